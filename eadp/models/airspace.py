"""Where a flight may be: out of obstacles, and inside a boundary."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, ways_to_point

if TYPE_CHECKING:
    from eadp.core.geometry.polygons import FreeSpace, Ring
    from eadp.core.geometry.ways import WaysTo

BOUNDARY = "the boundary"

CLEARANCE_SHARE = 0.2
"""Distance to obstacles and to the boundary, over the smallest turning radius: flights leave paths by up to so much."""


class Obstacle(NamedTuple):
    """An area that a flight stays out of.

    Attributes
    ----------
    outline : tuple of (float, float)
        Vertices [m], x east and y north, of either winding; the first is not repeated at the end.
    name : str
    height_m : float or None
        Up to which it is in the way, above the origin [m]; None for any altitude.
    """

    outline: Ring
    name: str
    height_m: float | None = None


class Entry(NamedTuple):
    """An obstacle that a flight was in, or the boundary that it was beyond.

    Attributes
    ----------
    name : str
    entered_s : float
        When it was entered first, or left [s].
    inside_m : float
        Length of the way inside it, or beyond it [m].
    """

    name: str
    entered_s: float
    inside_m: float

    @property
    def reason(self) -> str:
        """What happened, for the reason of a flight's end."""
        return f"{'left' if self.name == BOUNDARY else 'entered'} {self.name} at {self.entered_s:.1f} s"


def risk_text(name: str, probability: float) -> str:
    """What a forecast says of an obstacle, or of the boundary."""
    return f"{'leaves' if name == BOUNDARY else 'enters'} {name} with a probability of {100 * probability:.3g} %"


class Airspace(NamedTuple):
    """Obstacles, and outlines within whose union a flight stays; without outlines it may be anywhere."""

    obstacles: tuple[Obstacle, ...] = ()
    boundary: tuple[Ring, ...] = ()

    def in_the_way(self, altitude_m: float) -> Airspace:
        """What is in the way at an altitude above the origin [m]."""
        high = [each for each in self.obstacles if each.height_m is None or each.height_m > altitude_m]
        return Airspace(tuple(high), self.boundary)

    @functools.lru_cache(maxsize=16)  # noqa: B019
    def free_space(self, clear_m: float) -> FreeSpace:
        """Where a path may lie, a distance from obstacles and the boundary [m]."""
        from eadp.core.geometry.polygons import FreeSpace

        return FreeSpace([obstacle.outline for obstacle in self.obstacles], self.boundary, clear_m)

    def admits(self, point: Point) -> bool:
        """Whether a point [m] is out of the obstacles and within the boundary."""
        if not any(self):
            return True
        from eadp.core.geometry.polygons import holding

        within = not self.boundary or bool(holding(self.boundary, np.array([point])).any())
        return within and not holding([obstacle.outline for obstacle in self.obstacles], np.array([point])).any()

    def entries(self, times_s: Sequence[float], track_m: Sequence[Point], altitudes_m: Sequence[float]) -> list[Entry]:
        """Where a flight was that it should not have been, by time.

        Parameters
        ----------
        times_s, altitudes_m : sequence of float
            Time, and altitude above the origin, of each point of the track.
        track_m : sequence of (float, float)
            Straight lines join its points.
        """
        if not any(self) or len(track_m) < 2:
            return []
        from eadp.core.geometry.polygons import lengths_beyond_m, lengths_within_m

        names = [obstacle.name for obstacle in self.obstacles]
        segments, areas, lengths_m = lengths_within_m([obstacle.outline for obstacle in self.obstacles], track_m)
        heights_m = np.array([np.inf if each.height_m is None else each.height_m for each in self.obstacles])
        low_m = np.minimum(altitudes_m[:-1], altitudes_m[1:])
        below = low_m[segments] < heights_m[areas]
        hits = list(zip(segments[below].tolist(), areas[below].tolist(), lengths_m[below].tolist(), strict=True))
        if self.boundary:
            segments, lengths_m = lengths_beyond_m(self.boundary, track_m)
            names.append(BOUNDARY)
            hits += [(i, len(names) - 1, length_m) for i, length_m in zip(segments.tolist(), lengths_m, strict=True)]
        found: dict[int, Entry] = {}
        for segment, area, length_m in sorted(hits):
            entry = found.get(area, Entry(names[area], times_s[segment], 0.0))
            found[area] = entry._replace(inside_m=entry.inside_m + length_m)
        return list(found.values())


EVERYWHERE = Airspace()


HOME_RADII = 1.5
"""Radius of the turn home, in least turning radii: gusts and wind widen a turn."""


class WayHome(NamedTuple):
    """Where to return to, and how.

    Attributes
    ----------
    position_m : (float, float)
        [m].
    turn_radius_m : float
        Least radius of a turn [m].
    turns_back : bool
        Whether to fly home where the plan cannot be completed with the reserve kept.
    ways : WaysTo or None
        Round obstacles and within the boundary; None without either.
    altitude_m : float or None
        Altitude of the way [m]; None that of the stage.
    """

    position_m: Point
    turn_radius_m: float
    turns_back: bool = False
    ways: WaysTo | None = None
    altitude_m: float | None = None

    def line(self, start_m: Point) -> tuple[Point, ...]:
        """The shortest way from a point [m]: where its straight lines end."""
        found = self.ways and next(self.ways.lines(start_m), None)
        return found or (self.position_m,)

    def pieces(self, start: Pose) -> tuple[Piece, ...]:
        """Turns and straight lines from a pose."""
        if self.ways is not None:
            return self.ways.pieces(start)
        return ways_to_point(start, self.position_m, HOME_RADII * self.turn_radius_m)[0]
