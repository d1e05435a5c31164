"""Paths as they are travelled to a point of them: a line, a circle or a general curve, one class for each kind.

A new kind of path is a class here with a line in `TRACKS`, and its name in `eadp.core.geometry.curves.path_kind`.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.expressions.derivatives import PathFunction
from eadp.core.geometry.curves import (
    CIRCLE,
    CURVE,
    LINE,
    Point,
    circle_of,
    curve_length_m,
    line_of,
    points_along,
    project,
    tangent,
)

APPROACH_M = 100.0
"""Distance before the end of a line or a curve from which it can be approached [m]."""

NODES_PER_QUARTER, MAX_NODES = 4, 16
CURVE_NODES = 24
"""Nodes of the quadrature: on each quarter of a circle, and on one distance at most; on a distance along a curve."""


class Nodes(NamedTuple):
    """Quadrature over a piece of a path: lengths [m], directions of travel, curvatures [1/m]."""

    weights_m: FloatArray
    cosine: FloatArray
    sine: FloatArray
    curvature_per_m: FloatArray


class Track(ABC):
    """A path as travelled to a point.

    Parameters
    ----------
    path : function (x, y) → jet
        Its path function.
    end : (float, float)
        Where it is travelled to [m].
    sense : int
        +1 for rotation 90, −1 for rotation 270.

    Raises
    ------
    PathUndefined
        If the path has no value, no direction, or no point near; so do the methods.
    """

    def __init__(self, path: PathFunction, end: Point, sense: int) -> None:
        self.path, self._end, self._sense = path, end, sense

    turn_m: float = math.inf
    """Length of a whole turn [m]; infinite for what does not close."""

    @abstractmethod
    def nearest(self, point: Point) -> Point:
        """The point of the path nearest to a point [m]; of a curve, the one that Newton's steps lead to."""

    @abstractmethod
    def ahead_m(self, point: Point) -> float:
        """Distance along the path from a point to the end [m]; infinite for a curve that does not meet it.

        On a line it is negative where the end lies behind; on a circle it is above 0, up to a whole turn.
        """

    @abstractmethod
    def radius_m(self) -> float:
        """Radius at the end [m]; infinite for a line."""

    @abstractmethod
    def approach(self) -> Point:
        """A point of the path [m] from which the end can be approached: 100 m, or a quarter of a circle, before it."""

    @abstractmethod
    def points(self, start: Point, distance_m: float, share: float, count: int) -> Iterator[tuple[Point, float]]:
        """`count` + 1 points from a start along a distance [m], with directions of travel [rad].

        `share` is the distance as a share of that to the end: at 1, the last point is that of the end.
        """

    def remaining_m(self, point: Point, guess_m: float) -> float:
        """`ahead_m`, the one nearest to a guess [m] where the path closes."""
        return self.ahead_m(point)

    @abstractmethod
    def nodes(self, start: Point, distance_m: float, share: float) -> Nodes:
        """Quadrature over a distance [m] from a start; `share` as in `points`."""


class LineTrack(Track):
    """A straight line."""

    def __init__(self, path: PathFunction, end: Point, sense: int) -> None:
        super().__init__(path, end, sense)
        self._line = line_of(path, end, sense)

    def nearest(self, point: Point) -> Point:
        return line_of(self.path, point, self._sense).point_m

    def ahead_m(self, point: Point) -> float:
        return -self._line.progress_m(point)

    def radius_m(self) -> float:
        return math.inf

    def approach(self) -> Point:
        (x, y), (dx, dy) = self._line.point_m, self._line.direction
        return x - APPROACH_M * dx, y - APPROACH_M * dy

    def points(self, start: Point, distance_m: float, share: float, count: int) -> Iterator[tuple[Point, float]]:
        line = line_of(self.path, start, self._sense)
        (x, y), (dx, dy) = line.point_m, line.direction
        length_m, heading = line.progress_m(self._end) * share, math.atan2(dy, dx)
        for i in range(count + 1):
            along = length_m * i / count
            yield (x + along * dx, y + along * dy), heading

    def nodes(self, start: Point, distance_m: float, share: float) -> Nodes:
        dx, dy = self._line.direction
        return Nodes(*np.array([[distance_m], [dx], [dy], [0.0]]))


class CircleTrack(Track):
    """A circle."""

    def __init__(self, path: PathFunction, end: Point, sense: int) -> None:
        super().__init__(path, end, sense)
        self.circle = circle_of(path, end, sense)
        self.turn_m = 2 * math.pi * self.circle.radius_m

    def nearest(self, point: Point) -> Point:
        return self.circle.point_at(self.circle.angle_rad(point))

    def ahead_m(self, point: Point) -> float:
        return self.circle.radius_m * self.circle.sweep_rad(point, self._end)

    def radius_m(self) -> float:
        return self.circle.radius_m

    def approach(self) -> Point:
        return self.circle.point_at(self.circle.angle_rad(self._end) - self.circle.turn * math.pi / 2)

    def points(self, start: Point, distance_m: float, share: float, count: int) -> Iterator[tuple[Point, float]]:
        circle = self.circle
        first, sweep = circle.angle_rad(start), distance_m / circle.radius_m
        for i in range(count + 1):
            angle = first + circle.turn * sweep * i / count
            yield circle.point_at(angle), math.remainder(angle + circle.turn * math.pi / 2, 2 * math.pi)

    def remaining_m(self, point: Point, guess_m: float) -> float:
        ahead_m = self.ahead_m(point)
        # whole turns more, or less
        return ahead_m + self.turn_m * round((guess_m - ahead_m) / self.turn_m)

    def nodes(self, start: Point, distance_m: float, share: float) -> Nodes:
        circle = self.circle
        sweep = distance_m / circle.radius_m
        count = min(max(2, math.ceil(NODES_PER_QUARTER * sweep / (math.pi / 2))), MAX_NODES)
        at, weights = _gauss(count)
        course = circle.angle_rad(start) + circle.turn * (sweep * at + math.pi / 2)
        curvature = np.empty(count)
        curvature.fill(circle.turn / circle.radius_m)
        return Nodes(weights * distance_m, np.cos(course), np.sin(course), curvature)


class CurveTrack(Track):
    """A general curve, followed numerically."""

    def nearest(self, point: Point) -> Point:
        return project(self.path, point)

    def ahead_m(self, point: Point) -> float:
        return curve_length_m(self.path, self.nearest(point), self._end, self._sense)

    def radius_m(self) -> float:
        return radius_of_curvature_m(self.path, self.nearest(self._end))

    def approach(self) -> Point:
        back = points_along(self.path, self._end, -self._sense, 1.0)  # 1 m apart
        return next(itertools.islice(back, int(APPROACH_M), None))

    def points(self, start: Point, distance_m: float, share: float, count: int) -> Iterator[tuple[Point, float]]:
        points = points_along(self.path, start, self._sense, distance_m / count or 1.0)
        for point in itertools.islice(points, count):
            yield point, self._heading_rad(point)
        last = self.nearest(self._end) if share == 1 else next(points)
        yield last, self._heading_rad(last)

    def remaining_m(self, point: Point, guess_m: float) -> float:
        return guess_m

    def nodes(self, start: Point, distance_m: float, share: float) -> Nodes:
        count = max(1, math.ceil(distance_m / max(distance_m / CURVE_NODES, 1e-3) - 1e-9))
        headings = np.unwrap([heading for _, heading in self.points(start, distance_m, share, count)])
        middle = (headings[1:] + headings[:-1]) / 2
        step_m = distance_m / count
        curvature = np.diff(headings) / max(step_m, 1e-9)
        return Nodes(np.full(count, step_m), np.cos(middle), np.sin(middle), curvature)

    def _heading_rad(self, point: Point) -> float:
        x, y = tangent(self.path, point, self._sense)
        return math.atan2(y, x)


TRACKS: dict[str, type[Track]] = {LINE: LineTrack, CIRCLE: CircleTrack, CURVE: CurveTrack}


def radius_of_curvature_m(path: PathFunction, point: Point) -> float:
    """Radius of curvature of a path at a point of it [m]: |∇φ|³ / |φxx φy² − 2 φxy φx φy + φyy φx²|."""
    _, gx, gy, hxx, hxy, hyy = path(*point)
    bend = abs(hxx * gy * gy - 2 * hxy * gx * gy + hyy * gx * gx)
    return math.inf if bend == 0 else math.hypot(gx, gy) ** 3 / bend


@lru_cache(maxsize=MAX_NODES + 1)
def _gauss(count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre nodes and weights over [0, 1]."""
    at, weights = np.polynomial.legendre.leggauss(count)
    return (at + 1) / 2, weights / 2
