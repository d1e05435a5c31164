"""Distances of aircraft that fly at once, beside those of a fine grid of times."""

from __future__ import annotations

import math

import numpy as np
import pytest

from eadp.coverage.separation import LATE_S, TimedTrack, nearest, stagger_s, track_of
from eadp.coverage.swaths import CoverageLeg, CoveragePath, MotionLimits, half_circle, straight

TIMES = np.linspace(0.0, 100.0, 101)


def along(start, velocity, times=TIMES):
    return TimedTrack(times, np.array(start) + np.outer(times, velocity))


def test_two_that_cross_are_nearest_where_both_are_near():
    one, other = along((0.0, 0.0), (10.0, 0.0)), along((500.0, -450.0), (0.0, 10.0))
    found = nearest([one, other])
    # |(10 t − 500, 450 − 10 t)|² is least at t = 47.5
    assert found.time_s == pytest.approx(47.5, abs=1)
    assert found.distance_m == pytest.approx(math.hypot(25, 25), abs=1)
    assert found.pair == (0, 1)


def test_one_alone_and_two_at_other_times_are_near_to_no_one():
    one = along((0.0, 0.0), (10.0, 0.0))
    assert nearest([one]) is None
    assert nearest([one, one.later(500.0)]) is None


def test_on_the_ground_it_is_near_to_no_one():
    way = along((0.0, 0.0), (10.0, 0.0))
    twice = way.then(way, 60.0)
    assert twice.times_s[-1] == pytest.approx(260.0)
    hover = TimedTrack(np.array([110.0, 150.0]), np.full((2, 2), 1000.0))
    assert nearest([twice, hover]) is None


def test_a_delay_keeps_aircraft_apart_also_if_one_is_late():
    track = along((0.0, 0.0), (10.0, 0.0))
    delay_s = stagger_s([track, track], 50.0)
    for late_s in np.linspace(-LATE_S, LATE_S, 21):
        assert nearest([track, track.later(delay_s + late_s)]).distance_m >= 49.0
    assert delay_s <= LATE_S + 10.0


def test_the_track_of_a_path_takes_its_time_in_the_wind():
    motion = MotionLimits(30.0, 40.0, 60.0, 30.0, 15.0, (3.0, 4.0))
    line = straight((0.0, 0.0), (300.0, 0.0))
    path = CoveragePath((CoverageLeg(line, True), CoverageLeg(half_circle(line.end, 40.0, 1))))
    track = track_of(path, motion)
    assert track.times_s[-1] == pytest.approx(motion.time_s(path.pieces))
    assert track.points_m[-1] == pytest.approx(path.pieces[-1].end[:2])
    assert np.all(np.diff(track.times_s) > 0)
    assert np.linalg.norm(np.diff(track.points_m, axis=0), axis=1).max() <= 20.0
