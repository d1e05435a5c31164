"""The ratio of flown to forecast times: regression by its textbook formulas, calibration over many flights."""

import math

import numpy as np
import pytest
from regression import posterior

from eadp.planning.state import known as time_ratio
from eadp.planning.state.known import TimeRatio

ALGEBRA = 1e-9
AIRSPEED_MPS, STAY_S = 15.0, 5.0


def learned(pairs, gust_mps=0.0):
    ratio = TimeRatio(AIRSPEED_MPS, STAY_S)
    for told, flown in pairs:
        ratio.learn(told, flown, gust_mps)
    return ratio


@pytest.mark.parametrize("count", [1, 2, 10, 50])
def test_the_ratio_is_a_bayesian_regression(count):
    rng = np.random.default_rng(count)
    told = rng.uniform(5, 40, count)
    flown = told * 1.03 + rng.uniform(-0.1, 0.1, count) * np.sqrt(told)  # none is an outlier
    found = learned(zip(told, flown, strict=True))
    mean, covariance = posterior(told[:, None], flown - told, found.noise_s * told, np.zeros(1), [time_ratio.RATIO_STD])
    assert found.ratio - 1 == pytest.approx(mean[0], abs=ALGEBRA)
    assert found.variance == pytest.approx(covariance[0, 0], rel=ALGEBRA)


def test_the_noise_of_a_gust_that_stays():
    # a position that a coloured wind of σ moves: variance 2 τ σ² t for t ≫ τ
    rng, gust, step, leg = np.random.default_rng(0), 1.0, 0.5, 100.0
    kept, count = math.exp(-step / STAY_S), 4000
    wind, moved = gust * rng.standard_normal(count), np.zeros(count)
    for _ in range(round(leg / step)):
        wind = kept * wind + gust * math.sqrt(1 - kept**2) * rng.standard_normal(count)
        moved += wind * step
    variance_s = (moved / AIRSPEED_MPS).var() / leg
    ratio = learned([(leg, leg)], gust)
    expected = time_ratio.TIME_NOISE_S + variance_s
    share = time_ratio.TIME_NOISE_LEGS / (time_ratio.TIME_NOISE_LEGS + 1)
    assert ratio.noise_s / share == pytest.approx(expected, rel=0.1)


@pytest.mark.slow
def test_forecasts_of_times_are_calibrated():
    squares = []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        true, noise = 1 + rng.normal(0, time_ratio.RATIO_STD), time_ratio.TIME_NOISE_S
        told = rng.uniform(8, 25, 12)
        flown = true * told + rng.normal(0, np.sqrt(noise * told))
        ratio = learned(zip(told, flown, strict=True))
        rest = 200.0
        came = true * rest + rng.normal(0, math.sqrt(noise * rest))
        squares.append((came - ratio.ratio * rest) ** 2 / (rest**2 * ratio.variance + ratio.noise_s * rest))
    assert np.mean(squares) == pytest.approx(1, abs=0.35)
    assert np.mean(np.array(squares) < 1.645**2) == pytest.approx(0.9, abs=0.06)


@pytest.mark.parametrize("good", [2, 5, 20])
def test_one_late_leg_says_little_of_the_others(good):
    """A leg of 17 s flown in 77 s: the deviation of 560 s left stays within 1.5 of what it was."""

    def std_s(ratio):
        return math.sqrt(560**2 * ratio.variance + 560 * ratio.noise_s)

    rng = np.random.default_rng(good)
    legs = [(17.0, 17.0 + 0.3 * rng.standard_normal()) for _ in range(good)]
    before, after = learned(legs, 0.3), learned([*legs, (17.0, 77.0)], 0.3)
    assert std_s(after) < 1.5 * std_s(before)
    assert abs(after.ratio - before.ratio) * 560 < 1.5 * std_s(before)
