"""A flight as it is planned: readings in, decisions out. Simulated and live flights are driven through it alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eadp.errors import EadpError
from eadp.models.plan.cursor import Vector
from eadp.planning.base import Decision, Mission, Observation, PlannerSettings, Readings
from eadp.planning.registry import Planner, PowerEstimator, planner_class
from eadp.planning.state.flight_state import FlightState
from eadp.planning.state.queue import Seen
from eadp.plug_ins import plug_in


class PlannedFlight:
    """The planner of a flight, the state that it decides on, and its last decision.

    Parameters
    ----------
    planner : Planner
    state : FlightState
    parameters : tuple of float
        Those of take-off.
    power : PowerEstimator, optional
        For the log; by default the planner's, if it has one.
    """

    def __init__(
        self, planner: Planner, state: FlightState, parameters: Vector, power: PowerEstimator | None = None
    ) -> None:
        self.planner, self.state, self.power = planner, state, planner.power or power
        self.decision = Decision(parameters)

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
    return PlannedFlight(planner, state, mission.parameters, power)
