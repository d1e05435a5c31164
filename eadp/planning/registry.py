"""Every planner by its name."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from eadp.errors import EadpError

if TYPE_CHECKING:
    from eadp.planning.base import Mission, Planner, PlannerSettings
    from eadp.planning.estimation.estimator import EstimatorSettings
    from eadp.planning.flight import PlannedFlight

PLANNERS = {
    "static": "eadp.planning.static:StaticPlanner",
    "paper": "eadp.planning.paper.planner:PaperPlanner",
    "joint": "eadp.planning.joint.planner:JointPlanner",
}
"""The class of each planner, imported when it is needed. Its settings are a section of its name."""

DEFAULT = "joint"


def planner_class(name: str) -> type[Planner]:
    """The class of a planner.

    Raises
    ------
    EadpError
        On an unknown name.
    """
    if name not in PLANNERS:
        raise EadpError(f"unknown planner {name}; expected one of {', '.join(PLANNERS)}")
    module, _, attribute = PLANNERS[name].partition(":")
    planner: type[Planner] = getattr(import_module(module), attribute)
    return planner


def make_flight(settings: PlannerSettings, estimator: EstimatorSettings, mission: Mission) -> PlannedFlight:
    """A new flight with the planner that the settings name, with its own section of them, if they have it.

    Where that section has a number `horizon_s`, the power is estimated so far ahead.

    Raises
    ------
    EadpError
        On an unknown name.
    """
    from eadp.planning.flight import PlannedFlight
    from eadp.planning.state.flight_state import FlightState

    planner = planner_class(settings.name)(settings, mission, settings.own)
    horizon_s = getattr(settings.own, "horizon_s", None)
    state = FlightState(mission, settings.weights, estimator, horizon_s if isinstance(horizon_s, float | int) else None)
    return PlannedFlight(planner, state, mission.parameters)
