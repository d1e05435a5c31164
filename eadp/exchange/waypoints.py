"""Waypoints and circles as a path that an aircraft can fly: straights between them, and arcs where it turns.

A target is a circle with a signed radius, above 0 counter-clockwise; a waypoint is one of radius 0. A turn at a
waypoint is a fillet of the turning radius within the corner. Where two corners in a row are alike it may be wider:
waypoints along an arc are flown as that arc. Where a fillet would pass the waypoint too far away, the aircraft flies
over it and then turns.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from eadp.core.geometry.curves import Point, wrap_angle_rad
from eadp.core.geometry.dubins import Piece, Pose, centre_m
from eadp.errors import Unreachable

MIN_PIECE_M = 0.01
"""A shorter piece is left out: what a coordinate of 1e-7° resolves."""
ON_CIRCLE_M = 0.5
"""A waypoint so near to the circle before or after it lies on that circle."""
TURNS_TOLERANCE = 0.05
"""A loiter that is so much of a turn short when the way on is ahead is complete."""
EASED_M = 1.0
"""Distance from a waypoint that a turn wider than the least may pass it at [m]: that of an exported arc's corners."""
ARC_RAD = 0.02
"""Corners that differ by less are alike, and smaller ones none: what the rounding of coordinates makes of an arc's."""
SHRINK, SHRINK_LIMIT = 0.8, 60
"""A turn after a waypoint is made smaller by this factor, at most so often, until a straight leads on from it."""


class Waypoint(NamedTuple):
    """A point to fly to.

    A turn may pass it `miss_m` away; with `past_m` the aircraft flies over it and so much farther before it turns, and
    with `begins_m` the turn begins so far before it [m].
    """

    centre_m: Point
    miss_m: float
    past_m: float = 0.0
    begins_m: float = 0.0

    @property
    def radius_m(self) -> float:
        """0, as of a circle that is a point [m]."""
        return 0.0


class Loiter(NamedTuple):
    """A circle to fly `turns` times round, then on to where the next target lies ahead; radius above 0 is leftwards."""

    centre_m: Point
    radius_m: float
    turns: float


Target = Waypoint | Loiter


class TightTurn(NamedTuple):
    """Turns that need more room than there is: `needed_m` where the way to a target has `distance_m`."""

    target: int
    distance_m: float
    needed_m: float


class WaypointPath(NamedTuple):
    """The pieces of a path, each with the index of the target that it is flown to, and the turns that are too tight."""

    pieces: list[tuple[int, Piece]]
    tight: list[TightTurn]


@dataclass(slots=True)
class _Leg:
    """The way to a target, and the turn at its end: round a circle, or a fillet of `corner_rad`, or none.

    The way is straight, or with `round` an arc of that circle; `way` is the target that it was to: the first of those
    in the circle, or the same. `trim_m` is what fillets take off at the start and end; one that is wider than it must
    be begins `begins_m` before, or passes the corner within `eased_m`. The way goes `past_m` beyond the waypoint.
    """

    target: int
    start: Point
    end: Point
    course_rad: float
    round: Loiter | None = None
    circle: Loiter | None = None
    corner_rad: float = 0.0
    eased_m: float = 0.0
    begins_m: float = 0.0
    past_m: float = 0.0
    trim_m: tuple[float, float] = (0.0, 0.0)
    way: int = 0

    @property
    def length_m(self) -> float:
        return math.dist(self.start, self.end)

    @property
    def fillet_start(self) -> Pose:
        """Where the fillet at its end begins; its end without one."""
        return (*_ahead(self.end, self.course_rad, -self.trim_m[1]), self.course_rad)

    @property
    def room_m(self) -> float:
        """Its length up to the waypoint [m]: a fillet that took more would pass it by."""
        return max(0.0, self.length_m - self.past_m)


def path_through(start: Point, targets: Sequence[Target], radius_m: float) -> WaypointPath:
    """The path from a point along targets in order.

    Parameters
    ----------
    start : (float, float)
        Where it starts [m].
    targets : sequence of Waypoint or Loiter
        One or more. A waypoint that lies in the circle after it, or on the circle before it, is passed on that circle.
    radius_m : float
        Radius of the turns [m]. It is reduced where there is no room for it, which `tight` lists.

    Returns
    -------
    WaypointPath

    Raises
    ------
    Unreachable
        If no straight leads from one circle to the next.
    """
    tight: list[TightTurn] = []
    legs: list[_Leg] = []
    leave: Target = Waypoint(start, math.inf)
    kept = _kept(start, targets)
    for k, (i, target, way) in enumerate(kept):
        following = kept[k + 1] if k + 1 < len(kept) else None
        again = isinstance(target, Loiter) and isinstance(leave, Loiter) and leave[:2] == target[:2]
        leg = _farther(legs[-1], i) if again else _leg(i, leave, target)
        leg.way = way
        if leg.round is not None and abs(leg.round.radius_m) < radius_m:
            tight.append(TightTurn(i, 2 * abs(leg.round.radius_m), 2 * radius_m))
        legs.append(leg)
        leave = target
        if isinstance(target, Loiter):
            leg.circle = target
        elif following is not None:
            leave = _choose_turn(leg, target, following, radius_m, tight)
    _set_trims(legs, radius_m, tight)
    return WaypointPath(_pieces(legs), tight)


def _kept(start: Point, targets: Sequence[Target]) -> list[tuple[int, Target, int]]:
    """The targets, with their indices and those of the first in their circles, to which the ways are flown.

    They are without waypoints that the circle beside them passes, or that stand twice.
    """
    kept: list[tuple[int, Target, int]] = [(-1, Waypoint(start, 0.0), -1)]
    for i, target in enumerate(targets):
        before, way = kept[-1][1], i
        apart_m = math.dist(before.centre_m, target.centre_m)
        if isinstance(target, Loiter):
            within_m = abs(target.radius_m) + ON_CIRCLE_M
            while len(kept) > 1 and isinstance(before, Waypoint) and apart_m <= within_m:
                way = kept.pop()[2]
                before = kept[-1][1]
                apart_m = math.dist(before.centre_m, target.centre_m)
            if isinstance(before, Loiter) and apart_m < ON_CIRCLE_M and before.radius_m == target.radius_m:
                target = target._replace(centre_m=before.centre_m)
        elif isinstance(before, Waypoint):
            if apart_m < MIN_PIECE_M and isinstance(target, Waypoint):
                nearest = min(before.miss_m, target.miss_m)
                before = Waypoint(before.centre_m, nearest, max(before.past_m, target.past_m))
                kept[-1] = (kept[-1][0], before, kept[-1][2])
                continue
        elif abs(apart_m - abs(before.radius_m)) < ON_CIRCLE_M and i < len(targets) - 1:
            continue
        kept.append((i, target, way))
    return kept[1:]


def _farther(leg: _Leg, index: int) -> _Leg:
    """No way, from where the turns of a leg's circle end, for more of them."""
    assert leg.circle is not None
    (cx, cy), radius, turns = leg.circle
    course = wrap_angle_rad(leg.course_rad + 2 * math.pi * math.copysign(turns, radius))
    x, y = cx + radius * math.sin(course), cy - radius * math.cos(course)
    return _Leg(index, (x, y), (x, y), course)


def _leg(index: int, leave: Target, target: Target) -> _Leg:
    """The way from one target to the next: a common tangent, or a half circle where one lies in the other."""
    straight = _tangent(leave, target)
    if straight is not None:
        return _Leg(index, *straight)
    inner, outer = sorted((leave, target), key=lambda each: abs(each.radius_m))
    q = math.dist(inner.centre_m, outer.centre_m)  # [m]
    if inner.radius_m != 0 or outer.radius_m == 0:
        raise Unreachable(index, "no straight leads from the circle before it onto this one")
    (x, y), radius, side = outer.centre_m, abs(outer.radius_m), math.copysign(1.0, outer.radius_m)
    ux, uy = ((inner.centre_m[0] - x) / q, (inner.centre_m[1] - y) / q) if q > 0 else (1.0, 0.0)
    # u: from the centre to the point, beyond which the half circle through the point touches the circle
    half = (radius - q) / 2
    touch = (x + radius * ux, y + radius * uy)
    arc = Loiter((x + (radius - half) * ux, y + (radius - half) * uy), side * half, 0.5)
    course = math.atan2(side * ux, -side * uy)
    if outer is target:
        return _Leg(index, inner.centre_m, touch, course, arc)
    return _Leg(index, touch, inner.centre_m, wrap_angle_rad(course + math.pi), arc)


class _Straight(NamedTuple):
    """Start [m], end [m] and course [rad]."""

    start: Point
    end: Point
    course_rad: float


def _tangent(leave: Target, target: Target) -> _Straight | None:
    """The straight from one circle to another, a common tangent; None where one lies in the other."""
    (ax, ay), (bx, by) = leave.centre_m, target.centre_m
    d, between = math.hypot(bx - ax, by - ay), target.radius_m - leave.radius_m
    if d == 0 or abs(between) > d + ON_CIRCLE_M:
        return None
    # with n to the left of the course, centre = point + radius n at both ends: (b − a)·n = radius_b − radius_a
    course = math.atan2(by - ay, bx - ax) - math.asin(min(max(between / d, -1.0), 1.0))
    nx, ny = -math.sin(course), math.cos(course)
    a, b = leave.radius_m, target.radius_m
    if abs(between) > d:  # where the circles all but touch there is no straight
        touch = (bx - b * nx, by - b * ny) if abs(b) > abs(a) else (ax - a * nx, ay - a * ny)
        return _Straight(touch, touch, wrap_angle_rad(course))
    return _Straight((ax - a * nx, ay - a * ny), (bx - b * nx, by - b * ny), wrap_angle_rad(course))


def _choose_turn(
    leg: _Leg, waypoint: Waypoint, after: tuple[int, Target, int], radius_m: float, tight: list[TightTurn]
) -> Target:
    """Set the turn at the end of a leg, and note one that is too tight; return what the next leg leaves.

    `after` is the target after the waypoint, as `_kept` has it. The turn is a fillet where that passes near enough, or
    else a circle from the waypoint on.
    """
    course, (number, following, _) = leg.course_rad, after
    if waypoint.past_m and leg.round is None:
        leg.end, leg.past_m = _ahead(leg.end, course, waypoint.past_m), waypoint.past_m
    here = Waypoint(leg.end, 0.0)
    onward = _tangent(here, following)
    if onward is None:
        why = "its circle encloses" if following.radius_m else "it is"
        raise Unreachable(number, f"{why} the point from which it is flown to")
    corner = wrap_angle_rad(onward.course_rad - course)
    if abs(corner) < 1e-9:
        return here
    # a fillet passes the corner r (1/cos(θ/2) − 1) away
    if leg.round is None and not waypoint.past_m:
        cosine = math.cos(corner / 2)
        if cosine > 1e-6 and radius_m * (1 / cosine - 1) <= waypoint.miss_m:
            leg.corner_rad, leg.eased_m = corner, min(EASED_M, waypoint.miss_m)
            # one that begins b before it passes the corner b tan(θ/4) away
            leg.begins_m = min(waypoint.begins_m, waypoint.miss_m / abs(math.tan(corner / 4)))
            return here
    side = math.copysign(1.0, corner)
    radius = radius_m
    for _ in range(SHRINK_LIMIT):
        centre = centre_m((*leg.end, course), side, radius)
        leg.circle = Loiter(centre, side * radius, 0.0)
        between_m = abs(following.radius_m - side * radius)
        if between_m < math.dist(centre, following.centre_m):
            break
        radius *= SHRINK
    if radius < radius_m:
        tight.append(TightTurn(number, math.dist(leg.end, following.centre_m), 2 * radius_m))
    return leg.circle or here


def _set_trims(legs: list[_Leg], radius_m: float, tight: list[TightTurn]) -> None:
    """Set what fillets take off the legs, reduced where they do not fit; note where they do not."""
    # a fillet takes r tan(θ/2) off both its legs: [k] off leg k at its start and off leg k − 1 at its end
    wanted = [0.0, *(radius_m * abs(math.tan(leg.corner_rad / 2)) for leg in legs)]
    for k, (leg, after) in enumerate(itertools.pairwise(legs), 1):
        if abs(leg.corner_rad) < ARC_RAD:  # straight on
            continue
        if leg.begins_m:
            wanted[k] = max(wanted[k], min(leg.begins_m, leg.room_m, after.room_m))
            continue
        # the corners before and after; where one is alike, waypoints lie along an arc
        beside = [other.corner_rad for other in (*legs[max(k - 2, 0) : k - 1], after)]
        if any(angle * leg.corner_rad > 0 and abs(angle - leg.corner_rad) < ARC_RAD for angle in beside):
            # it passes the corner r (1/cos(θ/2) − 1) = r tan(θ/2) tan(θ/4) away
            wide_m = leg.eased_m / abs(math.tan(leg.corner_rad / 4))
            wanted[k] = max(wanted[k], min(wide_m, leg.room_m / 2, after.room_m / 2))
    share = [1.0] * len(wanted)
    for k, leg in enumerate(legs):
        needed = wanted[k] + wanted[k + 1]
        if needed <= leg.room_m:
            continue
        for end in (k, k + 1):
            share[end] = min(share[end], leg.room_m / needed)
        if needed > leg.room_m + 2 * MIN_PIECE_M:
            tight.append(TightTurn(leg.target, leg.room_m, needed))
    trims = [a * b for a, b in zip(wanted, share, strict=True)]
    for k, leg in enumerate(legs):
        leg.trim_m = trims[k], trims[k + 1]


def _pieces(legs: Sequence[_Leg]) -> list[tuple[int, Piece]]:
    """The pieces of legs, trimmed, and of the turns between them, each with its target's index."""
    pieces: list[tuple[int, Piece]] = []
    for leg, after in itertools.zip_longest(legs, legs[1:]):
        pieces += [(leg.way, piece) for piece in _way(leg)]
        if leg.circle is not None:
            turn = _arc(leg.circle, leg.end, after.start if after else None)
        else:
            turn = _fillet(leg, after) if after and leg.corner_rad else []
        pieces += [(leg.target, piece) for piece in turn]
    return pieces


def _way(leg: _Leg) -> list[Piece]:
    """The way of a leg: an arc, or the straight between the fillets at its ends, if any is left."""
    if leg.round is not None:
        return _arc(leg.round, leg.start, leg.end)
    at_start_m, at_end_m = leg.trim_m
    if leg.length_m - at_start_m - at_end_m < MIN_PIECE_M:
        return []
    start, end = (*_ahead(leg.start, leg.course_rad, at_start_m), leg.course_rad), leg.fillet_start
    return [Piece(0, start, end, math.dist(start[:2], end[:2]), None)]


def _fillet(leg: _Leg, after: _Leg) -> list[Piece]:
    """The fillet between a leg and the next one, if it has any length."""
    trim_m = leg.trim_m[1]
    if trim_m < MIN_PIECE_M / 2:
        return []
    # r = trim / tan(θ/2), which may be reduced
    radius_m, side = trim_m / abs(math.tan(leg.corner_rad / 2)), math.copysign(1.0, leg.corner_rad)
    circle = Loiter(centre_m(leg.fillet_start, side, radius_m), side * radius_m, 0.0)
    return _arc(circle, leg.fillet_start[:2], _ahead(after.start, after.course_rad, after.trim_m[0]))


def _ahead(point: Point, course_rad: float, distance_m: float) -> Point:
    """The point at a distance along a course [m]."""
    return point[0] + distance_m * math.cos(course_rad), point[1] + distance_m * math.sin(course_rad)


def _arc(circle: Loiter, start: Point, end: Point | None) -> list[Piece]:
    """An arc of a circle, and the whole turns after it; without an end, its turns alone."""
    (x, y), radius = circle.centre_m, abs(circle.radius_m)
    turn = 1 if circle.radius_m > 0 else -1
    first = math.atan2(start[1] - y, start[0] - x)
    if end is None:
        sweep = 2 * math.pi * (circle.turns % 1)
        whole = math.floor(circle.turns)
    else:
        sweep = (turn * (math.atan2(end[1] - y, end[0] - x) - first)) % (2 * math.pi)
        if radius * min(sweep, 2 * math.pi - sweep) < MIN_PIECE_M:
            sweep = 0.0  # whole turns end where they start
        whole = max(0, math.ceil(circle.turns - sweep / (2 * math.pi) - TURNS_TOLERANCE))
    last = first + turn * sweep
    poses = [
        (x + radius * math.cos(angle), y + radius * math.sin(angle), wrap_angle_rad(angle + turn * math.pi / 2))
        for angle in (first, last)
    ]
    pieces = [Piece(turn, poses[0], poses[1], radius * sweep, circle.centre_m)] * (radius * sweep >= MIN_PIECE_M)
    whole_turn = Piece(turn, poses[1], poses[1], 2 * math.pi * radius, circle.centre_m)
    return [*pieces, *[whole_turn] * whole]
