"""A flight as it is planned: readings in, decisions out. Simulated and live flights are driven through it alone."""

from __future__ import annotations

from collections.abc import Mapping

from eadp.models.plan.cursor import Vector
from eadp.planning.base import Decision, Observation, Planner, Readings
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
        """Take readings, which the next decision counts, or an observation, at which the planner decides."""
        if isinstance(seen, Readings):
            self.state.ingest(seen)
        else:
            self.state.observe(seen)
            self.decision = self.planner.update(self.state)
        return self.decision

    def keep(self, parameters: Vector, held: Mapping[int, float]) -> None:
        """Decide on parameters in the planner's place, and hold some of them, by index."""
        if parameters != self.decision.parameters:
            self.decision = self.decision._replace(parameters=parameters)
        self.planner.hold(held)
