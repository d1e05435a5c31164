"""Paths through waypoints and circles: continuous, near their targets, turning as told by geometry done another way."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from eadp.core.geometry.dubins import ordered
from eadp.errors import Unreachable
from eadp.exchange.waypoints import EASED_M, MIN_PIECE_M, ON_CIRCLE_M, Loiter, Waypoint, path_through

RADIUS_M = 20.0
JOINED_M, ALIGNED_RAD = 3 * MIN_PIECE_M, 5e-3
TURNS_SHORT = 0.06

metres = st.integers(-5000, 5000).map(lambda i: i / 10)
points = st.tuples(metres, metres)
waypoints = st.builds(Waypoint, points, st.sampled_from([0.0, 10.0, 50.0]), st.sampled_from([0.0, 0.0, 30.0]))
loiters = st.builds(Loiter, points, st.sampled_from([-60.0, 40.0, 90.0]), st.sampled_from([0.5, 1.0, 2.5]))
routes = st.lists(st.one_of(waypoints, waypoints, loiters), min_size=1, max_size=9)


def through(targets, start=(0.0, 0.0)):
    return path_through(start, targets, RADIUS_M)


def length_m(path):
    return sum(piece.length_m for _, piece in path.pieces)


def nearest_m(path, point):
    count = 400
    poses = [piece.pose_at(piece.length_m * k / count) for _, piece in path.pieces for k in range(count + 1)]
    return min(math.dist(pose[:2], point) for pose in [*poses, (0.0, 0.0, 0.0)])  # from where it starts


@given(targets=routes)
@example(targets=[Waypoint((0.0, 0.0), 0.0), Loiter((0.0, 59.5), -60.0, 0.5)])  # half a metre within the circle
def test_a_path_is_continuous_in_position_and_heading(targets):
    try:
        path = through(targets)
    except Unreachable:
        return
    assert [i for i, _ in path.pieces] == sorted(i for i, _ in path.pieces)
    for (_, before), (_, after) in zip(path.pieces, path.pieces[1:], strict=False):
        assert math.dist(before.end[:2], after.start[:2]) < ON_CIRCLE_M
        if math.dist(before.end[:2], after.start[:2]) < JOINED_M:
            assert abs(math.remainder(before.end[2] - after.start[2], 2 * math.pi)) < ALIGNED_RAD
    for _, piece in path.pieces:
        # the pose moves as its curvature says, which poses at the ends alone do not show
        x, y, heading = piece.pose_at(piece.length_m)
        assert math.dist((x, y), piece.end[:2]) < 1e-6
        assert abs(math.remainder(heading - piece.end[2], 2 * math.pi)) < 1e-6
    if not path.tight:
        assert all(piece.radius_m > RADIUS_M - 1e-6 for _, piece in path.pieces if piece.turn)


@given(targets=st.lists(waypoints, min_size=1, max_size=6))
@example(targets=[Waypoint((0.6, 0.0), 50.0), Waypoint((0.5, 0.1), 0.0, 30.0), Waypoint((0.0, 0.0), 0.0)])
def test_every_waypoint_is_passed_as_near_as_it_asks(targets):
    path = through(targets)
    for target in targets:
        longest = max((piece.length_m for _, piece in path.pieces), default=0.0)
        assert nearest_m(path, target.centre_m) <= target.miss_m + longest / 400 + MIN_PIECE_M


@pytest.mark.parametrize("corner_deg", [1, 30, 60, 90, 119, -45, -100])
def test_a_fillet_cuts_the_corner_as_the_triangle_says(corner_deg):
    corner = math.radians(corner_deg)
    second = (500 + 500 * math.cos(corner), 500 * math.sin(corner))
    path = through([Waypoint((500.0, 0.0), math.inf), Waypoint(second, 0.0)])
    assert [piece.turn for _, piece in path.pieces] == [0, int(math.copysign(1, corner)), 0]
    # the two tangents and half the corner are a right triangle with the radius
    cut = RADIUS_M * math.tan(abs(corner) / 2)
    assert length_m(path) == pytest.approx(1000 - 2 * cut + RADIUS_M * abs(corner), abs=1e-6)
    assert nearest_m(path, (500, 0)) == pytest.approx(RADIUS_M * (1 / math.cos(corner / 2) - 1), abs=0.02)


@pytest.mark.slow
def test_a_corner_that_is_too_sharp_is_flown_over_as_the_shortest_path_with_a_free_heading():
    start, corner, end = (0.0, 0.0), (300.0, 0.0), (100.0, 120.0)
    path = through([Waypoint(corner, 0.0), Waypoint(end, 0.0)])
    best = min(ordered((*corner, 0.0), (*end, math.radians(k / 4)), RADIUS_M)[0].length_m for k in range(1440))
    assert length_m(path) == pytest.approx(300 + best, abs=0.01)
    past = through([Waypoint(corner, 50.0, 40.0), Waypoint((300.0, 300.0), 0.0)])
    assert max(piece.end[0] for _, piece in past.pieces) == pytest.approx(340 + RADIUS_M, abs=RADIUS_M)
    assert past.pieces[0][1].end[:2] == pytest.approx((340, 0))
    assert start == path.pieces[0][1].start[:2]


def test_a_circle_that_cannot_be_reached_is_named_past_a_waypoint_that_stands_twice():
    twice = Waypoint((300.0, 0.0), 0.5, 100.0)
    with pytest.raises(Unreachable, match="its circle encloses") as caught:
        path_through((0.0, 0.0), [twice, twice, Loiter((400.0, 10.0), 80.0, 1.0)], 30.0)
    assert caught.value.target == 2


def test_no_room_for_a_turn_reduces_its_radius_and_is_listed():
    # two right angles 25 m apart need 2 · 20 m
    path = through([Waypoint((300.0, 0.0), 50), Waypoint((300.0, 25.0), 50), Waypoint((0.0, 25.0), 50)])
    (tight,) = path.tight
    assert tight.target == 1
    assert tight.distance_m == pytest.approx(25)
    assert tight.needed_m == pytest.approx(40)
    assert [piece.radius_m for _, piece in path.pieces if piece.turn] == pytest.approx([12.5, 12.5])
    assert length_m(path) == pytest.approx(2 * (300 - 12.5) + math.pi * 12.5)


@pytest.mark.parametrize("turns", [0.0, 0.5, 1.0, 2.0, 3.5])
@pytest.mark.parametrize("radius_m", [60.0, -80.0])
def test_a_loiter_turns_so_often_and_on_to_where_the_way_lies_ahead(turns, radius_m):
    loiter, after = Loiter((400.0, 30.0), radius_m, turns), Waypoint((500.0, 400.0), 0.0)
    path = through([loiter, after])
    arcs = [piece for _, piece in path.pieces if piece.turn]
    assert {piece.centre_m for piece in arcs} == {(400.0, 30.0)}
    assert {piece.turn for piece in arcs} == {int(math.copysign(1, radius_m))}
    angle = abs(sum(piece.turn * piece.length_m / piece.radius_m for piece in arcs))
    assert 2 * math.pi * (turns - TURNS_SHORT) <= angle <= 2 * math.pi * (turns + 1)
    # it leaves for the waypoint: the last straight passes it, and goes on where the circle had it
    assert path.pieces[-1][1].end[:2] == pytest.approx((500, 400))
    assert math.dist(path.pieces[-1][1].start[:2], loiter.centre_m) == pytest.approx(abs(radius_m))


def test_the_way_between_circles_is_their_common_tangent():
    for first in (50.0, -50.0):
        for second in (90.0, -90.0):
            path = through([Loiter((200.0, 0.0), first, 1), Loiter((900.0, 100.0), second, 1)])
            straight = next(piece for i, piece in path.pieces if i == 1 and piece.turn == 0)
            apart = math.hypot(700, 100)
            # outer tangent √(d² − (r₁ − r₂)²), inner tangent √(d² − (r₁ + r₂)²)
            assert straight.length_m == pytest.approx(math.sqrt(apart**2 - (first - second) ** 2))


def test_circles_that_overlap_otherwise_cannot_be_joined():
    with pytest.raises(Unreachable) as caught:
        through([Loiter((200.0, 0.0), 50.0, 1), Loiter((220.0, 0.0), -50.0, 1)])
    assert caught.value.target == 1


def test_a_waypoint_on_the_circle_after_it_is_passed_on_it():
    with_it = through([Waypoint((100.0, 0.0), 50), Loiter((100.0, 60.0), 60.0, 1), Waypoint((0.0, 120.0), 0)])
    without = through([Loiter((100.0, 60.0), 60.0, 1), Waypoint((0.0, 120.0), 0)])
    circle = Loiter((100.0, 60.0), 60.0, 0.7)
    twice = through([circle, Waypoint((90.0, 60.0), 0), Loiter((100.3, 60.0), 60.0, 0.3), Waypoint((0.0, 120.0), 0)])
    assert length_m(with_it) == pytest.approx(length_m(without)) == length_m(twice)


@pytest.mark.parametrize(("radius_m", "corners"), [(60.0, 9), (60.0, 5), (150.0, 14)])
def test_waypoints_along_an_arc_are_flown_as_that_arc(radius_m, corners):
    # a half circle to the left between two tangents, as a polygon about it
    step = math.pi / corners
    out = radius_m / math.cos(step / 2)
    angles = [-math.pi / 2 + (k + 0.5) * step for k in range(corners)]
    arc = [Waypoint((400 + out * math.cos(a), radius_m + out * math.sin(a)), math.inf) for a in angles]
    path = through([*arc, Waypoint((0.0, 2 * radius_m), 0.0)])
    passed_m = out - radius_m
    if passed_m > EASED_M:  # farther from the corners than a wider turn may be
        wider_m = EASED_M / (1 / math.cos(step / 2) - 1)
        assert max(piece.radius_m for _, piece in path.pieces if piece.turn) == pytest.approx(max(wider_m, RADIUS_M))
        return
    assert length_m(path) == pytest.approx(800 + math.pi * radius_m)
    assert {round(piece.radius_m, 6) for _, piece in path.pieces if piece.turn} == {radius_m}
