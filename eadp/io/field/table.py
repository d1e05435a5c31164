"""A table of vertices as a draft of a field: a row for each, in metres or degrees, and perhaps the number of its ring.

Columns are recognised by their names in the first row; two columns without names are east and north in metres.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import chain

from eadp.errors import Fault, InputError, printable
from eadp.io.field.draft import FieldDraft, Ring, VertexReader, counted
from eadp.io.text.csv import NOT_FINITE, NUMBER, Row, number_fault, read_rows
from eadp.io.text.source import SourceText

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
        rings = _rings(rows, columns, len(head.fields), source)
        return FieldDraft(rings, in_degrees, False, f"columns called {'x_m and y_m' if in_degrees else 'lon and lat'}")
    if len(head.fields) != 2:
        message = f"{counted(len(head.fields), 'column', 'columns')} without names"
        raise InputError(head.fault(min(2, len(head.fields)), message, f"two, or {_A_HEADER}"))
    rings = _rings(chain([head], rows), (0, 1, -1), 2, source)
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


def _rings(rows: Iterable[Row], columns: tuple[int, int, int], width: int, source: SourceText) -> list[Ring]:
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
