"""Every planner by its name."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from eadp.errors import EadpError

if TYPE_CHECKING:
    from eadp.planning.planner import Planner

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
