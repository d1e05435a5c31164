"""Coverage of a corridor, as of a river, a road or a power line: lines beside one another that follow its line.

A bend is flown where turns of the smallest radius keep to the line; where they do not, lines end at it, each as far
beyond as its strip needs, and a turn leads on. The parts of the lines are flown in the quickest order.

Source: Dubins 1957 for the turns between lines.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, polyline_m
from eadp.core.geometry.polygons import beside
from eadp.coverage.airspace import LineCosts, free_order
from eadp.coverage.cover import (
    MAX_LINES,
    TIE_DIGITS,
    CoverageRequest,
    CoverageSolution,
    connected,
    free_turns,
    from_start_s,
    to_home_s,
)
from eadp.coverage.line_order import best_order
from eadp.coverage.swaths import CoverageLeg, MotionLimits, straight
from eadp.errors import Infeasible

CORRIDOR = "corridor"

OFF_SHARE = 0.02
"""Distance over the swath that a line may keep from the line that it follows: simplified, or in a bend."""

MAX_BEYOND = 2.0
"""Longest way beyond a bend at which a line ends, over the swath: of sharper bends, the strip's corner is beyond."""

Run = list[CoverageLeg]
"""Part of a line that is flown at once: straights, and the arcs of bends."""


def cover_corridor(request: CoverageRequest, line: Sequence[Point], width_m: float) -> CoverageSolution:
    """The quickest order found of lines that follow a corridor.

    Parameters
    ----------
    request : CoverageRequest
        Its field is the corridor's ground; heading and pattern are not used.
    line : sequence of (float, float)
        The middle of the corridor [m].
    width_m : float
        Its width [m].

    Raises
    ------
    Infeasible
        If the lines are too many, leave the free space, or have no order whose turns are free.
    """
    request.check()
    motion = request.motion
    count = math.ceil(width_m / (request.order_spacing_m or motion.swath_m) - 1e-9)
    apart_m = width_m / count
    runs: list[Run] = []
    ends = 0
    for number in range(count):
        offset_m = (number + 0.5) * apart_m - width_m / 2
        own = [run for part in beside(line, offset_m, OFF_SHARE * motion.swath_m) for run in _runs(part, motion)]
        runs += own
        ends = max(ends, len(own) - 1)
    if len(runs) > MAX_LINES:
        raise Infeasible(f"the corridor needs {len(runs)} lines, more than {MAX_LINES}")
    directed = [way for run in runs for way in (run, _backward(run))]
    led = [_led(run, motion) for run in directed]
    order = _order(request, led)
    solution = connected(request, CORRIDOR, directed[order[0]][0].start[2], [led[i] for i in order])
    return replace(solution, spacing_m=apart_m if count > 1 else None, ends=ends)


def _order(request: CoverageRequest, led: Sequence[Run]) -> list[int]:
    """The quickest order found of runs, each followed by the same one the other way."""
    motion, space = request.motion, request.space
    starts, ends = [run[0].start for run in led], [run[-1].end for run in led]
    own_s = np.array([motion.time_s([leg.piece for leg in run]) for run in led])
    costs = motion.turns_s(ends, starts), own_s, from_start_s(request, starts), to_home_s(request, ends)
    rounded = LineCosts(*(np.round(part, TIE_DIGITS) for part in costs))
    if space is None:
        return best_order(*rounded)[0]
    if not all(space.has(polyline_m([leg.piece for leg in run])) for run in led):
        raise Infeasible("lines of the corridor leave the boundary or cross an obstacle")
    whole = [CoverageLeg(Piece(0, start, end, 0.0, None)) for start, end in zip(starts, ends, strict=True)]
    return free_order(whole, rounded, free_turns(space, motion))[0]


def _runs(line: Sequence[Point], motion: MotionLimits) -> list[Run]:
    """A line as straights and arcs of the smallest radius, in several runs where it bends too much for these."""
    radius_m, swath_m = motion.min_radius_m, motion.swath_m
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in itertools.pairwise(line)]
    bends = [0.0, *(math.remainder(b - a, 2 * math.pi) for a, b in itertools.pairwise(headings)), 0.0]
    lengths_m = [math.dist(a, b) for a, b in itertools.pairwise(line)]
    # an arc of radius r in a bend of θ: it takes r tan(θ/2) of either side, and passes the corner at r (1/cos(θ/2) − 1)
    taken_m = [radius_m * math.tan(abs(bend) / 2) for bend in bends]
    flown = [radius_m * (1 / math.cos(bend / 2) - 1) <= OFF_SHARE * swath_m for bend in bends]
    flown[0] = flown[-1] = False
    for i, length_m in enumerate(lengths_m):
        # the ends of both arcs lie on the straight between them
        while sum(taken_m[k] for k in (i, i + 1) if flown[k]) > length_m:
            sharper = max((i, i + 1), key=lambda k: taken_m[k] if flown[k] else 0.0)
            flown[sharper] = False
    # by how much a straight is shorter at a bend: its arc's share, or less than nothing, as far as its strip goes on
    shorter_m = [
        took_m if is_flown else -_beyond_m(bend, swath_m)
        for took_m, is_flown, bend in zip(taken_m, flown, bends, strict=True)
    ]
    runs: list[Run] = [[]]
    for i, (heading, length_m) in enumerate(zip(headings, lengths_m, strict=True)):
        cos, sin = math.cos(heading), math.sin(heading)
        # where the straight starts and ends along its segment
        (x, y), start_m, end_m = line[i], shorter_m[i], length_m - shorter_m[i + 1]
        piece = straight((x + start_m * cos, y + start_m * sin), (x + end_m * cos, y + end_m * sin))
        if runs[-1] and flown[i]:
            runs[-1].append(CoverageLeg(_arc(runs[-1][-1].end, piece.start, bends[i], radius_m), sensing=True))
        if end_m - start_m > 1e-6:
            runs[-1].append(CoverageLeg(piece, sensing=True))
        if not flown[i + 1]:
            runs.append([])
    return [run for run in runs if run]


def _beyond_m(bend_rad: float, swath_m: float) -> float:
    """How far a strip goes on beyond a bend, until it meets the outer corner of the next one [m]."""
    # half a swath times tan(θ/2)
    return min(swath_m / 2 * math.tan(abs(bend_rad) / 2), MAX_BEYOND * swath_m)


def _arc(start: Pose, end: Point | Pose, bend_rad: float, radius_m: float) -> Piece:
    """The arc of a bend between two straights."""
    turn = 1 if bend_rad > 0 else -1
    x, y, heading = start
    centre = x - turn * radius_m * math.sin(heading), y + turn * radius_m * math.cos(heading)
    after = (end[0], end[1], math.remainder(heading + bend_rad, 2 * math.pi))
    return Piece(turn, start, after, radius_m * abs(bend_rad), centre)


def _backward(run: Run) -> Run:
    """The same run in the other direction."""

    def turned(pose: Pose) -> Pose:
        return pose[0], pose[1], math.remainder(pose[2] + math.pi, 2 * math.pi)

    return [
        CoverageLeg(
            Piece(-leg.piece.turn, turned(leg.end), turned(leg.start), leg.piece.length_m, leg.piece.centre_m), True
        )
        for leg in reversed(run)
    ]


def _led(run: Run, motion: MotionLimits) -> Run:
    """A run with the straight ways before and after it."""
    return [*run[0].leads(motion)[0], *run, *run[-1].leads(motion)[1]]
