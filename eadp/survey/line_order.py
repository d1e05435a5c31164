"""The order and direction in which the lines of a coverage path are flown, so that its cost is least.

Lines are directed: 2i is line i forward and 2i + 1 is line i backward. The cost of going from the end of one to the
start of another is given, in metres or seconds, and may differ between the two directions. This is a travelling
salesman problem with two directions for each city. It is solved exactly by dynamic programming for few lines, and
otherwise by local search from the orders that farmers and surveyors use.

Source: Held and Karp, J. SIAM 10 (1962), for the exact order; Johnson and McGeoch, in Local Search in Combinatorial
Optimization (1997), for neighbour lists and iterated local search; Bochtis and Vougioukas, Biosystems Eng. 101 (2008),
for orders that skip lines so that turns are wide.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray

EXACT_LINES = 14
"""Up to this many lines `best_order` is exact."""

MAX_SKIP = 12
"""Largest distance, besides half the field, between consecutive lines in the orders of `_sequences`."""

NEIGHBOURS = 10
"""Number of the cheapest successors of a line that the local search tries."""

MAX_MOVED = 4
"""Largest number of consecutive lines that the local search moves elsewhere."""

MAX_SWAPPED = 8
"""Largest number of lines in each of the two runs that a perturbation swaps."""

MAX_PERTURBATIONS = 20_000
VISITS_PER_LINE = 500
MAX_VISITS = 50_000
"""Limits of the search: perturbations, and visits to a line; counted, not timed, so that results repeat.

Measured on fields of 15 to 80 lines, some in wind: within 1 % of what a general solver of routing problems finds in 10
s, in 0.3 s at most.
"""


class LineCosts(NamedTuple):
    """Costs of flying n lines in any order and direction [m or s].

    Attributes
    ----------
    between : array, shape (2n, 2n)
        From the end of directed line a to the start of directed line b; a line's to itself is not used.
    own : array, shape (2n,)
        Of each directed line itself.
    first, last : array, shape (2n,)
        From the point of departure to the start of each directed line, and from its end to the point of arrival; 0
        where these are free.
    """

    between: FloatArray
    own: FloatArray
    first: FloatArray
    last: FloatArray

    @property
    def lines(self) -> int:
        """The number of lines."""
        return len(self.own) // 2

    def with_total(self, order: list[int]) -> tuple[list[int], float]:
        """An order of directed lines, and its cost."""
        if not order:
            return order, 0.0
        at = np.asarray(order)
        ends = self.first[at[0]] + self.last[at[-1]]
        return order, float(ends + self.own[at].sum() + self.between[at[:-1], at[1:]].sum())


def best_order(costs: LineCosts) -> tuple[list[int], float]:
    """The order of lines of least cost: exact up to `EXACT_LINES`, by local search beyond.

    Returns
    -------
    order : list of int
        Directed lines, each line once. The same for the same costs.
    cost : float
        Its total.

    Source: see the module.
    """
    if costs.lines <= EXACT_LINES:
        return costs.with_total(_held_karp(costs))
    search = _Search(costs)
    return costs.with_total(search.improved(search.perturbed(search.improved(_initial_order(costs)))))


def quick_order(costs: LineCosts, known: list[int] | None = None) -> tuple[list[int], float]:
    """A good order at a tenth of the effort, to compare fields, headings or spacings with one another.

    Results are those of `best_order`; `known` is an order to improve.

    Notes
    -----
    The lines should be numbered across the field. Boustrophedon orders, orders that skip lines and orders in blocks are
    then those tried. Each has its best directions, and the cheapest is improved once.

    Source: Bochtis and Vougioukas 2008 for orders that skip.
    """
    if costs.lines < 2:
        return costs.with_total(_held_karp(costs))
    return costs.with_total(_Search(costs).improved(_initial_order(costs) if known is None else known))


# --- exactly ----------------------------------------------------------------------------------------------------------


def _held_karp(costs: LineCosts) -> list[int]:
    """The order of least cost, by dynamic programming over sets of lines: 2ⁿ n² steps."""
    n = costs.lines
    if n == 0:
        return []
    # least[e, s]: the smallest cost of flying the set s of lines (bit i is line i) with directed line e last
    # least[e, s + line(e)] = min_d (least[d, s] + cost[d, e]) + own[e]
    least = np.full((2 * n, 1 << n), np.inf)
    directed = np.arange(2 * n)
    least[directed, 1 << (directed // 2)] = costs.first + costs.own
    sets = np.arange(1 << n)
    sizes = (sets[:, np.newaxis] >> np.arange(n) & 1).sum(axis=1)
    for size in range(1, n):
        of_size = sets[sizes == size]
        for line in range(n):
            without = of_size[(of_size >> line) & 1 == 0]  # sets of this size without the line
            costs_before = least[:, without]
            for end in (2 * line, 2 * line + 1):
                cheapest = (costs_before + costs.between[:, end, np.newaxis]).min(axis=0)
                least[end, without | 1 << line] = cheapest + costs.own[end]
    # backwards from the best last line: its predecessor is the last line with which flying the others costs least
    order = [int(np.argmin(least[:, -1] + costs.last))]
    left = (1 << n) - 1
    while len(order) < n:
        left ^= 1 << (order[-1] // 2)
        order.append(int(np.argmin(least[:, left] + costs.between[:, order[-1]])))
    return order[::-1]


# --- initial orders ---------------------------------------------------------------------------------------------------


def _sequences(lines: int) -> IntArray:
    """Orders of lines 0..n−1 without directions, shape (k, n): each also from the field's other side, and backwards."""
    half = (lines + 1) // 2
    found: dict[tuple[int, ...], None] = {tuple(range(lines)): None}  # a set that keeps its order
    for skip in range(2, min(lines - 1, MAX_SKIP) + 1):
        for sequence in (_passes(lines, skip, False), _passes(lines, skip, True), _blocks(lines, 2 * skip)):
            found[tuple(sequence)] = None
    # wide skips: the field, or half of it, divided evenly into 1, 2, … blocks, down to the widths above
    for count in range(1, 1 + -(-lines // (2 * MAX_SKIP))):
        found[tuple(_blocks(lines, -(-lines // count)))] = None
        found[tuple(_passes(lines, -(-half // count), False))] = None
    one_side = np.array(list(found), dtype=np.intp)
    both_sides = np.concatenate([one_side, lines - 1 - one_side])
    return np.concatenate([both_sides, both_sides[:, ::-1]])


def _passes(lines: int, skip: int, back: bool) -> list[int]:
    """Every `skip`-th line from line 0, then from line 1, and so on; with `back`, every second pass is backwards."""
    passes = [range(start, lines, skip) for start in range(skip)]
    return [line for i, one in enumerate(passes) for line in (reversed(one) if back and i % 2 else one)]


def _blocks(lines: int, size: int) -> list[int]:
    """Blocks of lines, each flown as 0, k, 1, k + 1, … with k half the block."""
    order: list[int] = []
    for start in range(0, lines, size):
        block = range(start, min(start + size, lines))
        half = (len(block) + 1) // 2
        pairs = itertools.zip_longest(block[:half], block[half:])
        order += [line for pair in pairs for line in pair if line is not None]
    return order


def _best_directions(costs: LineCosts, sequences: IntArray) -> tuple[FloatArray, IntArray]:
    """The best directions for sequences of lines, shape (k, n), by dynamic programming.

    Returns the total cost of each sequence, shape (k,), and the direction of each of its lines, 0 forward and 1
    backward, shape (k, n).
    """
    count, n = sequences.shape
    directed = 2 * sequences[:, :, np.newaxis] + np.arange(2)
    # of the i-th line of each sequence in each direction: the best direction of the line before it, and the least cost
    # up to its end
    come_from = np.zeros((count, n, 2), dtype=np.intp)
    least = costs.first[directed[:, 0]] + costs.own[directed[:, 0]]
    rows = np.arange(count)
    for i in range(1, n):
        # cost up to the line before + turn, shape (k, from, to)
        step = least[:, :, np.newaxis] + costs.between[directed[:, i - 1, :, np.newaxis], directed[:, i, np.newaxis, :]]
        come_from[:, i] = step[:, 1] < step[:, 0]
        least = np.minimum(step[:, 0], step[:, 1]) + costs.own[directed[:, i]]
    least = least + costs.last[directed[:, -1]]
    chosen = np.empty((count, n), dtype=np.intp)
    chosen[:, -1] = least[:, 1] < least[:, 0]
    for i in range(n - 1, 0, -1):
        chosen[:, i - 1] = come_from[rows, i, chosen[:, i]]
    return least.min(axis=1), chosen


def _initial_order(costs: LineCosts) -> list[int]:
    """A directed order to start from: the cheapest of `_sequences`, in its best directions."""
    sequences = _sequences(costs.lines)
    totals, directions = _best_directions(costs, sequences)
    cheapest = int(totals.argmin())
    found: list[int] = (2 * sequences + directions)[cheapest].tolist()
    return found


# --- local search -----------------------------------------------------------------------------------------------------


class _Search:
    """Local search over directed orders: runs of lines are reversed, and short runs moved, reversed or not.

    `tour` is the order at positions 1..n, with the depot, directed line 2n, at both ends: departure at position 0,
    arrival at n + 1. A reversed run flies its lines and the turns between them in the other direction. What that costs
    more is a difference of `reversal_sums`, the running sum of `reversal_costs` over positions.

    For a directed line c, c >> 1 is its line and c ^ 1 its other direction. `table[a][b]` is the cost of going from a
    to b, `total` the tour's sum of it, and `position` where each line is in the tour. `after` lists, the cheapest
    first, the directed lines that may follow each one. `visits` counts the lines whose neighbourhood was improved: the
    effort.
    """

    def __init__(self, costs: LineCosts) -> None:
        self.lines = n = costs.lines
        self.depot = depot = 2 * n
        # what a line costs more than in its cheaper direction: half goes to the turn before it, half to the turn after
        extra = costs.own - np.minimum(costs.own[0::2], costs.own[1::2]).repeat(2)
        table = np.zeros((2 * n + 1, 2 * n + 1))
        table[:depot, :depot] = costs.between + (extra[:, np.newaxis] + extra) / 2
        table[depot, :depot] = costs.first + extra / 2
        table[:depot, depot] = costs.last + extra / 2
        self.table: list[list[float]] = table.tolist()
        backward = np.append(np.arange(2 * n) ^ 1, depot)
        # [a, b]: the extra cost of the turn from a to b when flown from b reversed to a reversed
        self.reversal_costs: list[list[float]] = (table[np.ix_(backward, backward)].T - table).tolist()
        square = table[:depot, :depot]
        # a line, in either direction, does not follow itself
        of_others = square + np.where(np.kron(np.eye(n), np.ones((2, 2))) > 0, np.inf, 0.0)
        count = min(NEIGHBOURS, 2 * n - 2)
        self.after: list[list[int]] = np.argsort(of_others, axis=1, kind="stable")[:, :count].tolist()
        self.after.append(np.argsort(table[depot, :depot], kind="stable").tolist())
        self.min_gain = 1e-8 * float(np.abs(square).max(initial=0.0))  # a smaller gain is rounding
        self.visits = 0

    def _set(self, tour: list[int]) -> None:
        """Go on from a tour, which is not changed."""
        self.tour, turns = tour, [*itertools.pairwise(tour)]
        self.total = sum(self.table[a][b] for a, b in turns)
        self.position = [0] * (self.lines + 1)
        for i, directed in enumerate(tour[:-1]):
            self.position[directed >> 1] = i
        self.reversal_sums = [*itertools.accumulate((self.reversal_costs[a][b] for a, b in turns), initial=0.0)]

    def improved(self, order: Sequence[int]) -> list[int]:
        """The order once no move improves it: never worse."""
        self._set([self.depot, *order, self.depot])
        before = math.inf
        while self.total < before - self.min_gain:  # until a pass over all lines finds nothing
            before = self.total
            self._descend(range(self.lines + 1))
        return self.tour[1:-1]

    def perturbed(self, order: Sequence[int]) -> list[int]:
        """The best order found by iterated local search from perturbations of the best so far: never worse than it.

        A perturbation swaps two runs that follow one another, each reversed or not. Their place, their lengths and
        whether they are reversed are drawn.
        """
        n = self.lines
        self._set([self.depot, *order, self.depot])
        longest = max(1, min(n // 3, MAX_SWAPPED))
        draws = np.random.default_rng(0).random((MAX_PERTURBATIONS, 5)).tolist()
        for where, left, right, *reverses in draws:
            if self.visits >= min(MAX_VISITS, VISITS_PER_LINE * n):
                break
            total, tour = self.total, self.tour
            left, right = 1 + int(left * longest), 1 + int(right * longest)
            start = 1 + int(where * (n + 1 - left - right))
            middle, end = start + left, start + left + right
            runs = tour[start:middle], tour[middle:end]
            one, two = (_reversed(run) if share < 0.5 else run for run, share in zip(runs, reverses, strict=True))
            self._set([*tour[:start], *two, *one, *tour[end:]])
            self._descend(tour[i] >> 1 for cut in (start, middle, end) for i in (cut - 1, cut))
            if self.total > total + self.min_gain:  # taken back; an equal order is kept, to cross plateaus
                self._set(tour)
        return self.tour[1:-1]

    def _descend(self, lines: Iterable[int]) -> None:
        """Improve the neighbourhood of lines until no move is left; line n stands for departure."""
        queue = [*dict.fromkeys(lines)]
        while queue:
            line = queue.pop()
            self.visits += 1
            while touched := self._improve(self.position[line]):
                queue += [each for each in dict.fromkeys(touched) if each != line and each not in queue]

    def _improve(self, i: int) -> list[int]:
        """Replace the successor of position i by a cheaper one, if that pays; the lines beside what has changed.

        The directed line a stands at position i, and c is a candidate for its new successor. The line of c stands at
        position j, in a direction d. Where d is c, a short run from d to e is moved behind a. Where d is c ^ 1, the
        other direction, a run is reversed so that c comes behind a: that of all lines between, or a short one from d
        to e that is also moved. In the tour b stands after a, y before the run and f after it. `gain` is what the turns
        changed so far save. Candidates are sorted by cost: the first one whose turn alone saves nothing ends the
        search.
        """
        tour, table, reversal_sums, min_gain = self.tour, self.table, self.reversal_sums, self.min_gain
        a, b = tour[i], tour[i + 1]
        for c in self.after[a]:
            gain = table[a][b] - table[a][c]
            if gain <= min_gain:
                break
            j = self.position[c >> 1]
            if tour[j] == c:  # c..e comes between a and b
                y = tour[j - 1]
                gain += table[y][c]
                for k in range(j, min(j + MAX_MOVED, len(tour) - 1 if j > i else i)):
                    e, f = tour[k], tour[k + 1]
                    if gain + table[e][f] - table[y][f] - table[e][b] > min_gain:
                        return self._move(j, k, i, tour[j : k + 1])
                continue
            d, f = tour[j], tour[j + 1]
            gain += table[d][f]
            if j > i and gain - table[b ^ 1][f] - reversal_sums[j] + reversal_sums[i + 1] > min_gain:
                return self._move(i + 1, j, i, _reversed(tour[i + 1 : j + 1]))
            for k in range(j, max(j - MAX_MOVED, i + 1 if j > i else 0), -1):  # e..d reversed comes between a and b
                e, y = tour[k], tour[k - 1]
                moved = table[y][e] - table[y][f] - table[e ^ 1][b] - reversal_sums[j] + reversal_sums[k]
                if gain + moved > min_gain:
                    return self._move(k, j, i, _reversed(tour[k : j + 1]))
        return []

    def _move(self, start: int, end: int, after: int, run: list[int]) -> list[int]:
        """Write the run at positions start..end, as it is then, behind a position; return the lines beside the cuts."""
        tour = self.tour
        if after < start:
            self._set([*tour[: after + 1], *run, *tour[after + 1 : start], *tour[end + 1 :]])
        else:
            self._set([*tour[:start], *tour[end + 1 : after + 1], *run, *tour[after + 1 :]])
        return [tour[i] >> 1 for cut in (start, end + 1, after + 1) for i in (cut - 1, cut)]


def _reversed(run: list[int]) -> list[int]:
    """A run of lines reversed: the last first, each in its other direction."""
    return [line ^ 1 for line in reversed(run)]
