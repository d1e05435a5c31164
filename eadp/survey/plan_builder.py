"""A coverage solution as a plan: stages flown once, and laps of four stages in loop variables that move them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import Expression
from eadp.core.geometry.curves import Point
from eadp.models.plan.pieces import (
    DIGITS,
    GAIN_PER_M,
    LOITER,
    MIN_STAGE_M,
    TRIGGER_RADIUS_M,
    Command,
    PathText,
    circle_text,
    linear_text,
    piece_path,
    rounded_text,
    scaled_text,
    shifted_text,
    sum_text,
)
from eadp.models.plan.plan import Plan, Site
from eadp.models.plan.stage import LAND, RETURN, TAKEOFF, TRIGGER_DISTANCE, Box, LoopVariable, Segment, Stage, Title
from eadp.survey.coverage import CoverageSolution
from eadp.survey.swaths import CoverageLeg, StripFrame
from eadp.survey.zamboni import END_TOLERANCE_M, Block, PiecewiseLinear

START_M = 100.0
"""Distance of the default start before the first trigger: a first stage of this length starts with the first line."""


@dataclass(frozen=True)
class FieldComputations:
    """The computations that run over the field: names with units, their sets, and whether they stop on turns."""

    computations: tuple[tuple[str, str], ...] = ()
    sets: tuple[Box, ...] = ()
    off_on_turns: bool = False

    def sets_for(self, sensing: bool) -> tuple[Box, ...]:
        """The sets of a stage."""
        return self.sets if sensing or not self.off_on_turns else tuple(Box(0.0, 0.0) for _ in self.sets)


def build_plan(
    solution: CoverageSolution,
    *,
    name: str = "",
    computations: FieldComputations | None = None,
    min_radius_m: float | None = None,
    site: Site | None = None,
    altitude_m: float | None = None,
    picture_m: float | None = None,
    takeoff_m: float | None = None,
    land_m: float | None = None,
) -> Plan:
    """The plan of a coverage path.

    Parameters
    ----------
    solution : CoverageSolution
    name : str, optional
        The plan's name in messages.
    computations : FieldComputations, optional
        None by default.
    min_radius_m : float, optional
        The aircraft's smallest turning radius [m], for the plan's header.
    site : Site, optional
        Where the field is.
    altitude_m : float, optional
        Altitude of the stages whose legs have none [m].
    picture_m : float, optional
        Distance of the pictures along a line [m].
    takeoff_m : float, optional
        Height up to which a flight from the ground climbs straight ahead [m]; 0 for that of the plan.
    land_m : float, optional
        Altitude at which the flight lands at its end [m]. One from the ground that does not land returns.
    """
    builder = _PlanBuilder(solution, computations or FieldComputations(), from_start=takeoff_m is not None)
    site = site or Site()
    if takeoff_m is not None:
        site = site._replace(start_m=site.home_m)
    elif builder.start_m is not None:
        site = site._replace(start_m=builder.start_m)
    repeats = len(builder.segments) > 1
    stages = builder.stages if picture_m is None else builder.photographed(picture_m)
    stages = [
        replace(stage, altitude_m=altitude_m if stage.altitude_m is None else stage.altitude_m) for stage in stages
    ]
    if takeoff_m is not None:
        stages[0] = replace(stages[0], commands=(_command(TAKEOFF, takeoff_m), *stages[0].commands))
    last = stages[-1]
    if land_m is not None:
        stages[-1] = replace(last, commands=(*last.commands, _command(LAND, land_m)), altitude_m=land_m)
    elif takeoff_m is not None:
        stages[-1] = replace(last, commands=(*last.commands, _command(RETURN)))
    return Plan(
        name=name,
        stages=tuple(stages),
        path_count=1 if solution.min_c1 < 0 else 0,
        titles=(Title("spacing", "m", _expression(_spacing(solution.blocks[0]))),) if solution.min_c1 < 0 else (),
        computations=builder.computations.computations,
        # below the length of the shortest stage, in two digits
        trigger_radius_m=min(TRIGGER_RADIUS_M, float(f"{0.9 * builder.shortest_m:.2g}")),
        min_radius_m=min_radius_m,
        site=site,
        segments=tuple(builder.segments) if repeats else (),
        primitive_stages=4 if repeats else None,
    )


class _PlanBuilder:
    """Stages and segments of a plan, and the length of its shortest stage; `_sensing`: whether each stage is a line."""

    def __init__(self, solution: CoverageSolution, computations: FieldComputations, *, from_start: bool) -> None:
        self.computations, self._from_start = computations, from_start
        self.stages: list[Stage] = []
        self.segments: list[Segment] = []
        self.shortest_m = math.inf
        self.start_m: Point | None = None
        """The plan's start [m], where that is not the default one: its first stage is shorter than the default way."""
        self._sensing: list[bool] = []
        self._min_c1 = solution.min_c1
        legs: list[CoverageLeg] = []  # not yet added: they become one segment, flown once
        for section in solution.sections:
            if not isinstance(section, Block):
                legs.append(section)
                continue
            if not self.stages and not legs:
                # a plan that starts with a block starts with part of its first line
                line = section.legs(0.0)[0]
                legs = line.cut(min(START_M, line.piece.length_m / 2))[:1]
            if legs:
                self._add_once(legs)
            self._add_laps(section)
            legs = section.last_lap()  # its first line starts where the last turn ends, whatever the parameters were
        self._add_once(legs)

    def _add_stage(
        self,
        path: PathText,
        trigger: tuple[str, str],
        sensing: bool,
        min_c1: float,
        altitude_m: float | None = None,
        commands: tuple[Command, ...] = (),
    ) -> None:
        """Append a stage along a path to a trigger point, both as text."""
        self._sensing.append(sensing)
        box = (Box(min_c1, 0.0),) if self._min_c1 < 0 else ()
        sets = (*box, *self.computations.sets_for(sensing))
        x, y = map(_expression, trigger)
        gain = float(f"{path.gain:.4g}")
        number, function = len(self.stages) + 1, _expression(path.function)
        stage = Stage(number, 0, gain, path.rotation_deg, function, (x, y), sets, altitude_m=altitude_m)
        self.stages.append(replace(stage, commands=commands))

    def photographed(self, distance_m: float) -> list[Stage]:
        """The stages with the command of a picture every so many metres where a line starts, of none where a turn does.

        A turn after a turn has none.
        """
        on, off = ((TRIGGER_DISTANCE, round(each_m, 6), 0.0, 1.0, 0.0, 0.0, 0.0, 0.0) for each_m in (distance_m, 0.0))
        stages = []
        for i, (stage, is_line) in enumerate(zip(self.stages, self._sensing, strict=True)):
            # whether the stages flown before it are lines: the stage above, and before a lap's first the lap's last
            before = {self._sensing[i - 1] if i else False}
            laps = [part for part in self.segments if part.repeats and part.first == i]
            before |= {self._sensing[part.first + part.count - 1] for part in laps}
            own = () if before == {is_line} else (on if is_line else off,)
            stages.append(replace(stage, commands=(*own, *stage.commands)))
        return stages

    def _add_once(self, legs: Sequence[CoverageLeg]) -> None:
        """Append a segment of stages flown once; of the first one `start_m` is set, or its first leg cut."""
        first = len(self.stages)
        if first == 0:
            # a plan starts by default so far before its first trigger: 100 m on a line, a quarter of a circle
            piece = legs[0].piece
            before_m = START_M if piece.turn == 0 else piece.radius_m * math.pi / 2
            if before_m < piece.length_m and not self._from_start:
                legs = [*legs[0].cut(before_m), *legs[1:]]  # the first trigger there, so that the start is the leg's
            else:
                self.start_m = (round(piece.start[0], DIGITS), round(piece.start[1], DIGITS))
        for leg in legs:
            if leg.piece.length_m >= MIN_STAGE_M:
                self.shortest_m = min(self.shortest_m, leg.piece.length_m)
                x, y, _ = leg.end
                path, end, climbs = piece_path(leg.piece), (rounded_text(x), rounded_text(y)), leg.whole_circle
                commands = (LOITER,) * climbs
                self._add_stage(path, end, leg.sensing, self._min_c1, leg.altitude_m, commands)
        self.segments.append(Segment(first, len(self.stages) - first))

    def _add_laps(self, block: Block) -> None:
        """Append a segment of the four primitive stages of a block, with the loop variables that move them.

        They are a first line up, the turn to the second line, that line down, and the turn to the next lap.
        """
        first = len(self.stages)
        frame = block.frame
        # rotations [°]: the gradient of a line points along u, that of a circle outward; turns are towards u
        up, down, turn = (90, 270, 270) if frame.hand == 1 else (270, 90, 90)
        u1, u2 = block.first_m, block.first_m + 2 * block.first_radius_m  # of both lines of the first lap
        gains = GAIN_PER_M / (2 * block.first_radius_m), GAIN_PER_M / (2 * block.radius_m)
        circles = (
            circle_text(_point(frame, u1 + block.first_radius_m, "s", "top"), rounded_text(block.first_radius_m)),
            circle_text(_point(frame, u2, "s - r2", "low"), "r2"),
        )
        for path, trigger, sensing in (
            (PathText(_line(frame, u1), up, GAIN_PER_M), _point(frame, u1, "s", "top"), True),
            (PathText(circles[0], turn, gains[0]), _point(frame, u2, "s", "top"), False),
            (PathText(_line(frame, u2), down, GAIN_PER_M), _point(frame, u2, "s", "low"), True),
            (PathText(circles[1], turn, gains[1]), _point(frame, u1, "next", "low"), False),
        ):
            self._add_stage(path, trigger, sensing, block.min_c1)
        end = (_expression("s"), _expression(rounded_text(block.travel_m - END_TOLERANCE_M)))
        segment = Segment(first, 4, tuple(_loop_variables(block)), end)
        self.stages[first:] = [replace(stage, segment=segment) for stage in self.stages[first:]]
        self.segments.append(segment)
        # [2::4]: the second lines of the laps
        self.shortest_m = min([self.shortest_m, *(leg.piece.length_m for leg in block.legs(0.0)[2::4])])


def _command(command: int, height_m: float = 0.0) -> Command:
    """A command that has a height alone [m]."""
    return (command, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)


def _spacing(block: Block) -> str:
    """The distance from lap to lap, which is that of the lines, in c1. Source: letter, Sec. IV-A."""
    # d = x_d + 2(r − √(r² + c1))
    radius, spacing = rounded_text(block.radius_m), rounded_text(block.spacing_m)
    return f"{spacing} + 2*({radius} - sqrt({radius}^2 + c1))" if block.min_c1 < 0 else spacing


def _loop_variables(block: Block) -> Iterator[LoopVariable]:
    """The variables of a lap [m]: its position s, the next lap's, the levels of its turns, radius r2 of the second."""
    yield LoopVariable("s", _expression("0"), _expression("next - s"))
    yield LoopVariable("next", _expression(f"min(s + {_spacing(block)}, {rounded_text(block.travel_m)})"))
    yield LoopVariable("top", _expression(_piecewise_linear(block.top, "s")))
    second, first = _piecewise_linear(block.low_second, "s"), _piecewise_linear(block.low_first, "next")
    yield LoopVariable("low", _expression(second if second == first else f"min({second}, {first})"))
    yield LoopVariable("r2", _expression(f"{rounded_text(block.first_radius_m)} - (next - s)/2"))


# --- expressions as text ----------------------------------------------------------------------------------------------


def _piecewise_linear(levels: PiecewiseLinear, name: str) -> str:
    """A straight line and its bends: v0 + m0 s + Σ (m_i − m_i−1) max(0, s − s_i)."""
    knots, values = levels.places_m, levels.levels_m
    slopes = [(b - a) / (t - s) for s, t, a, b in zip(knots, knots[1:], values, values[1:], strict=False)]
    terms = [scaled_text(slopes[0], name, 12)]
    for knot, before, after in zip(knots[1:], slopes, slopes[1:], strict=False):
        terms.append(scaled_text(after - before, f"max(0, {name} - {rounded_text(knot)})", 12))
    text = rounded_text(values[0])
    for term in filter(None, terms):
        text = sum_text(text, term)
    return text


def _line(frame: StripFrame, first_m: float) -> str:
    """u − (first + s), in x and y."""
    return f"{linear_text(frame.across)} - ({shifted_text(first_m, 's')})"


def _point(frame: StripFrame, first_m: float, moves: str, level: str) -> tuple[str, str]:
    """The point (first + moves, level) of a frame, in x and y."""
    across = shifted_text(first_m, moves)
    x, y = (
        sum_text(scaled_text(u, across), scaled_text(v, level)) for u, v in zip(frame.across, frame.along, strict=True)
    )
    return x, y


def _expression(text: str) -> Expression:
    return read_expression(text, ("s", "next", "top", "low", "r2"))
