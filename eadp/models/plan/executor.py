"""The plan as it is being flown: which stage, where its path and trigger lie now, when it ends.

This is the letter's state-transition function (Def. II.1) with what the print leaves open: when a trigger is armed, how
it cannot be missed, where a lap's stages lie after the shifts of earlier laps, and when a new path parameter may take
effect so that the robot always joins.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, MutableSequence, Sequence
from dataclasses import dataclass

from eadp.core.expressions.derivatives import PathFunction
from eadp.core.geometry.curves import (
    CIRCLE,
    LINE,
    Point,
    circle_of,
    curve_length_m,
    line_of,
    project,
    tangent,
)
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import LAP_LIMIT, PlanCursor
from eadp.models.plan.plan import COMPUTATION, PATH, Plan, Stage, point_at
from eadp.models.plan.segments import State

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


class PlanExecutor:
    """One flight's way through a plan.

    Attributes
    ----------
    stage : Stage
        The stage being flown; `lap` counts from 0 (always 0 where the plan does not repeat).
    path : function (x, y) → jet
        Its path function in the frame of lap 0: evaluate it at the position less `offset_m`.
    form : tuple of float or None
        The path function's closed form in the same frame, where it is a line or a circle.
    watch : list or array of float
        What `watched` looks at, and counts in; may be replaced by an array of the same numbers.
    curve : CurveProgress or None
        What passes the trigger of a general curve.
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
        self._walk = PlanCursor(plan, parameters) if plan.parts else None
        self._state: State | None = None
        self._latch = [latch_stage(plan, index) for index in range(len(plan.parameters))]
        self._bent = [shifting_stage(plan, parameter.name) for parameter in plan.parameters]
        self._decided: Vector = tuple(parameters)
        self._waiting: Vector = tuple(parameters)
        self._base: Point = (0.0, 0.0)
        self._pending = False
        self._join: Point | None = None
        self.watch: MutableSequence[float] = [0.0] * WATCHED
        self.curve: CurveProgress | None = None
        self._final_lap = False
        self.lap = 0
        self.stages_begun = 1
        self.complete = False
        self.offset_m: Point = (0.0, 0.0)
        self.stage: Stage = plan.stages[0]
        self.parameters: Vector = self._clipped()
        self.path: PathFunction
        self.form: Form | None
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
        return self.follow(watched(self.watch, x, y, self.curve), x, y)

    def follow(self, seen: int, x: float, y: float) -> bool:
        """What `watched` has seen at a position [m] comes to pass; return whether the stage has changed.

        Raises
        ------
        PathUndefined
            If the next stage has no path or trigger at the parameters in force.
        """
        if not seen & FIRED:
            self.complete = self.complete or bool(seen & ENDED)
            return False
        return self._leave((x, y), ended=bool(seen & ENDED))

    def go_on(self, position: Point) -> bool:
        """Leave the stage at a position [m], wherever its trigger is; return whether another one has begun.

        Raises
        ------
        PathUndefined
            As `advance`.
        """
        return self._leave(position, ended=bool(watched(self.watch, *position, self.curve) & ENDED))

    def _leave(self, position: Point, *, ended: bool) -> bool:
        if self._walk is not None:
            self._walk.next()
            self.complete = self._walk.done
            if self.complete:
                return False
            self._join = self.trigger_m
            self._follow(self._walk)
            self.stages_begun += 1
            self._begun_anew()
            self._place(position)
            return True
        if ended or (self._last() and (self._final_lap or not self._plan.repeats)):
            self.complete = True
            return False
        self._join = self.trigger_m
        self._begin_next(position)
        return True

    # --- where others tell what is flown

    def stay(self, x: float, y: float) -> None:
        """Look at a position [m] while something else tells that the stage goes on: only the plan's end counts."""
        seen = watched(self.watch, x, y, self.curve)
        self.complete = bool(seen & ENDED) or (bool(seen & FIRED) and self._nothing_follows())

    def stages_to(self, index: int) -> int | None:
        """How many stages from here on the next one of an index (from 1) begins; None where none will.

        Raises
        ------
        PathUndefined
            If a lap's quantities have no value.
        """
        if self._walk is None:
            if self.stage.index < index <= len(self._plan.stages):
                return index - self.stage.index
            if index < 1 or index > self.stage.index or not self._plan.repeats or self._final_lap:
                return None
            return index - self.stage.index + len(self._plan.stages)
        walk = copy.copy(self._walk)
        for count in range(1, LAP_LIMIT):
            walk.next()
            if walk.done:
                return None
            if walk.place.stage.index == index:
                return count
        return None

    def believe(self, parameters: Sequence[float], position: Point) -> bool:
        """Take parameters that are known to be in force, whatever was decided; return whether they are others.

        Raises
        ------
        PathUndefined
            If the path has no value at them.
        """
        before, values = self.parameters, tuple(parameters)
        if values == before:
            return False
        if self._walk is not None:
            self._walk.believe(values)
            self.parameters = self._walk.place.parameters
        else:
            self._waiting = values
            self.parameters = self._clipped()
        if self.parameters[: self._plan.path_count] != before[: self._plan.path_count]:
            self._place(position)
        return self.parameters != before

    def _nothing_follows(self) -> bool:
        if self._walk is None:
            return self._last() and (self._final_lap or not self._plan.repeats)
        walk = copy.copy(self._walk)
        walk.next()
        return walk.done

    # --- from one stage to the next

    def _follow(self, walk: PlanCursor) -> None:
        """Take over where a plan of parts is."""
        self.stage, self._state, self.lap = walk.place.stage, walk.place.state, walk.place.lap
        self.parameters = walk.place.parameters

    def _begun_anew(self) -> None:
        """A stage begins: no progress along it."""
        self.watch[PASSED_BY], self.curve = NEVER, None

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
        self._begun_anew()
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
        radius = self._plan.trigger_radius_m
        before, self.watch = self.watch, [0.0] * WATCHED
        self._watch_end()
        self.watch[TRIGGER : TRIGGER + 4] = [*self.trigger_m, radius, radius * radius]
        self.form = _form(self.stage, self.path, (x, y))
        if self._rules.box_triggers:
            self.watch[FIRES_IN] = BOX
            return
        self._watch_disc(position, radius, before)

    def _watch_end(self) -> None:
        """The end of a plan that repeats: beyond the final point along the shift, in a lap that reaches so far."""
        plan = self._plan
        self._final_lap = False
        if not plan.repeats or plan.parts:
            return
        final = point_at(plan.final_point, self.parameters, "the final point")
        shift = shift_at(plan, self.parameters)
        if not self._rules.box_triggers:
            x, y = plan.stages[-1].trigger_at(self.parameters)
            last = (x + self.offset_m[0], y + self.offset_m[1])
            if not reaches(last, final, shift, plan.trigger_radius_m):
                return
            if plan.ends_at_trigger:
                self._final_lap = True
                return
        self.watch[ENDS : ENDS + 6] = [1.0, *final, *_signs(shift), plan.trigger_radius_m]

    def _watch_disc(self, position: Point, radius: float, before: Sequence[float]) -> None:
        """Within the radius once armed (been outside it, or flown half the stage), or past the trigger."""
        join = self._join or position
        local_join = (join[0] - self.offset_m[0], join[1] - self.offset_m[1])
        local_trigger = (self.trigger_m[0] - self.offset_m[0], self.trigger_m[1] - self.offset_m[1])
        armed = math.dist(self.trigger_m, position) > radius
        length = self._watch_passing(local_join, local_trigger, position, before)
        self.watch[FIRES_IN] = DISC
        self.watch[ARMED : ARMED + 5] = [float(armed), 0.0, length / 2, *position]

    def _watch_passing(self, join: Point, trigger: Point, position: Point, before: Sequence[float]) -> float:
        """Progress along the path that passes the trigger; return the stage's nominal length [m].

        `join` and `trigger` are in the frame of lap 0.
        """
        stage, path, (ox, oy) = self.stage, self.path, self.offset_m
        if stage.kind == LINE:
            line = line_of(path, trigger, stage.sense)
            self.watch[PASSED_BY : PASSED_BY + 5] = [BY_LINE, ox + trigger[0], oy + trigger[1], *line.direction]
            return abs(line.progress_m(join))
        if stage.kind == CIRCLE:
            circle = circle_of(path, trigger, stage.sense)
            sweep, (cx, cy) = circle.sweep_rad(join, trigger), circle.centre_m
            self.watch[PASSED_BY : PASSED_BY + 5] = [BY_CIRCLE, cx + ox, cy + oy, circle.turn, sweep]
            self.watch[PROGRESS : PROGRESS + 2] = [0.0, circle.angle_rad(join)]
            _turned(self.watch, *position)  # from where the stage was joined in the plan to where the robot is
            if before[PASSED_BY] == BY_CIRCLE:
                # the path has moved under the robot: whole turns flown stay flown
                flown = before[PROGRESS] - self.watch[PROGRESS]
                self.watch[PROGRESS] += 2 * math.pi * round(flown / (2 * math.pi))
            return circle.radius_m * sweep
        start = project(path, join)
        length = curve_length_m(path, start, trigger, stage.sense)
        if not math.isfinite(length):
            self.curve = None
            return length
        curve = CurveProgress(path, stage.sense, length, self.offset_m, start)
        curve(*position)
        if self.curve is not None:
            curve.progress = self.curve.progress
        self.curve = curve
        return length


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


# --- what is watched along a stage ------------------------------------------------------------------------------------

Form = tuple[float, float, float, float, float, float]
"""A line or a circle: φ = q (u² + v²) + a u + b v + e at (u, v) = (x − x0, y − y0), as (q, x0, y0, a, b, e)."""

FIRED, ENDED = 1, 2
"""What is seen at a position, as bits: the trigger fires, the plan is over."""

FIRES_IN, TRIGGER, ARMED, PASSED_BY, PROGRESS, ENDS, WATCHED = 0, 1, 5, 10, 15, 17, 23
"""Where numbers lie in what is watched:

- where the trigger fires (`BOX`, `DISC` or nowhere); its x, y, radius and the square of that
- whether it is armed, the way flown until then, half the stage's length, the last position
- what passes it (`BY_LINE`: a point and the direction of travel; `BY_CIRCLE`: centre, turn and the angle to go)
- the angle gone, and the last direction from the centre
- whether the plan ends; the final point, the sides of it, the radius across them
"""

BOX, DISC = 1.0, 2.0
NEVER, BY_LINE, BY_CIRCLE = 0.0, 1.0, 2.0


def watched(w: MutableSequence[float], x: float, y: float, curve: CurveProgress | None) -> int:
    """Look at a position [m] whether a trigger fires (`FIRED`) and whether the plan ends (`ENDED`).

    `w` is what is watched, a list or an array; what is counted along the way is counted in it. Compiled, `curve` is
    None. Nothing here may raise.
    """
    fires = False
    dx, dy = x - w[1], y - w[2]
    if w[0] == DISC:
        inside = dx * dx + dy * dy <= w[4]
        if w[5] == 0.0:
            ex, ey = x - w[8], y - w[9]
            w[6] += math.sqrt(ex * ex + ey * ey)
            w[8], w[9] = x, y
            if not inside or w[6] >= w[7]:
                w[5] = 1.0
        fires = inside and w[5] != 0.0
        if not fires:
            if w[10] == BY_LINE:
                fires = (x - w[11]) * w[13] + (y - w[12]) * w[14] >= 0
            elif w[10] == BY_CIRCLE:
                _turned(w, x, y)
                fires = w[15] >= w[14]
            if curve is not None:
                fires = curve(x, y)
    elif w[0] == BOX:
        fires = abs(dx) <= w[3] and abs(dy) <= w[3]
    seen = FIRED if fires else 0
    if w[17] != 0.0 and _is_beyond(x - w[18], y - w[19], w[20], w[21], w[22]):
        seen += ENDED
    return seen


def _turned(w: MutableSequence[float], x: float, y: float) -> None:
    """Count the angle gone round a circle."""
    now = math.atan2(y - w[12], x - w[11])
    turned = now - w[16]
    # the remainder by 2π, exactly: the difference of two directions is within ±2π
    if turned > math.pi:
        turned -= 2 * math.pi
    elif turned < -math.pi:
        turned += 2 * math.pi
    w[15] += w[13] * turned
    w[16] = now


def _is_beyond(dx: float, dy: float, sx: float, sy: float, radius: float) -> bool:
    in_x = dx * sx > 0 if sx != 0.0 else abs(dx) <= radius
    in_y = dy * sy > 0 if sy != 0.0 else abs(dy) <= radius
    return in_x and in_y


WATCHING = (watched, _turned, _is_beyond)
"""`watched` and what it calls, to be compiled together."""


def _signs(shift: Point) -> Point:
    dx, dy = shift
    return 0.0 if abs(dx) < 1e-9 else math.copysign(1, dx), 0.0 if abs(dy) < 1e-9 else math.copysign(1, dy)


def beyond(final: Point, shift: Point, radius: float) -> Callable[[float, float], bool]:
    """A test whether a position is strictly beyond the final point along the shift, and within the radius across it."""
    (fx, fy), (sx, sy) = final, _signs(shift)
    return lambda x, y: _is_beyond(x - fx, y - fy, sx, sy, radius)


def _form(stage: Stage, path: PathFunction, near: Point) -> Form | None:
    """The closed form of a line or a circle, told by one evaluation; None of a curve."""
    if stage.kind not in (LINE, CIRCLE):
        return None
    x, y = near
    try:
        value, gx, gy, hxx, _, _ = path(x, y)
    except (ArithmeticError, ValueError):
        return None
    form = (0.0, x, y, gx, gy, value)
    if stage.kind == CIRCLE:
        if hxx == 0:
            return None
        # φ = ½h |p − c|² + e with p − c = ∇φ/h
        dx, dy = gx / hxx, gy / hxx
        form = (hxx / 2, x - dx, y - dy, 0.0, 0.0, value - hxx / 2 * (dx * dx + dy * dy))
    return form if all(math.isfinite(number) for number in form) else None


class CurveProgress:
    """Progress along a general curve, of its point below the robot; called, whether it has passed the trigger."""

    def __init__(self, path: PathFunction, sense: int, length_m: float, offset: Point, start: Point) -> None:
        self.progress = 0.0
        self._path, self._sense, self._length_m, self._offset = path, sense, length_m, offset
        self._foot = start

    def __call__(self, x: float, y: float) -> bool:
        try:
            foot = project(self._path, (x - self._offset[0], y - self._offset[1]))
            tx, ty = tangent(self._path, foot, self._sense)
        except PathUndefined:  # no point of the path below the robot: it has not moved along it
            return False
        self.progress += (foot[0] - self._foot[0]) * tx + (foot[1] - self._foot[1]) * ty
        self._foot = foot
        return self.progress >= self._length_m
