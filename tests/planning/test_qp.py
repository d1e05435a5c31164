"""The door to OSQP: answers by their KKT conditions, every status read, no trap sprung."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import osqp
import pytest
from scipy.optimize import nnls

from eadp.errors import Infeasible, SolverFailed
from eadp.planning import qp
from eadp.planning.qp import UNBOUNDED, QuadraticProgram

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


def box(columns=2, proximal=PROXIMAL):
    """A program whose rows are the variables and their sum."""
    return QuadraticProgram(np.vstack([np.eye(columns), np.ones((1, columns))]) > 0, proximal)


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


def kkt_residual(proximal, linear, matrix, lower, upper, z):
    """The least that P z + q + Aᵀ y can be with multipliers y of the right sign on the rows that are met."""
    values = matrix @ z
    at_upper = matrix[values > upper - FEASIBLE]
    at_lower = matrix[values < lower + FEASIBLE]
    _, residual = nnls(np.vstack([at_upper, -at_lower]).T, -(proximal * z + linear))
    return residual


@pytest.mark.parametrize("seed", range(40))
def test_answers_satisfy_the_kkt_conditions(seed):
    rng = np.random.default_rng(seed)
    data = random_data(rng, rows=6, columns=5)
    program = QuadraticProgram(data[1] != 0, PROXIMAL)
    for _ in range(3):  # built, then updated twice
        z = program.solve(*data)
        linear, matrix, lower, upper, _ = data
        assert np.all(matrix @ z <= upper + FEASIBLE)
        assert np.all(matrix @ z >= lower - FEASIBLE)
        assert kkt_residual(PROXIMAL, linear, matrix, lower, upper, z) < KKT
        data[0] = rng.normal(size=5)
        data[1] = matrix * rng.uniform(0.9, 1.1, matrix.shape)
        data[2], data[3] = data[2] - 0.5, data[3] + 0.5


def test_an_updated_program_answers_as_a_new_one():
    rng = np.random.default_rng(3)
    program = box(4)
    for _ in range(20):
        data = box_data(rng.normal(size=4), rng.uniform(0.1, 3.0))
        assert program.solve(*data) == pytest.approx(box(4).solve(*data), abs=FEASIBLE)


def test_a_known_answer():
    # z2 is worth most and fills its box; z1 takes what the sum leaves
    assert box().solve(*box_data()) == pytest.approx([0.5, 1.0], abs=FEASIBLE)


def test_places_not_announced_are_not_looked_at():
    data = box_data()
    data[1][0, 1] = 7.0
    assert box().solve(*data) == pytest.approx([0.5, 1.0], abs=FEASIBLE)


# --- what fails


def contradiction(data):
    data[2][2], data[3][2] = 3.0, 4.0  # a sum of 3 within the unit box


def above(data):
    data[2][0], data[3][0] = 1.0, 0.5


def not_a_number(part):
    def spoil(data):
        data[part].ravel()[0] = np.nan

    return spoil


def infinite(part, value):
    def spoil(data):
        data[part].ravel()[-1] = value

    return spoil


def too_long(part):
    def spoil(data):
        data[part] = np.concatenate([data[part], data[part][:1]])

    return spoil


FAULTS = {
    "infeasible": (contradiction, Infeasible),
    "lower above upper": (above, Infeasible),
    **{f"NaN in part {part}": (not_a_number(part), SolverFailed) for part in range(5)},
    **{f"infinite, part {part}": (infinite(part, np.inf), SolverFailed) for part in range(5)},
    "both infinities": (lambda data: (infinite(2, -np.inf)(data), infinite(3, np.inf)(data)), SolverFailed),
    **{f"part {part} too long": (too_long(part), SolverFailed) for part in range(5)},
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("first", [True, False], ids=["first solve", "later solve"])
def test_faults_are_told_and_leave_no_trace(fault, first):
    spoil, error = FAULTS[fault]
    program = box()
    if not first:
        program.solve(*box_data())
    data = box_data()
    spoil(data)
    with pytest.raises(error):
        program.solve(*data)
    assert program.solve(*box_data((-3.0, -2.0))) == pytest.approx([1.0, 0.5], abs=FEASIBLE)


def test_the_iteration_limit_is_a_failure(monkeypatch):
    data = random_data(np.random.default_rng(0), rows=6, columns=5)
    program = QuadraticProgram(data[1] != 0, PROXIMAL)
    with monkeypatch.context() as patch:
        patch.setattr(qp, "ITERATIONS", 2)
        with pytest.raises(SolverFailed, match="iterations"):
            program.solve(*data)
    z = program.solve(*data)  # built anew, with the limit of now
    assert kkt_residual(PROXIMAL, *data[:4], z) < KKT


@pytest.mark.parametrize("status", STATUSES, ids=[status.name for status in STATUSES])
def test_every_status_is_mapped(status, monkeypatch):
    """Only "solved" is an answer; only a proof of infeasibility is Infeasible."""
    program = box()
    program.solve(*box_data())
    answer = SimpleNamespace(x=np.array([2.1e9, 0.5]), info=SimpleNamespace(status_val=status, status=status.name))
    monkeypatch.setattr(program._solver, "solve", lambda raise_error: answer)
    if status.name == "OSQP_SOLVED":
        assert program.solve(*box_data()) == pytest.approx(answer.x)
        return
    error = Infeasible if "PRIMAL_INFEASIBLE" in status.name else SolverFailed
    with pytest.raises(error, match=status.name):
        program.solve(*box_data())
    # the stand-in is gone: a failed program is built anew
    assert program.solve(*box_data()) == pytest.approx([0.5, 1.0], abs=FEASIBLE)


def test_an_answer_that_is_not_finite_is_none(monkeypatch):
    program = box()
    program.solve(*box_data())
    solved = SimpleNamespace(status_val=osqp.SolverStatus.OSQP_SOLVED, status="solved")
    answer = SimpleNamespace(x=np.array([np.nan, 0.5]), info=solved)
    monkeypatch.setattr(program._solver, "solve", lambda raise_error: answer)
    with pytest.raises(SolverFailed, match="finite"):
        program.solve(*box_data())
    assert program.solve(*box_data()) == pytest.approx([0.5, 1.0], abs=FEASIBLE)
