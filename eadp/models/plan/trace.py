"""The nominal flight as points: every stage followed exactly, at fixed parameters, to the end of the plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

from eadp.core.geometry.curves import Point, tangent
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import PlanCursor, Rules, Vector
from eadp.models.plan.legs import Leg, TracePoint, leg_points
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import Route, RoutePredictor

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
    values, laps = tuple(values), []
    for before, legs in _laps(plan, parameters):
        following: PlanCursor | None = PlanCursor.start(plan, values)
        start = default_start(plan, values)[0]
        if before is not None:
            varied = before.decide(values).in_force(values)
            following, start = varied.next(), varied.trigger_m()
        lap: list[Leg] = []
        while following is not None and len(lap) < legs:
            lap.append(_leg(following, start))
            following, start = following.next(), lap[-1].end_m
        laps.append(tuple(lap))
    return tuple(laps)


def _laps(plan: Plan, parameters: Sequence[float]) -> list[tuple[PlanCursor | None, int]]:
    """For each lap of the nominal flight, the stage before it, None before the first, and its number of legs."""
    laps: list[tuple[PlanCursor | None, int]] = []
    before: PlanCursor | None = None
    following: PlanCursor | None = PlanCursor.start(plan, parameters)
    for _ in nominal_legs(plan, parameters):
        assert following is not None
        if before is None or (following.segment, following.lap) != (before.segment, before.lap):
            laps.append((before, 0))
        laps[-1] = laps[-1][0], laps[-1][1] + 1
        before, following = following, following.next()
    return laps


def _leg(cursor: PlanCursor, start: Point) -> Leg:
    """The whole of a stage from where it is joined."""
    (ox, oy), goal = cursor.offset_m, cursor.trigger_m()
    track = cursor.stage.track(cursor.path(), cursor.local_trigger_m())
    length_m = abs(track.ahead_m((start[0] - ox, start[1] - oy)))
    if not math.isfinite(length_m):
        raise PathUndefined(f"the path of stage {cursor.stage.index} does not lead to its trigger")
    return Leg(cursor.lap, cursor.stage, track, cursor.offset_m, start, goal, length_m)


def default_start(plan: Plan, parameters: Sequence[float]) -> tuple[Point, float]:
    """Position [m] and heading [rad] to start from: the plan's own, or on the first path 100 m before its trigger.

    On a circle it is a quarter of it before its trigger.

    Raises
    ------
    PathUndefined
        If the first path has no point or no direction there.
    """
    return _default_start(plan, tuple(parameters))


@lru_cache(KEPT_ROUTES)
def _default_start(plan: Plan, parameters: Vector) -> tuple[Point, float]:
    """`default_start`, kept for the next flight."""
    stage = plan.stages[0]
    path, trigger = stage.path_at(parameters), stage.trigger_at(parameters)
    point = plan.site.start_m or stage.track(path, trigger).approach()
    direction = tangent(path, point, stage.sense)
    return point, math.atan2(direction[1], direction[0])


def trace(plan: Plan, parameters: Sequence[float], step_m: float, start: Point | None = None) -> list[TracePoint]:
    """Points at most `step_m` [m] apart along the nominal path at fixed parameters.

    The first and the last point of every stage are there exactly; both are points of the stage's own path, so that a
    trigger off its path leaves a gap to the next stage.

    Raises
    ------
    PathUndefined
        If a path or trigger has no value, a trigger is not met, or there are more than 5,000,000 points.
    """
    legs = nominal_legs(plan, parameters, start)
    if sum(leg.distance_m / step_m + 2 for leg in legs) > MAX_POINTS:
        raise PathUndefined(f"a trace of more than {MAX_POINTS} points")
    return [point for leg in legs for point in leg_points(leg, step_m)]
