"""Settings and options that are possible, and so unlikely that they may mean something else: each with its reason."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.models.battery import Battery, BatteryFault
from eadp.models.vehicle import Airframe, PaperVehicle, PowerCurve
from eadp.models.weather import Wind
from eadp.survey.camera import Pictures

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


LEGAL_M = 120.0
"""Height above ground up to which most rules let unmanned aircraft fly: 120 m in Europe, 400 ft elsewhere [m]."""
FOOT_M = 0.3048
SMALL_SENSOR_MM = 3.0
"""Width of a sensor below that of a 1/4-inch one (3.6 mm); a few thermal ones are smaller [mm]."""
LONG_LENS = 3.0
"""Focal length over the sensor's width, from which on a picture spans less than 19°."""
QUICK_S = 0.5
"""Time between pictures below which most cameras for mapping take none [s]."""


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


class Shots(NamedTuple):
    """A camera's pictures as options have them; None where they do not.

    Attributes
    ----------
    altitude_m : float or None
        Above ground [m].
    sensor_width_mm, focal_length_mm : float or None
        [mm].
    gsd_cm : float or None
        Size of a pixel on the ground, where the altitude follows from it [cm].
    """

    altitude_m: float | None = None
    sensor_width_mm: float | None = None
    focal_length_mm: float | None = None
    gsd_cm: float | None = None


def shot_doubts(shots: Shots) -> Iterator[Doubt]:
    """Doubts about the altitude and the camera of a survey."""
    altitude_m, width_mm, focal_mm, gsd_cm = shots
    if altitude_m is not None and altitude_m > LEGAL_M:
        message = f"{altitude_m:.4g} m, above the {LEGAL_M:g} m that most rules allow"
        if gsd_cm is None:
            yield Doubt("--altitude", message, f"metres: {altitude_m:g} ft are {altitude_m * FOOT_M:.4g} m")
        else:
            lower_cm = math.floor(100 * gsd_cm * LEGAL_M / altitude_m) / 100
            expected = f"at most {lower_cm:g} cm a pixel, or another lens"
            yield Doubt("--gsd", f"{gsd_cm:g} cm a pixel are seen from {message}", expected)
    if width_mm is not None and width_mm < SMALL_SENSOR_MM:
        expected = "as 6.2 mm of 1/2.3 inch, 13.2 of 1 inch, 23.5 of APS-C, 35.9 of full frame"
        yield Doubt("--sensor-width-mm", f"{width_mm:g} mm, smaller than a 1/4-inch sensor", expected)
    if width_mm is not None and focal_mm is not None and focal_mm > LONG_LENS * width_mm:
        message = f"{focal_mm:g} mm with a sensor of {width_mm:g} mm, which spans {_span_deg(width_mm, focal_mm):.2g}°"
        expected = f"the lens's own: as full-frame equivalent it is {focal_mm * width_mm / 36:.3g} mm"
        yield Doubt("--focal-length-mm", message, expected)


def interval_doubts(pictures: Pictures) -> Iterator[Doubt]:
    """A doubt about pictures that follow one another too fast on the fastest lines."""
    distance_m, speed_mps, shortest_s = pictures.distance_m, pictures.speed_mps, pictures.interval_s
    if distance_m is not None and distance_m < (shortest_s or QUICK_S) * speed_mps:
        message = f"a picture each {distance_m:.3g} m, which are {distance_m / speed_mps:.2g} s on the fastest lines"
        whose = f"the camera's {shortest_s:g} s" if shortest_s else f"{QUICK_S:g} s, as most cameras have"
        yield Doubt("--forward-overlap", message, f"{whose}: less overlap, a slower flight, or more altitude")


def _span_deg(width_mm: float, focal_mm: float) -> float:
    """Angle of view across [°]."""
    return math.degrees(2 * math.atan(width_mm / 2 / focal_mm))


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
