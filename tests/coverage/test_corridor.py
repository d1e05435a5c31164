"""Corridors: lengths, radii and distances by hand, and the ground covered by shapely."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from common import few

from eadp.core.geometry.polygons import corridor
from eadp.coverage.corridor import MAX_BEYOND, cover_corridor
from eadp.coverage.cover import CoverageRequest
from eadp.coverage.report import covered_by_lines
from eadp.coverage.swaths import MotionLimits
from eadp.errors import Infeasible
from eadp.models.airspace import Airspace, Obstacle
from eadp.models.field import Field

SWATH_M, RADIUS_M = 40.0, 25.0
MOTION = MotionLimits(SWATH_M, RADIUS_M, 37.5, 20.0)
RIVER = [(x, 150 * math.sin(x / 300)) for x in range(0, 1500, 20)]
STRAIGHT = [(0.0, 0.0), (1000.0, 0.0)]
CORNER = [(0.0, 0.0), (600.0, 0.0), (600.0, 500.0)]
ZIGZAG = [(0.0, 0.0), (600.0, 0.0), (350.0, 400.0), (1000.0, 500.0)]


def planned(line, width_m, motion=MOTION, airspace=None, **given):
    outline, *holes = corridor(line, width_m)[0]
    field = Field(outline, tuple(holes), airspace=airspace or Airspace())
    return field, cover_corridor(CoverageRequest(field, motion, **given), line, width_m)


def by_shapely(field, path, swath_m):
    """Share of the field within half a swath of the lines, each a polyline of points 2 m apart."""
    runs = [list(run) for on, run in itertools.groupby(path.legs, lambda leg: leg.sensing) if on]
    ground = []
    for run in runs:
        points = [run[0].start[:2]]
        for leg in run:
            steps = math.ceil(leg.piece.length_m / 2)
            points += [leg.piece.pose_at(leg.piece.length_m * k / steps)[:2] for k in range(1, steps + 1)]
        ground.append(shapely.LineString(points).buffer(swath_m / 2, cap_style="flat"))
    area = shapely.Polygon(field.outline, field.holes)
    return area.intersection(shapely.union_all(ground).buffer(1e-6)).area / area.area


@pytest.mark.parametrize("line", [STRAIGHT, RIVER, CORNER, ZIGZAG], ids=["straight", "river", "corner", "zigzag"])
@pytest.mark.parametrize("width_m", few([120.0, 30.0, 50.0], 1))
def test_lines_cover_the_corridor(line, width_m):
    field, solution = planned(line, width_m)
    path = solution.path(0.0)
    covered = covered_by_lines(path, field, SWATH_M)
    assert covered >= 0.995
    assert covered == pytest.approx(by_shapely(field, path, SWATH_M), abs=1e-3)
    assert path.min_radius_m >= RADIUS_M - 1e-6
    for one, other in itertools.pairwise(path.pieces):
        assert one.end[:2] == pytest.approx(other.start[:2], abs=1e-6)
        assert math.remainder(one.end[2] - other.start[2], 2 * math.pi) == pytest.approx(0, abs=1e-6)
    for piece in path.pieces:
        assert piece.pose_at(piece.length_m)[:2] == pytest.approx(piece.end[:2], abs=1e-5)
    # as far as the middle of the corridor is from a line, its swath reaches
    count = math.ceil(width_m / SWATH_M)
    offsets = {round(abs((k + 0.5) * width_m / count - width_m / 2), 6) for k in range(count)}
    middle = shapely.LineString(line)
    for x, y in (leg.piece.pose_at(leg.piece.length_m / 2)[:2] for leg in path.legs if leg.sensing):
        distance_m = middle.distance(shapely.Point(x, y))
        assert min(abs(distance_m - offset) for offset in offsets) < 0.1 * SWATH_M or line in (CORNER, ZIGZAG)


def test_a_straight_corridor_is_flown_forth_and_back():
    _, solution = planned(STRAIGHT, 120.0)
    path = solution.path(0.0)
    lines = [leg for leg in path.legs if leg.sensing]
    assert sorted(round(leg.start[1], 6) for leg in lines) == [-40.0, 0.0, 40.0]
    assert [leg.piece.length_m for leg in lines] == pytest.approx([1000.0] * 3)
    assert path.lines == 3
    assert solution.spacing_m == 40.0
    assert solution.ends == 0
    assert [math.cos(a.start[2]) * math.cos(b.start[2]) for a, b in itertools.pairwise(lines)] == pytest.approx(
        [-1, -1]
    )


def test_a_gentle_bend_is_flown_on_one_line_and_a_sharp_one_ends_it():
    bend = math.radians(20)  # the arc passes the corner at 25 (1/cos 10° − 1) = 0.39 m
    gentle = [(0.0, 0.0), (500.0, 0.0), (500 + 500 * math.cos(bend), 500 * math.sin(bend))]
    _, solution = planned(gentle, 30.0)
    (line,) = [list(run) for on, run in itertools.groupby(solution.path(0.0).legs, lambda leg: leg.sensing) if on]
    taken_m = RADIUS_M * math.tan(bend / 2)
    assert [leg.piece.length_m for leg in line] == pytest.approx([500 - taken_m, RADIUS_M * bend, 500 - taken_m])
    assert solution.ends == 0
    _, solution = planned(CORNER, 30.0)
    lines = [leg.piece.length_m for leg in solution.path(0.0).legs if leg.sensing]
    # each goes on for half a swath times tan 45°
    assert sorted(lines) == pytest.approx([500 + SWATH_M / 2, 600 + SWATH_M / 2])
    assert solution.ends == 1


@pytest.mark.parametrize("line", [[(0, 0), (30, 0), (30, 100)], [(0, 100), (0, 0), (30, 0)]], ids=["first", "last"])
def test_an_arc_that_takes_all_of_a_segment_is_flown(line):
    motion = MotionLimits(700.0, 30.0, 45.0, 300.0, lead_in_m=20.0, overshoot_m=10.0)
    path = planned(line, 30.0, motion)[1].path(0.0)
    (run,) = path.runs
    assert sorted(leg.piece.length_m for leg in run) == pytest.approx([30 * math.pi / 2, 70])
    ends = sorted([run[0].start[:2], run[-1].end[:2]])
    assert ends == [pytest.approx(end, abs=1e-9) for end in sorted([line[0], line[-1]])]
    for one, other in itertools.pairwise(path.pieces):  # the straight ways before and after it, too
        assert one.end[:2] == pytest.approx(other.start[:2])
        assert math.remainder(one.end[2] - other.start[2], 2 * math.pi) == pytest.approx(0)


def test_a_line_that_turns_back_goes_on_for_two_swaths_at_most():
    _, solution = planned([(0.0, 0.0), (500.0, 0.0), (0.0, 1.0)], 30.0)
    assert max(leg.piece.length_m for leg in solution.path(0.0).legs if leg.sensing) <= 501 + MAX_BEYOND * SWATH_M


def test_straight_ways_before_and_after_each_line():
    motion = MotionLimits(SWATH_M, RADIUS_M, 37.5, 20.0, lead_in_m=30.0, overshoot_m=10.0)
    _, solution = planned(RIVER, 80.0, motion)
    legs = solution.path(0.0).legs
    starts = [i for i, leg in enumerate(legs) if leg.sensing and not (i and legs[i - 1].sensing)]
    ends = [i for i, leg in enumerate(legs) if leg.sensing and not (i + 1 < len(legs) and legs[i + 1].sensing)]
    assert [legs[i - 1].piece.length_m for i in starts] == pytest.approx([30.0] * 2)
    assert [legs[i + 1].piece.length_m for i in ends] == pytest.approx([10.0] * 2)
    assert all(legs[i - 1].piece.turn == legs[j + 1].piece.turn == 0 for i, j in zip(starts, ends, strict=True))


def test_obstacles_beside_a_corridor_are_kept_and_those_on_it_are_a_no():
    beside = Obstacle(((1010.0, -30.0), (1040.0, -30.0), (1040.0, 30.0), (1010.0, 30.0)), "mast")
    wall = Obstacle(((500.0, -100.0), (510.0, -100.0), (510.0, 100.0), (500.0, 100.0)), "wall")
    _, solution = planned(STRAIGHT, 80.0, airspace=Airspace((beside,)))
    mast = shapely.Polygon(beside.outline)
    for piece in solution.path(0.0).pieces:
        points = [piece.pose_at(s)[:2] for s in np.linspace(0, piece.length_m, 50)]
        assert shapely.LineString(points).distance(mast) > 4.9
    with pytest.raises(Infeasible, match="lines of the corridor"):
        planned(STRAIGHT, 80.0, airspace=Airspace((wall,)))
    with pytest.raises(Infeasible, match="needs 500 lines"):
        planned(STRAIGHT, 20_000.0)
