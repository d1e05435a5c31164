"""A planner on a real flight: samples of telemetry to observations, decisions to advice. No files, no clock.

`OutlierGate` rejects outliers; `LiveFlight` tracks the plan with the accepted samples and updates the planner. Both
depend on their input alone, so that a flight is restored from the same samples.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, printable
from eadp.models.plan.cursor import Vector
from eadp.models.plan.executor import PlanExecutor
from eadp.planning.base import Decision, Mission, Observation, Planner, next_multiple
from eadp.planning.joint.held import HeldForecast

GAP_S, GAP_STEPS = 5.0, 3.0
"""A gap: minimum length [s], and in multiples of the step before."""

MAX_GAP_S = 3600.0
SPEED_FACTOR, SLACK_M = 3.0, 50.0
"""Maximum distance of a sample from the last one: multiple of the cruise speed, and a constant [m]."""
MIN_AGREEING = 3
"""Number of consecutive samples in agreement that are accepted however far they are from the last one."""

STEP_M, MAX_STEPS = 1.0, 5000
"""Distance of trigger checks between two samples [m], and their maximum number."""

WINDOW_S, MIN_SPAN_S, MAX_CHORD_S = 2.5, 0.9, 3.0
"""Window of positions for the ground velocity, its minimum span, and the maximum step in it [s]."""

CLOCK_START_S = 10.0
"""A clock up to this at the first sample has started with the flight; any other counts from the first sample."""

RECENT_S = 10.0
"""Maximum age of a decision record that counts as a forecast [s], if it exceeds three re-plannings."""

MAX_NOTICES = 100
COMPLETED, EMPTY, TAKE_OFF, KEPT = "final point reached", "battery empty", "take-off", "kept"


class Sample(NamedTuple):
    """One sample of telemetry.

    Attributes
    ----------
    time_s, x_m, y_m : float
        Time of any clock that rises [s]; position in the local frame [m].
    power_w : float or None
        Measured power of motion and computations [W]; None without a reading.
    soc : float
        State of charge, 0 to 1.
    stage : int or None
        Stage being flown, from 1 within the plan's stages; None if the autopilot does not report it.
    wind_mps, velocity_mps : (float, float) or None
        Vector that the wind blows towards, and ground velocity [m/s].
    heading_rad : float or None
        Heading of the nose, 0 east, counter-clockwise [rad].
    parameters : mapping of name to value
        Reported to be in force.
    """

    time_s: float
    x_m: float
    y_m: float
    power_w: float | None
    soc: float
    stage: int | None = None
    wind_mps: Point | None = None
    velocity_mps: Point | None = None
    heading_rad: float | None = None
    parameters: Mapping[str, float] = {}


class Notice(NamedTuple):
    """A warning about a sample: its key, what is wrong, and what was expected."""

    key: str
    message: str
    expected: str = ""


class Advice(NamedTuple):
    """A planner's advice at a sample.

    Attributes
    ----------
    time_s : float
        Time of the sample [s].
    stage, lap : int
        Being flown, from 1 and from 0.
    parameters, in_force : mapping of name to value
        Decided; and in force, since path parameters may wait for their stage.
    soc_end_forecast : float or None
        State of charge at the end of the plan, negative by the shortfall of charge; None if unknown.
    completes_probability, reserve_probability : float or None
        Probabilities that the battery is not empty before the end, and that the reserve is kept; None if unknown.
    remaining_s : float or None
        Time to the end of the plan [s].
    wind_mps : (float, float) or None
        Estimated wind [m/s].
    reason : str
        The decision and its reason, in words.
    """

    time_s: float
    stage: int
    lap: int
    parameters: Mapping[str, float]
    in_force: Mapping[str, float]
    soc_end_forecast: float | None
    completes_probability: float | None
    reserve_probability: float | None
    remaining_s: float | None
    wind_mps: Point | None
    reason: str


class OutlierGate:
    """Accepts samples in order of time, and rejects outliers until several agree.

    Parameters
    ----------
    cruise_mps : float
        Airspeed of the aircraft [m/s].
    """

    def __init__(self, cruise_mps: float) -> None:
        self._max_mps = SPEED_FACTOR * cruise_mps
        self._last: Sample | None = None
        self._step_s = 0.0
        self._rejected: Sample | None = None
        self._agreeing = 0

    def accept(self, sample: Sample) -> tuple[bool, Notice | None]:
        """Whether a sample is accepted, and a notice about it; one that is becomes the reference of the next."""
        notice = None
        if self._last is not None:
            step_s = sample.time_s - self._last.time_s
            if step_s <= 0:
                what = f"late: {sample.time_s:.15g} s is not after {self._last.time_s:.15g} s"
                return False, Notice("time_s", what, "a time after the last line's")
            outlier = self._outlier(self._last, sample)
            if outlier is not None and not self._confirmed(sample):
                return False, outlier
            if step_s > GAP_S and step_s > GAP_STEPS * self._step_s:
                notice = Notice("time_s", f"a gap of {step_s:.6g} s", "lines more often")
        self.keep(sample)
        return True, notice

    def keep(self, sample: Sample) -> None:
        """Make a sample the reference of the next."""
        if self._last is not None:
            self._step_s = sample.time_s - self._last.time_s
        self._last, self._rejected, self._agreeing = sample, None, 0

    def _confirmed(self, sample: Sample) -> bool:
        """Whether enough consecutive outliers agree with one another."""
        before, self._rejected = self._rejected, sample
        agrees = before is not None and sample.time_s > before.time_s and self._outlier(before, sample) is None
        self._agreeing = self._agreeing + 1 if agrees else 1
        return self._agreeing >= MIN_AGREEING

    def _outlier(self, before: Sample, sample: Sample) -> Notice | None:
        step_s = sample.time_s - before.time_s
        if step_s > MAX_GAP_S:
            expected = f"{MAX_GAP_S:g} s or less, or {MIN_AGREEING} lines in a row that agree"
            return Notice("time_s", f"{step_s:.6g} s after the last line", expected)
        distance_m = math.dist((before.x_m, before.y_m), (sample.x_m, sample.y_m))
        if distance_m > self._max_mps * step_s + SLACK_M:
            expected = f"a position that can be reached, or {MIN_AGREEING} lines in a row that agree"
            return Notice("x_m", f"{distance_m:.6g} m from the last line's position, {step_s:.6g} s before", expected)
        return None


class LiveFlight:
    """A flight tracked through its plan by telemetry, and its planner.

    Parameters
    ----------
    mission : Mission
        Known before take-off. The flight starts at the first sample if that is far from the mission's start.
    make, make_forecast : function of a Mission
        A new planner, and a forecast for planners without their own.
    every_s : float
        Maximum time between two pieces of advice [s].

    Attributes
    ----------
    complete : bool
        Whether the plan is complete.
    forecast_completes : bool
        Whether it is, or is forecast at the last sample to be complete before the battery is empty.
    """

    def __init__(
        self,
        mission: Mission,
        make: Callable[[Mission], Planner],
        make_forecast: Callable[[Mission], HeldForecast],
        every_s: float,
    ) -> None:
        self._mission = mission
        self._names = mission.plan.names
        self._make, self._make_forecast = make, make_forecast
        self._every_s = every_s
        self._started = False
        self._planner: Planner
        self._executor: PlanExecutor
        self._forecast: HeldForecast
        self._ground = _GroundVelocity(mission.cruise_mps)
        self._origin_s = 0.0
        self._last: tuple[float, Point, float] = (0.0, (0.0, 0.0), 1.0)
        self._decision = Decision(mission.parameters, 0.0)
        self._next_s = -math.inf
        self._lost = self._empty = False
        self._past_stage: int | None = None
        self._failure = ""
        self._reasons: list[str] = []
        self._notices: list[Notice] = []
        self._noticed: set[str] = set()
        self.complete = False
        self.forecast_completes = False

    def update(self, sample: Sample) -> tuple[Advice | None, tuple[Notice, ...]]:
        """Update with a sample later than the last one; return advice, if any is due, and notices."""
        self._notices, self._reasons = [], []
        if not self._started:
            self._start(sample)
        velocity = self._ground.update(sample)
        if self.complete:
            return None, ()
        time_s, position = sample.time_s - self._origin_s, (sample.x_m, sample.y_m)
        if sample.soc <= 0:
            return self._run_empty(sample), ()
        self._empty = False
        before = self._decision
        self._track(sample)
        self._put_in_force(sample)
        self._last = (time_s, position, sample.soc)
        if self._executor.complete:
            self.complete = self.forecast_completes = True
            return self._advice(sample, COMPLETED, sample.wind_mps, sample.soc, 1.0, remaining_s=0.0), self._all()
        observation = self._observation(time_s, position, sample.soc)._replace(
            power_w=sample.power_w,
            wind_mps=sample.wind_mps,
            velocity_mps=velocity,
            heading_rad=sample.heading_rad,
        )
        self._update_planner(observation)
        changed = self._decision.parameters != before.parameters
        replanned = self._decision.record is not before.record or self._decision.reason != before.reason
        if not (changed or replanned or time_s >= self._next_s - 1e-9):
            return None, self._all()
        advice = self._advise(sample, observation)
        self._next_s = next_multiple(time_s, self._every_s)
        self.forecast_completes = (advice.soc_end_forecast or 0.0) > 0
        return advice, self._all()

    # --- the plan

    def _start(self, sample: Sample) -> None:
        """Set location and time of the start from the first sample."""
        mission = self._mission
        self._origin_s = 0.0 if 0 <= sample.time_s <= CLOCK_START_S else sample.time_s
        position, start = (sample.x_m, sample.y_m), mission.start_m
        elapsed_s = sample.time_s - self._origin_s
        if start is None or math.dist(position, start) > SPEED_FACTOR * mission.cruise_mps * elapsed_s + SLACK_M:
            start = position
        mission = replace(mission, start_m=start)
        self._planner = self._make(mission)
        self._forecast = self._make_forecast(mission)
        self._executor = PlanExecutor(mission.plan, mission.parameters, start, mission.rules)
        self._last = (min(0.0, elapsed_s), start, sample.soc)
        self._reasons.append(TAKE_OFF)
        self._started = True

    def _track(self, sample: Sample) -> None:
        """Advance the plan along the straight line from the last sample; a reported stage has precedence."""
        if self._lost:
            return
        executor = self._executor
        (t0, (x0, y0), soc0), position = self._last, (sample.x_m, sample.y_m)
        t1 = sample.time_s - self._origin_s
        try:
            skips = self._skips(sample)
            steps = min(max(1, math.ceil(math.dist((x0, y0), position) / STEP_M)), MAX_STEPS)
            for k in range(1, steps + 1):
                part = k / steps
                x, y = x0 + part * (position[0] - x0), y0 + part * (position[1] - y0)
                if skips is not None:
                    executor.stay(x, y)
                elif executor.advance(x, y) and k < steps:
                    # a stage has started between two samples: the planner observes it at that time
                    time_s, soc = t0 + part * (t1 - t0), soc0 + part * (sample.soc - soc0)
                    self._update_planner(self._observation(time_s, (x, y), soc))
                if executor.complete:
                    return
            for k in range(1, (skips or 0) + 1):
                executor.skip(position)
                if executor.complete:
                    return
                if k < (skips or 0):  # a skipped stage: its start is interpolated
                    time_s = t0 + k / (skips or 1) * (t1 - t0)
                    self._update_planner(self._observation(time_s, position, sample.soc))
        except EadpError as error:
            self._lose(error)

    def _skips(self, sample: Sample) -> int | None:
        """Number of stages to advance to the reported one; None where positions decide."""
        executor, reported = self._executor, sample.stage
        if reported is None:
            return None
        now, count = executor.stage.index, len(self._mission.plan.stages)
        if reported > count:
            self._notice_once("stage", f"there is no stage {reported}; ignored", f"one of 1 to {count}")
            return None
        to = executor.stages_to(reported)
        if reported == now:
            self._past_stage = None
            # only positions distinguish the laps of a plan of one stage
            return None if to == 1 else 0
        lap = executor.stages_to(now) if reported < now else None
        # 4 → 1 is the next lap; 3 → 2 is a jump back, since forwards is the longer way
        if to is None or (reported < now and lap is not None and 2 * to > lap):
            if self._past_stage != reported:
                self._past_stage = reported
                what = f"stage {reported} is before stage {now}, which is flown; ignored"
                self._notices.append(Notice("stage", what, "a stage ahead"))
            return None
        self._past_stage = None
        return to

    def _put_in_force(self, sample: Sample) -> None:
        """Put the reported parameters in force."""
        if not sample.parameters or self._lost:
            return
        values, sets = list(self._executor.parameters), self._executor.stage.sets
        for name, value in sample.parameters.items():
            if name not in self._names:
                expected = f"one of {', '.join(self._names) or 'none'}"
                what = f"the plan has no parameter {printable(name, 40)}; ignored"
                self._notice_once("parameters", what, expected, name)
                continue
            i = self._names.index(name)
            values[i] = clipped = sets[i].clip(value) if sets else value
            if clipped != value:
                expected = f"a value in [{sets[i].lo:g}, {sets[i].hi:g}]"
                what = f"{name} = {value:g} is outside its set; clipped"
                self._notice_once("parameters", what, expected, f"{name} outside")
        try:
            self._executor.take_in_force(values, (sample.x_m, sample.y_m))
        except EadpError as error:
            self._lose(error)

    def _lose(self, error: EadpError) -> None:
        """Stop tracking the plan: stage and parameters stay."""
        self._lost = True
        self._notices.append(Notice("x_m", f"the plan cannot be followed on from here: {error}"))

    def _notice_once(self, key: str, message: str, expected: str, about: str = "") -> None:
        """Add a notice unless there has been one about the same; the default is the same message."""
        if (about or message) not in self._noticed and len(self._noticed) < MAX_NOTICES:
            self._noticed.add(about or message)
            self._notices.append(Notice(key, message, expected))

    def _all(self) -> tuple[Notice, ...]:
        return tuple(self._notices)

    # --- the planner

    def _observation(self, time_s: float, position: Point, soc: float) -> Observation:
        """What is known at any time, between two samples as well."""
        executor = self._executor
        joined_m, started = executor.joined_m, executor.stages_started
        return Observation(time_s, *position, executor.cursor, joined_m, started, None, soc)

    def _update_planner(self, observation: Observation) -> None:
        """Update the planner with an observation, and the plan with its decision."""
        before = self._decision
        try:
            self._forecast.observe(observation)
            self._decision = self._planner.update(observation)
        except Exception as error:  # in flight, a failure of the planner must not stop the advice
            what = f"the planner failed, and parameters stay: {type(error).__name__}: {printable(str(error))}"
            if what != self._failure:
                self._failure = what
                self._notices.append(Notice("time_s", what))
            return
        if self._decision.parameters is before.parameters:
            return
        if self._decision.parameters != before.parameters:
            self._reasons.append(self._decision.reason)
        if not self._lost:
            try:
                self._executor.decide(self._decision.parameters, (observation.x_m, observation.y_m))
            except EadpError as error:
                self._lose(error)

    # --- advice

    def _advise(self, sample: Sample, observation: Observation) -> Advice:
        decision, record = self._decision, self._decision.record
        if record is not None and observation.time_s - record.time_s > max(RECENT_S, 3 * self._every_s):
            record = None
        if decision.reason not in self._reasons and not (self._reasons and decision.reason.startswith(KEPT)):
            self._reasons.append(decision.reason)
        reason = "; ".join(reason for reason in self._reasons if reason) or KEPT
        if record is not None and record.soc_end is None:  # of a planner without a forecast
            record = None
        wind_mps, end = sample.wind_mps, None
        if record is not None:
            wind_mps = record.wind_mps
        elif not self._lost:
            try:
                end = self._forecast.at(observation, decision.parameters)
            except EadpError:
                end = None
        if (known := record or end) is None:
            return self._advice(sample, reason, wind_mps)
        end_of = known.soc_end, known.completes_probability, known.reserve_probability, known.remaining_s
        return self._advice(sample, reason, wind_mps, *end_of)

    def _run_empty(self, sample: Sample) -> Advice | None:
        """The battery is measured to be empty: no decisions until it is not."""
        self.forecast_completes = False
        if self._empty:
            return None
        self._empty = True
        self._next_s = -math.inf
        return self._advice(sample, EMPTY, sample.wind_mps, 0.0, 0.0)

    def _advice(
        self,
        sample: Sample,
        reason: str,
        wind_mps: Point | None,
        soc_end: float | None = None,
        completes: float | None = None,
        reserve: float | None = None,
        remaining_s: float | None = None,
    ) -> Advice:
        return Advice(
            sample.time_s,
            self._executor.stage.index,
            self._executor.cursor.lap,
            self._named(self._decision.parameters),
            self._named(self._executor.parameters),
            _finite(soc_end),
            _finite(completes),
            _finite(reserve),
            _finite(remaining_s),
            wind_mps,
            reason,
        )

    def _named(self, parameters: Vector) -> dict[str, float]:
        return dict(zip(self._names, parameters, strict=True))


class _GroundVelocity:
    """Ground velocity: measured, else estimated from the positions of the last seconds."""

    def __init__(self, cruise_mps: float) -> None:
        self._max_mps = SPEED_FACTOR * cruise_mps
        self._positions: deque[tuple[float, float, float]] = deque()

    def update(self, sample: Sample) -> Point | None:
        """The velocity at a sample [m/s]; None if unknown.

        Source: the least-squares parabola through the positions, its slope at the last one, so that turns do not lag.
        """
        positions = self._positions
        if positions and sample.time_s - positions[-1][0] > MAX_CHORD_S:
            positions.clear()
        positions.append((sample.time_s, sample.x_m, sample.y_m))
        while len(positions) > 2 and sample.time_s - positions[0][0] > WINDOW_S:
            positions.popleft()
        if sample.velocity_mps is not None:
            return sample.velocity_mps
        data = np.array(positions)
        times, offsets = data[:, 0] - sample.time_s, data[:, 1:] - data[-1, 1:]
        if len(positions) < 2 or -times[0] < MIN_SPAN_S:
            return None
        columns = [np.ones_like(times), times, times**2][: len(positions)]
        slopes = np.linalg.lstsq(np.stack(columns, axis=1), offsets, rcond=None)[0][1]
        vx, vy = float(slopes[0]), float(slopes[1])
        return (vx, vy) if math.hypot(vx, vy) <= self._max_mps else None


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
