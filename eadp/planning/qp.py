"""Quadratic programs by OSQP, imported here only: set up once, updated, warm-started, the status always checked.

minimise ½ zᵀ P z + qᵀ z  subject to  l ≤ A z ≤ u, with P = ε I.

This module guards against behaviour of OSQP 1.1: an infeasible problem returns huge numbers as its solution; NaN in
the data is accepted and poisons the warm start; an update with l > u or a wrong length only prints and keeps the old
data; messages go to standard output, those of polishing even where `verbose` is off, so polishing is not used.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from eadp.core.arrays import FloatArray
from eadp.errors import Infeasible, SolverFailed

UNBOUNDED = 1e30
TOLERANCE = 1e-7
ITERATIONS = 4000
# Rows are scaled by the caller; ρ starts high and adapts early. On QPs of horizons of 10 and 46 steps with little
# charge this takes a median of 50 to 125 iterations; the defaults reach the limit.
SETTINGS = {"scaling": 0, "rho": 3.0, "adaptive_rho_tolerance": 2.0, "polishing": False, "warm_starting": True}


class QuadraticProgram:
    """A quadratic program whose A has a fixed sparsity pattern; see the module.

    Parameters
    ----------
    filled : array of bool, shape (rows, columns)
        Sparsity pattern of A.
    proximal : float
        ε, above 0.
    """

    def __init__(self, filled: NDArray[np.bool_], proximal: float) -> None:
        self._rows, self._columns = filled.shape
        # OSQP wants A by columns
        self._filled = np.ascontiguousarray(filled.T)
        self._indices = np.nonzero(self._filled)[1]
        self._indptr = np.concatenate([[0], np.cumsum(self._filled.sum(axis=1))])
        self._proximal = proximal
        self._solver: Any = None
        self._failed = False

    def solve(
        self, linear: FloatArray, matrix: FloatArray, lower: FloatArray, upper: FloatArray, warm: FloatArray
    ) -> FloatArray:
        """The minimiser, shape (columns,).

        Parameters
        ----------
        linear : array, shape (columns,)
            q.
        matrix : array, shape (rows, columns)
            A; entries outside the sparsity pattern are ignored.
        lower, upper : array, shape (rows,)
            l and u; `UNBOUNDED` for none.
        warm : array, shape (columns,)
            Starting point.

        Raises
        ------
        Infeasible
            If a lower bound is above its upper bound, or the solver proves that no z satisfies the rows.
        SolverFailed
            On data that are not finite or do not fit, and on any status but "solved".
        """
        self._check(linear, matrix, lower, upper, warm)
        entries = matrix.T[self._filled]
        if self._solver is None or self._failed:
            self._build(linear, entries, lower, upper)
        else:
            self._solver.update(q=linear, Ax=entries, l=lower, u=upper)
        self._solver.warm_start(x=warm)
        return self._checked(self._solver.solve(raise_error=False))

    def _check(self, *data: FloatArray) -> None:
        """Refuse data that OSQP would accept silently."""
        rows, columns = (self._rows,), (self._columns,)
        shapes = tuple(array.shape for array in data)
        if shapes != (columns, rows + columns, rows, rows, columns):
            raise SolverFailed(f"data of shapes {shapes} do not fit {self._rows} × {self._columns}")
        if not all(math.isfinite(np.vdot(array, array)) for array in data):
            raise SolverFailed("data that are not finite")
        if (data[2] > data[3]).any():
            raise Infeasible("a row whose lower bound is above its upper bound")

    def _build(self, linear: FloatArray, entries: FloatArray, lower: FloatArray, upper: FloatArray) -> None:
        locations = range(self._columns)
        identity = csc_matrix((np.full(self._columns, self._proximal), (locations, locations)))
        rows = csc_matrix((entries, self._indices, self._indptr), shape=(self._rows, self._columns))
        self._failed = True  # until it has a solution
        self._solver = osqp.OSQP()
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
            **SETTINGS,
        )

    def _checked(self, result: Any) -> FloatArray:
        status, known = result.info.status_val, osqp.SolverStatus
        self._failed = status != known.OSQP_SOLVED  # a failed run leaves a poor starting point: set up again
        if status in (known.OSQP_PRIMAL_INFEASIBLE, known.OSQP_PRIMAL_INFEASIBLE_INACCURATE):
            raise Infeasible(f"OSQP: {result.info.status}")
        if self._failed:
            # solved inaccurate, dual infeasible, iteration or time limit, non-convex, interrupted, unsolved
            raise SolverFailed(f"OSQP: {result.info.status}")
        x: FloatArray = np.array(result.x, dtype=np.float64)
        if not np.isfinite(x).all():
            self._failed = True
            raise SolverFailed("solved, but not finite")
        return x
