"""A way over a field written as a plan: explicit stages, and laps of four stages in the quantities that move them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import Expression, number_text
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece
from eadp.core.geometry.envelope import PiecewiseLinear
from eadp.coverage.cover import CoverageSolution
from eadp.coverage.swaths import CoverageLeg, StripFrame
from eadp.coverage.zamboni import END_M, Block
from eadp.models.plan.plan import Box, Plan, PointExpression, Stage
from eadp.models.plan.segments import LoopVariable, Segment

GAIN_PER_M = 0.1
"""Gain of a stage for a path function whose gradient is 1: a circle's is this over its diameter, the gradient there."""

TRIGGER_RADIUS_M = 0.5
"""Trigger radius, where no stage is shorter: a trigger cannot be missed, and one that fires early cuts lines short."""

START_M = 100.0
"""The usual start lies so far before the first trigger: a first stage that ends there begins at the first line."""

SHORTEST_STAGE_M = 1e-5
"""A shorter piece is left out: the next one begins no farther off than that."""

_DIGITS = 9


@dataclass(frozen=True)
class FieldComputations:
    """The computations that run over the field: names with units, their sets, and whether they rest on turns."""

    computations: tuple[tuple[str, str], ...] = ()
    sets: tuple[Box, ...] = ()
    off_on_turns: bool = False

    def sets_for(self, sensing: bool) -> tuple[Box, ...]:
        """The sets of a stage."""
        return self.sets if sensing or not self.off_on_turns else tuple(Box(0.0, 0.0) for _ in self.sets)


def plan_of(
    solution: CoverageSolution,
    *,
    name: str = "",
    sensors: FieldComputations | None = None,
    min_radius_m: float | None = None,
    origin_deg: Point | None = None,
) -> Plan:
    """The plan of a way over a field.

    Parameters
    ----------
    solution : Solution
    name : str, optional
        What to call it in messages.
    sensors : Sensors, optional
        The computations; none without.
    min_radius_m : float, optional
        The aircraft's smallest turning radius [m], for the plan's header.
    origin_deg : (float, float), optional
        Latitude and longitude of the local frame's origin [°].
    """
    return _Writer(solution, sensors or FieldComputations()).plan(name, min_radius_m, origin_deg)


class _Writer:
    def __init__(self, solution: CoverageSolution, sensors: FieldComputations) -> None:
        self._solution = solution
        self._sensors = sensors
        self._lowest_c1 = solution.lowest_c1
        self._stages: list[Stage] = []
        self._parts: list[Segment] = []
        self._shortest_m = math.inf

    def plan(self, name: str, min_radius_m: float | None, origin_deg: Point | None) -> Plan:
        loose: list[CoverageLeg] = []
        for section in self._solution.sections:
            if section.block is None:
                loose += section.legs
                continue
            block = section.block
            if not self._stages and not loose:
                loose.append(_lead(block))
            if loose:
                self._once(loose)
            self._laps(block)
            loose = block.last_lap()  # its first line begins where the last turn ends, whatever the parameters were
        self._once(loose)
        many = len(self._parts) > 1
        return Plan(
            name=name,
            stages=tuple(self._stages),
            path_count=1 if self._lowest_c1 < 0 else 0,
            computations=self._sensors.computations,
            trigger_radius_m=min(TRIGGER_RADIUS_M, float(f"{0.9 * self._shortest_m:.2g}")),
            min_radius_m=min_radius_m,
            origin_deg=origin_deg,
            parts=tuple(self._parts) if many else (),
            primitive_stages=4 if many else None,
        )

    def _sets(self, sensing: bool, lowest_c1: float) -> tuple[Box, ...]:
        path = (Box(lowest_c1, 0.0),) if self._lowest_c1 < 0 else ()
        return (*path, *self._sensors.sets_for(sensing))

    # --- stages flown once

    def _once(self, legs: Sequence[CoverageLeg]) -> None:
        first = len(self._stages)
        if self._sensors.off_on_turns:
            legs = [part for leg in legs for part in leg.split()]
        for leg in _with_start(legs) if first == 0 else legs:
            if leg.piece.length_m < SHORTEST_STAGE_M:
                continue
            self._shortest_m = min(self._shortest_m, leg.piece.length_m)
            path, rotation, gain = _piece_path(leg.piece)
            trigger = (_expression(_number(leg.piece.end[0])), _expression(_number(leg.piece.end[1])))
            self._stage(gain, rotation, path, trigger, self._sets(leg.sensing, self._lowest_c1))
        self._parts.append(Segment(first, len(self._stages) - first))

    def _stage(self, gain: float, rotation: int, path: str, trigger: PointExpression, sets: tuple[Box, ...]) -> None:
        index = len(self._stages) + 1
        self._stages.append(Stage(index, 0, gain, rotation, _expression(path), trigger, sets))

    # --- laps

    def _laps(self, block: Block) -> None:
        """The four primitive stages of a block, and the quantities that take them from lap to lap."""
        first = len(self._stages)
        frame, hand = block.frame, block.frame.hand
        lines = [block.first_m, block.first_m + 2 * block.circle_m]
        upward, downward = (90, 270) if hand == 1 else (270, 90)
        turn = 270 if hand == 1 else 90
        r1 = _number(block.circle_m)
        on, off = self._sets(True, block.lowest_c1), self._sets(False, block.lowest_c1)
        stages = [
            (GAIN_PER_M, upward, _moving_line(frame, lines[0]), _place(frame, lines[0], "s", "top"), on),
            (
                GAIN_PER_M / (2 * block.circle_m),
                turn,
                _moving_circle(frame, lines[0] + block.circle_m, "s", "top", r1),
                _place(frame, lines[1], "s", "top"),
                off,
            ),
            (GAIN_PER_M, downward, _moving_line(frame, lines[1]), _place(frame, lines[1], "s", "low"), on),
            (
                GAIN_PER_M / (2 * block.radius_m),
                turn,
                _moving_circle(frame, lines[1], "s - r2", "low", "r2"),
                _place(frame, lines[0], "next", "low"),
                off,
            ),
        ]
        for gain, rotation, path, (x, y), sets in stages:
            self._stage(float(f"{gain:.4g}"), rotation, path, (_expression(x), _expression(y)), sets)
        end = (_expression("s"), _expression(_number(block.travel_m - END_M)))
        part = Segment(first, 4, tuple(_quantities(block)), end)
        self._stages[first:] = [_with_part(stage, part) for stage in self._stages[first:]]
        self._parts.append(part)
        places = block.places_m(0.0)
        for here, next_ in itertools.pairwise(places):
            self._shortest_m = min(self._shortest_m, float(block.top.at(here)) - block.low(here, next_))


def _with_part(stage: Stage, part: Segment) -> Stage:
    return Stage(stage.index, stage.line, stage.gain, stage.rotation_deg, stage.path, stage.trigger, stage.sets, part)


def _lead(block: Block) -> CoverageLeg:
    """The begin of a block's first line, for a plan that begins with the block."""
    line = block.legs(0.0)[0].piece
    share = min(START_M, line.length_m / 2)
    return CoverageLeg(Piece(0, line.start, line.pose_at(share), share, None), True)


def _with_start(legs: Sequence[CoverageLeg]) -> Iterator[CoverageLeg]:
    """Legs of which the first ends where the usual start is its begin: 100 m on a line, a quarter of a circle."""
    piece = legs[0].piece
    share = START_M if piece.turn == 0 else piece.radius_m * math.pi / 2
    if share < piece.length_m:
        middle = piece.pose_at(share)
        yield CoverageLeg(Piece(piece.turn, piece.start, middle, share, piece.centre_m), legs[0].sensing)
        rest = Piece(piece.turn, middle, piece.end, piece.length_m - share, piece.centre_m)
        yield CoverageLeg(rest, legs[0].sensing)
    else:
        yield legs[0]
    yield from legs[1:]


def _quantities(block: Block) -> Iterator[LoopVariable]:
    radius = _number(block.radius_m)
    step = f"{_number(block.spacing_m)} + 2*({radius} - sqrt({radius}^2 + c1))"
    if block.lowest_c1 == 0:
        step = _number(block.spacing_m)
    yield LoopVariable("s", _expression("0"), _expression("next - s"))
    yield LoopVariable("next", _expression(f"min(s + {step}, {_number(block.travel_m)})"))
    yield LoopVariable("top", _expression(_levels_text(block.top, "s")))
    second, first = _levels_text(block.low_second, "s"), _levels_text(block.low_first, "next")
    yield LoopVariable("low", _expression(second if second == first else f"min({second}, {first})"))
    yield LoopVariable("r2", _expression(f"{_number(block.circle_m)} - (next - s)/2"))


def _levels_text(levels: PiecewiseLinear, name: str) -> str:
    """Levels as a straight line and its bends: v0 + m0 s + Σ (m_i − m_i−1) max(0, s − s_i)."""
    places, values = levels.places_m, levels.levels_m
    slopes = [(b - a) / (t - s) for s, t, a, b in zip(places, places[1:], values, values[1:], strict=False)]
    text = _number(values[0]) + _term(slopes[0], name)
    for place, before, after in zip(places[1:], slopes, slopes[1:], strict=False):
        text += _term(after - before, f"max(0, {name} - {_number(place)})")
    return text


def _term(factor: float, text: str) -> str:
    """A term of a sum: factor·text with its sign; nothing for 0."""
    rounded = round(factor, 12)
    if rounded == 0:
        return ""
    number = "" if abs(rounded) == 1 else f"{number_text(abs(rounded))}*"
    return f" {'-' if rounded < 0 else '+'} {number}{text}"


def _moving_line(frame: StripFrame, first_m: float) -> str:
    """u − (first + s), in x and y."""
    return f"{_linear(frame.across)} - ({_shifted(first_m, 's')})"


def _moving_circle(frame: StripFrame, first_m: float, moves: str, level: str, radius: str) -> str:
    x, y = _place(frame, first_m, moves, level)
    return f"{_square('x', x)} + {_square('y', y)} - {radius}^2"


def _square(axis: str, centre: str) -> str:
    return f"({axis} - ({centre}))^2"


def _place(frame: StripFrame, first_m: float, moves: str, level: str) -> tuple[str, str]:
    """The point (first + moves, level) of a frame, in x and y."""
    across = _shifted(first_m, moves)
    x, y = (_sum(_scaled(u, across), _scaled(v, level)) for u, v in zip(frame.across, frame.along, strict=True))
    return x, y


def _shifted(first_m: float, moves: str) -> str:
    """first + moves."""
    number = round(first_m, _DIGITS)
    if number == 0:
        return moves
    return f"{moves} {'-' if number < 0 else '+'} {number_text(abs(number))}"


def _scaled(factor: float, text: str) -> str:
    rounded = round(factor, 15)
    if rounded == 0:
        return ""
    compound = " " in text
    if abs(rounded) == 1:
        return text if rounded > 0 else (f"-({text})" if compound else f"-{text}")
    return f"{number_text(rounded)}*{f'({text})' if compound else text}"


def _sum(a: str, b: str) -> str:
    if not a or not b:
        return a or b or "0"
    return f"{a} - {b[1:]}" if b.startswith("-") else f"{a} + {b}"


def _linear(normal: Point) -> str:
    """n·(x, y)."""
    return _sum(_scaled(normal[0], "x"), _scaled(normal[1], "y"))


def _piece_path(piece: Piece) -> tuple[str, int, float]:
    """A piece's path function, rotation and gain."""
    x, y, heading = piece.start
    if piece.centre_m is not None:
        cx, cy = (_number(value) for value in piece.centre_m)
        path = f"{_square('x', cx)} + {_square('y', cy)} - {_number(piece.radius_m)}^2"
        return path, 90 if piece.turn > 0 else 270, float(f"{GAIN_PER_M / (2 * piece.radius_m):.4g}")
    # the gradient a quarter turn to the right of the travel: rotation 90 turns it back
    nx, ny = _cosine(math.sin(heading)), _cosine(-math.cos(heading))
    rotation = 90
    if nx < 0 or (nx == 0 and ny < 0):
        nx, ny, rotation = -nx, -ny, 270
    place = round(nx * x + ny * y, _DIGITS)
    path = _linear((nx, ny))
    if place:
        path += f" {'-' if place > 0 else '+'} {number_text(abs(place))}"
    return path, rotation, GAIN_PER_M


def _cosine(value: float) -> float:
    """A direction cosine, of an axis exactly."""
    rounded = round(value, 12)
    return rounded if rounded in (-1, 0, 1) else value


def _number(value: float) -> str:
    return number_text(round(value, _DIGITS) + 0.0)


def _expression(text: str) -> Expression:
    return read_expression(text, ("s", "next", "top", "low", "r2"))
