"""Flights with an OSQP that fails, returns its start or nonsense: visible in the summary, as safe as the fallback."""

import pytest
from broken_osqp import BROKEN, BUG, broken_osqp
from common import ROOT, few

import eadp

SCENARIOS = {
    "paper": ("paper-drained", {"time_limit_s": 150}),
    "joint": ("survey", {"time_limit_s": 150, "battery.capacity_ah": 0.62}),
}


def flown(planner):
    scenario, overrides = SCENARIOS[planner]
    return eadp.simulate(
        ROOT / "plans/survey.plan", scenario=ROOT / f"scenarios/{scenario}.yaml", planner=planner, overrides=overrides
    )


@pytest.fixture(scope="module", params=["paper", "joint"])
def sound(request):
    return request.param, flown(request.param)


@pytest.mark.parametrize("planner", SCENARIOS)
def test_a_bug_ends_the_flight(planner):
    with broken_osqp(BUG), pytest.raises(AttributeError, match="no such thing"):
        flown(planner)


def test_every_replanning_of_a_sound_solver_is_accounted_for(sound):
    _, flight = sound
    solver, statuses = flight.summary["solver"], [record.status for record in flight.decisions]
    assert (
        solver["calls"] == solver["solved"] + solver["failed"] == sum(record.calls for record in flight.decisions) > 0
    )
    assert solver["failed"] == solver["retried"] == solver["fallbacks"] == solver["closed_form_better"] == 0
    assert solver["by_status"] == {"solved": solver["calls"]}
    assert solver["skipped"] == statuses.count("kept")
    assert flight.summary["replans"] == sum(record.calls > 0 for record in flight.decisions)
    solved = [record for record in flight.decisions if record.status == "solved"]
    assert solved
    assert all(record.iterations > 0 and record.gap is not None for record in solved)


@pytest.mark.quick(2)
@pytest.mark.parametrize("broken", few(BROKEN, 2))
def test_a_broken_solver_shows_and_the_fallback_flies(sound, broken):
    planner, good = sound
    with broken_osqp(BROKEN[broken]):
        flight = flown(planner)
    solver, statuses = flight.summary["solver"], [record.status for record in flight.decisions]
    assert solver["calls"] == solver["failed"] == 2 * solver["retried"] > 0
    assert solver["solved"] == solver["skipped"] == 0
    assert solver["fallbacks"] == statuses.count("fallback") == flight.summary["replans"]
    assert solver["gap_max"] is None
    assert "solved" not in solver["by_status"]
    assert all(("fallback, " in record.reason) == (record.status == "fallback") for record in flight.decisions)
    assert flight.summary["soc_final"] > 0
    if planner == "paper":  # δ lowers the whole horizon alike
        assert [record.parameters for record in flight.decisions] != [record.parameters for record in good.decisions]
