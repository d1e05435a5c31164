"""One flight: aircraft → observation → planner → decision → aircraft, to its end. No files, no plots, no clock."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eadp.core.battery import undeliverable
from eadp.core.geometry import Point
from eadp.errors import EadpError, PathUndefined
from eadp.models.battery import Battery, Fault
from eadp.models.computing import Computing
from eadp.models.itinerary import Itinerary, Rules, Vector
from eadp.models.plan import Plan
from eadp.models.sensors import Sensors
from eadp.models.vehicle import Guidance, Vehicle
from eadp.models.weather import Wind
from eadp.planning.planners import Observation, Planner, Record
from eadp.simulation.aircraft import Gusts, make_aircraft
from eadp.simulation.metrics import ParameterLog, Totals
from eadp.simulation.sensing import SensorSuite

COMPLETED = "final point reached"
BATTERY_EMPTY = "battery empty"
TIME_LIMIT = "time limit"


@dataclass(frozen=True)
class World:
    """Everything of a flight but the planner."""

    plan: Plan
    computing: Computing
    vehicle: Vehicle
    guidance: Guidance
    wind: Wind
    battery: Battery
    faults: tuple[Fault, ...]
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
    totals: Totals = field(default_factory=Totals)
    parameters: ParameterLog | None = None
    stage_times_s: list[float] = field(default_factory=list)
    records: list[Record] = field(default_factory=list)


def fly(world: World, planner: Planner, outcome: Outcome) -> Iterator[Step]:
    """Fly, yielding a step every `log_every_s` and the last one; `outcome` is filled in at the end.

    Raises
    ------
    PathUndefined
        If the first path cannot be evaluated where the flight starts.
    """
    step_s, log_every = world.step_s, max(1, round(world.log_every_s / world.step_s))
    aircraft = make_aircraft(
        world.vehicle,
        world.guidance,
        world.wind.steady_mps,
        world.start_m,
        world.heading_rad,
        world.altitude_m,
    )
    gusts = Gusts(world.wind, step_s, np.random.default_rng(world.seed))
    ideal = world.sensors.ideal
    suite = SensorSuite(world.sensors, step_s, np.random.default_rng([world.seed, 1]))
    itinerary = Itinerary(world.plan, world.parameters, world.start_m, world.rules)
    charge = _Charge(world.battery, world.faults, step_s)
    parameters = itinerary.parameters
    log = outcome.parameters = ParameterLog(world.plan, parameters, itinerary.stage.sets)
    totals = outcome.totals
    stage = itinerary.stage
    computing_w = world.computing.power_w(parameters, stage.sets)
    # names bound once: this loop runs a hundred times for each second flown
    advance, update, next_wind, fly_step, drain = (
        itinerary.advance,
        planner.update,
        gusts.next_mps,
        aircraft.step,
        charge.drain,
    )
    path, offset, gain, sense = itinerary.path, itinerary.offset_m, stage.gain, stage.sense
    energy_w, distance_m, lowest_w, highest_w = 0.0, 0.0, math.inf, -math.inf
    decided: Vector | None = None
    recorded: Record | None = None
    steps = math.ceil(world.time_limit_s / step_s - 1e-9)
    reason = TIME_LIMIT
    time_s, power_w, forecast_w, last_logged = 0.0, 0.0, 0.0, -1
    k = 0

    def logged() -> Step:
        place = (aircraft.x_m, aircraft.y_m, aircraft.altitude_m, aircraft.heading_rad)
        return Step(time_s, stage.index, *place, power_w, forecast_w, charge.soc, parameters)

    for k in range(steps):
        time_s = (k + 1) * step_s
        try:
            motion_w = fly_step(path, offset, gain, sense, next_wind(), step_s)
        except (ArithmeticError, ValueError):
            if k == 0:
                what = (
                    f"the path of stage 1 has no finite value at the start ({world.start_m[0]:g}, {world.start_m[1]:g})"
                )
                raise PathUndefined(what) from None
            reason = f"the path of stage {stage.index} has no value at ({aircraft.x_m:.1f}, {aircraft.y_m:.1f})"
            break
        x, y = aircraft.x_m, aircraft.y_m
        power_w = motion_w + computing_w
        energy_w += power_w
        distance_m += math.sqrt(aircraft.vx * aircraft.vx + aircraft.vy * aircraft.vy)
        if power_w < lowest_w:
            lowest_w = power_w
        if power_w > highest_w:
            highest_w = power_w
        if not drain(time_s, power_w):
            reason = charge.failure
            break
        observation = Observation(
            time_s,
            x,
            y,
            stage.index,
            itinerary.stages_begun,
            power_w,
            charge.soc,
            parameters,
            None,
            (aircraft.vx, aircraft.vy),
            aircraft.heading_rad,
        )
        decision = update(observation if ideal else suite.observe(observation))
        forecast_w = decision.power_forecast_w
        if decision.record is not recorded:
            recorded = decision.record
            if recorded is not None:
                outcome.records.append(recorded)
        if (k + 1) % log_every == 0:
            last_logged = k
            yield logged()
        try:
            changed = advance(x, y)
            if itinerary.complete:
                outcome.completed, reason = True, COMPLETED
                break
            if changed:
                outcome.stage_times_s.append(time_s)
            if decision.parameters is not decided:
                decided = decision.parameters
                changed |= itinerary.decide(decided, (x, y))
        except EadpError as error:
            reason = str(error)
            break
        if changed:
            stage, parameters = itinerary.stage, itinerary.parameters
            path, offset, gain, sense = itinerary.path, itinerary.offset_m, stage.gain, stage.sense
            computing_w = world.computing.power_w(parameters, stage.sets)
            log.change(time_s, parameters, stage.sets)
    if k != last_logged:
        yield logged()
    totals.energy_j, totals.distance_m = energy_w * step_s, distance_m * step_s
    totals.power_min_w, totals.power_max_w = lowest_w, highest_w
    log.close(time_s)
    outcome.reason, outcome.duration_s, outcome.soc_final = reason, time_s, charge.soc


class _Charge:
    """The state of charge: drained by the actual power and by faults, or replayed."""

    def __init__(self, battery: Battery, faults: tuple[Fault, ...], step_s: float) -> None:
        self._battery = battery
        self._faults = sorted(faults, key=lambda fault: -fault.at_s)
        empty_v = battery.voltage_at(0.0)
        self._empty_v, self._rise_v = empty_v, battery.voltage_v - empty_v
        self._four_r = 4 * battery.resistance_ohm
        self._factor = 2 * battery.k_b_per_s * step_s / battery.capacity_ah
        self.soc = battery.prescribed_soc(0.0) if battery.prescribed else battery.soc
        self.failure = BATTERY_EMPTY

    def drain(self, time_s: float, power_w: float) -> bool:
        """Draw a power for one step; return whether the battery could give it and is not empty."""
        b = self._battery
        # I = 2y / (V + √(V² − 4 R y)), ḃ = −k_b I / Q_c: eadp.core.battery, inlined for the loop
        volts = self._empty_v + self._rise_v * self.soc
        discriminant = volts * volts - self._four_r * power_w
        if discriminant < 0:
            self.failure = "the battery cannot deliver: " + undeliverable(power_w, volts, b.resistance_ohm)
            return False
        if b.prescribed:
            self.soc = b.prescribed_soc(time_s)
        else:
            self.soc -= self._factor * power_w / (volts + math.sqrt(discriminant))
            while self._faults and time_s >= self._faults[-1].at_s - 1e-9:
                self.soc -= self._faults.pop().soc_drop
        if self.soc <= 0:
            self.soc = max(self.soc, 0.0)
            return False
        return True
