"""A flight's folder: decisions line by line, what was forecast before take-off, the figure; OSQP that is broken."""

import csv
import json

import numpy as np
import pytest
from broken_osqp import BROKEN, BUG, broken_osqp
from common import ROOT, few

import eadp
from eadp.api.flight import _copy_inputs, fly_flight
from eadp.api.inputs import load_flight
from eadp.io.text.streams import Text
from eadp.planning.base import DecisionRecord, Ending, HomeRecord


@pytest.fixture(scope="module")
def written(root, tmp_path_factory):
    """Folders and short flights by planner."""
    base, found = tmp_path_factory.mktemp("flights"), {}
    for planner in ("joint", "static"):
        inputs = load_flight(
            str(root / "plans/survey.plan"),
            scenario=str(root / "scenarios/survey.yaml"),
            overrides={"planner.name": planner, "time_limit_s": 30, "step_s": 0.05, "planner.joint.max_interval_s": 5},
        )
        flight = fly_flight(inputs, inputs.preflight())
        folder = base / planner
        flight.write(folder)
        found[planner] = folder, flight
    return found


def test_each_decision_is_a_line(written):
    folder, flight = written["joint"]
    rows = [json.loads(line) for line in (folder / "decisions.jsonl").read_text(encoding="utf-8").splitlines()]
    assert len(rows) == len(flight.decisions) > 2
    parts = {"ending": Ending._fields, "home": HomeRecord._fields}
    keys = [key for field in DecisionRecord._fields for key in parts.get(field, (field,))]
    for row, record in zip(rows, flight.decisions, strict=True):
        assert list(row) == keys
        assert row["time_s"] == pytest.approx(record.time_s, abs=1e-9)
        assert row["parameters"] == dict(zip(("c1", "c2"), record.parameters, strict=True))
        assert row["wind_mps"] == list(record.wind_mps)
        assert row["soc_end"] == record.ending.soc_end
        assert row["reason"] == record.reason
        assert 0 <= row["reserve_probability"] <= row["completes_probability"] <= 1
    assert (folder / "decisions.jsonl").read_bytes().endswith(b"\n")


def test_inputs_of_one_name_are_all_kept(tmp_path):
    texts = {
        "plan": Text("a/overrides.txt", "1"),
        "scenario": Text("b/overrides.txt", "2"),
        "profile": Text("<stdin>", "3"),
    }
    _copy_inputs(tmp_path, texts, ["vehicle.name=\udcff"])
    files = {str(path.relative_to(tmp_path)): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert files.pop("overrides.txt") == b"vehicle.name=\xff\n"
    assert files == {"plan/overrides.txt": b"1", "scenario/overrides.txt": b"2", "profile/stdin": b"3"}


@pytest.mark.parametrize("planner", ["joint", "static"])
def test_the_forecast_of_take_off(written, planner):
    folder, flight = written[planner]
    kept = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["energy_forecast"]
    assert kept == flight.summary["energy_forecast"]
    assert set(kept) == {
        "completes", "completes_probability", "reserve_probability", "time_s", "time_std_s", "energy_wh",
        "energy_std_wh", "computing_wh", "soc_end", "soc_end_std", "parameters", "quality", "turn_back_s",
        "turn_back_m", "batteries", "reach_share", "reach_s", "reach_m", "obstacles", "stages",
    }  # fmt: skip
    assert kept["completes"] == (kept["completes_probability"] >= 0.5)
    assert [stage["stage"] for stage in kept["stages"]] == [1, 2, 3, 4]
    assert sum(stage["time_s"] for stage in kept["stages"]) == pytest.approx(kept["time_s"])
    assert sum(stage["energy_wh"] for stage in kept["stages"]) == pytest.approx(kept["energy_wh"])
    assert set(kept["parameters"]) == {"c1", "c2"}


def test_the_figure_is_written_with_marks_where_there_are_decisions(written):
    for planner in ("joint", "static"):
        folder = written[planner][0]
        assert (folder / "flight.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (folder / "flight.svg").read_text(encoding="utf-8")
    decided = {record.parameters for record in written["joint"][1].decisions}
    assert decided - {(0.0, 10.0)}, "there is something to mark"
    drawn = [(written[planner][0] / "flight.svg").read_text(encoding="utf-8").count("<use ") for planner in written]
    assert drawn[0] > drawn[1]


@pytest.mark.parametrize("planner", ["joint", "static"])
def test_the_estimate_follows_the_flight(written, planner):
    folder, flight = written[planner]
    with (folder / "estimate.csv").open(encoding="utf-8", newline="") as stream:
        rows = [{key: float(cell) for key, cell in row.items()} for row in csv.DictReader(stream)]
    assert len(rows) > 250
    columns, battery = flight.columns, flight.inputs.mission.battery
    steps = [{key: values[i] for key, values in columns.items()} for i in range(len(columns["time_s"]))]
    for row, step in zip(rows[-200:], steps[-200:], strict=True):
        assert 0 <= step["time_s"] - row["time_s"] < 0.1 + 1e-6, "the reading before the logged moment"
        state = [row[f"q{i}_w"] for i in range(7)]
        assert row["computing_w"] == pytest.approx(4.75376 + (9.75462 - 4.75376) * (step["c2"] - 2) / 8, abs=1)
        assert row["battery_wh"] == pytest.approx(step["soc"] * battery.capacity_ah * battery.voltage_v, abs=1e-5)
        assert row["power_limit_w"] == pytest.approx(battery.voltage_v**2 / (4 * battery.resistance_ohm), rel=1e-5)
        assert row["horizon_s"] == row["period_s"], "a planner without a horizon of its own looks one period ahead"
        assert row["forecast_12_w"] - row["forecast_0_w"] == pytest.approx(0, abs=1), "a period later it is the same"
        assert row["forecast_0_w"] == pytest.approx(sum(state[:1] + state[1::2]) + row["computing_w"], abs=1)
    error = [row["forecast_0_w"] - step["power_w"] for row, step in zip(rows[-200:], steps[-200:], strict=True)]
    assert np.median(np.abs(error)) < 0.3


SCENARIOS = {
    "paper": ("paper-drained", {"time_limit_s": 150, "step_s": 0.05}),
    "joint": ("survey", {"time_limit_s": 150, "step_s": 0.05, "battery.capacity_ah": 0.62}),
}


def flown(planner):
    scenario, overrides = SCENARIOS[planner]
    return eadp.simulate(
        ROOT / "plans/survey.plan", scenario=ROOT / f"scenarios/{scenario}.yaml", planner=planner, overrides=overrides
    )


@pytest.fixture(scope="module", params=["paper", "joint"])
def sound(request):
    return request.param, flown(request.param)


@pytest.mark.parametrize("planner", SCENARIOS)
def test_a_bug_ends_the_flight(planner):
    with broken_osqp(BUG), pytest.raises(AttributeError, match="no such thing"):
        flown(planner)


def test_every_replanning_of_a_sound_solver_is_accounted_for(sound):
    _, flight = sound
    solver, statuses = flight.summary["solver"], [record.status for record in flight.decisions]
    assert (
        solver["calls"] == solver["solved"] + solver["failed"] == sum(record.calls for record in flight.decisions) > 0
    )
    assert solver["failed"] == solver["retried"] == solver["fallbacks"] == 0
    assert solver["by_status"] == {"solved": solver["calls"]}
    assert solver["skipped"] == statuses.count("kept")
    assert flight.summary["replans"] == sum(record.calls > 0 for record in flight.decisions)
    solved = [record for record in flight.decisions if record.status == "solved"]
    assert solved
    assert all(record.gap is not None for record in solved)


@pytest.mark.quick(2)
@pytest.mark.parametrize("broken", few(BROKEN, 2))
def test_a_broken_solver_shows_and_the_fallback_flies(sound, broken):
    planner, good = sound
    with broken_osqp(BROKEN[broken]):
        flight = flown(planner)
    solver, statuses = flight.summary["solver"], [record.status for record in flight.decisions]
    assert solver["calls"] == solver["failed"] == 2 * solver["retried"] > 0
    assert solver["solved"] == solver["skipped"] == 0
    assert solver["fallbacks"] == statuses.count("fallback") == flight.summary["replans"]
    assert solver["gap_max"] is None
    assert "solved" not in solver["by_status"]
    assert all(("fallback, " in record.reason) == (record.status == "fallback") for record in flight.decisions)
    assert flight.summary["soc_final"] > 0
    if planner == "paper":  # δ lowers the whole horizon alike
        assert [record.parameters for record in flight.decisions] != [record.parameters for record in good.decisions]
