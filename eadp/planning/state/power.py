"""The power of a flight as its estimator knows it, and the laps by which it does.

`FlightState` feeds it from the queue of what waits, as far as it is asked. Laps are counted at once: they are known
with the stage.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import Column, FloatArray, columns
from eadp.core.compiled import enabled, jitted
from eadp.errors import PathUndefined
from eadp.models.energy import EnergyModel
from eadp.models.plan.cursor import Vector
from eadp.models.plan.trace import nominal_legs
from eadp.papers.estimator import (
    MIN_NOISE_W,
    ONE_LAP_SHARE,
    PUBLISHED,
    SHORTEST_DISTURBANCE_S,
    Estimator,
    EstimatorSettings,
    ExactEstimator,
    PowerEstimate,
    PublishedEstimator,
)
from eadp.planning.base import Mission, Observation

UNKNOWN_PERIOD_S = 6.0
"""Horizon in place of one period if there is none [s]."""

NO_LAP, LAP_STARTS, LAP_ENDS = 0, 1, 2
"""What has happened to the laps at the start of a stage; where one ends, the next one starts."""


class Powers(NamedTuple):
    """Readings of the power [W], None or NaN where there is none, beside one power of the computations [W].

    `lap` is what has started or ended just before the first of them, at `lap_s` [s].
    """

    times_s: Column
    powers_w: Sequence[float | None] | FloatArray
    computing_w: float
    lap: int = NO_LAP
    lap_s: float = 0.0


class PowerTracker:
    """Counts laps, and has the estimator of the power.

    Parameters
    ----------
    settings : EstimatorSettings
    mission : Mission
    horizon_s : float, optional
        How far ahead the planner forecasts the power [s]; by default one period.
    limit_w : float
        What motor and battery can deliver [W]: a reading above it is none.

    Attributes
    ----------
    laps : int
        Laps flown whole.
    lap_time_s : float or None
        Time of the last lap, known before its readings are processed [s]; before the first one the estimator's period.
    computing_w : float
        Power of the computations in force [W].
    forecast_w : float
        Forecast of the last reading [W].
    """

    def __init__(self, settings: EstimatorSettings, mission: Mission, horizon_s: float | None, limit_w: float) -> None:
        self.estimator: Estimator = _estimator(settings, mission)
        self.lap_time_s = self.estimator.period_s
        self.laps, self.computing_w, self.forecast_w = 0, 0.0, 0.0
        self._mission, self._horizon_s, self._limit_w = mission, horizon_s, limit_w
        self._lap_from_s = math.inf  # when the lap being flown started [s]; infinite before the first
        self._segment = 0  # in which it started
        self._through_gap = False  # whether a gap of the telemetry lies in it
        self._computing_for: tuple[Vector, int] | None = None  # parameters and stage that `computing_w` is of

    def horizon_of_s(self, period_s: float | None) -> float:
        """How far ahead the planner looks, by the period [s]."""
        return self._horizon_s or period_s or UNKNOWN_PERIOD_S

    def locate(self, o: Observation, *, entered: bool) -> int:
        """Update the laps and the power of the computations by where an observation is in the plan.

        Returns what has happened to the laps: `NO_LAP`, `LAP_STARTS` or `LAP_ENDS`. `entered` is whether the stage of
        the observation has just started.
        """
        self._through_gap |= o.through_gap
        if self._computing_for != (o.parameters, o.stage):
            self._computing_for = (o.parameters, o.stage)
            self.computing_w = self._mission.computing.power_w(o.parameters, o.cursor.stage.sets)
        return self._count_lap(o) if entered else NO_LAP

    def _count_lap(self, o: Observation) -> int:
        """Count the lap that ends where the stage of an observation starts, if one does; return as `locate` does.

        A lap counts if it was flown whole within one segment; after a gap, or in a new segment, a lap only starts.
        """
        before, self._segment = self._segment, o.cursor.segment
        segment = o.cursor.table.segments[self._segment]
        plan = self._mission.plan
        # stages of a lap; None where nothing repeats
        lap_stages = None if plan.segments else plan.primitive_stages
        if segment.repeats:
            lap_stages = segment.count
        if lap_stages is None or (o.stage - 1 - segment.first) % lap_stages:
            return NO_LAP
        through_gap, self._through_gap = self._through_gap, o.through_gap
        whole = self._segment == before and not through_gap
        if whole:
            self.laps += 1
            if o.time_s > self._lap_from_s:
                self.lap_time_s = o.time_s - self._lap_from_s
        self._lap_from_s = o.time_s
        return LAP_ENDS if whole else LAP_STARTS

    def begin(self, powers: Powers) -> Powers:
        """Tell the estimator of the lap that starts or ends before some readings; return the readings as arrays."""
        if powers.lap:
            (self.estimator.end_lap if powers.lap == LAP_ENDS else self.estimator.start_lap)(powers.lap_s)
        times_s, powers_w = np.asarray(powers.times_s, dtype=float), np.array(powers.powers_w, dtype=float)
        return powers._replace(times_s=times_s, powers_w=powers_w)

    def observe(self, powers: Powers, first: int, until_s: float = math.inf) -> int:
        """Update the estimator with readings as arrays, from the index `first` up to a time; return the next index."""
        times_s, computing_w = np.asarray(powers.times_s), powers.computing_w
        end = int(np.searchsorted(times_s, until_s, "right"))
        motions_w = np.asarray(powers.powers_w)[first:end] - computing_w
        for time_s, value in zip(times_s[first:end].tolist(), motions_w.tolist(), strict=True):
            motion_w = value if value + computing_w <= self._limit_w else None  # not a number is none, too
            self.forecast_w = self.estimator.observe(time_s, motion_w) + computing_w
        return end

    def estimate(self) -> PowerEstimate:
        """The power as estimated after the last reading processed, beside the computations in force."""
        return self.estimator.estimate(self.computing_w, self.horizon_of_s(self.estimator.period_s))


def _estimator(settings: EstimatorSettings, mission: Mission) -> Estimator:
    """The estimator that the settings name, initialised with what the mission knows of the power."""
    if settings.kind == PUBLISHED:
        return PublishedEstimator(settings)
    if mission.energy is not None:
        return _estimator_of_fit(settings, mission.energy)
    if not mission.plan.primitive_stages:
        return ExactEstimator(settings, None)
    return ExactEstimator(settings, _nominal_lap_s(mission))


def _estimator_of_fit(settings: EstimatorSettings, fitted: EnergyModel) -> ExactEstimator:
    """An estimator initialised with a model fitted to a log, whose noise replaces the settings'."""
    std_s, disturbance = None, fitted.disturbance
    if fitted.period_s is not None and fitted.period_std_s is not None:
        std_s = max(fitted.period_std_s, ONE_LAP_SHARE * fitted.period_s)  # the model is of another flight
    if disturbance is not None:
        white_w = math.sqrt(max(fitted.noise_std_w**2 - disturbance.std_w**2, 0.0))
        settings = replace(
            settings,
            noise_w=max(white_w, MIN_NOISE_W),
            disturbance_std_w=disturbance.std_w,
            disturbance_time_s=max(disturbance.time_s, SHORTEST_DISTURBANCE_S),
        )
    return ExactEstimator(settings, fitted.period_s, fitted.state_w(settings.order), period_std_s=std_s)


def _nominal_lap_s(mission: Mission) -> float | None:
    """Time of a nominal lap at cruise speed without wind [s]: the initial period."""
    try:
        legs = nominal_legs(mission.plan, mission.parameters, mission.start_m)
    except PathUndefined:
        return None
    lap = max(legs[-1].lap - 1, 0)  # the last but one is whole: the last may be cut short, the first starts anywhere
    length_m = sum(leg.length_m for leg in legs if leg.lap == lap)
    return length_m / mission.cruise_mps if length_m > 0 and math.isfinite(length_m) else None


MAX_RATIO, PERSISTENT_S = 5.0, 5.0
"""A reading above this multiple of the mean is an outlier, unless readings stay there for this long [s]."""

MAX_OF_MOTOR = 20.0
"""Multiple of the motor's stated maximum that no reading exceeds: the stated aircraft may be another."""

MEAN_S = 60.0
"""Time constant of the mean [s]."""


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
    """

    def __init__(self, mean_w: float, limit_w: float) -> None:
        self._bounds = PowerBounds(mean_w, limit_w)
        self._state = GateState(mean_w, 0.0, 0.0, 0.0, math.nan, False)

    @property
    def max_motion_w(self) -> float:
        """Greatest power of the motion that two successive readings have reached [W]."""
        return self._state.max_motion_w

    @property
    def rejects(self) -> bool:
        """Whether the last reading was false."""
        return self._state.rejects

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
            self._state = self._state._replace(rejects=False)
            return [power_w if 0.0 <= power_w <= self._bounds.limit_w else math.nan for power_w in values]
        passed: list[float] | FloatArray = np.empty(len(values)) if enabled() else [math.nan] * len(values)
        ingested = jitted(_ingested)
        times_s, values = columns(times_s, values)
        self._state = ingested(self._state, self._bounds, times_s, values, computing_w, passed)
        if powers_w[-1] is None:  # no reading is no false one
            self._state = self._state._replace(rejects=False)
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
