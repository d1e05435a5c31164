"""Flights whose pages are tested."""

import pytest
from common import ROOT

import eadp

PLAN, SCENARIO = str(ROOT / "plans/survey.plan"), str(ROOT / "scenarios/survey.yaml")


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """The result folder of the survey with the planner joint: it completes, and c1 changes."""
    target = tmp_path_factory.mktemp("pages") / "survey"
    eadp.simulate(PLAN, SCENARIO, overrides={"step_s": 0.05}).write(target)
    return target
