"""Time and energy of a way home."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight.wind import ground_speeds_mps
from eadp.core.geometry.curves import LINE, Point
from eadp.models.airspace import HOME_RADII, WayHome
from eadp.models.plan.legs import Leg
from eadp.planning.state.known import Known

AT_HOME_M = 1.0
"""Distance at which the aircraft is at home, where it does not circle [m]."""


class Homeward(NamedTuple):
    """A way home: its time [s], its mean power with the computations [W], and the climb to its altitude [m]."""

    seconds: float
    power_w: float
    climb_m: float = 0.0


def homeward(known: Known, way_home: WayHome, cruise_altitude_m: float, computing_w: float) -> Homeward:
    """The way home from a moment of a flight.

    It is a whole turn, unless home is flown to already, straight lines in level flight, and a climb to the altitude of
    the way; then a landing, with a whole turn onto it and what the descent gives, or a circle. Its time is infinite
    against too strong a wind.

    Parameters
    ----------
    known : Known
    way_home : WayHome
    cruise_altitude_m : float
        Altitude where the plan commands none [m].
    computing_w : float
        Power of the computations [W].
    """
    climb, airspeed_mps, faster_w = known.climb, known.airspeed_mps, 0.0
    if climb is not None:
        _, airspeed_mps = climb.commanded(known.cursor.stage)
        faster_w = climb.faster_w(airspeed_mps)
    level_w, per_m, landing = known.motion.level_w + faster_w, known.motion.climb_j_per_m, way_home.landing
    seconds = 0.0
    if math.dist(known.position_m, way_home.end_m) > way_home.circle_radius_m:
        corners = np.array([known.position_m, *way_home.line(known.position_m)])
        seconds = _seconds(np.diff(corners, axis=0), airspeed_mps, known.wind.mps)
    turn_s = 2 * math.pi * HOME_RADII * way_home.turn_radius_m / airspeed_mps
    seconds += turn_s if seconds > 0 and not known.returns_home else 0.0
    seconds += 2 * math.pi * way_home.circle_radius_m / airspeed_mps
    here_m = cruise_altitude_m if climb is None else climb.altitude_m
    tops_m = here_m, way_home.altitude_m, None if landing is None else landing.altitude_m
    top_m = max(each for each in tops_m if each is not None)
    energy_j = level_w * seconds + per_m * (top_m - here_m)
    if landing is not None:
        legs = landing.legs
        lines = np.array([np.subtract(leg.end_m, leg.start_m) for leg in legs if leg.stage.kind == LINE]).reshape(-1, 2)
        circles_m = sum(leg.length_m for leg in legs if leg.stage.kind != LINE)
        down_s = _seconds(lines, airspeed_mps, known.wind.mps) + circles_m / airspeed_mps
        down_s += turn_s
        energy_j += max(level_w * down_s - per_m * (top_m - landing.altitude_m + landing.descent_m), 0.0)
        seconds += down_s
    power_w = energy_j / seconds if 0 < seconds < math.inf else level_w
    return Homeward(seconds, power_w + computing_w, top_m - here_m)


def _seconds(lines_m: FloatArray, airspeed_mps: float, wind_mps: Point) -> float:
    """Time of straight lines, shape (n, 2) [m], in a wind [s]; infinite where one cannot be flown."""
    lengths_m = np.linalg.norm(lines_m, axis=1)
    lines_m, lengths_m = lines_m[lengths_m >= AT_HOME_M], lengths_m[lengths_m >= AT_HOME_M]
    course_x, course_y = (lines_m / lengths_m[:, None]).T
    ground_mps, _ = ground_speeds_mps(course_x, course_y, airspeed_mps, wind_mps)
    return math.inf if (ground_mps <= 0).any() else float((lengths_m / ground_mps).sum())


def after_leg(known: Known, leg: Leg) -> Known:
    """What is known, as at the end of a leg: its place, and the altitude that is commanded there."""
    climb = known.climb
    climb = climb and climb._replace(altitude_m=climb.commanded(leg.stage)[0])
    return known._replace(position_m=leg.end_m, climb=climb)
