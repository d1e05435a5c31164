"""One optimisation over the path and the computations, to the end of the mission.

    maximise    f(p, x) = Σ_s τ_s(p) v_s(x_s) + f_path(p)        over path parameters p and the computations' shares x
    subject to  Σ_s use_s(p, x_s) ≤ available(p)                  the state of charge, less reserve and margin
                0 ≤ x ≤ 1, p in its box

Inhibited stages, power limits and trade-offs shape the menus that x fills, see `allocation`.

The time that remains is a staircase in p: whole laps. On a step of it everything is smooth. Steps are found by a scan
along each path parameter, in which the best x is told in closed form; from the best of it the program climbs by QPs:
f and use linearised in p and x together, solved, evaluated, taken only where it is better and stays on its step, else
with a shorter reach. A QP that fails ends the climb and is counted; what the scan has found stands.

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
"""Path parameters as shares of their boxes."""

COARSE, MOST_HALVINGS, LEAST_PROMISE = 13, 60, 2e-5
"""A scan: places over a box, halvings towards edges of steps, and what a step must promise to be looked at."""

GRIDS, SEARCHED, LEAST_STEP = {2: 11, 3: 5}, 3, 1e-3
"""Places a side of a grid over two or three path parameters, how many of its best are searched round, and how finely.
More parameters are scanned one after the other."""

PASSES, FIRST_REACH, LEAST_REACH = 6, 0.1, 1e-5
DIFFERENCE = 1e-3
PROXIMALS, FIRMEST, LEAST_COLUMN = (1e-3, 3e-2), 0.3, 1e-2
LEAST_GAIN = 1e-7
SCANNED, SOLVED, CLOSED_FORM, INFEASIBLE = "scanned", "solved", "closed form", "infeasible"


@dataclass(frozen=True)
class Candidate:
    """The rest of the mission at some path parameters: what its computations may take and give, and what there is.

    `shape` tells on which step of the staircase it lies; `least_value` of the steps holds what the path is worth.
    A state of charge that is short by `tolerance` more or less makes no difference.
    """

    shares: Shares
    shape: tuple[int, ...]
    steps: Increments
    available: float
    tolerance: float = 0.0


@dataclass(frozen=True)
class Solution:
    """The best that was found: where, how the charge is allocated, and how it was found.

    `failures` counts QPs that had no answer; `short` is the state of charge that lacks where nothing is feasible.
    """

    prospect: Candidate
    allocation: Allocation
    passes: int
    status: str
    failures: int = 0

    @property
    def value(self) -> float:
        """The objective."""
        return self.allocation.value

    @property
    def short(self) -> float:
        """State of charge that lacks, 0 where it is enough."""
        return max(0.0, self.prospect.steps.least_use - self.prospect.available)


Outlook = Callable[[Shares], Candidate | None]
"""Prospects at path parameters; None where the plan cannot be flown at them."""


class _NoSlope(Exception):
    """A step of the staircase is too narrow to tell how it slopes: there is nothing to climb."""


def best_at(prospect: Candidate) -> Solution:
    """The best computations at given path parameters, in closed form."""
    allocation = fill_greedy(prospect.steps, prospect.available)
    return Solution(prospect, allocation, 0, CLOSED_FORM if allocation.feasible else INFEASIBLE)


@dataclass
class MissionProgram:
    """The program of one mission; OSQP's problems are built once for each number of variables.

    Parameters
    ----------
    dimensions : int
        Number of path parameters that leave a choice.
    climb : bool
        Whether to climb by QPs from the scan's best.
    """

    dimensions: int
    climb: bool = True
    _programs: dict[tuple[int, float], QuadraticProgram] = field(default_factory=dict)

    def solve(self, outlook: Outlook, warm: Shares, least: float = -math.inf) -> Solution:
        """The best path parameters and computations.

        Parameters
        ----------
        outlook : function
        warm : tuple of float, shape (dimensions,)
            Where to begin: the last plan's.
        least : float
            What an answer has to be worth to be of use: along one parameter no step that promises less is looked for.

        Raises
        ------
        Infeasible
            If the plan cannot be flown at any path parameters that were tried.
        """
        known: dict[Shares, Solution | None] = {}

        def look(shares: Shares) -> Solution | None:
            if shares not in known:
                prospect = outlook(shares)
                known[shares] = None if prospect is None else best_at(prospect)
            return known[shares]

        best = _better(look(warm), None)
        if self.dimensions in GRIDS:
            best = _gridded(look, best, self.dimensions)
        else:
            for _ in range(2 if self.dimensions > 1 else 1):
                for axis in range(self.dimensions):
                    best = _scanned(look, best, warm, axis, least)
        if best is None:
            raise Infeasible("the plan cannot be flown at any path parameters")
        if not best.allocation.feasible:
            enough = best.short + best.prospect.tolerance
            as_good = [answer for answer in known.values() if answer is not None and answer.short <= enough]
            return max(as_good, key=lambda answer: answer.value) if math.isfinite(enough) else best
        if self.dimensions:
            best = Solution(best.prospect, best.allocation, 0, SCANNED)
        return self.climbed(outlook, best) if self.climb and self.dimensions else best

    def climbed(self, outlook: Outlook, start: Solution) -> Solution:
        """From an answer upwards by QPs; the answer itself where they find nothing better."""
        best, passes, failures = start, 0, 0
        reach = FIRST_REACH
        while passes < PASSES and reach >= LEAST_REACH:
            try:
                shares, x = self._pass(outlook, best, reach)
            except _NoSlope:
                break
            except (SolverFailed, Infeasible):
                failures += 1
                break
            passes += 1
            trial = self._evaluated(outlook, shares, x, best)
            if trial is None or trial.value <= best.value:
                reach /= 4
                continue
            gained = trial.value - best.value
            best = trial
            if gained < LEAST_GAIN:
                break
        status = SOLVED if passes and not failures else start.status
        return Solution(best.prospect, best.allocation, passes, status, failures)

    def allocated(self, prospect: Candidate, warm: FloatArray | None = None) -> Solution:
        """The computations at given path parameters by QPs alone, in sequence until shares stop moving.

        Parameters
        ----------
        prospect : Prospect
        warm : array, optional
            Shares to begin from.
        """
        steps = prospect.steps
        if steps.least_use > prospect.available + FULL or not len(steps.use):
            return best_at(prospect)
        x = warm if warm is not None and len(warm) == len(steps.use) else np.zeros(len(steps.use))
        best = allocation_of(steps, np.zeros(len(steps.use)))
        passes = 0
        for _ in range(PASSES):
            try:
                moved = self._allocation_pass(prospect, x)
            except (SolverFailed, Infeasible):
                closed = best_at(prospect)
                return Solution(prospect, closed.allocation, passes, closed.status, 1)
            passes += 1
            trial = allocation_of(steps, _within(steps, moved, prospect.available))
            still = float(np.abs(moved - x).max()) < 1e-6
            x = moved
            if trial.value > best.value:
                best = trial
            if still:
                break
        return Solution(prospect, best, passes, SOLVED)

    # --- QPs

    def _pass(self, outlook: Outlook, at: Solution, reach: float) -> tuple[Shares, FloatArray]:
        """One QP in path parameters and shares, both as where to go."""
        prospect, steps, x = at.prospect, at.prospect.steps, at.allocation.shares
        d = self.dimensions
        gain, use = np.zeros(d + len(x)), np.zeros(d + len(x))
        gain[d:], use[d:] = steps.gain, steps.use
        lower, upper = np.zeros(d + len(x)), np.ones(d + len(x))
        for j in range(d):
            gain[j], use[j] = self._slope(outlook, at, j)
            lower[j] = -min(reach, prospect.shares[j])
            upper[j] = min(reach, 1.0 - prospect.shares[j])
        now = np.concatenate((np.zeros(d), x))
        moved = self._solved(gain, use, prospect.available - steps.least_use, lower, upper, now)
        shares = tuple(
            min(1.0, max(0.0, share + step)) for share, step in zip(prospect.shares, moved[:d].tolist(), strict=True)
        )
        return shares, np.clip(moved[d:], 0.0, 1.0)

    def _allocation_pass(self, prospect: Candidate, x: FloatArray) -> FloatArray:
        steps = prospect.steps
        ends = np.zeros(len(x)), np.ones(len(x))
        moved = self._solved(steps.gain, steps.use, prospect.available - steps.least_use, *ends, x)
        return np.clip(moved, 0.0, 1.0)

    def _solved(
        self, gain: FloatArray, use: FloatArray, spare: float, lower: FloatArray, upper: FloatArray, now: FloatArray
    ) -> FloatArray:
        """max gain·z − ½ε|y − y_now|² subject to use·z ≤ spare within bounds, y being z by columns that weigh the same.

        Gain and use are scaled to 1, and each column by the larger of its own two: a path parameter's are a hundred
        times those of a leg's computations, and unscaled OSQP did not come to an end with one problem in two hundred.
        Where it does not with a small ε, it is asked again with a larger one, which it does easily, and unscaled.
        """
        gain = gain / max(float(np.abs(gain).max()), 1e-300)
        most_use = max(float(np.abs(use).max()), 1e-300)
        use = use / most_use
        weights = np.maximum(np.maximum(np.abs(gain), np.abs(use)), LEAST_COLUMN)

        def solved(proximal: float, *, scaled: bool) -> FloatArray:
            column = weights if scaled else np.ones(len(gain))
            return (
                self._program(len(gain), proximal).solve(
                    -gain / column - proximal * now * column,
                    np.vstack([use / column, np.eye(len(gain))]),
                    np.concatenate(([-UNBOUNDED], lower * column)),
                    np.concatenate(([max(spare, 0.0) / most_use], upper * column)),
                    np.clip(now, lower, upper) * column,
                )
                / column
            )

        for proximal, scaled in itertools.product(PROXIMALS, (True, False)):
            with contextlib.suppress(SolverFailed):
                return solved(proximal, scaled=scaled)
        return solved(FIRMEST, scaled=False)

    def _program(self, variables: int, proximal: float) -> QuadraticProgram:
        if (variables, proximal) not in self._programs:
            filled_rows = np.vstack([np.ones((1, variables), dtype=bool), np.eye(variables, dtype=bool)])
            self._programs[variables, proximal] = QuadraticProgram(filled_rows, proximal)
        return self._programs[variables, proximal]

    def _slope(self, outlook: Outlook, at: Solution, axis: int) -> tuple[float, float]:
        """How value, and use less what is available, change with a path parameter at fixed shares: one-sided."""
        here, x = at.prospect, at.allocation.shares
        for step in (-DIFFERENCE, DIFFERENCE):
            share = here.shares[axis] + step
            if not 0.0 <= share <= 1.0:
                continue
            there = outlook((*here.shares[:axis], share, *here.shares[axis + 1 :]))
            if there is None or there.shape != here.shape or len(there.steps.use) != len(x):
                continue
            a, b = allocation_of(here.steps, x), allocation_of(there.steps, x)
            use = (b.use - there.available) - (a.use - here.available)
            return (b.value - a.value) / step, use / step
        raise _NoSlope

    def _evaluated(self, outlook: Outlook, shares: Shares, x: FloatArray, at: Solution) -> Solution | None:
        """What a QP's answer is really worth: its shares, cut to the charge that there is, or the closed form's."""
        prospect = outlook(shares)
        if prospect is None or prospect.shape != at.prospect.shape:
            return None
        if prospect.steps.least_use > prospect.available + FULL:
            return None
        if len(x) != len(prospect.steps.use):
            return None
        own = allocation_of(prospect.steps, _within(prospect.steps, x, prospect.available))
        closed = fill_greedy(prospect.steps, prospect.available)
        return Solution(prospect, own if own.value >= closed.value else closed, 0, SOLVED)


def _within(steps: Increments, x: FloatArray, available: float) -> FloatArray:
    """Shares taken back until the charge is enough: those of least gain per charge first."""
    excess = steps.least_use + float(steps.use @ x) - available
    if excess <= 0:
        return x
    x = x.copy()
    for i in np.argsort(steps.efficiency, kind="stable"):
        taken = float(steps.use[i] * x[i])
        if taken <= 0:
            continue
        if taken >= excess:
            x[i] -= excess / float(steps.use[i])
            break
        x[i] = 0.0
        excess -= taken
    return x


def _better(new: Solution | None, old: Solution | None) -> Solution | None:
    """The better of two: a feasible one, then by value; of two that are not, the one that lacks less."""
    if new is None or old is None:
        return old if new is None else new
    if new.allocation.feasible != old.allocation.feasible:
        return new if new.allocation.feasible else old
    if not new.allocation.feasible:
        return new if new.short < old.short else old
    return new if new.value > old.value else old


def _gridded(look: Callable[[Shares], Solution | None], best: Solution | None, dimensions: int) -> Solution | None:
    """The best of a grid over all path parameters, and of searches from its best places with steps that are halved.

    Parameters that compete for charge are best along an edge that no search by one of them alone goes along.

    Source: pattern search (Hooke and Jeeves 1961).
    """
    places = np.linspace(0.0, 1.0, GRIDS[dimensions]).tolist()
    found = [answer for shares in itertools.product(places, repeat=dimensions) if (answer := look(shares)) is not None]
    if best is not None:
        found.append(best)
    found.sort(
        key=lambda answer: (answer.allocation.feasible, answer.value if answer.allocation.feasible else -answer.short)
    )
    for start in found[-SEARCHED:]:
        own = start
        step = 0.5 / (GRIDS[dimensions] - 1)
        while own.allocation.feasible and step > LEAST_STEP:
            centre = own.prospect.shares
            for moves in itertools.product((-step, 0.0, step), repeat=dimensions):
                there = tuple(min(1.0, max(0.0, c + move)) for c, move in zip(centre, moves, strict=True))
                own = _better(look(there), own) or own
            if own.prospect.shares == centre:
                step /= 2
        best = _better(own, best)
    return best


def _scanned(
    look: Callable[[Shares], Solution | None], best: Solution | None, warm: Shares, axis: int, least: float
) -> Solution | None:
    """The best along one path parameter: over its box, then up to the edges of those steps that could be better.

    Branch and bound: no step is looked at that could not be worth `least`.
    """
    base = best.prospect.shares if best is not None else warm

    def at(share: float) -> Solution | None:
        return look((*base[:axis], share, *base[axis + 1 :]))

    places = sorted({*np.linspace(0.0, 1.0, COARSE).tolist(), base[axis]})
    found = [at(share) for share in places]
    for answer in found:
        best = _better(answer, best)
    if best is None:
        return None
    cells = list(itertools.pairwise(zip(places, found, strict=True)))
    rises = [
        abs(b.value - a.value) / (high - low)
        for (low, a), (high, b) in cells
        if a is not None and b is not None and _alike(a, b) and a.allocation.feasible
    ]
    slope = max(rises, default=1.0)
    queue = [(-_promise(low, high, slope), i, low, high) for i, (low, high) in enumerate(cells) if _broken(low, high)]
    heapq.heapify(queue)
    for count in range(len(cells), len(cells) + MOST_HALVINGS):
        if not queue or -queue[0][0] <= max(best.value + LEAST_PROMISE, least):
            break
        _, _, low, high = heapq.heappop(queue)
        share = (low[0] + high[0]) / 2
        middle = share, at(share)
        best = _better(middle[1], best)
        assert best is not None
        for left, right in ((low, middle), (middle, high)):
            if right[0] - left[0] > LEAST_REACH and _broken(left, right):
                heapq.heappush(queue, (-_promise(left, right, slope), 2 * count + (left is middle), left, right))
    return best


_Place = tuple[float, Solution | None]


def _alike(a: Solution, b: Solution) -> bool:
    """Whether two answers lie on one step of the staircase, both feasible or both not."""
    return a.prospect.shape == b.prospect.shape and a.allocation.feasible == b.allocation.feasible


def _broken(low: _Place, high: _Place) -> bool:
    """Whether an edge of a step, or of what is feasible, lies between two places."""
    a, b = low[1], high[1]
    if a is None or b is None:
        return a is not b
    return not _alike(a, b)


def _promise(low: _Place, high: _Place, slope: float) -> float:
    """What could at most be found between two places, steps being no steeper than those seen."""
    values = [answer.value for _, answer in (low, high) if answer is not None and answer.allocation.feasible]
    return max(values, default=-math.inf) + slope * (high[0] - low[0])
