"""The nominal flight as points, and flights as they were flown: their positions in the plan and over the ground."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

from eadp.core.geometry.curves import Point, tangent
from eadp.errors import EadpError, PathUndefined
from eadp.models.airspace import BOUNDARY, Airspace, entered
from eadp.models.plan.cursor import PlanCursor, Rules, Vector, cursors
from eadp.models.plan.plan import Finding, Plan
from eadp.models.plan.route import Route, RoutePredictor
from eadp.models.plan.stage import Leg, leg_points

MAX_POINTS = 5_000_000
KEPT_ROUTES = 16


@lru_cache(KEPT_ROUTES)
def whole_route(plan: Plan, parameters: Vector, rules: Rules, start: Point, margin_m: float = 0.0) -> Route:
    """`RoutePredictor.route` from the plan's start, kept for the next flight."""
    return RoutePredictor().route(PlanCursor.start(plan, parameters, rules), start, margin_m)


def nominal_legs(plan: Plan, parameters: Sequence[float], start: Point | None = None) -> tuple[Leg, ...]:
    """The legs of the flight at fixed parameters, to the end of the plan.

    Parameters
    ----------
    plan : Plan
    parameters : sequence of float
    start : (float, float), optional
        Where the flight starts [m]; `default_start` without.

    Raises
    ------
    PathUndefined
        If a path or trigger has no value, a trigger is not met, or the plan never reaches its final point.
    """
    return nominal_route(plan, parameters, start).legs


def zone_findings(legs: Iterable[Leg], airspace: Airspace, low_m: float = 0.0) -> list[Finding]:
    """Warnings of each obstacle that a nominal path enters first, and of the boundary; arguments as of `entered`."""
    found: dict[str, Finding] = {}
    for stage, name in entered(legs, airspace, low_m) if any(airspace) else ():
        does = "leads beyond" if name == BOUNDARY else "leads through"
        message = f"the path {does} {name}, first on the way to {stage.label}"
        found.setdefault(name, Finding("warning", stage.index, stage.line, "zone", message))
    return list(found.values())


def nominal_route(plan: Plan, parameters: Sequence[float], start: Point | None = None) -> Route:
    """The route of the flight at fixed parameters, see `nominal_legs`."""
    values = tuple(parameters)
    if plan.has_sets:  # computations that are left out do not change the path
        values += tuple(plan.hull(i).hi for i in range(len(values), len(plan.parameters)))
    start = start or default_start(plan, values)[0]
    return whole_route(plan, values, Rules(), (start[0], start[1]))


def varied_legs(plan: Plan, parameters: Sequence[float], values: Sequence[float]) -> tuple[tuple[Leg, ...], ...]:
    """The legs of each lap of the flight at fixed parameters, that lap alone at other values.

    Parameters
    ----------
    plan : Plan
    parameters : sequence of float
        All parameters, in force up to the lap.
    values : sequence of float
        All parameters, in force on the lap.

    Raises
    ------
    PathUndefined
        As `nominal_legs`.

    Source: letter, Fig. 2 (the grey area).
    """
    values, predictor, laps = tuple(values), RoutePredictor(), list[list[Leg]]()
    before: PlanCursor | None = None
    following: PlanCursor | None = None
    for cursor, _ in zip(cursors(PlanCursor.start(plan, parameters)), nominal_legs(plan, parameters), strict=False):
        if before is None or (cursor.segment, cursor.lap) != (before.segment, before.lap):
            laps.append([])
            following, start = PlanCursor.start(plan, values), default_start(plan, values)[0]
            if before is not None:
                varied = before.decide(values).in_force(values)
                following, start = varied.next(), varied.trigger_m()
        if following is not None:
            laps[-1].append(predictor.leg(following, start).legs[0])
            following, start = following.next(), laps[-1][-1].end_m
        before = cursor
    return tuple(map(tuple, laps))


def default_start(plan: Plan, parameters: Sequence[float]) -> tuple[Point, float]:
    """Position [m] and heading [rad] to start from: the plan's own, or on the first path 100 m before its trigger.

    On a circle it is a quarter of it before its trigger.

    Raises
    ------
    PathUndefined
        If the first path has no point or no direction there.
    """
    stage = plan.stages[0]
    path, trigger = stage.path_at(parameters), stage.trigger_at(parameters)
    point = plan.site.start_m or stage.track(path, trigger).approach()
    direction = tangent(path, point, stage.sense)
    return point, math.atan2(direction[1], direction[0])


class TracePoint(NamedTuple):
    """A point of the nominal path [m] with its direction of travel [rad]."""

    stage: int
    kind: str
    x_m: float
    y_m: float
    heading_rad: float


def trace(plan: Plan, parameters: Sequence[float], step_m: float) -> list[TracePoint]:
    """Points at most `step_m` [m] apart along the nominal path at fixed parameters.

    The first and the last point of every stage are there exactly; both are points of the stage's own path, so that a
    trigger off its path leaves a gap to the next stage.

    Raises
    ------
    PathUndefined
        If a path or trigger has no value, a trigger is not met, or there are more than 5,000,000 points.
    """
    legs = nominal_legs(plan, parameters)
    if sum(leg.distance_m / step_m + 2 for leg in legs) > MAX_POINTS:
        raise PathUndefined(f"a trace of more than {MAX_POINTS} points")
    return [
        TracePoint(leg.stage.index, leg.stage.kind, *row) for leg in legs for row in leg_points(leg, step_m).tolist()
    ]


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


class PictureTrack(NamedTuple):
    """Where a recorded flight was, and where it took pictures.

    Attributes
    ----------
    rows : sequence of (float, float, float)
        Times [s] and positions x, y [m].
    camera_on : sequence of bool
        Whether the camera was on at each; on throughout where the recording does not say.
    pictures : sequence of int
        Rows at which pictures were taken; empty where the recording has none.
    """

    rows: Sequence[tuple[float, float, float]]
    camera_on: Sequence[bool]
    pictures: Sequence[int] = ()
