"""The door to OSQP: solutions by their KKT conditions, every status read and counted, no trap sprung."""

import sys

import numpy as np
import osqp
import pytest
from broken_osqp import BROKEN, BUG, break_osqp, broken_osqp, ends_with
from common import few
from scipy.optimize import nnls

from eadp.errors import EadpError, SolverFailed
from eadp.planning import qp
from eadp.planning.base import SolverReport
from eadp.planning.qp import UNBOUNDED, UNVERIFIED, QuadraticProgram

KKT = 1e-5
FEASIBLE = 1e-5  # the solver's 1e-7 is of its own iterates, and relative to numbers up to 5
PROXIMAL = 0.1
STATUSES = list(osqp.SolverStatus)


@pytest.fixture(autouse=True)
def quiet(capfd):
    """Nothing is printed, by Python or by the solver's C code."""
    yield
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err == ""


def box(columns=2, proximal=PROXIMAL, report=None):
    """A program whose rows are the variables and their sum."""
    rows = np.vstack([np.eye(columns), np.ones((1, columns))]) > 0
    return QuadraticProgram(rows, proximal, report or SolverReport(), 1e-7)


def box_data(linear=(-1.0, -2.0), most=1.5):
    """Within the unit box and a sum of at most `most`."""
    columns = len(linear)
    matrix = np.vstack([np.eye(columns), np.ones((1, columns))])
    lower = np.r_[np.zeros(columns), -UNBOUNDED]
    upper = np.r_[np.ones(columns), most]
    return [np.array(linear), matrix, lower, upper, np.zeros(columns)]


def random_data(rng, rows, columns):
    """A feasible problem with rows bounded on either side, on both, or not at all."""
    matrix = np.where(rng.random((rows, columns)) < 0.6, rng.normal(size=(rows, columns)), 0.0)
    inside = matrix @ rng.normal(size=columns)
    kind = rng.integers(0, 4, rows)
    lower = np.where(kind % 2 == 0, inside - rng.uniform(0, 1, rows), -UNBOUNDED)
    upper = np.where(kind >= 2, inside + rng.uniform(0, 1, rows), UNBOUNDED)
    # a box keeps it bounded where the proximal term is small
    matrix = np.vstack([matrix, np.eye(columns)])
    lower, upper = np.r_[lower, np.full(columns, -5.0)], np.r_[upper, np.full(columns, 5.0)]
    return [rng.normal(size=columns), matrix, lower, upper, rng.normal(size=columns)]


def kkt_residual(proximal, gradient, matrix, lower, upper, centre, z):
    """The least that ε (z − z₀) + g + Aᵀ y can be with multipliers y of the right sign on the rows that are met."""
    values = matrix @ z
    at_upper = matrix[values > upper - FEASIBLE]
    at_lower = matrix[values < lower + FEASIBLE]
    _, residual = nnls(np.vstack([at_upper, -at_lower]).T, -(proximal * (z - centre) + gradient))
    return residual


@pytest.mark.parametrize("seed", few(range(10), 4))
def test_answers_satisfy_the_kkt_conditions(seed):
    rng = np.random.default_rng(seed)
    data = random_data(rng, rows=6, columns=5)
    program = QuadraticProgram(data[1] != 0, PROXIMAL, SolverReport(), 1e-7)
    for _ in range(3):  # built, then updated twice
        z = program.solve(*data).x
        _, matrix, lower, upper, _ = data
        assert np.all(matrix @ z <= upper + FEASIBLE)
        assert np.all(matrix @ z >= lower - FEASIBLE)
        assert kkt_residual(PROXIMAL, *data, z) < KKT
        data[0] = rng.normal(size=5)
        data[1] = matrix * rng.uniform(0.9, 1.1, matrix.shape)
        data[2], data[3] = data[2] - 0.5, data[3] + 0.5


# --- what fails


FAULTS = {  # parts of the data, places in them, and values there; without a place, one row more
    "infeasible": [(2, 2, 3.0), (3, 2, 4.0)],  # a sum of 3 within the unit box
    "lower above upper": [(2, 0, 1.0), (3, 0, 0.5)],
    **{f"NaN in part {part}": [(part, 0, np.nan)] for part in range(5)},
    **{f"infinite, part {part}": [(part, -1, np.inf)] for part in range(5)},
    "both infinities": [(2, -1, -np.inf), (3, -1, np.inf)],
    **{f"part {part} too long": [(part, None, None)] for part in range(5)},
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("first", [True, False], ids=["first solve", "later solve"])
def test_faults_are_told_and_leave_no_trace(fault, first):
    program = box()
    if not first:
        program.solve(*box_data())
    data = box_data()
    for part, place, value in FAULTS[fault]:
        if place is None:
            data[part] = np.concatenate([data[part], data[part][:1]])
        else:
            data[part].flat[place] = value
    with pytest.raises(SolverFailed):
        program.solve(*data)
    assert program.solve(*box_data((-3.0, -2.0))).x == pytest.approx([1.0, 0.5], abs=FEASIBLE)


def test_a_failed_run_is_repeated_once_and_counted(monkeypatch):
    data, report = random_data(np.random.default_rng(0), rows=6, columns=5), SolverReport()
    program = QuadraticProgram(data[1] != 0, PROXIMAL, report)
    monkeypatch.setattr(qp, "SETTINGS", {"scaling": 0, "max_iter": 2})
    z = program.solve(*data).x
    assert kkt_residual(qp.RETRY_PROXIMAL[0] * PROXIMAL, *data, z) < KKT
    assert (report.calls, report.solved, report.retried, report.failed) == (2, 1, 1, 1)
    assert report.by_status == {"maximum iterations reached": 1, "solved": 1}
    monkeypatch.setattr(qp, "RETRY", {"scaling": 10, "max_iter": 2})
    with pytest.raises(SolverFailed, match="iterations"):
        program.solve(*data)
    assert (report.calls, report.solved, report.retried, report.failed) == (4, 1, 2, 3)


def test_data_that_osqp_refuses_are_a_failed_run(monkeypatch):
    """It keeps the old data without a word; their solution does not satisfy the conditions of the new ones."""
    report = SolverReport()
    program = box(report=report)
    program.solve(*box_data())
    break_osqp(monkeypatch, {"update_data_vec": lambda *_, **__: 1})
    # the repetition has ε = 10, and finds −g/ε
    assert program.solve(*box_data((-3.0, -2.0))).x == pytest.approx([0.3, 0.2], abs=FEASIBLE)
    assert report.by_status == {"solved": 2, UNVERIFIED: 1}
    assert (report.calls, report.failed, report.retried) == (3, 1, 1)


@pytest.mark.parametrize("status", STATUSES, ids=[status.name for status in STATUSES])
def test_only_solved_is_a_solution(status, monkeypatch):
    report = SolverReport()
    program = box(report=report)
    good = program.solve(*box_data())
    break_osqp(monkeypatch, ends_with(status, status.name))
    if status.name == "OSQP_SOLVED":
        assert program.solve(*box_data()).x == pytest.approx(good.x)
        return
    with pytest.raises(SolverFailed, match=status.name):
        program.solve(*box_data())
    assert report.by_status == {"solved": 1, status.name: 2}


@pytest.mark.parametrize("broken", BROKEN)
def test_what_is_called_solved_is_verified(broken):
    report = SolverReport()
    program = box(report=report)
    with broken_osqp(BROKEN[broken]), pytest.raises(SolverFailed):
        program.solve(*box_data())
    assert (report.calls, report.solved, report.retried, report.failed) == (2, 0, 1, 2)
    expected = {"failing": "maximum iterations reached", "refusing": "OSQPException"}.get(broken, UNVERIFIED)
    assert report.by_status == {expected: 2}
    # a failed program is built anew
    assert program.solve(*box_data()).x == pytest.approx([0.5, 1.0], abs=FEASIBLE)


@pytest.mark.parametrize("later", [False, True], ids=["first solve", "later solve"])
def test_a_bug_is_no_failed_solve(later):
    report = SolverReport()
    program = box(report=report)
    if later:
        program.solve(*box_data())
    with broken_osqp(BUG), pytest.raises(AttributeError):
        program.solve(*box_data())
    assert (report.failed, report.retried) == (0, 0)


def test_a_missing_osqp_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "osqp", None)
    with pytest.raises(EadpError, match=r"osqp cannot be imported .*pip install osqp"):
        box().solve(*box_data())
