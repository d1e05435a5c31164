"""Options of a coverage, as the command `eadp cover` and the library take them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import blowing_to_rad, place_text, to_local_m, velocity_mps
from eadp.io.text.options import Flag, check_range
from eadp.models.airspace import CLEARANCE_M, Field
from eadp.models.performance import PATH_MARGIN, ground_radius_m, roll_out_m
from eadp.models.plan.pieces import course_rad
from eadp.models.vehicle import Airframe
from eadp.survey.camera import CameraOptions, option_fault
from eadp.survey.coverage import AUTO, PATTERNS
from eadp.survey.heights import HeightLimits
from eadp.survey.swaths import RADIUS_SHARE, SPACING_SHARE, MotionLimits
from eadp.survey.terrain import ElevationModel, read_terrain

MIN_RADIUS_M = 0.1
MAX_LENGTH_M = 1e5
MAX_AIRSPEED_MPS = 1e3
NEAR_DEG = 1.0
"""Distance of two positions that are one place, with latitude and longitude swapped [°]."""
MAX_DISTANCE_M = 50_000.0
"""Largest distance of the start and home points from the field [m]."""
TOLERANCE_SHARE = 0.1
"""Default of --height-tolerance over --altitude: pixels on the ground are up to so much larger."""

Pair = str | Point
"""Two numbers, or the text of two numbers."""


@dataclass(frozen=True)
class PathOptions:
    """The lines, and the turns between them."""

    SECTION: ClassVar = "Lines and turns"

    min_radius_m: float | None = None
    """Smallest turning radius [m]; by default what the aircraft needs in the wind."""

    swath_m: float | None = None
    """Width of ground that a line covers [m]; or it follows from the camera."""

    radius_m: float | None = None
    """Ideal turning radius [m]; by default 1.5 times the smallest."""

    spacing_m: float | None = None
    """Distance of the lines [m]. Of Zamboni-like laps the finest, by default half the swath, up to which a planner
    widens it; of lines in an order by default the swath."""

    heading_deg: float | None = None
    """Heading of the lines [°], a compass bearing; the quickest by default."""

    pattern: Annotated[str, Flag(metavar=f"[{'|'.join(PATTERNS)}]")] = AUTO
    """Zamboni-like laps, lines in an order with Dubins turns, or the shorter."""

    turns_off: bool = False
    """Computations stop on turns."""

    lead_in_m: float | None = None
    """Straight and level flight before each line [m]; by default, with --forward-overlap, what the aircraft needs to
    roll out of a turn, else 0."""


@dataclass(frozen=True)
class EndOptions:
    """Where the flight starts and ends, and in which wind it flies how fast."""

    SECTION: ClassVar = "Take-off, landing and wind"

    start: Annotated[Pair | None, Flag(metavar="POINT")] = None
    """Where the flight starts: X,Y [m], or LAT,LON [°] of a field in degrees."""

    home: Annotated[Pair | None, Flag(metavar="POINT")] = None
    """Where the flight takes off, unless --start is another place, and where it returns to; as --start."""

    takeoff_deg: Annotated[float | None, Flag("--takeoff", metavar="HEADING")] = None
    """Heading of the take-off [°], straight ahead up to 50 m; with --landing by default into the wind."""

    landing: Annotated[str | tuple[float, float, float] | None, Flag(metavar="LAT,LON,HEADING")] = None
    """Where to land, instead of returning to home, and the heading of the final approach [°]; X,Y,HEADING [m] of a
    field in metres. Without --home it takes off there."""

    wind: Annotated[Pair | None, Flag(metavar="SPEED,FROM_DEG")] = None
    """Wind: speed [m/s] and the bearing it blows from [°]; by default the scenario's."""

    airspeed_mps: float | None = None
    """Airspeed [m/s]; by default that of the scenario's vehicle."""


@dataclass(frozen=True)
class FieldOptions:
    """How the field's file is read, and what lines and turns keep to."""

    SECTION: ClassVar = "Field"

    metres: bool = False
    """The file is in local metres, not degrees."""

    feature: str | None = None
    """Which polygon of a file that holds several: id, name or number; or all, as parts."""

    avoid: Annotated[str | None, Flag(metavar="FILE")] = None
    """Polygons that lines and turns stay out of: GeoJSON, KML or CSV."""

    inside: Annotated[str | None, Flag(metavar="FILE")] = None
    """Polygons that lines and turns stay inside of, as --avoid."""

    holes: Literal["cover", "avoid"] = "cover"
    """Whether the field's holes may be flown over; they are not covered."""

    clearance_m: float = CLEARANCE_M
    """Obstacles so far below the plan's altitude [m] are flown over, where their height is known."""


@dataclass(frozen=True)
class TerrainOptions:
    """The ground, and how lines follow it."""

    SECTION: ClassVar = "Ground"

    terrain: Annotated[Sequence[str], Flag(metavar="FILE")] = ()
    """Heights of the ground, as GeoTIFF or .hgt of SRTM; several are joined. Lines keep --altitude above it, turns and
    ways --clearance."""

    height_tolerance_m: float | None = None
    """How much higher above the ground lines may be [m]; by default a tenth of --altitude."""


@dataclass(frozen=True)
class CoverageOptions(TerrainOptions, CameraOptions, FieldOptions, EndOptions, PathOptions):
    """Options of a coverage: in order those of lines and turns, the ends, the field, the camera and the ground.

    Faults name them as the command `eadp cover` does.
    """

    @cached_property
    def line_swath_m(self) -> float:
        """Width of ground that a line covers beside its neighbours [m]: as given, or the camera's."""
        camera = (self.sensor_width_mm, self.focal_length_mm, self.side_overlap)
        if self.swath_m is None:
            if camera == (None, None, None):
                expected = "--swath, or --altitude or --gsd, and --camera"
                raise option_fault("--swath", "", "no width of ground that a line covers", expected)
            return self.camera_swath_m
        if self.sensor_width_mm is not None or self.side_overlap is not None:
            raise option_fault("--swath", f"{self.swath_m:g}", "a swath beside that of the camera", "one of the two")
        return self.swath_m

    def motion(self, airframe: Airframe, wind_mps: Point) -> MotionLimits:
        """The limits of the motion of an aircraft; the wind given here holds where the options have none."""
        swath = self.line_swath_m
        apart = self.wanted_spacing_m or SPACING_SHARE * swath if self.spacing_m is None else self.spacing_m
        speed = airframe.airspeed_mps if self.airspeed_mps is None else self.airspeed_mps
        if self.wind is not None:
            wind_mps = wind_vector_mps(self.wind)
        least = self.min_radius_m
        if least is None:
            least = float(math.ceil(PATH_MARGIN * ground_radius_m(airframe, speed, math.hypot(*wind_mps))))
        ideal = min(RADIUS_SHARE * least, MAX_LENGTH_M) if self.radius_m is None else self.radius_m
        check_range("--airspeed", speed, 0.0, MAX_AIRSPEED_MPS)
        check_range("--min-radius", least, MIN_RADIUS_M, MAX_LENGTH_M, closed=True)
        check_range("--swath", swath, 0.0, MAX_LENGTH_M)
        check_range("--radius", ideal, least, MAX_LENGTH_M, closed=True)
        check_range("--spacing", apart, 0.0, swath)
        if math.hypot(*wind_mps) >= speed:
            message = f"a wind of {math.hypot(*wind_mps):g} m/s, no slower than the aircraft"
            per_hour = f"{math.hypot(*wind_mps):g} km/h are {math.hypot(*wind_mps) / 3.6:.3g} m/s"
            raise option_fault("--wind", _raw(self.wind or ""), message, f"less than its {speed:g} m/s; {per_hour}")
        lead_in = self.lead_in_m
        if lead_in is None:
            rolls_m = 0.0 if self.forward_overlap is None else roll_out_m(airframe, speed + math.hypot(*wind_mps))
            lead_in = float(math.ceil(rolls_m))
        check_range("--lead-in", lead_in, 0.0, MAX_LENGTH_M, closed=True)
        return MotionLimits(swath, least, ideal, apart, speed, wind_mps, lead_in)

    @property
    def height_limits(self) -> HeightLimits:
        """Heights above the ground, of a terrain."""
        line_m, tolerance_m = self.altitude_m or 0.0, self.height_tolerance_m
        return HeightLimits(line_m, TOLERANCE_SHARE * line_m if tolerance_m is None else tolerance_m, self.clearance_m)

    def elevations(self, field: Field, ends: Sequence[Point | None]) -> ElevationModel | None:
        """The ground around a field and the ends of its flight; None where no terrain is given.

        Raises
        ------
        InputError
            Of the files, and where the plan cannot follow a terrain.
        """
        files, limits = [self.terrain] if isinstance(self.terrain, str) else self.terrain, self.height_limits
        if not files:
            if self.height_tolerance_m is not None:
                raise option_fault("--height-tolerance", "", "no ground to be above", "--terrain")
            return None
        if self.altitude_m is None:
            raise option_fault("--terrain", "", "no height to keep above the ground", "--altitude")
        if field.origin_deg is None:
            raise option_fault("--terrain", "", "the field has no place on the earth", "a field in degrees")
        check_range("--height-tolerance", limits.tolerance_m, 1, 1000, closed=True)
        if limits.line_m < limits.clearance_m:
            message = f"{limits.line_m:g} m, less than the clearance"
            raise option_fault("--altitude", "", message, f"--clearance {limits.line_m:g} or less")
        points = [*(vertex for part in field.parts for vertex in part[0]), *filter(None, ends)]
        return read_terrain(files, np.array(points), field.origin_deg)

    @property
    def heading_rad(self) -> float | None:
        """The mathematical heading (0 east, counter-clockwise) of the lines, if it is given."""
        if self.heading_deg is None:
            return None
        return course_rad("--heading", self.heading_deg)


def wind_vector_mps(given: Pair) -> Point:
    """The wind's vector (east, north), of its speed and the compass bearing that it blows from."""
    speed, from_deg = two_numbers("--wind", given, "a speed [m/s] and a bearing [°], like 5,270 for a west wind")
    if speed < 0:
        raise option_fault("--wind", _raw(given), f"a speed of {speed:g}", "0 or more")
    if abs(from_deg) > 360:
        raise option_fault("--wind", _raw(given), f"a bearing of {from_deg:g}°", "0 to 360: where the wind comes from")
    return velocity_mps(speed, blowing_to_rad(from_deg))


def point_of(option: str, given: Pair | None, field: Field) -> Point | None:
    return None if given is None else place_of(option, given, field)


def place_of(option: str, given: Pair, field: Field) -> Point:
    """A point in the field's coordinates: metres, or latitude and longitude if the field was given in degrees."""
    if field.origin_deg is None:
        point = two_numbers(option, given, "X,Y in metres, like -50,20")
    else:
        expected = "LAT,LON in degrees, like 55.37,10.43"
        lat, lon = two_numbers(option, given, expected)
        if not (abs(lat) <= 90 and abs(lon) <= 180):
            raise option_fault(option, _raw(given), "no latitude and longitude", expected)
        point = to_local_m(lat, lon, field.origin_deg)
    distance_m = min(math.dist(point, vertex) for part in field.parts for vertex in part[0])
    if distance_m > MAX_DISTANCE_M:
        message, expected = f"{distance_m / 1000:.0f} km from the field", f"{MAX_DISTANCE_M / 1000:g} km or less"
        if field.origin_deg is not None:
            message += f", which is at {place_text(field.origin_deg)}"
            expected += "; LAT,LON in that order"
            if math.dist((lon, lat), field.origin_deg) < NEAR_DEG:
                expected = "LAT,LON in that order: here or in the field's file they are swapped"
        raise option_fault(option, _raw(given), message, expected)
    if not field.airspace.admits(point):
        message = "lies in an obstacle or beyond the boundary"
        raise option_fault(option, _raw(given), message, "a place that may be flown over")
    return point


def _raw(given: Pair) -> str:
    return given if isinstance(given, str) else f"{given[0]},{given[1]}"


def two_numbers(option: str, given: Pair, expected: str) -> Point:
    try:
        first, second = (float(word) for word in _raw(given).replace(",", " ").split())
    except ValueError:
        first = second = math.nan
    if not (math.isfinite(first) and math.isfinite(second)):
        raise option_fault(option, _raw(given), "not two numbers", expected)
    return first, second
