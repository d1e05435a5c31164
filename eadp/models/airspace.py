"""Where a flight may be: out of obstacles, and inside a boundary; and the field that it covers."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, centre_m, ordered, ways_to_point
from eadp.models.autopilot import Autopilot
from eadp.models.plan.stage import LAND, LOITER_TO_ALTITUDE, Leg, Stage, leg_points

if TYPE_CHECKING:
    from eadp.core.geometry.polygons import FreeSpace, Ring, WaysTo


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

    def top_on_ways_m(self, points_m: FloatArray, to_m: Point, aside_m: float) -> float:
        """Top of the highest obstacle near straight ways from points, shape (n, 2), to a point [m]; −∞ without.

        `aside_m` is how near. Obstacles without a height have no top.
        """
        from eadp.core.geometry.polygons import FreeSpace

        ends_m, tops_m = np.broadcast_to(to_m, points_m.shape), [-math.inf]
        for each in self.obstacles:
            if each.height_m is not None and not FreeSpace([each.outline], (), aside_m).sees(points_m, ends_m).all():
                tops_m.append(each.height_m)
        return max(tops_m)

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


EVERYWHERE: Airspace = Airspace()


CLEARANCE_M = 20.0
"""How high a way passes over what is below it, by default [m]."""

HOME_RADII = 1.5
"""Radius of the turn home, in least turning radii: gusts and wind widen a turn."""


class Landing(NamedTuple):
    """The landing that a plan ends with, from where its final approach starts.

    Attributes
    ----------
    start : (float, float, float)
        Where it starts [m], and the course there [rad].
    descent_m : float
        From its start to its end [m].
    altitude_m : float
        At its start [m].
    legs : tuple of Leg
    """

    start: Pose
    descent_m: float
    altitude_m: float
    legs: tuple[Leg, ...]

    @classmethod
    def of(cls, legs: Sequence[Leg], cruise_altitude_m: float) -> Landing | None:
        """The landing of a plan's legs, with the circles before it; None where they do not land."""
        if len(legs) < 2 or not legs[-1].stage.command(LAND):
            return None
        first = len(legs) - 1
        while first > 1 and legs[first - 1].stage.command(LOITER_TO_ALTITUDE):
            first -= 1
        before, own = legs[first - 1].stage, tuple(legs[first:])
        x, y, course = leg_points(own[0], own[0].length_m)[0].tolist()
        altitude_m = cruise_altitude_m if before.altitude_m is None else before.altitude_m
        descent_m = altitude_m - (own[-1].stage.altitude_m or 0.0)
        return cls((x, y, course), descent_m, altitude_m, own)


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
    landing : Landing or None
        With which it ends.
    circle_radius_m : float
        Radius of the circle that an autopilot flies at home, once until a pilot takes over [m]; 0 for none.
    """

    position_m: Point
    turn_radius_m: float
    turns_back: bool = False
    ways: WaysTo | None = None
    altitude_m: float | None = None
    landing: Landing | None = None
    circle_radius_m: float = 0.0

    def flown_by(self, autopilot: Autopilot) -> WayHome:
        """The way as an autopilot flies it, by its kind and parameters."""
        if autopilot.kind is None:
            return self
        way = self._replace(altitude_m=autopilot.return_altitude_m(self.altitude_m))
        if self.landing is not None and autopilot.lands:
            return way
        circle_m = autopilot.circle_radius_m(HOME_RADII * self.turn_radius_m)
        return way._replace(landing=None, circle_radius_m=circle_m, ways=self.ways and self.ways.to(self.position_m))

    @property
    def end_m(self) -> Point:
        """Where its straight lines end [m]: home, or the start of the landing."""
        return self.position_m if self.landing is None else self.landing.start[:2]

    def line(self, start_m: Point) -> tuple[Point, ...]:
        """The shortest way from a point [m]: where its straight lines end."""
        found = self.ways and next(self.ways.lines(start_m), None)
        return found or (self.end_m,)

    def pieces(self, start: Pose) -> tuple[Piece, ...]:
        """Turns and straight lines from a pose, up to the start of the landing, or the end of the circle."""
        radius_m = HOME_RADII * self.turn_radius_m
        if math.dist(start[:2], self.end_m) <= self.circle_radius_m:
            return _circle(start, self.circle_radius_m)
        if self.ways is None and self.landing is not None:
            return ordered(start, self.landing.start, radius_m)[0].pieces
        way = ways_to_point(start, self.end_m, radius_m)[0] if self.ways is None else self.ways.pieces(start)
        pose = way[-1].end if way else start
        if self.landing is not None:
            return (*way, *ordered(pose, self.landing.start, radius_m)[0].pieces)
        return (*way, *_circle(pose, self.circle_radius_m)) if self.circle_radius_m else way


def _circle(start: Pose, radius_m: float) -> tuple[Piece, ...]:
    """A whole turn to the left from a pose, in two halves."""
    x, y = centre_m(start, 1, radius_m)
    across = 2 * x - start[0], 2 * y - start[1], start[2] + np.pi
    halves = ((start, across), (across, start))
    return tuple(Piece(1, begins, ends, np.pi * radius_m, (x, y)) for begins, ends in halves)


TRACK_M = 2.0
"""Distance between points of the path that is checked for obstacles [m]."""


def entered(legs: Iterable[Leg], airspace: Airspace, low_m: float = 0.0) -> Iterator[tuple[Stage, str]]:
    """The stages of a nominal path that enter an obstacle or leave the boundary, and its name.

    Parameters
    ----------
    legs : iterable of Leg
    airspace : Airspace
    low_m : float, optional
        The altitude of stages without one [m]; a landing descends evenly.
    """
    level_m = low_m
    for leg in legs:
        track = [(x, y) for x, y, _ in leg_points(leg, TRACK_M).tolist()]
        before_m, level_m = level_m, low_m if leg.stage.altitude_m is None else leg.stage.altitude_m
        start_m = before_m if leg.stage.command(LAND) else level_m
        altitudes_m = np.linspace(start_m, level_m, len(track)).tolist()
        for entry in airspace.entries([0.0] * len(track), track, altitudes_m):
            yield leg.stage, entry.name


@dataclass(frozen=True)
class Field:
    """A field to cover.

    Attributes
    ----------
    outline : tuple of (float, float)
        Vertices [m], x east and y north, counter-clockwise; the first is not repeated at the end.
    holes : tuple of tuples of (float, float)
        Areas that are not covered, each as `outline` but clockwise; within the outline and disjoint except for single
        points.
    name : str
        Its name in its file, '' if none.
    origin_deg : (float, float) or None
        Latitude and longitude [°] of the local frame's origin on the WGS-84 ellipsoid; None if the file is in metres
        and has none.
    airspace : Airspace
        What lines and turns keep to.
    others : tuple of tuples of rings
        Its other parts, each an outline and its holes.
    """

    outline: Ring
    holes: tuple[Ring, ...] = ()
    name: str = ""
    origin_deg: tuple[float, float] | None = None
    airspace: Airspace = EVERYWHERE
    others: tuple[tuple[Ring, ...], ...] = ()

    @property
    def parts(self) -> tuple[tuple[Ring, ...], ...]:
        """Its parts, each an outline and its holes; the field's own first."""
        return ((self.outline, *self.holes), *self.others)

    def with_parts(self, parts: Sequence[Sequence[Ring]]) -> Field:
        """The same field with other parts, each an outline and its holes; at least one."""
        (outline, *holes), *others = parts
        return replace(self, outline=outline, holes=tuple(holes), others=tuple(map(tuple, others)))

    @property
    def middle_m(self) -> Point:
        """The middle of the box around its own outline [m]."""
        x, y = zip(*self.outline, strict=True)
        return (min(x) + max(x)) / 2, (min(y) + max(y)) / 2

    @property
    def area_m2(self) -> float:
        """Area within the outlines, less the holes [m²]."""
        from eadp.core.geometry.polygons import signed_area_m2

        areas = ([abs(signed_area_m2(ring)) for ring in part] for part in self.parts)
        return sum(outline - sum(holes) for outline, *holes in areas)

    @property
    def summary(self) -> dict[str, float | str]:
        """Its area [m²] and its name, for documents."""
        return {"area_m2": round(self.area_m2, 1), "name": self.name}
