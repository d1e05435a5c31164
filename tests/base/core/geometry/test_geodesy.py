"""Bearings, worked by hand, and the tangent plane: round trips, distances along the axes, and pyproj if installed."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.geometry.geodesy import blowing_to_rad, compass_deg, heading_rad, to_geodetic_deg, to_local_m

ODENSE = (55.37, 10.43)
latitudes = st.floats(-89, 89)
longitudes = st.floats(-179.9, 179.9)
metres = st.floats(-5000, 5000)
MILLIMETRE = 1e-3


def test_the_origin_is_the_origin():
    assert to_geodetic_deg(0, 0, ODENSE) == pytest.approx(ODENSE, abs=1e-12)
    assert to_local_m(*ODENSE, ODENSE) == pytest.approx((0, 0), abs=1e-9)


@given(latitudes, longitudes, metres, metres)
def test_there_and_back(latitude, longitude, east, north):
    origin = (latitude, longitude)
    back = to_local_m(*to_geodetic_deg(east, north, origin), origin)
    # the plane lies d²/2R above the ellipsoid and the way down leans by d/R: the way back is d³/2R² short, 4 mm here
    short = math.hypot(east, north) ** 3 / (2 * 6.33e6**2)
    assert back == pytest.approx((east, north), abs=1.02 * short + 1e-6)


def test_a_minute_of_latitude_is_a_nautical_mile():
    _, north = to_local_m(ODENSE[0] + 1 / 60, ODENSE[1], ODENSE)
    # meridian radius of curvature a(1 − e²)/(1 − e² sin²φ)^1.5 at the middle
    e2 = 0.0066943799901413165
    radius = 6378137 * (1 - e2) / (1 - e2 * math.sin(math.radians(ODENSE[0] + 1 / 120)) ** 2) ** 1.5
    assert north == pytest.approx(radius * math.radians(1 / 60), abs=0.01)


@pytest.mark.parametrize("origin", [ODENSE, (0.0, 0.0), (-33.9, 151.2), (89.9, 10.0)])
def test_against_pyproj(origin):
    pyproj = pytest.importorskip("pyproj", reason="pyproj is not installed (extra maps)")
    pipeline = (
        f"+proj=pipeline +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={origin[0]} +lon_0={origin[1]} +h_0=0"
    )
    transformer = pyproj.Transformer.from_pipeline(pipeline)
    for east, north in ((0, 0), (100, 0), (0, -250), (-1234.5, 987.6)):
        latitude, longitude = to_geodetic_deg(east, north, origin)
        x, y, _ = transformer.transform(longitude, latitude, 0.0)
        assert to_local_m(latitude, longitude, origin) == pytest.approx((x, y), abs=1e-6)
        assert (x, y) == pytest.approx((east, north), abs=MILLIMETRE)


NORTH, EAST, SOUTH, WEST = math.pi / 2, 0.0, -math.pi / 2, math.pi


@pytest.mark.parametrize(("bearing", "angle"), [(0, NORTH), (90, EAST), (180, SOUTH), (270, WEST), (45, math.pi / 4)])
def test_headings(bearing, angle):
    assert compass_deg(angle) == pytest.approx(bearing)
    assert math.cos(heading_rad(bearing) - angle) == pytest.approx(1)


@pytest.mark.parametrize(("comes_from", "drifts"), [(270, (1, 0)), (0, (0, -1)), (300, (0.75**0.5, -0.5))])
def test_a_west_wind_drifts_east(comes_from, drifts):
    angle = blowing_to_rad(comes_from)
    assert (math.cos(angle), math.sin(angle)) == pytest.approx(drifts, abs=1e-12)
