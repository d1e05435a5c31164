"""One optimisation over the path and the computations, to the end of the mission.

    maximise    f(p, x) = Σ_s τ_s(p) v_s(x_s) + f_path(p)        over path parameters p and the computations' shares x
    subject to  Σ_s use_s(p, x_s) ≤ available(p)                  the state of charge, less reserve and margin
                0 ≤ x ≤ 1, p in its box

Inhibited stages, power limits and trade-offs shape the envelopes whose increments x fills, see `knapsack`.

The remaining time is a step function of p, one step per whole lap, and smooth on each step. A scan along each path
parameter finds the steps, with the optimal x at each point in closed form. On the best step OSQP decides: f and use are
linearised in p and x together, and QPs are solved in sequence while they gain. A QP's solution is accepted if its value
is greater and it lies on the same step; otherwise the trust region shrinks. Where p stays, one QP decides x.

The closed form at the final p certifies the solution: the gap is how much better it is. It is taken instead where the
gap exceeds 1e-6 of U, and where OSQP fails; both are counted. The last solution is kept without a QP where its
multiplier proves that nothing else gains more than 1e-7 of U under the new data.

Source: letter, Sec. VI, which names this optimisation as future work.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import Infeasible, SolverFailed
from eadp.planning.base import CLOSED_FORM, FALLBACK, INFEASIBLE, KEPT, NOTHING_TO_CHOOSE, SOLVED, SolverReport
from eadp.planning.joint.knapsack import FULL, Allocation, Increments, allocation_of, fill_greedy
from eadp.planning.qp import UNBOUNDED, QuadraticProgram

Shares = tuple[float, ...]
"""Path parameters as shares of their sets; one by blocks as two, for the first segment of laps and the others."""

Bracket = tuple[tuple[float, float], ...]
"""How far below and above a climb starts to look along each path parameter: part of the way to the next place that is
known to be no better."""

COARSE, MAX_HALVINGS, MIN_BOUND_GAIN = 13, 60, 2e-5
"""A scan: points over a set, maximum halvings towards edges of steps, and minimum bound of the gain of a step."""

GRIDS, SEARCHED, MIN_STEP = {2: 11, 3: 5}, 3, 1e-3
"""Points per side of a grid over two or three path parameters, how many of its best points start a pattern search, and
the search's smallest step. More parameters are scanned one after the other."""

MAX_QPS, FIRST_REACH, WITHIN, MIN_REACH, MIN_GAIN = 6, 0.1, 0.25, 1e-5, 1e-4
"""A climb: most QPs, how far the first may move, also as a share of the way to a place known to be no better, the
smallest distance that matters, and the least gain that a QP must promise for it to be tried."""

DIFFERENCE, MIN_COLUMN = 1e-3, 1e-6
PROXIMAL = (1e-4, 1e-3)
"""Weight of the proximal term, for a gradient scaled to 1: with the path kept, and with path parameters free."""

SIZES = 16
"""Problems without path parameters have a multiple of so many increments."""

TOLERANCE, DIGITS = 1e-7, 7
"""Tolerance of OSQP, and the digits of a path parameter's share that it gives."""

OUTDONE, KEPT_GAP = 1e-6, 1e-7
"""Gain of the closed form from which it is taken instead of the QP's solution, and largest gain that the last
solution's multiplier may leave open for it to be kept."""

TIE = 1e-3
"""Relative difference of gain per charge to the multiplier within which a QP's shares are kept."""

SAME = 1e-12
"""Difference of values, and of shortfalls, that is rounding: sums in another order must not choose another place."""

RECENTRED = 2
"""Maximum number of QPs with a proximal term around the last one's solution, where the gap is larger."""


class Candidate(NamedTuple):
    """The knapsack at given path parameters: increments and available state of charge.

    `shape` identifies the step that it lies on; `base_value` of the increments includes the path's value. Shortfalls
    that differ by less than `tolerance` are equivalent. `certain` is whether it is known where the flight ends.
    """

    shares: Shares
    shape: tuple[int, ...]
    increments: Increments
    available: float
    tolerance: float = 0.0
    certain: bool = True


class Place(NamedTuple):
    """A candidate in short, with its computations in closed form: what a scan compares.

    Attributes
    ----------
    shares, shape, certain, tolerance
        As of `Candidate`.
    feasible : bool
        Whether the charge suffices for the configurations of minimum power.
    value, use, available : float
        The objective, the use of charge at minimum power, and the charge that may be used.
    """

    shares: Shares
    shape: tuple[int, ...]
    certain: bool
    tolerance: float
    feasible: bool
    value: float
    use: float
    available: float

    @property
    def shortfall(self) -> float:
        """State of charge missing for the configurations of minimum power; 0 where it suffices."""
        return max(0.0, self.use - self.available)


class Solution(NamedTuple):
    """A solution of the program.

    Attributes
    ----------
    candidate : Candidate
    allocation : Allocation
        Allocation of the charge.
    status : str
        As in `DecisionRecord`.
    iterations : int
        Iterations of OSQP.
    gap : float or None
        How much better the closed form is at the same path parameters.
    bracket : tuple of (float, float)
        See `Bracket`; empty where it is not known.
    """

    candidate: Candidate
    allocation: Allocation
    status: str
    iterations: int = 0
    gap: float | None = None
    bracket: Bracket = ()

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

PlaceAt = Callable[[Shares], Place | None]
"""The same in short."""

Bound = Callable[[Shares], float]
"""Value that no computations exceed at path parameters. Between two values of one parameter it is at most the greater
of theirs."""


def _unbounded(_: Shares) -> float:
    return math.inf


class _NoSlope(Exception):
    """A step is too narrow for finite differences, and the climb ends."""


def best_at(candidate: Candidate) -> Solution:
    """The optimal computations at given path parameters, in closed form."""
    allocation = fill_greedy(candidate.increments, candidate.available)
    return Solution(candidate, allocation, CLOSED_FORM if allocation.feasible else INFEASIBLE)


def place_of(candidate: Candidate) -> Place:
    """A candidate in short."""
    shares, shape, increments, available, tolerance, certain = candidate
    found = fill_greedy(increments, available)
    return Place(shares, shape, certain, tolerance, found.feasible, found.value, increments.base_use, available)


class _Allocated(NamedTuple):
    """Shares of the increments and the multiplier of the charge, by a QP or kept, and its iterations."""

    x: FloatArray
    multiplier: float
    iterations: int

    def open_gain(self, increments: Increments, spare: float) -> float:
        """What any other shares gain at most: the Lagrangian bound λ spare + Σ max(0, gain − λ use), less the gain."""
        net = np.maximum(increments.gain - self.multiplier * increments.use, 0.0)
        return self.multiplier * spare + float(net.sum()) - float(increments.gain @ self.x)


class MissionProgram:
    """The program of one mission; OSQP is set up once for each number of variables.

    Parameters
    ----------
    dimensions : int
        Number of free path parameters.
    report : SolverReport, optional
        Counts the runs of OSQP.
    """

    def __init__(self, dimensions: int, report: SolverReport | None = None) -> None:
        self.dimensions = dimensions
        self.report = report or SolverReport()
        self._programs: dict[tuple[int, int], tuple[QuadraticProgram, FloatArray]] = {}
        self._last: _Allocated | None = None

    def solve(
        self,
        candidate_at: CandidateAt,
        warm: Shares,
        threshold: float = -math.inf,
        *,
        by_blocks: bool = False,
        bound: Bound = _unbounded,
    ) -> Solution:
        """The optimal path parameters and computations: `scanned`, then `decided`."""
        start = self.scanned(candidate_at, warm, threshold, by_blocks=by_blocks, bound=bound)
        return self.decided(candidate_at, start, movable=True)

    def scanned(
        self,
        candidate_at: CandidateAt,
        warm: Shares,
        threshold: float = -math.inf,
        *,
        by_blocks: bool = False,
        bound: Bound = _unbounded,
        place_at: PlaceAt | None = None,
    ) -> Solution:
        """The best point of the scan, with computations in closed form.

        Parameters
        ----------
        candidate_at : function
        warm : tuple of float, shape (dimensions,)
            Starting point: the shares in force.
        threshold : float
            Value that a solution needs to be of use: the scan of one parameter skips steps whose bound is lower.
        by_blocks : bool
            Whether the shares are of one parameter by blocks: first one value for all is sought, then each alone.
        bound : function, optional
            Places whose bound is no better than what is known are not looked at.
        place_at : function, optional
            Gives places in short; default: by `candidate_at`.

        Raises
        ------
        Infeasible
            If the plan cannot be flown at any path parameters that were tried.
        """
        known: dict[Shares, Place | None] = {}

        def evaluate(shares: Shares) -> Place | None:
            if shares not in known:
                if place_at is not None:
                    known[shares] = place_at(shares)
                else:
                    candidate = candidate_at(shares)
                    known[shares] = None if candidate is None else place_of(candidate)
            return known[shares]

        best, scan = _better(evaluate(warm), None), _Scan(evaluate, bound, threshold)
        if by_blocks:
            both = _Scan(lambda shares: evaluate(shares[:1] * 2), lambda shares: bound(shares[:1] * 2), threshold)
            best = both.best(best, warm, 0)
            # wider laps save less and less: extremes in turn may be better than a mean
            for share in (0.0, 1.0):
                own = evaluate((share, warm[1]))
                best = _better(scan.best(own, (share, warm[1]), 1), best)
            for axis in (0, 1):
                best = scan.best(best, warm, axis)
        elif self.dimensions in GRIDS:
            best = _grid_search(evaluate, best, self.dimensions)
        else:
            for _ in range(2 if self.dimensions > 1 else 1):
                for axis in range(self.dimensions):
                    best = scan.best(best, warm, axis)
        if best is None:
            raise Infeasible("the plan cannot be flown at any path parameters")
        enough = best.shortfall + best.tolerance
        if not best.feasible and math.isfinite(enough):
            as_good = [place for place in known.values() if place is not None and place.shortfall <= enough]
            for place in as_good:
                best = place if place.value > best.value + SAME else best
        candidate = candidate_at(best.shares)
        assert candidate is not None
        bracket = _bracket(best.shares, known) if self.dimensions and self.dimensions not in GRIDS else ()
        return best_at(candidate)._replace(bracket=bracket)

    def price(self, solution: Solution) -> float:
        """Value per charge of a little more charge in a solution: its multiplier; 0 where some is left over."""
        increments, shares = solution.candidate.increments, solution.allocation.shares
        missing = (shares < 1.0 - MIN_REACH) & (increments.use > 0.0)
        return float(increments.efficiency[missing].max(initial=0.0))

    # --- QPs

    def decided(self, candidate_at: CandidateAt, start: Solution, *, movable: bool) -> Solution:
        """The solution of OSQP from a point of the scan.

        Parameters
        ----------
        candidate_at : function
        start : Solution
            The point, with computations in closed form.
        movable : bool
            Whether the path parameters may move on their step.
        """
        if not start.allocation.feasible:
            return start
        movable = movable and self.dimensions > 0
        best, kept = start._replace(status=NOTHING_TO_CHOOSE), None
        try:
            if len(start.candidate.increments.use):
                kept = None if movable else self._kept(start.candidate)
                best = self._allocation(start, kept)
            elif not movable:
                return best
            if movable:
                best = self._climbed(candidate_at, best, start.bracket)
        except SolverFailed:
            self.report.fallbacks += 1
            self._last = None
            return start._replace(status=FALLBACK)
        closed = start.allocation
        if best.candidate is not start.candidate:
            closed = fill_greedy(best.candidate.increments, best.candidate.available)
        gap = float(closed.value - best.value)
        self.report.gaps.append(gap)
        if gap > OUTDONE:
            self.report.outdone += 1
            return Solution(best.candidate, closed, CLOSED_FORM, best.iterations, gap)
        if kept is not None:
            self.report.skipped += 1
        return best._replace(gap=gap)

    def _kept(self, candidate: Candidate) -> _Allocated | None:
        """The last solution, if it is feasible and its multiplier proves that it is optimal under the new data."""
        increments, spare = candidate.increments, candidate.available - candidate.increments.base_use
        last = self._tail(len(increments.use))
        if last is None or float(increments.use @ last.x) > spare + FULL:
            return None
        return last._replace(iterations=0) if last.open_gain(increments, spare) <= KEPT_GAP else None

    def _tail(self, count: int) -> _Allocated | None:
        """The last solution without the increments of legs flown since; None if there are more now."""
        if self._last is None or len(self._last.x) < count:
            return None
        return self._last._replace(x=self._last.x[len(self._last.x) - count :])

    def _allocation(self, at: Solution, kept: _Allocated | None) -> Solution:
        """The optimal computations at fixed path parameters, by a QP unless a kept solution is given."""
        increments, available = at.candidate.increments, at.candidate.available
        spare = max(available - increments.base_use, 0.0)
        found, centre = kept, self._tail(len(increments.use))
        if found is None:
            x = np.full(len(increments.use), 0.5) if centre is None else centre.x
            for _ in range(1 + RECENTRED):
                x, multiplier, iterations = self._solved(increments.gain, increments.use, spare, x, (), ())
                fitted = _fitted(increments, x, multiplier, available)
                # the efficiency of an increment taken in part is the multiplier
                mixed = np.flatnonzero((fitted > 0.0) & (fitted < 1.0) & (increments.use > 0.0))
                if len(mixed):
                    multiplier = float(increments.efficiency[mixed[0]])
                found = _Allocated(fitted, multiplier, iterations)
                if found.open_gain(increments, spare) <= OUTDONE:
                    break
        assert found is not None
        self._last = found
        allocation = allocation_of(increments, found.x)
        return Solution(at.candidate, allocation, KEPT if kept is not None else SOLVED, found.iterations)

    def _climbed(self, candidate_at: CandidateAt, start: Solution, bracket: Bracket) -> Solution:
        """Climb from a solution by QPs in path parameters and shares; the solution itself where they gain nothing."""
        best, d, reach = start, len(start.candidate.shares), FIRST_REACH
        below, above = np.array(bracket or [(FIRST_REACH, FIRST_REACH)] * d).T
        for _ in range(MAX_QPS):
            candidate, x = best.candidate, best.allocation.shares
            try:
                slopes = np.array([self._slope(candidate_at, best, axis) for axis in range(d)])
            except _NoSlope:
                break
            shares = np.array(candidate.shares)
            moved, multiplier, iterations = self._solved(
                np.concatenate((slopes[:, 0], candidate.increments.gain)),
                np.concatenate((slopes[:, 1], candidate.increments.use)),
                candidate.available - candidate.increments.base_use,
                np.concatenate((np.zeros(d), x)),
                np.minimum(reach, np.minimum(below, shares)).tolist(),
                np.minimum(reach, np.minimum(above, 1.0 - shares)).tolist(),
            )
            promised = slopes[:, 0] @ moved[:d] + candidate.increments.gain @ (moved[d:] - x)
            if promised < MIN_GAIN:
                break
            there = tuple(np.round(np.clip(shares + moved[:d], 0.0, 1.0), DIGITS).tolist())
            found = _Allocated(moved[d:], multiplier, iterations)
            trial = self._evaluated(candidate_at, there, found, best)
            if trial is None or trial.value <= best.value:
                reach = float(np.abs(moved[:d]).max()) / 4
            else:
                best = trial
        if best is start or not len(best.candidate.increments.use):
            return best
        return self._allocation(best, None)  # the last QP was linearised elsewhere

    def _solved(
        self,
        gain: FloatArray,
        use: FloatArray,
        spare: float,
        now: FloatArray,
        below: Sequence[float],
        above: Sequence[float],
    ) -> tuple[FloatArray, float, int]:
        """max gain·z − ½ε|y − y_now|² subject to use·z ≤ spare, where y is z scaled by columns.

        The first variables are moves of path parameters within −below and above, the others shares of increments.
        Returns z, the multiplier of the charge, and the iterations. An increment's column is scaled by its use: the row
        has entries of 1 then, whatever the leg. A path parameter's is scaled by the larger of its use and its gain.
        """
        paths, rest = len(below), len(gain) - len(below)
        use_size, gain_size = (float(np.abs(array[paths if rest else 0 :]).mean()) or 1.0 for array in (use, gain))
        # variables without effect, for increments of legs flown since: one program serves problems of many sizes
        spare_count = 0 if paths else -rest % SIZES
        first, count = paths + spare_count, paths + spare_count + rest
        gain, use, now = (
            np.concatenate((array[:paths], np.zeros(spare_count), array[paths:])) for array in (gain, use, now)
        )
        lower, upper = np.zeros(count), np.ones(count)
        lower[:paths], upper[:paths], upper[paths:first] = np.negative(below), above, 0.0
        column = np.abs(use) / use_size
        column[:paths] = np.maximum(column[:paths], np.abs(gain[:paths]) / gain_size)
        column = np.maximum(column, MIN_COLUMN)
        column[paths:first] = 1.0
        scaled = gain / column
        largest = float(np.abs(scaled).max()) or 1.0
        if (count, paths) not in self._programs:
            matrix = np.vstack([np.ones((1, count)), np.eye(count)])
            program = QuadraticProgram(matrix > 0, PROXIMAL[paths > 0], self.report, TOLERANCE)
            self._programs[count, paths] = program, matrix
        program, matrix = self._programs[count, paths]
        matrix[0] = use / (use_size * column)
        # a row that cannot bind would only slow OSQP down
        most = float(np.maximum(use * upper, use * lower).sum())
        room = UNBOUNDED if spare >= most else max(spare, 0.0) / use_size
        solution = program.solve(
            -scaled / largest,
            matrix,
            np.concatenate(([-UNBOUNDED], lower * column)),
            np.concatenate(([room], upper * column)),
            np.clip(now, lower, upper) * column,
        )
        z = solution.x / column
        multiplier = max(float(solution.multipliers[0]), 0.0) * largest / use_size
        return np.concatenate((z[:paths], z[first:])), multiplier, solution.iterations

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

    def _evaluated(self, candidate_at: CandidateAt, shares: Shares, found: _Allocated, at: Solution) -> Solution | None:
        """A QP's solution, made feasible at its path parameters; None if they lie on another step."""
        candidate = candidate_at(shares)
        if candidate is None or candidate.shape != at.candidate.shape:
            return None
        increments, available = candidate.increments, candidate.available
        if increments.base_use > available + FULL or len(found.x) != len(increments.use):
            return None
        own = allocation_of(increments, _fitted(increments, found.x, found.multiplier, available))
        return Solution(candidate, own, SOLVED, found.iterations)


def _fitted(increments: Increments, x: FloatArray, multiplier: float, available: float) -> FloatArray:
    """A QP's shares without its tolerance, within the charge.

    Increments that gain more than the multiplier for their charge are taken in full, those that gain less not at all;
    those within `TIE` of it as the QP mixes them. What that leaves of the charge goes to these, or is taken from the
    least efficient increments.
    """
    net, price = increments.gain - multiplier * increments.use, multiplier * increments.use
    ties = np.abs(net) <= TIE * price
    x = np.where(ties, np.clip(x, 0.0, 1.0), net > 0)
    spare = available - increments.base_use - float(increments.use @ x)
    order = np.argsort(increments.efficiency, kind="stable")
    if spare > 0:
        order = order[::-1][ties[order[::-1]]]
    for i in order.tolist():
        if spare == 0:
            break
        moved = min(1.0, max(0.0, x[i] + spare / float(increments.use[i]))) if increments.use[i] > 0 else x[i]
        spare -= float(increments.use[i]) * (moved - x[i])
        x[i] = moved
    return x


def _bracket(shares: Shares, known: Iterable[Shares]) -> Bracket:
    """The bracket of a place by those known that differ in one share alone."""
    bracket = [[FIRST_REACH, FIRST_REACH] for _ in shares]
    for place in known:
        differs = [axis for axis, (there, here) in enumerate(zip(place, shares, strict=True)) if there != here]
        if len(differs) == 1:
            (axis,) = differs
            side = place[axis] > shares[axis]
            bracket[axis][side] = min(bracket[axis][side], WITHIN * abs(place[axis] - shares[axis]))
    return tuple([(below, above) for below, above in bracket])


def _better(new: Place | None, old: Place | None) -> Place | None:
    """The better of two: the feasible one, then the greater value; of two infeasible ones the smaller shortfall.

    The old one stays where they are the same.
    """
    if new is None or old is None:
        return old if new is None else new
    if new.feasible != old.feasible:
        return new if new.feasible else old
    if not new.feasible:
        return new if new.shortfall < old.shortfall - SAME else old
    return new if new.value > old.value + SAME else old


def _grid_search(evaluate: PlaceAt, best: Place | None, dimensions: int) -> Place | None:
    """The best of a grid over all path parameters, and of pattern searches from its best points.

    Parameters that compete for charge have their optimum along an edge that no search by a single one follows.

    Source: pattern search (Hooke and Jeeves 1961).
    """
    points = np.linspace(0.0, 1.0, GRIDS[dimensions]).tolist()
    found = [
        place for shares in itertools.product(points, repeat=dimensions) if (place := evaluate(shares)) is not None
    ]
    if best is not None:
        found.append(best)
    found.sort(key=lambda place: (place.feasible, round(place.value if place.feasible else -place.shortfall, 11)))
    for start in found[-SEARCHED:]:
        own = start
        step = 0.5 / (GRIDS[dimensions] - 1)
        while own.feasible and step > MIN_STEP:
            centre = own.shares
            for moves in itertools.product((-step, 0.0, step), repeat=dimensions):
                there = tuple(min(1.0, max(0.0, c + move)) for c, move in zip(centre, moves, strict=True))
                own = _better(evaluate(there), own) or own
            if own.shares == centre:
                step /= 2
        best = _better(own, best)
    return best


class _Scan(NamedTuple):
    """Scans along one path parameter: over its set, then towards the edges of steps that could be better.

    Branch and bound: points and cells whose bound is no better than the best known, or than `threshold`, are skipped,
    and so are points between two that are short of the charge of more than a lap: one lap more or less is what the time
    varies by beside its trend.
    """

    evaluate: PlaceAt
    bound: Bound
    threshold: float

    def best(self, best: Place | None, warm: Shares, axis: int) -> Place | None:
        """The better of a place and the best along one parameter through it, or through `warm`."""
        base = best.shares if best is not None else warm

        def at(share: float) -> Place | None:
            return self.evaluate((*base[:axis], share, *base[axis + 1 :]))

        points = sorted({*np.linspace(0.0, 1.0, COARSE).tolist(), base[axis]})
        bounds = [self.bound((*base[:axis], share, *base[axis + 1 :])) for share in points]
        cells = list(itertools.pairwise(range(len(points))))
        found: dict[int, Place | None] = {}

        def look(i: int) -> Place | None:
            nonlocal best
            if i not in found:
                found[i] = at(points[i])
                best = _better(found[i], best)
            return found[i]

        last, skipped = len(points) - 1, set[int]()
        feasible = next((i for i in (points.index(base[axis]), 0, last) if _is_feasible(look(i))), None)
        for end in (0, last):
            if feasible is None or bounds[end] <= self._limit(best):
                continue
            near, far = feasible, end
            at_near, at_far = _beyond_a_lap(look(near)), _beyond_a_lap(look(end))
            # the point between where it is short of a lap, by the line through both
            while at_near <= 0 < at_far and abs(far - near) > 1:
                steps = round(at_near / (at_near - at_far) * abs(far - near))
                i = near + min(max(steps, 1), abs(far - near) - 1) * (1 if far > near else -1)
                short = _beyond_a_lap(look(i))
                near, at_near, far, at_far = (near, at_near, i, short) if short > 0 else (i, short, far, at_far)
            skipped.update(range(min(far, end) + 1, max(far, end)))
        # the cells that promise most come first: what they hold rules others out
        for cell in sorted(cells, key=lambda cell: -max(bounds[i] for i in cell)):
            if max(bounds[i] for i in cell) <= self._limit(best):
                break
            for i in cell:
                if i not in skipped:
                    look(i)
        if best is None:
            return None
        looked = [((points[i], found[i]), (points[j], found[j])) for i, j in cells if i in found and j in found]
        rises = [
            abs(b.value - a.value) / (high - low)
            for (low, a), (high, b) in looked
            # across an uncertain end the value falls as between steps
            if a is not None and b is not None and _alike(a, b) and a.feasible and a.certain and b.certain
        ]
        slope = max(rises, default=1.0)
        queue = [
            (-_upper_bound(low, high, slope), i, low, high)
            for i, (low, high) in enumerate(looked)
            if _broken(low, high)
        ]
        heapq.heapify(queue)
        for count in range(len(looked), len(looked) + MAX_HALVINGS):
            if not queue or -queue[0][0] <= max(best.value + MIN_BOUND_GAIN, self.threshold):
                break
            _, _, low, high = heapq.heappop(queue)
            share = (low[0] + high[0]) / 2
            middle = share, at(share)
            best = _better(middle[1], best)
            assert best is not None
            for left, right in ((low, middle), (middle, high)):
                if right[0] - left[0] > MIN_REACH and _broken(left, right):
                    entry = (-_upper_bound(left, right, slope), 2 * count + (left is middle), left, right)
                    heapq.heappush(queue, entry)
        return best

    def _limit(self, best: Place | None) -> float:
        """Value that a place has to exceed to be looked at."""
        if best is None or not best.feasible:
            return -math.inf
        return max(best.value, self.threshold)


_Point = tuple[float, Place | None]


def _is_feasible(at: Place | None) -> bool:
    return at is not None and at.feasible


def _beyond_a_lap(at: Place | None) -> float:
    """Charge that a place is short of, less that of a lap: a visit of each of its stages."""
    if at is None:
        return -MIN_REACH
    return at.use - at.available - at.use * len(set(at.shape)) / max(len(at.shape), 1)


def _alike(a: Place, b: Place) -> bool:
    """Whether two places lie on one step, both feasible or both not."""
    return a.shape == b.shape and a.feasible == b.feasible


def _broken(low: _Point, high: _Point) -> bool:
    """Whether an edge of a step, or of the feasible set, lies between two points."""
    a, b = low[1], high[1]
    if a is None or b is None:
        return a is not b
    return not _alike(a, b)


def _upper_bound(low: _Point, high: _Point, slope: float) -> float:
    """Upper bound of the value between two points, if no step is steeper than those evaluated."""
    values = [place.value for _, place in (low, high) if place is not None and place.feasible]
    return max(values, default=-math.inf) + slope * (high[0] - low[0])
