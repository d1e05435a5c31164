"""State of charge at the end of a flight, as a distribution over the ends that it may have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

MIN_STD, SAME_SOC = 1e-6, 1e-5
"""Least standard deviation, and accuracy of a quantile where there are several ends."""

LOSS, LOSS_SQUARE = 0.07, (0.12**3 - 0.02**3) / 3 / 0.1
"""Mean and mean square of a loss of charge, uniform in 2 to 12 %; losses are a Poisson process."""


class FinalCharge(NamedTuple):
    """State of charge at the end: a normal distribution for each end that the flight may have, of one variance.

    Attributes
    ----------
    std : float
    shares, means : tuple of float
        Probability of each end, and its mean.
    """

    std: float = MIN_STD
    shares: tuple[float, ...] = (1.0,)
    means: tuple[float, ...] = (0.0,)

    @property
    def mean(self) -> float:
        """Mean over all ends."""
        return moments(self.shares, self.means)[0]

    @property
    def variance(self) -> float:
        """Variance over all ends."""
        return self.std**2 + moments(self.shares, self.means)[1]

    def probability_above(self, soc: float) -> float:
        """Probability that the state of charge at the end is above `soc`."""
        # Σ share · ½ erfc((soc − mean)/(σ √2))
        scale = max(self.std, MIN_STD) * math.sqrt(2.0)
        above = 0.0
        for share, mean in zip(self.shares, self.means, strict=True):
            above += share * math.erfc((soc - mean) / scale)
        return above / 2

    def level(self, probability: float) -> float:
        """State of charge above which the flight ends with a probability: a quantile."""
        below_mean = NormalDist().inv_cdf(probability) * self.std
        # the level of the mixture lies between those of its lowest and its highest end; with one end they are equal
        low, high = min(self.means) - below_mean, max(self.means) - below_mean
        while high - low > SAME_SOC:
            middle = (low + high) / 2
            low, high = (middle, high) if self.probability_above(middle) > probability else (low, middle)
        return low


def moments(shares: Sequence[float], values: Sequence[float]) -> tuple[float, float]:
    """Mean and variance of values with probabilities."""
    mean = sum(share * value for share, value in zip(shares, values, strict=True))
    return mean, sum(share * (value - mean) ** 2 for share, value in zip(shares, values, strict=True))
