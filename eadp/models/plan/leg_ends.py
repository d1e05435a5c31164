"""Where a plan ends on a leg. Numbers alone, for compiled code too (`eadp.core.compiled`)."""

from __future__ import annotations

import math

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.compiled import jitted
from eadp.core.geometry.curves import LINE, Point
from eadp.core.geometry.tracks import CircleTrack
from eadp.models.plan.legs import Leg, leg_points
from eadp.models.plan.triggers import is_beyond, signs

STEP_M = 1.0
"""Distance between the points of a curve [m]."""

MIN_BEYOND_M, MIN_RATE = 1e-9, 1e-12
AFTER_M = 1e-6
"""Distance after a crossing at which it is beyond [m]."""

CLEARANCE_STEP_M = 0.05
"""Accuracy of an uncertain end's clearance [m]."""

ON_LINE, ON_CIRCLE, ON_CURVE = 0.0, 1.0, 2.0

LegNumbers = tuple[float, float, float, float, float, float, float]
"""Kind and length [m]; of a line, its start and end [m]; of a circle, its centre and radius [m], turn, and the angle at
its start [rad]."""

NO_POINTS = np.zeros(0)


def end_on(
    leg: Leg, final: Point, shift: Point, radius_m: float, margin_m: float, reach_m: float
) -> tuple[float, float]:
    """Where the plan ends on a leg, and by how much the leg passes that end.

    Parameters
    ----------
    leg : Leg
    final, shift : (float, float)
        Final point and shift [m].
    radius_m : float
        Radius across the shift [m].
    margin_m : float
        By how much the end has to be passed to be certain [m]; at 0 or below every end is, and the plan ends as much
        before.
    reach_m : float
        Distance along the leg within which an uncertain end counts [m].

    Returns
    -------
    flown_m : float
        Distance flown along the leg [m]; infinite where the plan does not end on it.
    clearance_m : float
        Infinite for an end that is certain; else within ±`margin_m` [m], from below; −inf without an end.
    """
    compiled = jitted(_end_on, makes_arrays=False)
    return compiled(*leg_numbers(leg), final, shift, radius_m, margin_m, reach_m)


def leg_numbers(leg: Leg) -> tuple[LegNumbers, FloatArray, FloatArray]:
    """A leg in numbers, and the points of a curve [m]."""
    (ox, oy), (x, y), length_m = leg.offset_m, leg.start_m, leg.length_m
    if leg.stage.kind == LINE:
        return (ON_LINE, length_m, x, y, *leg.end_m, 0.0), NO_POINTS, NO_POINTS
    if isinstance(leg.track, CircleTrack):
        circle = leg.track.circle
        (cx, cy), first = circle.centre_m, circle.angle_rad((x - ox, y - oy))
        return (ON_CIRCLE, length_m, ox + cx, oy + cy, circle.radius_m, float(circle.turn), first), NO_POINTS, NO_POINTS
    points = leg_points(leg, STEP_M) if math.isfinite(length_m) else ()
    xs, ys = np.array([(point.x_m, point.y_m) for point in points]).reshape(-1, 2).T.copy()
    return (ON_CURVE, length_m, 0.0, 0.0, 0.0, 0.0, 0.0), xs, ys


def _end_on(
    leg: LegNumbers,
    xs: FloatArray,
    ys: FloatArray,
    final: Point,
    shift: Point,
    radius_m: float,
    margin_m: float,
    reach_m: float,
) -> tuple[float, float]:
    flown_m = beyond_m(leg, xs, ys, final, shift, radius_m, -margin_m)
    if flown_m < math.inf:
        return beyond_m(leg, xs, ys, final, shift, radius_m, 0.0) if margin_m > 0.0 else flown_m, math.inf
    low, high = -margin_m, margin_m
    if margin_m <= 0.0 or not beyond_m(leg, xs, ys, final, shift, radius_m, margin_m) <= reach_m:
        return math.inf, -math.inf
    while high - low > CLEARANCE_STEP_M:
        middle = (low + high) / 2
        if beyond_m(leg, xs, ys, final, shift, radius_m, -middle) <= reach_m:
            low = middle
        else:
            high = middle
    return beyond_m(leg, xs, ys, final, shift, radius_m, max(0.0, -low)), low


def beyond_m(
    leg: LegNumbers, xs: FloatArray, ys: FloatArray, final: Point, shift: Point, radius_m: float, slack_m: float
) -> float:
    """How far along a leg the plan is over [m], to a millimetre; infinite where it is not. See `triggers.is_beyond`.

    `slack_m` before the final point counts as beyond it [m]; below 0, it has to be passed by as much.
    """
    kind, length_m = leg[0], leg[1]
    if not length_m < math.inf:
        return math.inf
    sx, sy = signs(shift)
    # a line along the bound is not beyond it by rounding
    min_beyond_m = MIN_BEYOND_M if kind == ON_LINE else 0.0
    fx, fy = final[0] - slack_m * sx + min_beyond_m * sx, final[1] - slack_m * sy + min_beyond_m * sy
    if kind == ON_CURVE:
        return _on_curve(xs, ys, length_m, fx, fy, sx, sy, radius_m)
    # at its start, or just after it has crossed a bound of either axis
    first = 0.0 if _is_over_after(0.0, leg, fx, fy, sx, sy, radius_m) else math.inf
    for axis in range(2):
        to, half = (fx, radius_m if sx == 0.0 else 0.0) if axis == 0 else (fy, radius_m if sy == 0.0 else 0.0)
        for bound in (to - half, to + half):
            for along_m in _crossings_m(leg, axis, bound):
                if 0.0 <= along_m < first and _is_over_after(along_m, leg, fx, fy, sx, sy, radius_m):
                    first = along_m
    return first


def _crossings_m(leg: LegNumbers, axis: int, bound: float) -> tuple[float, float]:
    """The two distances along a line or a circle at which x or y, axis 0 or 1, has a value; infinite without."""
    if leg[0] == ON_LINE:
        _, length_m, ax, ay, bx, by, _ = leg
        start, end = (ax, bx) if axis == 0 else (ay, by)
        rate = (end - start) / length_m if length_m > 0.0 else 0.0
        along_m = (bound - start) / rate if abs(rate) > MIN_RATE else math.inf
        return along_m, along_m
    _, _, cx, cy, r, turn, start_rad = leg
    centre, quarter = (cx, 0.0) if axis == 0 else (cy, math.pi / 2)
    if abs(bound - centre) > r:
        return math.inf, math.inf
    # on the axis at `quarter`, a bound is crossed at ± the arc cosine
    half = math.acos((bound - centre) / r)
    one, two = (quarter + half - start_rad) * turn, (quarter - half - start_rad) * turn
    return one % (2 * math.pi) * r, two % (2 * math.pi) * r


def _is_over_after(
    along_m: float, leg: LegNumbers, fx: float, fy: float, sx: float, sy: float, radius_m: float
) -> bool:
    """Whether the plan is over just after a distance along a line or a circle [m]."""
    kind, length_m = leg[0], leg[1]
    after_m = min(along_m + AFTER_M, length_m)
    if kind == ON_LINE:
        _, _, ax, ay, bx, by, _ = leg
        share = after_m / length_m if length_m > 0.0 else 0.0
        x, y = ax + share * (bx - ax), ay + share * (by - ay)
    else:
        _, _, cx, cy, r, turn, start_rad = leg
        angle = start_rad + turn * after_m / r
        x, y = cx + r * math.cos(angle), cy + r * math.sin(angle)
    return along_m <= length_m and is_beyond(x - fx, y - fy, sx, sy, radius_m)


def _on_curve(
    xs: FloatArray, ys: FloatArray, length_m: float, fx: float, fy: float, sx: float, sy: float, radius_m: float
) -> float:
    """Between the first of its points that is beyond and the one before it."""
    count, found = len(xs) - 1, 0
    while found <= count and not is_beyond(xs[found] - fx, ys[found] - fy, sx, sy, radius_m):
        found += 1
    if found > count:
        return math.inf
    if found == 0:
        return 0.0
    low, high = length_m * (found - 1) / count, length_m * found / count
    while high - low > 1e-3:
        middle = (low + high) / 2
        at = middle / length_m * count
        i = int(at)
        share, after = at - i, min(i + 1, count)
        x, y = xs[i] + share * (xs[after] - xs[i]), ys[i] + share * (ys[after] - ys[i])
        if is_beyond(x - fx, y - fy, sx, sy, radius_m):
            high = middle
        else:
            low = middle
    return high
