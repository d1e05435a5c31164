"""The use case of `eadp cover`: a field, an aircraft and computations in, a plan and its report out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from eadp.core.geometry.bearings import blowing_to_rad, heading_rad
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import to_local_m
from eadp.coverage.cover import AUTO, CoverageRequest, cover
from eadp.coverage.plan_builder import FieldComputations, build_plan
from eadp.coverage.report import CoverageReport, PowerDraw
from eadp.coverage.swaths import RADIUS_SHARE, SPACING_SHARE, MotionLimits
from eadp.errors import EadpError, InputError, printable
from eadp.io.field.kmz import read_field_text
from eadp.io.field.reader import read_field, read_zones
from eadp.io.plan.writer import plan_text
from eadp.models.computing import Computing, join_profile
from eadp.models.field import Field
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box
from eadp.models.profile_sum import AnyProfile
from eadp.models.vehicle import Airframe

MIN_RADIUS_M = 0.1
MAX_LENGTH_M = 1e5
MAX_AIRSPEED_MPS = 1e3
MAX_DISTANCE_M = 50_000.0
"""Largest distance of the start and home points from the field [m]."""

Pair = str | Point
"""Two numbers, or the text of two numbers."""


@dataclass(frozen=True)
class CoverageOptions:
    """Options of a coverage. Faults name them as the command `eadp cover` does."""

    min_radius_m: float
    """Smallest turning radius of the aircraft [m]."""

    swath_m: float
    """Width of ground that a line covers [m]."""

    radius_m: float | None = None
    """Ideal turning radius [m]; by default 1.5 times the smallest."""

    spacing_m: float | None = None
    """Distance of the lines [m]; by default half the swath for Zamboni-like laps, else the swath."""

    heading_deg: float | None = None
    """Compass bearing of the lines [°]; by default the quickest."""

    pattern: str = AUTO
    """`zamboni`, `dubins`, or `auto`, the shorter."""

    start: Pair | None = None
    """Where the flight starts: x, y [m], or latitude, longitude [°] of a field in degrees."""

    home: Pair | None = None
    """Where the flight ends, as `start`."""

    wind: Pair | None = None
    """Speed of the wind [m/s], and the bearing it blows from [°]; by default the scenario's."""

    airspeed_mps: float | None = None
    """Airspeed [m/s]; by default that of the scenario's vehicle."""

    turns_off: bool = False
    """Whether the computations stop on turns."""

    metres: bool = False
    """Whether the field is in local metres and not degrees."""

    feature: str | None = None
    """Which polygon of a file that holds several: id, name or number."""

    avoid: str | None = None
    """File of polygons that lines and turns stay out of."""

    inside: str | None = None
    """File of polygons that lines and turns stay inside of."""

    avoid_holes: bool = False
    """Whether lines and turns stay out of the field's holes, too."""

    def motion(self, airspeed_mps: float, wind_mps: Point) -> MotionLimits:
        """The limits of the motion; the airspeed and the wind given here hold where the options have none."""
        ideal = min(RADIUS_SHARE * self.min_radius_m, MAX_LENGTH_M) if self.radius_m is None else self.radius_m
        apart = SPACING_SHARE * self.swath_m if self.spacing_m is None else self.spacing_m
        speed = airspeed_mps if self.airspeed_mps is None else self.airspeed_mps
        for option, value, low, high, closed in (
            ("--min-radius", self.min_radius_m, MIN_RADIUS_M, MAX_LENGTH_M, True),
            ("--swath", self.swath_m, 0.0, MAX_LENGTH_M, False),
            ("--radius", ideal, self.min_radius_m, MAX_LENGTH_M, True),
            ("--spacing", apart, 0.0, self.swath_m, False),
            ("--airspeed", speed, 0.0, MAX_AIRSPEED_MPS, False),
        ):
            if not (low < value <= high or (closed and value == low)):
                expected = f"from {low:g} to {high:g}" if closed else f"above {low:g}, at most {high:g}"
                raise _fault(option, f"{value:g}", f"{value:g} is out of range", expected)
        if self.wind is not None:
            wind_mps = wind_vector_mps(self.wind)
        if math.hypot(*wind_mps) >= speed:
            message = f"a wind of {math.hypot(*wind_mps):g} m/s, no slower than the aircraft"
            raise _fault("--wind", _raw(self.wind or ""), message, f"less than its {speed:g} m/s")
        return MotionLimits(self.swath_m, self.min_radius_m, ideal, apart, speed, wind_mps)

    @property
    def heading_rad(self) -> float | None:
        """The mathematical heading (0 east, counter-clockwise) of the lines, if it is given."""
        if self.heading_deg is None:
            return None
        if not math.isfinite(self.heading_deg):
            raise _fault("--heading", f"{self.heading_deg}", "no heading", "a compass bearing [°]: 0 north, 90 east")
        return heading_rad(self.heading_deg)


@dataclass(frozen=True)
class CoveragePlan:
    """A plan that covers a field: the plan, its text, its report, and the repairs made to the field."""

    plan: Plan
    text: str
    report: CoverageReport
    repairs: Sequence[str]

    @property
    def document(self) -> dict[str, Any]:
        """The values of `eadp.cover/1`."""
        return self.report.document(self.repairs, self.text)


def plan_coverage(
    path: str, options: CoverageOptions, airframe: Airframe, wind_mps: Point, profile: AnyProfile | None = None
) -> CoveragePlan:
    """The quickest path found that covers a field, as a plan.

    Parameters
    ----------
    path : str
        The field's file, `-` for standard input.
    options : CoverageOptions
    airframe : Airframe
        For the airspeed, and the power of the motion in level flight.
    wind_mps : pair of float
        The wind (east, north) [m/s], unless the options have one.
    profile : profile, optional
        Its computations run over the field; with it the report has the energy.

    Raises
    ------
    Infeasible
        If no path covers the field.
    InputError
        Of the options and of the file, and if the profile does not measure whole settings.
    """
    motion = options.motion(airframe.airspeed_mps, wind_mps)
    text = read_field_text(path)
    field, repairs = read_field(text, metres=options.metres, feature=options.feature)
    field = _limited(field, options)
    start, home = _point("--start", options.start, field), _point("--home", options.home, field)
    request = CoverageRequest(
        field, motion, options.pattern, options.heading_rad, start, home, order_spacing_m=options.spacing_m
    )
    computations = _computations(profile, options.turns_off)
    solution = cover(request)
    plan = build_plan(
        solution,
        name=text.name,
        computations=computations,
        min_radius_m=motion.min_radius_m,
        origin_deg=field.origin_deg,
    )
    power = None if profile is None else _power(plan, profile, airframe.cruise_power_w, computations)
    report = CoverageReport.of(field, motion, solution, power)
    comments = "".join(f"% {line}\n" for line in report.comments(printable(text.name, 100)))
    return CoveragePlan(plan, comments + plan_text(plan), report, repairs)


def _limited(field: Field, options: CoverageOptions) -> Field:
    """The field with its obstacles and its boundary."""
    avoid, inside = (
        () if path is None else read_zones(read_field_text(path), field, metres=options.metres)
        for path in (options.avoid, options.inside)
    )
    holes = [hole for part in field.parts for hole in part[1:]] if options.avoid_holes else ()
    return replace(field, obstacles=(*field.obstacles, *avoid, *holes), boundary=inside)


def wind_vector_mps(given: Pair) -> Point:
    """The wind's vector (east, north), of its speed and the compass bearing that it blows from."""
    speed, from_deg = _two_numbers("--wind", given, "a speed [m/s] and a bearing [°], like 5,270 for a west wind")
    if speed < 0:
        raise _fault("--wind", _raw(given), f"a speed of {speed:g}", "0 or more")
    angle = blowing_to_rad(from_deg)
    return speed * math.cos(angle), speed * math.sin(angle)


def _point(option: str, given: Pair | None, field: Field) -> Point | None:
    """A point in the field's coordinates: metres, or latitude and longitude if the field was given in degrees."""
    if given is None:
        return None
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
        expected = f"{MAX_DISTANCE_M / 1000:g} km or less (LAT,LON in that order, or X,Y)"
        raise _fault(option, _raw(given), f"{distance_m / 1000:.0f} km from the field", expected)
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


def _power(plan: Plan, profile: AnyProfile, cruise_power_w: float, computations: FieldComputations) -> PowerDraw:
    """The power drawn with every computation at its maximum."""
    try:
        computing: Computing = join_profile(plan, profile)
        maxima = [plan.hull(i).hi for i in range(len(plan.parameters))]
        path = plan.stages[0].sets[: plan.path_count]
        drawn = [computing.power_w(maxima, [*path, *computations.sets_for(sensing)]) for sensing in (True, False)]
    except EadpError as error:
        raise InputError.at("--profile", 1, 1, str(error), "a profile that measures whole settings") from None
    return PowerDraw(cruise_power_w, *drawn)
