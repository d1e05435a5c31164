"""Compass bearings and mathematical angles, by cases worked by hand."""

import math

import pytest

from eadp.core.geometry.geodesy import blowing_to_rad, compass_deg, heading_rad

NORTH, EAST, SOUTH, WEST = math.pi / 2, 0.0, -math.pi / 2, math.pi


@pytest.mark.parametrize(("bearing", "angle"), [(0, NORTH), (90, EAST), (180, SOUTH), (270, WEST), (45, math.pi / 4)])
def test_headings(bearing, angle):
    assert compass_deg(angle) == pytest.approx(bearing)
    assert math.cos(heading_rad(bearing) - angle) == pytest.approx(1)


@pytest.mark.parametrize(("comes_from", "drifts"), [(270, (1, 0)), (0, (0, -1)), (180, (0, 1)), (90, (-1, 0))])
def test_a_west_wind_drifts_east(comes_from, drifts):
    angle = blowing_to_rad(comes_from)
    assert (math.cos(angle), math.sin(angle)) == pytest.approx(drifts, abs=1e-12)
