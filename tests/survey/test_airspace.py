"""Coverage out of obstacles and inside a boundary, checked point by point along the path without shapely."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from common import few

from eadp.core.geometry.dubins import polyline_m, straight
from eadp.core.geometry.polygons import FreeSpace
from eadp.errors import Infeasible
from eadp.models.airspace import CLEARANCE_SHARE, Airspace, Field, Obstacle
from eadp.survey.airspace import FreeTurns, free_lines
from eadp.survey.coverage import CoverageRequest, cover
from eadp.survey.report import Covered
from eadp.survey.swaths import CoverageLeg, MotionLimits, half_circle

BOX = ((0.0, 0.0), (600.0, 0.0), (600.0, 400.0), (0.0, 400.0))
MAST = ((250.0, 150.0), (330.0, 150.0), (330.0, 260.0), (250.0, 260.0))
ROOM = ((-60.0, -60.0), (660.0, -60.0), (660.0, 460.0), (-60.0, 460.0))
MOTION = MotionLimits(40.0, 25.0, 37.5, 20.0)
CLEAR_M = CLEARANCE_SHARE * 25.0


def airspace(obstacles=(), boundary=()):
    return Airspace(tuple(Obstacle(ring, "obstacle") for ring in obstacles), tuple(boundary))


def within(ring, x, y, margin=0.0):
    """Whether a point lies in a convex counter-clockwise ring, farther than a margin from its edges."""
    edges = zip(ring, (*ring[1:], ring[0]), strict=True)
    return all(
        ((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) / math.dist((x0, y0), (x1, y1)) > margin
        for (x0, y0), (x1, y1) in edges
    )


def points(path, step=0.5):
    for piece in path.pieces:
        for k in range(math.ceil(piece.length_m / step) + 1):
            yield piece.pose_at(min(k * step, piece.length_m))[:2]


def gaps(path):
    pieces = path.pieces
    return [math.dist(a.end[:2], b.start[:2]) for a, b in itertools.pairwise(pieces)]


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("limits", "least"),
    [
        pytest.param({"obstacles": (MAST,)}, 0.93, marks=pytest.mark.slow),
        pytest.param({"boundary": (ROOM,)}, 0.9999, marks=pytest.mark.slow),
        ({"obstacles": (MAST,), "boundary": (ROOM,)}, 0.93),
        ({"boundary": (BOX,)}, 0.9),
        ({"obstacles": (((580.0, 380.0), (680.0, 380.0), (680.0, 480.0), (580.0, 480.0)),)}, 0.97),
    ],
)
def test_lines_and_turns_keep_the_limits(limits, least):
    field = Field(BOX, airspace=airspace(**limits))
    path = cover(CoverageRequest(field, replace(MOTION, wind_mps=(3.0, 4.0)), "dubins", 0.0)).path(0.0)
    for x, y in points(path):
        assert not any(within(ring, x, y, 0.05 - CLEAR_M) for ring in limits.get("obstacles", ())), (x, y)
        assert all(within(ring, x, y, CLEAR_M - 0.05) for ring in limits.get("boundary", ())), (x, y)
    assert path.min_radius_m == pytest.approx(25.0)
    assert max(gaps(path)) < 1e-6
    assert Covered(field, path, 40.0).share >= least


@pytest.mark.slow
def test_laps_keep_a_boundary_and_not_an_obstacle_within_them():
    field = Field(BOX, airspace=airspace(boundary=(ROOM,)))
    solution = cover(CoverageRequest(field, MOTION, "zamboni"))
    for c1 in np.linspace(solution.min_c1, 0.0, 5):
        assert all(within(ROOM, x, y, -0.05) for x, y in points(solution.path(float(c1)), 2.0))
    with pytest.raises(Infeasible, match="no laps of the Zamboni-like motion stay out"):
        cover(CoverageRequest(Field(BOX, airspace=airspace((MAST,))), MOTION, "zamboni"))
    assert cover(CoverageRequest(Field(BOX, airspace=airspace((MAST,))), MOTION, "auto")).pattern == "dubins"


@pytest.mark.slow
def test_the_way_from_start_and_home_is_free_too():
    wall = ((-100.0, 100.0), (-40.0, 100.0), (-40.0, 300.0), (-100.0, 300.0))
    field = Field(BOX, airspace=airspace((wall,)))
    request = CoverageRequest(field, MOTION, "dubins", start_m=(-200.0, 200.0), home_m=(-200.0, 210.0))
    path = cover(request).path(0.0)
    assert path.pieces[0].start[:2] == pytest.approx((-200.0, 200.0))
    assert path.pieces[-1].end[:2] == pytest.approx((-200.0, 210.0))
    assert not any(within(wall, x, y, 0.05) for x, y in points(path))


@pytest.mark.parametrize(
    ("limits", "motion"),
    [
        ({"obstacles": (((-10.0, -10.0), (610.0, -10.0), (610.0, 410.0), (-10.0, 410.0)),)}, MOTION),
        ({"boundary": (((0.0, 0.0), (600.0, 0.0), (600.0, 30.0), (0.0, 30.0)),)}, MOTION),
        # a wall from side to side of the boundary; few lines: without an order the search tries as often as it may
        (
            {"boundary": (ROOM,), "obstacles": (((290.0, -100.0), (300.0, -100.0), (300.0, 500.0), (290.0, 500.0)),)},
            replace(MOTION, swath_m=160.0, spacing_m=80.0),
        ),
    ],
)
def test_what_cannot_be_flown_is_said(limits, motion):
    with pytest.raises(Infeasible, match=r"no line of the field has room|no order of the lines|the way to or from"):
        cover(CoverageRequest(Field(BOX, airspace=airspace(**limits)), motion, "dubins"))


def test_a_line_ends_where_half_a_turn_is_free():
    # a radius before the wall, and a step of a quarter of it more: the half circle would touch
    space = FreeSpace([((200.0, -1e4), (300.0, -1e4), (300.0, 1e4), (200.0, 1e4))])
    line = CoverageLeg(straight((0.0, 0.0), (400.0, 0.0)), True)
    legs = free_lines([line], space, replace(MOTION, min_radius_m=20.0))[::2]
    assert [(leg.start[0], leg.end[0]) for leg in legs] == [
        (pytest.approx(0.0), pytest.approx(175.0, abs=0.1)),
        (pytest.approx(325.0, abs=0.1), pytest.approx(400.0)),
    ]
    assert space.has(polyline_m([half_circle(legs[0].end, 20.0, 1)]))


def test_a_turn_goes_around_a_corner():
    wall = ((-10.0, -200.0), (10.0, -200.0), (10.0, 200.0), (-10.0, 200.0))
    turns = FreeTurns(FreeSpace([wall]), MOTION)
    start, end = (-100.0, 0.0, 0.0), (100.0, 0.0, 0.0)
    assert turns.direct(start, end) is None
    time_s, pieces = turns.turn(start, end)
    assert time_s == pytest.approx(sum(piece.length_m for piece in pieces) / 15.0)
    # a taut string round a corner is 2 √(100² + 200²) long
    assert 430 < time_s * 15 < 620
    assert not any(within(wall, x, y, 0.01) for x, y in polyline_m(pieces))


@pytest.mark.slow
def test_parts_of_a_field_are_covered_by_one_path():
    other = ((900.0, 100.0), (1200.0, 100.0), (1200.0, 500.0), (900.0, 500.0))
    field = Field(BOX, others=((other,),))
    solution = cover(CoverageRequest(field, MOTION))
    path = solution.path(0.0)
    assert solution.pattern == "dubins"
    assert Covered(field, path, 40.0).share >= 0.9999
    assert max(gaps(path)) < 1e-6
    # no more than the two parts apart and the way between them
    apart = [cover(CoverageRequest(Field(ring), MOTION, "dubins")).path(0.0).length_m for ring in (BOX, other)]
    assert path.length_m < sum(apart) + 1000
    with pytest.raises(Infeasible, match="covers one part of a field"):
        cover(CoverageRequest(field, MOTION, "zamboni"))
    wall = ((700.0, -500.0), (750.0, -500.0), (750.0, 450.0), (700.0, 450.0))
    walled = replace(field, airspace=airspace((wall,)))
    for x, y in points(cover(CoverageRequest(walled, MOTION)).path(0.0)):
        assert not within(wall, x, y, 0.05)


def test_a_turn_may_start_and_end_with_the_half_circle_of_its_line():
    """In a lane hardly wider than a turn, beside a mast: no corner leads from one line to the next."""
    lane, mast = [((0.0, 0.0), (60.0, 0.0), (60.0, 150.0), (0.0, 150.0))], (30.0, 10.0, 40.0, 30.0)
    west, south, east, north = mast
    space = FreeSpace([((west, south), (east, south), (east, north), (west, north))], lane, CLEAR_M)
    start, end = (30.0, 75.0, math.pi), (30.0, 45.0, 0.0)
    turns = FreeTurns(space, MOTION)
    assert turns.direct(start, end) is None
    found = turns.turn(start, end)
    assert found is not None
    assert any(piece.length_m == pytest.approx(math.pi * 25.0) for piece in found.pieces)
    for x, y in polyline_m(found.pieces):
        assert within(lane[0], x, y, CLEAR_M - 0.05)
        assert not (west < x < east and south < y < north)
    assert found.pieces[-1].end == pytest.approx(end, abs=1e-6)


def by_relaxation(turns, start, end):
    """The least time of a free way over the corners, all turns between any two of them checked [s]."""
    back = (*end[:2], end[2] + math.pi)
    halves = [half_circle(pose, turns.motion.min_radius_m, side).end for pose in (start, back) for side in (1, -1)]
    stops = [start, *turns._corners, *halves[:2], *((x, y, h + math.pi) for x, y, h in halves[2:]), end]
    pairs = [(a, b) for a in stops for b in stops if a != b]
    turns.find_direct(pairs)
    times = {pair: turns.direct(*pair) for pair in pairs}
    least = dict.fromkeys(stops, math.inf) | {start: 0.0}
    for _ in stops:  # Bellman and Ford
        for (a, b), leg in times.items():
            if leg is not None:
                least[b] = min(least[b], least[a] + leg.time_s)
    return least[end]


@pytest.mark.slow
@pytest.mark.parametrize("wind", few([(0.0, 0.0), (4.0, -3.0)], 1))
def test_the_way_around_corners_is_the_quickest(wind):
    wall = (-10, -120), (10, -120), (10, 120), (-10, 120)
    walls = [wall, [(x + 150, y + 90) for x, y in wall]]
    turns = FreeTurns(FreeSpace(walls), replace(MOTION, wind_mps=wind))
    for start, end in (((-100.0, 0.0, 0.0), (300.0, 60.0, 0.0)), ((70.0, 0.0, 1.0), (-80.0, 20.0, 3.0))):
        assert turns.direct(start, end) is None
        assert turns.turn(start, end).time_s == pytest.approx(by_relaxation(turns, start, end), rel=1e-9)


def test_a_draft_keeps_the_limits_and_takes_little_longer():
    coarse = replace(MOTION, swath_m=80.0, spacing_m=40.0)
    request = CoverageRequest(Field(BOX, airspace=airspace((MAST,), (ROOM,))), coarse, "dubins")
    draft, full = cover(request, draft=True), cover(request)
    assert draft.heading_rad == full.heading_rad
    assert full.time_s <= draft.time_s <= 1.05 * full.time_s
    assert not any(within(MAST, x, y, 0.05 - CLEAR_M) for x, y in points(draft.path(0.0)))


def test_what_was_planned_before_changes_no_path():
    mast = ((135.0, 60.0), (180.0, 60.0), (180.0, 105.0), (135.0, 105.0))
    field = Field(((0.0, 0.0), (300.0, 30.0), (260.0, 180.0), (20.0, 165.0)), airspace=airspace((mast,)))
    first, again = (cover(CoverageRequest(field, MOTION, "dubins", 0.0)) for _ in range(2))
    assert first == again
