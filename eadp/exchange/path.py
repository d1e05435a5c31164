"""A plan at parameters as the path that is exported, and its text as a map, a track, or a flight plan of Paparazzi."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from eadp.core.geometry.curves import CIRCLE, LINE, Point, circle_of
from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m
from eadp.errors import InputError
from eadp.models.airspace import EVERYWHERE, Airspace
from eadp.models.plan.stage import LOITER_TO_ALTITUDE, Leg, Stage, leg_points

TOLERANCE_M = 1.0
"""Distance of an exported path from the plan's, by default [m]."""
MAX_HALF_ANGLE_RAD = math.pi / 4
MAX_ACCEPTANCE_M = 255.0
"""Largest acceptance radius that ArduPilot holds [m]."""
CURVE_STEP_M = 5.0


class Arc(NamedTuple):
    """An arc: its centre [m], radius [m], turn (+1 counter-clockwise), start [rad] and angle [rad]."""

    centre_m: Point
    radius_m: float
    turn: int
    start_rad: float
    sweep_rad: float

    def point(self, share: float, out: float = 1.0) -> Point:
        """The point at a share of the arc, `out` times as far from the centre."""
        angle = self.start_rad + self.turn * share * self.sweep_rad
        x, y = self.centre_m
        return x + out * self.radius_m * math.cos(angle), y + out * self.radius_m * math.sin(angle)


@dataclass(frozen=True)
class Section:
    """A stage of the path as flown: a line to its end, an arc, or the points of a curve [m].

    `gain_per_m` is its gain for a path function whose gradient is 1; `first` and `last` are the indices of its legs.
    """

    stage: Stage
    start_m: Point
    end_m: Point
    gain_per_m: float
    arc: Arc | None = None
    points_m: tuple[Point, ...] = ()
    first: int = 0
    last: int = 0

    @property
    def courses_rad(self) -> tuple[float, float]:
        """Directions in which it starts and ends, 0 east, counter-clockwise [rad]."""
        if self.arc is not None:
            first = self.arc.start_rad + self.arc.turn * math.pi / 2
            return first, first + self.arc.turn * self.arc.sweep_rad
        points = [self.start_m, *self.points_m, self.end_m]
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = *points[:2], *points[-2:]
        return math.atan2(y1 - y0, x1 - x0), math.atan2(y3 - y2, x3 - x2)

    def corners(self, tolerance_m: float = math.inf) -> list[tuple[Point, float]]:
        """Points [m] whose fillets are the arc, and how far before them these begin [m]; else its points, with 0.

        The points lie at most a tolerance [m] outside the arc.
        """
        if self.arc is None:
            return [(point, 0.0) for point in self.points_m]
        # a fillet that turns by 2 h begins r tan h before its corner, which lies r (1/cos h − 1) out
        radius_m = self.arc.radius_m
        near = math.acos(radius_m / (radius_m + tolerance_m))
        most = min(MAX_HALF_ANGLE_RAD, math.atan(MAX_ACCEPTANCE_M / radius_m), near)
        count = math.ceil(self.arc.sweep_rad / (2 * most) - 1e-9)
        half = self.arc.sweep_rad / (2 * count)
        begins_m = radius_m * math.tan(half)
        return [(self.arc.point((k + 0.5) / count, 1 / math.cos(half)), begins_m) for k in range(count)]

    def drawn(self, tolerance_m: float) -> list[Point]:
        """Points of the section after its start [m], the path between them within a tolerance [m] of their chords."""
        if self.arc is None:
            return [*self.points_m, self.end_m]
        step = 2 * math.acos(max(1 - tolerance_m / self.arc.radius_m, math.cos(MAX_HALF_ANGLE_RAD)))
        count = math.ceil(self.arc.sweep_rad / step)
        return [self.arc.point((k + 1) / count) for k in range(count)]


@dataclass(frozen=True)
class PlannedPath:
    """What is exported: the sections of a plan at parameters, and what holds on them.

    `altitude_m` holds where a stage has none, and `stated_mps` as its airspeed, None without one; `flown_mps` is the
    airspeed that is commanded where the path begins in flight, None for the aircraft's own; `home_deg` is where
    the aircraft takes off and returns to, None without; `climb_deg` is the pitch of the take-off [°]. `zero_m` is the
    altitude 0 above the sea [m], where it is known: of a plan over terrain.
    Airspeeds are true; `calibrated` is what an autopilot holds over them. `height_m` is home's above the sea, or 0.
    """

    name: str
    sections: tuple[Section, ...]
    origin_deg: Point
    altitude_m: float
    airspeed_mps: float
    home_deg: Point | None = None
    trigger_distance_m: float | None = None
    tolerance_m: float = TOLERANCE_M
    airspace: Airspace = EVERYWHERE
    stated_mps: float | None = None
    flown_mps: float | None = None
    climb_deg: float = 0.0
    zero_m: float | None = None
    calibrated: float = 1.0
    height_m: float = 0.0

    def geodetic_deg(self, point: Point) -> Point:
        """Latitude and longitude of a point [m]."""
        return to_geodetic_deg(*point, self.origin_deg)

    def altitude_of(self, section: Section) -> float:
        """The altitude of a section above home [m]."""
        return self.altitude_m if section.stage.altitude_m is None else section.stage.altitude_m

    def airspeed_of(self, section: Section) -> float | None:
        """The airspeed that is stated for a section [m/s]."""
        return self.stated_mps if section.stage.airspeed_mps is None else section.stage.airspeed_mps

    @property
    def home(self) -> Point:
        """Latitude and longitude of home, or of the start of the path."""
        return self.home_deg or self.geodetic_deg(self.sections[0].start_m)

    def drawn(self) -> Iterator[tuple[float, float, float]]:
        """Latitude, longitude [°] and altitude [m] of points along the path: above the sea where `zero_m` is known."""
        first, zero_m = self.sections[0], self.zero_m or 0.0
        yield (*self.geodetic_deg(first.start_m), zero_m + self.altitude_of(first))
        for section in self.sections:
            for point in section.drawn(self.tolerance_m):
                yield (*self.geodetic_deg(point), zero_m + self.altitude_of(section))


def planned_sections(legs: Iterable[Leg]) -> tuple[Section, ...]:
    """The path along legs, its arcs round one circle joined where nothing else changes."""
    sections: list[Section] = []
    for index, leg in enumerate(legs):
        section = replace(_section(leg), first=index, last=index)
        before = sections[-1] if sections else None
        if before is not None and before.arc and section.arc and _joins(before, section):
            arc = before.arc._replace(sweep_rad=before.arc.sweep_rad + section.arc.sweep_rad)
            stage = replace(before.stage, commands=(*before.stage.commands, *section.stage.commands))
            sections[-1] = replace(before, stage=stage, end_m=section.end_m, arc=arc, last=index)
        elif leg.distance_m > 1e-6:
            sections.append(section)
    return tuple(sections)


def _joins(before: Section, section: Section) -> bool:
    """Whether an arc goes on with the one before it: whole turns do not beside a loiter to an altitude, with none."""
    states = {(each.stage.altitude_m, each.stage.airspeed_mps) for each in (before, section)}
    same = len(states) == 1 and all(each[0] == LOITER_TO_ALTITUDE for each in section.stage.commands)
    free = [each.arc for each in (before, section) if each.arc and not each.stage.command(LOITER_TO_ALTITUDE)]
    return same and one_circle(before.arc, section.arc) and (len(free) != 1 or free[0].sweep_rad < 2 * math.pi - 1e-6)


def one_circle(a: Arc | None, b: Arc | None) -> bool:
    """Whether both are arcs of one circle, flown in one direction."""
    return bool(a and b and a.turn == b.turn and math.dist((*a.centre_m, a.radius_m), (*b.centre_m, b.radius_m)) < 1e-6)


def _section(leg: Leg) -> Section:
    stage, (ox, oy) = leg.stage, leg.offset_m
    _, gx, gy, *_ = leg.path(leg.end_m[0] - ox, leg.end_m[1] - oy)
    gain = stage.gain * math.hypot(gx, gy)
    if stage.kind == CIRCLE:
        local = (leg.end_m[0] - ox, leg.end_m[1] - oy)
        circle = circle_of(leg.path, local, stage.sense)
        start = circle.angle_rad((leg.start_m[0] - ox, leg.start_m[1] - oy))
        centre = (circle.centre_m[0] + ox, circle.centre_m[1] + oy)
        arc = Arc(centre, circle.radius_m, circle.turn, start, leg.distance_m / circle.radius_m)
        return Section(stage, arc.point(0.0), arc.point(1.0), gain, arc)
    points = [(x, y) for x, y, _ in leg_points(leg, math.inf if stage.kind == LINE else CURVE_STEP_M).tolist()]
    return Section(stage, points[0], points[-1], gain, points_m=tuple(points[1:-1]))


WITH_ITEMS = ("qgc", "ardupilot", "px4")
"""Formats of missions of items; a map of these to the plan's stages is written beside the mission.

They hold obstacles and a boundary, too; of `ardupilot` these are a file of their own."""

ITEMS_ENDING = ".items.json"
"""Ending of the map's name, after that of the mission."""

FENCE_ENDING = ".fence.waypoints"
"""Ending of the name of ArduPilot's fence, after that of the mission."""

EXPORT_NAMES = ("qgc", "ardupilot", "px4", "paparazzi", "kml", "geojson", "gpx")
"""Formats that a plan is exported to; `export.EXPORTS` holds what writes them."""


_DIGITS = 9


def kml_text(path: PlannedPath) -> str:
    """KML: the path as a line above the ground, taken as level, or of a plan over terrain above the sea."""
    root = ET.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = ET.SubElement(root, "Document")
    ET.SubElement(document, "name").text = path.name
    placemark = ET.SubElement(document, "Placemark")
    ET.SubElement(placemark, "name").text = path.name
    line = ET.SubElement(placemark, "LineString")
    ET.SubElement(line, "altitudeMode").text = "relativeToGround" if path.zero_m is None else "absolute"
    ET.SubElement(line, "coordinates").text = " ".join(
        f"{longitude:.{_DIGITS}f},{latitude:.{_DIGITS}f},{altitude:g}" for latitude, longitude, altitude in path.drawn()
    )
    return xml_text(root)


def geojson_text(path: PlannedPath) -> str:
    """GeoJSON: the path as a line."""
    points = [[round(x, _DIGITS), round(y, _DIGITS), altitude] for y, x, altitude in path.drawn()]
    feature = {
        "type": "Feature",
        "properties": {"name": path.name},
        "geometry": {"type": "LineString", "coordinates": points},
    }
    return json.dumps({"type": "FeatureCollection", "features": [feature]}) + "\n"


def gpx_text(path: PlannedPath) -> str:
    """GPX: the path as a track; its elevations are above home, or of a plan over terrain above the sea."""
    root = ET.Element("gpx", xmlns="http://www.topografix.com/GPX/1/1", version="1.1", creator="eadp")
    track = ET.SubElement(root, "trk")
    ET.SubElement(track, "name").text = path.name
    segment = ET.SubElement(track, "trkseg")
    for latitude, longitude, altitude in path.drawn():
        place = {"lat": f"{latitude:.{_DIGITS}f}", "lon": f"{longitude:.{_DIGITS}f}"}
        ET.SubElement(ET.SubElement(segment, "trkpt", place), "ele").text = f"{altitude:g}"
    return xml_text(root)


def xml_text(root: ET.Element, doctype: str = "") -> str:
    """An XML document."""
    ET.indent(root)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n' + (f"{doctype}\n" if doctype else "")
    return head + ET.tostring(root, encoding="unicode") + "\n"


DOCTYPE = '<!DOCTYPE flight_plan SYSTEM "../flight_plan.dtd">'
NUMBER_LIMIT = 250
"""Most waypoints and most blocks: the autopilot numbers them by a byte."""
MAX_SWEEP_RAD = 2 * math.pi / 3
"""Largest arc of one call: it ends beyond the line across its end, and the arc has to lie before that line."""
LINE_UNIT_M = 100.0
MAX_SECURITY_HEIGHT_M = 25.0


def paparazzi_text(path: PlannedPath) -> str:
    """The flight plan of a path, as its `flight_plan.dtd` has it.

    Raises
    ------
    InputError
        If it takes more waypoints or blocks than Paparazzi can number.
    """
    plan = _FlightPlan(path)
    home_m = to_local_m(*path.home, path.origin_deg)
    plan.waypoint(home_m, path.altitude_m, "HOME")
    for number, section in enumerate(path.sections, 1):
        plan.add(number, section)
    last = path.sections[-1]
    centre = "HOME" if path.home_deg else plan.waypoint(last.end_m, path.altitude_of(last))
    ET.SubElement(ET.SubElement(plan.blocks, "block", name="Standby"), "circle", wp=centre, radius="nav_radius")
    for what, count in (("waypoints", len(plan.waypoints)), ("blocks", len(plan.blocks))):
        if count > NUMBER_LIMIT:
            expected = f"at most {NUMBER_LIMIT}: a shorter plan, or another format"
            raise InputError.at(path.name, 1, 1, f"a flight plan of {count} {what}", expected)
    root = ET.Element(
        "flight_plan",
        name=path.name,
        lat0=f"{path.origin_deg[0]:.9f}",
        lon0=f"{path.origin_deg[1]:.9f}",
        ground_alt="0",
        alt=f"{path.altitude_m:g}",
        security_height=f"{min(MAX_SECURITY_HEIGHT_M, path.altitude_m / 2):g}",
        max_dist_from_home=f"{math.ceil(1.5 * plan.farthest_m(home_m) + 100)}",
    )
    ET.SubElement(root, "header")
    root.append(plan.waypoints)
    ET.SubElement(ET.SubElement(root, "modules"), "module", name="gvf_module")
    root.append(plan.blocks)
    return xml_text(root, DOCTYPE)


class _FlightPlan:
    """Waypoints and blocks of a flight plan, in the plan's own frame."""

    def __init__(self, path: PlannedPath) -> None:
        self.path = path
        self.waypoints, self.blocks = ET.Element("waypoints"), ET.Element("blocks")
        self._names: dict[tuple[str, str, str], str] = {}

    def waypoint(self, point: Point, altitude_m: float, name: str = "") -> str:
        """The name of a waypoint at a point [m] and a height [m]."""
        place = (f"{round(point[0], 3) + 0.0:.3f}", f"{round(point[1], 3) + 0.0:.3f}", f"{altitude_m:g}")
        if place not in self._names:
            self._names[place] = name or f"P{len(self._names)}"
            x, y, height = place
            ET.SubElement(self.waypoints, "waypoint", name=self._names[place], x=x, y=y, height=height)
        return self._names[place]

    def farthest_m(self, home_m: Point) -> float:
        """The largest distance of a waypoint from home [m]."""
        return max(math.dist((float(x), float(y)), home_m) for x, y, _ in self._names)

    def add(self, number: int, section: Section) -> None:
        """Add the block of a section."""
        altitude_m = self.path.altitude_of(section)
        block = ET.SubElement(self.blocks, "block", name=f"stage {number}")
        ET.SubElement(block, "call_once", fun="NavVerticalAutoThrottleMode(RadOfDeg(0.0))")
        ET.SubElement(block, "call_once", fun=f"NavVerticalAltitudeMode(GetAltRef() + {altitude_m:g}, 0.)")
        arc = section.arc
        if arc is None:
            ET.SubElement(block, "set", var="gvf_line_par.ke", value=f"{LINE_UNIT_M * section.gain_per_m:.6g}")
            before = section.start_m
            for point in section.drawn(self.path.tolerance_m):
                names = self.waypoint(before, altitude_m), self.waypoint(point, altitude_m)
                ET.SubElement(block, "call", fun=f"nav_gvf_segment_wp1_wp2(WP_{names[0]}, WP_{names[1]})")
                before = point
            return
        # |∇φ| of the ellipse is 2/r on it
        ET.SubElement(block, "set", var="gvf_ellipse_par.ke", value=f"{section.gain_per_m * arc.radius_m / 2:.6g}")
        # its positive direction is clockwise
        ET.SubElement(block, "call_once", fun=f"gvf_set_direction({-arc.turn})")
        centre = self.waypoint(arc.centre_m, altitude_m)
        fun = f"gvf_ellipse_wp(WP_{centre}, {arc.radius_m:.3f}, {arc.radius_m:.3f}, 0)"
        count = math.ceil(arc.sweep_rad / MAX_SWEEP_RAD - 1e-9)
        for k in range(1, count + 1):
            heading = arc.start_rad + arc.turn * (arc.sweep_rad * k / count + math.pi / 2)
            ET.SubElement(block, "call", fun=fun, until=_passed(arc.point(k / count), heading))


def _passed(point: Point, heading_rad: float) -> str:
    """The condition that the aircraft is beyond a point [m] in a direction."""
    x, y = f"(GetPosX() - ({point[0]:.3f}))", f"(GetPosY() - ({point[1]:.3f}))"
    return f"{x} * ({math.cos(heading_rad):.6f}) + {y} * ({math.sin(heading_rad):.6f}) > 0"
