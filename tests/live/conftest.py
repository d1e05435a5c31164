"""What most tests of a link fly."""

import pytest
from common.plans import placed_survey

from eadp.api.inputs import load_flight


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    """The survey, with a place on the earth."""
    return placed_survey(tmp_path_factory.mktemp("plan"))


@pytest.fixture(scope="module")
def inputs(plan):
    """The survey's flight with its scenario."""
    return load_flight(str(plan), scenario="scenarios/survey.yaml")
