"""Cameras: the ground in a picture, and files, the shipped ones against one another and published angles of view."""

import math
import re
from dataclasses import replace

import pytest

from eadp.errors import InputError
from eadp.survey.camera import CAMERAS, Camera, CameraOptions, Pictures, ground_m, pictures_document, read_camera

BODY = {"sensor_width_mm": 6.3, "sensor_height_mm": 4.7, "focal_length_mm": 4.5, "image_width_px": 4000}


def write(path, schema="eadp.camera/1", **keys):
    path.write_text(f"schema: {schema}\n" + "".join(f"{key}: {value}\n" for key, value in keys.items()))
    return str(path)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_shipped_camera_is_consistent(name):
    camera = read_camera(name)
    pitch_mm = camera.sensor_width_mm / camera.image_width_px
    assert camera.sensor_height_mm / camera.image_height_px == pytest.approx(pitch_mm, rel=0.02)
    assert camera.focal_length_mm
    assert camera.source
    assert camera.name


@pytest.mark.parametrize(
    ("name", "width_deg", "height_deg", "diagonal_deg"),
    [
        ("raspberry-pi-v2", 62.2, 48.8, None),
        ("micasense-rededge", 47.2, None, None),
        ("flir-duo-pro-r-19mm", 32.0, 26.0, None),
        ("dji-phantom-4-pro", None, None, 84.0),
    ],
)
def test_the_angle_of_view_is_the_published_one(name, width_deg, height_deg, diagonal_deg):
    """Those of the makers, in whole degrees or tenths."""
    camera = read_camera(name)
    width_mm, height_mm = camera.sensor_width_mm, camera.sensor_height_mm
    sizes_mm = {width_deg: width_mm, height_deg: height_mm, diagonal_deg: math.hypot(width_mm, height_mm)}
    for angle_deg, size_mm in sizes_mm.items():
        if angle_deg is not None:
            found_deg = 2 * math.degrees(math.atan(size_mm / 2 / camera.focal_length_mm))
            assert found_deg == pytest.approx(angle_deg, abs=0.3)


def test_an_own_camera(tmp_path):
    camera = read_camera(write(tmp_path / "own.yaml", name="own", **BODY))
    assert Camera(**{key: getattr(camera, key) for key in Camera.__dataclass_fields__}) == Camera(name="own", **BODY)
    assert read_camera(write(tmp_path / "plain", **BODY)).focal_length_mm == 4.5, "a file of any name that exists"


def test_an_unknown_name_lists_the_cameras():
    with pytest.raises(InputError) as error:
        read_camera("sony-a600-20mm")
    for name in CAMERAS:
        assert name in str(error.value)
    assert "did you mean sony-a6000-20mm?" in str(error.value)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"sensor_width_m": 0.02}, r":2:1: error: unknown key sensor_width_m; .* did you mean sensor_width_mm\?"),
        (BODY | {"focal_length_mm": 0.0045}, r":4:1: error: focal_length_mm cannot be 0.0045; expected greater than"),
        (BODY | {"image_width_px": 4000.5}, r":5:1: error: image_width_px cannot be 4000.5; expected a whole number"),
        ({"picture_interval_s": "quick"}, r":2:1: error: picture_interval_s cannot be 'quick'; expected a number"),
        (BODY | {"image_width_px": 3000, "image_height_px": 4000}, r":5:1: error: pixels of 2.1 by 1.18 µm, by"),
        ({"schema": "eadp.vehicle/1"}, r".*error: is a file of eadp.vehicle/1; expected schema: eadp.camera/1"),
    ],
)
def test_a_fault_of_a_file_has_its_place(tmp_path, keys, message):
    path = write(tmp_path / "own.yaml", **keys)
    with pytest.raises(InputError) as error:
        read_camera(path)
    assert re.match(re.escape(path) + message, str(error.value))


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
