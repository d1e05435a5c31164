"""Planner `static`: the parameters of take-off throughout."""

from __future__ import annotations

import math

from eadp.planning.base import TrackingPlanner


class StaticPlanner(TrackingPlanner):
    """Keeps the parameters of take-off; it estimates the power, so that its flights record a forecast.

    Source: flights I and II of the letter.
    """

    takes_arrays = True

    @property
    def next_update_s(self) -> float:
        """Infinity: no decisions."""
        return math.inf
