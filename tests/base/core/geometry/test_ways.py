"""Ways to a point round what is in the way, beside a dense grid."""

import itertools
import math
from functools import cache

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from eadp.core.geometry.dubins import polyline_m
from eadp.core.geometry.polygons import FreeSpace, WaysTo

RADIUS_M, CLEAR_M = 20.0, 4.0
HOUSE = ((80.0, -60.0), (120.0, -60.0), (120.0, 60.0), (80.0, 60.0))
BARN = ((160.0, 20.0), (220.0, 20.0), (220.0, 150.0), (160.0, 150.0))
WALL = ((-50.0, 200.0), (400.0, 200.0), (400.0, 205.0), (-50.0, 205.0))
HOME_M = (300.0, 30.0)


@cache
def ways(*avoid, inside=(), home_m=HOME_M):
    return WaysTo(home_m, FreeSpace(avoid, inside, CLEAR_M), FreeSpace(avoid, inside), RADIUS_M)


def grid_length_m(start, end, space, step=5.0):
    """Shortest way on a grid with 32 directions: longer than the shortest in the plane by up to 1.3 %."""
    x, y = np.meshgrid(np.arange(-60, 420, step), np.arange(-160, 260, step), indexing="ij")
    points = np.stack((x.ravel(), y.ravel()), axis=1)
    number = np.arange(len(points)).reshape(x.shape)
    rows, columns = [], []
    for i, j in {(i, j) for i in range(-3, 4) for j in range(-3, 4) if math.gcd(i, j) == 1}:
        a = number[max(-i, 0) : len(number) - max(i, 0), max(-j, 0) : number.shape[1] - max(j, 0)]
        b = number[max(i, 0) : len(number) + min(i, 0), max(j, 0) : number.shape[1] + min(j, 0)]
        rows.append(a.ravel())
        columns.append(b.ravel())
    i, j = np.concatenate(rows), np.concatenate(columns)
    free = space.sees(points[i], points[j])
    lengths = np.linalg.norm(points[i] - points[j], axis=1)[free]
    graph = coo_matrix((lengths, (i[free], j[free])), shape=(len(points),) * 2).tocsr()
    nearest = [int(np.linalg.norm(points - each, axis=1).argmin()) for each in (start, end)]
    return float(dijkstra(graph, indices=nearest[0])[nearest[1]])


@pytest.mark.quick(1)
@pytest.mark.parametrize("start", [(0.0, 0.0), (140.0, 0.0), (190.0, 180.0)])
@pytest.mark.parametrize("avoid", [(HOUSE,), (HOUSE, BARN), (HOUSE, BARN, WALL)], ids=["house", "barn", "wall"])
def test_the_way_is_about_the_shortest_that_keeps_clear(start, avoid):
    line = next(ways(*avoid).lines(start))
    assert line[-1] == HOME_M
    assert FreeSpace(avoid).has([start, *line])
    shortest_m = grid_length_m(start, HOME_M, FreeSpace(avoid, (), CLEAR_M))
    # its corners lie about a radius out
    length_m = sum(math.dist(a, b) for a, b in itertools.pairwise([start, *line]))
    assert 0.98 * shortest_m <= length_m <= shortest_m + 2 * RADIUS_M


def test_without_anything_in_the_way_it_is_a_straight_line():
    assert next(ways(HOUSE).lines((200.0, -200.0))) == (HOME_M,)


@pytest.mark.parametrize("heading_deg", range(-180, 180, 40))
@pytest.mark.parametrize("start", [(0.0, 0.0), (60.0, 0.0), (140.0, 0.0), (190.0, 180.0)])
def test_turns_onto_the_way_are_free_too(start, heading_deg):
    found = ways(HOUSE, BARN)
    pieces = found.pieces((*start, math.radians(heading_deg)))
    assert math.dist(pieces[-1].end[:2], HOME_M) < 1e-6
    assert {round(piece.radius_m, 6) for piece in pieces if piece.turn} == {RADIUS_M}
    for before, after in itertools.pairwise(pieces):
        assert math.dist(before.end[:2], after.start[:2]) < 1e-6
        assert abs(math.remainder(before.end[2] - after.start[2], 2 * math.pi)) < 1e-6
    assert FreeSpace((HOUSE, BARN)).has(polyline_m(pieces))


def test_home_behind_a_wall_that_cannot_be_passed_is_flown_to_straight():
    ring = ((250.0, -20.0), (350.0, -20.0), (350.0, 80.0), (250.0, 80.0))
    found = ways(HOUSE, inside=(ring,))
    assert next(found.lines((0.0, 0.0)), None) is None
    assert found.pieces((0.0, 0.0, 0.0))[-1].end[:2] == pytest.approx(HOME_M)


def test_near_an_obstacle_the_way_begins_within_its_clearance():
    line = next(ways(HOUSE).lines((79.0, 0.0)))
    assert FreeSpace((HOUSE,)).has([(79.0, 0.0), *line])
    assert len(line) > 1
