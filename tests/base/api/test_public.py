"""The public API: its names, its laziness, and that it gives what the commands give."""

import csv
import json
import pickle
import re
import warnings

import numpy as np
import pytest
from common import ROOT

import eadp as library

PUBLIC = {
    "FlightOptions",
    "LinkOptions",
    "ReplanOptions",
    "check_plan",
    "replan",
    "CoverageOptions", "CoveragePlan", "EadpError", "EnergyFit", "EnergyModel", "ExportOptions", "Flight",
    "Infeasible", "InputError", "JobFlight", "SortieOptions", "SortiePlan", "cover_in_sorties", "simulate_sorties",
    "Plan", "Profile", "SweepFlight", "cover", "export", "fit_power", "fit_vehicle",
    "forecast", "read_plan", "read_profile", "report", "simulate", "sweep", "vehicle",
}  # fmt: skip
PLAN, SCENARIO = str(ROOT / "plans/survey.plan"), str(ROOT / "scenarios/survey.yaml")
FIELD = str(ROOT / "plans/meadow.geojson")
SHORT = {"time_limit_s": 20, "step_s": 0.05}


def test_the_public_names_are_these():
    assert set(library.__all__) == PUBLIC
    assert {*PUBLIC, "__version__"} == set(dir(library))
    for name in PUBLIC:
        assert (getattr(library, name).__doc__ or "").strip(), name
    stub = (ROOT / "eadp/__init__.pyi").read_text(encoding="utf-8")
    assert set(json.loads(stub.partition("__all__ = ")[2].replace(",\n]", "\n]"))) == PUBLIC
    with pytest.raises(AttributeError, match="no attribute 'nosuch'"):
        _ = library.nosuch


def test_a_flight_and_the_functions_can_be_pickled():
    seen = []
    flight = library.simulate(PLAN, SCENARIO, overrides=SHORT, on_step=seen.append)
    last = flight.estimates[-1]
    assert seen == flight.steps
    assert float(last.forecast_w(3)) == pytest.approx(last.forecast_w(np.array([3.0, 4.0]))[0], rel=1e-12)
    copied = pickle.loads(pickle.dumps(flight))
    assert (copied.summary, copied.steps) == (flight.summary, flight.steps)
    assert copied.inputs.scenario.planner == flight.inputs.scenario.planner
    assert pickle.loads(pickle.dumps(library.simulate)) is library.simulate
    with pytest.raises(library.InputError) as caught:
        library.read_plan("nosuch")
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


WRONG = [
    (lambda: library.simulate(PLAN, overrides={"wind.x": 1}), "--set wind.x:1:1: error: unknown key wind.x"),
    (lambda: library.fit_power("a", "b"), "times_s, power_w:1:1: error: could not convert"),
    (lambda: library.fit_power(range(50), range(40)), "times_s, power_w:1:1: error: of shapes (50,) and (40,)"),
    (lambda: library.fit_power([1.0] * 50, [1.0] * 50), "times_s, power_w:1:1: error: not finite, or not in order"),
    (lambda: library.cover(FIELD, library.CoverageOptions(min_radius_m=30)), "expected --swath, or"),
    (lambda: library.export(PLAN, "nix"), "--to:1:1: error: is no format"),
]


@pytest.mark.parametrize(("call", "message"), WRONG)
def test_what_is_wrong_is_an_error_that_names_the_option(call, message):
    with pytest.raises(library.InputError, match=re.escape(message)):
        call()


def test_a_flight_is_that_of_the_command(eadp, tmp_path):
    given = [word for key, value in SHORT.items() for word in ("--set", f"{key}={value}")]
    command = ("simulate", PLAN, "--scenario", SCENARIO, *given, "--planner", "joint", "--seed", "3")
    assert eadp(*command, "-o", tmp_path / "command").code == 1
    flight = library.simulate(PLAN, SCENARIO, overrides=SHORT, planner="joint", seed=3)
    flight.write(tmp_path / "library")
    for name in ("flight.csv", "inputs/overrides.txt", "inputs/plan/survey.plan", "inputs/scenario/survey.yaml"):
        assert (tmp_path / "library" / name).read_bytes() == (tmp_path / "command" / name).read_bytes(), name
    with (tmp_path / "library/flight.csv").open(encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    assert list(flight.columns) == rows[0]
    assert np.array(rows[1:], dtype=float).T.tolist() == [column.tolist() for column in flight.columns.values()]
    decisions = (tmp_path / "library/decisions.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(decisions) == len(flight.decisions) > 0
    assert json.loads((tmp_path / "library/summary.json").read_text(encoding="utf-8"))["seed"] == 3
    with pytest.raises(library.InputError, match="exists already"):
        flight.write(tmp_path / "library")


def test_objects_stand_for_their_files():
    profile = str(ROOT / "profiles/pednet-letter.yaml")
    energy = library.fit_power(*np.array([(t, 30 + np.cos(t / 8)) for t in range(400)]).T).model
    by_path = library.simulate(PLAN, profile=profile, energy=energy, overrides={**SHORT, "wind.speed_mps": 3.0})
    keys = {"wind": {"speed_mps": np.float64(3)}, **{key: np.array(value) for key, value in SHORT.items()}}
    by_object = library.simulate(library.read_plan(PLAN), keys, library.read_profile(profile), energy)
    assert by_object.steps == by_path.steps
    assert by_object.inputs.mission.energy == energy
    assert set(by_object.inputs.sources) == {"plan", "scenario", "profile", "energy"}


def test_warnings_are_pythons_or_the_callers(tmp_path):
    path = tmp_path / "rough.plan"
    path.write_text("0.1; 90; abs(x) - c1\n0, 400\n[-10, 10]\n")
    with pytest.warns(UserWarning, match=r"rough\.plan:1:10: warning"):
        plan = library.read_plan(path)
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert library.read_plan(path, warn=found.extend) == plan
    assert [fault.severity for fault in found] == ["warning"]


def test_faults_of_what_is_given_have_a_place():
    with pytest.raises(library.InputError, match=r"given-keys\.yaml:1:\d+: error: wind\.speed_mps cannot be -1"):
        library.simulate(PLAN, {"wind": {"speed_mps": -1}})
    with pytest.raises(library.InputError, match=r"given-keys\.yaml:1:\d+: error: unknown key nosuch"):
        library.sweep({"plan": PLAN, "grid": {"nosuch": [1]}})
    with pytest.raises(library.InputError, match=r"--wind:1:1: error: a wind of 30 m/s"):
        library.cover(ROOT / "plans/meadow.geojson", library.CoverageOptions(30, 30, wind=(30, 10)))


def test_the_forecast_is_that_of_the_command(eadp):
    given = [word for key, value in SHORT.items() for word in ("--set", f"{key}={value}")]
    told = json.loads(eadp("simulate", PLAN, "--scenario", SCENARIO, *given, "--format", "json").out)
    assert library.forecast(PLAN, SCENARIO, overrides=SHORT) == told["energy_forecast"]
    assert library.forecast(PLAN, ROOT / "scenarios/paper-i-dynamic.yaml") is None, "the charge is prescribed"


def test_an_export_is_that_of_the_command(eadp, tmp_path):
    notes = []
    options = library.ExportOptions(["spacing=20"], origin_deg=(55.37, 10.43))
    written = library.export(PLAN, "qgc", options, tmp_path / "m.plan", warn=notes.extend)
    answer = eadp("export", PLAN, "--to", "qgc", "--origin", "55.37,10.43", "--set", "spacing=20")
    assert written == answer.out == (tmp_path / "m.plan").read_text()
    assert [note.message for note in notes] == [
        "altitude 25 m, that of the default aircraft, as there is no --scenario; --altitude sets another"
    ]
    assert library.export(library.read_plan(PLAN), "qgc", options, warn=notes.extend) == written.replace(
        "survey.plan", "given.plan"
    )
    with pytest.raises(library.InputError, match=r"--to:1:1: error: is no format; expected one of .* did you mean qgc"):
        library.export(PLAN, "qg", options)


def test_a_field_is_covered_as_by_the_command(eadp):
    options = ("--min-radius", "40", "--swath", "30", "--wind", "4,200", "--heading", "80")
    answer = eadp("cover", "plans/meadow.geojson", *options, "--format", "json")
    chosen = library.CoverageOptions(min_radius_m=40, swath_m=30, wind=(4, 200), heading_deg=80)
    coverage = library.cover("plans/meadow.geojson", chosen)
    assert json.loads(json.dumps(coverage.document)) == json.loads(answer.out)
    assert coverage.plan.min_radius_m == 40


def test_a_sweep_is_that_of_the_command_and_is_kept(eadp, tmp_path):
    keys = {"plan": PLAN, "scenario": SCENARIO, "grid": {"wind.speed_mps": [0, 3]}, "seeds": 2}
    path = tmp_path / "sweep.yaml"
    path.write_text(json.dumps({"schema": "eadp.sweep/1", **keys}))
    out = tmp_path / "results.sqlite"
    rows = library.sweep(keys, overrides=SHORT, out=out)
    assert rows == library.sweep(path, overrides=["time_limit_s=20", "step_s=0.05"])
    assert [row.seed for row in rows] == [0, 1, 0, 1]
    given = [word for key, value in SHORT.items() for word in ("--set", f"{key}={value}")]
    answer = eadp("sweep", path, "--jobs", "1", *given, "-o", out, "--format", "csv")
    assert "more runs" not in answer.err
    assert [float(row["soc_final"]) for row in csv.DictReader(answer.out.splitlines())] == [r.soc_final for r in rows]
