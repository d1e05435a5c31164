"""Power logs: times and watts in order, with what was left out; and the CSV format, columns under their names.

A row that is no reading is left out and counted in a warning: an empty cell, NaN, an infinity; also a voltage of 0 or
−1 and a current of −1, which autopilots write for unknown. A cell that is not a number is an error. Rows out of order
are sorted; of rows at one time the first is kept. Where the clock was set back, as by a restart, the longest run of
rows is kept.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import chain
from typing import Annotated, Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from eadp.core.arrays import FloatArray, IntArray
from eadp.errors import FAULTS_READ, Fault, InputError, printable, refuse
from eadp.io.text.csv import ISO_TIME, NOT_FINITE, NUMBER, Row, number_fault, read_rows, repeated
from eadp.io.text.options import Flag
from eadp.io.text.streams import Text
from eadp.measure.recordings import RECORDED, read_recording
from eadp.measure.spectrum import MIN_SAMPLES

LARGEST_W = 1e9
"""Largest power, voltage or current [W, V, A]: beyond it, a log is not of a small aircraft."""
IMPOSSIBLE_W = 5e4
"""Mean power beyond that of any aircraft of the kind [W]: the units are others."""
LARGE_W, SLOW_S, LONG_S = 1e4, 60.0, 86_400.0
"""Mean power [W], time between rows and length [s] beyond which a log's units may be others: an electric aircraft of
150 kg draws about 6 kW, and batteries last for hours."""
SHORTEST_S = 1e-3
RESTARTS = 3
"""Most restarts of the clock; where times decrease more often, rows are out of order."""
GAP = 5.0
"""Shortest gap, relative to the median step."""


TimeUnit = Literal["s", "ms", "us", "ns", "min", "h"]
TIME_UNITS: tuple[TimeUnit, ...] = get_args(TimeUnit)


@dataclass(frozen=True)
class ColumnOptions:
    """Which columns of a log are read."""

    time: Annotated[str, Flag(metavar="NAME")] = ""
    """The column of time."""

    power: Annotated[Sequence[str], Flag(metavar="NAME")] = ()
    """The column of power, with its unit where its name has none: 'PWR_AVG [W]'. May repeat: they are added."""

    voltage: Annotated[str, Flag(metavar="NAME")] = ""
    """The column of voltage."""

    current: Annotated[str, Flag(metavar="NAME")] = ""
    """The column of current."""

    time_unit: TimeUnit | None = None
    """Unit of the times, where their column's name has none."""

    instance: Annotated[int | None, Flag(metavar="N")] = None
    """Which battery of an autopilot's log."""


@dataclass(frozen=True)
class Columns(ColumnOptions):
    """The columns to read.

    `factors` asks for voltage and current even if there is a power; `also` for other columns, by name; `motion` for the
    motion that the log has, in the columns below of `also`.
    """

    factors: bool = False
    also: Sequence[str] = ()
    motion: bool = False


AIRSPEED, BANK, CLIMB, ALTITUDE = "airspeed_mps", "bank_rad", "climb_mps", "altitude_m"
DENSITY = "air_density_kgpm3"
"""Columns of the motion: true airspeed [m/s], bank [rad], rate of climb [m/s], altitude [m], density of the air
[kg/m³]."""


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
        Readings that were left out or sorted.
    voltage_v, current_a : array, shape (n,), or None
        Factors of the power [V, A], if it was computed from them.
    also : dict of str to array, shape (n,)
        The other columns asked for.
    counts : dict of str to int or float
        Rows read, rows left out by reason, gaps, and the longest gap [s].
    battery : dict of str to float
        What an autopilot says of its battery, as far as it does: `capacity_ah`, `used_ah` before the first reading, and
        `counted_ah` in the log.
    """

    name: str
    times_s: FloatArray
    power_w: FloatArray
    warnings: list[Fault] = field(default_factory=list)
    voltage_v: FloatArray | None = None
    current_a: FloatArray | None = None
    also: dict[str, FloatArray] = field(default_factory=dict)
    counts: dict[str, int | float] = field(default_factory=dict)
    battery: dict[str, float] = field(default_factory=dict)

    def at(self, index: IntArray) -> PowerLog:
        """Some of the readings, at their times."""
        return replace(
            self,
            times_s=self.times_s[index],
            power_w=self.power_w[index],
            voltage_v=None if self.voltage_v is None else self.voltage_v[index],
            current_a=None if self.current_a is None else self.current_a[index],
            also={name: values[index] for name, values in self.also.items()},
        )


@dataclass(frozen=True)
class LogReadings:
    """The readings of a log as arrays of one length, in the order of the file, and what was left out before.

    Attributes
    ----------
    name : str
        The file.
    raw : array, shape (n,)
        Times in the unit of the file.
    per_second : float
        How many of that unit make a second.
    factors : array, shape (n, 1) or (n, 2)
        Power [W], or voltage [V] and current [A].
    lines : array, shape (n,)
        Line numbers.
    also, warnings, counts
        As those of `PowerLog`; the last two grow as readings are left out.
    columns : tuple of str
        Names of the columns of the factors.
    """

    name: str
    raw: FloatArray
    per_second: float
    factors: FloatArray
    lines: IntArray
    also: dict[str, FloatArray]
    warnings: list[Fault]
    counts: dict[str, int | float]
    columns: tuple[str, ...] = ("voltage", "current")

    def at(self, index: NDArray[Any] | slice) -> LogReadings:
        """Some of the readings."""
        also = {name: values[index] for name, values in self.also.items()}
        return replace(self, raw=self.raw[index], factors=self.factors[index], lines=self.lines[index], also=also)

    def warn(self, line: int, message: str, expected: str = "") -> None:
        """Add a warning."""
        self.warnings.append(Fault(self.name, line, 1, message, expected, severity="warning"))


_NAMED_SO = "columns in mW, mV or mA are named so"


def in_order(readings: LogReadings) -> PowerLog:
    """The log of readings in order of time, each time once.

    Raises
    ------
    InputError
        If too few readings, or too short a time, are left to find a period; or if they are of no aircraft.
    """
    name = readings.name
    if len(readings.raw) < MIN_SAMPLES:
        message = f"{len(readings.raw)} readings"
        raise InputError(*readings.warnings, Fault(name, 1, 1, message, f"{MIN_SAMPLES} or more, to find a period in"))
    readings = _each_time_once(_sorted(_longest_run(readings)))
    # the difference first: a date in µs has no digits to spare
    times_s = (readings.raw - readings.raw[0]) / readings.per_second
    if len(times_s) < MIN_SAMPLES or times_s[-1] < SHORTEST_S:
        message = f"{len(times_s)} readings at different times, over {times_s[-1]:g} s"
        raise InputError(Fault(name, 1, 1, message, f"{MIN_SAMPLES} or more, over {SHORTEST_S:g} s or longer"))
    _note_gaps(readings, times_s)
    power_w = readings.factors.prod(axis=1)
    _check_units(readings, times_s, power_w)
    warnings = sorted(readings.warnings, key=lambda fault: (fault.line, fault.column))
    volts, amps = readings.factors.T if readings.factors.shape[1] == 2 else (None, None)
    return PowerLog(name, times_s, power_w, warnings, volts, amps, readings.also, readings.counts)


def _longest_run(readings: LogReadings) -> LogReadings:
    """All readings; or the longest run where a clock was set back: seldom, by much, and with enough rows between."""
    raw = readings.raw
    back = np.flatnonzero(np.diff(raw) < 0) + 1
    runs = np.diff([0, *back.tolist(), len(raw)])
    step = float(np.median(np.abs(np.diff(raw))))
    if not 0 < len(back) <= RESTARTS or runs.min() < MIN_SAMPLES or (raw[back - 1] - raw[back] <= 10 * step).any():
        return readings
    longest = int(np.argmax(runs))
    start = int(runs[:longest].sum())
    stop = start + int(runs[longest])
    lost = readings.counts["restart"] = len(raw) - (stop - start)
    message = f"the clock is set back here: {rows_text(lost)} outside the longest run left out"
    readings.warn(int(readings.lines[start or stop]), message)
    return readings.at(slice(start, stop))


def _sorted(readings: LogReadings) -> LogReadings:
    """The readings in order of time."""
    late = np.flatnonzero(readings.raw < np.maximum.accumulate(readings.raw))
    if not len(late):
        return readings
    readings.counts["late"] = len(late)
    _warn_of_rows(readings, readings.lines[late].tolist(), "earlier than one before: sorted by time")
    return readings.at(np.argsort(readings.raw, kind="stable"))


def _each_time_once(readings: LogReadings) -> LogReadings:
    """The first of the readings at each time."""
    repeated = np.flatnonzero(np.diff(readings.raw) == 0) + 1
    if not len(repeated):
        return readings
    readings.counts["repeated"] = len(repeated)
    _warn_of_rows(readings, readings.lines[repeated].tolist(), "at the time of another left out")
    return readings.at(np.delete(np.arange(len(readings.raw)), repeated))


def _note_gaps(readings: LogReadings, times_s: FloatArray) -> None:
    """Count the gaps, and warn of one that is more than half of the log."""
    steps_s = np.diff(times_s)
    longest, longest_s = int(np.argmax(steps_s)), float(steps_s.max())
    if gaps := int(np.count_nonzero(steps_s > GAP * np.median(steps_s))):
        readings.counts.update(gaps=gaps, longest_gap_s=longest_s)
    if longest_s > times_s[-1] / 2:
        message = f"a gap of {longest_s:g} s before this row, more than half of the log"
        readings.warn(int(readings.lines[longest + 1]), message)


def _check_units(readings: LogReadings, times_s: FloatArray, power_w: FloatArray) -> None:
    """Refuse values that are in other units for sure; warn of those that may be, or that are of another sign."""
    step_s, mean_w = float(np.median(np.diff(times_s))), float(power_w.mean())
    if abs(mean_w) > IMPOSSIBLE_W:
        means = zip(readings.columns, readings.factors.mean(axis=0), strict=True)
        columns = ", ".join(f"{printable(what, 80)} {mean:.4g}" for what, mean in means)
        message = f"a mean power of {mean_w:.4g} W (mean of the columns: {columns})"
        raise InputError.at(readings.name, 1, 1, message, f"at most {IMPOSSIBLE_W:g} W; {_NAMED_SO}")
    if step_s > SLOW_S or times_s[-1] > LONG_S:
        message = f"a row every {step_s:.3g} s, over {times_s[-1] / 3600:.3g} h"
        readings.warn(1, message, "a log of a flight; --time-unit sets the unit of the time")
    if mean_w > LARGE_W:
        readings.warn(1, f"a mean power of {mean_w:.4g} W", f"at most {LARGE_W:g} W; {_NAMED_SO}")
    if mean_w < 0:
        readings.warn(1, f"a mean power of {mean_w:.4g} W", "power that is drawn, above 0")


def _warn_of_rows(readings: LogReadings, lines: Sequence[int], what: str) -> None:
    """Add a warning about rows, at the first of them."""
    where = "" if len(lines) == 1 else ", the first of them here"
    readings.warn(min(lines), f"{rows_text(len(lines))} {what}{where}")


def rows_text(count: int) -> str:
    """A number of rows, as text."""
    return "1 row" if count == 1 else f"{count} rows"


LARGEST_S = 1e12
SHORTEST_STEP_S, LONGEST_STEP_S = 5e-3, 60.0
"""Shortest and longest time between the rows of a log whose times are taken for PX4's [s]."""

PX4_TIME = "timestamp"
"""The time of PX4's logs as CSV [µs]: the one name that is known without its unit."""
USED = "discharged_mah"
"""Column of the charge used since the battery was put in, as PX4 names it [mAh]."""
_EXAMPLE = "time_s,power_w"


class _Known(NamedTuple):
    """What is known of a needed column: an example, its names without the unit, and how many of a unit make one in SI.

    A division keeps the digits that a product with 0.001 would not.
    """

    example: str
    stems: tuple[str, ...]
    per: dict[str, float]
    largest: float = LARGEST_W


_NEEDED = {
    "time": _Known(
        "time_s",
        ("time", PX4_TIME, "t", "elapsed", "elapsed_time"),
        {
            **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
            **dict.fromkeys(("ms", "millisecond", "milliseconds"), 1e3),
            **dict.fromkeys(("us", "µs", "microsecond", "microseconds"), 1e6),
            **dict.fromkeys(("min", "minute", "minutes"), 1 / 60),
            "ns": 1e9,
            "h": 1 / 3600,
        },
        LARGEST_S,
    ),
    "power": _Known("power_w", ("power", "total_power"), {"w": 1, "watt": 1, "watts": 1, "mw": 1e3, "kw": 1e-3}),
    "voltage": _Known("voltage_v", ("voltage", "volt"), {"v": 1, "volt": 1, "volts": 1, "mv": 1e3}),
    "current": _Known("current_a", ("current", "curr"), {"a": 1, "amp": 1, "amps": 1, "ma": 1e3}),
}
_MOTION: dict[str, dict[str, float]] = {
    AIRSPEED: dict.fromkeys(("airspeed_mps", "true_airspeed_mps", "tas_mps", "true_airspeed_m_s", "airspeed"), 1.0),
    BANK: {"bank_rad": 1.0, "roll_rad": 1.0, "bank_deg": math.pi / 180, "roll_deg": math.pi / 180},
    CLIMB: {"climb_mps": 1.0, "climb_rate_mps": 1.0, "vertical_speed_mps": 1.0, "climb": 1.0, "vz_down_mps": -1.0},
    ALTITUDE: dict.fromkeys(("altitude_m", "alt_m", "height_m", "altitude"), 1.0),
}
"""Columns of the motion: the names known, and their unit in SI."""


def read_csv_log(text: Text, columns: Columns) -> PowerLog:
    """Read a power log with a header.

    Raises
    ------
    InputError
        With the faults of the file or of `columns`.
    """
    if columns.instance is not None:
        raise InputError.at("--instance", 1, 1, "a table has no batteries", "none of it", str(columns.instance))
    _check_ways(columns)
    text, columns, notes = _recording(text, columns)
    rows = read_rows(text.name, text.body)
    first = next(rows, None)
    if first is None:
        raise InputError.at(text.name, 1, 1, "no readings", f"a header such as {_EXAMPLE}, and a row for each")
    second = next(rows, None)
    layout = _layout(first, columns, second)
    readings = _readings(text.name, chain([second] if second else [], rows), layout)
    readings.warnings.extend(notes)
    if layout.px4 and len(readings.raw) > 1:
        step_s = float(np.median(np.abs(np.diff(readings.raw)))) / readings.per_second
        if not SHORTEST_STEP_S <= step_s <= LONGEST_STEP_S and step_s > 0:
            message = f"a row every {step_s:.3g} s, if {PX4_TIME} is in µs"
            expected = "a name such as time_s or time_ms, or --time-unit"
            raise InputError(first.fault(layout.time.place, message, expected))
    log = in_order(readings)
    return replace(log, battery=counted(log.also[USED])) if USED in log.also else log


def counted(used_ah: FloatArray) -> dict[str, float]:
    """The charge used before the first reading of a count, and in the log, of `PowerLog.battery` [Ah]."""
    known = used_ah[np.isfinite(used_ah)]
    return {"used_ah": float(known[0]), "counted_ah": float(known[-1] - known[0])} if len(known) else {}


def _check_ways(columns: Columns) -> None:
    if columns.power and (columns.voltage or columns.current):
        raise InputError.at("--power", 1, 1, "and --voltage or --current", "one way to the power", columns.power[0])


def _recording(text: Text, columns: Columns) -> tuple[Text, Columns, list[Fault]]:
    """What a program recorded of a computer, with a column of its power; a log with a known power as it is."""
    first = next(read_rows(text.name, text.body), None)
    factors = columns.factors or columns.voltage or columns.current
    known = first and (_named(first, "power") or (_named(first, "voltage") and _named(first, "current")))
    found = None if factors or (known and not columns.power) else read_recording(text, columns.power)
    if found is None:
        return text, columns, []
    return found.with_power(), replace(columns, power=(RECORDED,)), found.notes()


# ── columns ──


class _Column(NamedTuple):
    """A needed column of a table: how many of its units make one in SI, and the largest value in its units."""

    name: str
    place: int
    per: float
    largest: float


class _Extra(NamedTuple):
    """A column whose cells may be empty: what it is read as, and its unit in SI."""

    name: str
    place: int
    unit: float


class _Layout(NamedTuple):
    """Where a table has what: the time, what makes the power, and more; a row has `width` fields.

    With `dates` times are by ISO 8601, with `px4` PX4's.
    """

    time: _Column
    factors: list[_Column]
    extras: list[_Extra]
    width: int
    dates: bool
    px4: bool


def _layout(header: Row, columns: Columns, second: Row | None) -> _Layout:
    """The layout of a header; the second row shows whether the times are dates."""
    if all(NUMBER.match(name) or NOT_FINITE.match(name) for name in header.fields):
        message = "the first row has numbers, not the names of columns"
        raise InputError(header.fault(0, message, f"a header such as {_EXAMPLE}"))
    if twice := repeated(header.fields):
        message = f"the name {printable(header.fields[twice[0]], 80)} stands twice"
        raise InputError(header.fault(twice[0], message, "each column under a name of its own"))
    roles = _power_roles(header, columns)
    at = _find(header, "time", columns.time)
    dates = bool(second and at < len(second.fields) and ISO_TIME.match(second.fields[at]))
    time = _needed(header, at, "time", "s" if dates else columns.time_unit)
    asked = {"power": next(iter(columns.power), ""), "voltage": columns.voltage, "current": columns.current}
    factors = [_needed(header, _find(header, role, asked[role]), role, None) for role in roles]
    px4 = not dates and not columns.time_unit and _plain(time.name) == PX4_TIME
    return _Layout(time, factors, _extras(header, columns), len(header.fields), dates, px4)


def _extras(header: Row, columns: Columns) -> list[_Extra]:
    """The columns asked for by name, and those known as what is asked for: the charge used, the motion."""
    extras = []
    for name in columns.also:
        if name not in header.fields:
            raise InputError(header.fault(0, f"no column {printable(name, 80)}", f"one beside {_names_of(header)}"))
        extras.append(_Extra(name, header.fields.index(name), 1.0))
    known = ({USED: {USED: 1e-3}} if columns.factors else {}) | (_MOTION if columns.motion else {})
    lower = [name.lower() for name in header.fields]
    for role, units in known.items():
        name = next((name for name in units if name in lower), "")
        if name:
            extras.append(_Extra(role, lower.index(name), units[name]))
    return extras


def _power_roles(header: Row, columns: Columns) -> tuple[str, ...]:
    """Power, or voltage and current: what is asked for, else what there is, power first."""
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
        message, expected = f"no column {printable(asked, 80)}", f"one of {_names_of(header)}"
        raise InputError.at(f"--{role}", 1, 1, message, expected, asked)
    found = _named(header, role)
    if not found:
        message, expected = f"no column for the {role}", f"{_NEEDED[role].example}, or --{role} NAME"
        raise InputError(header.fault(0, message, expected))
    if len(found) > 1:
        several = ", ".join(header.fields[i] for i in found)
        raise InputError(header.fault(found[1], f"several columns of {role}: {several}", f"one, or --{role} NAME"))
    return found[0]


def _names_of(header: Row) -> str:
    return ", ".join(printable(name, 40) for name in header.fields[:20] if name)


def _named(header: Row, role: str) -> list[int]:
    """Columns with a known name of a role, with a unit (`power_w`, `Power [W]`) or without."""
    names = [{_plain(name), _stem_and_unit(name, role)[0]} for name in header.fields]
    return [i for i, either in enumerate(names) if either.intersection(_NEEDED[role].stems)]


def _plain(name: str) -> str:
    """A name in small letters: `Time [ms]` and `time_ms` are the same."""
    return "_".join(filter(None, re.split(r"[\s_()\[\]-]+", name.lower())))


def _stem_and_unit(name: str, role: str) -> tuple[str, str]:
    """`time_ms` → time, ms; nothing where the ending is no unit of the role."""
    stem, _, unit = _plain(name).rpartition("_")
    return (stem, unit) if unit in _NEEDED[role].per else ("", "")


def _needed(header: Row, index: int, role: str, unit: str | None) -> _Column:
    """A needed column with the unit that is stated, or that of its name."""
    name, known = header.fields[index], _NEEDED[role]
    unit = unit or ("us" if role == "time" and _plain(name) == PX4_TIME else _stem_and_unit(name, role)[1])
    if not unit:
        option = f", or --time-unit {'|'.join(TIME_UNITS)}" if role == "time" else ""
        message = f"{printable(name, 80)} has no unit of {role}"
        raise InputError(header.fault(index, message, f"a name such as {known.example}{option}"))
    return _Column(name, index, known.per[unit], known.largest * known.per[unit])


# ── rows ──

_REASONS = {
    "empty": "with an empty cell",
    "not_finite": "with a cell that is not finite",
    "unknown": "with an unknown voltage (0 or -1) or current (-1)",
}


def _readings(name: str, rows: Iterable[Row], layout: _Layout) -> LogReadings:
    """The rows that are readings, with warnings of those that are not, and their numbers."""
    lines, values, extras = array("q"), array("d"), array("d")
    faults: list[Fault] = []
    left_out: dict[str, list[int]] = {}
    count = 0
    for row in rows:
        if len(faults) >= FAULTS_READ:
            break
        count += 1
        try:
            found, reason = _values(row, layout)
        except InputError as error:
            faults += error.faults
            continue
        if reason:
            left_out.setdefault(reason, []).append(row.line)
            continue
        lines.append(row.line)
        values.extend(found)
        extras.extend(_optional(row.fields, each.place) for each in layout.extras)
    refuse(faults)
    table = np.array(values).reshape(len(lines), 1 + len(layout.factors))
    more = np.array(extras).reshape(len(lines), len(layout.extras))
    readings = LogReadings(
        name,
        raw=table[:, 0],
        per_second=layout.time.per,
        factors=table[:, 1:] / [each.per for each in layout.factors],
        lines=np.array(lines, dtype=np.int64),
        also={each.name: more[:, i] * each.unit for i, each in enumerate(layout.extras)},
        warnings=[],
        counts={"rows": count, **{reason: len(numbers) for reason, numbers in left_out.items()}},
        columns=tuple(each.name for each in layout.factors),
    )
    for reason, numbers in left_out.items():
        _warn_of_rows(readings, numbers, f"{_REASONS[reason]} left out")
    return readings


def _values(row: Row, layout: _Layout) -> tuple[list[float], str]:
    """The time and the factors, as they are written; and why the row is no reading, or "".

    Raises InputError of a cell that is no number, or of a row with more fields than the header.
    """
    if any(row.fields[layout.width :]):
        message = f"{len(row.fields)} fields"
        raise InputError(row.fault(layout.width, message, f"{layout.width}, as in the header"))
    values: list[float] = []
    reason = ""
    for column in (layout.time, *layout.factors):
        raw = row.fields[column.place] if column.place < len(row.fields) else ""
        if raw and layout.dates and column is layout.time:
            values.append(_seconds(row, column.place))
        elif NUMBER.match(raw) and abs(value := float(raw)) <= column.largest:
            values.append(value)
        elif not raw:
            reason = "empty"
        elif NOT_FINITE.match(raw):
            reason = "not_finite"
        elif fault := number_fault(raw, column.largest):
            raise InputError(row.fault(column.place, *fault))
    if not reason and len(layout.factors) == 2:
        _, voltage, current = values
        reason = "unknown" if voltage <= 0 or current == -1 else ""
    return values, reason


def _seconds(row: Row, place: int) -> float:
    """Seconds since 1970 of a time by ISO 8601, or with slashes in its date, of UTC without a zone."""
    raw = row.fields[place]
    try:
        time = datetime.fromisoformat(raw.replace("/", "-", 2))
    except ValueError:
        message = f"{printable(raw, 40)} is no time by ISO 8601"
        raise InputError(row.fault(place, message, "a time as in the first row")) from None
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


def _optional(fields: Sequence[str], index: int) -> float:
    """A cell that may be missing: NaN."""
    return float(fields[index]) if index < len(fields) and NUMBER.match(fields[index]) else math.nan
