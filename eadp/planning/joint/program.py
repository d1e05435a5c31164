"""The computations of all legs that are left, at given path parameters: one linear program, solved by OSQP.

    maximise    Σ gain · x
    subject to  Σ use · x ≤ spare,  0 ≤ x ≤ 1

over the shares x of the knapsack's increments; inhibited stages, limits of power and trade-offs shape the increments.
The QP adds a small proximal term. Its solution becomes exact by its multiplier: increments that gain more than it for
their charge are taken in full, those that gain less not at all, and those at it as the QP mixes them.

The closed form of the same program certifies the solution: the gap is how much better it is. It is taken instead where
the gap exceeds 1e-6 of the objective, and where OSQP fails; both are counted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import SolverFailed
from eadp.planning.base import CLOSED_FORM, FALLBACK, INFEASIBLE, NOTHING_TO_CHOOSE, SOLVED, SolverReport
from eadp.planning.forecast.knapsack import FULL, Filling, Knapsack, fill_greedy
from eadp.planning.qp import UNBOUNDED, QuadraticProgram, require_osqp

PROXIMAL, TOLERANCE = 1e-4, 1e-7
"""Weight of the proximal term, for a gradient of median 1, and OSQP's tolerance."""

OUTDONE = 1e-6
"""Gain of the closed form from which it is taken instead of the QP's solution."""

TIE = 1e-3
"""Relative difference of gain per charge to the multiplier within which a QP's shares are kept."""

SIZES = 16
"""Problems have a multiple of so many variables, so that OSQP is set up seldom; those beyond the real ones are 0."""

RECENTRED = 2
"""Most further QPs, each with its proximal term around the last one's solution, where the gap exceeds `OUTDONE`."""


class Solution(NamedTuple):
    """A solution.

    Attributes
    ----------
    filling : Filling
        Of one place.
    status : str
        As in `DecisionRecord`.
    gap : float or None
        How much greater the closed form's value is.
    """

    filling: Filling
    status: str
    gap: float | None = None

    @property
    def value(self) -> float:
        """The objective."""
        return float(self.filling.value[0])

    @property
    def feasible(self) -> bool:
        """Whether the reserve is kept with its probability, with every leg at minimum power."""
        return bool(self.filling.feasible[0])


class ComputationProgram:
    """The program of one mission; OSQP is set up once for each number of increments.

    Parameters
    ----------
    report : SolverReport
        Counts the runs of OSQP.

    Raises
    ------
    EadpError
        If osqp is missing.
    """

    def __init__(self, report: SolverReport) -> None:
        require_osqp()
        self._report = report
        self._size = 0
        self._qp: QuadraticProgram | None = None

    def solve(self, knapsack: Knapsack) -> Solution:
        """The optimal computations at one place, by OSQP; in closed form where that is better by much, or OSQP fails.

        Parameters
        ----------
        knapsack : Knapsack
            Of one place.
        """
        closed = fill_greedy(knapsack)
        if not closed.feasible[0]:
            return Solution(closed, INFEASIBLE)
        # flat indices of the program's variables: increments that cost and gain something; the others are as in closed
        # form
        variable = np.flatnonzero((knapsack.use > 0) & (knapsack.gain > 0))
        if not len(variable):
            return Solution(closed, NOTHING_TO_CHOOSE)
        use, gain = knapsack.use.ravel()[variable], knapsack.gain.ravel()[variable]
        spare = max(float(knapsack.spare[0]), 0.0)
        # repeated around the last solution until it is as good as the closed form
        x = np.full(len(variable), 0.5)
        try:
            for _ in range(1 + RECENTRED):
                x, multiplier = self._solved(gain, use, spare, x)
                shares = closed.shares.copy()
                shares.ravel()[variable] = _exact(gain, use, spare, x, multiplier)
                filling = knapsack.filling(shares)
                gap = float(closed.value[0] - filling.value[0])
                if gap <= OUTDONE:
                    break
        except SolverFailed:
            self._report.fallbacks += 1
            return Solution(closed, FALLBACK)
        self._report.gaps.append(gap)
        if gap > OUTDONE:
            return Solution(closed, CLOSED_FORM, gap)
        return Solution(filling, SOLVED, gap)

    def _solved(self, gain: FloatArray, use: FloatArray, spare: float, centre: FloatArray) -> tuple[FloatArray, float]:
        """One run of OSQP: the shares x, and the multiplier of the charge.

            max gain·x − ½ε|y − y_centre|²  subject to  use·x ≤ spare,  0 ≤ x ≤ 1,  y being x scaled by use

        So scaled, the row has entries of 1, whatever the leg.
        """
        # y = s x with s = use / mean use: use·x = mean use · Σ y, and the gain of y is gain/s
        real, mean_use = len(gain), float(use.mean())
        # variables are filled up to a multiple of SIZES with ones that are 0; `scale` is s, `slope` the gain of y
        count = real + -real % SIZES
        scale, slope, start = np.ones(count), np.zeros(count), np.zeros(count)
        scale[:real] = np.maximum(use / mean_use, 1e-6)
        slope[:real], start[:real] = gain / scale[:real], centre * scale[:real]
        # gains are divided by the usual one; their mean would not do: a lap's rest may gain a hundred times as much
        usual = float(np.median(slope[:real]))
        if self._qp is None or count != self._size:
            pattern = np.vstack([np.ones((1, count)), np.eye(count)]) > 0
            self._qp, self._size = QuadraticProgram(pattern, PROXIMAL, self._report, TOLERANCE), count
        # the first row is the charge, the others are the bounds 0 ≤ y ≤ s
        matrix = np.vstack([np.zeros((1, count)), np.eye(count)])
        matrix[0, :real] = use / (mean_use * scale[:real])
        # a row that cannot bind would only slow OSQP down
        room = UNBOUNDED if spare >= float(use.sum()) else spare / mean_use
        lower, upper = np.zeros(count + 1), np.zeros(count + 1)
        lower[0], upper[0], upper[1 : real + 1] = -UNBOUNDED, room, scale[:real]
        solution = self._qp.solve(-slope / usual, matrix, lower, upper, start)
        multiplier = max(float(solution.multipliers[0]), 0.0) * usual / mean_use
        return (solution.x / scale)[:real], multiplier


def _exact(gain: FloatArray, use: FloatArray, spare: float, x: FloatArray, multiplier: float) -> FloatArray:
    """The shares of the program's exact solution near a QP's `x`, by the QP's multiplier of the charge.

    Increments that gain more than the multiplier for their charge are taken in full, and those that gain less not at
    all; ties stay as the QP has them. Charge left by this goes to the ties, the most efficient first; charge that it
    lacks is taken from all, the least efficient first.
    """
    net = gain - multiplier * use
    ties = np.abs(net) <= TIE * multiplier * use
    x = np.where(ties, np.clip(x, 0.0, 1.0), net > 0)
    left = spare - float(use @ x)  # negative for a lack
    order = np.argsort(gain / use, kind="stable")  # the least efficient first
    if left > 0:
        order = order[::-1][ties[order[::-1]]]
    for i in order.tolist():
        if abs(left) <= FULL * FULL:
            break
        moved = min(1.0, max(0.0, x[i] + left / float(use[i])))
        left -= float(use[i]) * (moved - x[i])
        x[i] = moved
    return x
