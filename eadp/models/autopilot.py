"""The autopilot that flies a plan, for its own rules: when it turns back, how it returns, which landing it accepts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.models.battery import Battery

ARDUPILOT: Final = "ardupilot"
PX4: Final = "px4"

LANDING_ANGLE = "FW_LND_ANG"
"""PX4's parameter of the steepest final approach [°]."""

FACTORY: Mapping[str, Mapping[str, float]] = {
    ARDUPILOT: {
        "RTL_ALTITUDE": 100.0,
        "RTL_AUTOLAND": 0.0,
        "RTL_RADIUS": 0.0,
        "WP_LOITER_RAD": 60.0,
        "BATT_FS_LOW_ACT": 0.0,
        "BATT_LOW_MAH": 0.0,
        "BATT_LOW_VOLT": 0.0,
        "BATT_FS_CRT_ACT": 0.0,
        "BATT_CRT_MAH": 0.0,
        "BATT_CRT_VOLT": 0.0,
        "BATT_FS_VOLTSRC": 0.0,
        "AIRSPEED_MIN": 9.0,
    },
    PX4: {
        LANDING_ANGLE: 5.0,
        "MIS_TKO_LAND_REQ": 2.0,
        "RTL_RETURN_ALT": 100.0,
        "RTL_TYPE": 1.0,
        "NAV_LOITER_RAD": 80.0,
        "COM_FLTT_LOW_ACT": 3.0,
        "RTL_TIME_FACTOR": 1.1,
        "RTL_TIME_MARGIN": 100.0,
        "FW_T_CLMB_R_SP": 3.0,
        "COM_LOW_BAT_ACT": 0.0,
        "BAT_CRIT_THR": 0.07,
        "FW_AIRSPD_MIN": 10.0,
    },
}
"""Values of parameters of a fixed wing that an owner has not changed, by kind: those that rules here ask for.

Source: ardupilot.org, "Complete Parameter List" of Plane; docs.px4.io, "Parameter Reference", and `rc.fw_defaults`.
"""

LIMITS = {ARDUPILOT: ("AIRSPEED_MIN", "AIRSPEED_MAX"), PX4: ("FW_AIRSPD_MIN", "FW_AIRSPD_MAX")}
"""The parameters of the least and the greatest airspeed that may be commanded, calibrated."""

OLDER = {
    "RTL_ALTITUDE": ("ALT_HOLD_RTL", 100.0),
    "AIRSPEED_MIN": ("ARSPD_FBW_MIN", 1.0),
    "AIRSPEED_MAX": ("ARSPD_FBW_MAX", 1.0),
}
"""Names in older versions, and how many times the value stands there."""

RETURNS_HOME, ON_CRITICAL = 3.0, (2.0, 3.0)
"""PX4's COM_FLTT_LOW_ACT that returns; and its COM_LOW_BAT_ACT that lands, or returns, at BAT_CRIT_THR."""

LANDS = (1.0, 2.0, 4.0)
"""ArduPilot's RTL_AUTOLAND with which a return lands; with 0 it does not arm a mission that has DO_LAND_START."""


class TimeRule(NamedTuple):
    """PX4 turns back once its time left, by its current, is below `factor` times the time home and `margin_s` [s].

    It counts the climb to the altitude of the way, at `climb_mps` [m/s], beside the way itself.
    """

    factor: float
    margin_s: float
    climb_mps: float

    def needed_s(self, home_s: FloatArray | float, climb_m: FloatArray | float) -> FloatArray:
        """The time left below which it turns back, by the time home and the climb to its altitude."""
        return np.asarray(self.factor * (home_s + climb_m / self.climb_mps) + self.margin_s)


@dataclass(frozen=True)
class Autopilot:
    """The autopilot and its parameters, which `eadp replan --mavlink` reads from it."""

    kind: Literal["ardupilot", "px4"] | None = None
    """Its software: ardupilot or px4; by default none, whose rules do not count."""

    parameters: Mapping[str, float] = field(default_factory=dict)
    """Its parameters by name, where they are not the factory's, like FW_LND_ANG: 7."""

    def value(self, name: str) -> float | None:
        """A parameter's value: as given, else the factory's of its kind; None where neither has it."""
        return self.given(name, FACTORY.get(self.kind or "", {}).get(name))

    def given(self, name: str, default: float | None = None) -> float | None:
        """A parameter's value as given, by the name that older versions have, too; else a default."""
        older, times = OLDER.get(name, ("", 1.0))
        if older in self.parameters and name not in self.parameters:
            return self.parameters[older] / times
        return self.parameters.get(name, default)

    def airspeed_limits_mps(self, cruise_mps: float) -> tuple[float, float]:
        """Least and greatest airspeed that may be commanded, calibrated [m/s]; that of cruise always may.

        A greatest one counts where it is given: a cruise above the factory's shows that it is another.
        """
        if self.kind is None:
            return 0.0, math.inf
        low, high = LIMITS[self.kind]
        return min(self.value(low) or 0.0, cruise_mps), max(self.given(high) or math.inf, cruise_mps)

    # --- how it returns

    def return_altitude_m(self, planned_m: float | None) -> float | None:
        """Altitude at which it returns [m]: as given, as planned, or the factory's; None for the one it is at."""
        name = "RTL_RETURN_ALT" if self.kind == PX4 else "RTL_ALTITUDE"
        found = self.given(name, self.value(name) if planned_m is None else planned_m)
        return None if found is None or (found < 0 and self.kind == ARDUPILOT) else found

    @property
    def lands(self) -> bool:
        """Whether its return flies the mission's landing; of ArduPilot unless a value is given that does not."""
        return bool(self.value("RTL_TYPE")) if self.kind == PX4 else self.given("RTL_AUTOLAND", LANDS[1]) in LANDS

    def circle_radius_m(self, planned_m: float) -> float:
        """Radius of the circle at home [m]: as given, else as planned."""
        names = ("NAV_LOITER_RAD",) if self.kind == PX4 else ("RTL_RADIUS", "WP_LOITER_RAD")
        return next((abs(value) for name in names if (value := self.given(name))), planned_m)

    # --- when it turns back

    @property
    def time_rule(self) -> TimeRule | None:
        """By which time left it turns back; None where it does not."""
        if self.kind != PX4 or self.value("COM_FLTT_LOW_ACT") != RETURNS_HOME:
            return None
        climb_mps = self.value("FW_T_CLMB_R_SP") or FACTORY[PX4]["FW_T_CLMB_R_SP"]
        return TimeRule(self.value("RTL_TIME_FACTOR") or 0.0, self.value("RTL_TIME_MARGIN") or 0.0, climb_mps)

    def low_soc(self, battery: Battery, power_w: FloatArray) -> FloatArray:
        """State of charge below which it gives the mission up by its battery's limits, 0 where by none; as `power_w`.

        Parameters
        ----------
        battery : Battery
        power_w : array
            Mean power drawn [W], at which a voltage under load is measured.
        """
        limits = [np.zeros_like(power_w)]
        if self.kind == PX4 and self.value("COM_LOW_BAT_ACT") in ON_CRITICAL:
            limits.append(np.full_like(power_w, self.value("BAT_CRIT_THR") or 0.0))
        for level in ("LOW", "CRT") if self.kind == ARDUPILOT and not battery.prescribed else ():
            if not self.value(f"BATT_FS_{level}_ACT"):
                continue
            limits.append(np.full_like(power_w, (self.value(f"BATT_{level}_MAH") or 0.0) / (1e3 * battery.capacity_ah)))
            limit_v = self.value(f"BATT_{level}_VOLT") or 0.0
            if limit_v > 0 and battery.voltage_at(1.0) > battery.voltage_at(0.0):
                # of V = U − R I, with I = P/V; U itself where sag is taken off
                sagging = 0.0 if self.value("BATT_FS_VOLTSRC") else battery.resistance_ohm / limit_v
                limits.append(battery.soc_at(limit_v + sagging * power_w))
        found: FloatArray = np.max(limits, axis=0)
        return found
