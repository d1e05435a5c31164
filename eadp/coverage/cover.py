"""Coverage: a field in, a way that covers it out, by the Zamboni-like motion or by lines in a good order.

Headings, starting corners and patterns are compared by the time of flight: of the Zamboni-like motion at the lowest
c1, where it covers the field with the fewest lines. Between the lines of an order, and between blocks, turns are as
tight as the aircraft's.

Source: letter, Sec. IV-A; Dubins 1957 for the turns between lines.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Pose, lengths_m, ordered, times_s
from eadp.core.geometry.polygons import strip_extents
from eadp.coverage.line_order import best_order, quick_order
from eadp.coverage.swaths import CoverageLeg, CoveragePath, MotionLimits, StripFrame, frame_of, half_circle, straight
from eadp.coverage.zamboni import Block, BlockBounds, BlockLayout, BlockSummary, block_of, shapes, sketch
from eadp.errors import Infeasible
from eadp.models.field import Field

ZAMBONI, DUBINS, AUTO = "zamboni", "dubins", "auto"
PATTERNS = (ZAMBONI, DUBINS, AUTO)

PLAINLY_LONGER = 1.02
"""A Zamboni-like way that takes more than this much of the best order's time is passed over."""

GRID_DEG = 10
"""Headings looked at beside those of the hull's edges: steps from the longest of these [°]."""

NEAR_RAD = math.radians(1.0)
FINALISTS = 3
"""How many headings get the full search of an order."""

SHORTEST_LINE_M = 5.0
"""Lines over a corner of the field are made at least this long."""

LINES_LIMIT = 400
"""Most lines of a field."""

FREE_HEADINGS = 36

TIE_DIGITS = 6
"""Times that agree to so many decimals are equal [s]."""

Problem = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class CoverageRequest:
    """What is to be covered, and how.

    `heading_rad` None is for any, `start_m` and `home_m` None for none. Lines flown in an order lie `order_spacing_m`
    apart or less, a swath without.
    """

    field: Field
    motion: MotionLimits
    pattern: str = AUTO
    heading_rad: float | None = None
    start_m: Point | None = None
    home_m: Point | None = None
    order_spacing_m: float | None = None


@dataclass(frozen=True)
class PathSection:
    """A stretch of the way: legs flown as they are, or a block flown lap by lap."""

    legs: tuple[CoverageLeg, ...] = ()
    block: Block | None = None


@dataclass(frozen=True)
class CoverageSolution:
    """A way that covers a field.

    `time_s` is at the lowest c1, `access_s` what of it the ways from the start and home take. `other_share` says how
    many times as long the other pattern would take, these left out, where both were looked at.
    """

    pattern: str
    heading_rad: float
    sections: tuple[PathSection, ...]
    time_s: float
    other_share: float | None = None
    access_s: float = 0.0

    def way(self, c1: float) -> CoveragePath:
        """All legs at a fixed parameter."""
        way = CoveragePath()
        for section in self.sections:
            if section.block is None:
                way.legs += section.legs
            else:
                way.legs += section.block.legs(max(c1, section.block.lowest_c1))
        return way

    @property
    def blocks(self) -> list[Block]:
        """The blocks flown lap by lap."""
        return [section.block for section in self.sections if section.block is not None]

    @property
    def lowest_c1(self) -> float:
        """The lowest c1 of any block; 0 without."""
        return min((block.lowest_c1 for block in self.blocks), default=0.0)


def cover(request: CoverageRequest) -> CoverageSolution:
    """The quickest way found that covers a field.

    Raises
    ------
    Infeasible
        If the wind is too strong, the field is too narrow for the pattern asked for, or needs too many lines.
    """
    field, motion = request.field, request.motion
    if math.hypot(*motion.wind_mps) >= motion.airspeed_mps:
        raise Infeasible(
            f"a wind of {math.hypot(*motion.wind_mps):g} m/s is not slower than the aircraft's {motion.airspeed_mps:g}"
        )
    headings = [request.heading_rad] if request.heading_rad is not None else list(_headings(field))
    if request.pattern == DUBINS:
        return _best_in_order(request, headings)
    zamboni = _best_zamboni(request, headings)
    if request.pattern == ZAMBONI:
        if zamboni is None:
            least = 4 * motion.min_radius_m + 2 * motion.swath_m
            raise Infeasible(
                f"the field is too narrow for the Zamboni-like motion: across its lines it needs about {least:.0f} m"
            )
        return zamboni
    try:
        order = _best_in_order(request, headings)
    except Infeasible:
        if zamboni is None:
            raise
        return zamboni
    if zamboni is None:
        return order
    # ways to the field and home are much the same for both
    laps_s, lines_s = zamboni.time_s - zamboni.access_s, order.time_s - order.access_s
    if laps_s <= PLAINLY_LONGER * lines_s:
        return replace(zamboni, other_share=lines_s / laps_s)
    return replace(order, other_share=laps_s / lines_s)


def _headings(field: Field) -> Iterator[float]:
    """Headings in [0, π) to look at: of the hull's edges, longest first, and a grid from the longest."""
    hull = _hull(np.array(field.outline))
    edges = np.roll(hull, -1, axis=0) - hull
    found: list[float] = []
    longest = edges[np.argsort(-np.round(np.hypot(edges[:, 0], edges[:, 1]), TIE_DIGITS), kind="stable")]
    first = math.atan2(longest[0, 1], longest[0, 0])
    turned = [math.atan2(dy, dx) for dx, dy in longest.tolist()]
    steps = [math.radians(sign * k) for k in range(GRID_DEG, 91, GRID_DEG) for sign in (1, -1)]
    for heading in [*turned, *(first + step for step in steps)]:
        heading %= math.pi
        if all(abs(math.remainder(heading - other, math.pi)) > NEAR_RAD for other in found):
            found.append(heading)
            yield heading


def _hull(points: FloatArray) -> FloatArray:
    """The convex hull's vertices, counter-clockwise."""
    from scipy.spatial import ConvexHull

    return np.asarray(points[ConvexHull(points).vertices])


# --- the Zamboni-like motion ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Corner:
    """A block of a shape, the `index`-th across the field, flown from one of its four corners."""

    heading_rad: float
    shape: BlockLayout
    index: int
    towards: int
    hand: int

    def frame(self) -> StripFrame:
        """The block's frame."""
        return frame_of(self.heading_rad, self.towards, self.hand)


def _best_zamboni(request: CoverageRequest, headings: Sequence[float]) -> CoverageSolution | None:
    """The quickest Zamboni-like way of some headings; None where the field is too narrow in all."""
    found = [way for heading in headings for way in _zamboni_at(request, heading)]
    if not found:
        return None
    least = min(time_s for time_s, _ in found)
    corners = next(corners for time_s, corners in found if time_s <= least * (1 + 1e-9))
    blocks = [_built(request, corner) for corner in corners]
    sections: list[PathSection] = []
    at: Pose | None = None
    for block in blocks:
        before = _entry(request, block.start()) if at is None else _transit(request.motion, at, block.start())
        sections += [PathSection(tuple(before))] if before else []
        sections.append(PathSection(block=block))
        at = block.end()
    assert at is not None
    home = _exit(request, at)
    sections += [PathSection(tuple(home))] if home else []
    access = [leg.piece for leg in (*_entry(request, blocks[0].start()), *home)]
    solution = CoverageSolution(
        ZAMBONI, corners[0].heading_rad, tuple(sections), 0.0, access_s=request.motion.time_s(access)
    )
    return replace(solution, time_s=request.motion.time_s(solution.way(solution.lowest_c1).pieces))


def _built(request: CoverageRequest, corner: _Corner) -> Block:
    frame, shape = corner.frame(), corner.shape
    points = frame.into(np.array(request.field.outline))
    first = float(points[:, 0].min())
    index = corner.index if corner.towards == 1 else shape.blocks - 1 - corner.index
    first += (index * shape.lines + 0.5) * shape.pitch_m
    return block_of(frame, BlockBounds(points), first, shape, request.motion)


def _zamboni_at(request: CoverageRequest, heading: float) -> Iterator[tuple[float, list[_Corner]]]:
    """Ways over blocks at a heading, each from its best corner: the time at the lowest c1 [s], and the corners."""
    motion = request.motion
    points = frame_of(heading).into(np.array(request.field.outline))
    left, width = float(points[:, 0].min()), float(np.ptp(points[:, 0]))
    splits = shapes(width, motion)
    if not splits:
        return
    sides = BlockBounds(points)
    paces = {
        (towards, hand): _Pace.of(frame_of(heading, towards, hand), motion) for towards in (1, -1) for hand in (1, -1)
    }
    for shape in splits:
        lines = left + (np.arange(shape.blocks * shape.lines) + 0.5) * shape.pitch_m
        reach = shape.widest_m(motion)
        top, low = sides.above.over(lines, reach), -sides.below.over(lines, reach)
        rows = []
        for index in range(shape.blocks):
            own = slice(index * shape.lines, (index + 1) * shape.lines)
            row = []
            for (towards, hand), pace in paces.items():
                # v runs along the heading where u runs to its right and in a mirror of the other: towards · hand = 1
                begin, end = (low[own], top[own]) if towards * hand == 1 else (-top[own], -low[own])
                u = np.asarray(towards * lines[own], dtype=np.float64)
                sketched = sketch(shape, u[::towards], begin[::towards], end[::towards])
                row.append((_Corner(heading, shape, index, towards, hand), sketched, pace.time_s(sketched)))
            rows.append(row)
        for order in (rows, rows[::-1])[: min(shape.blocks, 2)]:
            yield _chain(request, order)


@dataclass(frozen=True)
class _Pace:
    """Times of a frame's motions: of a metre up and down its lines, and of half a circle of radius 1 each way [s]."""

    up_s: float
    down_s: float
    first_turn_s: float
    second_turn_s: float

    @classmethod
    def of(cls, frame: StripFrame, motion: MotionLimits) -> _Pace:
        """In the motion's wind."""
        up = frame.pose_out(0.0, 0.0, math.pi / 2)
        down = frame.pose_out(0.0, 0.0, -math.pi / 2)
        return cls(
            motion.time_s([straight((0.0, 0.0), frame.out(0.0, 1.0))]),
            motion.time_s([straight((0.0, 0.0), frame.out(0.0, -1.0))]),
            motion.time_s([half_circle(up, 1.0, -frame.hand)]),
            motion.time_s([half_circle(down, 1.0, -frame.hand)]),
        )

    def time_s(self, block: BlockSummary) -> float:
        """Time of a block at its lowest c1 [s]."""
        return (
            block.up_m * self.up_s
            + block.down_m * self.down_s
            + block.first_turns_m * self.first_turn_s
            + block.second_turns_m * self.second_turn_s
        )


def _chain(
    request: CoverageRequest, rows: Sequence[Sequence[tuple[_Corner, BlockSummary, float]]]
) -> tuple[float, list[_Corner]]:
    """The corner of each block, in a given order of blocks, that makes the whole quickest."""
    starts = [[_start_of(*pair) for pair in row] for row in rows]
    ends = [[_end_of(*pair) for pair in row] for row in rows]
    total = np.array([time_s for _, _, time_s in rows[0]]) + _to_start(request, starts[0])
    came: list[FloatArray] = []
    for i in range(1, len(rows)):
        ways = total[:, None] + _costs(request.motion, ends[i - 1], starts[i])
        came.append(ways.argmin(axis=0))
        total = ways.min(axis=0) + np.array([time_s for _, _, time_s in rows[i]])
    total = total + _to_home(request, ends[-1])
    corner = int(total.argmin())
    chosen = [rows[-1][corner][0]]
    for row, sources in zip(reversed(rows[:-1]), reversed(came), strict=True):
        corner = int(sources[corner])
        chosen.append(row[corner][0])
    return float(total.min()), chosen[::-1]


def _start_of(corner: _Corner, block: BlockSummary, _: float) -> Pose:
    return corner.frame().pose_out(*block.start_m, math.pi / 2)


def _end_of(corner: _Corner, block: BlockSummary, _: float) -> Pose:
    return corner.frame().pose_out(*block.end_m, math.pi / 2 if block.ends_up else -math.pi / 2)


# --- lines in an order ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Lines:
    """Lines to be flown in any order and direction: each one's two ends, and gaps from the first on [m]."""

    heading_rad: float
    ends: tuple[tuple[Point, Point], ...]
    gaps_m: tuple[tuple[tuple[float, float], ...], ...] = ()

    def leg(self, way: int) -> CoverageLeg:
        """A directed line as it is flown."""
        line, backward = divmod(way, 2)
        begin, end = self.ends[line]
        gaps = self.gaps_m[line] if self.gaps_m else ()
        if not backward:
            return CoverageLeg(straight(begin, end), True, gaps)
        piece = straight(end, begin)
        return CoverageLeg(piece, True, tuple((piece.length_m - b, piece.length_m - a) for a, b in reversed(gaps)))

    def problem(self, request: CoverageRequest) -> Problem:
        """Costs as `line_order` has them [s]: between directed lines, of each, from the start and to home."""
        motion = request.motion
        starts, stops, own = [], [], []
        for a, b in self.ends:
            for begin, end in ((a, b), (b, a)):
                piece = straight(begin, end)
                starts.append(piece.start)
                stops.append(piece.end)
                own.append(motion.time_s([piece]))
        costs = _costs(motion, stops, starts), np.array(own), _to_start(request, starts), _to_home(request, stops)
        # what rounding parts is equal, so that a field turned or moved has the same order
        between, alone, before, after = (np.round(part, TIE_DIGITS) for part in costs)
        return between, alone, before, after


def _best_in_order(request: CoverageRequest, headings: Sequence[float]) -> CoverageSolution:
    """The quickest order of lines at some headings."""
    looked_at: list[tuple[float, int, _Lines, Problem]] = []
    best = math.inf
    for heading in headings:
        for lines in _lines_at(request, heading):
            # at least: every line, and between two lines half a turn
            turn = math.pi * request.motion.min_radius_m / request.motion.airspeed_mps
            if request.motion.calm:
                flown = sum(math.dist(*ends) for ends in lines.ends) / request.motion.airspeed_mps
                if flown + (len(lines.ends) - 1) * turn * 0.6 > best:
                    continue
            problem = lines.problem(request)
            _, time_s = quick_order(*problem)
            best = min(best, time_s)
            looked_at.append((time_s, len(looked_at), lines, problem))
    looked_at.sort(key=lambda item: item[:2])
    solutions = []
    for _, index, lines, problem in looked_at[:FINALISTS]:
        order, time_s = best_order(*problem)
        solutions.append((time_s, index, lines, order))
    _, _, lines, order = min(solutions, key=lambda item: (round(item[0], 9), item[1]))
    legs = _legs_in_order(request, lines, order)
    over = [i for i, leg in enumerate(legs) if leg.sensing]
    access = [leg.piece for leg in (*legs[: over[0]], *legs[over[-1] + 1 :])]
    time_s, access_s = (request.motion.time_s(pieces) for pieces in ([leg.piece for leg in legs], access))
    return CoverageSolution(DUBINS, lines.heading_rad, (PathSection(tuple(legs)),), time_s, access_s=access_s)


def _lines_at(request: CoverageRequest, heading: float) -> Iterator[_Lines]:
    """Lines over the whole field; where bays or holes part them, also as lines of their own."""
    motion, field = request.motion, request.field
    frame = _own_frame(field, heading)
    rings = [frame.into(np.array(ring)) for ring in (field.outline, *field.holes)]
    across = rings[0][:, 0]
    left, width = float(across.min()), float(np.ptp(across))
    spacing = request.order_spacing_m or motion.swath_m
    count = max(1, math.ceil((width - motion.swath_m - 1e-6) / spacing) + 1)
    if count > LINES_LIMIT:
        raise Infeasible(f"the field needs {count} lines, more than {LINES_LIMIT}")
    half = min(width, motion.swath_m) / 2
    middles = np.linspace(left + half, left + width - half, count)
    # what two lines both reach is the nearer one's
    edges = np.array([left, *((middles[:-1] + middles[1:]) / 2), left + width])
    extents = strip_extents(rings, edges)
    whole = [(u, parts) for u, parts in zip(middles.tolist(), extents, strict=True) if parts]
    yield _lines(frame, heading, whole)
    parted = [(u, [part]) for u, parts in whole for part in parts]
    if len(parted) > len(whole):
        yield _lines(frame, heading, parted)


def _own_frame(field: Field, heading: float) -> StripFrame:
    """The frame of a heading whose axes point to where more of the field is: the same for a field moved or mirrored."""
    points = frame_of(heading).into(np.array(field.outline))
    u, v = points.T
    cross = u * np.roll(v, -1) - np.roll(u, -1) * v
    signs = []
    for axis in (u, v):
        middle = float((axis.max() + axis.min()) / 2)
        centre = float(((axis + np.roll(axis, -1)) * cross).sum() / (3 * cross.sum()))
        signs.append(1 if centre >= middle - 1e-6 else -1)
    across, along = signs
    return frame_of(heading, across, across * along)


def _lines(frame: StripFrame, heading: float, spans: Sequence[tuple[float, list[tuple[float, float]]]]) -> _Lines:
    """Lines at places across, each over parts of the field and the gaps between them."""
    ends, gaps = [], []
    for u, parts in spans:
        low, high = parts[0][0], parts[-1][1]
        short = max(0.0, SHORTEST_LINE_M - (high - low)) / 2  # a corner's line is no point
        ends.append((frame.out(u, low - short), frame.out(u, high + short)))
        gaps.append(tuple((a[1] - low + short, b[0] - low + short) for a, b in itertools.pairwise(parts)))
    return _Lines(heading, tuple(ends), tuple(gaps))


def _legs_in_order(request: CoverageRequest, lines: _Lines, order: Sequence[int]) -> list[CoverageLeg]:
    """The legs of lines flown in an order of directed lines."""
    legs: list[CoverageLeg] = []
    at: Pose | None = None
    for way in order:
        leg = lines.leg(way)
        legs += _entry(request, leg.piece.start) if at is None else _transit(request.motion, at, leg.piece.start)
        legs.append(leg)
        at = leg.piece.end
    assert at is not None
    return legs + _exit(request, at)


def same_lines(request: CoverageRequest, solution: CoverageSolution, c1: float) -> Problem:
    """A way's lines as a problem of their order, with the tightest turns between them.

    Parameters
    ----------
    request, solution : Request, Solution
    c1 : float
        The path parameter at which the lines are taken.

    Returns
    -------
    costs, own, first, last : array
        As `line_order.best_order`'s [s].
    """
    ends = tuple((leg.piece.start[:2], leg.piece.end[:2]) for leg in solution.way(c1).legs if leg.sensing)
    return _Lines(solution.heading_rad, _across(ends, solution.heading_rad)).problem(request)


def _across(ends: tuple[tuple[Point, Point], ...], heading: float) -> tuple[tuple[Point, Point], ...]:
    """Lines numbered across the field, all one way round."""
    frame = frame_of(heading)
    (ux, uy), (vx, vy) = frame.across, frame.along
    upward = [tuple(sorted(pair, key=lambda p: vx * p[0] + vy * p[1])) for pair in ends]
    return tuple((a, b) for a, b in sorted(upward, key=lambda pair: ux * pair[0][0] + uy * pair[0][1]))


# --- between lines ----------------------------------------------------------------------------------------------------


def _costs(motion: MotionLimits, ends: Sequence[Pose], starts: Sequence[Pose]) -> FloatArray:
    """Times of the quickest turns from each pose to each [s]."""
    if motion.calm:
        return lengths_m(ends, starts, motion.min_radius_m) / motion.airspeed_mps
    return times_s(ends, starts, motion.min_radius_m, motion.airspeed_mps, motion.wind_mps)


def _transit(motion: MotionLimits, end: Pose, start: Pose) -> list[CoverageLeg]:
    """The quickest turn from a pose to another."""
    path = min(ordered(end, start, motion.min_radius_m), key=lambda path: motion.time_s(path.pieces))
    return [CoverageLeg(piece) for piece in path.pieces]


def _fan(point: Point) -> list[Pose]:
    """A point with headings all round."""
    return [(*point, math.remainder(2 * math.pi * k / FREE_HEADINGS, 2 * math.pi)) for k in range(FREE_HEADINGS)]


def _to_start(request: CoverageRequest, starts: Sequence[Pose]) -> FloatArray:
    if request.start_m is None:
        return np.zeros(len(starts))
    return np.asarray(_costs(request.motion, _fan(request.start_m), starts).min(axis=0))


def _to_home(request: CoverageRequest, ends: Sequence[Pose]) -> FloatArray:
    if request.home_m is None:
        return np.zeros(len(ends))
    return np.asarray(_costs(request.motion, ends, _fan(request.home_m)).min(axis=1))


def _entry(request: CoverageRequest, start: Pose) -> list[CoverageLeg]:
    """The way from the start point to a pose, from the best heading."""
    if request.start_m is None:
        return []
    at = request.start_m
    headings = [*_fan(at), *((*at, heading) for heading in _towards(at, start, request.motion.min_radius_m))]
    return _transit(request.motion, headings[int(_costs(request.motion, headings, [start])[:, 0].argmin())], start)


def _exit(request: CoverageRequest, end: Pose) -> list[CoverageLeg]:
    """The way from a pose to the home point, arriving at the best heading."""
    if request.home_m is None:
        return []
    at, (x, y, heading) = request.home_m, end
    backward = _towards(at, (x, y, heading + math.pi), request.motion.min_radius_m)
    headings = [*_fan(at), *((*at, turned + math.pi) for turned in backward)]
    return _transit(request.motion, end, headings[int(_costs(request.motion, [end], headings)[0].argmin())])


def _towards(point: Point, pose: Pose, radius_m: float) -> list[float]:
    """Headings in which a straight from a point meets the circles on which a pose is reached, along them."""
    x, y, heading = pose
    found = []
    for turn in (1, -1):
        dx, dy = x - turn * radius_m * math.sin(heading) - point[0], y + turn * radius_m * math.cos(heading) - point[1]
        distance = math.hypot(dx, dy)
        if distance > radius_m:
            found.append(math.atan2(dy, dx) - turn * math.asin(radius_m / distance))
    return found
