"""Documents that commands print, beside the schemas that `eadp schema` has of them."""

from __future__ import annotations

import json

import pytest
from jsonschema import Draft202012Validator

PROFILE, PLAN = "profiles/pednet-letter.yaml", "plans/survey.plan"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("performance", "vehicle vehicles/mapper.yaml --format json"),
        ("power", f"profile {PROFILE} --at fps=5 --format json"),
        ("faults", f"simulate {PLAN} --planner nosuch --faults json"),
        ("energy", "fit scenarios/example-power-log.csv --format json"),
    ],
)
def test_a_document_is_as_its_schema(eadp, name, words):
    schema = json.loads(eadp("schema", name).out)
    answer = eadp(*words.split())
    Draft202012Validator.check_schema(schema)
    Draft202012Validator(schema).validate(json.loads(answer.out or answer.err))


def test_what_fit_prints_is_flown_by(eadp, tmp_path):
    file = tmp_path / "model.json"
    file.write_text(eadp("fit", "scenarios/example-power-log.csv", "--format", "json").out)
    answer = eadp("simulate", PLAN, "--profile", PROFILE, "--energy", file, "--set", "time_limit_s=1")
    assert answer.code == 1
    assert "error" not in answer.err


def test_an_unknown_planner_is_refused_by_its_option(eadp):
    for command in ("simulate", "replan"):
        answer = eadp(command, PLAN, "--profile", PROFILE, "--planner", "jointt")
        assert answer.code == 2
        assert answer.err.startswith(
            "--planner:1:1: error: unknown planner jointt; expected one of static, paper, joint"
        )
        assert "did you mean joint?" in answer.err
