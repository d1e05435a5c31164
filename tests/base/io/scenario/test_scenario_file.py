"""Scenario files: the estimator's keys, the description of every key, angles."""

import pytest
import yaml
from common import ROOT
from jsonschema import Draft202012Validator
from settings_page import pages

from eadp.api.inputs import load_flight
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.errors import InputError
from eadp.io.scenario import json_schema, read_scenario
from eadp.io.text.yaml import properties, schema_of
from eadp.io.vehicle import VehicleFile
from eadp.simulation.loop import Outcome, fly


@pytest.mark.parametrize(("key", "value"), [("disturbance_std_w", -0.1), ("disturbance_time_s", 0.0)])
def test_values_that_mean_nothing_are_refused(key, value):
    with pytest.raises(InputError) as refused:
        read_scenario(None, {f"estimator.{key}": value})
    assert key in str(refused.value.faults[0])


# --- every key

UNITS = {
    "w_per_sqrt_s": "W/√s", "per_s": "1/s", "per_h": "1/h", "per_m": "1/m", "mps": "m/s", "kgpm3": "kg/m³", "m2": "m²",
    "ohm": "Ω", "deg": "°", "ah": "Ah", "kg": "kg", "s": "s", "m": "m", "w": "W", "v": "V", "n": "N",
}  # fmt: skip
"""Units by how a key's name ends; the first that fits."""


def keys_of(schema, node, path=()):
    for name, inner in properties(schema, node):
        yield ".".join((*path, name)), inner
        yield from keys_of(schema, inner, (*path, name))
        yield from keys_of(schema, inner.get("items") or {}, (*path, name))


@pytest.mark.parametrize("schema", [json_schema(), schema_of(VehicleFile)], ids=["scenario", "vehicle"])
def test_every_key_has_a_sentence_and_its_unit(schema):
    seen = 0
    for key, node in keys_of(schema, schema):
        seen += 1
        assert node.get("description", "").endswith("."), key
        unit = next((unit for end, unit in UNITS.items() if key.endswith(f"_{end}")), None)
        assert unit is None or f"[{unit}" in node["description"], key
    assert seen > 35


REFUSED = [
    {"wind": {"from_deg": 270, "towards_deg": 90}},
    {"wind": {"speed_mps": 3, "profile": [[0, 4, 270]]}},
    {"battery": {"cells": 4, "voltage_v": 16}},
    {"battery": {"chemistry": "lipo"}},
    {"parameters": {"1c": 3}},
    {"bounds": {"c 1": [0, 1]}},
]


@pytest.mark.parametrize("keys", REFUSED)
def test_keys_that_exclude_one_another_and_names_that_are_none(tmp_path, keys):
    (tmp_path / "s.yaml").write_text(yaml.safe_dump({"schema": "eadp.scenario/1"} | keys))
    with pytest.raises(InputError):
        read_scenario(str(tmp_path / "s.yaml"))
    if {"parameters", "bounds"} & keys.keys():  # the rest is beyond the schema
        assert not Draft202012Validator(json_schema()).is_valid({"schema": "eadp.scenario/1"} | keys)


@pytest.mark.parametrize("path", sorted((ROOT / "scenarios").glob("*.yaml")), ids=lambda path: path.name)
def test_the_schema_takes_what_is_shipped(path):
    if not path.name.startswith("sweep"):
        Draft202012Validator(json_schema()).validate(yaml.safe_load(path.read_text(encoding="utf-8")))


def test_the_page_of_keys_is_that_of_the_schemas():
    page = (ROOT / "docs/scenario.md").read_text(encoding="utf-8")
    assert page == "\n".join(pages()) + "\n", "python tests/support/settings_page.py > docs/scenario.md"


def test_sections_of_planners_that_do_not_fly_are_checked():
    assert read_scenario(None, {"planner.name": "static", "planner.paper.horizon_s": "period"}).planner.name == "static"
    with pytest.raises(InputError, match=r"planner\.paper\.horizon_s cannot be -1"):
        read_scenario(None, {"planner.name": "static", "planner.paper.horizon_s": -1})


# --- angles


def test_setting_one_direction_of_the_wind_removes_the_other(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text("schema: eadp.scenario/1\nwind: {speed_mps: 5, towards_deg: 90}\n")
    assert read_scenario(str(path), {"wind.from_deg": 270}).keys.wind.steady_mps == pytest.approx((5, 0))
    path.write_text("schema: eadp.scenario/1\nwind: {speed_mps: 5, from_deg: 180}\n")
    assert read_scenario(str(path), {"wind.towards_deg": 0}).keys.wind.steady_mps == pytest.approx((5, 0))


def test_an_override_of_a_part_of_another_way_does_not_replace_what_is_given(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text("schema: eadp.scenario/1\nbattery: {cells: 3}\n")
    assert read_scenario(str(path), {"battery.voltage_v": 14.8}).keys.battery.cells is None
    with pytest.raises(InputError, match=r"battery\.cells and battery\.voltage_empty_v are both given"):
        read_scenario(str(path), {"battery.voltage_empty_v": 13})


def test_a_flight_that_starts_with_heading_90_flies_east(tmp_path):
    plan = tmp_path / "east.plan"
    plan.write_text("0.1; 270; y\n400, 0\n")  # along y = 0, to a trigger in the east
    overrides = {"start.position_m": [0, 0], "start.heading_deg": 90, "planner.name": "static", "time_limit_s": 5}
    inputs = load_flight(str(plan), overrides=overrides)
    steps = list(fly(inputs.world, inputs.flight(), Outcome()))
    assert steps[-1].x_m == pytest.approx(5 * 15, abs=1)
    assert abs(steps[-1].y_m) < 0.1


# --- places on the earth

ORIGIN = (55.37, 10.43)


@pytest.fixture
def line(tmp_path):
    path = tmp_path / "line.plan"
    path.write_text(f"%: origin {ORIGIN[0]} {ORIGIN[1]}\n0.1; 270; y\n300, 0\n0.1; 270; y\n900, 0\n")
    return str(path)


def test_start_and_home_are_latitudes_and_longitudes_too(line):
    north, east = to_geodetic_deg(0.0, 800.0, ORIGIN), to_geodetic_deg(-200.0, 5.0, ORIGIN)
    keys = {"home": dict(zip(("lat_deg", "lon_deg"), north, strict=True)), "start.lat_deg": east[0]}
    inputs = load_flight(line, overrides={**keys, "start.lon_deg": east[1]})
    assert inputs.mission.way_home.position_m == pytest.approx((0.0, 800.0), abs=1e-3)
    assert inputs.world.start.position_m == pytest.approx((-200.0, 5.0), abs=1e-3)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("start", {"lat_deg": 55.37}, "one of lat_deg and lon_deg"),
        (
            "home",
            {"lat_deg": 55.37, "lon_deg": 10.4, "position_m": [0, 0]},
            "home.position_m and home.lat_deg are both given",
        ),
        ("home", {"lat_deg": 91, "lon_deg": 10.4}, "home.lat_deg cannot be 91"),
        ("home", {"lat_deg": 55.37, "lon_deg": -169.57}, "too far from the plan's origin"),
        # of a grid
        ("home", {"position_m": [578000, 6147000]}, "the home is 6174 km from the plan's first trigger"),
        ("start", {"position_m": [0, 200000]}, "the start is 200 km from the plan's first trigger"),
    ],
)
def test_places_that_are_none_are_refused(line, key, value, words):
    with pytest.raises(InputError) as refused:
        load_flight(line, overrides={key: value})
    assert words in str(refused.value.faults[0])


def test_a_plan_without_an_origin_has_no_latitudes():
    with pytest.raises(InputError) as refused:
        load_flight(
            str(ROOT / "plans/survey.plan"),
            scenario=str(ROOT / "scenarios/survey.yaml"),
            overrides={"home": {"lat_deg": 55.37, "lon_deg": 10.43}},
        )
    assert "the plan has no origin" in str(refused.value.faults[0])


# --- keys and values that mean something else than they seem to


def faults_of(tmp_path, body):
    """The faults of a scenario, without its name."""
    file = tmp_path / "s.yaml"
    file.write_text(f"schema: eadp.scenario/1\n{body}\n")
    with pytest.raises(InputError) as refused:
        read_scenario(str(file))
    return [str(fault).splitlines()[0].removeprefix(f"{file}:") for fault in refused.value.faults]


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("wind: {speed_mps: 6,5, from_deg: 270}", "2:21: error: unknown key wind.5"),
        (
            "reserve_soc: 0,1",
            "2:1: error: reserve_soc cannot be '0,1'; expected a number with a decimal point, as in 0.1",
        ),
        (
            "wind: {5: }",
            "2:8: error: unknown key wind.5; "
            "expected one of speed_mps, from_deg, towards_deg, profile, gust_std_mps, gust_time_s",
        ),
        ("parameters: {c-1: 2}", "2:14: error: parameters.c-1 cannot be 'c-1'; expected pattern "),
    ],
)
def test_no_key_is_dropped(tmp_path, body, fault):
    (found,) = faults_of(tmp_path, body)
    assert found.startswith(fault)


def test_unknown_keys_that_are_null_are_refused_beside_other_faults(tmp_path):
    first, second = faults_of(tmp_path, "wingspam:\nwind: {speed_mps: -1, from_deg: }")
    assert first.startswith("2:1: error: unknown key wingspam; expected one of ")
    assert second.startswith("3:8: error: wind.speed_mps cannot be -1")


def test_known_keys_that_are_null_are_absent(tmp_path):
    file = tmp_path / "s.yaml"
    body = "wind: {speed_mps: }\nbattery:\nparameters: {c1: ~}\nvehicle: {airframe: {model: null, mass_kg: }}\n"
    file.write_text(f"schema: eadp.scenario/1\n{body}")
    found, default = read_scenario(str(file)).keys, read_scenario(None).keys
    assert (found.wind, found.parameters, found.vehicle) == (default.wind, default.parameters, default.vehicle)
