"""What a pilot reads has no word of the inside: the table of docs/nomenclature.md, held against what commands print."""

import json
import re

import pytest
from common import ROOT
from common.pages import Page

from eadp.cli.main import main
from eadp.planning.base import SHORT

FAST = "--set", "step_s=0.1", "--set", "planner.every_s=10"
SMALL = "--set", "battery={cells: 4, capacity_ah: 0.3}"
ROW = re.compile(r"^\| (?P<inside>[^|]+) \| (?P<read>[^|]+) \|$", re.MULTILINE)


def table():
    page = (ROOT / "docs/nomenclature.md").read_text(encoding="utf-8").partition("## A pilot's words\n")[2]
    rows = {match["inside"]: match["read"] for match in ROW.finditer(page)}
    del rows["inside"]
    return rows


WORDS = [word for inside in table() for word in inside.split(", ")]


def inside_words(text):
    """The words of the inside in a text."""
    return [word for word in WORDS if re.search(rf"(?<![\w./-]){re.escape(word)}(?![\w./-])", text)]


def test_the_table_finds_what_it_names():
    assert len(WORDS) > 15
    for word in WORDS:
        assert inside_words(f"a line, {word} = 3") == [word]
    assert inside_words("UAV, Udine, c10, c1.csv, infeasibly") == []


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """A folder of `eadp init`, and a plan with computations."""
    folder = tmp_path_factory.mktemp("started")
    assert main(["init", str(folder), "--preset", "foam-wing"]) == 0
    profile = str(ROOT / "profiles/pednet-jetson-nano.yaml")
    words = "--swath", "80", "--pattern", "zamboni", "--profile", profile, "-o", str(folder / "computing.plan")
    field, scenario = str(folder / "field.geojson"), str(folder / "scenario.yaml")
    assert main(["cover", field, "--scenario", scenario, *words]) == 0
    return folder


def test_what_flights_print(eadp, started):
    flown = "simulate", started / "computing.plan", "--scenario", started / "scenario.yaml", *FAST
    profile, home = ("--profile", "profiles/pednet-jetson-nano.yaml"), "home={position_m: [0, 0]}"
    returning = "--set", "on_infeasible=home", "--set", home, "-o", started / "flown"
    answer = eadp(*flown, *profile, *SMALL, *returning)
    assert answer.code == 1
    assert inside_words(answer.out + answer.err) == []
    page = (started / "flown" / "report.html").read_text(encoding="utf-8")
    assert inside_words(" ".join(Page(page).data["words"])) == []
    rows = (started / "flown" / "decisions.jsonl").read_text().splitlines()
    reasons = " ".join(json.loads(row)["reason"] for row in rows)
    assert SHORT in reasons
    assert inside_words(reasons) == []


@pytest.mark.slow
def test_what_the_planner_in_flight_says(eadp):
    given = "--scenario", "scenarios/survey.yaml", "--telemetry", "scenarios/example-telemetry.jsonl"
    seldom = "--set", "battery.capacity_ah=0.1", "--set", "planner.every_s=10"
    answer = eadp("replan", "plans/survey.plan", *given, *seldom)
    said = [json.loads(line) for line in answer.out.splitlines()]
    reasons = " ".join(f"{line['reason']} {line['warnings']}" for line in said)
    assert SHORT in reasons
    assert inside_words(reasons + answer.err) == []


def test_what_other_commands_print(eadp, started):
    vehicle, field = started / "foam-wing.yaml", started / "field.geojson"
    lines = "--vehicle", vehicle, "--swath", "100"
    commands = [
        ("vehicle", vehicle),
        ("cover", field, *lines, "--pattern", "dubins"),
        ("cover", field, *lines, "--sorties", "2", "--home", "55.4730,10.3342", "-o", started / "sorties"),
        ("simulate", started / "sorties", *FAST),
        ("plan", "plans/valley.waypoints"),
        ("simulate", "plans/valley.waypoints", *FAST, *SMALL),
        ("export", started / "computing.plan", "--to", "qgc", "-o", started / "out.plan"),
    ]
    for command in commands:
        answer = eadp(*command)
        assert answer.code in (0, 1), command
        assert inside_words(answer.out + answer.err) == [], command
