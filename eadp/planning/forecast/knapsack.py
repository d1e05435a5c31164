"""Fractional multiple-choice knapsack: the computations of each leg within the remaining state of charge.

Each leg has the increments of its envelope, from one vertex to the next, with a use of charge and a gain. Filling them
in descending order of gain per charge is optimal, as concavity keeps each leg's increments in order.

Source: Dantzig 1957 for the greedy filling, Sinha and Zoltners 1979 for multiple choice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray

FULL = 1e-9
"""A shortfall of charge below this counts as none."""


class Knapsack(NamedTuple):
    """The knapsacks of some places, side by side.

    Attributes
    ----------
    use, gain : array, shape (legs, steps)
        State of charge that each increment takes, and what it adds to the objective; 0 where there is none.
    place : array of int, shape (legs,)
        The place that each leg belongs to.
    base_use, base_value, available : array, shape (places,)
        Use and value with every leg at minimum power, and the state of charge that may be used.
    """

    use: FloatArray
    gain: FloatArray
    place: IntArray
    base_use: FloatArray
    base_value: FloatArray
    available: FloatArray

    @property
    def spare(self) -> FloatArray:
        """State of charge beyond minimum power, shape (places,)."""
        return self.available - self.base_use

    @property
    def efficiency(self) -> FloatArray:
        """Gain per charge, shape (legs, steps): infinite without use."""
        ratio: FloatArray = np.full(self.use.shape, np.inf)
        return np.divide(self.gain, self.use, out=ratio, where=self.use > 0)

    def at(self, place: int) -> Knapsack:
        """That of one place alone."""
        mine, own = self.place == place, slice(place, place + 1)
        alone = np.zeros(int(mine.sum()), dtype=np.intp)
        return Knapsack(
            self.use[mine], self.gain[mine], alone, self.base_use[own], self.base_value[own], self.available[own]
        )

    def filling(self, shares: FloatArray) -> Filling:
        """What shares of the increments, shape (legs, steps), come to."""
        count = len(self.base_use)
        use = self.base_use + np.bincount(self.place, (self.use * shares).sum(axis=1), count)
        value = self.base_value + np.bincount(self.place, (self.gain * shares).sum(axis=1), count)
        return Filling(shares, use, value, self.spare >= -FULL)


class Filling(NamedTuple):
    """Fillings of the knapsacks of some places.

    Attributes
    ----------
    shares : array, shape (legs, steps)
        Share of each increment that is taken, in 0..1.
    use, value : array, shape (places,)
        Total use and value, minimum power included.
    feasible : array of bool, shape (places,)
        Whether the charge suffices for minimum power; nothing is taken where it does not.
    """

    shares: FloatArray
    use: FloatArray
    value: FloatArray
    feasible: BoolArray


def fill_greedy(knapsack: Knapsack) -> Filling:
    """The optimal filling at every place: increments in descending order of gain per charge, the last one in part."""
    # increments of all legs in a row, by place, the most efficient first
    use, place = knapsack.use.ravel(), np.repeat(knapsack.place, knapsack.use.shape[1])
    order = np.lexsort((-knapsack.efficiency.ravel(), place))
    used, of_place = use[order], place[order]
    # use of those before each one, and at the first of each place
    before = used.cumsum() - used
    first = np.searchsorted(of_place, np.arange(len(knapsack.base_use)))
    start = before[np.minimum(first, len(before) - 1)] if len(before) else before
    # what is left for each one; below 0 where not even minimum power is possible, so that nothing is taken
    spare = np.where(knapsack.spare >= -FULL, np.maximum(knapsack.spare, 0.0), -1.0)
    left = (spare + FULL)[of_place] - (before - start[of_place]) if len(before) else before
    share = np.clip(left / np.where(used > 0, used, 1.0), 0.0, 1.0)
    share = np.where(used > 0, share, left >= 0)  # what takes no charge is taken whole
    shares = np.empty(len(use))
    shares[order] = share
    return knapsack.filling(shares.reshape(knapsack.use.shape))
