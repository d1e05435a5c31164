"""Every planner by its name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eadp.errors import EadpError, printable
from eadp.plug_ins import OWN, plug_in

if TYPE_CHECKING:
    from eadp.planning.planner import Planner

PLANNERS = tuple(OWN["planners"])
"""The planners of eadp. Their settings are sections of their names."""

DEFAULT = "joint"


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
