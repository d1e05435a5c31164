"""The interface of planners."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Protocol

from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, PathUndefined, printable
from eadp.models.battery import Battery
from eadp.models.plan.cursor import Vector
from eadp.models.world import Mission, Step
from eadp.planning.base import Decision, Observation, PlannerSettings, Readings, SolverReport, trade_off_faults
from eadp.planning.forecast.held import HeldForecast, Preflight, before_take_off
from eadp.planning.state.flight_state import FlightState
from eadp.planning.state.queue import Seen
from eadp.plug_ins import OWN, added_names, plug_in


class PowerEstimator(Protocol):
    """Estimates the power of a flight, for a planner that asks it and for the log; made of its settings and a mission.

    Attributes
    ----------
    period_s : float or None
        Period of the power [s]; None if there is none.
    """

    own_settings: ClassVar[type]
    """Dataclass of its settings."""

    @property
    def period_s(self) -> float | None: ...

    def __init__(self, settings: Any, mission: Mission) -> None: ...

    def take(self, seen: Readings | Seen) -> None:
        """Take what the state of the flight has taken."""

    def estimates(self, times_s: Sequence[float]) -> tuple[list[float], Sequence[Any]]:
        """Forecasts of the last reading before each instant since the last call [W], and the estimates after it."""
        ...

    @staticmethod
    def table(steps: Sequence[Step], estimates: Sequence[Any], battery: Battery) -> Iterator[Sequence[str | float]]:
        """Header and rows of a table of the estimates at steps."""
        ...


class Planner:
    """A planner: it decides on what is known of a flight. The base class keeps the parameters of take-off.

    Parameters
    ----------
    settings : PlannerSettings
    mission : Mission
    own : dataclass, optional
        Its own section of the settings.

    Attributes
    ----------
    settings, mission, own
        As given.
    report : SolverReport
    next_update_s : float
        Time of the next update [s]; a new stage or a drop of charge requires one earlier.
    """

    own_settings: ClassVar[type | None] = None
    """Dataclass of this planner's own settings, if it has any."""

    power: PowerEstimator | None = None
    """Its estimator of the power, where it asks one: it takes what the state takes, and the log has its estimates."""

    optimises_to_end: ClassVar[bool] = False
    """Whether the planner chooses its parameters so that they last to the end of the mission."""

    def __init__(self, settings: PlannerSettings, mission: Mission, own: Any = None) -> None:
        self.report = SolverReport()
        self.settings, self.mission, self.own = settings, mission, own
        self._decision = Decision(mission.parameters)

    @classmethod
    def faults(cls, settings: PlannerSettings, mission: Mission) -> list[tuple[str, str, str]]:
        """Own settings that the mission contradicts: the key within them, what is wrong, and what was expected."""
        return trade_off_faults(getattr(settings.own, "trade_offs", ()), mission.plan)

    @classmethod
    def preflight(
        cls, settings: PlannerSettings, mission: Mission, wind_mps: Point, gust_std_mps: float
    ) -> Preflight | None:
        """The forecast before take-off, in the wind of the weather forecast: with the parameters of take-off held.

        None if the plan cannot be flown in this wind.
        """
        known = before_take_off(settings, mission, wind_mps, gust_std_mps)
        try:
            found = HeldForecast(settings, mission).evaluation(known, mission.parameters)
        except PathUndefined:
            return None
        return Preflight.of(found, found.filled(), mission.parameters)

    @property
    def next_update_s(self) -> float:
        """Infinity: it has nothing to decide."""
        return math.inf

    def update(self, state: FlightState) -> Decision:
        """Decide at an observation, `state.now`.

        It is asked at each new stage, change and sample, too; before `next_update_s` it may repeat its last decision.
        """
        return self._decision

    def hold(self, held: Mapping[int, float]) -> None:
        """Take the parameters, by index, that stay at a value whatever is decided; all others may change."""


PLANNERS = tuple(OWN["planners"])
"""The planners of eadp. Their settings are sections of their names."""

DEFAULT = "joint"


def planner_names() -> list[str]:
    """The planners of eadp and of installed packages."""
    return [*PLANNERS, *added_names("planners")]


def is_planner(name: str) -> bool:
    """Whether eadp or an installed package has a planner of a name. Raises EadpError if it cannot be imported."""
    return name in PLANNERS or plug_in("planners", name) is not None


def planner_class(name: str) -> type[Planner]:
    """The class of a planner of eadp, or of an installed package.

    Raises
    ------
    EadpError
        On an unknown name.
    """
    planner: type[Planner] | None = plug_in("planners", name)
    if planner is None:
        raise EadpError(f"unknown planner {printable(name, 60)}; expected one of {', '.join(PLANNERS)}")
    return planner


# --- a flight as it is planned


class PlannedFlight:
    """The planner of a flight, the state that it decides on, and its last decision.

    Parameters
    ----------
    planner : Planner
    state : FlightState
    power : PowerEstimator, optional
        For the log; by default the planner's, if it has one.
    """

    def __init__(self, planner: Planner, state: FlightState, power: PowerEstimator | None = None) -> None:
        self.planner, self.state, self.power = planner, state, planner.power or power
        self.decision = Decision(planner.mission.parameters)

    def take(self, seen: Readings | Observation) -> Decision:
        """Take readings, or an observation, at which the planner is updated; return the decision that holds.

        The planner is not updated before the flight has reached its plan.
        """
        if isinstance(seen, Readings):
            self.state.ingest(seen)
            taken: Readings | Seen = seen
        else:
            taken = self.state.observe(seen)
        if self.power is not None:
            self.power.take(taken)
        if isinstance(taken, Seen) and taken.observation.on_plan:
            decided: Any = self.planner.update(self.state)
            if not isinstance(decided, Decision):  # of another package's planner
                kind = type(self.planner)
                raise EadpError(f"{kind.__module__}.{kind.__name__}.update returns {decided!r}, and no Decision")
            self.decision = decided
        return self.decision

    def keep(self, parameters: Vector, held: Mapping[int, float]) -> None:
        """Put parameters in place of the planner's decision, and have it hold some of them, by index, at a value."""
        if parameters != self.decision.parameters:
            self.decision = self.decision._replace(parameters=parameters)
        self.planner.hold(held)


def make_flight(settings: PlannerSettings, mission: Mission, *, logged: bool = False) -> PlannedFlight:
    """A new flight with the planner that the settings name, with its own section of them, if they have it.

    `logged` is whether its power is estimated for a log, where the planner does not ask for it.

    Raises
    ------
    EadpError
        On an unknown name.
    """
    planner = planner_class(settings.name)(settings, mission, settings.own)
    state = FlightState(mission, settings.weights, settings.estimator.every_s)
    power = plug_in("estimators", "power")(settings.estimator, mission) if logged and planner.power is None else None
    return PlannedFlight(planner, state, power)
