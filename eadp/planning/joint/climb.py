"""Climbs, descents and airspeeds of stages in the forecast: what they add to time and motion power of legs."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.models.plan.route import Route
from eadp.models.plan.stage import Stage
from eadp.models.vehicle import FixedWing
from eadp.planning.base import Mission

MAX_SLOWED = 0.9
"""Greatest share of the ground speed that a climb takes: against a strong wind it would take all."""


class ClimbForecast:
    """The altitude by dead reckoning, and the load of the climbs that are left.

    An aircraft climbs to a stage's altitude from the start of the stage, as fast as it can, and goes on climbing in the
    next stages where that is not enough.

    Parameters
    ----------
    airframe : FixedWing
    altitude_m : float
        Altitude at take-off [m].

    Attributes
    ----------
    power_w : float
        What climbing and the airspeed added to the motion's power over the last step [W]; negative in a descent.
    level_mps : float
        The airspeed's horizontal part over the last step [m/s].
    slowed_s : float
        By how much climbing has delayed the flight in this stage, without wind [s].
    """

    def __init__(self, airframe: FixedWing, altitude_m: float) -> None:
        self._airframe, self._altitude_m = airframe, altitude_m
        self._rates_mps = cache(airframe.climb_rates_mps)
        self._level_w = cache(airframe.level_power_w)
        self.power_w = self.slowed_s = 0.0
        self.level_mps = airframe.airspeed_mps

    @classmethod
    def of(cls, mission: Mission) -> ClimbForecast | None:
        """That of a mission; None where its stages command neither altitudes nor airspeeds."""
        commanded = any(s.altitude_m is not None or s.airspeed_mps is not None for s in mission.plan.stages)
        return cls(mission.airframe, mission.altitude_m) if commanded and mission.airframe is not None else None

    def _commanded(self, stage: Stage) -> tuple[float, float]:
        """The altitude [m] and the airspeed [m/s] that hold on a stage."""
        airframe = self._airframe
        return (
            airframe.cruise_altitude_m if stage.altitude_m is None else stage.altitude_m,
            airframe.airspeed_mps if stage.airspeed_mps is None else stage.airspeed_mps,
        )

    def follow(self, stage: Stage, step_s: float) -> None:
        """Follow the flight along a stage for a step [s]."""
        altitude_m, airspeed_mps = self._commanded(stage)
        up_mps, down_mps = self._rates_mps(airspeed_mps)
        # ḣ = k (h_d − h) within the rates
        closing = -math.expm1(-self._airframe.altitude_gain_per_s * step_s)
        climb_m = min(max(closing * (altitude_m - self._altitude_m), -down_mps * step_s), up_mps * step_s)
        self._altitude_m += climb_m
        rate_mps = climb_m / step_s if step_s > 0 else 0.0
        self.level_mps = math.sqrt(max(airspeed_mps**2 - rate_mps**2, 0.0))
        self.slowed_s += step_s * (1 - self.level_mps / airspeed_mps)
        self.power_w = self._airframe.climb_j_per_m * rate_mps + self._faster_w(airspeed_mps)

    def _faster_w(self, airspeed_mps: float) -> float:
        """Power of level flight above that at the airframe's own airspeed [W]."""
        return self._level_w(airspeed_mps) - self._level_w(self._airframe.airspeed_mps)

    def loaded(
        self, route: Route, whole_s: FloatArray, times_s: FloatArray, motion_w: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times [s], mean and maximum motion powers [W] of a route's legs with climbs and airspeeds, shape (legs,).

        Parameters
        ----------
        route : Route
        whole_s : array, shape (legs,)
            Time of each leg from its start in level flight [s].
        times_s, motion_w : array, shape (legs,)
            Time left of each leg [s] and motion power [W] in level flight at the airframe's airspeed.

        Source: energy of a climb m g Δh / η; ground speed by V cos γ.
        """
        times, added_w, peak_w, here_m = (
            times_s.copy(),
            np.zeros(len(times_s)),
            np.zeros(len(times_s)),
            self._altitude_m,
        )
        per_m = self._airframe.climb_j_per_m
        for i, leg in enumerate(route.legs):
            altitude_m, airspeed_mps = self._commanded(leg.stage)
            added_w[i] = peak_w[i] = self._faster_w(airspeed_mps)
            up_mps, down_mps = self._rates_mps(airspeed_mps)
            rate_mps = up_mps if altitude_m > here_m else -down_mps
            if altitude_m == here_m or rate_mps == 0 or times[i] <= 0:
                continue
            climb_s = (altitude_m - here_m) / rate_mps
            # the climb takes V (1 − cos γ) of the ground speed
            slower_mps = airspeed_mps - math.sqrt(max(airspeed_mps**2 - rate_mps**2, 0.0))
            slowed = min(slower_mps * whole_s[i] / max(leg.distance_m, 1e-9), MAX_SLOWED)
            climbed_s = min(climb_s, times[i] / (1 - slowed))
            times[i] += slowed * climbed_s
            climb_m = rate_mps * climbed_s
            here_m = altitude_m if climbed_s == climb_s else here_m + climb_m
            added_w[i] += per_m * climb_m / times[i]
            peak_w[i] += max(per_m * rate_mps, 0.0)
        return times, np.maximum(motion_w + added_w, 0.0), motion_w + peak_w
