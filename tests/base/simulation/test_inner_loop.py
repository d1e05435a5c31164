"""Flights by the inner loop: compiled beside plain, whatever the lengths of its runs."""

import math
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from common import ROOT, draws, few
from common.plans import PARTS
from hypothesis import example, given, settings
from hypothesis import strategies as st

from eadp.api.inputs import load_flight
from eadp.core import compiled
from eadp.simulation import loop
from eadp.simulation.inner_loop import InnerLoop
from eadp.simulation.loop import Outcome, fly, step_at

SURVEY, SCENARIO = str(ROOT / "plans/survey.plan"), str(ROOT / "scenarios/survey.yaml")
SAME = 1e-9
"""How far compiled flights may be from plain ones, relative to each number or 1. Where numba calls the C library that
Python calls they are the same to the last bit, but for what the estimator forecasts."""

CURVED = """\
0.05; 90; y - 20*sin(x/40)
-300, 20*sin(-300/40)
0.05; 270; x + 300
-300, -200
"""


@pytest.fixture
def no_longer_compiled():
    """Leaves the process as it found it."""
    yield
    compiled.enable(False)


fast = pytest.mark.skipif(not compiled.available(), reason="eadp[fast] is not installed")


class EveryStep:
    """A planner that is asked at every step, as a stream of telemetry would."""

    def __init__(self, planner):
        self._planner = planner
        self.report = planner.report
        self.asked = 0

    next_update_s = 0.0

    def update(self, state):
        self.asked += 1
        return self._planner.update(state)


def flown(overrides, plan=SURVEY, scenario=SCENARIO, wrapped=lambda planner: planner, on=False, world=lambda it: it):
    inputs = load_flight(plan, scenario=scenario, overrides=overrides)
    compiled.enable(on)
    outcome = Outcome()
    flight = inputs.flight()
    flight.planner = wrapped(flight.planner)
    steps = list(fly(world(inputs.world), flight, outcome))
    return outcome, steps


def numbers(outcome, steps):
    """All numbers of a flight."""
    rows = [(*step[:-1], *step.parameters) for step in steps]
    sums = (outcome.energy_j, outcome.distance_m, outcome.power_min_w, outcome.power_max_w, outcome.soc_final)
    return np.array([value for row in rows for value in row] + [*sums, *outcome.stage_times_s])


def same(one, other, within=SAME):
    (a, _), (b, _) = one, other
    assert (a.completed, a.reason, a.duration_s) == (b.completed, b.reason, b.duration_s)
    assert numbers(*one) == pytest.approx(numbers(*other), rel=within, abs=within)
    kept = [[record.history for record in outcome.parameters.records] for outcome in (a, b)]
    changes = [[list(change) for history in each for change in history] for each in kept]
    assert np.array(changes[0]) == pytest.approx(np.array(changes[1]), rel=within, abs=within)


def drawn(seed):
    """A scenario at random: vehicle, wind, gusts, losses, sensors, rules."""
    rng = np.random.default_rng(seed)
    sensors = {
        "sensors.power_noise_w": float(rng.choice([0, 0.4])),
        "sensors.position_noise_m": float(rng.choice([0, 1.0])),
        "sensors.soc_noise": float(rng.choice([0, 0.001])),
        "sensors.delay_s": float(rng.choice([0, 0.05, 0.3])),
        "sensors.drop_out_share": float(rng.choice([0, 0.2])),
    }
    return {
        **(sensors if rng.random() < 0.6 else {}),
        "vehicle.airframe.model": str(rng.choice(["paper", "fixed-wing"])),
        "wind.speed_mps": float(rng.uniform(0, 9)),
        "wind.towards_deg": float(rng.uniform(0, 360)),
        "wind.gust_std_mps": float(rng.choice([0, 0.7])),
        "battery.capacity_ah": float(rng.uniform(0.15, 0.45)),
        "battery.voltage_empty_v": [None, 12.5][int(rng.integers(2))],
        "faults": [{"at_s": float(rng.uniform(0, 150)), "soc_drop": 0.1} for _ in range(int(rng.integers(3)))],
        "guidance.wind_corrected": bool(rng.random() < 0.7),
        "parameter_changes": str(rng.choice(["latched", "live"])),
        "estimator.every_s": float(rng.choice([0.03, 0.1, 0.25])),
        "planner.name": str(rng.choice(["static", "paper", "joint"])),
        "planner.every_s": float(rng.choice([0.5, 1.0, 1.7])),
        "planner.paper.min_periods": 1,
        "log_every_s": float(rng.choice([0.1, 3.0, 1e9])),
        "time_limit_s": 260.0,
        "step_s": float(rng.choice([0.02, 0.03, 0.05])),
        "seed": seed,
    }


@pytest.mark.quick(1)
@fast
@pytest.mark.parametrize("seed", range(3))
def test_compiled_flights_are_the_plain_ones(seed, no_longer_compiled):
    same(flown(drawn(seed), on=True), flown(drawn(seed)))


@pytest.mark.quick(1)
@fast
@pytest.mark.parametrize("text", [CURVED, PARTS])
@pytest.mark.parametrize("vehicle", few(["paper", "power-curve", "fixed-wing"], 2))
def test_plans_of_parts_and_curves_too(tmp_path, text, vehicle, no_longer_compiled):
    path = tmp_path / "a.plan"
    path.write_text(text)
    overrides = {"vehicle.airframe.model": vehicle, "wind.gust_std_mps": 0.5, "battery.capacity_ah": 3.0, "faults": []}
    overrides["step_s"] = 0.05
    one, other = (flown(overrides, str(path), on=on) for on in (True, False))
    assert one[0].completed
    same(one, other)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [100, 102])
def test_a_planner_that_is_asked_when_due_flies_as_one_that_is_asked_at_every_step(seed):
    overrides = drawn(seed)
    if overrides["planner.name"] == "paper":  # it would see other jumps in the noise when it looks at every step
        overrides["sensors.soc_noise"] = 0.0
    asked = []

    def wrapped(planner):
        asked.append(EveryStep(planner))
        return asked[0]

    often = flown(overrides, wrapped=wrapped)
    assert asked[0].asked >= len(often[1])
    same(flown(overrides), often)


@pytest.mark.quick(1)
@fast
@pytest.mark.skipif(sys.platform != "linux", reason="numba may call another C library than Python")
@pytest.mark.parametrize("vehicle", ["paper", "fixed-wing", "power-curve"])
def test_static_flights_are_the_same_to_the_last_bit(vehicle, no_longer_compiled):
    """All of a flight but what its estimator forecasts."""
    overrides = {
        "vehicle.airframe.model": vehicle, "planner.name": "static", "wind.speed_mps": 6.0, "wind.gust_std_mps": 0.4,
        "sensors.delay_s": 0.1, "battery.capacity_ah": 0.35, "step_s": 0.02,
        "faults": [{"at_s": 60, "soc_drop": 0.05}], "log_every_s": 0.5,
    }  # fmt: skip
    flights = [flown(overrides, on=on) for on in (True, False)]
    (a, compiled_steps), (b, plain_steps) = flights
    assert [step._replace(power_forecast_w=0.0) for step in compiled_steps] == [
        step._replace(power_forecast_w=0.0) for step in plain_steps
    ]
    assert len(plain_steps) > 500
    for name in ("reason", "duration_s", "soc_final", "energy_j", "distance_m", "stage_times_s"):
        assert getattr(a, name) == getattr(b, name)


@pytest.mark.slow
@pytest.mark.parametrize("on", [pytest.param(True, marks=fast), False])
@pytest.mark.parametrize("planner", few(["joint", "static"], 1))
def test_without_a_log_the_flight_is_the_same(planner, on, no_longer_compiled):
    overrides = {"planner.name": planner, "step_s": 0.05, "faults": [], "battery.capacity_ah": 0.4}
    (logged, steps), (unlogged, nothing) = (
        flown({**overrides}, on=on, world=lambda world, s=s: replace(world, clock=world.clock._replace(log_every_s=s)))
        for s in (0.1, math.inf)
    )
    assert steps
    assert not nothing
    assert not unlogged.estimates
    assert len(logged.estimates) == len(steps)
    for name in ("reason", "duration_s", "soc_final", "energy_j", "distance_m", "stage_times_s"):
        assert getattr(logged, name) == getattr(unlogged, name)
    assert [record.parameters for record in logged.records] == [record.parameters for record in unlogged.records]


@pytest.mark.slow
@settings(max_examples=draws(0.3))
@given(
    planner=st.sampled_from(["static", "paper", "joint"]),
    every_s=st.sampled_from([0.05, 0.1, 0.5]),
    update_s=st.sampled_from([0.5, 1.0, 40.0]),
    log_every_s=st.sampled_from([0.1, 5.0, 30.0, 100.0, 1e9]),
    length_m=st.integers(60, 3000),
)
@example("static", 0.1, 1.0, 100.0, 3000)
def test_time_always_advances(planner, every_s, update_s, log_every_s, length_m):
    class Advancing(InnerLoop):
        def run(self, k, end):
            after = super().run(k, end)
            assert after[0] > k
            return after

    overrides = {
        "planner.name": planner, "planner.every_s": update_s, "estimator.every_s": every_s, "log_every_s": log_every_s,
        "step_s": 0.05, "time_limit_s": 230.0,
    }  # fmt: skip
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "InnerLoop", Advancing)
        path = Path(folder, "lines.plan")
        path.write_text(f"0.05; 90; y\n-{length_m}, 0\n[2, 10]\n0.05; 90; y - 90\n-{2 * length_m}, 90\n[2, 10]\n")
        outcome, _ = flown(overrides, str(path))
    assert outcome.reason


def test_a_path_without_a_value_ends_the_flight(tmp_path):
    path = tmp_path / "a.plan"
    path.write_text("0.05; 270; y - 5*sqrt(x)\n400, 100\n")
    overrides = {"planner.name": "static", "start.position_m": [5, 60], "start.heading_deg": 270}
    outcome, steps = flown(overrides, str(path))
    assert "has no value at" in outcome.reason
    assert steps[-1].time_s == outcome.duration_s


@pytest.mark.parametrize(
    ("time_s", "step_s", "step"),
    [(0.0, 0.01, 1), (0.01, 0.01, 1), (0.1, 0.01, 10), (0.11, 0.01, 11), (92.64, 0.01, 9264), (0.1, 0.03, 4)],
)
def test_the_step_at_a_time(time_s, step_s, step):
    assert step_at(time_s, step_s, 1 << 40) == step


def test_never_is_the_last_step():
    assert step_at(math.inf, 0.01, 700) == 700
