"""The computation energy model: average power of the computations at a configuration of their parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.interpolation import Interpolant, Kind, interpolant
from eadp.errors import Infeasible

LEVELS_LIMIT = 100_000
"""Most values of a computation: a larger set is a real number."""

WHOLE = 1e-9
"""Tolerance of a whole number of steps."""

ARRAYS = ("configurations", "power_w", "std_w", "samples", "standard_error_w")
"""Names of the arrays of a profile, one row for each configuration."""

DEFAULTS = {"std_w": 0.0, "samples": 1.0, "standard_error_w": math.nan}
"""What is in an array that is not given."""


def configuration_text(names: Sequence[str], values: Sequence[float], separator: str = ", ") -> str:
    """A configuration as in `fps=2, keysize=32`."""
    return separator.join(f"{name}={value:.10g}" for name, value in zip(names, values, strict=True))


def titles(names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Parameters with their units where they are known, as in `fps [1/s]`."""
    return [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]


def shortest(value: float) -> float | int:
    """A number as people write it: a whole one without its point."""
    return int(value) if float(value).is_integer() and abs(value) < 1e15 else value


@dataclass(frozen=True, eq=False)
class Profile:
    """Average power of the computations, measured at n configurations of d parameters.

    Kept in the order of the configurations, the first parameter changing slowest; arrays are read-only.

    Attributes
    ----------
    names, units : tuple of d str
        Parameters and their units; a unit of '' is not known.
    configurations : array, shape (n, d)
        Measured configurations [units], each once.
    power_w : array, shape (n,)
        Average power at each [W].
    std_w : array, shape (n,)
        Standard deviation of its samples [W]; 0 of one sample. Default: all 0.
    samples : array, shape (n,)
        How many measurements were averaged. Default: 1 each.
    interpolation : str
        `linear`, or `pchip` where one parameter changes.
    source : str
        Where the measurements come from.
    standard_error_w : array, shape (n,)
        Standard deviation of `power_w` as a mean [W], consecutive samples being alike; NaN where it is not known.
        Default: all NaN.

    Raises
    ------
    Infeasible
        If there is no interpolation over the configurations (see `eadp.core.interpolation.interpolant`).
    ValueError
        If the shapes do not fit, a number is not finite, or a configuration stands twice.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    configurations: FloatArray
    power_w: FloatArray
    std_w: FloatArray = field(default_factory=lambda: np.empty(0))
    samples: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    interpolation: Kind = "linear"
    source: str = ""
    standard_error_w: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        points = np.array(self.configurations, dtype=np.float64)
        n = len(points)
        if points.shape != (n, len(self.names)) or len(self.units) != len(self.names):
            raise ValueError(f"{points.shape} configurations do not fit the names {self.names}")
        if not (np.isfinite(points).all() and np.isfinite(self.power_w).all()):
            raise ValueError("a configuration or its power is not finite")
        known, times = np.unique(points, axis=0, return_counts=True)
        if len(known) < n:
            twice = configuration_text(self.names, known[np.argmax(times)])
            raise ValueError(f"the configuration {twice} stands twice")
        order = np.lexsort(points.T[::-1])
        for name in ARRAYS:
            given = getattr(self, name)
            if name in DEFAULTS and not np.size(given):
                given = np.full(n, DEFAULTS[name])
            column = np.array(given, dtype=np.int64 if name == "samples" else np.float64)
            if len(column) != n:
                raise ValueError(f"{len(column)} {name} do not fit {n} configurations")
            column = column[order]
            column.setflags(write=False)
            object.__setattr__(self, name, column)
        _ = self.interpolant  # what cannot be interpolated is no profile

    @cached_property
    def interpolant(self) -> Interpolant:
        """The interpolation of power [W] over the configurations."""
        return interpolant(self.configurations, self.power_w, self.interpolation)

    def power_w_at(self, configuration: Sequence[float]) -> float:
        """Average power of the computations at a configuration.

        Parameters
        ----------
        configuration : d floats
            One value for each of `names` [units].

        Returns
        -------
        float
            Power [W].

        Raises
        ------
        Infeasible
            Outside the measured range.

        Source: letter, Eq. 13 (corrected).
        """
        try:
            return self.interpolant.at(configuration)
        except Infeasible:
            raise Infeasible(self._outside(configuration)) from None

    def _outside(self, configuration: Sequence[float]) -> str:
        """Why a configuration of d floats is outside the measured range, as text."""
        bounds = zip(self.names, configuration, self.interpolant.lower, self.interpolant.upper, strict=True)
        parts = [
            f"{name}={value:.10g} is outside the measured {least:.10g} to {most:.10g}"
            for name, value, least, most in bounds
            if not least <= value <= most
        ]
        named = configuration_text(self.names, configuration)
        return "; ".join(parts) or f"{named} is outside the hull of the measured ones"

    def levels(self, index: int, lo: float, hi: float, *, measured: bool = False) -> tuple[float, ...]:
        """The values that a computation may take between two bounds, both included.

        Whole steps from the lower bound; but where a measured value within the bounds is not reached by them and the
        profile was not measured at whole steps either (0.5, 1 and 2 frames per second), the measured values, and the
        lower bound where it lies between two.

        Parameters
        ----------
        index : int
            Which of `names`.
        lo, hi : float
            Bounds [unit of the parameter].
        measured : bool, optional
            Only the measured values, and the bounds.

        Returns
        -------
        tuple of float
            Increasing [unit of the parameter]; empty for lo > hi.

        Raises
        ------
        Infeasible
            If these are more than `LEVELS_LIMIT`.
        """
        values = [float(value) for value in np.unique(self.configurations[:, index])]
        inside = [value for value in values if lo <= value <= hi]
        if measured:
            return tuple(sorted({lo, *inside, hi}))
        if not (_whole_steps(lo, inside) or _whole_steps(values[0], values)):
            return (lo, *inside) if inside[0] > lo > values[0] else tuple(inside)
        if not hi - lo < LEVELS_LIMIT:
            name = self.names[index]
            raise Infeasible(f"{name} from {lo:g} to {hi:g} has more than {LEVELS_LIMIT:,} whole steps")
        return tuple(float(min(lo + k, hi)) for k in range(math.floor(hi - lo + WHOLE) + 1))


def _whole_steps(start: float, values: Sequence[float]) -> bool:
    """Whether whole steps from a start reach every value."""
    return all(abs(value - start - round(value - start)) <= WHOLE for value in values)
