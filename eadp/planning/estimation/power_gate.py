"""Gate for power readings: what cannot be is no reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from eadp.core.compiled import jitted, on_numbers
from eadp.planning.estimation.regressions import Floats, State

MAX_RATIO, PERSISTENT_S = 5.0, 5.0
"""A reading above this multiple of the mean is an outlier, unless readings stay there for this long [s]."""

MAX_OF_MOTOR = 20.0
"""Multiple of the motor's stated maximum that no reading exceeds: the stated aircraft may be another."""

MEAN_S = 60.0
"""Time constant of the mean [s]."""


class PowerGate:
    """Passes readings of power, of which single ones, or some in a row, may be false.

    Parameters
    ----------
    mean_w : float or None
        Power before the first reading [W]; None where it is not known: the first reading passes then.
    limit_w : float
        Power that the battery and the motor cannot exceed [W]; may be infinite.
    """

    def __init__(self, mean_w: float | None, limit_w: float) -> None:
        self._bounds = mean_w or 0.0, limit_w
        self._state: list[float] = [math.nan if mean_w is None else mean_w, 0.0, 0.0, 0.0, math.nan, 0.0]

    @property
    def max_motion_w(self) -> float:
        """Greatest power of the motion that two successive readings have reached [W]."""
        return self._state[MAX_MOTION_W]

    @property
    def rejects(self) -> bool:
        """Whether the last reading was false."""
        return self._state[REJECTS] > 0

    def passed(self, time_s: float, power_w: float | None, computing_w: float) -> float | None:
        """The reading [W] at a time [s], or None where it is false; `computing_w` is the computations' part of it."""
        if power_w is None:
            self._state[REJECTS] = 0.0
            return None
        passed = _passed(self._state, self._bounds, time_s, power_w, computing_w)
        return None if math.isnan(passed) else passed

    def passed_batch(self, times_s: Floats, powers_w: Sequence[float | None], computing_w: float) -> list[float]:
        """`passed` of readings in order, but NaN for those that are false or missing."""
        known: Any = powers_w
        if not isinstance(known, np.ndarray):
            known = [math.nan if power is None else power for power in powers_w]
        passed: list[float]
        passed, self._state = on_numbers(
            jitted(_all_passed, _passed), self._state, self._bounds, times_s, known, computing_w
        )
        if powers_w[-1] is None:
            self._state[REJECTS] = 0.0
        return passed


MEAN_W, READ_S, LAST_W, MAX_MOTION_W, SINCE_S, REJECTS = range(6)
"""State of `PowerGate`: mean [W], NaN before the first reading; time [s] and motion power [W] of the last reading that
has passed; the greatest of two in a row; since when readings are outliers [s], or NaN; whether the last was false."""


# The functions below keep to what numba compiles, see `eadp.core.compiled`.


def _all_passed(
    s: State, bounds: tuple[float, float], times_s: Floats, powers_w: Floats, computing_w: float
) -> list[float]:
    return [_passed(s, bounds, times_s[i], powers_w[i], computing_w) for i in range(len(powers_w))]


def _passed(s: State, bounds: tuple[float, float], time_s: float, power_w: float, computing_w: float) -> float:
    """The reading, or NaN where it is false."""
    usual_w, limit_w = bounds
    s[REJECTS] = 1.0
    if not 0.0 <= power_w <= limit_w:  # NaN included
        return math.nan
    if math.isnan(s[MEAN_W]):
        s[MEAN_W] = power_w
    if power_w > MAX_RATIO * max(s[MEAN_W], usual_w):
        if math.isnan(s[SINCE_S]):
            s[SINCE_S] = time_s
        if time_s - s[SINCE_S] < PERSISTENT_S:
            return math.nan
        s[MEAN_W] = power_w
    s[SINCE_S] = math.nan
    s[MEAN_W] += (1.0 - math.exp((s[READ_S] - time_s) / MEAN_S)) * (power_w - s[MEAN_W])
    motion_w = power_w - computing_w
    s[MAX_MOTION_W] = max(s[MAX_MOTION_W], min(motion_w, s[LAST_W]))
    s[READ_S], s[LAST_W], s[REJECTS] = time_s, motion_w, 0.0
    return power_w
