"""The world of a flight, all but the planner, and what is logged of the flight."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.models.airspace import WayHome
from eadp.models.battery import Battery, BatteryFault
from eadp.models.computing import Computing
from eadp.models.plan.cursor import Rules, Vector
from eadp.models.plan.plan import Plan
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
    way_home: WayHome | None = None
    """Where the aircraft flies when the planner gives the plan up, and how."""


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
