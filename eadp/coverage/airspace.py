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

LineCosts = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""The arguments of `line_order.best_order` [s]."""


def free_lines(lines: Sequence[CoverageLeg], space: FreeSpace, radius_m: float) -> list[CoverageLeg]:
    """Lines cut to the free space, with room for a turn at either end; each in both directions."""
    found = []
    for line in lines:
        start, end = line.start[:2], line.end[:2]
        for low, high in space.intervals_m(start, end):
            pieces = [line.piece.pose_at(low), line.piece.pose_at(high)]
            room = _with_room(straight(pieces[0][:2], pieces[1][:2]), space, radius_m)
            if room is not None:
                leg = CoverageLeg(room, True)
                found += [leg, leg.backward()]
    return found


def _with_room(line: Piece, space: FreeSpace, radius_m: float) -> Piece | None:
    """A line shortened until there is room for a half circle at both ends; None where nothing is left."""
    step, low, high = TRIM_SHARE * radius_m, 0.0, line.length_m

    def free(place_m: float, backward: bool) -> bool:
        x, y, heading = line.pose_at(place_m)
        pose = (x, y, heading + math.pi * backward)
        return any(space.has(polyline_m([half_circle(pose, radius_m, turn)])) for turn in (1, -1))

    while high - low >= MIN_LINE_M and not free(high, False):
        high -= step
    while high - low >= MIN_LINE_M and not free(low, True):
        low += step
    if high - low < MIN_LINE_M:
        return None
    return straight(line.pose_at(low)[:2], line.pose_at(high)[:2])


@dataclass
class FreeTurns:
    """The quickest free turns between poses: direct, or around the corners of the free space."""

    space: FreeSpace
    motion: MotionLimits
    _corners: list[Pose] = field(default_factory=list)
    _between: dict[tuple[Pose, Pose], tuple[float, tuple[Piece, ...]] | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for ring in self.space.corners_m(CORNER_RATIO * self.motion.min_radius_m):
            for before, here, after in zip((ring[-1], *ring[:-1]), ring, (*ring[1:], ring[0]), strict=True):
                along = math.atan2(after[1] - before[1], after[0] - before[0])
                self._corners += [(*here, along), (*here, math.remainder(along + math.pi, 2 * math.pi))]
        if len(self._corners) > MAX_CORNERS:
            chosen = np.linspace(0, len(self._corners) / 2 - 1, MAX_CORNERS // 2).round().astype(int)
            self._corners = [self._corners[2 * i + j] for i in chosen for j in (0, 1)]

    def direct(self, start: Pose, end: Pose) -> tuple[float, tuple[Piece, ...]] | None:
        """Time [s] and pieces of the quickest free Dubins path; None where none is free."""
        key = start, end
        if key not in self._between:
            paths = [path.pieces for path in ordered(start, end, self.motion.min_radius_m)]
            timed = sorted((self.motion.time_s(pieces), i) for i, pieces in enumerate(paths))
            free = (i for _, i in timed if not paths[i] or self.space.has(polyline_m(paths[i])))
            best = next(free, None)
            self._between[key] = None if best is None else ({i: t for t, i in timed}[best], tuple(paths[best]))
        return self._between[key]

    def turn(self, start: Pose, end: Pose) -> tuple[float, tuple[Piece, ...]] | None:
        """Time [s] and pieces of the quickest free path found; None where none is."""
        found = self.direct(start, end)
        if found is not None:
            return found
        # Dijkstra over the corners
        done: set[Pose] = set()
        count = itertools.count()
        queue: list[tuple[float, int, Pose, tuple[Piece, ...]]] = [(0.0, next(count), start, ())]
        while queue:
            time_s, _, pose, pieces = heapq.heappop(queue)
            if pose == end and pieces:
                return time_s, pieces
            if pose in done:
                continue
            done.add(pose)
            for following in (*self._corners, end):
                if following not in done and (leg := self.direct(pose, following)) is not None:
                    heapq.heappush(queue, (time_s + leg[0], next(count), following, (*pieces, *leg[1])))
        return None


def free_order(directed: Sequence[CoverageLeg], costs: LineCosts, turns: FreeTurns) -> tuple[list[int], float]:
    """The order of lines of least time whose turns are all free.

    Parameters
    ----------
    directed : sequence of CoverageLeg, length 2n
        Every line, followed by the same line in the other direction.
    costs : tuple of arrays
        As `line_order.best_order` takes them [s].
    turns : FreeTurns

    Raises
    ------
    Infeasible
        If no such order is found.
    """
    between, own, first, last = costs
    between = between.copy()
    # a turn that is not free, above any sum of those that are
    blocked_s = 1e3 * (float(between.max()) + float(own.sum()) + 1)
    checked: set[tuple[int, int]] = set()
    solve = quick_order  # until all turns of its orders are checked: most of what is checked is found so
    for _ in range(MAX_ORDERS):
        order, time_s = solve(between, own, first, last)
        used = set(itertools.pairwise(order)) - checked
        if not used and solve is quick_order:
            solve = best_order
            continue
        if time_s >= blocked_s and solve is best_order:
            break
        if not used:
            return order, time_s
        for a, b in used:
            found = turns.turn(directed[a].end, directed[b].start)
            between[a, b] = blocked_s if found is None else max(found[0], between[a, b])
            checked.add((a, b))
    raise Infeasible("no order of the lines has turns that stay out of the obstacles and inside the boundary")
