"""One leg: a stage as it is flown exactly along its path, from where it is joined to its trigger."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from eadp.core.expressions.derivatives import PathFunction
from eadp.core.geometry.curves import LINE, Circle, Point
from eadp.core.geometry.tracks import CircleTrack, Track
from eadp.models.plan.stage import Stage
from eadp.models.plan.triggers import beyond

END_STEP_M = 1.0
MIN_BEYOND_M = 1e-9
AFTER_M = 1e-6
"""Distance after a crossing at which it is beyond [m]."""


class Leg(NamedTuple):
    """One stage of a route: from where it is joined to its trigger.

    `track` is its path as travelled to its trigger, in the frame of lap 0. `flown_m` is less than `length_m` for the
    leg on which the plan ends.
    """

    lap: int
    stage: Stage
    track: Track
    offset_m: Point
    start_m: Point
    end_m: Point
    length_m: float
    flown_m: float = math.inf

    @property
    def path(self) -> PathFunction:
        """Its path function, in the frame of lap 0."""
        return self.track.path

    @property
    def distance_m(self) -> float:
        """The distance flown along the leg [m]."""
        return min(self.length_m, self.flown_m)


class TracePoint(NamedTuple):
    """A point of the nominal path [m] with its direction of travel [rad]."""

    stage: int
    kind: str
    x_m: float
    y_m: float
    heading_rad: float


def first_beyond_m(leg: Leg, final: Point, shift: Point, radius_m: float, slack_m: float = 0.0) -> float | None:
    """How far along a leg the plan is over [m], to a millimetre; None where it is not. See `triggers.beyond`.

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
    if isinstance(leg.track, CircleTrack):
        return _circle_beyond_m(leg, leg.track.circle, final, shift, radius_m)
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


def _circle_beyond_m(leg: Leg, circle: Circle, final: Point, shift: Point, radius_m: float) -> float | None:
    """`first_beyond_m` on a circle: at its start, or just after it has crossed a bound of either axis."""
    (ox, oy), (cx, cy), r = leg.offset_m, circle.centre_m, circle.radius_m
    first = circle.angle_rad((leg.start_m[0] - ox, leg.start_m[1] - oy))
    crossings = [0.0]
    axes = [(ox + cx, final[0], shift[0], 0.0), (oy + cy, final[1], shift[1], math.pi / 2)]
    for centre, to, d, _ in axes:
        if abs(to - centre) > r + (radius_m if abs(d) < 1e-9 else 0.0) and (abs(d) < 1e-9 or (centre - to) * d < 0):
            return None  # no point of the circle is beyond, or across it within the radius
    for centre, to, d, quarter in axes:
        for bound in (to,) if abs(d) >= 1e-9 else (to - radius_m, to + radius_m):
            if abs(bound - centre) <= r:
                # on the axis at `quarter`, a bound is crossed at ± the arc cosine
                half = math.acos((bound - centre) / r)
                for angle in (quarter + half, quarter - half):
                    turned = (angle - first) * circle.turn % (2 * math.pi)
                    crossings += [turned * r, (turned - 2 * math.pi) * r]
    is_over = beyond(final, shift, radius_m)
    for along_m in sorted(crossings):
        after_m = min(along_m + AFTER_M, leg.length_m)
        if -AFTER_M <= along_m <= leg.length_m and after_m >= 0:
            angle = first + circle.turn * after_m / r
            if is_over(ox + cx + r * math.cos(angle), oy + cy + r * math.sin(angle)):
                return max(along_m, 0.0)
    return None


def _line_beyond_m(leg: Leg, final: Point, shift: Point, radius_m: float) -> float | None:
    """`first_beyond_m` on a line: on each axis, the plan is over from a first distance to a last one."""
    first, last = 0.0, leg.length_m
    for start, end, to, d in zip(leg.start_m, leg.end_m, final, shift, strict=True):
        rate = (end - start) / leg.length_m if leg.length_m > 0 else 0.0
        if abs(d) < 1e-9:
            lows = [(to - radius_m, 1.0), (-to - radius_m, -1.0)]  # |v − to| ≤ radius
        else:
            sign = math.copysign(1.0, d)
            lows = [(sign * to + MIN_BEYOND_M, sign)]  # strictly beyond
        for bound, sign in lows:
            value, slope = sign * start, sign * rate
            if abs(slope) < 1e-12:
                if value < bound:
                    return None
            elif slope > 0:
                first = max(first, (bound - value) / slope)
            else:
                last = min(last, (bound - value) / slope)
    return first if first <= last else None


def leg_points(leg: Leg, step_m: float) -> Iterator[TracePoint]:
    """The points of one stage, to where the plan ends on it; see `trace`."""
    stage, (ox, oy) = leg.stage, leg.offset_m
    start = (leg.start_m[0] - ox, leg.start_m[1] - oy)
    share = leg.distance_m / leg.length_m if leg.length_m else 1.0
    count = max(1, math.ceil(leg.distance_m / step_m - 1e-9))
    for (x, y), heading in leg.track.points(start, leg.distance_m, share, count):
        yield TracePoint(stage.index, stage.kind, x + ox, y + oy, heading)


def left_m(leg: Leg, position: Point, flown_m: float, early_m: float = 0.0) -> float:
    """The distance left of a leg at a position [m]; up to `early_m` more than the leg, where the last one ended early.

    Parameters
    ----------
    leg : Leg
    position : (float, float)
        Where the aircraft is [m].
    flown_m : float
        Distance flown on it so far, roughly [m]: it resolves turns round a circle, and is the measure on a curve.
    """
    local = (position[0] - leg.offset_m[0], position[1] - leg.offset_m[1])
    cut_m = leg.length_m - leg.distance_m
    left = leg.track.remaining_m(local, leg.distance_m - flown_m + cut_m) - cut_m
    return min(max(left, 0.0), leg.distance_m + early_m)
