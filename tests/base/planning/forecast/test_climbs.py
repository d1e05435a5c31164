"""Altitudes and airspeeds of stages: the flight by its energy, the forecast by the flight."""

import math

import pytest

from eadp.api.inputs import load_flight
from eadp.core import compiled
from eadp.core.guidance import GRAVITY_MPS2
from eadp.errors import InputError
from eadp.models.vehicle import FixedWing
from eadp.simulation.loop import Outcome, fly

VEHICLE = FixedWing()
CLIMB_J = VEHICLE.mass_kg * GRAVITY_MPS2 * 100 / VEHICLE.propulsive_efficiency
WIND = {"wind.speed_mps": 6.0, "wind.from_deg": 200.0}


def leg(x, *headers):
    """A stage along the x axis, and what holds from it on."""
    return "".join(f"%: {header}\n" for header in headers) + f"0.01; 270; y\n{x}, 0\n"


LEVEL = leg(1000) + leg(2500)
CLIMB = leg(1000, "altitude 25") + leg(2500, "altitude 125")
DESCENT = leg(1000, "altitude 125") + leg(3000, "altitude 25")
STAIRS = leg(1000, "altitude 25") + leg(1200, "altitude 125") + leg(2500, "altitude 100") + leg(5000, "altitude 150")
FASTER = leg(1500) + leg(4000, "airspeed 20") + leg(6000, "airspeed 12")


@pytest.fixture
def inputs_of(tmp_path):
    def load(text, planner="static", **overrides):
        path = tmp_path / "a.plan"
        path.write_text(text)
        keys = {"planner.name": planner, "start.position_m": [0, 0], "wind.speed_mps": 0.0, "step_s": 0.02}
        return load_flight(str(path), overrides=keys | overrides)

    return load


def flown(inputs):
    outcome = Outcome()
    return list(fly(inputs.world, inputs.flight(), outcome)), outcome


@pytest.mark.quick(5)
@pytest.mark.parametrize("wind", [{}, WIND])
@pytest.mark.parametrize("text", [CLIMB, DESCENT, STAIRS, FASTER])
@pytest.mark.parametrize("planner", ["static", "joint"])
def test_the_forecast_is_what_is_flown(text, wind, planner, inputs_of):
    inputs = inputs_of(text, planner, **wind)
    forecast = inputs.preflight().forecast
    _, outcome = flown(inputs)
    assert outcome.completed
    assert forecast.energy_wh == pytest.approx(outcome.energy_j / 3600, rel=0.015)
    assert forecast.remaining_s == pytest.approx(outcome.duration_s, rel=0.015)


@pytest.mark.quick(2)
@pytest.mark.parametrize(("text", "within"), [(CLIMB, 0.025), (DESCENT, 0.025), (STAIRS, 0.025), (FASTER, 0.05)])
def test_in_flight_too(text, within, inputs_of):
    """Climbs that are flown are not learned as power of level flight; changes of the airspeed are, a little."""
    inputs = inputs_of(text, "joint", **WIND, **{"planner.joint.loss_rate_per_h": 0.0})
    _, outcome = flown(inputs)
    used = inputs.mission.battery.soc - outcome.soc_final
    for record in outcome.records:
        assert record.ending.soc_end == pytest.approx(outcome.soc_final, abs=within * used)
        assert record.time_s + record.ending.remaining_s == pytest.approx(outcome.duration_s, rel=0.025)


def test_a_battery_that_cannot_climb_is_forecast(inputs_of):
    # 52 W are enough for level flight, and for the mean of a leg with 100 W of climbing in it
    limits = {"battery.capacity_ah": 1.0, "battery.max_c_rate": 3.5}
    inputs = inputs_of(leg(1000, "altitude 25") + leg(7000, "altitude 125"), "joint", **limits)
    assert not inputs.preflight().feasible
    assert inputs_of(leg(1000) + leg(7000), "joint", **limits).preflight().feasible
    assert "cannot deliver" in flown(inputs)[1].reason


def test_the_forecast_knows_the_ground_speed_that_a_climb_takes(inputs_of):
    level, climb = (inputs_of(text).preflight().forecast for text in (LEVEL, CLIMB))
    slower_s = 100 / 3 * (1 - math.sqrt(1 - (3 / 15) ** 2))
    assert climb.remaining_s - level.remaining_s == pytest.approx(slower_s, rel=0.01)
    more_j = 3600 * (climb.energy_wh - level.energy_wh)
    assert more_j == pytest.approx(CLIMB_J + VEHICLE.cruise_power_w * slower_s, rel=1e-3)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("text", "within"), [(STAIRS, 0.1), (FASTER, 1.0)])
def test_neither_climbs_nor_airspeeds_are_taken_for_wind(text, within, inputs_of):
    _, outcome = flown(inputs_of(text, "joint"))
    assert max(math.hypot(*record.wind_mps) for record in outcome.records) < within


@pytest.mark.slow
@pytest.mark.skipif(not compiled.available(), reason="eadp[fast] is not installed")
def test_compiled_flights_climb_alike(inputs_of):
    def steps():
        return [step._replace(power_forecast_w=0.0) for step in flown(inputs_of(STAIRS + FASTER, **WIND))[0]]

    compiled.enable(False)
    plain = steps()
    compiled.enable()
    assert steps() == plain


def test_a_flight_starts_at_the_altitude_of_its_first_stage(inputs_of):
    assert inputs_of(LEVEL).world.start.altitude_m == VEHICLE.cruise_altitude_m
    assert inputs_of(DESCENT).world.start.altitude_m == 125
    assert inputs_of(DESCENT, **{"start.altitude_m": 50.0}).world.start.altitude_m == 50
    # from home, as a mission: on the ground
    assert inputs_of("%: start 0 0\n" + DESCENT, **{"start.position_m": None}).world.start.altitude_m == 0


@pytest.mark.parametrize(
    ("airspeed", "wind", "what"),
    [(7, 0, "stage 2: an airspeed of 7 m/s is below the stall's 7.4"), (12, 13, "a wind of 13 m/s"), (60, 0, "motor")],
)
def test_airspeeds_that_cannot_be_flown_are_errors_at_their_stage(airspeed, wind, what, inputs_of):
    with pytest.raises(InputError) as caught:
        inputs_of(leg(1000) + leg(2500, f"airspeed {airspeed}"), **{"wind.speed_mps": float(wind)})
    assert what in caught.value.faults[0].message
    assert caught.value.faults[0].line == 4


def test_a_climb_that_a_leg_is_too_short_for_goes_on_in_the_next(inputs_of):
    steps = flown(inputs_of(STAIRS))[0]
    top = max(step.altitude_m for step in steps if step.stage == 2)
    assert 60 < top < 70  # 200 m of way, 40 m of climb


def test_an_ardupilot_takes_off_at_full_throttle(inputs_of):
    """From the ground to 25 m, 20° steep: the greatest power for as long, in place of m g Δh/η."""
    text = leg(1000, "altitude 25") + leg(2500, "altitude 125")
    at_ground = {"start.altitude_m": 0.0}
    usual, at_full = (
        inputs_of(text, **at_ground, **more).preflight().forecast.energy_wh * 3600
        for more in ({}, {"autopilot.kind": "ardupilot"})
    )
    full_j = 25 * (VEHICLE.max_motion_w - VEHICLE.cruise_power_w) / (VEHICLE.airspeed_mps * math.sin(math.radians(20)))
    assert at_full - usual == pytest.approx(full_j - CLIMB_J / 4, rel=1e-3)
    # in the air it climbs as any other
    flying = {"start.altitude_m": 25.0}
    kinds = {}, {"autopilot.kind": "ardupilot"}
    one, other = (inputs_of(text, **flying, **more).preflight().forecast for more in kinds)
    assert one.energy_wh == pytest.approx(other.energy_wh)
