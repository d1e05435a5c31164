"""Interpolation between measured configurations: linear, PCHIP, multilinear, barycentric; no extrapolation.

A configuration is a point of d coordinates with one measured value. A coordinate that is the same in all measurements
is fixed: a configuration with another value there is outside the measured range.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray
from eadp.errors import Infeasible

Point = tuple[float, ...]
Kind = Literal["linear", "pchip"]

EDGE = 1e-9
"""Tolerance at the edge of the measured range, as a fraction of it: rounding, not extrapolation."""


class _Piece(Protocol):
    """An interpolation over the varying coordinates, inside their box; `nearest` is within the measured ones' hull."""

    def at(self, point: Sequence[float]) -> float: ...

    def nearest(self, point: Sequence[float]) -> Sequence[float]:
        return point


@dataclass(frozen=True)
class Interpolant:
    """Values between measured configurations; built once by `interpolant`, evaluated often.

    `lower`, `upper` are the smallest and largest measured value of each of the d coordinates.
    """

    lower: Point
    upper: Point
    _lower_edge: Point
    _upper_edge: Point
    _varying: tuple[int, ...]
    _piece: _Piece

    def at(self, configuration: Sequence[float]) -> float:
        """Value at one configuration.

        Parameters
        ----------
        configuration : d floats

        Returns
        -------
        float
            Interpolated value; at a measured configuration, the measured value.

        Raises
        ------
        Infeasible
            Outside the measured range, NaN included.
        """
        for value, low, high in zip(configuration, self._lower_edge, self._upper_edge, strict=True):
            if not low <= value <= high:
                raise Infeasible(f"{tuple(configuration)} is outside the measured range")
        return self._piece.at(self._varying_part(self.clipped(configuration)))

    def nearest(self, configuration: Sequence[float]) -> Point:
        """The nearest configuration inside the measured range.

        Each coordinate goes to its own measured range first; if that is still outside the hull of scattered points,
        to the nearest measured configuration, coordinates scaled by their ranges.

        Raises
        ------
        Infeasible
            If a coordinate is not a finite number.
        """
        if not all(map(math.isfinite, configuration)):
            raise Infeasible(f"{tuple(configuration)} is not a finite configuration")
        result = list(self.clipped(configuration))
        for axis, value in zip(self._varying, self._piece.nearest(self._varying_part(result)), strict=True):
            result[axis] = value
        return tuple(result)

    def clipped(self, configuration: Sequence[float]) -> Point:
        """The configuration with each coordinate clipped to its measured range."""
        bounds = zip(configuration, self.lower, self.upper, strict=True)
        return tuple([min(max(value, lower), upper) for value, lower, upper in bounds])

    def _varying_part(self, configuration: Sequence[float]) -> Sequence[float]:
        return [configuration[axis] for axis in self._varying]


def interpolant(configurations: ArrayLike, values: ArrayLike, kind: Kind = "linear") -> Interpolant:
    """Build the interpolation that the measured configurations allow.

    One changing coordinate: straight lines between neighbours, or PCHIP. A full grid: multilinear. Anything
    else: linear over the triangles (tetrahedra, …) of the points, by barycentric weights.

    Parameters
    ----------
    configurations : array, shape (n, d)
        Distinct measured configurations, n at least 2.
    values : array, shape (n,)
        What was measured at each, as finite as the configurations.
    kind : str
        `linear`, or `pchip` where one coordinate changes.

    Returns
    -------
    Interpolant

    Raises
    ------
    Infeasible
        If the configurations span nothing to interpolate over (fewer than two, or on one line in a plane), if
        they are too close together, or if `kind` is `pchip` and several coordinates change.

    Source: letter, Eq. 13, corrected: g = g(⌊c⌋) + (g(⌈c⌉) − g(⌊c⌋)) (c − ⌊c⌋)/(⌈c⌉ − ⌊c⌋), where ⌊c⌋ and ⌈c⌉
    are the measured neighbours of c. PCHIP: Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980), as in scipy.
    """
    points, measured = np.array(configurations, dtype=np.float64), np.array(values, dtype=np.float64)
    lower, upper = points.min(axis=0), points.max(axis=0)
    span = upper - lower
    varying = tuple(int(axis) for axis in np.flatnonzero(span > 0))
    if not varying:
        raise Infeasible("there is one configuration only: nothing to interpolate between")
    slack = EDGE * np.where(span > 0, span, np.abs(lower))
    piece = _piece(points[:, varying], measured, kind)
    return Interpolant(_floats(lower), _floats(upper), _floats(lower - slack), _floats(upper + slack), varying, piece)


def _piece(points: FloatArray, values: FloatArray, kind: Kind) -> _Piece:
    """The interpolation of n distinct points whose d coordinates all change."""
    order = np.lexsort(points.T[::-1])  # the first coordinate changes slowest
    points, values = points[order], values[order]
    if kind == "pchip":
        if points.shape[1] > 1:
            raise Infeasible(f"pchip needs one changing parameter, and {points.shape[1]} change")
        return _Pchip(points[:, 0], values)
    levels = [np.unique(column) for column in points.T]
    if len(points) == math.prod(map(len, levels)):
        return _Grid(tuple(map(_floats, levels)), _floats(values))
    return _Scattered(points, values)


@dataclass(frozen=True)
class _Grid(_Piece):
    """Multilinear over a full grid: `values` in row-major order of `levels`."""

    levels: tuple[Point, ...]
    values: Point

    def at(self, point: Sequence[float]) -> float:
        # Eq. 13 on each axis in turn, multiplied out to weights of the corners of the cell
        corners = [(0, 1.0)]
        for knots, value in zip(self.levels, point, strict=True):
            i, t = _cell(knots, value)
            n = len(knots)
            ends = ((i, 1.0 - t), (i + 1, t))
            corners = [(flat * n + k, weight * w) for flat, weight in corners for k, w in ends]
        return math.fsum([weight * self.values[flat] for flat, weight in corners])


def _cell(knots: Point, value: float) -> tuple[int, float]:
    """Index of the knot below a value (the last cell holds its end), and how far towards the next, 0..1."""
    i = min(bisect_right(knots, value), len(knots) - 1) - 1
    return i, (value - knots[i]) / (knots[i + 1] - knots[i])


class _Pchip(_Piece):
    """Monotone cubics between neighbouring knots."""

    def __init__(self, knots: FloatArray, values: FloatArray) -> None:
        from scipy.interpolate import PchipInterpolator

        self._end, self._end_value = float(knots[-1]), float(values[-1])
        too_close = Infeasible("the configurations are too close together for pchip")
        try:
            with np.errstate(all="ignore"):
                self._curve = PchipInterpolator(knots, values)
        except ValueError:  # of finite and increasing knots, scipy refuses only slopes that are not finite
            raise too_close from None
        if not np.all(np.isfinite(self._curve.c)):
            raise too_close

    def at(self, point: Sequence[float]) -> float:
        # exact at the last knot, without the rounding of its segment
        return self._end_value if point[0] >= self._end else float(self._curve(point[0]))


class _Scattered(_Piece):
    """Barycentric over the Delaunay simplices of n points in d coordinates, scaled to 0..1."""

    def __init__(self, points: FloatArray, values: FloatArray) -> None:
        from scipy.spatial import Delaunay, QhullError

        self._points, self._values = points, values
        self._lower, self._span = points.min(axis=0), np.ptp(points, axis=0)
        scaled = self._scaled(points)
        flat = "the configurations are no full grid and lie on one line (or plane)"
        if np.linalg.matrix_rank(scaled - scaled.mean(axis=0), tol=1e-6) < points.shape[1]:
            raise Infeasible(flat)
        try:
            self._mesh = Delaunay(scaled)
        except QhullError:
            raise Infeasible(flat) from None

    def at(self, point: Sequence[float]) -> float:
        scaled = self._scaled(point)
        simplex = self._mesh.find_simplex(scaled, tol=EDGE)
        if simplex < 0:
            raise Infeasible(f"{tuple(point)} is outside the hull of the measured configurations")
        # λ = T (x − r) for the first d, the last makes the sum 1
        *rows, origin = self._mesh.transform[simplex]
        first = rows @ (scaled - origin)
        weights = np.maximum([*first, 1.0 - first.sum()], 0.0)
        return float(weights @ self._values[self._mesh.simplices[simplex]] / weights.sum())

    def nearest(self, point: Sequence[float]) -> Sequence[float]:
        scaled = self._scaled(point)
        if self._mesh.find_simplex(scaled, tol=EDGE) >= 0:
            return point
        return _floats(self._points[np.argmin(np.sum((self._scaled(self._points) - scaled) ** 2, axis=1))])

    def _scaled(self, points: ArrayLike) -> FloatArray:
        scaled: FloatArray = (np.asarray(points) - self._lower) / self._span
        return scaled


def _floats(values: ArrayLike) -> Point:
    return tuple(float(value) for value in np.asarray(values))
