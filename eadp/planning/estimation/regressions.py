"""Online regressions in flight: time against forecast, power in turns, state of charge, parameters flown."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eadp.models.plan.cursor import Vector
from eadp.models.plan.stage import Box

RATIO_STD = 0.02
"""Prior standard deviation of the ratio of flown to forecast time, common to all legs."""

TIME_NOISE_S, TIME_NOISE_LEGS = 0.002, 4
"""Prior variance of a leg's time per second of it [s²/s] without gusts, and its weight in legs."""

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

JUMP, JUMP_STDS, MIN_JUMP = 0.01, 6.0, 1e-3
"""Innovation, absolute and in standard deviations, beyond which a reading is an outlier; and that of an exact gauge."""

SMALL_JUMP_STDS = 3.0
"""Innovation, in standard deviations, whose excess is charge that was lost."""

EXACT_GAUGE, NOISE_SHARE, FIRST_READINGS = 1e-8, 0.02, 60
"""Variance below which a gauge is exact; gain of its noise estimate; readings before the variance may shrink freely."""

RATIO_OF_USE_STD, SLOPE_OF_USE_STD, MAX_USE = 0.03, 0.1, 2.0
"""Prior standard deviations of the ratio of charge used to charge predicted, and of its change with the charge; and
the ratio's greatest value, and its least one's inverse."""

USE_DRIFT, USE_NOISE, UNMEASURED = 0.015, 5e-4, 0.3
"""Standard deviations per √charge: of the ratio's random walk, and of the charge used; and of a drain whose power was
not measured, as a share of it."""

GAUGE_QUANTUM, MAX_QUANTUM, CHECKED_DRAIN, CHECKED_QUANTA, CHECKED_STDS, MIN_FALL = 0.01, 0.1, 0.02, 2.5, 10.0, 0.25
"""Resolution of a gauge until it is seen, and at most; drain over which a gauge is checked, at least, in resolutions
and in standard deviations of its noise; and the least share of it by which it has to fall."""

GAUGE_GAIN_STD = 0.01
"""Standard deviation of a gauge's gain: what it counts of the charge used, less 1. No reading shows it."""


class TimeRatio:
    """Ratio of flown to forecast leg times, and the noise of each.

    A regression through the origin: flown − forecast = β · forecast + noise, whose variance grows with the time.

    Attributes
    ----------
    ratio : float
        1 + β.
    noise_s : float
        Variance of the noise per second [s²/s].

    Source: Bayesian linear regression with a normal prior.
    """

    def __init__(self) -> None:
        self.noise_s = TIME_NOISE_S
        self.ratio = 1.0
        self._forecast_s = self._excess_s = 0.0
        self._legs: list[tuple[float, float]] = []

    def learn(self, forecast_s: float, flown_s: float, gust_std_mps: float, airspeed_mps: float, stay_s: float) -> None:
        """Update with a flown leg.

        Parameters
        ----------
        forecast_s, flown_s : float
            Its forecast and its flown time [s].
        gust_std_mps, airspeed_mps, stay_s : float
            Standard deviation of the gusts, airspeed [m/s] and correlation time of the gusts [s], for the prior noise.
        """
        if not (forecast_s > 0 and math.isfinite(forecast_s)):
            return
        self._legs.append((forecast_s, flown_s))
        self._forecast_s += forecast_s
        self._excess_s += flown_s - forecast_s
        expected = _expected_noise_s(gust_std_mps, airspeed_mps, stay_s)
        beta = self._excess_s / (self._forecast_s + self.noise_s / RATIO_STD**2)
        squares = sum((flown - (1 + beta) * expected_s) ** 2 / expected_s for expected_s, flown in self._legs)
        self.noise_s = (TIME_NOISE_LEGS * expected + squares) / (TIME_NOISE_LEGS + len(self._legs))
        self.ratio = 1.0 + self._excess_s / (self._forecast_s + self.noise_s / RATIO_STD**2)

    def expect(self, gust_std_mps: float, airspeed_mps: float, stay_s: float) -> None:
        """Set the prior noise from forecast gusts, before any leg is flown."""
        self.noise_s = _expected_noise_s(gust_std_mps, airspeed_mps, stay_s)

    @property
    def variance(self) -> float:
        """Variance of the ratio."""
        return self.noise_s / (self._forecast_s + self.noise_s / RATIO_STD**2)

    def variance_s2(self, remaining_s: float) -> float:
        """Variance of a forecast time [s²]."""
        return remaining_s**2 * self.variance + self.noise_s * remaining_s


def _expected_noise_s(gust_std_mps: float, airspeed_mps: float, stay_s: float) -> float:
    """Variance of a leg's time per second of it [s]."""
    # a gust of σ and correlation time τ moves an aircraft by √(2 τ t) σ metres in t seconds
    return TIME_NOISE_S + 2 * stay_s * (gust_std_mps / airspeed_mps) ** 2


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
        self._prior = np.array([level, TURN_SHARE * level])
        self._prior_std = np.array([level_share * level, TURN_SHARE * level]) if level_w else np.array(UNKNOWN_W)
        self._first_noise = WINDOW_S * max(POWER_SHARE * level, MIN_POWER_STD_W) ** 2
        self._noise = self._first_noise
        # sums over windows, weighted by their time: of 1, x, x², y, xy, y²
        self._sums = np.zeros(6)
        self._windows = 0.0
        self._mean = self._prior
        self._covariance = np.diag(self._prior_std**2)
        self._energy_j = self._seconds = 0.0

    def reset_window(self) -> None:
        """Start a window."""
        self._energy_j = self._seconds = 0.0

    def observe(self, power_w: float, step_s: float, slope: float) -> None:
        """Take a reading of the motion's power [W] over a step [s] on a leg of mean tan² φ `slope`."""
        self._energy_j += power_w * step_s
        self._seconds += step_s
        if self._seconds >= WINDOW_S - 1e-9:
            self.end_window(slope)

    def end_window(self, slope: float) -> None:
        """End a window and update the regression."""
        seconds = self._seconds
        if seconds < WINDOW_S / 2:
            self.reset_window()
            return
        mean = self._energy_j / seconds
        kept = math.exp(-seconds / FADE_S)
        self._sums = kept * self._sums + seconds * np.array([1, slope, slope**2, mean, slope * mean, mean**2])
        self._windows = kept * self._windows + 1
        self.reset_window()
        n, x, xx, y, xy, yy = self._sums
        rows, moment = np.array([[n, x], [x, xx]]), np.array([y, xy])
        first = np.diag(1 / self._prior_std**2)
        noise = self._noise
        for _ in range(2):
            information = first + rows / noise
            best = np.linalg.solve(information, first @ self._prior + moment / noise)
            # Σ t (y − a − b x)²
            squares = max(float(yy - 2 * best @ moment + best @ rows @ best), 0.0)
            noise = (PRIOR_WINDOWS * self._first_noise + squares * 1.0) / (PRIOR_WINDOWS + self._windows)
        self._noise = noise
        self._mean, self._covariance = best, np.linalg.inv(first + rows / noise)

    @property
    def level_w(self) -> float:
        """a [W]."""
        return float(self._mean[0])

    @property
    def slope_w(self) -> float:
        """b [W], 0 or more."""
        return max(float(self._mean[1]), 0.0)

    def energy_variance_j2(self, seconds: float, bank_s: float) -> float:
        """Predictive variance of the energy over a time [s] with ∫ tan² φ dt [s]."""
        row = np.array([seconds, bank_s])
        return float(row @ self._covariance @ row) + self._noise * seconds


class ChargeFilter:
    """Kalman filter of the state of charge b: gauge readings against the charge drained by the power.

    The battery uses κ of the drain predicted, and κ changes by s for each charge: an inaccurate capacity, and a voltage
    that falls. Over a predicted drain d

        b ← b − κ d − ½ s d²,  κ ← κ + s d

    and κ drifts. A reading that repeats the last one says nothing: a coarse gauge is read where it changes. Its noise
    is estimated from differences. Two outliers in a row are accepted as a loss, or as the end of a false one. A gauge
    that falls by less than `MIN_FALL` of the drain, over more of it than the gauge resolves, is disbelieved until it
    agrees with the integral.

    Parameters
    ----------
    voltage_fall : float, optional
        By how much the voltage that predicts the drain falls from full to empty, as a share of its mean.

    Attributes
    ----------
    believed, rises : bool
        Whether the gauge is believed; and whether it rose where it was disbelieved.

    Source: Kalman filter.
    """

    def __init__(self, voltage_fall: float = 0.0) -> None:
        self._min_slope = -voltage_fall
        # κ is what is stated at half of the charge: when full, it is less by half of s
        slope = SLOPE_OF_USE_STD**2
        of_ratio = RATIO_OF_USE_STD**2 + slope / 4
        self._state: _ChargeState = (math.nan, 1.0, 0.0, 0.0, 0.0, 0.0, of_ratio, -slope / 2, slope)
        self._noise = self._drained = self._unmeasured = self._total = 0.0
        self._last: float | None = None
        self._first = math.nan
        self._outliers = 0
        self._count = self._readings = 1
        self._quantum, self._lost = GAUGE_QUANTUM, 0.0
        self.believed, self.rises = True, False
        self._checked = (math.nan, self._state, 0.0)

    @property
    def soc(self) -> float:
        """b."""
        return _drained(self._state, self._drained)[0]

    @property
    def variance(self) -> float:
        """Variance of b."""
        return _drained(self._state, self._drained)[3]

    def use(self, drain: float) -> tuple[float, float]:
        """Charge that the battery uses for a predicted drain from now on, and the variance of b thereafter.

        The slope has a least value: no voltage rises while the charge falls.

        Source: b ← b − κ d − ½ s d².
        """
        now = _drained(self._state, self._drained)
        now = (*now[:2], max(now[2], self._min_slope), *now[3:])
        then = _drained(now, drain)
        return now[0] - then[0], then[3]

    def gain_std(self, soc: float) -> float:
        """Standard deviation of b at a reading, as a gauge that is not exact counts too much or too little."""
        return 0.0 if self._noise < EXACT_GAUGE else GAUGE_GAIN_STD * max(self._first - soc, 0.0)

    def observe(self, reading: float, drained: float, *, measured: bool = True) -> bool:
        """Take a reading, with the charge drained since the last by prediction; return whether some was lost.

        Where its power was not measured, a drain says little of κ.
        """
        if self._last is None:
            self._last = self._first = reading
            self._state = (reading, *self._state[1:])
            self._checked = (reading, self._state, 0.0)
            return False
        self._drained += drained
        self._unmeasured += 0.0 if measured else drained
        self._total += drained
        self._readings += 1
        fell, self._last = self._last - reading, reading
        jumped = self._taken(reading, fell) if fell or self._outliers or not drained else False
        self._check(reading)
        return jumped

    def _taken(self, reading: float, fell: float) -> bool:
        """Update with a reading that is another than the last; return whether charge was lost."""
        self._count += 1
        since, state = self._drained, _drained(self._state, self._drained)
        state = (*state[:3], state[3] + (UNMEASURED * self._unmeasured) ** 2, *state[4:])
        error, variance = reading - state[0], self._bounded(state[3])
        if self._is_outlier(error, math.sqrt(variance + self._noise), since):
            self._outliers += 1
            exact, back = self._noise < EXACT_GAUGE, self.believed and error <= self._lost + MIN_JUMP
            if (self._outliers > 1 or exact) and (error < 0 or back):
                self.believed = True
                self._lost = max(self._lost - error, 0.0)
                self._state = (reading, *state[1:3], self._noise, 0.0, 0.0, *state[6:])
                self._drained = self._unmeasured = 0.0
                self._outliers, self._count, self._readings = 0, 2, 2
                self._checked = (reading, self._state, self._total)
                return True
            return False
        self._outliers = 0
        if not self.believed:
            return False
        if self._noise >= EXACT_GAUGE:  # a small loss is one of charge, not of capacity
            variance += max(0.0, error * error - SMALL_JUMP_STDS**2 * (variance + self._noise))
        if not self._unmeasured:
            change = state[1] * since - fell
            self._noise += max(NOISE_SHARE, 1 / (self._count - 1)) * (change * change / 2 - self._noise)
        self._quantum = min(max(self._quantum, fell), MAX_QUANTUM)
        self._state = _corrected(state, variance, error, self._noise)
        self._drained = self._unmeasured = 0.0
        return False

    def _check(self, reading: float) -> None:
        """Compare what the gauge has fallen by with the drain, now and then; once disbelieved, with the integral."""
        first, state, total = self._checked
        drain = self._total - total
        if drain < max(CHECKED_DRAIN, CHECKED_QUANTA * self._quantum, CHECKED_STDS * math.sqrt(self._noise)):
            return
        fell, expected = first - reading, state[1] * drain
        falls = MIN_FALL * expected <= fell
        if self.believed and not falls:
            self.believed, self.rises = False, fell < 0
            self._state, self._drained = _drained(state, drain), 0.0
        elif falls and fell <= expected / MIN_FALL:
            far = max(CHECKED_QUANTA * self._quantum, JUMP_STDS * math.sqrt(self.variance))
            self.believed = self.believed or reading <= self.soc + far
        self._checked = (reading, _drained(self._state, self._drained), self._total)

    def is_ambiguous(self, soc: float) -> bool:
        """Whether the last reading, or a charge not yet taken, may be an outlier: the next reading decides."""
        return self._outliers > 0 or abs(soc - self.soc) > MIN_JUMP

    def _bounded(self, variance: float) -> float:
        """A variance of b, at or above that of the mean of the first readings."""
        return max(variance, self._noise / (self._count - 1)) if self._count <= FIRST_READINGS else variance

    def _is_outlier(self, error: float, std: float, drained: float) -> bool:
        if self._noise < EXACT_GAUGE and self._readings > 2:
            return abs(error) > MIN_JUMP + 10 * drained
        return self._readings > 4 and abs(error) > JUMP and abs(error) > JUMP_STDS * std


_ChargeState = tuple[float, float, float, float, float, float, float, float, float]
"""b, κ, s; their covariances bb, bκ, bs, κκ, κs, ss."""


def _drained(state: _ChargeState, d: float) -> _ChargeState:
    """The state after a predicted drain d."""
    b, ratio, slope, bb, bk, bs, kk, ks, ss = state
    h = d * d / 2
    # F P Fᵀ + Q with F = [[1, −d, −d²/2], [0, 1, d], [0, 0, 1]]
    row_b, row_k, row_s = bb - d * bk - h * bs, bk - d * kk - h * ks, bs - d * ks - h * ss
    drift = USE_DRIFT**2 * d
    return (
        b - ratio * d - slope * h,
        ratio + slope * d,
        slope,
        row_b - d * row_k - h * row_s + USE_NOISE**2 * d + drift * d * d / 3,
        row_k + d * row_s - drift * d / 2,
        row_s,
        kk + 2 * d * ks + d * d * ss + drift,
        ks + d * ss,
        ss,
    )


def _corrected(state: _ChargeState, variance: float, error: float, noise: float) -> _ChargeState:
    """The state after a reading of b that is off by `error`, of variance `noise`; b's is `variance`."""
    b, ratio, slope, _, bk, bs, kk, ks, ss = state
    total = max(variance + noise, 1e-18)
    gain = variance / total if noise > 1e-12 else 1.0
    k, s = bk / total, bs / total
    left = 1.0 - gain
    ratio = min(max(ratio + k * error, 1 / MAX_USE), MAX_USE)
    return (
        *(b + gain * error, ratio, slope + s * error),
        *(variance * left, bk * left, bs * left, kk - k * bk, ks - k * bs, ss - s * bs),
    )


class ParameterAverages:
    """Time integrals of the parameters flown, as shares of their sets, over the time in which each was free."""

    def __init__(self, count: int) -> None:
        self.areas_s = [0.0] * count
        self.times_s = [0.0] * count
        self._since_s = 0.0
        self._held: tuple[Vector, Sequence[Box]] | None = None

    def hold(self, time_s: float, parameters: Vector, sets: Sequence[Box]) -> None:
        """Parameters and sets in force from a time on [s]."""
        if self._held is not None:
            self.times_s, self.areas_s = self.until(time_s)
        self._since_s, self._held = time_s, (parameters, sets)

    def until(self, time_s: float) -> tuple[list[float], list[float]]:
        """Times and areas of shares up to a time [s], the parameters in force included."""
        times, areas = list(self.times_s), list(self.areas_s)
        if self._held is not None and self._held[1]:
            duration = time_s - self._since_s
            for i, (value, box) in enumerate(zip(*self._held, strict=True)):
                share = box.share(value)
                if share is not None:
                    areas[i] += share * duration
                    times[i] += duration
        return times, areas
