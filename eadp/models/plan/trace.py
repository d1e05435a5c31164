"""The nominal flight: every stage followed exactly, as legs and as points, lap by lap to the end of the plan."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from eadp.core.expressions.derivatives import PathFunction
from eadp.core.geometry.curves import (
    CIRCLE,
    LINE,
    Point,
    circle_of,
    curve_length_m,
    line_of,
    points_along,
    project,
    tangent,
)
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import LAP_LIMIT, PlanCursor
from eadp.models.plan.executor import beyond, reaches, shift_at
from eadp.models.plan.plan import Plan, Stage, point_at

POINTS_LIMIT = 5_000_000
END_STEP_M = 1.0
LEAST_BEYOND_M = 1e-9
MOST_PLACES = 5000


@dataclass(frozen=True, slots=True)
class Leg:
    """One stage of the nominal flight: from where it is joined to its trigger.

    `flown_m` is less than `length_m` for the leg on which the plan ends.
    """

    lap: int
    stage: Stage
    path: PathFunction
    offset_m: Point
    start_m: Point
    end_m: Point
    length_m: float
    flown_m: float = math.inf

    @property
    def distance_m(self) -> float:
        """How far the leg is flown [m]."""
        return min(self.length_m, self.flown_m)


def nominal_legs(plan: Plan, parameters: Sequence[float], start: Point | None = None) -> list[Leg]:
    """The stages as flown exactly, at fixed parameters, lap by lap to the end of the plan.

    Parameters
    ----------
    plan : Plan
    parameters : sequence of float
    start : (float, float), optional
        Where the flight begins [m]; `default_start` without.

    Raises
    ------
    PathUndefined
        If a path or trigger has no value, or the plan never reaches its final point.
    """
    legs: list[Leg] = []
    begin = start or default_start(plan, parameters)[0]
    if plan.parts:
        return _legs_of_parts(plan, parameters, begin)
    shift = shift_at(plan, parameters)
    final = point_at(plan.final_point, parameters, "the final point")
    bound = [(stage, stage.path_at(parameters), stage.trigger_at(parameters)) for stage in plan.stages]
    lengths: dict[int, float] = {}
    for lap in range(LAP_LIMIT):
        offset = (lap * shift[0], lap * shift[1])
        last = (bound[-1][2][0] + offset[0], bound[-1][2][1] + offset[1])
        ends = plan.repeats and reaches(last, final, shift, plan.trigger_radius_m)
        for stage, path, trigger in bound:
            end = (trigger[0] + offset[0], trigger[1] + offset[1])
            local = (begin[0] - offset[0], begin[1] - offset[1])
            if lap <= 1:  # from then on the same stage, one shift further
                lengths[stage.index] = leg_length_m(stage, path, local, trigger)
            leg = Leg(lap, stage, path, offset, begin, end, lengths[stage.index])
            if ends and not plan.ends_at_trigger:
                over_m = first_beyond_m(leg, final, shift, plan.trigger_radius_m)
                if over_m is not None:
                    return [*legs, replace(leg, flown_m=over_m)]
            legs.append(leg)
            begin = end
        if not plan.repeats or (ends and plan.ends_at_trigger):
            return legs
    raise PathUndefined(f"the plan does not reach its final point within {LAP_LIMIT} laps")


def _legs_of_parts(plan: Plan, parameters: Sequence[float], begin: Point) -> list[Leg]:
    """The legs of a plan of parts."""
    legs = []
    walk = PlanCursor(plan, parameters)
    while not walk.done:
        place = walk.place
        path, end = place.path(), place.trigger_m()
        length_m = leg_length_m(place.stage, path, begin, end)
        legs.append(Leg(place.lap, place.stage, path, (0.0, 0.0), begin, end, length_m))
        begin = end
        walk.next()
    return legs


def first_beyond_m(leg: Leg, final: Point, shift: Point, radius_m: float, slack_m: float = 0.0) -> float | None:
    """How far along a leg the plan is over [m], to a millimetre; None where it is not. See `itinerary.beyond`.

    `slack_m` before the final point counts as beyond it [m]; below 0, it has to be passed by as much.
    """
    if not math.isfinite(leg.length_m):
        return None
    dx, dy = shift
    final = (
        final[0] - (slack_m * math.copysign(1.0, dx) if abs(dx) >= 1e-9 else 0.0),
        final[1] - (slack_m * math.copysign(1.0, dy) if abs(dy) >= 1e-9 else 0.0),
    )
    if leg.stage.kind == LINE:
        return _line_beyond_m(leg, final, shift, radius_m)
    is_over = beyond(final, shift, radius_m)
    count = max(1, math.ceil(leg.length_m / END_STEP_M))
    if leg.stage.kind == CIRCLE:
        if not _circle_reaches(leg, final, shift, radius_m):
            return None
        at = _on_circle(leg)
        count = max(count, math.ceil(leg.length_m / max(radius_m / 4, leg.length_m / MOST_PLACES)))
        found = next((i for i in range(count + 1) if is_over(*at(leg.length_m * i / count))), None)
    else:
        points = [(point.x_m, point.y_m) for point in leg_points(leg, END_STEP_M)]
        count = len(points) - 1

        def at(along_m: float) -> Point:
            i, share = divmod(along_m / leg.length_m * count, 1.0)
            (ax, ay), (bx, by) = points[int(i)], points[min(int(i) + 1, count)]
            return ax + share * (bx - ax), ay + share * (by - ay)

        found = next((i for i, point in enumerate(points) if is_over(*point)), None)
    if not found:
        return None if found is None else 0.0
    low, high = leg.length_m * (found - 1) / count, leg.length_m * found / count
    while high - low > 1e-3:
        middle = (low + high) / 2
        low, high = (low, middle) if is_over(*at(middle)) else (middle, high)
    return high


def _circle_reaches(leg: Leg, final: Point, shift: Point, radius_m: float) -> bool:
    """Whether the whole circle of a leg has any point that could be beyond: by the square round it."""
    circle = circle_of(leg.path, (leg.end_m[0] - leg.offset_m[0], leg.end_m[1] - leg.offset_m[1]), leg.stage.sense)
    for centre, offset, to, d in zip(circle.centre_m, leg.offset_m, final, shift, strict=True):
        place, r = centre + offset, circle.radius_m
        if abs(d) < 1e-9:
            if abs(place - to) > radius_m + r:
                return False
        elif (place - to) * math.copysign(1.0, d) + r <= 0:
            return False
    return True


def _on_circle(leg: Leg) -> Callable[[float], Point]:
    """The point of a circular leg some way along it [m]."""
    ox, oy = leg.offset_m
    circle = circle_of(leg.path, (leg.end_m[0] - ox, leg.end_m[1] - oy), leg.stage.sense)
    (cx, cy), radius = circle.centre_m, circle.radius_m
    first = circle.angle_rad((leg.start_m[0] - ox, leg.start_m[1] - oy))

    def at(along_m: float) -> Point:
        angle = first + circle.turn * along_m / radius
        return ox + cx + radius * math.cos(angle), oy + cy + radius * math.sin(angle)

    return at


def _line_beyond_m(leg: Leg, final: Point, shift: Point, radius_m: float) -> float | None:
    """The same on a line: on each axis, a first and a last place from which and to which it is over."""
    first, last = 0.0, leg.length_m
    for start, end, to, d in zip(leg.start_m, leg.end_m, final, shift, strict=True):
        rate = (end - start) / leg.length_m if leg.length_m > 0 else 0.0
        if abs(d) < 1e-9:
            lows = [(to - radius_m, 1.0), (-to - radius_m, -1.0)]  # |v − to| ≤ radius
        else:
            sign = math.copysign(1.0, d)
            lows = [(sign * to + LEAST_BEYOND_M, sign)]  # strictly beyond
        for least, sign in lows:
            value, slope = sign * start, sign * rate
            if abs(slope) < 1e-12:
                if value < least:
                    return None
            elif slope > 0:
                first = max(first, (least - value) / slope)
            else:
                last = min(last, (least - value) / slope)
    return first if first <= last else None


def leg_length_m(stage: Stage, path: PathFunction, join: Point, trigger: Point) -> float:
    """Length of a stage's path from where it is joined to its trigger [m]."""
    if stage.kind == LINE:
        return abs(line_of(path, trigger, stage.sense).progress_m(join))
    if stage.kind == CIRCLE:
        circle = circle_of(path, trigger, stage.sense)
        return circle.radius_m * circle.sweep_rad(join, trigger)
    return curve_length_m(path, project(path, join), trigger, stage.sense)


def default_start(plan: Plan, parameters: Sequence[float]) -> tuple[Point, float]:
    """Position [m] and heading [rad] to begin from: on the first path, 100 m (circle: a quarter) before its trigger.

    Raises
    ------
    PathUndefined
        If the first path has no point or no direction there.
    """
    stage = plan.stages[0]
    path, trigger = stage.path_at(parameters), stage.trigger_at(parameters)
    if stage.kind == LINE:
        line = line_of(path, trigger, stage.sense)
        point = (line.point_m[0] - 100 * line.direction[0], line.point_m[1] - 100 * line.direction[1])
    elif stage.kind == CIRCLE:
        circle = circle_of(path, trigger, stage.sense)
        point = circle.point_at(circle.angle_rad(trigger) - circle.turn * math.pi / 2)
    else:
        point = next(itertools.islice(points_along(path, trigger, -stage.sense, 1.0), 100, None))
    direction = tangent(path, point, stage.sense)
    return point, math.atan2(direction[1], direction[0])


class TracePoint(NamedTuple):
    """A point of the nominal path [m] with its direction of travel [rad]."""

    stage: int
    kind: str
    x_m: float
    y_m: float
    heading_rad: float


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
    for leg in legs:
        if not math.isfinite(leg.length_m):
            raise PathUndefined(f"the path of stage {leg.stage.index} does not lead to its trigger")
    if sum(leg.distance_m / step_m + 2 for leg in legs) > POINTS_LIMIT:
        raise PathUndefined(f"a trace of more than {POINTS_LIMIT} points")
    return [point for leg in legs for point in leg_points(leg, step_m)]


def leg_points(leg: Leg, step_m: float) -> Iterator[TracePoint]:
    """The points of one stage, to where the plan ends on it; see `trace`."""
    stage, (ox, oy) = leg.stage, leg.offset_m
    start = (leg.start_m[0] - ox, leg.start_m[1] - oy)
    end = (leg.end_m[0] - ox, leg.end_m[1] - oy)
    count = max(1, math.ceil(leg.distance_m / step_m - 1e-9))
    for (x, y), heading in _local_points(leg, start, end, count):
        yield TracePoint(stage.index, stage.kind, x + ox, y + oy, heading)


def _local_points(leg: Leg, start: Point, end: Point, count: int) -> Iterator[tuple[Point, float]]:
    stage, path = leg.stage, leg.path
    share = leg.distance_m / leg.length_m if leg.length_m else 1.0
    if stage.kind == LINE:
        line = line_of(path, start, stage.sense)
        (x, y), (dx, dy) = line.point_m, line.direction
        length = line.progress_m(end) * share
        heading = math.atan2(dy, dx)
        for i in range(count + 1):
            along = length * i / count
            yield (x + along * dx, y + along * dy), heading
    elif stage.kind == CIRCLE:
        circle = circle_of(path, end, stage.sense)
        first = circle.angle_rad(start)
        sweep = leg.distance_m / circle.radius_m
        for i in range(count + 1):
            angle = first + circle.turn * sweep * i / count
            yield circle.point_at(angle), math.remainder(angle + circle.turn * math.pi / 2, 2 * math.pi)
    else:
        points = points_along(path, start, stage.sense, leg.distance_m / count or 1.0)
        for _ in range(count):
            point = next(points)
            yield point, _heading(leg, point)
        last = project(path, end) if leg.distance_m == leg.length_m else next(points)
        yield last, _heading(leg, last)


def _heading(leg: Leg, point: Point) -> float:
    x, y = tangent(leg.path, point, leg.stage.sense)
    return math.atan2(y, x)
