"""Planner `static`: the parameters of take-off throughout."""

from __future__ import annotations

from eadp.planning.planner import Planner


class StaticPlanner(Planner):
    """Keeps the parameters of take-off, as every planner does that decides nothing.

    Source: flights I and II of the letter.
    """
