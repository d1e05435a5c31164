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
"""How far a line may be off the line that it follows, over the swath: where that is simplified, and in a bend."""

MAX_BEYOND = 2.0
"""Longest way that a line goes on beyond a bend at which it ends, over the swath. The outer corner of the strip of a
sharper bend is farther away."""

MIN_STRAIGHT_M = 1e-6
"""Length below which the arcs at both ends of a segment take all of it: it has no straight."""

Run = list[CoverageLeg]
"""Part of a line that is flown without a turn between: straights, and the arcs of bends."""


def cover_corridor(request: CoverageRequest, line: Sequence[Point], width_m: float) -> CoverageSolution:
    """The quickest order found of lines that follow a corridor.

    Parameters
    ----------
    request : CoverageRequest
        Its field is the corridor's ground; its heading and its pattern are not used.
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
        # the line beside the corridor's middle, in several parts where the offset parts it
        line_runs = [run for part in beside(line, offset_m, OFF_SHARE * motion.swath_m) for run in _runs(part, motion)]
        runs += line_runs
        ends = max(ends, len(line_runs) - 1)
    if len(runs) > MAX_LINES:
        raise Infeasible(f"the corridor needs {len(runs)} lines, more than {MAX_LINES}")
    directed = [way for run in runs for way in (run, _backward(run))]
    led = [_led(run, motion) for run in directed]
    order = _order(request, led)
    solution = connected(request, CORRIDOR, directed[order[0]][0].start[2], [led[i] for i in order])
    return replace(solution, spacing_m=apart_m if count > 1 else None, ends=ends)


def _order(request: CoverageRequest, led: Sequence[Run]) -> list[int]:
    """The quickest order found: indices of `led`, in which each run is followed by the same run the other way."""
    motion, space = request.motion, request.space
    starts, ends = [run[0].start for run in led], [run[-1].end for run in led]
    own_s = np.array([motion.time_s([leg.piece for leg in run]) for run in led])
    costs = motion.turns_s(ends, starts), own_s, from_start_s(request, starts), to_home_s(request, ends)
    rounded = LineCosts(*(np.round(part, TIE_DIGITS) for part in costs))
    if space is None:
        return best_order(*rounded)[0]
    if not all(space.has(polyline_m([leg.piece for leg in run])) for run in led):
        raise Infeasible("lines of the corridor leave the boundary or cross an obstacle")
    # the order is found by the ends of each run alone
    by_ends = [CoverageLeg(Piece(0, start, end, 0.0, None)) for start, end in zip(starts, ends, strict=True)]
    return free_order(by_ends, rounded, free_turns(space, motion))[0]


def _runs(line: Sequence[Point], motion: MotionLimits) -> list[Run]:
    """A line as straights and arcs of the smallest radius, in several runs where it bends too much for these."""
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in itertools.pairwise(line)]
    # a bend at each point of the line, 0 at both of its ends: segment i lies between bends i and i + 1
    bends = [0.0, *(math.remainder(b - a, 2 * math.pi) for a, b in itertools.pairwise(headings)), 0.0]
    lengths_m = [math.dist(a, b) for a, b in itertools.pairwise(line)]
    as_arc = _arc_bends(bends, lengths_m, motion)
    # how much of a segment its straight leaves to an arc at a bend; negative where the straight goes on beyond the bend
    shorter_m = [
        _taken_m(bend, motion.min_radius_m) if is_arc else -_beyond_m(bend, motion.swath_m)
        for bend, is_arc in zip(bends, as_arc, strict=True)
    ]
    straights = []
    for i, ((x, y), heading, length_m) in enumerate(zip(line[:-1], headings, lengths_m, strict=True)):
        # where the straight starts and ends along its segment
        start_m, end_m = shorter_m[i], length_m - shorter_m[i + 1]
        start, end = ((x + m * math.cos(heading), y + m * math.sin(heading)) for m in (start_m, end_m))
        no_length = Piece(0, (*start, heading), (*start, heading), 0.0, None)
        straights.append(straight(start, end) if end_m - start_m > MIN_STRAIGHT_M else no_length)
    return _assembled(straights, bends, as_arc, motion.min_radius_m)


def _assembled(
    straights: Sequence[Piece], bends_rad: Sequence[float], as_arc: Sequence[bool], radius_m: float
) -> list[Run]:
    """Straights joined by the arcs of bends, in a new run after each bend that is no arc.

    Bend i is at the start of straight i. A straight of no length is left out, but arcs start and end at it. The
    first bend is never an arc, as no straight is before it.
    """
    runs: list[Run] = []
    for i, piece in enumerate(straights):
        if as_arc[i]:
            arc = _arc(straights[i - 1].end, piece.start, bends_rad[i], radius_m)
            runs[-1].append(CoverageLeg(arc, sensing=True))
        else:
            runs.append([])
        if piece.length_m > 0:
            runs[-1].append(CoverageLeg(piece, sensing=True))
    return [run for run in runs if run]


def _arc_bends(bends_rad: Sequence[float], lengths_m: Sequence[float], motion: MotionLimits) -> list[bool]:
    """Whether each bend of a line is flown as an arc, which stays near its corner and fits in the segments beside it.

    The first and the last bend are the ends of the line, and no arcs.
    """
    radius_m = motion.min_radius_m
    # an arc of radius r in a bend of θ passes the corner at r (1/cos(θ/2) − 1)
    as_arc = [radius_m * (1 / math.cos(bend / 2) - 1) <= OFF_SHARE * motion.swath_m for bend in bends_rad]
    as_arc[0] = as_arc[-1] = False
    taken_m = [_taken_m(bend, radius_m) for bend in bends_rad]
    for i, length_m in enumerate(lengths_m):
        # while the arcs at both ends of a segment take more than all of it, the sharper bend is none
        while sum(taken_m[k] for k in (i, i + 1) if as_arc[k]) > length_m:
            as_arc[max((i, i + 1), key=lambda k: taken_m[k] if as_arc[k] else 0.0)] = False
    return as_arc


def _taken_m(bend_rad: float, radius_m: float) -> float:
    """Length that the arc of a bend takes from either segment beside it [m]."""
    # r tan(θ/2)
    return radius_m * math.tan(abs(bend_rad) / 2)


def _beyond_m(bend_rad: float, swath_m: float) -> float:
    """How far a strip goes on beyond a bend, until it meets the outer corner of the next one [m]."""
    # half a swath times tan(θ/2)
    return min(swath_m / 2 * math.tan(abs(bend_rad) / 2), MAX_BEYOND * swath_m)


def _arc(start: Pose, end: Pose, bend_rad: float, radius_m: float) -> Piece:
    """The arc of a bend, from the end of one straight to the start of the next."""
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
    """A run with the straight ways before and after it, also where it starts or ends with an arc."""
    first, last = (  # straight legs, which alone have leads
        leg if leg.piece.turn == 0 else CoverageLeg(Piece(0, pose, pose, 0.0, None))
        for leg, pose in ((run[0], run[0].start), (run[-1], run[-1].end))
    )
    return [*first.leads(motion)[0], *run, *last.leads(motion)[1]]
