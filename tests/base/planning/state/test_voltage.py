"""A cell that is lost shows in the voltage; a pack that is drained does not look so."""

import numpy as np
import pytest
from common import ROOT

from eadp.api.inputs import load_flight
from eadp.models.battery import Battery
from eadp.planning.base import Observation, Sample
from eadp.planning.state.flight_state import CELL_LOST
from eadp.planning.state.voltage import VoltageWatch

SOC = [0.0, 0.02, 0.05, 0.10, 0.20, 0.30, 0.40, 0.50, 0.60, 0.70, 0.80, 0.90, 1.0]
CELL_V = [3.27, 3.45, 3.61, 3.69, 3.73, 3.77, 3.80, 3.84, 3.87, 3.95, 4.02, 4.11, 4.20]
"""A curve of lithium polymer cells as it is, beside the straight line of `Battery`."""
BATTERY = Battery(cells=4, chemistry="lipo", capacity_ah=1.0, resistance_ohm=0.03)


def flown(seed, *, lost_v=0.0, at_s=300.0, to_soc=0.1):
    """A pack from full down to a tenth: when the watch has found a loss [s], and the watch."""
    rng = np.random.default_rng(seed)
    watch, soc, ohm = VoltageWatch(BATTERY), 1.0, 0.03 * rng.uniform(0.5, 2)
    gust = 0.0
    for second in range(2000):
        gust += -gust / 8 + rng.normal(0, 0.4)
        amps = 40.0 if second < 10 else max(2.7 + gust + (4.0 if second // 60 % 5 == 4 else 0.0), 0.0)
        soc -= amps / 3600
        volts = 4 * float(np.interp(soc, SOC, CELL_V)) - ohm * amps + rng.normal(0, 0.03) - lost_v * (second >= at_s)
        watch.ingest(float(second), volts, amps * volts, round(soc, 2))
        if watch.lost:
            return float(second), watch
        if soc < to_soc:
            break
    return None, watch


@pytest.mark.slow
@pytest.mark.parametrize("to_soc", [0.1, 0.0])
def test_a_pack_that_is_drained_gives_no_alarm(to_soc):
    assert [flown(seed, to_soc=to_soc)[0] for seed in range(40)] == [None] * 40


def test_a_lost_cell_is_found_within_30_s():
    """Of 0.84 V, as of 30 % of a pack of ArduPilot's simulator."""
    found = [flown(seed, lost_v=0.84)[0] for seed in range(40)]
    assert all(time_s is not None and 300 <= time_s <= 330 for time_s in found)


def test_its_size_is_that_of_the_fall_over_the_slope_of_the_curve():
    _, watch = flown(1, lost_v=0.84)
    slope_v = 4 * (CELL_V[-2] - CELL_V[6]) / 0.5  # of the charge used so far
    assert watch.lost == pytest.approx(0.84 / slope_v, abs=2 * watch.lost_std)


@pytest.mark.parametrize("battery", [Battery(voltage_v=14.8), Battery(cells=4, prescribed=((0.0, 1.0),))])
def test_a_battery_without_a_curve_is_not_watched(battery):
    watch = VoltageWatch(battery)
    for second in range(200):
        watch.ingest(float(second), 14.8 - 3.0 * (second > 100), 40.0, 0.9)
    assert watch.lost == 0


def test_readings_of_no_voltage_or_across_a_gap_are_none():
    watch = VoltageWatch(BATTERY)
    for second in range(0, 400, 10):
        watch.ingest(float(second), 16.0 if second < 200 else 14.0, 40.0, 0.9)
    for second in range(400, 600):
        watch.ingest(float(second), 0.0, 40.0, 0.9)
    assert watch.lost == 0


def test_the_planner_answers_the_loss():
    """The charge is less by it, once, and the line has the warning; the gauge goes on as before."""
    overrides = {"battery.cells": 4}
    inputs = load_flight(ROOT / "plans/survey.plan", scenario=ROOT / "scenarios/survey.yaml", overrides=overrides)
    flight = inputs.flight()
    mission = inputs.mission
    cursor = flight.state._place.cursor
    for second in range(300):
        volts = mission.battery.voltage_at(1 - second / 2000) - (2.0 if second >= 200 else 0.0)
        soc = 1 - second / 2000
        sample = Sample(float(second), (-100.0, 220.0), 40.0, soc, voltage_v=volts)
        flight.take(Observation(sample, soc, cursor, (-100.0, 220.0), 1))
        if second == 199:
            assert flight.state.warnings == ()
            before = flight.state.soc
    assert CELL_LOST in flight.state.warnings
    assert flight.state.losses == 1
    lost = flight.state._voltage.lost
    assert lost > 0.1
    assert flight.state.soc == pytest.approx(before - 100 / 2000 - lost, abs=0.01)
    known = flight.state.known(300.0, (-100.0, 220.0))
    assert known.charge.lost_std == pytest.approx(0.3 * lost)
