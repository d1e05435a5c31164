"""What is forecast before take-off against the flight that is then simulated."""

import math
from dataclasses import replace

import pytest
from common import ROOT, draws
from common.plans import STADIUM
from hypothesis import given, settings
from hypothesis import strategies as st

from eadp.api.inputs import Files, load_flight
from eadp.io.text.streams import Text
from eadp.simulation.loop import Outcome, fly

WIND = {"wind.speed_mps": 5.0, "wind.towards_deg": 60.0}


def inputs_of(plan, planner, **overrides):
    fixed = {"planner.name": planner, "step_s": 0.05, "faults": [], "wind.speed_mps": 0.0, **overrides}
    return load_flight(str(plan), scenario=str(ROOT / "scenarios/survey.yaml"), overrides=fixed)


def flown(inputs):
    outcome = Outcome()
    for _ in fly(inputs.world, inputs.flight(), outcome):
        pass
    return outcome


@pytest.mark.quick(1)
@pytest.mark.parametrize("wind", [WIND, {}])
@pytest.mark.parametrize("planner", ["static", "joint"])
def test_the_forecast_is_what_is_flown(planner, wind):
    more = {"battery.capacity_ah": 0.45, **({"parameters.c1": -1000.0} if planner == "static" else {})}
    inputs = inputs_of(ROOT / "plans/survey.plan", planner, **wind, **more)
    expected = inputs.preflight()
    assert expected is not None
    assert expected.feasible
    evaluated, outcome = expected.forecast, flown(inputs)
    assert outcome.completed
    assert evaluated.completes_probability > 0.95
    assert evaluated.reserve_probability > 0.9
    quality = outcome.parameters.quality({})
    if planner == "static":
        assert outcome.duration_s == pytest.approx(evaluated.remaining_s, rel=0.02)
        assert abs(outcome.duration_s - evaluated.remaining_s) < 3 * evaluated.remaining_std_s
        assert abs(outcome.energy_j / 3600 - evaluated.energy_wh) < 3 * evaluated.energy_std_wh
        assert abs(outcome.soc_final - evaluated.soc_end) < 3 * evaluated.soc_end_std
        assert [*expected.parameters.values()] == pytest.approx([*inputs.mission.parameters])
        assert expected.quality == pytest.approx(quality, abs=0.02)
    else:  # it is sure of more on the way, and spends what it had to save before take-off
        reserve = inputs.scenario.planner.reserve_soc
        assert outcome.soc_final >= reserve
        assert outcome.soc_final < evaluated.soc_end + 2 * evaluated.soc_end_std
        assert evaluated.remaining_s * 0.98 < outcome.duration_s < evaluated.remaining_s * 1.2
        assert expected.quality - 0.02 < quality < expected.quality + 0.25
    assert sum(seconds for seconds, _ in expected.stages.values()) == pytest.approx(evaluated.remaining_s)
    assert sum(energy for _, energy in expected.stages.values()) == pytest.approx(evaluated.energy_wh)


@pytest.mark.quick(1)
@pytest.mark.parametrize("planner", ["static", "joint"])
def test_a_battery_that_is_too_small_is_told_before_take_off(planner):
    inputs = inputs_of(ROOT / "plans/survey.plan", planner, **{"battery.capacity_ah": 0.15})
    expected = inputs.preflight()
    assert not expected.feasible
    assert expected.forecast.completes_probability < 0.5
    assert expected.forecast.soc_end < 0
    assert not flown(inputs).completed


def test_a_charge_that_is_replayed_is_not_forecast():
    inputs = inputs_of(ROOT / "plans/survey.plan", "joint", **{"battery.prescribed": [[0, 1], [400, 0.2]]})
    assert inputs.preflight() is None


@pytest.mark.parametrize("planner", ["static", "paper", "joint"])
def test_a_wind_that_cannot_be_flown_in_has_no_forecast(planner):
    inputs = inputs_of(ROOT / "plans/survey.plan", planner)
    stormy = replace(inputs, world=replace(inputs.world, wind=replace(inputs.world.wind, speed_mps=40.0)))
    assert stormy.preflight() is None


def test_a_plan_without_parameters_has_a_forecast(tmp_path):
    path = tmp_path / "line.plan"
    path.write_text("0.1; 90; x\n0, 400\n")
    inputs = load_flight(str(path))
    expected = inputs.preflight()
    assert (expected.parameters, expected.quality) == ({}, None)
    # from 100 m before the trigger to it at 15 m/s
    assert expected.forecast.remaining_s == pytest.approx(100 / 15)
    power_w = inputs.mission.vehicle.cruise_power_w
    assert expected.forecast.energy_wh == pytest.approx(power_w * 100 / 15 / 3600, rel=1e-6)


AIRSPEED_MPS, STEP_S = 15.0, 0.02


@settings(max_examples=draws(0.3))
@given(st.lists(st.floats(1.0, 40.0), min_size=4, max_size=4))
def test_each_stage_ends_within_its_own_radius_in_the_flight_and_its_forecast(radii_m):
    keys = {"planner.name": "static", "step_s": STEP_S, "log_every_s": STEP_S, "battery.capacity_ah": 2.0}
    plan = Text("stadium.plan", STADIUM.format(*radii_m))
    inputs = load_flight(plan.name, overrides=keys, files=Files({plan.name: plan}))
    triggers = [(-75.0, 0.0), (75.0, 0.0), (75.0, 200.0), (-75.0, 200.0)]
    outcome, ends = Outcome(), {}
    for row in fly(inputs.world, inputs.flight(), outcome):
        ends[row.stage] = math.dist((row.x_m, row.y_m), triggers[row.stage - 1])
    assert outcome.completed
    for stage, (radius_m, gap_m) in enumerate(zip(radii_m, ends.values(), strict=True), 1):
        assert radius_m - AIRSPEED_MPS * STEP_S - 1e-6 <= gap_m <= radius_m, stage
    remaining_s = inputs.preflight().forecast.remaining_s
    # the forecast flies to the final point, the flight ends at its circle
    assert outcome.duration_s == pytest.approx(remaining_s - radii_m[-1] / AIRSPEED_MPS, abs=1.0)
