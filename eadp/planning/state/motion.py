"""Power of the motion in flight: a regression on level flight and turns."""

from __future__ import annotations

import math
from typing import NamedTuple

from eadp.core.arrays import Column, columns
from eadp.core.compiled import jitted

TURN_SHARE = 0.3
"""Prior mean and standard deviation of the power per tan² φ, as a share of level flight's: induced drag is about a
third of the drag at cruise."""

LEVEL_SHARE = 0.05
"""Relative prior standard deviation of level flight's power."""

UNKNOWN_W = (1000.0, 30.0)
"""Standard deviations of level flight's power and of a bank's without prior values [W]."""

WINDOW_S, FADE_S = 5.0, 900.0
POWER_SHARE, MIN_POWER_STD_W, PRIOR_WINDOWS = 0.03, 0.2, 3
"""Prior standard deviation of a window's mean power, as a share of the level's and at least [W]; and its weight in
windows."""


class MotionPrior(NamedTuple):
    """Prior of a and b: means [W] and inverse variances [1/W²]; and the noise of the windows [J²/s]."""

    level_w: float
    slope_w: float
    level_information: float
    slope_information: float
    noise: float


class MotionWindow(NamedTuple):
    """Energy [J] of the window of readings that is open, and its time [s]."""

    energy_j: float
    seconds: float


class MotionSums(NamedTuple):
    """Sums over the windows that have ended, weighted by their times and faded: of 1, x, x², y, xy and y².

    x is tan² φ, y the mean power [W]; and the number of windows, faded, too.
    """

    n: float
    x: float
    xx: float
    y: float
    xy: float
    yy: float
    windows: float


class MotionFit(NamedTuple):
    """Posterior of a and b [W], their variances and covariance [W²], and the noise of the windows [J²/s]."""

    level_w: float
    slope_w: float
    level_variance: float
    covariance: float
    slope_variance: float
    noise: float


class MotionState(NamedTuple):
    """State of `MotionPower`."""

    window: MotionWindow
    sums: MotionSums
    fit: MotionFit


class MotionPower:
    """Regression of the motion power, a + b tan² φ, on means over short windows.

    Windows count as independent, which holds for gusts shorter than one; the noise is estimated from the residuals.
    Information fades over `FADE_S`, so that slow changes are followed.

    Parameters
    ----------
    level_w : float or None
        Prior power of level flight [W].
    level_share : float
        Its standard deviation, as a share of it.

    Source: induced drag grows with the square of the load factor (Anderson 1999); Bayesian linear regression.
    """

    def __init__(self, level_w: float | None, level_share: float = LEVEL_SHARE) -> None:
        level = level_w or 0.0
        level_std, slope_std = (level_share * level, TURN_SHARE * level) if level_w else UNKNOWN_W
        noise = WINDOW_S * max(POWER_SHARE * level, MIN_POWER_STD_W) ** 2
        self._prior = MotionPrior(level, TURN_SHARE * level, 1 / level_std**2, 1 / slope_std**2, noise)
        fit = MotionFit(level, TURN_SHARE * level, level_std**2, 0.0, slope_std**2, noise)
        self._state = MotionState(MotionWindow(0.0, 0.0), MotionSums(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), fit)

    def ingest(self, powers_w: Column, beside_w: Column, steps_s: Column, slope: float) -> None:
        """Take readings in order, on a leg.

        Parameters
        ----------
        powers_w, beside_w : sequence of float or array, shape (n,)
            Readings of power, NaN for none, and the part of each that is not the motion's [W].
        steps_s : sequence of float or array, shape (n,)
            Times since the last reading [s]; a reading without a time counts for nothing.
        slope : float
            Mean tan² φ of the leg.
        """
        ingested = jitted(_ingested)
        powers_w, beside_w, steps_s = columns(powers_w, beside_w, steps_s)
        self._state = ingested(self._state, self._prior, powers_w, beside_w, steps_s, slope)

    def end_window(self, slope: float) -> None:
        """End the window of readings, on a leg of mean tan² φ `slope`, and update the regression."""
        self._state = _window_ended(self._state, self._prior, slope)

    @property
    def level_w(self) -> float:
        """a [W]."""
        return self._state.fit.level_w

    @property
    def slope_w(self) -> float:
        """b [W], 0 or more."""
        return max(self._state.fit.slope_w, 0.0)

    def energy_variance_j2(self, seconds: float, bank_s: float) -> float:
        """Predictive variance of the energy over a time [s] with ∫ tan² φ dt [s]."""
        aa, ab, bb, noise = self.variances
        return seconds * seconds * aa + 2 * seconds * bank_s * ab + bank_s * bank_s * bb + noise * seconds

    @property
    def variances(self) -> tuple[float, float, float, float]:
        """Covariance of a and b: aa, ab, bb; and the variance of the energy per second beside [J²/s]."""
        return self._state.fit[2:]


# The functions below may be compiled, see `eadp.core.compiled`.


def _ingested(
    state: MotionState, prior: MotionPrior, powers_w: Column, beside_w: Column, steps_s: Column, slope: float
) -> MotionState:
    """See `MotionPower.ingest`."""
    for i in range(len(powers_w)):
        if steps_s[i] > 0.0 and not math.isnan(powers_w[i]):
            window = state.window
            energy_j = window.energy_j + (powers_w[i] - beside_w[i]) * steps_s[i]
            state = MotionState(MotionWindow(energy_j, window.seconds + steps_s[i]), state.sums, state.fit)
            if state.window.seconds >= WINDOW_S - 1e-9:
                state = _window_ended(state, prior, slope)
    return state


def _window_ended(state: MotionState, prior: MotionPrior, slope: float) -> MotionState:
    """The state after a window; one shorter than half of `WINDOW_S` is left out."""
    window, sums, fit = state
    seconds = window.seconds
    if seconds < WINDOW_S / 2:
        return MotionState(MotionWindow(0.0, 0.0), sums, fit)
    mean_w = window.energy_j / seconds
    kept = math.exp(-seconds / FADE_S)
    sums = MotionSums(
        kept * sums.n + seconds,
        kept * sums.x + seconds * slope,
        kept * sums.xx + seconds * (slope * slope),
        kept * sums.y + seconds * mean_w,
        kept * sums.xy + seconds * (slope * mean_w),
        kept * sums.yy + seconds * (mean_w * mean_w),
        kept * sums.windows + 1,
    )
    # the residuals' noise depends on the fit, and the fit on the noise: in turns
    for _ in range(2):
        fit = _fitted(sums, prior, fit.noise)
        a, b = fit.level_w, fit.slope_w
        # Σ t (y − a − b x)²
        of_products = sums.yy - 2 * (a * sums.y + b * sums.xy)
        squares = max(of_products + a * a * sums.n + 2 * a * b * sums.x + b * b * sums.xx, 0.0)
        noise = (PRIOR_WINDOWS * prior.noise + squares) / (PRIOR_WINDOWS + sums.windows)
        fit = MotionFit(*fit[:5], noise)
    variances = _fitted(sums, prior, fit.noise)[2:5]
    return MotionState(MotionWindow(0.0, 0.0), sums, MotionFit(fit.level_w, fit.slope_w, *variances, fit.noise))


def _fitted(sums: MotionSums, prior: MotionPrior, noise: float) -> MotionFit:
    """Posterior of a and b [W] and their covariance [W²], by the sums over windows and a given noise [J²/s]."""
    # (P⁻¹ + XᵀX/v) (a, b) = P⁻¹ prior + Xᵀy/v, with P the prior covariance and v the noise
    info_aa, info_ab = prior.level_information + sums.n / noise, sums.x / noise
    info_bb = prior.slope_information + sums.xx / noise
    rhs_a = prior.level_information * prior.level_w + sums.y / noise
    rhs_b = prior.slope_information * prior.slope_w + sums.xy / noise
    determinant = info_aa * info_bb - info_ab * info_ab
    a, b = (info_bb * rhs_a - info_ab * rhs_b) / determinant, (info_aa * rhs_b - info_ab * rhs_a) / determinant
    return MotionFit(a, b, info_bb / determinant, -info_ab / determinant, info_aa / determinant, noise)
