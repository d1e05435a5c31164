"""Every planner by its name, and what a flight needs of one."""

from __future__ import annotations

from eadp.errors import EadpError
from eadp.planning.estimator import EstimatorSettings
from eadp.planning.joint import JointPlanner
from eadp.planning.paper import PaperPlanner
from eadp.planning.planner import (
    JOINT,
    PAPER,
    STATIC,
    Decision,
    Mission,
    Observation,
    Planner,
    PlannerSettings,
    Readings,
    Record,
    SolverReport,
    StaticPlanner,
)

__all__ = [
    "NAMES",
    "Decision",
    "JointPlanner",
    "Mission",
    "Observation",
    "PaperPlanner",
    "Planner",
    "PlannerSettings",
    "Readings",
    "Record",
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
