"""Shapefiles as GeoJSON: each record a feature in a line of its number, in degrees where the .prj says what it is in.

This is the one door to pyshp (the extra `fields`), imported where a shapefile is read.
"""

from __future__ import annotations

import codecs
import io
import json
import math
import warnings
from collections.abc import Callable
from typing import Any

from eadp.core.geometry.curves import Point
from eadp.errors import InputError, printable
from eadp.io.field.systems import degrees_of
from eadp.io.text.streams import Text

MAGIC = b"\x00\x00\x27\x0a"
"""The first bytes of a .shp file."""


def shapefile_text(name: str, read: Callable[[str], bytes | None]) -> Text:
    """The text of a GeoJSON with the shapes of a shapefile.

    Parameters
    ----------
    name : str
        For messages.
    read : function
        The content of the file with an ending: `.shp`, and of those beside it, None where there is none.

    Raises
    ------
    InputError
        If the extra is not installed, a file is damaged, or its reference system is not known.
    """
    try:
        import shapefile
    except ImportError:
        message = "pyshp, which reads shapefiles, is missing"
        raise InputError.at(name, 1, 1, message, "pip install 'eadp[fields]'") from None
    body, table, encoding = read(".shp"), read(".dbf"), (read(".cpg") or b"utf-8").decode("ascii", "replace").strip()
    assert body is not None
    features = []
    shapefile.VERBOSE = False
    try:
        with (
            warnings.catch_warnings(action="ignore"),  # what is odd in a field, its reader says
            shapefile.Reader(
                shp=io.BytesIO(body),
                dbf=None if table is None else io.BytesIO(table),
                encoding=_encoding(encoding),
                encodingErrors="replace",
            ) as reader,
        ):
            for i, shape in enumerate(reader.iterShapes()):
                values = {} if table is None else reader.record(i).as_dict()
                features.append((shape.__geo_interface__ if shape.points else None, values))
    except Exception as error:  # pyshp raises whatever its parsing runs into
        message = f"cannot be read as a shapefile: {printable(str(error), 200)}"
        raise InputError.at(name, 1, 1, message, "a .shp with its .dbf") from None
    to_degrees = _to_degrees(name, read(".prj"))
    lines = [
        json.dumps(
            {
                "type": "Feature",
                "properties": {key: _value(value) for key, value in values.items()},
                "geometry": geometry and _moved(geometry, to_degrees),
            }
        )
        for geometry, values in features
    ]
    return Text(name, '{"type": "FeatureCollection", "features": [' + ",\n".join(lines) + "]}\n")


def _encoding(name: str) -> str:
    """A codec of Python: that of a .cpg file if it is known."""
    try:
        return codecs.lookup(name).name
    except (LookupError, ValueError):
        return "utf-8"


def _value(value: Any) -> Any:
    """A value of a record as JSON has it."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def _to_degrees(name: str, prj: bytes | None) -> Callable[[float, float], Point]:
    """What makes longitude and latitude [°, WGS-84] of a file's coordinates; nothing without a .prj."""
    if prj is None:
        return lambda x, y: (x, y)

    def error(message: str, expected: str) -> InputError:
        return InputError.at(name, 1, 1, message, expected)

    wkt = prj.decode("utf-8", "replace")
    found = degrees_of(wkt, f"of its .prj, {printable(wkt, 60)},", error, "one by WKT")

    def to_degrees(x: float, y: float) -> Point:
        place = found(x, y)
        if place is None:
            message = f"a vertex at ({x:.6g}, {y:.6g}) lies outside the reference system of its .prj"
            raise error(message, "coordinates of that system")
        return place

    return to_degrees


def _moved(node: Any, to_degrees: Callable[[float, float], Point]) -> Any:
    """A geometry with its positions, in two dimensions, in degrees."""
    if isinstance(node, dict):
        return {key: _moved(value, to_degrees) for key, value in node.items()}
    if not isinstance(node, (list, tuple)):
        return node
    if len(node) >= 2 and isinstance(node[0], (int, float)):
        return to_degrees(float(node[0]), float(node[1]))
    return [_moved(each, to_degrees) for each in node]
