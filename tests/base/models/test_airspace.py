"""Where a flight was that it should not have been: against sampling, without shapely; a field of a coverage problem."""

import itertools
import math

import numpy as np
import pytest
from common import few

from eadp.models.airspace import BOUNDARY, Airspace, Field, Obstacle

SQUARE = ((10.0, 10.0), (20.0, 10.0), (20.0, 20.0), (10.0, 20.0))
ROOM = ((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0))
SAMPLED_M = 0.05


def within(ring, x, y):
    """Whether a point lies in a ring, by the crossings of a ray."""
    inside = False
    for (x0, y0), (x1, y1) in zip(ring, (*ring[1:], ring[0]), strict=True):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            inside = not inside
    return inside


def sampled(track, inside):
    """Length of a track where something holds, and the number of the first such segment, by points along it."""
    length, first = 0.0, None
    for i, (a, b) in enumerate(itertools.pairwise(track)):
        count = max(1, math.ceil(math.dist(a, b) / SAMPLED_M))
        shares = (np.arange(count) + 0.5) / count
        hits = sum(inside(a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1])) for s in shares)
        length += math.dist(a, b) * hits / count
        first = i if hits and first is None else first
    return length, first


@pytest.mark.parametrize("seed", few(range(8), 4))
def test_entries_are_those_of_points_along_the_track(seed):
    rng = np.random.default_rng(seed)
    track = [tuple(point) for point in np.cumsum(rng.normal(0, 12, (30, 2)), axis=0).tolist()]
    times = [2.0 * i for i in range(len(track))]
    found = {each.name: each for each in Airspace((Obstacle(SQUARE, "barn"),), (ROOM,)).entries(times, track, [0] * 30)}
    for name, inside in (("barn", lambda x, y: within(SQUARE, x, y)), (BOUNDARY, lambda x, y: not within(ROOM, x, y))):
        length, first = sampled(track, inside)
        entry = found.get(name)
        assert (entry.inside_m if entry else 0.0) == pytest.approx(length, abs=0.1 + 0.01 * length)
        if entry is not None and first is not None and length > 1:
            assert entry.entered_s <= times[first]


def test_an_obstacle_is_in_the_way_up_to_its_height():
    airspace = Airspace((Obstacle(SQUARE, "barn", 12.0), Obstacle(ROOM, "mast")))
    track, times = [(0.0, 15.0), (30.0, 15.0)], [0.0, 2.0]
    assert [each.name for each in airspace.entries(times, track, [12.0, 12.0])] == ["mast"]
    low = {each.name: each.inside_m for each in airspace.entries(times, track, [11.0, 12.0])}
    assert low == {"barn": pytest.approx(10.0, abs=0.01), "mast": pytest.approx(30.0)}


def test_a_track_along_an_edge_is_free():
    airspace = Airspace((Obstacle(SQUARE, "barn"),), (ROOM,))
    assert airspace.entries([0.0, 1.0], [(10.0, -50.0), (10.0, 50.0)], [0.0, 0.0]) == []
    assert airspace.entries([0.0, 1.0], [(-50.0, -50.0), (-50.0, 50.0)], [0.0, 0.0]) == []


def test_the_top_on_the_ways_home_is_of_obstacles_that_are_crossed():
    """Of a mast beside the straight ways too; one that is not on the way, or has no height, has no top."""
    square = ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0))
    at = lambda x, y: tuple((x + dx, y + dy) for dx, dy in square)  # noqa: E731
    mast, tower = Obstacle(at(0, 0), "mast", 80.0), Obstacle(at(0, 300), "tower", 200.0)
    space = Airspace((mast, tower, Obstacle(at(50, 0), "hill")))
    points = np.array([(200.0, 0.0), (200.0, 10.0)])
    assert space.top_on_ways_m(points, (-200.0, 0.0), 1.0) == 80
    assert space.top_on_ways_m(np.array([(-100.0, 0.0)]), (-200.0, 0.0), 1.0) == -math.inf
    beside = np.array([(200.0, 12.0)])
    assert space.top_on_ways_m(beside, (-200.0, 12.0), 1.0) == -math.inf
    assert space.top_on_ways_m(beside, (-200.0, 12.0), 8.0) == 80


def test_holes_are_no_part_of_the_area():
    # a rectangle of 30 × 20 m, less a square of 10 m and a right triangle with legs of 4 and 5 m
    outline = ((0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0))
    square = ((2.0, 2.0), (2.0, 12.0), (12.0, 12.0), (12.0, 2.0))
    triangle = ((20.0, 5.0), (20.0, 10.0), (24.0, 5.0))
    assert Field(outline).area_m2 == 600.0
    assert Field(outline, (square, triangle)).area_m2 == 600.0 - 100.0 - 10.0
