"""How near aircraft come to one another that fly at the same time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.coverage.swaths import CoveragePath, MotionLimits

STEP_S = 1.0
"""Time between the points of a track at which distances are taken [s]."""

LATE_S = 10.0
"""A pilot's take-off is late by up to this [s]."""

STAGGERS_S = range(0, 601, 5)
"""Delays of take-off from one aircraft to the next that are tried [s]."""


class TimedTrack(NamedTuple):
    """Where an aircraft is over time: times [s], ascending, shape (n,), and positions [m], shape (n, 2)."""

    times_s: FloatArray
    points_m: FloatArray

    def later(self, delay_s: float) -> TimedTrack:
        """The same track, flown later."""
        return self._replace(times_s=self.times_s + delay_s)

    def then(self, other: TimedTrack, pause_s: float) -> TimedTrack:
        """This track, followed by another one after a pause on the ground, where it has no position: NaN."""
        start_s = self.times_s[-1] + pause_s - other.times_s[0]
        # interpolation between two points of NaN, just after the one and just before the other, is NaN
        gap = np.array([self.times_s[-1] + 1e-3, self.times_s[-1] + pause_s - 1e-3])
        ground = np.full((2, 2), np.nan)  # on the ground it is near to no one
        return TimedTrack(
            np.concatenate([self.times_s, gap, other.times_s + start_s]),
            np.concatenate([self.points_m, ground, other.points_m]),
        )


class Nearest(NamedTuple):
    """The least distance of two aircraft [m]: when [s], where [m], and which two."""

    distance_m: float
    time_s: float
    place_m: Point
    pair: tuple[int, int]


def track_of(path: CoveragePath, motion: MotionLimits) -> TimedTrack:
    """The track of a path flown in the wind, with points at the ends of its pieces and along them."""
    times, points = [0.0], [path.pieces[0].start[:2]]
    for piece in path.pieces:
        took_s = motion.time_s([piece])
        parts = max(1, math.ceil(took_s / STEP_S))
        start_s = times[-1]
        for k in range(1, parts + 1):
            times.append(start_s + took_s * k / parts)
            points.append(piece.pose_at(piece.length_m * k / parts)[:2])
    return TimedTrack(np.array(times), np.array(points))


def nearest(tracks: Sequence[TimedTrack]) -> Nearest | None:
    """The least distance of any two aircraft while both are in the air, at steps of `STEP_S`; None if no two ever are.

    Either aircraft flies some 20 m in a step: a distance between two steps may be less by as much.
    """
    if len(tracks) < 2:
        return None
    start_s, end_s = min(track.times_s[0] for track in tracks), max(track.times_s[-1] for track in tracks)
    times = np.arange(start_s, end_s + STEP_S, STEP_S)
    places = []
    for track in tracks:
        in_air = (times >= track.times_s[0]) & (times <= track.times_s[-1])
        xy = np.stack([np.interp(times, track.times_s, track.points_m[:, k]) for k in (0, 1)], axis=1)
        places.append(np.where(in_air[:, None], xy, np.nan))
    found: Nearest | None = None  # of the pairs so far
    for i, j in itertools.combinations(range(len(tracks)), 2):
        distances = np.linalg.norm(places[i] - places[j], axis=1)
        if np.isnan(distances).all():
            continue
        at = int(np.nanargmin(distances))
        if found is None or distances[at] < found.distance_m:
            x, y = places[i][at].tolist()
            found = Nearest(float(distances[at]), float(times[at]), (x, y), (i, j))
    return found


def stagger_s(tracks: Sequence[TimedTrack], distance_m: float) -> float:
    """The least delay of take-off from one aircraft to the next that keeps a distance [s].

    Where none of `STAGGERS_S` does, the one with the greatest distance.
    """

    def min_distance_m(delay_s: float) -> float:
        """The least distance of any two aircraft [m], also where every second one takes off up to `LATE_S` off time."""
        found = [
            nearest([track.later(k * delay_s + late_s * (k % 2)) for k, track in enumerate(tracks)])
            for late_s in np.linspace(-LATE_S, LATE_S, 5).tolist()
        ]
        return min((each.distance_m for each in found if each is not None), default=math.inf)

    best_s, best_m = 0.0, -1.0
    for delay_s in map(float, STAGGERS_S):
        found_m = min_distance_m(delay_s)
        if found_m >= distance_m:
            return delay_s
        if found_m > best_m:
            best_s, best_m = delay_s, found_m
    return best_s
