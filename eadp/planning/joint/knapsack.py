"""Fractional multiple-choice knapsack: the computations of each segment within the remaining state of charge.

Each segment is a class of configurations with a use of charge and a value; switching within a segment mixes two of
them. The optimal mixes lie on the upper concave envelope of value over charge. Filling the increments of all envelopes
in descending order of value per charge is optimal.

Source: Dantzig 1957 for the greedy filling, Sinha and Zoltners 1979 for multiple choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.envelope import upper_envelope

FULL = 1e-9
"""A shortfall of charge below this counts as none."""


@dataclass(frozen=True)
class ConcaveEnvelope:
    """Upper concave envelope of value over power of a segment's configurations, in ascending order of power.

    Attributes
    ----------
    powers_w : array, shape (k,)
        Power of each configuration [W], rising.
    values : array, shape (k,)
        Value of each per second, rising.
    configurations : array, shape (k, computations)
    """

    powers_w: FloatArray
    values: FloatArray
    configurations: FloatArray

    @cached_property
    def rises_w(self) -> FloatArray:
        """Rise of the power from each configuration to the next [W], shape (k - 1,)."""
        return np.diff(self.powers_w)

    def scaled(self, scale: float) -> ConcaveEnvelope:
        """The envelope with all values multiplied by `scale`."""
        return ConcaveEnvelope(self.powers_w, self.values * scale, self.configurations)


def concave_envelope(powers_w: FloatArray, values: FloatArray, configurations: FloatArray) -> ConcaveEnvelope:
    """Upper concave envelope of configurations: the one of minimum power, and the vertices above it.

    Parameters
    ----------
    powers_w, values : array, shape (n,)
    configurations : array, shape (n, computations)
    """
    order = np.lexsort((-values, powers_w))
    kept = order[upper_envelope(powers_w[order], values[order])]
    return ConcaveEnvelope(powers_w[kept], values[kept], configurations[kept])


class Increments(NamedTuple):
    """Increments of all segments' envelopes: the use of charge and the gain from each vertex to the next.

    Attributes
    ----------
    segment, level : array of int, shape (increments,)
        The segment of each increment, and its index on the segment's envelope, from 0.
    use, gain : array, shape (increments,)
        State of charge that it takes; what it adds to the objective.
    base_use, base_value : float
        Use and value with every segment at minimum power.
    """

    segment: IntArray
    level: IntArray
    use: FloatArray
    gain: FloatArray
    base_use: float
    base_value: float

    @property
    def efficiency(self) -> FloatArray:
        """Gain over use; infinite for increments without use."""
        ratio: FloatArray = np.full(len(self.use), np.inf)
        return np.divide(self.gain, self.use, out=ratio, where=self.use > 0)


class Allocation(NamedTuple):
    """A filling of the knapsack.

    Attributes
    ----------
    shares : array, shape (increments,)
        Share of each increment that is taken, in 0..1.
    use, value : float
        Total use and value, the configurations of minimum power included.
    feasible : bool
        Whether the charge suffices for the configurations of minimum power.
    """

    shares: FloatArray
    use: float
    value: float
    feasible: bool


def fill_greedy(increments: Increments, available: float) -> Allocation:
    """Optimal filling: increments in descending order of gain per charge, the last one in part.

    Parameters
    ----------
    increments : Increments
    available : float
        State of charge that may be used.

    Returns
    -------
    Allocation
        All zero, and not feasible, where even the configurations of minimum power use more.

    Source: Dantzig 1957; concavity keeps each segment's increments in order.
    """
    spare = available - increments.base_use
    if spare < -FULL:
        none = np.zeros(len(increments.use))
        return Allocation(none, increments.base_use, increments.base_value, feasible=False)
    return allocation_of(increments, _filled(increments, spare))


def _filled(increments: Increments, spare: float) -> FloatArray:
    """Share of each increment that is taken."""
    use = increments.use
    shares = np.zeros(len(use))
    order = (-increments.efficiency).argsort(kind="stable")
    after = use[order].cumsum()
    whole = int(after.searchsorted(max(spare, 0.0) + FULL, side="right"))
    shares[order[:whole]] = 1.0
    if whole < len(order):
        before = float(after[whole - 1]) if whole else 0.0
        shares[order[whole]] = min(1.0, max(0.0, (spare - before) / float(use[order[whole]])))
    return shares


def allocation_of(increments: Increments, shares: FloatArray) -> Allocation:
    """The allocation with given shares of the increments."""
    use = increments.base_use + float(increments.use @ shares)
    return Allocation(shares, use, increments.base_value + float(increments.gain @ shares), feasible=True)
