"""GeoJSON as a draft of a field: the polygon of one feature, in degrees or metres."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from itertools import islice
from typing import Any

from eadp.errors import Fault, printable
from eadp.io.text.json import JsonList, JsonObject, JsonReader
from eadp.io.text.streams import Location, SourceText
from eadp.survey.field import (
    A_HEIGHT,
    BOUNDARIES,
    FIELDS,
    MAX_HEIGHT_M,
    NAME_KEYS,
    NAMES_SHOWN,
    OBSTACLES,
    FeatureCandidate,
    FeatureFormat,
    Ring,
    Units,
    VertexReader,
    counted,
    degrees_of,
    is_avoided,
    there_and_back,
)

_OUTLINES = "outlines"
"""Closed lines, besides what `draft` lists."""

_A_POLYGON = "a Polygon, or a Feature or FeatureCollection with one"

_ASSIGNED = re.compile(r"\s*+(?:var|let|const|export default)?\s*+[\w.$]{1,80}\s*+=\s*+(?=\{)")
_POSITION = "longitude, latitude and perhaps altitude, or x and y in metres"


def is_geojson(head: str) -> bool:
    """Whether a text that starts so is JSON, or a script that gives a name to it."""
    return head[0] in "{[" or _ASSIGNED.match(head) is not None


def _features(source: SourceText, metres: bool, want: str) -> list[FeatureCandidate]:
    """The features of a kind, one or more, with the obstacles beside them."""
    if match := _ASSIGNED.match(source.body):  # a script that holds the object: blanks keep its places
        body = " " * match.end() + source.body[match.end() :].rstrip().removesuffix(";")
        source.body = body
    root = JsonReader(source).document()
    start = source.location(len(source.body) - len(source.body.lstrip()))
    seen: Counter[str] = Counter()
    candidates = _collect(source, root, start, [], seen, want)
    if want in (FIELDS, BOUNDARIES) and not any(not each.thin for each in candidates):
        candidates += _collect(source, root, start, [], Counter(), _OUTLINES)
    if not any(want == OBSTACLES or not each.thin for each in candidates):
        only = ", ".join(printable(kind, 40) for kind in islice(seen, NAMES_SHOWN))
        raise source.error(start, f"no polygon, only {only}" if only else "no polygon", _A_POLYGON)
    return candidates


def _collect(
    source: SourceText, node: Any, location: Location, chain: Sequence[JsonObject], seen: Counter[str], want: str
) -> list[FeatureCandidate]:
    """The features of a kind at and below a GeoJSON object, and the obstacles there; counts the types of the others."""
    if not isinstance(node, JsonObject):
        raise source.error(location, f"{_kind(node)} where an object of GeoJSON belongs", _A_POLYGON)
    chain = [*chain, node]
    kind = node.get("type")
    if not isinstance(kind, str):
        raise source.error(location, "an object of GeoJSON without a type", _A_POLYGON)
    if kind == "FeatureCollection":
        features = _members(source, node, "features", location)
        return [
            found
            for item, offset in zip(features, features.offsets, strict=True)
            for found in _collect(source, item, source.location(offset), chain, seen, want)
        ]
    geometry, at, names = node, location, list[str]()
    if kind == "Feature":
        if node.get("geometry") is None:
            seen["a Feature without a geometry"] += 1
            return []
        geometry, at, names = node["geometry"], source.location(node.offsets["geometry"]), _names(node)
    avoided = is_avoided(names) and want != BOUNDARIES
    if avoided and want == _OUTLINES:
        return []  # which was found before
    wanted = OBSTACLES if avoided else want
    polygons, objects = _polygons(source, geometry, at, seen, wanted)
    if not polygons:
        return []
    # a geometry is its own first object
    own = [*chain, *objects] if kind == "Feature" else [*chain[:-1], *objects]
    thin = wanted == OBSTACLES and not any("Polygon" in str(each.get("type")) for each in objects)
    return [FeatureCandidate(location, names, polygons, own, _height_m(node, source), _properties(node), thin)]


def _polygons(
    source: SourceText, node: Any, location: Location, seen: Counter[str], want: str
) -> tuple[list[tuple[Any, Location]], list[JsonObject]]:
    """The polygons of a geometry, points and lines of obstacles among them, and the objects on the way to them."""
    if not isinstance(node, JsonObject) or not isinstance(kind := node.get("type"), str):
        raise source.error(location, "no geometry", "an object with a type and coordinates")
    if kind == "GeometryCollection":
        geometries = _members(source, node, "geometries", location)
        polygons: list[tuple[Any, Location]] = []
        objects = [node]
        for item, offset in zip(geometries, geometries.offsets, strict=True):
            more, way = _polygons(source, item, source.location(offset), seen, want)
            polygons += more
            objects += way if more else []
        return polygons, objects
    at = source.location(node.offsets.get("coordinates", 0))
    given = node.get("coordinates")
    if kind in ("LineString", "MultiLineString") and want in (OBSTACLES, _OUTLINES):
        each = [given] if kind == "LineString" else given if isinstance(given, JsonList) else []
        lines = [line for line in each if isinstance(line, JsonList) and _is_line(line, closed=want == _OUTLINES)]
        rings = [_returning(line) if want == OBSTACLES else line for line in lines]
        return [(_listed(ring, ring.offsets[0]), at) for ring in rings], [node]
    if kind in ("Point", "MultiPoint") and want == OBSTACLES:
        points = [given] if kind == "Point" else given if isinstance(given, JsonList) else []
        offset = node.offsets.get("coordinates", 0)
        return [(_listed(_listed(point, offset), offset), at) for point in points], [node]
    if kind not in ("Polygon", "MultiPolygon"):
        seen[f"a {kind}"] += 1
        return [], []
    coordinates = _members(source, node, "coordinates", location)
    if kind == "Polygon":
        return [(coordinates, source.location(node.offsets["coordinates"]))], [node]
    if not coordinates:
        raise source.error(source.location(node.offsets["coordinates"]), "a MultiPolygon of no polygons", "one")
    locations = [source.location(offset) for offset in coordinates.offsets]
    return list(zip(coordinates, locations, strict=True)), [node]


def _is_line(line: JsonList, *, closed: bool) -> bool:
    """Whether it is a line; with `closed`, whether it ends where it starts, and may have an area."""
    return len(line) > 1 and not (closed and (len(line) < 4 or line[0] != line[-1]))


def _listed(value: Any, offset: int) -> JsonList:
    """A list of one value."""
    result = JsonList()
    result.append(value)
    result.offsets.append(offset)
    return result


def _returning(line: JsonList) -> JsonList:
    """An open line as a ring without an area, a closed one as it is."""
    if _is_line(line, closed=True):
        return line
    result = JsonList()
    result += there_and_back(line)
    result.offsets += there_and_back(line.offsets)
    return result


def _members(source: SourceText, node: JsonObject, key: str, location: Location) -> JsonList:
    value = node.get(key)
    if not isinstance(value, JsonList):
        location = source.location(node.offsets[key]) if key in node else location
        raise source.error(location, f"no list of {key}", f"{key} with a list")
    return value


def _names(feature: JsonObject) -> list[str]:
    """The names of a feature: its name first, then its ids."""
    properties = feature.get("properties")
    given = [properties.get(key) for key in NAME_KEYS] if isinstance(properties, JsonObject) else []
    names = [str(value).strip() for value in (*given, feature.get("id")) if type(value) in (str, int, float)]
    return list(dict.fromkeys(name for name in names if name))


def _properties(feature: JsonObject) -> dict[str, str]:
    """The texts and numbers among the properties of a feature, as texts."""
    properties = feature.get("properties")
    items = properties.items() if isinstance(properties, JsonObject) else ()
    return {key: str(value).strip() for key, value in items if type(value) in (str, int, float)}


def _height_m(feature: JsonObject, source: SourceText) -> float | None:
    """The height of a feature above the field's origin [m], if its properties have one."""
    properties = feature.get("properties")
    if not isinstance(properties, JsonObject) or properties.get("height") is None:
        return None
    height = properties["height"]
    if type(height) not in (int, float) or not 0 <= height <= MAX_HEIGHT_M:
        location = source.location(properties.offsets["height"])
        raise source.error(location, "no height", A_HEIGHT)
    return float(height)


# the reference systems whose numbers are degrees as WGS-84 has them, to a metre; those whose metres are longer
_GEOGRAPHIC = {"4326", "4979", "4258", "4937"}
_WEB_MERCATOR = {"3857", "3785", "900913", "102100", "102113"}
_CODE = re.compile(r".*(EPSG|ESRI).*?([0-9]+)", re.IGNORECASE | re.DOTALL)
_IN_METRES = re.compile(r"\s*(?:m|met(?:re|er)s?)(?![\w/^*·])", re.IGNORECASE)
_OTHER_LENGTH = re.compile(
    r"\s*(?:ft|feet|foot|us-ft|yd|yards?|km|kilomet(?:re|er)s?|miles?|cm|mm)(?!\w)", re.IGNORECASE
)


def _units(chain: Sequence[JsonObject], metres: bool, source: SourceText) -> Units:
    """The units of coordinates: by the option, by `units` that start with metres, or by a `crs`."""
    properties = [node.get("properties") for node in chain]
    holders = [holder for holder in (*chain, *properties) if isinstance(holder, JsonObject)]
    units = [(holder, unit) for holder in holders if isinstance(unit := holder.get("units"), str)]
    in_metres = metres or any(_IN_METRES.match(unit) for _, unit in units)
    for holder, unit in units:
        if _OTHER_LENGTH.match(unit) and not in_metres:
            message = f"units of {printable(unit, 40)}"
            expected = "metres, or longitude and latitude in degrees"
            raise source.error(source.location(holder.offsets["units"]), message, expected)
    for node in reversed(chain):  # the innermost first
        if node.get("crs") is not None:
            return _system(node["crs"], source.location(node.offsets["crs"]), metres, source, in_metres)
    return Units(not in_metres, _remedy(in_metres, metres))


def _remedy(in_metres: bool, metres: bool) -> str:
    if not in_metres:
        return "--metres"
    return "no --metres" if metres else "a file without units in metres"


def _system(crs: Any, location: Location, metres: bool, source: SourceText, in_metres: bool) -> Units:
    """The units of a coordinate reference system; metres where the option has them, or `units` of an unknown one."""
    properties = crs.get("properties") if isinstance(crs, JsonObject) else None
    given: Any = None
    if isinstance(properties, JsonObject):
        given = properties.get("name", f"EPSG:{properties['code']}" if "code" in properties else None)
    name = given[:200] if isinstance(given, str) else ""
    codes = _CODE.fullmatch(name.rstrip().replace("EPSG/0/", "EPSG/"))
    authority, code = (codes[1].upper(), codes[2]) if codes else ("", "")
    if re.search(r"CRS84h?\Z", name, re.IGNORECASE) or (authority == "EPSG" and code in _GEOGRAPHIC):
        return Units(True, "--metres")
    if metres and code in _WEB_MERCATOR:
        message = f"{printable(name, 80)} is Web Mercator, whose metres are longer than metres away from the equator"
        raise source.error(location, message, "no --metres, which converts it to degrees")
    if metres or (in_metres and not codes):
        return Units(False, _remedy(True, metres))
    shown, otherwise = printable(name, 80) or "without a name", "longitude and latitude (WGS-84), or --metres"
    if not codes:
        raise source.error(location, f"the reference system {shown} is not known", otherwise)
    to_degrees = degrees_of((authority, code), shown, lambda *texts: source.error(location, *texts), otherwise)
    return Units(True, "--metres", to_degrees)


def _rings(polygon: Any, location: Location, source: SourceText) -> list[Ring]:
    if not isinstance(polygon, JsonList):
        raise source.error(location, f"{_kind(polygon)} where a polygon belongs", "a list of rings")
    if not polygon:
        raise source.error(location, "a polygon without rings", "a ring of positions")
    reader = VertexReader(source)
    rings = []
    for ring, offset in zip(polygon, polygon.offsets, strict=True):
        at = source.location(offset)
        if not isinstance(ring, JsonList):
            raise source.error(at, f"{_kind(ring)} where a ring belongs", "a list of positions")
        rings.append(Ring([], at))
        for position, start in zip(ring, ring.offsets, strict=True):
            if isinstance(position, tuple):
                reader.add(rings[-1], position[0], position[1], source.location(start))
            else:
                reader.refuse(_position_faults(position, start, source))
    reader.finish()
    return rings


def _position_faults(position: Any, offset: int, source: SourceText) -> list[Fault]:
    """The faults of a value as a position."""
    location = source.location(offset)
    if not isinstance(position, JsonList):
        return [source.fault(location, f"{_kind(position)} where a position belongs", f"a list: {_POSITION}")]
    if not 2 <= len(position) <= 3:
        return [source.fault(location, f"a position of {counted(len(position), 'number', 'numbers')}", _POSITION)]
    faults = []
    for value, at in zip(position, position.offsets, strict=True):
        if type(value) not in (int, float):
            faults.append(source.fault(source.location(at), f"{_kind(value)} is no number", "a number"))
        elif not math.isfinite(value):
            faults.append(source.fault(source.location(at), "a number too large", "a finite number"))
    return faults


def _kind(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {True: "true", False: "false", None: "null"}[value]
    kinds: dict[type, str] = {JsonObject: "an object", JsonList: "a list", tuple: "a list of numbers", str: "a string"}
    return kinds.get(type(value), "a number")


GEOJSON = FeatureFormat(_features, _rings, _units)
