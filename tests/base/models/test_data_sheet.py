"""Aircraft by their data sheets: beside published ones, beside polars, and how well what follows is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from common import ROOT
from scipy.optimize import minimize

from eadp.core.guidance import GRAVITY_MPS2
from eadp.errors import EadpError
from eadp.io.text.streams import read_text
from eadp.io.vehicle import read_vehicle
from eadp.models.battery import Battery
from eadp.models.data_sheet import CRUISE_LIFT, DRAG, EFFICIENCY, ENDURANCE_STD, OSWALD, DataSheet, estimate
from eadp.models.vehicle import FixedWing

UX5 = DataSheet(1.0, 2.5, 22.2, endurance_min=50, pack_wh=88.8)
SLOWER_FASTER = (0.8, 1.2)


def of(sheet, battery=None):
    return estimate(sheet.with_power(battery or Battery()))


PUBLISHED = [
    (UX5, "wing_area_m2", 0.34, "Trimble, data sheet of the UX5"),
    (DataSheet(0.96, 0.69, 13.0, endurance_min=50, pack_wh=23.9), "wing_area_m2", 0.25, "senseFly, eBee"),
    (
        DataSheet(3.2, 2.5, 8.2, cruise_power_w=16.1, wing_area_m2=0.776),
        "propulsive_efficiency",
        0.95 * 0.85 * 0.97 * 0.85,
        "Noth 2008, Sky-Sailor: speed controller, motor, gear, propeller",
    ),
    (
        DataSheet(5.69, 6.9, 8.4, cruise_power_w=43.0, wing_area_m2=1.72),
        "propulsive_efficiency",
        0.62,
        "Oettershagen et al. 2017, AtlantikSolar",
    ),
]


@pytest.mark.parametrize(("sheet", "key", "value", "source"), PUBLISHED, ids=lambda value: str(value)[:24])
def test_what_follows_is_near_to_what_is_published(sheet, key, value, source):
    found = of(sheet)
    std = {"wing_area_m2": CRUISE_LIFT[1], "propulsive_efficiency": EFFICIENCY[1]}[key]
    assert abs(math.log(found.keys[key] / value)) < 1.5 * std, source
    assert FixedWing(**found.keys).cruise_power_w == pytest.approx(found.sheet.cruise_power_w)


POLARS = {
    # Beard and McLain 2012, appendix E: Aerosonde
    "Aerosonde": FixedWing(
        mass_kg=13.5, wing_area_m2=0.55, aspect_ratio=2.8956**2 / 0.55, oswald_efficiency=0.9, avionics_w=24,
        zero_lift_drag_coefficient=0.0437, propulsive_efficiency=0.5, airspeed_mps=35, max_power_w=1e4,
    ),
    # Gryte et al. 2018: the X8 as it was flown
    "X8": FixedWing(
        mass_kg=3.364, wing_area_m2=0.75, aspect_ratio=5.88, oswald_efficiency=0.721, avionics_w=9,
        zero_lift_drag_coefficient=0.02, propulsive_efficiency=0.5, airspeed_mps=18, max_power_w=1e3,
    ),
}  # fmt: skip
PRESETS = ("foam-wing", "mapper", "small-wing", "survey-wing")


@pytest.mark.parametrize("name", [*POLARS, *PRESETS])
def test_an_aircraft_that_flies_its_own_endurance_has_its_power_back(name):
    if name in POLARS:
        airframe, battery = POLARS[name], Battery(cells=6, capacity_ah=30.0)
    else:
        vehicle = read_vehicle(read_text(str(ROOT / f"vehicles/{name}.yaml")))
        airframe, battery = vehicle.airframe, vehicle.battery
    span_m = math.sqrt(airframe.aspect_ratio * airframe.wing_area_m2)
    minutes = battery.endurance_s(airframe.cruise_power_w) / 60
    found = of(DataSheet(span_m, airframe.mass_kg, airframe.airspeed_mps, endurance_min=minutes), battery)
    derived = FixedWing(**found.keys)
    assert derived.cruise_power_w == pytest.approx(airframe.cruise_power_w, rel=1e-3)
    for ratio in SLOWER_FASTER:
        speed = ratio * airframe.airspeed_mps
        apart = derived.level_power_w(speed) / airframe.level_power_w(speed) - 1
        assert abs(apart) < found.power_std_at(speed)
    assert derived.stall_mps == pytest.approx(airframe.stall_mps, rel=0.2)


def test_it_is_the_likeliest_that_draws_the_power():
    """By a general minimiser of the distance from what is known beforehand."""
    sheet = replace(UX5, wing_area_m2=0.34)
    found = of(sheet)
    pressure_pa, weight_n = 0.5 * 1.225 * sheet.airspeed_mps**2, sheet.mass_kg * GRAVITY_MPS2
    prior, stds = np.log([DRAG[0], EFFICIENCY[0], OSWALD[0]]), np.array([DRAG[1], EFFICIENCY[1], OSWALD[1]])
    wanted_w = found.sheet.cruise_power_w - found.keys["avionics_w"]

    def misses(x):
        drag, efficiency, oswald = np.exp(x)
        induced_n = weight_n**2 / (math.pi * oswald * sheet.span_m**2 * pressure_pa)
        return math.log((pressure_pa * 0.34 * drag + induced_n) * sheet.airspeed_mps / efficiency / wanted_w)

    best = minimize(
        lambda x: float(np.sum(((x - prior) / stds) ** 2)), prior, constraints={"type": "eq", "fun": misses}, tol=1e-12
    )
    keys = ("zero_lift_drag_coefficient", "propulsive_efficiency", "oswald_efficiency")
    assert [found.keys[key] for key in keys] == pytest.approx(np.exp(best.x), rel=1e-4)


@pytest.mark.slow
def test_the_power_is_as_far_off_as_it_is_said_to_be():
    """Of aircraft drawn from what is known beforehand, each with an endurance that is stated wrongly."""
    rng, scores = np.random.default_rng(1), []
    for _ in range(300):
        drag, efficiency, oswald = (mean * math.exp(rng.normal(0, std)) for mean, std in (DRAG, EFFICIENCY, OSWALD))
        true = FixedWing(
            mass_kg=2.5, wing_area_m2=0.4, aspect_ratio=6.0, oswald_efficiency=min(oswald, 1.0), avionics_w=7.75,
            zero_lift_drag_coefficient=drag, propulsive_efficiency=min(efficiency, 1.0), airspeed_mps=17.0,
        )  # fmt: skip
        stated_w = true.cruise_power_w * math.exp(rng.normal(0, ENDURANCE_STD))
        sheet = DataSheet(math.sqrt(6.0 * 0.4), 2.5, 17.0, endurance_min=60, pack_wh=stated_w, wing_area_m2=0.4)
        try:
            found = of(sheet)
        except EadpError:
            continue
        derived = FixedWing(**found.keys)
        scores.append(
            [
                math.log(derived.level_power_w(speed) / true.level_power_w(speed)) / found.power_std_at(speed)
                for speed in (13.6, 17.0, 20.4)
            ]
        )
    assert len(scores) > 290
    assert np.std(scores, axis=0) == pytest.approx([1.0] * 3, abs=0.15)
    assert of(UX5).power_std_at(22.2) == pytest.approx(ENDURANCE_STD)


@pytest.mark.parametrize("sheet", [replace(UX5, endurance_min=500), replace(UX5, pack_wh=8.8), replace(UX5, span_m=8)])
def test_what_no_such_aircraft_draws_is_refused(sheet):
    with pytest.raises(EadpError, match="of which such an aircraft takes"):
        of(sheet)
