"""A flight as it is planned: readings in, decisions out. Simulated and live flights are driven through it alone."""

from __future__ import annotations

from collections.abc import Mapping

from eadp.models.plan.cursor import Vector
from eadp.papers.estimator import EstimatorSettings
from eadp.planning.base import Decision, Mission, Observation, PlannerSettings, Readings
from eadp.planning.registry import Planner, planner_class
from eadp.planning.state.flight_state import FlightState


class PlannedFlight:
    """The planner of a flight, the state that it decides on, and its last decision.

    Parameters
    ----------
    planner : Planner
    state : FlightState
    parameters : tuple of float
        Those of take-off.
    """

    def __init__(self, planner: Planner, state: FlightState, parameters: Vector) -> None:
        self.planner, self.state = planner, state
        self.decision = Decision(parameters)

    def take(self, seen: Readings | Observation) -> Decision:
        """Take readings, or an observation, at which the planner is updated; return the decision that holds.

        The planner is not updated before the flight has reached its plan.
        """
        if isinstance(seen, Readings):
            self.state.ingest(seen)
        else:
            self.state.observe(seen)
            if seen.on_plan:
                self.decision = self.planner.update(self.state)
        return self.decision

    def keep(self, parameters: Vector, held: Mapping[int, float]) -> None:
        """Put parameters in place of the planner's decision, and have it hold some of them, by index, at a value."""
        if parameters != self.decision.parameters:
            self.decision = self.decision._replace(parameters=parameters)
        self.planner.hold(held)


def make_flight(settings: PlannerSettings, estimator: EstimatorSettings, mission: Mission) -> PlannedFlight:
    """A new flight with the planner that the settings name, with its own section of them, if they have it.

    Where that section has a number `horizon_s`, the power is estimated so far ahead.

    Raises
    ------
    EadpError
        On an unknown name.
    """
    planner = planner_class(settings.name)(settings, mission, settings.own)
    horizon_s = getattr(settings.own, "horizon_s", None)
    state = FlightState(mission, settings.weights, estimator, horizon_s if isinstance(horizon_s, float | int) else None)
    return PlannedFlight(planner, state, mission.parameters)
