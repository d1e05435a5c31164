"""The Zamboni-like motion over a block of a field: line, circle, line, circle, lap by lap, all turns to one hand.

The letter's Algorithm 1, with what its print leaves wrong or open put right:

- Both lines that a turn joins end at the same level, the farther that either needs, so that the turn leaves one and
  meets the other along it. (The print ends them at the polygon, where a half circle meets the second line only if the
  edge is square to the lines.)
- A line reaches as far as the whole strip that it covers, not as far as its middle.
- The distance of the lines, d(c1) = x_d + 2(r − √(r² + c1)), leaves no gap only while it is at most the swath: c1 has
  that bound beside the one of the smallest radius. A width is split so that lines can lie evenly over the whole of it
  within both.
- Laps end when the ground is covered, whatever the parameters were on the way, and the last one is drawn in to where
  the block ends; a fixed final point would be missed or met too soon.

Source: letter, Sec. IV-A, Alg. 1, Eqs. 14 and 15.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.dubins import Pose
from eadp.core.geometry.envelope import Envelope, PiecewiseLinear, levels_above, upper_envelope
from eadp.coverage.swaths import CoverageLeg, MotionLimits, StripFrame, half_circle, straight
from eadp.errors import Infeasible

SHORTEST_LINE_M = 5.0
"""Lines of a corner of the field are made at least this long."""

C1_STEP = 1e-6
"""Bounds of c1 are whole multiples of this."""

LINES_LIMIT = 5000
"""Most lines of a field at c1 = 0."""

END_M = 1e-6
"""Laps nearer to the block's end than this are at it."""

UP = math.pi / 2


@dataclass(frozen=True)
class BlockLayout:
    """How a width is split: into `blocks` of equal width, each of at least `lines` lines, then `pitch_m` apart.

    The first line of a block lies half a pitch inside it. Of the lines the first `firsts` belong to the laps' first
    lines, the others to their second lines; an odd number of lines leaves out the last second line.
    """

    blocks: int
    lines: int
    pitch_m: float

    @property
    def firsts(self) -> int:
        """How many laps there are at the lowest c1."""
        return (self.lines + 1) // 2

    @property
    def circle_m(self) -> float:
        """r1: the first circle's radius [m], half the way from a lap's first line to its second."""
        return self.firsts * self.pitch_m / 2

    @property
    def least_radius_m(self) -> float:
        """The second circle's radius at the lowest c1 [m]."""
        return self.circle_m - self.pitch_m / 2

    @property
    def travel_m(self) -> float:
        """How far the laps move in all [m]."""
        return (self.firsts - 1) * self.pitch_m

    def spacing_m(self, motion: MotionLimits) -> float:
        """x_d: how far the lines move from lap to lap at c1 = 0 [m], a whole part of the travel."""
        wanted = motion.spacing_m * self.pitch_m / motion.swath_m
        return self.travel_m / math.ceil(self.travel_m / wanted - 1e-9)

    def widest_m(self, motion: MotionLimits) -> float:
        """How far the lines may move from lap to lap at most [m]: no gap is left, and r2 is no less than allowed.

        A pitch or more, so that a lap is spared before the lowest c1 is reached. The last second line of an odd number
        of lines may lie one step before the end, so that half of what it covers must reach the block's edge.
        """
        by_swath = motion.swath_m if self.lines % 2 == 0 else (motion.swath_m + self.pitch_m) / 2
        return max(self.pitch_m, min(by_swath, 2 * (self.circle_m - motion.min_radius_m)))


@dataclass(frozen=True)
class Block:
    """A part of a field as wide as one set of laps covers, in a frame in which it is flown from u = `first_m` up.

    Lap by lap the first line moves from `first_m` to `first_m + travel_m`, and the second beside it, twice the first
    circle's radius farther. `top` is the level at which the first turn is flown; the second turn is flown at the lower
    of `low_second` at the lap's place and `low_first` at the next lap's. `last_top_m` is how far the last first line
    reaches by itself.
    """

    frame: StripFrame
    shape: BlockLayout
    spacing_m: float
    widest_m: float
    first_m: float
    top: PiecewiseLinear
    low_first: PiecewiseLinear
    low_second: PiecewiseLinear
    last_top_m: float

    @property
    def circle_m(self) -> float:
        """r1: the first circle's radius [m]."""
        return self.shape.circle_m

    @property
    def radius_m(self) -> float:
        """r: the second circle's radius at c1 = 0 [m]. Source: letter, Sec. IV-A: r1 = r + x_d/2."""
        return self.circle_m - self.spacing_m / 2

    @property
    def travel_m(self) -> float:
        """How far the laps move in all [m]."""
        return self.shape.travel_m

    @property
    def ends_on_second(self) -> bool:
        """Whether the last lap has a second line."""
        return self.shape.lines % 2 == 0

    @property
    def lowest_c1(self) -> float:
        """The lowest c1: at it the lines move as far as they may from lap to lap."""
        # √(r² + c1) ≥ r1 − d/2
        lowest = (self.circle_m - self.widest_m / 2) ** 2 - self.radius_m**2
        return min(0.0, round(math.ceil(lowest / C1_STEP - 1e-9) * C1_STEP, 6))

    def steps(self) -> list[float]:
        """The c1 at and below which a lap less is flown, for each lap that can be spared, highest first."""
        most = round(self.travel_m / self.spacing_m)
        found = []
        for laps in range(most - 1, 0, -1):
            # d = travel/laps
            c1 = (self.circle_m - self.travel_m / laps / 2) ** 2 - self.radius_m**2
            if c1 < self.lowest_c1:
                break
            found.append(round(math.floor(c1 / C1_STEP) * C1_STEP, 6))
        return found

    def spacing_at(self, c1: float) -> float:
        """d(c1): how far the lines move from lap to lap [m]. Source: letter, Sec. IV-A."""
        # d = x_d + 2(r − √(r² + c1))
        return self.spacing_m + 2 * (self.radius_m - math.sqrt(self.radius_m**2 + c1))

    def places_m(self, c1: float) -> list[float]:
        """Where the laps' first lines lie, from `first_m` [m], at a fixed parameter."""
        step = self.spacing_at(c1)
        places = [0.0]
        while places[-1] < self.travel_m - END_M:
            places.append(self.next_m(places[-1], step))
        return places

    def next_m(self, here_m: float, step_m: float) -> float:
        """The place of the lap after one [m]: a step on, the last drawn in, and no lap for less than `END_M`."""
        return self.travel_m if here_m + step_m >= self.travel_m - END_M else here_m + step_m

    def low(self, here_m: float, next_m: float) -> float:
        """The level of the turn that leads from a lap to the next [m]."""
        return float(min(self.low_second.at(here_m), self.low_first.at(next_m)))

    def start(self) -> Pose:
        """Where the first line begins."""
        return self.frame.pose_out(self.first_m, float(self.low_first.at(0.0)), UP)

    def end(self) -> Pose:
        """Where the last line ends."""
        u = self.first_m + self.travel_m
        if self.ends_on_second:
            return self.frame.pose_out(u + 2 * self.circle_m, float(self.low_second.at(self.travel_m)), -UP)
        return self.frame.pose_out(u, self.last_top_m, UP)

    def legs(self, c1: Sequence[float] | float) -> list[CoverageLeg]:
        """The block flown at a fixed parameter, or at one for each lap in turn, the last one kept."""
        values = [c1] if isinstance(c1, float | int) else list(c1)
        legs: list[CoverageLeg] = []
        here, lap, low = 0.0, 0, float(self.low_first.at(0.0))
        while here < self.travel_m - END_M:
            next_ = self.next_m(here, self.spacing_at(values[min(lap, len(values) - 1)]))
            end = self.low(here, next_)
            legs += self._lap(here, low, end)
            legs.append(
                CoverageLeg(half_circle(legs[-1].piece.end, self.circle_m - (next_ - here) / 2, -self.frame.hand))
            )
            here, lap, low = next_, lap + 1, end
        return legs + self._last_lap(low)

    def last_lap(self) -> list[CoverageLeg]:
        """The lap at the block's end but for where its first line begins, which the lap before decides.

        It is given from where the line must be flown at the latest.
        """
        return self._last_lap(float(self.low_first.at(self.travel_m)))

    def _last_lap(self, low_m: float) -> list[CoverageLeg]:
        here = self.travel_m
        if self.ends_on_second:
            return self._lap(here, low_m, float(self.low_second.at(here)))
        u = self.first_m + here
        return [CoverageLeg(straight(self.frame.out(u, low_m), self.frame.out(u, self.last_top_m)), True)]

    def _lap(self, here_m: float, low_m: float, end_m: float) -> list[CoverageLeg]:
        """Line, circle and line of a lap that begins at a level and ends at another [m]."""
        u, top = self.first_m + here_m, float(self.top.at(here_m))
        first = straight(self.frame.out(u, low_m), self.frame.out(u, top))
        turn = half_circle(self.frame.pose_out(u, top, UP), self.circle_m, -self.frame.hand)
        across = u + 2 * self.circle_m
        second = straight(self.frame.out(across, top), self.frame.out(across, end_m))
        return [CoverageLeg(first, True), CoverageLeg(turn), CoverageLeg(second, True)]


def shapes(width_m: float, motion: MotionLimits) -> list[BlockLayout]:
    """Ways to split a width into blocks of equal width; empty where it is too small.

    Looked at are the number of blocks that keeps the second circle's radius at or below the ideal one, and one fewer;
    for each the least number of lines, and one more. A width below 4 r_min + 2 d has none.
    """
    # a block is 4 r1 wide, r1 = r + x_d/2
    most = max(1, math.ceil(width_m / (4 * motion.radius_m + 2 * motion.spacing_m) - 1e-9))
    found = []
    for blocks in (most, most - 1):
        least = max(2, math.ceil(width_m / (max(blocks, 1) * motion.swath_m) - 1e-9))
        for lines in (least, least + 1) if blocks else ():
            shape = BlockLayout(blocks, lines, width_m / (blocks * lines))
            if shape.least_radius_m >= motion.min_radius_m - 1e-9 and shape.firsts > 1:
                found.append(shape)
    for shape in found:
        count = 2 * shape.blocks * (1 + round(shape.travel_m / shape.spacing_m(motion)))
        if count > LINES_LIMIT:
            raise Infeasible(f"the field needs about {count} lines at c1 = 0, more than {LINES_LIMIT}")
    return found


class BlockBounds:
    """What blocks need of a polygon whose vertices are given in their frame: its upper boundary, and its lower one.

    The lower one upside down.
    """

    def __init__(self, points_m: FloatArray) -> None:
        self.above: Envelope = upper_envelope(points_m)
        self.below: Envelope = upper_envelope(points_m * np.array([1.0, -1.0]))


@dataclass(frozen=True)
class BlockSummary:
    """A block at its lowest c1 as metres flown: along its lines up and down, and its turns' radii summed up [m].

    `start_m` and `end_m` are where it begins and ends in its frame; it ends heading up or down the lines.
    """

    up_m: float
    down_m: float
    first_turns_m: float
    second_turns_m: float
    start_m: tuple[float, float]
    end_m: tuple[float, float]
    ends_up: bool


def sketch(shape: BlockLayout, u_m: FloatArray, low_m: FloatArray, top_m: FloatArray) -> BlockSummary:
    """What a block takes, from the lines that it has at the lowest c1.

    Parameters
    ----------
    shape : Shape
    u_m, low_m, top_m : array, shape (lines,)
        Where each line lies in the block's frame, in the order in which u grows, and from where to where its strip of
        the field reaches [m].
    """
    laps = shape.firsts
    first_low, second_low = low_m[:laps], low_m[laps:]
    seconds = len(second_low)
    tops = top_m[:laps].copy()
    tops[:seconds] = np.maximum(tops[:seconds], top_m[laps:])
    turns = np.minimum(second_low[: laps - 1], first_low[1:])  # the level of the turn from each lap to the next
    begins = np.append(first_low[:1], turns)
    if seconds == laps:
        down, end = float((tops - np.append(turns, second_low[-1:])).sum()), (float(u_m[-1]), float(second_low[-1]))
    else:
        down, end = float((tops[:-1] - turns).sum()), (float(u_m[laps - 1]), float(tops[-1]))
    return BlockSummary(
        float((tops - begins).sum()),
        down,
        seconds * shape.circle_m,
        (laps - 1) * shape.least_radius_m,
        (float(u_m[0]), float(first_low[0])),
        end,
        seconds < laps,
    )


def block_of(frame: StripFrame, sides: BlockBounds, first_m: float, shape: BlockLayout, motion: MotionLimits) -> Block:
    """The block whose first line is at u = `first_m` of a frame, over a polygon's two sides."""
    travel = shape.travel_m
    second = first_m + 2 * shape.circle_m
    reach = shape.widest_m(motion)
    top = levels_above([(sides.above, first_m), (sides.above, second)], travel, reach)
    low_first = _negated(levels_above([(sides.below, first_m)], travel, reach))
    low_second = _negated(levels_above([(sides.below, second)], travel, reach))
    # lines of a corner are no points: the turn above is flown a little higher than either line below it begins
    knots = sorted({*top.places_m, *low_first.places_m, *low_second.places_m})
    floor = np.maximum(low_first.at(knots), low_second.at(knots)) + SHORTEST_LINE_M
    if np.any(top.at(knots) < floor):
        top = PiecewiseLinear(tuple(knots), tuple(np.maximum(top.at(knots), floor).tolist()))
    last_low = float(low_first.at(travel))
    last_top = max(float(sides.above.over(first_m + travel, reach)[0]), last_low + SHORTEST_LINE_M)
    return Block(frame, shape, shape.spacing_m(motion), reach, first_m, top, low_first, low_second, last_top)


def _negated(levels: PiecewiseLinear) -> PiecewiseLinear:
    return PiecewiseLinear(levels.places_m, tuple(-level for level in levels.levels_m))
