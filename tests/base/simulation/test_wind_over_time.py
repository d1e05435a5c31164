"""A wind that changes in flight."""

import json
import math

import numpy as np
import pytest
from common import ROOT

import eadp
from eadp.core import compiled
from eadp.models.weather import Wind

SURVEY, SCENARIO = str(ROOT / "plans/survey.plan"), str(ROOT / "scenarios/survey.yaml")
RISING = str(ROOT / "scenarios/rising-wind.yaml")
COARSE = {"step_s": 0.05, "log_every_s": 1.0}


def flown(profile, **more):
    overrides = {"planner.name": "static", "battery.capacity_ah": 3, "faults": [], "step_s": 0.05, **more}
    wind = {"wind.profile": profile} if profile else {}
    return eadp.simulate(SURVEY, scenario=SCENARIO, overrides=overrides | wind)


def test_components_are_linear_between_rows():
    rows = [(10.0, 3.0, 270.0), (20.0, 5.0, 180.0), (50.0, 0.0, 0.0)]
    wind = Wind(profile=tuple(rows))
    times = [row[0] for row in rows]
    east = [speed * math.sin(math.radians(deg + 180)) for _, speed, deg in rows]
    north = [speed * math.cos(math.radians(deg + 180)) for _, speed, deg in rows]
    for time_s in (0.0, 9.9, 10.0, 12.5, 19.0, 20.0, 35.0, 50.0, 90.0):
        expected = float(np.interp(time_s, times, east)), float(np.interp(time_s, times, north))
        assert wind.steady_at_mps(time_s) == pytest.approx(expected, abs=1e-12)
    assert wind.steady_mps == pytest.approx((3.0, 0.0), abs=1e-12)
    assert wind.speeds_mps == (0.0, 5.0)


@pytest.mark.slow
def test_a_drifting_aircraft_moves_with_the_wind_that_it_is_told():
    """Over a straight leg the ground speed is that of the wind triangle of the moment."""
    steps = flown([[0, 2, 270], [300, 8, 270]], **{"wind.gust_std_mps": 0, "time_limit_s": 200}).steps
    for before, after in zip(steps[:-10:50], steps[10::50], strict=False):
        seconds = after.time_s - before.time_s
        if before.stage != after.stage or before.stage not in (2, 4) or before.time_s < 30:
            continue
        if abs(after.heading_rad - before.heading_rad) > 0.01:
            continue
        wind = Wind(profile=((0, 2, 270), (300, 8, 270))).steady_at_mps((before.time_s + after.time_s) / 2)[0]
        ground = math.hypot(after.x_m - before.x_m, after.y_m - before.y_m) / seconds
        # the legs run north and south, the wind is square to them
        assert ground == pytest.approx(math.sqrt(15**2 - wind**2), rel=0.02)


@pytest.mark.skipif(not compiled.available(), reason="numba is not installed")
def test_compiled_flights_are_the_same():
    profile = [[0, 2, 180], [60, 6, 200]]
    compiled.enable(False)
    plain = flown(profile, time_limit_s=100)
    compiled.enable()
    assert flown(profile, time_limit_s=100).steps == plain.steps


@pytest.mark.slow
def test_joint_answers_a_rising_wind_and_static_does_not():
    joint = eadp.simulate(SURVEY, scenario=RISING, overrides=COARSE)
    assert joint.summary["energy_forecast"]["completes"]
    assert joint.summary["completed"]
    assert joint.summary["reserve_kept"]
    static = eadp.simulate(SURVEY, scenario=RISING, overrides={**COARSE, "planner.name": "static"})
    assert static.summary["energy_forecast"]["completes"]
    assert not static.summary["completed"]


@pytest.mark.parametrize(
    ("wind", "message"),
    [
        ("{profile: [[0, 2, 270], [0, 3, 270]]}", "wind.profile is not in order of time"),
        ("{profile: [[0, 2]]}", "wind.profile"),
        ("{profile: [[0, 2, 270], [60, 20, 270]]}", "a wind of 20 m/s, at an airspeed of 15 m/s"),
        ("{profile: [[0, 2, 270]], speed_mps: 3}", "wind.profile and wind.speed_mps are both given"),
    ],
)
def test_bad_profiles(eadp, tmp_path, wind, message):
    path = tmp_path / "s.yaml"
    path.write_text(f"schema: eadp.scenario/1\nprofile: {ROOT}/profiles/pednet-jetson-nano.yaml\nwind: {wind}\n")
    answer = eadp("simulate", SURVEY, "--scenario", path)
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.startswith(f"{path}:3:")
    assert message in answer.err


def test_one_way_to_give_the_wind_removes_the_other(eadp):
    profile = ("--set", "wind.profile=[[0, 4, 180]]")
    speed = ("--set", "wind.speed_mps=4", "--set", "wind.from_deg=180")
    short = ("--scenario", SCENARIO, "--set", "time_limit_s=5", "--format", "json")
    ways = profile, speed, (*profile, *speed)
    flights = [json.loads(eadp("simulate", SURVEY, *short, *given).out) for given in ways]
    assert len({flight["distance_m"] for flight in flights}) == 1
