"""A battery from voltage and current: found where it is there, with errors that hold, and said where it is not."""

import numpy as np
import pytest
from common import few

from eadp.measure.battery import fit_battery

CAPACITY_AH = 2.0


def log(seed=0, *, seconds=1200.0, empty_v=13.0, ohm=0.08, vary_a=6.0, noise_v=0.03, memory_s=3.0, mean_a=4.0):
    """Times, voltage and current of a Rint battery with a noise that is alike over some seconds."""
    rng = np.random.default_rng(seed)
    step = 0.5
    t = np.arange(0, seconds, step)
    amps = mean_a + vary_a * (rng.random(len(t) // 20 + 1).repeat(20)[: len(t)] - 0.5)
    used = np.concatenate(([0.0], np.cumsum((amps[1:] + amps[:-1]) / 2 * step)))
    charge = 1 - used / 3600 / CAPACITY_AH
    keep = np.exp(-step / memory_s)
    noise = np.zeros(len(t))
    draws = rng.standard_normal(len(t)) * noise_v
    for k in range(1, len(t)):
        noise[k] = keep * noise[k - 1] + np.sqrt(1 - keep**2) * draws[k]
    return t, empty_v + (16.8 - empty_v) * charge - ohm * amps + noise, amps


def test_a_battery_without_noise_is_found_exactly():
    fit = fit_battery(*log(noise_v=0.0), CAPACITY_AH)
    assert fit.voltage_full_v == pytest.approx(16.8, abs=1e-6)
    assert fit.voltage_empty_v == pytest.approx(13.0, abs=1e-5)
    assert fit.resistance_ohm == pytest.approx(0.08, abs=1e-7)
    assert fit.rms_v < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("runs", few([140, 200], 1))
def test_intervals_hold_where_noise_is_alike_from_reading_to_reading(runs):
    inside = {"full": 0, "empty": 0, "ohm": 0}
    for seed in range(runs):
        fit = fit_battery(*log(seed, seconds=600.0), CAPACITY_AH)
        inside["full"] += abs(fit.voltage_full_v - 16.8) < 1.96 * fit.voltage_full_std_v
        inside["empty"] += abs(fit.voltage_empty_v - 13.0) < 1.96 * fit.voltage_empty_std_v
        inside["ohm"] += abs(fit.resistance_ohm - 0.08) < 1.96 * fit.resistance_std_ohm
    # 95 %, less what 600 s of such noise cannot tell about itself; white-noise errors would hold half of them
    assert all(0.85 <= count / runs <= 1.0 for count in inside.values()), inside


def test_outliers_do_not_move_it():
    t, volts, amps = log(3)
    volts = volts.copy()
    volts[::40] -= 5.0
    fit = fit_battery(t, volts, amps, CAPACITY_AH)
    assert fit.resistance_ohm == pytest.approx(0.08, abs=0.004)
    assert fit.voltage_full_v == pytest.approx(16.8, abs=0.05)


def test_a_current_that_hardly_varies_tells_no_resistance():
    fit = fit_battery(*log(vary_a=0.001), CAPACITY_AH)
    assert fit.resistance_ohm is None
    assert any("resistance cannot be estimated" in note for note in fit.notes)


def test_a_voltage_that_rises_with_the_current_is_no_battery():
    t, volts, _ = log()
    rising = 13 + 0.1 * np.linspace(5, 30, len(t)) + 0.2 * (volts - volts.mean())
    fit = fit_battery(t, rising, np.linspace(5, 30, len(t)), 10 * CAPACITY_AH)
    assert fit.resistance_ohm is None
    assert fit.voltage_empty_v is None
    assert any("rises with the current" in note for note in fit.notes)


def test_little_charge_used_tells_no_slope():
    fit = fit_battery(*log(seconds=60.0), CAPACITY_AH)
    assert fit.voltage_empty_v is None
    used = next(note for note in fit.notes if "of the charge is used" in note)
    # a minute at about 4 A of 2 Ah
    assert float(used.split()[1]) == pytest.approx(100 * 4 / 60 / 2, rel=0.15)
    assert fit.resistance_ohm == pytest.approx(0.08, abs=0.02)


def test_what_capacity_is_wrong_by_goes_into_the_slope():
    right, wrong = (fit_battery(*log(noise_v=0.0), capacity) for capacity in (CAPACITY_AH, 2 * CAPACITY_AH))
    assert wrong.resistance_ohm == pytest.approx(right.resistance_ohm, abs=1e-7)
    assert wrong.rms_v == pytest.approx(right.rms_v, abs=1e-7)
    assert 16.8 - wrong.voltage_empty_v == pytest.approx(2 * (16.8 - right.voltage_empty_v), rel=1e-4)


def test_the_published_log(reference):
    """A linear voltage brings the error of a real flight's voltage down."""
    table = np.genfromtxt(reference / "logs" / "px4_battery_first900s.csv", delimiter=",", names=True)
    fit = fit_battery(table["timestamp"] / 1e6, table["voltage_v"], table["current_a"], 10.0)
    assert fit.resistance_ohm == pytest.approx(0.077, abs=0.01)
    assert fit.rms_v < 0.75 * fit.constant_rms_v
