"""A command that applies computations: run with the values decided, its end kept, its failure said."""

from __future__ import annotations

import itertools
import json
import shutil
import sys
from pathlib import Path

import pytest
from common import ROOT

from eadp.api.inputs import load_flight
from eadp.live.replanner import ValuesFile

PLAN, SCENARIO, EXAMPLE = "plans/survey.plan", "scenarios/survey.yaml", "scenarios/example-telemetry.jsonl"
LINES = 60
RECORD = "import pathlib, sys; p = pathlib.Path(sys.argv[1]); p.open('a').write(' '.join(sys.argv[2:]) + chr(10))"


def applied(log: Path) -> list[dict]:
    return [line for line in map(json.loads, log.read_text().splitlines()) if line["kind"] == "applied"]


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """The beginning of the example's telemetry: the rate of the computations is the same to its end."""
    path = tmp_path_factory.mktemp("begun") / "telemetry.jsonl"
    path.write_text("".join((ROOT / EXAMPLE).read_text().splitlines(keepends=True)[:LINES]))
    return path


@pytest.fixture
def command(tmp_path):
    script = tmp_path / "apply it.py"
    script.write_text(RECORD)
    return f'{sys.executable} "{script}" {tmp_path / "applied.txt"}', tmp_path / "applied.txt"


def test_it_runs_with_the_values_decided_and_only_where_they_change(eadp, tmp_path, begun, command):
    text, out = command
    log, given = tmp_path / "flight.jsonl", ("replan", PLAN, "--scenario", SCENARIO, "--telemetry", begun)
    answer = eadp(*given, "--log", log, "--apply", text)
    decided = [json.loads(line)["parameters"]["c2"] for line in answer.out.splitlines()]
    values = [float(line.removeprefix("fps=")) for line in out.read_text().splitlines()]
    assert values[0] == decided[0]
    assert set(values) <= set(decided)
    assert all(one != other for one, other in itertools.pairwise(values))
    assert values[-1] == decided[-1]
    assert [run["exit_code"] for run in applied(log)] == [0] * len(values)
    assert [run["parameters"] for run in applied(log)] == [{"fps": value} for value in values]
    # the log with these lines is resumed, reported and replayed
    assert eadp(*given, "--log", log).out == ""
    assert eadp("report", log, "-o", tmp_path / "page.html").code == 0
    assert eadp("replan", PLAN, "--scenario", SCENARIO, "--replay", log).out == answer.out


@pytest.mark.parametrize(
    ("command", "message"),
    [("nosuch-command", "No such file"), (f"{sys.executable} -c raise-SystemExit(3)", "exit code 1")],
)
def test_a_failure_is_said_and_kept(eadp, tmp_path, command, message):
    log = tmp_path / "flight.jsonl"
    first = Path(EXAMPLE).read_text().splitlines(keepends=True)[:3]
    (tmp_path / "first.jsonl").write_text("".join(first))
    given = ("--scenario", SCENARIO, "--telemetry", tmp_path / "first.jsonl", "--log", log, "--apply", command)
    answer = eadp("replan", PLAN, *given)
    assert answer.code in (0, 1)  # as the forecast is
    assert "did not apply fps 10" in answer.err
    assert message in answer.err
    assert applied(log)[0]["exit_code"] != 0


@pytest.mark.parametrize("command", ["", "'"])
def test_no_command_is_refused(eadp, command):
    answer = eadp("replan", PLAN, "--scenario", SCENARIO, "--telemetry", EXAMPLE, "--apply", command)
    assert answer.code == 2
    assert "--apply:1:1: error: is no command" in answer.err


# --- a file with the values


def test_the_file_holds_the_values_last_decided(eadp, begun, tmp_path):
    file = tmp_path / "rates.json"
    answer = eadp("replan", PLAN, "--scenario", SCENARIO, "--telemetry", begun, "--publish", file)
    lines = [json.loads(line) for line in answer.out.splitlines()]
    changed = [one for other, one in itertools.pairwise([{}, *lines]) if one["parameters"]["c2"] != _fps(other)]
    found = json.loads(file.read_text())
    assert found == {"time_s": changed[-1]["time_s"], "parameters": {"fps": lines[-1]["parameters"]["c2"]}}
    assert [each.name for each in tmp_path.iterdir()] == ["rates.json"]


def _fps(decision):
    return decision.get("parameters", {}).get("c2")


def test_it_is_written_where_values_change_and_a_failure_is_said_once(tmp_path):
    plan = load_flight(PLAN, scenario=SCENARIO).mission.plan
    (tmp_path / "there").mkdir()
    said, file = [], tmp_path / "there" / "rates.json"
    door = ValuesFile(str(file), plan.parameters[plan.path_count :], said.append)
    decision = {"time_s": 1.0, "parameters": {"c1": 0.0, "c2": 7.0}}
    door.decided(decision)
    door.decided({**decision, "time_s": 2.0})
    assert json.loads(file.read_text()) == {"time_s": 1.0, "parameters": {"fps": 7.0}}
    shutil.rmtree(tmp_path / "there")
    for time_s in (3.0, 4.0):
        door.decided({"time_s": time_s, "parameters": {"c1": 0.0, "c2": 2.0}})
    assert len(said) == 1
    assert "cannot be written" in said[0]
    (tmp_path / "there").mkdir()
    door.decided({"time_s": 5.0, "parameters": {"c1": 0.0, "c2": 2.0}})
    assert json.loads(file.read_text())["time_s"] == 5.0


@pytest.mark.parametrize("path", ["", "plans", "/dev/null"])
def test_a_path_that_is_no_file_is_refused(eadp, path):
    answer = eadp("replan", PLAN, "--scenario", SCENARIO, "--telemetry", EXAMPLE, "--publish", path)
    assert (answer.code, answer.out) == (2, "")
    assert "cannot be written" in answer.err
