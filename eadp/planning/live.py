"""A planner on a real flight: samples of telemetry to observations, decisions to advice. No files, no clock.

`LiveFlight` tracks the plan with the samples that the gate accepts and updates the planner. Both depend on their input
alone, so that a flight is restored from the same samples.
"""

from __future__ import annotations

import contextlib
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
from eadp.models.plan.plan import Plan
from eadp.planning.acquisition import Acquisition
from eadp.planning.base import Decision, DecisionRecord, Mission, Observation, Planner, next_multiple
from eadp.planning.ending import Continuation, is_certain
from eadp.planning.forecast.evaluate import Forecast
from eadp.planning.forecast.held import HeldForecast
from eadp.planning.gate import GAP_S, GAP_STEPS, SLACK_M, SPEED_FACTOR, Notice, Sample
from eadp.planning.locator import Locator, Sighting
from eadp.planning.state.flight_state import FlightState

WINDOW_S, MIN_SPAN_S, MAX_CHORD_S = 2.5, 0.9, 3.0
"""Window of positions for the ground velocity, its minimum span, and the maximum step in it [s]."""

CLOCK_START_S = 10.0
"""A clock up to this at the first sample has started with the flight; any other counts from the first sample."""

RECENT_S = 10.0
"""Maximum age of a decision record that counts as a forecast [s], if it exceeds three re-plannings."""

APPLY_S, SAME_SHARE = 10.0, 0.01
"""Time in which the aircraft applies a parameter [s]; and by how much a value may be off, as a share of its set."""

APART_S = 3.0
"""By how much the aircraft may start a stage before positions show it, or after [s]."""

STALE, STAGE_UNKNOWN, NOT_APPLIED = "stale", "stage-unknown", "not-applied"
"""Codes of warnings: position or charge is not measured, the stage is not certain, parameters are not applied."""

MAX_NOTICES = 100
COMPLETED, EMPTY, TAKE_OFF, KEPT = "final point reached", "battery empty", "take-off", "kept"
SEARCHED, FOUND = "stage and lap are not known yet: parameters stay", "stage and lap are found"
GOES_ON = "the flight goes on after the final point"
UNCERTAIN_END = "final point passed by less than the error of a position"


class Ending(NamedTuple):
    """Forecast of the end of the plan; None where it is unknown.

    Attributes
    ----------
    soc_end, soc_end_std : float or None
        State of charge, negative by the shortfall of charge; and its standard deviation.
    completes_probability, reserve_probability : float or None
        Probabilities that the battery is not empty before, and that the reserve is kept.
    remaining_s : float or None
        Time to it [s].
    energy_wh, energy_std_wh : float or None
        Energy to it, and its standard deviation [Wh].
    """

    soc_end: float | None = None
    soc_end_std: float | None = None
    completes_probability: float | None = None
    reserve_probability: float | None = None
    remaining_s: float | None = None
    energy_wh: float | None = None
    energy_std_wh: float | None = None

    @classmethod
    def of(cls, known: DecisionRecord | Forecast) -> Ending:
        """That of a record or a forecast; numbers that are not finite are unknown."""
        values = [getattr(known, name) for name in cls._fields]
        return cls(*[value if value is not None and math.isfinite(value) else None for value in values])


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
    ending : Ending
        Forecast of the end of the plan.
    wind_mps : (float, float) or None
        Estimated wind [m/s].
    reason : str
        The decision and its reason, in words.
    warnings : tuple of str
        Codes of what is wrong with the telemetry.
    """

    time_s: float
    stage: int
    lap: int
    parameters: Mapping[str, float]
    in_force: Mapping[str, float]
    ending: Ending
    wind_mps: Point | None
    reason: str
    warnings: tuple[str, ...]


class LiveFlight:
    """A flight tracked through its plan by telemetry, and its planner.

    Parameters
    ----------
    mission : Mission
        Known before take-off. The flight starts at the first sample with a position if that is far from the mission's
        start.
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
        self._started = self._planning = False
        self._planner: Planner
        self._locator: Locator
        self._forecast: HeldForecast
        self._state: FlightState
        self._ground = _GroundVelocity(mission.cruise_mps)
        self._applied = AppliedParameters(mission.parameters, mission.plan)
        self._origin_s = 0.0
        self._located: tuple[float, Point] = (0.0, (0.0, 0.0))
        self._usual_s = 0.0
        self._last: tuple[float, float] = (0.0, 1.0)
        self._decision = Decision(mission.parameters)
        self._next_s = -math.inf
        self._lost = self._empty = self._measured = False
        self._acquisition: Acquisition | None = None
        self._continuation: Continuation | None = None
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
            if sample.position_m is None and self._mission.start_m is None:
                return None, (Notice("x_m", "the flight starts at the first position", "a position"),)
            self._start(sample)
        velocity = self._ground.update(sample)
        if self.complete and self._continuation is None:
            return None, ()
        if not self.complete and sample.soc is not None and sample.soc <= 0:
            return self._run_empty(sample), ()
        time_s = sample.time_s - self._origin_s
        known_soc = self._state.soc if self._planning else self._last[1]
        soc = known_soc if sample.soc is None else sample.soc
        self._empty, self._measured = False, sample.soc is not None
        before = self._decision
        was_found = self._acquisition is None or self._acquire(self._acquisition, sample, time_s, velocity)
        if not self._planning:
            return self._unknown(sample, time_s), self._all()
        position = self._located[1]
        if was_found:
            position = self._track(sample, time_s, soc, velocity)
            self._put_in_force(sample, time_s, position)
        step_s, self._last = time_s - self._last[0], (time_s, soc)
        was_complete = self.complete
        self._update_end(_sighting(sample, time_s, velocity), position, step_s)
        if self.complete:
            if was_complete:
                return None, ()
            return self._advice(sample, COMPLETED, sample.wind_mps, Ending(soc, 0.0, 1.0, remaining_s=0.0)), self._all()
        observation = self._observation(time_s, position, soc)._replace(
            power_w=sample.power_w,
            wind_mps=sample.wind_mps,
            velocity_mps=velocity,
            heading_rad=sample.heading_rad,
            airspeed_mps=sample.airspeed_mps,
        )
        self._update_planner(observation)
        changed = self._decision.parameters != before.parameters
        replanned = self._decision.record is not before.record or self._decision.reason != before.reason
        if not (changed or replanned or time_s >= self._next_s - 1e-9):
            return None, self._all()
        advice = self._advise(sample, observation)
        self._next_s = next_multiple(time_s, self._every_s)
        self.forecast_completes = self._continuation is not None or (advice.ending.soc_end or 0.0) > 0
        return advice, self._all()

    # --- the plan

    @property
    def _executor(self) -> PlanExecutor:
        return self._locator.executor

    def _start(self, sample: Sample) -> None:
        """Set location and time of the start from the first sample."""
        mission = self._mission
        self._origin_s = 0.0 if 0 <= sample.time_s <= CLOCK_START_S else sample.time_s
        position, start = sample.position_m, mission.start_m
        mission_start = start
        elapsed_s = sample.time_s - self._origin_s
        if position is not None:
            reach_m = SPEED_FACTOR * mission.cruise_mps * elapsed_s + SLACK_M
            start = start if start is not None and math.dist(position, start) <= reach_m else position
        assert start is not None
        mission = replace(mission, start_m=start, live=True)
        executor = PlanExecutor(mission.plan, mission.parameters, start, mission.rules)
        time_s = min(0.0, elapsed_s)
        self._locator = Locator(executor, mission.cruise_mps, time_s)
        self._located = (time_s, start)
        self._last = (time_s, mission.battery.soc if sample.soc is None else sample.soc)
        self._started = True
        away = position is not None and start is position and mission_start is not None
        if away or sample.stage not in (None, 1) or (sample.stages_started or 1) > 1:
            self._acquisition = Acquisition(executor, mission_start or start)
        else:
            self._plan_with(mission)
            self._reasons.append(TAKE_OFF)

    def _plan_with(self, mission: Mission) -> None:
        self._planner, self._forecast = self._make(mission), self._make_forecast(mission)
        self._state = self._planner.flight_state()
        self._planning = True

    def _acquire(self, acquisition: Acquisition, sample: Sample, time_s: float, velocity: Point | None) -> bool:
        """Find stage and lap where telemetry begins in the middle of the flight; return whether it begins at the start.

        Planning starts with the stage. Path parameters are held until the lap is found.
        """
        reported = {self._names.index(name): value for name, value in sample.parameters.items() if name in self._names}
        acquisition.update(_sighting(sample, time_s, velocity), reported)
        if acquisition.is_start:
            self._acquisition = None
            self._plan_with(replace(self._mission, start_m=self._executor.joined_m, live=True))
            self._reasons.append(TAKE_OFF)
            return True
        best, rho = acquisition.hypotheses[0], self._mission.plan.path_count
        path = best.executor.cursor.waiting[:rho]
        if acquisition.stage_found and not self._planning:
            parameters = (*path, *best.executor.parameters[rho:])
            self._decision, self._last = Decision(parameters), (time_s, self._last[1])
            self._plan_with(replace(self._mission, parameters=parameters, start_m=best.executor.joined_m, live=True))
        elif self._planning and path != self._decision.parameters[:rho]:
            self._decision = self._decision._replace(parameters=(*path, *self._decision.parameters[rho:]))
        if self._planning:
            self._planner.hold({} if acquisition.settled else dict(enumerate(path)))
        self._applied = AppliedParameters((*path, *self._decision.parameters[rho:]), self._mission.plan)
        self._locator = Locator(best.executor, self._mission.cruise_mps, time_s, sample.position_m)
        self._locator.hypotheses, self._locator.through_gap = [best], True
        if sample.position_m is not None:
            self._usual_s, self._located = time_s - self._located[0], (time_s, sample.position_m)
            self._locator.decide(self._applied.effective, sample.position_m)
        if acquisition.settled:
            self._acquisition = None
            self._reasons.append(FOUND)
        return False

    def _track(self, sample: Sample, time_s: float, soc: float, velocity: Point | None) -> Point:
        """Find the position in the plan; return that of the aircraft, or its forecast [m].

        In ordinary flight the plan is advanced along the straight line from the last sample, and a reported stage has
        precedence.
        """
        (located_s, last), position = self._located, sample.position_m
        step_s = time_s - located_s
        gap = step_s > GAP_S and (position is None or step_s > GAP_STEPS * self._usual_s)
        if position is not None:
            self._located, self._usual_s = (time_s, position), step_s
        if self._lost:
            return position or last
        sighting = _sighting(sample, time_s, velocity)
        try:
            if gap or self._locator.lost:
                found = self._seek(sighting, soc)
                if found is not None or position is None:
                    return found or last
            elif position is None:
                return last
            self._follow(sighting, soc)
        except EadpError as error:
            self._lose(error)
        assert position is not None
        return position

    def _update_end(self, to: Sighting, position: Point, step_s: float) -> None:
        """Find out whether the plan is complete: an end may be uncertain, and the aircraft may fly on all the same."""
        if self._continuation is not None:
            goes_on = self._continuation.update(self._executor, to, step_s)
            if goes_on is None:
                return
            self._continuation = None
            if goes_on and self.complete:
                self._locator.through_gap = True
            if goes_on:
                self._reasons.append(GOES_ON)
                self._notices.append(Notice("x_m", GOES_ON))
            self.complete = self.forecast_completes = not goes_on
        elif self._executor.complete:
            certain, goes_on = is_certain(self._executor, position, to.course_rad), self._locator.go_on()
            self.complete = certain or not goes_on
            self.forecast_completes = True
            if goes_on:
                self._continuation = Continuation(self._executor)
            if not self.complete:
                self._reasons.append(UNCERTAIN_END)

    def _follow(self, to: Sighting, soc: float) -> None:
        """Advance to a sample; the planner observes each stage that starts before it, at that time."""
        t0, soc0 = self._last

        def started(time_s: float, position: Point, part: float) -> None:
            self._update_planner(self._observation(max(time_s, t0), position, soc0 + part * (soc - soc0)))

        self._locator.follow(to, self._skips(to), started)

    def _seek(self, sighting: Sighting, soc: float) -> Point | None:
        """Find the flight again after a gap; the planner observes the stage at the time at which it started."""
        before = self._executor.stages_started
        found = self._locator.seek(sighting, self._state.wind_mps)
        since_s = self._locator.hypotheses[0].since_s
        if found is not None and self._executor.stages_started != before and self._last[0] < since_s < sighting.time_s:
            self._update_planner(self._observation(since_s, self._executor.joined_m, soc))
        return found

    def _skips(self, to: Sighting) -> int | None:
        """Number of stages to advance to the reported one; None where positions decide."""
        executor, reported = self._executor, to.stage
        if to.stages_started is not None:
            ahead = to.stages_started - executor.stages_started
            if self._locator.leads(ahead):
                return ahead
            what = f"{to.stages_started} stages started, and {executor.stages_started} are flown; ignored"
            self._notice_once("stages_started", what, "a stage ahead")
        if reported is None:
            return None
        now, count = executor.stage.index, len(self._mission.plan.stages)
        if reported > count:
            self._notice_once("stage", f"there is no stage {reported}; ignored", f"one of 1 to {count}")
            return None
        skips = executor.stages_to(reported)
        if reported == now:
            self._past_stage = None
            # only positions distinguish the laps of a plan of one stage
            return None if skips == 1 else 0
        lap = executor.stages_to(now) if reported < now else None
        # 4 → 1 is the next lap; 3 → 2 is a jump back, since forwards is the longer way
        if skips is None or (reported < now and lap is not None and 2 * skips > lap):
            if self._past_stage != reported:
                self._past_stage = reported
                what = f"stage {reported} is before stage {now}, which is flown; ignored"
                self._notices.append(Notice("stage", what, "a stage ahead"))
            return None
        self._past_stage = None
        return skips

    def _put_in_force(self, sample: Sample, time_s: float, position: Point) -> None:
        """Put the reported parameters in force, and hold those that the aircraft does not change."""
        if not sample.parameters or self._lost:
            return
        expected, sets = self._executor.parameters, self._executor.stage.sets
        values = list(expected)
        reported: dict[int, float] = {}
        for name, value in sample.parameters.items():
            if name not in self._names:
                known = f"one of {', '.join(self._names) or 'none'}"
                what = f"the plan has no parameter {printable(name, 40)}; ignored"
                self._notice_once("parameters", what, known, name)
                continue
            i = self._names.index(name)
            values[i] = reported[i] = clipped = sets[i].clip(value) if sets else value
            if clipped != value:
                known = f"a value in [{sets[i].lo:g}, {sets[i].hi:g}]"
                what = f"{name} = {value:g} is outside its set; clipped"
                self._notice_once("parameters", what, known, f"{name} outside")
        if not self._executor.cursor.table.live:
            for i in self._applied.apart(time_s, reported, expected):
                values[i] = expected[i]
        try:
            self._locator.take_in_force(values, position)
            if self._applied.update(time_s, reported, expected):
                self._hold(position)
        except EadpError as error:
            self._lose(error)

    def _hold(self, position: Point) -> None:
        """Plan with the parameters that the aircraft changes; the others stay."""
        held = self._applied.held
        self._planner.hold(held)
        self._locator.decide(self._applied.effective, position)
        for i, value in held.items():
            asked = self._applied.asked[i]
            what = f"{self._names[i]} = {asked:g} is not applied: {value:g} stays in force"
            self._notice_once("parameters", what, "the parameters decided", f"{self._names[i]} held at {value:g}")

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
        gap = self._locator.through_gap
        return Observation(time_s, *position, executor.cursor, joined_m, started, None, soc, through_gap=gap)

    def _update_planner(self, observation: Observation) -> None:
        """Update the planner with an observation, and the plan with its decision; not once the plan is complete."""
        if self.complete:
            return
        before = self._decision
        try:
            self._state.observe(observation if self._measured else observation._replace(soc=math.nan))
            self._decision = self._planner.update(observation._replace(state=self._state))
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
        self._applied.decide(self._decision.parameters)
        if not self._lost:
            try:
                self._locator.decide(self._applied.effective, (observation.x_m, observation.y_m))
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
            with contextlib.suppress(EadpError):
                known = self._state.known(observation.time_s, (observation.x_m, observation.y_m))
                end = self._forecast.at(known, self._applied.effective)
        forecast = record or end
        return self._advice(sample, reason, wind_mps, Ending() if forecast is None else Ending.of(forecast))

    def _unknown(self, sample: Sample, time_s: float) -> Advice | None:
        """Stage and lap are not known yet: the parameters stay."""
        if time_s < self._next_s - 1e-9:
            return None
        self._next_s = next_multiple(time_s, self._every_s)
        return self._advice(sample, SEARCHED, sample.wind_mps, Ending())

    def _run_empty(self, sample: Sample) -> Advice | None:
        """The battery is measured to be empty: no decisions until it is not."""
        self.forecast_completes = False
        if self._empty:
            return None
        self._empty = True
        self._next_s = -math.inf
        return self._advice(sample, EMPTY, sample.wind_mps, Ending(0.0, completes_probability=0.0))

    def _advice(self, sample: Sample, reason: str, wind_mps: Point | None, ending: Ending) -> Advice:
        return Advice(
            sample.time_s,
            self._executor.stage.index,
            self._executor.cursor.lap,
            self._named(self._applied.asked),
            self._named(self._executor.parameters),
            ending,
            wind_mps,
            reason,
            self._warnings(sample),
        )

    def _warnings(self, sample: Sample) -> tuple[str, ...]:
        known = {
            STALE: sample.position_m is None or sample.soc is None,
            STAGE_UNKNOWN: self._lost or self._locator.uncertain or self._undecided,
            NOT_APPLIED: bool(self._applied.held),
        }
        return (
            *sample.warnings,
            *(code for code, holds in known.items() if holds),
            *(self._state.warnings if self._planning else ()),
        )

    @property
    def _undecided(self) -> bool:
        """Whether stage and lap are being found, or an end is uncertain."""
        return self._acquisition is not None or (self._continuation is not None and not self.complete)

    def _named(self, parameters: Vector) -> dict[str, float]:
        return dict(zip(self._names, parameters, strict=True))


def _sighting(sample: Sample, time_s: float, velocity: Point | None) -> Sighting:
    course = math.atan2(velocity[1], velocity[0]) if velocity is not None else None
    return Sighting(time_s, sample.position_m, course, sample.stage, sample.stages_started)


class AppliedParameters:
    """Which of the parameters decided the aircraft applies, by those that it reports to be in force.

    A parameter that should have changed `APPLY_S` before, and is still reported as it was, is held: it keeps that value
    until another value of it is reported.

    Parameters
    ----------
    parameters : tuple of float
        Decided at take-off.
    plan : Plan

    Attributes
    ----------
    asked : tuple of float
        Parameters to fly with; of those that are held, the values decided before.
    held : dict of int to float
        Parameters that are held, by index, and the values reported.
    """

    def __init__(self, parameters: Vector, plan: Plan) -> None:
        self.asked = parameters
        self.held: dict[int, float] = {}
        boxes = [plan.hull(i) for i in range(len(parameters))] if plan.has_sets else []
        self._tolerances = [SAME_SHARE * (box.hi - box.lo) for box in boxes] or [0.0] * len(parameters)
        self._reported: dict[int, float] = {}
        self._before: dict[int, float] = {}
        """Reported when another value was decided."""
        self._refused_s: dict[int, float] = {}
        self._ahead_s: dict[int, float] = {}
        self._expected = parameters
        self._left: dict[int, tuple[float, float]] = {}
        """Values in force before the last change, and the time of that [s]."""

    @property
    def effective(self) -> Vector:
        """The parameters that will be in force."""
        return tuple([self.held.get(i, value) for i, value in enumerate(self.asked)])

    def decide(self, parameters: Vector) -> None:
        """Take a decision."""
        asked = list(self.asked)
        for i, value in enumerate(parameters):
            if i not in self.held and value != asked[i]:
                asked[i] = value
                if i in self._reported:
                    self._before[i] = self._reported[i]
        self.asked = tuple(asked)

    def update(self, time_s: float, reported: Mapping[int, float], expected: Vector) -> bool:
        """Take parameters reported, and those in force by the plan's rules; return whether those held have changed."""
        self._reported |= reported
        held = dict(self.held)
        for i, value in reported.items():
            if i in self.held:
                if not self._same(i, value, self.held[i]):
                    del self.held[i], self._before[i]
                continue
            unchanged = i in self._before and self._same(i, value, self._before[i])
            if not unchanged or self._same(i, value, self.asked[i]):
                self._refused_s.pop(i, None)
            elif not self._same(i, value, expected[i]):  # else it waits for its stage
                self._refused_s.setdefault(i, time_s)
            if time_s - self._refused_s.get(i, math.inf) >= APPLY_S:
                self.held[i] = value
                del self._refused_s[i]
        return held != self.held

    def apart(self, time_s: float, reported: Mapping[int, float], expected: Vector) -> list[int]:
        """Parameters reported as in the stage before, or as in the next one, where that has started in `APART_S`."""
        for i, value in enumerate(expected):
            if value != self._expected[i]:
                self._left[i] = self._expected[i], time_s
        self._expected = expected
        others = {i: value for i, value in reported.items() if not self._same(i, value, expected[i])}
        ahead = [i for i, value in others.items() if self._same(i, value, self.asked[i])]
        self._ahead_s = {i: self._ahead_s.get(i, time_s) for i in ahead}
        left = {i: since_s for i, (value, since_s) in self._left.items() if i in others and others[i] == value}
        return [i for i, since_s in (self._ahead_s | left).items() if time_s - since_s < APART_S]

    def _same(self, i: int, one: float, other: float) -> bool:
        return abs(one - other) <= self._tolerances[i]


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
        position = sample.position_m
        if position is None:
            return sample.velocity_mps
        if positions and sample.time_s - positions[-1][0] > MAX_CHORD_S:
            positions.clear()
        positions.append((sample.time_s, *position))
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
