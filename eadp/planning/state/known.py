"""What is known of a flight at one moment: numbers that a forecast starts from. Immutable."""

from __future__ import annotations

from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.models.autopilot import Autopilot
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.ground import FlownGround
from eadp.planning.state.charge import Charge
from eadp.planning.state.climb import Climb


class WindKnown(NamedTuple):
    """Wind [m/s], and the variances of both components and their covariance [m²/s²]."""

    mps: Point = (0.0, 0.0)
    covariance: tuple[float, float, float] = (0.0, 0.0, 0.0)


class TimeKnown(NamedTuple):
    """Ratio of flown to forecast times of legs; a time t has the variance t² · `variance` + `noise_s` · t."""

    ratio: float
    variance: float
    noise_s: float


class MotionKnown(NamedTuple):
    """Power of the motion, a + b tan² φ, as learned in flight.

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
    in_doubt: bool = False


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
    joined_m : (float, float)
        Where that was joined [m].
    since_s : float
        When that was joined [s].
    stages_started : int
        Over the flight.
    airspeed_mps : float
        Cruise [m/s].
    wind, time, motion, charge
        Estimates.
    reach_std_m : float
        Standard deviation of how far the aircraft reaches beside its path [m]; 0 where the end is certain.
    climb : Climb or None
        Altitude and climbs, where the plan commands them.
    flown : FlownGround
        What has been seen.
    autopilot : Autopilot
        That flies, as far as its parameters are known.
    returns_home : bool
        Whether the aircraft flies home, and its plan no longer.
    rejoins_at_start : bool or None
        Where the plan that is taken up again is joined, see `Observation`.
    """

    time_s: float
    position_m: Point
    cursor: PlanCursor
    joined_m: Point
    since_s: float
    stages_started: int
    airspeed_mps: float
    wind: WindKnown
    time: TimeKnown
    motion: MotionKnown
    charge: ChargeKnown
    reach_std_m: float
    climb: Climb | None
    flown: FlownGround
    autopilot: Autopilot = Autopilot()
    returns_home: bool = False
    rejoins_at_start: bool | None = None

    @property
    def soc(self) -> float:
        """Filtered state of charge."""
        return self.charge.filtered.soc
