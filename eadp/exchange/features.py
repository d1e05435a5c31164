"""Files of fields and zones as features: polygons and lines with names, of GeoJSON, KML, or a table of vertices.

Syntax alone is checked here; what is wrong with an outline is in `field_reader`. KML's elements are recognised by their
names without a prefix. A document type is refused: it may refer to other files, or expand into more than the text.
"""

from __future__ import annotations

import re
import xml.parsers.expat
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder

from eadp.core.geometry.curves import Point
from eadp.errors import Fault, InputError, counted, printable, refuse
from eadp.io.text.csv import Row, number_fault, read_rows
from eadp.io.text.json import JsonList, JsonObject, JsonReader
from eadp.io.text.streams import HEAD, Location, Text

VERTICES_LIMIT = 20_000
"""Most vertices of a polygon, those of its holes among them."""
NAME_LIMIT = 100
"""Most characters of a name."""
NAME_KEYS = ("name", "Name", "NAME", "id")
"""Properties that are names."""
OBSTACLE = "avoid"
"""Start of the name of a feature that is not flown over."""
MAX_HEIGHT_M = 10_000.0
"""Largest height of an obstacle [m]."""

Line = list[Point]
"""Vertices: x is east, or longitude; y is north, or latitude."""


@dataclass(frozen=True)
class Feature:
    """What a file has under one name.

    Attributes
    ----------
    location : (int, int)
        Line and column where it begins.
    names : sequence of str
        Its name first, then its ids.
    polygons : list of lists of lines
        Each its outline and its holes.
    lines : list of lines
        Open and closed ones; a point is a line of one vertex.
    height_m : float or None
        Above the field's origin [m].
    """

    location: Location
    names: Sequence[str] = ()
    polygons: list[list[Line]] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    height_m: float | None = None

    @property
    def avoided(self) -> bool:
        """Whether it is an obstacle: one of its names is "avoid", or starts so."""
        return any(name.lower().startswith(OBSTACLE) for name in self.names)

    @property
    def name(self) -> str:
        """Its name, as that of an obstacle; '' without one."""
        name = "".join(self.names[:1])
        return name[len(OBSTACLE) :].strip(" :-_") if self.avoided else name

    @property
    def outlines(self) -> list[Line]:
        """The outlines of its polygons, and its lines, those that are open as outlines without an area."""
        returning = (line if is_closed(line) else [*line, *line[-2:0:-1]] for line in self.lines)
        return [*(rings[0] for rings in self.polygons), *returning]

    @property
    def as_polygons(self) -> Feature:
        """Its closed lines as polygons."""
        return replace(self, polygons=[[line] for line in self.lines if is_closed(line)], lines=[])


@dataclass(frozen=True)
class Features:
    """The features of a file.

    `degrees` is whether they are in degrees and not in metres; `remedy` is the advice where that is wrong.
    """

    features: list[Feature]
    degrees: bool
    remedy: str = ""

    def areas(self, source: Text) -> list[Feature]:
        """The features with polygons; where there are none, those with closed lines. Raises InputError without any."""
        found = [each for each in self.features if each.polygons] or [
            closed for each in self.features if (closed := each.as_polygons).polygons
        ]
        if not found:
            expected = "a polygon, or a closed line: a Polygon of GeoJSON, alone or in a Feature, or of KML"
            only = ", only open lines and points" if any(each.lines for each in self.features) else ""
            raise source.error((1, 1), f"no polygon{only}", expected)
        return found


def is_closed(line: Sequence[Point]) -> bool:
    """Whether a line ends where it starts, and may have an area."""
    return len(line) > 3 and line[0] == line[-1]


def read_features(source: Text, *, metres: bool) -> Features:
    """The features of a text; with `metres` it is in metres, whatever it states.

    Raises
    ------
    InputError
        If it is of no format, or of the option, if it does not fit.
    """
    head = source.body.lstrip()[:HEAD]
    if not head:
        raise source.error((1, 1), "is empty", "a field as GeoJSON, KML or a CSV of vertices")
    if head[0] in "{[":
        found = _GeoJson(source, metres).read()
    else:
        found = read_kml(source, metres) if head[0] == "<" else read_table(source, metres)
    for each in found.features:
        if any(sum(map(len, rings)) > VERTICES_LIMIT for rings in (*each.polygons, each.lines)):
            expected = f"at most {VERTICES_LIMIT}: a simpler outline"
            raise source.error(each.location, f"more than {VERTICES_LIMIT} vertices", expected)
    return found


def _height_m(raw: object, fault: Callable[[str, str], InputError]) -> float | None:
    """A height as a file has it [m]; None where there is none."""
    if raw in (None, ""):
        return None
    if isinstance(raw, bool) or number_fault(str(raw), MAX_HEIGHT_M) or float(str(raw)) < 0:
        expected = f"metres above the field, from 0 to {MAX_HEIGHT_M:g}"
        raise fault(f"a height of {printable(str(raw), 40)}", expected)
    return float(str(raw))


# --- GeoJSON

_POSITION = "longitude, latitude and perhaps altitude, or x and y in metres"
_DEPTHS = {"Point": 0, "MultiPoint": 1, "LineString": 1, "MultiLineString": 2, "Polygon": 2, "MultiPolygon": 3}
"""Lists in lists that the coordinates of a geometry are."""

_DEGREES = re.compile(r".*(?:CRS84h?|EPSG\W(?:.*\W)?(?:4326|4979|4258|4937))\s*", re.IGNORECASE | re.DOTALL)
"""Names of the reference systems whose numbers are degrees as WGS-84 has them, to a metre."""
_WEB_MERCATOR = re.compile(r".*\D(?:3857|3785|900913|102100|102113)\s*", re.DOTALL)
"""Of that whose metres are longer than metres away from the equator."""
_IN_METRES = re.compile(r"\s*(?:m|met(?:re|er)s?)(?![\w/^*·])", re.IGNORECASE)


@dataclass
class _GeoJson:
    """A reader of a text of GeoJSON."""

    source: Text
    metres: bool
    units: list[str] = field(default_factory=list)
    """The `units` of all objects."""
    systems: list[tuple[str, Location]] = field(default_factory=list)
    """The names of the reference systems of all objects, and where they stand."""

    def read(self) -> Features:
        source = self.source
        start = source.location(len(source.body) - len(source.body.lstrip()))
        found, degrees = list(self._features(JsonReader(source).document(), start)), self._are_degrees()
        in_metres = "no --metres" if self.metres else "a file without units in metres"
        return Features(found, degrees, "--metres" if degrees else in_metres)

    def _are_degrees(self) -> bool:
        """Whether coordinates are degrees: by a `crs`, else by the option or `units`; of the whole file.

        Raises InputError of a reference system that is not read.
        """
        if any(_DEGREES.fullmatch(name) for name, _ in self.systems):
            return True
        in_metres = self.metres or any(map(_IN_METRES.match, self.units))
        for name, at in self.systems:
            if not in_metres or _WEB_MERCATOR.fullmatch(name):
                expected = f"degrees, as by ogr2ogr -t_srs EPSG:4326 field.geojson {printable(self.source.name)}"
                expected += "" if in_metres else ", or --metres"
                message = f"the reference system {printable(name, 80) or 'without a name'} is not read"
                raise self.source.error(at, message, expected)
        return not in_metres

    def _features(self, node: Any, at: Location) -> Iterator[Feature]:
        """The features at and below an object."""
        kind = node.get("type") if isinstance(node, JsonObject) else None
        if not isinstance(kind, str):
            raise self.source.error(at, "no object of GeoJSON with a type", "a Polygon, Feature or FeatureCollection")
        self._note_units(node)
        if kind == "FeatureCollection":
            for item, start in self._members(node, "features", at):
                yield from self._features(item, start)
            return
        geometry, start = node, at
        if kind == "Feature" and (geometry := node.get("geometry")) is not None:
            start = self.source.location(node.offsets["geometry"])
        properties = _object(node.get("properties") if kind == "Feature" else None)
        texts = {key: str(value).strip() for key, value in properties.items() if type(value) in (str, int, float)}
        own_id = [str(node["id"]).strip()] if type(node.get("id")) in (str, int, float) else []
        names = [name for name in (*(texts.get(key, "") for key in NAME_KEYS), *own_id) if name]
        height_m = _height_m(properties.get("height"), lambda *wrong: self.source.error(at, *wrong))
        found = Feature(at, [*dict.fromkeys(names)], height_m=height_m)
        if geometry is not None:
            self._add(found, geometry, start)
        yield found

    def _members(self, node: JsonObject, key: str, at: Location) -> list[tuple[Any, Location]]:
        """The items of a list, each with its location."""
        value = node.get(key)
        if not isinstance(value, JsonList):
            raise self.source.error(at, f"no list of {key}", f"{key} with a list")
        return [(item, self.source.location(offset)) for item, offset in zip(value, value.offsets, strict=True)]

    def _add(self, to: Feature, node: Any, at: Location) -> None:
        """Add the polygons and lines of a geometry to a feature."""
        kind = node.get("type") if isinstance(node, JsonObject) else None
        if kind == "GeometryCollection":
            for item, start in self._members(node, "geometries", at):
                self._add(to, item, start)
            return
        if kind not in _DEPTHS:
            raise self.source.error(at, "no geometry", f"{', '.join(_DEPTHS)} or GeometryCollection, with coordinates")
        found = self._nested(node.get("coordinates"), _DEPTHS[kind], at)
        if kind.endswith("Polygon"):
            polygons = [found] if kind == "Polygon" else found
            if not all(polygons):
                raise self.source.error(at, "a polygon without rings", "a ring of positions")
            to.polygons.extend(polygons)
        else:
            lines = {"Point": [[found]], "LineString": [found], "MultiPoint": [[each] for each in found]}
            to.lines.extend(lines.get(kind, found))

    def _nested(self, value: Any, depth: int, at: Location) -> Any:
        """Positions, in so many lists."""
        if depth == 0 and isinstance(value, tuple):
            return value[:2]
        if depth == 0 or not isinstance(value, JsonList):
            what = "position" if depth == 0 else "list of positions"
            raise self.source.error(
                at, f"no {what}", f"{'' if depth == 0 else 'a list of positions, each '}{_POSITION}"
            )
        return [
            self._nested(each, depth - 1, at if isinstance(each, tuple) else self.source.location(offset))
            for each, offset in zip(value, value.offsets, strict=True)
        ]

    def _note_units(self, node: JsonObject) -> None:
        """Note `units` and `crs` of an object."""
        properties = _object(node.get("properties"))
        self.units += [str(each.get("units") or "") for each in (node, properties)]
        if (crs := node.get("crs")) is not None:
            name = _object(_object(crs).get("properties")).get("name")
            name = name[:200] if isinstance(name, str) else ""
            self.systems.append((name, self.source.location(node.offsets["crs"])))


def _object(value: Any) -> JsonObject:
    """A value if it is an object, else an empty one."""
    return value if isinstance(value, JsonObject) else JsonObject()


# --- KML

_OUTER, _INNER = "outerBoundaryIs", "innerBoundaryIs"
_LINE = "line"
"""Attribute that has the line of an element."""


def read_kml(source: Text, metres: bool) -> Features:
    """The Placemarks of KML, and polygons without one. Raises InputError as `read_features`."""
    if metres:
        raise InputError.at("--metres", 1, 1, "a KML file is in degrees (WGS-84)", "KML without --metres")
    root, seen, found = _tree(source), set[Element](), list[Feature]()
    for each in root.iter():
        if each.tag == "Placemark" or (each.tag == "Polygon" and each not in seen):
            seen.update(each.iter("Polygon"))
            found.append(_placemark(each, source))
    return Features(found, degrees=True)


def _tree(source: Text) -> Element:
    """The elements of XML by their local names, each with its line."""
    builder, parser = TreeBuilder(), xml.parsers.expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        builder.start(tag.rpartition(":")[2], {**attributes, _LINE: str(parser.CurrentLineNumber)})

    def refuse_type(*_: object) -> None:
        message = "a document type, which may refer to other files"
        raise source.error((parser.CurrentLineNumber, 1), message, "a KML file without <!DOCTYPE>")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: builder.end(tag.rpartition(":")[2])
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse_type
    try:
        parser.Parse(source.body, True)
    except xml.parsers.expat.ExpatError as error:
        reason = xml.parsers.expat.ErrorString(error.code)
        raise source.error((error.lineno, error.offset + 1), f"is not XML: {reason}", "a KML file") from None
    return builder.close()


def _placemark(holder: Element, source: Text) -> Feature:
    """The feature of a Placemark, or of a Polygon alone."""
    location = int(holder.attrib[_LINE]), 1
    names = [name for name in ((holder.findtext("name") or "").strip(), holder.get("id", "")) if name]
    data = {each.get("name", ""): each.findtext("value") or "" for each in holder.iter("Data")}
    data |= {each.get("name", ""): each.text or "" for each in holder.iter("SimpleData")}
    polygons = list[list[Line]]()
    for polygon in holder.iter("Polygon"):
        outer, inner = (polygon.findall(f"{role}/LinearRing/coordinates") for role in (_OUTER, _INNER))
        if len(outer) != 1:
            message = "a second outline" if outer else "a Polygon without an outline"
            expected = f"one {_OUTER} with a LinearRing of coordinates"
            raise source.error((int(polygon.attrib[_LINE]), 1), message, expected)
        polygons.append([_coordinates(each, source) for each in (*outer, *inner)])
    lines = [
        _coordinates(each, source)
        for kind in ("LineString", "Point")
        for geometry in holder.iter(kind)
        for each in geometry.findall("coordinates")
    ]
    height_m = _height_m(data.get("height", "").strip()[:NAME_LIMIT], lambda *wrong: source.error(location, *wrong))
    return Feature(location, [*dict.fromkeys(names)], polygons, lines, height_m)


def _coordinates(element: Element, source: Text) -> Line:
    """The vertices of an element: tuples separated by blanks, each `longitude,latitude[,altitude]`."""
    location, found = (int(element.attrib[_LINE]), 1), list[Point]()
    if len(element):
        raise source.error(location, "an element within coordinates", "vertices alone")
    for token in (element.text or "").split():
        parts = token.split(",")
        if not 2 <= len(parts) <= 3 or any(map(number_fault, parts)):
            expected = "longitude,latitude or longitude,latitude,altitude, finite numbers without blanks"
            raise source.error(location, f"{printable(token, 40)} is no position", expected)
        found.append((float(parts[0]), float(parts[1])))
    return found


# --- a table of vertices

_COLUMNS = {
    "x": ("x", "x_m", "east", "east_m", "easting", "easting_m"),
    "y": ("y", "y_m", "north", "north_m", "northing", "northing_m"),
    "lon": ("lon", "lng", "long", "longitude", "lon_deg", "longitude_deg"),
    "lat": ("lat", "latitude", "lat_deg", "latitude_deg"),
}
_ROLES = {name: role for role, names in _COLUMNS.items() for name in names}
_A_HEADER = "a header such as x_m,y_m or lon,lat"


def read_table(source: Text, metres: bool) -> Features:
    """A table of vertices as one outline: columns `x_m,y_m` or `lon,lat`. Raises InputError as `read_features`."""
    rows = read_rows(source.name, source.body)
    head = next(rows, None)
    if head is None:
        raise source.error((1, 1), "no vertices", f"{_A_HEADER}, and a row for each vertex")
    columns, degrees = _header(head, metres)
    ring, faults, width = Line(), list[Fault](), len(head.fields)
    for row in rows:
        if len(row.fields) < width or any(row.fields[width:]):
            message = counted(len(row.fields), "field")
            faults.append(row.fault(min(len(row.fields), width), message, f"{width}, as in the first row"))
        elif wrong := [row.fault(i, *each) for i in columns if (each := number_fault(row.fields[i]))]:
            faults += wrong
        else:
            ring.append((float(row.fields[columns[0]]), float(row.fields[columns[1]])))
    refuse(faults)
    remedy = f"columns called {'x_m and y_m' if degrees else 'lon and lat'}"
    return Features([Feature((head.line, 1), polygons=[[ring]])], degrees, remedy)


def _header(head: Row, metres: bool) -> tuple[tuple[int, int], bool]:
    """Which columns are east and north, and whether they are degrees."""
    roles = [_ROLES.get(re.sub(r"[\s\[\]()°-]+", "_", name[:80].lower()).strip("_")) for name in head.fields]
    known = sorted(filter(None, roles))
    if known not in (["lat", "lon"], ["x", "y"]):
        what = "more columns of vertices than two" if len(known) > 2 else "no columns of vertices"
        raise InputError(head.fault(0, what, _A_HEADER))
    degrees = "lon" in known
    if degrees and metres:
        raise InputError(head.fault(roles.index("lon"), "a column of degrees", "x_m,y_m, as --metres asks"))
    return (roles.index("lon" if degrees else "x"), roles.index("lat" if degrees else "y")), degrees
