"""The straight ways at the ends of a flight: the final approach to where it lands, and the climb-out ahead of home."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, flight_time_s, straight
from eadp.core.geometry.geodesy import compass_deg, heading_rad
from eadp.errors import Fault, InputError
from eadp.models.autopilot import FACTORY, LANDING_ANGLE, PX4, Autopilot
from eadp.models.vehicle import Airframe, PaperVehicle

BEHIND_MPS = 0.5
"""Wind from behind from which on it is said of a landing [m/s]."""


class Air(NamedTuple):
    """An airspeed, and the wind, where it blows towards (east, north) [m/s]."""

    airspeed_mps: float
    wind_mps: Point


def course_rad(option: str, bearing_deg: float) -> float:
    """The mathematical heading of an option's compass bearing; raises InputError."""
    if not abs(bearing_deg) <= 360:
        raise InputError.at(option, 1, 1, "no heading", "a compass bearing [°]: 0 north, 90 east", f"{bearing_deg}")
    return heading_rad(bearing_deg)


def landing_pose(given: str | Pose, point: Callable[[str], Point]) -> Pose:
    """Where `--landing` lands, and on which course; `point` reads its place. Raises InputError."""
    raw = given if isinstance(given, str) else ",".join(map(str, given))
    *place, bearing = raw.replace(",", " ").split() or [""]
    try:
        course = course_rad("--landing", float(bearing))
    except ValueError:
        course = math.nan
    if len(place) != 2 or math.isnan(course):
        expected = "a place and a heading [°], like 55.37,10.43,240"
        raise InputError.at("--landing", 1, 1, "no place and heading", expected, raw)
    return *point(",".join(place)), course


def approach_slopes(autopilot: Autopilot) -> list[float]:
    """The steepest slopes of a final approach that an autopilot accepts: the one that is tried first, first.

    PX4 arms no mission whose approach is steeper than FW_LND_ANG. Where no autopilot is stated, an approach is as flat
    as PX4 asks where there is room, so that both can be armed, and else as steep as the aircraft glides.
    """
    limit_deg = autopilot.value(LANDING_ANGLE)
    if limit_deg is not None:
        return [math.tan(math.radians(limit_deg))]
    flat = math.tan(math.radians(FACTORY[PX4][LANDING_ANGLE]))
    return [flat, math.inf] if autopilot.kind is None else [math.inf]


def behind_mps(course: float, wind_mps: Point) -> float:
    """The wind from behind on a course [rad]; 0 where it comes from ahead, or is less than `BEHIND_MPS`."""
    along_mps = wind_mps[0] * math.cos(course) + wind_mps[1] * math.sin(course)
    return along_mps if along_mps >= BEHIND_MPS else 0.0


def behind_warning(course: float, wind_mps: Point) -> list[Fault]:
    """The warning of a landing with the wind behind."""
    if not (behind := behind_mps(course, wind_mps)):
        return []
    into = compass_deg(math.atan2(-wind_mps[1], -wind_mps[0]))
    message = f"lands with {behind:.1f} m/s of wind behind: the aircraft touches down faster, and farther on"
    return [Fault("--landing", 1, 1, message, f"a heading near {into:.0f}°, into the wind", severity="warning")]


def approach(to: Pose, height_m: float, airframe: Airframe, air: Air, slope: float) -> Piece:
    """The straight final approach that descends from a height to where a flight lands; raises InputError.

    It is as steep as the aircraft glides, and no steeper than a slope.
    """
    x, y, course = to
    length_m = max(_sloping_m("--landing", course, height_m, airframe, air, 1), height_m / slope)
    return straight((x - length_m * math.cos(course), y - length_m * math.sin(course)), (x, y))


def climb_out(start_m: Point, course: float, height_m: float, airframe: Airframe, air: Air) -> Piece:
    """The straight way ahead on a course [rad] in which an aircraft climbs to a height; raises InputError."""
    (x, y), length_m = start_m, _sloping_m("--takeoff", course, height_m, airframe, air, 0)
    return straight((x, y), (x + length_m * math.cos(course), y + length_m * math.sin(course)))


def _sloping_m(option: str, course: float, height_m: float, airframe: Airframe, air: Air, down: int) -> float:
    """Ground that a climb of a height takes on a course, or a descent (1) [m]; a headwind may die down."""
    if isinstance(airframe, PaperVehicle):
        message = f"the airframe {airframe.model} holds its altitude"
        raise InputError.at(option, 1, 1, message, "an aeroplane, as in --scenario")
    rate_mps = airframe.climb_rates_mps(air.airspeed_mps)[down]
    if rate_mps <= 0 or height_m <= 0:
        message = f"the aircraft does not {'descend' if down else 'climb'} at {air.airspeed_mps:g} m/s"
        raise InputError.at(option, 1, 1, message, "another airspeed, and an altitude above home")
    metre_s = flight_time_s([straight((0.0, 0.0), (math.cos(course), math.sin(course)))], *air)
    return height_m / rate_mps * max(1 / metre_s, air.airspeed_mps)
