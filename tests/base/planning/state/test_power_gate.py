"""The gate of power readings, and what false ones do to a flight."""

import math

import numpy as np
import pytest
from common import ROOT
from common.observations import measured

from eadp.api.inputs import load_flight
from eadp.planning.state.power import MAX_RATIO, PERSISTENT_S, PowerGate
from eadp.simulation.loop import Outcome, fly

LIMIT_W, MEAN_W = 1000.0, 40.0


def passed_of(gate, time_s, power_w):
    """One reading, or None where it does not pass."""
    found = float(gate.ingest(np.array([time_s]), np.array([power_w]), 5.0)[0])
    return None if math.isnan(found) else found


def passed(powers_w, step_s=0.1):
    gate = PowerGate(MEAN_W, LIMIT_W)
    return gate, [passed_of(gate, k * step_s, power_w) for k, power_w in enumerate(powers_w)]


@pytest.mark.parametrize("false_w", [1e5, -1.0, math.nan, math.inf, LIMIT_W + 1, MAX_RATIO * MEAN_W + 10])
@pytest.mark.parametrize("count", [1, 5, 40])
def test_false_readings_do_not_pass_and_others_do(false_w, count):
    true = MEAN_W + 10 * np.sin(np.arange(300))
    readings = true.copy()
    readings[100 : 100 + count] = false_w
    gate, found = passed(readings.tolist())
    assert found[100 : 100 + count] == [None] * count
    assert [*found[:100], *found[100 + count :]] == [*true[:100], *true[100 + count :]]
    assert gate.state.max_motion_w <= MEAN_W + 10 - 5


@pytest.mark.parametrize("step_s", [0.1, 1.0])
def test_a_power_that_stays_is_believed(step_s):
    """Below what is possible at all: another aircraft than stated, or a climb."""
    stays_w = 10 * MEAN_W
    _, found = passed([MEAN_W] * 20 + [stays_w] * 200, step_s)
    first = next(k for k, power_w in enumerate(found) if power_w == stays_w)
    assert first * step_s == pytest.approx(20 * step_s + PERSISTENT_S)
    assert found[first:] == [stays_w] * (220 - first)


def test_the_greatest_power_is_one_that_two_readings_reach():
    assert passed([40.0, 60.0, 41.0, 55.0, 50.0, 42.0])[0].state.max_motion_w == 50.0 - 5.0


def corrupt(state, false_w):
    """Have a state take readings of power that are false, some of them."""
    ingest, observe = state.ingest, state.observe

    def corrupted(readings):
        powers_w = [false_w(t, power) for t, power in zip(readings.times_s, readings.powers_w, strict=True)]
        ingest(readings._replace(powers_w=powers_w))

    state.ingest = corrupted
    state.observe = lambda o: observe(measured(o, power_w=false_w(o.time_s, o.sample.power_w)))


def quality(false_w):
    inputs = load_flight(
        str(ROOT / "plans/survey.plan"),
        scenario=str(ROOT / "scenarios/survey.yaml"),
        overrides={"step_s": 0.05, "faults": [], "wind.gust_std_mps": 0.5, "battery.capacity_ah": 0.4},
    )
    flight, outcome = inputs.flight(), Outcome()
    corrupt(flight.state, false_w)
    for _ in fly(inputs.world, flight, outcome):
        pass
    assert outcome.completed
    return outcome.parameters.quality({})


@pytest.fixture(scope="module")
def undisturbed():
    return quality(lambda _, power_w: power_w)


@pytest.mark.slow
@pytest.mark.parametrize(
    "false_w",
    [
        pytest.param(lambda t, power_w: 1e5 if 60 < t < 60.11 else power_w, id="one"),
        pytest.param(lambda t, power_w: 1e5 if 60 < t < 90 else power_w, id="a train"),
        pytest.param(lambda t, power_w: 6000.0 if 10 < t < 12 else power_w, id="a peak before the first lap"),
    ],
)
def test_false_readings_of_power_cost_no_quality(undisturbed, false_w):
    assert quality(false_w) == pytest.approx(undisturbed, abs=0.01)


def test_a_take_off_passes_and_says_nothing_of_the_power_after_it():
    """But what battery and motor cannot deliver."""
    gate = PowerGate(MEAN_W, LIMIT_W)
    times_s, powers_w = 0.1 * np.arange(100), np.full(100, 770.0)
    assert gate.ingest(times_s, powers_w, 5.0, on_plan=False).tolist() == powers_w.tolist()
    assert not gate.state.rejects
    assert gate.state.max_motion_w == 0
    assert math.isnan(gate.ingest(np.array([10.0]), np.array([LIMIT_W + 1]), 5.0, on_plan=False)[0])
    assert passed_of(gate, 10.1, 42.0) == 42
    assert passed_of(gate, 10.2, 770.0) is None
