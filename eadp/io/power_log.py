"""Power logs: a CSV of times and power, or of voltage and current, as times and watts.

A reading that is no reading is left out and counted in a warning: an empty cell, NaN, an infinity, a row cut off; of a
voltage and a current also 0 and −1, by which autopilots mean that they do not know. A cell that is not a number
is an error. Rows out of order are sorted; of rows at one time the first is kept.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eadp.core.spectrum import MIN_SAMPLES, FloatArray
from eadp.errors import Fault, InputError, capped, printable
from eadp.io.csv_text import NOT_FINITE, NUMBER, Row, split_fields
from eadp.io.streams import Text, read_text

LARGEST_W = 1e9
"""Largest power, voltage or current [W, V, A]: beyond it, a log is not of a small aircraft."""
LARGEST_S = 1e12
SHORTEST_S = 1e-3

# in units to a second, a watt, a volt, an ampere: a division keeps the digits that a product with 0.001 would not
_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "µs": 1e6, "ns": 1e9, "min": 1 / 60, "h": 1 / 3600}
_PER_UNIT = {
    "time": _PER_SECOND,
    "power": {"w": 1.0, "mw": 1e3, "kw": 1e-3},
    "voltage": {"v": 1.0, "mv": 1e3},
    "current": {"a": 1.0, "ma": 1e3},
}
_STEMS = {
    "time": ("time", "timestamp", "t", "elapsed", "elapsed_time"),
    "power": ("power",),
    "voltage": ("voltage", "volt", "volts"),
    "current": ("current", "curr", "amps"),
}
_STEM_AND_UNIT = re.compile(r"(.*?)(?:\s*[\[(]\s*(\w+)\s*[\])]|[ _-]([^\W_]+))?\Z", re.DOTALL)
NAME_LIMIT = 200
"""A longer name of a column is no name: its unit is not looked for, which would take the square of its length."""
_BINARY = {b"ULog\x01\x12": "a PX4 ULog", b"\xa3\x95": "an ArduPilot DataFlash log"}
_EXAMPLE = "time_s,power_w"


@dataclass(frozen=True)
class Columns:
    """Which columns to read, as far as their own names do not say it; '' leaves it to them.

    `names` are those of the first columns of a file without a header, '' for a column to skip.
    """

    time: str = ""
    power: str = ""
    voltage: str = ""
    current: str = ""
    names: Sequence[str] = ()
    time_unit: str = ""


@dataclass(frozen=True, eq=False)
class PowerLog:
    """Readings of power.

    Attributes
    ----------
    name : str
        The file.
    times_s : array, shape (n,)
        Times from the first reading, strictly increasing [s].
    power_w : array, shape (n,)
        Power [W].
    warnings : list of Fault
        What was left out or put in order.
    """

    name: str
    times_s: FloatArray
    power_w: FloatArray
    warnings: list[Fault] = field(default_factory=list)


def read_power_log(path: str, columns: Columns | None = None) -> PowerLog:
    """Read a power log.

    Parameters
    ----------
    path : str
        A CSV file, `-` for standard input.
    columns : Columns, optional
        Which columns to read. Default: those whose names say so, `time_s` or `timestamp` (µs), and `power_w`, or
        `voltage_v` and `current_a`.

    Returns
    -------
    PowerLog

    Raises
    ------
    InputError
        With the faults of the file or of `columns`; and if fewer than `MIN_SAMPLES` readings are left.
    """
    _refuse_binary(path)
    return parse_power_log(read_text(path), columns)


def parse_power_log(text: Text, columns: Columns | None = None) -> PowerLog:
    """`read_power_log` of a text."""
    columns = columns or Columns()
    if text.body.startswith("ULog\x01"):
        raise _binary(text.name, _BINARY[b"ULog\x01\x12"])
    lines = [(i, line) for i, line in enumerate(text.body.split("\n"), 1) if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        raise InputError.at(text.name, 1, 1, "no readings", f"a header such as {_EXAMPLE}, and a row for each")
    header, rows = (None, lines) if columns.names else (_row(text.name, *lines[0]), lines[1:])
    layout = _layout(header, columns)
    readings, warnings = _readings(text.name, rows, layout)
    return _ordered(text.name, readings, layout.per[0], warnings)


def _refuse_binary(path: str) -> None:
    if not os.path.isfile(path):  # a pipe could not be read twice
        return
    try:
        with open(path, "rb") as stream:
            head = stream.read(8)
    except OSError:
        return  # read_text says what is wrong
    for magic, kind in _BINARY.items():
        if head.startswith(magic):
            raise _binary(path, kind)


def _binary(name: str, kind: str) -> InputError:
    return InputError.at(name, 1, 1, f"is {kind}, which is binary and not read as CSV", f"a CSV file ({_EXAMPLE})")


# ── what the columns mean ──


@dataclass(frozen=True)
class _Layout:
    """Where time comes first and what makes the power follows: columns, and how many of their units make an SI one."""

    index: list[int]
    per: list[float]
    width: int  # fields of a row; 0 for any
    warnings: list[Fault] = field(default_factory=list)


def _row(name: str, number: int, line: str) -> Row:
    return Row(name, number, line, *split_fields(line))


def _layout(header: Row | None, columns: Columns) -> _Layout:
    if header is None:
        raw = ",".join(columns.names)
        header = Row("--columns", 1, raw, *split_fields(raw))
    elif all(NUMBER.match(name) or NOT_FINITE.match(name) for name in header.fields):
        message = "the first row has numbers, not the names of columns"
        raise InputError(header.fault(0, message, f"a header such as {_EXAMPLE}, or --columns {_EXAMPLE}"))
    twice = [i for i, name in enumerate(header.fields) if name and name in header.fields[:i]]
    if twice:
        message = f"the name {printable(header.fields[twice[0]], 80)} stands twice"
        raise InputError(header.fault(twice[0], message, "each column under a name of its own"))
    layout = _Layout([], [], 0 if columns.names else len(header.fields))
    for role in ("time", *_power_roles(header, columns)):
        index = _find(header, role, getattr(columns, role))
        layout.index.append(index)
        layout.per.append(_per_unit(header, index, role, columns, layout.warnings))
    return layout


def _power_roles(header: Row, columns: Columns) -> tuple[str, ...]:
    """Power, or voltage and current: what is asked for, else what there is, power first."""
    if columns.power and (columns.voltage or columns.current):
        raise InputError.at("--power", 1, 1, "and --voltage or --current", "one way to the power", columns.power)
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
        example = {"time": "time_s, timestamp", "voltage": "voltage_v", "current": "current_a"}[role]
        raise InputError(header.fault(0, f"no column for the {role}", f"{example}, or --{role} NAME"))
    if len(found) > 1:
        several = ", ".join(header.fields[i] for i in found)
        raise InputError(header.fault(found[1], f"several columns of {role}: {several}", f"one, or --{role} NAME"))
    return found[0]


def _named(header: Row, role: str) -> list[int]:
    """Columns whose names say that they are a role's: `power_w`; or the only one that ends so (`total_power_w`)."""
    stems = [_stem_and_unit(name, role)[0] for name in header.fields]
    plain = [i for i, stem in enumerate(stems) if stem in _STEMS[role]]
    return plain or [i for i, stem in enumerate(stems) if stem.endswith(tuple(f"_{s}" for s in _STEMS[role][:1]))]


def _stem_and_unit(name: str, role: str) -> tuple[str, str]:
    """`time [ms]` and `time_ms` → time, ms; an ending that is no unit of the role belongs to the name."""
    name = name.strip()
    match = _STEM_AND_UNIT.match(name.lower()) if len(name) <= NAME_LIMIT else None
    if match is None:
        return name.lower(), ""
    unit = match[2] or match[3] or ""
    return (match[1].strip(), unit) if unit in _PER_UNIT[role] or match[2] else (name.strip().lower(), "")


def _per_unit(header: Row, index: int, role: str, columns: Columns, warnings: list[Fault]) -> float:
    """How many of a column's units make a second, watt, volt, ampere."""
    known = _PER_UNIT[role]
    if role == "time" and columns.time_unit:
        return known[columns.time_unit]
    stem, unit = _stem_and_unit(header.fields[index], role)
    if not unit and role == "time":
        if stem == "timestamp":
            return known["us"]
        message = f"{printable(header.fields[index], 80)} has no unit"
        raise InputError(header.fault(index, message, f"a name such as time_s or time_ms, or --time-unit {_units()}"))
    if not unit:
        taken = {"power": "W", "voltage": "V", "current": "A"}[role]
        message = f"{printable(header.fields[index], 80)} has no unit: taken as {taken}"
        warnings.append(replace(header.fault(index, message), severity="warning"))
        return 1.0
    if unit not in known:
        message = f"{printable(unit, 40)} is no unit of {role}"
        raise InputError(header.fault(index, message, " or ".join(known)))
    return known[unit]


def _units() -> str:
    return "|".join(unit for unit in _PER_SECOND if unit.isascii())


# ── what the rows say ──


@dataclass(frozen=True)
class _Reading:
    line: int
    raw_time: float
    power_w: float


def _readings(name: str, rows: Sequence[tuple[int, str]], layout: _Layout) -> tuple[list[_Reading], list[Fault]]:
    """The rows that are readings; warnings for those that are not."""
    readings: list[_Reading] = []
    faults: list[Fault] = []
    dropped: dict[str, list[int]] = {}
    limits = [LARGEST_S, *[LARGEST_W] * (len(layout.index) - 1)]
    columns = list(zip(layout.index, layout.per, limits, strict=True))
    for number, line in rows:
        fields = line.split(",") if '"' not in line else split_fields(line)[0]
        if layout.width and len(fields) > layout.width and any(map(str.strip, fields[layout.width :])):
            message = f"{len(fields)} fields"
            faults.append(_row(name, number, line).fault(layout.width, message, f"{layout.width}, as in the header"))
            continue
        values: list[float] = []
        reason = ""
        for index, per, limit in columns:
            raw = fields[index].strip() if index < len(fields) else ""
            if NUMBER.match(raw) and abs(value := float(raw)) <= limit * per:
                values.append(value)
            elif not raw or NOT_FINITE.match(raw):
                reason = "an empty cell" if not raw else "a cell that is not finite"
            else:
                shown = printable(raw, 40)
                what = f"{shown} is {'too large' if NUMBER.match(raw) else 'not a number'}"
                expected = f"at most {limit * per:g}" if NUMBER.match(raw) else "a number"
                faults.append(_row(name, number, line).fault(index, what, expected))
                break
        else:
            if not reason and len(values) == 3 and (values[1] <= 0 or values[2] in (0, -1)):
                reason = "an unknown voltage or current (0 or -1)"
            if reason:
                dropped.setdefault(reason, []).append(number)
            else:
                power = math.prod(value / per for value, (_, per, _) in zip(values[1:], columns[1:], strict=True))
                readings.append(_Reading(number, values[0], power))
    if faults:
        raise capped(faults)
    warnings = [_counted(name, numbers, f"with {reason} left out") for reason, numbers in dropped.items()]
    return readings, layout.warnings + warnings


def _counted(name: str, lines: Sequence[int], what: str) -> Fault:
    rows = "1 row" if len(lines) == 1 else f"{len(lines)} rows"
    where = "" if len(lines) == 1 else ", the first of them here"
    return Fault(name, min(lines), 1, f"{rows} {what}{where}", severity="warning")


def _ordered(name: str, readings: list[_Reading], per_second: float, warnings: list[Fault]) -> PowerLog:
    """The log in order of time, each time once."""
    if len(readings) < MIN_SAMPLES:
        message = f"{len(readings)} readings"
        raise InputError(*warnings, Fault(name, 1, 1, message, f"{MIN_SAMPLES} or more, to find a period in"))
    raw = np.array([reading.raw_time for reading in readings])
    power = np.array([reading.power_w for reading in readings])
    lines = np.array([reading.line for reading in readings])
    late = np.flatnonzero(raw < np.maximum.accumulate(raw))
    if len(late):
        warnings.append(_counted(name, lines[late].tolist(), "earlier than one before: sorted by time"))
        order = np.argsort(raw, kind="stable")
        raw, power, lines = raw[order], power[order], lines[order]
    again = np.flatnonzero(np.diff(raw) == 0) + 1
    if len(again):
        warnings.append(_counted(name, lines[again].tolist(), "at the time of another left out"))
        raw, power, lines = (np.delete(values, again) for values in (raw, power, lines))
    times = (raw - raw[0]) / per_second  # the difference first: a date in µs has no digits to spare
    if len(times) < MIN_SAMPLES or times[-1] < SHORTEST_S:
        message = f"{len(times)} readings at times of their own, over {times[-1]:g} s"
        raise InputError(Fault(name, 1, 1, message, f"{MIN_SAMPLES} or more, over {SHORTEST_S:g} s or longer"))
    gap = int(np.argmax(np.diff(times)))
    if times[gap + 1] - times[gap] > times[-1] / 2:
        message = f"a gap of {times[gap + 1] - times[gap]:g} s before this row, more than half of the log"
        warnings.append(Fault(name, int(lines[gap + 1]), 1, message, severity="warning"))
    return PowerLog(name, times, power, sorted(warnings, key=lambda fault: (fault.line, fault.column)))
