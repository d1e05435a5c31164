"""Measurements of computations, as CSV: with a header, with powprofiler's flags, or numbers alone."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eadp.errors import Fault, Infeasible, InputError, capped, printable
from eadp.io.csv_text import NOT_FINITE, NUMBER, Row, split_fields
from eadp.io.streams import Text
from eadp.models.profile import Profile

"""Most faults of one file that are reported one by one."""

SPREAD_LIMIT = 0.2
"""Largest spread of a repeated configuration, as a part of its mean: beyond it, a reading is wrong."""

LARGEST = 1e30
"""Largest magnitude of a number in a profile: no power or parameter, and far from where floats end."""

PARAMETERS_LIMIT = 8
"""Most parameters of a configuration: interpolating between points costs 2^parameters."""

NAME = re.compile(r"[^\W\d](?:[\w .+/-]{0,62}\w)?\Z")
A_NAME = "a name: a letter first, then letters, digits, _ - + . / or spaces, 64 at most"

# a division by 1000 keeps the digits of a value in mW, where a product with 0.001 would not
_PER_WATT = {"w": 1.0, "W": 1.0, "watt": 1.0, "watts": 1.0, "mW": 1e3, "mw": 1e3, "kW": 1e-3, "kw": 1e-3}
_A_HEADER = "a header such as fps,power_w"
_A_CONFIGURATION = "the model that powprofiler makes of its traces (flags 200, 201, …), or a header"

_SOURCE = re.compile(r"#\s*source:(.*)\Z", re.IGNORECASE)
_HEADING = re.compile(r"([^\[(]*)(?:[\[(]([^\])]*)[\])])?\Z")
_POWER = re.compile(r"(.*[ _-])?power(?:[ _-]([a-zµ]?w|watts?))?\Z", re.IGNORECASE)
_NO_PARAMETER = re.compile(r"(?:time|timestamp|energy|soc)(?:[ _-](?:s|ms|us|j|mj|wh|mwh))?\Z", re.IGNORECASE)


@dataclass(frozen=True)
class Places:
    """What reading found beside the profile: warnings, and an empty fault where each configuration stands."""

    of_point: dict[tuple[float, ...], Fault]
    warnings: Sequence[Fault] = ()


def read_measurements(text: Text, names: Sequence[str]) -> tuple[Profile, Places]:
    """The profile that measurements make: repeated configurations averaged, their spread and count kept.

    Parameters
    ----------
    text : Text
    names : sequence of str
        Names for parameters that the file leaves nameless; see `eadp.io.profile_file.read_profile`.

    Raises
    ------
    InputError
        With all the faults of the file, as far as they can be told together.
    """
    rows, source = _rows(text)
    if not rows:
        message = "no measurements"
        raise InputError.at(text.name, 1, 1, message, f"{_A_HEADER} and a row for each measurement")
    layout = _layout(rows[0], names)
    readings = _readings(rows[layout.first :], layout)
    if len(readings) < 2:
        message = "one configuration only" if readings else "no measurements"
        raise InputError(rows[-1].fault(0, message, "measurements of two configurations or more"))
    _check_agreement(readings, layout)
    averages = [_average([power_w for power_w, _ in group]) for group in readings.values()]
    try:
        profile = Profile(
            names=tuple(layout.names),
            units=tuple(layout.units),
            configurations=np.array(list(readings)),
            power_w=np.array([mean_w for mean_w, _ in averages]),
            spread_w=np.array([spread_w for _, spread_w in averages]),
            samples=np.array([len(group) for group in readings.values()]),
            source=source or ("standard input" if text.name == "<stdin>" else os.path.basename(text.name)),
        )
    except Infeasible as error:
        first = rows[layout.first]
        raise InputError(first.fault(0, str(error), "a full grid, or points that span an area")) from None
    places = {point: group[0][1].fault(0, "") for point, group in readings.items()}
    return profile, Places(places, layout.warnings)


def _rows(text: Text) -> tuple[list[Row], str]:
    """The rows of a table, without blank lines and comments, and what its `# source:` comments say."""
    rows, sources = [], []
    for number, line in enumerate(text.body.split("\n"), start=1):
        bare = line.strip()
        if bare.startswith("#"):
            said = _SOURCE.match(bare)
            if said:
                sources.append(said.group(1).strip())
        elif bare:
            rows.append(Row(text.name, number, line, *split_fields(line)))
    return rows, " ".join(sources)


# ── what the columns mean ──


@dataclass(frozen=True)
class _Layout:
    """What the columns of a table mean.

    `parameters` and `power` are indices of columns; the power has `per_watt` units to a watt; the first
    measurement is in row `first`, and each row has `width` fields.
    """

    names: list[str]
    units: list[str]
    parameters: list[int]
    power: int
    width: int
    per_watt: float = 1.0
    first: int = 1
    warnings: Sequence[Fault] = ()


def _layout(row: Row, names: Sequence[str]) -> _Layout:
    """Read the first row: a header, powprofiler's flags, or the first measurement of numbers alone."""
    if len(row.fields) == 1:
        raise InputError(row.fault(0, "one column only", f"{_A_HEADER}, fields separated by commas"))
    if not all(NUMBER.match(field) or NOT_FINITE.match(field) for field in row.fields):
        layout = _header(row)
    elif _has_flags(row.fields):
        layout = _flags(row)
    else:
        layout = _headerless(row, names)
    if len(layout.parameters) > PARAMETERS_LIMIT:
        message = f"{len(layout.parameters)} columns of parameters"
        place = layout.parameters[PARAMETERS_LIMIT]
        raise InputError(row.fault(place, message, f"at most {PARAMETERS_LIMIT}"))
    return layout


def _headerless(row: Row, names: Sequence[str]) -> _Layout:
    """Numbers alone: parameters, then power; a single parameter is called c."""
    d = len(row.fields) - 1
    if d > 1 and len(names) != d:
        message = f"{d + 1} columns without names"
        raise InputError(row.fault(0, message, f"{_A_HEADER}, or --names with {d} names"))
    return _Layout(list(names) if d > 1 else ["c"], [""] * d, list(range(d)), power=d, width=d + 1, first=0)


def _has_flags(fields: Sequence[str]) -> bool:
    """Whether numbers are powprofiler's column flags, and not a first measurement such as `200,130`."""
    known = {"100", "101", "102", "130", "131", "132", "160", "161", "162"}
    flags = all(field in known or re.fullmatch("2[0-9]{2}", field) for field in fields)
    return flags and len(set(fields)) == len(fields) and ("100" in fields or len(fields) > 2)


def _flags(row: Row) -> _Layout:
    """powprofiler's columns: 2xx are parameters, 100 is the total average power; the others are not needed.

    101 and 102 are parts of the total; 130 to 132, called energy, are W·samples.

    Source: powprofiler, doi 10.5281/zenodo.5562457 (letter, reference 48).
    """
    parameters = [i for i, flag in enumerate(row.fields) if flag.startswith("2")]
    if not parameters:
        message = "a powprofiler trace: power over time, without the configuration it was measured at"
        raise InputError(row.fault(0, message, _A_CONFIGURATION))
    if "100" not in row.fields:
        raise InputError(row.fault(0, "no total power", "a column 100 among powprofiler's flags"))
    names = [f"p{row.fields[i]}" for i in parameters]
    power = row.fields.index("100")
    return _Layout(names, [""] * len(names), parameters, power, width=len(row.fields))


@dataclass(frozen=True)
class _Heading:
    """A column's name and unit ('' unknown); for power, how many of the unit make a watt, else 0."""

    name: str
    unit: str
    per_watt: float = 0.0
    problem: str = ""


def _header(row: Row) -> _Layout:
    headings = [_heading(field) for field in row.fields]
    faults = []
    for i, heading in enumerate(headings):
        if heading.problem:
            faults.append(row.fault(i, heading.problem, _A_HEADER))
        elif heading.name in [before.name for before in headings[:i]]:
            faults.append(row.fault(i, f"the column {heading.name} stands twice", "each once"))
    if faults:
        raise capped(faults)
    power = _power_column(row, headings)
    idle = [i for i, heading in enumerate(headings) if heading.per_watt or _NO_PARAMETER.match(heading.name)]
    ignored = [(i, headings[i].name) for i in idle if i != power]
    warnings = [row.fault(i, f"{name} is no parameter of the computations: ignored") for i, name in ignored]
    if not headings[power].unit:
        warnings.append(row.fault(power, "power without a unit: taken as W", "power_w, or power [W]"))
    parameters = sorted(set(range(len(headings))) - set(idle))
    if not parameters:
        raise InputError(row.fault(0, "no column for the configuration", _A_HEADER))
    names, units = [headings[i].name for i in parameters], [headings[i].unit for i in parameters]
    per_watt = headings[power].per_watt
    return _Layout(names, units, parameters, power, len(headings), per_watt, warnings=warnings)


def _heading(field: str) -> _Heading:
    """Read `fps`, `fps [1/s]`, `power_w`, `power (mW)`."""
    split = _HEADING.match(field)
    name, unit = (split.group(1).strip(), (split.group(2) or "").strip()) if split else (field, "")
    shown = printable(field, 80) or "an empty field"
    if not NAME.match(name):
        return _Heading(name, unit, problem=f"{shown} is no name")
    if not unit.isprintable() or len(unit) > 64:
        return _Heading(name, unit, problem=f"{printable(unit, 80)} is no unit")
    power = _POWER.match(name)
    if not power:
        return _Heading(name, unit)
    suffix = power.group(2) or ""
    if unit and suffix and _PER_WATT.get(unit) != _PER_WATT.get(suffix):
        return _Heading(name, unit, problem=f"{shown} names two units of power")
    if (unit or suffix) in _PER_WATT:
        return _Heading(name, unit or suffix, _PER_WATT[unit or suffix])
    if not unit and not suffix:
        return _Heading(name, "", 1.0)
    if suffix or not power.group(1):
        return _Heading(name, unit, problem=f"{printable(unit or suffix)} is no known unit of power")
    return _Heading(name, unit)  # a parameter, such as a transmitter's power [dBm]


def _power_column(row: Row, headings: Sequence[_Heading]) -> int:
    """The column `power`; else the only one whose name ends so (`total_power_w`)."""
    powers = [i for i, heading in enumerate(headings) if heading.per_watt]
    plain = [i for i in powers if headings[i].name.lower().startswith("power")]
    chosen = plain or powers
    if not chosen:
        raise InputError(row.fault(0, "no column for the power", _A_HEADER))
    if len(chosen) > 1:
        several = ", ".join(headings[i].name for i in chosen)
        raise InputError(row.fault(chosen[1], f"several columns of power: {several}", "one, called power_w"))
    return chosen[0]


# ── what the rows say ──

_Readings = dict[tuple[float, ...], list[tuple[float, Row]]]


def _readings(rows: Sequence[Row], layout: _Layout) -> _Readings:
    """Power readings [W] and their rows by configuration, in the order of the file."""
    readings: _Readings = {}
    faults: list[Fault] = []
    for row in rows:
        if len(row.fields) != layout.width:
            at = min(len(row.fields), layout.width)
            faults.append(row.fault(at, f"{len(row.fields)} fields", f"{layout.width}, as in the first row"))
            continue
        numbers = [_number(row, i, faults) for i in (*layout.parameters, layout.power)]
        power_w = numbers.pop() / layout.per_watt
        if power_w < 0:
            faults.append(row.fault(layout.power, f"a power of {power_w:g} W", "a power of 0 or more"))
        readings.setdefault(tuple(numbers), []).append((power_w, row))
    if faults:
        raise capped(faults)
    return readings


def _number(row: Row, index: int, faults: list[Fault]) -> float:
    """A field as a finite number; a fault and 0 if it is none."""
    raw = row.fields[index]
    shown = printable(raw, 40) or "an empty field"
    if NUMBER.match(raw):
        value = float(raw)
        if abs(value) <= LARGEST:
            return value
        faults.append(row.fault(index, f"{shown} is too large", f"a number of at most {LARGEST:g}"))
    elif NOT_FINITE.match(raw):
        faults.append(row.fault(index, f"{shown} is not finite", "a finite number"))
    else:
        faults.append(row.fault(index, f"{shown} is not a number", "a number"))
    return 0.0


def _average(powers_w: Sequence[float]) -> tuple[float, float]:
    """Mean and sample standard deviation [W]; the spread of one reading is 0."""
    if min(powers_w) == max(powers_w):  # exactly what was read, without the rounding of a sum
        return powers_w[0], 0.0
    mean_w = math.fsum(powers_w) / len(powers_w)
    variance = math.fsum((power_w - mean_w) ** 2 for power_w in powers_w) / (len(powers_w) - 1)
    return mean_w, math.sqrt(variance)


def _check_agreement(readings: _Readings, layout: _Layout) -> None:
    """Refuse repeated configurations whose spread is above `SPREAD_LIMIT` of their mean: that is no noise."""
    faults = []
    for point, group in readings.items():
        mean_w, spread_w = _average([power_w for power_w, _ in group])
        if spread_w <= SPREAD_LIMIT * mean_w:
            continue
        low_w, low = min(group, key=lambda reading: reading[0])
        high_w, high = max(group, key=lambda reading: reading[0])
        where = ", ".join(f"{name}={value:g}" for name, value in zip(layout.names, point, strict=True))
        readings_said = f"{low_w:g} W in line {low.line} and {high_w:g} W in line {high.line}"
        spread = f"a spread of {100 * spread_w / mean_w:.0f} % of the mean"
        message = f"repeated configurations that disagree: {where} draws {readings_said}, {spread}"
        later = max(low, high, key=lambda row: row.line)
        faults.append(later.fault(layout.power, message, f"at most {100 * SPREAD_LIMIT:.0f} %"))
    if faults:
        raise capped(faults)
