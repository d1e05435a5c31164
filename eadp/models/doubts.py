"""Settings that are possible, and so unlikely that they may mean something else: each with its reason."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.models.battery import Battery
from eadp.models.vehicle import Airframe, PaperVehicle
from eadp.models.weather import Wind

MAX_WH_PER_KG = 500.0
"""Energy of a battery over the mass of the whole aircraft [Wh/kg]: the best cells alone have about 450 Wh/kg."""
MAX_GUST_SHARE = 0.4
"""Standard deviation of the gusts over the airspeed. At 0.4 they exceed the airspeed 4 % of the time, as of two normal
axes exp(−1/(2·0.4²)): the aircraft is blown back, which no forecast counts."""
NEAR_DEG = 1.0
"""Distance of two positions that are one place [°]."""


class Doubt(NamedTuple):
    """A dotted key of a scenario, why its value is doubtful, and what is expected."""

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
    if wind.gust_std_mps > MAX_GUST_SHARE * vehicle.airspeed_mps:
        message = (
            f"gusts with a standard deviation of {wind.gust_std_mps:g} m/s, at an airspeed of "
            f"{vehicle.airspeed_mps:g} m/s: they exceed it often, which no forecast counts"
        )
        expected = f"at most {MAX_GUST_SHARE * vehicle.airspeed_mps:.3g} m/s"
        yield Doubt("wind.gust_std_mps", message, expected)


def position_doubts(key: str, position_m: Point | None, origin_deg: Point | None) -> Iterator[Doubt]:
    """A doubt about a position in metres whose numbers are the degrees of the plan's origin."""
    if position_m is None or origin_deg is None:
        return
    if any(math.dist(each, origin_deg) < NEAR_DEG for each in (position_m, position_m[::-1])):
        message = f"({position_m[0]:g}, {position_m[1]:g}) m, which are the degrees of the plan's origin"
        yield Doubt(f"{key}.position_m", message, "metres, or lat_deg and lon_deg")
