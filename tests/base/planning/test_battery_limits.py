"""Limits of the battery's power in flights: kept to, and named."""

import numpy as np
import pytest

from eadp.api.flight import fly_flight
from eadp.api.inputs import load_flight
from eadp.models.battery import LOSS
from eadp.planning.forecast.battery_limits import LOSS_SQUARE


def flown(plan, profile=None, **keys):
    inputs = load_flight(plan, profile=profile, overrides={"step_s": 0.05, "wind.speed_mps": 4, **keys})
    expected = inputs.preflight()
    return fly_flight(inputs, expected), expected


def survey(root):
    return str(root / "plans/survey.plan"), str(root / "profiles/pednet-jetson-nano.yaml")


SURVEY = {
    "battery.capacity_ah": 1.0, "wind.speed_mps": 0, "planner.joint.start_after_s": 0,
    "planner.paper.min_periods": 0, "time_limit_s": 120,
}  # fmt: skip
BINDING = [
    ({"max_c_rate": 3.4}, "current", "the battery's current limit binds"),
    ({"cutoff_voltage_v": 14.5, "resistance_ohm": 0.0875}, "cut-off voltage", "the battery's cut-off voltage binds"),
    ({"resistance_ohm": 1.1}, "deliverable power", "the battery's deliverable power binds"),
    ({"letter_crate_per_h": 3.7}, "letter", "the letter's limit of power binds"),
]


@pytest.mark.quick(4)
@pytest.mark.parametrize("planner", ["joint", "paper"])
@pytest.mark.parametrize(("keys", "limit", "words"), BINDING)
def test_a_limit_that_binds_is_named(root, planner, keys, limit, words):
    battery = {f"battery.{key}": value for key, value in keys.items()}
    flight, _ = flown(*survey(root), **SURVEY, **battery, **{"planner.name": planner})
    named = {record.battery_limit for record in flight.decisions}
    assert limit in named
    assert named <= {limit, None}
    assert all(record.reason.endswith(words) == (record.battery_limit == limit) for record in flight.decisions)


def test_the_cut_off_voltage_is_an_empty_battery(root):
    keys = {"voltage_v": 16.8, "voltage_empty_v": 12.8, "cutoff_voltage_v": 14.0, "capacity_ah": 0.2}
    battery = {f"battery.{key}": value for key, value in keys.items()}
    static = {"planner.name": "static", "wind.speed_mps": 0}
    flight, expected = flown(*survey(root), **battery, **static)
    summary = flight.summary
    assert not summary["completed"]
    assert summary["reason"].startswith("battery empty: ")
    assert "cut-off voltage allows" in summary["reason"]
    # 14 V at the terminals and I = y/14 through 0.05 Ω
    volts = 12.8 + 4.0 * summary["soc_final"]
    assert volts - 0.05 * flight.columns["power_w"][-1] / 14.0 == pytest.approx(14.0, abs=0.02)
    assert expected.forecast.completes_probability < 0.01
    assert expected.forecast.soc_end < summary["soc_final"]


def test_moments_of_losses_are_those_of_draws():
    drawn = np.random.default_rng(1).uniform(0.02, 0.12, 1_000_000)
    assert pytest.approx(drawn.mean(), rel=1e-3) == LOSS
    assert pytest.approx((drawn**2).mean(), rel=1e-3) == LOSS_SQUARE
