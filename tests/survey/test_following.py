"""Following the ground: profiles beside a linear program, climbs beside their equation, commands beside a search."""

import itertools

import numpy as np
import pytest
from common import few
from scipy.integrate import solve_ivp
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import linprog

from eadp.core.guidance import RATE_SHARE
from eadp.errors import Infeasible
from eadp.survey.heights import LEVEL_M, Band, Climbing, banded, commanded, min_profile_m

WING = Climbing(3.0, 1.6, 0.5)
STEP_M, SPEED_MPS, TOLERANCE_M = 5.0, 15.0, 6.0
ROUNDING_M = 1e-5
SECOND_ORDER_M = 0.05
"""A change between a climb at the greatest rate and one that ends, within a sample."""


def _ground(seed, n=300, scale=12, height_m=8):
    return gaussian_filter1d(np.random.default_rng(seed).normal(0, 1, n), scale) * height_m * scale**0.5


def _band(floor_m, may_end=None):
    n = len(floor_m)
    ends = np.full(n, True) if may_end is None else may_end
    seconds = np.full(n - 1, STEP_M / SPEED_MPS)
    return banded(Band(STEP_M * np.arange(n), seconds, floor_m, floor_m + TOLERANCE_M, ends), WING, TOLERANCE_M / 2)


def _flown(band, commands, start_m=None, parts=20):
    """The altitude along a band by short steps, and the straight lines between the ends of the commands."""
    altitude = commands[0][1] if start_m is None else start_m
    flown, first = [altitude], 0
    for end, level in commands:
        for i in range(first, end):
            dt = band.seconds[i] / parts
            for _ in range(parts):
                altitude += np.clip(WING.gain_per_s * (level - altitude), -WING.down_mps, WING.up_mps) * dt
            flown.append(altitude)
        first = end
    ends, levels = zip((0, flown[0]), *commands, strict=True)
    return np.array(flown), np.interp(np.arange(first + 1), ends, levels)


@pytest.mark.parametrize("seed", few(range(4), 2))
def test_the_lowest_profile_is_that_of_a_linear_program(seed):
    rng = np.random.default_rng(seed)
    floor_m, up_m, down_m = rng.normal(0, 3, 40), rng.uniform(0.1, 2, 39), rng.uniform(0.1, 2, 39)
    # least Σ z with z ≥ f, z_{i+1} − z_i ≤ u_i and z_i − z_{i+1} ≤ d_i
    rises = np.eye(40)[1:] - np.eye(40)[:-1]
    found = linprog(
        np.ones(40), np.vstack([rises, -rises]), np.concatenate([up_m, down_m]), bounds=[(f, None) for f in floor_m]
    )
    assert min_profile_m(floor_m, up_m, down_m) == pytest.approx(found.x, abs=1e-6)


@pytest.mark.parametrize(("start", "level"), [(0.0, 40.0), (0.0, 4.0), (30.0, -10.0), (5.0, 4.0)])
def test_a_command_is_followed_as_its_equation_says(start, level):
    times = np.arange(0, 20, STEP_M / SPEED_MPS)

    def rate(_, altitude):
        return np.clip(WING.gain_per_s * (level - altitude), -WING.down_mps, WING.up_mps)

    exact = solve_ivp(rate, (0, times[-1]), [start], t_eval=times, rtol=1e-9, atol=1e-9, max_step=0.05).y[0]
    altitudes = [np.array([start])]
    for before, after in itertools.pairwise(times):
        altitudes.append(WING.followed_m(altitudes[-1], np.array([level]), after - before))
    assert np.concatenate(altitudes) == pytest.approx(exact, abs=SECOND_ORDER_M)


@pytest.mark.parametrize("seed", few(range(4), 2))
@pytest.mark.parametrize("scale", [8, 25])
def test_flights_stay_in_the_band_and_straight_climbs_above_the_ground(seed, scale):
    floor_m = _ground(seed, scale=scale)
    band = _band(floor_m)
    flown_m, straight_m = _flown(band, commanded(band, WING, floor_m))
    assert (flown_m >= band.floor_m - SECOND_ORDER_M).all()
    assert (flown_m <= band.ceiling_m + SECOND_ORDER_M).all()
    assert (straight_m >= floor_m - ROUNDING_M).all()


def test_a_slope_is_climbed_in_steps():
    # 5 % at 15 m/s rise 0.75 m/s. A climb of 3 m/s by h ends (1 − 0.75/3) h above the floor: h = 8
    floor_m = 0.05 * STEP_M * np.arange(401)
    band = _band(floor_m)
    commands = commanded(band, WING, floor_m)
    least_m = TOLERANCE_M / (1 - 0.75 / WING.up_mps)
    # the last metres of a climb take their time: 1/k s at the slope's rate, and more
    assert np.diff([level for _, level in commands])[:-1].min() >= least_m
    assert np.diff([level for _, level in commands]).max() <= least_m + 2 * 0.75 / WING.gain_per_s
    assert [level % LEVEL_M for _, level in commands] == [0.0] * len(commands)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_slope_that_is_too_steep_is_begun_before_it(sign):
    # 40 % up and flat again: above it the climb of 2.4 m/s at 15 m/s, of 16 %, begins before its foot
    rise_m = 0.4 * STEP_M * np.arange(31)
    floor_m = np.concatenate([np.zeros(200), rise_m, np.full(200, rise_m[-1])])[::sign]
    band = _band(floor_m)
    rate = RATE_SHARE * (WING.up_mps if sign == 1 else WING.down_mps) / SPEED_MPS
    foot_m = rise_m[-1] / rate - 150
    beside = np.flatnonzero(band.floor_m > floor_m + ROUNDING_M)
    assert STEP_M * len(beside) == pytest.approx(foot_m + 150, abs=2 * STEP_M)
    flown_m, _ = _flown(band, commanded(band, WING, floor_m))
    assert (flown_m >= floor_m - SECOND_ORDER_M).all()


def test_where_no_other_altitude_may_be_commanded_none_is():
    floor_m = _ground(3)
    may_end = np.arange(300) % 30 == 29
    ends = [end for end, _ in commanded(_band(floor_m, may_end), WING, floor_m)]
    assert all(may_end[end] for end in ends)
    assert len(ends) > 2


def test_a_flight_that_gets_above_the_band_comes_back():
    # as steep down as the wing follows, where one altitude holds for 150 m, as on a turn: then straight on
    floor_m = np.concatenate([-0.08 * STEP_M * np.arange(200), np.full(100, -0.08 * STEP_M * 199)])
    may_end = (np.arange(300) % 30 == 29) | (np.arange(300) > 200)
    band = _band(floor_m, may_end)
    flown_m, _ = _flown(band, commanded(band, WING, floor_m))
    assert (flown_m > band.ceiling_m + LEVEL_M).any()
    assert (flown_m - floor_m).max() <= 150 * 0.08 + 2 * TOLERANCE_M
    assert flown_m[-1] <= band.ceiling_m[-1]


def test_a_climb_that_the_aircraft_cannot_begin_is_named():
    floor_m = np.concatenate([np.zeros(20), np.full(20, 50.0)])
    with pytest.raises(Infeasible, match="no climb from 0 m of the way on"):
        commanded(_band(floor_m), WING, floor_m, start_m=0.0)
