"""The CSV format of power logs: times and power, or voltage and current, in columns under their names.

A row that is no reading is left out and counted in a warning: an empty cell, NaN, an infinity; also a voltage of 0 or
−1 and a current of −1, which autopilots write for unknown. A cell that is not a number is an error.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import chain

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import to_local_m
from eadp.errors import FAULTS_READ, Fault, InputError, printable, refuse
from eadp.io.text.csv import ISO_TIME, NOT_FINITE, NUMBER, Row, number_fault, read_rows, repeated
from eadp.io.text.streams import Text
from eadp.measure.power_log import (
    AIRSPEED,
    ALTITUDE,
    BANK,
    CLIMB,
    LARGEST_W,
    TIME_UNITS,
    Columns,
    LogReadings,
    PowerLog,
    in_order,
    rows_warning,
)

LARGEST_S = 1e12
SHORTEST_STEP_S, LONGEST_STEP_S = 5e-3, 60.0
"""Shortest and longest time between the rows of a log whose times are taken for PX4's [s]."""

# in units to a second, a watt, a volt, an ampere: a division keeps the digits that a product with 0.001 would not
_PER_UNIT = {
    "time": {
        **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
        **dict.fromkeys(("ms", "millisecond", "milliseconds"), 1e3),
        **dict.fromkeys(("us", "µs", "microsecond", "microseconds"), 1e6),
        **dict.fromkeys(("min", "minute", "minutes"), 1 / 60),
        "ns": 1e9,
        "h": 1 / 3600,
    },
    "power": {"w": 1.0, "watt": 1.0, "watts": 1.0, "mw": 1e3, "kw": 1e-3},
    "voltage": {"v": 1.0, "volt": 1.0, "volts": 1.0, "mv": 1e3},
    "current": {"a": 1.0, "amp": 1.0, "amps": 1.0, "ma": 1e3},
}
_STEMS = {
    "time": ("time", "timestamp", "t", "elapsed", "elapsed_time"),
    "power": ("power", "total_power"),
    "voltage": ("voltage", "volt"),
    "current": ("current", "curr"),
}
PX4_TIME = "timestamp"
"""The time of PX4's logs as CSV [µs]: the one name that is known without its unit."""
_EXAMPLES = {"time": "time_s", "power": "power_w", "voltage": "voltage_v", "current": "current_a"}
_POSITIONS = (("x_m", "y_m"), ("lat", "lon"), ("latitude", "longitude"), ("latitude_deg", "longitude_deg"))
_MOTION = {
    AIRSPEED: {
        "airspeed_mps": 1.0,
        "true_airspeed_mps": 1.0,
        "tas_mps": 1.0,
        "true_airspeed_m_s": 1.0,
        "airspeed": 1.0,
    },
    BANK: {"bank_rad": 1.0, "roll_rad": 1.0, "bank_deg": math.pi / 180, "roll_deg": math.pi / 180},
    CLIMB: {"climb_mps": 1.0, "climb_rate_mps": 1.0, "vertical_speed_mps": 1.0, "climb": 1.0, "vz_down_mps": -1.0},
    ALTITUDE: {"altitude_m": 1.0, "alt_m": 1.0, "height_m": 1.0, "altitude": 1.0},
}
"""Columns of the motion: the names known, and their unit in SI."""
USED = "discharged_mah"
"""Column of the charge used since the battery was put in, as PX4 names it [mAh]."""
_EXAMPLE = "time_s,power_w"


def read_csv_log(text: Text, columns: Columns) -> PowerLog:
    """Read a power log with a header.

    Raises
    ------
    InputError
        With the faults of the file or of `columns`.
    """
    if columns.instance is not None:
        raise InputError.at("--instance", 1, 1, "a table has no batteries", "none of it", str(columns.instance))
    rows = read_rows(text.name, text.body, None)
    first = next(rows, None)
    if first is None:
        raise InputError.at(text.name, 1, 1, "no readings", f"a header such as {_EXAMPLE}, and a row for each")
    second = next(rows, None)
    layout = _layout(first, columns, second)
    readings, warnings, counts = _readings(text.name, chain([second] if second else [], rows), layout)
    if layout.px4 and len(readings.raw) > 1:
        _check_step(first, layout, float(np.median(np.abs(np.diff(readings.raw)))) / layout.per[0])
    names = [first.fields[i] for i in layout.index[1:]]
    position, also = layout.position, layout.also
    log = in_order(text.name, readings, layout.per[0], warnings, counts, position=position, also=also, names=names)
    return replace(log, battery={"used_ah": float(log.also[USED][0])}) if USED in log.also else log


# ── columns ──


@dataclass(frozen=True)
class _Layout:
    """Where time comes first and what makes the power follows: columns, and how many of their units make an SI one."""

    index: list[int]
    per: list[float]
    width: int  # fields of a row
    others: list[int] = field(
        default_factory=list
    )  # columns that may be empty: two of a position, then those asked for
    scales: list[float] = field(default_factory=list)  # SI units in a unit of those columns
    dates: bool = False  # times by ISO 8601
    position: bool = False
    degrees: bool = False
    origin_deg: Point | None = None
    also: tuple[str, ...] = ()
    px4: bool = False  # whether the times are taken for PX4's


def _layout(header: Row, columns: Columns, second: Row | None) -> _Layout:
    """The layout of a header; the second row shows whether the times are dates."""
    if all(NUMBER.match(name) or NOT_FINITE.match(name) for name in header.fields):
        message = "the first row has numbers, not the names of columns"
        raise InputError(header.fault(0, message, f"a header such as {_EXAMPLE}"))
    if twice := repeated(header.fields):
        message = f"the name {printable(header.fields[twice[0]], 80)} stands twice"
        raise InputError(header.fault(twice[0], message, "each column under a name of its own"))
    layout = _Layout([], [], len(header.fields), origin_deg=columns.origin_deg)
    for role in ("time", *_power_roles(header, columns)):
        index = _find(header, role, getattr(columns, role))
        layout.index.append(index)
        if role == "time" and second and index < len(second.fields) and ISO_TIME.match(second.fields[index]):
            columns, layout = replace(columns, time_unit="s"), replace(layout, dates=True)
        layout.per.append(_per_unit(header, index, role, columns.time_unit))
    px4 = not columns.time_unit and _plain(header.fields[layout.index[0]]) == PX4_TIME
    return _with_others(replace(layout, px4=px4), header, columns)


def _check_step(header: Row, layout: _Layout, step_s: float) -> None:
    """Refuse rows that are nearer or farther apart than a log's, if the times are taken for PX4's."""
    if not SHORTEST_STEP_S <= step_s <= LONGEST_STEP_S and step_s > 0:
        message = f"a row every {step_s:.3g} s, if {PX4_TIME} is in µs"
        raise InputError(header.fault(layout.index[0], message, "a name such as time_s or time_ms, or --time-unit"))


def _with_others(layout: _Layout, header: Row, columns: Columns) -> _Layout:
    """The layout with the columns of a position, if there are some, and those that are asked for by name."""
    lower = [name.lower() for name in header.fields]
    pair = next((pair for pair in _POSITIONS if all(name in lower for name in pair)), None)
    others = [lower.index(name) for name in pair] if pair else []
    for name in columns.also:
        if name not in header.fields:
            known = ", ".join(printable(name, 40) for name in header.fields[:20] if name)
            raise InputError(header.fault(0, f"no column {printable(name, 80)}", f"one beside {known}"))
        others.append(header.fields.index(name))
    degrees = pair is not None and pair[0] != "x_m"
    also, scales = [*columns.also], [1.0] * len(others)
    if columns.factors and USED in lower:
        others.append(lower.index(USED))
        also.append(USED)
        scales.append(1e-3)
    for role, names in _MOTION.items() if columns.motion else ():
        if found := next((name for name in names if name in lower), None):
            others.append(lower.index(found))
            also.append(role)
            scales.append(names[found])
    return replace(layout, others=others, scales=scales, position=pair is not None, degrees=degrees, also=tuple(also))


def _power_roles(header: Row, columns: Columns) -> tuple[str, ...]:
    """Power, or voltage and current: what is asked for, else what there is, power first."""
    if columns.power and (columns.voltage or columns.current):
        raise InputError.at("--power", 1, 1, "and --voltage or --current", "one way to the power", columns.power)
    if columns.factors:
        return ("voltage", "current")
    if columns.power or (not columns.voltage and not columns.current and _named(header, "power")):
        return ("power",)
    if columns.voltage or columns.current or (_named(header, "voltage") and _named(header, "current")):
        return ("voltage", "current")
    message = "no column for the power"
    raise InputError(header.fault(0, message, "power_w, or voltage_v and current_a, or --power NAME"))


def _find(header: Row, role: str, asked: str) -> int:
    """The column of a role."""
    if asked:
        if asked in header.fields:
            return header.fields.index(asked)
        known = ", ".join(printable(name, 40) for name in header.fields[:20] if name)
        raise InputError.at(f"--{role}", 1, 1, f"no column {printable(asked, 80)}", f"one of {known}", asked)
    found = _named(header, role)
    if not found:
        raise InputError(header.fault(0, f"no column for the {role}", f"{_EXAMPLES[role]}, or --{role} NAME"))
    if len(found) > 1:
        several = ", ".join(header.fields[i] for i in found)
        raise InputError(header.fault(found[1], f"several columns of {role}: {several}", f"one, or --{role} NAME"))
    return found[0]


def _named(header: Row, role: str) -> list[int]:
    """Columns with a known name of a role, with a unit (`power_w`, `Power [W]`) or without."""
    names = [{_plain(name), _stem_and_unit(name, role)[0]} for name in header.fields]
    return [i for i, either in enumerate(names) if either.intersection(_STEMS[role])]


def _plain(name: str) -> str:
    """A name in small letters: `Time [ms]` and `time_ms` are the same."""
    return "_".join(filter(None, re.split(r"[\s_()\[\]-]+", name.lower())))


def _stem_and_unit(name: str, role: str) -> tuple[str, str]:
    """`time_ms` → time, ms; nothing where the ending is no unit of the role."""
    stem, _, unit = _plain(name).rpartition("_")
    return (stem, unit) if unit in _PER_UNIT[role] else ("", "")


def _per_unit(header: Row, index: int, role: str, time_unit: str | None) -> float:
    """How many of a column's units make a second, watt, volt, ampere."""
    name, known = header.fields[index], _PER_UNIT[role]
    if role == "time" and (time_unit or _plain(name) == PX4_TIME):
        return known[time_unit or "us"]
    if unit := _stem_and_unit(name, role)[1]:
        return known[unit]
    option = f", or --time-unit {'|'.join(TIME_UNITS)}" if role == "time" else ""
    message = f"{printable(name, 80)} has no unit of {role}"
    raise InputError(header.fault(index, message, f"a name such as {_EXAMPLES[role]}{option}"))


# ── rows ──

_REASONS = {
    "empty": "with an empty cell",
    "not_finite": "with a cell that is not finite",
    "unknown": "with an unknown voltage (0 or -1) or current (-1)",
}


def _readings(
    name: str, rows: Iterable[Row], layout: _Layout
) -> tuple[LogReadings, list[Fault], dict[str, int | float]]:
    """The rows that are readings; warnings for those that are not, and their numbers."""
    lines, values, others = array("q"), array("d"), array("d")
    faults: list[Fault] = []
    dropped: dict[str, list[int]] = {}
    limits = [LARGEST_S, *[LARGEST_W] * (len(layout.index) - 1)]
    columns = [(index, limit * per) for index, per, limit in zip(layout.index, layout.per, limits, strict=True)]
    count = 0
    for row in rows:
        if len(faults) >= FAULTS_READ:
            break
        count += 1
        if any(row.fields[layout.width :]):
            message = f"{len(row.fields)} fields"
            faults.append(row.fault(layout.width, message, f"{layout.width}, as in the header"))
            continue
        found = _values(row, columns, dates=layout.dates)
        if isinstance(found, Fault):
            faults.append(found)
        elif isinstance(found, str):
            dropped.setdefault(found, []).append(row.line)
        else:
            lines.append(row.line)
            values.extend(found)
            others.extend(_optional(row.fields, i) for i in layout.others)
    refuse(faults)
    warnings = [rows_warning(name, numbers, f"{_REASONS[key]} left out") for key, numbers in dropped.items()]
    counts: dict[str, int | float] = {"rows": count, **{key: len(numbers) for key, numbers in dropped.items()}}
    table = np.array(values).reshape(len(lines), len(columns))
    rest = np.array(others).reshape(len(lines), len(layout.others)) * layout.scales
    if layout.degrees and len(rest):
        rest[:, :2] = _metres(name, rest[:, :2], lines, layout.origin_deg)
    readings = LogReadings(table[:, 0], table[:, 1:] / layout.per[1:], rest, np.array(lines, dtype=np.int64))
    return readings, warnings, counts


def _values(row: Row, columns: Sequence[tuple[int, float]], *, dates: bool = False) -> list[float] | str | Fault:
    """The values of the columns, up to a limit each; or why the row is no reading; or the fault of a cell."""
    values: list[float] = []
    reason = ""
    for index, limit in columns:
        raw = row.fields[index] if index < len(row.fields) else ""
        if dates and not values and raw:
            time_s = _seconds(raw)
            if time_s is None:
                return row.fault(index, f"{printable(raw, 40)} is no time by ISO 8601", "a time as in the first row")
            values.append(time_s)
        elif NUMBER.match(raw) and abs(value := float(raw)) <= limit:
            values.append(value)
        elif not raw:
            reason = "empty"
        elif NOT_FINITE.match(raw):
            reason = "not_finite"
        elif fault := number_fault(raw, limit):
            return row.fault(index, *fault)
    if not reason and len(values) == 3 and (values[1] <= 0 or values[2] == -1):
        reason = "unknown"
    return reason or values


def _seconds(raw: str) -> float | None:
    """Seconds since 1970 of a time by ISO 8601, or with slashes in its date, of UTC without a zone; None if none."""
    try:
        time = datetime.fromisoformat(raw.replace("/", "-", 2))
    except ValueError:
        return None
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


def _optional(fields: Sequence[str], index: int) -> float:
    """A cell that may be missing: NaN."""
    return float(fields[index]) if index < len(fields) and NUMBER.match(fields[index]) else math.nan


def _metres(name: str, degrees: FloatArray, lines: Sequence[int], origin_deg: Point | None) -> FloatArray:
    """Latitude and longitude [°] as metres about an origin, the first of them for None; large numbers are 1e-7 °."""
    known = np.flatnonzero(np.isfinite(degrees).all(axis=1))
    if not len(known):
        return degrees
    scaled = degrees * (1e-7 if np.nanmax(np.abs(degrees)) > 1000 else 1.0)
    beyond = known[(np.abs(scaled[known]) > (90, 180)).any(axis=1)]
    if len(beyond):
        latitude, longitude = scaled[beyond[0]]
        message = f"a latitude of {latitude:.7g} and a longitude of {longitude:.7g}"
        swapped = ": they seem to be swapped" if abs(latitude) <= 180 and abs(longitude) <= 90 else ""
        expected = "latitude within ±90 and longitude within ±180 degrees"
        raise InputError.at(name, lines[beyond[0]], 1, f"{message}{swapped}", expected)
    origin = origin_deg or (float(scaled[known[0], 0]), float(scaled[known[0], 1]))
    result = np.full_like(degrees, np.nan)
    for i in known:
        result[i] = to_local_m(float(scaled[i, 0]), float(scaled[i, 1]), origin)
    return result
