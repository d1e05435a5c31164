"""The Zamboni-like motion over a block of a field: line, circle, line, circle, lap by lap, all turns to one side.

The letter's Algorithm 1, with corrections where its print is wrong or incomplete:

- Both lines that a turn joins end at the same level, the farther that either needs, so that the turn is tangent to
  both. (The print ends them at the polygon, where a half circle meets the second line only if the edge is square to the
  lines.)
- A line reaches as far as the whole strip that it covers, not as far as its middle.
- The line spacing d(c1) = x_d + 2(r − √(r² + c1)) leaves no gap only while it is at most the swath: c1 has that bound
  besides the one of the smallest radius. A width is divided so that lines can be spaced evenly over the whole of it
  within both.
- Laps end when the ground is covered, whatever the parameters were on the way, and the last one is drawn in to where
  the block ends; a fixed final point would be missed or reached too soon.

Source: letter, Sec. IV-A, Alg. 1, Eqs. 14 and 15.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray
from eadp.core.geometry.dubins import Pose, straight
from eadp.errors import Infeasible
from eadp.survey.swaths import MIN_LINE_M, CoverageLeg, MotionLimits, StripFrame, half_circle

C1_STEP = 1e-6
"""Bounds of c1 are whole multiples of this."""

MAX_LINES = 5000
"""Largest number of lines of a field at c1 = 0."""

END_TOLERANCE_M = 1e-6
"""A lap closer than this to the end of its block is at the end."""

SAME_M = 1e-9
"""Distance within which two abscissae are one."""

EDGE_M = 1e-6
"""Overlap with a strip, along its edge, below which an area belongs to the neighbouring strip."""

UP = math.pi / 2


@dataclass(frozen=True)
class BlockLayout:
    """The division of a width into `blocks` of equal width, each of `lines` lines or more, `pitch_m` apart.

    The first line of a block lies half a pitch inside it. Each lap flies a first line and a second one. The first
    `firsts` lines across a block are the laps' first lines, the others their second lines; with an odd number of lines
    the last lap has no second line.
    """

    blocks: int
    lines: int
    pitch_m: float

    @property
    def firsts(self) -> int:
        """The number of laps at the lowest c1."""
        return (self.lines + 1) // 2

    @property
    def first_radius_m(self) -> float:
        """r1: radius of the turn from a lap's first line to its second [m], half the distance of the two."""
        return self.firsts * self.pitch_m / 2

    @property
    def second_radius_m(self) -> float:
        """r2: radius of the turn from a lap to the next at the lowest c1 [m]."""
        return self.first_radius_m - self.pitch_m / 2

    @property
    def travel_m(self) -> float:
        """The distance from the first lap to the last [m]."""
        return (self.firsts - 1) * self.pitch_m

    def spacing_m(self, motion: MotionLimits) -> float:
        """x_d: the shift from lap to lap at c1 = 0 [m], a whole part of the travel."""
        wanted = motion.spacing_m * self.pitch_m / motion.swath_m
        return self.travel_m / math.ceil(self.travel_m / wanted - 1e-9)

    def max_spacing_m(self, motion: MotionLimits) -> float:
        """The largest shift from lap to lap [m] that leaves no gap, and r2 no less than `min_radius_m`.

        It is a pitch or more, so that a lap is saved before the lowest c1 is reached. With an odd number of lines the
        last second line may lie one shift before the end, so that half of its swath must reach the block's edge.
        """
        by_swath = motion.swath_m if self.lines % 2 == 0 else (motion.swath_m + self.pitch_m) / 2
        return max(self.pitch_m, min(by_swath, 2 * (self.first_radius_m - motion.min_radius_m)))


@dataclass(frozen=True)
class PiecewiseLinear:
    """A piecewise linear function: levels [m] at knots `places_m` [m]."""

    places_m: tuple[float, ...]
    levels_m: tuple[float, ...]

    def at(self, place_m: ArrayLike) -> FloatArray:
        """The level at an abscissa [m], constant beyond the ends."""
        return np.asarray(np.interp(np.asarray(place_m, dtype=float), self.places_m, self.levels_m))


@dataclass(frozen=True)
class Block:
    """A part of a field that one series of laps covers, in a frame in which it is flown from u = `first_m` up.

    Lap by lap the first line moves from `first_m` to `first_m + travel_m`; the second line lies twice the first
    circle's radius farther. A level is the v at which lines end and a turn begins [m], over the lap's position from 0
    to `travel_m`: `top` is that of the first turn; that of the second turn is the lower one of `low_second` at the
    lap's position and `low_first` at the next lap's. Where the last lap has no second line, its first one ends at
    `last_top_m`.
    """

    frame: StripFrame
    layout: BlockLayout
    spacing_m: float
    max_spacing_m: float
    first_m: float
    top: PiecewiseLinear
    low_first: PiecewiseLinear
    low_second: PiecewiseLinear
    last_top_m: float

    @property
    def first_radius_m(self) -> float:
        """r1: the first circle's radius [m]."""
        return self.layout.first_radius_m

    @property
    def radius_m(self) -> float:
        """r: the second circle's radius at c1 = 0 [m]. Source: letter, Sec. IV-A: r1 = r + x_d/2."""
        return self.first_radius_m - self.spacing_m / 2

    @property
    def travel_m(self) -> float:
        """The distance from the first lap to the last [m]."""
        return self.layout.travel_m

    @property
    def ends_on_second(self) -> bool:
        """Whether the last lap has a second line."""
        return self.layout.lines % 2 == 0

    @property
    def min_c1(self) -> float:
        """The lowest c1, at which the shift from lap to lap is largest."""
        # √(r² + c1) ≥ r1 − d/2
        lowest = (self.first_radius_m - self.max_spacing_m / 2) ** 2 - self.radius_m**2
        return min(0.0, round(math.ceil(lowest / C1_STEP - 1e-9) * C1_STEP, 6))

    def spacing_at(self, c1: float) -> float:
        """d(c1): the shift from lap to lap [m]. Source: letter, Sec. IV-A."""
        # d = x_d + 2(r − √(r² + c1))
        return self.spacing_m + 2 * (self.radius_m - math.sqrt(self.radius_m**2 + c1))

    def next_m(self, here_m: float, step_m: float) -> float:
        """The position of the next lap [m]: a step on, but not beyond the end nor within `END_TOLERANCE_M` of it."""
        return self.travel_m if here_m + step_m >= self.travel_m - END_TOLERANCE_M else here_m + step_m

    def low(self, here_m: float, next_m: float) -> float:
        """The level of the turn from one lap to the next [m]."""
        return float(min(self.low_second.at(here_m), self.low_first.at(next_m)))

    @property
    def start(self) -> Pose:
        """The pose at the start of the first line."""
        return self.frame.pose_out(self.first_m, float(self.low_first.at(0.0)), UP)

    @property
    def end(self) -> Pose:
        """The pose at the end of the last line."""
        u = self.first_m + self.travel_m
        if self.ends_on_second:
            return self.frame.pose_out(u + 2 * self.first_radius_m, float(self.low_second.at(self.travel_m)), -UP)
        return self.frame.pose_out(u, self.last_top_m, UP)

    def legs(self, c1: Sequence[float] | float) -> list[CoverageLeg]:
        """The legs at a fixed c1, or at one c1 for each lap, the last of which holds for the rest."""
        values = [c1] if isinstance(c1, float | int) else list(c1)
        legs: list[CoverageLeg] = []
        # of the present lap: its position, its number from 0, and the level at which its first line starts
        here_m, lap, start_m = 0.0, 0, float(self.low_first.at(0.0))
        while here_m < self.travel_m - END_TOLERANCE_M:
            next_m = self.next_m(here_m, self.spacing_at(values[min(lap, len(values) - 1)]))
            end_m = self.low(here_m, next_m)
            legs += self._lap(here_m, start_m, end_m)
            second_radius_m = self.first_radius_m - (next_m - here_m) / 2
            legs.append(CoverageLeg(half_circle(legs[-1].end, second_radius_m, -self.frame.hand)))
            here_m, lap, start_m = next_m, lap + 1, end_m
        return legs + self.last_lap(start_m)

    def last_lap(self, low_m: float | None = None) -> list[CoverageLeg]:
        """The last lap: line, turn and line, or a first line alone.

        It starts at the level of the turn before, `low_m` [m], by default at the level that its first line needs.
        """
        low = float(self.low_first.at(self.travel_m)) if low_m is None else low_m
        if self.ends_on_second:
            return self._lap(self.travel_m, low, float(self.low_second.at(self.travel_m)))
        u = self.first_m + self.travel_m
        return [CoverageLeg(straight(self.frame.out(u, low), self.frame.out(u, self.last_top_m)), True)]

    def _lap(self, here_m: float, start_m: float, end_m: float) -> list[CoverageLeg]:
        """Line, half circle and line of the lap at a position, from a level to another [m]."""
        u, top = self.first_m + here_m, float(self.top.at(here_m))
        first = straight(self.frame.out(u, start_m), self.frame.out(u, top))
        turn = half_circle(self.frame.pose_out(u, top, UP), self.first_radius_m, -self.frame.hand)
        across = u + 2 * self.first_radius_m
        second = straight(self.frame.out(across, top), self.frame.out(across, end_m))
        return [CoverageLeg(first, True), CoverageLeg(turn), CoverageLeg(second, True)]


def layouts(width_m: float, motion: MotionLimits) -> list[BlockLayout]:
    """Divisions of a width into blocks of equal width; none of a width below about 4 r_min + 2 d.

    The number of blocks is the one that keeps the second circle's radius at or below the ideal one, or one fewer; the
    number of lines is the smallest possible, or one more. Raises Infeasible where lines are more than `MAX_LINES`.
    """
    # a block is 4 r1 wide, r1 = r + x_d/2, with the ideal radius r and the spacing x_d at c1 = 0
    max_blocks = max(1, math.ceil(width_m / (4 * motion.radius_m + 2 * motion.spacing_m) - 1e-9))
    found = []
    for blocks in range(max_blocks, max(0, max_blocks - 2), -1):
        min_lines = max(2, math.ceil(width_m / (blocks * motion.swath_m) - 1e-9))
        for lines in (min_lines, min_lines + 1):
            layout = BlockLayout(blocks, lines, width_m / (blocks * lines))
            if layout.second_radius_m >= motion.min_radius_m - 1e-9 and layout.firsts > 1:
                found.append(layout)
    for layout in found:
        count = 2 * layout.blocks * (1 + round(layout.travel_m / layout.spacing_m(motion)))
        if count > MAX_LINES:
            raise Infeasible(f"the field needs about {count} lines at c1 = 0, more than {MAX_LINES}")
    return found


def edges_of(polygon_m: FloatArray) -> FloatArray:
    """The edges of a polygon that are not upright.

    Parameters
    ----------
    polygon_m : array, shape (n, 2)
        Its vertices (u, v) [m], in order, either way round.

    Returns
    -------
    array, shape (5, k)
        Of each the least and the greatest u, u and v where it starts [m], and its slope.
    """
    starts, ends = polygon_m, np.concatenate([polygon_m[1:], polygon_m[:1]])
    own = np.abs(ends[:, 0] - starts[:, 0]) > SAME_M  # an upright one has its ends in common with others
    (u0, v0), (u1, v1) = starts[own].T, ends[own].T
    return np.stack([np.minimum(u0, u1), np.maximum(u0, u1), u0, v0, (v1 - v0) / (u1 - u0)])


def top_m(edges: FloatArray, centres_m: ArrayLike, width_m: float) -> FloatArray:
    """The greatest v of a polygon in strips along v.

    Parameters
    ----------
    edges : array, shape (5, n)
        Of `edges_of`.
    centres_m : array, shape (k,)
        Middles u of the strips [m].
    width_m : float
        Their width w: from u − w/2 to u + w/2 [m].

    Returns
    -------
    array, shape (k,)
        [m]; −∞ for a strip outside the polygon.
    """
    left, right, u0, v0, slope = edges
    # of each strip, row, with each edge, column: the v at both ends of what they share
    u = np.atleast_1d(np.asarray(centres_m, dtype=float))[:, None]
    low, high = np.maximum(u - width_m / 2 + EDGE_M, left), np.minimum(u + width_m / 2 - EDGE_M, right)
    higher = np.maximum(v0 + slope * (low - u0), v0 + slope * (high - u0))
    return np.asarray(np.where(low <= high, higher, -np.inf).max(axis=1))


def levels_above(
    polygons: list[tuple[FloatArray, float]], length_m: float, width_m: float, slack_m: float = 0.3
) -> PiecewiseLinear:
    """An upper bound of the levels that strips moving together reach, with few knots.

    Parameters
    ----------
    polygons : list of (array, float)
        The edges of each, as of `edges_of`, with where its strip's middle is at the start [m].
    length_m, width_m : float
        How far the strips move, and how wide they are [m].
    slack_m : float
        Mean excess of the bound between knots that is allowed for fewer knots [m].

    Returns
    -------
    PiecewiseLinear
        Over 0 to `length_m`.
    """
    knots = [0.0, length_m]
    for edges, first in polygons:
        corners = edges[:2].ravel() - first
        inside = width_m / 2 - 2 * EDGE_M  # so that a strip contains a corner at the corner's knots
        knots += [*(corners - inside), *(corners + inside)]
    places = np.unique(np.clip(knots, 0.0, length_m))
    places = places[np.concatenate(([True], np.diff(places) > 1e-6))]
    places[-1] = length_m
    # between knots the reach of a strip is a maximum of lines, which is convex: a chord lies above it
    levels = [_filled(places, top_m(edges, first + places, width_m)) for edges, first in polygons]
    return _thinned(places.tolist(), np.max(levels, axis=0).tolist(), slack_m)


def _filled(places: FloatArray, levels: FloatArray) -> FloatArray:
    """Levels where a strip lies outside the polygon: interpolated from where it overlaps."""
    known = np.isfinite(levels)
    return np.interp(places, places[known], levels[known])


def _thinned(places: list[float], levels: list[float], slack_m: float) -> PiecewiseLinear:
    """Remove knots under the chord of their neighbours, those of least cost first."""
    while len(places) > 2:
        # the knot of least mean rise of the bound, and that rise; -1 for none
        cheapest, rise_of_cheapest = -1, slack_m
        for i in range(1, len(places) - 1):
            share = (places[i] - places[i - 1]) / (places[i + 1] - places[i - 1])
            rise = levels[i - 1] + share * (levels[i + 1] - levels[i - 1]) - levels[i]
            if -EDGE_M <= rise <= 2 * rise_of_cheapest:  # a triangle's mean height is half its height
                cheapest, rise_of_cheapest = i, rise / 2
        if cheapest < 0:
            break
        del places[cheapest], levels[cheapest]
    return PiecewiseLinear(tuple(places), tuple(levels))


def build_block(
    frame: StripFrame, polygon_m: FloatArray, first_m: float, layout: BlockLayout, motion: MotionLimits
) -> Block:
    """The block whose first line is at u = `first_m` of a frame, over a polygon of it, shape (n, 2)."""
    # a turn begins beyond the ground by a lead-in; from below it is seen upside down, by −v
    beyond = np.array([0.0, motion.lead_in_m])
    above, below = edges_of(polygon_m + beyond), edges_of(polygon_m * np.array([1.0, -1.0]) + beyond)
    # each level holds for the whole strip under a line, `strip_m` wide at most, while the line moves over `travel`
    travel = layout.travel_m
    second = first_m + 2 * layout.first_radius_m
    strip_m = layout.max_spacing_m(motion)
    top = levels_above([(above, first_m), (above, second)], travel, strip_m)
    low_first = _negated(levels_above([(below, first_m)], travel, strip_m))
    low_second = _negated(levels_above([(below, second)], travel, strip_m))
    # in a corner, the upper turn is raised until both lines below it have the smallest length
    knots = sorted({*top.places_m, *low_first.places_m, *low_second.places_m})
    floor = np.maximum(low_first.at(knots), low_second.at(knots)) + MIN_LINE_M
    if np.any(top.at(knots) < floor):
        top = PiecewiseLinear(tuple(knots), tuple(np.maximum(top.at(knots), floor).tolist()))
    last_top = max(float(top_m(above, first_m + travel, strip_m)[0]), float(low_first.at(travel)) + MIN_LINE_M)
    return Block(frame, layout, layout.spacing_m(motion), strip_m, first_m, top, low_first, low_second, last_top)


def _negated(levels: PiecewiseLinear) -> PiecewiseLinear:
    """Levels of a lower boundary, from the levels of that boundary upside down."""
    return PiecewiseLinear(levels.places_m, tuple(-level for level in levels.levels_m))
