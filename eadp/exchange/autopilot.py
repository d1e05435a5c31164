"""The parameters of an autopilot that a forecast holds for, and what PX4 asks of a mission before it arms.

Source: ardupilot.org, "Complete Parameter List" of Plane; docs.px4.io, "Parameter Reference"; PX4's
`FeasibilityChecker.cpp`, and flights beside it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

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
from eadp.models.autopilot import ARDUPILOT, FACTORY, LANDING_ANGLE, LIMITS, OLDER, PX4, Autopilot
from eadp.models.battery import Battery
from eadp.models.performance import calibrated_over_true
from eadp.models.plan.plan import Plan
from eadp.models.vehicle import Airframe

INT32, FLOAT = 6, 9
"""MAVLink's types of whole numbers of 32 bits, and of numbers in single precision."""

ACCEPTANCE_M = 2.0
"""Acceptance radius of a waypoint at the end of a line [m]."""

SWITCHES = 0.1
"""PX4's switching distance as a share of that of its guidance: 0.32 as delivered leaves lines 24 to 34 m early."""

NO_LANDING = 0
"""What PX4 requires of a mission: nothing; 2, as delivered for fixed wings, is a landing, without which none arms."""

AGREES = 0.02
"""Share of a value by which an autopilot's may be off."""


EXACTLY, AT_LEAST, AT_MOST = "", ", less than ", ", more than "
"""How an autopilot's value may differ from the one that the forecast holds for: not, upwards, downwards."""

RETURN_LANDS, FLIES_LANDING = 2, 1
"""ArduPilot's RTL_AUTOLAND and PX4's RTL_TYPE with which a return flies straight to the mission's landing."""


class AutopilotParameter(NamedTuple):
    """A parameter of an autopilot: its name and value, and those that older versions have in their place.

    A value that is no number is any: the parameter is read, and the forecast counts it.
    """

    name: str
    value: float
    bound: str = EXACTLY
    older: str = ""
    older_value: float = 0.0

    def difference(self, name: str, value: float) -> str:
        """How a value of one of its names disagrees, for people; empty where it agrees."""
        wanted = self.older_value if name == self.older else self.value
        if math.isnan(wanted):
            return ""
        # a radius below 0 is that of the other way round
        agrees = math.isclose(abs(value), abs(wanted), rel_tol=AGREES)
        if agrees or (self.bound == AT_LEAST and value > wanted) or (self.bound == AT_MOST and value < wanted):
            return ""
        armed = ", so that the mission is not armed" if name in _ARMING else ""
        return f"{name} is {value:.6g}{self.bound or ', not '}{wanted:.6g}{armed}"


_ARMING = frozenset(("MIS_TKO_LAND_REQ", "FW_LND_ANG"))
"""PX4's parameters by which it refuses a mission."""

_OLDER = {**OLDER, "AIRSPEED_CRUISE": ("TRIM_ARSPD_CM", 100.0), "ROLL_LIMIT_DEG": ("LIM_ROLL_CD", 100.0)}
"""Of ArduPilot's parameters: their names in older versions, and how many times the value stands there."""

_WHOLE = frozenset(("MIS_TKO_LAND_REQ", "RTL_TYPE", "COM_FLTT_LOW_ACT", "RTL_TIME_MARGIN", "COM_LOW_BAT_ACT"))
"""PX4's parameters of type INT32."""


def wanted_parameters(
    plan: Plan, airframe: Airframe, battery: Battery, *, ardupilot: bool, home_altitude_m: float | None = None
) -> list[AutopilotParameter]:
    """What an autopilot's parameters must be so that a plan is armed, and its forecast holds.

    `home_altitude_m` is that of the way home; by default the plan's highest.
    """
    radius_m, speed = round(plan.min_radius_m or airframe.turn_radius_m), airframe.airspeed_mps
    speed = round(speed * calibrated_over_true(plan.site, airframe), 3)
    bank_deg = airframe.max_bank_deg if airframe.takes_commands else math.nan
    slope_deg = landing_slope_deg(plan, airframe.cruise_altitude_m)
    lands = bool(plan.stages[-1].command(LAND))
    altitudes_m = [airframe.cruise_altitude_m if each.altitude_m is None else each.altitude_m for each in plan.stages]
    home_m = math.ceil(max(altitudes_m) if home_altitude_m is None else home_altitude_m)
    # value, ArduPilot's name, PX4's name; a value that is no number, or a name that is empty, is of no parameter
    rows = [
        (speed, "AIRSPEED_CRUISE", "FW_AIRSPD_TRIM", EXACTLY),
        (bank_deg, "ROLL_LIMIT_DEG", "FW_R_LIM", EXACTLY),
        (radius_m, "WP_RADIUS", "", EXACTLY),
        (ACCEPTANCE_M, "", "NAV_ACC_RAD", EXACTLY),
        (SWITCHES, "", "NPFG_SW_DST_MLT", AT_MOST),
        (radius_m, "WP_LOITER_RAD", "NAV_LOITER_RAD", EXACTLY),
        (round(1000 * battery.capacity_ah), "BATT_CAPACITY", "BAT1_CAPACITY", EXACTLY),
        # else PX4 does not arm: it requires a landing, and none that is steeper
        (math.nan if lands else NO_LANDING, "", "MIS_TKO_LAND_REQ", AT_MOST),
        (slope_deg, "", "FW_LND_ANG", AT_LEAST),
        # the way home: clear of what is below it, and to the landing, without which ArduPilot does not arm one
        (home_m if airframe.takes_commands else math.nan, "RTL_ALTITUDE", "RTL_RETURN_ALT", AT_LEAST),
        (RETURN_LANDS if lands else math.nan, "RTL_AUTOLAND", "", EXACTLY),
        (FLIES_LANDING if lands else math.nan, "", "RTL_TYPE", EXACTLY),
    ]
    found = []
    for value, of_ardupilot, of_px4, bound in rows:
        name = of_ardupilot if ardupilot else of_px4
        if name and not math.isnan(value):
            older, times = _OLDER.get(name, ("", 0.0))
            found.append(AutopilotParameter(name, value, bound, older, times * value))
    return found


def stated_parameters(
    autopilot: Autopilot, found: Sequence[AutopilotParameter], *, ardupilot: bool
) -> list[AutopilotParameter]:
    """What a scenario states of its autopilot besides those that are found: its forecast counts them."""
    if autopilot.kind != (ARDUPILOT if ardupilot else PX4):
        return []
    names = {name for each in found for name in (each.name, each.older)}
    return [AutopilotParameter(name, value) for name, value in autopilot.parameters.items() if name not in names]


def read_parameters(wanted: Sequence[AutopilotParameter], *, ardupilot: bool) -> list[AutopilotParameter]:
    """Those that are wanted, and those that a forecast counts at any value."""
    names = [each.name for each in wanted]
    rest = [name for name in FACTORY[ARDUPILOT if ardupilot else PX4] if name not in names]
    return [*wanted, *(AutopilotParameter(name, math.nan, EXACTLY, *_OLDER.get(name, ("", 0.0))) for name in rest)]


def speed_limits(plan: Plan, airframe: Airframe, *, ardupilot: bool) -> list[AutopilotParameter]:
    """What an autopilot's limits of the calibrated airspeed must allow: below its least one ArduPilot refuses a change
    of speed, and PX4 accepts it and flies that one."""
    calibrated = calibrated_over_true(plan.site, airframe)
    speeds = [round(calibrated * (stage.airspeed_mps or airframe.airspeed_mps), 3) for stage in plan.stages]
    slowest, fastest = min(speeds), max(speeds)
    low, high = LIMITS[ARDUPILOT if ardupilot else PX4]
    return [
        AutopilotParameter(low, slowest, AT_MOST, OLDER.get(low, ("",))[0], slowest),
        AutopilotParameter(high, fastest, AT_LEAST, OLDER.get(high, ("",))[0], fastest),
    ]


def landing_slope_deg(plan: Plan, cruise_altitude_m: float) -> float:
    """Slope of a plan's final approach, up to a tenth [°]; no number where it does not land."""
    if len(plan.stages) < 2 or not plan.stages[-1].command(LAND):
        return math.nan
    before, last = plan.stages[-2:]
    highest = [plan.hull(i).hi for i in range(plan.path_count)]
    from_m = cruise_altitude_m if before.altitude_m is None else before.altitude_m
    length_m = math.dist(before.trigger_at(highest), last.trigger_at(highest))
    return math.ceil(10 * math.degrees(math.atan2(from_m - (last.altitude_m or 0.0), length_m))) / 10


def _ardupilot_text(parameters: Sequence[AutopilotParameter]) -> str:
    """As Mission Planner and MAVProxy read it."""
    lines = [f"{each.name},{each.value:.7g}" for each in parameters]
    lines += [f"# of older versions: {each.older},{each.older_value:.7g}" for each in parameters if each.older]
    return "\n".join(lines) + "\n"


def _px4_text(parameters: Sequence[AutopilotParameter]) -> str:
    """As QGroundControl reads it: vehicle, component, name, value and type."""
    typed = [(each, INT32 if each.name in _WHOLE else FLOAT) for each in parameters]
    rows = [f"1\t1\t{each.name}\t{each.value:.7g}\t{kind}" for each, kind in typed]
    return "\n".join(["# Vehicle-Id Component-Id Name Value Type", *rows]) + "\n"


PARAMETER_FILES: Mapping[str, tuple[bool, Callable[[Sequence[AutopilotParameter]], str]]] = {
    ".param": (True, _ardupilot_text),
    ".params": (False, _px4_text),
}
"""Endings of files of parameters: whether they are ArduPilot's, else PX4's, and their text."""


ENDS_REQUIRED = "MIS_TKO_LAND_REQ"
"""PX4's parameter of which ends a mission must have."""

ROUNDING_DEG = 0.1
"""By how much PX4 accepts an approach that is steeper [°]."""


def check_landing(items: Sequence[MissionItem], autopilot: Autopilot) -> None:
    """Raise Infeasible where PX4 refuses the landing of a mission."""
    starts = [i for i, item in enumerate(items) if item.command == LAND_START]
    lands = [i for i, item in enumerate(items) if item.command in (LAND, VTOL_LAND)]
    if starts and (len(starts) > 1 or not lands or lands[-1] < starts[0]):
        raise Infeasible("PX4 does not arm: it takes one DO_LAND_START (189), before a landing", "one of them, or none")
    limit_deg = autopilot.value(LANDING_ANGLE) or 0.0
    for before, land in itertools.pairwise(items):
        if land.command == LAND and before.placed:
            _check_approach(before, land, limit_deg)


def _check_approach(before: MissionItem, land: MissionItem, limit_deg: float) -> None:
    """Raise Infeasible where PX4 refuses a landing after the item before it, or an approach steeper than a limit."""
    if before.command not in (WAYPOINT, LOITER_TO_ALTITUDE):
        message = f"PX4 does not arm: its landing follows a command {before.command}"
        raise Infeasible(message, "a waypoint (16) or a loiter to altitude (31) before it")
    way_m = math.hypot(*to_local_m(*land.position_deg, before.position_deg))
    radius_m = abs(before.parameters[1]) if before.command == LOITER_TO_ALTITUDE else 0.0
    if radius_m and way_m <= radius_m:
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
