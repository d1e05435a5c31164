"""The motion's power: before a window, within one, and in gusts that last."""

import math

import numpy as np
import pytest

from eadp.models.vehicle import FixedWing
from eadp.planning.state import motion as power
from eadp.planning.state.level_regression import WINDOW_S
from eadp.planning.state.motion import MotionPower


def observe(motion, power_w, step_s, slope):
    motion.ingest([power_w], [0.0], [step_s], slope)


def spells(motion, levels, slopes):
    """Spells of constant power, five seconds each."""
    for level, slope in zip(levels, slopes, strict=True):
        for _ in range(5):
            observe(motion, level, 1.0, slope)


def energy_variance_j2(motion, seconds, bank_s):
    """Of a time with ∫ tan² φ dt: (t, ∫tan²φ) P (t, ∫tan²φ)ᵀ + v t."""
    *_, aa, ab, bb, noise = motion.known()[:6]
    return seconds * seconds * aa + 2 * seconds * bank_s * ab + bank_s * bank_s * bb + noise * seconds


def test_power_before_anything_is_flown():
    motion = MotionPower(36.0, FixedWing())
    assert motion.known().level_w == 36
    assert motion.known().slope_w == pytest.approx(0.3 * 36)
    level_j2 = (power.LEVEL_SHARE * 36 * 100) ** 2
    assert energy_variance_j2(motion, 100.0, 0.0) == pytest.approx(level_j2 + motion.known().noise * 100)


def test_short_spells_are_left_out_and_a_spell_ends_with_its_leg():
    motion = MotionPower(36.0, FixedWing())
    observe(motion, 1000.0, 1.0, 0.0)
    motion.end_window(0.0)
    assert motion.known().level_w == 36
    for _ in range(3):
        observe(motion, 40.0, 1.0, 0.0)
    motion.end_window(0.0)
    assert 36 < motion.known().level_w < 40


def test_the_slope_is_never_below_0():
    motion = MotionPower(36.0, FixedWing())
    spells(motion, [36.0, 10.0] * 20, [0.0, 0.3] * 20)
    assert motion.known().slope_w == 0


def test_a_first_window_in_a_gust_is_not_believed():
    """25 % above a level that is known to 5 %."""
    motion = MotionPower(80.0, FixedWing())
    spells(motion, [100.0], [0.0])
    assert 80 < motion.known().level_w < 88


@pytest.mark.slow
@pytest.mark.parametrize("windows", [12, 20])
def test_gusts_that_last_are_learned(windows):
    """Windows that scatter by 3 to 17 % of the level, each half of the one before: the energy of 600 s to come."""
    squares = []
    for seed in range(150):
        rng = np.random.default_rng([seed, windows])
        level, scatter_w = 80 * (1 + rng.normal(0, power.LEVEL_SHARE)), 80 * rng.uniform(0.03, 0.17)
        shocks = rng.normal(0, scatter_w / math.sqrt(2), windows + 121)
        gusts = shocks[1:] + shocks[:-1]  # of a correlation 1/2
        motion = MotionPower(80.0, FixedWing())
        spells(motion, level + gusts[:windows], np.zeros(windows))
        came = WINDOW_S * float(np.sum(level + gusts[windows:]))
        variance_j2 = energy_variance_j2(motion, 600.0, 0.0)
        squares.append((came - 600 * motion.known().level_w) ** 2 / variance_j2)
    assert 0.7 < math.sqrt(np.mean(squares)) < 1.4
