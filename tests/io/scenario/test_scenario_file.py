"""Keys of the estimator: their defaults, what reaches it, what is refused."""

from __future__ import annotations

import pytest

from eadp.errors import InputError
from eadp.io.scenario.scenario_file import json_schema, read_scenario
from eadp.planning.estimation.estimator import EstimatorSettings


def test_the_estimators_defaults_are_its_own():
    assert read_scenario(None).estimator == EstimatorSettings()


def test_keys_reach_the_estimator():
    keys = {"disturbance_std_w": 0.0, "disturbance_time_s": 12.5, "learn_noise": False, "noise_w": 0.2, "gate_w": 0.1}
    found = read_scenario(None, {f"estimator.{key}": value for key, value in keys.items()}).estimator
    assert {key: getattr(found, key) for key in keys} == keys


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("disturbance_std_w", -0.1),
        ("disturbance_std_w", 1e7),
        ("disturbance_time_s", 0.0),
        ("disturbance_time_s", 1e7),
        ("learn_noise", 1),
    ],
)
def test_values_that_mean_nothing_are_refused(key, value):
    with pytest.raises(InputError) as refused:
        read_scenario(None, {f"estimator.{key}": value})
    assert key in str(refused.value.faults[0])


def test_what_the_new_keys_mean_is_in_the_schema():
    keys = json_schema()["$defs"]["EstimatorKeys"]["properties"]
    for key in ("disturbance_std_w", "disturbance_time_s", "learn_noise"):
        assert keys[key]["description"]
