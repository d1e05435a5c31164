"""The plan as it is flown: a cursor that goes on where triggers fire, and the path and trigger where they lie now."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

from eadp.core.expressions.derivatives import PathFunction
from eadp.core.geometry.curves import CIRCLE, LINE, Point
from eadp.models.plan.cursor import LAP_LIMIT, PlanCursor, Rules, Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Stage
from eadp.models.plan.triggers import ENDED, FIRED, TriggerWatch

Form = tuple[float, float, float, float, float, float]
"""A line or a circle: φ = q (u² + v²) + a u + b v + e at (u, v) = (x − x0, y − y0), as (q, x0, y0, a, b, e)."""


class PlanExecutor:
    """One flight through a plan.

    Attributes
    ----------
    cursor : PlanCursor
        The stage being flown, its lap, and the parameters in force.
    joined_m : (float, float)
        Where the stage was joined in the plan: the trigger before it, or the start of the flight [m].
    path : function (x, y) → jet
        Its path function in the frame of lap 0: evaluate it at the position less the cursor's `offset_m`.
    trigger_m : (float, float)
        Its trigger [m].
    form : tuple of float or None
        The path function's closed form in the same frame, where it is a line or a circle.
    watch : TriggerWatch
        What ends the stage and the plan.
    stages_started : int
        Stages started so far, the first included.
    complete : bool
        Whether the plan is done.
    """

    def __init__(self, plan: Plan, parameters: Sequence[float], position: Point, rules: Rules) -> None:
        self._begin(PlanCursor.start(plan, parameters, rules), position)

    @classmethod
    def at(cls, cursor: PlanCursor, position: Point) -> PlanExecutor:
        """A flight from the start of a stage [m] on."""
        executor = cls.__new__(cls)
        executor._begin(cursor, position)
        return executor

    def _begin(self, cursor: PlanCursor, position: Point) -> None:
        self.cursor = cursor
        self.joined_m = position
        self.stages_started = 1
        self.complete = False
        self.path: PathFunction
        self.trigger_m: Point
        self.form: Form | None
        self.watch: TriggerWatch
        self._lay_out(position)

    @property
    def stage(self) -> Stage:
        """The stage being flown."""
        return self.cursor.stage

    @property
    def parameters(self) -> Vector:
        """The parameters in force."""
        return self.cursor.parameters

    def decide(self, parameters: Sequence[float], position: Point, airspeeds_mps: Vector | None = None) -> bool:
        """Take new parameters at a position [m], and airspeeds, None for no others; return whether any has changed.

        Raises
        ------
        PathUndefined
            If the path has no value at the new parameters.
        """
        values, before = tuple(parameters), self.cursor.airspeed_mps
        if airspeeds_mps is not None:
            self.cursor = self.cursor._replace(airspeeds_mps=airspeeds_mps)
        changed = self.cursor.airspeed_mps != before
        if values == self.cursor.decided:
            return changed
        return self._change(self.cursor.decide(values), position) or changed

    def take_in_force(self, parameters: Sequence[float], position: Point) -> bool:
        """Take parameters that are known to be in force, whatever was decided; return whether they are others.

        Raises
        ------
        PathUndefined
            If the path has no value at them.
        """
        values = tuple(parameters)
        if values == self.cursor.parameters:
            return False
        return self._change(self.cursor.in_force(values), position)

    def placed(
        self, cursor: PlanCursor, joined_m: Point, stages_started: int, position: Point, share: float
    ) -> PlanExecutor:
        """A flight through the same plan that is somewhere else: a share along a stage, at a position [m].

        Raises
        ------
        PathUndefined
            As `advance`.
        """
        other = copy.copy(self)
        other.cursor, other.joined_m, other.stages_started = cursor, joined_m, stages_started
        other._lay_out(position)
        other.watch.resume(share)
        return other

    def advance(self, x: float, y: float) -> bool:
        """Go on where the stage, or the plan, ends at a position [m]; return whether the stage has changed.

        Raises
        ------
        PathUndefined
            If the next stage has no path or trigger at the parameters in force.
        """
        return self.handle(self.watch.events(x, y), x, y)

    def handle(self, events: int, x: float, y: float) -> bool:
        """Take what `watched` returned at a position [m]; return whether the stage has changed.

        Raises
        ------
        PathUndefined
            If the next stage has no path or trigger at the parameters in force.
        """
        if not events & FIRED:
            self.complete = self.complete or bool(events & ENDED)
            return False
        return self._leave((x, y), ended=bool(events & ENDED))

    def skip(self, position: Point) -> bool:
        """Leave the stage at a position [m], wherever its trigger is; return whether another one has started.

        Raises
        ------
        PathUndefined
            As `advance`.
        """
        return self._leave(position, ended=bool(self.watch.events(*position) & ENDED))

    def stay(self, x: float, y: float) -> None:
        """Take a position [m] at which the stage is known to go on: only the plan's end counts.

        Raises
        ------
        PathUndefined
            If the next lap's loop variables have no value.
        """
        events = self.watch.events(x, y)
        self.complete = bool(events & ENDED) or (bool(events & FIRED) and self.cursor.next() is None)

    def past_end(self) -> PlanExecutor | None:
        """The flight that goes on where this one is complete, without its end on this leg; None without a next stage.

        Raises
        ------
        PathUndefined
            If the next lap's loop variables have no value.
        """
        if self.cursor.next() is None:
            return None
        other = copy.copy(self)
        other.complete, other.watch = False, self.watch.without_end()
        return other

    def stages_to(self, index: int) -> int | None:
        """In how many stages from here the next one of an index (from 1) starts; None where none will.

        Raises
        ------
        PathUndefined
            If a lap's loop variables have no value.
        """
        if not 1 <= index <= len(self.cursor.table.plan.stages):
            return None
        cursor = self.cursor.next()
        for count in range(1, LAP_LIMIT):
            if cursor is None or cursor.stage.index == index:
                return None if cursor is None else count
            cursor = cursor.next()
        return None

    def _change(self, cursor: PlanCursor, position: Point) -> bool:
        before, self.cursor = self.cursor, cursor
        rho = cursor.table.plan.path_count
        # live, a lap's last stage keeps the path that it started with
        kept = cursor.table.live and cursor.table.is_last(cursor.stage.index - 1)
        if cursor.parameters[:rho] != before.parameters[:rho] and not kept:
            self._lay_out(position, self.watch)
        return cursor.parameters != before.parameters

    def _leave(self, position: Point, *, ended: bool) -> bool:
        following = None if ended else self.cursor.next()
        if following is None:
            self.complete = True
            return False
        self.cursor, self.joined_m = following, self.trigger_m
        self.stages_started += 1
        self._lay_out(position)
        return True

    def _lay_out(self, position: Point, before: TriggerWatch | None = None) -> None:
        """Put path, trigger and watch where the stage lies now; `before` is this stage's watch so far."""
        cursor = self.cursor
        self.path, (x, y), (ox, oy) = cursor.path(), cursor.local_trigger_m(), cursor.offset_m
        self.trigger_m = (x + ox, y + oy)
        self.watch = TriggerWatch(cursor, self.path, self.trigger_m, self.joined_m, position, before)
        self.form = _form(cursor.stage, self.path, (x, y))


def _form(stage: Stage, path: PathFunction, near: Point) -> Form | None:
    """The closed form of a line or a circle, from one evaluation; None for a curve."""
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
