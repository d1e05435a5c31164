"""Grids of heights as files."""

import warnings

import numpy as np


def from_corner(west, north, step):
    """The place of cells of a size, from the north-west corner."""
    from affine import Affine

    return Affine(step, 0, west, 0, -step, north)


def write_geotiff(path, heights_m, transform, system="EPSG:4326", **options):
    """A GeoTIFF of heights; `transform` places the corners of its cells."""
    import rasterio

    heights_m = np.asarray(heights_m)
    rows, columns = heights_m.shape
    with warnings.catch_warnings(action="ignore"), rasterio.open(
        path, "w", driver="GTiff", height=rows, width=columns, count=1, dtype=heights_m.dtype, crs=system,
        transform=transform, **options,
    ) as raster:  # fmt: skip
        raster.write(heights_m, 1)
    return str(path)


def write_degrees(path, height, south_west, north_east, step_deg=1 / 3600, **options):
    """A GeoTIFF in degrees of a function of latitudes and longitudes [°], by whole cells from its north-west corner."""
    (south, west), (north, east) = south_west, north_east
    rows, columns = round((north - south) / step_deg), round((east - west) / step_deg)
    latitudes = north - (np.arange(rows)[:, None] + 0.5) * step_deg
    longitudes = west + (np.arange(columns)[None] + 0.5) * step_deg
    heights_m = np.broadcast_to(height(latitudes, longitudes), (rows, columns)).astype("float32")
    return write_geotiff(path, heights_m, from_corner(west, north, step_deg), **options)


def write_hgt(path, heights_m):
    """A degree of SRTM, rows from north."""
    np.asarray(heights_m).astype(">i2").tofile(path)
    return str(path)
