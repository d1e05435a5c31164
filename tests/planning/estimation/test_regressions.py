"""What a flight tells of itself: regressions by their textbook formulas, calibration over many flights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from common import ROOT

from eadp.core import compiled
from eadp.core.flight.battery import current_a
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.models.plan.stage import Box
from eadp.planning.estimation import regressions as observed
from eadp.planning.estimation.regressions import (
    USE_DRIFT,
    USE_NOISE,
    ChargeFilter,
    MotionPower,
    ParameterAverages,
    TimeRatio,
)
from eadp.simulation.metrics import ParameterLog

ALGEBRA = 1e-9
AIRSPEED_MPS, STAY_S = 15.0, 5.0


def posterior(rows, values, noise, prior, spread):
    """Bayesian linear regression by the formulas of any textbook: mean and covariance."""
    rows, values = np.asarray(rows, dtype=float), np.asarray(values, dtype=float)
    first, weights = np.diag(1 / np.asarray(spread) ** 2), np.diag(1 / np.asarray(noise))
    covariance = np.linalg.inv(first + rows.T @ weights @ rows)
    return covariance @ (first @ prior + rows.T @ weights @ values), covariance


# --- time -------------------------------------------------------------------------------------------------------------


def learned(pairs, gust_mps=0.0):
    ratio = TimeRatio()
    for told, flown in pairs:
        ratio.learn(told, flown, gust_mps, AIRSPEED_MPS, STAY_S)
    return ratio


@pytest.mark.parametrize("count", [1, 2, 10, 50])
def test_the_ratio_is_a_bayesian_regression(count):
    rng = np.random.default_rng(count)
    told = rng.uniform(5, 40, count)
    flown = told * 1.03 + rng.normal(0, 0.1 * np.sqrt(told))
    found = learned(zip(told, flown, strict=True))
    mean, covariance = posterior(told[:, None], flown - told, found.noise_s * told, np.zeros(1), [observed.RATIO_STD])
    assert found.ratio - 1 == pytest.approx(mean[0], abs=ALGEBRA)
    assert found.variance == pytest.approx(covariance[0, 0], rel=ALGEBRA)
    rest = 300.0  # a leg of 300 s to come: the ratio's variance and its own noise
    assert found.variance_s2(rest) == pytest.approx(rest**2 * covariance[0, 0] + found.noise_s * rest)


def test_before_anything_is_flown():
    fresh = TimeRatio()
    assert fresh.ratio == 1
    assert fresh.variance == pytest.approx(observed.RATIO_STD**2)


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
    expected = observed.TIME_NOISE_S + variance_s
    share = observed.TIME_NOISE_LEGS / (observed.TIME_NOISE_LEGS + 1)
    assert ratio.noise_s / share == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("nonsense_s", [0.0, -1.0, math.inf, math.nan])
def test_a_forecast_of_no_time_teaches_nothing(nonsense_s):
    assert learned([(nonsense_s, 3.0)]).ratio == 1


def test_forecasts_of_times_are_calibrated():
    squares = []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        true, noise = 1 + rng.normal(0, observed.RATIO_STD), observed.TIME_NOISE_S
        told = rng.uniform(8, 25, 12)
        flown = true * told + rng.normal(0, np.sqrt(noise * told))
        ratio = learned(zip(told, flown, strict=True))
        rest = 200.0
        came = true * rest + rng.normal(0, math.sqrt(noise * rest))
        squares.append((came - ratio.ratio * rest) ** 2 / ratio.variance_s2(rest))
    assert np.mean(squares) == pytest.approx(1, abs=0.35)
    assert np.mean(np.array(squares) < 1.645**2) == pytest.approx(0.9, abs=0.06)


# --- power ------------------------------------------------------------------------------------------------------------


def spells(motion, levels, slopes):
    """Spells of constant power, five seconds each."""
    for level, slope in zip(levels, slopes, strict=True):
        for _ in range(5):
            motion.observe(level, 1.0, slope)


def test_power_is_a_bayesian_regression():
    rng, count = np.random.default_rng(1), 30
    slopes = rng.choice([0.0, 0.2, 0.35], count)
    powers = 35 + 12 * slopes + rng.normal(0, 0.8, count)
    motion = MotionPower(36.0)
    spells(motion, powers, slopes)
    ages = observed.WINDOW_S * np.arange(count)[::-1]
    weights = observed.WINDOW_S * np.exp(-ages / observed.FADE_S)
    prior = np.array([36.0, observed.TURN_SHARE * 36.0])
    spread = np.array([observed.LEVEL_SHARE * 36.0, observed.TURN_SHARE * 36.0])
    mean, covariance = posterior(
        np.column_stack([np.ones(count), slopes]), powers, motion._state[observed.WINDOW_NOISE] / weights, prior, spread
    )
    # the noise is learned from the residuals, so that mean and noise go on in turns: near the fixed point
    assert (motion.level_w, motion.slope_w) == pytest.approx(mean, rel=1e-3)
    seconds, bank_s = 400.0, 60.0
    row = np.array([seconds, bank_s])
    expected = row @ covariance @ row + motion._state[observed.WINDOW_NOISE] * seconds
    assert motion.energy_variance_j2(seconds, bank_s) == pytest.approx(expected, rel=1e-6)


def test_power_before_anything_is_flown():
    motion = MotionPower(36.0)
    assert motion.level_w == 36
    assert motion.slope_w == pytest.approx(0.3 * 36)
    level_j2 = (observed.LEVEL_SHARE * 36 * 100) ** 2
    assert motion.energy_variance_j2(100.0, 0.0) == pytest.approx(level_j2 + motion._state[observed.WINDOW_NOISE] * 100)


@pytest.mark.parametrize("told_w", [None, 0.0])
def test_power_that_nothing_is_known_of_is_what_is_flown(told_w):
    motion = MotionPower(told_w)
    spells(motion, [42.0] * 3, [0.0] * 3)
    assert motion.level_w == pytest.approx(42, rel=1e-4)


def test_short_spells_are_left_out_and_a_spell_ends_with_its_leg():
    motion = MotionPower(36.0)
    motion.observe(1000.0, 1.0, 0.0)
    motion.end_window(0.0)
    assert motion.level_w == 36
    for _ in range(3):
        motion.observe(40.0, 1.0, 0.0)
    motion.end_window(0.0)
    assert 36 < motion.level_w < 40


def test_before_the_first_window_the_variance_is_that_of_the_prior():
    """Of the level, and of windows of 3 % of it whose errors are independent."""
    level, noise = 36 * observed.LEVEL_SHARE, 36 * observed.POWER_SHARE
    expected = (level * 100) ** 2 + (100 / observed.WINDOW_S) * (noise * observed.WINDOW_S) ** 2
    assert MotionPower(36.0).energy_variance_j2(100.0, 0.0) == pytest.approx(expected)


def test_a_slow_change_is_followed():
    motion = MotionPower(36.0)
    for k in range(600):  # from 36 to 42 W in 50 minutes
        spells(motion, [36 + k / 100], [0.0])
    assert motion.level_w == pytest.approx(42, abs=3)
    steady = MotionPower(36.0)
    spells(steady, [36.0] * 600, [0.0] * 600)
    assert motion.energy_variance_j2(100, 0) > steady.energy_variance_j2(100, 0)


def test_the_slope_is_never_below_0():
    motion = MotionPower(36.0)
    spells(motion, [36.0, 10.0] * 20, [0.0, 0.3] * 20)
    assert motion.slope_w == 0


def test_forecasts_of_energy_are_calibrated():
    squares = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        level = 36 * (1 + rng.normal(0, observed.LEVEL_SHARE))
        slope = max(36 * observed.TURN_SHARE * (1 + rng.normal()), 0.0)
        slopes = np.tile([0.0, 0.0, 0.25], 6)
        spread = rng.uniform(0.4, 1.6)
        motion = MotionPower(36.0)
        spells(motion, level + slope * slopes + rng.normal(0, spread, len(slopes)), slopes)
        seconds, bank_s = 300.0, 25.0
        came = level * seconds + slope * bank_s + rng.normal(0, spread * math.sqrt(seconds * observed.WINDOW_S))
        told = motion.level_w * seconds + motion.slope_w * bank_s
        squares.append((came - told) ** 2 / motion.energy_variance_j2(seconds, bank_s))
    assert np.mean(squares) == pytest.approx(1, abs=0.4)
    assert np.mean(np.array(squares) < 1.645**2) == pytest.approx(0.9, abs=0.07)


# --- charge -----------------------------------------------------------------------------------------------------------


def followed(readings, drained, jumps=None):
    charge, found = ChargeFilter(), []
    for k, reading in enumerate(readings):
        jumped = charge.observe(reading, drained if k else 0.0)
        if jumps is not None and jumped:
            jumps.append(k)
        assert charge.variance >= 0
        found.append(charge.soc)
    return charge, np.array(found)


def test_an_exact_gauge_is_believed():
    true = 1 - 1e-4 * np.arange(2000)
    charge, found = followed(true, 1e-4, jumps := [])
    assert found == pytest.approx(true, abs=1e-12)
    assert charge.variance < 1e-12
    assert jumps == []


def test_an_exact_gauge_is_believed_where_the_battery_drains_otherwise():
    true = 1 - 1.2e-4 * np.arange(2000)
    _, found = followed(true, 1e-4, jumps := [])
    assert np.abs(found - true).max() < 2e-3
    assert jumps == []


@pytest.mark.parametrize("drop", [0.02, 0.06, 0.5])
def test_a_jump_of_an_exact_gauge_is_believed_at_once(drop):
    true = 1 - 1e-4 * np.arange(400) - np.where(np.arange(400) >= 150, drop, 0)
    _, found = followed(true, 1e-4, jumps := [])
    assert jumps == [150]
    assert found[150:] == pytest.approx(true[150:], abs=1e-9)


def noisy(seed, std, count=600, drained=1e-4):
    true = 1 - drained * np.arange(count)
    return true, true + np.random.default_rng(seed).normal(0, std, count)


def test_a_noisy_gauge_is_smoothed_in_the_end():
    errors = []
    for seed in range(20):
        true, readings = noisy(seed, 0.003, 3000)
        errors.append((followed(readings, 1e-4)[1] - true)[2000:])
    assert np.sqrt(np.mean(np.square(errors))) < 0.003 / 5


def test_one_odd_reading_of_a_noisy_gauge_is_not_a_jump_two_are():
    true, readings = noisy(3, 0.002)
    readings[300] -= 0.2
    _, found = followed(readings, 1e-4, jumps := [])
    assert [k for k in jumps if k > 50] == []
    assert abs(found[300] - true[300]) < 0.01
    true, readings = noisy(3, 0.002)
    readings[300:] -= 0.2
    _, found = followed(readings, 1e-4, jumps := [])
    assert [k for k in jumps if k > 50] == [301]
    assert abs(found[301] - true[301] + 0.2) < 0.01


def test_one_odd_reading_just_after_a_jump_is_no_other_jump():
    true, readings = noisy(3, 0.002)
    readings[300:] -= 0.2
    readings[310] -= 0.2  # the jump is known by the reading 301, and its variance has settled by 309
    _, found = followed(readings, 1e-4, jumps := [])
    assert [k for k in jumps if k > 50] == [301]
    assert found[311] == pytest.approx(true[311] - 0.2, abs=0.01)


def test_a_drain_whose_power_was_not_measured_teaches_little():
    """Three tenths of what is predicted are used: measured, that is an odd reading; not measured, it is the truth."""
    found = {}
    for measured in (True, False):
        rng, charge, soc = np.random.default_rng(2), ChargeFilter(), 1.0
        charge.observe(soc, 0.0)
        for _ in range(200):
            soc -= 1e-3
            charge.observe(soc + rng.normal(0, 0.002), 1e-3)
        before = charge.soc
        charge.observe(soc - 0.03, 0.1, measured=measured)
        found[measured] = before - charge.soc, charge.use(0.1)[0] / 0.1
    assert found[True][0] == pytest.approx(0.1, abs=0.01)
    assert found[False] == (pytest.approx(0.03, abs=0.01), pytest.approx(1.0, abs=0.1))


@pytest.mark.parametrize("count", [10, 100, 600])
def test_the_variance_of_a_noisy_gauge_is_calibrated(count):
    squares = []
    for seed in range(100):
        true, readings = noisy(seed, 0.005, count)
        charge, found = followed(readings, 1e-4)
        squares.append((found[-1] - true[-1]) ** 2 / charge.variance)
    assert np.mean(np.array(squares) < 1.96**2) > 0.8


def test_a_noisy_gauge_does_not_jump_at_the_start():
    jumps = []
    for seed in range(30):
        followed(noisy(seed, 0.01, 100)[1], 1e-4, jumps)
    assert len(jumps) <= 3


def test_a_small_loss_of_an_exact_gauge_is_believed_soon():
    true = 1 - 1e-4 * np.arange(400) - np.where(np.arange(400) >= 150, 0.009, 0)
    charge, found = followed(true, 1e-4)
    late = abs(found[170] - true[170])
    assert late < 0.002 or late < 3 * math.sqrt(charge.variance)


def battery(ratio, count=4000, quantum=0.0, drained=2e-4):
    """Charges of a battery that uses a ratio, a function of its charge, of what is predicted; and its readings."""
    true = [1.0]
    for _ in range(count - 1):
        true.append(true[-1] - ratio(true[-1]) * drained)
    charges = np.array(true)
    return charges, np.ceil(charges / quantum - 1e-9) * quantum if quantum else charges


@pytest.mark.parametrize("quantum", [0.0, 0.01])
@pytest.mark.parametrize(
    "ratio", [lambda _: 1.0, lambda _: 1 / 0.85, lambda b: 1 / (0.9 + 0.2 * b)], ids=["stated", "15 % less", "falls"]
)
def test_the_ratio_of_charge_used_to_charge_predicted_is_learned(ratio, quantum):
    """From half of the charge on, what is used to the end is forecast within four of its standard deviations."""
    charges, readings = battery(ratio, 4500, quantum)
    half = int(np.argmax(charges < 0.5))
    charge, found = followed(readings[: half + 1], 2e-4, jumps := [])
    assert jumps == []
    for steps in (200, 1000, 1500):
        used, variance = charge.use(2e-4 * steps)
        assert abs(found[-1] - used - charges[half + steps]) < 4 * math.sqrt(variance) + 1e-4
        assert math.sqrt(variance) < 0.01
        assert used == pytest.approx(charges[half] - charges[half + steps], rel=0.04)


def test_the_variance_of_the_charge_to_be_used_is_that_of_a_kalman_filter_with_matrices():
    charge = ChargeFilter()
    noise, rng = 0.004, np.random.default_rng(1)
    b = 1.0
    charge.observe(b, 0.0)
    for _ in range(300):
        drained = rng.uniform(1e-4, 6e-4)
        b -= 1.05 * drained
        charge.observe(b + rng.normal(0, noise), drained)
    state = np.array([*charge._state[:2], max(charge._state[2], 0.0)])
    bb, bk, bs, kk, ks, ss = charge._state[3:9]
    covariance = np.array([[bb, bk, bs], [bk, kk, ks], [bs, ks, ss]])
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    steps, drain = 4000, 0.6
    d = drain / steps
    move = np.array([[1, -d, -d * d / 2], [0, 1, d], [0, 0, 1]])
    for _ in range(steps):
        covariance = move @ covariance @ move.T + np.diag([USE_NOISE**2 * d, USE_DRIFT**2 * d, 0])
    end = np.linalg.matrix_power(move, steps) @ state
    used, variance = charge.use(drain)
    assert used == pytest.approx(state[0] - end[0], rel=1e-9)
    assert variance == pytest.approx(covariance[0, 0], rel=1e-3)


@pytest.mark.parametrize("quantum", [0.0, 0.01, 0.02])
def test_a_gauge_that_is_stuck_is_disbelieved_and_the_integral_holds(quantum):
    charges, readings = battery(lambda _: 1.05, quantum=quantum)
    stuck = readings.copy()
    stuck[1500:] = readings[1500]
    charge, found = followed(stuck, 2e-4, jumps := [])
    assert not charge.believed
    assert jumps == []
    assert abs(found[-1] - charges[-1]) < 4 * math.sqrt(charge.variance) + quantum
    assert abs(found[-1] - charges[-1]) < 0.02
    # and it is believed once it shows the truth again
    stuck[2500:] = readings[2500:]
    charge, found = followed(stuck, 2e-4)
    assert charge.believed
    assert abs(found[-1] - charges[-1]) < 0.005 + quantum


@pytest.mark.parametrize("rise", [2e-4, 2e-5])
def test_a_gauge_that_rises_is_disbelieved_and_the_integral_holds(rise):
    charges, readings = battery(lambda _: 1.0)
    rising = readings.copy()
    rising[1500:] = readings[1500] + rise * np.arange(len(readings) - 1500)
    charge, found = followed(rising, 2e-4)
    assert not charge.believed
    assert abs(found[-1] - charges[-1]) < 0.01


def test_a_gauge_that_jumps_up_is_disbelieved():
    charges, readings = battery(lambda _: 1.0)
    charge, found = followed(readings + np.where(np.arange(len(readings)) >= 1500, 0.2, 0.0), 2e-4, jumps := [])
    assert jumps == []
    assert not charge.believed
    assert abs(found[-1] - charges[-1]) < 0.01


def test_a_loss_that_was_false_is_taken_back():
    charges, readings = battery(lambda _: 1.0)
    false = readings.copy()
    false[1500:1520] -= 0.3
    charge, found = followed(false, 2e-4, jumps := [])
    assert jumps == [1500, 1520]
    assert charge.believed
    assert abs(found[-1] - charges[-1]) < 1e-3


@pytest.mark.parametrize("quantum", [0.0, 0.01])
def test_a_good_gauge_is_believed_throughout(quantum):
    charge = ChargeFilter()
    for k, reading in enumerate(battery(lambda _: 0.9, quantum=quantum)[1]):
        charge.observe(reading, 2e-4 if k else 0.0)
        assert charge.believed


# --- parameters flown -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(10))
def test_flown_is_what_the_log_of_parameters_says(seed):
    rng = np.random.default_rng(seed)
    plan = read_plan(read_text(str(ROOT / "plans" / "survey.plan")))[0]
    boxes = [(Box(-1000, 0), Box(2, 10)), (Box(-1000, 0), Box(0, 0)), (Box(-300, -300), Box(2, 6))]
    sets, time_s = boxes[0], 0.0
    parameters = (-200.0, 5.0)
    log, flown = ParameterLog(plan, parameters, sets), ParameterAverages(2)
    flown.hold(0.0, parameters, sets)
    for _ in range(30):
        time_s += rng.uniform(0, 20)
        sets = boxes[rng.integers(3)]
        parameters = tuple(box.clip(value) for box, value in zip(sets, rng.uniform([-1000, 2], [0, 10]), strict=True))
        log.change(time_s, parameters, sets)
        flown.hold(time_s, parameters, sets)
    log.close(time_s)
    for i in range(2):
        assert flown.areas_s[i] / flown.times_s[i] == pytest.approx(log.mean_share(i), rel=ALGEBRA)
    live = [flown.areas_s[i] / flown.times_s[i] for i in range(2)]
    assert np.mean(live) == pytest.approx(log.quality({}), rel=ALGEBRA)
    assert 0.3 * live[0] + 0.7 * live[1] == pytest.approx(log.quality({"c1": 3.0, "c2": 7.0}), rel=ALGEBRA)


def test_flown_counts_what_had_a_choice_up_to_now():
    flown = ParameterAverages(1)
    flown.hold(0.0, (4.0,), (Box(2, 10),))
    flown.hold(10.0, (0.0,), (Box(0, 0),))
    flown.hold(15.0, (10.0,), (Box(2, 10),))
    assert flown.times_s == [10.0]
    assert flown.areas_s == [pytest.approx(10 * 0.25)]
    # what is held counts to a moment, and is not counted twice
    assert flown.until(16.5) == ([11.5], [pytest.approx(10 * 0.25 + 1.5)])
    assert flown.until(17.0) == ([12.0], [pytest.approx(10 * 0.25 + 2)])
    flown.hold(17.0, (10.0,), (Box(2, 10),))
    assert (flown.times_s, flown.areas_s) == flown.until(17.0) == ([12.0], [pytest.approx(10 * 0.25 + 2)])


def test_before_anything_is_held_nothing_is_flown():
    assert ParameterAverages(2).until(30.0) == ([0.0, 0.0], [0.0, 0.0])


def test_stages_without_sets_leave_no_choice():
    flown = ParameterAverages(1)
    flown.hold(0.0, (4.0,), ())
    flown.hold(10.0, (5.0,), ())
    assert flown.times_s == [0.0]


def test_a_loss_below_the_outliers_limit_is_not_learned_as_use():
    """Of a gauge in steps of 1 %, whose noise is taken for more than it is, 3.5 % are within six deviations."""
    for seed in range(20):
        rng, charge, soc = np.random.default_rng(seed), ChargeFilter(), 1.0
        for k in range(200):
            soc -= 1e-3 + (0.035 if k == 83 else 0.0)
            charge.observe(round(soc + rng.normal(0, 0.002), 2), 0.0 if k == 0 else 1e-3)
        assert charge.use(0.4)[0] == pytest.approx(0.4, rel=0.05)


def test_the_gain_of_a_gauge_is_unknown_unless_it_is_exact():
    coarse, exact = ChargeFilter(), ChargeFilter()
    for k in range(100):
        coarse.observe(round(1 - 1e-3 * k, 2), 1e-3 * (k > 0))
        exact.observe(1 - 1e-3 * k, 1e-3 * (k > 0))
    assert coarse.gain_std(0.2) == pytest.approx(0.01 * 0.8)
    assert exact.gain_std(0.2) == 0.0


@pytest.mark.parametrize(("voltage_fall", "slope"), [(0.0, 0.0), (0.2, -0.2)])
def test_use_falls_no_faster_than_the_voltage_of_the_prediction(voltage_fall, slope):
    """A voltage that is constant, predicted to fall by a fifth: the ratio of use falls by as much."""
    charge, soc, drained = ChargeFilter(voltage_fall), 1.0, 0.0
    for _ in range(600):
        charge.observe(soc, 1e-3 * (drained > 0))
        soc -= 1e-3 * (1 + 0.4 * (0.25 - drained))
        drained += 1e-3
    now = charge.use(1e-6)[0] / 1e-6
    assert charge.use(0.3)[0] == pytest.approx(0.3 * now + slope * 0.3**2 / 2, rel=0.02)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("compiled_code", [False, True])
def test_readings_in_a_batch_are_taken_as_one_by_one(seed, compiled_code):
    """Charge, with the drain by the power and a loss, and power in windows; nothing measured now and then."""
    rng, count = np.random.default_rng(seed), 400
    steps_s = rng.uniform(0.05, 0.5, count).tolist()
    powers_w = (45.0 + rng.normal(0, 3, count)).tolist()
    per_as, volts, resistance_ohm = 1 / 3600 / 0.5, 11.1, 0.05
    charges = (1.0 - np.cumsum(steps_s) * 45.0 / volts * per_as + rng.normal(0, 0.002, count)).tolist()
    charges[250:] = [charge - 0.08 for charge in charges[250:]]
    for i in range(60, 80):
        powers_w[i] = math.nan
    cell = (volts, 0.0, resistance_ohm, per_as)
    one, motion = ChargeFilter(), MotionPower(40.0)
    power_w, expected, started = 45.0, False, False
    for step_s, reading_w, charge in zip(steps_s, powers_w, charges, strict=True):
        power_w = power_w if math.isnan(reading_w) else reading_w
        drained = current_a(power_w, volts, resistance_ohm) * per_as * step_s if started else 0.0
        expected |= one.observe(charge, drained, measured=not math.isnan(reading_w))
        started = True
        if not math.isnan(reading_w):
            motion.observe(reading_w - 5.0, step_s, 0.1)
    other, together = ChargeFilter(), MotionPower(40.0)
    found, known_w, at = False, 45.0, 0
    compiled.enable(compiled_code)
    try:
        while at < count:
            end = min(count, at + int(rng.integers(1, 40)))
            batch = powers_w[at:end], charges[at:end], steps_s[at:end]
            jumped, known_w = other.observe_batch(known_w, *batch, 10.0, cell)
            together.observe_batch(batch[0], [5.0] * (end - at), batch[2], 0.1)
            found, at = found or jumped, end
    finally:
        compiled.enable(False)
    assert found
    assert expected
    assert other.soc == pytest.approx(one.soc, abs=1e-12)
    assert other.use(0.2) == pytest.approx(one.use(0.2), rel=1e-9)
    assert (together.level_w, together.slope_w) == pytest.approx((motion.level_w, motion.slope_w), rel=1e-9)


@pytest.mark.parametrize("rounded", [math.floor, round, math.ceil])
def test_the_first_steps_of_a_coarse_gauge_are_not_the_capacity(rounded):
    """Before its resolution is known, a step of 1 % after half of it is drained is no battery of half the charge."""
    charge, soc, used = ChargeFilter(), 1.0, []
    charge.observe(1.0, 0.0)
    for _ in range(60):
        soc -= 1e-3
        charge.observe(rounded(soc * 100) / 100, 1e-3)
        used.append(charge.use(0.5)[0])
    assert max(abs(value - 0.5) for value in used) < 0.02


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("rounded", [math.floor, round, math.ceil])
def test_a_gauge_that_rounds_is_above_its_readings_by_what_a_full_battery_shows(rounded, noise):
    """After a fifth of the charge, gauges of 1 % are off by 3 per mille or less, their readings by up to 7.5."""
    squares = []
    for seed in range(20):
        rng, charge, soc = np.random.default_rng(seed), ChargeFilter(), 1.0
        charge.observe(1.0, 0.0)
        for _ in range(100):
            soc -= 2e-3
            charge.observe(min(rounded(100 * (soc + noise * rng.normal()) + 1e-9) / 100, 1.0), 2e-3)
        squares.append((charge.soc - soc) ** 2)
    assert math.sqrt(np.mean(squares)) < 0.003


@pytest.mark.parametrize("start", [0.8, 0.797, 0.792])
@pytest.mark.parametrize("rounded", [math.floor, round, math.ceil])
def test_where_a_gauge_of_steps_starts_on_one_is_not_known(rounded, start):
    """Of a battery that does not start full, the charge is within three standard deviations, of up to half a step."""
    charge, soc = ChargeFilter(), start
    charge.observe(rounded(100 * soc) / 100, 0.0)
    for _ in range(200):
        soc -= 2e-3
        charge.observe(rounded(100 * soc) / 100, 2e-3)
    assert abs(charge.soc - soc) < 3 * math.sqrt(charge.variance)
    assert 0.002 < math.sqrt(charge.variance) < 0.005


def test_a_gauge_whose_changes_are_no_multiples_of_the_first_has_no_steps():
    """The mean of a gauge with noise is the charge, whatever its first change was."""
    charge, rng = ChargeFilter(), np.random.default_rng(1)
    charge.observe(1.0, 0.0)
    for k in range(1, 401):
        charge.observe(1 - 1e-3 * k + rng.normal(0, 0.004), 1e-3)
    assert charge.soc == pytest.approx(0.6, abs=0.001)
