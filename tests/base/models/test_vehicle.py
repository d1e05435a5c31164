"""Aircraft models: speeds, powers and faults, worked by hand."""

import math
from dataclasses import replace

import pytest

from eadp.models.vehicle import FixedWing, PaperVehicle, PowerCurve

# 1 N of weight, ½ ρ S = 0.5: q S = 0.5 V²
WING = FixedWing(
    mass_kg=1 / 9.80665, wing_area_m2=1.0, air_density_kgpm3=1.0, max_lift_coefficient=0.5, aspect_ratio=4 / math.pi,
    oswald_efficiency=0.5, zero_lift_drag_coefficient=0.1, propulsive_efficiency=0.5, avionics_w=3.0, airspeed_mps=4.0,
    max_bank_deg=60.0,
)  # fmt: skip


def test_a_wing_in_level_flight():
    assert WING.weight_n == pytest.approx(1.0)
    # C_L = W/(q S): 0.5 at 2 m/s
    assert WING.stall_mps == pytest.approx(2.0)
    assert WING.stall_in_turn_mps(math.radians(60)) == pytest.approx(2.0 * math.sqrt(2))
    # D = q S (C_D0 + C_L²/(π e A)) = 8 (0.1 + 0.125²/2), P = D V/η
    drag_n = 8 * (0.1 + 0.125**2 / 2)
    assert WING.drag_n(4.0) == pytest.approx(drag_n)
    assert WING.cruise_power_w == pytest.approx(drag_n * 4 / 0.5 + 3.0)
    assert WING.level_power_w(4.0, math.radians(60)) == pytest.approx(8 * (0.1 + 0.25**2 / 2) * 4 / 0.5 + 3.0)


def test_the_papers_vehicle():
    vehicle = PaperVehicle(speed_per_throttle_mps=0.4, nominal_throttle=45.0, idle_power_w=10.0, throttle_power_w=60.0)
    assert vehicle.airspeed_mps == pytest.approx(18.0)
    assert vehicle.cruise_power_w == pytest.approx(10 + 27)
    assert vehicle.faults() == []


CURVE = PowerCurve(
    points=((10.0, 22.0), (20.0, 82.0)), bank_w=9.0, avionics_w=2.0, propulsive_efficiency=0.5, airspeed_mps=15.0
)


def test_a_power_curve():
    # drag η (P − 2)/V: 1 N at 10 m/s, 2 N at 20 m/s
    assert CURVE.drags_n == pytest.approx((1.0, 2.0))
    assert [CURVE.level_power_w(v) for v in (10.0, 20.0)] == pytest.approx([22.0, 82.0])
    assert CURVE.cruise_power_w == pytest.approx(1.5 * 15 / 0.5 + 2)
    assert CURVE.level_power_w(15.0, math.radians(45)) - CURVE.cruise_power_w == pytest.approx(9.0)
    assert CURVE.level_power_w(10.0, math.radians(45)) - 22.0 == pytest.approx(9.0 * 15 / 10)
    # beyond the points, of constant drag
    assert CURVE.level_power_w(30.0) == pytest.approx(2 * 30 / 0.5 + 2)
    assert CURVE.level_speeds_mps() == (10.0, 20.0)


@pytest.mark.parametrize(
    ("airframe", "changes", "words"),
    [
        (WING, {}, []),
        (WING, {"airspeed_mps": 2.0}, ["below the stall's 2.0 m/s"]),
        (WING, {"airspeed_mps": 2.5}, ["at a bank of 60° and 2.5 m/s the wing stalls"]),  # n = 2 takes 2.83 m/s
        (WING, {"airspeed_mps": 2.5, "max_bank_deg": 45.0}, []),
        (WING, {"max_power_w": 6.8}, ["level flight takes 7 W of a motor of 6.8 W"]),  # 6.9 W
        (WING, {"max_power_w": 7.0}, []),
        (CURVE, {}, []),
        (CURVE, {"points": ((10.0, 22.0), (10.0, 30.0))}, ["do not rise"]),
        (CURVE, {"points": ((10.0, 2.0),)}, ["no more than the avionics' 2 W"]),
        (CURVE, {"max_power_w": 44.0}, ["level flight takes 45 W of a motor of 44 W"]),
    ],
)
def test_faults_of_an_airframe(airframe, changes, words):
    faults = replace(airframe, **changes).faults()
    assert len(faults) == len(words)
    assert all(word in fault for word, fault in zip(words, faults, strict=True))
