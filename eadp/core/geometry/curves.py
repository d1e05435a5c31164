"""Kinds of path: lines, circles and curves; and travel along them."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.expressions.algebra import expanded
from eadp.core.expressions.derivatives import PathFunction
from eadp.core.expressions.tree import Expression
from eadp.errors import PathUndefined

LINE, CIRCLE, CURVE = "line", "circle", "curve"

Point = tuple[float, float]


def wrap_angle_rad(angle_rad: float) -> float:
    """The same direction in (−π, π]."""
    wrapped = math.remainder(angle_rad, 2 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


# --- kind of a path, from its expression ------------------------------------------------------------------------------

_POINT = re.compile(r"\b[xy]\b")


@lru_cache(maxsize=512)
def path_kind(expression: Expression) -> str:
    """`line`, `circle` or `curve`: what the zero set of a path function is by its form.

    Decided exactly: the expression is multiplied out, and is a line or a circle as a polynomial in x and y of degree 1
    or 2. What is no such polynomial is a curve.
    """
    try:
        terms = expanded(expression.node)
    except ArithmeticError:
        return CURVE
    of: dict[tuple[int, int], dict[tuple[str, ...], Fraction]] = {}
    for monomial, multiple in terms.items():
        power = monomial.count("x"), monomial.count("y")
        rest = tuple(factor for factor in monomial if factor not in ("x", "y"))
        if sum(power) > 2 or any(map(_POINT.search, rest)):
            return CURVE
        of.setdefault(power, {})[rest] = multiple
    # a x² + b xy + c y² + d x + e y + f: b = 0 and a = c ≠ 0 a circle; a = b = c = 0 a line
    if (1, 1) in of or of.get((2, 0)) != of.get((0, 2)):
        return CURVE
    return CIRCLE if (2, 0) in of else LINE if (1, 0) in of or (0, 1) in of else CURVE


# --- a path at given parameters ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Line:
    """A line as travelled: a point on it [m] and the unit direction."""

    point_m: Point
    direction: Point

    def progress_m(self, point: Point) -> float:
        """Signed distance along the line from `point_m` [m]."""
        dx, dy = point[0] - self.point_m[0], point[1] - self.point_m[1]
        return dx * self.direction[0] + dy * self.direction[1]


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle as travelled: centre [m], radius [m], and turn (+1 counter-clockwise, −1 clockwise)."""

    centre_m: Point
    radius_m: float
    turn: int

    def angle_rad(self, point: Point) -> float:
        """Direction from the centre to a point [rad]."""
        return math.atan2(point[1] - self.centre_m[1], point[0] - self.centre_m[0])

    def sweep_rad(self, start: Point, end: Point) -> float:
        """Angle travelled from one point to another [rad], in (0, 2π]: the same point is a whole turn."""
        # the remainder has the sign of its first argument
        sweep = math.fmod(self.turn * (self.angle_rad(end) - self.angle_rad(start)), 2 * math.pi)
        if sweep < 0:
            sweep += 2 * math.pi
        return sweep if sweep > 1e-9 else sweep + 2 * math.pi

    def point_at(self, angle_rad: float) -> Point:
        """The point on the circle in a direction from the centre [m]."""
        cx, cy = self.centre_m
        return cx + self.radius_m * math.cos(angle_rad), cy + self.radius_m * math.sin(angle_rad)


def line_of(path: PathFunction, near: Point, sense: int) -> Line:
    """The line of a path function of kind `line`, with the point of it nearest to `near`.

    Raises
    ------
    PathUndefined
        If its gradient is zero: there is no line.
    """
    value, gx, gy, *_ = _jet(path, near)
    square = gx * gx + gy * gy
    if square == 0:
        raise PathUndefined("has no gradient, so it is no line")
    norm = math.sqrt(square)
    foot = (near[0] - value * gx / square, near[1] - value * gy / square)
    return Line(foot, (-sense * gy / norm, sense * gx / norm))


def circle_of(path: PathFunction, near: Point, sense: int) -> Circle:
    """The circle of a path function of kind `circle`; φ is quadratic, so one evaluation determines it.

    Raises
    ------
    PathUndefined
        If the square of its radius is not above 0.
    """
    # φ = a(|p − centre|² − radius²): ∇φ = 2a(p − centre), H = 2a I, so p − centre = ∇φ/2a and
    # radius² = |p − centre|² − 2φ/2a; a < 0 turns the gradient inward, and so the travel round
    value, gx, gy, hxx, _, _ = _jet(path, near)
    if hxx == 0:
        raise PathUndefined("is no circle at these parameters")
    dx, dy = gx / hxx, gy / hxx
    square = dx * dx + dy * dy - 2 * value / hxx
    if not square > 0:
        raise PathUndefined(f"is a circle whose radius² is {square:g}")
    return Circle((near[0] - dx, near[1] - dy), math.sqrt(square), sense if hxx > 0 else -sense)


def project(path: PathFunction, point: Point, *, passes: int = 50) -> Point:
    """The point of a path near a point [m], by Newton's steps down the gradient.

    Raises
    ------
    PathUndefined
        If no point of the path is found.
    """
    x, y = point
    for _ in range(passes):
        value, gx, gy, *_ = _jet(path, (x, y))
        square = gx * gx + gy * gy
        if square == 0:
            break
        # p⁺ = p − φ ∇φ / |∇φ|²
        step = value / square
        x, y = x - step * gx, y - step * gy
        if abs(step) * math.sqrt(square) < 1e-10 * (1 + abs(x) + abs(y)):
            return x, y
    raise PathUndefined(f"has no point near ({point[0]:g}, {point[1]:g})")


def tangent(path: PathFunction, point: Point, sense: int) -> Point:
    """Unit direction of travel at a point of a path.

    Raises
    ------
    PathUndefined
        If the gradient is zero there.
    """
    _, gx, gy, *_ = _jet(path, point)
    norm = math.hypot(gx, gy)
    if norm == 0:
        raise PathUndefined(f"has no direction at ({point[0]:g}, {point[1]:g})")
    return -sense * gy / norm, sense * gx / norm


def points_along(path: PathFunction, start: Point, sense: int, step_m: float) -> Iterator[Point]:
    """Points along a path from the point of it near `start`, `step_m` [m] apart, without end.

    The midpoint rule along the tangent, then back onto the path by Newton's steps.
    """
    point = project(path, start)
    while True:
        yield point
        t = tangent(path, point, sense)  # t: the direction of travel at the point, then at the middle of the step
        middle = (point[0] + step_m / 2 * t[0], point[1] + step_m / 2 * t[1])
        t = tangent(path, middle, sense)
        point = project(path, (point[0] + step_m * t[0], point[1] + step_m * t[1]))


def curve_length_m(path: PathFunction, start: Point, end: Point, sense: int, *, limit_m: float = 20_000.0) -> float:
    """Distance along a path from one point of it to another [m]; infinite where it is not met within `limit_m`.

    The step is a hundredth of the distance between the two, between 0.1 and 5 m.
    """
    step_m = min(5.0, max(0.1, math.dist(start, end) / 100))
    length_m = 0.0
    ahead = False  # whether the end was ahead at the point before: passed where it no longer is, and is near
    for point in points_along(path, start, sense, step_m):
        t = tangent(path, point, sense)
        ahead_m = (end[0] - point[0]) * t[0] + (end[1] - point[1]) * t[1]  # of the end, along the tangent
        if ahead and ahead_m <= 0 and math.dist(point, end) < max(5 * step_m, 5.0):
            return max(0.0, length_m + ahead_m)
        ahead = ahead_m > 0
        length_m += step_m
        if length_m > limit_m:
            break
    return math.inf


def _jet(path: PathFunction, point: Point) -> Sequence[float]:
    """φ, φx, φy, φxx, φxy and φyy at a point. Raises PathUndefined where one is not finite."""
    try:
        jet = path(*point)
    except (ArithmeticError, ValueError):
        raise PathUndefined(f"has no value at ({point[0]:g}, {point[1]:g})") from None
    if not all(math.isfinite(value) for value in jet):
        raise PathUndefined(f"has no finite value at ({point[0]:g}, {point[1]:g})")
    return jet


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


class Track:
    """A path as travelled to a point: a general curve, followed numerically, or a line or circle of the classes below.

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

    def nearest(self, point: Point) -> Point:
        """The point of the path nearest to a point [m]; of a curve, the one that Newton's steps lead to."""
        return project(self.path, point)

    def ahead_m(self, point: Point) -> float:
        """Distance along the path from a point to the end [m]; infinite for a curve that does not meet it.

        On a line it is negative where the end lies behind; on a circle it is above 0, up to a whole turn.
        """
        return curve_length_m(self.path, self.nearest(point), self._end, self._sense)

    def radius_m(self) -> float:
        """Radius at the end [m]; infinite for a line."""
        return radius_of_curvature_m(self.path, self.nearest(self._end))

    def approach(self) -> Point:
        """A point of the path [m] from which the end can be approached: 100 m, or a quarter of a circle, before it."""
        back = points_along(self.path, self._end, -self._sense, 1.0)  # 1 m apart
        return next(itertools.islice(back, int(APPROACH_M), None))

    def points(self, start: Point, distance_m: float, share: float, count: int) -> FloatArray:
        """`count` + 1 points from a start along a distance [m]: x, y [m] and direction of travel [rad] of each.

        `share` is the distance as a share of that to the end: at 1, the last point is that of the end.
        """
        along = points_along(self.path, start, self._sense, distance_m / count or 1.0)
        points = [*itertools.islice(along, count + (share != 1))]
        points += [self.nearest(self._end)] if share == 1 else []
        return np.array([(*point, self._heading_rad(point)) for point in points])

    def remaining_m(self, point: Point, guess_m: float) -> float:
        """`ahead_m`, the one nearest to a guess [m] where the path closes; of a curve the guess."""
        return guess_m

    def nodes(self, start: Point, distance_m: float, share: float) -> Nodes:
        """Quadrature over a distance [m] from a start; `share` as in `points`."""
        count = max(1, math.ceil(distance_m / max(distance_m / CURVE_NODES, 1e-3) - 1e-9))
        headings = np.unwrap(self.points(start, distance_m, share, count)[:, 2])
        middle = (headings[1:] + headings[:-1]) / 2
        step_m = distance_m / count
        curvature = np.diff(headings) / max(step_m, 1e-9)
        return Nodes(np.full(count, step_m), np.cos(middle), np.sin(middle), curvature)

    def _heading_rad(self, point: Point) -> float:
        x, y = tangent(self.path, point, self._sense)
        return math.atan2(y, x)


class LineTrack(Track):
    """A straight line."""

    def __init__(self, path: PathFunction, end: Point, sense: int) -> None:
        super().__init__(path, end, sense)
        self.line = line_of(path, end, sense)

    def nearest(self, point: Point) -> Point:
        return line_of(self.path, point, self._sense).point_m

    def ahead_m(self, point: Point) -> float:
        return -self.line.progress_m(point)

    def remaining_m(self, point: Point, guess_m: float) -> float:
        return self.ahead_m(point)

    def approach(self) -> Point:
        (x, y), (dx, dy) = self.line.point_m, self.line.direction
        return x - APPROACH_M * dx, y - APPROACH_M * dy

    def points(self, start: Point, distance_m: float, share: float, count: int) -> FloatArray:
        line = line_of(self.path, start, self._sense)
        (x, y), (dx, dy) = line.point_m, line.direction
        along_m = line.progress_m(self._end) * share * np.arange(count + 1) / count
        return np.column_stack((x + along_m * dx, y + along_m * dy, np.full(count + 1, math.atan2(dy, dx))))

    def nodes(self, start: Point, distance_m: float, share: float) -> Nodes:
        dx, dy = self.line.direction
        return Nodes(*np.array([[distance_m], [dx], [dy], [0.0]]))


class CircleTrack(Track):
    """A circle."""

    def __init__(self, path: PathFunction, end: Point, sense: int) -> None:
        super().__init__(path, end, sense)
        self.circle = circle_of(path, end, sense)
        self.turn_m = 2 * math.pi * self.circle.radius_m  # the length of a whole turn [m]

    def nearest(self, point: Point) -> Point:
        return self.circle.point_at(self.circle.angle_rad(point))

    def ahead_m(self, point: Point) -> float:
        return self.circle.radius_m * self.circle.sweep_rad(point, self._end)

    def radius_m(self) -> float:
        return self.circle.radius_m

    def approach(self) -> Point:
        return self.circle.point_at(self.circle.angle_rad(self._end) - self.circle.turn * math.pi / 2)

    def points(self, start: Point, distance_m: float, share: float, count: int) -> FloatArray:
        (x, y), radius_m, turn = self.circle.centre_m, self.circle.radius_m, self.circle.turn
        angles = self.circle.angle_rad(start) + turn * distance_m / radius_m * np.arange(count + 1) / count
        courses = np.remainder(angles + turn * np.pi / 2 + np.pi, 2 * np.pi) - np.pi
        return np.column_stack((x + radius_m * np.cos(angles), y + radius_m * np.sin(angles), courses))

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


TRACKS: dict[str, type[Track]] = {LINE: LineTrack, CIRCLE: CircleTrack, CURVE: Track}


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
