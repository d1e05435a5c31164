"""The climb before the first line, on circles or with the camera off: by hand, on level ground and on a slope."""

import itertools
import math

import numpy as np
import pytest
from common.planes import FIELD, LIMITS, MOTION, WING, ground

from eadp.core.geometry.polygons import FreeSpace
from eadp.errors import Infeasible
from eadp.survey.coverage import CoverageRequest, cover
from eadp.survey.heights import REACHED_SHARE, climb_lack, climbed_first, held_up_m, level_lack, over_terrain
from eadp.survey.report import Covered

HOME = (-60.0, 60.0)
ALTITUDE_M = 100.0
UP_MPS = 0.8 * WING.up_mps
ROUNDING_S = 1e-3


def near_home(**given):
    """Lines over the field from a home beside it, by an order that knows nothing of a climb."""
    request = CoverageRequest(FIELD, MOTION, "dubins", 0.0, HOME, HOME, **given)
    return cover(request)


def before_first_s(solution):
    """Time from the start to the first line, by lengths: without wind [s]."""
    legs = itertools.takewhile(lambda leg: not leg.sensing, solution.path(0.0).legs)
    return sum(leg.piece.length_m for leg in legs) / MOTION.airspeed_mps


def test_a_climb_is_over_at_its_share_of_the_height():
    """By small steps of the model with 0.8 of its greatest rate."""
    slower = WING._replace(up_mps=UP_MPS)
    for height_m in (3.0, 20.0, ALTITUDE_M):
        time_s, up_m = WING.reached_s(height_m), np.array(0.0)
        for _ in range(2000):
            up_m = slower.followed_m(up_m, height_m, time_s / 2000)
        assert float(up_m) == pytest.approx(REACHED_SHARE * height_m, rel=1e-3)


def test_circles_before_the_first_line_take_the_time_that_the_climb_lacks():
    needed_s = WING.reached_s(ALTITUDE_M)
    plain = near_home()
    lacks_s = needed_s - before_first_s(plain)
    assert lacks_s > 20
    found = climbed_first(plain, MOTION, None, lambda each: level_lack(each, MOTION, needed_s))
    circles = [leg for leg in found.path(0.0).legs if leg.whole_circle]
    assert {leg.start for leg in circles} == {leg.end for leg in circles}
    # on the line's start, as wide as takes just the time, in whole metres
    first = next(leg for leg in found.path(0.0).legs if leg.sensing)
    assert circles[0].start == pytest.approx(first.start)
    radius_m = circles[0].piece.radius_m
    assert radius_m >= MOTION.min_radius_m
    assert radius_m == pytest.approx(round(radius_m))
    more_s = before_first_s(found) - before_first_s(plain)
    assert lacks_s - ROUNDING_S <= more_s <= max(lacks_s + 1, 2 * math.pi * MOTION.min_radius_m / MOTION.airspeed_mps)
    # its times count
    assert found.time_s - plain.time_s == pytest.approx(more_s)
    assert found.access_s - plain.access_s == pytest.approx(more_s)


def test_an_order_that_knows_of_the_climb_is_not_longer_than_circles():
    needed_s = WING.reached_s(ALTITUDE_M)

    def lack(each):
        return level_lack(each, MOTION, needed_s)

    circled = climbed_first(near_home(), MOTION, None, lack)
    chosen = climbed_first(near_home(climb_s=needed_s), MOTION, None, lack)
    assert before_first_s(chosen) >= needed_s - ROUNDING_S
    assert chosen.time_s <= circled.time_s + ROUNDING_S


def test_without_room_for_a_circle_the_camera_is_off_and_the_ground_is_named():
    needed_s, plain = WING.reached_s(ALTITUDE_M), near_home()
    nowhere = FreeSpace([], [[(5000.0, 5000.0), (5001.0, 5000.0), (5001.0, 5001.0)]])
    found = climbed_first(plain, MOTION, nowhere, lambda each: level_lack(each, MOTION, needed_s))
    legs, before = found.path(0.0), plain.path(0.0)
    assert [leg.piece.length_m for leg in legs.legs if leg.whole_circle] == []
    assert legs.length_m == pytest.approx(before.length_m)
    assert before_first_s(found) == pytest.approx(needed_s)
    off_m = sum(leg.piece.length_m for leg in before.legs if leg.sensing)
    off_m -= sum(leg.piece.length_m for leg in legs.legs if leg.sensing)
    assert off_m > 100
    covered = Covered(FIELD, legs, MOTION.swath_m).share
    assert covered == pytest.approx(1 - off_m * MOTION.swath_m / (600 * 300), abs=0.01)


def test_laps_without_room_for_a_circle_are_refused():
    laps = cover(CoverageRequest(FIELD, MOTION, "zamboni", 0.0, HOME, HOME))
    nowhere = FreeSpace([], [[(5000.0, 5000.0), (5001.0, 5000.0), (5001.0, 5001.0)]])
    with pytest.raises(Infeasible, match="no room for a circle before the laps"):
        climbed_first(laps, MOTION, nowhere, lambda each: level_lack(each, MOTION, 60.0))


@pytest.mark.quick(1)
@pytest.mark.parametrize("slope", [0.0, 0.06])
def test_over_terrain_lines_have_their_height_and_ways_their_clearance_once_they_had_it(slope):
    """On a plane by its own heights; on lines none is lower, where before some were."""
    under = ground(lambda x, y: slope * (x - HOME[0]))._replace(motion=MOTION)
    plain = near_home()
    lack = climb_lack(plain, under, WING, 0.0)
    assert lack.late_s > 0
    assert lack.until_m > 0
    found = climbed_first(plain, MOTION, None, lambda each: climb_lack(each, under, WING, 0.0))
    assert climb_lack(found, under, WING, 0.0).late_s == pytest.approx(0)
    _, profile = over_terrain(found, under, WING, 0.0)
    above_m = profile.flown_m - slope * (profile.samples.points_m[:, 0] - HOME[0])
    assert above_m[profile.samples.on_line].min() >= LIMITS.line_m - 1e-3
    has_m = np.maximum.accumulate(above_m >= LIMITS.clearance_m + 1)
    assert above_m[has_m].min() >= LIMITS.clearance_m - 0.5


def test_radii_are_such_as_autopilots_hold():
    assert [held_up_m(radius_m) for radius_m in (36.0, 36.2, 254.9, 255.1, 261.0)] == [36, 37, 255, 260, 270]
