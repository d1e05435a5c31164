"""Cameras: the ground in a picture, and how quickly pictures follow one another."""

from dataclasses import replace

import pytest

from eadp.survey.camera import CameraOptions, Pictures, ground_m, pictures_document

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


@pytest.mark.parametrize("speed_mps", [10.0, 16.0, 20.0, 90.0])
def test_pictures_faster_than_the_interval_are_doubted(speed_mps):
    """One each 16 m, and one a second."""
    assert (list(SURVEY._replace(speed_mps=speed_mps).doubts()) == []) == (speed_mps <= 16.0)


def test_what_is_not_known_is_not_said():
    alone = Pictures(replace(SHOT, forward_overlap=None, image_width_px=None, camera=None), None, 20.0)
    assert alone.lines() == ["camera     from 100 m: pictures of 120.0 m across"]
    assert list(alone.doubts()) == []
    assert set(pictures_document(None).values()) == {None}
    assert pictures_document(None).keys() == pictures_document(SURVEY).keys()
