"""The plan of a flight home: a turn and straight there, then a landing or a circle; computations at their lowest."""

from __future__ import annotations

from dataclasses import replace

from eadp.core.geometry.dubins import Pose
from eadp.models.airspace import WayHome
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box


def home_plan(cursor: PlanCursor, pose: Pose, way_home: WayHome) -> Plan:
    """A plan of a turn and a straight line home, round what is in the way, and of what ends it.

    Parameters
    ----------
    cursor : PlanCursor
        Where the flight was in its plan: path parameters and the stage's airspeed stay as they are, and its altitude,
        unless the way home has one.
    pose : (float, float, float)
        Where the aircraft is [m] and its heading [rad].
    way_home : WayHome
    """
    from eadp.models.plan.pieces import piece_stages  # slow to import, and few flights end at home

    plan = cursor.table.plan
    rho = plan.path_count  # the first parameters are the path's, the others the computations'
    lowest = [plan.hull(i).lo for i in range(rho, len(cursor.parameters))]
    sets = tuple(Box(value, value) for value in (*cursor.parameters[:rho], *lowest))
    altitude_m = cursor.stage.altitude_m if way_home.altitude_m is None else way_home.altitude_m
    like = replace(cursor.stage, sets=sets, altitude_m=altitude_m)
    stages = piece_stages(way_home.pieces(pose), like, 1)
    legs = () if way_home.landing is None else way_home.landing.legs
    down = [replace(leg.stage, index=len(stages) + k, segment=None, sets=sets) for k, leg in enumerate(legs, 1)]
    return Plan(plan.name, (*stages, *down), rho, plan.computations, trigger_radius_m=plan.trigger_radius_m)
