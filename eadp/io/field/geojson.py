"""GeoJSON as a draft of a field: the polygon of one feature, in degrees or metres."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from itertools import islice
from typing import Any

from eadp.errors import Fault, printable
from eadp.io.field.draft import (
    NAME_KEYS,
    NAMES_SHOWN,
    FeatureCandidate,
    FeatureFormat,
    Ring,
    VertexReader,
    counted,
)
from eadp.io.text.json import JsonList, JsonObject, JsonReader
from eadp.io.text.source import Location, SourceText

_OUTLINES, _LINES = ("closed",), ("closed", "open")
"""Which lines are read."""

_A_POLYGON = "a Polygon, or a Feature or FeatureCollection with one"
MAX_HEIGHT_M = 10_000.0
"""Largest height of an obstacle [m]."""

_ASSIGNED = re.compile(r"\s*(?:var|let|const|export default)?\s*[\w.$]{1,80}\s*=\s*(?=\{)")
_POSITION = "longitude, latitude and perhaps altitude, or x and y in metres"


def is_geojson(head: str) -> bool:
    """Whether a text that starts so is JSON, or a script that gives a name to it."""
    return head[0] in "{[" or _ASSIGNED.match(head) is not None


def _features(source: SourceText, metres: bool, lines: bool) -> list[FeatureCandidate]:
    """The features with polygons, one or more; or with `lines` those with lines."""
    if match := _ASSIGNED.match(source.body):  # a script that holds the object: blanks keep its places
        body = " " * match.end() + source.body[match.end() :].rstrip().removesuffix(";")
        source.body = body
    root = JsonReader(source).document()
    start = source.location(len(source.body) - len(source.body.lstrip()))
    candidates: list[FeatureCandidate] = []
    seen: Counter[str] = Counter()
    _collect(source, root, start, [], candidates, seen, lines=_LINES if lines else ())
    if not candidates and not lines:
        _collect(source, root, start, [], candidates, Counter(), lines=_OUTLINES)
    if not candidates:
        only = ", ".join(printable(kind, 40) for kind in islice(seen, NAMES_SHOWN))
        expected = f"{_A_POLYGON}: of a pole, one round it" if set(seen) == {"Point"} else _A_POLYGON
        if lines:
            expected = "a LineString; a polygon is covered without --corridor"
        elif any("LineString" in kind for kind in seen):
            expected += "; of a line, --corridor WIDTH"
        what = "line" if lines else "polygon"
        raise source.error(start, f"no {what}, only {only}" if only else f"no {what}", expected)
    return candidates


def _collect(
    source: SourceText,
    node: Any,
    location: Location,
    chain: Sequence[JsonObject],
    found: list[FeatureCandidate],
    seen: Counter[str],
    *,
    lines: tuple[str, ...] = (),
) -> None:
    """Collect the features with polygons at and below a GeoJSON object, and count the types of the others.

    With `lines` it is those with lines: `_OUTLINES` are closed, `_LINES` are any.
    """
    if not isinstance(node, JsonObject):
        raise source.error(location, f"{_kind(node)} where an object of GeoJSON belongs", _A_POLYGON)
    chain = [*chain, node]
    kind = node.get("type")
    if not isinstance(kind, str):
        raise source.error(location, "an object of GeoJSON without a type", _A_POLYGON)
    if kind == "FeatureCollection":
        features = _members(source, node, "features", location)
        for item, offset in zip(features, features.offsets, strict=True):
            _collect(source, item, source.location(offset), chain, found, seen, lines=lines)
    elif kind == "Feature":
        geometry = node.get("geometry")
        if geometry is None:
            seen["a Feature without a geometry"] += 1
            return
        polygons, objects = _polygons(source, geometry, source.location(node.offsets["geometry"]), seen, lines)
        if polygons:
            height_m = _height_m(node, source)
            own = [*chain, *objects]
            found.append(FeatureCandidate(location, _names(node), polygons, own, height_m, _properties(node)))
    else:
        polygons, objects = _polygons(source, node, location, seen, lines)
        if polygons:
            found.append(FeatureCandidate(location, [], polygons, [*chain[:-1], *objects]))


def _polygons(
    source: SourceText, node: Any, location: Location, seen: Counter[str], lines: tuple[str, ...]
) -> tuple[list[tuple[Any, Location]], list[JsonObject]]:
    """The polygons of a geometry, and the objects on the way to them."""
    if not isinstance(node, JsonObject) or not isinstance(kind := node.get("type"), str):
        raise source.error(location, "no geometry", "an object with a type and coordinates")
    if kind == "GeometryCollection":
        geometries = _members(source, node, "geometries", location)
        polygons: list[tuple[Any, Location]] = []
        objects = [node]
        for item, offset in zip(geometries, geometries.offsets, strict=True):
            more, way = _polygons(source, item, source.location(offset), seen, lines)
            polygons += more
            objects += way if more else []
        return polygons, objects
    if lines and kind in ("LineString", "MultiLineString"):
        given = node.get("coordinates")
        each = [given] if kind == "LineString" else given if isinstance(given, JsonList) else []
        at = source.location(node.offsets.get("coordinates", 0))
        return [(_closed(line), at) for line in each if _is_line(line, closed=lines == _OUTLINES)], [node]
    if kind not in ("Polygon", "MultiPolygon") or lines == _LINES:
        seen[f"a {kind}"] += 1
        return [], []
    coordinates = _members(source, node, "coordinates", location)
    if kind == "Polygon":
        return [(coordinates, source.location(node.offsets["coordinates"]))], [node]
    if not coordinates:
        raise source.error(source.location(node.offsets["coordinates"]), "a MultiPolygon of no polygons", "one")
    locations = [source.location(offset) for offset in coordinates.offsets]
    return list(zip(coordinates, locations, strict=True)), [node]


def _is_line(line: Any, *, closed: bool) -> bool:
    """Whether it is a line; with `closed`, whether it ends where it starts, and may have an area."""
    return isinstance(line, JsonList) and len(line) > 1 and not (closed and (len(line) < 4 or line[0] != line[-1]))


def _closed(line: Any) -> JsonList:
    """A polygon with a line as its outline."""
    polygon = JsonList()
    polygon.append(line)
    polygon.offsets.append(line.offsets[0])
    return polygon


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
        raise source.error(location, "no height", f"metres above the field, from 0 to {MAX_HEIGHT_M:g}")
    return float(height)


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


def _units(chain: Sequence[JsonObject], metres: bool, source: SourceText) -> tuple[bool, str]:
    in_metres = _in_metres(chain, metres, source)
    remedy = "no --metres" if metres else "a file without units or crs in metres"
    return not in_metres, remedy if in_metres else "--metres"


def _in_metres(chain: Sequence[JsonObject], metres: bool, source: SourceText) -> bool:
    """Whether coordinates are in metres: by the option, by `units` that start with metres, or by a grid's `crs`."""
    properties = [node.get("properties") for node in chain]
    holders = [holder for holder in (*chain, *properties) if isinstance(holder, JsonObject)]
    units = [(holder, unit) for holder in holders if isinstance(unit := holder.get("units"), str)]
    metres = metres or any(_IN_METRES.match(unit) for _, unit in units)
    for holder, unit in units:
        if _OTHER_LENGTH.match(unit) and not metres:
            message = f"units of {printable(unit, 40)}"
            expected = "metres, or longitude and latitude in degrees"
            raise source.error(source.location(holder.offsets["units"]), message, expected)
    for node in reversed(chain):  # the innermost first
        if node.get("crs") is not None:
            return _system(node["crs"], source.location(node.offsets["crs"]), metres, source) or metres
    return metres


def _system(crs: Any, location: Location, metres: bool, source: SourceText) -> bool:
    """Whether a coordinate reference system is in metres; `metres` where it is unknown."""
    properties = crs.get("properties") if isinstance(crs, JsonObject) else None
    given: Any = None
    if isinstance(properties, JsonObject):
        given = properties.get("name", f"EPSG:{properties['code']}" if "code" in properties else None)
    name = given[:200] if isinstance(given, str) else ""
    if re.search(r"CRS84h?\Z", name, re.IGNORECASE):
        return False
    codes = _CODE.fullmatch(name.rstrip().replace("EPSG/0/", "EPSG/"))
    code = codes[1] if codes else ""
    if code in _WEB_MERCATOR:
        message = f"{printable(name, 80)} is Web Mercator, whose metres are longer than metres away from the equator"
        raise source.error(location, message, "longitude and latitude in degrees, or a UTM zone")
    if code in _GEOGRAPHIC or _GRID.fullmatch(code):
        return code not in _GEOGRAPHIC
    if metres:
        return True
    message = f"the reference system {printable(name, 80) or 'without a name'} is not known"
    raise source.error(location, message, "longitude and latitude in degrees (WGS-84), a UTM zone, or --metres")


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
