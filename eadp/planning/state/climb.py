"""Climbs and descents that stages command: followed in flight by dead reckoning."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

from eadp.models.autopilot import ARDUPILOT
from eadp.models.plan.stage import Stage
from eadp.models.vehicle import Aeroplane
from eadp.models.world import Mission

TAKE_OFF_RAD, GROUND_M = math.radians(20.0), 5.0
"""Steepness of ArduPilot's take-off, which it flies at full throttle; and altitude below which a flight begins with it.

Source: ardupilot.org, "Automatic Takeoff"; PTCH_LIM_MAX_DEG 20 of the factory.
"""


class Climb(NamedTuple):
    """The aircraft that climbs, its altitude now [m], and the energy of a metre of its take-off [J/m].

    That is 0 where the aircraft does not take off, or with the energy of any climb.
    """

    airframe: Aeroplane
    altitude_m: float
    take_off_j_per_m: float = 0.0

    def commanded_m(self, stage: Stage) -> float:
        """The altitude that a stage commands [m]; that of cruise where it commands none."""
        return self.airframe.cruise_altitude_m if stage.altitude_m is None else stage.altitude_m


@lru_cache(256)
def climb_rates_mps(airframe: Aeroplane, airspeed_mps: float) -> tuple[float, float]:
    """As `airframe.climb_rates_mps`, kept by airspeed: a plan commands few."""
    return airframe.climb_rates_mps(airspeed_mps)


class ClimbFollower:
    """Follows the altitude along a flight.

    An aircraft climbs to a stage's altitude from the start of the stage, as fast as it can, and goes on climbing in the
    next stages where that is not enough.

    Parameters
    ----------
    climb : Climb
        At take-off.

    Attributes
    ----------
    climb : Climb
        Now.
    slowed_s : float
        By how much climbing has delayed the flight in this stage, without wind [s].
    """

    def __init__(self, climb: Climb) -> None:
        self.climb, self.slowed_s = climb, 0.0

    @classmethod
    def of(cls, mission: Mission) -> ClimbFollower | None:
        """A follower of a mission's climbs; None where it flies at one altitude from its start on."""
        commanded = any(stage.altitude_m is not None for stage in mission.plan.stages)
        vehicle = mission.vehicle
        if not vehicle.takes_commands or not (commanded or mission.altitude_m != vehicle.cruise_altitude_m):
            return None
        take_off_j_per_m = 0.0
        if mission.autopilot.kind == ARDUPILOT and mission.altitude_m < GROUND_M:
            # (P_max − P) / (V sin γ): the motor at its greatest power until the height is reached
            rate_mps = vehicle.airspeed_mps * math.sin(TAKE_OFF_RAD)
            take_off_j_per_m = (vehicle.max_motion_w - vehicle.cruise_power_w) / rate_mps
        return cls(Climb(vehicle, mission.altitude_m, take_off_j_per_m))

    def follow(self, stage: Stage, airspeed_mps: float, step_s: float) -> tuple[float, float]:
        """Update the altitude by a step [s] along a stage, and return what climbing does in it.

        What it adds to the motion's power [W], negative in a descent, and the airspeed's horizontal part [m/s].
        """
        airframe, here_m, take_off_j_per_m = self.climb
        up_mps, down_mps = climb_rates_mps(airframe, airspeed_mps)
        # ḣ = k (h_d − h) over the step: Δh = (1 − e^(−k Δt)) (h_d − h), within the greatest rates
        closed = -math.expm1(-airframe.altitude_gain_per_s * step_s)
        climb_m = min(max(closed * (self.climb.commanded_m(stage) - here_m), -down_mps * step_s), up_mps * step_s)
        self.climb = Climb(airframe, here_m + climb_m, take_off_j_per_m)
        rate_mps = climb_m / step_s if step_s > 0 else 0.0
        # the horizontal part V cos γ, with sin γ = ḣ/V; and the delay by flying at it and not at V
        level_mps = math.sqrt(max(airspeed_mps**2 - rate_mps**2, 0.0))
        self.slowed_s += step_s * (1 - level_mps / airspeed_mps)
        return airframe.climb_j_per_m * rate_mps, level_mps
