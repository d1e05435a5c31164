"""Rings: area, what is superfluous, and what makes them no field, beside shapely's own word."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.geometry.polygons import BESIDE, covered_share, flaw, signed_area_m2, simplified, strip_extents

SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))

whole = st.tuples(st.integers(-6, 6), st.integers(-6, 6))
grid_rings = st.lists(whole, min_size=3, max_size=8, unique=True)


@st.composite
def stars(draw, spread_m=200.0):
    """A ring that does not cross itself, counter-clockwise: vertices in order of their angle, to a centimetre."""
    n = draw(st.integers(3, 12))
    shares = [draw(st.floats(0.1, 0.9)) for _ in range(n)]
    radii = [draw(st.floats(spread_m / 10, spread_m)) for _ in range(n)]
    angles = [2 * math.pi * (i + share / 2) / n for i, share in enumerate(shares)]
    return tuple((round(r * math.cos(a), 2), round(r * math.sin(a), 2)) for r, a in zip(radii, angles, strict=True))


def square(x, y, side):
    return ((x, y), (x + side, y), (x + side, y + side), (x, y + side))


@given(stars(), st.floats(0.1, 50.0))
def test_vertices_that_are_dropped_lie_within_the_tolerance(ring, tolerance_m):
    kept = [ring.index(vertex) for vertex in simplified(ring, tolerance_m)]
    assert kept[0] == 0
    assert kept == sorted(set(kept))
    for i, vertex in enumerate(ring):
        before, after = max(k for k in kept if k <= i), min((k for k in kept if k >= i), default=0)
        edge = shapely.LineString([ring[before], ring[after]])
        assert edge.distance(shapely.Point(vertex)) <= tolerance_m * (1 + 1e-9)


@given(stars())
def test_area_is_shapelys_with_the_sign_of_the_winding(ring):
    assert signed_area_m2(ring) == pytest.approx(shapely.Polygon(ring).area, rel=1e-12)
    assert signed_area_m2(ring[::-1]) == pytest.approx(-signed_area_m2(ring), rel=1e-12)


@pytest.mark.parametrize(
    ("outline", "holes"),
    [
        (SQUARE, []),
        (SQUARE[::-1], [square(2, 2, 3)]),
        (SQUARE, [square(2, 2, 2), square(4, 4, 2)]),  # touch at a point
        (SQUARE, [((0, 5), (2, 6), (2, 4))]),  # touches the outline at a point
    ],
)
def test_no_flaws(outline, holes):
    assert flaw(outline, holes) is None


@pytest.mark.parametrize(
    ("outline", "holes", "ring", "message", "point"),
    [
        (((0, 0), (10, 10), (10, 0), (0, 10)), [], 0, "crosses itself", (5, 5)),
        (((0, 0), (10, 0), (10, 10), (5, 0), (0, 10)), [], 0, "touches itself", (5, 0)),
        (SQUARE, [((2, 2), (6, 6), (6, 2), (2, 6))], 1, "crosses itself", (4, 4)),
        (SQUARE, [square(20, 20, 2)], 1, BESIDE, None),
        (SQUARE, [square(1, 1, 1), square(9, 4, 2)], 2, BESIDE, None),
        (SQUARE, [((0, 2), (3, 2), (3, 4), (0, 4))], 1, BESIDE, None),
        (SQUARE, [square(7, 7, 2), square(1, 1, 3), square(3, 3, 3)], 2, BESIDE, None),
        (SQUARE, [square(1, 1, 6), square(3, 3, 2)], 2, BESIDE, None),
        (SQUARE, [((0, 5), (5, 6), (10, 5), (5, 4))], 1, BESIDE, None),
        (SQUARE, [((0, 5), (3, 6), (5, 5), (3, 4)), ((5, 5), (7, 6), (10, 5), (7, 4))], None, BESIDE, None),
    ],
)
def test_a_flaw(outline, holes, ring, message, point):
    found = flaw(outline, holes)
    assert found.message == message
    assert found.ring == ring or ring is None  # of two holes together either may be named
    if point:
        assert found.point_m == point
    rings = [shapely.Polygon(points).exterior for points in (outline, *holes)]
    assert min(line.distance(shapely.Point(found.point_m)) for line in rings) < 1e-9


@given(grid_rings, st.lists(grid_rings, max_size=3))
def test_no_flaw_is_found_exactly_where_shapely_finds_a_polygon_valid(outline, holes):
    found = flaw(outline, holes)
    assert (found is None) == shapely.Polygon(outline, holes).is_valid
    assert found is None or (found.ring in range(len(holes) + 1) and all(map(math.isfinite, found.point_m)))


def test_extents_in_strips():
    # a U of 30 × 20 m: legs 10 m wide, the ground between them 5 m deep; a hole in the left leg
    outline = np.array([(0, 0), (30, 0), (30, 20), (20, 20), (20, 5), (10, 5), (10, 12), (0, 20)], dtype=float)
    hole = np.array([(4, 8), (6, 8), (6, 10), (4, 10)], dtype=float)
    strips = strip_extents([outline, hole], np.array([-5.0, 0.0, 4.0, 6.0, 10.0, 20.0, 25.0, 31.0]))
    expected = [
        [],
        [(0, 20)],
        [(0, 8), (10, 20 - 4 * 0.8)],  # the slope falls by 0.8
        [(0, 20 - 6 * 0.8)],
        [(0, 5)],
        [(0, 20)],
        [(0, 20)],
    ]
    assert [len(parts) for parts in strips] == [len(parts) for parts in expected]
    for parts, known in zip(strips, expected, strict=True):
        for part, ends in zip(parts, known, strict=True):
            assert part == pytest.approx(ends, abs=1e-5)


def test_parts_that_overlap_in_a_strip_are_one():
    teeth = np.array([(0, 0), (9, 0), (9, 8), (6, 8), (6, 1), (4, 1), (4, 5), (0, 5)], float)
    assert strip_extents([teeth], np.array([3.0, 7.0])) == [[pytest.approx((0, 8), abs=1e-5)]]
    apart = np.array([(0, 0), (1, 0), (1, 6), (3, 6), (3, 4), (2, 4), (2, 3), (4, 3), (4, 9), (0, 9)], float)
    assert strip_extents([apart], np.array([1.5, 2.5])) == [
        [pytest.approx((3, 4), abs=1e-5), pytest.approx((6, 9), abs=1e-5)]
    ]


def test_parts_whose_rounded_corners_cross_are_one_ground():
    # strips of a field, with corners at whole millimetres: a corner of the second lies beyond its own edge
    strips = [
        [(323.745, 243.624), (-285.123, -623.52), (-238.278, -629.541), (568.734, 519.796), (526.707, 532.68)],
        [(-394.242, -269.761), (-360.034, -293.78), (-561.786, -581.113), (274.546, 609.982), (232.52, 622.865)],
        [(91.278, 639.924), (-747.499, -554.653), (-747.749, -564.053), (-706.729, -569.326), (144.786, 643.392)],
    ]
    assert not shapely.Polygon(strips[1]).is_valid
    area_m2 = sum(shapely.Polygon(strip).area for strip in strips)
    lines = [((-261.7, -626.5), (547.7, 526.2))]
    share = covered_share([(strip,) for strip in strips], lines, 1.0)
    assert share == pytest.approx(shapely.LineString(lines[0]).length / area_m2, rel=0.02)


def test_the_share_that_lines_cover():
    field, hole = square(0, 0, 10), square(6, 6, 2)
    # strips 2 m wide: the whole length, then one that overlaps half of it, ends at 5 m
    assert covered_share([(field,)], [((0, 3), (10, 3))], 2.0) == pytest.approx(0.2)
    assert covered_share([(field,)], [((0, 3), (10, 3)), ((0, 4), (5, 4))], 2.0) == pytest.approx(0.25)
    assert covered_share([(field, hole)], [((0, 7), (10, 7))], 2.0) == pytest.approx(16 / 96)
    assert covered_share([(field,)], [((-5, 5), (15, 5))], 20.0) == 1.0
    assert covered_share([(field,)], [((5, 5), (5, 5))], 2.0) == 0.0
