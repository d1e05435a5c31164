"""The positions in a plan along a flight, found again from what was logged of it."""

from __future__ import annotations

from collections.abc import Iterable

from eadp.core.geometry.curves import Point
from eadp.errors import EadpError
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.legs import Leg
from eadp.models.plan.route import RoutePredictor

Row = tuple[float, int, float, float, Vector]
"""Time [s], stage from 1, position [m], and the parameters in force."""


class PlanReplay:
    """The positions in the plan along a flight, of the stages and parameters in its log.

    Parameters
    ----------
    cursor : PlanCursor
        At take-off.
    joined_m : (float, float)
        Where the first stage is joined [m].
    rows : iterable of `Row`

    Attributes
    ----------
    laps : list of int
        The lap at each row.
    turns : list of (float, PlanCursor, (float, float))
        When the path parameters in force change: the time, the position in the plan, and where its stage was joined.
    """

    def __init__(self, cursor: PlanCursor, joined_m: Point, rows: Iterable[Row]) -> None:
        rho = cursor.table.plan.path_count
        self.laps: list[int] = []
        self.turns = [(0.0, cursor, joined_m)]
        for time_s, stage, x, y, parameters in rows:
            if stage != cursor.stage.index:
                cursor, joined_m = _next(cursor, stage), (x, y)
            if parameters != cursor.parameters:
                turned = parameters[:rho] != cursor.parameters[:rho]
                cursor = cursor.decide(parameters).in_force(parameters)
                if turned:
                    self.turns.append((time_s, cursor, joined_m))
            self.laps.append(cursor.lap)

    def before(self, time_s: float) -> tuple[Leg, ...]:
        """The legs that would have been flown without the first change of path from a time on; () without one."""
        index = next((i for i, turn in enumerate(self.turns) if i and turn[0] >= time_s), None)
        return () if index is None else legs_from(*self.turns[index - 1][1:])


def legs_from(cursor: PlanCursor, joined_m: Point) -> tuple[Leg, ...]:
    """The legs from a position in the plan to its end; () where they cannot be flown."""
    try:
        return RoutePredictor().route(cursor, joined_m).legs
    except EadpError:
        return ()


def _next(cursor: PlanCursor, stage: int) -> PlanCursor:
    """The next position at a stage; the same position where the plan has none."""
    found: PlanCursor | None = cursor
    for _ in cursor.table.plan.stages:
        try:
            found = found and found.next()
        except EadpError:
            break
        if found is not None and found.stage.index == stage:
            return found
    return cursor
