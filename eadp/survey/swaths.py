"""Lines and turns of a coverage path, the limits of their motion, and the frame of their strips."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight import ground_speeds_mps
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, flight_time_s, lengths_m, straight, times_s
from eadp.models.plan.pieces import direction_cosine

SPACING_SHARE = 0.5
"""Default line spacing at the highest path parameter as a share of the swath: a side overlap of one half.

The published survey's is two fifths. Laps are whole: a share nearer to 1 leaves c1 one lap to save, or none."""

RADIUS_SHARE = 1.5
"""Default ideal turning radius as a share of the smallest one."""

MIN_LINE_M = 5.0
"""Lines over a corner of the field are made at least this long."""


@dataclass(frozen=True)
class MotionLimits:
    """Swath, turning radii, line spacing, airspeed and wind of a coverage path.

    `spacing_m` is the line spacing at c1 = 0, `radius_m` the ideal turning radius of the letter. Lines and turns are
    timed at `airspeed_mps` in `wind_mps`. Before each line the flight is straight for `lead_in_m`.
    """

    swath_m: float
    min_radius_m: float
    radius_m: float
    spacing_m: float
    airspeed_mps: float = 15.0
    wind_mps: Point = (0.0, 0.0)
    lead_in_m: float = 0.0

    @cached_property
    def windless(self) -> bool:
        """Whether there is no wind."""
        return self.wind_mps == (0.0, 0.0)

    @property
    def wind_text(self) -> str:
        """The wind, for people."""
        if self.windless:
            return f"wind       none: times are for calm air, at {self.airspeed_mps:g} m/s"
        return (
            f"wind       {math.hypot(*self.wind_mps):g} m/s; times are in it, at {self.airspeed_mps:g} m/s of airspeed"
        )

    @property
    def ground_limit_mps(self) -> float:
        """Ground speed with the wind behind [m/s]."""
        return self.airspeed_mps + math.hypot(*self.wind_mps)

    def max_line_speed_mps(self, heading_rad: float) -> float:
        """Ground speed along lines of a heading, in the faster of both directions [m/s]."""
        ways = np.array([heading_rad, heading_rad + math.pi])
        return float(ground_speeds_mps(np.cos(ways), np.sin(ways), self.airspeed_mps, self.wind_mps)[0].max())

    def time_s(self, pieces: Sequence[Piece]) -> float:
        """Time of flight along pieces [s].

        Raises
        ------
        Infeasible
            If the wind is as fast as the aircraft.
        """
        if self.windless:
            return sum(piece.length_m for piece in pieces) / self.airspeed_mps
        return flight_time_s(pieces, self.airspeed_mps, self.wind_mps)

    def turns_s(self, ends: Sequence[Pose], starts: Sequence[Pose]) -> FloatArray:
        """Times of the quickest turns from each end to each start with nothing in the way, shape (ends, starts) [s]."""
        if self.windless:
            return lengths_m(ends, starts, self.min_radius_m) / self.airspeed_mps
        return times_s(ends, starts, self.min_radius_m, self.airspeed_mps, self.wind_mps)


@dataclass(frozen=True)
class StripFrame:
    """A frame whose u axis runs across the lines and whose v axis runs along them; it may be mirrored.

    `across` is u's unit vector; v is a quarter turn counter-clockwise from it for `hand` +1, clockwise for −1.
    """

    across: Point
    hand: int = 1

    @property
    def along(self) -> Point:
        """v's unit vector."""
        ux, uy = self.across
        return (-uy * self.hand, ux * self.hand)

    def into(self, points_m: FloatArray) -> FloatArray:
        """Points of the plane in this frame; shape (n, 2) both."""
        return np.asarray(points_m @ np.array([self.across, self.along]).T)

    def out(self, u: float, v: float) -> Point:
        """A point of this frame in the plane."""
        (ux, uy), (vx, vy) = self.across, self.along
        return ux * u + vx * v, uy * u + vy * v

    def pose_out(self, u: float, v: float, heading_rad: float) -> Pose:
        """A pose of this frame in the plane."""
        x, y = self.out(u, v)
        dx, dy = self.out(math.cos(heading_rad), math.sin(heading_rad))
        return x, y, math.atan2(dy, dx)


def frame_of(heading_rad: float, towards: int = 1, hand: int = 1) -> StripFrame:
    """The frame of lines of a heading: u points to their right (`towards` +1) or to their left (−1)."""
    across = towards * direction_cosine(math.sin(heading_rad)), towards * direction_cosine(-math.cos(heading_rad))
    return StripFrame(across, hand)


@dataclass(frozen=True)
class CoverageLeg:
    """A piece of a coverage path; `sensing` where it is flown to cover ground.

    `altitude_m` is its own, if it has one.
    """

    piece: Piece
    sensing: bool = False
    altitude_m: float | None = None

    @property
    def start(self) -> Pose:
        """The pose at its start."""
        return self.piece.start

    @property
    def end(self) -> Pose:
        """The pose at its end."""
        return self.piece.end

    @property
    def whole_circle(self) -> bool:
        """Whether it is a whole turn, on which a flight climbs or descends."""
        return self.piece.turn != 0 and self.start == self.end

    def backward(self) -> CoverageLeg:
        """The same straight leg in the other direction."""
        return CoverageLeg(straight(self.end[:2], self.start[:2]), self.sensing)

    def led(self, motion: MotionLimits) -> CoverageLeg:
        """The straight leg made longer by the lead-in."""
        if not motion.lead_in_m:
            return self
        return CoverageLeg(straight(self.piece.pose_at(-motion.lead_in_m)[:2], self.end[:2]), self.sensing)

    def with_leads(self, motion: MotionLimits) -> list[CoverageLeg]:
        """The straight leg after its lead-in, which covers no ground."""
        before = [CoverageLeg(straight(self.led(motion).start[:2], self.start[:2]))] if motion.lead_in_m else []
        return [*before, self]

    def cut(self, *places_m: float) -> list[CoverageLeg]:
        """The leg in several, cut at places along it [m]."""
        piece = self.piece
        poses = [piece.start, *(piece.pose_at(place) for place in places_m), piece.end]
        lengths = np.diff([0.0, *places_m, piece.length_m]).tolist()
        return [
            CoverageLeg(Piece(piece.turn, start, end, length, piece.centre_m), self.sensing, self.altitude_m)
            for (start, end), length in zip(itertools.pairwise(poses), lengths, strict=True)
        ]


@dataclass(frozen=True)
class CoveragePath:
    """Legs in the order flown."""

    legs: tuple[CoverageLeg, ...]

    @property
    def pieces(self) -> list[Piece]:
        """The pieces of its legs."""
        return [leg.piece for leg in self.legs]

    @property
    def runs(self) -> list[list[CoverageLeg]]:
        """The lines: legs that cover ground, those that follow one another together."""
        return [list(run) for sensing, run in itertools.groupby(self.legs, lambda leg: leg.sensing) if sensing]

    @property
    def sensed_m(self) -> list[tuple[Point, ...]]:
        """Points along each line [m]: the ends of its legs."""
        return [(run[0].start[:2], *(leg.end[:2] for leg in run)) for run in self.runs]

    @property
    def length_m(self) -> float:
        """Its length [m]."""
        return sum(leg.piece.length_m for leg in self.legs)

    @property
    def min_radius_m(self) -> float:
        """The smallest radius of its turns [m]; infinite without one."""
        return min((leg.piece.radius_m for leg in self.legs), default=math.inf)

    @property
    def lines(self) -> int:
        """The number of lines."""
        return len(self.runs)


def half_circle(start: Pose, radius_m: float, turn: int) -> Piece:
    """Half a circle from a pose, to the left (+1) or to the right (−1)."""
    x, y, heading = start
    cx, cy = x - turn * radius_m * math.sin(heading), y + turn * radius_m * math.cos(heading)
    end = (2 * cx - x, 2 * cy - y, math.remainder(heading + math.pi, 2 * math.pi))
    return Piece(turn, start, end, math.pi * radius_m, (cx, cy))
