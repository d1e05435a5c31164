"""Draft 003 lets the period differ by the stage j at which it is measured: how much it does."""

import itertools

import numpy as np
import pytest
from common import ROOT

import eadp


@pytest.mark.slow
@pytest.mark.parametrize(("gusts", "seed"), [(0.0, 0), (1.0, 1)])
def test_the_period_is_one_whatever_the_stage_it_is_measured_at(gusts, seed):
    keys = {"planner.name": "static", "battery.capacity_ah": 3, "faults": [], "wind.gust_std_mps": gusts, "seed": seed}
    keys["step_s"] = 0.05
    flight = eadp.simulate(ROOT / "plans/survey.plan", scenario=ROOT / "scenarios/survey.yaml", overrides=keys)
    starts_s = {stage: [] for stage in range(1, 5)}
    for before, step in itertools.pairwise(flight.steps):
        if step.stage != before.stage:
            starts_s[step.stage].append(step.time_s)
    laps = min(map(len, starts_s.values())) - 2
    # the first lap begins anywhere; rows are stages
    periods_s = np.array([np.diff(times)[1 : laps + 1] for times in starts_s.values()])
    assert laps >= 8
    # at one lap the stages differ less than one lap from the next
    assert periods_s.std(axis=0).mean() < periods_s.std(axis=1).mean()
    assert np.ptp(periods_s.mean(axis=1)) < 0.01 * periods_s.mean()
