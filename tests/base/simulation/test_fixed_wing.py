"""The fixed-wing aircraft: steady flight as the formulas have it, limits kept, gusts felt as airspeed first."""

import math
from dataclasses import replace

import pytest

from eadp.core.expressions.derivatives import bind
from eadp.core.expressions.reader import read_expression
from eadp.core.guidance import GRAVITY_MPS2
from eadp.models.vehicle import FixedWing, Guidance, PowerCurve
from eadp.models.weather import Wind
from eadp.simulation.aircraft import AIRSPEED, ALTITUDE, BANK, CLIMB, VX, X, Y, constants_of, fly_step, state_of

STEP_S = 0.01
CALM = (0.0, 0.0)


class Plane:
    """One aircraft and its numbers."""

    def __init__(self, position=(0.0, 0.0), heading=0.0, altitude=25.0, vehicle=None, wind=CALM, step_s=STEP_S):
        vehicle = vehicle or FixedWing()
        self.s = state_of(vehicle, wind, position, heading, altitude)
        self.c = constants_of(vehicle, Guidance(), Wind(), step_s)

    def step(self, along, gain=0.1, sense=1, wind=CALM):
        """The power of a step."""
        return fly_step(self.s, self.c, along(self.s[X], self.s[Y]), gain, sense, *wind)


def path(text):
    return bind(read_expression(text), {})


def fly(plane, along, seconds, gain=0.1, sense=1, wind=CALM):
    """The power of every step."""
    winds = wind if callable(wind) else lambda _t: wind
    return [plane.step(along, gain, sense, winds(k * STEP_S)) for k in range(round(seconds / STEP_S))]


@pytest.mark.parametrize("radius", [40.0, 70.0, 120.0])
def test_a_circle_takes_the_bank_and_the_power_of_a_level_turn(radius):
    # counter-clockwise round the origin from its rightmost point, heading north
    plane = Plane((radius, 0.0), math.pi / 2)
    power = fly(plane, path(f"x^2 + y^2 - {radius}^2"), 60, gain=0.1 / (2 * radius))[-1]
    bank = math.atan(15**2 / (GRAVITY_MPS2 * radius))
    assert plane.s[BANK] == pytest.approx(bank, rel=1e-2)
    assert power == pytest.approx(FixedWing().level_power_w(15, bank), rel=2e-3)
    assert math.hypot(plane.s[X], plane.s[Y]) == pytest.approx(radius, abs=0.5)


CURVE = PowerCurve(points=((12.0, 30.0), (15.0, 40.0), (20.0, 90.0)), bank_w=8.0)


@pytest.mark.parametrize("speed", [10.0, 12.0, 14.0, 15.0, 17.0, 20.0, 24.0])
def test_a_power_curve_takes_its_power(speed):
    vehicle = replace(CURVE, airspeed_mps=speed)
    assert fly(Plane(vehicle=vehicle), path("-y"), 20)[-1] == pytest.approx(vehicle.cruise_power_w, rel=1e-6)


def test_a_power_curve_turns_and_climbs():
    plane = Plane((70.0, 0.0), math.pi / 2, vehicle=CURVE)
    power = fly(plane, path("x^2 + y^2 - 70^2"), 60, gain=0.1 / 140)[-1]
    # tan φ = V²/(g r)
    assert power == pytest.approx(40 + 8 * (15**2 / (GRAVITY_MPS2 * 70)) ** 2, rel=5e-3)
    plane = Plane(vehicle=replace(CURVE, cruise_altitude_m=60.0))
    assert fly(plane, path("-y"), 5)[-1] == pytest.approx(40 + 1.2 * GRAVITY_MPS2 * 3 / 0.55, rel=1e-3)


def test_the_published_survey_speed_takes_what_was_published():
    # the published survey flight of such a wing drew from 30.4 to 40.4 W
    wing = FixedWing()
    assert 30.4 < wing.cruise_power_w < 40.4
    # by coefficients: C_L = 2 W/(ρ V² S), C_D = C_D0 + C_L²/(π e A), P = ½ ρ V³ S C_D/η
    for speed in (0.8 * wing.airspeed_mps, wing.airspeed_mps):
        pressure = wing.air_density_kgpm3 * speed**2 / 2
        lift = wing.mass_kg * 9.80665 / pressure / wing.wing_area_m2
        drag = wing.zero_lift_drag_coefficient + lift**2 / (math.pi * wing.oswald_efficiency * wing.aspect_ratio)
        power_w = pressure * speed * wing.wing_area_m2 * drag / wing.propulsive_efficiency + wing.avionics_w
        assert wing.level_power_w(speed) == pytest.approx(power_w, rel=1e-9)


def test_no_bank_is_beyond_its_limit():
    plane = Plane((0.0, 100.0), math.pi)
    line = path("-y")
    steepest = 0.0
    for _ in range(3000):
        plane.step(line, 5.0)
        steepest = max(steepest, abs(plane.s[BANK]))
    assert math.radians(30) < steepest <= math.radians(45)


def test_it_climbs_to_its_height_within_its_limit_and_pays_for_it():
    vehicle = FixedWing(cruise_altitude_m=60.0)
    plane = Plane(altitude=25.0, vehicle=vehicle)
    power = fly(plane, path("-y"), 5)[-1]
    assert plane.s[CLIMB] == 3.0
    # P = (D + W sin γ) V/η: the climb takes m g ḣ/η more
    climb_w = vehicle.weight_n * 3.0 / vehicle.propulsive_efficiency
    assert power == pytest.approx(vehicle.cruise_power_w + climb_w, rel=1e-3)
    fly(plane, path("-y"), 40)
    assert plane.s[ALTITUDE] == pytest.approx(60, abs=0.1)


@pytest.mark.parametrize("airspeed", [10.0, 12.0, 15.0])
def test_a_descent_is_at_most_the_glide_of_the_drag_polar(airspeed):
    vehicle = FixedWing(airspeed_mps=airspeed, cruise_altitude_m=0.0)
    plane = Plane(altitude=200.0, vehicle=vehicle)
    powers = fly(plane, path("-y"), 60)
    assert powers[-1] == vehicle.avionics_w
    assert plane.s[AIRSPEED] == pytest.approx(airspeed, rel=1e-6)
    # tan γ = C_D / C_L with C_D = C_D0 + C_L² / (π e A): Anderson 1999, power-off glide
    pressure = 0.5 * vehicle.air_density_kgpm3 * airspeed**2
    lift = vehicle.mass_kg * GRAVITY_MPS2 / (pressure * vehicle.wing_area_m2)
    drag = vehicle.zero_lift_drag_coefficient + lift**2 / (math.pi * vehicle.oswald_efficiency * vehicle.aspect_ratio)
    assert (200 - plane.s[ALTITUDE]) / plane.s[X] == pytest.approx(drag / lift, rel=0.01)
    assert vehicle.climb_rates_mps(airspeed)[1] == pytest.approx(-plane.s[CLIMB])


def test_a_weak_motor_climbs_with_its_excess_power_and_keeps_the_airspeed():
    vehicle = FixedWing(max_power_w=60.0, cruise_altitude_m=500.0)
    plane = Plane(vehicle=vehicle)
    powers = fly(plane, path("-y"), 30)
    assert powers[-1] == pytest.approx(60.0 + vehicle.avionics_w)
    assert plane.s[AIRSPEED] == pytest.approx(15, rel=1e-6)
    # R/C = (P_available − P_required) / W: Anderson 1999
    required = (vehicle.level_power_w(15.0) - vehicle.avionics_w) * vehicle.propulsive_efficiency
    rate = (60.0 * vehicle.propulsive_efficiency - required) / (vehicle.mass_kg * GRAVITY_MPS2)
    assert plane.s[CLIMB] == pytest.approx(rate, rel=1e-6)
    assert vehicle.climb_rates_mps(15.0)[0] == pytest.approx(rate)


def test_energy_is_conserved_when_the_motor_is_off():
    # without thrust at level height, kinetic energy is lost to drag alone: m V dV = −D ds
    vehicle = FixedWing(airspeed_mps=14.0, speed_gain_per_s=100.0)
    plane = Plane(vehicle=vehicle)
    plane.s[AIRSPEED] = 25.0
    line, lost = path("-y"), 0.0
    before = 0.5 * vehicle.mass_kg * plane.s[AIRSPEED] ** 2
    while plane.s[AIRSPEED] > 18:
        lost += vehicle.drag_n(plane.s[AIRSPEED]) * plane.s[AIRSPEED] * STEP_S
        assert plane.step(line) == vehicle.avionics_w
    assert before - 0.5 * vehicle.mass_kg * plane.s[AIRSPEED] ** 2 == pytest.approx(lost, rel=2e-3)


def test_a_motor_at_its_limit_does_not_hold_the_speed():
    vehicle = FixedWing(max_power_w=20.0)
    plane = Plane(vehicle=vehicle)
    powers = fly(plane, path("-y"), 60)
    assert max(powers) <= 20.0 + vehicle.avionics_w
    assert plane.s[AIRSPEED] < 14


def test_a_head_gust_is_airspeed_first():
    plane = Plane()
    line = path("-y")
    fly(plane, line, 5)
    plane.step(line, wind=(-2.0, 0.0))
    assert plane.s[AIRSPEED] == pytest.approx(17, abs=0.01)
    assert plane.s[VX] == pytest.approx(15, abs=0.01)
    fly(plane, line, 20, wind=(-2.0, 0.0))
    assert plane.s[AIRSPEED] == pytest.approx(15, abs=0.05)
    assert plane.s[VX] == pytest.approx(13, abs=0.05)
