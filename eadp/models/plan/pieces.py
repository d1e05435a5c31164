"""Straights and arcs as stages of a plan; the straight ways at the ends of a flight: final approach and climb-out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import constant, number_text
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, flight_time_s, straight
from eadp.core.geometry.geodesy import compass_deg, heading_rad
from eadp.errors import Fault, InputError
from eadp.models.autopilot import FACTORY, LANDING_ANGLE, PX4, Autopilot
from eadp.models.plan.stage import LOITER_TO_ALTITUDE, Stage
from eadp.models.vehicle import Airframe

CLIMB_OUT_M = 50.0
"""Height of the climb straight ahead after take-off [m]: ArduPilot's TKOFF_ALT by default."""

GAIN_PER_M = 0.1
"""Gain of a stage for a path function whose gradient is 1: a circle's is this over its diameter, the gradient there."""

TRIGGER_RADIUS_M = 0.5
"""Trigger radius, if no stage is shorter: a trigger cannot be missed, and one that fires early cuts lines short."""


MIN_STAGE_M = 1e-5
"""A shorter piece is left out: the next one starts no farther away than that."""


DIGITS = 9


Command = tuple[float, ...]

LOITER: Command = (LOITER_TO_ALTITUDE, *(0.0,) * 7)
"""The command of a whole circle, on which the aircraft climbs or descends to the altitude of the stage."""


class PathText(NamedTuple):
    """A stage's path function as text, its rotation [°] and its gain."""

    function: str
    rotation_deg: int
    gain: float


def direction_cosine(value: float) -> float:
    """A component of a unit vector; exactly 0 or ±1 where it is within rounding of that."""
    rounded = round(value, 12)
    return rounded + 0.0 if rounded in (-1, 0, 1) else value


def circle_text(centre: tuple[str, str], radius: str) -> str:
    """The path function of a circle."""
    x, y = centre
    return f"(x - ({x}))^2 + (y - ({y}))^2 - {radius}^2"


def shifted_text(offset: float, text: str) -> str:
    """offset + text."""
    number = round(offset, DIGITS)
    if number == 0:
        return text
    return f"{text} {'-' if number < 0 else '+'} {number_text(abs(number))}"


def scaled_text(factor: float, text: str, digits: int = 15) -> str:
    """factor · text; nothing for 0."""
    rounded = round(factor, digits)
    if rounded == 0:
        return ""
    compound = " " in text and not text.endswith(")")
    if abs(rounded) == 1:
        return text if rounded > 0 else (f"-({text})" if compound else f"-{text}")
    return f"{number_text(rounded)}*{f'({text})' if compound else text}"


def sum_text(a: str, b: str) -> str:
    """a + b; either may be empty, for 0."""
    if not a or not b:
        return a or b or "0"
    return f"{a} - {b[1:]}" if b.startswith("-") else f"{a} + {b}"


def linear_text(normal: Point) -> str:
    """n·(x, y)."""
    return sum_text(scaled_text(normal[0], "x"), scaled_text(normal[1], "y"))


def piece_path(piece: Piece) -> PathText:
    """The path of a straight or an arc."""
    x, y, heading = piece.start
    if piece.centre_m is not None:
        cx, cy = map(rounded_text, piece.centre_m)
        circle, rotation = circle_text((cx, cy), rounded_text(piece.radius_m)), 90 if piece.turn > 0 else 270
        return PathText(circle, rotation, GAIN_PER_M / (2 * piece.radius_m))
    # the gradient a quarter turn to the right of the travel: rotation 90 turns it back
    nx, ny = direction_cosine(math.sin(heading)), direction_cosine(-math.cos(heading))
    rotation = 90
    if nx < 0 or (nx == 0 and ny < 0):
        nx, ny, rotation = -nx, -ny, 270
    # n·(p − start)
    return PathText(shifted_text(-round(nx * x + ny * y, DIGITS), linear_text((nx, ny))), rotation, GAIN_PER_M)


def piece_stages(pieces: Sequence[Piece], like: Stage, first: int) -> tuple[Stage, ...]:
    """Stages along pieces, flown as another stage is, with numbers from `first` on."""
    stages = []
    for index, piece in enumerate(pieces, first):
        function, rotation_deg, gain = piece_path(piece)
        x, y = map(constant, piece.end[:2])
        flown = replace(like, index=index, segment=None, commands=(), path=read_expression(function), trigger=(x, y))
        stages.append(replace(flown, gain=gain, rotation_deg=rotation_deg))
    return tuple(stages)


def rounded_text(value: float) -> str:
    """A number, as stages of a plan have it."""
    return number_text(round(value, DIGITS) + 0.0)


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


def landing_pose(given: str | tuple[float, float, float], point: Callable[[str], Point]) -> Pose:
    """Where `--landing`, a place and a bearing [°], lands, and on which course; `point` reads the place.

    Raises InputError.
    """
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


def behind_warning(course: float, wind_mps: Point) -> list[Fault]:
    """The warning of a landing on a course [rad] with `BEHIND_MPS` of wind behind, or more."""
    behind_mps = wind_mps[0] * math.cos(course) + wind_mps[1] * math.sin(course)
    if behind_mps < BEHIND_MPS:
        return []
    into = compass_deg(math.atan2(-wind_mps[1], -wind_mps[0]))
    message = f"lands with {behind_mps:.1f} m/s of wind behind: the aircraft touches down faster, and farther on"
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
    if not airframe.takes_commands:
        message = f"the airframe {airframe.model} holds its altitude"
        raise InputError.at(option, 1, 1, message, "an aeroplane, as in --scenario")
    rate_mps = airframe.climb_rates_mps(air.airspeed_mps)[down]
    if rate_mps <= 0 or height_m <= 0:
        message = f"the aircraft does not {'descend' if down else 'climb'} at {air.airspeed_mps:g} m/s"
        raise InputError.at(option, 1, 1, message, "another airspeed, and an altitude above home")
    metre_s = flight_time_s([straight((0.0, 0.0), (math.cos(course), math.sin(course)))], *air)
    return height_m / rate_mps * max(1 / metre_s, air.airspeed_mps)
