"""Polygon rings: area, simplification, validity, and extents in strips.

A ring is a tuple of vertices (x, y) [m], not closed: the first vertex is not repeated. This module is the one door to
shapely, whose import takes a tenth of a second: import this module where it is used.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, polyline_m, ways_to_point

Ring = tuple[Point, ...]

TOLERANCE_M = 1e-3
"""Vertices nearer to one another than this are one, and a vertex nearer to a line is on it [m]."""


def signed_area_m2(ring: Sequence[Point]) -> float:
    """Area within a ring [m²]: positive counter-clockwise, negative clockwise."""
    if not ring:
        return 0.0
    # Σ (x_i y_i+1 − x_i+1 y_i)/2, from the first vertex: a ring far from the origin keeps its digits
    x0, y0 = ring[0]
    moved = [(x - x0, y - y0) for x, y in ring]
    return math.fsum(a[0] * b[1] - b[0] * a[1] for a, b in zip(moved, [*moved[1:], moved[0]], strict=True)) / 2


# --- simplification ---------------------------------------------------------------------------------------------------


def simplified(ring: Sequence[Point], tolerance_m: float) -> Ring:
    """The vertices that keep a ring's line within a tolerance [m], the first among them: Douglas and Peucker's."""
    kept = shapely.LineString([*ring, ring[0]]).simplify(tolerance_m, preserve_topology=False)
    return tuple(kept.coords)[:-1]


# --- validity ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RingDefect:
    """A defect of a ring (0 the outline, 1.. the holes): end of the message, and location [m]."""

    ring: int
    message: str
    point_m: Point


def flaw(outline: Sequence[Point], holes: Sequence[Sequence[Point]]) -> RingDefect | None:
    """A defect of an outline and its holes, vertices of either winding, three or more [m]; None without.

    A ring that crosses or touches itself; else a hole that is not within the outline, meets another hole, or cuts the
    field into parts. A hole may touch the outline or another hole at a point.
    """
    for i, ring in enumerate((outline, *holes)):
        if complaint := _complaint(ring):
            reason, point = complaint
            return RingDefect(i, "touches itself" if reason.startswith("Ring") else "crosses itself", point)
    if complaint := _complaint(outline, *holes):
        _, point = complaint
        away_m = shapely.distance([shapely.LinearRing(hole) for hole in holes], shapely.Point(point))
        return RingDefect(int(np.argmin(away_m)) + 1, BESIDE, point)
    return None


BESIDE = "crosses, meets or is beyond another ring, or cuts the field into parts"
"""What a hole does where the whole is not valid."""

_REASON = re.compile(r"(.+)\[(\S+) (\S+)\]\Z")


def _complaint(shell: Sequence[Point], *holes: Sequence[Point]) -> tuple[str, Point] | None:
    """Reason and location [m] of a polygon's invalidity according to shapely; None if it is valid."""
    match = _REASON.match(shapely.is_valid_reason(shapely.Polygon(shell, holes)))
    return (match[1], (float(match[2]), float(match[3]))) if match else None


def ground_m2(*rings: Sequence[Point]) -> float:
    """Area of an outline and its holes where they are made valid, whatever crosses or lies upon itself [m²]."""
    return float(sum(part.area for part in shapely.get_parts(_valid(rings))))


def made_valid(*rings: Sequence[Point]) -> list[list[Ring]]:
    """An outline and its holes made valid: parts, each its outline and its holes, of opposite windings.

    Where rings cross themselves, what has an odd number of windings is ground; what holes share with one another, or
    have beyond the outline, counts once.
    """
    return _rings(_valid(rings))


def _valid(rings: Sequence[Sequence[Point]]) -> shapely.Geometry:
    """An outline and its holes made valid, see `made_valid`."""
    return shapely.make_valid(shapely.Polygon(rings[0], rings[1:]), method="structure", keep_collapsed=False)


def joined(parts: Sequence[Sequence[Sequence[Point]]], overlap_m2: float) -> list[list[Ring]] | None:
    """The union of parts, as `strips`; None where no two overlap by more than an area [m²]."""
    polygons = [shapely.Polygon(outline, holes) for outline, *holes in parts]
    one, other = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    once = one < other  # each pair is found both ways, and each polygon with itself
    shared = [polygons[i].intersection(polygons[j]).area for i, j in zip(one[once], other[once], strict=True)]
    return _rings(shapely.union_all(polygons)) if any(area > overlap_m2 for area in shared) else None


# --- extents in strips ------------------------------------------------------------------------------------------------

EDGE_M = 1e-6
"""Overlap with a strip, along its edge, below which an area belongs to the neighbouring strip [m]."""


def strip_extents(
    rings: Sequence[FloatArray], edges_m: FloatArray, others: Sequence[Sequence[FloatArray]] = ()
) -> list[list[tuple[float, float]]]:
    """Extents of a field in each of adjacent strips along y.

    Parameters
    ----------
    rings : sequence of array, shape (n, 2)
        The outline and the holes [m].
    edges_m : array, shape (n + 1,)
        Where the strips end across [m], ascending.
    others : sequence of such rings, optional
        The field's other parts.

    Returns
    -------
    list of lists of (float, float)
        For each strip the minimum and maximum y [m] of each of the field's parts in it, upward; parts that overlap in y
        are merged.
    """
    field = _union([rings, *others])
    _, low, _, high = field.bounds
    boxes = shapely.box(edges_m[:-1] + EDGE_M, low - 1, edges_m[1:] - EDGE_M, high + 1)
    parts, strips = shapely.get_parts(shapely.intersection(field, boxes), return_index=True)
    found: list[list[tuple[float, float]]] = [[] for _ in boxes]
    bounds = shapely.bounds(parts)  # of each part: min x, min y, max x, max y
    solid = shapely.area(parts) > EDGE_M
    order = np.argsort(bounds[:, 1], kind="stable")
    for i in order[solid[order]].tolist():
        own, (start, end) = found[strips[i]], bounds[i, [1, 3]].tolist()
        if own and start <= own[-1][1]:
            own[-1] = (own[-1][0], max(own[-1][1], end))
        else:
            own.append((start, end))
    return found


def _union(parts: Sequence[Sequence[ArrayLike]]) -> shapely.Geometry:
    """Parts of a field, each an outline and its holes, as one geometry."""
    # corners that are rounded may cross by as much
    polygons = shapely.make_valid([shapely.Polygon(outline, holes) for outline, *holes in parts])
    return polygons[0] if len(polygons) == 1 else shapely.union_all(polygons)


def covered_share(
    parts: Sequence[Sequence[Sequence[Point]]], lines: Sequence[Sequence[Point]], swath_m: float
) -> float:
    """Share of a field within half a swath of lines, square to their ends.

    Parameters
    ----------
    parts : sequence of sequences of rings
        The parts of the field [m], each an outline and its holes.
    lines : sequence of sequences of (float, float)
        Points of each line [m]; one of fewer than two different points covers nothing.
    swath_m : float
        Width of the strip that each covers [m].
    """
    field = rest = _union(parts)
    for line in lines:
        if len(set(line)) > 1:  # one by one: a union of strips that only touch may lose area
            strip = shapely.LineString(line).simplify(1e-3).buffer(swath_m / 2, cap_style="flat")
            rest = shapely.difference(rest, strip)
    return 1 - min(1.0, float(rest.area / field.area))


def strips(
    parts: Sequence[Sequence[Sequence[Point]]], lines: Sequence[Sequence[Point]], swath_m: float
) -> list[list[Ring]]:
    """The ground within half a swath of lines, square to their ends, and within a field.

    Parameters
    ----------
    parts : sequence of sequences of rings
        The parts of the field [m], each an outline and its holes.
    lines : sequence of sequences of (float, float)
        Points of each line [m].
    swath_m : float
        Width of the strips [m].

    Returns
    -------
    list of lists of rings
        For each part its outline and its holes [m], of opposite windings.
    """
    return _rings(shapely.intersection(_ground(lines, swath_m), _union(parts)))


def uncovered(
    parts: Sequence[Sequence[Sequence[Point]]], lines: Sequence[Sequence[Point]], swath_m: float, min_width_m: float
) -> list[list[Ring]]:
    """The ground of a field beyond half a swath of lines, where it is wider than `min_width_m`; else as `strips`."""
    left = shapely.difference(_union(parts), _ground(lines, swath_m))
    # a morphological opening takes out what is narrower
    wide = left.buffer(-min_width_m / 2, join_style="mitre").buffer(min_width_m / 2, join_style="mitre")
    return _rings(shapely.simplify(shapely.intersection(wide, left), min_width_m / 10))


def clipped(parts: Sequence[Sequence[Sequence[Point]]], windows: Sequence[Sequence[Point]]) -> list[list[Ring]]:
    """The ground of a field within the union of some outlines; else as `strips`."""
    return _rings(shapely.intersection(_union(parts), shapely.union_all([shapely.Polygon(ring) for ring in windows])))


def hull(points_m: ArrayLike) -> Ring:
    """The convex hull of points, shape (n, 2) [m], counter-clockwise."""
    return _rings(shapely.MultiPoint(np.asarray(points_m)).convex_hull)[0][0]


def _ground(lines: Sequence[Sequence[Point]], swath_m: float) -> shapely.Geometry:
    """The ground within half a swath of lines, square to their ends."""
    drawn = [shapely.LineString(line).simplify(0.01) for line in lines if len(set(line)) > 1]
    return shapely.union_all([line.buffer(swath_m / 2, cap_style="flat") for line in drawn])


def _rings(areas: shapely.Geometry) -> list[list[Ring]]:
    """The polygons of a geometry, each its outline and its holes, of opposite windings."""
    found = [part for part in shapely.get_parts(areas) if part.geom_type == "Polygon" and part.area > 0]
    oriented = map(shapely.geometry.polygon.orient, found)
    return [[tuple(ring.coords)[:-1] for ring in (area.exterior, *area.interiors)] for area in oriented]


def near(points: Sequence[Point], distance_m: float) -> list[list[Ring]]:
    """The ground within a distance of points and of the lines between them [m], a little more at ends; as `strips`."""
    line = points if len(points) > 1 else [*points, *points]
    # round ends have 16 corners, and lie outside the circle
    return _rings(shapely.LineString(line).buffer(distance_m / math.cos(math.pi / 16), quad_segs=4))


# --- where a path may lie ---------------------------------------------------------------------------------------------


class FreeSpace:
    """Where a path may lie: out of some polygons, and inside others.

    Parameters
    ----------
    avoid : sequence of sequences of (float, float)
        Outlines that a path stays out of [m]; it may run along them.
    inside : sequence of sequences of (float, float)
        Outlines within whose union it stays; none for everywhere.
    clear_m : float, optional
        Distance that it keeps from both.
    """

    def __init__(
        self, avoid: Sequence[Sequence[Point]], inside: Sequence[Sequence[Point]] = (), clear_m: float = 0.0
    ) -> None:
        # _blocked and _inside: the limits at their distance; _inner and _outer: what a path must not enter or leave
        each = shapely.buffer([shapely.Polygon(ring) for ring in avoid], clear_m, join_style="mitre")
        self._blocked = shapely.union_all(each)
        free = shapely.union_all([shapely.Polygon(ring) for ring in inside]) if inside else None
        self._inside = None if free is None else shapely.buffer(free, -clear_m, join_style="mitre")
        # a path may touch a boundary, with its rounding
        inner = shapely.buffer(shapely.get_parts(self._blocked), -ALONG_M)
        self._inner = shapely.multipolygons(shapely.get_parts(inner))
        self._outer = None if self._inside is None else shapely.buffer(self._inside, ALONG_M)
        shapely.prepare(self._inner)
        shapely.prepare(self._outer)

    def has(self, path_m: ArrayLike) -> bool:
        """Whether a polyline, shape (n, 2), lies in it."""
        return bool(self._free(shapely.LineString(path_m)))

    def sees(self, starts_m: ArrayLike, ends_m: ArrayLike) -> BoolArray:
        """Whether straight lines lie in it, from points to points, each of shape (n, 2); shape (n,)."""
        return self._free(shapely.linestrings(np.stack((np.asarray(starts_m), np.asarray(ends_m)), axis=1)))

    def has_each(self, paths_m: Sequence[FloatArray]) -> BoolArray:
        """Whether polylines lie in it, each of shape (points, 2); shape (n,)."""
        if not len(paths_m):
            return np.zeros(0, dtype=bool)
        of_points = np.repeat(np.arange(len(paths_m)), [len(path) for path in paths_m])
        return self._free(shapely.linestrings(np.concatenate(paths_m), indices=of_points))

    def _free(self, geometries: Any) -> BoolArray:
        """Whether each of many geometries lies in it, or one."""
        free = np.logical_not(shapely.intersects(self._inner, geometries))
        found: BoolArray = free if self._outer is None else free & shapely.covers(self._outer, geometries)
        return found

    def has_hull(self, points_m: ArrayLike) -> bool:
        """Whether the convex hull of points, shape (n, 2), lies in it."""
        return bool(self._free(shapely.MultiPoint(points_m).convex_hull))

    def blocks(self, parts: Sequence[Sequence[Sequence[Point]]], radius_m: float) -> bool:
        """Whether a circle of a radius [m] on a field's ground, as `covered_share` has it, lies out of it."""
        return not shapely.intersection(self._inner, _union(parts)).buffer(-radius_m).is_empty

    def rooms(self, points_m: ArrayLike) -> IntArray:
        """Numbers of its parts in which points lie, shape (n, 2), with no way from one to another; shape (n,)."""
        everywhere = shapely.box(-FAR_M, -FAR_M, FAR_M, FAR_M)
        parts = shapely.get_parts(shapely.difference(self._outer or everywhere, self._inner))
        found: IntArray = shapely.distance(shapely.points(points_m)[:, np.newaxis], parts).argmin(axis=1)
        return found

    def intervals_m(self, starts_m: ArrayLike, ends_m: ArrayLike) -> list[list[tuple[float, float]]]:
        """The parts of straight lines that lie in it, from points to points, each of shape (n, 2).

        Of each line intervals along it [m], in their order.
        """
        starts_m, ends_m = (np.asarray(points_m, dtype=float).reshape(-1, 2) for points_m in (starts_m, ends_m))
        lines = shapely.difference(shapely.linestrings(np.stack((starts_m, ends_m), axis=1)), self._inner)
        if self._outer is not None:
            lines = shapely.intersection(lines, self._outer)
        parts, of_line = shapely.get_parts(lines, return_index=True)
        own = (shapely.length(parts) > EDGE_M) & (shapely.get_type_id(parts) == shapely.GeometryType.LINESTRING)
        parts, of_line = parts[own], of_line[own]
        points_m = [shapely.get_coordinates(shapely.get_point(parts, i)) for i in (0, -1)]
        along_m = np.sort([np.linalg.norm(point_m - starts_m[of_line], axis=1) for point_m in points_m], axis=0)
        found: list[list[tuple[float, float]]] = [[] for _ in starts_m]
        for i, low_m, high_m in zip(of_line.tolist(), *along_m.tolist(), strict=True):
            found[i].append((low_m, high_m))
        return [sorted(intervals) for intervals in found]

    def corners_m(self, distance_m: float) -> list[Ring]:
        """Rings at a distance around what is avoided, and at a distance within what is to be inside."""
        areas = [shapely.buffer(part.convex_hull, distance_m, quad_segs=2) for part in shapely.get_parts(self._blocked)]
        if self._inside is not None:
            areas.append(shapely.buffer(self._inside, -distance_m, quad_segs=2))
        polygons = [part for area in areas for part in shapely.get_parts(area) if not part.is_empty]
        thinned = [shapely.simplify(part.exterior, distance_m / 20) for part in polygons]
        return [tuple((float(x), float(y)) for x, y in ring.coords[:-1]) for ring in thinned]


FAR_M = 1e6
"""Beyond any field [m]."""

ALONG_M = 1e-3
"""How far a path may cross a boundary that it runs along [m]."""


def lengths_within_m(
    areas: Sequence[Sequence[Point]], track_m: Sequence[Point]
) -> tuple[IntArray, IntArray, FloatArray]:
    """Lengths of a track's segments within areas, as `FreeSpace` counts them: their edges are free.

    Parameters
    ----------
    areas : sequence of sequences of (float, float)
        Outlines [m].
    track_m : sequence of (float, float)
        Two points or more.

    Returns
    -------
    segments, found : array of int
        Numbers of a segment and of an area that it enters.
    lengths_m : array
        How much of the segment lies in the area [m].
    """
    inner = shapely.buffer([shapely.Polygon(area) for area in areas], -ALONG_M)
    lines = _segments(track_m)
    segments, found = shapely.STRtree(inner).query(lines, predicate="intersects")
    return segments, found, shapely.length(shapely.intersection(lines[segments], inner[found]))


def near_edges(areas: Sequence[Sequence[Point]], points_m: ArrayLike, distance_m: float) -> tuple[IntArray, IntArray]:
    """Points, shape (n, 2), and areas whose edges are nearer than a distance [m]: the numbers of both, each pair."""
    edges = shapely.STRtree([shapely.LinearRing(area) for area in areas])
    points, found = edges.query(shapely.points(points_m), predicate="dwithin", distance=distance_m)
    return points, found


def distances_m(areas: Sequence[Sequence[Point]], point: Point) -> FloatArray:
    """Distances of areas from a point, 0 where it lies within; shape (areas,) [m]."""
    found: FloatArray = shapely.distance([shapely.Polygon(area) for area in areas], shapely.Point(point))
    return found


def inner_point(*rings: Sequence[Point]) -> Point:
    """A point of the ground of an outline and its holes, away from its edges where it can be [m]."""
    point = shapely.point_on_surface(shapely.Polygon(rings[0], rings[1:]))
    return float(point.x), float(point.y)


def holding(areas: Sequence[Sequence[Point]], points_m: FloatArray) -> BoolArray:
    """Whether areas hold points, shape (n, 2); shape (areas, n)."""
    x, y = points_m.T
    found = [shapely.contains_xy(shapely.Polygon(area), x, y) for area in areas]
    return np.array(found, dtype=bool).reshape(len(areas), len(points_m))


def lengths_beyond_m(areas: Sequence[Sequence[Point]], track_m: Sequence[Point]) -> tuple[IntArray, FloatArray]:
    """Segments of a track that leave the union of areas, and their lengths beyond it [m]; as `lengths_within_m`."""
    outer = shapely.buffer(shapely.union_all([shapely.Polygon(area) for area in areas]), ALONG_M)
    shapely.prepare(outer)
    lines = _segments(track_m)
    segments = np.flatnonzero(~shapely.covers(outer, lines))
    return segments, shapely.length(shapely.difference(lines[segments], outer))


def _segments(track_m: Sequence[Point]) -> Any:
    points = np.asarray(track_m, dtype=float)
    return shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1))


CORNER_RADII = 1.05
"""Distance of the corners from what they go round, in turning radii."""
MAX_CORNERS = 400
"""Corners that are kept, the nearest: as many pairs as a second lays out."""


class WaysTo:
    """Ways to a point of an aircraft that turns: a graph of the point, node 0, and corners that see one another.

    Parameters
    ----------
    end_m : (float, float)
        [m].
    space : FreeSpace
        Where the ways lie.
    near : FreeSpace
        Where they may lie at their start and end, too: nearer to what is in the way.
    radius_m : float
        Radius of the turns [m].

    Source: visibility graph, Lozano-Pérez and Wesley 1979, with corners a turn's radius away; Dijkstra 1959.
    """

    def __init__(self, end_m: Point, space: FreeSpace, near: FreeSpace, radius_m: float) -> None:
        self._end_m, self._spaces, self._radius_m = end_m, (space, near), radius_m

    def to(self, end_m: Point) -> WaysTo:
        """Ways to another point [m]."""
        return self if end_m == self._end_m else WaysTo(end_m, *self._spaces, self._radius_m)

    @cached_property
    def _graph(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Nodes, shape (n, 2) [m], the length of the shortest way from each to the end [m], and the next node on it."""
        from scipy.sparse.csgraph import dijkstra  # slow to import, and few plans have obstacles

        space, near = self._spaces
        corners = [corner for ring in space.corners_m(CORNER_RADII * self._radius_m) for corner in ring]
        nearest = sorted(corners, key=lambda corner: math.dist(corner, self._end_m))[:MAX_CORNERS]
        nodes_m = np.array([self._end_m, *nearest])
        i, j = np.triu_indices(len(nodes_m), 1)
        seen = space.sees(nodes_m[i], nodes_m[j]) | ((i == 0) & near.sees(nodes_m[i], nodes_m[j]))
        graph = np.zeros((len(nodes_m), len(nodes_m)))
        graph[i[seen], j[seen]] = np.linalg.norm(nodes_m[i[seen]] - nodes_m[j[seen]], axis=1)
        return nodes_m, *dijkstra(graph, directed=False, indices=0, return_predecessors=True)

    def lines(self, start_m: Point) -> Iterator[tuple[Point, ...]]:
        """Ways from a point [m], the shortest first: the points at which their lines end. None where none is free."""
        nodes_m, left_m, following = self._graph
        starts = np.broadcast_to(start_m, nodes_m.shape)
        lengths_m = np.linalg.norm(nodes_m - starts, axis=1) + left_m
        seen = np.zeros(len(lengths_m), dtype=bool)
        for space in self._spaces:
            if not seen.any():  # the nearer space, where none is free in the other
                seen = space.sees(starts, nodes_m) & np.isfinite(lengths_m)
        for node in sorted(np.flatnonzero(seen).tolist(), key=lengths_m.__getitem__):
            nodes = [node]
            while nodes[-1] != 0:
                nodes.append(int(following[nodes[-1]]))
            yield tuple((float(x), float(y)) for x, y in nodes_m[nodes])

    def pieces(self, start: Pose) -> tuple[Piece, ...]:
        """The first of its ways whose turns are free too, from a pose; a turn and a straight line where none is."""
        for space in self._spaces:
            for line in self.lines(start[:2]):
                for pieces in ways_to_point(start, line[0], self._radius_m):
                    for point in line[1:]:
                        pieces += ways_to_point(pieces[-1].end if pieces else start, point, self._radius_m)[0]
                    if not pieces or space.has(polyline_m(pieces)):
                        return pieces
        return ways_to_point(start, self._end_m, self._radius_m)[0]
