"""When a flight has reached its plan."""

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


@pytest.mark.parametrize(
    ("flight", "from_s", "to_s"),
    [
        (take_off, 3 + 50 / 3 + STAYS_S, 3 + 60 / 3 + STAYS_S),
        # too fast is not near
        (lambda s: (27.0 if 3 < s < 40 else take_off(s)[0], take_off(s)[1]), 40 + STAYS_S, 40 + STAYS_S),
        # another altitude that is held is near, too; along the runway it is not
        (lambda second: (take_off(second)[0], min(take_off(second)[1], 36.0)), 15, 35),
        (lambda second: (15.0 if second else 2.0, 0.2), MAX_S + 1, 200),
        # without altitudes the slowest climb counts, of 1 m/s
        (lambda second: (min(15.0, 4.0 * second), None), 60 + STAYS_S, 60 + STAYS_S),
        # what holds another airspeed flies its plan in the end
        (lambda second: (20.0 if second else 0.0, 60.0), MAX_S + 1, MAX_S + 1),
    ],
)
def test_a_flight_from_the_ground_is_on_its_plan_once_it_is_near(flight, from_s, to_s):
    from_ground, time_s = reached_s(flight)
    assert from_ground
    assert from_s <= time_s <= to_s
