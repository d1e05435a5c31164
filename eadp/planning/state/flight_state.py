"""The state of a flight, the one recipient of its readings: wind, power, times, charge, navigation, climb, ground seen.

Planners and forecasts ask it what is known. Readings and observations wait in one queue until it is asked, and are
processed in their order: the filters as far as all of it, the estimator of the power as far as the time that it is
asked for. A planner that never asks costs nothing, and what it answers does not depend on when it is asked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight.wind import WindFilter
from eadp.core.geometry.curves import Point
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.ground import GroundLog
from eadp.models.plan.route import Route, RoutePredictor
from eadp.planning.base import Mission, Observation, Readings
from eadp.planning.estimation.estimator import Estimator, EstimatorSettings, PowerEstimate
from eadp.planning.state.charge import MAX_STEP_S, ChargeFilter, DrainModel
from eadp.planning.state.climb import ClimbFollower
from eadp.planning.state.heading_gate import HEADING_DISBELIEVED, HeadingGate
from eadp.planning.state.known import ChargeKnown, Known, MotionKnown, TimeKnown, WindKnown
from eadp.planning.state.motion import MotionPower
from eadp.planning.state.power import SAME_INSTANT_S, Powers, PowerTracker
from eadp.planning.state.power_gate import MAX_OF_MOTOR, PowerGate
from eadp.planning.state.time_ratio import TimeRatio

SAME_TIME_S = 1e-9

MAX_AIRSPEEDS = 5.0
"""Ratio of a measured airspeed to that of cruise, or the inverse, above which it is false."""

MEASURED_WIND_S = 60.0
"""How long a measured wind is used [s]."""

NAVIGATION_M = 0.25, 10.0
"""Least and greatest standard deviation of how far the aircraft reaches [m]."""

OFF_PATH_S, MEDIAN_PER_STD = 30.0, 0.6745
"""Time constant of the median cross-track error [s], and the median of a normal variable's size per its deviation."""

MAX_WAITING = 10_000
"""Most batches of readings and observations that wait."""

GAUGE_STUCK, GAUGE_RISES, POWER_OUTLIER = "gauge-stuck", "gauge-rises", "power-outlier"
"""Codes of warnings: the gauge is disbelieved, as it does not fall or rises; the last reading of power is false."""


class _Batch(NamedTuple):
    """Readings that wait, beside the power of the computations then in force [W]."""

    readings: Readings
    computing_w: float

    @property
    def powers(self) -> Powers:
        return Powers(self.readings.times_s, self.readings.powers_w, self.computing_w)


class _Seen(NamedTuple):
    """An observation that waits.

    `stages_before` is how many stages had started before it; `is_reading` whether it is a reading, too; `powers` what
    the estimator takes of it.
    """

    observation: Observation
    stages_before: int
    is_reading: bool
    powers: Powers


class FlightState:
    """What is known of a flight; see the module.

    Parameters
    ----------
    mission : Mission
    weights : mapping of name to float, optional
        Weights of the parameters in U.
    estimator : EstimatorSettings, optional
        Of the power; its `every_s` is the least time between readings: an observation sooner after one is none.
    horizon_s : float, optional
        How far ahead the planner looks at the power [s]; by default one period.

    Attributes
    ----------
    now : Observation
        The last observation; there is none before the first.
    soc_before : float or None
        The gauge's reading before it; None where it is the first.
    next_reading_s : float
        From when the next reading may be taken [s].
    every_s : float
        Least time between readings [s].
    """

    now: Observation

    def __init__(
        self,
        mission: Mission,
        weights: Mapping[str, float] | None = None,
        estimator: EstimatorSettings | None = None,
        horizon_s: float | None = None,
    ) -> None:
        self._mission, self._horizon_s = mission, horizon_s
        self._estimator_settings = estimator or EstimatorSettings()
        self.every_s, self.next_reading_s = self._estimator_settings.every_s, -math.inf
        self.soc_before: float | None = None
        self._last_soc: float | None = None
        self._stages_started = 1
        self._waiting: list[_Batch | _Seen | float] = []
        self._filtered = self._estimated = self._within = 0
        self._place = _Place(mission)
        self._ground = GroundLog(mission.plan, weights or {})
        self._wind = WindFilter(mission.gust_time_s)
        self._headings = HeadingGate()
        self._measured_wind: tuple[Point, float] | None = None
        self._times = TimeRatio()
        self._motion = MotionPower(mission.energy.mean_w if mission.energy is not None else mission.motion_w)
        battery = mission.battery
        full_v, empty_v = battery.voltage_at(1.0), battery.voltage_at(0.0)
        limit_w = min(float(battery.max_power_w(battery.voltage_v)), MAX_OF_MOTOR * mission.max_motion_w)
        self._gate = PowerGate(mission.motion_w, limit_w)
        self._power = PowerTracker(self._estimator_settings, mission, horizon_s, limit_w)
        per_as = 0.0 if battery.prescribed else battery.drain_per_as
        model = DrainModel(empty_v, full_v - empty_v, battery.resistance_ohm, per_as)
        self._charge = ChargeFilter(model, (full_v - empty_v) / battery.voltage_at(0.5), battery.soc)
        self._climb = ClimbFollower.of(mission)
        self._computing_w = 0.0
        self._last_s: float | None = None
        self._losses = 0

    # --- readings in

    def ingest(self, readings: Readings) -> None:
        """Take readings since the last observation: stage and parameters have not changed."""
        self._wait(_Batch(readings, self._power.computing_w))
        self.next_reading_s = float(readings.times_s[-1]) + self.every_s
        self._last_soc = float(readings.charges[-1])

    def observe(self, observation: Observation) -> None:
        """Take an observation, which is a reading, too, unless it is too soon after the last one."""
        o = observation
        before, self._stages_started = self._stages_started, o.stages_started
        is_reading = o.time_s >= self.next_reading_s - SAME_TIME_S
        lap = self._power.locate(o, entered=o.stages_started != before)
        times_s, powers_w = ([o.time_s], [o.power_w]) if is_reading else ([], [])
        self._wait(_Seen(o, before, is_reading, Powers(times_s, powers_w, self._power.computing_w, lap, o.time_s)))
        if is_reading:
            self.next_reading_s = o.time_s + self.every_s
        self.now, self.soc_before, self._last_soc = o, self._last_soc, o.soc

    def shift_level(self, by_w: float) -> None:
        """Step the level of the motion's power by a known change [W], see `ExactEstimator.shift_level`."""
        self._wait(by_w)

    def _wait(self, item: _Batch | _Seen | float) -> None:
        if len(self._waiting) >= MAX_WAITING:  # without this one: the next instants asked for may lie in it
            self._process()
            self._estimate()
        self._waiting.append(item)

    def assume(self, wind_mps: Point, gust_std_mps: float) -> None:
        """Before take-off: the wind of the weather forecast [m/s], and its gusts."""
        self._measured_wind = wind_mps, math.inf
        self._times.expect(gust_std_mps, self._mission.cruise_mps, self._mission.gust_time_s)

    def _process(self) -> None:
        """Pass what waits through the filters, in its order; an observation's reading goes with those before it."""
        waiting, self._filtered = self._waiting[self._filtered :], len(self._waiting)
        readings: Readings | None = None
        for each in waiting:
            if isinstance(each, _Seen):
                if each.is_reading:
                    readings = _with_reading(readings, each.observation)
                if readings is not None:
                    self._read(readings)
                self._locate(each.observation, each.stages_before)
                readings = None
            elif isinstance(each, _Batch):
                if readings is not None:
                    self._read(readings)
                readings = each.readings
        if readings is not None:
            self._read(readings)
        self._forget()

    def _estimate(self, until_s: float = math.inf) -> None:
        """Pass what waits to the estimator of the power, in its order, up to a time [s]."""
        while self._estimated < len(self._waiting):
            each = self._waiting[self._estimated]
            if isinstance(each, float):
                self._power.estimator.shift_level(each)
            else:
                self._within = self._power.observe(each.powers, self._within, until_s)
                if self._within < len(each.powers.times_s):
                    break
            self._estimated, self._within = self._estimated + 1, 0
        self._forget()

    def _forget(self) -> None:
        """Drop what both have taken."""
        taken = min(self._filtered, self._estimated)
        if taken:
            del self._waiting[:taken]
            self._filtered, self._estimated = self._filtered - taken, self._estimated - taken

    def _locate(self, o: Observation, stages_before: int) -> None:
        """Take the place of an observation: a new stage, or changed parameters; power of computations; measured wind.

        Readings before it are processed already, with the parameters that were in force.
        """
        place = self._place
        place.through_gap |= o.through_gap
        # without a route: at take-off, or where it could not be laid out, tried again
        if o.stages_started != stages_before or place.route is None:
            self._start_stage(o, stages_before)
        elif (o.cursor.parameters, o.cursor.decided) != (place.cursor.parameters, place.cursor.decided):
            self._ground.hold(o.time_s, o.cursor, o.parameters)
        place.cursor, place.flies_mission = o.cursor, o.flies_mission
        self._computing_w = self._mission.computing.power_w(o.parameters, o.cursor.stage.sets)
        if o.wind_mps is not None:
            self._measured_wind = o.wind_mps, o.time_s + MEASURED_WIND_S

    def _start_stage(self, o: Observation, stages_before: int) -> None:
        """A stage has started: the leg before shows how long legs take, unless it was flown only in part."""
        place, speed, gust_time_s = self._place, self._mission.cruise_mps, self._mission.gust_time_s
        slowed_s = 0.0
        if self._climb is not None:
            slowed_s, self._climb.slowed_s = self._climb.slowed_s, 0.0
        if place.route is not None:
            if stages_before > 1 and not place.through_gap:
                forecast_s = float(place.route.times_s(speed, self.wind_mps)[0][0])
                flown_s = o.time_s - place.since_s - slowed_s
                self._times.learn(forecast_s, flown_s, self._wind.gust_std_mps, speed, gust_time_s)
            self._motion.end_window(place.slope)
        place.start(o)
        route = place.route
        if route is not None:
            self._ground.start_leg(o.time_s, o.cursor, route.first.length_m)
            times_s, turning_s = route.times_s(speed, self.wind_mps)
            place.slope = float(turning_s[0] / times_s[0]) if 0 < times_s[0] < math.inf else 0.0
        self._ground.hold(o.time_s, o.cursor, o.parameters)

    def _read(self, readings: Readings) -> None:
        """Update the filters with readings, columns of shape (n,), in the order of their use.

        Navigation, power gate, climb, heading gate, wind, motion power, charge. The first reading of a flight has no
        step. Readings at the time of the last one are left out.
        """
        times_s = np.asarray(readings.times_s, dtype=float)
        before_s = float(times_s[0]) if self._last_s is None else self._last_s
        steps_s = np.diff(times_s, prepend=before_s)
        if self._last_s is not None and not steps_s.any():
            return
        self._last_s = float(times_s[-1])
        # once a second, whenever it is asked
        whole_s = np.floor(times_s + SAME_TIME_S)
        for i in np.flatnonzero(np.diff(whole_s, prepend=math.floor(before_s + SAME_TIME_S)) > 0).tolist():
            self._place.off_path((float(readings.x_m[i]), float(readings.y_m[i])), float(times_s[i]))
        powers_w = np.asarray(self._gate.ingest(times_s, readings.powers_w, self._computing_w))
        climb_w, level_mps = self._followed(steps_s)
        airspeeds_mps = np.asarray(_numbers(readings.airspeeds_mps), dtype=float)
        ratios = airspeeds_mps / self._mission.cruise_mps
        measured = (ratios > 1 / MAX_AIRSPEEDS) & (ratios < MAX_AIRSPEEDS)
        airspeeds_mps = np.where(measured, airspeeds_mps, level_mps)
        vx, vy, headings = (_numbers(column) for column in (readings.vx_mps, readings.vy_mps, readings.headings_rad))
        headings = np.asarray(self._headings.ingest(vx, vy, headings, steps_s, airspeeds_mps, self._wind))
        if self._measured_wind is not None and self._last_s > self._measured_wind[1]:
            self._measured_wind = None
        moving = steps_s > 0
        self._wind.ingest(*(column[moving] for column in (vx, vy, headings, steps_s, airspeeds_mps)))
        # over a long gap the charge goes on with the power before it; the motion takes the reading for MAX_STEP_S
        drain_powers_w = np.where(steps_s > MAX_STEP_S, math.nan, powers_w)
        self._motion.ingest(powers_w, self._computing_w + climb_w, np.minimum(steps_s, MAX_STEP_S), self._place.slope)
        self._losses += self._charge.ingest(_numbers(readings.charges), drain_powers_w, steps_s)

    def _followed(self, steps_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Power that climbing and the stage's airspeed added over each step [W], and the level airspeed [m/s]."""
        if self._climb is None:
            return np.zeros(len(steps_s)), np.full(len(steps_s), self._mission.cruise_mps)
        found = []
        for step_s in steps_s.tolist():
            self._climb.follow(self._place.cursor.stage, step_s)
            found.append((self._climb.power_w, self._climb.level_mps))
        added_w, level_mps = np.array(found).T
        return added_w, level_mps

    # --- what is known

    @property
    def wind_mps(self) -> Point:
        """The wind to plan with [m/s]: measured, else estimated."""
        self._process()
        return self._wind.wind_mps if self._measured_wind is None else self._measured_wind[0]

    @property
    def laps(self) -> int:
        """Laps flown whole."""
        return self._power.laps

    @property
    def computing_w(self) -> float:
        """Power of the computations in force [W]."""
        return self._power.computing_w

    @property
    def period_s(self) -> float | None:
        """Period of the power [s]; None if there is none."""
        # that of the last lap does not wait
        return self._power.last_lap_s if self._power.estimator.follows_laps else self.estimator.period_s

    @property
    def horizon_s(self) -> float:
        """How far ahead the planner looks at the power [s]."""
        return self._power.horizon_of_s(self.period_s)

    @property
    def estimator(self) -> Estimator:
        """The estimator of the power, after all readings; only to be asked."""
        self._estimate()
        return self._power.estimator

    def estimates(self, times_s: Sequence[float]) -> tuple[list[float], list[PowerEstimate]]:
        """Forecast of the last reading [W] and the power as estimated after it, at instants since the last call [s]."""
        forecasts_w, estimates = [], []
        for time_s in times_s:
            self._estimate(time_s + SAME_INSTANT_S)
            forecasts_w.append(self._power.forecast_w)
            estimates.append(self._power.estimate())
        return forecasts_w, estimates

    @property
    def soc(self) -> float:
        """Filtered state of charge at the last reading."""
        self._process()
        return self._charge.soc

    @property
    def losses(self) -> int:
        """Sudden losses of charge so far."""
        self._process()
        return self._losses

    def is_ambiguous(self, soc: float) -> bool:
        """Whether the charge, `soc` now, may have jumped: the next reading decides."""
        self._process()
        return self._charge.is_ambiguous(soc)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Codes of what is wrong with the readings."""
        self._process()
        known = {
            GAUGE_STUCK: not self._charge.believed and not self._charge.rises,
            GAUGE_RISES: not self._charge.believed and self._charge.rises,
            POWER_OUTLIER: self._gate.rejects,
            HEADING_DISBELIEVED: self._headings.disbelieved,
        }
        return tuple([code for code, holds in known.items() if holds])

    def known(self, time_s: float, position: Point) -> Known:
        """What is known at a time [s] and a position [m]."""
        self._process()
        max_w = min(self._gate.max_motion_w, self._mission.max_motion_w)
        place, times, (gain_std, gain_from) = self._place, self._times, self._charge.gauge_gain
        wind = WindKnown(self.wind_mps, self._wind.covariance if self._measured_wind is None else (0.0, 0.0, 0.0))
        return Known(
            time_s,
            position,
            place.cursor,
            place.joined_m,
            place.since_s,
            self._stages_started,
            self._mission.cruise_mps,
            wind,
            TimeKnown(times.ratio, times.variance, times.noise_s),
            MotionKnown(self._motion.level_w, self._motion.slope_w, *self._motion.variances, max_w),
            ChargeKnown(self._charge.ahead, gain_std, gain_from, self._charge.believed),
            0.0 if place.flies_mission else place.reach_std_m,
            self._climb.climb if self._climb is not None else None,
            self._ground.until(time_s),
        )


class _Place:
    """Where the flight is in its plan, and how well it keeps to it.

    Attributes
    ----------
    cursor, joined_m
        As of the last observation.
    route : Route or None
        The leg being flown alone; None where it cannot be laid out.
    since_s : float
        When it was joined [s].
    slope : float
        Its mean tan² φ.
    through_gap : bool
        Whether its start or end may be unknown.
    flies_mission : bool
        As of the last observation.
    reach_std_m : float
        Standard deviation of the cross-track error [m].
    """

    def __init__(self, mission: Mission) -> None:
        self.cursor = PlanCursor.start(mission.plan, mission.parameters, mission.rules)
        self.joined_m: Point = mission.start_m or (0.0, 0.0)
        self.route: Route | None = None
        self.since_s = self.slope = 0.0
        self.through_gap = self.flies_mission = False
        self.reach_std_m = NAVIGATION_M[0]
        self._located_s = 0.0
        self._predictor = RoutePredictor()

    def start(self, o: Observation) -> None:
        """A stage has started."""
        self.joined_m, self.since_s, self.through_gap = o.joined_m, o.time_s, o.through_gap
        try:
            self.route = self._predictor.leg(o.cursor, o.joined_m)
        except PathUndefined:
            self.route = None

    def off_path(self, position: Point, time_s: float) -> None:
        """Update the standard deviation of the cross-track error, by its median: stages are joined from far off.

        Source: recursive median, a step up or down for each reading above or below it.
        """
        step_s, self._located_s = time_s - self._located_s, time_s
        if self.route is None or step_s <= 0:
            return
        leg = self.route.first
        try:
            phi, gx, gy, *_ = leg.path(position[0] - leg.offset_m[0], position[1] - leg.offset_m[1])
        except (ArithmeticError, ValueError):
            return
        square = gx * gx + gy * gy
        if square > 0 and math.isfinite(phi):
            above = phi * phi > square * (MEDIAN_PER_STD * self.reach_std_m) ** 2
            std_m = self.reach_std_m * math.exp((1.0 if above else -1.0) * min(1.0, step_s / OFF_PATH_S))
            self.reach_std_m = min(max(std_m, NAVIGATION_M[0]), NAVIGATION_M[1])


def _with_reading(before: Readings | None, o: Observation) -> Readings:
    """Readings, and an observation as one more."""
    vx, vy = (math.nan, math.nan) if o.velocity_mps is None or o.wind_mps is not None else o.velocity_mps
    soc = o.soc if o.soc_measured else math.nan
    rest = ([math.nan if value is None else value] for value in (soc, vx, vy, o.heading_rad, o.airspeed_mps))
    own = Readings([o.time_s], [o.x_m], [o.y_m], [o.power_w], *rest)
    if before is None or before.times_s[-1] >= o.time_s:
        return own if before is None else before
    return Readings(*(np.append(_numbers(old), _numbers(new)) for old, new in zip(before, own, strict=True)))


def _numbers(column: object) -> FloatArray:
    """A column as an array, NaN for None."""
    return np.array(column, dtype=float)
