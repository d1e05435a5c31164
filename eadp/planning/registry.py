"""Every planner by its name, and what a flight needs of one."""

from __future__ import annotations

from eadp.errors import EadpError
from eadp.planning.base import (
    JOINT,
    PAPER,
    STATIC,
    Decision,
    DecisionRecord,
    Mission,
    Observation,
    Planner,
    PlannerSettings,
    Readings,
    SolverReport,
    StaticPlanner,
)
from eadp.planning.estimation.estimator import EstimatorSettings
from eadp.planning.joint.forecaster import Forecast
from eadp.planning.joint.held import HeldForecast
from eadp.planning.joint.planner import JointPlanner
from eadp.planning.paper.planner import PaperPlanner

__all__ = [
    "NAMES",
    "Decision",
    "DecisionRecord",
    "Forecast",
    "HeldForecast",
    "JointPlanner",
    "Mission",
    "Observation",
    "PaperPlanner",
    "Planner",
    "PlannerSettings",
    "Readings",
    "SolverReport",
    "StaticPlanner",
    "make_planner",
]

NAMES = (STATIC, PAPER, JOINT)


def make_planner(settings: PlannerSettings, estimator: EstimatorSettings, mission: Mission) -> Planner:
    """The planner that the settings name.

    Raises
    ------
    EadpError
        On an unknown name.
    """
    planners = {STATIC: StaticPlanner, PAPER: PaperPlanner, JOINT: JointPlanner}
    if settings.name not in planners:
        raise EadpError(f"unknown planner {settings.name}; expected one of {', '.join(NAMES)}")
    return planners[settings.name](settings, estimator, mission)
