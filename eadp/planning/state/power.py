"""Readings of the power that are false, and what no reading exceeds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import Column, FloatArray, columns
from eadp.core.compiled import jitted
from eadp.models.world import Mission

MAX_RATIO, PERSISTENT_S = 5.0, 5.0
"""A reading above this multiple of the mean is an outlier, unless readings stay there for this long [s]."""

MAX_OF_MOTOR = 20.0
"""Multiple of the motor's stated maximum that no reading exceeds: the stated aircraft may be another."""

MEAN_S = 60.0
"""Time constant of the mean [s]."""


def max_reading_w(mission: Mission) -> float:
    """What motor and battery can deliver [W]: a reading above it is none."""
    battery = mission.battery
    return min(float(battery.max_power_w(battery.voltage_v)), MAX_OF_MOTOR * mission.vehicle.max_motion_w)


class GateState(NamedTuple):
    """State of `PowerGate`.

    Attributes
    ----------
    mean_w : float
        Mean [W].
    read_s, motion_w : float
        Time [s] and motion power [W] of the last reading that has passed.
    max_motion_w : float
        The greatest motion power that two in a row have reached [W].
    since_s : float
        Since when readings are outliers [s]; NaN where the last was none.
    rejects : bool
        Whether the last reading was false.
    """

    mean_w: float
    read_s: float
    motion_w: float
    max_motion_w: float
    since_s: float
    rejects: bool


class PowerGate:
    """Passes readings of power, of which single ones, or some in a row, may be false.

    Parameters
    ----------
    mean_w : float
        Power before the first reading [W].
    limit_w : float
        Power that the battery and the motor cannot exceed [W]; may be infinite.

    Attributes
    ----------
    state : GateState
    """

    def __init__(self, mean_w: float, limit_w: float) -> None:
        self._usual_w, self._limit_w = mean_w, limit_w
        self.state = GateState(mean_w, 0.0, 0.0, 0.0, math.nan, False)

    def ingest(
        self, times_s: FloatArray, powers_w: FloatArray, computing_w: float, *, on_plan: bool = True
    ) -> FloatArray:
        """Judge readings in order; return them, NaN where one is false or missing, shape (n,).

        Parameters
        ----------
        times_s, powers_w : array, shape (n,)
            Times of the readings [s], and the readings [W], NaN for none.
        computing_w : float
            The computations' part of each [W].
        on_plan : bool
            Whether the aircraft flies its plan: a take-off has a power of its own, which says nothing of later ones.
        """
        if not on_plan:
            self.state = self.state._replace(rejects=False)
            return np.where((powers_w >= 0.0) & (powers_w <= self._limit_w), powers_w, math.nan)
        passed_w, (times, powers) = np.empty(len(powers_w)), columns(times_s, powers_w)
        ingested = jitted(_ingested)
        self.state = ingested(self.state, self._usual_w, self._limit_w, times, powers, computing_w, passed_w)
        return passed_w


# The functions below may be compiled, see `eadp.core.compiled`.


def _ingested(
    state: GateState,
    usual_w: float,
    limit_w: float,
    times_s: Column,
    powers_w: Column,
    computing_w: float,
    passed_w: FloatArray,
) -> GateState:
    """The state after readings, of which those that pass are written to `passed_w`; see `PowerGate.ingest`."""
    for i in range(len(powers_w)):
        state = _with_reading(state, usual_w, limit_w, times_s[i], powers_w[i], computing_w)
        passed_w[i] = math.nan if state.rejects else powers_w[i]
    return state


def _with_reading(
    state: GateState, usual_w: float, limit_w: float, time_s: float, power_w: float, computing_w: float
) -> GateState:
    """The state after a reading; its `rejects` says whether that is false. A missing one, NaN, is not."""
    mean_w, read_s, last_w, max_motion_w, since_s, _ = state
    if not 0.0 <= power_w <= limit_w:
        return GateState(mean_w, read_s, last_w, max_motion_w, since_s, rejects=not math.isnan(power_w))
    if power_w > MAX_RATIO * max(mean_w, usual_w):  # false, until it has persisted: the mean is another then
        if math.isnan(since_s):
            since_s = time_s
        if time_s - since_s < PERSISTENT_S:
            return GateState(mean_w, read_s, last_w, max_motion_w, since_s, rejects=True)
        mean_w = power_w
    # m ← m + (1 − e^(−Δt/τ)) (y − m)
    mean_w += (1.0 - math.exp((read_s - time_s) / MEAN_S)) * (power_w - mean_w)
    motion_w = power_w - computing_w
    # the smaller of two in a row is what both have reached
    max_motion_w = max(max_motion_w, min(motion_w, last_w))
    return GateState(mean_w, time_s, motion_w, max_motion_w, since_s=math.nan, rejects=False)
