"""How a flight is likely to end with its parameters as they are, for planners that tell no forecast of their own.

What is left is laid out from the plan's geometry and taken to cost the power of the last minute: no spread is told.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.errors import EadpError
from eadp.models.plan.executor import Vector
from eadp.models.plan.route import Route, RoutePredictor, left_m
from eadp.planning.base import Mission, Observation

POWER_TIME_S = 60.0


class EndForecast(NamedTuple):
    """A flight's end as forecast: state of charge, and time until then [s]; None where it cannot be told."""

    soc: float | None
    remaining_s: float | None


class Outlook:
    """Follows a flight and forecasts its end.

    Parameters
    ----------
    mission : Mission
    """

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._follower = RoutePredictor(mission.plan, mission.parameters, mission.start_m or (0.0, 0.0), mission.rules)
        self._decided = mission.parameters
        self._begun = 1
        self._stage_since_s = 0.0
        self._power_w: float | None = None
        self._read_s = 0.0
        self._wind: Point = (0.0, 0.0)
        self._course: Route | None = None
        self._lost = False

    def observe(self, o: Observation) -> None:
        """Take an observation."""
        if o.stages_begun != self._begun:
            self._stage_since_s = o.time_s
            self._course = None
            try:
                while self._begun < o.stages_begun:
                    self._begun += 1
                    self._follower.next_stage(o.parameters)
            except EadpError:
                self._lost = True
        self._wind = o.wind_mps or self._wind
        if o.power_w is not None:
            share = 1.0 if self._power_w is None else 1.0 - math.exp((self._read_s - o.time_s) / POWER_TIME_S)
            known = self._power_w or 0.0
            self._power_w, self._read_s = known + share * (o.power_w - known), o.time_s

    def end(self, o: Observation, decided: Vector) -> EndForecast:
        """The end as it looks from an observation, with parameters that have been decided.

        Source: Rint battery (letter, Sec. III-C) under a constant power; wind triangle.
        """
        try:
            remaining_s = self._remaining_s(o, decided)
        except EadpError:
            return EndForecast(None, None)
        if remaining_s is None or not math.isfinite(remaining_s) or self._power_w is None:
            return EndForecast(None, None)
        battery = self._mission.battery
        # half of what is left is used on average
        volts = max(battery.voltage_at(min(max(o.soc / 2, 0.0), 1.0)), 1e-3)
        return EndForecast(o.soc - float(battery.drain_per_s(self._power_w, volts)) * remaining_s, remaining_s)

    def _remaining_s(self, o: Observation, decided: Vector) -> float | None:
        if self._lost:
            return None
        if decided != self._decided:
            self._follower.decide(decided)
            self._decided, self._course = decided, None
        if self._course is None:
            self._course = self._follower.course(decided)
        if not self._course.legs:
            return 0.0
        times, _ = self._course.times_s(self._mission.cruise_mps, self._wind)
        if not math.isfinite(times[0]):
            return None
        leg = self._course.legs[0]
        elapsed = (o.time_s - self._stage_since_s) / max(float(times[0]), 1e-9)
        left = left_m(leg, (o.x_m, o.y_m), leg.distance_m * min(1.0, elapsed))
        return float(times[1:].sum()) + float(times[0]) * left / max(leg.distance_m, 1e-9)
