"""Parameters by the names that people give them: read at every door, and shown at every other."""

import csv
import json
import math

import pytest
from common import ROOT
from common.answers import refused

from eadp.io.plan.reader import read_plan
from eadp.io.plan.writer import plan_text
from eadp.io.text.streams import Text, read_text

PLAN, SCENARIO = "plans/survey.plan", "scenarios/survey.yaml"
GIVEN = (PLAN, "--scenario", SCENARIO, "--set", "step_s=0.05", "--set", "time_limit_s=20")
LINE = "1; 90; x - c1\n0, 100\n[-10, 0]\n[2, 10]\n"


def spacing_of(c1):
    return 150 - 2 * math.sqrt(4900 + c1)


def c1_of(spacing_m):
    return (75 - spacing_m / 2) ** 2 - 4900


def plan_of(header):
    return read_plan(Text("a.plan", f"%: {header}\n{LINE}"))


def test_a_header_names_the_path_parameters():
    plan, findings = plan_of("paths offset [cm] = 100*(c1 + 3)")
    assert not findings
    item = plan.parameters[0]
    assert (item.name, item.label, item.unit, plan.parameters[1].label) == ("c1", "offset", "cm", "c2")
    assert item.shown(-4.0) == -100
    assert item.text(-4.0) == "-100 cm"
    assert read_plan(Text("b.plan", plan_text(plan)))[0].parameters == plan.parameters
    assert plan_of("paths offset")[0].parameters[0].text(-4.25) == "-4.25"


@pytest.mark.parametrize(
    ("header", "column", "words"),
    [
        ("paths x", 10, "a path parameter without a name of its own"),
        ("paths a, b", 10, "2 names for 1 path parameters"),
        ("paths a = 3", 14, "a is no expression in c1 alone"),
        ("paths a = (c1 + 5)^2", 14, "a neither rises nor falls over all of the set of c1"),
    ],
)
def test_a_header_that_names_nothing_is_refused(tmp_path, eadp, header, column, words):
    path = tmp_path / "a.plan"
    path.write_text(f"%: {header}\n{LINE}")
    assert refused(eadp("plan", path), f"a.plan:1:{column}: error", words)


def test_what_is_shown_is_the_inverse_of_what_is_given():
    plan, _ = read_plan(read_text(str(ROOT / PLAN)))
    box, item = plan.hull(0), plan.parameters[0]
    for spacing in (10.0, 12.345, 20.0, spacing_of(-1000.0)):
        c1 = item.of_shown(spacing, box)
        assert c1 == pytest.approx(c1_of(spacing), abs=1e-6)
        assert box.clip(c1) == c1
    for end in (box.lo, box.hi):  # as printed, with four digits, too
        assert item.of_shown(float(item.text(end).split()[0]), box) == end
    for beyond in (9.9, 25.2, -3.0, 1e6):
        c1 = item.of_shown(beyond, box)
        assert box.clip(c1) != c1


@pytest.mark.parametrize("key", ["spacing", "parameters.spacing"])
def test_a_flight_starts_with_what_is_set(eadp, key):
    answer = eadp("simulate", *GIVEN, "--planner", "static", "--set", f"{key}=20", "--set", "fps=4", "--format", "json")
    flown = json.loads(answer.out)["parameters"]
    assert flown["c1"]["first"] == pytest.approx(c1_of(20), abs=1e-6)
    assert flown["c1"]["shown"]["first"] == pytest.approx(20)
    assert (flown["c1"]["title"], flown["c1"]["unit"], flown["c2"]["title"]) == ("spacing", "m", "fps")
    assert flown["c2"]["first"] == 4
    text = eadp("simulate", *GIVEN, "--planner", "static", "--set", "spacing=20", "--set", "fps=4").out
    assert "\nspacing    20 m, no change\nfps        4, no change\n" in text


def test_settings_name_parameters_as_people_do(eadp, tmp_path):
    """A scenario with titles flies as one with c-numbers, to the last bit, and says what it decided in titles."""
    text = (ROOT / SCENARIO).read_text().replace("../profiles", str(ROOT / "profiles"))
    outs, seldom = [], ("--set", "step_s=0.1", "--set", "planner.every_s=10", "--set", "time_limit_s=150")
    for fps, path in (("fps", "spacing"), ("c2", "c1")):
        scenario = tmp_path / f"{fps}.yaml"
        scenario.write_text(
            f"{text}planner:\n  weights: {{{fps}: 0.2, {path}: 1}}\n  levels: {{{fps}: [2, 5, 10]}}\n"
            f"  joint: {{trade_offs: [{{coefficients: {{{fps}: 1}}, at_least: 3}}]}}\n"
        )
        answer = eadp("simulate", PLAN, "--scenario", scenario, *seldom, "-o", tmp_path / fps)
        assert answer.code in (0, 1), answer.err
        outs.append([(tmp_path / fps / name).read_text() for name in ("flight.csv", "decisions.jsonl")])
    assert outs[0] == outs[1]
    changed = [json.loads(line)["reason"] for line in outs[0][1].splitlines() if "→" in line]
    assert any("spacing 10 m → " in reason for reason in changed)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            "spacing=30",
            "--set parameters.spacing:1:1: error: spacing = 30 is outside its set; expected a value in [10, 25.1",
        ),
        ("spacin=20", "unknown key spacin: the plan has no parameter spacin either; expected one of spacing, fps"),
        ("planner.weights.fsp=2", "the plan has no parameter fsp; expected one of spacing, fps; did you mean fps?"),
        ("planner.paper.gains.spacing=3", "spacing stands for a value of c1, which is not known here; expected c1"),
    ],
)
def test_what_is_no_name_is_refused_with_what_it_looks_like(eadp, given, words):
    assert refused(eadp("simulate", *GIVEN, "--set", given), words)


def test_a_parameter_by_both_names_is_refused(eadp, tmp_path):
    scenario = tmp_path / "s.yaml"
    scenario.write_text("schema: eadp.scenario/1\nparameters: {c2: 5, fps: 5}\n")
    answer = eadp("simulate", PLAN, "--scenario", scenario, "--profile", "profiles/pednet-jetson-nano.yaml")
    assert refused(answer, "s.yaml:2:21: error: fps is c2, which stands there too")


def test_the_profile_names_computations_that_the_plan_does_not(eadp, tmp_path):
    plan = tmp_path / "a.plan"
    plan.write_text((ROOT / PLAN).read_text().replace("%: computations fps\n", ""))
    answer = eadp("simulate", plan, *GIVEN[1:], "--set", "fps=5", "--planner", "static")
    assert "\nfps        5, no change\n" in answer.out


def test_export_and_plan_take_names(eadp):
    place = ("--to", "geojson", "--origin", "55.37,10.43")
    named = eadp("export", PLAN, *place, "--set", "spacing=20")
    assert named.code == 0
    assert named.out == eadp("export", PLAN, *place, "--set", f"c1={c1_of(20)!r}").out
    assert refused(eadp("export", PLAN, *place, "--set", "spacing=26"), "a value in [10, 25.10")
    assert refused(eadp("plan", PLAN, "--trace", "50", "--set", "spacin=20"), "did you mean spacing?")
    assert "c1         path spacing [m] = 150 - 2*sqrt(4900 + c1), from 10 to 25.1\n" in eadp("plan", PLAN).out


def test_a_sweep_varies_names(eadp, tmp_path):
    path = tmp_path / "sweep.yaml"
    fixed = "step_s: [0.1]\n  time_limit_s: [5]\n  planner: [static]"
    names = f"schema: eadp.sweep/1\nplan: {ROOT / PLAN}\nscenario: {ROOT / SCENARIO}\ngrid:\n  {fixed}\n  "
    path.write_text(f"{names}spacing: [10, 20]\n  fps: [2, 10]\n")
    answer = eadp("sweep", path, "--jobs", "1", "--format", "csv")
    assert [(row["spacing"], row["fps"]) for row in csv.DictReader(answer.out.splitlines())] == [
        (a, b) for a in ("10", "20") for b in ("2", "10")
    ]
    path.write_text(f"{names}spacin: [10, 20]\n")
    assert refused(eadp("sweep", path), "sweep.yaml:8:3: error: unknown key spacin", "did you mean spacing?")


def test_telemetry_takes_names(eadp, tmp_path):
    lines = [json.loads(line) for line in (ROOT / "scenarios/example-telemetry.jsonl").read_text().splitlines()[:40]]
    answers = []
    for title in (True, False):
        path = tmp_path / f"{title}.jsonl"
        for line in lines:
            c1, c2 = line["parameters"].values()
            line["parameters"] = (
                {"spacing": spacing_of(c1), "fps": c2} if title else {"c1": c1_of(spacing_of(c1)), "c2": c2}
            )
        path.write_text("".join(json.dumps(line) + "\n" for line in lines))
        for line in lines:
            values = line["parameters"]
            line["parameters"] = {"c1": c1_of(values["spacing"]), "c2": values["fps"]} if title else values
        answers.append(eadp("replan", PLAN, "--scenario", SCENARIO, "--telemetry", path))
    assert answers[0].code == answers[1].code
    assert answers[0].err == answers[1].err
    first, second = ([json.loads(line) for line in answer.out.splitlines()] for answer in answers)
    assert [row["reason"] for row in first] == [row["reason"] for row in second]
    assert len(first) > 25
