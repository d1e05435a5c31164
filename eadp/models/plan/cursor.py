"""Where a flight is in its plan: the stage, its lap, the parameters in force, and what comes next.

One immutable state machine serves the simulated flight, live telemetry, the route that is left, the nominal trace and
the check. This is the letter's state-transition function (Def. II.1) with what the print leaves open: where a lap's
stages lie after the shifts of earlier laps, and when a new path parameter takes effect so that the robot always joins.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from eadp.core.expressions.derivatives import PathFunction
from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, PathUndefined
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import COMPUTATION, Segment, Stage, State, point_at

LAP_LIMIT = 10_000
KEPT = 1_000
"""Parameters whose shift is kept: each lap asks for it several times, and so do similar routes."""
Vector = tuple[float, ...]
LATCHED, LIVE = "latched", "live"


@dataclass(frozen=True, slots=True)
class Rules:
    """How stages follow one another.

    `parameter_changes` is `latched` (a new path parameter waits for the stage before the first whose path names it, and
    in the last lap does not take effect where it would alter nothing flown) or `live` (it moves the path at once, as
    the published flights do). `box_triggers` is the published test: a box of the
    trigger's radius, neither armed nor passed, and an end that asks for the position alone.
    """

    parameter_changes: str = LATCHED
    box_triggers: bool = False


class PlanEnd(NamedTuple):
    """Where a plan that repeats ends in this lap: beyond `final_m` along `shift_m`, or at the lap's last trigger."""

    final_m: Point
    shift_m: Point
    at_trigger: bool


class PlanCursor(NamedTuple):
    """A position in a plan: one stage as it is flown in one lap. Immutable: `next` and `decide` return another one.

    A plan that repeats ends where its `end` says, which depends on the aircraft's position: the cursor alone goes on
    for ever, but for a plan that ends at a trigger.

    Attributes
    ----------
    stage : Stage
    parameters : tuple of float
        In force: as decided, held back where they wait, clipped to the stage's sets.
    lap : int
        Laps of this segment flown before this one; 0 where it is flown once.
    offset_m : (float, float)
        How far this lap's stages lie from those of lap 0 [m].
    state : tuple of float
        The segment's loop variables.
    segment : int
        Index of the segment.
    decided, waiting : tuple of float
        Parameters as decided last; and as they are before clipping, where a path parameter may still be an older one.
    airspeeds_mps : tuple of float
        Airspeed decided for each stage [m/s]; empty where that is not decided.
    """

    stage: Stage
    parameters: Vector
    lap: int
    offset_m: Point
    state: State
    segment: int
    decided: Vector
    waiting: Vector
    base_m: Point
    shift_due: bool
    table: _Table
    airspeeds_mps: Vector = ()

    @classmethod
    def start(cls, plan: Plan, parameters: Sequence[float], rules: Rules | None = None) -> PlanCursor:
        """The first stage of a plan, at the parameters of take-off.

        Raises
        ------
        PathUndefined
            If loop variables have no value, or no segment has any lap to fly.
        """
        values = tuple(parameters)
        table = _Table(plan, rules or Rules())
        before = cls(plan.stages[0], values, 0, (0.0, 0.0), (), -1, values, values, (0.0, 0.0), False, table)
        first = before._next_segment()
        if first is None:
            raise PathUndefined("no segment of the plan has any lap to fly")
        return first

    @property
    def airspeed_mps(self) -> float | None:
        """Airspeed that is commanded here [m/s]: the stage's own, else as decided; None for that of cruise."""
        airspeeds = self.airspeeds_mps
        return self.stage.airspeed_mps or (airspeeds[self.stage.index - 1] if airspeeds else None)

    # --- where the stage lies

    def path(self) -> PathFunction:
        """The stage's path function in the frame of lap 0: evaluate it at the position less `offset_m`.

        Raises
        ------
        PathUndefined
            If it has no value at the parameters in force.
        """
        return self.stage.path_at(self.parameters, self.state)

    def local_trigger_m(self) -> Point:
        """The stage's trigger in the frame of lap 0 [m]; raises PathUndefined as `path`."""
        return self.stage.trigger_at(self.parameters, self.state)

    def trigger_m(self) -> Point:
        """The stage's trigger [m]; raises PathUndefined as `path`."""
        x, y = self.local_trigger_m()
        return x + self.offset_m[0], y + self.offset_m[1]

    def end(self) -> PlanEnd | None:
        """Where a plan that repeats ends in this lap; None where it does not reach its end in this lap.

        Raises
        ------
        PathUndefined
            If the final point, the shift or the last trigger has no value.
        """
        table, plan = self.table, self.table.plan
        if not plan.repeats:
            return None
        final, shift, (x, y) = table.ends_at(self.parameters)
        if table.rules.box_triggers:
            return PlanEnd(final, shift, at_trigger=False)
        last = (x + self.offset_m[0], y + self.offset_m[1])
        if not reaches(last, final, shift, plan.final_radius_m):
            return None
        return PlanEnd(final, shift, plan.ends_at_trigger)

    # --- transitions

    def decide(self, parameters: Vector) -> PlanCursor:
        """The same stage after a decision.

        Computations change at once. A path parameter waits for its stage, or takes effect at once where the rules say
        `live`; a lap's last stage stays where it lies. A plan of segments latches whatever the rules say.
        """
        if self.table.live:
            waiting = parameters
        else:
            rho = self.table.plan.path_count
            waiting = (*self.waiting[:rho], *parameters[rho:])
        return self._moved(decided=parameters, waiting=waiting)

    def in_force(self, parameters: Vector) -> PlanCursor:
        """The same stage where these parameters are known to be in force, whatever was decided."""
        return self._moved(waiting=parameters)

    def next(self) -> PlanCursor | None:
        """The next stage; None after the last one.

        Raises
        ------
        PathUndefined
            If the next lap's loop variables or its shift have no value, or a segment takes more than 10,000 laps.
        """
        segment = self.table.segments[self.segment]
        if self.stage.index < segment.first + segment.count:
            return self._enter(self.segment, self.stage.index, self.lap, self.state, self.base_m)
        if not segment.repeats:
            return self._next_lap() if self.table.plan.repeats else self._next_segment()
        _check_laps(self.lap + 1)
        state = segment.next(self.parameters, self.state)
        if segment.over(self.parameters, state):
            return self._next_segment()
        return self._enter(self.segment, segment.first, self.lap + 1, state, self.base_m)

    def _next_lap(self) -> PlanCursor | None:
        """The first stage of the next lap of a plan that repeats."""
        _check_laps(self.lap + 1)
        end = self.end()
        if end is not None and end.at_trigger:
            return None
        # live, the shift was due at the start of the last stage
        base = self.base_m if self.table.live else self._shifted(self.base_m, self.waiting)
        return self._enter(self.segment, 0, self.lap + 1, self.state, base)

    def accepts_changes(self) -> bool:
        """Whether a path parameter decided during this stage takes effect with the next one, or at once."""
        if self.table.live:
            return True
        rho = self.table.plan.path_count
        for bound in (-math.inf, math.inf):
            try:
                following = self.decide((*[bound] * rho, *self.decided[rho:])).next()
            except EadpError:
                return True
            if following is None or following.parameters[:rho] != self.parameters[:rho]:
                return True
        return False

    def _next_segment(self) -> PlanCursor | None:
        """The first stage of the next segment that has any lap to fly."""
        table = self.table
        for index in range(self.segment + 1, len(table.segments)):
            segment = table.segments[index]
            values = _clipped(table.plan.stages[segment.first], self.decided)
            state = segment.start(values)
            if not segment.repeats or not segment.over(values, state):
                start = self._replace(waiting=self.decided)
                return start._enter(index, segment.first, 0, state, self.base_m)
        return None

    def _enter(self, segment: int, index: int, lap: int, state: State, base_m: Point) -> PlanCursor:
        """A stage (from 0) as it starts: path parameters that waited for it take effect."""
        table, waiting = self.table, self.waiting
        if waiting != self.decided:
            latched = [latch in (index, None) for latch in table.latches[segment]]
            waiting = _chosen(latched, self.decided, self.waiting)
            kept = _chosen(table.of_later_laps[segment], self.waiting, waiting)
            if kept != waiting and all(
                self._is_last_lap(segment, index, state, base_m, own) for own in (kept, waiting)
            ):
                waiting = kept  # it would alter nothing flown
        due = self.shift_due
        if table.live and table.is_last(index):
            # where the lap lies now it stays, and the shift to the next one is due, whatever it will be
            base_m, due = (self._shifted(base_m, waiting) if due else base_m), True
        stage = table.plan.stages[index]
        own = _clipped(stage, waiting)
        offset = self._offset(index, base_m, waiting, due=due)
        decided, airspeeds = self.decided, self.airspeeds_mps
        return PlanCursor(stage, own, lap, offset, state, segment, decided, waiting, base_m, due, table, airspeeds)

    def _is_last_lap(self, segment: int, index: int, state: State, base_m: Point, waiting: Vector) -> bool:
        """Whether the plan, or the segment, ends in the lap of a stage (from 0)."""
        table, of_laps = self.table, self.table.segments[segment]
        own = _clipped(table.plan.stages[index], waiting)
        if of_laps.repeats:
            return of_laps.over(own, of_laps.next(own, state))
        final, shift, (x, y) = table.ends_at(own)
        at = x + base_m[0], y + base_m[1]
        return not table.rules.box_triggers and reaches(at, final, shift, table.plan.final_radius_m)

    def _moved(self, *, waiting: Vector, decided: Vector | None = None) -> PlanCursor:
        """The same stage with other parameters."""
        stage, _, lap, _, state, segment, before, _, base_m, due, table, airspeeds = self
        offset, own = self._offset(stage.index - 1, base_m, waiting, due=due), _clipped(stage, waiting)
        decided = before if decided is None else decided
        return PlanCursor(stage, own, lap, offset, state, segment, decided, waiting, base_m, due, table, airspeeds)

    def _offset(self, index: int, base_m: Point, waiting: Vector, *, due: bool) -> Point:
        """Live, a lap lies where the parameters of the moment shift it to, but for its last stage."""
        if not due or not self.table.live or self.table.is_last(index):
            return base_m
        return self._shifted(base_m, waiting)

    def _shifted(self, base_m: Point, waiting: Vector) -> Point:
        """One shift further than `base_m` [m], parameters clipped to the sets of the stages whose paths they change."""
        dx, dy = self.table.shift_at(waiting)
        return base_m[0] + dx, base_m[1] + dy


class _Table:
    """What all cursors of a plan share; `highest` are its highest parameters."""

    def __init__(self, plan: Plan, rules: Rules) -> None:
        self.plan, self.rules = plan, rules
        self.segments = plan.segments or (Segment(0, len(plan.stages)),)
        self.live = rules.parameter_changes == LIVE and not plan.segments
        self.latches = [_latches(plan, segment) for segment in self.segments]
        self.of_later_laps = [_of_later_laps(plan, segment) for segment in self.segments]
        self._changed = [
            next((stage for stage in plan.stages if parameter.name in stage.path.names), plan.stages[0])
            for parameter in plan.parameters
        ]
        self.highest = tuple([plan.hull(i).hi for i in range(len(plan.parameters))]) if plan.has_sets else ()

    def is_last(self, index: int) -> bool:
        """Whether a stage (from 0) is the last one of a lap of a plan that repeats."""
        return self.plan.repeats and index == len(self.plan.stages) - 1

    @lru_cache(maxsize=KEPT)  # noqa: B019
    def ends_at(self, parameters: Vector) -> tuple[Point, Point, Point]:
        """Final point, shift, and last trigger of lap 0 [m]."""
        final = point_at(self.plan.final_point, parameters, "the final point")
        return final, shift_at(self.plan, parameters), self.plan.stages[-1].trigger_at(parameters)

    @lru_cache(maxsize=KEPT)  # noqa: B019
    def shift_at(self, waiting: Vector) -> Point:
        """The shift [m] at parameters clipped to the sets of the stages whose paths they change."""
        if not self.plan.has_sets:
            return shift_at(self.plan, waiting)
        sets = (stage.sets[i] for i, stage in enumerate(self._changed))
        return shift_at(self.plan, [box.clip(value) for box, value in zip(sets, waiting, strict=True)])


def cursors(cursor: PlanCursor | None) -> Iterator[PlanCursor]:
    """The stages from a cursor on, as long as there is a next one."""
    while cursor is not None:
        yield cursor
        cursor = cursor.next()


def _check_laps(lap: int) -> None:
    if lap >= LAP_LIMIT:
        raise PathUndefined(f"the plan does not reach its final point within {LAP_LIMIT} laps")


def _latches(plan: Plan, segment: Segment) -> list[int | None]:
    """For each parameter the stage (from 0) of a segment at whose start it takes effect; None for at every start."""
    stages = plan.stages[segment.first : segment.first + segment.count]
    latches: list[int | None] = []
    for parameter in plan.parameters:
        if parameter.kind == COMPUTATION or not (segment.repeats or plan.repeats):
            latches.append(None)
            continue
        dependent = segment.dependent(parameter.name)
        named = [i for i, stage in enumerate(stages) if stage.path.names & dependent]
        # the stage before the first one named; a whole lap for what no path names
        latches.append(segment.first + ((named[0] - 1) % segment.count if named else 0))
    return latches


def _of_later_laps(plan: Plan, segment: Segment) -> list[bool]:
    """For each parameter whether it alters later laps alone from where it takes effect in a lap of a segment."""
    alters = []
    for parameter, latch in zip(plan.parameters, _latches(plan, segment), strict=True):
        dependent = segment.dependent(parameter.name)
        rest = plan.stages[latch : segment.first + segment.count] if latch is not None else ()
        parts = [part for stage in rest for part in (stage.path, *stage.trigger)]
        parts += plan.final_point if plan.repeats else ()
        alters.append(latch is not None and not any(part.names & dependent for part in parts))
    return alters


def _chosen(where: Sequence[bool], values: Vector, others: Vector) -> Vector:
    """Values where they are chosen, and others elsewhere."""
    return tuple([one if own else other for own, one, other in zip(where, values, others, strict=True)])


def _clipped(stage: Stage, values: Vector) -> Vector:
    """Parameters clipped to a stage's sets."""
    if not stage.sets:
        return values
    for box, value in zip(stage.sets, values, strict=True):
        if not box.lo <= value <= box.hi:
            return tuple([box.clip(value) for box, value in zip(stage.sets, values, strict=True)])
    return values


def shift_at(plan: Plan, parameters: Sequence[float]) -> Point:
    """The shift d(c) [m] from one lap to the next; (0, 0) for a plan that does not repeat."""
    return point_at(plan.shift, parameters, "the shift") if plan.shift else (0.0, 0.0)


def reaches(last: Point, final: Point, shift: Point, radius: float) -> bool:
    """Whether a lap whose last trigger is `last` reaches the final point along the shift."""
    (x, y), (fx, fy), (dx, dy) = last, final, shift
    return _reaches(x - fx, fx, dx, radius) and _reaches(y - fy, fy, dy, radius)


def _reaches(beyond: float, end: float, d: float, radius: float) -> bool:
    """Along one axis, from how far a value lies beyond the end."""
    if abs(d) < 1e-9:
        return abs(beyond) <= radius
    return beyond * d >= -1e-9 * abs(d) * (1 + abs(end))
