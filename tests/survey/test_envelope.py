"""How far polygons reach in strips, beside shapely's own intersections."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from eadp.survey.swaths import EDGE_M, levels_above, upper_envelope


def star(seed, corners):
    """A polygon round the origin whose corners lie at any distance: bays and all."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.random(corners)) * 2 * math.pi
    radius = 50 + 250 * rng.random(corners)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def reach(points, u, width):
    """The highest y of a polygon in a strip, by shapely."""
    low, high = u - width / 2 + EDGE_M, u + width / 2 - EDGE_M
    cut = shapely.intersection(shapely.Polygon(points).buffer(0), shapely.box(low, -1e4, high, 1e4))
    return -math.inf if cut.is_empty else cut.bounds[3]


@given(st.integers(0, 10_000), st.integers(3, 30), st.floats(-300, 300), st.floats(5, 80))
def test_the_reach_in_a_strip_is_that_of_the_polygon_cut_out(seed, corners, u, width):
    points = star(seed, corners)
    if not shapely.Polygon(points).is_valid:
        return
    expected = reach(points, u, width)
    found = upper_envelope(points).over([u], width)[0]
    if math.isinf(expected):
        assert found == -math.inf or found <= points[:, 1].max()
    else:
        assert found == pytest.approx(expected, abs=1e-4)


@given(st.integers(0, 10_000), st.integers(3, 30), st.floats(10, 60), st.floats(0.0, 2.0))
@example(9999, 26, 13.78125, 0.0)  # an edge that rises by 20 km in a metre
def test_levels_are_never_below_what_strips_reach(seed, corners, width, slack):
    points = star(seed, corners)
    envelope = upper_envelope(points)
    left, right = points[:, 0].min(), points[:, 0].max()
    length = (right - left) / 3
    firsts = [left + width / 2, left + length]
    levels = levels_above([(envelope, first) for first in firsts], length, width, slack)
    places = np.linspace(0, length, 301)
    reached = np.max([envelope.over(first + places, width) for first in firsts], axis=0)
    # a strip's edge is known to a few EDGE_M: on an edge that is all but upright, that is millimetres of level
    bound = np.max([levels.at(np.clip(places + by, 0, length)) for by in (-4 * EDGE_M, 0.0, 4 * EDGE_M)], axis=0)
    assert (bound >= reached - 1e-3).all()
    assert levels.places_m[0] == 0
    assert levels.places_m[-1] == length
