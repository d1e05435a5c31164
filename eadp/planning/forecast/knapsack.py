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

    def filling(self, shares: FloatArray) -> Filling:
        """The filling that takes shares of the increments, shape (legs, steps): their use and value are summed."""
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

    def as_good(self, tolerance: float) -> IntArray:
        """Places of a value as great as that of any that is feasible, but for a tolerance; some are feasible."""
        best = self.value[self.feasible].max()
        good: IntArray = np.flatnonzero(self.feasible & (self.value >= best - tolerance))
        return good


def fill_greedy(knapsack: Knapsack) -> Filling:
    """The optimal filling at every place: increments in descending order of gain per charge, the last one in part."""
    # increments of all legs in a row, by place, the most efficient first: those that take no charge before all others
    use, gain = knapsack.use.ravel(), knapsack.gain.ravel()
    place = np.repeat(knapsack.place, knapsack.use.shape[1])
    efficiency = np.divide(gain, use, out=np.full(len(use), np.inf), where=use > 0)
    order = np.lexsort((-efficiency, place))
    use, place = use[order], place[order]
    # use of all increments before each one in the row; and, of each place, use of all increments before its first
    before = use.cumsum() - use
    first = np.searchsorted(place, np.arange(len(knapsack.base_use)))
    start = before[np.minimum(first, len(before) - 1)] if len(before) else before
    # charge left for each increment once those before it at its place are taken whole: it is taken whole if that
    # suffices, else in part or not at all. Below 0 where minimum power is not possible, so that nothing is taken
    spare = np.where(knapsack.spare >= -FULL, np.maximum(knapsack.spare, 0.0), -1.0)
    left = (spare + FULL)[place] - (before - start[place]) if len(before) else before
    share = np.clip(left / np.where(use > 0, use, 1.0), 0.0, 1.0)
    share = np.where(use > 0, share, left >= 0)  # what takes no charge is taken whole
    shares = np.empty(len(use))  # in the order of the legs again
    shares[order] = share
    return knapsack.filling(shares.reshape(knapsack.use.shape))
