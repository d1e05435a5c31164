"""A battery from voltage and current, with errors that hold; `eadp fit --battery` gives the block of a scenario."""

import json

import numpy as np
import pytest
from common import few
from common.answers import refused

from eadp.core.flight import interpolated
from eadp.measure.battery import CURVES_V, BatteryReadings, fit_battery


@pytest.fixture
def flight(tmp_path):
    """A log of 20 minutes of a battery of 16.8 to 13 V, 80 mΩ, 2 Ah."""
    rng = np.random.default_rng(1)
    t = np.arange(0, 1200, 1.0)
    amps = 4 + 3 * (rng.random(60).repeat(20) - 0.5)
    charge = 1 - np.concatenate(([0.0], np.cumsum((amps[1:] + amps[:-1]) / 2))) / 3600 / 2.0
    volts = 13 + 3.8 * charge - 0.08 * amps + 0.01 * rng.standard_normal(len(t))
    path = tmp_path / "flight.csv"
    rows = (f"{a},{b},{c},{b * c}" for a, b, c in zip(t.tolist(), volts.tolist(), amps.tolist(), strict=True))
    path.write_text("time_s,voltage_v,current_a,power_w\n" + "\n".join(rows) + "\n")
    return path


def test_the_block_flies(eadp, flight, tmp_path):
    block = tmp_path / "battery.yaml"
    answer = eadp("fit", flight, "--battery", "--capacity", "2", "--soc", "1", "-o", block)
    assert answer.code == 0
    assert "resistance 80" in answer.out or "resistance 79" in answer.out
    scenario = tmp_path / "s.yaml"
    scenario.write_text("schema: eadp.scenario/1\n" + block.read_text())
    flown = eadp(
        "simulate", "plans/survey.plan", "--scenario", scenario, "--planner", "static", "--profile",
        "profiles/pednet-jetson-nano.yaml", "--set", "step_s=0.1", "--format", "json",
    )  # fmt: skip
    assert flown.code == 0
    assert json.loads(flown.out)["soc_final"] < 1


def test_json(eadp, flight):
    document = json.loads(eadp("fit", flight, "--battery", "--capacity", "2", "--soc", "1", "--format", "json").out)
    assert document["schema"] == "eadp.battery/1"
    assert document["battery"]["resistance_ohm"] == pytest.approx(0.08, abs=0.003)
    assert document["battery"]["voltage_v"] == pytest.approx(16.8, abs=0.02)
    assert document["battery"]["voltage_empty_v"] == pytest.approx(13.0, abs=0.1)
    assert document["rms_v"] < document["constant_rms_v"]
    assert any("capacity" in note for note in document["notes"])


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        ((), "--capacity:1:1"),
        (("--capacity", "-2"), "--capacity:1:1"),
        (("--capacity", "2", "--soc", "1.5"), "--soc:1:1"),
        (("--capacity", "2", "--k-b", "0"), "--k-b:1:1"),
        (("--capacity", "2", "--power", "power_w"), "--power:1:1"),
    ],
)
def test_what_cannot_be(eadp, flight, arguments, where):
    answer = eadp("fit", flight, "--battery", *arguments)
    assert answer.code == 2
    assert answer.out == ""
    assert answer.err.startswith(f"{where}: error: ")


def test_a_capacity_that_the_log_exceeds(eadp, flight):
    answer = eadp("fit", flight, "--battery", "--capacity", "0.5", "--soc", "1")
    assert refused(answer, "more than 1 of a capacity of 0.5 Ah")


def test_a_log_without_current(eadp):
    assert refused(eadp("fit", "scenarios/example-power-log.csv", "--battery", "--capacity", "2"), "voltage")


def test_the_charge_at_the_start_needs_evidence(eadp, flight):
    doubt = "--soc:1:1: error: nothing shows the charge at the start of the log: the first voltage is "
    answer = eadp("fit", flight, "--battery", "--capacity", "2")
    assert (answer.code, answer.out, answer.err.startswith(doubt)) == (2, "", True)
    lines = flight.read_text().splitlines()
    used = [f"{lines[0]},discharged_mah", *(f"{line},{100 + i}" for i, line in enumerate(lines[1:]))]
    flight.write_text("\n".join(used) + "\n")
    assert "soc: 0.95\n" in eadp("fit", flight, "--battery", "--capacity", "2").out  # 100 mAh of 2 Ah
    assert "100 mAh were used before" in eadp("fit", flight, "--battery", "--cells", "4").err
    lines[1] = "0,16.75,0,0"  # at rest, 4.19 V a cell
    flight.write_text("\n".join(lines) + "\n")
    assert "soc: 1.0\n" in eadp("fit", flight, "--battery", "--capacity", "2").out
    answer = eadp("fit", flight, "--battery", "--cells", "5")
    assert f"{doubt}16.75 V at rest, not that of 5 full lipo cells at rest" in answer.err


def test_a_count_and_a_voltage_that_disprove_what_is_given(eadp, flight):
    """The log uses 1.33 Ah: a count of more than a capacity; a pack that was not full."""
    lines = flight.read_text().splitlines()
    count = [f"{line},{10 + 1333 / 1200 * i}" for i, line in enumerate(lines[1:])]
    flight.write_text("\n".join([f"{lines[0]},discharged_mah", *count]) + "\n")
    assert refused(eadp("fit", flight, "--battery", "--capacity", "1"), "--soc:1:1: error: nothing shows the charge")
    flight.write_text("\n".join(lines) + "\n")
    assert "far below" not in eadp("fit", flight, "--battery", "--capacity", "2", "--soc", "1", "--cells", "4").err
    answer = eadp("fit", flight, "--battery", "--capacity", "2", "--soc", "1", "--cells", "5")
    assert "V a cell without current, far below that of a charge of 1.00" in answer.err


@pytest.mark.parametrize(
    ("capacity_ah", "soc", "words"),
    [
        (1.2, 1, "Ah, which the log uses, were more than the cells held"),  # 1.33 Ah: the search ends at those
        (7.0, 0.25, "the log starts with 25 % of the charge: a capacity needs more than 30 %"),  # and uses 0.19 of it
    ],
)
def test_a_capacity_that_the_log_does_not_show_is_no_result(eadp, flight, capacity_ah, soc, words):
    lines = flight.read_text().splitlines()
    t, _, amps = np.array([line.split(",")[:3] for line in lines[1:]], dtype=float).T
    open_v = 4 * interpolated(soc - np.cumsum(amps) / 3600 / capacity_ah, CURVES_V["lipo"])
    rows = zip(t.tolist(), (open_v - 0.08 * amps).tolist(), amps.tolist(), strict=True)
    flight.write_text("time_s,voltage_v,current_a\n" + "".join(f"{a},{b},{c}\n" for a, b, c in rows))
    assert refused(eadp("fit", flight, "--battery", "--cells", "4", "--soc", soc), words)


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
    fit = fit_battery(BatteryReadings(*log(noise_v=0.0)), CAPACITY_AH)
    assert fit.voltage_full_v == pytest.approx(16.8, abs=1e-6)
    assert fit.voltage_empty_v == pytest.approx(13.0, abs=1e-5)
    assert fit.resistance_ohm == pytest.approx(0.08, abs=1e-7)
    assert fit.rms_v < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("runs", few([140, 200], 1))
def test_intervals_hold_where_noise_is_alike_from_reading_to_reading(runs):
    inside = {"full": 0, "empty": 0, "ohm": 0}
    for seed in range(runs):
        fit = fit_battery(BatteryReadings(*log(seed, seconds=600.0)), CAPACITY_AH)
        inside["full"] += abs(fit.voltage_full_v - 16.8) < 1.96 * fit.voltage_full_std_v
        inside["empty"] += abs(fit.voltage_empty_v - 13.0) < 1.96 * fit.voltage_empty_std_v
        inside["ohm"] += abs(fit.resistance_ohm - 0.08) < 1.96 * fit.resistance_std_ohm
    # 95 %, less what 600 s of such noise cannot tell about itself; white-noise errors would hold half of them
    assert all(0.85 <= count / runs <= 1.0 for count in inside.values()), inside


def test_outliers_do_not_move_it():
    t, volts, amps = log(3)
    volts = volts.copy()
    volts[::40] -= 5.0
    fit = fit_battery(BatteryReadings(t, volts, amps), CAPACITY_AH)
    assert fit.resistance_ohm == pytest.approx(0.08, abs=0.004)
    assert fit.voltage_full_v == pytest.approx(16.8, abs=0.05)


def test_a_current_that_hardly_varies_tells_no_resistance():
    fit = fit_battery(BatteryReadings(*log(vary_a=0.001)), CAPACITY_AH)
    assert fit.resistance_ohm is None
    assert any("resistance cannot be estimated" in note for note in fit.notes)


def test_a_voltage_that_rises_with_the_current_is_no_battery():
    t, volts, _ = log()
    rising = 13 + 0.1 * np.linspace(5, 30, len(t)) + 0.2 * (volts - volts.mean())
    fit = fit_battery(BatteryReadings(t, rising, np.linspace(5, 30, len(t))), 10 * CAPACITY_AH)
    assert fit.resistance_ohm is None
    assert fit.voltage_empty_v is None
    assert any("rises with the current" in note for note in fit.notes)


def test_little_charge_used_tells_no_slope():
    fit = fit_battery(BatteryReadings(*log(seconds=60.0)), CAPACITY_AH)
    assert fit.voltage_empty_v is None
    used = next(note for note in fit.notes if "of the charge is used" in note)
    # a minute at about 4 A of 2 Ah
    assert float(used.split()[1]) == pytest.approx(100 * 4 / 60 / 2, rel=0.15)
    assert fit.resistance_ohm == pytest.approx(0.08, abs=0.02)


def test_what_capacity_is_wrong_by_goes_into_the_slope():
    right, wrong = (
        fit_battery(BatteryReadings(*log(noise_v=0.0)), capacity) for capacity in (CAPACITY_AH, 2 * CAPACITY_AH)
    )
    assert wrong.resistance_ohm == pytest.approx(right.resistance_ohm, abs=1e-7)
    assert wrong.rms_v == pytest.approx(right.rms_v, abs=1e-7)
    assert 16.8 - wrong.voltage_empty_v == pytest.approx(2 * (16.8 - right.voltage_empty_v), rel=1e-4)


def test_the_published_log(reference):
    """A linear voltage brings the error of a real flight's voltage down."""
    table = np.genfromtxt(reference / "logs" / "px4_battery_first900s.csv", delimiter=",", names=True)
    fit = fit_battery(BatteryReadings(table["timestamp"] / 1e6, table["voltage_v"], table["current_a"]), 10.0)
    assert fit.resistance_ohm == pytest.approx(0.077, abs=0.01)
    assert fit.rms_v < 0.75 * fit.constant_rms_v
