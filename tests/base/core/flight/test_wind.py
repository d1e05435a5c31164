"""Flight in wind: the triangle by complex numbers, banks by differences, the filter by batches."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.stats import chi2

from eadp.core import flight as wind
from eadp.core.flight import WindFilter, WindReadings, ground_speeds_mps, squared_bank_slopes
from eadp.core.guidance import GRAVITY_MPS2

AIRSPEED_MPS = 15.0
MICRO = 1e-6
DIFFERENCE_RAD = 1e-5
BY_DIFFERENCES = 1e-6
"""Relative error of a derivative that is taken by differences."""


def speed_of(course_rad, wind_mps, airspeed_mps=AIRSPEED_MPS):
    course = np.array([math.cos(course_rad)]), np.array([math.sin(course_rad)])
    speeds, along = ground_speeds_mps(*course, airspeed_mps, wind_mps)
    return float(speeds[0]), float(along[0])


def heading_by_roots(course_rad, wind_mps):
    """The heading near a course whose velocity over ground has no part across it."""

    def across(heading_rad):
        ground = AIRSPEED_MPS * np.exp(1j * heading_rad) + complex(*wind_mps)
        return (ground * np.exp(-1j * course_rad)).imag

    return brentq(across, course_rad - math.pi / 2, course_rad + math.pi / 2, xtol=1e-14)


@given(course=st.floats(-7, 7), speed=st.floats(0, 14.9), towards=st.floats(-7, 7))
def test_the_triangle_by_complex_numbers_and_root_finding(course, speed, towards):
    wind_mps = (speed * math.cos(towards), speed * math.sin(towards))
    heading = heading_by_roots(course, wind_mps)
    ground = AIRSPEED_MPS * np.exp(1j * heading) + complex(*wind_mps)
    over_ground, along = speed_of(course, wind_mps)
    assert over_ground == pytest.approx((ground * np.exp(-1j * course)).real, abs=MICRO)
    assert along == pytest.approx(AIRSPEED_MPS * math.cos(heading - course), abs=MICRO)


@pytest.mark.parametrize(
    ("wind_mps", "held"),
    [((0.0, 15.0), False), ((0.0, 16.0), False), ((-20.0, 0.0), False), ((20.0, 0.0), True), ((-15.0, 0.0), False)],
)
def test_a_wind_stronger_than_the_airspeed(wind_mps, held):
    speed, _ = speed_of(0.0, wind_mps)
    assert (speed > 0) == held


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("wind_mps", [(0.0, 0.0), (5.0, 0.0), (-3.0, 8.0), (0.0, -12.0)])
def test_the_bank_against_the_heading_differentiated_along_a_circle(turn, wind_mps):
    radius = 50.0
    for angle in np.linspace(0, 2 * math.pi, 17):
        course = angle + turn * math.pi / 2
        speed, along = speed_of(course, wind_mps)
        slope = squared_bank_slopes(np.array([turn / radius]), np.array([speed]), np.array([along]), AIRSPEED_MPS)[0]
        before, after = (heading_by_roots(course + turn * d, wind_mps) for d in (-DIFFERENCE_RAD, DIFFERENCE_RAD))
        seconds = 2 * DIFFERENCE_RAD * radius / speed
        rate = math.remainder(after - before, 2 * math.pi) / seconds
        assert slope == pytest.approx((AIRSPEED_MPS * rate / GRAVITY_MPS2) ** 2, rel=BY_DIFFERENCES)


def flown(seconds, wind_mps, gust_std_mps, seed, *, course=None, step_s=1.0):
    """Velocities and headings of a flight at constant airspeed in gusts that stay 5 s; by default round in 60 s."""
    rng = np.random.default_rng(seed)
    kept = math.exp(-step_s / wind.GUST_TIME_S)
    gust = gust_std_mps * rng.standard_normal(2)
    for k in range(round(seconds / step_s)):
        gust = kept * gust + gust_std_mps * math.sqrt(1 - kept**2) * rng.standard_normal(2)
        heading = 2 * math.pi * k * step_s / 60 if course is None else course(k * step_s)
        vx = AIRSPEED_MPS * math.cos(heading) + wind_mps[0] + gust[0]
        vy = AIRSPEED_MPS * math.sin(heading) + wind_mps[1] + gust[1]
        yield (vx, vy), heading


def observe(found, velocity_mps, heading_rad, step_s):
    """Take a reading, after a step."""
    (vx, vy), heading = velocity_mps, math.nan if heading_rad is None else heading_rad
    found.ingest(WindReadings([vx], [vy], [heading], [step_s], [AIRSPEED_MPS]))


def filtered(readings, *, headings=True, step_s=1.0):
    found = WindFilter()
    for velocity, heading in readings:
        observe(found, velocity, heading if headings else None, step_s)
        xx, yy, xy = found.covariance
        assert xx > 0
        assert yy > 0
        assert xx * yy - xy * xy >= -MICRO * xx * yy, "positive"
    return found


def test_with_headings_it_is_a_batch_least_squares_of_a_random_walk(monkeypatch):
    # the spread of the gusts kept as at first, so that all is linear
    monkeypatch.setattr(wind, "_gusts_after", lambda gusts, *_: gusts)
    readings = list(flown(40, (3.0, -4.0), 0.5, 1))
    found = filtered(readings)
    n, noise = len(readings), wind.INITIAL_GUST_MPS**2 * 2 * wind.GUST_TIME_S
    steps = np.minimum.outer(np.arange(1, n + 1), np.arange(1, n + 1))
    prior = wind.INITIAL_STD_MPS**2 + wind.DRIFT_M2PS3 * steps
    inverse = np.linalg.inv(prior + noise * np.eye(n))
    values = np.array(
        [
            [vx - AIRSPEED_MPS * math.cos(heading), vy - AIRSPEED_MPS * math.sin(heading)]
            for (vx, vy), heading in readings
        ]
    )
    assert found.wind_mps == pytest.approx(prior[-1] @ inverse @ values, abs=MICRO)
    variance = prior[-1, -1] - prior[-1] @ inverse @ prior[-1]
    assert found.covariance == pytest.approx((variance, variance, 0), abs=MICRO)


def test_without_headings_it_finds_where_the_circle_of_air_velocities_lies():
    readings = list(flown(300, (3.0, -4.0), 0.0, 1))
    velocities = np.array([velocity for velocity, _ in readings])
    # ‖v − w‖² = s² less its mean: linear in w
    square, mean = (velocities**2).sum(axis=1), velocities.mean(axis=0)
    batch = np.linalg.lstsq(2 * (velocities - mean), square - square.mean(), rcond=None)[0]
    assert batch == pytest.approx((3, -4), abs=MICRO)
    assert filtered(readings, headings=False).wind_mps == pytest.approx(batch, abs=0.02)


@pytest.mark.quick(2)
@pytest.mark.parametrize("headings", [True, False])
@pytest.mark.parametrize("step_s", [0.1, 1.0, 10.0])
def test_known_winds_with_gusts(headings, step_s):
    found = filtered(flown(600, (-6.0, 2.0), 1.0, 2, step_s=step_s), headings=headings, step_s=step_s)
    assert found.wind_mps == pytest.approx((-6, 2), abs=0.5)
    assert found.gust_std_mps == pytest.approx(1, rel=0.4 if headings else 0.5)


@pytest.mark.parametrize(
    ("headings", "least", "most"), [(True, 0.7, 2.6), pytest.param(False, 0.6, 3.0, marks=pytest.mark.slow)]
)
def test_the_covariance_is_calibrated_with_headings_and_where_courses_turn_without_them(headings, least, most):
    """eᵀP⁻¹e of the estimate at the end of many flights."""
    squares = []
    for seed in range(120):
        true = np.random.default_rng(1000 + seed).uniform(-7, 7, 2)
        found = filtered(flown(240, tuple(true), 0.7, seed), headings=headings)
        xx, yy, xy = found.covariance
        error = np.array(found.wind_mps) - true
        squares.append(error @ np.linalg.inv([[xx, xy], [xy, yy]]) @ error)
    # χ² of two freedoms has a mean of 2; below it, as these winds stay while the filter lets them drift
    assert least < np.mean(squares) < most
    assert np.mean(np.array(squares) < chi2(2).ppf(0.95)) > 0.85


def test_nothing_is_learned_of_what_a_single_course_does_not_show():
    found = filtered(flown(300, (4.0, 5.0), 0.3, 3, course=lambda _: 0.0), headings=False)
    xx, yy, _ = found.covariance
    # a cross wind of 5 m/s crabs like a tail wind: neither is told well, and it is said so
    assert abs(found.wind_mps[0] - 4) < 2 * math.sqrt(xx)
    assert abs(found.wind_mps[1] - 5) < 2 * math.sqrt(yy)
    assert yy > 0.8 * wind.INITIAL_STD_MPS**2
    assert xx < wind.INITIAL_STD_MPS**2 / 5


def test_a_wind_that_turns_is_followed():
    readings = [*flown(300, (4.0, 0.0), 0.3, 4), *flown(900, (3.0, 1.0), 0.3, 5)]
    assert filtered(readings).wind_mps == pytest.approx((3, 1), abs=0.3)


def test_standing_in_the_air_tells_nothing_without_a_heading():
    found = WindFilter()
    before = found.covariance
    observe(found, (0.0, 0.0), None, 1.0)
    assert found.wind_mps == (0.0, 0.0)
    assert found.covariance[0] == pytest.approx(before[0], rel=1e-3)
