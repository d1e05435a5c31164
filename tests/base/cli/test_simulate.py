"""`eadp simulate` as its users meet it: answers, result folder, refusals."""

import csv
import json
import math
import re
import sys

import pytest
from broken_osqp import BROKEN, broken_osqp
from common import few
from common.answers import refused
from common.pages import Page

PLAN = "plans/survey.plan"
SCENARIO = "scenarios/paper-i-dynamic.yaml"
LINE = "0.1; 90; x\n0, 400\n"
SHORT = ("--set", "time_limit_s=20")
SUBROUTINE = ("--scenario", SCENARIO, "--set", "planner.paper.solver=subroutine")


@pytest.fixture
def line_plan(tmp_path):
    """A line without parameters."""
    path = tmp_path / "line.plan"
    path.write_text(LINE)
    return path


def test_a_plan_without_parameters_flies_as_it_stands(eadp, line_plan):
    answer = eadp("simulate", line_plan, "--format", "json")
    assert answer.code == 0
    summary = json.loads(answer.out)
    assert summary["completed"]
    assert summary["quality"] is None
    assert summary["parameters"] == {}
    # from 100 m before the trigger to 20 m before it, at 15 m/s
    assert summary["duration_s"] == pytest.approx(80 / 15, abs=0.02)
    assert summary["distance_m"] == pytest.approx(80, abs=0.3)


def test_the_result_folder(eadp, tmp_path):
    folder = tmp_path / "results/deep/i"
    answer = eadp("simulate", PLAN, "--scenario", SCENARIO, "-o", folder, *SHORT)
    assert answer.code == 1
    assert sorted(item.name for item in folder.iterdir()) == [
        "estimate.csv", "files.json", "flight.csv", "flight.png", "flight.svg", "inputs", "report.html",
        "summary.json", "timings.json",
    ]  # fmt: skip
    with (folder / "flight.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    head = "time_s,stage,x_m,y_m,altitude_m,heading_rad,power_w,power_forecast_w,soc,c1,c2"
    assert list(rows[0]) == head.split(",")
    times = [float(row["time_s"]) for row in rows]
    assert times == pytest.approx([0.1 * (i + 1) for i in range(200)])
    assert all(math.isfinite(float(cell)) for row in rows for cell in row.values())
    names = sorted(item.name for item in (folder / "inputs").rglob("*.*"))
    assert names == ["overrides.txt", "paper-i-dynamic.yaml", "pednet-letter.yaml", "survey.plan"]
    assert [item.name for item in folder.parent.iterdir()] == ["i"], "no temporary folder is left"


def test_same_inputs_same_bytes(eadp, tmp_path):
    gusts = ("--set", "wind.gust_std_mps=1", "--seed", "7")
    for name in ("a", "b"):
        eadp("simulate", PLAN, "--scenario", SCENARIO, "-o", tmp_path / name, *gusts, "--set", "time_limit_s=40")
    eadp("simulate", PLAN, "--scenario", SCENARIO, "-o", tmp_path / "c", *gusts[:2], "--seed", "8", *SHORT)
    a, b = ((tmp_path / name / "flight.csv").read_bytes() for name in "ab")
    assert a == b
    assert a[:2000] != (tmp_path / "c" / "flight.csv").read_bytes()[:2000], "another seed, another flight"
    summaries = []
    for name in "ab":
        summary = json.loads((tmp_path / name / "summary.json").read_text())
        summary["solver"] = {key: value for key, value in summary["solver"].items() if not key.endswith("_ms")}
        summaries.append(summary)
    assert summaries[0] == summaries[1]


def test_an_existing_folder_is_refused_unless_forced(eadp, tmp_path, line_plan):
    folder = tmp_path / "taken"
    assert eadp("simulate", line_plan, "-o", folder).code == 0
    (folder / "flight.csv").write_text("old")
    assert refused(eadp("simulate", line_plan, "-o", folder), f"{folder}:1:1: error:", "--force")
    assert (folder / "flight.csv").read_text() == "old"
    assert eadp("simulate", line_plan, "-o", folder, "--force").code == 0
    assert (folder / "flight.csv").read_text() != "old"
    assert refused(eadp("simulate", line_plan, "--figure", "paper"), "--figure:1:1: error:", "-o DIR")


@pytest.mark.slow
def test_what_is_to_be_expected_is_told_first_and_decisions_are_kept(eadp, tmp_path):
    folder = tmp_path / "joint"
    often = ("--set", "planner.joint.max_interval_s=0")
    answer = eadp("simulate", PLAN, "--scenario", "scenarios/survey.yaml", "-o", folder, *often, *SHORT)
    assert answer.out.splitlines()[1].startswith("forecast   finishes: ")
    assert answer.out.endswith(f"written    {folder}\n")
    told = json.loads((folder / "summary.json").read_text())["energy_forecast"]
    assert f"{told['energy_wh']:.2f} ± {told['energy_std_wh']:.2f} Wh in {told['time_s']:.0f} ±" in answer.out
    assert len((folder / "decisions.jsonl").read_text().splitlines()) > 1
    json_form = eadp("simulate", PLAN, "--scenario", "scenarios/survey.yaml", "--format", "json", *SHORT)
    assert json.loads(json_form.out)["energy_forecast"] == told


def test_the_endurance(eadp, line_plan):
    summary = json.loads(eadp("simulate", PLAN, "--scenario", SCENARIO, "--format", "json", *SHORT).out)
    flown = f"endurance  {summary['endurance_s'] / 60:.1f} min on a full"
    assert flown in eadp("simulate", PLAN, "--scenario", SCENARIO, *SHORT).out
    assert " min on a full battery, as flown\n" in eadp("simulate", line_plan).out


def test_require_reserve_makes_a_flight_below_it_a_no(eadp, line_plan):
    low = ("--set", "reserve_soc=0.9999")
    assert eadp("simulate", line_plan, *low).code == 0
    assert eadp("simulate", line_plan, *low, "--require-reserve").code == 1


@pytest.mark.parametrize("format_", few(["text", "json"], 1))
def test_failed_runs_of_the_solver_are_seen(eadp, format_):
    """The fallback of planner joint completes the flight, too."""
    seldom = "--set", "planner.every_s=20", "--set", "step_s=0.1"
    flight = ("simulate", PLAN, "--scenario", "scenarios/survey.yaml", "--format", format_, *seldom)
    sound = eadp(*flight, "--strict-solver")
    assert (sound.code, sound.err) == (0, "")
    assert "FAILED" not in sound.out
    with broken_osqp(BROKEN["failing"]):
        answer, strict = eadp(*flight), eadp(*flight, "--strict-solver")
    assert (answer.code, strict.code) == (0, 1)
    line = r"(\d+) of \1 decisions by the fallback: OSQP did not solve \((\d+) of \2 runs FAILED\)"
    assert re.fullmatch(f"eadp: warning: {line}\n", answer.err)
    assert bool(re.search(f"^solver     {line}$", answer.out, re.MULTILINE)) == (format_ == "text")


@pytest.mark.parametrize("planner", ["paper", "joint"])
def test_a_missing_osqp_is_bad_input_not_a_bug(eadp, monkeypatch, tmp_path, planner):
    monkeypatch.setitem(sys.modules, "osqp", None)
    answer = eadp("simulate", PLAN, "--scenario", "scenarios/survey.yaml", "--planner", planner, "-o", tmp_path / "out")
    assert refused(answer, "eadp: error: osqp cannot be imported", "pip install osqp")
    assert not (tmp_path / "out").exists()
    assert eadp("simulate", PLAN, "--scenario", "scenarios/survey.yaml", "--planner", "static", *SHORT).code == 1
    assert eadp("simulate", PLAN, *SUBROUTINE, *SHORT).code == 1
    telemetry = ("--telemetry", "scenarios/example-telemetry.jsonl")
    replanned = eadp("replan", PLAN, "--scenario", "scenarios/survey.yaml", "--planner", planner, *telemetry)
    assert refused(replanned, "eadp: error: osqp cannot be imported")


# --- what is refused

BAD_SETS = [
    ("wind.speed_mps=.nan", "not a finite number"),
    ("planner.name=greedy", "unknown planner greedy"),
    ("vehicle.airframe.model=balloon", "unknown vehicle.airframe.model balloon; expected one of fixed-wing, paper"),
    ("vehicle.max_bank_deg=30", "unknown key vehicle.max_bank_deg; expected vehicle.airframe.max_bank_deg"),
    ("vehicle.airframe.aspect_ratio=9", "vehicle.airframe.aspect_ratio is a key of model fixed-wing, not of paper"),
    ("planner.start_after_s=9", "expected planner.paper.start_after_s or planner.joint.start_after_s"),
    ("c1=-2000", "outside its set"),
    ("bounds={c1: [0, 1]}", "carry sets"),
    ("planner.weights={c5: 1}", "no parameter c5"),
    ("=3", "--set:1:1"),
]


@pytest.mark.parametrize(("override", "word"), BAD_SETS)
def test_bad_overrides(eadp, tmp_path, override, word):
    folder = tmp_path / "out"
    answer = eadp("simulate", PLAN, "--scenario", SCENARIO, "--set", override, "-o", folder)
    assert refused(answer, word, "error:")
    assert not folder.exists()


BAD_SCENARIOS = [
    ("wind: {speed_mps: 5}\n", ":1:1: error: has no key schema"),
    ("schema: eadp.scenario/1\nwimd: {}\n", ":2:1: error: unknown key wimd"),
    ("schema: eadp.scenario/1\nwind: [\n", ": error: is not YAML"),
    ("schema: eadp.scenario/1\nguidance: {k_d: -1}\n", ":2:12: error: guidance.k_d is negative: the aircraft turns"),
    ("schema: eadp.scenario/1\nprofile: nosuch.yaml\n", "nosuch.yaml:1:1: error: cannot be read"),
]


@pytest.mark.parametrize(("text", "message"), BAD_SCENARIOS)
def test_bad_scenarios(eadp, tmp_path, text, message):
    scenario = tmp_path / "s.yaml"
    scenario.write_text(text)
    assert refused(eadp("simulate", PLAN, "--scenario", scenario), message)


def test_a_plan_with_computations_needs_a_profile(eadp):
    assert refused(eadp("simulate", PLAN), "survey.plan:", "profile")


def test_a_profile_of_something_else_is_refused(eadp, tmp_path):
    profile = tmp_path / "p.csv"
    profile.write_text("frames,power_w\n2,5\n10,9\n")
    assert refused(eadp("simulate", PLAN, "--profile", profile), "p.csv:1:1: error:", "fps", "frames")
    profile.write_text("fps,power_w\n2,5\n8,9\n")
    assert refused(eadp("simulate", PLAN, "--profile", profile), "stage 1")


@pytest.mark.parametrize(
    ("setting", "limit"),
    [
        ("resistance_ohm=5", "exceeds the 11.0 W"),
        ("max_c_rate=0.5", "the 23.6 W that the battery's current limit"),
        ("cutoff_voltage_v=14.7", "the 29.4 W"),
    ],
)
def test_a_battery_that_cannot_deliver_level_flight_is_refused_with_its_key(eadp, setting, limit):
    pack = ("--set", "battery.capacity_ah=3.2", "--set", "battery.resistance_ohm=0.05")
    answer = eadp("simulate", PLAN, "--scenario", SCENARIO, *pack, "--set", f"battery.{setting}")
    assert refused(answer, f"battery.{setting.split('=')[0]}", "level flight", limit)


UNFLYABLE = [
    ("0.1; 90; x^2+y^2+1\n0, 400\n", "radius"),
    ("0.1; 90; sqrt(x)-1\n-10, 4\n", "stage 1"),
    ("0.1; 90; log(c1)*x\n0, 400\n[-1, 2]\n", "c1 = -1"),
]


@pytest.mark.parametrize(("text", "word"), UNFLYABLE)
def test_a_plan_that_cannot_be_joined_is_refused(eadp, tmp_path, text, word):
    path = tmp_path / "bad.plan"
    path.write_text(text)
    assert refused(eadp("simulate", path), "bad.plan:1:1: error:", word)


def test_a_start_where_the_path_has_no_value_is_refused(eadp, tmp_path):
    path = tmp_path / "root.plan"
    path.write_text("0.1; 90; sqrt(x)-10\n100, 400\n")
    assert refused(eadp("simulate", path, "--set", "start.position_m=[-5, 0]"), "start.position_m", "no value")


def test_a_plan_without_sets_needs_bounds(eadp, tmp_path):
    path = tmp_path / "free.plan"
    path.write_text("0.1; 90; x-c1\nc1, 400\n")
    assert refused(eadp("simulate", path), "free.plan:1:1: error:", "no sets")
    answer = eadp("simulate", path, "--set", "bounds={c1: [-10, 5]}", "--format", "json")
    assert answer.code == 0
    assert json.loads(answer.out)["parameters"]["c1"]["first"] == 5
    assert refused(eadp("simulate", path, "--set", "bounds={c2: [-10, 5]}"), "no bounds for c1")
    assert refused(eadp("simulate", path, "--set", "bounds={c1: [5, -10]}"), "above")


def test_a_vehicle_file_is_flown_and_copied(eadp, line_plan, tmp_path):
    (tmp_path / "aircraft").mkdir()
    (tmp_path / "aircraft" / "s.yaml").write_text("schema: eadp.vehicle/1\nairframe: {airspeed_mps: 20}\n")
    scenario = tmp_path / "s.yaml"
    scenario.write_text("schema: eadp.scenario/1\nvehicle: aircraft/s.yaml\n")
    out = tmp_path / "out"
    assert eadp("simulate", line_plan, "--scenario", scenario, "-o", out).code == 0
    assert json.loads((out / "summary.json").read_text())["duration_s"] == pytest.approx(80 / 20, abs=0.02)
    assert (out / "inputs/scenario/s.yaml").read_text() == scenario.read_text()
    assert "airspeed_mps: 20" in (out / "inputs/vehicle/s.yaml").read_text()


def test_too_little_memory_is_exit_2(eadp, monkeypatch):
    def hungry(*_args, **_options):
        raise MemoryError("Unable to allocate 7.28 TiB")

    monkeypatch.setattr("eadp.cli.simulate.simulate", hungry)
    answer = eadp("simulate", "plans/survey.plan")
    assert (answer.code, answer.err) == (2, "eadp: error: not enough memory: Unable to allocate 7.28 TiB\n")


def test_a_profile_beside_a_plan_without_computations_is_a_constant_load(eadp, line_plan):
    profile = ("--profile", "profiles/pednet-jetson-nano.csv", "--format", "json")
    bare, most = eadp("simulate", line_plan, "--format", "json"), eadp("simulate", line_plan, *profile)
    assert bare.err == ""
    assert "note: the plan has no parameter for it: a constant load of 10.21 W at fps=10, its highest" in most.err
    unladen, laden = (json.loads(answer.out) for answer in (bare, most))
    assert laden["power_w"]["mean"] - unladen["power_w"]["mean"] == pytest.approx(10.21, abs=0.01)
    load_wh = laden["energy_forecast"]["energy_wh"] - unladen["energy_forecast"]["energy_wh"]
    assert load_wh == pytest.approx(10.21 * unladen["energy_forecast"]["time_s"] / 3600, rel=0.01)


def test_the_first_line_names_aircraft_battery_and_wind(eadp, line_plan):
    first = eadp("simulate", line_plan).out.splitlines()[0]
    assert first == (
        "aircraft   fixed-wing of 1.2 kg at 15 m/s (default); battery 14.8 V, 3.2 Ah (default); wind 0 m/s (default)"
    )
    chosen = ("wind.speed_mps=5", "wind.towards_deg=0", "battery.capacity_ah=9", "vehicle.airframe.mass_kg=2")
    first = eadp("simulate", line_plan, *(part for key in chosen for part in ("--set", key))).out.splitlines()[0]
    assert first == "aircraft   fixed-wing of 2 kg at 15 m/s; battery 14.8 V, 9 Ah; wind 5 m/s from 270°"


@pytest.mark.usefixtures("drawn")
def test_a_flight_that_returns_home_has_one_account_in_text_page_picture_and_json(eadp, tmp_path):
    folder = tmp_path / "home"
    keys = ["battery.capacity_ah=0.25", "home.position_m=[0, -1000]", "on_infeasible=home"]
    keys += ["step_s=0.1", "planner.every_s=3"]
    answer = eadp(
        "simulate", PLAN, "--scenario", "scenarios/survey.yaml", "-o", folder,
        *(part for key in keys for part in ("--set", key)),
    )  # fmt: skip
    assert answer.code == 1
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["completed"], summary["reason"]) == (False, "returned home")
    assert summary["reserve_kept"]
    assert summary["soc_final"] >= summary["soc_reserve"]
    assert re.search("reserve of [0-9.]+ % kept$", answer.out, re.MULTILINE)
    page = (folder / "report.html").read_text()
    assert re.search("reserve of [0-9.]+ % kept", page)
    assert Page(page).data["reserve_kept"] is True
    decisions = [json.loads(line) for line in (folder / "decisions.jsonl").read_text().splitlines()]
    last = decisions[-1]
    assert last["reason"].startswith("home: ")
    assert last["time_s"] == summary["turned_back_s"]
    assert f"home       decided at {last['time_s']:.2f} s" in answer.out
    assert f"decided at {last['time_s']:.2f} s" in page
    latest_s = summary["energy_forecast"]["turn_back_s"]
    assert latest_s == pytest.approx(summary["turned_back_s"], rel=0.15)
    assert f"home       latest turn-back to keep the reserve: at {latest_s:.0f} s" in answer.out
    assert f"latest turn-back to keep the reserve: at {latest_s:.0f} s" in page
    assert "turned back home" in (folder / "flight.svg").read_text()
    with (folder / "flight.csv").open() as stream:
        at = next(row for row in csv.DictReader(stream) if float(row["time_s"]) >= last["time_s"])
    assert (float(at["x_m"]), float(at["y_m"])) == pytest.approx(tuple(summary["turned_back_m"]), abs=2)


def test_quiet_leaves_warnings_out(eadp, tmp_path):
    plan = tmp_path / "line.plan"
    plan.write_text(f"%: nosuch 1\n{LINE}")
    quiet = eadp("simulate", plan, "--format", "json", "--quiet")
    assert quiet.err == ""
    assert json.loads(quiet.out)["planner"] == "joint"
    assert refused(eadp("simulate", PLAN, "--set", "seed=-1", "-q"), "seed")
