"""Paths as maps and tracks: KML, GeoJSON and GPX."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET

from eadp.io.mission.path import PlannedPath

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
