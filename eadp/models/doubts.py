"""Settings and options that are possible, and so unlikely that they may mean something else: each with its reason."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.models.battery import Battery
from eadp.models.vehicle import Airframe, PaperVehicle, PowerCurve

MAX_WH_PER_KG = 500.0
"""Energy of a battery over the mass of the whole aircraft [Wh/kg]: the best cells alone have about 450 Wh/kg."""
MAX_BEYOND = 1.5
"""Largest ratio of the airspeed to the measured ones: beyond it, the power is a guess, or the points are swapped."""
FAR_M = 100_000.0
"""Distance from the plan that no small aircraft flies to begin one [m]: its metres may be those of a map's grid."""
NEAR_DEG = 1.0
"""Distance of two positions that are one place [°]."""


class Doubt(NamedTuple):
    """A dotted key of a scenario, or an option, why its value is doubtful, and what is expected."""

    key: str
    message: str
    expected: str


def aircraft_doubts(vehicle: Airframe, battery: Battery) -> Iterator[Doubt]:
    """Doubts about a battery that no aircraft lifts, and a power curve that is of other airspeeds."""
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
