"""The parameters of an autopilot that a forecast holds for, and their files.

Source: ardupilot.org, "Complete Parameter List" of Plane; docs.px4.io, "Parameter Reference".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from eadp.models.battery import Battery
from eadp.models.plan.plan import Plan
from eadp.models.vehicle import Airframe, PaperVehicle

FLOAT = 9
"""MAVLink's type of a number in single precision."""

ACCEPTANCE_M = 2.0
"""Acceptance radius of a waypoint at the end of a line [m]."""

AGREES = 0.02
"""Share of a value by which an autopilot's may be off."""


class AutopilotParameter(NamedTuple):
    """A parameter of an autopilot: its name and value, and those that older versions have in their place."""

    name: str
    value: float
    older: str = ""
    older_value: float = 0.0

    def difference(self, name: str, value: float) -> str:
        """How a value of one of its names disagrees, for people; empty where it agrees."""
        wanted = self.older_value if name == self.older else self.value
        # a radius below 0 is that of the other way round
        agrees = math.isclose(abs(value), abs(wanted), rel_tol=AGREES)
        return "" if agrees else f"{name} is {value:.6g}, not {wanted:.6g}"


def wanted_parameters(plan: Plan, airframe: Airframe, battery: Battery, *, ardupilot: bool) -> list[AutopilotParameter]:
    """What an autopilot's parameters must be so that the forecast of a plan holds: airspeed, bank, radii, capacity."""
    radius_m, speed = round(plan.min_radius_m or airframe.turn_radius_m), airframe.airspeed_mps
    bank_deg = math.nan if isinstance(airframe, PaperVehicle) else airframe.max_bank_deg
    mah = round(1000 * battery.capacity_ah)
    if ardupilot:
        found = [
            AutopilotParameter("AIRSPEED_CRUISE", speed, "TRIM_ARSPD_CM", 100 * speed),
            AutopilotParameter("ROLL_LIMIT_DEG", bank_deg, "LIM_ROLL_CD", 100 * bank_deg),
            AutopilotParameter("WP_RADIUS", radius_m),
            AutopilotParameter("WP_LOITER_RAD", radius_m),
            AutopilotParameter("BATT_CAPACITY", mah),
        ]
    else:
        found = [
            AutopilotParameter("FW_AIRSPD_TRIM", speed),
            AutopilotParameter("FW_R_LIM", bank_deg),
            AutopilotParameter("NAV_ACC_RAD", ACCEPTANCE_M),
            AutopilotParameter("NAV_LOITER_RAD", radius_m),
            AutopilotParameter("BAT1_CAPACITY", mah),
        ]
    return [each for each in found if not math.isnan(each.value)]


def _ardupilot_text(parameters: Sequence[AutopilotParameter]) -> str:
    """As Mission Planner and MAVProxy read it."""
    lines = [f"{each.name},{each.value:.7g}" for each in parameters]
    lines += [f"# of older versions: {each.older},{each.older_value:.7g}" for each in parameters if each.older]
    return "\n".join(lines) + "\n"


def _px4_text(parameters: Sequence[AutopilotParameter]) -> str:
    """As QGroundControl reads it: vehicle, component, name, value and type."""
    rows = [f"1\t1\t{each.name}\t{each.value:.7g}\t{FLOAT}" for each in parameters]
    return "\n".join(["# Vehicle-Id Component-Id Name Value Type", *rows]) + "\n"


PARAMETER_FILES: Mapping[str, tuple[bool, Callable[[Sequence[AutopilotParameter]], str]]] = {
    ".param": (True, _ardupilot_text),
    ".params": (False, _px4_text),
}
"""Endings of files of parameters: whether they are ArduPilot's, else PX4's, and their text."""
