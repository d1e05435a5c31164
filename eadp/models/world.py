"""A mission as its planner knows it, the world in which it is flown, and what is logged of the flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from eadp.core.flight import GUST_TIME_S
from eadp.core.geometry.curves import Point
from eadp.models.airspace import WayHome
from eadp.models.autopilot import Autopilot
from eadp.models.battery import Battery, BatteryFault
from eadp.models.computing import Computing
from eadp.models.energy import EnergyModel
from eadp.models.plan.cursor import Rules, Vector
from eadp.models.plan.plan import Plan
from eadp.models.vehicle import Airframe, Guidance
from eadp.models.weather import Sensors, Wind


class Excess(NamedTuple):
    """What a stage takes beside its path, whose turns the aircraft overshoots: time, and time integral of tan² of the
    bank [s]."""

    seconds: float
    turning_s: float


@dataclass(frozen=True)
class Mission:
    """The mission as known before take-off.

    `vehicle` is the aircraft as stated, which may be another. `gust_time_s` is the time constant of gusts [s], and
    `altitude_m` that of take-off [m]. `excess` is what stages that the aircraft cannot follow take beside their paths,
    by number. `live` is whether forecasts are shown as they are made: none is older than a re-planning then.
    `autopilot` is the one that flies, for its own rules.
    `clock_s` is what the telemetry's clock shows at time 0 [s].
    """

    plan: Plan
    computing: Computing
    battery: Battery
    vehicle: Airframe
    parameters: Vector
    start_m: Point | None = None
    energy: EnergyModel | None = None
    way_home: WayHome | None = None
    rules: Rules = field(default_factory=Rules)
    gust_time_s: float = GUST_TIME_S
    altitude_m: float = 0.0
    live: bool = False
    clock_s: float = 0.0
    excess: Mapping[int, Excess] = field(default_factory=dict)
    autopilot: Autopilot = field(default_factory=Autopilot)

    @property
    def cruise_mps(self) -> float:
        """Airspeed where a stage commands none [m/s]."""
        return self.vehicle.airspeed_mps


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
    """Everything in a flight except the planner: its mission, and what it does not know."""

    mission: Mission
    guidance: Guidance
    wind: Wind
    faults: tuple[BatteryFault, ...]
    start: TakeOff
    clock: Timing
    seed: int = 0
    sensors: Sensors = field(default_factory=Sensors)

    @cached_property
    def way_home(self) -> WayHome | None:
        """Where the aircraft flies when the planner gives the plan up, and how: as its autopilot does."""
        way_home = self.mission.way_home
        return None if way_home is None else way_home.flown_by(self.mission.autopilot)


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
