"""A level that may step: found soon and rarely by mistake; its slopes by the textbook."""

import math

import numpy as np
import pytest
from regression import posterior

from eadp.core import compiled
from eadp.models.vehicle import FixedWing
from eadp.planning.state.level_regression import FADE_S, WINDOW_S, Prior, started, with_window
from eadp.planning.state.motion import CLIMB_SHARE, LEVEL_SHARE, STEP_SHARE, TURN_SHARE, MotionPower

LEVEL_W, NOISE_W = 42.0, 2.0
fast = pytest.mark.skipif(not compiled.available(), reason="eadp[fast] is not installed")


def flown(rng, count, level_w=LEVEL_W, motion=None):
    """The power after so many readings, one a second: with noise, and turns in a third of the time."""
    motion = motion or MotionPower(LEVEL_W * (1 + rng.normal(0, LEVEL_SHARE)), FixedWing())
    for second in range(count):
        slope = 0.2 if second // 10 % 3 == 2 else 0.0
        motion.ingest([level_w * (1 + 0.3 * slope) + rng.normal(0, NOISE_W * math.sqrt(WINDOW_S))], [0.0], [1.0], slope)
        if second % 10 == 9:
            motion.end_window(slope)
    return motion


@pytest.mark.slow
@pytest.mark.parametrize("share", [-0.2, 0.3, 1.0])
def test_a_lasting_step_is_followed(share):
    """Within 2 σ after 30 s and within 5 % after 90 s, wherever it falls in a window."""
    within, errors = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        motion, new_w = flown(rng, 300 + seed % 10), LEVEL_W * (1 + share)
        flown(rng, 30, new_w, motion)
        within.append(abs(motion.known().level_w - new_w) <= 2 * math.sqrt(motion.known().var_level))
        flown(rng, 60, new_w, motion)
        errors.append(abs(motion.known().level_w / new_w - 1))
    assert np.mean(within) >= 0.9
    assert np.quantile(errors, 0.9) <= 0.05


def test_a_step_widens_the_variance():
    rng = np.random.default_rng(0)
    motion = flown(rng, 600)
    before = motion.known().var_level
    flown(rng, 20, 2 * LEVEL_W, motion)
    assert motion._state.regression.steps == 1
    assert motion.known().var_level > 4 * before


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_stated():
    """In 10 hours of 60 flights at most 1, with 1.6 times the noise assumed: the design is one in 100 hours."""
    assert sum(flown(np.random.default_rng(seed), 600)._state.regression.steps for seed in range(60)) <= 1


def test_a_single_wild_window_is_no_step():
    rng = np.random.default_rng(2)
    motion = flown(rng, 300)
    flown(rng, 5, 1.5 * LEVEL_W, motion)
    flown(rng, 300, LEVEL_W, motion)
    assert motion.known().level_w == pytest.approx(LEVEL_W, rel=0.04)


@pytest.mark.parametrize("compiled_code", [False, pytest.param(True, marks=fast)])
def test_the_power_of_a_climb_is_a_term_of_its_own(compiled_code):
    rng, count = np.random.default_rng(1), 60
    rates = np.where(np.arange(count) % 4 == 0, 2.5, 0.0)
    slopes = rng.choice([0.0, 0.2], count)
    powers = 40 + 12 * slopes + 50 * rates + rng.normal(0, 0.8, count)
    motion = MotionPower(40.0, FixedWing(), climb_j_per_m=45.0)
    compiled.enable(compiled_code)
    for power_w, slope, rate in zip(powers, slopes, rates, strict=True):
        motion.ingest([power_w] * 5, [0.0] * 5, [1.0] * 5, slope, rate)
    weights = WINDOW_S * np.exp(-WINDOW_S * np.arange(count)[::-1] / FADE_S)
    prior, spread = np.array([40.0, TURN_SHARE * 40, 45.0]), [LEVEL_SHARE * 40, TURN_SHARE * 40, CLIMB_SHARE * 45]
    rows = np.column_stack([np.ones(count), slopes, rates])
    mean, covariance = posterior(rows, powers, motion.known().noise / weights, prior, spread)
    known = motion.known()
    assert (known.level_w, known.slope_w, known.climb_j_per_m) == pytest.approx(mean, rel=1e-3)
    assert known.var_level == pytest.approx(covariance[0, 0], rel=1e-6)
    assert known.var_slope == pytest.approx(covariance[1, 1], rel=1e-6)
    fit = motion._state.regression.fit
    found = [[fit.aa, fit.ab, fit.ac], [fit.ab, fit.bb, fit.bc], [fit.ac, fit.bc, fit.cc]]
    assert np.array(found) == pytest.approx(covariance, rel=1e-6)


def test_without_climbs_the_prior_of_a_climb_stays():
    motion = flown(np.random.default_rng(0), 100, motion=MotionPower(LEVEL_W, FixedWing(), climb_j_per_m=37.3))
    assert motion.known().climb_j_per_m == 37.3


def test_the_size_of_a_step_is_known():
    state = started(Prior(16.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.01))
    for k in range(60):
        state = with_window(state, WINDOW_S, 16.0 - 0.7 * (k >= 40), 0.0, 0.0, STEP_SHARE)
    assert state.steps == 1
    assert state.step == pytest.approx(-0.7, abs=0.05)
