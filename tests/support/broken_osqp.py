"""Faults of OSQP's compiled extension: it refuses, stops at its limit, or calls something else solved.

The class of the extension itself is changed, so that a solver of any age shows the fault, whatever calls it.
"""

import contextlib
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import osqp
import pytest

EXTENSION = osqp.OSQP().ext.OSQPSolver
TRUE_SOLUTION = EXTENSION.solution
"""The extension's class, and its solution without a fault."""


def _returns(change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]) -> dict[str, object]:
    """Attributes of an extension that returns a change of its solution x and multipliers y, called solved."""

    def solution(solver: object) -> SimpleNamespace:
        true = TRUE_SOLUTION.fget(solver)
        x, y = change(np.array(true.x), np.array(true.y))
        return SimpleNamespace(x=x, y=y, prim_inf_cert=None, dual_inf_cert=None)

    return {"solution": property(solution)} | ends_with(osqp.SolverStatus.OSQP_SOLVED, "solved")


def ends_with(status: int, name: str) -> dict[str, object]:
    """Attributes of an extension whose every run ends with a status."""
    values = {"status_val": int(status), "status": name, "iter": 1, "obj_val": 0.0}
    return {"info": property(lambda solver: type("Info", (), values)())}


def _nonsense(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.random(len(x)), rng.normal(size=len(y))


def _refuses(*_: object, **__: object) -> None:
    """As on data that it finds invalid."""
    raise ValueError(str(int(osqp.SolverError.OSQP_DATA_VALIDATION_ERROR)))


def _lacks_it(*_: object) -> None:
    raise AttributeError("no such thing")


BROKEN: dict[str, dict[str, object]] = {
    "failing": ends_with(osqp.SolverStatus.OSQP_MAX_ITER_REACHED, "maximum iterations reached"),
    "zeros": _returns(lambda x, y: (0 * x, 0 * y)),
    "nonsense": _returns(_nonsense),
    "spoilt": _returns(lambda x, y: (np.r_[x[:-1], x[-1] + 0.1], y)),
    "scaled": _returns(lambda x, y: (0.9 * x, y)),
    "not_finite": _returns(lambda x, y: (x * np.nan, y)),
    "refusing": {"__init__": _refuses},
}
"""Faults of which each is a failed run."""

BUG: dict[str, object] = {"solve": _lacks_it}
"""A fault that is none of the problem's."""


def break_osqp(patch: pytest.MonkeyPatch, attributes: dict[str, object]) -> None:
    """Give the extension a fault until the patch is undone."""
    for name, value in attributes.items():
        patch.setattr(EXTENSION, name, value)


@contextlib.contextmanager
def broken_osqp(attributes: dict[str, object]) -> Iterator[None]:
    """The extension with a fault."""
    with pytest.MonkeyPatch.context() as patch:
        break_osqp(patch, attributes)
        yield
