"""Quadratic programs by OSQP, imported here only, and late: set up once, updated, warm-started, every run verified.

minimise gᵀ z + ½ ε |z − z₀|²  subject to  l ≤ A z ≤ u

The problems are linear, and a small ε keeps the solution near z₀ where others are as good. Callers scale their data to
magnitudes of about 1. A solution counts if OSQP calls it solved and it satisfies the optimality conditions of the data,
computed here. A run that fails is repeated once from scratch, with a smaller step ρ, more iterations and a larger ε.
The report of the planner counts every run.

This module guards against behaviour of OSQP 1: an infeasible problem returns huge numbers as its solution; NaN in
the data is accepted and poisons the warm start; an update with l > u or a wrong length only prints and keeps the old
data; messages go to standard output, those of polishing even where `verbose` is off, so polishing is not
used.
"""

from __future__ import annotations

import importlib.util
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eadp.core.arrays import FloatArray
from eadp.errors import EadpError, SolverFailed
from eadp.planning.base import SolverReport

UNBOUNDED = 1e30
SETTINGS: dict[str, float] = {"scaling": 0, "max_iter": 4000}
RETRY: dict[str, float] = {"scaling": 0, "max_iter": 20_000, "rho": 0.01}
"""Settings of the first run, and of its repetition."""

RETRY_PROXIMAL = 100.0, 1e-2
"""Factor of ε in the repetition, and the least ε."""

VERIFIED = 1e-4
"""Maximum violation of an optimality condition: OSQP's tolerance holds for its own scaled iterates."""

ROOM = 1e3
"""Maximum distance from a bound that counts in the complementarity of its multiplier."""

SOLVED, UNVERIFIED = "solved", "solved, not verified"
SILENT = {"verbose": False, "polishing": False, "warm_starting": True}


def load_osqp() -> Any:
    """The module osqp.

    Raises
    ------
    EadpError
        If it cannot be imported.
    """
    try:
        import osqp
    except ImportError as error:
        raise EadpError(f"osqp cannot be imported ({error}); install it, as in: pip install osqp") from None
    return osqp


def require_osqp() -> None:
    """Raise an EadpError where osqp is missing, before a flight needs it; nothing is imported where it is there."""
    if importlib.util.find_spec("osqp") is None:
        load_osqp()


class QpSolution(NamedTuple):
    """A solution, verified where `QuadraticProgram.solve` returns it.

    Attributes
    ----------
    x : array, shape (columns,)
        The minimiser.
    multipliers : array, shape (rows,)
        Lagrange multipliers of the rows, positive at upper bounds.
    """

    x: FloatArray
    multipliers: FloatArray


QpData = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Gradient, matrix, lower and upper bounds, and centre of one problem, see `QuadraticProgram.solve`."""


class QuadraticProgram:
    """A quadratic program whose A has a fixed sparsity pattern; see the module.

    Parameters
    ----------
    filled : array of bool, shape (rows, columns)
        Sparsity pattern of A.
    proximal : float
        ε, above 0.
    report : SolverReport
        Counts the runs.
    tolerance : float
        OSQP's absolute and relative tolerance.
    """

    def __init__(
        self, filled: NDArray[np.bool_], proximal: float, report: SolverReport, tolerance: float = 1e-6
    ) -> None:
        self._rows, self._columns = filled.shape
        # OSQP wants A by columns (`_indptr`, `_indices`); `_places` are the flat indices of these entries in A by rows
        columns, self._indices = np.nonzero(filled.T)
        self._places = self._indices * self._columns + columns
        self._indptr = np.concatenate([[0], np.cumsum(filled.sum(axis=0))])
        self._proximal, self._retry_proximal = proximal, max(RETRY_PROXIMAL[0] * proximal, RETRY_PROXIMAL[1])
        self._report, self._tolerance = report, tolerance
        # OSQP's extension, once set up: what its interface does around each call takes as long as OSQP does
        self._extension: Any = None

    def solve(
        self, gradient: FloatArray, matrix: FloatArray, lower: FloatArray, upper: FloatArray, centre: FloatArray
    ) -> QpSolution:
        """The minimiser and its multipliers.

        Parameters
        ----------
        gradient : array, shape (columns,)
            g.
        matrix : array, shape (rows, columns)
            A; 0 outside the sparsity pattern.
        lower, upper : array, shape (rows,)
            l and u; `UNBOUNDED` for none.
        centre : array, shape (columns,)
            z₀, and where OSQP starts from.

        Raises
        ------
        SolverFailed
            On data that are not finite or do not fit, and if both runs end with any status but "solved", or with a
            solution that does not satisfy the optimality conditions.
        """
        data = gradient, matrix, lower, upper, centre
        self._check(data)
        try:
            return self._run(data, self._proximal, SETTINGS)
        except SolverFailed:
            self._extension = None  # a failed run leaves a poor starting point
            self._report.retried += 1
        try:
            return self._run(data, self._retry_proximal, RETRY)
        finally:
            self._extension = None  # the next problem starts with the settings of a first run

    def _check(self, data: QpData) -> None:
        """Refuse data that OSQP would accept silently."""
        rows, columns, (_, _, lower, upper, _) = (self._rows,), (self._columns,), data
        shapes = tuple([array.shape for array in data])
        if shapes != (columns, rows + columns, rows, rows, columns):
            raise SolverFailed(f"data of shapes {shapes} do not fit {self._rows} × {self._columns}")
        if not math.isfinite(sum(map(np.vdot, data, data))):
            raise SolverFailed("data that are not finite")
        if np.minimum.reduce(upper - lower, initial=0.0) < 0:
            raise SolverFailed("a row whose lower bound is above its upper bound")

    def _run(self, data: QpData, proximal: float, settings: dict[str, float]) -> QpSolution:
        """One run of OSQP from the centre, counted; its solution, verified. Raises SolverFailed without one."""
        osqp, report = load_osqp(), self._report
        report.calls += 1
        try:
            self._set(data, proximal, settings)
            self._extension.warm_start(data[-1], None)
            self._extension.solve()
            info, found = self._extension.info, self._extension.solution
            # copies: OSQP may write its next solution into the same memory
            solution = QpSolution(np.array(found.x), np.array(found.y))
            # any other status: inaccurate, infeasible, iteration or time limit, non-convex, interrupted, unsolved
            status = info.status
            if info.status_val == osqp.SolverStatus.OSQP_SOLVED:
                status = SOLVED if _is_optimal(data, proximal, solution) else UNVERIFIED
        except osqp.OSQPException as error:  # a problem that the extension refuses; any other exception is a bug
            status = type(error).__name__
        report.by_status[status] = report.by_status.get(status, 0) + 1
        if status != SOLVED:
            report.failed += 1
            raise SolverFailed(f"OSQP: {status}")
        report.solved += 1
        return solution

    def _set(self, data: QpData, proximal: float, settings: dict[str, float]) -> None:
        """Set OSQP up with a problem at first, else update it."""
        # ½ ε |z − z₀|² + gᵀ z is ½ ε |z|² + (g − ε z₀)ᵀ z, and a constant
        gradient, matrix, lower, upper, centre = data
        linear = gradient - proximal * centre
        entries = matrix.take(self._places)
        if self._extension is None:
            from scipy.sparse import csc_matrix, identity

            rows = csc_matrix((entries, self._indices, self._indptr), shape=(self._rows, self._columns))
            tolerance = {"eps_abs": self._tolerance, "eps_rel": self._tolerance}
            osqp = load_osqp().OSQP()
            quadratic = proximal * identity(self._columns, format="csc")
            osqp.setup(quadratic, linear, rows, lower, upper, **SILENT | tolerance | settings)
            self._extension = osqp._solver
        else:
            self._extension.update_data_vec(q=linear, l=lower, u=upper)
            self._extension.update_data_mat(P_x=None, P_i=None, A_x=entries, A_i=None)


def _is_optimal(data: QpData, proximal: float, solution: QpSolution) -> bool:
    """Whether a solution and its multipliers satisfy the Karush-Kuhn-Tucker conditions; False with NaN."""
    gradient, matrix, lower, upper, centre = data
    x, y = solution.x, solution.multipliers
    # A z, its distance below u and above l: both are 0 or more
    values = matrix @ x
    below, above = upper - values, values - lower
    # g + ε (z − z₀) + Aᵀ y = 0
    forces = gradient + proximal * (x - centre) + y @ matrix
    # |y| · distance = 0: a multiplier is positive at u, negative at l
    pushed = np.abs(y)
    room = np.minimum(np.where(y > 0, below, above), ROOM)
    largest = np.maximum.reduce
    bound = VERIFIED * max(1.0, largest(pushed, initial=0.0))
    return bool(
        np.minimum.reduce(np.minimum(below, above)) >= -VERIFIED
        and largest(np.abs(forces)) <= bound
        and pushed @ room <= bound
    )
