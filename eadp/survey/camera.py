"""A camera that looks straight down: its file, its options, and the ground in its pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from os.path import exists
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

from annotated_types import Ge, Gt, Le

from eadp.errors import InputError, one_of, printable
from eadp.io.text.options import Flag, check_range, option_name
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import STRICT, keys_document, validated, without_nulls
from eadp.models.plan.plan import SurveyCamera

MIN_LENGTH_MM, MAX_LENGTH_MM = 0.5, 1e3
"""Sensors have from 2 mm (of thermal cameras) to 100 mm, lenses from 1.5 mm to 800 mm: metres are refused [mm]."""
MAX_PIXELS = 100_000
MAX_NAME = 100
"""Most characters of a camera's name."""
MIN_GSD_CM, MAX_GSD_CM = 0.1, 1e3
"""No aircraft in flight resolves a millimetre: most pixels in metres are refused [cm]."""
MAX_OVERLAP = 99.0
MAX_ALTITUDE_M = 1e5
MAX_PIXEL_RATIO = 1.25
"""Width of a pixel over its height, or the inverse: of pictures cropped from 4:3 to 16:9 it is 1.33, where width and
height of 5:4 are swapped 1.56."""

Length = Annotated[float, Ge(MIN_LENGTH_MM), Le(MAX_LENGTH_MM)]
Pixels = Annotated[int, Ge(1), Le(MAX_PIXELS)]


@dataclass(frozen=True)
class Camera:
    """A camera as far as it is known: None where it is not. Its pictures lie across the lines."""

    name: str = ""
    """Name of the camera and its lens, for people."""

    sensor_width_mm: Length | None = None
    """Width of the sensor, across the lines [mm]."""

    sensor_height_mm: Length | None = None
    """Height of the sensor, along the lines [mm]."""

    image_width_px: Pixels | None = None
    """Width of a picture [pixels]."""

    image_height_px: Pixels | None = None
    """Height of a picture [pixels]."""

    focal_length_mm: Length | None = None
    """Focal length of the lens, not that of full frame [mm]."""

    picture_interval_s: Annotated[float, Gt(0), Le(60)] | None = None
    """Shortest time between two pictures [s]."""

    def faults(self) -> Iterator[tuple[str, str]]:
        """A key and what is wrong with it: pixels that are far from square."""
        sides = self.sensor_width_mm, self.sensor_height_mm, self.image_width_px, self.image_height_px
        if None in sides:
            return
        width_mm, height_mm, columns, rows = map(float, sides)  # type: ignore[arg-type]
        wide_um, high_um = 1000 * width_mm / columns, 1000 * height_mm / rows
        if max(wide_um, high_um) > MAX_PIXEL_RATIO * min(wide_um, high_um):
            yield "image_width_px", f"pixels of {wide_um:.3g} by {high_um:.3g} µm, by the sizes of sensor and picture"


def ground_m(size_mm: float, focal_length_mm: float, altitude_m: float) -> float:
    """Ground that a length on the sensor sees [m].

    Parameters
    ----------
    size_mm, focal_length_mm : float
        Length on the sensor, and the lens's [mm].
    altitude_m : float
        Above the ground [m].

    Source: similar triangles.
    """
    # g / h = s / f
    return altitude_m * size_mm / focal_length_mm


# --- the camera file

SCHEMA = "eadp.camera/1"
FOLDER = files("eadp") / "presets" / "cameras"
CAMERAS = tuple(sorted(file.name.removesuffix(".yaml") for file in FOLDER.iterdir()))
"""Names of the cameras that are shipped."""


@dataclass(frozen=True)
class CameraFile(Camera):
    """A camera file."""

    __pydantic_config__ = STRICT

    schema: Literal["eadp.camera/1"] = "eadp.camera/1"
    """Name and version of the format."""

    source: str = ""
    """Where the values are from."""


def read_camera(name: str) -> Camera:
    """A camera by its name, or of a file.

    Raises
    ------
    InputError
        If there is neither, or with every fault of the file.
    """
    if name in CAMERAS:
        text = Text(f"{name}.yaml", (FOLDER / f"{name}.yaml").read_text("utf-8"))
    elif name.endswith((".yaml", ".yml")) or exists(name):
        text = read_text(name)
    else:
        expected = f"a camera file (.yaml), or {one_of(CAMERAS, name)}"
        raise InputError.at("--camera", 1, 1, f"no camera {printable(name, 60)}", expected, name)
    document = keys_document(text, SCHEMA)
    expected = "the picture's width and height in the order of the sensor's"
    return validated(
        CameraFile,
        document,
        without_nulls(document.value),
        lambda keys: [document.fault((key,), message, expected) for key, message in keys.faults()],
    )


# --- a survey's options and pictures

QUICK_S = 0.5
"""Time between pictures below which most cameras for mapping take none [s]."""

_CAMERA_LIMITS = {
    "altitude_m": (0.0, MAX_ALTITUDE_M),
    "sensor_width_mm": (MIN_LENGTH_MM, MAX_LENGTH_MM),
    "sensor_height_mm": (MIN_LENGTH_MM, MAX_LENGTH_MM),
    "focal_length_mm": (MIN_LENGTH_MM, MAX_LENGTH_MM),
    "image_width_px": (1, MAX_PIXELS),
}
_CAMERA_KEYS = ("sensor_width_mm", "sensor_height_mm", "focal_length_mm", "picture_interval_s", "image_width_px")
"""Options whose values replace those of a camera."""


@dataclass(frozen=True)
class CameraOptions:
    """The camera, and how its pictures overlap."""

    SECTION: ClassVar = "Camera"

    altitude_m: float | None = None
    """Altitude above the ground [m], which the plan holds; or it follows from --gsd."""

    gsd_cm: float | None = None
    """Ground sampling distance, the size of a pixel on the ground [cm]."""

    camera: Annotated[str | None, Flag(metavar="NAME")] = None
    """Camera by name, or a camera file (.yaml); an unknown name lists them. The next options replace its values."""

    sensor_width_mm: float | None = None
    """Width of the camera's sensor, across the lines [mm]."""

    sensor_height_mm: float | None = None
    """Height of the camera's sensor, along the lines [mm]."""

    focal_length_mm: float | None = None
    """Focal length of the camera [mm]."""

    side_overlap: Annotated[float | str | None, Flag(metavar="PERCENT")] = None
    """Overlap of the pictures of neighbouring lines [%]; by default 0. Or wanted and acceptable, as 70:60: laps are
    flown at the first, and widen up to the second."""

    forward_overlap: Annotated[float | None, Flag(metavar="PERCENT")] = None
    """Overlap of the pictures along a line [%]: the plan takes them."""

    picture_interval_s: Annotated[float | None, Flag(low=0)] = None
    """Shortest time between two pictures of which the camera is capable [s]; --forward-overlap is held against it."""

    image_width_px: int | None = None
    """Width of a picture, across the lines [pixels]: the size of a pixel is said."""

    def with_camera(self) -> Self:
        """The options with the values of the camera, and the altitude at which its pixels have their size.

        Raises
        ------
        InputError
            If there is no such camera, or the altitude is given as well, or cannot follow.
        """
        camera = Camera() if self.camera is None else read_camera(self.camera)
        values = {key: getattr(each, key) for each in (camera, self) for key in _CAMERA_KEYS if getattr(each, key)}
        found = replace(self, camera=printable(" ".join(camera.name.split()), MAX_NAME) or None, **values)
        if self.gsd_cm is None:
            return found
        if self.altitude_m is not None:
            raise option_fault("--gsd", f"{self.gsd_cm:g}", "the size of a pixel beside the altitude", "one of the two")
        check_range("--gsd", self.gsd_cm, MIN_GSD_CM, MAX_GSD_CM, closed=True)
        width_mm, focal_mm, columns = found._needed("sensor_width_mm", "focal_length_mm", "image_width_px")
        # h = g n / (s / f): the altitude at which n pixels of the size g are as wide as the picture
        return replace(found, altitude_m=self.gsd_cm / 100 * columns / ground_m(width_mm, focal_mm, 1.0))

    def _needed(self, *keys: str) -> list[float]:
        """Values of the camera; a fault where one is not given, or out of range."""
        for key in keys:
            option, value = option_name(key), getattr(self, key)
            if value is None:
                expected = "--gsd or --altitude" if key == "altitude_m" else "a --camera that has it, or this option"
                raise option_fault(option, "", f"the camera needs {option} too", expected)
            check_range(option, value, *_CAMERA_LIMITS[key], closed=key == "image_width_px")
        return [getattr(self, key) for key in keys]

    def _ground_m(self, key: str, overlap: float = 0.0) -> float:
        """Ground that a picture adds beside its neighbour [m], less the overlap [%]; `key` is the sensor's size."""
        altitude_m, size_mm, focal_mm = self._needed("altitude_m", key, "focal_length_mm")
        if not (overlap == 0 or 1 <= overlap <= MAX_OVERLAP):
            name = "--side-overlap" if key == "sensor_width_mm" else "--forward-overlap"
            raise option_fault(
                name, f"{overlap:g}", f"{overlap:g} %", f"percent from 1 to {MAX_OVERLAP:g}, as 70; or 0"
            )
        return ground_m(size_mm, focal_mm, altitude_m) * (1 - overlap / 100)

    @cached_property
    def _side_overlaps(self) -> tuple[float | None, float]:
        """Overlap that is wanted, None where one value is given, and that is acceptable [%]."""
        raw = str(self.side_overlap or 0)
        try:
            *wanted, acceptable = map(float, raw.split(":"))
        except ValueError:
            wanted, acceptable = [math.nan] * 2, math.nan
        if len(wanted) > 1 or (wanted and not wanted[0] > acceptable):
            expected = "percent, as 70, or wanted and acceptable, as 70:60"
            raise option_fault("--side-overlap", raw, f"{printable(raw, 40)}", expected)
        return (wanted[0] if wanted else None), acceptable

    @property
    def camera_swath_m(self) -> float:
        """Ground across a picture beside its neighbour of the next line [m]."""
        return self._ground_m("sensor_width_mm", self._side_overlaps[1])

    @property
    def wanted_spacing_m(self) -> float | None:
        """Distance of lines whose pictures overlap as wanted [m]; None where nothing is."""
        wanted, _ = self._side_overlaps
        return None if wanted is None else self._ground_m("sensor_width_mm", wanted)

    @property
    def width_m(self) -> float:
        """Ground across a picture [m]."""
        return self._ground_m("sensor_width_mm")

    @property
    def picture_length_m(self) -> float | None:
        """Ground in a picture along a line [m]; None where the sensor's height is not known."""
        return None if self.sensor_height_mm is None else self._ground_m("sensor_height_mm")

    @cached_property
    def picture_distance_m(self) -> float | None:
        """Distance between pictures along a line [m]; None where none are taken."""
        return None if self.forward_overlap is None else self._ground_m("sensor_height_mm", self.forward_overlap)

    @property
    def pixel_cm(self) -> float | None:
        """Ground sampling distance, of a pixel [cm]; None where the picture's width in pixels is not known."""
        return None if self.image_width_px is None else 100 * self.width_m / self._needed("image_width_px")[0]


def option_fault(option: str, raw: str, message: str, expected: str) -> InputError:
    """The error of an option, to be raised."""
    return InputError.at(option, 1, 1, message, expected, raw)


class Pictures(NamedTuple):
    """A camera's pictures of a survey: of all lines, the densest, and the ground speed of the fastest lines [m/s].

    `number` is None where the plan takes none.
    """

    shot: CameraOptions
    number: int | None
    speed_mps: float

    @property
    def altitude_m(self) -> float:
        """Above the ground [m]."""
        assert self.shot.altitude_m is not None
        return self.shot.altitude_m

    @property
    def of_plan(self) -> SurveyCamera:
        """What the plan carries of them."""
        pixel_cm = self.shot.pixel_cm
        rounded_cm = None if pixel_cm is None else round(pixel_cm, 6)
        return SurveyCamera(self.shot.camera or "", round(self.altitude_m, 3), rounded_cm)

    def lines(self) -> list[str]:
        """A summary for people, line by line."""
        shot, distance_m, overlap = self.shot, self.shot.picture_distance_m, self.shot.forward_overlap
        name = f"{shot.camera} " if shot.camera else ""
        parts = [f"{name}from {self.altitude_m:.4g} m: pictures of {shot.width_m:.1f} m across"]
        parts += [] if shot.pixel_cm is None else [f"{rounded_text(shot.pixel_cm, 2)} cm a pixel"]
        if distance_m is None or overlap is None:
            return [f"camera     {'; '.join(parts)}"]
        parts += [f"one each {distance_m:.1f} m, forward overlap {overlap:.0f} %", f"{self.number} in all"]
        return [f"camera     {'; '.join(parts)}"]

    def doubts(self) -> Iterator[tuple[str, str, str]]:
        """An option, what is wrong and what is expected, of pictures that follow too fast on the fastest lines."""
        distance_m, speed_mps, shortest_s = self.shot.picture_distance_m, self.speed_mps, self.shot.picture_interval_s
        if distance_m is not None and distance_m < (shortest_s or QUICK_S) * speed_mps:
            message = (
                f"a picture each {distance_m:.3g} m, which are {distance_m / speed_mps:.3g} s on the fastest lines"
            )
            whose = f"the camera's {shortest_s:g} s" if shortest_s else f"{QUICK_S:g} s, as most cameras have"
            yield "--forward-overlap", message, f"{whose}: less overlap, a slower flight, or more altitude"


def rounded_text(value: float, digits: int) -> str:
    """A number for people: to so many digits, and as many more as it has before its point."""
    return f"{value:.{digits}g}" if value < 10**digits - 0.5 else f"{value:.0f}"


def pictures_document(pictures: Pictures | None) -> dict[str, Any]:
    """The values of `eadp.cover/1` and `eadp.sorties/1`; None of each where there is no camera."""
    if pictures is None:
        return {"forward_overlap": None, "pictures": None, "gsd_cm": None, "camera": None}
    shot = pictures.shot
    camera: dict[str, str | float | None] = {
        "name": shot.camera or "",
        "altitude_m": shot.altitude_m,
        "width_m": shot.width_m,
        "distance_m": shot.picture_distance_m,
    }
    overlap = None if shot.forward_overlap is None else shot.forward_overlap / 100
    return {"forward_overlap": overlap, "pictures": pictures.number, "gsd_cm": shot.pixel_cm, "camera": camera}
