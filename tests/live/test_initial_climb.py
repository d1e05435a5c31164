"""When a flight has reached its plan."""

from __future__ import annotations

import pytest

from eadp.live.locator import MAX_S, STAYS_S, InitialClimb
from eadp.planning.base import Sample


def reached_s(flight, altitude_m=60.0):
    """When it is: `flight` gives airspeed [m/s] and altitude [m] at a time [s]."""
    samples = [
        Sample(float(k), (0.0, 0.0), 40.0, 1.0, airspeed_mps=airspeed, altitude_m=height)
        for k, (airspeed, height) in enumerate(map(flight, range(200)))
    ]
    climb = InitialClimb(samples[0], 15.0, altitude_m)
    for sample in samples:
        climb.update(sample, altitude_m)
        if climb.on_plan:
            return climb.from_ground, sample.time_s
    return climb.from_ground, None


def take_off(second):
    """On the ground for 3 s, then 3 m/s up to 60 m."""
    return min(15.0, 4.0 * second), min(60.0, max(0.0, 3.0 * (second - 3)))


def test_a_flight_in_the_air_flies_its_plan_at_once():
    assert reached_s(lambda second: (15.2, 58.0)) == (False, 0.0)
    assert reached_s(lambda second: (None, None)) == (False, 0.0)


def test_a_take_off_ends_near_the_plans_altitude():
    from_ground, time_s = reached_s(take_off)
    assert from_ground
    assert 3 + 50 / 3 + STAYS_S <= time_s <= 3 + 60 / 3 + STAYS_S


def test_too_fast_is_not_near():
    _, time_s = reached_s(lambda second: (27.0 if 3 < second < 40 else take_off(second)[0], take_off(second)[1]))
    assert time_s == 40 + STAYS_S


def test_another_altitude_that_is_held_is_near_too():
    _, time_s = reached_s(lambda second: (take_off(second)[0], min(take_off(second)[1], 36.0)))
    assert 15 < time_s < 35


def test_along_the_runway_it_is_not():
    assert reached_s(lambda second: (15.0 if second else 2.0, 0.2))[1] > MAX_S


@pytest.mark.parametrize("altitude_m", [25.0, 60.0])
def test_without_altitudes_the_slowest_climb_counts(altitude_m):
    _, time_s = reached_s(lambda second: (min(15.0, 4.0 * second), None), altitude_m)
    assert time_s == altitude_m + STAYS_S


def test_what_holds_another_airspeed_flies_its_plan_in_the_end():
    assert reached_s(lambda second: (20.0 if second else 0.0, 60.0))[1] == MAX_S + 1
