"""Settings that are possible and unlikely."""

from __future__ import annotations

import pytest

from eadp.models.battery import Battery
from eadp.models.doubts import aircraft_doubts, position_doubts
from eadp.models.vehicle import FixedWing, PaperVehicle, PowerCurve

BATTERY = Battery()
LIGHT, HEAVY = FixedWing(mass_kg=1.0), FixedWing(mass_kg=2.0)
ORIGIN_DEG = (55.37, 10.43)


def keys_of(vehicle=LIGHT, battery=BATTERY):
    return [doubt.key for doubt in aircraft_doubts(vehicle, battery)]


def test_a_battery_has_no_more_energy_than_the_aircrafts_mass_could_hold():
    lifted, too_heavy = Battery(voltage_v=10.0, capacity_ah=50.0), Battery(voltage_v=10.0, capacity_ah=50.1)
    assert keys_of(battery=lifted) == keys_of(HEAVY, too_heavy) == keys_of(PaperVehicle(), too_heavy) == []
    assert keys_of(battery=too_heavy) == ["battery.capacity_ah"]


@pytest.mark.parametrize(("airspeed_mps", "doubtful"), [(8.1, False), (7.9, True), (26.9, False), (27.1, True)])
def test_a_power_curve_is_measured_around_the_airspeed(airspeed_mps, doubtful):
    curve = PowerCurve(points=((12.0, 30.0), (18.0, 50.0)), airspeed_mps=airspeed_mps)
    assert keys_of(curve) == (["vehicle.airframe.points"] if doubtful else [])


@pytest.mark.parametrize(
    ("position_m", "message"),
    [
        ((55.4, 10.4), "(55.4, 10.4) m, which are the degrees of the plan's origin"),
        ((10.43, 55.37), "(10.43, 55.37) m, which are the degrees of the plan's origin"),
        ((55.37, -10.43), ""),
        ((99_000.0, 0.0), ""),
        ((560_000.0, 6_130_000.0), "(560000, 6.13e+06) m, 6156 km from the plan's first trigger"),
        (None, ""),
    ],
)
def test_positions_in_metres_are_near_the_plan(position_m, message):
    found = [doubt.message for doubt in position_doubts("home", position_m, (0.0, 0.0), ORIGIN_DEG)]
    assert found == ([message] if message else [])
    assert [*position_doubts("home", (10.43, 55.37), (0.0, 0.0), None)] == []
