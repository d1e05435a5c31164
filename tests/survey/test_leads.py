"""Straight ways before lines, and how far polygons reach in strips: by hand and by shapely."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from common import few
from hypothesis import example, given
from hypothesis import strategies as st

from eadp.models.airspace import CLEARANCE_SHARE, Airspace, Field, Obstacle
from eadp.models.performance import roll_out_m
from eadp.models.vehicle import FixedWing, PaperVehicle
from eadp.survey.coverage import CoverageRequest, cover
from eadp.survey.swaths import MotionLimits
from eadp.survey.zamboni import EDGE_M, edges_of, levels_above, top_m

BOX = ((0.0, 0.0), (600.0, 0.0), (600.0, 400.0), (0.0, 400.0))
MOTION = MotionLimits(40.0, 25.0, 37.5, 20.0)
LED = replace(MOTION, lead_in_m=35.0)
MAST = ((250.0, 150.0), (330.0, 150.0), (330.0, 260.0), (250.0, 260.0))


@pytest.mark.quick(1)
@pytest.mark.parametrize("limits", [Airspace(), Airspace((Obstacle(MAST, "mast"),))])
@pytest.mark.parametrize("wind", few([(3.0, 4.0), (0.0, 0.0)], 1))
def test_each_line_has_its_straight_ways(limits, wind):
    field, motion = Field(BOX, airspace=limits), replace(LED, wind_mps=wind)
    legs = cover(CoverageRequest(field, motion, "dubins")).path(0.0).legs
    lines = [i for i, leg in enumerate(legs) if leg.sensing]
    for i in lines:
        before, line = legs[i - 1 : i + 1]
        assert before.piece.length_m == pytest.approx(35.0)
        assert before.piece.turn == 0
        assert before.start[2] == pytest.approx(line.start[2])
        assert not before.sensing
    mast = shapely.Polygon(MAST)
    clear_m = CLEARANCE_SHARE * 25.0 - 0.05
    for leg in legs if any(limits) else ():
        points = [leg.piece.pose_at(s)[:2] for s in np.linspace(0, leg.piece.length_m, 60)]
        assert shapely.LineString(points).distance(mast) > clear_m


def test_the_lines_are_the_same_and_the_flight_is_longer():
    field = Field(BOX)
    bare, led = (cover(CoverageRequest(field, m, "dubins", 0.0)).path(0.0) for m in (MOTION, LED))
    assert bare.lines == led.lines == 10
    assert sorted(leg.piece.length_m for leg in led.legs if leg.sensing) == pytest.approx([600.0] * 10)
    # a turn joins the end of a line and the start of a lead-in, 35 m apart along them
    more_m = led.length_m - bare.length_m
    assert 10 * 35 <= more_m <= 10 * 35 + 9 * 35


def test_laps_turn_as_far_out_as_the_lead_in_needs():
    field = Field(BOX)
    bare, led = (cover(CoverageRequest(field, m, "zamboni", 0.0)).path(0.0) for m in (MOTION, LED))
    lengths = [[leg.piece.length_m for leg in path.legs if leg.sensing] for path in (bare, led)]
    assert np.array(lengths[1]) - lengths[0] == pytest.approx(np.full(len(lengths[0]), 70.0))


def test_an_aircraft_rolls_out_of_its_steepest_turn():
    airframe = FixedWing(mass_kg=2, wing_area_m2=0.4, aspect_ratio=8, zero_lift_drag_coefficient=0.03,
                         max_bank_deg=40, roll_time_constant_s=0.5)  # fmt: skip
    bank, flown_m, step_s = 40.0, 0.0, 1e-4
    while bank > 2:  # φ̇ = −φ/τ
        bank, flown_m = bank * (1 - step_s / 0.5), flown_m + 20 * step_s
    assert roll_out_m(airframe, 20.0) == pytest.approx(flown_m, rel=1e-3)
    assert roll_out_m(PaperVehicle(), 20.0) == 0


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
    found = top_m(edges_of(points), [u], width)[0]
    if math.isinf(expected):
        assert found == -math.inf or found <= points[:, 1].max()
    else:
        assert found == pytest.approx(expected, abs=1e-4)


@given(st.integers(0, 10_000), st.integers(3, 30), st.floats(10, 60), st.floats(0.0, 2.0))
@example(9999, 26, 13.78125, 0.0)  # an edge that rises by 20 km in a metre
def test_levels_are_never_below_what_strips_reach(seed, corners, width, slack):
    points = star(seed, corners)
    edges, left, right = edges_of(points), points[:, 0].min(), points[:, 0].max()
    length = (right - left) / 3
    firsts = [left + width / 2, left + length]
    levels = levels_above([(edges, first) for first in firsts], length, width, slack)
    places = np.linspace(0, length, 301)
    reached = np.max([top_m(edges, first + places, width) for first in firsts], axis=0)
    # a strip's edge is known to a few EDGE_M: on an edge that is all but upright, that is millimetres of level
    bound = np.max([levels.at(np.clip(places + by, 0, length)) for by in (-4 * EDGE_M, 0.0, 4 * EDGE_M)], axis=0)
    assert (bound >= reached - 1e-3).all()
    assert levels.places_m[0] == 0
    assert levels.places_m[-1] == length
