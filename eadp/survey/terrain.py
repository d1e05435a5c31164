"""The ground's height, from grids of it."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.geodesy import point_text, to_geodetic_deg
from eadp.errors import Infeasible, InputError, printable
from eadp.io.plan.sources import Ground


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


MARGIN_M = 1000.0
"""Ground that is read around the field and its ends [m]: turns of fast aircraft are 500 m wide."""

MAX_CELLS = 25_000_000
"""Most cells that are read of a file: 5 km by 5 km at 1 m, which are 200 MB."""

MAX_HEIGHT_M = 9000.0
"""Above every mountain [m]; heights in feet or centimetres are above it."""

_EXPECTED = "a GeoTIFF, or an .hgt of SRTM named as N55E010.hgt"


def read_terrain(files: Sequence[str], points_m: FloatArray, origin_deg: tuple[float, float]) -> ElevationModel:
    """The ground around points of a local frame, where files overlap of the first that knows it.

    Parameters
    ----------
    files : sequence of str
    points_m : array, shape (n, 2)
        Among them the corners of the field [m].
    origin_deg : (float, float)
        Latitude and longitude of the frame's origin [°].

    Raises
    ------
    InputError
        If a file cannot be read, the extra is not installed, or no file knows the height at one of the points.
    """
    low, high = points_m.min(axis=0) - MARGIN_M, points_m.max(axis=0) + MARGIN_M
    corners = [to_geodetic_deg(x, y, origin_deg) for x in (low[0], high[0]) for y in (low[1], high[1])]
    (south, west), (north, east) = np.min(corners, axis=0).tolist(), np.max(corners, axis=0).tolist()
    tiles = [_read(file, (south, west, north, east)) for file in files]
    terrain = ElevationModel(tuple(tile for tile in tiles if tile is not None), origin_deg)
    missing = points_m[np.isnan(terrain.heights_m(points_m))]
    if len(missing):
        message, expected = (
            f"no height at {terrain.place_text(missing[0])}",
            "a terrain without voids that holds the field",
        )
        raise InputError.at(files[0], 1, 1, message, f"{expected}; several are joined")
    return terrain


def ground_of(files: Sequence[str]) -> Ground:
    """The heights of files, those between which they do not know refused as `read_terrain` does."""
    return lambda points_m, origin_deg: read_terrain(files, points_m, origin_deg).heights_m(points_m)


def _read(file: str, wanted: tuple[float, float, float, float]) -> Tile | None:
    """What a file has of the bounds that are wanted: south, west, north, east [°]; None where nothing."""
    if not os.path.isfile(file):
        raise InputError.at(file, 1, 1, "no such file", _EXPECTED)
    try:
        import rasterio
        from rasterio.warp import transform
        from rasterio.windows import Window
    except ImportError:
        message = "rasterio, which reads terrains, is missing"
        raise InputError.at(file, 1, 1, message, "pip install 'eadp[terrain]'") from None
    try:
        # GDAL reads many formats, also ones that name other files; rasterio warns of its own dependencies
        driver = "SRTMHGT" if file.lower().endswith(".hgt") else "GTiff"
        with warnings.catch_warnings(action="ignore"), rasterio.open(file, driver=driver) as raster:
            if raster.crs is None or raster.transform.is_identity:
                raise InputError.at(file, 1, 1, "has no place on the earth", "a terrain with a reference system")
            if raster.count != 1:
                raise InputError.at(file, 1, 1, f"{raster.count} bands", "one, of heights [m]")
            to_cells, system = ~raster.transform, raster.crs

            def rows_columns(latitudes: FloatArray, longitudes: FloatArray) -> tuple[FloatArray, FloatArray]:
                x, y = map(np.asarray, transform("EPSG:4326", system, longitudes, latitudes))
                # a cell's centre is half a cell from its corner
                return (
                    to_cells.d * x + to_cells.e * y + to_cells.f - 0.5,
                    to_cells.a * x + to_cells.b * y + to_cells.c - 0.5,
                )

            sides, (south, west, north, east) = np.linspace(0, 1, 11), wanted
            grid = np.meshgrid(south + sides * (north - south), west + sides * (east - west))
            places = rows_columns(*(each.ravel() for each in grid))
            row, column = (max(0, math.floor(each.min())) for each in places)
            ends = [min(size, math.ceil(each.max()) + 2) for each, size in zip(places, raster.shape, strict=True)]
            height, width = ends[0] - row, ends[1] - column
            if min(height, width) <= 0:
                return None
            if height * width > MAX_CELLS:
                message = f"{height * width / 1e6:.0f} million cells within {MARGIN_M / 1000:g} km of the field"
                raise InputError.at(file, 1, 1, message, f"at most {MAX_CELLS / 1e6:.0f} million: a coarser terrain")
            window = Window(column, row, width, height)
            values = raster.read(1, window=window, masked=True).astype(float).filled(np.nan)
            heights_m = values * raster.scales[0] + raster.offsets[0]
    except InputError:
        raise
    except Exception as error:  # rasterio raises GDAL's errors besides its own
        raise InputError.at(file, 1, 1, f"cannot be read: {printable(str(error), 200)}", _EXPECTED) from None

    def cells(latitudes: FloatArray, longitudes: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows, columns = rows_columns(latitudes, longitudes)
        return rows - row, columns - column

    return Tile(_checked(file, heights_m), cells)


def _checked(file: str, heights_m: FloatArray) -> FloatArray:
    """Heights, NaN where they are not finite; refused where they are not in metres."""
    heights_m = np.where(np.isfinite(heights_m), heights_m, np.nan)
    beyond = np.abs(heights_m[~np.isnan(heights_m)]).max(initial=0.0)
    if beyond > MAX_HEIGHT_M:
        raise InputError.at(
            file, 1, 1, f"a height of {beyond:g} m", f"metres, at most {MAX_HEIGHT_M:g}; voids as nodata"
        )
    return heights_m
