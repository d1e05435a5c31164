"""The power of a flight as its estimator knows it, and the laps by which it does.

Readings wait until it is asked, and are processed in their order, as far as the time that it is asked for: what it
answers does not depend on when it is asked. Laps are counted at once: they are known with the stage.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from eadp.core.arrays import Column, FloatArray
from eadp.errors import PathUndefined
from eadp.models.battery import Battery
from eadp.models.energy import EnergyModel
from eadp.models.plan.trace import nominal_legs
from eadp.models.world import Step
from eadp.papers.estimator import (
    LOOK_AHEADS,
    ONE_LAP_SHARE,
    PUBLISHED,
    Estimator,
    EstimatorSettings,
    ExactEstimator,
    PowerEstimate,
    PublishedEstimator,
)
from eadp.planning.base import Mission, Observation, Readings
from eadp.planning.state.power import max_reading_w
from eadp.planning.state.queue import SAME_TIME_S, Seen

DIGITS = 6

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

    Attributes
    ----------
    laps : int
        Laps flown whole.
    lap_time_s : float or None
        Time of the last lap, known before its readings are processed [s]; before the first one the estimator's period.
    computing_w : float
        Power of the computations in force [W].
    """

    own_settings: ClassVar[type] = EstimatorSettings

    def __init__(self, settings: EstimatorSettings, mission: Mission, horizon_s: float | None = None) -> None:
        self._estimator = _estimator(settings, mission)
        self.lap_time_s = self._estimator.period_s
        self.laps, self.computing_w = 0, 0.0
        self._forecast_w = 0.0  # of the last reading
        self._plan, self._horizon_s, self._limit_w = mission.plan, horizon_s, max_reading_w(mission)
        self._lap_from_s = math.inf  # when the lap being flown started [s]; infinite before the first
        self._segment = 0  # in which it started
        self._through_gap = False  # whether a gap of the telemetry lies in it
        # readings, and steps of the level [W]; whether the first has started, and how many of its readings are taken
        self._waiting: deque[Powers | float] = deque()
        self._started, self._within = False, 0

    # --- readings in

    def take(self, seen: Readings | Seen) -> None:
        """Take what the state of the flight takes: the stage and the lap are counted at once, the rest waits."""
        if isinstance(seen, Readings):
            self._waiting.append(Powers(seen.times_s, seen.powers_w, self.computing_w))
            return
        o, self.computing_w = seen.observation, seen.computing_w
        self._through_gap |= o.through_gap
        lap = self._count_lap(o) if o.stages_started != seen.stages_before else NO_LAP
        # a take-off has a power of its own, which the estimator does not learn
        times_s, powers_w = ([o.time_s], [o.sample.power_w if o.on_plan else None]) if seen.is_reading else ([], [])
        self._waiting.append(Powers(times_s, powers_w, self.computing_w, lap, o.time_s))

    def shift_level(self, by_w: float) -> None:
        """Take a known change of the power of level flight [W], in its order; see `ExactEstimator.shift_level`."""
        self._waiting.append(by_w)

    def _count_lap(self, o: Observation) -> int:
        """Count the lap that ends where the stage of an observation starts, if one does.

        Returns what has happened to the laps: `NO_LAP`, `LAP_STARTS` or `LAP_ENDS`.

        A lap counts if it was flown whole within one segment; after a gap, or in a new segment, a lap only starts.
        """
        before, self._segment = self._segment, o.cursor.segment
        segment = o.cursor.table.segments[self._segment]
        # stages of a lap; None where nothing repeats
        lap_stages = None if self._plan.segments else self._plan.primitive_stages
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

    def _process(self, until_s: float = math.inf) -> None:
        """Pass what waits to the estimator, in order, up to a time [s], be it within a batch."""
        while self._waiting:
            each = self._waiting[0]
            if isinstance(each, Powers):
                if not self._started and each.lap:
                    (self._estimator.end_lap if each.lap == LAP_ENDS else self._estimator.start_lap)(each.lap_s)
                self._started = True
                self._observe(each, until_s)
                if self._within < len(each.times_s):
                    return  # the rest of its readings is later
                self._started, self._within = False, 0
            else:
                self._estimator.shift_level(each)
            self._waiting.popleft()

    def _observe(self, powers: Powers, until_s: float) -> None:
        """Update the estimator with the readings of a batch that it has not taken yet, up to a time [s]."""
        times_s, computing_w, first = np.asarray(powers.times_s, dtype=float), powers.computing_w, self._within
        self._within = int(np.searchsorted(times_s, until_s, "right"))
        motions_w = np.array(powers.powers_w[first : self._within], dtype=float) - computing_w
        for time_s, value in zip(times_s[first : self._within].tolist(), motions_w.tolist(), strict=True):
            motion_w = value if value + computing_w <= self._limit_w else None  # not a number is none, too
            self._forecast_w = self._estimator.observe(time_s, motion_w) + computing_w

    # --- what is known

    @property
    def estimator(self) -> Estimator:
        """The estimator of the power, after all readings."""
        self._process()
        return self._estimator

    @property
    def period_s(self) -> float | None:
        """Period of the power [s]; None if there is none."""
        # the time of the last lap is known at once, while readings wait
        return self.lap_time_s if self._estimator.follows_laps else self.estimator.period_s

    @property
    def horizon_s(self) -> float:
        """How far ahead the planner forecasts the power [s]."""
        return self._horizon_of_s(self.period_s)

    def _horizon_of_s(self, period_s: float | None) -> float:
        return self._horizon_s or period_s or UNKNOWN_PERIOD_S

    def estimates(self, times_s: Sequence[float]) -> tuple[list[float], list[PowerEstimate]]:
        """At instants since the last call [s]: forecasts of the last reading before each [W], and estimates after it.

        For the rows of a simulation's log, in ascending order.
        """
        forecasts_w, estimates = [], []
        for time_s in times_s:
            self._process(time_s + SAME_TIME_S)
            forecasts_w.append(self._forecast_w)
            horizon_s = self._horizon_of_s(self._estimator.period_s)
            estimates.append(self._estimator.estimate(self.computing_w, horizon_s))
        return forecasts_w, estimates

    @staticmethod
    def table(
        steps: Sequence[Step], estimates: Sequence[PowerEstimate], battery: Battery
    ) -> Iterator[Sequence[str | float]]:
        """Header and rows of `estimate.csv`: one for each logged step that has a new reading."""
        size = len(estimates[0].state) - 2
        yield [
            *("time_s", "period_s", *(f"q{i}_w" for i in range(size)), "computing_w", "battery_wh", "power_limit_w"),
            *("horizon_s", *(f"forecast_{k}_w" for k in range(LOOK_AHEADS + 1))),
        ]
        last_s = None
        read = []
        for step, one in zip(steps, estimates, strict=True):
            if one.time_s != last_s:
                last_s = one.time_s
                read.append((step, one))
        for _, same in itertools.groupby(read, key=lambda each: _horizon(each[1])):
            group = list(same)
            states = np.array([one.state for _, one in group])
            limits = [
                (one.computing_w, battery.energy_wh(step.soc), battery.power_limit_w(step.soc), one.horizon_s)
                for step, one in group
            ]
            first = group[0][1]
            forecasts_w = states @ first.horizon_rows().T + np.array([[one.computing_w] for _, one in group])
            period = "" if first.period_s is None else round(first.period_s, DIGITS)
            values = np.round(np.hstack([states[:, :size], limits, forecasts_w]), DIGITS)
            for (_, one), row in zip(group, values.tolist(), strict=True):
                yield [round(one.time_s, 9), period, *("" if value == math.inf else value for value in row)]


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
    """An estimator initialised with a model fitted to a log."""
    std_s = None
    if fitted.period_s is not None and fitted.period_std_s is not None:
        std_s = max(fitted.period_std_s, ONE_LAP_SHARE * fitted.period_s)  # the model is of another flight
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


def _horizon(one: PowerEstimate) -> tuple[float | None, ...]:
    """What the forecasts of estimates are the same function of their states for."""
    return one.period_s, one.disturbance_s, one.horizon_s


def over_log(
    model: EnergyModel, times_s: FloatArray, power_w: FloatArray, gate_w: float
) -> tuple[FloatArray, FloatArray]:
    """The exact estimator over the readings of a log, from the period of the model fitted to it and with a gate [W].

    Returns the forecast of each reading [W], shape (n,), and α0, α1, β1, … after it [W], shape (n, 2r + 1).
    """
    settings = EstimatorSettings(order=model.order, gate_w=gate_w, noise_w=model.noise_std_w)
    estimator = ExactEstimator(settings, model.period_s, period_std_s=model.period_std_s)
    forecasts, states = [], []
    for time_s, reading_w in zip(times_s.tolist(), power_w.tolist(), strict=True):
        forecasts.append(estimator.observe(time_s, reading_w))
        states.append(estimator.state_w)
    return np.array(forecasts), np.array(states)
