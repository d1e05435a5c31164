"""What the joint planner keeps to in flights: the reserve's probability, the first decision, its forecasts."""

import itertools

import numpy as np
import pytest
from common.forecasts import survey_inputs
from common.recorder import watched

from eadp.planning.base import CLOSED_FORM, FALLBACK, INFEASIBLE
from eadp.planning.joint.planner import WARM_UP_S
from eadp.planning.joint.policy import SETTLED_S
from eadp.planning.joint.program import OUTDONE
from eadp.simulation.loop import Outcome, fly

ASKED, STATED = 0.95, 0.945
"""Probability of the reserve that is asked for, and the least that a feasible re-planning may state."""
QUALITY = 0.02
GUSTS = {"wind.speed_mps": 6.0, "wind.gust_std_mps": 1.5}
CAPACITIES_AH = (0.34, 0.42, 0.5)


def flown(make=None, **overrides):
    inputs = survey_inputs("joint", **{"log_every_s": 1.0, **overrides})
    outcome = Outcome()
    flight = make(inputs) if make else inputs.flight()
    rows = list(fly(inputs.world, flight, outcome))
    return outcome, rows, flight.planner


@pytest.fixture(scope="module", params=[1, pytest.param(2, marks=pytest.mark.slow)])
def gusty(request):
    """Flights in gusts from several sides, with a loss in some."""
    flights = []
    for seed, capacity_ah in itertools.product(range(request.param), CAPACITIES_AH):
        faults = [{"at_s": 120, "soc_drop": 0.06}] if seed % 2 else []
        keys = {"seed": seed, "wind.from_deg": 90.0 * seed, "battery.capacity_ah": capacity_ah, "faults": faults}
        flights.append(flown(**GUSTS, **keys))
    return flights


def test_every_feasible_re_planning_states_the_probability_that_is_asked_for(gusty):
    records = [record for outcome, *_ in gusty for record in outcome.records if record.status != INFEASIBLE]
    assert len(records) > 12 * len(gusty) / len(CAPACITIES_AH)
    assert min(record.ending.reserve_probability for record in records) >= STATED


def test_what_it_forecasts_to_see_it_has_seen_in_the_end(gusty):
    for outcome in [outcome for outcome, *_ in gusty if outcome.completed]:
        last = outcome.records[-1]
        assert last.ending.quality_forecast == pytest.approx(outcome.parameters.quality({}), abs=QUALITY)


@pytest.mark.slow
def test_the_first_decision_searches_the_path(gusty):
    for outcome, _, planner in gusty:
        first = outcome.records[0]
        assert first.time_s == pytest.approx(WARM_UP_S, abs=1.1)
        assert first.calls > 0 or first.status == INFEASIBLE
        assert planner.report.replans <= len(outcome.records)
    outcome, *_ = flown(**{"battery.capacity_ah": 0.5, "parameters.c1": -1000.0, "parameters.c2": 2.0})
    assert outcome.records[0].parameters[0] > -1000.0, "a path with charge to spare is changed at once"
    assert outcome.records[0].parameters[1] > 2.0


def test_osqp_decides_and_certifies_itself(gusty):
    for outcome, _, planner in gusty:
        report = planner.report
        assert report.calls == report.solved + report.failed == sum(record.calls for record in outcome.records)
        assert not any(record.status == FALLBACK for record in outcome.records)
        for record in outcome.records:
            # where the closed form is better by more, it is flown
            assert record.gap is None or (record.gap > OUTDONE) == (record.status == CLOSED_FORM)
    gaps = [gap for _, _, planner in gusty for gap in planner.report.gaps]
    assert sum(gap > OUTDONE for gap in gaps) < 0.01 * len(gaps)


def test_computations_do_not_rise_soon_after_they_fell(gusty):
    for outcome, *_ in gusty:
        fell_s = -np.inf
        for before, after in itertools.pairwise(outcome.records):
            if after.parameters[1] > before.parameters[1]:
                assert after.time_s - fell_s >= SETTLED_S
            elif after.parameters[1] < before.parameters[1]:
                fell_s = after.time_s


@pytest.mark.slow
def test_it_is_a_pure_function_of_its_readings():
    """The same flight twice, and with a planner that is shown every step: rows and decisions are the same."""
    keys = {"battery.capacity_ah": 0.42, "time_limit_s": 200, **GUSTS}
    once, again = (flown(**keys)[0] for _ in range(2))
    first, second = ([record._replace(time_s=0) for record in each.records] for each in (once, again))
    assert first == second
    other, *_ = flown(watched, **keys)
    assert [record.parameters for record in other.records] == [record.parameters for record in once.records]
