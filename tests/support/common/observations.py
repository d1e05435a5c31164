"""Observations made by hand."""

import math

from eadp.models.plan.cursor import PlanCursor
from eadp.papers.power import PowerTracker
from eadp.planning.base import Observation, Sample
from eadp.planning.registry import PlannedFlight
from eadp.planning.state.flight_state import FlightState


def observation(plan, parameters, time_s, x_m, y_m, *, started=1, power_w=46.0, soc=1.0, through_gap=False, **more):
    """What is known after so many stages have started, flown at fixed parameters."""
    cursor, joined_m = PlanCursor.start(plan, parameters), (x_m, y_m)
    for _ in range(started - 1):
        cursor, joined_m = cursor.next(), cursor.trigger_m()
    return Observation(Sample(time_s, (x_m, y_m), power_w, soc, **more), soc, cursor, joined_m, started, through_gap)


def measured(o, **changes):
    """An observation whose sample has other measurements."""
    sample = o.sample._replace(**changes)
    return o._replace(sample=sample, soc=sample.soc)


def seen_at(time_s, position_m, course_rad=None, stage=None, stages_started=None):
    """A sample of where an aircraft is and where it flies to, at 1 m/s, with what it reports of its stage."""
    velocity = None if course_rad is None else (math.cos(course_rad), math.sin(course_rad))
    return Sample(time_s, position_m, None, None, stage, velocity_mps=velocity, stages_started=stages_started)


class Piloted(PlannedFlight):
    """A planner with the state of its flight; what is asked of it beside is asked of the planner."""

    def __init__(self, planner):
        mission, settings = planner.mission, planner.settings
        power = PowerTracker(settings.estimator, mission)
        state = FlightState(mission, settings.weights, settings.estimator.every_s)
        super().__init__(planner, state, power)

    def __getattr__(self, name):
        return getattr(self.planner, name)
