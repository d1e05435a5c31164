"""Settings that are possible and unlikely."""

from __future__ import annotations

import pytest

from eadp.models.battery import Battery
from eadp.models.doubts import aircraft_doubts, position_doubts
from eadp.models.vehicle import FixedWing, PaperVehicle
from eadp.models.weather import Wind

BATTERY, CALM = Battery(), Wind()
LIGHT, HEAVY = FixedWing(mass_kg=1.0), FixedWing(mass_kg=2.0)
ORIGIN_DEG = (55.37, 10.43)


def keys_of(vehicle=LIGHT, battery=BATTERY, wind=CALM):
    return [doubt.key for doubt in aircraft_doubts(vehicle, battery, wind)]


def test_a_battery_has_no_more_energy_than_the_aircrafts_mass_could_hold():
    lifted, too_heavy = Battery(voltage_v=10.0, capacity_ah=50.0), Battery(voltage_v=10.0, capacity_ah=50.1)
    assert keys_of(battery=lifted) == keys_of(HEAVY, too_heavy) == keys_of(PaperVehicle(), too_heavy) == []
    assert keys_of(battery=too_heavy) == ["battery.capacity_ah"]


@pytest.mark.parametrize(("share", "doubtful"), [(0.39, False), (0.41, True)])
def test_gusts_are_well_below_the_airspeed(share, doubtful):
    found = keys_of(wind=Wind(gust_std_mps=share * LIGHT.airspeed_mps))
    assert found == (["wind.gust_std_mps"] if doubtful else [])


@pytest.mark.parametrize(
    ("position_m", "doubtful"), [((55.4, 10.4), True), ((10.43, 55.37), True), ((55.37, -10.43), False), (None, False)]
)
def test_degrees_of_the_plans_place_are_no_metres(position_m, doubtful):
    found = [doubt.key for doubt in position_doubts("home", position_m, ORIGIN_DEG)]
    assert found == (["home.position_m"] if doubtful else [])
    assert not [*position_doubts("home", position_m, None)]
