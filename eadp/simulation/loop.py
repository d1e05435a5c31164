"""One flight: aircraft → observation → planner → decision → aircraft, to its end. No files, no plots, no clock."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Pose
from eadp.errors import EadpError, PathUndefined
from eadp.models.airspace import Entry
from eadp.models.battery import CUT_OFF
from eadp.models.plan.cursor import PlanCursor, Rules, Vector
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.pieces import piece_stages
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box
from eadp.models.world import Step, World
from eadp.planning.base import DecisionRecord, Observation, Readings, Sample
from eadp.planning.registry import PlannedFlight
from eadp.simulation.aircraft import AIRSPEED, ALTITUDE, HEADING, X, Y, constants_of, state_of
from eadp.simulation.inner_loop import DISTANCE, EMPTY, ENERGY, LOST, MAX_POWER, MIN_POWER, POWER, SAGS, SOC, InnerLoop
from eadp.simulation.metrics import ParameterLog, SensorSuite

COMPLETED = "final point reached"
RETURNED = "returned home"
BATTERY_EMPTY = "battery empty"
TIME_LIMIT = "time limit"
MAX_STEPS = 1 << 40
WIND_S = 0.1
"""Longest time for which a wind that changes is held [s]."""

TRACK_S = 0.1
"""Longest time between the points of a track that is checked for obstacles [s]."""


@dataclass
class Outcome:
    """End of a flight, and its totals."""

    reason: str = ""
    duration_s: float = 0.0
    soc_final: float = 0.0
    energy_j: float = 0.0
    distance_m: float = 0.0
    power_min_w: float = math.inf
    power_max_w: float = -math.inf
    entries: list[Entry] = field(default_factory=list)
    """Obstacles that the flight was in, by time; a flight that was in one is not completed."""
    parameters: ParameterLog = field(init=False)
    stage_times_s: list[float] = field(default_factory=list)
    turned_back_s: float | None = None
    turned_back_m: Point | None = None
    """When [s] and where [m] the plan was given up for home."""
    records: list[DecisionRecord] = field(default_factory=list)
    estimates: list[Any] = field(default_factory=list)
    """The flight's estimate of the power at each step of the log."""

    @property
    def completed(self) -> bool:
        """Whether the final point was reached, by a plan that was never given up, and out of obstacles."""
        return self.reason == COMPLETED


def fly(world: World, flight: PlannedFlight, outcome: Outcome) -> Iterator[Step]:
    """Fly, yielding a step every `log_every_s` and the last one; `outcome` is filled in at the end.

    The inner loop (`eadp.simulation.inner_loop`) runs until the planner, a loss of charge or a new stage is due, and
    writes the rows of the log on the way.

    Raises
    ------
    PathUndefined
        If the first path cannot be evaluated where the flight starts.
    """
    yield from _Flight(world, flight, outcome).steps()


class _Flight:
    """A flight: what is due next, and what is handed over between the inner loop, the planner and the plan."""

    def __init__(self, world: World, flight: PlannedFlight, outcome: Outcome) -> None:
        self._world, self._outcome = world, outcome
        cursor = PlanCursor.start(world.mission.plan, world.mission.parameters, world.mission.rules)
        self._executor = executor = PlanExecutor(cursor, world.start.position_m)
        self._inner_loop = InnerLoop(
            state_of(world.mission.vehicle, world.wind.steady_mps, *world.start),
            constants_of(world.mission.vehicle, world.guidance, world.wind, world.clock.step_s),
            world.mission.battery,
            world.wind,
            np.random.default_rng(world.seed),
        )
        self._bridge = _PlannerBridge(world, flight, self._inner_loop, outcome)
        self._drops = _losses(world)
        self._loss_steps = list(self._drops)
        computing_w = world.mission.computing.power_w(executor.parameters, executor.stage.sets)
        self._log = ParameterLog(world.mission.plan, executor.cursor, executor.joined_m)
        outcome.parameters = self._log
        self._inner_loop.start_stage(executor, computing_w)
        self._parameters = executor.parameters  # in force
        # the number of the plan's stage, which on the way home stays the last one flown
        self._plan_stage, self._stages_started = executor.stage.index, executor.stages_started
        self._home_as: str | None = None  # on the way home, the reason with which the flight ends there
        self._track: list[Step] = []  # what is checked for obstacles
        self._k, self._next_update = 0, 1  # the last step flown, and the step at which the planner is due

    def steps(self) -> Iterator[Step]:
        """Fly, see `fly`. Each turn of the loop is one run of the inner loop and what is due after it.

        In this order: readings and rows of the log before step k, the planner's update at step k, the row of step k,
        and what the events and the decision change.
        """
        world, inner_loop, bridge = self._world, self._inner_loop, self._bridge
        end, reason = math.ceil(world.clock.time_limit_s / world.clock.step_s - 1e-9), None
        while reason is None and self._k < end:
            self._k, events = inner_loop.run(self._k, self._next_stop(end))
            k, failed = self._k, events & (LOST | EMPTY | SAGS)
            # whether the planner is updated at step k: it is due, or a loss is measured
            measures = k - bridge.late in self._drops
            due = (k >= self._next_update or measures) and self._home_as is None and not failed
            # where an update is due, the readings of step k are part of its observation, and the row of step k has what
            # is estimated after it: both wait
            before = k - 1 if due else k
            rows = inner_loop.take_rows()
            last = [rows.pop()] if due and rows and rows[-1][0] == k else []
            if rows:
                yield from self._log_rows(rows, before)
            elif inner_loop.full:
                bridge.ingest(before)
            if due:
                bridge.update(k, self._executor)
            if last:
                yield from self._log_rows(last, k)
            reason = self._failure(events) if failed else self._hand_over(events, end, due=due)
        bridge.ingest(self._k)
        if not math.isinf(log_every_s(world)) and bridge.logged_to != self._k:
            now = [inner_loop.variable(i) for i in (X, Y, ALTITUDE, HEADING, POWER, SOC, AIRSPEED)]
            now.append(inner_loop.airspeed_commanded_mps)
            yield from self._log_rows([[self._k, *now]], self._k)
        self._close(TIME_LIMIT if reason is None else reason)

    def _log_rows(self, rows: list[list[float]], k: int) -> list[Step]:
        """Log rows, see `_PlannerBridge.log_rows`; keep their steps where the plan has obstacles or a boundary."""
        steps = self._bridge.log_rows(rows, k, self._plan_stage, self._parameters)
        if any(self._world.mission.plan.site.airspace):
            self._track += steps
        return steps

    def _next_stop(self, end: int) -> int:
        """Set the next loss of charge and the wind of the next run; return the step up to which it may fly.

        At that step the planner, a loss, its measurement or another wind is due, or the flight ends.
        """
        k, steps, late = self._k, self._loss_steps, self._bridge.late
        loss, measured = steps[bisect.bisect(steps, k)], steps[bisect.bisect(steps, k - late)] + late
        self._inner_loop.set_loss(loss, self._drops[loss])
        stop, wind = min(end, self._next_update, loss, measured), self._world.wind
        if wind.profile:
            step_s = self._world.clock.step_s
            self._inner_loop.set_wind(wind.steady_at_mps(k * step_s))
            stop = min(stop, k + max(1, round(WIND_S / step_s)))
        return stop

    def _pose(self) -> Pose:
        """Where the aircraft is [m], and its heading [rad]."""
        variable = self._inner_loop.variable
        return variable(X), variable(Y), variable(HEADING)

    @property
    def _time_s(self) -> float:
        """The time after the last step flown [s]."""
        return self._k * self._world.clock.step_s

    def _hand_over(self, events: int, end: int, *, due: bool) -> str | None:
        """Hand events and the planner's decision to the plan, and what is to be flown now to the inner loop.

        Sets when the planner is updated next; `due` is whether it was at this step, and `end` the last step. Returns
        why the flight ends; None where it goes on.
        """
        try:
            changed = bool(events) and self._executor.handle(events, *self._pose()[:2])
            if self._executor.complete:
                if self._home_as is not None or not self._returns_after_plan():
                    return self._home_as or COMPLETED
                self._fly_home(COMPLETED)
                changed = True
            if self._home_as is None:
                if changed:
                    self._outcome.stage_times_s.append(self._time_s)
                changed |= self._decide()
        except EadpError as error:
            return str(error)
        if changed:
            self._start_flown()
        self._next_update = self._next_update_step(end, changed=changed, due=due)
        return None

    def _returns_after_plan(self) -> bool:
        """Whether an autopilot flies, which returns by the way home at the end of a plan that does not land."""
        way_home = self._world.way_home
        return way_home is not None and way_home.circle_radius_m > 0

    def _next_update_step(self, end: int, *, changed: bool, due: bool) -> int:
        """The step at which the planner is updated next: at once after a change, so with a new stage in force."""
        if self._home_as is not None:
            return end
        if changed:
            return self._k + 1
        if due:
            return max(self._k + 1, step_at(self._bridge.flight.planner.next_update_s, self._world.clock.step_s, end))
        return self._next_update

    def _decide(self) -> bool:
        """Put the planner's decision in force, or turn home; return whether that changes what is flown."""
        decision = self._bridge.flight.decision
        if decision.returns_home:
            self._outcome.turned_back_s, self._outcome.turned_back_m = self._time_s, self._pose()[:2]
            self._fly_home(RETURNED)
            return True
        return self._executor.decide(decision.parameters, self._pose()[:2], decision.airspeeds_mps)

    def _fly_home(self, home_as: str) -> None:
        """Fly home from here on, with the computations at their lowest; the flight ends there with a reason."""
        world, pose = self._world, self._pose()
        plan = _home_plan(world, self._executor.cursor, pose)
        lowest = tuple(box.lo for box in plan.stages[0].sets)
        cursor = PlanCursor.start(plan, lowest, Rules(box_triggers=world.mission.rules.box_triggers))
        self._executor, self._home_as = PlanExecutor(cursor, pose[:2]), home_as

    def _start_flown(self) -> None:
        """Start what the executor flies now in the inner loop and in the log: another stage, or other parameters."""
        executor, time_s = self._executor, self._time_s
        self._parameters = executor.parameters
        computing_w = self._world.mission.computing.power_w(executor.parameters, executor.stage.sets)
        self._inner_loop.start_stage(executor, computing_w)
        if self._home_as is not None:  # the plan was given up, or is over
            self._log.give_up(time_s, executor.parameters, executor.stage.sets)
            return
        started, self._stages_started = executor.stages_started != self._stages_started, executor.stages_started
        self._plan_stage = executor.stage.index
        self._log.change(time_s, executor.cursor, executor.joined_m if started else None)

    def _failure(self, events: int) -> str:
        """Reason of a flight's early end.

        Raises
        ------
        PathUndefined
            If the first path cannot be evaluated where the flight starts.
        """
        variable, battery = self._inner_loop.variable, self._world.mission.battery
        if events & EMPTY:
            return BATTERY_EMPTY
        if events & SAGS:
            soc = variable(SOC)
            is_empty = battery.limit_at(battery.voltage_at(soc)) == CUT_OFF
            what = BATTERY_EMPTY if is_empty else "the battery cannot deliver"
            return f"{what}: {battery.undeliverable(variable(POWER), soc)}"
        if self._k == 1:
            x, y = self._world.start.position_m
            raise PathUndefined(f"the path of stage 1 has no finite value at the start ({x:g}, {y:g})")
        return f"the path of stage {self._plan_stage} has no value at ({variable(X):.1f}, {variable(Y):.1f})"

    def _close(self, reason: str) -> None:
        """Fill in the outcome of a flight that has ended."""
        variable, outcome, time_s = self._inner_loop.variable, self._outcome, self._time_s
        # the inner loop sums power and ground speed over the steps
        outcome.energy_j = variable(ENERGY) * self._world.clock.step_s
        outcome.distance_m = variable(DISTANCE) * self._world.clock.step_s
        outcome.power_min_w, outcome.power_max_w = variable(MIN_POWER), variable(MAX_POWER)
        # where, and how fast, the rest of the plan would have been flown
        short_of = (variable(X), variable(Y)), self._world.mission.vehicle.airspeed_mps
        self._log.close(time_s, None if reason == COMPLETED else short_of)
        outcome.reason, outcome.duration_s, outcome.soc_final = reason, time_s, variable(SOC)
        outcome.entries = self._world.mission.plan.site.airspace.entries(
            [step.time_s for step in self._track],
            [(step.x_m, step.y_m) for step in self._track],
            [step.altitude_m for step in self._track],
        )
        if outcome.entries and outcome.completed:
            outcome.reason = outcome.entries[0].reason


def _home_plan(world: World, cursor: PlanCursor, pose: Pose) -> Plan:
    """A plan of a turn and a straight line home from a pose, round what is in the way, and of what ends it.

    The path parameters and the airspeed of the stage at the cursor stay, and its altitude, unless the way has one.
    """
    plan, way_home = cursor.table.plan, world.way_home
    assert way_home is not None
    rho = plan.path_count  # the first parameters are the path's, the others the computations'
    lowest = [plan.hull(i).lo for i in range(rho, len(cursor.parameters))]
    sets = tuple(Box(value, value) for value in (*cursor.parameters[:rho], *lowest))
    altitude_m = cursor.stage.altitude_m if way_home.altitude_m is None else way_home.altitude_m
    like = replace(cursor.stage, sets=sets, altitude_m=altitude_m)
    stages = piece_stages(way_home.pieces(pose), like, 1)
    legs = () if way_home.landing is None else way_home.landing.legs
    down = [replace(leg.stage, index=len(stages) + k, segment=None, sets=sets) for k, leg in enumerate(legs, 1)]
    return Plan(plan.name, (*stages, *down), rho, plan.computations, trigger_radius_m=plan.trigger_radius_m)


class _PlannerBridge:
    """Between the inner loop and the planned flight: measurements there, and rows of the log.

    The rows have what the flight estimates.
    """

    def __init__(self, world: World, flight: PlannedFlight, inner_loop: InnerLoop, outcome: Outcome) -> None:
        self._step_s, self.flight = world.clock.step_s, flight
        self._inner_loop = inner_loop
        self._suite = SensorSuite(world.sensors, world.clock.step_s, np.random.default_rng([world.seed, 1]))
        self.late = self._suite.late
        """Delay of the measurements in steps."""
        every_s = log_every_s(world)
        log_every = MAX_STEPS if math.isinf(every_s) else max(1, round(every_s / world.clock.step_s))
        inner_loop.set_records(step_at(flight.state.every_s, world.clock.step_s, MAX_STEPS), self.late, log_every)
        self._outcome = outcome
        self.logged_to = -1
        """The last step logged."""

    def update(self, k: int, executor: PlanExecutor) -> None:
        """Update the planner with an observation after step `k`; the readings before it are passed on first."""
        self.ingest(k - 1)
        true = self._inner_loop.measured(k)
        position_m, power_w, soc = self._suite.measured(k, true.x_m, true.y_m, true.power_w, true.soc)
        velocity_mps = true.vx_mps, true.vy_mps
        sample = Sample(
            k * self._step_s, position_m, power_w, soc, velocity_mps=velocity_mps, heading_rad=true.heading_rad
        )
        observation = Observation(sample, soc, executor.cursor, executor.joined_m, executor.stages_started)
        before, decision = self.flight.decision, self.flight.take(observation)
        if decision.record is not None and decision.record is not before.record:
            self._outcome.records.append(decision.record)

    def log_rows(self, rows: list[list[float]], k: int, stage: int, parameters: Vector) -> list[Step]:
        """Pass readings up to step `k` on; return rows of the inner loop with the power that was forecast, as steps.

        The estimates of the power go into the outcome.
        """
        self.ingest(k)
        self.logged_to = int(rows[-1][0])
        times_s = [row[0] * self._step_s for row in rows]
        assert self.flight.power is not None
        forecasts_w, estimates = self.flight.power.estimates(times_s)
        self._outcome.estimates += estimates
        return [
            Step(time_s, stage, x, y, altitude, heading, power_w, forecast_w, soc, flown, commanded, parameters)
            for time_s, (_, x, y, altitude, heading, power_w, soc, flown, commanded), forecast_w in zip(
                times_s, rows, forecasts_w, strict=True
            )
        ]

    def ingest(self, k: int) -> None:
        """Pass the new readings up to step `k` to the flight; a later one is part of its next observation."""
        steps, columns = self._inner_loop.take_readings(k)
        if not len(steps):
            return
        x_m, y_m, powers_w, charges, vx_mps, vy_mps, headings_rad = columns
        if not self._suite.ideal:
            for i, (step, *true) in enumerate(zip(steps, x_m, y_m, powers_w, charges, strict=True)):
                _, power_w, charges[i] = self._suite.measured(int(step), *true)
                powers_w[i] = math.nan if power_w is None else power_w
        times_s, airspeeds_mps = steps * self._step_s, np.full(len(steps), math.nan)  # airspeeds are not measured
        self.flight.take(Readings(times_s, powers_w, charges, vx_mps, vy_mps, headings_rad, airspeeds_mps))


def step_at(time_s: float, step_s: float, max_step: int) -> int:
    """The first step that ends at a time [s] or later, from 1 to `max_step`; a time within rounding of one is at it."""
    if time_s >= max_step * step_s:
        return max_step
    return max(1, math.ceil((time_s - 1e-9) / step_s - 1e-9))


def log_every_s(world: World) -> float:
    """Time between rows of the log [s]; infinite for a flight without one.

    Among obstacles or within a boundary it is `TRACK_S` at most, as rows are the track that is checked.
    """
    every_s = world.clock.log_every_s
    return min(every_s, TRACK_S) if any(world.mission.plan.site.airspace) else every_s


def _losses(world: World) -> dict[int, float]:
    """Amounts of sudden losses of charge by their steps, in order; the last is beyond the end of any flight.

    A charge that is replayed has a loss where two of its points have one time: its amount is 0 here, as it is in the
    charge that is replayed.
    """
    drops = [(fault.at_s, fault.soc_drop) for fault in world.faults]
    if world.mission.battery.prescribed:
        drops = [(t, 0.0) for (t, _), (after, _) in itertools.pairwise(world.mission.battery.prescribed) if t == after]
    losses: dict[int, float] = {}
    for at_s, drop in sorted(drops):
        step = step_at(at_s, world.clock.step_s, MAX_STEPS)
        losses[step] = losses.get(step, 0.0) + drop
    return {**losses, MAX_STEPS: 0.0}
