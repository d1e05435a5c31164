"""Gate for power readings: what cannot be is no reading."""

from __future__ import annotations

import math

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

    Attributes
    ----------
    max_motion_w : float
        Greatest power of the motion that two successive readings have reached [W].
    rejects : bool
        Whether the last reading was false.
    """

    def __init__(self, mean_w: float | None, limit_w: float) -> None:
        self._least_w, self._limit_w = mean_w or 0.0, limit_w
        self._mean_w = mean_w
        self._time_s = self._last_w = self.max_motion_w = 0.0
        self._outlier_since_s: float | None = None
        self.rejects = False

    def passed(self, time_s: float, power_w: float | None, computing_w: float) -> float | None:
        """The reading [W] at a time [s], or None where it is false; `computing_w` is the computations' part of it."""
        self.rejects = power_w is not None
        if power_w is None or not 0.0 <= power_w <= self._limit_w:  # NaN included
            return None
        if self._mean_w is None:
            self._mean_w = power_w
        if power_w > MAX_RATIO * max(self._mean_w, self._least_w):
            if self._outlier_since_s is None:
                self._outlier_since_s = time_s
            if time_s - self._outlier_since_s < PERSISTENT_S:
                return None
            self._mean_w = power_w
        self._outlier_since_s = None
        self._mean_w += (1.0 - math.exp((self._time_s - time_s) / MEAN_S)) * (power_w - self._mean_w)
        motion_w = power_w - computing_w
        self.max_motion_w = max(self.max_motion_w, min(motion_w, self._last_w))
        self._time_s, self._last_w, self.rejects = time_s, motion_w, False
        return power_w
