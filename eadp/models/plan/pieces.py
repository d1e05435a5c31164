"""Straights and arcs as stages of a plan: their path functions as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import constant, number_text
from eadp.core.geometry.curves import Point, tangent
from eadp.core.geometry.dubins import Piece, ordered
from eadp.errors import Infeasible
from eadp.models.plan.plan import Plan
from eadp.models.plan.segments import Segment
from eadp.models.plan.stage import LOITER_TO_ALTITUDE, RETURN, Stage

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
        rotation = 90 if piece.turn > 0 else 270
        return PathText(
            circle_text((cx, cy), rounded_text(piece.radius_m)), rotation, GAIN_PER_M / (2 * piece.radius_m)
        )
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


def with_landing(plan: Plan, approach: Piece, radius_m: float, land: Command) -> Plan:
    """A plan that lands from where it ends: the quickest turn to a final approach, and down it.

    Parameters
    ----------
    plan : Plan
    approach : Piece
    radius_m : float
        Of the turns [m].
    land : tuple
        The command of the landing, whose altitude its stage has.

    Raises
    ------
    Infeasible
        If where the plan ends depends on its laps or its path parameters.
    """
    last = plan.stages[-1]
    laps = plan.repeats or (last.segment and last.segment.repeats)
    if laps or any(part.max_parameter for part in (last.path, *last.trigger)):
        raise Infeasible("where the plan ends depends on its laps or its path parameters")
    x, y = last.trigger_at(())
    dx, dy = tangent(last.path_at(()), (x, y), last.sense)
    turn = ordered((x, y, math.atan2(dy, dx)), approach.start, radius_m)[0]
    pieces = [each for each in (*turn.pieces, approach) if each.length_m >= MIN_STAGE_M]
    *way, down = piece_stages(pieces, last, len(plan.stages) + 1)
    landing = replace(down, altitude_m=land[-1], commands=(land,))
    kept = replace(last, commands=tuple(each for each in last.commands if each[0] != RETURN))
    segments = plan.segments and (*plan.segments, Segment(len(plan.stages), len(pieces)))
    stages = (*plan.stages[:-1], kept, *way, landing)
    # a plan whose stages were explicit laps has none any more
    return replace(plan, stages=stages, segments=segments, primitive_stages=None, shift=None, final=None)


def rounded_text(value: float) -> str:
    """A number, as stages of a plan have it."""
    return number_text(round(value, DIGITS) + 0.0)
