"""Stand-ins for a solve of OSQP that fails, returns its start, or returns nonsense and calls it solved."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import osqp

TRUE_SOLVE = osqp.OSQP.solve


def failing(solver, raise_error=None):
    """The iteration limit."""
    info = SimpleNamespace(
        status_val=osqp.SolverStatus.OSQP_MAX_ITER_REACHED, status="maximum iterations reached", iter=1
    )
    return SimpleNamespace(x=np.full(solver.n, 2.1e9), y=np.zeros(solver.m), info=info)


def _called_solved(x, y):
    info = SimpleNamespace(status_val=osqp.SolverStatus.OSQP_SOLVED, status="solved", iter=1)
    return SimpleNamespace(x=x, y=y, info=info)


def start(solver, raise_error=None):
    """Zeros, called solved."""
    return _called_solved(np.zeros(solver.n), np.zeros(solver.m))


def nonsense(solver, raise_error=None):
    """Numbers of the right shape, called solved."""
    rng = np.random.default_rng(0)
    return _called_solved(rng.random(solver.n), rng.normal(size=solver.m))


def spoilt(solver, raise_error=None):
    """The solution, its last variable moved."""
    result = TRUE_SOLVE(solver, raise_error=False)
    x = np.array(result.x)
    x[-1] += 0.1
    return _called_solved(x, np.array(result.y))


def not_finite(solver, raise_error=None):
    """NaN, called solved."""
    return _called_solved(np.full(solver.n, np.nan), np.zeros(solver.m))


def raising(solver, raise_error=None):
    """An exception of the extension."""
    raise RuntimeError("OSQP")


BROKEN = {f.__name__: f for f in (failing, start, nonsense, spoilt, not_finite, raising)}
