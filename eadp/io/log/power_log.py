"""Power logs: a CSV of times and power, or of voltage and current, or an autopilot's log, as times and watts.

A reading that is no reading is left out and counted in a warning: an empty cell, NaN, an infinity, a row cut off; of a
voltage and a current also 0 and −1, by which autopilots mean that they do not know. A cell that is not a number
is an error. Rows out of order are sorted; of rows at one time the first is kept. Where the clock was set back in
between, as by a restart, the longest run of rows is kept.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.geometry.geodesy import to_local_m
from eadp.core.signals.spectrum import MIN_SAMPLES
from eadp.errors import Fault, InputError, capped, printable
from eadp.io.log.autopilot import (
    DATAFLASH_MAGIC,
    LIMIT_BYTES,
    ULOG_MAGIC,
    Tables,
    is_dataflash_text,
    read_dataflash,
    read_dataflash_text,
    read_ulog,
)
from eadp.io.log.autopilot_battery import DATAFLASH_KINDS, ULOG_KINDS, battery_table
from eadp.io.text.csv import NOT_FINITE, NUMBER, Row, split_fields
from eadp.io.text.streams import Text, read_text

LARGEST_W = 1e9
"""Largest power, voltage or current [W, V, A]: beyond it, a log is not of a small aircraft."""
LARGEST_S = 1e12
SHORTEST_S = 1e-3
HEAD = 20_000
"""Characters of a text that tell what it is."""

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
RESTARTS = 3
"""Where times go back more often than this, rows are out of order, and no clock was set."""
GAP = 5.0
"""A step this many times the median one is a gap."""
_POSITIONS = (("x_m", "y_m"), ("lat", "lon"), ("latitude", "longitude"), ("latitude_deg", "longitude_deg"))
_EXAMPLE = "time_s,power_w"


@dataclass(frozen=True)
class Columns:
    """Which columns to read, as far as their own names do not say it; '' leaves it to them.

    `names` are those of the first columns of a file without a header, '' for a column to skip. `factors` asks for
    voltage and current even where there is a power; `also` for other columns, by name; `instance` says which battery of
    an autopilot's log is meant.
    """

    time: str = ""
    power: str = ""
    voltage: str = ""
    current: str = ""
    names: Sequence[str] = ()
    time_unit: str = ""
    factors: bool = False
    also: Sequence[str] = ()
    instance: int | None = None


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
    voltage_v, current_a : array, shape (n,), or None
        What the power was computed from [V, A], where it was.
    position_m : array, shape (n, 2), or None
        Where the log says so: x and y [m], NaN where a row does not.
    also : dict of str to array, shape (n,)
        The other columns asked for.
    counts : dict of str to int or float
        Rows read, and how many of them were left out for what; gaps, and the longest of them [s].
    """

    name: str
    times_s: FloatArray
    power_w: FloatArray
    warnings: list[Fault] = field(default_factory=list)
    voltage_v: FloatArray | None = None
    current_a: FloatArray | None = None
    position_m: FloatArray | None = None
    also: dict[str, FloatArray] = field(default_factory=dict)
    counts: dict[str, int | float] = field(default_factory=dict)


def read_power_log(path: str, columns: Columns | None = None) -> PowerLog:
    """Read a power log.

    Parameters
    ----------
    path : str
        A CSV file, `-` for standard input; a PX4 ULog, or an ArduPilot DataFlash log, binary or as text.
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
    head = _head(path)
    if head.startswith(ULOG_MAGIC[:4]):
        return _of_autopilot(path, read_ulog(path, _bytes(path), ULOG_KINDS), columns or Columns())
    if head.startswith(DATAFLASH_MAGIC):
        return _of_autopilot(path, read_dataflash(path, _bytes(path), DATAFLASH_KINDS), columns or Columns())
    return parse_power_log(read_text(path), columns)


def parse_power_log(text: Text, columns: Columns | None = None) -> PowerLog:
    """`read_power_log` of a text."""
    columns = columns or Columns()
    if is_dataflash_text(text.body[:HEAD]):
        return _of_autopilot(text.name, read_dataflash_text(text.name, text.body, DATAFLASH_KINDS), columns)
    lines = [(i, line) for i, line in enumerate(text.body.split("\n"), 1) if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        raise InputError.at(text.name, 1, 1, "no readings", f"a header such as {_EXAMPLE}, and a row for each")
    header, rows = (None, lines) if columns.names else (_row(text.name, *lines[0]), lines[1:])
    layout = _layout(header, columns)
    readings, warnings, counts = _readings(text.name, rows, layout)
    return _ordered(text.name, readings, layout, warnings, counts)


def _head(path: str) -> bytes:
    if not os.path.isfile(path):  # a pipe could not be read twice
        return b""
    try:
        with open(path, "rb") as stream:
            return stream.read(8)
    except OSError:
        return b""  # read_text says what is wrong


def _bytes(path: str) -> bytes:
    if os.path.getsize(path) > LIMIT_BYTES:
        raise InputError.at(path, 1, 1, "is too large", f"at most {LIMIT_BYTES} bytes")
    with open(path, "rb") as stream:
        return stream.read()


# ── autopilots' logs ──


def _of_autopilot(name: str, tables: Tables, columns: Columns) -> PowerLog:
    """Voltage times current of one battery, with the position where there is one."""
    for option, asked in (("--power", columns.power), ("--columns", ",".join(columns.names))):
        if asked:
            raise InputError.at(option, 1, 1, "an autopilot's log has no such columns", "none of it", asked)
    if columns.also:
        raise InputError.at(name, 1, 1, f"an autopilot's log has no column {columns.also[0]}", "a CSV file")
    battery = battery_table(name, tables, columns.instance, columns.voltage, columns.current)
    warnings = [Fault(name, 1, 1, note, severity="warning") for note in battery.notes]
    time, volts, amps = battery.time_us, battery.voltage_v, battery.current_a
    counts: dict[str, int | float] = {"rows": len(time)}
    known = np.isfinite(volts) & np.isfinite(amps) & (volts > 0) & (amps != 0) & (amps != -1)
    known &= (volts <= LARGEST_W) & (np.abs(amps) <= LARGEST_W)
    if unknown := int(len(time) - np.count_nonzero(known)):
        counts["unknown"] = unknown
        message = f"{_rows(unknown)} with an unknown voltage or current (0 or -1) left out"
        warnings.append(Fault(name, 1, 1, message, severity="warning"))
    others = np.empty((len(time), 0)) if battery.position_m is None else battery.position_m
    table = _Table(time[known], np.stack([volts, amps], axis=1)[known], others[known], np.ones(len(time), int)[known])
    return _in_order(name, table, 1e6, warnings, counts, battery.position_m is not None, ())


# ── what the columns mean ──


@dataclass(frozen=True)
class _Layout:
    """Where time comes first and what makes the power follows: columns, and how many of their units make an SI one."""

    index: list[int]
    per: list[float]
    width: int  # fields of a row; 0 for any
    others: list[int] = field(
        default_factory=list
    )  # columns that may be empty: two of a position, then those asked for
    position: bool = False
    degrees: bool = False
    also: tuple[str, ...] = ()
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
    return _with_others(layout, header, columns)


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
    return replace(layout, others=others, position=pair is not None, degrees=degrees, also=tuple(columns.also))


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
    factors: tuple[float, ...]
    """The power [W], or voltage [V] and current [A]."""
    others: tuple[float, ...] = ()


def _readings(
    name: str, rows: Sequence[tuple[int, str]], layout: _Layout
) -> tuple[list[_Reading], list[Fault], dict[str, int | float]]:
    """The rows that are readings; warnings for those that are not, and how many there are."""
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
                factors = [value / per for value, (_, per, _) in zip(values[1:], columns[1:], strict=True)]
                readings.append(_Reading(number, values[0], tuple(factors), tuple(_other(fields, layout.others))))
    if faults:
        raise capped(faults)
    warnings = [_counted(name, numbers, f"with {reason} left out") for reason, numbers in dropped.items()]
    counts: dict[str, int | float] = {"rows": len(rows)}
    counts |= {_KEYS[reason]: len(numbers) for reason, numbers in dropped.items()}
    return readings, layout.warnings + warnings, counts


_KEYS = {
    "an empty cell": "empty",
    "a cell that is not finite": "not_finite",
    "an unknown voltage or current (0 or -1)": "unknown",
}


def _other(fields: Sequence[str], places: Sequence[int]) -> list[float]:
    """Cells that may be missing: NaN."""
    cells = [fields[i].strip() if i < len(fields) else "" for i in places]
    return [float(cell) if NUMBER.match(cell) else math.nan for cell in cells]


def _counted(name: str, lines: Sequence[int], what: str) -> Fault:
    where = "" if len(lines) == 1 else ", the first of them here"
    return Fault(name, min(lines), 1, f"{_rows(len(lines))} {what}{where}", severity="warning")


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"


@dataclass(frozen=True)
class _Table:
    """Readings as arrays of one length."""

    raw: FloatArray
    factors: FloatArray
    others: FloatArray
    lines: IntArray

    def at(self, index: NDArray[Any] | slice) -> _Table:
        return _Table(self.raw[index], self.factors[index], self.others[index], self.lines[index])


def _ordered(
    name: str,
    readings: list[_Reading],
    layout: _Layout,
    warnings: list[Fault],
    counts: dict[str, int | float],
) -> PowerLog:
    table = _Table(
        np.array([reading.raw_time for reading in readings]),
        np.array([reading.factors for reading in readings]).reshape(len(readings), len(layout.index) - 1),
        np.array([reading.others for reading in readings]).reshape(len(readings), len(layout.others)),
        np.array([reading.line for reading in readings], dtype=np.int64),
    )
    if layout.degrees and len(readings):
        table.others[:, :2] = _metres(table.others[:, :2])
    return _in_order(name, table, layout.per[0], warnings, counts, layout.position, layout.also)


def _metres(degrees: FloatArray) -> FloatArray:
    """Latitude and longitude [°] as east and north of the first [m]; numbers as large as autopilots' are 1e-7 °."""
    known = np.flatnonzero(np.isfinite(degrees).all(axis=1))
    if not len(known):
        return degrees
    scaled = degrees * (1e-7 if np.nanmax(np.abs(degrees)) > 1000 else 1.0)
    origin = (float(scaled[known[0], 0]), float(scaled[known[0], 1]))
    result = np.full_like(degrees, np.nan)
    for i in known:
        result[i] = to_local_m(float(scaled[i, 0]), float(scaled[i, 1]), origin)
    return result


def _in_order(
    name: str,
    table: _Table,
    per_second: float,
    warnings: list[Fault],
    counts: dict[str, int | float],
    position: bool,
    also: Sequence[str],
) -> PowerLog:
    """The log in order of time, each time once."""
    if len(table.raw) < MIN_SAMPLES:
        message = f"{len(table.raw)} readings"
        raise InputError(*warnings, Fault(name, 1, 1, message, f"{MIN_SAMPLES} or more, to find a period in"))
    kept = _longest_run(table.raw)
    if (lost := len(table.raw) - (kept.stop - kept.start)) > 0:
        counts["restart"] = lost
        place = int(table.lines[kept.start if kept.start else kept.stop])
        message = f"the clock is set back here: {_rows(lost)} outside the longest run left out"
        warnings.append(Fault(name, place, 1, message, severity="warning"))
        table = table.at(kept)
    late = np.flatnonzero(table.raw < np.maximum.accumulate(table.raw))
    if len(late):
        counts["late"] = len(late)
        warnings.append(_counted(name, table.lines[late].tolist(), "earlier than one before: sorted by time"))
        table = table.at(np.argsort(table.raw, kind="stable"))
    again = np.flatnonzero(np.diff(table.raw) == 0) + 1
    if len(again):
        counts["repeated"] = len(again)
        warnings.append(_counted(name, table.lines[again].tolist(), "at the time of another left out"))
        table = table.at(np.delete(np.arange(len(table.raw)), again))
    times = (table.raw - table.raw[0]) / per_second  # the difference first: a date in µs has no digits to spare
    if len(times) < MIN_SAMPLES or times[-1] < SHORTEST_S:
        message = f"{len(times)} readings at times of their own, over {times[-1]:g} s"
        raise InputError(Fault(name, 1, 1, message, f"{MIN_SAMPLES} or more, over {SHORTEST_S:g} s or longer"))
    gap = _count_gaps(times, counts)
    if times[gap + 1] - times[gap] > times[-1] / 2:
        message = f"a gap of {times[gap + 1] - times[gap]:g} s before this row, more than half of the log"
        warnings.append(Fault(name, int(table.lines[gap + 1]), 1, message, severity="warning"))
    found = sorted(warnings, key=lambda fault: (fault.line, fault.column))
    factors, others = table.factors, table.others
    volts, amps = (factors[:, 0], factors[:, 1]) if factors.shape[1] == 2 else (None, None)
    where = others[:, :2] if position and np.isfinite(others[:, :2]).all(axis=1).sum() >= MIN_SAMPLES else None
    named = {label: others[:, 2 * position + i] for i, label in enumerate(also)}
    return PowerLog(name, times, factors.prod(axis=1), found, volts, amps, where, named, counts)


def _longest_run(raw: FloatArray) -> slice:
    """All rows; or the longest run of them where a clock was set back: seldom, far, and with rows enough between."""
    back = np.flatnonzero(np.diff(raw) < 0) + 1
    runs = np.diff([0, *back.tolist(), len(raw)])
    step = float(np.median(np.abs(np.diff(raw))))
    far = len(back) and np.all(raw[back - 1] - raw[back] > 10 * step)
    if not 0 < len(back) <= RESTARTS or not far or runs.min() < MIN_SAMPLES:
        return slice(0, len(raw))
    longest = int(np.argmax(runs))
    start = int(runs[:longest].sum())
    return slice(start, start + int(runs[longest]))


def _count_gaps(times_s: FloatArray, counts: dict[str, int | float]) -> int:
    """Where the longest step is; gaps go into the counts."""
    steps = np.diff(times_s)
    longest = int(np.argmax(steps))
    gaps = int(np.count_nonzero(steps > GAP * np.median(steps)))
    if gaps:
        counts["gaps"], counts["longest_gap_s"] = gaps, float(steps[longest])
    return longest
