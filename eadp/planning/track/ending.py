"""The end of a plan on telemetry: whether it is certain, and whether the flight goes on all the same."""

from __future__ import annotations

import math

from eadp.core.geometry.curves import Point
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.route import MARGIN_M
from eadp.planning.base import Sample
from eadp.planning.track.locator import ALIKE, INDEPENDENT_S, MAX_STDS, path_mismatch

AHEAD_M = 20.0
"""Distance straight on within which a certain end is passed by the error of a position, `MARGIN_M` [m]."""

ELSEWHERE = 9.0
"""Squared mismatch with the plan, in standard deviations, of an aircraft that flies anywhere."""


def is_certain(executor: PlanExecutor, position: Point, course_rad: float | None) -> bool:
    """Whether the end of a plan is passed by more than the error of a position.

    Parameters
    ----------
    executor : PlanExecutor
        A flight that is complete.
    position : (float, float)
        Position [m].
    course_rad : float or None
        Direction of the ground velocity [rad]: along it, what is passed by little now is passed by more soon.
    """
    end = executor.cursor.end()
    if end is None or end.at_trigger:
        return True
    # where the aircraft is soon, straight on
    ahead_m = 0.0 if course_rad is None else AHEAD_M
    course_rad = course_rad or 0.0
    straight_on = position[0] + ahead_m * math.cos(course_rad), position[1] + ahead_m * math.sin(course_rad)
    # on each axis: by how much the end is passed in the direction of the plan's shift d, now or soon; without a shift
    # on this axis, by how much the position is inside the final point's radius
    for x, later_x, final, d in zip(position, straight_on, end.final_m, end.shift_m, strict=True):
        if abs(d) < 1e-9:
            beyond_m = executor.cursor.table.plan.final_radius_m - abs(x - final)
        else:
            beyond_m = max((x - final) * math.copysign(1, d), (later_x - final) * math.copysign(1, d))
        if beyond_m < MARGIN_M:
            return False
    return True


class Continuation:
    """Whether a flight goes on along its plan after an end of it, by the positions that follow.

    Two hypotheses compete: the aircraft follows the plan, or flies anywhere. Positions count for the first only from
    the next leg on, since a loiter at the end may lie on the leg that ends.

    Parameters
    ----------
    executor : PlanExecutor
        The flight that goes on.
    """

    def __init__(self, executor: PlanExecutor) -> None:
        self._stages_started = executor.stages_started
        self._log_odds = 0.0

    def update(self, executor: PlanExecutor, to: Sample, step_s: float) -> bool | None:
        """Weigh a position, `step_s` [s] after the last one; return whether the flight goes on, None while unknown."""
        if executor.complete:
            return False
        if to.position_m is not None:
            # log odds of the plan against anywhere, by this position
            log_odds = (ELSEWHERE - min(path_mismatch(executor, to), 2 * MAX_STDS**2)) / 2
            if log_odds < 0 or executor.stages_started > self._stages_started:
                self._log_odds += log_odds * min(1.0, step_s / INDEPENDENT_S)
        return None if abs(self._log_odds) < ALIKE else self._log_odds > 0
