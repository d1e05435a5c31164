"""Coverage paths over terrain: heights by hand on planes, what is cut and what is not, and what cannot be flown."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from common.planes import FIELD, LIMITS, MOTION, WING, ground

from eadp.core.geometry.dubins import straight
from eadp.errors import Infeasible
from eadp.models.airspace import Obstacle
from eadp.survey.coverage import CoverageRequest, cover
from eadp.survey.heights import FinalApproach, over_terrain
from eadp.survey.swaths import CoverageLeg

ROUNDING_M = 1e-5


def flown(height, pattern="dubins", heading_rad=0.0, start_m=None, obstacles=(), lands=False, **given):
    solution = cover(CoverageRequest(FIELD, MOTION, pattern, heading_rad, **given))
    final = FinalApproach(given["approach"], LIMITS.line_m) if lands else None
    return solution, *over_terrain(solution, ground(height, obstacles), WING, start_m, lands=final)


def test_level_ground_has_one_altitude():
    solution, path, profile = flown(lambda x, y: 0 * x + 7)
    assert path.sections == tuple(replace(leg, altitude_m=87.0) for leg in solution.sections)
    assert profile.flown_m - profile.ground_m == pytest.approx(80.0)


@pytest.mark.parametrize("slope", [0.03, -0.06])
def test_lines_up_a_plane_keep_their_height(slope):
    solution, path, profile = flown(lambda x, y: slope * x)
    legs = path.sections
    # the same path in more pieces, one after the other; turns are whole
    assert sum(leg.piece.length_m for leg in legs) == pytest.approx(solution.path(0.0).length_m)
    for before, after in itertools.pairwise(legs):
        assert after.start == pytest.approx(before.end)
    turns = [[leg.piece for leg in each.sections if leg.piece.turn] for each in (solution, path)]
    assert turns[0] == turns[1]
    # heights by the plane itself, at the samples of the profile
    x = profile.samples.points_m[:, 0]
    above_m = (profile.flown_m - slope * x)[profile.samples.on_line]
    assert above_m == pytest.approx(profile.above_m, abs=ROUNDING_M)
    assert above_m.min() >= 80 - ROUNDING_M
    assert above_m.max() <= 88 + ROUNDING_M
    # a climb at once, and one along the whole leg: both are above the plane at both ends
    lines = [leg for leg in legs if leg.sensing]
    assert len(lines) >= 2 * len([leg for leg in solution.sections if leg.sensing])
    assert min(leg.altitude_m - slope * leg.end[0] for leg in lines) >= 80 - ROUNDING_M


def test_a_slope_across_the_lines_needs_an_altitude_a_line():
    # lines along y of a plane that rises with x: each is level
    solution, _, profile = flown(lambda x, y: 0.04 * x, heading_rad=math.pi / 2)
    assert len(profile.commanded_m) <= solution.path(0.0).lines
    assert profile.above_m.min() >= 80 - ROUNDING_M
    # on either side of a line the ground is as much higher as lower
    assert profile.sides_m == pytest.approx(profile.ground_m, abs=ROUNDING_M)


def test_a_ridge_between_lines_raises_them():
    # lines along x, 50 m apart: a ridge of 10 m in the middle between two, which their pictures show both
    lines = cover(CoverageRequest(FIELD, MOTION, "dubins", 0.0)).sections
    middle = sorted({round(leg.start[1], 3) for leg in lines if leg.sensing})[:2]
    ridge = sum(middle) / 2

    def height(x, y):
        return 10 * np.maximum(0, 1 - np.abs(y - ridge) / 20)

    *_, profile = flown(height)
    beside = profile.samples.on_line & (np.abs(np.abs(profile.samples.points_m[:, 1] - ridge) - 25) < 1)
    inner = beside & (profile.samples.points_m[:, 0] > 50) & (profile.samples.points_m[:, 0] < 550)
    # one of its two sides is on the ridge: half its height, but for the grid's cells
    assert profile.sides_m[inner] == pytest.approx(5.0, abs=1.5)
    assert profile.ground_m[inner] == pytest.approx(0.0, abs=0.5)
    assert profile.overlapping_m.min() >= 80 - ROUNDING_M


def test_turns_and_ways_keep_the_clearance():
    # a wall beside the field, under the turns at its east end, 90 m higher
    *_, profile = flown(lambda x, y: 90 * np.clip((x - 600) / 30, 0, 1))
    assert (profile.flown_m - profile.ground_m)[~profile.samples.on_line].min() >= 20 - ROUNDING_M
    assert profile.above_m.min() >= 80 - ROUNDING_M


def test_an_obstacle_is_flown_over_where_its_ground_is():
    # a mast of 30 m on a plane, at x = 300 above lines of 80 m: 20 m clear of its top, from the highest of its ground
    mast = Obstacle(((290.0, 100.0), (310.0, 100.0), (310.0, 200.0), (290.0, 200.0)), "mast", 75.0)
    plane = ground(lambda x, y: 0.02 * x, [mast])
    (top,) = plane.airspace.obstacles
    assert top.height_m == pytest.approx(75 + 0.02 * 310)
    *_, profile = flown(lambda x, y: 0.02 * x, obstacles=[mast])
    x, y = profile.samples.points_m.T
    over = (np.abs(x - 300) < 10) & (np.abs(y - 150) < 50)
    assert over.any()
    assert profile.flown_m[over].min() >= top.height_m + 20 - ROUNDING_M
    # of one beyond the terrain no top is known
    far = replace_outline(mast, 1e5)
    assert ground(lambda x, y: 0 * x, [far]).airspace.obstacles[0].height_m is None


def replace_outline(obstacle, shift_m):
    return obstacle._replace(outline=tuple((x + shift_m, y) for x, y in obstacle.outline))


def test_a_flight_from_the_ground_climbs_from_home():
    *_, profile = flown(lambda x, y: 0 * x, start_m=0.0)
    assert profile.flown_m[0] == 0
    rates = np.diff(profile.flown_m) / (np.diff(profile.samples.places_m) / 15.0)
    assert rates.max() <= WING.up_mps + 1e-9
    # 80 m take 27 s and more of the first line, of 3,600 m in all; where it is lower than the clearance it is no turn
    below_m = profile.samples.places_m[int(np.argmax(profile.flown_m >= 80))]
    assert below_m >= 80 / WING.up_mps * 15
    assert profile.flown_m[200] >= 80


def test_ground_that_rises_faster_than_the_climb_is_named():
    # 40 % for 300 m from the start of the first line, at x = 600; the aircraft climbs 20 %; samples are 5 m apart
    with pytest.raises(Infeasible, match=r"the ground at 55\.5\d+,10\.5\d+ rises 120 m in 302 m of the way from home"):
        flown(lambda x, y: 0.4 * np.clip(600 - x, 0, 300), start_m=0.0)


def test_a_path_beyond_the_terrain_is_named():
    with pytest.raises(Infeasible, match=r"no height at 55\.\d+,10\.\d+, where the flight leads"):
        flown(lambda x, y: np.where(x > 620, np.nan, 0))


def test_an_approach_is_one_slope_from_above_the_ground_where_it_lands():
    # a plane that rises to the east; the approach of 600 m comes from the west to 40 m below the field's middle
    down = CoverageLeg(straight((-900.0, 150.0), (-300.0, 150.0)))
    _, path, profile = flown(lambda x, y: 0.05 * x, lands=True, home_m=(0.0, 0.0), approach=down)
    *_, before, last = path.sections
    assert (last.piece, last.altitude_m) == (down.piece, pytest.approx(-15.0))
    assert before.altitude_m == pytest.approx(65.0, abs=8 / 2)
    assert profile.flown_m[-1] == pytest.approx(-15.0)
    on_approach = profile.samples.places_m >= profile.samples.places_m[-1] - 600
    slopes = np.diff(profile.flown_m[on_approach]) / np.diff(profile.samples.places_m[on_approach])
    assert slopes == pytest.approx(-80 / 600, rel=8 / 2 / 80)
    assert np.ptp(slopes) < ROUNDING_M


def test_a_flight_too_high_for_its_approach_is_none():
    # the approach begins beside the last line, 100 m below it
    down = CoverageLeg(straight((-100.0, 150.0), (-700.0, 150.0)))
    with pytest.raises(Infeasible, match=r"m too high at .* for the final approach"):
        flown(lambda x, y: np.where(x < -50, -100.0, 0.0), lands=True, home_m=(0.0, 0.0), approach=down)
