"""Settings and options that are possible, and so unlikely that they may mean something else: each with its reason."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.models.battery import Battery, BatteryFault
from eadp.models.vehicle import Airframe, PaperVehicle, PowerCurve
from eadp.models.weather import Wind

MAX_WH_PER_KG = 500.0
"""Energy of a battery over the mass of the whole aircraft [Wh/kg]: the best cells alone have about 450 Wh/kg."""
MAX_GUST_SHARE = 0.4
"""Standard deviation of the gusts over the airspeed. At 0.4 they exceed the airspeed 4 % of the time, as of two normal
axes exp(−1/(2·0.4²)): the aircraft is blown back, which no forecast counts."""
MAX_BEYOND = 1.5
"""Largest ratio of the airspeed to the measured ones: beyond it, the power is a guess, or the points are swapped."""
FAR_M = 100_000.0
"""Distance from the plan that no small aircraft flies to begin one [m]: its metres may be those of a map's grid."""
LATE_S = 30_000.0
"""Time after which batteries are empty; most times in ms are above it [s]."""
NEAR_DEG = 1.0
"""Distance of two positions that are one place [°]."""


SMALLER = {
    "_ah": ("mAh", 1000.0, " Ah"),
    "_v": ("mV", 1000.0, " V"),
    "_ohm": ("mΩ", 1000.0, " Ω"),
    "_kg": ("g", 1000.0, " kg"),
    "soc": ("%", 100.0, ""),
    "soc_drop": ("%", 100.0, ""),
    "efficiency": ("%", 100.0, ""),
}
"""By the ends of keys: the unit in which values are often written, how many of it make one, and the key's own."""


def meant(key: str, value: float) -> str:
    """What a value beyond its bound was probably meant as, by the end of its key; '' where that is not known."""
    for end, (unit, many, own) in SMALLER.items():
        if key.endswith(end):
            return f"{value:g} {unit} are {value / many:g}{own}"
    return ""


class Doubt(NamedTuple):
    """A dotted key of a scenario, or an option, why its value is doubtful, and what is expected."""

    key: str
    message: str
    expected: str


def aircraft_doubts(vehicle: Airframe, battery: Battery, wind: Wind) -> Iterator[Doubt]:
    """Doubts about a battery that no aircraft lifts, and gusts that none flies in."""
    capacity_ah, energy_wh = battery.capacity_ah, battery.energy_wh(1.0)
    if not isinstance(vehicle, PaperVehicle) and energy_wh > MAX_WH_PER_KG * vehicle.mass_kg:
        message = f"{capacity_ah:g} Ah, which are {energy_wh:.4g} Wh, in an aircraft of {vehicle.mass_kg:g} kg"
        expected = f"at most {MAX_WH_PER_KG:g} Wh/kg: {capacity_ah:g} mAh are {capacity_ah / 1000:g} Ah"
        yield Doubt("battery.capacity_ah", message, expected)
    if isinstance(vehicle, PowerCurve) and len(vehicle.points) > 1:
        low_mps, high_mps = vehicle.level_speeds_mps()
        if not low_mps / MAX_BEYOND <= vehicle.airspeed_mps <= high_mps * MAX_BEYOND:
            message = f"points from {low_mps:g} to {high_mps:g} m/s, at an airspeed of {vehicle.airspeed_mps:g} m/s"
            yield Doubt("vehicle.airframe.points", message, "[airspeed in m/s, power in W], around the airspeed")
    if wind.gust_std_mps > MAX_GUST_SHARE * vehicle.airspeed_mps:
        message = (
            f"gusts with a standard deviation of {wind.gust_std_mps:g} m/s, at an airspeed of "
            f"{vehicle.airspeed_mps:g} m/s: they exceed it often, which no forecast counts"
        )
        expected = f"at most {MAX_GUST_SHARE * vehicle.airspeed_mps:.3g} m/s"
        yield Doubt("wind.gust_std_mps", message, expected)


def angle_doubts(key: str, angle_deg: float | None) -> Iterator[Doubt]:
    """Doubts about an angle of a few degrees and a fraction: up to 2π, which radians are."""
    if angle_deg is not None and abs(angle_deg) <= 2 * math.pi and angle_deg != round(angle_deg):
        expected = f"degrees: {angle_deg:g} rad are {math.degrees(angle_deg):.4g}°"
        yield Doubt(key, f"{angle_deg:g}°, an angle of a few degrees", expected)


def position_doubts(key: str, position_m: Point | None, first_m: Point, origin_deg: Point | None) -> Iterator[Doubt]:
    """Doubts about a position in metres: far from the plan's first trigger, or the degrees of the plan's origin."""
    if position_m is None:
        return
    where = f"({position_m[0]:g}, {position_m[1]:g}) m"
    if origin_deg and any(math.dist(each, origin_deg) < NEAR_DEG for each in (position_m, position_m[::-1])):
        message = f"{where}, which are the degrees of the plan's origin"
        yield Doubt(f"{key}.position_m", message, "metres, or lat_deg and lon_deg")
    elif (far_m := math.dist(position_m, first_m)) > FAR_M:
        message = f"{where}, {far_m / 1000:.0f} km from the plan's first trigger"
        yield Doubt(f"{key}.position_m", message, "metres in the plan's frame")


def fault_doubts(faults: Sequence[BatteryFault], time_limit_s: float) -> Iterator[Doubt]:
    """Doubts about faults after hours and after the time limit, which may cut a flight short on purpose."""
    for i, fault in enumerate(faults):
        if fault.at_s > max(LATE_S, time_limit_s):
            message = f"a loss of charge at {fault.at_s:g} s, after the time limit"
            yield Doubt(f"faults.{i}.at_s", message, f"seconds, at most {time_limit_s:.4g}")
