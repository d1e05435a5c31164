"""Vehicle files: the shipped one, what a scenario makes of one, and what is refused."""

import dataclasses

import pytest
from common import ROOT

from eadp.errors import InputError
from eadp.io.scenario import read_scenario
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import Document, read_yaml
from eadp.io.vehicle import VehicleFile, vehicle_of
from eadp.models.battery import Battery
from eadp.models.vehicle import AIRFRAMES, FixedWing, PaperVehicle

WING = ROOT / "vehicles/survey-wing.yaml"
VEHICLE = """\
schema: eadp.vehicle/1
name: 2 kg survey wing
airframe: {mass_kg: 2.0, wing_area_m2: 0.45}
battery: {capacity_ah: 5, resistance_ohm: 0.03}
"""


def read(text):
    document = read_yaml(Text("v.yaml", text))
    return vehicle_of(document)


@pytest.fixture
def scenario(tmp_path):
    """A scenario beside a vehicle file, and what it makes of some text and overrides."""
    (tmp_path / "v.yaml").write_text(VEHICLE)

    def of(text="", **overrides):
        path = tmp_path / "s.yaml"
        path.write_text(f"schema: eadp.scenario/1\nvehicle: v.yaml\n{text}")
        return read_scenario(str(path), overrides)

    return of


def test_the_shipped_vehicle_is_the_default_aircraft():
    shipped = read(read_text(str(WING)).body)
    assert shipped.airframe == FixedWing(airspeed_range_mps=(10.0, 15.0))  # the default holds its airspeed
    assert shipped.battery == Battery()
    assert read_scenario(None).keys.vehicle == VehicleFile()


def test_every_airframe_model_is_read():
    for model, airframe in AIRFRAMES.items():
        found = vehicle_of(Document("v", {"airframe": {"model": model, "mass_kg": 3}})).airframe
        assert found == airframe(mass_kg=3.0)


def test_a_scenario_takes_its_vehicle_from_a_file_beside_it(scenario):
    found = scenario()
    assert found.keys.vehicle.name == "2 kg survey wing"
    assert found.keys.vehicle.airframe == FixedWing(mass_kg=2.0, wing_area_m2=0.45)
    assert found.keys.battery == Battery(capacity_ah=5.0, resistance_ohm=0.03)
    assert found.vehicle_text is not None
    assert found.vehicle_text.body == VEHICLE


def test_the_scenario_overrides_the_vehicle_key_by_key(scenario):
    found = scenario("battery: {capacity_ah: 1}\n", **{"vehicle.airframe.mass_kg": 2.5, "battery.soc": 0.9})
    assert found.keys.vehicle.airframe == FixedWing(mass_kg=2.5, wing_area_m2=0.45)
    assert found.keys.battery == Battery(capacity_ah=1.0, resistance_ohm=0.03, soc=0.9)


def test_null_restores_a_default(scenario):
    found = scenario("battery: {capacity_ah: null}\n", **{"vehicle.airframe.mass_kg": None})
    assert found.keys.battery.capacity_ah == Battery().capacity_ah
    assert found.keys.vehicle.airframe.mass_kg == FixedWing().mass_kg


def test_cells_give_the_voltages(scenario):
    cells = {"battery.cells": 4, "battery.chemistry": "li-ion"}
    battery = scenario(**cells).keys.battery
    assert (battery.voltage_v, battery.voltage_empty_v) == pytest.approx((16.8, 12.8))
    assert battery.capacity_ah == 5.0
    # of a layer above, a voltage replaces the cells, and cells the voltage
    with_cells = scenario(**{"vehicle.battery.cells": 3})
    assert with_cells.keys.battery.voltage_empty_v == pytest.approx(10.5)
    own = scenario("battery: {voltage_v: 12}\n", **{"vehicle.battery.cells": 3}).keys.battery
    assert (own.voltage_v, own.voltage_empty_v, own.cells) == (12, pytest.approx(10.5), None)
    again = scenario("battery: {voltage_v: 12}\n", **{"battery.cells": 3}).keys.battery
    assert (again.voltage_v, again.cells) == (pytest.approx(12.6), 3)
    other = scenario("battery: {chemistry: lihv}\n", **{"vehicle.battery.cells": 3}).keys.battery
    assert other.voltage_v == pytest.approx(13.05)


def test_cells_of_a_layer_above_have_their_own_resistance(scenario):
    vehicle = {"vehicle.battery": {"cells": 4, "capacity_ah": 5, "resistance_ohm": 0.02}}
    assert scenario(**vehicle).keys.battery.resistance_ohm == 0.02
    other = scenario(**vehicle, **{"battery.cells": 6}).keys.battery
    assert (other.resistance_ohm, other.capacity_ah) == (pytest.approx(6 * 0.04 / 5), 5.0)


SHEET = {"span_m": 2.1, "mass_kg": 3.4, "airspeed_mps": 17, "endurance_min": 60}
PACK = {"chemistry": "lipo", "cells": 4, "capacity_ah": 10}


def test_a_data_sheet_is_an_airframe_wherever_a_vehicle_is_read(scenario):
    text = f"schema: eadp.vehicle/1\ndata_sheet: {SHEET}\nbattery: {PACK}\n".replace("'", "")
    vehicle = read(text)
    battery, airframe = vehicle.battery, vehicle.airframe
    assert battery.endurance_s(airframe.cruise_power_w) == pytest.approx(3600, rel=1e-3)
    assert airframe.power_std_share == pytest.approx(0.15, abs=1e-3)
    keys = {"vehicle": {"data_sheet": SHEET, "battery": PACK}}
    assert scenario(**keys).keys.vehicle.airframe == airframe
    # another pack changes no aircraft; a greater mass does
    assert scenario(**keys, **{"battery.capacity_ah": 5}).keys.vehicle.airframe == airframe
    heavy = scenario(**keys, **{"vehicle.airframe.mass_kg": 4}).keys.vehicle.airframe
    assert heavy == dataclasses.replace(airframe, mass_kg=4)
    fast = scenario(**keys, **{"vehicle.airframe.airspeed_mps": 21}).keys.vehicle.airframe
    assert fast.power_std_share > 0.16, "it is known less well beside the stated airspeed"


def test_a_vehicle_may_be_set_and_stand_inline(scenario):
    assert scenario(vehicle=str(WING)).keys.vehicle.airframe == FixedWing(airspeed_range_mps=(10.0, 15.0))
    inline = read_scenario(None, {"vehicle": {"airframe": {"model": "paper"}, "battery": {"capacity_ah": 1}}})
    assert inline.keys.vehicle.airframe == PaperVehicle()
    assert inline.keys.battery.capacity_ah == 1


STATED = "data_sheet: {span_m: 2.1, mass_kg: 3.4, airspeed_mps: 17"
BAD = [
    ("airframe: {mass: 3}", ":2:12: error: unknown key airframe.mass; expected one of model, mass_kg"),
    ("airframe: {throttle_power_w: 3}", ":2:12: error: airframe.throttle_power_w is a key of model paper, not"),
    ("airframe: {model: kite}", ":2:12: error: unknown airframe.model kite; expected one of fixed-wing, paper"),
    ("battery: {voltage_empty_v: 15}", ":2:11: error: battery.voltage_empty_v: 15 V is above voltage_v"),
    ("battery: {cells: 4, chemistry: nicd}", ":2:21: error: battery.chemistry nicd is none of lipo, lihv, li-ion,"),
    ("battery: {chemistry: lipo}", ":2:11: error: battery.chemistry without cells"),
    ("battery: {cells: 4, voltage_v: 16}", ":2:21: error: battery.cells and battery.voltage_v are both given; exp"),
    (f"{STATED}}}", ":2:1: error: data_sheet has no endurance; expected endurance_min or cruise_power_w"),
    (f"{STATED}, endurance_min: 60}}", ":2:59: error: data_sheet.endurance_min without the pack that it is stated"),
    (f"{STATED}, endurance_min: 60, pack_wh: 9000}}", ":2:1: error: data_sheet has 9e+03 W at 17 m/s, of 3.4 kg with"),
    (f"airframe: {{model: paper}}\n{STATED}, cruise_power_w: 9}}", ":3:1: error: data_sheet beside an airframe of mod"),
    (f"{STATED}, cruise_power_w: 9, endurance_min: 6}}", ":2:1: error: data_sheet has an endurance and a"),
]


@pytest.mark.parametrize(("text", "message"), BAD)
def test_what_is_refused(text, message):
    with pytest.raises(InputError) as refused:
        read(f"schema: eadp.vehicle/1\n{text}\n")
    assert f"v.yaml{message}" in str(refused.value)


def test_faults_of_a_vehicle_file_stand_in_it(scenario, tmp_path):
    (tmp_path / "v.yaml").write_text("schema: eadp.vehicle/1\nairframe: {mass_kg: 0}\n")
    with pytest.raises(InputError, match=r"v\.yaml:2:12: error: airframe\.mass_kg cannot be 0"):
        scenario()
    (tmp_path / "v.yaml").write_text("airframe: {mass_kg: 1}\n")
    with pytest.raises(InputError, match=r"v\.yaml:1:1: error: has no key schema"):
        scenario()
    (tmp_path / "v.yaml").unlink()
    with pytest.raises(InputError, match=r"v\.yaml:1:1: error: cannot be read"):
        scenario()
