"""Ground that legs stand for, and the quality U that it was seen with.

In a segment of laps, a lap stands for the strip between it and the next one: its advance times its length, on a scale
on which a lap at the highest parameters stands for its own length. Stages outside laps stand for their length. The
ground of a lap, or of such a run of stages, is shared among its legs by their times, so that wind prefers none of them.

    U = Σ_k g_k Σ_i ω_i c̃_ik / Σ_k g_k

over the legs k of the mission on which a parameter has a choice, flown or not; ω_i are the weights of these parameters,
scaled to sum to 1. Ground that is not reached counts 0 in the numerator.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box

MIN_ADVANCE = 1e-9


def lap_scale(cursor: PlanCursor, *, last: bool = False) -> float:
    """Ground per metre of a lap, relative to that at the highest parameters: its advance over theirs.

    The last lap of a plan, or of a segment, advances to its end. A stage outside laps has 1.

    Parameters
    ----------
    cursor : PlanCursor
        At the last stage of the lap, the parameters of which shift the next lap.
    last : bool
        Whether the plan ends in this lap.

    Raises
    ------
    PathUndefined
        If a shift, a trigger, the final point or a loop variable has no value.
    """
    if cursor.table.segments[cursor.segment].repeats:
        return _segment_scale(cursor)
    return _plan_scale(cursor, last=last) if cursor.table.plan.repeats else 1.0


def _segment_scale(cursor: PlanCursor) -> float:
    """`lap_scale` of a segment of laps, by what a lap gains on the segment's end."""
    segment, highest = cursor.table.segments[cursor.segment], tuple(cursor.table.highest)
    gained = _gain(cursor, cursor.parameters, cursor.state)
    most = _gain(cursor, highest, segment.start(highest))
    return gained / most if most > MIN_ADVANCE else 1.0


def _plan_scale(cursor: PlanCursor, *, last: bool) -> float:
    """`lap_scale` of a plan that repeats, by its shift, up to the final point."""
    table = cursor.table
    shift_m, max_m = math.hypot(*table.shift_at(cursor.waiting)), math.hypot(*table.shift_at(table.highest))
    laps = _laps_left(cursor)
    return max(laps if last else min(laps, 1.0), 0.0) * (shift_m / max_m if max_m > MIN_ADVANCE else 1.0)


def _laps_left(cursor: PlanCursor) -> float:
    """Laps from the one before to the final point, along the axis of the shift with more of them; 1 without a shift."""
    final_m, _, trigger_m = cursor.table.ends_at(cursor.parameters)
    shift_m = cursor.table.shift_at(cursor.waiting)
    axes = zip(final_m, trigger_m, cursor.offset_m, shift_m, strict=True)
    laps = [1.0 + (end - here - offset) / by for end, here, offset, by in axes if abs(by) > MIN_ADVANCE]
    return max(laps, default=1.0)


def _gain(cursor: PlanCursor, parameters: Vector, state: tuple[float, ...]) -> float:
    """Advance of a lap of a segment towards its end, and not beyond, in the units of its condition."""
    segment = cursor.table.segments[cursor.segment]
    now, then = segment.left(parameters, state), segment.left(parameters, segment.next(parameters, state))
    return max(now - max(then, 0.0), 0.0)


class QualityShares:
    """What a leg is seen with: Σ_i ω_i c̃_i over the parameters that have a choice on its stage.

    Parameters
    ----------
    plan : Plan
    weights : mapping of name to float
        A parameter that is not named weighs 1.
    """

    def __init__(self, plan: Plan, weights: Mapping[str, float]) -> None:
        self.weights = np.array([weights.get(name, 1.0) for name in plan.names])
        self._plan, self._scaled = plan, [self._of(sets) for sets in plan.quality_sets]

    def _of(self, sets: Sequence[Box]) -> FloatArray:
        weights: FloatArray = np.where([not box.fixed for box in sets], self.weights, 0.0) if sets else 0 * self.weights
        total = float(weights.sum())
        return weights / total if total > 0 else weights

    def scaled(self, stage: int) -> FloatArray:
        """ω_i on a stage, from 1, shape (parameters,): they sum to 1, or are all 0 where no parameter has a choice."""
        return self._scaled[stage - 1]

    def of(self, stage: int, parameters: Vector) -> float | None:
        """Σ_i ω_i c̃_i on a stage, from 1; None where no parameter has a choice."""
        scaled, sets = self._scaled[stage - 1], self._plan.quality_sets[stage - 1]
        if not sets or not scaled.any():
            return None
        shares = [box.share(value) or 0.0 for box, value in zip(sets, parameters, strict=True)]
        return float(scaled @ shares)


class RunTally(NamedTuple):
    """The lap, or the run of stages outside laps, that is being flown.

    Attributes
    ----------
    flown_m : float
        Length of its legs before the one being flown [m].
    flown_s : float
        Time since it began [s].
    free_s, area_s : float
        Of that, the time in which a parameter had a choice, and the time integral of Σ_i ω_i c̃_i [s].
    """

    flown_m: float = 0.0
    flown_s: float = 0.0
    free_s: float = 0.0
    area_s: float = 0.0


class FlownGround(NamedTuple):
    """What a flight has seen so far.

    Attributes
    ----------
    ground, value : float
        Of the runs before the one being flown: ground on which a parameter had a choice [m], and what of it counts
        as seen.
    run : RunTally
    """

    ground: float = 0.0
    value: float = 0.0
    run: RunTally = RunTally()


class GroundLog:
    """Adds up the ground of a flight, leg by leg.

    Parameters
    ----------
    plan : Plan
    weights : mapping of name to float
    """

    def __init__(self, plan: Plan, weights: Mapping[str, float]) -> None:
        self.shares = QualityShares(plan, weights)
        self._ground = self._value = 0.0
        self._run = RunTally()
        self._place: tuple[int, int] | None = None
        self._cursor: PlanCursor | None = None
        self._length_m = 0.0
        self._since_s = 0.0
        self._quality: float | None = None

    def start_leg(self, time_s: float, cursor: PlanCursor, length_m: float) -> None:
        """A leg begins: where it is in the plan, and its length [m]."""
        self._advance(time_s)
        place = cursor.segment, cursor.lap
        if place != self._place and self._cursor is not None:
            self._close()
        elif self._cursor is not None:
            self._run = self._run._replace(flown_m=self._run.flown_m + self._length_m)
        self._place, self._cursor, self._length_m = place, cursor, length_m

    def hold(self, time_s: float, cursor: PlanCursor, parameters: Vector) -> None:
        """Parameters that hold from a time on [s], and the cursor with those decided."""
        self._advance(time_s)
        self._cursor, self._quality = cursor, self.shares.of(cursor.stage.index, parameters)

    def until(self, time_s: float) -> FlownGround:
        """What was seen up to a time [s]; asking changes nothing."""
        return FlownGround(self._ground, self._value, self._run_until(time_s))

    def _advance(self, time_s: float) -> None:
        self._run, self._since_s = self._run_until(time_s), time_s

    def _run_until(self, time_s: float) -> RunTally:
        seconds = time_s - self._since_s
        m, flown_s, free_s, area_s = self._run
        if self._quality is not None:
            free_s, area_s = free_s + seconds, area_s + seconds * self._quality
        return RunTally(m, flown_s + seconds, free_s, area_s)

    def _close(self) -> None:
        """The run is complete."""
        assert self._cursor is not None
        m, flown_s, free_s, area_s = self._run
        if flown_s > 0:
            ground = lap_scale(self._cursor) * (m + self._length_m)
            self._ground += ground * free_s / flown_s
            self._value += ground * area_s / flown_s
        self._run = RunTally()
