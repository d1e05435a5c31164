"""Terrain files: heights beside scipy's and pyproj's, files joined, voids, and what is refused."""

import numpy as np
import pytest
from common.terrains import from_corner, write_degrees, write_geotiff, write_hgt

from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.errors import InputError
from eadp.survey.terrain import read_terrain

pytest.importorskip("rasterio")

ORIGIN = (55.5, 10.5)
POINTS = np.random.default_rng(1).uniform(-900, 900, (40, 2))
FLOAT32 = 1e-4
"""Rounding of heights up to 1000 m in 32 bits [m]."""


def _degrees(points=POINTS, origin=ORIGIN):
    return np.array([to_geodetic_deg(*point, origin) for point in points.tolist()])


def _hills(latitudes, longitudes):
    return 100 + 40 * np.sin(300 * latitudes) * np.cos(200 * longitudes) + 1000 * (latitudes - 55.5)


def test_heights_between_cells_are_scipys(tmp_path):
    from scipy.interpolate import RegularGridInterpolator

    file = write_degrees(tmp_path / "a.tif", _hills, (55.45, 10.4), (55.55, 10.6))
    step = 1 / 3600
    latitudes, longitudes = 55.45 + (np.arange(360) + 0.5) * step, 10.4 + (np.arange(720) + 0.5) * step
    grid = RegularGridInterpolator((latitudes, longitudes), _hills(latitudes[:, None], longitudes[None]))
    assert read_terrain([file], POINTS, ORIGIN).heights_m(POINTS) == pytest.approx(grid(_degrees()), abs=1e-3)


def test_a_plane_in_utm_is_that_plane(tmp_path):
    pyproj = pytest.importorskip("pyproj")
    to_utm = pyproj.Transformer.from_crs(4326, 32632, always_xy=True).transform
    east, north = to_utm(ORIGIN[1], ORIGIN[0])
    west, top = round(east) - 3000, round(north) + 3000
    x, y = west + 10 * np.arange(600) + 5, top - 10 * np.arange(600) - 5
    heights_m = 0.1 * (x[None] - east) - 0.05 * (y[:, None] - north) + 300
    file = write_geotiff(tmp_path / "utm.tif", heights_m.astype("float32"), from_corner(west, top, 10), "EPSG:32632")
    xs, ys = to_utm(*_degrees().T[::-1])
    expected = 0.1 * (xs - east) - 0.05 * (ys - north) + 300
    assert read_terrain([file], POINTS, ORIGIN).heights_m(POINTS) == pytest.approx(expected, abs=FLOAT32)


@pytest.mark.quick(2)
@pytest.mark.parametrize("posts", [1201, 3601])
@pytest.mark.parametrize(("name", "origin"), [("N55E010", ORIGIN), ("S13W071", (-12.5, -70.5))])
def test_a_degree_of_srtm(tmp_path, posts, name, origin):
    # heights of whole metres that are linear in degrees: a row is `step` lower than the one north of it
    step = 3600 // (posts - 1)
    heights_m = 3600 - step * np.arange(posts)[:, None] + step * np.arange(posts)[None]
    file = write_hgt(tmp_path / f"{name}.hgt", heights_m)
    south, west = np.floor(origin)
    latitudes, longitudes = _degrees(origin=origin).T
    expected = 3600 * (latitudes - south) + 3600 * (longitudes - west)
    assert read_terrain([file], POINTS, origin).heights_m(POINTS) == pytest.approx(expected, abs=1e-6)


def test_files_are_joined_and_the_first_that_knows_holds(tmp_path):
    west = write_degrees(tmp_path / "w.tif", lambda a, b: 0 * a + 10, (55.45, 10.4), (55.55, 10.5))
    both = write_degrees(tmp_path / "b.tif", lambda a, b: 0 * a + 20, (55.45, 10.4), (55.55, 10.6))
    heights_m = read_terrain([west, both], POINTS, ORIGIN).heights_m(POINTS)
    east = _degrees()[:, 1] > 10.5
    assert heights_m == pytest.approx(np.where(east, 20.0, 10.0))
    with pytest.raises(InputError, match=r"no height at 55\.\d+,10\.5\d+"):
        read_terrain([west], POINTS, ORIGIN)


@pytest.mark.parametrize("void", [-9999.0, np.nan])
def test_a_void_in_the_field_is_refused_and_one_beside_it_is_not(tmp_path, void):

    def holed(near):
        return lambda a, b: np.where(np.hypot(a - 55.5, b - near) < 0.006, void, 50.0)

    beside = write_degrees(tmp_path / "beside.tif", holed(10.57), (55.45, 10.4), (55.55, 10.6), nodata=void)
    assert read_terrain([beside], POINTS, ORIGIN).heights_m(POINTS) == pytest.approx(50.0)
    inside = write_degrees(tmp_path / "inside.tif", holed(10.5), (55.45, 10.4), (55.55, 10.6), nodata=void)
    with pytest.raises(InputError, match="no height at"):
        read_terrain([inside], POINTS, ORIGIN)
    # another file fills it
    assert read_terrain([inside, beside], POINTS, ORIGIN).heights_m(POINTS) == pytest.approx(50.0)


def test_what_is_no_terrain_is_refused(tmp_path):
    there = from_corner(10.4, 55.6, 0.001)
    flat = np.zeros((200, 200), "float32")
    files = {
        "no such file": str(tmp_path / "none.tif"),
        "cannot be read": str(tmp_path / "text.tif"),
        "has no place on the earth": write_geotiff(tmp_path / "nowhere.tif", flat, there, None),
        "a height of 12000 m": write_geotiff(tmp_path / "feet.tif", flat + 12000, there),
        "cannot be read: .*hills.hgt": write_hgt(tmp_path / "hills.hgt", flat),
    }
    (tmp_path / "text.tif").write_text("no raster")
    for message, file in files.items():
        with pytest.raises(InputError, match=message) as raised:
            read_terrain([file], POINTS, ORIGIN)
        assert raised.value.faults[0].file == file
