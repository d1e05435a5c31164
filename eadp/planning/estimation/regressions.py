"""What a flight has told so far about itself: time against forecast, power in turns, charge, and parameters flown."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eadp.models.plan.executor import Vector
from eadp.models.plan.plan import Box

RATIO_STD = 0.02
"""Standard deviation of flown to forecast time before anything is flown: of what every leg shares."""

TIME_NOISE_S, TIME_NOISE_LEGS = 0.002, 4
"""Variance of a leg's time per second of it [s²/s] in calm air, and how many legs that knowledge is worth."""

TURN_SHARE = 0.3
"""Power that a bank takes for each tan² φ, as a share of level flight's, and its standard deviation: induced drag is a
third or so of an aeroplane's at its cruise."""

LEVEL_SHARE = 0.05
"""Standard deviation of level flight's power as told before take-off, as a share of it."""

UNKNOWN_W = (1000.0, 30.0)
"""Standard deviations of level flight's power and of a bank's where nothing is known of either [W]."""

WINDOW_S, FADE_S = 5.0, 900.0
POWER_SHARE, MIN_POWER_STD_W, PRIOR_WINDOWS = 0.03, 0.2, 3
"""How far a spell's mean power is off before any is flown, as a share of the level's and at least [W]; and how many
spells that knowledge is worth."""

JUMP, JUMP_STDS, MIN_JUMP = 0.01, 6.0, 1e-3
"""A reading farther off than this, and than so many standard deviations, is odd; of an exact gauge, by the last."""

EXACT_GAUGE, NOISE_SHARE, FIRST_READINGS = 1e-8, 0.02, 60
"""Variance below which a gauge is exact; how fast its noise is learned at last; how many readings are the first."""


class TimeRatio:
    """How much longer legs take than is forecast, all alike, and how much each differs.

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
        """A leg has been flown.

        Parameters
        ----------
        forecast_s, flown_s : float
            Its time as it would have been forecast, and as it was [s].
        gust_std_mps, airspeed_mps, stay_s : float
            Spread of the gusts, airspeed [m/s] and how long a gust stays [s]: what to expect of the noise.
        """
        if not (forecast_s > 0 and math.isfinite(forecast_s)):
            return
        self._legs.append((forecast_s, flown_s))
        self._forecast_s += forecast_s
        self._excess_s += flown_s - forecast_s
        expected = _expected_noise_s(gust_std_mps, airspeed_mps, stay_s)
        beta = self._excess_s / (self._forecast_s + self.noise_s / RATIO_STD**2)
        squares = sum((flown - (1 + beta) * told) ** 2 / told for told, flown in self._legs)
        self.noise_s = (TIME_NOISE_LEGS * expected + squares) / (TIME_NOISE_LEGS + len(self._legs))
        self.ratio = 1.0 + self._excess_s / (self._forecast_s + self.noise_s / RATIO_STD**2)

    def expect(self, gust_std_mps: float, airspeed_mps: float, stay_s: float) -> None:
        """Nothing is flown yet, and gusts are told."""
        self.noise_s = _expected_noise_s(gust_std_mps, airspeed_mps, stay_s)

    @property
    def variance(self) -> float:
        """Of the ratio."""
        return self.noise_s / (self._forecast_s + self.noise_s / RATIO_STD**2)

    def variance_s2(self, remaining_s: float) -> float:
        """Variance of a time that is forecast [s²]."""
        return remaining_s**2 * self.variance + self.noise_s * remaining_s


def _expected_noise_s(gust_std_mps: float, airspeed_mps: float, stay_s: float) -> float:
    """Variance of a leg's time per second of it [s]."""
    # a gust of σ that stays τ moves an aircraft by √(2 τ t) σ metres in t seconds
    return TIME_NOISE_S + 2 * stay_s * (gust_std_mps / airspeed_mps) ** 2


class MotionPower:
    """The motion's power = a + b tan² φ: that of level flight, and what a bank costs, from means over short spells.

    Spells are taken as independent, which gusts that stay for less than one are; their noise is learned from how far
    they are off. What is known fades over `FADE_S`, so that a slow change is followed.

    Parameters
    ----------
    level_w : float or None
        Power of level flight as told before take-off [W].
    level_share : float
        Its standard deviation, as a share of it.

    Source: induced drag grows with the square of the load factor (Anderson 1999); Bayesian linear regression.
    """

    def __init__(self, level_w: float | None, level_share: float = LEVEL_SHARE) -> None:
        level = level_w or 0.0
        self._prior = np.array([level, TURN_SHARE * level])
        self._spread = np.array([level_share * level, TURN_SHARE * level]) if level_w else np.array(UNKNOWN_W)
        self._first_noise = WINDOW_S * max(POWER_SHARE * level, MIN_POWER_STD_W) ** 2
        self._noise = self._first_noise
        # sums over spells, weighted by their time: of 1, x, x², y, xy, y²
        self._sums = np.zeros(6)
        self._spells = 0.0
        self._mean = self._prior
        self._covariance = np.diag(self._spread**2)
        self._energy_j = self._seconds = 0.0

    def reset_window(self) -> None:
        """Begin a spell."""
        self._energy_j = self._seconds = 0.0

    def observe(self, power_w: float, step_s: float, slope: float) -> None:
        """Take a reading of the motion's power [W] over a step [s] on a leg of mean tan² φ `slope`."""
        self._energy_j += power_w * step_s
        self._seconds += step_s
        if self._seconds >= WINDOW_S - 1e-9:
            self.end_window(slope)

    def end_window(self, slope: float) -> None:
        """A spell has ended."""
        seconds = self._seconds
        if seconds < WINDOW_S / 2:
            self.reset_window()
            return
        mean = self._energy_j / seconds
        kept = math.exp(-seconds / FADE_S)
        self._sums = kept * self._sums + seconds * np.array([1, slope, slope**2, mean, slope * mean, mean**2])
        self._spells = kept * self._spells + 1
        self.reset_window()
        n, x, xx, y, xy, yy = self._sums
        rows, told = np.array([[n, x], [x, xx]]), np.array([y, xy])
        first = np.diag(1 / self._spread**2)
        noise = self._noise
        for _ in range(2):
            information = first + rows / noise
            best = np.linalg.solve(information, first @ self._prior + told / noise)
            # Σ t (y − a − b x)²
            squares = max(float(yy - 2 * best @ told + best @ rows @ best), 0.0)
            noise = (PRIOR_WINDOWS * self._first_noise + squares * 1.0) / (PRIOR_WINDOWS + self._spells)
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
        """Variance of the energy of so much time [s] with so much of ∫ tan² φ dt [s], the noise to come included."""
        row = np.array([seconds, bank_s])
        return float(row @ self._covariance @ row) + self._noise * seconds


class ChargeFilter:
    """State of charge from a gauge that may be noisy: readings against what the power should have drained.

    The gauge's noise is learned from how readings differ from one to the next. A reading that is off by far more than
    that, twice, is a jump and is believed.

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
        self._odd = 0
        self._count = 1

    def observe(self, reading: float, drained: float) -> bool:
        """Take a reading after so much should have been drained since the last; return whether it has jumped."""
        if self._last is None:
            self.soc = self._last = reading
            return False
        change = reading - self._last + drained
        self._last = reading
        self._count += 1
        expected = self.soc - drained
        self.variance += (0.05 * drained) ** 2 + 1e-14
        self._not_surer()
        error = reading - expected
        if self._jumps(error, drained):
            self._odd += 1
            if self._odd > 1 or self._noise < EXACT_GAUGE:
                self.soc, self.variance, self._odd, self._count = reading, self._noise, 0, 2
                return True
            self.soc = expected
            return False
        self._odd = 0
        self._noise += max(NOISE_SHARE, 1 / (self._count - 1)) * (change * change / 2 - self._noise)
        self._not_surer()
        gain = self.variance / (self.variance + self._noise) if self._noise > 1e-12 else 1.0
        self.soc = expected + gain * error
        self.variance *= 1 - gain
        return False

    def is_ambiguous(self, soc: float) -> bool:
        """Whether the last reading was odd, or a charge that is not taken for one is: the next will tell."""
        return self._odd > 0 or abs(soc - self.soc) > MIN_JUMP

    def _not_surer(self) -> None:
        """Not surer than a mean of the readings so far: the first of them was no better than the others."""
        if self._count <= FIRST_READINGS:
            self.variance = max(self.variance, self._noise / (self._count - 1))

    def _jumps(self, error: float, drained: float) -> bool:
        if self._noise < EXACT_GAUGE and self._count > 2:
            return abs(error) > MIN_JUMP + 10 * drained
        spread = math.sqrt(self.variance + self._noise)
        return self._count > 4 and abs(error) > JUMP and abs(error) > JUMP_STDS * spread


class ParameterAverages:
    """Parameters flown so far, as shares of their sets: area and time of each while it had a choice."""

    def __init__(self, count: int) -> None:
        self.areas_s = [0.0] * count
        self.times_s = [0.0] * count
        self._since_s = 0.0
        self._held: tuple[Vector, Sequence[Box]] | None = None

    def hold(self, time_s: float, parameters: Vector, sets: Sequence[Box]) -> None:
        """From a time on [s] these are flown."""
        if self._held is not None:
            self.times_s, self.areas_s = self.until(time_s)
        self._since_s, self._held = time_s, (parameters, sets)

    def until(self, time_s: float) -> tuple[list[float], list[float]]:
        """Times and areas of shares up to a time [s], what is held included."""
        times, areas = list(self.times_s), list(self.areas_s)
        if self._held is not None and self._held[1]:
            duration = time_s - self._since_s
            for i, (value, box) in enumerate(zip(*self._held, strict=True)):
                share = box.share(value)
                if share is not None:
                    areas[i] += share * duration
                    times[i] += duration
        return times, areas
