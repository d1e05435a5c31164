"""Oracle of the horizon's integers: branch and bound over every choice at every step."""

from bisect import bisect_left, bisect_right
from functools import cached_property

import numpy as np

SAME = 1e-10
"""Relative tolerance of equal objectives."""

WORK = 2_000_000
"""Maximum number of steps that the search visits."""


def best_levels(table, soc):
    """The greatest value of any feasible choices, and whether that is certain; −inf where nothing is feasible.

    `table` has the value of each choice at each step, the charge that it takes, and the charge that its power requires;
    choices are in ascending order of power.
    """
    drop = table.drop
    beyond = drop - drop[:, :1]
    needed = table.limit + beyond + np.cumsum(drop[:, 0])[:, None]
    later = np.maximum.accumulate(needed[::-1, 0])[::-1]
    if not later[0] <= soc:
        return -np.inf, True
    # minimum power must stay feasible: a choice needs the charge of the later steps, and its own use
    needed[:-1] = np.maximum(needed[:-1], later[1:, None] + beyond[:-1])
    top = np.maximum.accumulate(table.value, axis=1)
    needed = np.maximum.accumulate(needed, axis=1)
    _, value, whole = Search(needed.tolist(), beyond.tolist(), top.tolist()).best(soc)
    return value, whole


class Search:
    """Branch and bound over the choices at each step.

    Parameters
    ----------
    needed, beyond, top : tables of M rows, one entry for each choice, in order of power
        Charge that each needs, and its use of that; running maximum of the value. The first two ascend along a row.

    A choice of no greater value than one of less power is dominated: `top` shows which are not.
    """

    def __init__(self, needed, beyond, top):
        self._needed, self._beyond, self._top = needed, beyond, top

    def best(self, charge):
        """One index for each step, their value, and whether it is certified as optimal.

        The usual case ends with the first descent, which meets the bound.
        """
        made, value = self._descent(charge)
        enough = value + SAME * abs(value)
        if self._bound(0, charge, enough) <= enough:
            return made, value, True
        return self._branched(charge, made, value)

    def _descent(self, charge):
        """Greedy: at each step the choice of greatest value that the charge admits."""
        made, value = [], 0.0
        for needed, beyond, top in zip(self._needed, self._beyond, self._top, strict=True):
            i = bisect_left(top, top[bisect_right(needed, charge) - 1])
            made.append(i)
            value += top[i]
            charge -= beyond[i]
        return made, value

    def _bound(self, first, charge, enough):
        """Upper bound of the value of the steps from `first` on, or a number up to `enough` if that is less.

        At first each step is bounded as if those before it had used nothing. A plan better than `enough` forgoes at
        most the difference and so uses almost as much charge, which tightens the bound.
        """
        steps = range(first, len(self._needed))
        bound = spared = np.inf
        while True:
            total, left = 0.0, charge
            for k in steps:
                needed, top = self._needed[k], self._top[k]
                i = bisect_right(needed, min(charge, left + spared)) - 1
                if i < 0:
                    return -np.inf
                total += top[i]
                left -= self._beyond[k][bisect_left(top, top[i])]
            if total <= enough or bound - total < 1e-3 * (bound - enough):
                return total
            bound, spared = total, self._charge_per_value * (total - enough)

    @cached_property
    def _charge_per_value(self):
        """Largest charge saved per value forgone, at any step."""
        rate = 0.0
        for beyond, top in zip(self._beyond, self._top, strict=True):
            last = 0
            for i in range(1, len(top)):
                if top[i] > top[last]:
                    rate = max(rate, (beyond[i] - beyond[last]) / (top[i] - top[last]))
                    last = i
        return rate

    def _branched(self, charge, made, best):
        """A plan of greater value, if there is one: depth first, from the choices of greatest value down."""
        steps, work = len(self._needed), 0
        stack = [((), charge, 0.0)]
        while stack and work < WORK:
            work += steps
            chain, charge, value = stack.pop()
            m = len(chain)
            enough = best + SAME * abs(best) - value
            if self._bound(m, charge, enough) <= enough:
                continue
            if m == steps:
                made, best = [*chain], value
                continue
            top, branches = self._top[m], []
            i = bisect_right(self._needed[m], charge) - 1
            while i >= 0:
                i = bisect_left(top, top[i])
                branches.append(((*chain, i), charge - self._beyond[m][i], value + top[i]))
                i -= 1
            stack.extend(reversed(branches))
        return made, best, not stack
