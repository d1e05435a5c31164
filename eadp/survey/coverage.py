"""Coverage path planning: the quickest path found that covers a field, in one of two patterns.

The patterns are the letter's Zamboni-like motion, and lines in a travelling salesman's order with Dubins turns.
Headings, starting corners and patterns are compared by the time of flight. That of the Zamboni-like motion is taken at
its lowest c1, where it covers the field with the fewest lines. Turns between the lines of an order, and between blocks,
have the aircraft's smallest radius.

Source: letter, Sec. IV-A; Dubins 1957 for the turns between lines.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Pose, centre_m, ordered, polyline_m, straight
from eadp.core.geometry.geodesy import compass_deg, point_text
from eadp.core.geometry.polygons import FreeSpace, hull, strip_extents
from eadp.errors import Infeasible
from eadp.models.airspace import CLEARANCE_SHARE, Airspace, Field
from eadp.plug_ins import plug_in
from eadp.survey.airspace import FreeTurns, NotFree, free_lines, free_order
from eadp.survey.line_order import LineCosts, best_order, quick_order
from eadp.survey.swaths import MIN_LINE_M, CoverageLeg, CoveragePath, MotionLimits, StripFrame, frame_of, half_circle
from eadp.survey.zamboni import Block, BlockLayout, build_block, layouts

ZAMBONI, DUBINS, AUTO = PATTERNS = "zamboni", "dubins", "auto"

MAX_TIME_RATIO = 1.02
"""`auto` takes the Zamboni-like motion if its time is at most this many times the best order's."""

HEADING_STEP_DEG = 10
"""Step of the headings tried besides those of the hull's edges, counted from the longest edge [°]."""

MAX_SQUARES, MIN_HEADINGS = 300_000, 6
"""Largest sum of the squares of lines over the headings tried, and fewest headings: more would take over 10 s."""

SAME_HEADING_RAD = math.radians(1.0)

FULL_SEARCHES = 3
"""Number of headings for which the order of lines is searched in full."""

FREE_HEADINGS_TRIED = 6
"""Most headings that are tried within obstacles and a boundary, the quickest first."""

MIN_LEFT = 0.05
"""Smallest share of the lines that obstacles and a boundary leave, for a field to be covered at all."""

LOST_RATIO = 20.0
"""Time that a metre of a line left out counts, over the time that it takes."""

FULL_LAYOUTS = 16
"""Number of layouts of laps at a heading that are tried from all corners."""

ACCESS_TRIED = 12
"""Lines whose ways from the start and to the end are tried before the search, the nearest first."""

MAX_LINES = 400
"""Largest number of lines that are ordered."""

SEAM_M = 1e-7
"""By how much windows beside each other overlap [m]: less than what a line leaves to its neighbour."""

FREE_HEADINGS = 36
"""Number of headings tried at the start and home points."""

BEFORE_SHARES = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
"""Lengths of a straight before the first line that are tried, over what a climb lacks."""

TIE_DIGITS = 6
"""Times that agree to so many decimals are equal [s]."""

Pattern = Callable[["CoverageRequest", float], Sequence[CoverageLeg]]
"""A pattern of another package: the lines of a request at a heading [rad], in order; turns are added. It raises
`Infeasible` where it does not fit."""


@dataclass(frozen=True)
class LineGrid:
    """Lines beside each other, by their u in a frame: middles of n lines, and the n + 1 edges of their ground [m]."""

    frame: StripFrame
    middles_m: FloatArray
    edges_m: FloatArray

    @classmethod
    def over(cls, field: Field, heading_rad: float, swath_m: float, spacing_m: float) -> LineGrid:
        """Lines of a heading over a field, evenly spaced, as few as lie no farther apart than `spacing_m`.

        Raises
        ------
        Infeasible
            If they are more than `MAX_LINES`.
        """
        frame = _canonical_frame(field, heading_rad)
        across = np.concatenate([frame.into(np.array(part[0]))[:, 0] for part in field.parts])
        left, width = float(across.min()), float(np.ptp(across))
        count = max(1, math.ceil((width - swath_m - 1e-6) / spacing_m) + 1)
        if count > MAX_LINES:
            raise Infeasible(f"the field needs {count} lines, more than {MAX_LINES}")
        half = min(width, swath_m) / 2
        middles = np.linspace(left + half, left + width - half, count)
        # ground that two lines reach belongs to the nearer one
        return cls(frame, middles, np.array([left, *((middles[:-1] + middles[1:]) / 2), left + width]))

    def whole_lines(self, field: Field) -> list[CoverageLeg]:
        """The lines over a field and its gaps: each as a leg, followed by the same line the other way."""
        return self.directed(_without_gaps(self.extents(field)))

    def directed(self, extents: Sequence[Sequence[tuple[float, float]]]) -> list[CoverageLeg]:
        """A line over each extent, upward [m], followed by the same one the other way; a short one is made longer."""
        legs = []
        for u, spans in zip(self.middles_m.tolist(), extents, strict=True):
            for low, high in spans:
                extra = max(0.0, MIN_LINE_M - (high - low)) / 2
                leg = CoverageLeg(straight(self.frame.out(u, low - extra), self.frame.out(u, high + extra)), True)
                legs += [leg, leg.backward()]
        return legs

    def order_of(self, solution: CoverageSolution) -> list[int]:
        """Indices of the lines, in the order in which a solution without laps first flies a part of each."""
        flown = [leg.start[:2] for leg in solution.path(0.0).legs if leg.sensing]
        across = self.frame.into(np.array(flown))[:, 0]
        return list(dict.fromkeys(np.abs(across[:, None] - self.middles_m).argmin(axis=1).tolist()))

    def extents(self, field: Field) -> list[list[tuple[float, float]]]:
        """For each line the intervals of v in which its strip holds ground of a field [m], upward."""
        rings, *others = ([self.frame.into(np.array(ring)) for ring in part] for part in field.parts)
        return strip_extents(rings, self.edges_m, others)

    def window(self, line: int, low_m: float, high_m: float) -> list[Point]:
        """Corners in the plane of a line's ground between two values of v [m]."""
        left, right = float(self.edges_m[line]) - SEAM_M, float(self.edges_m[line + 1]) + SEAM_M
        corners = ((left, low_m), (right, low_m), (right, high_m), (left, high_m))
        return [self.frame.out(*corner) for corner in corners]


@dataclass(frozen=True)
class CoverageRequest:
    """A coverage problem: the field, the motion's limits, and what is prescribed.

    `heading_rad` None leaves the heading of the lines free; `start_m` and `home_m` None leave both ends of the path
    free; a path may start at a pose. It may start with a straight `climb_out` and end with a straight final `approach`.
    The first line begins `climb_s` after the start at the earliest, as the aircraft has to climb.
    Ordered lines lie at most `order_spacing_m` apart, by default a swath, or on a `grid`. `airspace` is what is in the
    way, by default all that the field has.
    """

    field: Field
    motion: MotionLimits
    pattern: str = AUTO
    heading_rad: float | None = None
    start_m: Point | Pose | None = None
    home_m: Point | None = None
    order_spacing_m: float | None = None
    grid: LineGrid | None = None
    airspace: Airspace | None = None
    climb_out: CoverageLeg | None = None
    approach: CoverageLeg | None = None
    climb_s: float = 0.0

    @property
    def way_out(self) -> Point | Pose | None:
        """Where the way to the first line starts: with a heading after a climb-out."""
        return self.start_m if self.climb_out is None else self.climb_out.end

    @property
    def way_back(self) -> Point | Pose | None:
        """Where the way from the last line ends: with a heading before an approach."""
        return self.home_m if self.approach is None else self.approach.start

    def check(self) -> None:
        """Raise Infeasible if climb-out or final approach is not free, or the wind is too strong."""
        wind_mps = math.hypot(*self.motion.wind_mps)
        if wind_mps >= self.motion.airspeed_mps:
            raise Infeasible(
                f"a wind of {wind_mps:g} m/s is not slower than the aircraft's {self.motion.airspeed_mps:g}"
            )
        for leg, name in ((self.climb_out, "climb-out"), (self.approach, "final approach")):
            if leg is not None and self.space is not None and not self.space.has_hull(polyline_m([leg.piece])):
                way = f"{leg.piece.length_m:.0f} m towards {compass_deg(leg.start[2]):.0f}°"
                # where the leg stops being free: its start, or else the end of its first free interval
                (low_m, high_m), *_ = (*self.space.intervals_m([leg.start[:2]], [leg.end[:2]])[0], (1.0, 0.0))
                place = self.place_text(leg.piece.pose_at(0.0 if low_m > 0 else high_m))
                message = f"the {name} of {way} does not stay {self.limits_text} at {place}"
                raise Infeasible(message, "another heading, another place, or less altitude")

    def place_text(self, pose: Point | Pose) -> str:
        """A place, for people."""
        return point_text(pose[:2], self.field.origin_deg)

    @property
    def limits_text(self) -> str:
        """What is in the way, in a message."""
        airspace = self.airspace or self.field.airspace
        limits = ["out of the obstacles"] * bool(airspace.obstacles) + ["inside the boundary"] * bool(airspace.boundary)
        return " and ".join(limits)

    @cached_property
    def space(self) -> FreeSpace | None:
        """Where lines and turns may lie; None for everywhere."""
        airspace = self.airspace or self.field.airspace
        return airspace.free_space(CLEARANCE_SHARE * self.motion.min_radius_m) if any(airspace) else None


@dataclass(frozen=True)
class CoverageSolution:
    """A path that covers a field: single legs, and blocks that are flown lap by lap.

    `time_s` is the time of flight at the lowest c1, `access_s` the part of it before the first line and after the last.
    """

    pattern: str
    heading_rad: float
    sections: tuple[CoverageLeg | Block, ...]
    time_s: float = 0.0
    access_s: float = 0.0

    def path(self, c1: float) -> CoveragePath:
        """The whole path at a fixed parameter."""
        legs: list[CoverageLeg] = []
        for section in self.sections:
            legs += section.legs(max(c1, section.min_c1)) if isinstance(section, Block) else [section]
        return CoveragePath(tuple(legs))

    @property
    def blocks(self) -> list[Block]:
        """The blocks flown lap by lap."""
        return [section for section in self.sections if isinstance(section, Block)]

    @property
    def min_c1(self) -> float:
        """The lowest c1 of any block; 0 without blocks."""
        return min((block.min_c1 for block in self.blocks), default=0.0)


def cover(request: CoverageRequest, *, draft: bool = False) -> CoverageSolution:
    """The quickest path found that covers a field.

    With `draft`, lines within obstacles and a boundary are ordered by a quick search: some percent longer at most.

    Raises
    ------
    Infeasible
        If the wind is too strong, the field is too narrow for the requested pattern, or needs too many lines.
    """
    request.check()  # before the search, which takes long
    motion = request.motion
    check_access(request)
    headings = _tried_headings(request) if request.heading_rad is None else [request.heading_rad]
    if request.pattern == DUBINS:
        return _best_in_order(request, headings, draft)
    if request.pattern not in PATTERNS:
        return _best_of_pattern(request, plug_in("coverage_patterns", request.pattern), headings)
    parted = bool(request.field.others)
    if parted and request.pattern == ZAMBONI:
        raise Infeasible("the Zamboni-like motion covers one part of a field; --pattern dubins covers several")
    zamboni = None if parted else _best_zamboni(request, headings)
    if request.pattern == ZAMBONI:
        if zamboni is None and request.space is not None:
            message = "no laps of the Zamboni-like motion stay out of the obstacles and inside the boundary"
            raise Infeasible(f"{message}, at every c1; --pattern dubins may")
        if zamboni is None:
            needs = f"across its lines it needs about {4 * motion.min_radius_m + 2 * motion.swath_m:.0f} m"
            raise Infeasible(f"the field is too narrow for the Zamboni-like motion: {needs}")
        return zamboni
    return _laps_or_lines(request, headings, zamboni, draft)


def _laps_or_lines(
    request: CoverageRequest, headings: Sequence[float], zamboni: CoverageSolution | None, draft: bool = False
) -> CoverageSolution:
    """Laps, or lines in an order at some headings: laps unless they take more than `MAX_TIME_RATIO` times as long."""
    try:
        order = _best_in_order(request, headings, draft and zamboni is None)
    except Infeasible:
        if zamboni is None:
            raise
        return zamboni
    if zamboni is None:
        return order
    # access takes much the same time in both patterns
    laps_s, lines_s = zamboni.time_s - zamboni.access_s, order.time_s - order.access_s
    return zamboni if laps_s <= MAX_TIME_RATIO * lines_s else order


def has_pattern(name: str) -> bool:
    """Whether eadp or an installed package has a pattern of a name. Raises EadpError if it cannot be imported."""
    return name in PATTERNS or plug_in("coverage_patterns", name) is not None


def _best_of_pattern(request: CoverageRequest, pattern: Pattern, headings: Sequence[float]) -> CoverageSolution:
    """The quickest path of another package's pattern at some headings; Infeasible, of the last one, where none fits."""
    found, failure = list[CoverageSolution](), Infeasible(f"pattern {request.pattern} has no lines")
    for heading in headings:
        try:
            legs = [replace(leg, sensing=True) for leg in pattern(request, heading)]
            if request.space is not None and not all(
                request.space.has_hull(polyline_m([leg.led(request.motion).piece])) for leg in legs
            ):
                raise Infeasible(f"lines of pattern {request.pattern} leave the boundary or cross an obstacle")
            if legs:
                found.append(
                    connected(request, request.pattern, heading, [leg.with_leads(request.motion) for leg in legs])
                )
        except Infeasible as error:
            failure = error
    if not found:
        raise failure
    return min(found, key=lambda solution: solution.time_s)


def _tried_headings(request: CoverageRequest) -> list[float]:
    """The headings to compare [rad]: where lines are many, only those that need the fewest lines.

    The time to order n lines grows as n², so that the number of headings is limited by `MAX_SQUARES` / n².
    """
    headings = list(_headings(request.field))
    outline = np.concatenate([np.array(part[0]) for part in request.field.parts])
    widths_m = [float(np.ptp(frame_of(heading).into(outline)[:, 0])) for heading in headings]
    lines = min(widths_m) / (request.order_spacing_m or request.motion.swath_m)
    count = max(MIN_HEADINGS, int(MAX_SQUARES / lines**2))
    kept = sorted(range(len(headings)), key=lambda i: round(widths_m[i], TIE_DIGITS))[:count]
    return [headings[i] for i in sorted(kept)]


def _headings(field: Field) -> Iterator[float]:
    """Headings in [0, π) to try: those of the hull's edges, the longest first; then steps from the longest edge's."""
    corners = np.array(hull(np.concatenate([np.array(part[0]) for part in field.parts])))
    edges = np.roll(corners, -1, axis=0) - corners
    found: list[float] = []
    by_length = edges[np.argsort(-np.round(np.hypot(edges[:, 0], edges[:, 1]), TIE_DIGITS), kind="stable")]
    of_edges = [math.atan2(dy, dx) for dx, dy in by_length.tolist()]
    steps = [math.radians(sign * k) for k in range(HEADING_STEP_DEG, 91, HEADING_STEP_DEG) for sign in (1, -1)]
    for heading in [*of_edges, *(of_edges[0] + step for step in steps)]:
        heading %= math.pi
        if all(abs(math.remainder(heading - other, math.pi)) > SAME_HEADING_RAD for other in found):
            found.append(heading)
            yield heading


def connected(
    request: CoverageRequest, pattern: str, heading_rad: float, parts: Sequence[Sequence[CoverageLeg | Block]]
) -> CoverageSolution:
    """The timed solution that flies lines or blocks in this order, from the start point to home by the quickest turns.

    A line has its lead-in, and all its legs, if it has several.

    Raises
    ------
    Infeasible
        If no turn between two of them is free.
    """
    climb_out, approach = ([] if leg is None else [leg] for leg in (request.climb_out, request.approach))
    sections: list[CoverageLeg | Block] = [*climb_out]
    previous: Pose | None = None
    for flown in parts:
        start = flown[0].start
        entry = _climbing_entry(request, start) if previous is None else _turn(request, previous, start)
        sections += [*entry, *flown]
        previous = flown[-1].end
    assert previous is not None
    flown = (*sections, *_exit(request, previous), *approach)
    return timed(CoverageSolution(pattern, heading_rad, flown), request.motion)


def timed(solution: CoverageSolution, motion: MotionLimits) -> CoverageSolution:
    """A solution with its times."""
    legs = solution.path(solution.min_c1).legs
    lines = [i for i, leg in enumerate(legs) if leg.sensing]
    access = (*legs[: lines[0]], *legs[lines[-1] + 1 :])
    time_s, access_s = (motion.time_s([leg.piece for leg in flown]) for flown in (legs, access))
    return replace(solution, time_s=time_s, access_s=access_s)


# --- the Zamboni-like motion ------------------------------------------------------------------------------------------


class _Chain(NamedTuple):
    """Blocks flown one after the other at a heading, and the whole time at the lowest c1 [s]."""

    time_s: float
    blocks: list[Block]
    heading_rad: float


def _best_zamboni(request: CoverageRequest, headings: Sequence[float]) -> CoverageSolution | None:
    """The quickest Zamboni-like path at some headings; None where the field is too narrow, or no path is free."""
    if request.space is not None and request.space.blocks(request.field.parts, request.motion.swath_m / 2):
        return None  # the hull of the laps, which has to be free, comes within half a swath of all ground
    outline = np.array(request.field.outline)
    designs = [
        (heading, layout)
        for heading in headings
        for layout in layouts(float(np.ptp(frame_of(heading).into(outline)[:, 0])), request.motion)
    ]
    # compared from one corner, the best of them then from all
    drafts_s = [round(next(_chains(request, *design, corners=1)).time_s, TIE_DIGITS) for design in designs]
    best_first = [designs[i] for i in np.argsort(drafts_s, kind="stable")]
    found = [chain for design in best_first[:FULL_LAYOUTS] for chain in _chains(request, *design)]
    for chain in sorted(found, key=lambda chain: round(chain.time_s, TIE_DIGITS)):  # of equal ones the first
        # laps of any sequence of c1 lie in the hull of those at its ends
        hulls = ([leg.piece for c1 in (0.0, block.min_c1) for leg in block.legs(c1)] for block in chain.blocks)
        if request.space is None or all(request.space.has_hull(polyline_m(pieces)) for pieces in hulls):
            with suppress(Infeasible):
                return connected(request, ZAMBONI, chain.heading_rad, [[block] for block in chain.blocks])
    return None


def _chains(request: CoverageRequest, heading_rad: float, layout: BlockLayout, corners: int = 4) -> Iterator[_Chain]:
    """Chains of the blocks of a layout at a heading, from either side, every block from the best of its corners."""
    motion, outline = request.motion, np.array(request.field.outline)
    rows: list[list[Block]] = [[] for _ in range(layout.blocks)]  # each block from its corners
    # one frame for each corner: u to the right or left of the heading, v a quarter turn from it to either side
    for towards, hand in ((1, 1), (1, -1), (-1, 1), (-1, -1))[:corners]:
        frame = frame_of(heading_rad, towards, hand)
        points = frame.into(outline)
        left_m = float(points[:, 0].min())
        for index, row in enumerate(rows[::towards]):
            first_m = left_m + (index * layout.lines + 0.5) * layout.pitch_m
            row.append(build_block(frame, points, first_m, layout, motion))
    own_s = [[motion.time_s([leg.piece for leg in block.legs(block.min_c1)]) for block in row] for row in rows]
    for order in (1, -1)[: min(layout.blocks, 2)]:
        yield _Chain(*_quickest_chain(request, rows[::order], own_s[::order]), heading_rad)


def _quickest_chain(
    request: CoverageRequest, rows: Sequence[Sequence[Block]], own_s: Sequence[Sequence[float]]
) -> tuple[float, list[Block]]:
    """The least time from start to home by one block of each row, in the rows' order [s]; and those blocks.

    `own_s` are the blocks' times. By dynamic programming.
    """
    starts = [[block.start for block in row] for row in rows]
    ends = [[block.end for block in row] for row in rows]
    # least time up to block b of row i: T_i(b) = min_a (T_i−1(a) + turn(a, b)) + own_i(b), with a its predecessor
    total_s = np.array(own_s[0]) + from_start_s(request, starts[0])
    predecessors: list[FloatArray] = []
    for i in range(1, len(rows)):
        times = total_s[:, None] + request.motion.turns_s(ends[i - 1], starts[i])
        predecessors.append(times.argmin(axis=0))
        total_s = times.min(axis=0) + np.array(own_s[i])
    total_s = total_s + to_home_s(request, ends[-1])
    corner = int(total_s.argmin())
    chosen = [rows[-1][corner]]
    for row, predecessor in zip(reversed(rows[:-1]), reversed(predecessors), strict=True):
        corner = int(predecessor[corner])
        chosen.append(row[corner])
    return float(total_s.min()), chosen[::-1]


# --- lines in an order ------------------------------------------------------------------------------------------------


def line_costs(request: CoverageRequest, directed: Sequence[CoverageLeg]) -> LineCosts:
    """Costs of flying lines in any order and direction.

    Parameters
    ----------
    request : CoverageRequest
        For the motion, the start point and home.
    directed : sequence of CoverageLeg, length 2n
        Every line as one leg, followed by the same line in the other direction.

    Returns
    -------
    LineCosts
        [s], rounded to `TIE_DIGITS`.
    """
    directed = [leg.led(request.motion) for leg in directed]
    starts, ends = [leg.start for leg in directed], [leg.end for leg in directed]
    own_s = np.array([request.motion.time_s([leg.piece]) for leg in directed])
    between_s = request.motion.turns_s(ends, starts)
    costs = between_s, own_s, from_start_s(request, starts), to_home_s(request, ends)
    # rounding differs in a field that is turned or moved, and must not change the order
    return LineCosts(*(np.round(part, TIE_DIGITS) for part in costs))


class _LineSet(NamedTuple):
    """Lines at a heading, each in both directions, with their costs.

    `time_s` is that of a quick order, and counts lines that were lost to obstacles. `number` is the set's place among
    all that are tried, and decides between equal times.
    """

    time_s: float
    number: int
    heading_rad: float
    directed: list[CoverageLeg]
    costs: LineCosts


def _best_in_order(request: CoverageRequest, headings: Sequence[float], draft: bool) -> CoverageSolution:
    """The quickest order of lines at some headings: they are ordered quickly, and the best of these in full.

    Raises
    ------
    Infeasible
        If a heading needs too many lines, or no order is free.
    """
    sets = _quickest_sets(request, headings)
    if request.space is not None:
        return _free_in_order(request, request.space, sets, draft)
    solved = [(each, *best_order(each.costs)) for each in sets[:FULL_SEARCHES]]
    # of equal times, up to rounding, the heading that was tried first
    best, order, _ = min(solved, key=lambda found: (round(found[2], 9), found[0].number))
    return connected(request, DUBINS, best.heading_rad, [best.directed[i].with_leads(request.motion) for i in order])


def _quickest_sets(request: CoverageRequest, headings: Sequence[float]) -> list[_LineSet]:
    """Sets of lines at some headings, within obstacles and a boundary, by the time of a quick order."""
    motion, space, found = request.motion, request.space, list[_LineSet]()
    tried = [(heading, directed) for heading in headings for directed in _lines_at(request, heading)]
    for heading, directed in tried:
        lost_s = 0.0
        if space is not None:
            flown_m = sum(leg.piece.length_m for leg in directed[::2])
            directed = free_lines(directed[::2], space, motion)
            left_m = sum(leg.piece.length_m for leg in directed[::2])
            if left_m < MIN_LEFT * flown_m:
                continue
            lost_s = LOST_RATIO * (flown_m - left_m) / motion.airspeed_mps
        costs = line_costs(request, directed)
        found.append(_LineSet(quick_order(costs)[1] + lost_s, len(found), heading, directed, costs))
    return sorted(found, key=lambda each: each[:2])


def _free_in_order(
    request: CoverageRequest, space: FreeSpace, sets: Sequence[_LineSet], draft: bool
) -> CoverageSolution:
    """The path of the first of some sets, given the quickest first, that has an order whose turns are all free."""
    motion = request.motion
    failure: Infeasible = NotFree(
        "no line of the field has room for a turn out of the obstacles and inside the boundary"
    )
    for each in sets[:FREE_HEADINGS_TRIED]:
        try:
            led = [leg.led(motion) for leg in each.directed]
            order, _ = free_order(led, each.costs, free_turns(space, motion), draft=draft)
            return connected(request, DUBINS, each.heading_rad, [each.directed[i].with_leads(motion) for i in order])
        except Infeasible as error:
            failure = error
    raise failure


@functools.lru_cache(maxsize=4)
def free_turns(space: FreeSpace, motion: MotionLimits) -> FreeTurns:
    """Free turns with what they have found so far: the parts of a field have many turns in common."""
    return FreeTurns(space, motion)


def _lines_at(request: CoverageRequest, heading_rad: float) -> Iterator[list[CoverageLeg]]:
    """Lines over a field in both directions: one set across bays and holes, and one cut by them, if there are any."""
    swath_m = request.motion.swath_m
    grid = request.grid or LineGrid.over(request.field, heading_rad, swath_m, request.order_spacing_m or swath_m)
    extents = grid.extents(request.field)
    yield grid.directed(_without_gaps(extents))
    if any(len(spans) > 1 for spans in extents):
        yield grid.directed(extents)


def _without_gaps(extents: Sequence[Sequence[tuple[float, float]]]) -> list[list[tuple[float, float]]]:
    """Of each line one extent, from the start of its first one to the end of its last."""
    return [[(spans[0][0], spans[-1][1])] if spans else [] for spans in extents]


def _canonical_frame(field: Field, heading_rad: float) -> StripFrame:
    """The frame of a heading whose two axes point to the larger part of the field: from its middle to its centroid.

    So a field that is moved or mirrored has the same lines: its frame moves with it.
    """
    u, v = frame_of(heading_rad).into(np.array(field.outline)).T
    # centroid of a polygon: Σ (u_i + u_i+1) k_i / (3 Σ k_i), k_i = u_i v_i+1 − u_i+1 v_i
    cross = u * np.roll(v, -1) - np.roll(u, -1) * v
    signs = []  # by which u and v of that frame are multiplied
    for axis in (u, v):
        middle = float((axis.max() + axis.min()) / 2)
        centroid = float(((axis + np.roll(axis, -1)) * cross).sum() / (3 * cross.sum()))
        signs.append(1 if centroid >= middle - 1e-6 else -1)
    of_u, of_v = signs
    # u is flipped by `towards`, v by towards · hand: so hand = of_u of_v
    return frame_of(heading_rad, towards=of_u, hand=of_u * of_v)


# --- between lines ----------------------------------------------------------------------------------------------------


def _turn(request: CoverageRequest, end: Pose, start: Pose) -> list[CoverageLeg]:
    """The quickest turn from one pose to another that is free. Raises Infeasible where there is none."""
    motion = request.motion
    if request.space is not None:
        found = free_turns(request.space, motion).turn(end, start)
        if found is None:
            places = f"from {request.place_text(end)} to {request.place_text(start)}"
            raise NotFree(f"no way {places} is found that stays {request.limits_text}")
        return [CoverageLeg(piece) for piece in found.pieces]
    path = min(ordered(end, start, motion.min_radius_m), key=lambda path: motion.time_s(path.pieces))
    return [CoverageLeg(piece) for piece in path.pieces]


def _poses(end: Point | Pose) -> list[Pose]:
    """The poses that an end of the path may have: a pose itself, or a point with headings all round."""
    if len(end) == 3:
        return [end]
    return [(*end, math.remainder(2 * math.pi * k / FREE_HEADINGS, 2 * math.pi)) for k in range(FREE_HEADINGS)]


def from_start_s(request: CoverageRequest, starts: Sequence[Pose]) -> FloatArray:
    """Least time from the start point to each pose, at least that of the climb [s]; 0 where the start is free."""
    if request.way_out is None:
        return np.zeros(len(starts))
    climbed_s = 0.0 if request.climb_out is None else request.motion.time_s([request.climb_out.piece])
    ways_s = request.motion.turns_s(_poses(request.way_out), starts).min(axis=0)
    return np.asarray(np.maximum(ways_s, request.climb_s - climbed_s))


def to_home_s(request: CoverageRequest, ends: Sequence[Pose]) -> FloatArray:
    """Least time from each pose to the home point [s]; 0 where the end is free."""
    if request.way_back is None:
        return np.zeros(len(ends))
    return np.asarray(request.motion.turns_s(ends, _poses(request.way_back)).min(axis=1))


def _entry(request: CoverageRequest, start: Pose) -> list[CoverageLeg]:
    """The path from the start point to a pose, from the best heading."""
    point, motion = request.way_out, request.motion
    if point is None:
        return []
    poses = _poses(point)
    if len(point) == 2:
        poses += [(*point, heading) for heading in _tangents(point, start, motion.min_radius_m)]
    return _turn(request, poses[int(motion.turns_s(poses, [start])[:, 0].argmin())], start)


def _climbing_entry(request: CoverageRequest, start: Pose) -> list[CoverageLeg]:
    """The path from the start point to a pose, longer by a straight before it where the climb takes longer.

    Not where a circle takes less, or there is no room: what the climb lacks is then flown on circles.
    """
    motion, entry = request.motion, _entry(request, start)

    def way_s(legs: Sequence[CoverageLeg]) -> float:
        """Time of a way to the pose, the climb-out among it [s]."""
        return motion.time_s([leg.piece for leg in (request.climb_out, *legs) if leg is not None])

    lacks_s = request.climb_s - way_s(entry)
    if not entry or lacks_s <= 0:
        return entry
    x, y, heading = start
    metre_s = motion.time_s([straight((0.0, 0.0), (math.cos(heading), math.sin(heading)))])
    circle_s = motion.time_s([half_circle(start, 2 * motion.min_radius_m, 1)])  # as long as a whole one of the radius
    best, best_s = entry, way_s(entry) + max(lacks_s, circle_s)
    for share in BEFORE_SHARES:
        back_m = share * lacks_s / metre_s
        back = (x - back_m * math.cos(heading), y - back_m * math.sin(heading), heading)
        before = CoverageLeg(straight(back[:2], (x, y)))
        if request.space is None or request.space.has(polyline_m([before.piece])):
            with suppress(Infeasible):
                longer = [*_entry(request, back), before]
                if request.climb_s <= way_s(longer) < best_s:
                    best, best_s = longer, way_s(longer)
    return best


def _exit(request: CoverageRequest, end: Pose) -> list[CoverageLeg]:
    """The path from a pose to the home point, arriving at the best heading."""
    point, motion, (x, y, heading) = request.way_back, request.motion, end
    if point is None:
        return []
    poses = _poses(point)
    if len(point) == 2:
        # the tangents of arrival are those of a departure from home with all headings reversed
        backward = _tangents(point, (x, y, heading + math.pi), motion.min_radius_m)
        poses += [(*point, opposite + math.pi) for opposite in backward]
    return _turn(request, end, poses[int(motion.turns_s([end], poses)[0].argmin())])


def check_access(request: CoverageRequest) -> None:
    """Raise Infeasible where no line has a free way from the start, or none has one to the end.

    Only the nearest lines at one heading are tried: the check comes before the search, which takes long.
    """
    if request.space is None:
        return
    heading_rad = _tried_headings(request)[0] if request.heading_rad is None else request.heading_rad
    whole = next(_lines_at(request, heading_rad))[::2]
    lines = [leg.led(request.motion) for leg in free_lines(whole, request.space, request.motion)]
    starts, ends = [leg.start for leg in lines], [leg.end for leg in lines]
    # for the start and the end: its place, the poses of the lines there, the times between, and what finds a free way
    ways = (
        (request.way_out, starts, from_start_s(request, starts), _entry),
        (request.way_back, ends, to_home_s(request, ends), _exit),
    )
    for end, poses, times_s, find_way in ways if lines else ():
        for k in np.argsort(times_s)[:ACCESS_TRIED].tolist():
            with suppress(Infeasible):
                find_way(request, poses[k])
                break
        else:  # none of the nearest lines has a free way
            assert end is not None  # else any way is free
            message = (
                f"no way between the lines and {request.place_text(end)} is found that stays {request.limits_text}"
            )
            raise Infeasible(message, "another place or heading of it, or more room")


def _tangents(point: Point, pose: Pose, radius_m: float) -> list[float]:
    """Headings at a point from which a straight leads onto either turning circle of a pose, in its sense of turning."""
    found = []
    for turn in (1, -1):
        cx, cy = centre_m(pose, turn, radius_m)
        dx, dy = cx - point[0], cy - point[1]
        distance = math.hypot(dx, dy)
        if distance > radius_m:
            # the tangent is asin(r/d) off the direction of the centre, to the right of it for a left turn
            found.append(math.atan2(dy, dx) - turn * math.asin(radius_m / distance))
    return found
