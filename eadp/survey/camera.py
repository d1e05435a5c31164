"""A camera that looks straight down, and the ground in its pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

from annotated_types import Ge, Gt, Le

from eadp.models.doubts import Doubt

MIN_LENGTH_MM, MAX_LENGTH_MM = 0.5, 1e3
"""Sensors have from 2 mm (of thermal cameras) to 100 mm, lenses from 1.5 mm to 800 mm: metres are refused [mm]."""
MAX_PIXELS = 100_000
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

    def with_values(self, **values: float | None) -> Camera:
        """The camera with other values, where they are given; its name says which."""
        other = {key: value for key, value in values.items() if value not in (None, getattr(self, key))}
        changed = ", ".join(f"{key} {value:g}" for key, value in other.items())
        name = f"{self.name} with {changed}" if self.name and changed else self.name
        return replace(self, name=name, **other)  # type: ignore[arg-type]

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


class Pictures(NamedTuple):
    """A camera's pictures of a survey.

    Attributes
    ----------
    camera : str
        Its name, '' if it has none.
    altitude_m : float
        Above the ground [m].
    width_m : float
        Of the ground in one, across the lines [m].
    gsd_cm : float or None
        Ground sampling distance, of a pixel [cm]; None where the picture's width in pixels is not known.
    distance_m : float or None
        Between pictures along a line [m]; None where none are taken.
    forward_overlap : float or None
        Share of a picture that the next one of the line shows too.
    number : int or None
        Of all lines, the densest.
    interval_s : float or None
        Shortest time between two pictures of which the camera is capable [s].
    speed_mps : float
        Ground speed of the fastest lines [m/s].
    """

    camera: str
    altitude_m: float
    width_m: float
    gsd_cm: float | None
    distance_m: float | None
    forward_overlap: float | None
    number: int | None
    interval_s: float | None
    speed_mps: float

    @property
    def max_forward_overlap(self) -> float | None:
        """Largest forward overlap for which the camera is quick enough on the fastest lines; below 0 with gaps."""
        if self.interval_s is None or self.distance_m is None or self.forward_overlap is None:
            return None
        # 1 − v t / L, of pictures that are L = d / (1 − overlap) long
        return 1 - self.speed_mps * self.interval_s * (1 - self.forward_overlap) / self.distance_m

    def lines(self) -> list[str]:
        """A summary for people, line by line."""
        name = f"{self.camera} " if self.camera else ""
        parts = [f"{name}from {self.altitude_m:.4g} m: pictures of {self.width_m:.1f} m across"]
        parts += [] if self.gsd_cm is None else [f"{self.gsd_cm:.2g} cm a pixel"]
        if self.distance_m is None or self.forward_overlap is None:
            return [f"camera     {'; '.join(parts)}"]
        overlap = f"forward overlap {100 * self.forward_overlap:.0f} %"
        parts += [f"one each {self.distance_m:.1f} m, {overlap}", f"{self.number} in all"]
        return [f"camera     {'; '.join(parts)}", *self._interval_lines()]

    def _interval_lines(self) -> list[str]:
        """What the camera's shortest interval allows."""
        most = self.max_forward_overlap
        if most is None or self.distance_m is None or self.forward_overlap is None or self.interval_s is None:
            return []
        # rounded down: what is printed is possible
        line = f"interval   {self.interval_s:g} s or more: on the fastest lines, at {self.speed_mps:.1f} m/s over "
        line += f"ground, forward overlap up to {100 * most // 1:.0f} %"
        if most < self.forward_overlap:
            slow_mps = self.distance_m / self.interval_s
            line += f"; {100 * self.forward_overlap:.0f} % up to {slow_mps * 10 // 1 / 10:.1f} m/s"
        return [line]


def pictures_document(pictures: Pictures | None) -> dict[str, Any]:
    """The values of `eadp.cover/1` and `eadp.sorties/1`; None of each where there is no camera."""
    if pictures is None:
        return dict.fromkeys(("forward_overlap", "pictures", "gsd_cm", "camera"))
    keys = ("altitude_m", "width_m", "distance_m", "max_forward_overlap")
    return {
        "forward_overlap": pictures.forward_overlap,
        "pictures": pictures.number,
        "gsd_cm": pictures.gsd_cm,
        "camera": {"name": pictures.camera} | {key: getattr(pictures, key) for key in keys},
    }


# --- what may be meant otherwise

LEGAL_M = 120.0
"""Height above ground up to which most rules let unmanned aircraft fly: 120 m in Europe, 400 ft elsewhere [m]."""
FOOT_M = 0.3048
SMALL_SENSOR_MM = 3.0
"""Width of a sensor below that of a 1/4-inch one (3.6 mm); a few thermal ones are smaller [mm]."""
LONG_LENS = 3.0
"""Focal length over the sensor's width, from which on a picture spans less than 19°."""
QUICK_S = 0.5
"""Time between pictures below which most cameras for mapping take none [s]."""


class Shots(NamedTuple):
    """A camera's pictures as options have them; None where they do not.

    Attributes
    ----------
    altitude_m : float or None
        Above ground [m].
    sensor_width_mm, focal_length_mm : float or None
        [mm].
    gsd_cm : float or None
        Size of a pixel on the ground, where the altitude follows from it [cm].
    """

    altitude_m: float | None = None
    sensor_width_mm: float | None = None
    focal_length_mm: float | None = None
    gsd_cm: float | None = None


def shot_doubts(shots: Shots) -> Iterator[Doubt]:
    """Doubts about the altitude and the camera of a survey."""
    altitude_m, width_mm, focal_mm, gsd_cm = shots
    if altitude_m is not None and altitude_m > LEGAL_M:
        message = f"{altitude_m:.4g} m, above the {LEGAL_M:g} m that most rules allow"
        if gsd_cm is None:
            yield Doubt("--altitude", message, f"metres: {altitude_m:g} ft are {altitude_m * FOOT_M:.4g} m")
        else:
            lower_cm = math.floor(100 * gsd_cm * LEGAL_M / altitude_m) / 100
            expected = f"at most {lower_cm:g} cm a pixel, or another lens"
            yield Doubt("--gsd", f"{gsd_cm:g} cm a pixel are seen from {message}", expected)
    if width_mm is not None and width_mm < SMALL_SENSOR_MM:
        expected = "as 6.2 mm of 1/2.3 inch, 13.2 of 1 inch, 23.5 of APS-C, 35.9 of full frame"
        yield Doubt("--sensor-width-mm", f"{width_mm:g} mm, smaller than a 1/4-inch sensor", expected)
    if width_mm is not None and focal_mm is not None and focal_mm > LONG_LENS * width_mm:
        message = f"{focal_mm:g} mm with a sensor of {width_mm:g} mm, which spans {_span_deg(width_mm, focal_mm):.2g}°"
        expected = f"the lens's own: as full-frame equivalent it is {focal_mm * width_mm / 36:.3g} mm"
        yield Doubt("--focal-length-mm", message, expected)


def interval_doubts(pictures: Pictures) -> Iterator[Doubt]:
    """A doubt about pictures that follow one another too fast on the fastest lines."""
    distance_m, speed_mps, shortest_s = pictures.distance_m, pictures.speed_mps, pictures.interval_s
    if distance_m is not None and distance_m < (shortest_s or QUICK_S) * speed_mps:
        message = f"a picture each {distance_m:.3g} m, which are {distance_m / speed_mps:.2g} s on the fastest lines"
        whose = f"the camera's {shortest_s:g} s" if shortest_s else f"{QUICK_S:g} s, as most cameras have"
        yield Doubt("--forward-overlap", message, f"{whose}: less overlap, a slower flight, or more altitude")


def _span_deg(width_mm: float, focal_mm: float) -> float:
    """Angle of view across [°]."""
    return math.degrees(2 * math.atan(width_mm / 2 / focal_mm))
