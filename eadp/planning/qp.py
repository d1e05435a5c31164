"""The only door to OSQP: a quadratic program that is built once, updated, warm-started, its status always read.

minimise ½ zᵀ P z + qᵀ z  subject to  l ≤ A z ≤ u, with P = ε I.

Traps of OSQP 1.1 that this door guards: an infeasible problem returns huge numbers as its solution; NaN in the
data is accepted and poisons the warm start; an update with l > u or a wrong length only prints and keeps the old
data; messages go to standard output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from eadp.errors import Infeasible, SolverFailed

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

UNBOUNDED = 1e30
TOLERANCE = 1e-6
ITERATIONS = 4000


@dataclass(frozen=True, slots=True)
class Pattern:
    """Where A has entries: column pointers and row indices, compressed by columns."""

    rows: int
    columns: int
    indptr: IntArray
    indices: IntArray


class QuadraticProgram:
    """A problem of fixed pattern; see the module.

    Parameters
    ----------
    pattern : Pattern
        Of A.
    proximal : float
        ε, above 0.
    """

    def __init__(self, pattern: Pattern, proximal: float) -> None:
        self._pattern = pattern
        self._proximal = proximal
        self._solver: Any = None
        self._failed = False

    def solve(
        self, linear: FloatArray, entries: FloatArray, lower: FloatArray, upper: FloatArray, warm: FloatArray
    ) -> FloatArray:
        """The minimiser, shape (columns,).

        Parameters
        ----------
        linear : array, shape (columns,)
            q.
        entries : array, shape (len(indices),)
            A's entries in the pattern's order.
        lower, upper : array, shape (rows,)
            l and u; `UNBOUNDED` for none.
        warm : array, shape (columns,)
            Where to begin.

        Raises
        ------
        Infeasible
            If a lower bound is above its upper bound, or the solver proves that no z satisfies the rows.
        SolverFailed
            On data that are not finite or do not fit, and on any status but "solved".
        """
        self._check(linear, entries, lower, upper, warm)
        if self._solver is None or self._failed:
            self._failed = True  # until it has solved
            self._build(linear, entries, lower, upper)
        else:
            self._solver.update(q=linear, Ax=entries, l=lower, u=upper)
        self._solver.warm_start(x=warm)
        return self._checked(self._solver.solve(raise_error=False))

    def _check(self, *data: FloatArray) -> None:
        """Refuse what OSQP would take without a word."""
        p = self._pattern
        shapes = tuple(array.shape for array in data)
        if shapes != ((p.columns,), (len(p.indices),), (p.rows,), (p.rows,), (p.columns,)):
            raise SolverFailed(f"data of shapes {shapes} do not fit the problem")
        if not np.isfinite(np.concatenate(data)).all():
            raise SolverFailed("data that are not finite")
        _, _, lower, upper, _ = data
        if (lower > upper).any():
            raise Infeasible("a row whose lower bound is above its upper bound")

    def _build(self, linear: FloatArray, entries: FloatArray, lower: FloatArray, upper: FloatArray) -> None:
        p = self._pattern
        identity = csc_matrix((np.full(p.columns, self._proximal), (range(p.columns), range(p.columns))))
        rows = csc_matrix((entries, p.indices, p.indptr), shape=(p.rows, p.columns))
        self._solver = osqp.OSQP()
        try:
            self._solver.setup(
                identity,
                linear,
                rows,
                lower,
                upper,
                verbose=False,
                eps_abs=TOLERANCE,
                eps_rel=TOLERANCE,
                max_iter=ITERATIONS,
                scaling=0,  # rows come scaled
                rho=3.0,
                adaptive_rho_tolerance=2.0,
                polishing=True,
                warm_starting=True,
            )
        except osqp.OSQPException as error:
            raise SolverFailed(f"OSQP: set-up refused, error {error}") from None

    def _checked(self, result: Any) -> FloatArray:
        status = result.info.status_val
        constants = osqp.SolverStatus
        self._failed = status != constants.OSQP_SOLVED  # a failed run leaves a poor start: build anew
        if status == constants.OSQP_SOLVED:
            x: FloatArray = np.array(result.x, dtype=np.float64)
            if not np.isfinite(x).all():
                self._failed = True
                raise SolverFailed("solved, but not finite")
            return x
        if status in (constants.OSQP_PRIMAL_INFEASIBLE, constants.OSQP_PRIMAL_INFEASIBLE_INACCURATE):
            raise Infeasible(f"OSQP: {result.info.status}")
        # solved inaccurate, dual infeasible, iteration or time limit, non-convex, interrupted, unsolved
        raise SolverFailed(f"OSQP: {result.info.status}")


def pattern(columns: Sequence[Sequence[int]], rows: int) -> Pattern:
    """A pattern from the row indices of each column."""
    pointers = np.cumsum([0, *(len(column) for column in columns)])
    indices = np.array([row for column in columns for row in column], dtype=np.int64)
    return Pattern(rows, len(columns), np.asarray(pointers, dtype=np.int64), indices)
