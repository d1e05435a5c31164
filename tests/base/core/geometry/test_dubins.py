"""Shortest paths with bounded turns: by quadrature of the motion, against other paths, and in wind by the triangle."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import ellipe

from eadp.core.geometry.dubins import TURNS, DubinsPath, flight_time_s, lengths_m, ordered, times_s, ways_to_point
from eadp.errors import Infeasible

CLOSE = 1e-9
REACHED_M = 1e-6
WORDS = ("LSL", "RSR", "LSR", "RSL", "LRL", "RLR")

thousandths = st.integers(-300_000, 300_000).map(lambda i: i / 1000)
headings = st.one_of(
    st.integers(-7000, 7000).map(lambda i: i / 1000), st.integers(-8, 8).map(lambda i: i * math.pi / 4)
)
poses = st.tuples(thousandths, thousandths, headings)
near_poses = st.tuples(thousandths.map(lambda x: x / 10), thousandths.map(lambda y: y / 10), headings)
radii = st.sampled_from([7.5, 20.0, 33.0, 75.0])
winds = st.tuples(st.floats(-0.65, 0.65), st.floats(-0.65, 0.65))  # of the airspeed
AIRSPEED = 18.0


NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def shortest(start, end, radius):
    return ordered(start, end, radius)[0]


def moved(pose, turn, radius, length):
    """Where a vehicle gets that turns at a constant rate: quadrature of ẋ = cos θ, ẏ = sin θ."""
    rate = turn / radius
    along = (NODES + 1) * length / 2
    heading = pose[2] + rate * along
    x = pose[0] + length / 2 * float(WEIGHTS @ np.cos(heading))
    y = pose[1] + length / 2 * float(WEIGHTS @ np.sin(heading))
    return x, y, pose[2] + rate * length


def flown(start, word, lengths, radius):
    pose = start
    for letter, length in zip(word, lengths, strict=True):
        pose = moved(pose, TURNS[letter], radius, length)
    return pose


def apart(one, other):
    """Distance and difference of direction of two poses, whole turns aside."""
    return math.dist(one[:2], other[:2]), abs(math.remainder(one[2] - other[2], 2 * math.pi))


def time_by_triangle(path, airspeed, wind):
    """Time along a path: at each place the nose is held into the wind until the drift is along the course."""

    def pace(course):
        across = wind[1] * math.cos(course) - wind[0] * math.sin(course)
        nose = course - math.asin(across / airspeed)
        vx, vy = airspeed * math.cos(nose) + wind[0], airspeed * math.sin(nose) + wind[1]
        assert abs(math.remainder(math.atan2(vy, vx) - course, 2 * math.pi)) < CLOSE
        return 1 / math.hypot(vx, vy)

    total, course = 0.0, path.start[2]
    for letter, length in zip(path.word, path.lengths_m, strict=True):
        rate, begin = TURNS[letter] / path.radius_m, course
        total += quad(lambda s, b=begin, r=rate: pace(b + r * s), 0, length, epsabs=1e-11, epsrel=1e-11, limit=200)[0]
        course += rate * length
    return total


@given(st.one_of(st.tuples(poses, poses), st.tuples(near_poses, near_poses)), radii)
def test_every_word_reaches_the_goal(pair, radius):
    start, end = pair
    paths = ordered(start, end, radius)
    assert [path.length_m for path in paths] == sorted(path.length_m for path in paths)
    assert {"LSL", "RSR"} <= {path.word for path in paths} <= set(WORDS)
    for path in paths:
        distance, turned = apart(flown(start, path.word, path.lengths_m, radius), end)
        assert distance < REACHED_M, path
        assert turned < CLOSE, path
        assert min(path.lengths_m) >= 0


@given(near_poses, near_poses, radii)
@example((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 20.0)
@example((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), 20.0)
@example((0.0, 0.0, 0.0), (0.0, 40.0, math.pi), 20.0)
@example((0.0, 0.0, 0.0), (40.0, 40.0, 0.0), 20.0)
def test_pieces_follow_one_another(start, end, radius):
    for path in ordered(start, end, radius):
        pieces = path.pieces
        assert sum(piece.length_m for piece in pieces) == pytest.approx(path.length_m, abs=3e-9)
        for piece in pieces:
            # each piece on its own arrives where it says, to the rounding of the joints
            distance, turned = apart(moved(piece.start, piece.turn, radius, piece.length_m), piece.end)
            assert distance < REACHED_M
            assert turned < 1e-8
            assert apart(piece.pose_at(piece.length_m), piece.end)[0] < REACHED_M
            assert (piece.centre_m is None) == (piece.turn == 0) == math.isinf(piece.radius_m)
            if piece.centre_m is not None:
                for s in (0.0, piece.length_m / 3, piece.length_m):
                    x, y, heading = moved(piece.start, piece.turn, radius, s)
                    assert math.dist((x, y), piece.centre_m) == pytest.approx(radius, rel=CLOSE)
                    ahead = (piece.centre_m[0] - x) * -math.sin(heading) + (piece.centre_m[1] - y) * math.cos(heading)
                    assert ahead == pytest.approx(piece.turn * radius, rel=CLOSE), "a left turn has its centre left"
        for before, after in itertools.pairwise(pieces):
            distance, turned = apart(before.end, after.start)
            assert max(distance, turned) < CLOSE
        if pieces:
            assert pieces[-1].end == end
        else:
            assert apart(start, end) == pytest.approx((0, 0), abs=1e-8)


@given(near_poses, radii, st.sampled_from(WORDS), st.tuples(st.floats(0, 6.28), st.floats(0, 6.28), st.floats(0, 6.28)))
@example((0.0, 0.0, 0.0), 20.0, "LRL", (0.1, 4.5, 0.2))  # the shortest itself
@example((0.0, 0.0, 0.0), 20.0, "RSL", (0.4, 2.5, 0.2))
@example((0.0, 0.0, 0.0), 7.5, "LSL", (0.0, 0.0, 6.25))
@example((0.0, 0.0, 0.0), 7.5, "LSL", (0.0, 2e-10, 6.25))  # the straight's course is all rounding
@example((0.0, 0.0, 0.0), 7.5, "RSR", (3.0, 3e-8, 3.25))
def test_none_is_longer_than_another_way_there(start, radius, word, turns):
    lengths = [turn * radius for turn in turns]
    end = flown(start, word, lengths, radius)
    path = shortest(start, end, radius)
    assert path.length_m <= sum(lengths) + 1e-7
    assert apart(flown(start, path.word, path.lengths_m, radius), end)[0] < REACHED_M


R = 20.0


@pytest.mark.parametrize(
    ("end", "word", "length"),
    [
        ((0, 0, 0), None, 0),
        ((120, 0, 0), None, 120),
        ((-100, 0, 0), None, 100 + 2 * math.pi * R),
        ((0, 2 * R, math.pi), None, math.pi * R),  # touching circles
        ((0, 3 * R, math.pi), "LSL", math.pi * R + R),
        ((2 * R, 2 * R, 0), None, math.pi * R),  # a left and a right quarter, circles touching
        ((0, 0, math.pi), None, 7 / 3 * math.pi * R),
        # an omega: the outer turns' centres are w + 2R apart
        ((0, R, math.pi), "RLR", R * (math.pi + 4 * math.acos(3 / 4))),
        ((-1e-12, 1e-12, -1e-13), None, 0),  # one pose, but for rounding
    ],
)
@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (812.3, -77.7, 0.3), (-3e4, 5e4, 2.9)])
def test_known_lengths(start, end, word, length):
    c, s = math.cos(start[2]), math.sin(start[2])
    there = (start[0] + c * end[0] - s * end[1], start[1] + s * end[0] + c * end[1], start[2] + end[2])
    path = shortest(start, there, R)
    assert path.length_m == pytest.approx(length, abs=1e-7)
    if word:
        assert path.word == word
    if length == 0:
        assert path.pieces == ()


@given(st.lists(near_poses, min_size=1, max_size=4), st.lists(near_poses, min_size=1, max_size=3), radii)
def test_many_at_once(starts, ends, radius):
    found = lengths_m(starts, ends, radius)
    wanted = [[shortest(start, end, radius).length_m for end in ends] for start in starts]
    assert found.shape == (len(starts), len(ends))
    assert found == pytest.approx(np.array(wanted), abs=CLOSE)


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_a_radius_that_is_none(radius):
    with pytest.raises(ValueError, match="radius"):
        shortest((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), radius)


@given(near_poses, near_poses, radii, winds)
def test_time_by_the_wind_triangle(start, end, radius, wind):
    wind = (AIRSPEED * wind[0], AIRSPEED * wind[1])
    for path in ordered(start, end, radius):
        wanted = time_by_triangle(path, AIRSPEED, wind)
        assert flight_time_s(path.pieces, AIRSPEED, wind) == pytest.approx(wanted, rel=CLOSE, abs=1e-8)


@pytest.mark.parametrize(("share", "tolerance"), [(0.9, 1e-12), (0.98, 1e-12), (0.9999, 1e-6)])
def test_a_turn_in_strong_wind(share, tolerance):
    # ∫ √(1 − m sin²φ) dφ over a whole turn is 4 E(m), and the other part cancels
    arc = DubinsPath("LSL", (2 * math.pi * R, 0.0, 0.0), (0.0, 0.0, 0.4), (0.0, 0.0, 0.4), R)
    wind = share * AIRSPEED
    wanted = R * AIRSPEED * 4 * ellipe(share**2) / (AIRSPEED**2 - wind**2)
    assert flight_time_s(arc.pieces, AIRSPEED, (0.6 * wind, -0.8 * wind)) == pytest.approx(wanted, rel=tolerance)
    half = DubinsPath("LSL", (math.pi * R / 2, 0.0, 0.0), (0.0, 0.0, 0.4), (0.0, 0.0, 0.4), R)
    assert flight_time_s(half.pieces, AIRSPEED, (0.6 * wind, -0.8 * wind)) == pytest.approx(
        time_by_triangle(half, AIRSPEED, (0.6 * wind, -0.8 * wind)), rel=max(tolerance, 1e-10)
    )


@given(st.lists(near_poses, min_size=1, max_size=3), st.lists(near_poses, min_size=1, max_size=3), radii, winds)
def test_many_times_at_once_are_of_the_fastest(starts, ends, radius, wind):
    wind = (AIRSPEED * wind[0], AIRSPEED * wind[1])
    found = times_s(starts, ends, radius, AIRSPEED, wind)
    wanted = [
        [min(flight_time_s(path.pieces, AIRSPEED, wind) for path in ordered(start, end, radius)) for end in ends]
        for start in starts
    ]
    assert found == pytest.approx(np.array(wanted), abs=1e-8)


def test_a_breath_of_wind_is_no_jump():
    start, end = (0.0, 0.0, 0.3), (60.0, -20.0, 2.0)
    calm = shortest(start, end, R).length_m / AIRSPEED
    for breath in (5e-324, 1e-200, 1e-12, 1e-9):
        assert times_s([start], [end], R, AIRSPEED, (breath, -breath))[0, 0] == pytest.approx(calm, rel=1e-8)


@pytest.mark.parametrize("wind", [(AIRSPEED, 0.0), (0.0, -25.0), (math.nan, 0.0)])
def test_a_wind_too_strong(wind):
    path = shortest((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), R)
    with pytest.raises(Infeasible, match="hold every course"):
        flight_time_s(path.pieces, AIRSPEED, wind)
    with pytest.raises(Infeasible, match="hold every course"):
        times_s([path.start], [path.end], R, AIRSPEED, wind)


@given(poses, st.tuples(thousandths, thousandths), radii)
@example((0.0, 0.0, 0.0), (100.0, 0.0), 20.0)
@example((0.0, 0.0, 0.0), (-100.0, 0.0), 20.0)
def test_the_way_to_a_point_is_the_shortest_over_all_headings_there(start, point, radius):
    assume(math.dist(start[:2], point) > 4 * radius)  # nearer, three turns may be shorter
    pieces = ways_to_point(start, point, radius)[0]
    length = sum(piece.length_m for piece in pieces)
    assert math.dist(pieces[-1].end[:2], point) < REACHED_M
    assert math.dist(pieces[0].start[:2], start[:2]) < REACHED_M
    ends = [(*point, heading) for heading in np.linspace(-math.pi, math.pi, 721)]
    best = float(lengths_m([start], ends, radius).min())
    assert length <= best + REACHED_M
    assert length == pytest.approx(best, abs=radius * math.radians(0.5))
