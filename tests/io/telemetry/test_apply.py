"""A command that applies computations: run with the values decided, its end kept, its failure said."""

from __future__ import annotations

import itertools
import json
import sys
from pathlib import Path

import pytest

PLAN, SCENARIO, EXAMPLE = "plans/survey.plan", "scenarios/survey.yaml", "scenarios/example-telemetry.jsonl"
RECORD = "import pathlib, sys; p = pathlib.Path(sys.argv[1]); p.open('a').write(' '.join(sys.argv[2:]) + chr(10))"


def applied(log: Path) -> list[dict]:
    return [line for line in map(json.loads, log.read_text().splitlines()) if line["kind"] == "applied"]


@pytest.fixture
def command(tmp_path):
    script = tmp_path / "apply it.py"
    script.write_text(RECORD)
    return f'{sys.executable} "{script}" {tmp_path / "applied.txt"}', tmp_path / "applied.txt"


def test_it_runs_with_the_values_decided_and_only_where_they_change(eadp, tmp_path, command):
    text, out = command
    log, given = tmp_path / "flight.jsonl", ("replan", PLAN, "--scenario", SCENARIO, "--telemetry", EXAMPLE)
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
