"""When a flight has reached its plan, whether that is flown, and its end: by how much it is passed, what follows."""

import math

import pytest
from common import ROOT
from common.observations import seen_at

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.live.gate import FAR, Continuation, Departure, is_certain
from eadp.live.locator import MAX_S, STAYS_S, FollowedExecutor, InitialClimb
from eadp.models.plan.cursor import PlanCursor, Rules
from eadp.planning.base import Mode, Sample

PLAN, _ = read_plan(read_text(str(ROOT / "plans/survey.plan")))
NORTH = math.pi / 2


def in_lap(lap):
    """On the first stage of a lap of the survey at c1 = 0; laps from 15 on may end the plan, beyond (175, 161)."""
    executor = FollowedExecutor(PlanCursor.start(PLAN, (0.0, 10.0), Rules()), (-45.0, 216.0))
    for _ in range(4 * lap):
        executor.skip((0.0, 0.0))
    return executor


@pytest.mark.parametrize(
    ("position", "course", "certain"),
    [
        ((175.2, 161.1), NORTH, False),
        ((177.0, 161.1), NORTH, True),
        ((177.0, 161.1), None, False),
        ((175.2, 170.0), 0.0, True),
        ((175.2, 170.0), math.pi, False),
    ],
)
def test_an_end_is_certain_if_it_is_passed_by_more_than_the_error_of_a_position(position, course, certain):
    executor = in_lap(15)
    executor.advance(*position)
    assert executor.complete
    assert is_certain(executor, position, course) == certain


def test_a_flight_goes_on_past_an_end_and_the_other_is_left_as_it_was():
    executor = in_lap(15)
    executor.advance(175.2, 161.1)
    following = executor.past_end()
    assert executor.complete
    assert not following.complete
    following.advance(175.3, 162.0)
    assert not following.complete
    assert following.skip((35.0, 150.0))
    assert (following.cursor.lap, following.stage.index) == (15, 2)


def test_the_next_leg_decides_that_it_goes_on_and_positions_elsewhere_that_it_does_not():
    executor = in_lap(15).past_end()
    continuation = Continuation(executor)
    (ox, oy), _ = executor.cursor.offset_m, executor.stage
    on_circle = seen_at(0.0, (-45.0 + ox, 216.0 + oy), math.pi)
    assert all(continuation.update(executor, on_circle, 1.0) is None for _ in range(60))
    executor.skip(executor.trigger_m)
    on_line = seen_at(0.0, (-115.0 + ox, 80.0 + oy), -NORTH)
    assert [continuation.update(executor, on_line, 1.0) for _ in range(5)] == [None] * 4 + [True]
    away, elsewhere = Continuation(executor), seen_at(0.0, (500.0, 500.0), 0.0)
    assert [away.update(executor, elsewhere, 2.5) for _ in range(2)] == [None, False]


def sample(time_s, flies_mission=None):
    return Sample(time_s, (0.0, 0.0), power_w=40.0, soc=0.9, mode=Mode(flies_mission))


@pytest.mark.parametrize("flies", [True, False])
def test_a_mode_decides_at_once_wherever_the_aircraft_is(flies):
    departure = Departure()
    departure.update(sample(0.0, flies), 0.0 if not flies else 100 * FAR)
    assert departure.away is not flies


def test_without_a_mode_the_distance_decides():
    departure = Departure()
    found = []
    for time_s, mismatch in enumerate([0.0, FAR + 1, FAR + 1, 0.0, FAR + 1, *[0.0] * 10, FAR + 1]):
        departure.update(sample(float(time_s)), mismatch)
        found.append(departure.away)
    # a circle that crosses the path for a moment is still away from it
    assert found == [False, *[True] * 8, *[False] * 6, True]
    assert departure.away_s == 1.0  # counts anew


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
