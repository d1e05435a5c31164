"""The program of the computations: OSQP's answer against linear programs, and what fails is counted."""

import numpy as np
import pytest
from common import few
from common.knapsacks import by_linear_program
from common.knapsacks import knapsack_of as random_knapsack

from eadp.planning.base import CLOSED_FORM, INFEASIBLE, NOTHING_TO_CHOOSE, SOLVED, SolverReport
from eadp.planning.forecast.knapsack import FULL, Knapsack, fill_greedy
from eadp.planning.joint import program as module
from eadp.planning.joint.program import ComputationProgram

ROUNDING = 1e-12


def knapsack_of(seed, share):
    """One place at random with a share of the charge that all its increments take."""
    return random_knapsack(np.random.default_rng(seed), 1, share=share)


def checked(knapsack, solution):
    """The answer is what it says: within its boxes and its charge, at its value."""
    x = solution.filling.shares
    assert ((x >= 0) & (x <= 1)).all()
    assert solution.filling.use[0] <= knapsack.available[0] + 2 * FULL
    assert solution.filling.use[0] == pytest.approx(knapsack.base_use[0] + (knapsack.use * x).sum(), abs=ROUNDING)
    assert solution.value == pytest.approx(knapsack.base_value[0] + (knapsack.gain * x).sum(), abs=ROUNDING)


@pytest.mark.parametrize("seed", few(range(8), 3))
def test_osqp_answers_the_linear_program(seed):
    knapsack, report = knapsack_of(seed, 0.05 + seed / 8), SolverReport()
    solution = ComputationProgram(report).solve(knapsack)
    checked(knapsack, solution)
    assert solution.value == pytest.approx(by_linear_program(knapsack), abs=module.OUTDONE)
    assert solution.status == SOLVED
    assert solution.gap == report.gaps[-1] <= module.OUTDONE
    assert report.fallbacks == 0
    assert report.solved == report.calls - report.failed > 0


def test_one_program_solves_missions_of_any_length():
    """As a flight goes on its program shrinks; OSQP is set up for a size, and the answers are those of a new one."""
    program = ComputationProgram(SolverReport())
    whole = knapsack_of(3, 0.5)
    for first in range(0, len(whole.use), 3):
        use, gain = whole.use[first:], whole.gain[first:]
        available = whole.base_use + 0.4 * use.sum()
        rest = Knapsack(use, gain, whole.place[first:], whole.base_use, whole.base_value, available)
        solution = program.solve(rest)
        checked(rest, solution)
        assert solution.value == pytest.approx(by_linear_program(rest), abs=module.OUTDONE)


def test_ties_are_mixed_within_the_charge():
    """Increments that gain alike for their charge: as much is taken as fits."""
    use = np.array([[0.2], [0.3], [0.4]])
    for spare in (0.1, 0.5, 0.9, 1.2, 5.0):
        base = np.array([0.05])
        knapsack = Knapsack(use, 2 * use, np.zeros(3, dtype=np.intp), base, np.array([0.0]), base + spare)
        solution = ComputationProgram(SolverReport()).solve(knapsack)
        checked(knapsack, solution)
        assert solution.filling.use[0] - 0.05 == pytest.approx(min(spare, use.sum()), abs=2 * FULL)


def test_a_worse_solution_is_replaced_by_the_closed_form(monkeypatch):
    report, knapsack = SolverReport(), knapsack_of(4, 0.5)
    monkeypatch.setattr(module, "_exact", lambda gain, use, spare, x, multiplier: np.zeros(len(gain)))
    solution = ComputationProgram(report).solve(knapsack)
    closed = float(fill_greedy(knapsack).value[0])
    assert (solution.status, solution.value) == (CLOSED_FORM, closed)
    free = float(knapsack.gain[knapsack.use == 0].sum())
    assert solution.gap == report.gaps[-1] == pytest.approx(closed - float(knapsack.base_value[0]) - free)


def test_too_little_charge_is_infeasible_without_a_call():
    report, knapsack = SolverReport(), knapsack_of(5, -0.1)
    solution = ComputationProgram(report).solve(knapsack)
    assert solution.status == INFEASIBLE
    assert not solution.feasible
    assert solution.value == float(knapsack.base_value[0])
    assert report.calls == 0


@pytest.mark.parametrize("width", [0, 2])
def test_without_anything_to_choose_nothing_runs(width):
    report, place = SolverReport(), np.zeros(3, dtype=np.intp)
    none = np.zeros((3, width))
    knapsack = Knapsack(none, none, place, np.array([0.4]), np.array([0.2]), np.array([0.9]))
    solution = ComputationProgram(report).solve(knapsack)
    assert (solution.status, report.calls, solution.value) == (NOTHING_TO_CHOOSE, 0, 0.2)
