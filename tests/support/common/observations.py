"""Observations made by hand."""

from __future__ import annotations

from eadp.models.plan.cursor import PlanCursor
from eadp.planning.base import Observation


def observation(plan, parameters, time_s, x_m, y_m, *, started=1, power_w=46.0, soc=1.0, **more):
    """What is known after so many stages have started, flown at fixed parameters."""
    cursor, joined_m = PlanCursor.start(plan, parameters), (x_m, y_m)
    for _ in range(started - 1):
        cursor, joined_m = cursor.next(), cursor.trigger_m()
    return Observation(time_s, x_m, y_m, cursor, joined_m, started, power_w, soc, **more)


class Piloted:
    """A planner with the state of its flight, which takes each observation before the planner does."""

    def __init__(self, planner):
        self.planner, self.state = planner, planner.flight_state()

    def __getattr__(self, name):
        return getattr(self.planner, name)

    def update(self, seen):
        self.state.observe(seen)
        return self.planner.update(seen._replace(state=self.state))
