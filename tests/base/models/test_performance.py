"""What an aircraft can do, beside the closed forms of textbooks, worked here from a parabolic polar alone."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eadp.models.battery import Battery
from eadp.models.performance import ground_radius_m, performance
from eadp.models.vehicle import FixedWing

# a glider with ½ρS = 0.5, W = 9.80665 N: its best speeds lie far above the stall
WING = FixedWing(
    mass_kg=1.0, wing_area_m2=1.0, air_density_kgpm3=1.0, aspect_ratio=8.0, oswald_efficiency=1.0,
    zero_lift_drag_coefficient=0.01, max_lift_coefficient=3.0, propulsive_efficiency=0.5, avionics_w=0.0,
    max_power_w=100.0, airspeed_mps=7.0, max_bank_deg=40.0,
)  # fmt: skip
W, K, C_D0, HALF = 9.80665, 1 / (8 * math.pi), 0.01, 0.5
IDEAL = Battery(voltage_v=10.0, resistance_ohm=0.0, capacity_ah=2.0)  # 20 Wh
POWER_MPS = math.sqrt(W / HALF * math.sqrt(K / (3 * C_D0)))
DRAG_MPS = math.sqrt(W / HALF * math.sqrt(K / C_D0))


def test_best_speeds_stall_turn_and_motor_are_the_textbooks():
    found = performance(WING, IDEAL)
    assert found.endurance_mps == pytest.approx(POWER_MPS, rel=1e-6)
    assert found.range_mps == pytest.approx(DRAG_MPS, rel=1e-6)
    assert found.glide_mps == pytest.approx(DRAG_MPS, rel=1e-9)
    # (L/D)max = 1/(2 √(K C_D0)); P_min = 4/3 W V √(3 K C_D0)... worked as D V at C_L² = 3 C_D0/K
    assert found.glide_ratio == pytest.approx(1 / (2 * math.sqrt(K * C_D0)))
    least_w = W * POWER_MPS * 4 * C_D0 / math.sqrt(3 * C_D0 / K) / 0.5
    assert found.endurance_w == pytest.approx(least_w, rel=1e-9)
    assert found.range_mps / found.endurance_mps == pytest.approx(3**0.25, rel=1e-6)
    assert found.stall_mps == pytest.approx(math.sqrt(W / HALF / 3.0))
    assert found.stall_in_turn_mps == pytest.approx(found.stall_mps / math.sqrt(math.cos(math.radians(40))))
    assert found.turn_radius_m == pytest.approx(49 / (W * math.tan(math.radians(40))))
    # at the greatest speed the drag takes all the motor's power
    top = found.max_speed_mps
    drag = HALF * top**2 * C_D0 + K * W**2 / (HALF * top**2)
    assert drag * top / 0.5 == pytest.approx(100.0)
    level = (HALF * 49 * C_D0 + K * W**2 / (HALF * 49)) * 7 / 0.5
    assert found.level_power_w == pytest.approx(level)
    assert found.climb_mps == pytest.approx((100 - level) * 0.5 / W)
    assert found.bank_power_w - level == pytest.approx(
        K * W**2 * math.tan(math.radians(40)) ** 2 / (HALF * 49) * 7 / 0.5
    )


def test_a_circle_over_the_ground_is_as_tight_as_the_bank_allows_with_the_wind_behind():
    # W tan φ turns the mass: v²/r = g tan φ, with v over the ground
    radius_m = (9.0 + 4.0) ** 2 / (W * math.tan(math.radians(40)))
    assert ground_radius_m(WING, 9.0, 4.0) == pytest.approx(radius_m, rel=1e-4)


@pytest.mark.parametrize("wind", [0.0, 3.0, 6.0])
def test_endurance_and_range_in_wind(wind):
    found = performance(WING, IDEAL, [wind], computing_w=2.0, reserve_soc=0.25)
    (row,) = found.winds
    assert row.held.power_w == pytest.approx(found.level_power_w + 2)
    hours = 0.75 * 20 / row.held.power_w
    assert row.held.endurance_s == pytest.approx(3600 * hours, rel=1e-6)
    assert row.held.against_m == pytest.approx(row.held.endurance_s * (7 - wind))
    assert row.held.with_m == pytest.approx(row.held.endurance_s * (7 + wind))
    out = row.held.out_and_back_m
    assert out / (7 - wind) + out / (7 + wind) == pytest.approx(row.held.endurance_s)
    # brute force over airspeeds
    speeds = np.arange(max(1.2 * found.stall_mps, wind + 0.01), 20, 0.001)
    watts = (HALF * speeds**2 * C_D0 + K * W**2 / (HALF * speeds**2)) * speeds / 0.5 + 2
    best = speeds[np.argmax((speeds - wind) / watts)]
    assert row.range.airspeed_mps == pytest.approx(best, abs=2e-3)
    assert row.range.against_m >= row.held.against_m


def test_a_wind_that_no_airspeed_outflies():
    (row,) = performance(WING, IDEAL, [60.0]).winds
    assert row.range is None
    assert (row.held.against_m, row.held.out_and_back_m) == (0, 0)


@pytest.mark.parametrize(
    ("wing", "battery", "words"),
    [
        ({}, {}, None),
        ({"airspeed_mps": 2.0}, {}, "below the stall's"),
        ({"airspeed_mps": 3.0, "max_bank_deg": 70.0}, {}, "the wing stalls"),
        ({"max_power_w": 8.0}, {}, "a climb of 3 m/s"),
        ({}, {"resistance_ohm": 10.0}, "level flight"),
        ({}, {"max_c_rate": 0.1}, "current limit"),
    ],
)
def test_what_cannot_be_is_named(wing, battery, words):
    found = performance(replace(WING, **wing), replace(IDEAL, **battery))
    assert (words is None) == (found.faults == ())
    assert words is None or words in " ".join(found.faults)
