"""One optimisation over the path and the computations, to the end of the mission.

    maximise    f(p, x) = Σ_s τ_s(p) v_s(x_s) + f_path(p)        over path parameters p and the computations' shares x
    subject to  Σ_s use_s(p, x_s) ≤ available(p)                  the state of charge, less reserve and margin
                0 ≤ x ≤ 1, p in its box

Inhibited stages, power limits and trade-offs shape the envelopes whose increments x fills, see `knapsack`.

The remaining time is a step function of p, one step per whole lap, and smooth on each step. A scan along each path
parameter finds the steps; at each point the optimal x has a closed form. From the best point the program climbs by
sequential QPs: f and use are linearised in p and x together, and a QP's solution is accepted only if its value is
greater and it lies on the same step; otherwise the trust region shrinks. A QP that fails ends the climb and is counted;
the best point of the scan stays the solution.

Source: letter, Sec. VI, which names this optimisation as future work.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import Infeasible, SolverFailed
from eadp.planning.joint.knapsack import FULL, Allocation, Increments, allocation_of, fill_greedy
from eadp.planning.qp import UNBOUNDED, QuadraticProgram

Shares = tuple[float, ...]
"""Path parameters as shares of their sets."""

COARSE, MAX_HALVINGS, MIN_BOUND_GAIN = 13, 60, 2e-5
"""A scan: points over a set, maximum halvings towards edges of steps, and minimum bound of the gain of a step."""

GRIDS, SEARCHED, MIN_STEP = {2: 11, 3: 5}, 3, 1e-3
"""Points per side of a grid over two or three path parameters, how many of its best points start a pattern search, and
the search's smallest step. More parameters are scanned one after the other."""

MAX_QPS, FIRST_REACH, MIN_REACH = 6, 0.1, 1e-5
DIFFERENCE = 1e-3
PROXIMALS, FALLBACK_PROXIMAL, MIN_COLUMN = (1e-3, 3e-2), 0.3, 1e-2
MIN_GAIN = 1e-7
SCANNED, SOLVED, CLOSED_FORM, INFEASIBLE = "scanned", "solved", "closed form", "infeasible"


@dataclass(frozen=True)
class Candidate:
    """The knapsack at given path parameters: increments and available state of charge.

    `shape` identifies the step that it lies on; `base_value` of the increments includes the path's value. Shortfalls
    that differ by less than `tolerance` are equivalent.
    """

    shares: Shares
    shape: tuple[int, ...]
    increments: Increments
    available: float
    tolerance: float = 0.0


@dataclass(frozen=True)
class Solution:
    """A solution of the program: candidate, allocation of the charge, QPs solved, and status.

    `failures` counts QPs without a solution.
    """

    candidate: Candidate
    allocation: Allocation
    qp_solves: int
    status: str
    failures: int = 0

    @property
    def value(self) -> float:
        """The objective."""
        return self.allocation.value

    @property
    def shortfall(self) -> float:
        """State of charge missing for the configurations of minimum power; 0 where it suffices."""
        return max(0.0, self.candidate.increments.base_use - self.candidate.available)


CandidateAt = Callable[[Shares], Candidate | None]
"""Candidate at path parameters; None where the plan cannot be flown at them."""


class _NoSlope(Exception):
    """A step is too narrow for finite differences, and the climb ends."""


def best_at(candidate: Candidate) -> Solution:
    """The optimal computations at given path parameters, in closed form."""
    allocation = fill_greedy(candidate.increments, candidate.available)
    return Solution(candidate, allocation, 0, CLOSED_FORM if allocation.feasible else INFEASIBLE)


@dataclass
class MissionProgram:
    """The program of one mission; OSQP is set up once for each number of variables.

    Parameters
    ----------
    dimensions : int
        Number of free path parameters.
    climb : bool
        Whether to climb by QPs from the best point of the scan.
    """

    dimensions: int
    climb: bool = True
    _programs: dict[tuple[int, float], QuadraticProgram] = field(default_factory=dict)

    def solve(self, candidate_at: CandidateAt, warm: Shares, threshold: float = -math.inf) -> Solution:
        """The optimal path parameters and computations.

        Parameters
        ----------
        candidate_at : function
        warm : tuple of float, shape (dimensions,)
            Starting point: the shares in force.
        threshold : float
            Value that a solution needs to be of use: the scan of one parameter skips steps whose bound is lower.

        Raises
        ------
        Infeasible
            If the plan cannot be flown at any path parameters that were tried.
        """
        known: dict[Shares, Solution | None] = {}

        def evaluate(shares: Shares) -> Solution | None:
            if shares not in known:
                candidate = candidate_at(shares)
                known[shares] = None if candidate is None else best_at(candidate)
            return known[shares]

        best = _better(evaluate(warm), None)
        if self.dimensions in GRIDS:
            best = _grid_search(evaluate, best, self.dimensions)
        else:
            for _ in range(2 if self.dimensions > 1 else 1):
                for axis in range(self.dimensions):
                    best = _scan(evaluate, best, warm, axis, threshold)
        if best is None:
            raise Infeasible("the plan cannot be flown at any path parameters")
        if not best.allocation.feasible:
            enough = best.shortfall + best.candidate.tolerance
            as_good = [solution for solution in known.values() if solution is not None and solution.shortfall <= enough]
            return max(as_good, key=lambda solution: solution.value) if math.isfinite(enough) else best
        if self.dimensions:
            best = Solution(best.candidate, best.allocation, 0, SCANNED)
        return self.climbed(candidate_at, best) if self.climb and self.dimensions else best

    def climbed(self, candidate_at: CandidateAt, start: Solution) -> Solution:
        """Climb from a solution by QPs; return the solution itself where they find no better one."""
        best, qp_solves, failures = start, 0, 0
        reach = FIRST_REACH
        while qp_solves < MAX_QPS and reach >= MIN_REACH:
            try:
                shares, x = self._qp_step(candidate_at, best, reach)
            except _NoSlope:
                break
            except (SolverFailed, Infeasible):
                failures += 1
                break
            qp_solves += 1
            trial = self._evaluate_step(candidate_at, shares, x, best)
            if trial is None or trial.value <= best.value:
                reach /= 4
                continue
            gained = trial.value - best.value
            best = trial
            if gained < MIN_GAIN:
                break
        status = SOLVED if qp_solves and not failures else start.status
        return Solution(best.candidate, best.allocation, qp_solves, status, failures)

    # --- QPs

    def _qp_step(self, candidate_at: CandidateAt, at: Solution, reach: float) -> tuple[Shares, FloatArray]:
        """One QP in path parameters and shares; return its solution."""
        candidate, increments, x = at.candidate, at.candidate.increments, at.allocation.shares
        d = self.dimensions
        gain, use = np.zeros(d + len(x)), np.zeros(d + len(x))
        gain[d:], use[d:] = increments.gain, increments.use
        lower, upper = np.zeros(d + len(x)), np.ones(d + len(x))
        for j in range(d):
            gain[j], use[j] = self._slope(candidate_at, at, j)
            lower[j] = -min(reach, candidate.shares[j])
            upper[j] = min(reach, 1.0 - candidate.shares[j])
        now = np.concatenate((np.zeros(d), x))
        moved = self._solve_qp(gain, use, candidate.available - increments.base_use, lower, upper, now)
        shares = tuple(
            min(1.0, max(0.0, share + step)) for share, step in zip(candidate.shares, moved[:d].tolist(), strict=True)
        )
        return shares, np.clip(moved[d:], 0.0, 1.0)

    def _solve_qp(
        self, gain: FloatArray, use: FloatArray, spare: float, lower: FloatArray, upper: FloatArray, now: FloatArray
    ) -> FloatArray:
        """max gain·z − ½ε|y − y_now|² subject to use·z ≤ spare within bounds, where y is z scaled by columns.

        Gain and use are scaled to 1, and each column by the larger of its two entries: a path parameter's are a hundred
        times those of a leg's computations, and unscaled, OSQP fails on one problem in two hundred. Where it fails with
        a small ε, it is run unscaled and with larger ones.
        """
        gain = gain / max(float(np.abs(gain).max()), 1e-300)
        largest_use = max(float(np.abs(use).max()), 1e-300)
        use = use / largest_use
        weights = np.maximum(np.maximum(np.abs(gain), np.abs(use)), MIN_COLUMN)

        def solved(proximal: float, *, scaled: bool) -> FloatArray:
            column = weights if scaled else np.ones(len(gain))
            return (
                self._program(len(gain), proximal).solve(
                    -gain / column - proximal * now * column,
                    np.vstack([use / column, np.eye(len(gain))]),
                    np.concatenate(([-UNBOUNDED], lower * column)),
                    np.concatenate(([max(spare, 0.0) / largest_use], upper * column)),
                    np.clip(now, lower, upper) * column,
                )
                / column
            )

        for proximal, scaled in itertools.product(PROXIMALS, (True, False)):
            with contextlib.suppress(SolverFailed):
                return solved(proximal, scaled=scaled)
        return solved(FALLBACK_PROXIMAL, scaled=False)

    def _program(self, variables: int, proximal: float) -> QuadraticProgram:
        if (variables, proximal) not in self._programs:
            filled_rows = np.vstack([np.ones((1, variables), dtype=bool), np.eye(variables, dtype=bool)])
            self._programs[variables, proximal] = QuadraticProgram(filled_rows, proximal)
        return self._programs[variables, proximal]

    def _slope(self, candidate_at: CandidateAt, at: Solution, axis: int) -> tuple[float, float]:
        """One-sided derivatives of value, and of use minus available charge, by a path parameter at fixed shares."""
        here, x = at.candidate, at.allocation.shares
        for step in (-DIFFERENCE, DIFFERENCE):
            share = here.shares[axis] + step
            if not 0.0 <= share <= 1.0:
                continue
            there = candidate_at((*here.shares[:axis], share, *here.shares[axis + 1 :]))
            if there is None or there.shape != here.shape or len(there.increments.use) != len(x):
                continue
            a, b = allocation_of(here.increments, x), allocation_of(there.increments, x)
            use = (b.use - there.available) - (a.use - here.available)
            return (b.value - a.value) / step, use / step
        raise _NoSlope

    def _evaluate_step(self, candidate_at: CandidateAt, shares: Shares, x: FloatArray, at: Solution) -> Solution | None:
        """The solution at a QP's path parameters: the better of the QP's shares, made feasible, and the closed form."""
        candidate = candidate_at(shares)
        if candidate is None or candidate.shape != at.candidate.shape:
            return None
        if candidate.increments.base_use > candidate.available + FULL:
            return None
        if len(x) != len(candidate.increments.use):
            return None
        own = allocation_of(candidate.increments, _within(candidate.increments, x, candidate.available))
        closed = fill_greedy(candidate.increments, candidate.available)
        return Solution(candidate, own if own.value >= closed.value else closed, 0, SOLVED)


def _within(increments: Increments, x: FloatArray, available: float) -> FloatArray:
    """Shares reduced until they are feasible, in ascending order of gain per charge."""
    excess = increments.base_use + float(increments.use @ x) - available
    if excess <= 0:
        return x
    x = x.copy()
    for i in np.argsort(increments.efficiency, kind="stable"):
        taken = float(increments.use[i] * x[i])
        if taken <= 0:
            continue
        if taken >= excess:
            x[i] -= excess / float(increments.use[i])
            break
        x[i] = 0.0
        excess -= taken
    return x


def _better(new: Solution | None, old: Solution | None) -> Solution | None:
    """The better of two: the feasible one, then the greater value; of two infeasible ones the smaller shortfall."""
    if new is None or old is None:
        return old if new is None else new
    if new.allocation.feasible != old.allocation.feasible:
        return new if new.allocation.feasible else old
    if not new.allocation.feasible:
        return new if new.shortfall < old.shortfall else old
    return new if new.value > old.value else old


def _grid_search(
    evaluate: Callable[[Shares], Solution | None], best: Solution | None, dimensions: int
) -> Solution | None:
    """The best of a grid over all path parameters, and of pattern searches from its best points.

    Parameters that compete for charge have their optimum along an edge that no search by a single one follows.

    Source: pattern search (Hooke and Jeeves 1961).
    """
    points = np.linspace(0.0, 1.0, GRIDS[dimensions]).tolist()
    found = [
        solution
        for shares in itertools.product(points, repeat=dimensions)
        if (solution := evaluate(shares)) is not None
    ]
    if best is not None:
        found.append(best)
    found.sort(
        key=lambda solution: (
            solution.allocation.feasible,
            solution.value if solution.allocation.feasible else -solution.shortfall,
        )
    )
    for start in found[-SEARCHED:]:
        own = start
        step = 0.5 / (GRIDS[dimensions] - 1)
        while own.allocation.feasible and step > MIN_STEP:
            centre = own.candidate.shares
            for moves in itertools.product((-step, 0.0, step), repeat=dimensions):
                there = tuple(min(1.0, max(0.0, c + move)) for c, move in zip(centre, moves, strict=True))
                own = _better(evaluate(there), own) or own
            if own.candidate.shares == centre:
                step /= 2
        best = _better(own, best)
    return best


def _scan(
    evaluate: Callable[[Shares], Solution | None], best: Solution | None, warm: Shares, axis: int, threshold: float
) -> Solution | None:
    """The best along one path parameter: over its set, then towards the edges of steps that could be better.

    Branch and bound: cells whose bound is below `threshold` are skipped.
    """
    base = best.candidate.shares if best is not None else warm

    def at(share: float) -> Solution | None:
        return evaluate((*base[:axis], share, *base[axis + 1 :]))

    points = sorted({*np.linspace(0.0, 1.0, COARSE).tolist(), base[axis]})
    found = [at(share) for share in points]
    for solution in found:
        best = _better(solution, best)
    if best is None:
        return None
    cells = list(itertools.pairwise(zip(points, found, strict=True)))
    rises = [
        abs(b.value - a.value) / (high - low)
        for (low, a), (high, b) in cells
        if a is not None and b is not None and _alike(a, b) and a.allocation.feasible
    ]
    slope = max(rises, default=1.0)
    queue = [
        (-_upper_bound(low, high, slope), i, low, high) for i, (low, high) in enumerate(cells) if _broken(low, high)
    ]
    heapq.heapify(queue)
    for count in range(len(cells), len(cells) + MAX_HALVINGS):
        if not queue or -queue[0][0] <= max(best.value + MIN_BOUND_GAIN, threshold):
            break
        _, _, low, high = heapq.heappop(queue)
        share = (low[0] + high[0]) / 2
        middle = share, at(share)
        best = _better(middle[1], best)
        assert best is not None
        for left, right in ((low, middle), (middle, high)):
            if right[0] - left[0] > MIN_REACH and _broken(left, right):
                heapq.heappush(queue, (-_upper_bound(left, right, slope), 2 * count + (left is middle), left, right))
    return best


_Point = tuple[float, Solution | None]


def _alike(a: Solution, b: Solution) -> bool:
    """Whether two solutions lie on one step, both feasible or both not."""
    return a.candidate.shape == b.candidate.shape and a.allocation.feasible == b.allocation.feasible


def _broken(low: _Point, high: _Point) -> bool:
    """Whether an edge of a step, or of the feasible set, lies between two points."""
    a, b = low[1], high[1]
    if a is None or b is None:
        return a is not b
    return not _alike(a, b)


def _upper_bound(low: _Point, high: _Point, slope: float) -> float:
    """Upper bound of the value between two points, if no step is steeper than those evaluated."""
    values = [solution.value for _, solution in (low, high) if solution is not None and solution.allocation.feasible]
    return max(values, default=-math.inf) + slope * (high[0] - low[0])
