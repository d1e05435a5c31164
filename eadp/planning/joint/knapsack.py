"""Computations over the rest of a mission: which configuration each segment gets of the charge that is left.

Each segment offers configurations, by the charge that each takes and the value that it gives for its time; switching
within a segment mixes two of them. The best mixes lie on the upper concave envelope of value over charge, and are found
by filling the steps of all envelopes in the order of value per charge: the fractional multiple-choice knapsack.

Source: Dantzig 1957 for the greedy filling, Sinha and Zoltners 1979 for multiple choice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eadp.core.arrays import FloatArray, IntArray

FULL = 1e-9
"""A charge short by less than this is enough."""

NEAR_ENVELOPE, SAME_POWER_W = 0.01, 1e-9
"""A configuration whose value is below the best mix of the same power by less than this share of the whole range is as
good; powers that differ by less are the same [W]."""


@dataclass(frozen=True)
class ConcaveEnvelope:
    """What the computations may do in a segment: configurations on the envelope, cheapest first.

    Attributes
    ----------
    powers_w : array, shape (k,)
        Power of each configuration [W], rising.
    values : array, shape (k,)
        Value of each per second, rising.
    configurations : array, shape (k, computations)
    near : tuple of array
        Powers, values and configurations of all that is on the envelope or nearly so, cheapest first.
    """

    powers_w: FloatArray
    values: FloatArray
    configurations: FloatArray
    near: tuple[FloatArray, FloatArray, FloatArray]

    def worth(self, scale: float) -> ConcaveEnvelope:
        """The same with all values times `scale`."""
        powers_w, values, configurations = self.near
        return ConcaveEnvelope(
            self.powers_w, self.values * scale, self.configurations, (powers_w, values * scale, configurations)
        )


def concave_envelope(powers_w: FloatArray, values: FloatArray, configurations: FloatArray) -> ConcaveEnvelope:
    """The configurations that a best mix may use: the cheapest, and the vertices of the upper concave envelope.

    Parameters
    ----------
    powers_w, values : array, shape (n,)
    configurations : array, shape (n, computations)
    """
    order = np.lexsort((-values, powers_w))
    kept: list[int] = []
    for i in order:
        if kept and values[i] <= values[kept[-1]] + 1e-15:
            continue
        # the last kept vertex goes where the chord from the one before it passes above
        while len(kept) > 1:
            a, b = kept[-2], kept[-1]
            if (values[b] - values[a]) * (powers_w[i] - powers_w[a]) > (values[i] - values[a]) * (
                powers_w[b] - powers_w[a]
            ) * (1 + 1e-12):
                break
            kept.pop()
        kept.append(int(i))
    best_w, best = powers_w[kept], values[kept]
    least = np.interp(powers_w, best_w, best) - NEAR_ENVELOPE * (best[-1] - best[0])
    near = (values >= least) & (powers_w <= best_w[-1] + SAME_POWER_W)
    near[kept] = True
    rising = order[near[order]]
    return ConcaveEnvelope(
        best_w, best, configurations[kept], (powers_w[rising], values[rising], configurations[rising])
    )


@dataclass(frozen=True)
class Increments:
    """The steps of all segments' envelopes: what each takes of the state of charge and adds to the objective.

    Attributes
    ----------
    segment, level : array of int, shape (steps,)
        To which segment a step belongs, and which step of its envelope it is, from 0.
    use, gain : array, shape (steps,)
        State of charge that it takes; what it adds.
    least_use, least_value : float
        With every segment at its cheapest.
    """

    segment: IntArray
    level: IntArray
    use: FloatArray
    gain: FloatArray
    least_use: float
    least_value: float

    @property
    def efficiency(self) -> FloatArray:
        """Gain over use, infinite for steps that take nothing."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.use > 0, self.gain / np.maximum(self.use, 1e-300), np.inf)


@dataclass(frozen=True)
class Allocation:
    """Shares of steps that are taken.

    Attributes
    ----------
    shares : array, shape (steps,)
        Each in 0..1.
    use, value : float
        Altogether, the cheapest configurations included.
    feasible : bool
        Whether the charge is enough for the cheapest.
    """

    shares: FloatArray
    use: float
    value: float
    feasible: bool


def fill_greedy(steps: Increments, available: float) -> Allocation:
    """The best shares: steps taken in the order of their gain per charge, the last one in part.

    Parameters
    ----------
    steps : Steps
    available : float
        State of charge that may be used.

    Returns
    -------
    Allocation
        All zero, and not feasible, where even the cheapest configurations take more.

    Source: Dantzig 1957; envelopes make each segment's own steps come in order.
    """
    shares = np.zeros(len(steps.use))
    spare = available - steps.least_use
    if spare < -FULL:
        return Allocation(shares, steps.least_use, steps.least_value, feasible=False)
    order = np.argsort(-steps.efficiency, kind="stable")
    after = np.cumsum(steps.use[order])
    whole = int(np.searchsorted(after, max(spare, 0.0) + FULL, side="right"))
    shares[order[:whole]] = 1.0
    if whole < len(order):
        before = float(after[whole - 1]) if whole else 0.0
        step = order[whole]
        shares[step] = min(1.0, max(0.0, (spare - before) / float(steps.use[step])))
    return allocation_of(steps, shares)


def allocation_of(steps: Increments, shares: FloatArray) -> Allocation:
    """What shares add up to."""
    use = steps.least_use + float(steps.use @ shares)
    return Allocation(shares, use, steps.least_value + float(steps.gain @ shares), feasible=True)
