"""The use case of `eadp cover`: a field, an aircraft and computations in, a plan and its report out."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from functools import cached_property
from os import PathLike
from typing import Annotated, Any, Literal, NamedTuple, Self

from eadp.api.given import File, Warn, python_warnings
from eadp.api.inputs import clear_home_m, load_flight
from eadp.api.profile import profile_of_scenario, read_profile
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Pose
from eadp.core.geometry.geodesy import blowing_to_rad, compass_deg, place_text, to_local_m, velocity_mps
from eadp.core.geometry.polygons import FreeSpace
from eadp.errors import Fault, Infeasible, InputError, one_of, printable, refuse
from eadp.io.plan.writer import plan_text
from eadp.io.scenario import read_scenario
from eadp.io.text.options import Flag, check_range, option_name
from eadp.io.text.streams import read_text
from eadp.io.vehicle import read_vehicle
from eadp.models.airspace import CLEARANCE_M, CLEARANCE_SHARE, Airspace, Obstacle
from eadp.models.autopilot import FACTORY, LANDING_ANGLE, PX4, Autopilot
from eadp.models.battery import Battery
from eadp.models.doubts import NEAR_DEG, Doubt, angle_doubts
from eadp.models.field import Field
from eadp.models.landing import (
    Air,
    approach,
    approach_slopes,
    behind_mps,
    behind_warning,
    climb_out,
    course_rad,
    landing_pose,
)
from eadp.models.performance import PATH_MARGIN, ground_radius_m, roll_out_m, too_tight
from eadp.models.plan.pieces import CLIMB_OUT_M
from eadp.models.plan.plan import MadeFor, Plan, Site, SurveyCamera
from eadp.models.plan.stage import LAND, LOITER_TO_ALTITUDE, RETURN, TAKEOFF, TRIGGER_DISTANCE, Box
from eadp.models.plan.trace import nominal_legs
from eadp.models.profile import AnyProfile
from eadp.models.vehicle import Airframe, PaperVehicle
from eadp.survey.camera import (
    MAX_LENGTH_MM,
    MAX_PIXELS,
    MIN_LENGTH_MM,
    Camera,
    Pictures,
    Shots,
    ground_m,
    interval_doubts,
    pictures_document,
    shot_doubts,
)
from eadp.survey.camera_file import read_camera
from eadp.survey.coverage import AUTO, PATTERNS, CoverageRequest, CoverageSolution, check_access, has_pattern
from eadp.survey.coverage import cover as cover_field
from eadp.survey.ends import (
    Climbing,
    FinalApproach,
    Lack,
    climbed_first,
    free_circles,
    held_up_m,
    level_lack,
    with_circles,
)
from eadp.survey.features import NAME_LIMIT
from eadp.survey.field_reader import read_airspace, read_field, read_field_text
from eadp.survey.ground import (
    FLAT_M,
    HOME_TEXT,
    HeightReport,
    Heights,
    TerrainOptions,
    TerrainTask,
    climbing_over,
    with_heights,
)
from eadp.survey.heights import Ground, clear_circle, climb_lack, late_over_s
from eadp.survey.plan_builder import FieldComputations, PlanCommands, build_plan
from eadp.survey.report import CoverageReport
from eadp.survey.swaths import RADIUS_SHARE, SPACING_SHARE, CoverageLeg, MotionLimits

MIN_RADIUS_M = 0.1
MAX_LENGTH_M = 1e5
MAX_AIRSPEED_MPS = 1e3
MAX_ALTITUDE_M = 1e5
MIN_GSD_CM, MAX_GSD_CM = 0.1, 1e3
"""No aircraft in flight resolves a millimetre: most pixels in metres are refused [cm]."""
MAX_OVERLAP = 99.0
MAX_DISTANCE_M = 50_000.0
"""Largest distance of the start and home points from the field [m]."""

TURNS_DEG = [side * turn for turn in range(10, 181, 10) for side in (1, -1)]
"""Turns from a heading of landing that are tried, the least first [°]."""

LOWER_M, MIN_APPROACH_M = 10.0, 30.0
"""Step of the heights from which a final approach is tried, and the least: lower, an autopilot has no time to line up
[m]."""

Pair = str | Point
"""Two numbers, or the text of two numbers."""


@dataclass(frozen=True)
class PathOptions:
    """How the field is flown: turns and lines, where they start and end, and in which wind."""

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

    start: Annotated[Pair | None, Flag(metavar="POINT")] = None
    """Where the flight starts: X,Y [m], or LAT,LON [°] of a field in degrees."""

    home: Annotated[Pair | None, Flag(metavar="POINT")] = None
    """Where the flight takes off, unless --start is another place, and where it returns to; as --start."""

    takeoff_deg: Annotated[float | None, Flag("--takeoff", metavar="HEADING")] = None
    """Heading of the take-off [°], straight ahead up to 50 m; with --landing by default into the wind."""

    landing: Annotated[str | Pose | None, Flag(metavar="LAT,LON,HEADING")] = None
    """Where to land, instead of returning to home, and the heading of the final approach [°]; X,Y,HEADING [m] of a
    field in metres. Without --home it takes off there."""

    wind: Annotated[Pair | None, Flag(metavar="SPEED,FROM_DEG")] = None
    """Wind: speed [m/s] and the bearing it blows from [°]; by default the scenario's."""

    airspeed_mps: float | None = None
    """Airspeed [m/s]; by default that of the scenario's vehicle."""

    turns_off: bool = False
    """Computations stop on turns."""

    lead_in_m: float | None = None
    """Straight and level flight before each line [m]; by default, with --forward-overlap, what the aircraft needs to
    roll out of a turn, else 0."""

    overshoot_m: float = 0.0
    """Straight and level flight after each line [m]."""


@dataclass(frozen=True)
class FieldOptions:
    """How the field's file is read, and what lines and turns keep to."""

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
        camera = camera.with_values(**{key: getattr(self, key) for key in _CAMERA_KEYS})
        name = printable(" ".join(camera.name.split()), NAME_LIMIT)
        found = replace(self, camera=name or None, **{key: getattr(camera, key) for key in _CAMERA_KEYS})
        if self.gsd_cm is None:
            return found
        if self.altitude_m is not None:
            raise _fault("--gsd", f"{self.gsd_cm:g}", "the size of a pixel beside the altitude", "one of the two")
        if not MIN_GSD_CM <= self.gsd_cm <= MAX_GSD_CM:
            expected = (
                f"centimetres from {MIN_GSD_CM:g} to {MAX_GSD_CM:g}: {self.gsd_cm:g} m are {100 * self.gsd_cm:g} cm"
            )
            raise _fault("--gsd", f"{self.gsd_cm:g}", f"{self.gsd_cm:g} cm a pixel", expected)
        width_mm, focal_mm, columns = found._needed("sensor_width_mm", "focal_length_mm", "image_width_px")
        # h = g n / (s / f): the altitude at which n pixels of the size g are as wide as the picture
        return replace(found, altitude_m=self.gsd_cm / 100 * columns / ground_m(width_mm, focal_mm, 1.0))

    def _needed(self, *keys: str) -> list[float]:
        """Values of the camera; a fault where one is not given, or out of range."""
        for key in keys:
            option, value = option_name(key), getattr(self, key)
            if value is None:
                expected = "--gsd or --altitude" if key == "altitude_m" else "a --camera that has it, or this option"
                raise _fault(option, "", f"the camera needs {option} too", expected)
            check_range(option, value, *_CAMERA_LIMITS[key], closed=key == "image_width_px")
        return [getattr(self, key) for key in keys]

    def _footprint_m(self, key: str, overlap: float = 0.0) -> float:
        """Ground that a picture adds beside its neighbour [m], less the overlap [%]; `key` is the sensor's size."""
        altitude_m, size_mm, focal_mm = self._needed("altitude_m", key, "focal_length_mm")
        if not (overlap == 0 or 1 <= overlap <= MAX_OVERLAP):
            name = "--side-overlap" if key == "sensor_width_mm" else "--forward-overlap"
            raise _fault(name, f"{overlap:g}", f"{overlap:g} %", f"percent from 1 to {MAX_OVERLAP:g}, as 70; or 0")
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
            raise _fault("--side-overlap", raw, f"{printable(raw, 40)}", expected)
        return (wanted[0] if wanted else None), acceptable

    @property
    def wanted_spacing_m(self) -> float | None:
        """Distance of lines whose pictures overlap as wanted [m]; None where nothing is."""
        wanted, _ = self._side_overlaps
        if wanted is None:
            return None
        return self._footprint_m("sensor_width_mm", wanted)

    def pictures(self, sensed_m: float, speed_mps: float) -> Pictures | None:
        """Those along lines of a length [m], the fastest at a ground speed [m/s]; None without a camera."""
        if self.sensor_width_mm is None or self.altitude_m is None:
            return None
        width_m, apart_m = self._footprint_m("sensor_width_mm"), self.picture_distance_m
        gsd_cm = None if self.image_width_px is None else 100 * width_m / self._needed("image_width_px")[0]
        return Pictures(
            camera=self.camera or "",
            altitude_m=self.altitude_m,
            width_m=width_m,
            gsd_cm=gsd_cm,
            distance_m=apart_m,
            forward_overlap=None if self.forward_overlap is None else self.forward_overlap / 100,
            number=None if apart_m is None else math.ceil(sensed_m / apart_m),
            interval_s=self.picture_interval_s or None,
            speed_mps=speed_mps,
        )

    @property
    def picture_length_m(self) -> float | None:
        """Ground in a picture along a line [m]; None where the sensor's height is not known."""
        if self.sensor_height_mm is None:
            return None
        return self._footprint_m("sensor_height_mm")

    @cached_property
    def picture_distance_m(self) -> float | None:
        """Distance between pictures along a line [m]; None where none are taken."""
        if self.forward_overlap is None:
            return None
        return self._footprint_m("sensor_height_mm", self.forward_overlap)


@dataclass(frozen=True)
class CoverageOptions(TerrainOptions, CameraOptions, FieldOptions, PathOptions):
    """Options of a coverage: in order those of the path, the field, the camera and the ground.

    Faults name them as the command `eadp cover` does.
    """

    @cached_property
    def line_swath_m(self) -> float:
        """Width of ground that a line covers beside its neighbours [m]: as given, or the camera's."""
        camera = (self.sensor_width_mm, self.focal_length_mm, self.side_overlap)
        if self.swath_m is None:
            if camera == (None, None, None):
                expected = "--swath, or --altitude or --gsd, and --camera"
                raise _fault("--swath", "", "no width of ground that a line covers", expected)
            return self._footprint_m("sensor_width_mm", self._side_overlaps[1])
        if self.sensor_width_mm is not None or self.side_overlap is not None:
            raise _fault("--swath", f"{self.swath_m:g}", "a swath beside that of the camera", "one of the two")
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
            raise _fault("--wind", _raw(self.wind or ""), message, f"less than its {speed:g} m/s; {per_hour}")
        check_range("--overshoot", self.overshoot_m, 0.0, MAX_LENGTH_M, closed=True)
        lead_in = self.lead_in_m
        if lead_in is None:
            rolls_m = 0.0 if self.forward_overlap is None else roll_out_m(airframe, speed + math.hypot(*wind_mps))
            lead_in = float(math.ceil(rolls_m))
        check_range("--lead-in", lead_in, 0.0, MAX_LENGTH_M, closed=True)
        return MotionLimits(swath, least, ideal, apart, speed, wind_mps, lead_in, self.overshoot_m)

    @property
    def heading_rad(self) -> float | None:
        """The mathematical heading (0 east, counter-clockwise) of the lines, if it is given."""
        if self.heading_deg is None:
            return None
        return course_rad("--heading", self.heading_deg)


class Pack(NamedTuple):
    """A full pack, the state of charge kept in it, and that with less of which the autopilot turns back."""

    battery: Battery
    reserve_soc: float
    turns_back_soc: float = 0.0

    @property
    def energy_wh(self) -> float:
        """What it gives before [Wh]."""
        kept = max(self.reserve_soc, self.turns_back_soc)
        return float((1 - kept) * self.battery.capacity_ah * self.battery.voltage_at((1 + kept) / 2))


@dataclass(frozen=True)
class CoveragePlan:
    """A plan that covers a field: its text, its report, the repairs made to the field, and the camera's pictures.

    `pack` is a full one of the aircraft, if it has one.
    """

    plan: Plan
    text: str
    report: CoverageReport
    repairs: Sequence[str]
    pictures: Pictures | None = None
    pack: Pack | None = None
    heights: Heights | None = None
    autopilot: Autopilot = dataclass_field(default_factory=Autopilot)

    @property
    def document(self) -> dict[str, Any]:
        """The values of `eadp.cover/1`."""
        own = {"side_overlap": self._side_overlaps, "batteries": self._batteries}
        ground = None if self.heights is None else HeightReport([self.heights], *self.on_ground).document()
        shown = self.report.document(self.repairs, self.text)
        return shown | own | pictures_document(self.pictures) | {"terrain": ground}

    @property
    def on_ground(self) -> tuple[float, float | None, float | None]:
        """Width of a picture or of a line's ground [m], distance of the lines [m], and size of a pixel [cm]."""
        shot, apart_m = self.pictures, self.report.least.spacing_m
        return (self.report.motion.swath_m, apart_m, None) if shot is None else (shot.width_m, apart_m, shot.gsd_cm)

    @property
    def _side_overlaps(self) -> list[float | None]:
        """Share of a line's ground that the next line shows too, at the finest spacing and at the coarsest."""
        return [self._overlap(end.spacing_m) for end in (self.report.full, self.report.least)]

    def _overlap(self, apart_m: float | None) -> float | None:
        return None if apart_m is None else 1 - apart_m / self.on_ground[0]

    @property
    def _batteries(self) -> list[float] | None:
        """Full packs, down to what is kept in them, for the path at the finest spacing and at the coarsest."""
        energies_wh = [end.energy_wh for end in (self.report.full, self.report.least) if end.energy_wh is not None]
        return [energy_wh / self.pack.energy_wh for energy_wh in energies_wh] or None if self.pack else None

    @property
    def lines(self) -> list[str]:
        """A summary for people, line by line."""
        camera = [] if self.pictures is None else self.pictures.lines()
        home_m = self.plan.site.home_altitude_m
        ground = [] if home_m is None else [HOME_TEXT.format(home_m)]
        if self.heights is not None:
            ground = HeightReport([self.heights], *self.on_ground).text()
        flight = [*self.report.text(), *self._climb_text(), *self._landing_text()]
        return [*flight, *camera, *self._overlap_text(), *ground, *self._batteries_text()]

    def _climb_text(self) -> list[str]:
        """The circles of the climb before the first line."""
        ways = itertools.takewhile(lambda leg: not leg.sensing, self.report.solution.path(0.0).legs)
        radii_m = [leg.piece.radius_m for leg in ways if leg.whole_circle]
        many = f"{len(radii_m)} circles" if len(radii_m) > 1 else "a circle"
        return [f"climb      {many} of {radii_m[0]:.0f} m radius before the first line"] if radii_m else []

    def _landing_text(self) -> list[str]:
        """The final approach."""
        last = self.plan.stages[-1]
        if not last.command(LAND):
            return []
        before = self.plan.stages[-2]  # which leads to its start
        length_m = math.dist(before.trigger_at(()), last.trigger_at(()))
        down_m = (before.altitude_m or 0.0) - (last.altitude_m or 0.0)
        ends = f" to {last.altitude_m:.0f} m" if last.altitude_m else ""
        circle = ", after a circle down to it" if before.command(LOITER_TO_ALTITUDE) else ""
        steep_deg = math.degrees(math.atan2(down_m, length_m))
        steep = self.autopilot.kind is None and steep_deg > FACTORY[PX4][LANDING_ANGLE] + 0.05
        px4 = f": PX4 needs {LANDING_ANGLE} {steep_deg:.1f}" if steep else ""
        how = f"final approach of {length_m:.0f} m from {before.altitude_m:g} m{ends}, {steep_deg:.1f}°"
        return [f"landing    {how}{circle}{px4}"]

    def _overlap_text(self) -> list[str]:
        """The overlap of neighbouring lines, and where it is always less."""
        shares = [f"{100 * share:.0f} %" for share in self._side_overlaps if share is not None]
        seam_m = self.report.seam_m
        seam = self._overlap(seam_m)
        where = "" if seam is None else f"; {100 * seam:.0f} %, {seam_m:.1f} m, in the middle of each block"
        return [f"overlap    {' to '.join(dict.fromkeys(shares))} from line to line{where}"] if shares else []

    def _batteries_text(self) -> list[str]:
        """How many packs the path takes."""
        if self._batteries is None or self.pack is None:
            return []
        packs = " to ".join(dict.fromkeys(f"{count:.2g}" for count in self._batteries))
        until = "its reserve" if self.pack.turns_back_soc <= self.pack.reserve_soc else "the autopilot turns back"
        return [f"batteries  {packs}; a full one gives {self.pack.energy_wh:.3g} Wh before {until}"]


@dataclass(frozen=True)
class CoverageTask:
    """A field to cover: as its file, the options and the aircraft have it.

    Attributes
    ----------
    file : str
        Name of the field's file.
    field : Field
    repairs : sequence of str
        Repairs made to the field.
    options : CoverageOptions
    motion : MotionLimits
    vehicle : str
        Name of the aircraft, '' if it has none.
    airframe : Airframe
        For the airspeed, and the power of the motion in level flight.
    profile : profile or None
        Its computations run over the field; with it, or with a pack, the report has the energy.
    pack : Pack or None
    autopilot : Autopilot
        For the landings that it accepts.
    circles_first : bool
        Whether a climb circles up until it is above obstacles near home that the altitude clears; else the path stays
        out of them.
    """

    file: str
    field: Field
    repairs: Sequence[str]
    options: CoverageOptions
    motion: MotionLimits
    vehicle: str
    airframe: Airframe
    profile: AnyProfile | None = None
    pack: Pack | None = None
    autopilot: Autopilot = dataclass_field(default_factory=Autopilot)
    circles_first: bool = False

    @classmethod
    def read(
        cls,
        path: str,
        options: CoverageOptions,
        vehicle: str,
        airframe: Airframe,
        wind_mps: Point,
        profile: AnyProfile | None = None,
        pack: Pack | None = None,
        autopilot: Autopilot | None = None,
    ) -> CoverageTask:
        """Read a field's file, `-` for standard input; `wind_mps` (east, north) holds unless the options have one.

        Raises
        ------
        InputError
            Of the options and of the file.
        """
        motion = options.motion(airframe, wind_mps)
        if options.altitude_m is not None:
            check_range("--altitude", options.altitude_m, 0, MAX_ALTITUDE_M)
        check_range("--clearance", options.clearance_m, 0, MAX_ALTITUDE_M, closed=True)
        if not has_pattern(options.pattern):
            raise _fault("--pattern", options.pattern, "is no pattern", one_of(PATTERNS, options.pattern))
        text = read_field_text(path)
        field, repairs = read_field(text, metres=options.metres, feature=options.feature)
        field, notes = _limited(field, options)
        notes, flies = [*repairs, *notes], autopilot or Autopilot()
        return cls(text.name, field, notes, options, motion, vehicle, airframe, profile, pack, flies)

    @property
    def extent_m(self) -> float:
        """The greater extent of the field, to the east or to the north [m]."""
        x, y = zip(*(vertex for part in self.field.parts for vertex in part[0]), strict=True)
        return float(max(max(x) - min(x), max(y) - min(y)))

    @cached_property
    def terrain(self) -> TerrainTask | None:
        """The ground to follow, if one is given. Raises InputError of its files and options."""
        options = self.options
        ends = _point("--start", options.start, self.field), self.home_m
        return TerrainTask.read(options, options.altitude_m, options.clearance_m, self.field, ends)

    @cached_property
    def home_m(self) -> Point | None:
        """Where the flight takes off and returns to."""
        found = _point("--home", self.options.home, self.field)
        return self.landing[:2] if found is None and self.landing is not None else found

    @property
    def from_ground(self) -> bool:
        """Whether the flight takes off at home."""
        return self.home_m is not None and self.options.start is None

    @cached_property
    def landing(self) -> Pose | None:
        """Where the flight lands, and on which course."""
        if self.options.landing is None:
            return None
        return landing_pose(self.options.landing, lambda raw: _place("--landing", raw, self.field))

    @cached_property
    def climb_out(self) -> CoverageLeg | None:
        """The climb straight ahead after take-off; None where no direction is known."""
        options, given = self.options, self.options.takeoff_deg
        if given is None and (options.landing is None or options.start is not None or self.motion.windless):
            return None
        if self.home_m is None or options.start is not None:
            raise _fault("--takeoff", f"{given}", "no home to take off from", "--home, and no --start")
        east, north = self.motion.wind_mps
        course = math.atan2(-north, -east) if given is None else course_rad("--takeoff", given)
        return CoverageLeg(climb_out(self.home_m, course, min(CLIMB_OUT_M, self._altitude_m), self.airframe, self._air))

    @cached_property
    def final(self) -> FinalApproach | None:
        """The final approach; None without a landing. Raises Infeasible, with a heading on which there is one."""
        if self.landing is None:
            return None
        course = self.landing[2]
        try:
            return self._final_on(course)
        except Infeasible as error:
            works = "another place, or less altitude"
            others = [course + math.radians(turn_deg) for turn_deg in TURNS_DEG]
            # headings with the wind behind last
            for other in sorted(others, key=lambda each: behind_mps(each, self.motion.wind_mps) > 0):
                with suppress(Infeasible):
                    self._final_on(other)
                    works = f"a heading of {compass_deg(other) % 360:.0f}°, or {works}"
                    break
            raise Infeasible(str(error), works) from None

    def _final_on(self, course: float) -> FinalApproach:
        """The final approach on a course [rad]: from the plan's altitude, else from less by a circle before it.

        Raises Infeasible, of the first one tried.
        """
        failures: list[Infeasible] = []
        whole_m, straight_in = self._altitude_m, None
        steps = range(math.ceil(whole_m / LOWER_M) - 1, math.ceil(MIN_APPROACH_M / LOWER_M) - 1, -1)
        for slope in approach_slopes(self.autopilot):
            for height_m in (whole_m, *(LOWER_M * step for step in steps)):
                try:
                    found = self._checked(course, slope, height_m)
                except Infeasible as error:
                    failures.append(error)
                    continue
                if found.circle is not None or (height_m == whole_m and self.terrain is None):
                    return found
                if height_m == whole_m:
                    straight_in = straight_in or found
            if straight_in is not None:
                return straight_in
        raise failures[0]

    def _checked(self, course: float, slope: float, height_m: float) -> FinalApproach:
        """A final approach that is free, reached and clear of the ground, with a circle if one is. Raises."""
        assert self.landing is not None
        x, y, _ = self.landing
        way = approach((x, y, course), height_m, self.airframe, self._air, slope)
        final = FinalApproach(CoverageLeg(way), height_m)
        request = self._request(final)
        request.check()
        check_access(request)
        ground = None
        if self.terrain is not None:
            ground = self.terrain.ground(self.field, self.motion, self.motion.swath_m, (x, y))
            self.terrain.check_approach(final, ground)
        space = replace(request, airspace=self._airspace(final)).space  # it leads down to obstacles near home
        circles = free_circles(final.leg.start, held_up_m(self.motion.min_radius_m), space)
        return final._replace(
            circle=next((each for each in circles if ground is None or clear_circle(each, final, ground)), None)
        )

    @property
    def _air(self) -> Air:
        return Air(self.motion.airspeed_mps, self.motion.wind_mps)

    @property
    def _altitude_m(self) -> float:
        altitude_m = self.options.altitude_m
        return self.airframe.cruise_altitude_m if altitude_m is None else altitude_m

    @cached_property
    def airspace(self) -> Airspace:
        """What is in the way: not obstacles lower than the plan's altitude, and a climb from home, by the clearance."""
        return self._airspace(self.final, circled=self.circles_first)

    def _airspace(self, final: FinalApproach | None, *, circled: bool = False) -> Airspace:
        """As `airspace`, with a final approach; with `circled` after a climb on circles."""
        given, altitude_m, airframe = self.field.airspace, self.options.altitude_m, self.airframe
        if altitude_m is None or isinstance(airframe, PaperVehicle):
            return given
        reached_m, slopes = [altitude_m] * len(given.obstacles), list[tuple[Point, float]]()
        if self.home_m is not None and not circled:
            # a climb from home with the wind behind, straight to the obstacle
            climb_mps = airframe.climb_rates_mps(self.motion.airspeed_mps)[0]
            slopes.append((self.home_m, climb_mps / self.motion.ground_limit_mps))
        if final is not None:
            slopes.append((final.leg.end[:2], final.height_m / final.leg.piece.length_m))
        for point, slope in slopes if given.obstacles else ():
            from eadp.core.geometry.polygons import distances_m

            ways_m = distances_m([each.outline for each in given.obstacles], point).tolist()
            reached_m = [min(there_m, slope * way_m) for there_m, way_m in zip(reached_m, ways_m, strict=True)]
        high = [
            each
            for each, there_m in zip(given.obstacles, reached_m, strict=True)
            if each.height_m is None or each.height_m > there_m - self.options.clearance_m
        ]
        return given._replace(obstacles=tuple(high))

    @property
    def flown_over(self) -> list[str]:
        """What is said of obstacles that are flown over."""
        over = [each for each in self.field.airspace.obstacles if each not in self.airspace.obstacles]
        highest = max(over, key=lambda each: each.height_m or 0.0, default=None)
        if highest is None:
            return []
        many = "an obstacle is" if len(over) == 1 else f"{len(over)} obstacles are"
        return [
            f"{many} flown over at {self.options.altitude_m:g} m, the highest {highest.name} of {highest.height_m:g} m"
        ]

    @cached_property
    def request(self) -> CoverageRequest:
        """The coverage of the whole field."""
        return self._request(self.final)

    def _request(self, final: FinalApproach | None) -> CoverageRequest:
        """As `request`, with a final approach."""
        options = self.options
        ends = _point("--start", options.start, self.field) or self.home_m, self.home_m
        apart = options.wanted_spacing_m if options.spacing_m is None else options.spacing_m
        pattern, lands = options.pattern, self.landing is not None
        if self.terrain is not None:
            pattern = self.terrain.pattern(pattern, self.field, lands=lands)
        return CoverageRequest(
            self.field,
            self.motion,
            pattern,
            options.heading_rad,
            *ends,
            apart,
            airspace=self._airspace(final, circled=self.circles_first),
            climb_out=self.climb_out,
            approach=None if final is None else final.leg,
            climb_s=self._climb_s,
        )

    @cached_property
    def _climbing(self) -> Climbing | None:
        """How the aircraft climbs from the ground and descends to it; None where it holds its own altitude."""
        if self.options.altitude_m is None or isinstance(self.airframe, PaperVehicle):
            return None
        return Climbing(*self.airframe.climb_rates_mps(self.motion.airspeed_mps), self.airframe.altitude_gain_per_s)

    @property
    def _climb_s(self) -> float:
        """Time of the climb from home to the height of the lines above it [s]; 0 where none is known."""
        if self._climbing is None or not self.from_ground or self._climbing.up_mps <= 0:
            return 0.0
        return self._climbing.reached_s(self._altitude_m)

    @cached_property
    def _low_space(self) -> FreeSpace | None:
        """Where circles may lie before the altitude is reached; None for everywhere."""
        airspace = self._airspace(self.final)
        return airspace.free_space(CLEARANCE_SHARE * self.motion.min_radius_m) if any(airspace) else None

    def _with_circles(self, solution: CoverageSolution, ground: Ground | None) -> CoverageSolution:
        """A path with the circles of its climb before the first line, and on level ground of its descent to land."""
        motion, climbing, final = self.motion, self._climbing, self.final
        if climbing is None:
            return solution
        if final is not None and final.circle is not None and ground is None:
            count = final.circles(self._altitude_m - final.height_m, climbing, motion)
            circle = replace(final.circle, altitude_m=final.height_m)
            solution = with_circles(solution, len(solution.sections) - 1, circle, count, motion)
        if not self._climb_s:
            return solution
        low = [each for each in self._airspace(self.final).obstacles if each not in self.airspace.obstacles]

        def lack(tried: CoverageSolution) -> Lack:
            """What the climb of a path lacks."""
            if ground is None:
                late_s, until_m = level_lack(tried, motion, self._climb_s)
                return Lack(max(late_s, late_over_s(tried, low, motion, climbing, self.options.clearance_m)), until_m)
            return climb_lack(tried, ground, climbing, 0.0)

        return climbed_first(solution, motion, self._low_space, lack)

    @cached_property
    def circled(self) -> CoverageTask | None:
        """The task with circles up to obstacles near home; None where these change nothing."""
        if self.terrain is not None or not self._climb_s:
            return None
        found = replace(self, circles_first=True)
        return None if found.airspace == self.airspace else found

    def best(self) -> tuple[CoverageTask, CoveragePlan]:
        """The plan of the quickest path found; it circles above obstacles near home where that covers more, or is less.

        Raises
        ------
        Infeasible
        """
        found, failures = list[tuple[CoverageTask, CoveragePlan]](), list[Infeasible]()
        for task in (self, self.circled):
            if task is None:
                continue
            try:
                found.append((task, task.planned(task.solution())))
            except Infeasible as error:
                failures.append(error)
        if not found:
            raise failures[0]
        return min(found, key=lambda each: (-round(each[1].report.least.coverage, 4), each[1].report.full.time_s))

    def solution(self) -> CoverageSolution:
        """The quickest path found. Raises Infeasible."""
        return cover_field(self.request)

    def planned(self, solution: CoverageSolution, field: Field | None = None) -> CoveragePlan:
        """The plan of a path over the field, or over a part of it, which circles up to its first line."""
        field, options, motion, ground = field or self.field, self.options, self.motion, None
        home_m = self.home_m or solution.path(0.0).legs[0].start[:2]
        if self.terrain is not None:
            ground = self.terrain.ground(field, motion, self.request.order_spacing_m or motion.swath_m, home_m)
        solution = self._with_circles(solution, ground)
        distance_m, computations = options.picture_distance_m, _computations(self.profile, options.turns_off)
        sensed_m = sum(leg.piece.length_m for leg in solution.path(0.0).legs if leg.sensing)
        pictures = options.pictures(sensed_m, motion.max_line_speed_mps(solution.heading_rad))
        parts = [tuple(map(_millimetres, part)) for part in field.parts]
        takeoff, ending = None, None
        if self.from_ground:
            # a height of 0 is that of the plan
            up_m = 0.0 if self.climb_out is None else min(CLIMB_OUT_M, self._altitude_m)
            takeoff, ending = _command(TAKEOFF, up_m), _command(RETURN)
        name = printable(" ".join(field.name.split()), NAME_LIMIT)
        covered = Field(parts[0][0], parts[0][1:], name, others=tuple(parts[1:]))
        flown, heights, sited = solution, None, field
        altitude_m = None if options.altitude_m is None else round(options.altitude_m, 3)
        if ground is not None:
            if options.turns_off and not solution.blocks:
                split = (part for leg in solution.path(0.0).legs for part in leg.split())
                flown = replace(solution, sections=tuple(split))
            climbing = climbing_over(ground, self.airframe)
            flown, heights = with_heights(
                flown, ground, home_m, climbing, from_ground=self.from_ground, lands=self.final
            )
            altitude_m, sited = heights.profile.commanded_m[0], heights.on_ground(field)
        if self.landing is not None:
            ending = _command(LAND, 0.0 if heights is None else heights.profile.commanded_m[-1])
        on_and_off = None if distance_m is None else (_pictures(distance_m), _pictures(0.0))
        plan = build_plan(
            flown,
            name=self.file,
            computations=computations,
            min_radius_m=motion.min_radius_m,
            site=_site(sited, covered, motion, self.home_m, self.vehicle)._replace(
                camera=_survey_camera(pictures),
                ground_m=None if heights is None else heights.profile.ground.zero_m,
                home_altitude_m=None if heights is None or self.home_m is None else heights.home_altitude_m,
                clearance_m=options.clearance_m,
            ),
            altitude_m=altitude_m,
            commands=PlanCommands(on_and_off, takeoff, ending),
        )
        if heights is None and self.home_m is not None and altitude_m is not None:
            legs = nominal_legs(plan, [plan.hull(i).hi for i in range(len(plan.parameters))])
            clear_m = clear_home_m(plan, legs, self.home_m, self.airframe)
            plan = replace(plan, site=plan.site._replace(home_altitude_m=clear_m))
        report = CoverageReport.of(replace(field, airspace=self.airspace), motion, solution)
        comments = "".join(f"% {line}\n" for line in report.comments(printable(self.file, 100)))
        notes = [*self.repairs, *self.flown_over]
        text = comments + plan_text(plan)
        return CoveragePlan(plan, text, report, notes, pictures, self.pack, heights, self.autopilot)


def _site(field: Field, covered: Field, motion: MotionLimits, home: Point | None, vehicle: str) -> Site:
    """What the plan carries of its mission."""
    obstacles = tuple(each._replace(outline=_millimetres(each.outline)) for each in field.airspace.obstacles)
    airspace = Airspace(obstacles, tuple(map(_millimetres, field.airspace.boundary)))
    wind_mps = math.hypot(*motion.wind_mps)
    from_deg = compass_deg(math.atan2(-motion.wind_mps[1], -motion.wind_mps[0])) if wind_mps else 0.0
    made_for = MadeFor(vehicle, motion.airspeed_mps, round(wind_mps, 3), round(from_deg, 1) % 360)
    home_m = None if home is None else _millimetres((home,))[0]
    return Site(field.origin_deg, None, covered, motion.swath_m, home_m, airspace, made_for)


def _survey_camera(pictures: Pictures | None) -> SurveyCamera | None:
    """What the plan carries of its pictures."""
    if pictures is None:
        return None
    gsd_cm = None if pictures.gsd_cm is None else round(pictures.gsd_cm, 6)
    return SurveyCamera(pictures.camera, round(pictures.altitude_m, 3), gsd_cm)


def _millimetres(points: Sequence[Point]) -> tuple[Point, ...]:
    return tuple((round(x, 3), round(y, 3)) for x, y in points)


def _pictures(distance_m: float) -> tuple[float, ...]:
    """The command to take a picture every so many metres; 0 for none."""
    return (TRIGGER_DISTANCE, round(distance_m, 6), 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)


def _command(command: int, height_m: float = 0.0) -> tuple[float, ...]:
    """A command that has a height alone [m]."""
    return (command, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)


def _limited(field: Field, options: CoverageOptions) -> tuple[Field, list[str]]:
    """The field with its obstacles and its boundary, and notes on what was left out of these."""
    avoid, inside = (None if path is None else read_field_text(path) for path in (options.avoid, options.inside))
    given, notes = read_airspace(avoid, inside, field.origin_deg, field.middle_m, metres=options.metres)
    holes = [hole for part in field.parts for hole in part[1:]] if options.holes == "avoid" else ()
    named = [Obstacle(hole, f"hole {i}") for i, hole in enumerate(holes, 1)]
    airspace = Airspace((*field.airspace.obstacles, *given.obstacles, *named), given.boundary)
    return replace(field, airspace=airspace), [f"{printable(note.file)}: {note.message}" for note in notes]


def wind_vector_mps(given: Pair) -> Point:
    """The wind's vector (east, north), of its speed and the compass bearing that it blows from."""
    speed, from_deg = _two_numbers("--wind", given, "a speed [m/s] and a bearing [°], like 5,270 for a west wind")
    if speed < 0:
        raise _fault("--wind", _raw(given), f"a speed of {speed:g}", "0 or more")
    if abs(from_deg) > 360:
        raise _fault("--wind", _raw(given), f"a bearing of {from_deg:g}°", "0 to 360: where the wind comes from")
    return velocity_mps(speed, blowing_to_rad(from_deg))


def _point(option: str, given: Pair | None, field: Field) -> Point | None:
    return None if given is None else _place(option, given, field)


def _place(option: str, given: Pair, field: Field) -> Point:
    """A point in the field's coordinates: metres, or latitude and longitude if the field was given in degrees."""
    if field.origin_deg is None:
        point = _two_numbers(option, given, "X,Y in metres, like -50,20")
    else:
        expected = "LAT,LON in degrees, like 55.37,10.43"
        lat, lon = _two_numbers(option, given, expected)
        if not (abs(lat) <= 90 and abs(lon) <= 180):
            raise _fault(option, _raw(given), "no latitude and longitude", expected)
        point = to_local_m(lat, lon, field.origin_deg)
    distance_m = min(math.dist(point, vertex) for part in field.parts for vertex in part[0])
    if distance_m > MAX_DISTANCE_M:
        message, expected = f"{distance_m / 1000:.0f} km from the field", f"{MAX_DISTANCE_M / 1000:g} km or less"
        if field.origin_deg is not None:
            message += f", which is at {place_text(field.origin_deg)}"
            expected += "; LAT,LON in that order"
            if math.dist((lon, lat), field.origin_deg) < NEAR_DEG:
                expected = "LAT,LON in that order: here or in the field's file they are swapped"
        raise _fault(option, _raw(given), message, expected)
    if not field.airspace.admits(point):
        message = "lies in an obstacle or beyond the boundary"
        raise _fault(option, _raw(given), message, "a place that may be flown over")
    return point


def _raw(given: Pair) -> str:
    return given if isinstance(given, str) else f"{given[0]},{given[1]}"


def _two_numbers(option: str, given: Pair, expected: str) -> Point:
    try:
        first, second = (float(word) for word in _raw(given).replace(",", " ").replace("@", " ").split())
    except ValueError:
        first = second = math.nan
    if not (math.isfinite(first) and math.isfinite(second)):
        raise _fault(option, _raw(given), "not two numbers", expected)
    return first, second


def _fault(option: str, raw: str, message: str, expected: str) -> InputError:
    return InputError.at(option, 1, 1, message, expected, raw)


def _computations(profile: AnyProfile | None, off_on_turns: bool) -> FieldComputations:
    """The computations of a profile, over the range that it measures, in whole numbers if it has any."""
    if profile is None:
        return FieldComputations()
    sets = []
    for name in profile.names:
        lo, hi = profile.range_of(name)
        lo = max(lo, 0.0)  # bounds of computations are 0 or more
        whole = float(math.ceil(lo)), float(math.floor(hi))
        sets.append(Box(*whole) if whole[0] <= whole[1] else Box(lo, hi))
    return FieldComputations(tuple(zip(profile.names, profile.units, strict=True)), tuple(sets), off_on_turns)


def flight_keys(task: CoverageTask, vehicle: File | None) -> dict[str, Any]:
    """Keys of a scenario with which what a task plans is flown: its aircraft, its airspeed and its wind."""
    keys: dict[str, Any] = {} if vehicle is None else {"vehicle": str(vehicle)}
    if task.options.airspeed_mps is not None:
        keys["vehicle.airframe.airspeed_mps"] = task.options.airspeed_mps
    if task.options.wind is not None:
        east, north = task.motion.wind_mps
        from_deg = compass_deg(math.atan2(-north, -east))
        keys |= {"wind.speed_mps": math.hypot(east, north), "wind.from_deg": round(from_deg, 6)}
    return keys


def held_at(plan: Plan, path: Literal["lo", "hi"], computations: Literal["lo", "hi"]) -> Plan:
    """A plan whose parameters are fixed at ends of their sets: those of the path, and those of the computations."""
    ends = [path if i < plan.path_count else computations for i in range(len(plan.parameters))]
    fixed = [[getattr(box, end) for box, end in zip(stage.sets, ends, strict=True)] for stage in plan.stages]
    stages = [
        replace(stage, sets=tuple(Box(value, value) for value in values))
        for stage, values in zip(plan.stages, fixed, strict=True)
    ]
    return replace(plan, stages=tuple(stages))


def cover(
    field: File,
    options: CoverageOptions,
    profile: File | AnyProfile | None = None,
    scenario: File | None = None,
    *,
    vehicle: File | None = None,
    warn: Warn = python_warnings,
) -> CoveragePlan:
    """Plan the coverage of a field: from its outline to a plan whose line spacing can vary in flight.

    Parameters
    ----------
    field : path
        Outline: GeoJSON, KML or CSV of vertices.
    options : CoverageOptions
        The turning radius and the swath, and what else is prescribed.
    profile : path or profile, optional
        The plan gets its computations, and the report the energy; by default the scenario's.
    scenario : path, optional
        For the vehicle, the wind and the energy.
    vehicle : path, optional
        The aircraft, instead of the scenario's.
    warn : function, optional

    Raises
    ------
    Infeasible
        If no path of this pattern covers the field.
    InputError
        With the faults of the files, or of an option under its name on the command line.
    """
    task = coverage_task(str(field), options, profile, scenario, vehicle, warn)
    task, found = task.best()
    if task.profile is not None or task.pack is not None:
        keys, given = flight_keys(task, vehicle) | {"parameters": None}, None if scenario is None else str(scenario)
        turns_back_soc = [0.0]

        def energy_wh(c1: float) -> float | None:
            """As forecast, with every computation at its highest."""
            plan = held_at(found.plan, "lo" if c1 < 0 else "hi", "hi")
            forecast = load_flight(plan, scenario=given, profile=profile, overrides=keys).preflight(whole=False)
            if forecast is None:
                return None
            turns_back_soc.append(forecast.turns_back_soc)
            return forecast.forecast.energy_wh

        try:
            report = found.report.with_energy(energy_wh)
            pack = found.pack and found.pack._replace(turns_back_soc=max(turns_back_soc))
            found = replace(found, report=report, pack=pack)
        except InputError as error:
            # the path takes vehicle and wind alone from a scenario, which may be of another plan
            if any(fault.file not in (given, *(f"--set {key}" for key in keys)) for fault in error.faults):
                raise
            first = error.faults[0]
            warn([replace(first, message=f"no energy is stated: {first.message}", severity="note")])
    warn(picture_warnings(found.pictures))
    return found


def picture_warnings(pictures: Pictures | None) -> list[Fault]:
    """Warnings about pictures that the camera may be too slow for."""
    return [] if pictures is None else _warnings(interval_doubts(pictures))


def coverage_task(
    field: str,
    options: CoverageOptions,
    profile: File | AnyProfile | None,
    scenario: File | None,
    vehicle: File | None,
    warn: Warn,
    *,
    cruises: bool = False,
) -> CoverageTask:
    """A field to cover, with the aircraft and the wind of a scenario; warns of turns that are too tight.

    With `cruises` the altitude is that of the aircraft, unless the options have one.
    """
    setting = read_scenario(None if scenario is None else str(scenario))
    if profile is None:
        profile, found = profile_of_scenario(setting)
        warn(found)
    if isinstance(profile, str | PathLike):
        profile = read_profile(profile, warn=warn)
    if options.turns_off and profile is None:
        message = "no computations to stop on turns; --profile names some"
        warn([Fault("--turns-off", 1, 1, message, severity="note")])
    flown = setting.keys.vehicle if vehicle is None else read_vehicle(read_text(str(vehicle)))
    options = options.with_camera()
    if (cruises or options.landing is not None or options.takeoff_deg is not None) and options.altitude_m is None:
        options = replace(options, altitude_m=flown.airframe.cruise_altitude_m)
    pack = None
    if vehicle is not None or "battery" in setting.chosen:
        battery = flown.battery if vehicle is not None else setting.keys.battery
        pack = Pack(battery, setting.keys.reserve_soc)
    wind_mps = setting.keys.wind.steady_mps
    if (vehicle is not None or "vehicle" in setting.chosen) and not isinstance(flown.airframe, PaperVehicle):
        faults = replace(flown.airframe, airspeed_mps=options.airspeed_mps or flown.airframe.airspeed_mps).faults()
        where = "--airspeed" if options.airspeed_mps else str(vehicle or scenario)
        refuse([Fault(where, 1, 1, fault, "an aeroplane that can fly so") for fault in faults])
    autopilot = setting.keys.autopilot
    task = CoverageTask.read(field, options, flown.name, flown.airframe, wind_mps, profile, pack, autopilot)
    if task.terrain is None and task.extent_m > FLAT_M:
        message = f"the ground is taken as flat over {task.extent_m / 1000:.1f} km; --terrain has its heights"
        warn([Fault(task.file, 1, 1, message, severity="note")])
    speed_mps = math.hypot(*task.motion.wind_mps)
    if tight := too_tight(flown.airframe, task.motion.airspeed_mps, task.motion.min_radius_m, speed_mps):
        warn([Fault("--min-radius", 1, 1, tight, severity="warning")])
    warn(_warnings(_doubts(task)))
    if task.landing is not None:
        warn(behind_warning(task.landing[2], task.motion.wind_mps))
    return task


def _warnings(doubts: Iterable[Doubt]) -> list[Fault]:
    return [Fault(key, 1, 1, message, expected, severity="warning") for key, message, expected in doubts]


def _doubts(task: CoverageTask) -> Iterator[Doubt]:
    """What may be meant otherwise than it is written."""
    options = task.options
    yield from angle_doubts("--heading", options.heading_deg)
    if options.wind is not None:
        yield from angle_doubts("--wind", _two_numbers("--wind", options.wind, "")[1])
    yield from angle_doubts("--takeoff", options.takeoff_deg)
    if task.landing is not None:
        yield from angle_doubts("--landing", round(compass_deg(task.landing[2]), 9))
    camera = options.altitude_m, options.sensor_width_mm, options.focal_length_mm
    yield from shot_doubts(Shots(*camera, options.gsd_cm))
