"""The papers' settings in flights: trade-offs in every row, costs, gains and the subroutine; what contradicts them."""

import pytest
from common import ROOT

import eadp
from eadp.errors import InputError

DRAINED = {"battery.capacity_ah": 0.7, "faults": [{"at_s": 150, "soc_drop": 0.15}], "planner.paper.min_periods": 1}


def flown(**overrides):
    return eadp.simulate(
        ROOT / "plans/survey.plan", scenario=ROOT / "scenarios/survey.yaml", planner="paper", overrides=overrides
    )


@pytest.mark.slow
@pytest.mark.parametrize(("r1", "r2", "least"), [(1 / 200, -1.0, -10.0), (1 / 250, 1.0, 3.0)])
def test_every_row_of_a_flight_keeps_to_the_trade_offs(r1, r2, least):
    row = {"coefficients": {"c1": r1, "c2": r2}, "at_least": least}
    flight = flown(**DRAINED, **{"parameters.c1": -400, "parameters.c2": 8, "planner.paper.trade_offs": [row]})
    assert flight.summary["completed"]
    assert flight.summary["parameters"]["c2"]["changes"] > 0
    # a re-planning counts once, also where its computations were solved for two paths
    solver, records = flight.summary["solver"], flight.decisions
    assert solver["skipped"] == sum(record.status == "kept" and not record.calls for record in records)
    assert flight.summary["replans"] == sum(record.calls > 0 for record in records)
    values = [r1 * step.parameters[0] + r2 * step.parameters[1] for step in flight.steps]
    assert min(values) >= least - 1e-9


def test_the_papers_costs_gains_and_subroutine_fly():
    size = 7
    q = [[2.0 if i == j else 0.1 for j in range(size)] for i in range(size)]
    flight = flown(
        **DRAINED,
        **{
            "planner.paper.cost": "quadratic",
            "planner.paper.cost_weights": [q, [[1.0, 0.2], [0.2, 1.0]]],
            "planner.paper.terminal_weight": 2.0,
            "planner.paper.gains": {"c1": 0.001},
            "planner.paper.path_rule": "subroutine",
        },
    )
    solver = flight.summary["solver"]
    assert flight.summary["completed"]
    assert solver["solved"] == solver["calls"] > 0
    assert solver["fallbacks"] == 0
    assert flight.summary["parameters"]["c1"]["changes"] > 0


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("cost_weights", [[[1, 2], [0, 1]], 1], "Q is no 7 × 7 matrix"),
        ("cost_weights", [1, [[1, 2], [2, 1]]], "R has the eigenvalue -1, below 0"),
        ("cost_weights", [1, [[1, 0.2], [0.5, 1]]], "R is not symmetric"),
        ("cost_weights", [-1, 1], "greater than or equal to 0"),
        ("terminal_weight", -1, "greater than or equal to 0"),
        ("gains", {"c9": 1}, "the plan has no parameter c9"),
        ("trade_offs", [{"coefficients": {"c2": 1}, "at_least": 11}], "R c is at most 10, and r is 11"),
        ("trade_offs", [{"coefficients": {"c1": -1, "c2": 1}, "at_least": 1011}], "R c is at most 1010, and r is 1011"),
        ("horizon_s", 1e6, "less than or equal to 100000"),
        ("horizon_s", 1000, "more than 400 steps of 1 s in 1000 s"),
    ],
)
def test_settings_that_contradict_the_mission_are_named(key, value, message):
    with pytest.raises(InputError, match=message):
        flown(**{f"planner.paper.{key}": value, "time_limit_s": 1})


def test_a_trade_off_of_a_stage_that_the_plan_has_not():
    row = {"coefficients": {"c2": 1.0}, "at_least": 3.0, "stages": [2, 9]}
    with pytest.raises(InputError, match="the plan has no stage 9"):
        flown(**{"planner.paper.trade_offs": [row]})
