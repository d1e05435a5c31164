"""The filter of the charge: the Kalman filter with matrices, gauges of all kinds, calibration over many flights."""

import math

import numpy as np
import pytest

from eadp.core import compiled
from eadp.core.flight import drain_per_s
from eadp.planning.state.charge import (
    MAX_STEP_S,
    MAX_USE,
    USE_DRIFT,
    USE_NOISE,
    Charge,
    ChargeFilter,
    DrainModel,
    after_drain,
    charge_at_end,
    corrected,
)

fast = pytest.mark.skipif(not compiled.available(), reason="eadp[fast] is not installed")

UNIT = DrainModel(empty_v=1.0, rise_v=0.0, resistance_ohm=0.0, per_as=1.0)
"""A battery that a watt drains by 1 in a second."""


def observe(charge, reading, drained, *, measured=True):
    """Take a reading, with the charge drained since the last by prediction; return whether some was lost."""
    step_s = 1.0 if measured else 2 * MAX_STEP_S
    before = charge.belief.losses
    charge.ingest([reading], [drained / step_s], [step_s])
    return charge.belief.losses > before


def use(charge, drain):
    """Charge that a battery uses for a predicted drain from now on, and the variance of b thereafter."""
    then = after_drain(charge.ahead, drain)
    return charge.soc - then.soc, then.var_soc


def matrix(charge):
    """The covariance of charge, ratio, slope and offset."""
    _, _, _, bb, bk, bs, kk, ks, ss, _, bo, ko, so, oo = charge
    return np.array([[bb, bk, bs, bo], [bk, kk, ks, ko], [bs, ks, ss, so], [bo, ko, so, oo]])


def followed(readings, drained, jumps=None):
    charge, found = ChargeFilter(UNIT), []
    for k, reading in enumerate(readings):
        jumped = observe(charge, reading, drained if k else 0.0)
        if jumps is not None and jumped:
            jumps.append(k)
        assert charge.ahead.var_soc >= 0
        found.append(charge.soc)
    return charge, np.array(found)


@pytest.mark.parametrize("drop", [0.02, 0.06, 0.5])
def test_a_jump_of_an_exact_gauge_is_believed_at_once(drop):
    true = 1 - 1e-4 * np.arange(400) - np.where(np.arange(400) >= 150, drop, 0)
    _, found = followed(true, 1e-4, jumps := [])
    assert jumps == [150]
    assert found[150:] == pytest.approx(true[150:], abs=1e-9)


def noisy(seed, std, count=600, drained=1e-4):
    true = 1 - drained * np.arange(count)
    return true, true + np.random.default_rng(seed).normal(0, std, count)


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


def test_a_drain_whose_power_was_not_measured_teaches_little():
    """Three tenths of what is predicted are used: measured, that is an odd reading; not measured, it is the truth."""
    found = {}
    for measured in (True, False):
        rng, charge, soc = np.random.default_rng(2), ChargeFilter(UNIT), 1.0
        observe(charge, soc, 0.0)
        for _ in range(200):
            soc -= 1e-3
            observe(charge, soc + rng.normal(0, 0.002), 1e-3)
        before = charge.soc
        observe(charge, soc - 0.03, 0.1, measured=measured)
        found[measured] = before - charge.soc, use(charge, 0.1)[0] / 0.1
    assert found[True][0] == pytest.approx(0.1, abs=0.01)
    assert found[False] == (pytest.approx(0.03, abs=0.01), pytest.approx(1.0, abs=0.1))


@pytest.mark.quick(1)
@pytest.mark.parametrize(("count", "seeds"), [(10, 100), (100, 100), (600, 40)])
def test_the_variance_of_a_noisy_gauge_is_calibrated(count, seeds):
    squares = []
    for seed in range(seeds):
        true, readings = noisy(seed, 0.005, count)
        charge, found = followed(readings, 1e-4)
        squares.append((found[-1] - true[-1]) ** 2 / charge.ahead.var_soc)
    assert np.mean(np.array(squares) < 1.96**2) > 0.8


def battery(ratio, count=4000, quantum=0.0, drained=2e-4):
    """Charges of a battery that uses a ratio, a function of its charge, of what is predicted; and its readings."""
    true = [1.0]
    for _ in range(count - 1):
        true.append(true[-1] - ratio(true[-1]) * drained)
    charges = np.array(true)
    return charges, np.ceil(charges / quantum - 1e-9) * quantum if quantum else charges


@pytest.mark.quick(3)
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
        used, variance = use(charge, 2e-4 * steps)
        assert abs(found[-1] - used - charges[half + steps]) < 4 * math.sqrt(variance) + 1e-4
        assert math.sqrt(variance) < 0.01
        assert used == pytest.approx(charges[half] - charges[half + steps], rel=0.04)


@pytest.mark.quick(1)
@pytest.mark.parametrize("quantum", [0.0, 0.01, 0.02])
def test_a_gauge_that_is_stuck_is_disbelieved_and_the_integral_holds(quantum):
    charges, readings = battery(lambda _: 1.05, quantum=quantum)
    stuck = readings.copy()
    stuck[1500:] = readings[1500]
    charge, found = followed(stuck, 2e-4, jumps := [])
    assert not charge.belief.believed
    assert jumps == []
    assert abs(found[-1] - charges[-1]) < 4 * math.sqrt(charge.ahead.var_soc) + quantum
    assert abs(found[-1] - charges[-1]) < 0.02
    # and it is believed once it shows the truth again
    stuck[2500:] = readings[2500:]
    charge, found = followed(stuck, 2e-4)
    assert charge.belief.believed
    assert abs(found[-1] - charges[-1]) < 0.005 + quantum


def test_a_gauge_that_jumps_up_is_disbelieved():
    charges, readings = battery(lambda _: 1.0)
    charge, found = followed(readings + np.where(np.arange(len(readings)) >= 1500, 0.2, 0.0), 2e-4, jumps := [])
    assert jumps == []
    assert not charge.belief.believed
    assert abs(found[-1] - charges[-1]) < 0.01


def test_a_loss_that_was_false_is_taken_back():
    charges, readings = battery(lambda _: 1.0)
    false = readings.copy()
    false[1500:1520] -= 0.3
    charge, found = followed(false, 2e-4, jumps := [])
    assert jumps == [1500, 1520]
    assert charge.belief.believed
    assert abs(found[-1] - charges[-1]) < 1e-3


def test_a_loss_below_the_outliers_limit_is_not_learned_as_use():
    """Of a gauge in steps of 1 %, whose noise is taken for more than it is, 3.5 % are within six deviations."""
    for seed in range(20):
        rng, charge, soc = np.random.default_rng(seed), ChargeFilter(UNIT), 1.0
        for k in range(200):
            soc -= 1e-3 + (0.035 if k == 83 else 0.0)
            observe(charge, round(soc + rng.normal(0, 0.002), 2), 0.0 if k == 0 else 1e-3)
        assert use(charge, 0.4)[0] == pytest.approx(0.4, rel=0.05)


def test_the_gain_of_a_gauge_is_unknown_unless_it_is_exact():
    coarse, exact = ChargeFilter(UNIT), ChargeFilter(UNIT)
    for k in range(100):
        observe(coarse, round(1 - 1e-3 * k, 2), 1e-3 * (k > 0))
        observe(exact, 1 - 1e-3 * k, 1e-3 * (k > 0))
    assert coarse.gauge_gain == pytest.approx((0.01, 1.0))
    assert exact.gauge_gain == (0.0, 0.0)


@pytest.mark.parametrize(("voltage_fall", "slope"), [(0.0, 0.0), (0.2, -0.2)])
def test_use_falls_no_faster_than_the_voltage_of_the_prediction(voltage_fall, slope):
    """A voltage that is constant, predicted to fall by a fifth: the ratio of use falls by as much."""
    charge, soc, drained = ChargeFilter(UNIT, voltage_fall), 1.0, 0.0
    for _ in range(600):
        observe(charge, soc, 1e-3 * (drained > 0))
        soc -= 1e-3 * (1 + 0.4 * (0.25 - drained))
        drained += 1e-3
    now = use(charge, 1e-6)[0] / 1e-6
    assert use(charge, 0.3)[0] == pytest.approx(0.3 * now + slope * 0.3**2 / 2, rel=0.02)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("compiled_code", [False, pytest.param(True, marks=fast)])
def test_readings_in_a_batch_are_taken_as_one_by_one(seed, compiled_code):
    """Charge, with the drain by the power and a loss; nothing measured now and then, by the gauge neither."""
    rng, count = np.random.default_rng(seed), 400
    steps_s = rng.uniform(0.05, 0.5, count).tolist()
    powers_w = (45.0 + rng.normal(0, 3, count)).tolist()
    per_as, volts, resistance_ohm = 1 / 3600 / 0.5, 11.1, 0.05
    charges = (1.0 - np.cumsum(steps_s) * 45.0 / volts * per_as + rng.normal(0, 0.002, count)).tolist()
    charges[250:] = [charge - 0.08 for charge in charges[250:]]
    for i in range(60, 80):
        powers_w[i] = math.nan
    if seed % 2:
        charges[120:130] = [math.nan] * 10
    one, other = ChargeFilter(UNIT), ChargeFilter(DrainModel(volts, 0.0, resistance_ohm, per_as))
    power_w, expected, started = 0.0, False, False
    for step_s, reading_w, charge in zip(steps_s, powers_w, charges, strict=True):
        power_w = power_w if math.isnan(reading_w) else reading_w
        drained = drain_per_s(power_w, volts, resistance_ohm, per_as) * step_s if started else 0.0
        expected |= observe(one, charge, drained, measured=not math.isnan(reading_w))
        started = True
    at = 0
    compiled.enable(compiled_code)
    while at < count:
        end = min(count, at + int(rng.integers(1, 40)))
        other.ingest(charges[at:end], powers_w[at:end], steps_s[at:end])
        at = end
    assert other.belief.losses == one.belief.losses > 0
    assert expected
    assert other._state.drain.power_w == powers_w[-1]
    assert other.soc == pytest.approx(one.soc, abs=1e-12)
    assert use(other, 0.2) == pytest.approx(use(one, 0.2), rel=1e-9)


@pytest.mark.quick(3)
@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("rounded", [math.floor, round, math.ceil])
def test_a_gauge_that_rounds_is_above_its_readings_by_what_a_full_battery_shows(rounded, noise):
    """After a fifth of the charge, gauges of 1 % are off by 3 per mille or less, their readings by up to 7.5."""
    squares = []
    for seed in range(20):
        rng, charge, soc = np.random.default_rng(seed), ChargeFilter(UNIT), 1.0
        observe(charge, 1.0, 0.0)
        for _ in range(100):
            soc -= 2e-3
            observe(charge, min(rounded(100 * (soc + noise * rng.normal()) + 1e-9) / 100, 1.0), 2e-3)
        squares.append((charge.soc - soc) ** 2)
    assert math.sqrt(np.mean(squares)) < 0.003


# --- the algebra ------------------------------------------------------------------------------------------------------


def some_charge(rng):
    root = rng.normal(0, 0.05, (4, 4))
    p = root @ root.T
    rows = np.array([[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2], [0, 3], [1, 3], [2, 3], [3, 3]])
    values = [float(p[i, j]) for i, j in rows]
    return Charge(0.6, 1.1, -0.2, *values[:6], 0.004, *values[6:])


def either(function, compiled_code):
    """A function, plain or compiled."""
    compiled.enable(compiled_code)
    return compiled.jitted(function)


@pytest.mark.quick(3)
@pytest.mark.parametrize("compiled_code", [False, pytest.param(True, marks=fast)])
@pytest.mark.parametrize("seed", range(3))
def test_a_drain_is_a_kalman_filters_prediction_with_matrices(seed, compiled_code):
    rng = np.random.default_rng(seed)
    charge, d = some_charge(rng), float(rng.uniform(0, 0.1))
    f = np.array([[1, -d, -d * d / 2, 0], [0, 1, d, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    q = np.zeros((4, 4))
    q[:2, :2] = USE_DRIFT**2 * np.array([[d**3 / 3, -d * d / 2], [-d * d / 2, d]]) + [[USE_NOISE**2 * d, 0], [0, 0]]
    found = either(after_drain, compiled_code)(charge, d)
    assert isinstance(found, Charge)
    state = f @ [charge.soc, charge.use_ratio, charge.use_slope, charge.offset]
    assert [found.soc, found.use_ratio, found.use_slope, found.offset] == pytest.approx(state, rel=1e-12)
    assert matrix(found) == pytest.approx(f @ matrix(charge) @ f.T + q, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_beyond_empty_the_ratio_stays(seed):
    charge = some_charge(np.random.default_rng(seed))
    drains = charge.soc * np.array([0.2, 1.0, 3.0, 20.0])
    for drain, soc, variance in zip(drains.tolist(), *charge_at_end(charge, drains), strict=True):
        then = after_drain(charge, min(drain, charge.soc))
        row = np.array([1.0, -max(drain - charge.soc, 0.0), 0.0, 0.0])
        assert soc == pytest.approx(row @ [then.soc, then.use_ratio, then.use_slope, then.offset], rel=1e-12)
        assert variance == pytest.approx(row @ matrix(then) @ row, rel=1e-12)


@pytest.mark.quick(3)
@pytest.mark.parametrize("compiled_code", [False, pytest.param(True, marks=fast)])
@pytest.mark.parametrize("seed", range(3))
def test_a_reading_is_a_kalman_filters_correction_with_matrices(seed, compiled_code):
    rng = np.random.default_rng(seed)
    charge, error, noise = some_charge(rng), float(rng.normal(0, 0.01)), float(rng.uniform(1e-6, 1e-3))
    p, h = matrix(charge), np.array([1, 0, 0, -1])
    gain = p @ h / (h @ p @ h + noise)
    found = either(corrected, compiled_code)(charge, error, noise)
    state = np.array([charge.soc, charge.use_ratio, charge.use_slope, charge.offset]) + gain * error
    assert 1 / MAX_USE < state[1] < MAX_USE
    assert [found.soc, found.use_ratio, found.use_slope, found.offset] == pytest.approx(state, rel=1e-12)
    assert matrix(found) == pytest.approx(p - np.outer(gain, h @ p), rel=1e-9, abs=1e-12)


# --- a gauge that says nothing ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("compiled_code", [False, pytest.param(True, marks=fast)])
def test_without_a_gauge_the_charge_is_the_integral_of_the_power(compiled_code):
    """From the charge at the start, whose drain follows a voltage that falls; a power that is missing is the last."""
    model, rng = DrainModel(10.0, 2.0, 0.1, 1 / 3600 / 2), np.random.default_rng(1)
    charge, soc, power_w = ChargeFilter(model, start_soc=0.9), 0.9, 0.0
    powers_w, steps_s = rng.uniform(30, 60, 300), rng.uniform(0.1, 1.0, 300)
    powers_w[100:110] = math.nan
    for reading_w, step_s in zip(powers_w.tolist(), steps_s.tolist(), strict=True):
        power_w = power_w if math.isnan(reading_w) else reading_w
        soc -= drain_per_s(power_w, 10 + 2 * soc, 0.1, model.per_as) * step_s
    compiled.enable(compiled_code)
    charge.ingest(np.full(300, math.nan), powers_w, steps_s)
    assert charge.belief.losses == 0
    assert charge.soc == pytest.approx(soc, abs=1e-12)
    assert charge.ahead.var_soc > 0
    assert charge.belief.believed
    assert charge.gauge_gain == (0.0, 0.0)


def test_before_anything_is_known_there_is_no_charge_and_the_first_reading_is_it():
    charge = ChargeFilter(UNIT)
    assert not observe(charge, math.nan, 0.1)
    assert math.isnan(charge.soc)
    assert not observe(charge, 0.8, 0.1)
    assert charge.soc == 0.8


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_readings_that_fail_for_a_while_are_bridged_by_the_drain(noise):
    """After as many with a ratio of use to be estimated, a fifth of the charge is predicted within 4 deviations."""
    rng, charge, soc = np.random.default_rng(5), ChargeFilter(UNIT), 1.0
    observe(charge, 1.0, 0.0)
    for k in range(1600):
        soc -= 1.05 * 2.5e-4
        observe(charge, math.nan if k >= 800 else soc + noise * rng.normal(), 2.5e-4)
    assert abs(charge.soc - soc) < 4 * math.sqrt(charge.ahead.var_soc)
    assert abs(charge.soc - soc) < 0.01
    before = charge.ahead.var_soc
    jumped = [observe(charge, soc + noise * rng.normal(), 0.0) for _ in range(5)]
    assert not any(jumped)
    assert charge.belief.believed
    assert charge.ahead.var_soc < before
