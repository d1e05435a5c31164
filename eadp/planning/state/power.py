"""Readings of the power that are false, and what no reading exceeds."""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import Column, FloatArray, columns
from eadp.core.compiled import enabled, jitted
from eadp.planning.base import Mission

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


class PowerBounds(NamedTuple):
    """Power before the first reading, and power that cannot be exceeded [W]."""

    usual_w: float
    limit_w: float


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
        self._bounds = PowerBounds(mean_w, limit_w)
        self.state = GateState(mean_w, 0.0, 0.0, 0.0, math.nan, False)

    def ingest(
        self,
        times_s: Column,
        powers_w: Sequence[float | None] | FloatArray,
        computing_w: float,
        *,
        on_plan: bool = True,
    ) -> list[float] | FloatArray:
        """Judge readings in order; return them, NaN where one is false or missing.

        Parameters
        ----------
        times_s : sequence of float or array, shape (n,)
            Times of the readings [s].
        powers_w : sequence of (float or None) or array, shape (n,)
            Readings [W]; None where there is none. A reading that is not a number is false.
        computing_w : float
            The computations' part of each [W].
        on_plan : bool
            Whether the aircraft flies its plan: a take-off has a power of its own, which says nothing of later ones.

        Returns
        -------
        list of float, or array, shape (n,)
            An array in compiled code.
        """
        values: Any = powers_w
        if not isinstance(values, np.ndarray):
            values = [math.nan if power_w is None else power_w for power_w in powers_w]
        if not on_plan:
            self.state = self.state._replace(rejects=False)
            return [power_w if 0.0 <= power_w <= self._bounds.limit_w else math.nan for power_w in values]
        passed: list[float] | FloatArray = np.empty(len(values)) if enabled() else [math.nan] * len(values)
        ingested = jitted(_ingested)
        times_s, values = columns(times_s, values)
        self.state = ingested(self.state, self._bounds, times_s, values, computing_w, passed)
        if powers_w[-1] is None:  # no reading is no false one
            self.state = self.state._replace(rejects=False)
        return passed


# The functions below may be compiled, see `eadp.core.compiled`.


def _ingested(
    state: GateState,
    bounds: PowerBounds,
    times_s: Column,
    powers_w: Column,
    computing_w: float,
    passed_w: MutableSequence[float] | FloatArray,
) -> GateState:
    """The state after readings, of which those that pass are written to `passed_w`; see `PowerGate.ingest`."""
    for i in range(len(powers_w)):
        state = _with_reading(state, bounds, times_s[i], powers_w[i], computing_w)
        passed_w[i] = math.nan if state.rejects else powers_w[i]
    return state


def _with_reading(
    state: GateState, bounds: PowerBounds, time_s: float, power_w: float, computing_w: float
) -> GateState:
    """The state after a reading; its `rejects` says whether that is false."""
    mean_w, read_s, last_w, max_motion_w, since_s, _ = state
    if not 0.0 <= power_w <= bounds.limit_w:  # NaN included
        return GateState(mean_w, read_s, last_w, max_motion_w, since_s, rejects=True)
    if power_w > MAX_RATIO * max(mean_w, bounds.usual_w):  # false, until it has persisted: the mean is another then
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
