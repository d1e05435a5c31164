"""The ground's height, from grids of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.geodesy import point_text, to_geodetic_deg
from eadp.errors import Infeasible


class Tile(NamedTuple):
    """A grid of heights.

    Attributes
    ----------
    heights_m : array, shape (rows, columns)
        Above the sea [m]; NaN where it is not known.
    cells : function
        From latitudes and longitudes [°] to rows and columns, whole at the centre of a cell.
    """

    heights_m: FloatArray
    cells: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class ElevationModel:
    """The ground of a local frame, from the first of some tiles that knows it."""

    tiles: tuple[Tile, ...]
    origin_deg: tuple[float, float]

    def heights_m(self, points_m: FloatArray) -> FloatArray:
        """Height of the ground above the sea [m], bilinear between the centres of cells; NaN where it is not known.

        Parameters
        ----------
        points_m : array, shape (n, 2)
            In the local frame [m].

        Returns
        -------
        array, shape (n,)
        """
        places = np.array([to_geodetic_deg(x, y, self.origin_deg) for x, y in points_m.tolist()]).reshape(-1, 2)
        found = np.full(len(places), np.nan)
        for tile in self.tiles:
            left = np.flatnonzero(np.isnan(found))
            found[left] = bilinear(tile.heights_m, *tile.cells(*places[left].T))
        return found

    @cached_property
    def cell_m(self) -> float:
        """The least distance between the centres of cells at the origin [m]."""
        latitudes, longitudes = np.array(
            [to_geodetic_deg(*at_m, self.origin_deg) for at_m in ((0, 0), (1, 0), (0, 1))]
        ).T
        along = [place for tile in self.tiles for place in tile.cells(latitudes, longitudes)]
        return 1 / max((math.hypot(*(place[1:] - place[0])) for place in along), default=1.0)

    def place_text(self, point_m: FloatArray) -> str:
        """A point, shape (2,) [m], for people."""
        return point_text((float(point_m[0]), float(point_m[1])), self.origin_deg)

    def grid(self, points_m: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
        """Heights over the box of points, shape (count, count) from south-west, and the steps to x and y [m]."""
        low, high = points_m.min(axis=0), points_m.max(axis=0)
        x, y = np.linspace(low, high, count).T
        nodes = np.column_stack([each.ravel() for each in np.meshgrid(x, y)])
        return self.heights_m(nodes).reshape(count, count), (high - low) / (count - 1)

    def known_m(self, points_m: FloatArray) -> FloatArray:
        """`heights_m` where all are known.

        Raises
        ------
        Infeasible
            With the first place of which the height is not known.
        """
        heights_m = self.heights_m(points_m)
        if len(missing := np.flatnonzero(np.isnan(heights_m))):
            place = self.place_text(points_m[missing[0]])
            raise Infeasible(f"the terrain has no height at {place}, where the flight leads")
        return heights_m


def bilinear(values: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    """Values of a grid between its nodes.

    Parameters
    ----------
    values : array, shape (m, n)
    rows, columns : array, shape (k,)
        Half a cell beyond the outer nodes their value holds, as a cell has one.

    Returns
    -------
    array, shape (k,)
        NaN beyond, and beside a node that is NaN.
    """
    from scipy.ndimage import map_coordinates

    inside = (np.abs(rows - (values.shape[0] - 1) / 2) <= values.shape[0] / 2) & (
        np.abs(columns - (values.shape[1] - 1) / 2) <= values.shape[1] / 2
    )
    found = np.full(len(rows), np.nan)
    found[inside] = map_coordinates(values, [rows[inside], columns[inside]], order=1, mode="nearest")
    return found
