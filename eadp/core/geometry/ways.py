"""Ways to a point through free space: straight lines round corners, and turns onto them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, polyline_m, ways_to_point
from eadp.core.geometry.polygons import FreeSpace

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
