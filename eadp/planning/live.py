"""A planner on a real flight: from telemetry to observations, from decisions to advice. No files, no clock.

A `OutlierGate` judges which fixes can be believed, a `LiveFlight` follows the plan through those that are and asks the
planner. Both depend on what they are given alone, so that a flight is restored by giving them the same fixes again.
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
from eadp.planning.base import Decision, DecisionRecord, Mission, Observation, Planner, next_multiple
from eadp.planning.joint.forecaster import Forecast
from eadp.planning.joint.held import HeldForecast

GAP_S, GAP_STEPS = 5.0, 3.0
"""A gap: this long [s], and so many times as long as the step before."""

LONGEST_GAP_S = 3600.0
FASTEST, SLACK_M = 3.0, 50.0
"""How far a fix may lie from the last one: so many times as far as the cruise speed goes, and some more [m]."""
BELIEVED = 3
"""So many fixes in a row that agree with one another are believed, however far from the last one."""

STEP_M, MOST_STEPS = 1.0, 5000
"""Between two fixes triggers are looked for this often."""

WINDOW_S, LEAST_SPAN_S, LONGEST_CHORD_S = 2.5, 0.9, 3.0
"""Velocity is told from the positions of so long, where they span at least and no step is longer than that [s]."""

CLOCK_STARTS_S = 10.0
"""A clock that begins no later than this began with the flight; any other is counted from the first fix."""

RECENT_S = 10.0
"""A record older than this, and than three re-plannings, is no forecast any more."""

COMPLETED, EMPTY, TAKE_OFF, KEPT = "final point reached", "battery empty", "take-off", "kept"


class Sample(NamedTuple):
    """One line of telemetry.

    Attributes
    ----------
    time_s, x_m, y_m : float
        Any clock that rises [s]; local frame [m].
    power_w : float or None
        Measured, motion and computations [W]; None where the sensor has no reading.
    soc : float
        State of charge, 0 to 1.
    stage : int or None
        That is flown, from 1 within the plan's stages, where the autopilot tells it.
    wind_mps, velocity_mps : (float, float) or None
        Where the wind blows towards, velocity over ground [m/s].
    heading_rad : float or None
        Of the nose, 0 east, counter-clockwise.
    parameters : mapping of name to value
        In force, as far as told.
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
    """Something odd about a fix: about which key, what, and what was expected."""

    key: str
    message: str
    expected: str = ""


class Advice(NamedTuple):
    """What a planner advises at a fix.

    Attributes
    ----------
    time_s : float
        Of the fix.
    stage, lap : int
        Being flown, from 1 and from 0.
    parameters, in_force : mapping of name to value
        Decided, to be flown with; and those that the plan has put into force, where path parameters may wait.
    soc_end_forecast : float or None
        State of charge at the end of the plan, below 0 where the battery is short; None where it cannot be told.
    completes_probability, reserve_probability : float or None
        That the battery is not empty before the end; that the reserve is kept. None where the planner tells none.
    remaining_s : float or None
        To the end of the plan [s].
    wind_mps : (float, float) or None
        As estimated [m/s].
    reason : str
        What has been decided and why, in words.
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
    """Judges fixes before they are used: those that are late are not, and outliers are not at first.

    Parameters
    ----------
    cruise_mps : float
        Airspeed of the aircraft [m/s].
    """

    def __init__(self, cruise_mps: float) -> None:
        self._reach_mps = FASTEST * cruise_mps
        self._last: Sample | None = None
        self._step_s = 0.0
        self._doubted: Sample | None = None
        self._agreeing = 0

    def judge(self, fix: Sample) -> tuple[bool, Notice | None]:
        """Whether a fix can be used, and what is odd about it; one that can be is to be kept."""
        last = self._last
        if last is None:
            return True, None
        step_s = fix.time_s - last.time_s
        if step_s <= 0:
            what = f"late: {fix.time_s:.15g} s is not after {last.time_s:.15g} s"
            return False, Notice("time_s", what, "a time after the last line's")
        doubt = self._doubt(last, fix)
        if doubt is not None:
            agrees = (
                self._doubted is not None
                and fix.time_s > self._doubted.time_s
                and self._doubt(self._doubted, fix) is None
            )
            self._agreeing = self._agreeing + 1 if agrees else 1
            self._doubted = fix
            if self._agreeing < BELIEVED:
                return False, doubt
        if step_s > GAP_S and step_s > GAP_STEPS * self._step_s:
            return True, Notice("time_s", f"a gap of {step_s:.6g} s", "lines more often")
        return True, None

    def keep(self, fix: Sample) -> None:
        """A fix is used: later ones are judged by it."""
        if self._last is not None:
            self._step_s = fix.time_s - self._last.time_s
        self._last, self._doubted, self._agreeing = fix, None, 0

    def _doubt(self, before: Sample, fix: Sample) -> Notice | None:
        step_s = fix.time_s - before.time_s
        if step_s > LONGEST_GAP_S:
            expected = f"{LONGEST_GAP_S:g} s or less, or {BELIEVED} lines in a row that agree"
            return Notice("time_s", f"{step_s:.6g} s after the last line", expected)
        distance_m = math.dist((before.x_m, before.y_m), (fix.x_m, fix.y_m))
        if distance_m > self._reach_mps * step_s + SLACK_M:
            expected = f"a position that can be reached, or {BELIEVED} lines in a row that agree"
            return Notice("x_m", f"{distance_m:.6g} m from the last line's position, {step_s:.6g} s before", expected)
        return None


class LiveFlight:
    """A flight that is followed through its plan, and its planner.

    Parameters
    ----------
    mission : Mission
        What the planner is told before take-off. The first fix that is far from its start begins the flight.
    make, make_forecast : function of a Mission
        A new planner, and a forecast for where it makes none of its own.
    every_s : float
        How often advice is given at least [s].

    Attributes
    ----------
    complete : bool
        Whether the plan is done.
    forecast_completes : bool
        Whether it is, or is forecast to be done before the battery is empty, by the last fix.
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
        self._planner: Planner
        self._itinerary: PlanExecutor | None = None
        self._forecast: HeldForecast
        self._ground = _Ground(mission.cruise_mps)
        self._origin_s = 0.0
        self._last: tuple[float, Point, float] = (0.0, (0.0, 0.0), 1.0)
        self._decision = Decision(mission.parameters, 0.0)
        self._next_s = -math.inf
        self._lost = self._empty = False
        self._told_back: int | None = None
        self._failed = ""
        self._reasons: list[str] = []
        self._remarks: list[Notice] = []
        self._remarked: set[str] = set()
        self.complete = False
        self.forecast_completes = False

    def take(self, fix: Sample) -> tuple[Advice | None, tuple[Notice, ...]]:
        """Take a fix whose time is after the last one's; return advice, where there is any, and what is odd."""
        self._remarks, self._reasons = [], []
        itinerary = self._itinerary or self._begin(fix)
        velocity = self._ground.observe(fix)
        if self.complete:
            return None, ()
        time_s = fix.time_s - self._origin_s
        if fix.soc <= 0:
            return self._run_empty(fix, itinerary), ()
        self._empty = False
        before, replans = self._decision, self._planner.report.replans
        self._follow(fix, itinerary)
        self._take_in_force(fix, itinerary)
        self._last = (time_s, (fix.x_m, fix.y_m), fix.soc)
        if itinerary.complete:
            return self._done(fix, itinerary), tuple(self._remarks)
        seen = self._observation(time_s, (fix.x_m, fix.y_m), fix.soc, itinerary)._replace(
            power_w=fix.power_w,
            wind_mps=fix.wind_mps,
            velocity_mps=velocity,
            heading_rad=fix.heading_rad,
        )
        self._ask(seen, itinerary)
        changed = self._decision.parameters != before.parameters
        replanned = self._planner.report.replans != replans
        due = time_s >= self._next_s - 1e-9
        if not (changed or replanned or due):
            return None, tuple(self._remarks)
        advice = self._advise(fix, seen, itinerary)
        self._next_s = next_multiple(time_s, self._every_s)
        self.forecast_completes = (advice.soc_end_forecast or 0.0) > 0
        return advice, tuple(self._remarks)

    # --- the flight through its plan

    def _begin(self, fix: Sample) -> PlanExecutor:
        """The first fix: where and when the flight begins."""
        mission = self._mission
        known = 0 <= fix.time_s <= CLOCK_STARTS_S
        self._origin_s = 0.0 if known else fix.time_s
        here, start = (fix.x_m, fix.y_m), mission.start_m
        elapsed_s = fix.time_s - self._origin_s
        if start is None or math.dist(here, start) > FASTEST * mission.cruise_mps * elapsed_s + SLACK_M:
            start = here
        mission = replace(mission, start_m=start)
        self._planner = self._make(mission)
        self._forecast = self._make_forecast(mission)
        self._itinerary = PlanExecutor(mission.plan, mission.parameters, start, mission.rules)
        self._last = (min(0.0, elapsed_s), start, fix.soc)
        self._reasons.append(TAKE_OFF)
        return self._itinerary

    def _follow(self, fix: Sample, itinerary: PlanExecutor) -> None:
        """Go through the plan along the straight line from the last fix; stages that are told are believed."""
        if self._lost:
            return
        (t0, (x0, y0), soc0), here = self._last, (fix.x_m, fix.y_m)
        t1 = fix.time_s - self._origin_s
        try:
            ahead = self._stages_ahead(fix, itinerary)
            steps = min(max(1, math.ceil(math.dist((x0, y0), here) / STEP_M)), MOST_STEPS)
            for k in range(1, steps + 1):
                part = k / steps
                x, y = x0 + part * (here[0] - x0), y0 + part * (here[1] - y0)
                if ahead is not None:
                    itinerary.stay(x, y)
                elif itinerary.advance(x, y) and k < steps:
                    # a stage has begun between two fixes: the planner is told when, not at the next fix
                    time_s, soc = t0 + part * (t1 - t0), soc0 + part * (fix.soc - soc0)
                    self._ask(self._observation(time_s, (x, y), soc, itinerary), itinerary)
                if itinerary.complete:
                    return
            for k in range(1, (ahead or 0) + 1):
                itinerary.skip(here)
                if itinerary.complete:
                    return
                if k < (ahead or 0):  # a stage that was left out: no one saw when it began
                    time_s = t0 + k / (ahead or 1) * (t1 - t0)
                    self._ask(self._observation(time_s, here, fix.soc, itinerary), itinerary)
        except EadpError as error:
            self._lose(error)

    def _stages_ahead(self, fix: Sample, itinerary: PlanExecutor) -> int | None:
        """How many stages to go on to the one that is told; None where positions are to tell."""
        told, now = fix.stage, itinerary.stage.index
        count = len(self._mission.plan.stages)
        if told is None:
            return None
        if told > count:
            if f"stage {told}" not in self._remarked and len(self._remarked) < 100:
                self._remarked.add(f"stage {told}")
                self._remarks.append(Notice("stage", f"there is no stage {told}; ignored", f"one of 1 to {count}"))
            return None
        to = itinerary.stages_to(told)
        if told == now:
            self._told_back = None
            # laps of a single stage are told apart by positions alone
            return None if to == 1 else 0
        lap = itinerary.stages_to(now) if told < now else None
        # 4 → 1 is the next lap; 3 → 2 is a jump back, since on to it is the longer way round
        if to is None or (told < now and lap is not None and 2 * to > lap):
            if self._told_back != told:
                self._told_back = told
                self._remarks.append(
                    Notice("stage", f"stage {told} is before stage {now}, which is flown; ignored", "a stage ahead")
                )
            return None
        self._told_back = None
        return to

    def _take_in_force(self, fix: Sample, itinerary: PlanExecutor) -> None:
        """Parameters that a sample reports to be in force."""
        if not fix.parameters or self._lost:
            return
        values = list(itinerary.parameters)
        sets = itinerary.stage.sets
        for name, value in fix.parameters.items():
            if name not in self._names:
                if name not in self._remarked and len(self._remarked) < 100:
                    self._remarked.add(name)
                    expected = f"one of {', '.join(self._names) or 'none'}"
                    what = f"the plan has no parameter {printable(name, 40)}; ignored"
                    self._remarks.append(Notice("parameters", what, expected))
                continue
            i = self._names.index(name)
            clipped = sets[i].clip(value) if sets else value
            if clipped != value and f"{name} outside" not in self._remarked:
                self._remarked.add(f"{name} outside")
                expected = f"a value in [{sets[i].lo:g}, {sets[i].hi:g}]"
                self._remarks.append(Notice("parameters", f"{name} = {value:g} is outside its set; clipped", expected))
            values[i] = clipped
        try:
            itinerary.take_in_force(values, (fix.x_m, fix.y_m))
        except EadpError as error:
            self._lose(error)

    def _lose(self, error: EadpError) -> None:
        """The plan cannot be followed any more: its stage and parameters stay."""
        self._lost = True
        self._remarks.append(Notice("x_m", f"the plan cannot be followed on from here: {error}"))

    # --- the planner

    def _observation(self, time_s: float, position: Point, soc: float, itinerary: PlanExecutor) -> Observation:
        """What is known at any moment, between two fixes as well."""
        return Observation(
            time_s,
            *position,
            itinerary.cursor,
            itinerary.joined_m,
            itinerary.stages_started,
            None,
            soc,
        )

    def _ask(self, seen: Observation, itinerary: PlanExecutor) -> None:
        """Give the planner an observation, and the plan what it decides."""
        before = self._decision
        try:
            self._forecast.observe(seen)
            self._decision = self._planner.update(seen)
        except Exception as error:  # in the air a planner that fails must not take the advice of the others with it
            what = f"the planner failed, and parameters stay: {type(error).__name__}: {printable(str(error))}"
            if what != self._failed:
                self._failed = what
                self._remarks.append(Notice("time_s", what))
            return
        if self._decision.parameters is before.parameters:
            return
        if self._decision.parameters != before.parameters:
            self._reasons.append(self._decision.reason)
        if not self._lost:
            try:
                itinerary.decide(self._decision.parameters, (seen.x_m, seen.y_m))
            except EadpError as error:
                self._lose(error)

    # --- advice

    def _advise(self, fix: Sample, seen: Observation, itinerary: PlanExecutor) -> Advice:
        decision, record = self._decision, self._decision.record
        if not _recent(record, seen.time_s, self._every_s):
            record = None
        end = record or self._held_forecast(seen)
        if decision.reason not in self._reasons and not (self._reasons and decision.reason.startswith(KEPT)):
            self._reasons.append(decision.reason)
        return Advice(
            time_s=fix.time_s,
            stage=itinerary.stage.index,
            lap=itinerary.cursor.lap,
            parameters=self._named(decision.parameters),
            in_force=self._named(itinerary.parameters),
            soc_end_forecast=_finite(end.soc_end) if end else None,
            completes_probability=_finite(end.completes_probability) if end else None,
            reserve_probability=_finite(end.reserve_probability) if end else None,
            remaining_s=_finite(end.remaining_s) if end else None,
            wind_mps=record.wind_mps if record else fix.wind_mps,
            reason="; ".join(reason for reason in self._reasons if reason) or KEPT,
        )

    def _held_forecast(self, seen: Observation) -> Forecast | None:
        """The end at the parameters decided, for a planner that forecasts none."""
        if self._lost:
            return None
        try:
            return self._forecast.at(seen, self._decision.parameters)
        except EadpError:
            return None

    def _done(self, fix: Sample, itinerary: PlanExecutor) -> Advice:
        self.complete = self.forecast_completes = True
        return self._last_words(fix, itinerary, COMPLETED, fix.soc, 1.0)

    def _run_empty(self, fix: Sample, itinerary: PlanExecutor) -> Advice | None:
        """The battery is told to be empty: there is nothing to decide until it is told not to be."""
        self.forecast_completes = False
        if self._empty:
            return None
        self._empty = True
        self._next_s = -math.inf
        return self._last_words(fix, itinerary, EMPTY, 0.0, 0.0)

    def _last_words(self, fix: Sample, itinerary: PlanExecutor, reason: str, soc: float, probability: float) -> Advice:
        return Advice(
            time_s=fix.time_s,
            stage=itinerary.stage.index,
            lap=itinerary.cursor.lap,
            parameters=self._named(self._decision.parameters),
            in_force=self._named(itinerary.parameters),
            soc_end_forecast=soc,
            completes_probability=probability,
            reserve_probability=None,
            remaining_s=0.0 if self.complete else None,
            wind_mps=fix.wind_mps,
            reason=reason,
        )

    def _named(self, parameters: Vector) -> dict[str, float]:
        return dict(zip(self._names, parameters, strict=True))


class _Ground:
    """Velocity over ground: as told, else from the positions of the last seconds."""

    def __init__(self, cruise_mps: float) -> None:
        self._most_mps = FASTEST * cruise_mps
        self._fixes: deque[tuple[float, float, float]] = deque()

    def observe(self, fix: Sample) -> Point | None:
        """The velocity at a fix [m/s]; None where nothing tells it.

        Source: the least-squares parabola through the positions, its slope at the last one, so that turns do not lag.
        """
        fixes = self._fixes
        if fixes and fix.time_s - fixes[-1][0] > LONGEST_CHORD_S:
            fixes.clear()
        fixes.append((fix.time_s, fix.x_m, fix.y_m))
        while len(fixes) > 2 and fix.time_s - fixes[0][0] > WINDOW_S:
            fixes.popleft()
        if fix.velocity_mps is not None:
            return fix.velocity_mps
        data = np.array(fixes)
        times, places = data[:, 0] - fix.time_s, data[:, 1:] - data[-1, 1:]
        if len(fixes) < 2 or -times[0] < LEAST_SPAN_S:
            return None
        columns = [np.ones_like(times), times, times**2][: len(fixes)]
        slopes = np.linalg.lstsq(np.stack(columns, axis=1), places, rcond=None)[0][1]
        vx, vy = float(slopes[0]), float(slopes[1])
        return (vx, vy) if math.hypot(vx, vy) <= self._most_mps else None


def _recent(record: DecisionRecord | None, time_s: float, every_s: float) -> bool:
    return record is not None and time_s - record.time_s <= max(RECENT_S, 3 * every_s)


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
