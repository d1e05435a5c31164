"""What is known of a flight at one moment: numbers that a forecast starts from. Immutable."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.models.autopilot import Autopilot
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.ground import FlownGround
from eadp.models.vehicle import Airframe, PowerTerms
from eadp.planning.state.charge import Charge
from eadp.planning.state.climb import Climb


class WindKnown(NamedTuple):
    """Wind [m/s], the variances of both components and their covariance [m²/s²], and its gusts' deviation [m/s]."""

    mps: Point = (0.0, 0.0)
    covariance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust_std_mps: float = 0.0


class TimeKnown(NamedTuple):
    """Ratio of flown to forecast times of legs, its variance, and the variance of a leg's time per second of it."""

    ratio: float
    variance: float
    noise_s: float

    def var_s2(self, seconds: Any, wind_var: Any = 0.0) -> Any:
        """Variance of times, numbers or arrays; `wind_var` is that of their logarithm due to the wind."""
        # var t = t² (var ratio + var log t) + noise t
        return seconds**2 * (self.variance + wind_var) + self.noise_s * seconds


class MotionKnown(NamedTuple):
    """Power of the motion as learned in flight: at the airframe's own airspeed a + b tan² φ.

    Attributes
    ----------
    level_w, slope_w : float
        a, of level flight, and b [W].
    var_level, cov_level_slope, var_slope : float
        Covariance of a and b [W²].
    noise : float
        Variance of the motion's energy per second beside it [J²/s].
    max_w : float
        The greatest power that was measured, up to the motor's [W].
    climb_j_per_m : float
        Energy of a metre of climb [J/m].
    airframe : Airframe
        Whose power it is; by it follows the power at other airspeeds, see `PowerTerms`.
    in_doubt : bool
        Whether a may have changed for good.
    """

    level_w: float
    slope_w: float
    var_level: float
    cov_level_slope: float
    var_slope: float
    noise: float
    max_w: float
    climb_j_per_m: float
    airframe: Airframe
    in_doubt: bool = False

    def energy_var_j2(self, seconds: Any, level_s: Any, bank_s: Any) -> Any:
        """Variance of energies over times, numbers or arrays, with derivatives `level_s` by a and `bank_s` by b."""
        # var E = (∂E/∂a, ∂E/∂b) P (∂E/∂a, ∂E/∂b)ᵀ + v t, with P the covariance of a and b
        by_level = level_s**2 * self.var_level + 2 * level_s * bank_s * self.cov_level_slope
        return by_level + bank_s**2 * self.var_slope + self.noise * seconds

    def straight_w(self, airspeed_mps: float) -> float:
        """Power of straight level flight at an airspeed [W]."""
        level, flat, _, own_w = power_terms(self.airframe, airspeed_mps)
        return level * self.level_w + flat * self.slope_w + own_w


@lru_cache(512)
def power_terms(airframe: Airframe, airspeed_mps: float) -> PowerTerms:
    """As `airframe.power_terms`, kept by airspeed: a flight has few."""
    return airframe.power_terms(airspeed_mps)


def terms_of(airframe: Airframe, airspeeds_mps: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """`PowerTerms` for airspeeds [m/s], each an array of their shape, (n,)."""
    speeds, of = np.unique(airspeeds_mps, return_inverse=True)
    rows = np.array([power_terms(airframe, speed) for speed in speeds.tolist()]).reshape(-1, 4)
    level, flat, turn, own_w = rows[of].T
    return level, flat, turn, own_w


class ChargeKnown(NamedTuple):
    """The charge, and how well it is known.

    Attributes
    ----------
    filtered : Charge
        State of the filter: the charge, and how the power drains it.
    gain_std, gain_from : float
        Standard deviation of the gauge's gain, and the charge from which on it counts.
    believed : bool
        Whether the gauge is.
    lost_std : float
        Standard deviation of the charge that the voltage shows to be lost.
    losses : int
        Sudden losses of charge so far.
    """

    filtered: Charge
    gain_std: float
    gain_from: float
    believed: bool
    lost_std: float
    losses: int


class Joined(NamedTuple):
    """Where [m] and when [s] the stage being flown was joined, and the how-manieth of the flight it is, from 1.

    `rejoins_at_start` is where a plan that is taken up again is joined, see `Observation`.
    """

    position_m: Point
    time_s: float
    stages_started: int
    rejoins_at_start: bool | None = None


class Known(NamedTuple):
    """What is known of a flight.

    Attributes
    ----------
    time_s : float
        Now [s].
    position_m : (float, float)
        Where the aircraft is [m].
    cursor : PlanCursor
        The stage being flown.
    joined : Joined
        Where it was joined.
    wind, time, motion, charge
        Estimates.
    margin_m : float
        By how much the end of the plan has to be passed to be one [m]; 0 where an autopilot's mission has it.
    climb : Climb or None
        Altitude and climbs, where the plan commands them.
    flown : FlownGround
        What has been seen.
    autopilot : Autopilot
        That flies, as far as its parameters are known.
    returns_home : bool
        Whether the aircraft flies home, and its plan no longer.
    """

    time_s: float
    position_m: Point
    cursor: PlanCursor
    joined: Joined
    wind: WindKnown
    time: TimeKnown
    motion: MotionKnown
    charge: ChargeKnown
    margin_m: float
    climb: Climb | None
    flown: FlownGround
    autopilot: Autopilot = Autopilot()
    returns_home: bool = False

    @property
    def airspeed_mps(self) -> float:
        """Airspeed where no stage commands one [m/s]."""
        return self.motion.airframe.airspeed_mps

    @property
    def soc(self) -> float:
        """Filtered state of charge."""
        return self.charge.filtered.soc


RATIO_STD = 0.02
"""Prior standard deviation of the ratio of flown to forecast time, common to all legs."""

TIME_NOISE_S, TIME_NOISE_LEGS = 0.002, 4
"""Prior variance of a leg's time per second of it [s²/s] without gusts, and its weight in legs."""

OUTLIER_STDS, WINSORISED, PASSES = 2.0, 0.9205, 3
"""Standard deviations beyond which a leg's time counts as that far off; the mean of min(z², 2²) of a normal variable z;
and how often estimates and outliers are computed in turns."""


class TimeRatio:
    """Ratio of flown to forecast leg times, and the noise of each.

    A regression through the origin: flown − forecast = β · forecast + noise, whose variance grows with the time. A leg
    that is flown much later or sooner than forecast, as in an evasion, does not speak of others: its residual is
    limited.

    Parameters
    ----------
    airspeed_mps, gust_time_s : float
        Airspeed [m/s] and correlation time of gusts [s], for the prior noise.

    Attributes
    ----------
    ratio : float
        1 + β.
    noise_s : float
        Variance of the noise per second [s²/s].

    Source: Bayesian linear regression with a normal prior; Huber 1981 for the limit, with his proposal 2 for the scale.
    """

    def __init__(self, airspeed_mps: float, gust_time_s: float) -> None:
        self._airspeed_mps, self._gust_time_s = airspeed_mps, gust_time_s
        self.ratio, self.noise_s = 1.0, TIME_NOISE_S
        self._forecast_s = 0.0  # Σ forecast over the legs flown, outliers by their weight
        self._legs: list[tuple[float, float]] = []

    def learn(self, forecast_s: float, flown_s: float, gust_std_mps: float) -> None:
        """Update with a flown leg: its forecast and its flown time [s], in gusts of a standard deviation [m/s]."""
        if not (forecast_s > 0 and math.isfinite(forecast_s)):
            return
        self._legs.append((forecast_s, flown_s))
        prior_noise_s = self._expected_noise_s(gust_std_mps)
        noise_s, beta = max(self.noise_s, prior_noise_s), self.ratio - 1.0
        expected_s, flown = np.array(self._legs).T
        for _ in range(PASSES):
            # residuals r of a deviation σ √t count as at most 2 σ √t, by a weight w
            far = np.abs(flown - (1 + beta) * expected_s) / np.sqrt(noise_s * expected_s)
            weights = 1 / np.maximum(far / OUTLIER_STDS, 1.0)
            # σ², the mean of the prior's and of w² r²/t
            squares = float(np.sum((far * weights) ** 2)) * noise_s / WINSORISED
            noise_s = (TIME_NOISE_LEGS * prior_noise_s + squares) / (TIME_NOISE_LEGS + len(self._legs))
            # β = Σ w (flown − forecast) / (Σ w forecast + σ²/σ_β²)
            self._forecast_s = float(weights @ expected_s)
            beta = float(weights @ (flown - expected_s)) / (self._forecast_s + noise_s / RATIO_STD**2)
        self.ratio, self.noise_s = 1.0 + beta, noise_s

    def expect(self, gust_std_mps: float) -> None:
        """Set the prior noise from forecast gusts [m/s], before any leg is flown."""
        self.noise_s = self._expected_noise_s(gust_std_mps)

    @property
    def variance(self) -> float:
        """Variance of the ratio, of its posterior: σ² / (Σ forecast + σ²/σ_β²)."""
        return self.noise_s / (self._forecast_s + self.noise_s / RATIO_STD**2)

    def _expected_noise_s(self, gust_std_mps: float) -> float:
        """Prior variance of a leg's time per second of it, in gusts of a standard deviation [s²/s]."""
        # a gust of σ and correlation time τ moves an aircraft by √(2 τ t) σ metres in t seconds
        return TIME_NOISE_S + 2 * self._gust_time_s * (gust_std_mps / self._airspeed_mps) ** 2
