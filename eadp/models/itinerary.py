"""The plan as it is being flown: which stage, where its path and trigger lie now, when it ends.

This is the letter's state-transition function (Def. II.1) with what the print leaves open: when a trigger is armed, how
it cannot be missed, where a lap's stages lie after the shifts of earlier laps, and when a new path parameter may take
effect so that the robot always joins.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from eadp.core.derivatives import PathFunction
from eadp.core.geometry import (
    CIRCLE,
    LINE,
    Circle,
    Point,
    circle_of,
    curve_length_m,
    line_of,
    project,
    tangent,
)
from eadp.errors import PathUndefined
from eadp.models.parts import State
from eadp.models.plan import COMPUTATION, PATH, Plan, Stage, point_at
from eadp.models.walk import Walk

Vector = tuple[float, ...]
LATCHED, LIVE = "latched", "live"


@dataclass(frozen=True, slots=True)
class Rules:
    """How stages follow one another.

    `parameter_changes` is `latched` (a new path parameter waits for the stage before the first whose path names it) or
    `live` (it moves the path at once, as the published flights do). `box_triggers` is the published test: a box of the
    trigger's radius, neither armed nor passed, and an end that asks for the position alone.
    """

    parameter_changes: str = LATCHED
    box_triggers: bool = False


class Itinerary:
    """One flight's way through a plan.

    Attributes
    ----------
    stage : Stage
        The stage being flown; `lap` counts from 0 (always 0 where the plan does not repeat).
    path : function (x, y) → jet
        Its path function in the frame of lap 0: evaluate it at the position less `offset_m`.
    offset_m : (float, float)
        How far this lap's stages lie from those of lap 0 [m].
    trigger_m : (float, float)
        The stage's trigger [m].
    parameters : tuple of float
        In force now: as decided, held back where they wait, clipped to the stage's sets.
    stages_begun : int
        Stages begun so far, the first included.
    complete : bool
        Whether the plan is done.
    """

    def __init__(self, plan: Plan, parameters: Sequence[float], position: Point, rules: Rules) -> None:
        self._plan = plan
        self._rules = rules
        self._walk = Walk(plan, parameters) if plan.parts else None
        self._state: State | None = None
        self._latch = [latch_stage(plan, index) for index in range(len(plan.parameters))]
        self._bent = [shifting_stage(plan, parameter.name) for parameter in plan.parameters]
        self._progress: _CircleProgress | _CurveProgress | None = None
        self._decided: Vector = tuple(parameters)
        self._waiting: Vector = tuple(parameters)
        self._base: Point = (0.0, 0.0)
        self._pending = False
        self._join: Point | None = None
        self._fires: Callable[[float, float], bool] = _never
        self._ends: Callable[[float, float], bool] = _never
        self._final_lap = False
        self.lap = 0
        self.stages_begun = 1
        self.complete = False
        self.offset_m: Point = (0.0, 0.0)
        self.stage: Stage = plan.stages[0]
        self.parameters: Vector = self._clipped()
        self.path: PathFunction
        self.trigger_m: Point
        if self._walk is not None:
            self._follow(self._walk)
        self._place(position)

    def decide(self, parameters: Sequence[float], position: Point) -> bool:
        """Take new parameters; return whether the ones in force have changed.

        Computations change at once. A path parameter waits for its stage, or moves the path at once where the rules say
        so, except for the last stage of a lap, which keeps the path it was begun with. In a plan of parts it waits
        whatever the rules.

        Raises
        ------
        PathUndefined
            If the path has no value at the new parameters.
        """
        values = tuple(parameters)
        if values == self._decided:
            return False
        self._decided = values
        before = self.parameters
        if self._walk is not None:
            self._walk.decide(values)
            self.parameters = self._walk.place.parameters
            return self.parameters != before
        live = self._rules.parameter_changes == LIVE
        self._waiting = tuple(
            new if live or parameter.kind == COMPUTATION else old
            for new, old, parameter in zip(values, self._waiting, self._plan.parameters, strict=True)
        )
        self.parameters = self._clipped()
        moved = self.parameters[: self._plan.path_count] != before[: self._plan.path_count]
        if live and moved and not (self._plan.repeats and self._last()):
            self._place(position)
        return self.parameters != before

    def advance(self, x: float, y: float) -> bool:
        """Look whether the stage, or the plan, is over at a position [m]; return whether the stage has changed.

        Raises
        ------
        PathUndefined
            If the next stage has no path or trigger at the parameters in force.
        """
        if not self._fires(x, y):
            if self._ends(x, y):
                self.complete = True
            return False
        if self._walk is not None:
            self._walk.next()
            self.complete = self._walk.done
            if self.complete:
                return False
            self._join = self.trigger_m
            self._follow(self._walk)
            self.stages_begun += 1
            self._progress = None
            self._place((x, y))
            return True
        if self._ends(x, y) or (self._last() and (self._final_lap or not self._plan.repeats)):
            self.complete = True
            return False
        self._join = self.trigger_m
        self._begin_next((x, y))
        return True

    # --- from one stage to the next

    def _follow(self, walk: Walk) -> None:
        """Take over where a plan of parts is."""
        self.stage, self._state, self.lap = walk.place.stage, walk.place.state, walk.place.lap
        self.parameters = walk.place.parameters

    def _last(self) -> bool:
        return self.stage.index == len(self._plan.stages)

    def _begin_next(self, position: Point) -> None:
        plan = self._plan
        self.stages_begun += 1
        if self._last():
            if self._rules.parameter_changes == LATCHED:
                self._base = self._shifted()  # with the parameters of the lap that ends
            self.lap += 1
            self.stage = plan.stages[0]
        else:
            self.stage = plan.stages[self.stage.index]
        self._latch_parameters(self.stage.index - 1)
        self.parameters = self._clipped()
        self._progress = None
        self._place(position)
        if self._rules.parameter_changes == LIVE and plan.repeats and self._last():
            # the shift to the next lap is taken here, and again with every change of a parameter until it is flown
            self._base, self._pending = self.offset_m, True

    def _latch_parameters(self, begun: int) -> None:
        """Path parameters that wait for the stage now begun (index from 0) take effect."""
        self._waiting = tuple(
            new if latch in (begun, None) else old
            for new, old, latch in zip(self._decided, self._waiting, self._latch, strict=True)
        )

    def _shifted(self) -> Point:
        """Where the next lap lies: one shift further, parameters clipped to the sets of the stages that they bend."""
        values = self._waiting
        if self.stage.sets:
            stages = self._plan.stages
            values = tuple(
                stages[bent].sets[i].clip(value) for i, (bent, value) in enumerate(zip(self._bent, values, strict=True))
            )
        dx, dy = shift_at(self._plan, values)
        return self._base[0] + dx, self._base[1] + dy

    def _clipped(self) -> Vector:
        sets = self.stage.sets
        if not sets:
            return self._waiting
        return tuple(box.clip(value) for box, value in zip(sets, self._waiting, strict=True))

    def _place(self, position: Point) -> None:
        """Put the stage's path and trigger where they lie now."""
        live_shift = self._rules.parameter_changes == LIVE and self._pending
        self.offset_m = self._shifted() if live_shift else self._base
        self.path = self.stage.path_at(self.parameters, self._state)
        x, y = self.stage.trigger_at(self.parameters, self._state)
        self.trigger_m = (x + self.offset_m[0], y + self.offset_m[1])
        self._ends = self._end_test()
        radius = self._plan.trigger_radius_m
        if self._rules.box_triggers:
            self._fires = _box_trigger(self.trigger_m, radius)
            return
        self._fires = self._disc_trigger(position, radius)

    def _end_test(self) -> Callable[[float, float], bool]:
        """The end of a plan that repeats: beyond the final point along the shift, in a lap that reaches so far."""
        plan = self._plan
        self._final_lap = False
        if not plan.repeats or plan.parts:
            return _never
        final = point_at(plan.final_point, self.parameters, "the final point")
        shift = shift_at(plan, self.parameters)
        if not self._rules.box_triggers:
            x, y = plan.stages[-1].trigger_at(self.parameters)
            last = (x + self.offset_m[0], y + self.offset_m[1])
            if not reaches(last, final, shift, plan.trigger_radius_m):
                return _never
            if plan.ends_at_trigger:
                self._final_lap = True
                return _never
        return beyond(final, shift, plan.trigger_radius_m)

    def _disc_trigger(self, position: Point, radius: float) -> Callable[[float, float], bool]:
        join = self._join or position
        local_join = (join[0] - self.offset_m[0], join[1] - self.offset_m[1])
        local_trigger = (self.trigger_m[0] - self.offset_m[0], self.trigger_m[1] - self.offset_m[1])
        passed, length = _passing(self.stage, self.path, local_join, local_trigger, self.offset_m, position)
        if isinstance(passed, _CircleProgress | _CurveProgress):
            if self._progress is not None:  # the path has moved under the robot: whole turns flown stay flown
                passed.resume(self._progress.progress)
            self._progress = passed
        return _armed_disc(self.trigger_m, radius, length, position, passed)


def shift_at(plan: Plan, parameters: Sequence[float]) -> Point:
    """The shift d(c) [m] from one lap to the next; (0, 0) for a plan that does not repeat."""
    return point_at(plan.shift, parameters, "the shift") if plan.shift else (0.0, 0.0)


def reaches(last: Point, final: Point, shift: Point, radius: float) -> bool:
    """Whether a lap whose last trigger is `last` reaches the final point along the shift."""
    for value, end, d in zip(last, final, shift, strict=True):
        if abs(d) < 1e-9:
            if abs(value - end) > radius:
                return False
        elif (value - end) * d < -1e-9 * abs(d) * (1 + abs(end)):
            return False
    return True


def shifting_stage(plan: Plan, name: str) -> int:
    """The first stage (from 0) whose path names a parameter; the first of all where none does."""
    return next((stage.index - 1 for stage in plan.stages if name in stage.path.names), 0)


def latch_stage(plan: Plan, index: int) -> int | None:
    """The stage (from 0) at whose start a path parameter takes effect; None for at every start."""
    parameter = plan.parameters[index]
    if parameter.kind != PATH or not plan.repeats:
        return None
    if not any(parameter.name in stage.path.names for stage in plan.stages):
        return 0
    return (shifting_stage(plan, parameter.name) - 1) % len(plan.stages)


# --- tests of a position, built once per stage ------------------------------------------------------------------------


def _never(_x: float, _y: float) -> bool:
    return False


def _box_trigger(trigger: Point, radius: float) -> Callable[[float, float], bool]:
    tx, ty = trigger
    return lambda x, y: abs(x - tx) <= radius and abs(y - ty) <= radius


def beyond(final: Point, shift: Point, radius: float) -> Callable[[float, float], bool]:
    """A test whether a position is strictly beyond the final point along the shift, and within the radius across it."""
    (fx, fy), (dx, dy) = final, shift
    sx = 0 if abs(dx) < 1e-9 else math.copysign(1, dx)
    sy = 0 if abs(dy) < 1e-9 else math.copysign(1, dy)

    def is_beyond(x: float, y: float) -> bool:
        in_x = (x - fx) * sx > 0 if sx else abs(x - fx) <= radius
        return in_x and ((y - fy) * sy > 0 if sy else abs(y - fy) <= radius)

    return is_beyond


def _armed_disc(
    trigger: Point, radius: float, length_m: float, start: Point, passed: Callable[[float, float], bool]
) -> Callable[[float, float], bool]:
    """Within the radius once armed (been outside it, or flown half the stage), or past the trigger."""
    tx, ty = trigger
    square = radius * radius
    armed = math.dist(trigger, start) > radius
    flown = 0.0
    px, py = start

    def fires(x: float, y: float) -> bool:
        nonlocal armed, flown, px, py
        dx, dy = x - tx, y - ty
        inside = dx * dx + dy * dy <= square
        if not armed:
            flown += math.hypot(x - px, y - py)
            px, py = x, y
            armed = not inside or flown >= length_m / 2
        return (inside and armed) or passed(x, y)

    return fires


def _passing(
    stage: Stage, path: PathFunction, join: Point, trigger: Point, offset: Point, position: Point
) -> tuple[Callable[[float, float], bool], float]:
    """A test whether progress along the path has passed the trigger, and the stage's nominal length [m].

    `join` and `trigger` are in the frame of lap 0, `offset` takes them to this lap's, where positions are given.
    """
    ox, oy = offset
    if stage.kind == LINE:
        line = line_of(path, trigger, stage.sense)
        (tx, ty), (lx, ly) = trigger, line.direction
        length = abs(line.progress_m(join))
        return lambda x, y: (x - ox - tx) * lx + (y - oy - ty) * ly >= 0, length
    if stage.kind == CIRCLE:
        circle = circle_of(path, trigger, stage.sense)
        progress = _CircleProgress(circle, join, trigger, offset)
        progress(*position)  # from where the stage was joined in the plan to where the robot is
        return progress, circle.radius_m * progress.sweep_rad
    start = project(path, join)
    length = curve_length_m(path, start, trigger, stage.sense)
    if not math.isfinite(length):
        return _never, length
    curve = _CurveProgress(path, stage.sense, length, offset, start)
    curve(*position)
    return curve, length


class _CircleProgress:
    """Progress round a circle from where it was joined, unwrapped; called, whether it has passed the trigger."""

    def __init__(self, circle: Circle, join: Point, trigger: Point, offset: Point) -> None:
        self.sweep_rad = circle.sweep_rad(join, trigger)
        self.progress = 0.0
        self._cx, self._cy = circle.centre_m[0] + offset[0], circle.centre_m[1] + offset[1]
        self._turn = circle.turn
        self._last = circle.angle_rad(join)

    def resume(self, progress: float) -> None:
        """Add the whole turns that bring the progress nearest to an earlier one [rad]."""
        self.progress += 2 * math.pi * round((progress - self.progress) / (2 * math.pi))

    def __call__(self, x: float, y: float) -> bool:
        now = math.atan2(y - self._cy, x - self._cx)
        self.progress += self._turn * math.remainder(now - self._last, 2 * math.pi)
        self._last = now
        return self.progress >= self.sweep_rad


class _CurveProgress:
    """Progress along a general curve, of its point below the robot; called, whether it has passed the trigger."""

    def __init__(self, path: PathFunction, sense: int, length_m: float, offset: Point, start: Point) -> None:
        self.progress = 0.0
        self._path, self._sense, self._length_m, self._offset = path, sense, length_m, offset
        self._foot = start

    def resume(self, progress: float) -> None:
        """Go on from an earlier progress [m]: the path has moved under the robot."""
        self.progress = progress

    def __call__(self, x: float, y: float) -> bool:
        try:
            foot = project(self._path, (x - self._offset[0], y - self._offset[1]))
            tx, ty = tangent(self._path, foot, self._sense)
        except PathUndefined:  # no point of the path below the robot: it has not moved along it
            return False
        self.progress += (foot[0] - self._foot[0]) * tx + (foot[1] - self._foot[1]) * ty
        self._foot = foot
        return self.progress >= self._length_m
