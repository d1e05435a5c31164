"""Fields to cover: GeoJSON, KML or a CSV of vertices as an outline and holes in local metres.

A file is told by its first character: `{` begins GeoJSON, `<` KML, and anything else is a table of vertices. Degrees
are those of WGS-84; they become metres east and north in the tangent plane at the middle of the outline. What can be
mended without a question is, and is said; what cannot is refused at the vertex where it shows.
"""

from __future__ import annotations

import json
import math
import re
import xml.parsers.expat
from array import array
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import accumulate, chain, islice
from typing import Any, NamedTuple

from eadp.core.geodesy import to_geodetic_deg, to_local_m
from eadp.errors import FAULTS_SHOWN, Fault, InputError, capped, printable
from eadp.io.csv_text import NOT_FINITE, NUMBER, Row, split_fields
from eadp.io.streams import Text
from eadp.models.field import Field

VERTICES_LIMIT = 20_000
HOLES_LIMIT = 1_000
EXTENT_LIMIT_M = 50_000.0
"""Largest width and height [m]: beyond it the tangent plane is no map of a field."""
_SMALLER = f"a field of at most {EXTENT_LIMIT_M / 1000:g} km either way"
_WIDEST_DEG, _HIGHEST_DEG = 10.0, 1.0
"""Longitudes and latitudes [°] that are always more than `EXTENT_LIMIT_M` apart, up to `LATITUDE_LIMIT_DEG`."""
LATITUDE_LIMIT_DEG = 85.0
LARGEST_M = 1e8
"""Largest coordinate in metres: grids have numbers of seven or eight digits."""
SMALLEST_M2 = 1.0
NESTING_LIMIT = 50
NAMES_SHOWN = 10

_DEGREES = "longitude within ±180 and latitude within ±90 degrees"
_POSITION = "longitude, latitude and perhaps altitude, or x and y in metres"

Place = tuple[int, int]
"""Line and column, from 1."""


class _Vertex(NamedTuple):
    """A vertex as its file has it: x is east, or longitude; y is north, or latitude."""

    x: float
    y: float
    line: int
    column: int


@dataclass
class _Ring:
    vertices: list[_Vertex]
    place: Place


@dataclass
class _Draft:
    """What a file says before it is judged.

    `closes` is whether the format repeats the first vertex of a ring at its end; `remedy` is the end of what was
    expected where the unit seems to be another.
    """

    rings: list[_Ring]
    degrees: bool
    closes: bool
    remedy: str
    name: str = ""
    notes: list[str] = field(default_factory=list)


class _Source:
    """The text by lines, to name places in."""

    def __init__(self, text: Text) -> None:
        self.name, self.body, self.lines = text.name, text.body, text.body.split("\n")

    @cached_property
    def starts(self) -> Sequence[int]:
        """Offsets of the lines; as an array, since a text may be all line ends."""
        return array("q", accumulate((len(line) + 1 for line in self.lines), initial=0))

    def place(self, offset: int) -> Place:
        """Line and column of an offset."""
        line = bisect_right(self.starts, offset, hi=len(self.lines))
        return line, offset - self.starts[line - 1] + 1

    def fault(self, place: Place, message: str, expected: str = "") -> Fault:
        line, column = place
        source = self.lines[line - 1] if line <= len(self.lines) else ""
        return Fault(self.name, line, column, message, expected, source)

    def error(self, place: Place, message: str, expected: str = "") -> InputError:
        return InputError(self.fault(place, message, expected))


def read_field(text: Text, *, metres: bool = False, feature: str | None = None) -> tuple[Field, list[str]]:
    """Read the outline and the holes of a field.

    Parameters
    ----------
    text : Text
        GeoJSON (a Polygon, a MultiPolygon of one, or a Feature, FeatureCollection or GeometryCollection with one), KML
        (a Placemark with a Polygon), or a CSV of vertices: columns `x_m,y_m` or `lon,lat` and perhaps `ring` (0 the
        outline, 1.. the holes), or two columns without names.
    metres : bool, optional
        The file is in metres, x east and y north; without, it is where it says so, and in WGS-84 degrees elsewhere.
    feature : str, optional
        Of several features, the one to read: its id, its name, or its number from 1 among those with polygons.

    Returns
    -------
    field : Field
        Metres; the vertices as they stand in the file, the first of them first, but for those that were dropped and
        rings that were turned.
    mended : list of str
        What was put right on the way, a sentence each.

    Raises
    ------
    InputError
        With the faults of the file, each at its line and column, or of the options.
    """
    source = _Source(text)
    first = text.body.lstrip()[:1]
    if not first:
        raise source.error((1, 1), "is empty", "a field as GeoJSON, KML or a CSV of vertices")
    read = _read_geojson if first in "{[" else _read_kml if first == "<" else _read_table
    return _settled(read(source, metres, feature), source)


def _many(count: int, one: str, several: str) -> str:
    return f"1 {one}" if count == 1 else f"{count} {several}"


# ── GeoJSON ──


class _List(list[Any]):
    """A JSON list; `offsets` are those of its elements. One of two or three finite numbers is a tuple instead."""

    __slots__ = ("offsets",)

    def __init__(self) -> None:
        self.offsets: list[int] = []


class _Object(dict[str, Any]):
    """A JSON object; `offsets` are those of its values."""

    __slots__ = ("offsets",)

    def __init__(self) -> None:
        self.offsets: dict[str, int] = {}


_SPACE = re.compile(r"[ \t\n\r]*")
_JSON_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]*+)(?:\.[0-9]++)?(?:[eE][-+]?[0-9]++)?")
_JSON_POSITION = re.compile(r"\[N,N(?:,N)?\]".replace("N", rf"[ \t\n\r]*+({_JSON_NUMBER.pattern})[ \t\n\r]*+"))
_JSON_WORD = re.compile(r"-?[A-Za-z]+")
_JSON_WORDS = {"true": True, "false": False, "null": None}


class _Json:
    """A reader of JSON that keeps the offset of every value, which the standard library's does not."""

    def __init__(self, source: _Source) -> None:
        self.source, self.body, self.decoder = source, source.body, json.JSONDecoder()

    def document(self) -> Any:
        """The value that the text is."""
        value, i = self._value(self._skip(0), 1)
        if i < len(self.body):
            raise self._fail(i, "the end of the file")
        return value

    def _skip(self, i: int) -> int:
        match = _SPACE.match(self.body, i)
        assert match is not None
        return match.end()

    def _fail(self, i: int, expected: str) -> InputError:
        found = printable(self.body[i : i + 1]) if i < len(self.body) else "the end of the file"
        return self.source.error(self.source.place(i), f"is not JSON: {found} cannot stand here", expected)

    def _value(self, i: int, depth: int) -> tuple[Any, int]:
        """The value at an offset, and the offset of what follows it and the blanks after it."""
        if depth > NESTING_LIMIT:
            raise self.source.error(self.source.place(i), f"nested deeper than {NESTING_LIMIT} levels")
        c = self.body[i : i + 1]
        value: Any
        if c == "[":
            position = _JSON_POSITION.match(self.body, i)
            value = tuple(float(number) for number in position.groups() if number) if position else ()
            if position and all(map(math.isfinite, value)):  # by far the most lists of a file
                return value, self._skip(position.end())
            value, end = self._list(i + 1, depth)
        elif c == "{":
            value, end = self._object(i + 1, depth)
        elif c == '"':
            value, end = self._string(i)
        elif number := _JSON_NUMBER.match(self.body, i):
            end = number.end()
            value = int(number[0]) if re.fullmatch("-?[0-9]{1,17}", number[0]) else float(number[0])
        elif (word := _JSON_WORD.match(self.body, i)) and word[0] in _JSON_WORDS:
            value, end = _JSON_WORDS[word[0]], word.end()
        elif word and word[0].lstrip("-") in ("NaN", "Infinity"):
            raise self.source.error(self.source.place(i), f"{word[0]} is no number of JSON", "a finite number")
        else:
            raise self._fail(i, "a value")
        return value, self._skip(end)

    def _string(self, i: int) -> tuple[str, int]:
        try:
            value, end = self.decoder.raw_decode(self.body, i)
        except json.JSONDecodeError as error:
            message = f"is not JSON: {printable(error.msg[:1].lower() + error.msg[1:])}"
            raise self.source.error(self.source.place(error.pos), message, "a string in quotes") from None
        return str(value), end

    def _list(self, i: int, depth: int) -> tuple[_List, int]:
        result = _List()
        i = self._skip(i)
        if self.body[i : i + 1] == "]":
            return result, i + 1
        while True:
            result.offsets.append(i)
            value, i = self._value(i, depth + 1)
            result.append(value)
            c = self.body[i : i + 1]
            if c == "]":
                return result, i + 1
            if c != ",":
                raise self._fail(i, "a comma or ]")
            i = self._skip(i + 1)

    def _object(self, i: int, depth: int) -> tuple[_Object, int]:
        result = _Object()
        i = self._skip(i)
        if self.body[i : i + 1] == "}":
            return result, i + 1
        while True:
            if self.body[i : i + 1] != '"':
                raise self._fail(i, "a key in quotes")
            at = i
            key, i = self._string(i)
            if key in result:
                message = f"the key {printable(key, 80)} stands twice"
                raise self.source.error(self.source.place(at), message, "each key once")
            i = self._skip(i)
            if self.body[i : i + 1] != ":":
                raise self._fail(i, "a colon")
            i = self._skip(i + 1)
            result.offsets[key] = i
            result[key], i = self._value(i, depth + 1)
            c = self.body[i : i + 1]
            if c == "}":
                return result, i + 1
            if c != ",":
                raise self._fail(i, "a comma or }")
            i = self._skip(i + 1)


@dataclass
class _Candidate:
    """A feature with polygons: where it stands, what it may be called, and its polygons, each with its place.

    `chain` are the objects from the document to the polygons, which may say what the units are.
    """

    place: Place
    names: list[str]
    polygons: list[tuple[Any, Place]]
    chain: list[_Object] = field(default_factory=list)

    @property
    def label(self) -> str:
        return printable(self.names[0], 40) if self.names else "without a name"


_A_POLYGON = "a Polygon, or a Feature or FeatureCollection with one"


def _read_geojson(source: _Source, metres: bool, feature: str | None) -> _Draft:
    root = _Json(source).document()
    start = source.place(len(source.body) - len(source.body.lstrip()))
    candidates: list[_Candidate] = []
    seen: Counter[str] = Counter()
    _collect(source, root, start, [], candidates, seen)
    if not candidates:
        only = ", ".join(printable(kind, 40) for kind in islice(seen, NAMES_SHOWN))
        raise source.error(start, f"no polygon, only {only}" if only else "no polygon", _A_POLYGON)
    chosen = _chosen(candidates, feature, source)
    polygon, place = _only_polygon(chosen, source)
    # before the vertices: a fault of theirs may come of the units
    in_metres = _says_metres(chosen.chain, metres, source)
    rings = _json_rings(polygon, place, source)
    remedy = "no --metres" if metres else "a file that does not say that it is in metres"
    return _Draft(rings, not in_metres, True, remedy if in_metres else "--metres", "".join(chosen.names[:1]))


def _collect(
    source: _Source,
    node: Any,
    place: Place,
    chain: Sequence[_Object],
    found: list[_Candidate],
    seen: Counter[str],
) -> None:
    """Gather the features with polygons at and below a GeoJSON object, and count the types of what has none."""
    if not isinstance(node, _Object):
        raise source.error(place, f"{_kind(node)} where an object of GeoJSON belongs", _A_POLYGON)
    chain = [*chain, node]
    kind = node.get("type")
    if not isinstance(kind, str):
        raise source.error(place, "an object of GeoJSON without a type", _A_POLYGON)
    if kind == "FeatureCollection":
        features = _members(source, node, "features", place)
        for item, offset in zip(features, features.offsets, strict=True):
            _collect(source, item, source.place(offset), chain, found, seen)
    elif kind == "Feature":
        geometry = node.get("geometry")
        if geometry is None:
            seen["a Feature without a geometry"] += 1
            return
        polygons, objects = _polygons(source, geometry, source.place(node.offsets["geometry"]), seen)
        if polygons:
            found.append(_Candidate(place, _names(node), polygons, [*chain, *objects]))
    else:
        polygons, objects = _polygons(source, node, place, seen)
        if polygons:
            found.append(_Candidate(place, [], polygons, [*chain[:-1], *objects]))


def _polygons(
    source: _Source, node: Any, place: Place, seen: Counter[str]
) -> tuple[list[tuple[Any, Place]], list[_Object]]:
    """The polygons of a geometry, and the objects on the way to them."""
    if not isinstance(node, _Object) or not isinstance(kind := node.get("type"), str):
        raise source.error(place, "no geometry", "an object with a type and coordinates")
    if kind == "GeometryCollection":
        geometries = _members(source, node, "geometries", place)
        polygons: list[tuple[Any, Place]] = []
        objects = [node]
        for item, offset in zip(geometries, geometries.offsets, strict=True):
            more, way = _polygons(source, item, source.place(offset), seen)
            polygons += more
            objects += way if more else []
        return polygons, objects
    if kind not in ("Polygon", "MultiPolygon"):
        seen[f"a {kind}"] += 1
        return [], []
    coordinates = _members(source, node, "coordinates", place)
    if kind == "Polygon":
        return [(coordinates, source.place(node.offsets["coordinates"]))], [node]
    if not coordinates:
        raise source.error(source.place(node.offsets["coordinates"]), "a MultiPolygon of no polygons", "one")
    places = [source.place(offset) for offset in coordinates.offsets]
    return list(zip(coordinates, places, strict=True)), [node]


def _members(source: _Source, node: _Object, key: str, place: Place) -> _List:
    value = node.get(key)
    if not isinstance(value, _List):
        place = source.place(node.offsets[key]) if key in node else place
        raise source.error(place, f"no list of {key}", f"{key} with a list")
    return value


def _names(feature: _Object) -> list[str]:
    """What a feature may be called: its name first, then its ids."""
    properties = feature.get("properties")
    said = [properties.get(key) for key in ("name", "Name", "id")] if isinstance(properties, _Object) else []
    names = [str(value).strip() for value in (*said, feature.get("id")) if type(value) in (str, int, float)]
    return list(dict.fromkeys(name for name in names if name))


def _chosen(candidates: Sequence[_Candidate], feature: str | None, source: _Source) -> _Candidate:
    """The feature that was asked for, or the only one."""
    shown = [f"{i} {candidate.label}" for i, candidate in enumerate(candidates[:NAMES_SHOWN], 1)]
    known = "; ".join(shown) + (f"; and {len(candidates) - NAMES_SHOWN} more" if len(candidates) > NAMES_SHOWN else "")
    if feature is None:
        if len(candidates) == 1:
            return candidates[0]
        message = f"{len(candidates)} features with polygons"
        raise source.error(candidates[1].place, message, f"one, or --feature with a name or number of {known}")
    named = [candidate for candidate in candidates if feature.strip() in candidate.names]
    if len(named) > 1:
        message = f"{len(named)} features are called {printable(feature, 80)}"
        raise InputError.at("--feature", 1, 1, message, f"a name or number of {known}", printable(feature, 80))
    if named:
        return named[0]
    if re.fullmatch("[0-9]{1,7}", feature.strip()) and 1 <= int(feature) <= len(candidates):
        return candidates[int(feature) - 1]
    message = f"no feature {printable(feature, 80)} with a polygon"
    raise InputError.at("--feature", 1, 1, message, f"a name or number of {known}", printable(feature, 80))


def _only_polygon(chosen: _Candidate, source: _Source) -> tuple[Any, Place]:
    if len(chosen.polygons) > 1:
        message = f"{len(chosen.polygons)} polygons in one feature"
        raise source.error(chosen.polygons[1][1], message, "one polygon: each part of a field in a file of its own")
    return chosen.polygons[0]


# the reference systems whose numbers are degrees as WGS-84 has them, to a metre; those whose numbers are metres
_GEOGRAPHIC = {"4326", "4979", "4258", "4937"}
_WEB_MERCATOR = {"3857", "3785", "900913", "102100", "102113"}
_GRID = re.compile(
    r"258(2[89]|3[0-8])|32[67](0[1-9]|[1-5][0-9]|60)"  # UTM on ETRS89 and WGS-84
    r"|2154|28992|2056|21781|31370|3812|3067|3006|27700"  # the grids of FR, NL, CH, CH, BE, BE, FI, SE, GB
)
_CODE = re.compile(r".*EPSG.*?([0-9]+)", re.IGNORECASE | re.DOTALL)
_IN_METRES = re.compile(r"\s*(?:m|met(?:re|er)s?)(?![\w/^*·])", re.IGNORECASE)
_OTHER_LENGTH = re.compile(
    r"\s*(?:ft|feet|foot|us-ft|yd|yards?|km|kilomet(?:re|er)s?|miles?|cm|mm)(?!\w)", re.IGNORECASE
)


def _says_metres(chain: Sequence[_Object], metres: bool, source: _Source) -> bool:
    """Whether coordinates are in metres: by the option, by `units` that begin with metres, or by a grid's `crs`."""
    properties = [node.get("properties") for node in chain]
    holders = [holder for holder in (*chain, *properties) if isinstance(holder, _Object)]
    units = [(holder, said) for holder in holders if isinstance(said := holder.get("units"), str)]
    metres = metres or any(_IN_METRES.match(said) for _, said in units)
    for holder, said in units:
        if _OTHER_LENGTH.match(said) and not metres:
            message = f"units of {printable(said, 40)}"
            expected = "metres, or longitude and latitude in degrees"
            raise source.error(source.place(holder.offsets["units"]), message, expected)
    for node in reversed(chain):  # the innermost that says it
        if node.get("crs") is not None:
            return _system(node["crs"], source.place(node.offsets["crs"]), metres, source) or metres
    return metres


def _system(crs: Any, place: Place, metres: bool, source: _Source) -> bool:
    """Whether a coordinate reference system is one in metres; one that is not known is what is said elsewhere."""
    properties = crs.get("properties") if isinstance(crs, _Object) else None
    said: Any = None
    if isinstance(properties, _Object):
        said = properties.get("name", f"EPSG:{properties['code']}" if "code" in properties else None)
    name = said[:200] if isinstance(said, str) else ""
    if re.search(r"CRS84h?\Z", name, re.IGNORECASE):
        return False
    codes = _CODE.fullmatch(name.rstrip().replace("EPSG/0/", "EPSG/"))
    code = codes[1] if codes else ""
    if code in _WEB_MERCATOR:
        message = f"{printable(name, 80)} is Web Mercator, whose metres are longer than metres away from the equator"
        raise source.error(place, message, "longitude and latitude in degrees, or a UTM zone")
    if code in _GEOGRAPHIC or _GRID.fullmatch(code):
        return code not in _GEOGRAPHIC
    if metres:
        return True
    message = f"the reference system {printable(name, 80) or 'without a name'} is not known"
    raise source.error(place, message, "longitude and latitude in degrees (WGS-84), a UTM zone, or --metres")


def _json_rings(polygon: Any, place: Place, source: _Source) -> list[_Ring]:
    if not isinstance(polygon, _List):
        raise source.error(place, f"{_kind(polygon)} where a polygon belongs", "a list of rings")
    if not polygon:
        raise source.error(place, "a polygon without rings", "a ring of positions")
    reader = _VertexReader(source)
    rings = []
    for ring, offset in zip(polygon, polygon.offsets, strict=True):
        at = source.place(offset)
        if not isinstance(ring, _List):
            raise source.error(at, f"{_kind(ring)} where a ring belongs", "a list of positions")
        rings.append(_Ring([], at))
        for position, start in zip(ring, ring.offsets, strict=True):
            if isinstance(position, tuple):
                reader.add(rings[-1], position[0], position[1], source.place(start))
            else:
                reader.refuse(_json_faults(position, start, source))
    reader.finish()
    return rings


def _json_faults(position: Any, offset: int, source: _Source) -> list[Fault]:
    """What keeps a value from being a position."""
    place = source.place(offset)
    if not isinstance(position, _List):
        return [source.fault(place, f"{_kind(position)} where a position belongs", f"a list: {_POSITION}")]
    if not 2 <= len(position) <= 3:
        return [source.fault(place, f"a position of {_many(len(position), 'number', 'numbers')}", _POSITION)]
    faults = []
    for value, at in zip(position, position.offsets, strict=True):
        if type(value) not in (int, float):
            faults.append(source.fault(source.place(at), f"{_kind(value)} is no number", "a number"))
        elif not math.isfinite(value):
            faults.append(source.fault(source.place(at), "a number too large", "a finite number"))
    return faults


def _kind(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {True: "true", False: "false", None: "null"}[value]
    kinds: dict[type, str] = {_Object: "an object", _List: "a list", tuple: "a list of numbers", str: "a string"}
    return kinds.get(type(value), "a number")


class _VertexReader:
    """Adds vertices to rings, up to the limit, and gathers the faults of those that are none."""

    def __init__(self, source: _Source) -> None:
        self.source = source
        self.faults: list[Fault] = []
        self.count = 0

    def add(self, ring: _Ring, x: float, y: float, place: Place) -> None:
        """A vertex at its place."""
        self._count(place)
        ring.vertices.append(_Vertex(x, y, *place))

    def refuse(self, faults: Sequence[Fault]) -> None:
        """The faults of what should have been a vertex."""
        self.faults += faults
        self._count((faults[0].line, faults[0].column))

    def _count(self, place: Place) -> None:
        self.count += 1
        if self.count > VERTICES_LIMIT:
            self.finish()
            message = f"more than {VERTICES_LIMIT} vertices"
            raise self.source.error(place, message, f"at most {VERTICES_LIMIT}: a simpler outline")

    def finish(self) -> None:
        """Raise the faults, if there are any."""
        if self.faults:
            raise capped(self.faults)


def _number_fault(raw: str) -> tuple[str, str] | None:
    """What is wrong with a text as a finite number, and what would be right."""
    shown = printable(raw, 40) or "an empty field"
    if NUMBER.match(raw):
        return None if math.isfinite(float(raw)) else (f"{shown} is too large", "a finite number")
    if NOT_FINITE.match(raw):
        return f"{shown} is not finite", "a finite number"
    return f"{shown} is not a number", "a number"


# ── KML ──


_OUTER, _INNER = "outerBoundaryIs", "innerBoundaryIs"
_RING_PATHS = [["Polygon", role, "LinearRing", "coordinates"] for role in (_OUTER, _INNER)]


@dataclass
class _KmlRing:
    """The text of a ring's coordinates in pieces, each with its place; blanks between them are pieces of their own."""

    role: str
    place: Place
    pieces: list[tuple[str, Place]] = field(default_factory=list)
    blanks: int = 0

    def add(self, text: str, place: Place) -> None:
        """Add a piece; not behind so many that the ring will be refused for its length."""
        if self.blanks > VERTICES_LIMIT:
            return
        if not text.isspace():
            self.pieces.append((text, place))
        elif self.pieces and self.pieces[-1][0] != " ":
            self.pieces.append((" ", place))
            self.blanks += 1


class _Kml:
    """Gathers the Placemarks with polygons. What could refer to other texts, a DTD, is refused."""

    def __init__(self, source: _Source) -> None:
        self.source = source
        self.found: list[_Candidate] = []
        self.path: list[str] = []
        self.placemark: _Candidate | None = None
        self.name: list[str] = []
        self.parser = xml.parsers.expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text

    def document(self) -> list[_Candidate]:
        try:
            self.parser.Parse(self.source.body, True)
        except xml.parsers.expat.ExpatError as error:
            place = (error.lineno, error.offset + 1)
            reason = xml.parsers.expat.ErrorString(error.code)
            raise self.source.error(place, f"is not XML: {reason}", "a KML file") from None
        return self.found

    def _place(self) -> Place:
        return self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1

    def _doctype(self, *_: object) -> None:
        message = "a document type, through which a file may draw on others"
        raise self.source.error(self._place(), message, "a KML file without <!DOCTYPE>")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        local = tag.rpartition(":")[2]
        self.path.append(local)
        if local == "Placemark":
            identity = [attributes["id"]] if attributes.get("id") else []
            self.placemark, self.name = _Candidate(self._place(), identity, []), []
        elif local == "Polygon":
            holder = self.placemark
            if holder is None:
                holder = _Candidate(self._place(), [], [])
                self.found.append(holder)
            elif not holder.polygons:
                self.found.append(holder)
            holder.polygons.append(([], self._place()))
        elif self.path[-4:] in _RING_PATHS:
            self._polygon().append(_KmlRing(self.path[-3], self._place()))

    def _polygon(self) -> list[_KmlRing]:
        rings: list[_KmlRing] = self.found[-1].polygons[-1][0]
        return rings

    def _text(self, data: str) -> None:
        if self.path[-4:] in _RING_PATHS:
            self._polygon()[-1].add(data, self._place())
        elif self.path[-2:] == ["Placemark", "name"]:
            self.name.append(data)

    def _end(self, tag: str) -> None:
        local = self.path.pop()
        if local == "name" and self.path[-1:] == ["Placemark"] and self.placemark:
            self.placemark.names[:0] = filter(None, ["".join(self.name).strip()])
        elif local == "Placemark":
            self.placemark = None


def _read_kml(source: _Source, metres: bool, feature: str | None) -> _Draft:
    if metres:
        raise InputError.at("--metres", 1, 1, "a KML file is in degrees (WGS-84)", "KML without --metres")
    candidates = _Kml(source).document()
    if not candidates:
        raise source.error((1, 1), "no polygon", "KML with a Polygon in a Placemark")
    chosen = _chosen(candidates, feature, source)
    polygon, place = _only_polygon(chosen, source)
    outer = [ring for ring in polygon if ring.role == _OUTER]
    if len(outer) != 1:
        place = outer[1].place if outer else place
        message = "a second outline" if outer else "a Polygon without an outline"
        raise source.error(place, message, f"one {_OUTER} with a LinearRing of coordinates")
    reader = _VertexReader(source)
    rings = [_kml_ring(ring, reader) for ring in (*outer, *(ring for ring in polygon if ring.role == _INNER))]
    reader.finish()
    return _Draft(rings, True, True, "", "".join(chosen.names[:1]))


def _kml_ring(ring: _KmlRing, reader: _VertexReader) -> _Ring:
    """The vertices of a ring: tuples apart by blanks, each `longitude,latitude[,altitude]`."""
    text = "".join(piece for piece, _ in ring.pieces)
    starts = list(accumulate((len(piece) for piece, _ in ring.pieces), initial=0))
    result = _Ring([], ring.place)
    for token in re.finditer(r"\S+", text):
        piece = bisect_right(starts, token.start(), hi=len(ring.pieces)) - 1
        line, column = ring.pieces[piece][1]
        place = (line, column + token.start() - starts[piece])
        parts = token[0].split(",")
        columns = accumulate((len(part) + 1 for part in parts), initial=place[1])
        faults = [
            reader.source.fault((line, at), *wrong)
            for part, at in zip(parts, columns, strict=False)
            if (wrong := _number_fault(part))
        ]
        if not 2 <= len(parts) <= 3:
            expected = "longitude,latitude or longitude,latitude,altitude without blanks"
            faults = [reader.source.fault(place, f"{printable(token[0], 40)} is no position", expected)]
        if faults:
            reader.refuse(faults)
        else:
            reader.add(result, float(parts[0]), float(parts[1]), place)
    return result


# ── tables of vertices ──


_ROLES = {
    **dict.fromkeys(("x", "x_m", "east", "east_m", "easting", "easting_m"), "x"),
    **dict.fromkeys(("y", "y_m", "north", "north_m", "northing", "northing_m"), "y"),
    **dict.fromkeys(("lon", "lng", "long", "longitude", "lon_deg", "longitude_deg"), "lon"),
    **dict.fromkeys(("lat", "latitude", "lat_deg", "latitude_deg"), "lat"),
    "ring": "ring",
}
_A_HEADER = "a header such as x_m,y_m or lon,lat"


def _read_table(source: _Source, metres: bool, feature: str | None) -> _Draft:
    if feature is not None:
        raise InputError.at("--feature", 1, 1, "a table of vertices has no features", "a table without --feature")
    rows = _rows(source)
    head = next(rows, None)
    if head is None:
        raise source.error((1, 1), "no vertices", f"{_A_HEADER}, and a row for each vertex")
    if not all(NUMBER.match(text) or NOT_FINITE.match(text) for text in head.fields):
        columns, in_degrees = _header(head, metres)
        rings = _table_rings(rows, columns, len(head.fields), source)
        return _Draft(rings, in_degrees, False, f"columns called {'x_m and y_m' if in_degrees else 'lon and lat'}")
    if len(head.fields) != 2:
        message = f"{_many(len(head.fields), 'column', 'columns')} without names"
        raise InputError(head.fault(min(2, len(head.fields)), message, f"two, or {_A_HEADER}"))
    rings = _table_rings(chain([head], rows), (0, 1, -1), 2, source)
    if metres:
        return _Draft(rings, False, False, "a header lon,lat and no --metres")
    if all(abs(vertex.x) <= 180 and abs(vertex.y) <= 90 for vertex in rings[0].vertices):
        message = "columns without names, which may be degrees or metres"
        raise InputError(head.fault(0, message, "--metres, or a header such as lon,lat or x_m,y_m"))
    note = "taken as metres, since there are values beyond the ±180 and ±90 of degrees"
    return _Draft(rings, False, False, "a header lon,lat", notes=[note])


def _rows(source: _Source) -> Iterator[Row]:
    """The rows of a table, their fields apart by what is in the first: semicolons, tabs, commas or blanks."""
    split: Callable[[str], tuple[list[str], list[int]]] | None = None
    for number, line in enumerate(source.lines, 1):
        if not line.strip() or line.lstrip()[0] == "#":
            continue
        if split is None:
            mark = next((mark for mark in ";\t," if mark in line), "")
            split = split_fields if mark == "," else partial(_split, mark)
        yield Row(source.name, number, line, *split(line))


def _split(mark: str, line: str) -> tuple[list[str], list[int]]:
    """As `split_fields`, at another mark than a comma, which cannot be within a field; without one, at blanks."""
    pieces = [(match.start(), match[0]) for match in re.finditer(r"\S+", line)]
    if mark:
        raw = line.split(mark)
        pieces = list(zip(accumulate((len(text) + 1 for text in raw), initial=0), raw, strict=False))
    fields = [text.strip() for _, text in pieces]
    columns = [at + 1 + (len(text) - len(text.lstrip()) if text.strip() else 0) for at, text in pieces]
    return [text[1:-1].strip() if re.fullmatch('".*"', text) else text for text in fields], columns


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


def _table_rings(rows: Iterable[Row], columns: tuple[int, int, int], width: int, source: _Source) -> list[_Ring]:
    """The rings of a table: the outline, then the holes by their numbers."""
    x, y, ring_column = columns
    rings: dict[int, _Ring] = {}
    reader = _VertexReader(source)
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
        ring = rings.setdefault(last, _Ring([], (row.line, row.columns[0])))
        reader.add(ring, float(row.fields[x]), float(row.fields[y]), (row.line, row.columns[min(x, y)]))
    reader.finish()
    if not rings:
        raise source.error((max(1, len(source.lines)), 1), "no vertices", "a row for each vertex")
    if 0 not in rings:
        place = next(iter(rings.values())).place
        raise source.error(place, "no outline", "rows of ring 0")
    return [rings[number] for number in sorted(rings)]


def _row_faults(row: Row, columns: tuple[int, int, int], width: int, ring: str) -> list[Fault]:
    """What keeps a row from being a vertex of a ring."""
    if len(row.fields) < width or any(row.fields[width:]):
        message = _many(len(row.fields), "field", "fields")
        return [row.fault(min(len(row.fields), width), message, f"{width}, as in the first row")]
    faults = [row.fault(i, *wrong) for i in columns[:2] if (wrong := _number_fault(row.fields[i]))]
    if not re.fullmatch("[0-9]{1,9}", ring):
        shown = printable(ring, 40) or "an empty field"
        faults.append(row.fault(columns[2], f"{shown} is no ring", "0 for the outline, 1, 2, … for the holes"))
    return faults


# ── from what the file says to a field ──


def _settled(draft: _Draft, source: _Source) -> tuple[Field, list[str]]:
    """The field of a draft, mended and found sound, and what was mended."""
    from eadp.core.polygons import signed_area_m2

    notes = list(draft.notes)
    _check_counts(draft, source)
    origin_deg: tuple[float, float] | None = None
    rings = [ring.vertices for ring in draft.rings]
    if draft.degrees:
        rings, origin_deg = _localised(rings, draft, source, notes)
    else:
        _check_metres(rings, draft, source)
    _check_extent(rings, draft, source)
    rings = _mended(rings, draft, source, notes)
    _check_shape(rings, origin_deg, source)
    corners = [tuple((vertex.x, vertex.y) for vertex in ring) for ring in rings]
    turned = [signed_area_m2(ring) > 0 for ring in corners]
    result = Field(
        corners[0] if turned[0] else (corners[0][0], *corners[0][:0:-1]),
        tuple((ring[0], *ring[:0:-1]) if up else ring for ring, up in zip(corners[1:], turned[1:], strict=True)),
        printable(draft.name),
        origin_deg,
    )
    if result.area_m2 < SMALLEST_M2:
        message = f"an area of {result.area_m2:.3g} m²"
        raise source.error(_place(rings[0][0]), message, f"{SMALLEST_M2:g} m² or more")
    if not turned[0]:
        notes.append("winding of the outline turned")
    if holes := sum(turned[1:]):
        notes.append(f"winding of {_many(holes, 'hole', 'holes')} turned")
    return result, notes


def _check_counts(draft: _Draft, source: _Source) -> None:
    """Refuse rings without three vertices, and more holes than there may be."""
    if len(draft.rings) - 1 > HOLES_LIMIT:
        place = draft.rings[HOLES_LIMIT + 1].place
        raise source.error(place, f"more than {HOLES_LIMIT} holes", f"at most {HOLES_LIMIT}")
    faults = []
    for i, ring in enumerate(draft.rings):
        count = len({vertex[:2] for vertex in ring.vertices})
        if count < 3:
            place = _place(ring.vertices[0]) if ring.vertices else ring.place
            message = f"{_title(i)} has {_many(count, 'vertex', 'vertices')}"
            faults.append(source.fault(place, message, "three or more that differ"))
    if faults:
        raise capped(faults)


def _place(vertex: _Vertex) -> Place:
    return vertex.line, vertex.column


def _title(ring: int) -> str:
    return f"hole {ring}" if ring else "the outline"


def _localised(
    rings: Sequence[Sequence[_Vertex]], draft: _Draft, source: _Source, notes: list[str]
) -> tuple[list[list[_Vertex]], tuple[float, float]]:
    """Degrees as metres east and north of the middle of the outline, and that middle as latitude and longitude [°]."""
    _check_degrees(rings, draft, source)
    rings = [list(ring) for ring in rings]
    west, east = _span([vertex.x for vertex in rings[0]])
    if east - west > 180:
        moved = [[v._replace(x=v.x + 360) if v.x < 0 else v for v in ring] for ring in rings]
        from_west, to_east = _span([vertex.x for vertex in moved[0]])
        if to_east - from_west < _WIDEST_DEG:
            rings, west, east = moved, from_west, to_east
            notes.append("longitudes counted on across the antimeridian")
    south, north = _span([vertex.y for vertex in rings[0]])
    middle = (west + east) / 2
    origin = (round((south + north) / 2, 7) + 0.0, round(middle - 360 if middle > 180 else middle, 7) + 0.0)
    start = rings[0][0]
    for vertex in chain.from_iterable(rings):
        # refused before they are projected: the plane folds the far side of the earth onto this one
        dx, dy = abs(vertex.x - start.x), abs(vertex.y - start.y)
        if dx > _WIDEST_DEG or dy > _HIGHEST_DEG:
            message = f"{dx:.6g}° of longitude and {dy:.6g}° of latitude from the first vertex"
            raise source.error(_place(vertex), message, _or(_SMALLER, draft.remedy))
    return [[_at(vertex, to_local_m(vertex.y, vertex.x, origin)) for vertex in ring] for ring in rings], origin


def _at(vertex: _Vertex, point: tuple[float, float]) -> _Vertex:
    return vertex._replace(x=point[0], y=point[1])


def _or(expected: str, remedy: str) -> str:
    return f"{expected}, or {remedy}" if remedy else expected


def _span(values: Sequence[float]) -> tuple[float, float]:
    return min(values), max(values)


def _check_degrees(rings: Sequence[Sequence[_Vertex]], draft: _Draft, source: _Source) -> None:
    """Refuse what cannot be degrees: metres, or longitude and latitude in each other's place."""
    vertices = [vertex for ring in rings for vertex in ring]
    beyond = [vertex for vertex in vertices if abs(vertex.x) > 180 or abs(vertex.y) > 90]
    if beyond:
        first = beyond[0]
        which, value, limit = ("longitude", first.x, 180) if abs(first.x) > 180 else ("latitude", first.y, 90)
        message = f"a {which} of {value:.10g} is beyond ±{limit}, as in {len(beyond)} of {len(vertices)} vertices"
        if all(abs(vertex.x) <= 90 and abs(vertex.y) <= 180 for vertex in vertices):
            message = f"a latitude of {value:.10g} is beyond ±90: longitude and latitude seem to have changed places"
        raise source.error(_place(first), message, _or(_DEGREES, draft.remedy))
    for vertex in vertices:
        if abs(vertex.y) > LATITUDE_LIMIT_DEG:
            message = f"a latitude of {vertex.y:.10g}, near a pole"
            raise source.error(_place(vertex), message, f"latitudes within ±{LATITUDE_LIMIT_DEG:g}")


def _check_metres(rings: Sequence[Sequence[_Vertex]], draft: _Draft, source: _Source) -> None:
    """Refuse what cannot be metres: numbers without end, and degrees."""
    far = [vertex for ring in rings for vertex in ring if max(abs(vertex.x), abs(vertex.y)) > LARGEST_M]
    if far:
        message = f"a vertex at ({far[0].x:.3g}, {far[0].y:.3g}) m"
        raise source.error(_place(far[0]), message, f"coordinates of at most {LARGEST_M:g} m")
    (west, east), (south, north) = (_span([vertex[i] for vertex in rings[0]]) for i in (0, 1))
    degrees = max(abs(west), abs(east)) <= 180 and max(abs(south), abs(north)) <= 90
    if degrees and max(east - west, north - south) < 1:
        message = f"a field of {east - west:.3g} m by {north - south:.3g} m, if these are metres and not degrees"
        raise source.error(_place(rings[0][0]), message, _or("a larger field", draft.remedy))


def _check_extent(rings: Sequence[Sequence[_Vertex]], draft: _Draft, source: _Source) -> None:
    """Refuse what is too large, at the vertex furthest from the first."""
    vertices = [vertex for ring in rings for vertex in ring]
    (west, east), (south, north) = (_span([vertex[i] for vertex in vertices]) for i in (0, 1))
    if max(east - west, north - south) > EXTENT_LIMIT_M:
        start = vertices[0]
        furthest = max(vertices, key=lambda vertex: math.dist(vertex[:2], start[:2]))
        message = f"{(east - west) / 1000:.4g} km by {(north - south) / 1000:.4g} km"
        raise source.error(_place(furthest), message, _or(_SMALLER, draft.remedy))


def _mended(
    rings: Sequence[Sequence[_Vertex]], draft: _Draft, source: _Source, notes: list[str]
) -> list[list[_Vertex]]:
    """The rings open and without vertices that say nothing; the faults of those that nothing is left of."""
    from eadp.core.polygons import TOLERANCE_M, tidy

    counts: Counter[str] = Counter()
    faults: list[Fault] = []
    result = []
    for i, ring in enumerate(rings):
        closed = len(ring) > 1 and math.dist(ring[0][:2], ring[-1][:2]) < TOLERANCE_M
        vertices = list(ring[:-1] if closed else ring)
        counts["closed" if closed else "open"] += 1
        tidied = tidy([(vertex.x, vertex.y) for vertex in vertices])
        if len(tidied.kept) < 3:
            message = f"{_title(i)} has no area"
            faults.append(source.fault(_place(ring[0]), message, "vertices that do not lie on one line"))
        counts.update(repeated=tidied.repeated, in_line=tidied.in_line, spikes=tidied.spikes)
        result.append([vertices[j] for j in tidied.kept])
    if faults:
        raise capped(faults)
    if draft.closes and counts["open"]:
        notes.append(f"{_many(counts['open'], 'open ring', 'open rings')} closed")
    if not draft.closes and counts["closed"]:
        notes.append(f"{_many(counts['closed'], 'closing vertex', 'closing vertices')} dropped")
    for key, one, several in (
        ("repeated", "repeated vertex", "repeated vertices"),
        ("in_line", "vertex in line with its neighbours", "vertices in line with their neighbours"),
        ("spikes", "spike", "spikes"),
    ):
        if counts[key]:
            notes.append(f"{_many(counts[key], one, several)} dropped")
    return result


def _check_shape(rings: Sequence[Sequence[_Vertex]], origin_deg: tuple[float, float] | None, source: _Source) -> None:
    """Refuse rings that cross themselves or one another, at the vertex of the ring that is nearest to where."""
    from eadp.core.polygons import flaws

    outline, *holes = [[(vertex.x, vertex.y) for vertex in ring] for ring in rings]
    faults = []
    for flaw in islice(flaws(outline, holes), FAULTS_SHOWN):
        x, y = flaw.point_m
        where = f"({x:.2f}, {y:.2f}) m"
        if origin_deg is not None:
            latitude, longitude = to_geodetic_deg(x, y, origin_deg)
            where = f"longitude {longitude:.7f}, latitude {latitude:.7f}, which is {where}"
        nearest = min(rings[flaw.ring], key=lambda vertex: math.dist(vertex[:2], (x, y)))
        expected = "holes within the outline and apart from one another"
        if flaw.message.endswith("itself"):
            expected = "a ring that neither crosses nor touches itself"
        faults.append(source.fault(_place(nearest), f"{_title(flaw.ring)} {flaw.message} at {where}", expected))
    if faults:
        raise capped(faults)
