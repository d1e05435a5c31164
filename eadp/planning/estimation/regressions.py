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

EXACT_GAUGE, NOISE_SHARE, FIRST_READINGS = 1e-8, 0.02, 60
"""Variance below which a gauge is exact; gain of its noise estimate; readings before the variance may shrink freely."""


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
    """Scalar Kalman filter of the state of charge: gauge readings against the charge drained by the power.

    The gauge's noise is estimated from differences of readings. Two outliers in a row are a jump, which is accepted.

    Attributes
    ----------
    soc : float
    variance : float

    Source: scalar Kalman filter.
    """

    def __init__(self) -> None:
        self.soc = math.nan
        self.variance = 0.0
        self._noise = 0.0
        self._last: float | None = None
        self._outliers = 0
        self._count = 1

    def observe(self, reading: float, drained: float) -> bool:
        """Take a reading, with the charge drained since the last; return whether it has jumped."""
        if self._last is None:
            self.soc = self._last = reading
            return False
        change = reading - self._last + drained
        self._last = reading
        self._count += 1
        expected = self.soc - drained
        self.variance += (0.05 * drained) ** 2 + 1e-14
        self._bound_variance()
        error = reading - expected
        if self._jumps(error, drained):
            self._outliers += 1
            if self._outliers > 1 or self._noise < EXACT_GAUGE:
                self.soc, self.variance, self._outliers, self._count = reading, self._noise, 0, 2
                return True
            self.soc = expected
            return False
        self._outliers = 0
        self._noise += max(NOISE_SHARE, 1 / (self._count - 1)) * (change * change / 2 - self._noise)
        self._bound_variance()
        gain = self.variance / (self.variance + self._noise) if self._noise > 1e-12 else 1.0
        self.soc = expected + gain * error
        self.variance *= 1 - gain
        return False

    def is_ambiguous(self, soc: float) -> bool:
        """Whether the last reading, or a charge not yet taken, may be an outlier: the next reading decides."""
        return self._outliers > 0 or abs(soc - self.soc) > MIN_JUMP

    def _bound_variance(self) -> None:
        """Keep the variance at or above that of the mean of the first readings."""
        if self._count <= FIRST_READINGS:
            self.variance = max(self.variance, self._noise / (self._count - 1))

    def _jumps(self, error: float, drained: float) -> bool:
        if self._noise < EXACT_GAUGE and self._count > 2:
            return abs(error) > MIN_JUMP + 10 * drained
        std = math.sqrt(self.variance + self._noise)
        return self._count > 4 and abs(error) > JUMP and abs(error) > JUMP_STDS * std


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
