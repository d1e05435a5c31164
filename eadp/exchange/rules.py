"""What an autopilot asks of a mission before it arms.

Source: PX4's `FeasibilityChecker.cpp`, docs.px4.io, "Parameter Reference", and flights beside it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from eadp.core.geometry.geodesy import to_local_m
from eadp.errors import Infeasible
from eadp.exchange.items import (
    LAND,
    LAND_START,
    LOITER_TO_ALTITUDE,
    TAKEOFF,
    VTOL_LAND,
    VTOL_TAKEOFF,
    WAYPOINT,
    MissionItem,
)
from eadp.models.autopilot import LANDING_ANGLE, Autopilot

ENDS_REQUIRED = "MIS_TKO_LAND_REQ"
"""PX4's parameter of which ends a mission must have."""

ROUNDING_DEG = 0.1
"""By how much PX4 accepts an approach that is steeper [°]."""


def check_landing(items: Sequence[MissionItem], autopilot: Autopilot) -> None:
    """Raise Infeasible where PX4 refuses the landing of a mission."""
    starts = [i for i, item in enumerate(items) if item.command == LAND_START]
    lands = [i for i, item in enumerate(items) if item.command in (LAND, VTOL_LAND)]
    if len(starts) > 1:
        raise Infeasible("PX4 does not arm: the mission has more than one DO_LAND_START (189)", "one of them")
    if starts and (not lands or lands[-1] < starts[0]):
        raise Infeasible("PX4 does not arm: no landing follows DO_LAND_START (189)", "a landing after it, or neither")
    limit_deg = autopilot.value(LANDING_ANGLE) or 0.0
    for before, land in itertools.pairwise(items):
        if land.command != LAND or not before.placed:
            continue
        if before.command not in (WAYPOINT, LOITER_TO_ALTITUDE):
            message = f"PX4 does not arm: its landing follows a command {before.command}"
            raise Infeasible(message, "a waypoint (16) or a loiter to altitude (31) before it")
        (latitude, longitude), (to_latitude, to_longitude) = before.parameters[4:6], land.parameters[4:6]
        way_m, radius_m = math.hypot(*to_local_m(to_latitude, to_longitude, (latitude, longitude))), 0.0
        if before.command == LOITER_TO_ALTITUDE:
            radius_m = abs(before.parameters[1])
            if way_m <= radius_m:
                raise Infeasible("PX4 does not arm: it lands within the circle before", "a place outside of it")
        down_m = before.altitude_m - land.altitude_m
        if down_m <= 0:
            raise Infeasible("PX4 does not arm: the approach begins no higher than the landing", "a higher approach")
        # from a circle the approach leads along the tangent
        steep_deg = math.degrees(math.atan2(down_m, math.sqrt(way_m**2 - radius_m**2)))
        if steep_deg > limit_deg + ROUNDING_DEG:
            message = f"PX4 does not arm: the final approach of {steep_deg:.1f}° is steeper than {LANDING_ANGLE}"
            planned = "eadp cover --landing with autopilot: {kind: px4} in its scenario, which plans a flatter one"
            least = f"{math.ceil(10 * steep_deg) / 10:g}"
            where = f"{LANDING_ANGLE}: {least} in the autopilot and in the scenario's autopilot.parameters"
            raise Infeasible(f"{message}, {limit_deg:g}°", f"{planned}; or {where}")


def lacking_ends(items: Sequence[MissionItem], autopilot: Autopilot) -> str:
    """Which end a mission lacks for PX4 to arm it: `a landing`, `a take-off`; empty where none lacks."""
    takes_off = any(item.command in (TAKEOFF, VTOL_TAKEOFF) for item in items)
    lands = any(item.command in (LAND, VTOL_LAND) for item in items)
    required = autopilot.value(ENDS_REQUIRED) or 0
    if not lands and (required in (2, 3) or (required == 4 and takes_off)):
        return "a landing"
    if not takes_off and (required in (1, 3) or (required == 4 and lands)):
        return "a take-off"
    return ""
