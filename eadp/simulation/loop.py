"""One flight: aircraft → observation → planner → decision → aircraft, to its end. No files, no plots, no clock."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eadp.core.flight.battery import undeliverable
from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, PathUndefined
from eadp.models.battery import Battery, BatteryFault
from eadp.models.computing import Computing
from eadp.models.plan.cursor import Rules, Vector
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.plan import Plan
from eadp.models.sensors import Sensors
from eadp.models.vehicle import Airframe, Guidance
from eadp.models.weather import Wind
from eadp.planning.base import DecisionRecord, Observation, Planner, Readings
from eadp.simulation.aircraft import ALTITUDE, HEADING, X, Y, constants_of, state_of
from eadp.simulation.inner_loop import DISTANCE, EMPTY, ENERGY, LEAST, LOST, MOST, POWER, SAGS, SOC, InnerLoop
from eadp.simulation.metrics import FlightTotals, ParameterLog
from eadp.simulation.sensors import SensorSuite

COMPLETED = "final point reached"
BATTERY_EMPTY = "battery empty"
TIME_LIMIT = "time limit"
MOST_STEPS = 1 << 40


@dataclass(frozen=True)
class World:
    """Everything of a flight but the planner."""

    plan: Plan
    computing: Computing
    vehicle: Airframe
    guidance: Guidance
    wind: Wind
    battery: Battery
    faults: tuple[BatteryFault, ...]
    start_m: Point
    heading_rad: float
    altitude_m: float
    parameters: Vector
    rules: Rules
    step_s: float = 0.01
    log_every_s: float = 0.1
    time_limit_s: float = 7200.0
    seed: int = 0
    sensors: Sensors = field(default_factory=Sensors)


class Step(NamedTuple):
    """One logged moment; `stage` counts from 1 over the whole flight's stages of a lap."""

    time_s: float
    stage: int
    x_m: float
    y_m: float
    altitude_m: float
    heading_rad: float
    power_w: float
    power_forecast_w: float
    soc: float
    parameters: Vector


@dataclass
class Outcome:
    """How a flight ended, and what it added up to."""

    completed: bool = False
    reason: str = ""
    duration_s: float = 0.0
    soc_final: float = 0.0
    totals: FlightTotals = field(default_factory=FlightTotals)
    parameters: ParameterLog | None = None
    stage_times_s: list[float] = field(default_factory=list)
    records: list[DecisionRecord] = field(default_factory=list)


def fly(world: World, planner: Planner, outcome: Outcome) -> Iterator[Step]:
    """Fly, yielding a step every `log_every_s` and the last one; `outcome` is filled in at the end.

    From one moment at which something has to look to the next the aircraft flies by itself
    (`eadp.simulation.inner_loop`): until a planner is due, a row of the log, a loss of charge, or a new stage.

    Raises
    ------
    PathUndefined
        If the first path cannot be evaluated where the flight starts.
    """
    step_s, log_every = world.step_s, max(1, round(world.log_every_s / world.step_s))
    itinerary = PlanExecutor(world.plan, world.parameters, world.start_m, world.rules)
    steady_mps = world.wind.steady_mps
    stretches = InnerLoop(
        state_of(world.vehicle, steady_mps, world.start_m, world.heading_rad, world.altitude_m),
        constants_of(world.vehicle, world.guidance, world.wind, step_s),
        world.battery,
        world.wind,
        np.random.default_rng(world.seed),
    )
    watcher = _SensorBridge(world, planner, stretches)
    losses = _losses(world)
    alarms = [step + watcher.late for step, _ in losses]
    parameters, stage = itinerary.parameters, itinerary.stage
    log = outcome.parameters = ParameterLog(world.plan, parameters, stage.sets)
    stretches.along(itinerary, world.computing.power_w(parameters, stage.sets))
    decided: Vector | None = None
    recorded: DecisionRecord | None = None
    steps = math.ceil(world.time_limit_s / step_s - 1e-9)
    reason = TIME_LIMIT
    k, look, last_logged = 0, 1, -1

    def logged() -> Step:
        place = (number(X), number(Y), number(ALTITUDE), number(HEADING))
        forecast_w = watcher.forecast_w
        return Step(k * step_s, stage.index, *place, number(POWER), forecast_w, number(SOC), parameters)

    number = stretches.number
    while k < steps:
        if losses and k >= losses[-1][0]:
            losses.pop()
        if alarms and k >= alarms[-1]:
            alarms.pop()
        loss = losses[-1] if losses else (steps, 0.0)
        alarm = alarms[-1] if alarms else steps
        stretches.fault(*loss)
        k, seen = stretches.run(k, min(steps, look, loss[0], alarm, k - k % log_every + log_every))
        time_s = k * step_s
        if seen & (LOST | EMPTY | SAGS):
            reason = _failure(seen, world, stretches, stage.index, k)
            break
        looks = k >= look or k == alarm
        if looks:
            watcher.look(k, itinerary)
            if watcher.record is not recorded:
                recorded = watcher.record
                if recorded is not None:
                    outcome.records.append(recorded)
        if k % log_every == 0:
            watcher.ingest(k)
            last_logged = k
            yield logged()
        try:
            changed = itinerary.handle(seen, number(X), number(Y)) if seen else False
            if itinerary.complete:
                outcome.completed, reason = True, COMPLETED
                break
            if changed:
                outcome.stage_times_s.append(time_s)
            if watcher.parameters is not decided:
                decided = watcher.parameters
                if decided is not None:
                    changed |= itinerary.decide(decided, (number(X), number(Y)))
        except EadpError as error:
            reason = str(error)
            break
        if changed:
            stage, parameters = itinerary.stage, itinerary.parameters
            stretches.along(itinerary, world.computing.power_w(parameters, stage.sets))
            log.change(time_s, parameters, stage.sets)
            look = k + 1  # a new stage, or what has been decided, is told at once
        elif looks:
            look = max(k + 1, step_at(planner.next_update_s, step_s, steps))
    if k != last_logged:
        watcher.ingest(k)
        yield logged()
    totals = outcome.totals
    totals.energy_j, totals.distance_m = number(ENERGY) * step_s, number(DISTANCE) * step_s
    totals.power_min_w, totals.power_max_w = number(LEAST), number(MOST)
    log.close(k * step_s)
    outcome.reason, outcome.duration_s, outcome.soc_final = reason, k * step_s, number(SOC)


class _SensorBridge:
    """What goes from the sensors to the planner, and what it has decided."""

    def __init__(self, world: World, planner: Planner, stretches: InnerLoop) -> None:
        self._step_s = world.step_s
        self._planner = planner
        self._stretches = stretches
        self._ideal = world.sensors.ideal
        self._suite = SensorSuite(world.sensors, world.step_s, np.random.default_rng([world.seed, 1]))
        self.late = self._suite.late
        """How many steps old what is told is."""
        stretches.sense(step_at(planner.reading_every_s, world.step_s, MOST_STEPS), self.late)
        self.forecast_w = 0.0
        self.parameters: Vector | None = None
        self.record: DecisionRecord | None = None

    def look(self, k: int, itinerary: PlanExecutor) -> None:
        """Show the planner what is known after step `k`."""
        self.ingest(k - 1)
        x, y, power_w, soc, vx, vy, heading = self._stretches.told(k)
        observation = Observation(
            k * self._step_s,
            x,
            y,
            itinerary.cursor,
            itinerary.joined_m,
            itinerary.stages_started,
            power_w,
            soc,
            None,
            (vx, vy),
            heading,
        )
        decision = self._planner.update(observation if self._ideal else self._suite.observe(k, observation))
        self.forecast_w, self.parameters, self.record = decision.power_forecast_w, decision.parameters, decision.record

    def ingest(self, k: int) -> None:
        """Give the planner the readings up to step `k` that it has not been shown; a later one it sees itself."""
        steps, moments = self._stretches.readings()
        if steps and steps[-1] > k:
            steps.pop()
            for numbers in moments:
                numbers.pop()
        if not steps:
            return
        x, y, true_w, charges, vx, vy, headings = moments
        powers_w: list[float | None] = [*true_w]
        if not self._ideal:
            suite = self._suite
            for i, n in enumerate(steps):
                x[i], y[i] = suite.position_m(n, x[i], y[i])
                powers_w[i] = suite.power_w(n, true_w[i])
                charges[i] = suite.soc(n, charges[i])
        step_s = self._step_s
        readings = Readings([n * step_s for n in steps], x, y, powers_w, charges, vx, vy, headings)
        self.forecast_w = self._planner.ingest(readings).power_forecast_w


def step_at(time_s: float, step_s: float, most: int) -> int:
    """The first step after which it is a time [s] or later, 1 or more; at most `most`."""
    if time_s >= most * step_s:
        return most
    return max(1, math.ceil((time_s - 1e-9) / step_s - 1e-9))


def _losses(world: World) -> list[tuple[int, float]]:
    """The steps with a sudden loss of charge and how much it is, the last first; of a replayed charge, 0.

    A planner looks at once.
    """
    drops = [(fault.at_s, fault.soc_drop) for fault in world.faults]
    if world.battery.prescribed:
        points = world.battery.prescribed
        drops = [(t, 0.0) for (t, _), (after, _) in itertools.pairwise(points) if t == after]
    losses: dict[int, float] = {}
    for at_s, drop in sorted(drops):
        step = step_at(at_s, world.step_s, MOST_STEPS)
        losses[step] = losses.get(step, 0.0) + drop
    return sorted(losses.items(), reverse=True)


def _failure(seen: int, world: World, stretches: InnerLoop, stage: int, k: int) -> str:
    """Why a flight ends early.

    Raises
    ------
    PathUndefined
        If the first path cannot be evaluated where the flight starts.
    """
    if seen & EMPTY:
        return BATTERY_EMPTY
    if seen & SAGS:
        volts = world.battery.voltage_at(stretches.number(SOC))
        power_w = stretches.number(POWER)
        return "the battery cannot deliver: " + undeliverable(power_w, volts, world.battery.resistance_ohm)
    if k == 1:
        x, y = world.start_m
        raise PathUndefined(f"the path of stage 1 has no finite value at the start ({x:g}, {y:g})")
    return f"the path of stage {stage} has no value at ({stretches.number(X):.1f}, {stretches.number(Y):.1f})"
