"""Computations measured apart, whose power is added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from eadp.errors import Infeasible
from eadp.models.profile import Profile


@dataclass(frozen=True)
class ProfileSum:
    """Average power of computations that were measured apart, g(c) = g1(c1, …) + g2(c2, …) + ….

    Parameters are those of the parts, in the order of the parts.

    Attributes
    ----------
    parts : tuple of Profile
        Two or more; no two have a parameter of one name.

    Raises
    ------
    Infeasible
        If a parameter stands twice.
    ValueError
        If there are fewer than two parts.

    Source: draft 002, section on computations: one interpolation for each task, their power added.
    """

    parts: tuple[Profile, ...]

    def __post_init__(self) -> None:
        if len(self.parts) < 2:
            raise ValueError("a sum of profiles needs two of them")
        twice = [name for i, name in enumerate(self.names) if name in self.names[:i]]
        if twice:
            raise Infeasible(f"two of the profiles that are added have a parameter {twice[0]}")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameters of all the parts."""
        return tuple(name for part in self.parts for name in part.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Their units; '' is not known."""
        return tuple(unit for part in self.parts for unit in part.units)

    def power_w_at(self, configuration: Sequence[float], clamp: bool = False) -> float:
        """Average power [W] with all of the computations running; see `Profile.power_w_at`.

        Raises
        ------
        Infeasible
            Where one of the parts has no value.
        """
        return sum(part.power_w_at(own, clamp) for part, own in self._split(configuration))

    def contains(self, configuration: Sequence[float]) -> bool:
        """Whether a configuration is within what was measured of every part."""
        return all(part.contains(own) for part, own in self._split(configuration))

    def nearest(self, configuration: Sequence[float]) -> tuple[float, ...]:
        """The nearest configuration inside; see `Interpolant.nearest`."""
        return tuple(value for part, own in self._split(configuration) for value in part.nearest(own))

    def outside(self, configuration: Sequence[float]) -> str:
        """Why a configuration is outside the measured range, as text."""
        return "; ".join(part.outside(own) for part, own in self._split(configuration) if not part.contains(own))

    def range_of(self, name: str) -> tuple[float, float]:
        """The smallest and the largest measured value of a parameter [its unit].

        Raises
        ------
        KeyError
            If no part has a parameter of that name.
        """
        for part in self.parts:
            if name in part.names:
                return part.range_of(name)
        raise KeyError(f"the profile has no parameter {name}, but {', '.join(self.names)}")

    def levels(self, index: int, lo: float, hi: float, *, measured: bool = False) -> tuple[float, ...]:
        """The values that a computation may take between two bounds; see `Profile.levels`."""
        for part in self.parts:
            if index < len(part.names):
                return part.levels(index, lo, hi, measured=measured)
            index -= len(part.names)
        raise IndexError("the profile has fewer parameters")

    def _split(self, configuration: Sequence[float]) -> list[tuple[Profile, Sequence[float]]]:
        """Each part with its own values."""
        if len(configuration) != len(self.names):
            raise ValueError(f"{len(configuration)} values for the parameters {', '.join(self.names)}")
        pieces, column = [], 0
        for part in self.parts:
            pieces.append((part, configuration[column : column + len(part.names)]))
            column += len(part.names)
        return pieces


AnyProfile = Profile | ProfileSum
"""Power of computations, measured together or apart."""


def added(profiles: Sequence[AnyProfile]) -> AnyProfile:
    """The sum of profiles, by their parts; a single one is returned.

    Raises
    ------
    Infeasible
        If a parameter stands in two of them.
    """
    parts = tuple(part for profile in profiles for part in profile.parts)
    return ProfileSum(parts) if len(parts) > 1 else parts[0]
