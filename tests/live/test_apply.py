"""A file with computations as decided, for the process to watch."""

import itertools
import json
import shutil

import pytest
from common import ROOT
from common.answers import refused

from eadp.api.inputs import load_flight
from eadp.live.replanner import ValuesFile

PLAN, SCENARIO, EXAMPLE = "plans/survey.plan", "scenarios/survey.yaml", "scenarios/example-telemetry.jsonl"
LINES = 60


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """The beginning of the example's telemetry: the rate of the computations is the same to its end."""
    path = tmp_path_factory.mktemp("begun") / "telemetry.jsonl"
    path.write_text("".join((ROOT / EXAMPLE).read_text().splitlines(keepends=True)[:LINES]))
    return path


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
    assert refused(answer, "cannot be written")
