"""Dubins paths: shortest paths with a minimum turning radius, and their flight time in wind.

A path is a word of three letters: L turns left, R turns right, S goes straight. Inside, lengths are in radii, so that
an arc's length is its angle, and only LSL, LSR and LRL are worked out: the others are these in a mirror.

Source: Dubins, Am. J. Math. 79 (1957), that the shortest is one of six words; Shkel and Lumelsky, Robotics and
Autonomous Systems 34 (2001), for working them out one by one. The formulae are derived here from the turns' centres.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point, wrap_angle_rad
from eadp.errors import Infeasible

Pose = tuple[float, float, float]
"""x, y [m] and heading [rad], 0 east, counter-clockwise."""

MIN_PIECE_M = 1e-9
"""Length below which a piece is dropped."""

TOUCHING = 1e-10
"""Distance [radii] within which circles count as touching: rounding."""

WHOLE_TURN_RAD = 1e-9
"""An arc within this of a whole turn is 0: rounding turns 0 into −0, and −0 into 2π."""

HARMONICS_LIMIT = 512
"""Largest number of harmonics of the time along an arc in wind."""

TURNS = {"L": 1, "S": 0, "R": -1}


@dataclass(frozen=True, slots=True)
class Piece:
    """An arc or a straight of a path.

    `turn` is +1 left, 0 straight, −1 right; `centre_m` [m] is of the arc's circle.
    """

    turn: int
    start: Pose
    end: Pose
    length_m: float
    centre_m: Point | None

    @property
    def radius_m(self) -> float:
        """The arc's radius [m]; infinite for a straight."""
        return math.inf if self.centre_m is None else math.dist(self.centre_m, self.start[:2])

    def pose_at(self, distance_m: float) -> Pose:
        """The pose at a distance [m] from the piece's start, its heading in (−π, π]."""
        return _advanced(self.start, self.turn, self.radius_m, distance_m)


def straight(start: Point, end: Point) -> Piece:
    """The straight piece between two points [m]."""
    heading = math.atan2(end[1] - start[1], end[0] - start[0])
    return Piece(0, (*start, heading), (*end, heading), math.dist(start, end), None)


@dataclass(frozen=True, slots=True)
class DubinsPath:
    """A path of three pieces from one pose to another: its word, and the length of each piece [m], some 0."""

    word: str
    lengths_m: tuple[float, float, float]
    start: Pose
    end: Pose
    radius_m: float

    @property
    def length_m(self) -> float:
        """The whole length [m]."""
        return sum(self.lengths_m)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The arcs and straights that are not shorter than `MIN_PIECE_M`, each from the end of the one before.

        The first leaves the start, the last arrives at the end, and the middle one joins the two, so that both ends
        are exact.
        """
        turns = [TURNS[letter] for letter in self.word]
        kept = [length >= MIN_PIECE_M for length in self.lengths_m]
        leave, arrive = self.start, self.end
        if kept[0]:
            leave = _advanced(self.start, turns[0], self.radius_m, self.lengths_m[0])
        if kept[2]:
            arrive = _advanced(self.end, turns[2], self.radius_m, -self.lengths_m[2])
        if not kept[1]:  # the arcs meet where the first ends; without the last one that is the end
            leave = arrive = leave if kept[2] else self.end
        poses = (self.start, leave, arrive, self.end)
        return tuple(
            Piece(turn, begin, end, length, centre_m(begin, turn, self.radius_m) if turn else None)
            for turn, begin, end, length, keep in zip(turns, poses, poses[1:], self.lengths_m, kept, strict=False)
            if keep
        )


def ordered(start: Pose, end: Pose, radius_m: float) -> list[DubinsPath]:
    """Every path of a word from one pose to another, the shortest first.

    Parameters
    ----------
    start, end : (float, float, float)
        x, y [m] and heading [rad].
    radius_m : float
        The minimum turning radius [m], above 0.

    Returns
    -------
    list of DubinsPath
        Two to eight: LSL and RSR always exist; RLR and LRL come with a middle arc below π and with one above.

    Raises
    ------
    ValueError
        If the radius is not above 0 and finite, or a pose is not finite.

    Notes
    -----
    The shortest is not the fastest in wind: see `flight_time_s`.

    Source: Shkel and Lumelsky 2001.
    """
    return ordered_each([start], [end], radius_m)[0]


def ordered_each(starts: Sequence[Pose], ends: Sequence[Pose], radius_m: float) -> list[list[DubinsPath]]:
    """The paths of `ordered` from each of some poses to its own of as many others."""
    paths: list[list[DubinsPath]] = [[] for _ in starts]
    for word, *arcs in _words(np.array(starts, dtype=float), np.array(ends, dtype=float), radius_m):
        lengths_m = (np.stack(arcs, axis=-1) * radius_m).tolist()
        for found, start, end, (first, middle, last) in zip(paths, starts, ends, lengths_m, strict=True):
            if math.isfinite(middle):
                found.append(DubinsPath(word, (first, middle, last), start, end, radius_m))
    return [sorted(found, key=lambda path: path.length_m) for found in paths]


ARC_STEP_RAD = math.radians(5)
"""Largest angle between the points of an arc."""


def polyline_m(pieces: Sequence[Piece]) -> FloatArray:
    """Points along pieces, close enough on arcs; shape (n, 2) [m]."""
    points = [np.array([pieces[0].start[:2]])]
    for piece in pieces:
        if piece.turn:
            (x, y, heading), left_m = piece.start, piece.turn * piece.radius_m
            steps = max(1, math.ceil(piece.length_m / (piece.radius_m * ARC_STEP_RAD)))
            courses = heading + piece.length_m / left_m * np.arange(1, steps) / steps
            # x + ∫ cos χ ds, y + ∫ sin χ ds, with dχ = ds/R
            x_m, y_m = np.sin(courses) - math.sin(heading), math.cos(heading) - np.cos(courses)
            points.append(np.column_stack((x + left_m * x_m, y + left_m * y_m)))
        points.append(np.array([piece.end[:2]]))
    return np.concatenate(points)


def ways_to_point(start: Pose, point_m: Point, radius_m: float) -> list[tuple[Piece, ...]]:
    """An arc and a straight to a point, at which any heading will do, to either side; the shorter first.

    Parameters
    ----------
    start : (float, float, float)
        x, y [m] and heading [rad].
    point_m : (float, float)
        [m].
    radius_m : float
        Turning radius [m]; a point within the turn to one side is reached by the turn to the other alone.
    """
    ways = []  # of each: length, pieces
    for turn in (1, -1):
        centre = centre_m(start, turn, radius_m)
        distance = math.dist(centre, point_m)
        if distance < radius_m:
            continue
        # the straight leaves the circle along the tangent through the point
        bearing = math.atan2(point_m[1] - centre[1], point_m[0] - centre[0])
        arc = (turn * (bearing - start[2]) + math.asin(radius_m / distance)) % (2 * math.pi)
        arc = 0.0 if 2 * math.pi - arc < WHOLE_TURN_RAD else arc
        arc_m, straight_m = radius_m * arc, math.sqrt(distance**2 - radius_m**2)
        middle = _advanced(start, turn, radius_m, arc_m)
        end = _advanced(middle, 0, math.inf, straight_m)
        pieces = (Piece(turn, start, middle, arc_m, centre), Piece(0, middle, end, straight_m, None))
        kept = tuple(piece for piece in pieces if piece.length_m >= MIN_PIECE_M)
        ways.append((arc_m + straight_m, kept))
    return [pieces for _, pieces in sorted(ways, key=lambda way: way[0])]


def lengths_m(starts: ArrayLike, ends: ArrayLike, radius_m: float) -> FloatArray:
    """Lengths of the shortest paths from many poses to many others.

    Parameters
    ----------
    starts, ends : array, shapes (n, 3) and (m, 3)
        x, y [m] and heading [rad] of each pose.
    radius_m : float
        The minimum turning radius [m], above 0.

    Returns
    -------
    array, shape (n, m)
        Lengths [m], each of the first path that `ordered` gives.

    Raises
    ------
    ValueError
        If the radius is not above 0 and finite, or a pose is not finite.

    Source: Dubins 1957; Shkel and Lumelsky 2001.
    """
    totals = [arcs.first + arcs.middle + arcs.last for arcs in _words(*_each_to_each(starts, ends), radius_m)]
    shortest_of: FloatArray = np.fmin.reduce(totals) * radius_m
    return shortest_of


# --- time in wind -----------------------------------------------------------------------------------------------------


def flight_time_s(pieces: Sequence[Piece], airspeed_mps: float, wind_mps: Point) -> float:
    """Time to fly a path that is fixed to the ground, in a steady wind.

    Parameters
    ----------
    pieces : sequence of Piece
    airspeed_mps : float
        Airspeed v [m/s].
    wind_mps : (float, float)
        Wind w, where it blows towards [m/s].

    Returns
    -------
    float
        Time [s]; of arcs to 1e-12 of itself where the wind is below 0.99 of the airspeed, to 1e-6 beyond.

    Raises
    ------
    Infeasible
        If the wind is as fast as the aircraft, so that it cannot hold every course.

    Source: the wind triangle, see `times_s`.
    """
    pace = _Pace.in_wind(airspeed_mps, wind_mps)
    # course at the start, length [m], and of arcs the radius [m], above 0 to the left
    straight = [(piece.start[2], piece.length_m) for piece in pieces if not piece.turn]
    arcs = [(piece.start[2], piece.length_m, piece.turn * piece.radius_m) for piece in pieces if piece.turn]
    total = 0.0
    if straight:
        courses, lengths_m = np.array(straight).T
        total += float(lengths_m @ pace.straight(courses))
    if arcs:
        courses, lengths_m, left_m = np.array(arcs).T
        # ∫ ds/g = R ∫ dχ/g = mean · length + R (rest at its end − rest at its start)
        rest = pace.rest(courses + lengths_m / left_m) - pace.rest(courses)
        total += pace.mean * float(lengths_m.sum()) + float(left_m @ rest)
    return total


def times_s(starts: ArrayLike, ends: ArrayLike, radius_m: float, airspeed_mps: float, wind_mps: Point) -> FloatArray:
    """Times of the fastest paths of a word from many poses to many others, the paths fixed to the ground.

    Parameters
    ----------
    starts, ends : array, shapes (n, 3) and (m, 3)
        x, y [m] and heading [rad] of each pose: the course over ground.
    radius_m : float
        The minimum turning radius over ground [m], above 0.
    airspeed_mps : float
        Airspeed v [m/s].
    wind_mps : (float, float)
        Wind w, where it blows towards [m/s].

    Returns
    -------
    array, shape (n, m)
        Times [s]: the minimum `flight_time_s` of the paths that `ordered` gives. Without wind, `lengths_m` over v.

    Raises
    ------
    Infeasible
        If the wind is as fast as the aircraft.
    ValueError
        If the radius is not above 0 and finite, or a pose is not finite.

    Notes
    -----
    The ground speed on course χ is g = w·χ̂ + √(v² − (w × χ̂)²), and 1/g = (√(v² − (w × χ̂)²) − w·χ̂) / (v² − |w|²): its
    integral over an arc is an elliptic one, worked out here as the Fourier series that it is.

    Source: the wind triangle.
    """
    pace = _Pace.in_wind(airspeed_mps, wind_mps)
    a, b = np.asarray(starts, dtype=float)[:, np.newaxis, 2], np.asarray(ends, dtype=float)[np.newaxis, :, 2]
    at_start, at_end = pace.rest(a), pace.rest(b)
    fastest = np.full(np.broadcast_shapes(a.shape, b.shape), np.inf)
    for word, first, middle, last in _words(*_each_to_each(starts, ends), radius_m):
        one, two, three = (TURNS[letter] for letter in word)
        course = a + one * first
        there = pace.rest(course)
        # each arc takes mean · angle + turn · (rest at its end − rest at its start)
        time = pace.mean * (first + last) + one * (there - at_start)
        if two == 0:
            time += middle * pace.straight(course) + three * (at_end - there)
        else:
            then = pace.rest(course + two * middle)
            time += pace.mean * middle + two * (then - there) + three * (at_end - then)
        np.fmin(fastest, time, out=fastest)
    return fastest * radius_m


@dataclass(frozen=True, slots=True)
class _Pace:
    """Time per length [s/m] over a course: 1/g and its integral, mean · χ + rest(χ)."""

    airspeed_mps: float
    wind_mps: Point
    mean: float
    sines: tuple[float, ...]
    """Coefficients of sin 2kφ in the integral, φ the course from the wind's direction, k = 1, 2, …"""

    @classmethod
    @functools.lru_cache(maxsize=16)
    def in_wind(cls, airspeed_mps: float, wind_mps: Point) -> _Pace:
        """The pace at an airspeed in a wind. Raises Infeasible if the wind is as fast."""
        wind = math.hypot(*wind_mps)
        if not wind < airspeed_mps:
            raise Infeasible(f"wind of {wind:g} m/s, airspeed of {airspeed_mps:g} m/s: it cannot hold every course")
        # √(v² − w² sin²φ) has its branch points at a height of arcosh(v/w): harmonic k falls as exp(−2k arcosh(v/w))
        fall = 2 * math.acosh(airspeed_mps / wind) if wind > 1e-9 * airspeed_mps else math.inf
        count = min(HARMONICS_LIMIT, 2 + math.ceil(36 / fall))  # down to e⁻³⁶, rounding
        samples = 4 * count
        phi = np.pi * np.arange(samples) / samples
        root = np.sqrt(airspeed_mps**2 - (wind * np.sin(phi)) ** 2)
        harmonics = np.fft.rfft(root).real[: count + 1] / (samples * (airspeed_mps**2 - wind**2))
        # c0 + Σ 2 c_k cos 2kφ  →  c0 φ + Σ (c_k / k) sin 2kφ
        sines = harmonics[1:] / np.arange(1, count + 1)
        return cls(airspeed_mps, wind_mps, float(harmonics[0]), tuple(sines.tolist()))

    def straight(self, course: FloatArray) -> FloatArray:
        """1/g of courses [s/m]."""
        cosine, sine = np.cos(course), np.sin(course)
        along = self.wind_mps[0] * cosine + self.wind_mps[1] * sine
        across = self.wind_mps[0] * sine - self.wind_mps[1] * cosine
        return 1 / (along + np.sqrt(self.airspeed_mps**2 - across**2))

    def rest(self, course: FloatArray) -> FloatArray:
        """The periodic part of the integral of 1/g over the course, up to a constant [s/m]."""
        wx, wy = self.wind_mps
        cosine, sine = np.cos(course), np.sin(course)
        if wx == wy == 0:
            return np.zeros_like(sine)
        wind = math.hypot(wx, wy)
        # of φ, the course from the wind's direction
        cosine, sine = (wx * cosine + wy * sine) / wind, (wx * sine - wy * cosine) / wind
        twice = 2 * (cosine**2 - sine**2)
        one, two = np.zeros_like(sine), np.zeros_like(sine)
        for coefficient in reversed(self.sines):  # Clenshaw: b_k = s_k + 2 cos 2φ b_(k+1) − b_(k+2), Σ = b_1 sin 2φ
            one, two = coefficient + twice * one - two, one
        # Σ s_k sin 2kφ, and −∫ w·χ̂ dχ / (v² − w²)
        return one * 2 * sine * cosine - sine * (wind / (self.airspeed_mps**2 - wind**2))


# --- words, in radii --------------------------------------------------------------------------------------------------


class _Arcs(NamedTuple):
    """A word and its three lengths [radii], of the poses' shape; NaN where there is no such path."""

    word: str
    first: FloatArray
    middle: FloatArray
    last: FloatArray


def _each_to_each(starts: ArrayLike, ends: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Poses, shapes (n, 3) and (m, 3), as arrays that broadcast to (n, m, 3)."""
    return np.asarray(starts, dtype=float)[:, np.newaxis, :], np.asarray(ends, dtype=float)[np.newaxis, :, :]


def _words(here: FloatArray, there: FloatArray, radius_m: float) -> Iterator[_Arcs]:
    """The paths of every word from poses to others, arrays of shape (…, 3) that broadcast.

    Raises
    ------
    ValueError
        If the radius is not above 0 and finite, or a pose is not finite.
    """
    if not 0 < radius_m < math.inf:
        raise ValueError(f"a turning radius of {radius_m:g} m is not above 0 and finite")
    if not (np.isfinite(here).all() and np.isfinite(there).all()):
        raise ValueError("a pose is not finite")
    x, y = (np.moveaxis(there[..., :2] - here[..., :2], -1, 0)) / radius_m
    a, b = here[..., 2], there[..., 2]
    for mirror, names in ((1, ("LSL", "LSR", "LRL")), (-1, ("RSR", "RSL", "RLR"))):
        place = (x, mirror * y, mirror * a, mirror * b)
        yield _Arcs(names[0], *_lsl(*place))
        yield _Arcs(names[1], *_lsr(*place))
        for more_than_half in (True, False):
            yield _Arcs(names[2], *_lrl(*place, more_than_half))


# In these three: x, y is the end's position from the start [radii], a and b are the headings at start and end, (cx, cy)
# goes from the centre of the first turn to that of the last, and results are the lengths of the three pieces [radii].

_Three = tuple[FloatArray, FloatArray, FloatArray]


def _lsl(x: FloatArray, y: FloatArray, a: FloatArray, b: FloatArray) -> _Three:
    # between the centres of two left turns goes a straight of the same length and direction χ
    cx, cy = x - np.sin(b) + np.sin(a), y + np.cos(b) - np.cos(a)
    middle = np.hypot(cx, cy)
    # on one circle, up to rounding, the straight has no direction: the whole turn comes after it
    same = middle < TOUCHING
    course = np.where(same, a, np.arctan2(cy, cx))
    return _turned(course - a), np.where(same, 0.0, middle), _turned(b - course)


def _lsr(x: FloatArray, y: FloatArray, a: FloatArray, b: FloatArray) -> _Three:
    # from the centre of a left turn to that of a right one: p χ̂ + 2 (sin χ, −cos χ)
    cx, cy = x + np.sin(b) + np.sin(a), y - np.cos(b) - np.cos(a)
    square = cx * cx + cy * cy - 4
    middle = np.sqrt(np.where(square > -TOUCHING, np.maximum(square, 0.0), np.nan))
    course = np.arctan2(cy, cx) + np.arctan2(2.0, middle)
    first = _turned(course - a)
    return first, middle, _turned(a + first - b)


def _lrl(x: FloatArray, y: FloatArray, a: FloatArray, b: FloatArray, more_than_half: bool) -> _Three:
    # between the centres of the left turns: 4 sin(p/2) in the direction of the middle of the right turn, p its angle
    cx, cy = x - np.sin(b) + np.sin(a), y + np.cos(b) - np.cos(a)
    quarter = np.hypot(cx, cy) / 4
    half = np.arcsin(np.where(quarter < 1 + TOUCHING, np.minimum(quarter, 1.0), np.nan))
    if more_than_half:
        half = np.pi - half
    course = np.arctan2(cy, cx)
    first = _turned(course + half - a)
    return first, 2 * half, _turned(b - a - first + 2 * half)


def _turned(angle: FloatArray) -> FloatArray:
    """An angle in [0, 2π); what is within `WHOLE_TURN_RAD` of a whole turn is 0."""
    turned = np.mod(angle, 2 * np.pi)
    return np.where(turned > 2 * np.pi - WHOLE_TURN_RAD, 0.0, turned)


def _advanced(pose: Pose, turn: int, radius_m: float, distance_m: float) -> Pose:
    """The pose after a distance [m], which may be below 0, along an arc or a straight."""
    x, y, heading = pose
    if turn == 0:
        return x + distance_m * math.cos(heading), y + distance_m * math.sin(heading), wrap_angle_rad(heading)
    # the chord: 2 r sin(δ/2) in the direction of the middle of the arc
    half = turn * distance_m / (2 * radius_m)
    chord = 2 * radius_m * turn * math.sin(half)
    middle = heading + half
    return x + chord * math.cos(middle), y + chord * math.sin(middle), wrap_angle_rad(heading + 2 * half)


def centre_m(pose: Pose, turn: float, radius_m: float) -> Point:
    """Centre of the turn from a pose, +1 left or −1 right [m]."""
    return pose[0] - turn * radius_m * math.sin(pose[2]), pose[1] + turn * radius_m * math.cos(pose[2])
