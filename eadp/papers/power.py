"""The power of a flight as its estimator knows it, and the laps by which it does.

Readings wait until it is asked, and are processed in their order, as far as the time that it is asked for: what it
answers does not depend on when it is asked. Laps are counted at once: they are known with the stage.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import PathUndefined
from eadp.models.battery import Battery
from eadp.models.energy import EnergyModel
from eadp.models.plan.trace import nominal_legs
from eadp.models.world import Mission, Step
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
from eadp.planning.base import Observation, Readings
from eadp.planning.state.power import max_reading_w
from eadp.planning.state.queue import SAME_TIME_S, Seen

DIGITS = 6

UNKNOWN_PERIOD_S = 6.0
"""Horizon in place of one period if there is none [s]."""


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
    soc_before : float or None
        The gauge's reading before the last observation; None where that is the first.
    """

    own_settings: ClassVar[type] = EstimatorSettings

    def __init__(self, settings: EstimatorSettings, mission: Mission, horizon_s: float | None = None) -> None:
        self._estimator = _estimator(settings, mission)
        self.lap_time_s = self._estimator.period_s
        self.laps, self.computing_w = 0, 0.0
        self.soc_before: float | None = None
        self._soc: float | None = None  # the gauge's last reading
        self._forecast_w = 0.0  # of the last reading
        self._plan, self._horizon_s, self._limit_w = mission.plan, horizon_s, max_reading_w(mission)
        self._lap_from_s = math.inf  # when the lap being flown started [s]; infinite before the first
        self._segment = 0  # in which it started
        self._through_gap = False  # whether a gap of the telemetry lies in it
        # what waits, in order: its time [s], and the call that takes it
        self._waiting: deque[tuple[float, Callable[[], None]]] = deque()

    # --- readings in

    def take(self, seen: Readings | Seen) -> None:
        """Take what the state of the flight takes: the stage and the lap are counted at once, the rest waits."""
        if isinstance(seen, Readings):
            self._soc = float(seen.charges[-1])
            self._waiting.append((float(seen.times_s[0]), partial(self._spread, seen, self.computing_w)))
            return
        o, self.computing_w = seen.observation, seen.computing_w
        self.soc_before, self._soc = self._soc, o.soc
        self._through_gap |= o.through_gap
        if o.stages_started != seen.stages_before:
            self._count_lap(o)
        if seen.is_reading:
            # a take-off has a power of its own, which the estimator does not learn
            power_w = o.sample.power_w if o.on_plan else None
            self._waiting.append((o.time_s, partial(self._observe, o.time_s, power_w, self.computing_w)))

    def shift_level(self, by_w: float) -> None:
        """Take a known change of the power of level flight [W], in its order; see `ExactEstimator.shift_level`."""
        self._waiting.append((-math.inf, partial(self._estimator.shift_level, by_w)))

    def _count_lap(self, o: Observation) -> None:
        """Count the lap that ends where the stage of an observation starts, if one does; where one ends, one starts.

        A lap counts if it was flown whole within one segment; after a gap, or in a new segment, a lap only starts.
        """
        before, self._segment = self._segment, o.cursor.segment
        segment = o.cursor.table.segments[self._segment]
        # stages of a lap; None where nothing repeats
        lap_stages = None if self._plan.segments else self._plan.primitive_stages
        if segment.repeats:
            lap_stages = segment.count
        if lap_stages is None or (o.stage - 1 - segment.first) % lap_stages:
            return
        through_gap, self._through_gap = self._through_gap, o.through_gap
        whole = self._segment == before and not through_gap
        if whole:
            self.laps += 1
            if o.time_s > self._lap_from_s:
                self.lap_time_s = o.time_s - self._lap_from_s
        self._lap_from_s = o.time_s
        lap = self._estimator.end_lap if whole else self._estimator.start_lap
        self._waiting.append((o.time_s, partial(lap, o.time_s)))

    def _spread(self, readings: Readings, computing_w: float) -> None:
        """Put the readings of a batch in its place, which a flight that asks for no estimate never comes to."""
        for time_s, power_w in zip(readings.times_s[::-1].tolist(), readings.powers_w[::-1].tolist(), strict=True):
            self._waiting.appendleft((time_s, partial(self._observe, time_s, power_w, computing_w)))

    def _process(self, until_s: float = math.inf) -> None:
        """Pass what waits to the estimator, in order, up to a time [s]."""
        while self._waiting and self._waiting[0][0] <= until_s:
            self._waiting.popleft()[1]()

    def _observe(self, time_s: float, power_w: float | None, computing_w: float) -> None:
        """Update the estimator with a reading, None or NaN for none, beside the power of the computations [W]."""
        motion_w = power_w - computing_w if power_w is not None and power_w <= self._limit_w else None
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
        for step, one in zip(steps, estimates, strict=True):
            if one.time_s == last_s:
                continue
            last_s = one.time_s
            battery_w = battery.energy_wh(step.soc), battery.power_limit_w(step.soc)
            numbers = [*one.state[:size], one.computing_w, *battery_w, one.horizon_s, *one.horizon_w()]
            values = ["" if value == math.inf else value for value in np.round(numbers, DIGITS).tolist()]
            yield [round(last_s, 9), "" if one.period_s is None else round(one.period_s, DIGITS), *values]


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
