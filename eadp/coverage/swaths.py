"""What coverage motions share: the aircraft's and the camera's measures, frames, and legs of a way over a field."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, flight_time_s

SPACING_SHARE = 0.5
"""Distance of the lines at the highest path parameter as a share of the swath, unless given: a side overlap of half.

The published survey's is two fifths. Laps are whole: a share nearer to 1 leaves c1 one lap to spare, or none."""

RADIUS_SHARE = 1.5
"""The ideal turning radius as a share of the smallest one, unless given."""


@dataclass(frozen=True)
class MotionLimits:
    """What the lines must obey.

    `spacing_m` is the distance of the lines at c1 = 0, `radius_m` the ideal turning radius of the letter. Lines and
    turns are timed at `airspeed_mps` in `wind_mps`.
    """

    swath_m: float
    min_radius_m: float
    radius_m: float
    spacing_m: float
    airspeed_mps: float = 15.0
    wind_mps: Point = (0.0, 0.0)

    @cached_property
    def calm(self) -> bool:
        """No wind."""
        return self.wind_mps == (0.0, 0.0)

    def time_s(self, pieces: Sequence[Piece]) -> float:
        """Time of flight along pieces [s].

        Raises
        ------
        Infeasible
            If the wind is as fast as the aircraft.
        """
        if self.calm:
            return sum(piece.length_m for piece in pieces) / self.airspeed_mps
        return flight_time_s(pieces, self.airspeed_mps, self.wind_mps)


@dataclass(frozen=True)
class StripFrame:
    """A frame whose u runs across the lines and whose v along them, maybe seen in a mirror.

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
    """The frame of lines of a heading: across them to the right (`towards` +1) or to the left (−1)."""
    across = (towards * _unit(math.sin(heading_rad)), towards * _unit(-math.cos(heading_rad)))
    return StripFrame(across, hand)


def _unit(value: float) -> float:
    """A direction cosine, of an axis exactly."""
    rounded = round(value, 12)
    return rounded + 0.0 if rounded in (-1, 0, 1) else value


@dataclass(frozen=True)
class CoverageLeg:
    """A piece of the way over a field; `sensing` where it is flown to cover ground.

    `gaps_m` says from where to where along it there is none of the field below [m].
    """

    piece: Piece
    sensing: bool = False
    gaps_m: tuple[tuple[float, float], ...] = ()

    def split(self) -> list[CoverageLeg]:
        """The leg cut at its gaps, over which nothing is sensed."""
        if not self.gaps_m:
            return [self]
        cuts = [0.0, *(end for gap in self.gaps_m for end in gap), self.piece.length_m]
        piece = self.piece
        return [
            CoverageLeg(Piece(piece.turn, piece.pose_at(a), piece.pose_at(b), b - a, piece.centre_m), i % 2 == 0)
            for i, (a, b) in enumerate(itertools.pairwise(cuts))
        ]


@dataclass
class CoveragePath:
    """Legs in the order flown."""

    legs: list[CoverageLeg] = field(default_factory=list)

    def add(self, pieces: Sequence[Piece], sensing: bool = False) -> None:
        """Go on along pieces."""
        self.legs += [CoverageLeg(piece, sensing) for piece in pieces]

    @property
    def pieces(self) -> list[Piece]:
        """The pieces alone."""
        return [leg.piece for leg in self.legs]

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
        """How many straight legs cover ground."""
        return sum(leg.sensing for leg in self.legs)


def straight(start: Point, end: Point) -> Piece:
    """The straight piece between two points [m]."""
    heading = math.atan2(end[1] - start[1], end[0] - start[0])
    return Piece(0, (*start, heading), (*end, heading), math.dist(start, end), None)


def half_circle(start: Pose, radius_m: float, turn: int) -> Piece:
    """Half a circle from a pose, to the left (+1) or to the right (−1)."""
    x, y, heading = start
    cx, cy = x - turn * radius_m * math.sin(heading), y + turn * radius_m * math.cos(heading)
    end = (2 * cx - x, 2 * cy - y, math.remainder(heading + math.pi, 2 * math.pi))
    return Piece(turn, start, end, math.pi * radius_m, (cx, cy))
