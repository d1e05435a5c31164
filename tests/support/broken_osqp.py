"""Stand-ins for a solve of OSQP that fails, returns its start, or returns nonsense and calls it solved."""

from __future__ import annotations

import numpy as np
import osqp

from eadp.planning.qp import OsqpSolver, QpSolution

TRUE_RUN = OsqpSolver.run


def failing(solver, start):
    """The iteration limit."""
    limit = osqp.SolverStatus.OSQP_MAX_ITER_REACHED
    return QpSolution(np.full(solver.columns, 2.1e9), np.zeros(solver.rows), limit, "maximum iterations reached", 1)


def _called_solved(x, y):
    return QpSolution(x, y, osqp.SolverStatus.OSQP_SOLVED, "solved", 1)


def start(solver, start):
    """Zeros, called solved."""
    return _called_solved(np.zeros(solver.columns), np.zeros(solver.rows))


def nonsense(solver, start):
    """Numbers of the right shape, called solved."""
    rng = np.random.default_rng(0)
    return _called_solved(rng.random(solver.columns), rng.normal(size=solver.rows))


def spoilt(solver, start):
    """The solution, its last variable moved."""
    run = TRUE_RUN(solver, start)
    x = np.array(run.x)
    x[-1] += 0.1
    return _called_solved(x, run.multipliers)


def not_finite(solver, start):
    """NaN, called solved."""
    return _called_solved(np.full(solver.columns, np.nan), np.zeros(solver.rows))


def raising(solver, start):
    """An exception of the extension."""
    raise RuntimeError("OSQP")


BROKEN = {f.__name__: f for f in (failing, start, nonsense, spoilt, not_finite, raising)}
