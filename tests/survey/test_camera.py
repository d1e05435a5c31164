"""Cameras: the ground in a picture, and how quickly pictures follow one another."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.survey.camera import Camera, CameraOptions, Pictures, ground_m, pictures_document

SHOT = CameraOptions(
    altitude_m=100.0, camera="a camera", sensor_width_mm=12.0, sensor_height_mm=6.4, focal_length_mm=10.0,
    forward_overlap=75.0, picture_interval_s=1.0, image_width_px=6000,
)  # fmt: skip
SURVEY = Pictures(SHOT, 40, 20.0)


def test_a_picture_has_the_ground_that_qgroundcontrol_computes():
    """Its CameraCalc: image density · pixels, of a Sony a6000 with 16 mm at 120 m."""
    gsd_cm = 120 * 23.5 * 100 / (6000 * 16)
    assert gsd_cm == 2.9375
    assert ground_m(23.5, 16, 120) == pytest.approx(6000 * gsd_cm / 100)
    assert ground_m(15.6, 16, 120) == pytest.approx(117.0)


@given(st.floats(1, 40), st.floats(1, 100), st.floats(1, 1000))
def test_a_picture_spans_the_angle_of_view(size_mm, focal_mm, altitude_m):
    half_rad = math.atan(size_mm / 2 / focal_mm)
    assert ground_m(size_mm, focal_mm, altitude_m) == pytest.approx(2 * altitude_m * math.tan(half_rad))


@pytest.mark.parametrize("speed_mps", [10.0, 16.0, 20.0, 90.0])
def test_the_overlap_that_the_interval_allows_is_that_of_pictures_taken_so(speed_mps):
    """Pictures as intervals of ground, one each interval."""
    length_m = 16.0 / (1 - 0.75)
    first, second = (0.0, length_m), (speed_mps * 1.0, speed_mps * 1.0 + length_m)
    shared = (first[1] - second[0]) / length_m
    shot = SURVEY._replace(speed_mps=speed_mps)
    assert shot.max_forward_overlap == pytest.approx(shared)
    quick = speed_mps <= 16.0
    assert (list(shot.doubts()) == []) == quick
    (line,) = shot.lines()
    assert f"up to {math.floor(100 * shared + 1e-9)} % on the fastest lines" in line


def test_what_is_not_known_is_not_said():
    alone = Pictures(replace(SHOT, forward_overlap=None, image_width_px=None, camera=None), None, 20.0)
    assert alone.lines() == ["camera     from 100 m: pictures of 120.0 m across"]
    assert list(alone.doubts()) == []
    assert "on the fastest" not in SURVEY._replace(shot=replace(SHOT, picture_interval_s=None)).lines()[0]
    assert set(pictures_document(None).values()) == {None}
    assert pictures_document(None).keys() == pictures_document(SURVEY).keys()


def test_values_that_are_given_replace_those_of_the_camera():
    camera = Camera("body", 23.5, 15.6, 6000, 4000, 16.0, 1.0)
    assert camera.with_values(focal_length_mm=None, image_width_px=6000) == camera
    other = camera.with_values(focal_length_mm=35.0, picture_interval_s=None)
    assert other == Camera("body", 23.5, 15.6, 6000, 4000, 35.0, 1.0)
    assert Camera().with_values(focal_length_mm=35.0) == Camera(focal_length_mm=35.0)
