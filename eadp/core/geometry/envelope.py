"""Envelopes of a polygon along parallel strips: the extents of swaths.

All in a frame whose first axis u runs across the lines and whose second, v, along them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray

SAME_M = 1e-9
"""Distance within which two abscissae are one."""

EDGE_M = 1e-6
"""Overlap with a strip, along its edge, below which an area belongs to the neighbouring strip."""


@dataclass(frozen=True)
class Envelope:
    """The upper boundary of a polygon as pieces of straight line: over [left, right] from `start` to `end` [m]."""

    left_m: FloatArray
    right_m: FloatArray
    start_m: FloatArray
    end_m: FloatArray

    def over(self, centres_m: ArrayLike, width_m: float) -> FloatArray:
        """The maximum v over strips [u − w/2, u + w/2].

        Parameters
        ----------
        centres_m : array, shape (n,)
            Middles of the strips [m].
        width_m : float
            Their width w [m].

        Returns
        -------
        array, shape (n,)
            The maximum v [m]; −∞ for a strip outside the polygon.
        """
        # of each strip, row, with each piece, column: the v at both ends of what they share
        u = np.atleast_1d(np.asarray(centres_m, dtype=float))[:, None]
        low = np.maximum(u - width_m / 2 + EDGE_M, self.left_m)
        high = np.minimum(u + width_m / 2 - EDGE_M, self.right_m)
        slope = (self.end_m - self.start_m) / (self.right_m - self.left_m)
        at_low = self.start_m + slope * (low - self.left_m)
        at_high = self.start_m + slope * (high - self.left_m)
        top = np.where(low <= high, np.maximum(at_low, at_high), -np.inf)
        return np.asarray(top.max(axis=1))


def upper_envelope(points_m: FloatArray) -> Envelope:
    """The upper boundary of a polygon; concavities and holes below it are filled.

    Parameters
    ----------
    points_m : array, shape (n, 2)
        The vertices (u, v) [m], in order, either way round.
    """
    start, end = points_m, np.roll(points_m, -1, axis=0)
    # between the abscissae of two neighbouring vertices, one edge is the uppermost throughout
    vertices = np.sort(points_m[:, 0])
    vertices = vertices[np.concatenate(([True], np.diff(vertices) > SAME_M))]
    left, right = vertices[:-1], vertices[1:]
    middle = (left + right) / 2
    low, high = np.minimum(start[:, 0], end[:, 0]), np.maximum(start[:, 0], end[:, 0])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slope = (end[:, 1] - start[:, 1]) / (end[:, 0] - start[:, 0])

        def edge(u: FloatArray) -> FloatArray:
            """v of every edge, column, at abscissae, rows [m]."""
            return np.asarray(start[:, 1] + slope * (u[:, None] - start[:, 0]))

        spans = (low < middle[:, None]) & (middle[:, None] < high)
        top = np.where(spans, edge(middle), -np.inf).argmax(axis=1)
        rows = np.arange(len(middle))
        return Envelope(left, right, edge(left)[rows, top], edge(right)[rows, top])


@dataclass(frozen=True)
class PiecewiseLinear:
    """A piecewise linear function: levels [m] at knots `places_m` [m]."""

    places_m: tuple[float, ...]
    levels_m: tuple[float, ...]

    def at(self, place_m: ArrayLike) -> FloatArray:
        """The level at an abscissa [m], constant beyond the ends."""
        return np.asarray(np.interp(np.asarray(place_m, dtype=float), self.places_m, self.levels_m))


def levels_above(
    envelopes: list[tuple[Envelope, float]], length_m: float, width_m: float, slack_m: float = 0.3
) -> PiecewiseLinear:
    """An upper bound of the levels that strips moving together reach, with few knots.

    Parameters
    ----------
    envelopes : list of (Envelope, float)
        Each boundary with where its strip's middle is at the start [m].
    length_m, width_m : float
        How far the strips move, and how wide they are [m].
    slack_m : float
        Mean excess of the bound between knots that is allowed for fewer knots [m].

    Returns
    -------
    PiecewiseLinear
        Over 0 to `length_m`.
    """
    knots = [0.0, length_m]
    for envelope, first in envelopes:
        corners = np.concatenate((envelope.left_m, envelope.right_m)) - first
        inside = width_m / 2 - 2 * EDGE_M  # so that a strip contains a corner at the corner's knots
        knots += [*(corners - inside), *(corners + inside)]
    places = np.unique(np.clip(knots, 0.0, length_m))
    places = places[np.concatenate(([True], np.diff(places) > 1e-6))]
    places[-1] = length_m
    # between knots the reach of a strip is a maximum of lines, which is convex: a chord lies above it
    levels = np.max([_filled(places, envelope.over(first + places, width_m)) for envelope, first in envelopes], axis=0)
    return _thinned(places.tolist(), levels.tolist(), slack_m)


def _filled(places: FloatArray, levels: FloatArray) -> FloatArray:
    """Levels where a strip lies outside the polygon: interpolated from where it overlaps."""
    known = np.isfinite(levels)
    return np.interp(places, places[known], levels[known])


def _thinned(places: list[float], levels: list[float], slack_m: float) -> PiecewiseLinear:
    """Remove knots under the chord of their neighbours, those of least cost first."""
    while len(places) > 2:
        # the knot of least mean rise of the bound, and that rise; -1 for none
        cheapest, rise_of_cheapest = -1, slack_m
        for i in range(1, len(places) - 1):
            share = (places[i] - places[i - 1]) / (places[i + 1] - places[i - 1])
            rise = levels[i - 1] + share * (levels[i + 1] - levels[i - 1]) - levels[i]
            if -EDGE_M <= rise <= 2 * rise_of_cheapest:  # a triangle's mean height is half its height
                cheapest, rise_of_cheapest = i, rise / 2
        if cheapest < 0:
            break
        del places[cheapest], levels[cheapest]
    return PiecewiseLinear(tuple(places), tuple(levels))
