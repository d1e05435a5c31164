"""Coverage within limits: lines and turns that stay out of obstacles and inside a boundary.

Lines are cut where they leave the free space, and shortened until a half circle to one side of either end is free,
behind what is flown straight beyond the line. The order of the lines is found with the times of free turns: those that
an order uses are checked, replaced by the quickest free ones, direct or around corners, and the order is found again,
until all of its turns are free.

Source: Dubins 1957 for the turns; Dellin and Srinivasa 2016 for edges that are checked where a shortest path uses them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.dubins import Piece, Pose, ordered_each, polyline_m, straight
from eadp.core.geometry.polygons import FreeSpace
from eadp.errors import Infeasible
from eadp.survey.line_order import LineCosts, best_order, quick_order
from eadp.survey.swaths import MIN_LINE_M, CoverageLeg, MotionLimits, half_circle

TRIM_SHARE = 0.25
"""Step by which the end of a line is shortened, as a share of the turning radius."""

CORNER_RATIO = 1.05
"""Distance of the corners that a turn goes around, over the turning radius."""

MAX_CORNERS = 48
"""Most poses at corners that turns go around."""

MAX_BLOCKED = 60
"""Most orders tried that have a turn without a free way. Other orders run out: each turn is checked once."""

MIN_GAIN = 1e-6
"""Least share of the time that another order saves: less is rounding."""


class NotFree(Infeasible):
    """No order of lines, or no way between two, stays out of obstacles and inside a boundary."""


class FreeTurn(NamedTuple):
    """A free way from one pose to another: its time [s] and its pieces."""

    time_s: float
    pieces: tuple[Piece, ...]


def free_lines(lines: Sequence[CoverageLeg], space: FreeSpace, motion: MotionLimits) -> list[CoverageLeg]:
    """Lines cut to the free space, with room for a turn at either end; each in both directions."""
    intervals = space.intervals_m([line.start[:2] for line in lines], [line.end[:2] for line in lines])
    inside = [
        straight(line.piece.pose_at(low)[:2], line.piece.pose_at(high)[:2])
        for line, own in zip(lines, intervals, strict=True)
        for low, high in own
    ]
    # shortened at its end until there is room for a half circle; then reversed, and at its start
    for _ in range(2):
        inside = [straight(line.end[:2], line.start[:2]) for line in _with_room(inside, space, motion)]
    legs = [CoverageLeg(line, True) for line in inside]
    return [way for leg in legs for way in (leg, leg.backward())]


def _with_room(lines: Sequence[Piece], space: FreeSpace, motion: MotionLimits) -> list[Piece]:
    """Lines shortened at their ends until there is room for what is flown beyond and a half circle to one side.

    Lines that become too short are left out.
    """
    if not lines:
        return []
    ends_m = np.array([line.length_m for line in lines])  # along each line
    beyond = [straight((0.0, 0.0), (motion.lead_in_m, 0.0))] if motion.lead_in_m else []
    # points of the way on from the origin along the x axis: with a half circle to the left, and with one to the right
    halves = [
        polyline_m([*beyond, half_circle((motion.lead_in_m, 0.0, 0.0), motion.min_radius_m, side)]) for side in (1, -1)
    ]
    left = np.arange(len(lines))  # indices of lines without room so far
    while len(left):
        x, y, headings = np.array([lines[i].pose_at(ends_m[i]) for i in left.tolist()]).T
        rotations = np.array([[np.cos(headings), np.sin(headings)], [-np.sin(headings), np.cos(headings)]])
        # each way out, turned and moved to the line's end: shape (lines, points, 2)
        rooms = [
            space.has_each([*(np.einsum("pi,ijn->npj", half, rotations) + np.stack([x, y], axis=1)[:, None])])
            for half in halves
        ]
        left = left[~(rooms[0] | rooms[1])]
        ends_m[left] -= TRIM_SHARE * motion.min_radius_m
        left = left[ends_m[left] >= MIN_LINE_M]
    kept = zip(lines, ends_m.tolist(), strict=True)
    return [straight(line.start[:2], line.pose_at(end_m)[:2]) for line, end_m in kept if end_m >= MIN_LINE_M]


@dataclass
class FreeTurns:
    """The quickest free turns between poses: direct, or around the corners of the free space.

    A corner stands twice in `_corners`: as a pose along its ring, then as the pose in the other direction. `_between`
    keeps what `direct` has found for a start and an end, `_found` what `turn` has found; None where no turn is free.
    """

    space: FreeSpace
    motion: MotionLimits
    _corners: list[Pose] = field(default_factory=list)
    _between: dict[tuple[Pose, Pose], FreeTurn | None] = field(default_factory=dict)
    _found: dict[tuple[Pose, Pose], FreeTurn | None] = field(default_factory=dict)

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
        self.find_direct([(start, end)])
        return self._between[start, end]

    def find_direct(self, pairs: Iterable[tuple[Pose, Pose]]) -> None:
        """Find the direct turns between pairs of poses, all at once, and keep them in `_between`."""
        if not (new := [pair for pair in pairs if pair not in self._between]):
            return
        starts, ends = zip(*new, strict=True)
        left: dict[tuple[Pose, Pose], Iterator[FreeTurn]] = {}  # of each pair without a free turn: turns not yet tried
        for pair, paths in zip(new, ordered_each(starts, ends, self.motion.min_radius_m), strict=True):
            turns = (FreeTurn(self.motion.time_s(path.pieces), path.pieces) for path in paths)
            # in wind by their times, of equally quick ones the shorter first
            left[pair] = turns if self.motion.windless else iter(sorted(turns, key=lambda turn: turn.time_s))
        while left:  # the quickest turn of each pair, then the next one of each pair whose turn was not free
            tried = {pair: next(turns, None) for pair, turns in left.items()}
            flown = {pair: polyline_m(turn.pieces) for pair, turn in tried.items() if turn and turn.pieces}
            for pair, free in zip(flown, self.space.has_each([*flown.values()]), strict=True):
                if not free:
                    del tried[pair]
            self._between |= tried  # now those that are free, and None for a pair whose turns are all tried
            left = {pair: turns for pair, turns in left.items() if pair not in tried}

    def turn(self, start: Pose, end: Pose) -> FreeTurn | None:
        """The quickest free path found, direct or around corners; None where none is."""
        key = start, end
        if key not in self._found:
            self._found[key] = self.direct(start, end) or self._around(start, end)
        return self._found[key]

    def _around(self, start: Pose, end: Pose) -> FreeTurn | None:
        """The quickest free path found around corners; None where none is.

        Over stops: the corners, poses after a half circle from the start and before one to the end. The turns of the
        quickest way are checked, and the way is found again, until all of its turns are free.
        """
        if np.ptp(self.space.rooms([start[:2], end[:2]])):
            return None
        # a line has room for a half circle at either end: one leads away from it, and one leads to it
        back = (*end[:2], end[2] + math.pi)
        turned = [half_circle(pose, self.motion.min_radius_m, side).end for pose in (start, back) for side in (1, -1)]
        own = [*turned[:2], *((x, y, heading + math.pi) for x, y, heading in turned[2:]), end, start]
        stops = [*self._corners, *own]
        # of each turn the time with nothing in the way, a lower bound; once checked, that of the free turn
        to_corners = np.vstack([self._apart_s, self.motion.turns_s(own, self._corners)])
        times_s = np.hstack([to_corners, self.motion.turns_s(stops, own)])
        checked: set[tuple[int, int]] = set()
        while turns := [*itertools.pairwise(_quickest_way(times_s))]:
            unchecked = set(turns) - checked
            if not unchecked:
                free = [turn for a, b in turns if (turn := self.direct(stops[a], stops[b])) is not None]
                pieces = itertools.chain.from_iterable(turn.pieces for turn in free)
                return FreeTurn(sum(turn.time_s for turn in free), tuple(pieces))
            self.find_direct((stops[a], stops[b]) for a, b in unchecked)
            for a, b in unchecked:
                found = self.direct(stops[a], stops[b])
                times_s[a, b] = math.inf if found is None else found.time_s
            checked |= unchecked
        return None

    @cached_property
    def _apart_s(self) -> FloatArray:
        """Times of the quickest turns from each corner to each, with nothing in the way [s]."""
        return self.motion.turns_s(self._corners, self._corners)


def _quickest_way(times_s: FloatArray) -> list[int]:
    """Stops of the quickest way from the last to the last but one, by times from each to each [s]; one without a way.

    Source: Bellman 1958.
    """
    end, start = len(times_s) - 2, len(times_s) - 1
    left_s, following = np.full(len(times_s), np.inf), np.full(len(times_s), end)
    left_s[end] = 0.0
    while (quicker := (through_s := times_s + left_s).min(axis=1) < left_s).any():
        following[quicker] = through_s[quicker].argmin(axis=1)
        left_s[quicker] = through_s[quicker].min(axis=1)
    way = [start]
    while math.isfinite(left_s[start]) and way[-1] != end:
        way.append(int(following[way[-1]]))
    return way


def free_order(
    directed: Sequence[CoverageLeg], costs: LineCosts, turns: FreeTurns, *, draft: bool = False
) -> tuple[list[int], float]:
    """The order of lines of least time whose turns are all free.

    Parameters
    ----------
    directed : sequence of CoverageLeg, length 2n
        Every line, followed by the same line in the other direction.
    costs : LineCosts
        With turns that may cross what is not free [s].
    turns : FreeTurns
    draft : bool, optional
        Whether the first such order of a quick search is enough.

    Returns
    -------
    order, time_s : list of int, float
        As of `line_order.best_order` [s].

    Raises
    ------
    NotFree
        If no such order is found.
    """
    failure = NotFree("no order of the lines has turns that stay out of the obstacles and inside the boundary")
    if np.ptp(turns.space.rooms([leg.start[:2] for leg in directed])):
        raise failure
    costs = costs._replace(between=costs.between.copy())  # raised below, once checked, to the times of free turns
    # the time of a turn without a free way: above any sum of times, so that only an order with such a turn reaches it
    blocked_s = 1e3 * (float(costs.between.max()) + float(costs.own.sum()) + 1)
    checked: set[tuple[int, int]] = set()
    best: tuple[list[int], float] = [], blocked_s  # of the orders whose turns are all checked
    order, time_s = quick_order(costs)
    blocked = 0  # orders so far with a turn without a free way
    while blocked < MAX_BLOCKED:
        blocked += time_s >= blocked_s
        unchecked = set(itertools.pairwise(order)) - checked
        if unchecked:
            turns.find_direct((directed[a].end, directed[b].start) for a, b in unchecked)
            for a, b in unchecked:
                found = turns.turn(directed[a].end, directed[b].start)
                costs.between[a, b] = blocked_s if found is None else max(found.time_s, costs.between[a, b])
            checked |= unchecked
            # the same order improved by the new times; one searched in full below, where it has nothing to check
            order, time_s = quick_order(costs, order)
            continue
        best = min(best, (order, time_s), key=lambda one: one[1])
        if draft and time_s < blocked_s:
            break
        order, time_s = best_order(costs)
        if time_s > best[1] * (1 - MIN_GAIN):
            break
    if best[1] < blocked_s:
        return best
    raise failure
