"""Missions of other software: read as plans, and plans written as missions."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET

from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import to_local_m
from eadp.errors import InputError
from eadp.exchange.path import PlannedPath, Section

ENDINGS = {
    "qgc": ".plan",
    "ardupilot": ".waypoints",
    "px4": ".plan",
    "paparazzi": ".xml",
    "kml": ".kml",
    "geojson": ".geojson",
    "gpx": ".gpx",
}
"""Endings of the names of files, by format."""

WITH_ITEMS = ("qgc", "ardupilot", "px4")
"""Formats of missions of items; a map of these to the plan's stages is written beside the mission."""

ITEMS_ENDING = ".items.json"
"""Ending of the map's name, after that of the mission."""

FENCE_ENDING = ".fence.waypoints"
"""Ending of the name of ArduPilot's fence, after that of the mission."""

EXPORT_NAMES = tuple(ENDINGS)
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
