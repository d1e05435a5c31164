"""The energy model of a power log: its period and harmonics, or its mean alone. Source: letter, Sec. III-A."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray
from eadp.core.signals import coefficients_of_state, signal_w, state_of_phases


@dataclass(frozen=True, slots=True)
class Harmonic:
    """One term: amplitude_w · cos(2πjt/period_s + phase_rad)."""

    amplitude_w: Annotated[float, Ge(0), Le(1e9)]
    """[W]."""

    phase_rad: Annotated[float, Ge(-1e3), Le(1e3)]
    """[rad]."""


@dataclass(frozen=True, slots=True)
class Coefficients:
    """The papers' coefficients [W s]: a0..ar and b1..br. Source: letter, Eq. 3."""

    a: tuple[float, ...]
    """a0..ar."""

    b: tuple[float, ...]
    """b1..br."""


@dataclass(frozen=True)
class EnergyModel:
    """power = mean + Σ_j amplitude_j cos(2πjt/period + phase_j), t from the first sample kept.

    Attributes
    ----------
    period_s : float or None
        The period [s]; None where the log has none, and then there are no harmonics.
    mean_w : float
        Mean power [W].
    harmonics : tuple of Harmonic
    noise_std_w : float
        Standard deviation of the residuals [W].
    period_std_s : float or None
        Standard deviation of the period [s].
    cv_r2 : float
        Cross-validated R²: share of the variance explained in held-out blocks.
    samples : int
    span_s : float
        Time from the first sample to the last [s].
    mean_std_w : float or None
    amplitude_std_w : tuple of float
        Standard deviations of the mean and of the amplitudes [W]; None and empty where they are not known.
    """

    period_s: float | None
    mean_w: float
    harmonics: tuple[Harmonic, ...] = ()
    noise_std_w: float = 0.0
    period_std_s: float | None = None
    cv_r2: float = 0.0
    samples: int = 0
    span_s: float = 0.0
    mean_std_w: float | None = None
    amplitude_std_w: tuple[float, ...] = ()

    @property
    def periodic(self) -> bool:
        """Whether there is a period."""
        return self.period_s is not None

    @property
    def order(self) -> int:
        """r, the number of harmonics."""
        return len(self.harmonics)

    @property
    def coefficients(self) -> Coefficients:
        """The papers' coefficients; none without a period, which their scaling needs."""
        if self.period_s is None:
            return Coefficients((), ())
        a, b = coefficients_of_state(self.state_w(), self.period_s)
        return Coefficients(tuple(a.tolist()), tuple(b.tolist()))

    def state_w(self, order: int | None = None) -> FloatArray:
        """The energy state q at t = 0.

        Parameters
        ----------
        order : int, optional
            Number of harmonics of the result: the model's are truncated or padded with zeros. Default: the model's.

        Returns
        -------
        array, shape (2·order + 1,)
            q [W].

        Source: letter, Lemma III.1, corrected.
        """
        amplitude = [harmonic.amplitude_w for harmonic in self.harmonics]
        state = state_of_phases(self.mean_w, amplitude, [harmonic.phase_rad for harmonic in self.harmonics])
        result = np.zeros(2 * (self.order if order is None else order) + 1)
        size = min(len(result), len(state))
        result[:size] = state[:size]
        return result

    def power_w(self, times_s: ArrayLike) -> FloatArray:
        """The model's power [W] at times [s] from the first sample, the same shape."""
        times = np.asarray(times_s, dtype=float)
        if self.period_s is None:
            return np.full(times.shape, self.mean_w)
        return signal_w(times, self.coefficients.a, self.coefficients.b, self.period_s)
