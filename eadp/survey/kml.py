"""KML as a draft of a field: the polygon of one Placemark, in degrees.

Elements are recognised by their names without a prefix, so that KML of any namespace is read. A document type is
refused: it may refer to other files, or expand into more than the text.
"""

from __future__ import annotations

import re
import xml.parsers.expat
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, chain

from eadp.errors import Fault, InputError, printable
from eadp.io.text.csv import NOT_FINITE, NUMBER, Row, number_fault, read_rows
from eadp.io.text.streams import Location, SourceText
from eadp.survey.field import (
    A_HEIGHT,
    BOUNDARIES,
    MAX_HEIGHT_M,
    NAME_LIMIT,
    OBSTACLES,
    VERTICES_LIMIT,
    FeatureCandidate,
    FeatureFormat,
    FieldDraft,
    Ring,
    Units,
    VertexReader,
    counted,
    there_and_back,
)

_OUTER, _INNER = "outerBoundaryIs", "innerBoundaryIs"
_RING_PATHS = [["Polygon", role, "LinearRing", "coordinates"] for role in (_OUTER, _INNER)]
_THIN_PATHS = [["LineString", "coordinates"], ["Point", "coordinates"]]
_MODE = "altitudeMode"
_A_POLYGON = "KML with a Polygon, or a closed line, in a Placemark"


@dataclass
class _RingText:
    """The text of a ring's, or a line's, coordinates in pieces with their locations; blanks between are pieces too.

    One that `returns` is a line, read as a ring without an area.
    """

    role: str
    location: Location
    pieces: list[tuple[str, Location]] = field(default_factory=list)
    blanks: int = 0
    returns: bool = False

    def add(self, text: str, location: Location) -> None:
        """Add a piece, unless the ring is already too long."""
        if self.blanks > VERTICES_LIMIT:
            return
        if not text.isspace():
            self.pieces.append((text, location))
        elif self.pieces and self.pieces[-1][0] != " ":
            self.pieces.append((" ", location))
            self.blanks += 1

    @property
    def tokens(self) -> list[str]:
        """The texts of its positions."""
        return "".join(piece for piece, _ in self.pieces).split()

    @property
    def is_closed(self) -> bool:
        """Whether it ends where it starts, and may have an area."""
        tokens = self.tokens
        return len(tokens) > 3 and tokens[0] == tokens[-1]


class _KmlReader:
    """Collects the Placemarks with polygons, those with lines and those with points; refuses a document type."""

    def __init__(self, source: SourceText) -> None:
        self.source = source
        self.found: list[FeatureCandidate] = []
        self.lines: list[FeatureCandidate] = []
        self.points: list[FeatureCandidate] = []
        self.key = ""
        self.path: list[str] = []
        self.placemark: FeatureCandidate | None = None
        self.name: list[str] = []
        self.parser = xml.parsers.expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text

    def document(self) -> list[FeatureCandidate]:
        """The Placemarks with polygons, each a list of the texts of its rings."""
        try:
            self.parser.Parse(self.source.body, True)
        except xml.parsers.expat.ExpatError as error:
            location = (error.lineno, error.offset + 1)
            reason = xml.parsers.expat.ErrorString(error.code)
            raise self.source.error(location, f"is not XML: {reason}", "a KML file") from None
        return self.found

    def outlines(self) -> list[FeatureCandidate]:
        """The Placemarks with lines that are closed, as polygons."""
        return [line for line in self.lines if line.polygons[0][0][0].is_closed]

    @property
    def _coordinates(self) -> bool:
        """Whether the parser is within the coordinates of a ring, a line or a point."""
        return self.path[-4:] in _RING_PATHS or self.path[-2:] in _THIN_PATHS

    def _location(self) -> Location:
        return self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1

    def _doctype(self, *_: object) -> None:
        message = "a document type, which may refer to other files"
        raise self.source.error(self._location(), message, "a KML file without <!DOCTYPE>")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if self._coordinates:
            raise self.source.error(self._location(), "an element within coordinates", "vertices alone")
        local = tag.rpartition(":")[2]
        self.path.append(local)
        if local == "Placemark":
            identity = [attributes["id"]] if attributes.get("id") else []
            self.placemark, self.name = FeatureCandidate(self._location(), identity, []), []
        elif local == "Polygon":
            holder = self.placemark
            if holder is None:
                holder = FeatureCandidate(self._location(), [], [])
                self.found.append(holder)
            elif not holder.polygons:
                self.found.append(holder)
            holder.polygons.append(([], self._location()))
        elif local in ("Data", "SimpleData"):
            self.key = attributes.get("name", "")[:NAME_LIMIT]
        elif self.path[-2:] in _THIN_PATHS and self.placemark is not None:
            ring = _RingText(_OUTER, self._location())
            self._thin().append(replace(self.placemark, polygons=[([ring], self._location())]))
        elif self.path[-4:] in _RING_PATHS:
            self._polygon().append(_RingText(self.path[-3], self._location()))

    def _polygon(self) -> list[_RingText]:
        rings: list[_RingText] = self.found[-1].polygons[-1][0]
        return rings

    def _thin(self) -> list[FeatureCandidate]:
        """The lines or the points, of which one is read."""
        return self.points if self.path[-2] == "Point" else self.lines

    def _text(self, data: str) -> None:
        if self.path[-4:] in _RING_PATHS:
            self._polygon()[-1].add(data, self._location())
        elif self.path[-2:] in _THIN_PATHS and self.placemark is not None:
            self._thin()[-1].polygons[0][0][0].add(data, self._location())
        elif self.path[-2:] == ["Placemark", "name"]:
            self.name.append(data)
        elif self.placemark is not None and self.path[-1] == _MODE:
            self.placemark.properties[_MODE] = self.placemark.properties.get(_MODE, "") + data.strip()
        elif self.placemark is not None and (self.path[-1] == "SimpleData" or self.path[-2:] == ["Data", "value"]):
            known = self.placemark.properties.get(self.key, "")
            self.placemark.properties[self.key] = (known + data.strip())[:NAME_LIMIT]

    def _end(self, tag: str) -> None:
        local = self.path.pop()
        if local == "name" and self.path[-1:] == ["Placemark"] and self.placemark:
            self.placemark.names[:0] = filter(None, ["".join(self.name).strip()])
        elif local == "Placemark":
            self.placemark = None


def _features(source: SourceText, metres: bool, want: str) -> list[FeatureCandidate]:
    """The Placemarks of a kind, one or more, with the obstacles beside them."""
    if metres:
        raise InputError.at("--metres", 1, 1, "a KML file is in degrees (WGS-84)", "KML without --metres")
    reader = _KmlReader(source)
    polygons = reader.document()
    thin = [
        each for each in (*reader.lines, *reader.points) if want == OBSTACLES or (want != BOUNDARIES and each.avoided)
    ]
    candidates = polygons or [each for each in reader.outlines() if each not in thin]
    if not candidates and not (want == OBSTACLES and thin):
        only = f", only {counted(len(reader.lines), 'open line', 'open lines')}" if reader.lines else ""
        raise source.error((1, 1), f"no polygon{only}", _A_POLYGON)
    for each in thin:
        text = each.polygons[0][0][0]
        each.thin = text.returns = not text.is_closed
    for each in (*candidates, *thin):
        each.height_m = _height_m(each, source)
    return [*candidates, *thin]


def _height_m(each: FeatureCandidate, source: SourceText) -> float | None:
    """The height of a Placemark above the field [m]: of its data, or of its altitudes, if these are above ground."""
    raw = each.properties.get("height", "")
    if raw:
        if number_fault(raw, MAX_HEIGHT_M) or float(raw) < 0:
            raise source.error(each.location, f"a height of {printable(raw, 40)}", A_HEIGHT)
        return float(raw)
    if each.properties.get(_MODE) != "relativeToGround":
        return None
    positions = [token.split(",") for polygon, _ in each.polygons for ring in polygon for token in ring.tokens]
    tops_m = [float(parts[2]) for parts in positions if len(parts) == 3 and not number_fault(parts[2])]
    return max(tops_m, default=0.0) or None


def _rings(polygon: Sequence[_RingText], location: Location, source: SourceText) -> list[Ring]:
    """The outline of a polygon, and its holes."""
    outer = [ring for ring in polygon if ring.role == _OUTER]
    if len(outer) != 1:
        location = outer[1].location if outer else location
        message = "a second outline" if outer else "a Polygon without an outline"
        raise source.error(location, message, f"one {_OUTER} with a LinearRing of coordinates")
    reader = VertexReader(source)
    rings = [_ring(ring, reader) for ring in (*outer, *(ring for ring in polygon if ring.role == _INNER))]
    reader.finish()
    return rings


def _ring(ring: _RingText, reader: VertexReader) -> Ring:
    """The vertices of a ring: tuples separated by blanks, each `longitude,latitude[,altitude]`."""
    text = "".join(piece for piece, _ in ring.pieces)
    starts = list(accumulate((len(piece) for piece, _ in ring.pieces), initial=0))
    result = Ring([], ring.location)
    for token in re.finditer(r"\S+", text):
        piece = bisect_right(starts, token.start(), hi=len(ring.pieces)) - 1
        line, column = ring.pieces[piece][1]
        location = (line, column + token.start() - starts[piece])
        parts = token[0].split(",")
        columns = accumulate((len(part) + 1 for part in parts), initial=location[1])
        faults = [
            reader.source.fault((line, at), *wrong)
            for part, at in zip(parts, columns, strict=False)
            if (wrong := number_fault(part))
        ]
        if not 2 <= len(parts) <= 3:
            expected = "longitude,latitude or longitude,latitude,altitude without blanks"
            faults = [reader.source.fault(location, f"{printable(token[0], 40)} is no position", expected)]
        if faults:
            reader.refuse(faults)
        else:
            reader.add(result, float(parts[0]), float(parts[1]), location)
    if ring.returns:
        result.vertices = there_and_back(result.vertices)
    return result


KML = FeatureFormat(_features, _rings, lambda *_: Units(True))


_ROLES = {
    **dict.fromkeys(("x", "x_m", "east", "east_m", "easting", "easting_m"), "x"),
    **dict.fromkeys(("y", "y_m", "north", "north_m", "northing", "northing_m"), "y"),
    **dict.fromkeys(("lon", "lng", "long", "longitude", "lon_deg", "longitude_deg"), "lon"),
    **dict.fromkeys(("lat", "latitude", "lat_deg", "latitude_deg"), "lat"),
    "ring": "ring",
}
_A_HEADER = "a header such as x_m,y_m or lon,lat"


def read_table(source: SourceText, metres: bool, feature: str | None) -> FieldDraft:
    """Read a table of vertices.

    Parameters
    ----------
    source : SourceText
        Columns `x_m,y_m` or `lon,lat` and perhaps `ring` (0 the outline, 1.. the holes), or two columns without names.
    metres : bool
        Two columns without names are in metres, and columns of degrees are refused; without it, two columns without
        names must have values beyond those of degrees.
    feature : str or None
        Refused if not None: a table has no features.

    Raises
    ------
    InputError
        With the faults of the rows, or of the header, or of the options, if they do not fit.
    """
    if feature is not None:
        raise InputError.at("--feature", 1, 1, "a table of vertices has no features", "a table without --feature")
    rows = read_rows(source.name, source.body, None)
    head = next(rows, None)
    if head is None:
        raise source.error((1, 1), "no vertices", f"{_A_HEADER}, and a row for each vertex")
    if not all(NUMBER.match(text) or NOT_FINITE.match(text) for text in head.fields):
        columns, in_degrees = _header(head, metres)
        rings = _table_rings(rows, columns, len(head.fields), source)
        return FieldDraft(rings, in_degrees, False, f"columns called {'x_m and y_m' if in_degrees else 'lon and lat'}")
    if len(head.fields) != 2:
        message = f"{counted(len(head.fields), 'column', 'columns')} without names"
        raise InputError(head.fault(min(2, len(head.fields)), message, f"two, or {_A_HEADER}"))
    rings = _table_rings(chain([head], rows), (0, 1, -1), 2, source)
    if metres:
        return FieldDraft(rings, False, False, "a header lon,lat and no --metres")
    if all(abs(vertex.x) <= 180 and abs(vertex.y) <= 90 for vertex in rings[0].vertices):
        message = "columns without names, which may be degrees or metres"
        raise InputError(head.fault(0, message, "--metres, or a header such as lon,lat or x_m,y_m"))
    note = "taken as metres, since there are values beyond the ±180 and ±90 of degrees"
    return FieldDraft(rings, False, False, "a header lon,lat", notes=[note])


def _header(head: Row, metres: bool) -> tuple[tuple[int, int, int], bool]:
    """Which columns are east, north and the ring (−1 for none), and whether the first two are degrees."""
    columns: dict[str, int] = {}
    for i, name in enumerate(head.fields):
        role = _ROLES.get(re.sub(r"[\s\[\]()°-]+", "_", name[:80].lower()).strip("_"))
        if role is None:
            continue
        if role in columns:
            message = f"{printable(name, 40)} after {printable(head.fields[columns[role]], 40)}"
            raise InputError(head.fault(i, message, "one column of each"))
        columns[role] = i
    degrees = {"lon", "lat"} <= set(columns)
    if degrees and {"x", "y"} <= set(columns):
        message = "columns of degrees and of metres"
        raise InputError(head.fault(max(columns["lon"], columns["x"]), message, "x_m,y_m or lon,lat, not both"))
    if degrees and metres:
        raise InputError(head.fault(columns["lon"], "a column of degrees", "x_m,y_m, or no --metres"))
    for role, partner in (("x", "y"), ("y", "x"), ("lon", "lat"), ("lat", "lon")):
        if role in columns and partner not in columns:
            raise InputError(head.fault(len(head.fields), f"no column {partner} beside {role}", _A_HEADER))
    if not degrees and "x" not in columns:
        raise InputError(head.fault(0, "no columns of vertices", f"{_A_HEADER}, or two columns of numbers"))
    east, north = ("lon", "lat") if degrees else ("x", "y")
    return (columns[east], columns[north], columns.get("ring", -1)), degrees


def _table_rings(rows: Iterable[Row], columns: tuple[int, int, int], width: int, source: SourceText) -> list[Ring]:
    """The rings of a table: the outline, then the holes by their numbers."""
    x, y, ring_column = columns
    rings: dict[int, Ring] = {}
    reader = VertexReader(source)
    last = 0
    for row in rows:
        number = row.fields[ring_column] if 0 <= ring_column < len(row.fields) else "0"
        if faults := _row_faults(row, columns, width, number):
            reader.refuse(faults)
            continue
        if int(number) in rings and int(number) != last:
            message = f"ring {int(number)} goes on after ring {last}"
            reader.refuse([row.fault(ring_column, message, "the vertices of a ring together")])
        last = int(number)
        ring = rings.setdefault(last, Ring([], (row.line, row.columns[0])))
        reader.add(ring, float(row.fields[x]), float(row.fields[y]), (row.line, row.columns[min(x, y)]))
    reader.finish()
    if not rings:
        raise source.error((max(1, len(source.lines)), 1), "no vertices", "a row for each vertex")
    if 0 not in rings:
        location = next(iter(rings.values())).location
        raise source.error(location, "no outline", "rows of ring 0")
    return [rings[number] for number in sorted(rings)]


def _row_faults(row: Row, columns: tuple[int, int, int], width: int, ring: str) -> list[Fault]:
    """The faults of a row as a vertex of a ring."""
    if len(row.fields) < width or any(row.fields[width:]):
        message = counted(len(row.fields), "field", "fields")
        return [row.fault(min(len(row.fields), width), message, f"{width}, as in the first row")]
    faults = [row.fault(i, *wrong) for i in columns[:2] if (wrong := number_fault(row.fields[i]))]
    if not re.fullmatch("[0-9]{1,9}", ring):
        shown = printable(ring, 40) or "an empty field"
        faults.append(row.fault(columns[2], f"{shown} is no ring", "0 for the outline, 1, 2, … for the holes"))
    return faults
