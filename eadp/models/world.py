"""The world of a flight, all but the planner, and what is logged of the flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.models.airspace import WayHome
from eadp.models.battery import Battery, BatteryFault
from eadp.models.computing import ComputationRate, Computing
from eadp.models.plan.cursor import Rules, Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Stage
from eadp.models.vehicle import Airframe, Guidance
from eadp.models.weather import Sensors, Wind


class TakeOff(NamedTuple):
    """State of the aircraft at take-off: where it is [m], and where its nose points [rad]."""

    position_m: Point
    heading_rad: float
    altitude_m: float


class Timing(NamedTuple):
    """Times of a simulation.

    Attributes
    ----------
    step_s : float
        Time step [s].
    log_every_s : float
        Time between rows of the log [s]; infinite for no log, not even of the end.
    time_limit_s : float
        Time after which the flight is ended [s].
    """

    step_s: float = 0.01
    log_every_s: float = 0.1
    time_limit_s: float = 7200.0


@dataclass(frozen=True)
class World:
    """Everything in a flight except the planner."""

    plan: Plan
    computing: Computing
    vehicle: Airframe
    guidance: Guidance
    wind: Wind
    battery: Battery
    faults: tuple[BatteryFault, ...]
    start: TakeOff
    parameters: Vector
    rules: Rules
    clock: Timing
    seed: int = 0
    sensors: Sensors = field(default_factory=Sensors)
    rates: Mapping[str, ComputationRate] = field(default_factory=dict)
    """Computations, by parameter, that run at another rate than commanded."""
    way_home: WayHome | None = None
    """Where the aircraft flies when the planner gives the plan up, and how."""

    def actual(self, parameters: Vector) -> Vector:
        """Parameters with the rates at which the computations run in place of the commanded ones."""
        if not self.rates:
            return parameters
        named = zip(self.plan.names, parameters, strict=True)
        return tuple([self.rates[name].actual(value) if name in self.rates else value for name, value in named])

    def computing_w(self, parameters: Vector, stage: Stage) -> float:
        """Power of the computations [W] at the rates at which they run; raises Infeasible as `Computing.power_w`."""
        return self.computing.power_w(self.actual(parameters), stage.sets)


class Step(NamedTuple):
    """A row of the log; `stage` is the index within the plan's stages, from 1."""

    time_s: float
    stage: int
    x_m: float
    y_m: float
    altitude_m: float
    heading_rad: float
    power_w: float
    power_forecast_w: float
    soc: float
    airspeed_mps: float
    airspeed_commanded_mps: float
    parameters: Vector
