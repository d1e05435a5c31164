"""Coverage within limits: lines and turns that stay out of obstacles and inside a boundary.

Lines are cut where they leave the free space, and shortened until a half circle to one side of either end is free. The
order of the lines is found with the times of free turns: those that an order uses are checked, replaced by the quickest
free ones, direct or around corners, and the order is found again, until all of its turns are free.

Source: Dubins 1957 for the turns; Dellin and Srinivasa 2016 for edges that are checked where a shortest path uses them.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.dubins import Piece, Pose, ordered, polyline_m
from eadp.core.geometry.polygons import FreeSpace
from eadp.coverage.line_order import best_order, quick_order
from eadp.coverage.swaths import MIN_LINE_M, CoverageLeg, MotionLimits, half_circle, straight
from eadp.errors import Infeasible

TRIM_SHARE = 0.25
"""Step by which the end of a line is shortened, as a share of the turning radius."""

CORNER_RATIO = 1.05
"""Distance of the corners that a turn goes around, over the turning radius."""

MAX_CORNERS = 48
MAX_ORDERS = 60
"""Most poses at corners, and most orders that are tried."""


class LineCosts(NamedTuple):
    """The arguments of `line_order.best_order` [s]."""

    between_s: FloatArray
    own_s: FloatArray
    first_s: FloatArray
    last_s: FloatArray


class FreeTurn(NamedTuple):
    """A free way from one pose to another: its time [s] and its pieces."""

    time_s: float
    pieces: tuple[Piece, ...]


def free_lines(lines: Sequence[CoverageLeg], space: FreeSpace, radius_m: float) -> list[CoverageLeg]:
    """Lines cut to the free space, with room for a turn at either end; each in both directions."""
    found = []
    for line in lines:
        start, end = line.start[:2], line.end[:2]
        for low, high in space.intervals_m(start, end):
            inside = straight(line.piece.pose_at(low)[:2], line.piece.pose_at(high)[:2])
            shortened = _with_room(inside, space, radius_m)
            if shortened is not None:
                leg = CoverageLeg(shortened, True)
                found += [leg, leg.backward()]
    return found


def _with_room(line: Piece, space: FreeSpace, radius_m: float) -> Piece | None:
    """A line shortened until there is room for a half circle at both ends; None where nothing is left."""
    step_m, low_m, high_m = TRIM_SHARE * radius_m, 0.0, line.length_m

    def has_room(place_m: float, backward: bool) -> bool:
        """Whether a half circle to either side is free where the line is left, forward or backward."""
        x, y, heading = line.pose_at(place_m)
        pose = (x, y, heading + math.pi * backward)
        return any(space.has(polyline_m([half_circle(pose, radius_m, turn)])) for turn in (1, -1))

    while high_m - low_m >= MIN_LINE_M and not has_room(high_m, False):
        high_m -= step_m
    while high_m - low_m >= MIN_LINE_M and not has_room(low_m, True):
        low_m += step_m
    if high_m - low_m < MIN_LINE_M:
        return None
    return straight(line.pose_at(low_m)[:2], line.pose_at(high_m)[:2])


@dataclass
class FreeTurns:
    """The quickest free turns between poses: direct, or around the corners of the free space.

    A corner stands twice in `_corners`: a pose along its ring, then the one in the other direction. `_between` keeps
    what `direct` has found.
    """

    space: FreeSpace
    motion: MotionLimits
    _corners: list[Pose] = field(default_factory=list)
    _between: dict[tuple[Pose, Pose], FreeTurn | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for ring in self.space.corners_m(CORNER_RATIO * self.motion.min_radius_m):
            for before, here, after in zip((ring[-1], *ring[:-1]), ring, (*ring[1:], ring[0]), strict=True):
                along = math.atan2(after[1] - before[1], after[0] - before[0])
                self._corners += [(*here, along), (*here, math.remainder(along + math.pi, 2 * math.pi))]
        if len(self._corners) > MAX_CORNERS:
            # corners evenly along the rings, each with both of its poses
            chosen = np.linspace(0, len(self._corners) / 2 - 1, MAX_CORNERS // 2).round().astype(int)
            self._corners = [self._corners[2 * i + j] for i in chosen for j in (0, 1)]

    def direct(self, start: Pose, end: Pose) -> FreeTurn | None:
        """The quickest free Dubins path, without corners on the way; None where none is free."""
        key = start, end
        if key not in self._between:
            paths = [path.pieces for path in ordered(start, end, self.motion.min_radius_m)]
            timed = [FreeTurn(self.motion.time_s(pieces), pieces) for pieces in paths]
            timed.sort(key=lambda turn: turn.time_s)  # of equally quick ones the shorter stays first
            free = (turn for turn in timed if not turn.pieces or self.space.has(polyline_m(turn.pieces)))
            self._between[key] = next(free, None)
        return self._between[key]

    def turn(self, start: Pose, end: Pose) -> FreeTurn | None:
        """The quickest free path found, direct or around corners; None where none is."""
        found = self.direct(start, end)
        if found is not None:
            return found
        # a line has room for a half circle at either end: one leaves it, and one leads to it
        back = (*end[:2], end[2] + math.pi)
        turned = [half_circle(pose, self.motion.min_radius_m, side).end for pose in (start, back) for side in (1, -1)]
        stops = [*self._corners, *turned[:2], *((x, y, heading + math.pi) for x, y, heading in turned[2:]), end]
        # Dijkstra over the corners; of equal times the one found first, as poses have no order
        done: set[Pose] = set()
        count = itertools.count()
        queue: list[tuple[float, int, Pose, tuple[Piece, ...]]] = [(0.0, next(count), start, ())]
        while queue:
            time_s, _, pose, pieces = heapq.heappop(queue)
            if pose == end and pieces:
                return FreeTurn(time_s, pieces)
            if pose in done:
                continue
            done.add(pose)
            for following in stops:
                if following not in done and (leg := self.direct(pose, following)) is not None:
                    heapq.heappush(queue, (time_s + leg.time_s, next(count), following, (*pieces, *leg.pieces)))
        return None


def free_order(directed: Sequence[CoverageLeg], costs: LineCosts, turns: FreeTurns) -> tuple[list[int], float]:
    """The order of lines of least time whose turns are all free.

    Parameters
    ----------
    directed : sequence of CoverageLeg, length 2n
        Every line, followed by the same line in the other direction.
    costs : LineCosts
        With turns that may cross what is not free [s].
    turns : FreeTurns

    Returns
    -------
    order, time_s : list of int, float
        As of `line_order.best_order` [s].

    Raises
    ------
    Infeasible
        If no such order is found.
    """
    between_s, own_s, first_s, last_s = costs
    between_s = between_s.copy()  # raised below where the turn is not free
    # where no free turn is found: above any sum of times, so that an order of this time has a turn that is blocked
    blocked_s = 1e3 * (float(between_s.max()) + float(own_s.sum()) + 1)
    checked: set[tuple[int, int]] = set()
    solve = quick_order  # until all turns of its order are checked, which are most; then `best_order`
    for _ in range(MAX_ORDERS):
        order, time_s = solve(between_s, own_s, first_s, last_s)
        unchecked = set(itertools.pairwise(order)) - checked
        if not unchecked and solve is quick_order:
            solve = best_order
            continue
        if time_s >= blocked_s and solve is best_order:
            break
        if not unchecked:
            return order, time_s
        for a, b in unchecked:
            found = turns.turn(directed[a].end, directed[b].start)
            between_s[a, b] = blocked_s if found is None else max(found.time_s, between_s[a, b])
            checked.add((a, b))
    raise Infeasible("no order of the lines has turns that stay out of the obstacles and inside the boundary")
