"""Measurements of computations, as CSV: with a header, with powprofiler's flags, or numbers alone."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from eadp.core.signals.averaging import SampleMean, average
from eadp.errors import Fault, Infeasible, InputError, capped, printable
from eadp.io.text.csv import NOT_FINITE, NUMBER, Row, split_fields
from eadp.io.text.streams import Text
from eadp.models.profile import FEW, Profile

SPREAD_LIMIT = 0.2
"""Largest spread of a repeated configuration, as a part of its mean: beyond it, a reading is wrong. Of many samples,
such as a sensor's over time, the largest standard error instead, and a larger spread is worth a warning."""

LARGEST = 1e30
"""Largest magnitude of a number in a profile: no power or parameter, and far from where floats end."""

PARAMETERS_LIMIT = 8
"""Most parameters of a configuration: interpolating between points costs 2^parameters."""

NAME = re.compile(r"[^\W\d](?:[\w .+/-]{0,62}\w)?\Z")
A_NAME = "a name: a letter first, then letters, digits, _ - + . / or spaces, 64 at most"

# a division by 1000 keeps the digits of a value in mW, where a product with 0.001 would not
_PER_WATT = {"w": 1.0, "W": 1.0, "watt": 1.0, "watts": 1.0, "mW": 1e3, "mw": 1e3, "kW": 1e-3, "kw": 1e-3}
_A_HEADER = "a header such as fps,power_w"
_A_CONFIGURATION = "what it was measured at, as in --config fps=0.5, or columns that say so"

_SOURCE = re.compile(r"#\s*source:(.*)\Z", re.IGNORECASE)
_HEADING = re.compile(r"([^\[(]*)(?:[\[(]([^\])]*)[\])])?\Z")
_POWER = re.compile(r"(.*[ _-])?power(?:[ _-]([a-zµ]?w|watts?))?\Z", re.IGNORECASE)
_NO_PARAMETER = re.compile(r"(?:time|timestamp|energy|soc)(?:[ _-](?:s|ms|us|j|mj|wh|mwh))?\Z", re.IGNORECASE)


@dataclass(frozen=True)
class Places:
    """What reading found beside the profile: warnings, and an empty fault where each configuration stands."""

    of_point: dict[tuple[float, ...], Fault]
    warnings: Sequence[Fault] = ()


@dataclass(frozen=True)
class Configuration:
    """Parameters of the computations, their units ('' unknown) and a value [unit] for each."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]

    def __str__(self) -> str:
        return ",".join(f"{name}={value:.10g}" for name, value in zip(self.names, self.values, strict=True))


class Trace(NamedTuple):
    """A file of measurements and what it was measured at, if the file itself does not say."""

    text: Text
    configuration: Configuration | None = None


def read_measurements(
    files: Sequence[Trace], names: Sequence[str], *, nameless: bool = False
) -> tuple[Profile, Places]:
    """The profile that measurements make: repeated configurations averaged, their spread and count kept.

    Parameters
    ----------
    files : sequence of Trace
        One or more, of the same parameters; the configuration of a file that has columns for its parameters is not
        used.
    names : sequence of str
        Names for parameters that the file leaves nameless; see `eadp.io.profile.model_file.read_profile`.
    nameless : bool
        Take several columns of numbers alone without names, as c1, c2, …: they are named later.

    Raises
    ------
    InputError
        With all the faults of the file, as far as they can be told together.
    """
    readings: _Readings = {}
    layouts: list[_Layout] = []
    sources: list[str] = []
    rows: list[Row] = []
    for file in files:
        rows, source = _rows(file.text)
        if not rows:
            message = "no measurements"
            raise InputError.at(file.text.name, 1, 1, message, f"{_A_HEADER} and a row for each measurement")
        layout = _layout(rows[0], names, file.configuration, nameless)
        if layouts:
            layout = _like(layouts[0], layout, rows[0])
        _read_rows(rows[layout.first :], layout, readings)
        layouts.append(layout)
        name = "standard input" if file.text.name == "<stdin>" else os.path.basename(file.text.name)
        sources.append(source or name)
    if len(readings) < 2:
        message = "one configuration only" if readings else "no measurements"
        raise InputError(rows[-1].fault(0, message, "measurements of two configurations or more"))
    return _averaged(readings, layouts, " + ".join(dict.fromkeys(sources)), rows[layouts[-1].first])


def _averaged(readings: _Readings, layouts: Sequence[_Layout], source: str, first: Row) -> tuple[Profile, Places]:
    """The profile of all readings, and what is odd about them."""
    layout = layouts[0]
    averages = [average([[power_w for power_w, _ in run] for run in runs]) for runs in readings.values()]
    warnings = [*(warning for each in layouts for warning in each.warnings)]
    warnings += _check_agreement(readings, averages, layout)
    try:
        profile = Profile(
            names=tuple(layout.names),
            units=tuple(layout.units),
            configurations=np.array(list(readings)),
            power_w=np.array([each.mean for each in averages]),
            spread_w=np.array([each.std for each in averages]),
            samples=np.array([each.samples for each in averages]),
            source=source,
            standard_error_w=np.array([each.standard_error if each.samples > 1 else np.nan for each in averages]),
        )
    except Infeasible as error:
        raise InputError(first.fault(0, str(error), "a full grid, or points that span an area")) from None
    places = {point: runs[0][0][1].fault(0, "") for point, runs in readings.items()}
    return profile, Places(places, warnings)


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


def is_trace(text: Text) -> bool:
    """Whether a table has power but no column of a parameter: power over time at a configuration it does not tell."""
    rows, _ = _rows(text)
    if not rows:
        return False
    fields = rows[0].fields
    if all(NUMBER.match(field) for field in fields):
        return (_has_flags(fields) or fields == ["100"]) and not any(field.startswith("2") for field in fields)
    headings = [_heading(field) for field in fields]
    return any(each.per_watt for each in headings) and all(
        each.per_watt or _NO_PARAMETER.match(each.name) for each in headings
    )


# ── what the columns mean ──


@dataclass(frozen=True)
class _Layout:
    """What the columns of a table mean.

    `parameters` and `power` are indices of columns; the power has `per_watt` units to a watt; the first
    measurement is in row `first`, and each row has `width` fields. A trace has no columns of parameters, but the
    values `constant` of all of them.
    """

    names: list[str]
    units: list[str]
    parameters: list[int]
    power: int
    width: int
    per_watt: float = 1.0
    first: int = 1
    warnings: Sequence[Fault] = ()
    constant: tuple[float, ...] = ()


def _layout(row: Row, names: Sequence[str], stated: Configuration | None, nameless: bool) -> _Layout:
    """Read the first row: a header, powprofiler's flags, or the first measurement of numbers alone."""
    if len(row.fields) == 1:
        if stated and (_heading(row.fields[0]).per_watt or row.fields[0] == "100"):
            return _trace(row, 0, _heading(row.fields[0]).per_watt or 1.0, stated, [])
        raise InputError(row.fault(0, "one column only", f"{_A_HEADER}, fields separated by commas"))
    if not all(NUMBER.match(field) or NOT_FINITE.match(field) for field in row.fields):
        layout = _header(row, stated)
    elif _has_flags(row.fields):
        layout = _flags(row, stated)
    else:
        layout = _headerless(row, names, nameless)
    if len(layout.parameters) > PARAMETERS_LIMIT:
        message = f"{len(layout.parameters)} columns of parameters"
        place = layout.parameters[PARAMETERS_LIMIT]
        raise InputError(row.fault(place, message, f"at most {PARAMETERS_LIMIT}"))
    return layout


def _trace(row: Row, power: int, per_watt: float, stated: Configuration, warnings: Sequence[Fault]) -> _Layout:
    """Power over time at one configuration."""
    names, units, constant = list(stated.names), list(stated.units), stated.values
    return _Layout(names, units, [], power, len(row.fields), per_watt, warnings=warnings, constant=constant)


def _like(first: _Layout, layout: _Layout, row: Row) -> _Layout:
    """A further file's layout, its parameters in the order of the first's."""
    if sorted(zip(layout.names, layout.units, strict=True)) != sorted(zip(first.names, first.units, strict=True)):
        here = ", ".join(f"{name} {unit}".strip() for name, unit in zip(layout.names, layout.units, strict=True))
        there = ", ".join(f"{name} {unit}".strip() for name, unit in zip(first.names, first.units, strict=True))
        expected = f"{there}, as in the first file; --add for computations that were measured apart"
        raise InputError(row.fault(0, f"measurements of {here}", expected))
    order = [layout.names.index(name) for name in first.names]
    return replace(
        layout,
        names=first.names,
        units=first.units,
        parameters=[layout.parameters[i] for i in order] if layout.parameters else [],
        constant=tuple(layout.constant[i] for i in order) if layout.constant else (),
    )


def _headerless(row: Row, names: Sequence[str], nameless: bool) -> _Layout:
    """Numbers alone: parameters, then power; a single parameter is called c."""
    d = len(row.fields) - 1
    if d > 1 and nameless:
        names = [f"c{i + 1}" for i in range(d)]
    if d > 1 and len(names) != d:
        message = f"{d + 1} columns without names"
        raise InputError(row.fault(0, message, f"{_A_HEADER}, or --names with {d} names"))
    return _Layout(list(names) if d > 1 else ["c"], [""] * d, list(range(d)), power=d, width=d + 1, first=0)


def _has_flags(fields: Sequence[str]) -> bool:
    """Whether numbers are powprofiler's column flags, and not a first measurement such as `200,130`."""
    known = {f"{kind}{part}" for kind in ("10", "13", "16") for part in "012"}
    flags = all(field in known or re.fullmatch("2[0-9]{2}", field) for field in fields)
    return flags and len(set(fields)) == len(fields) and ("100" in fields or len(fields) > 2)


def _flags(row: Row, stated: Configuration | None) -> _Layout:
    """powprofiler's columns: 2xx are parameters, 100 is the total average power; the others are not needed.

    101 and 102 are parts of the total; 130 to 132, called energy, are W·samples.

    Source: powprofiler, doi 10.5281/zenodo.5562457 (letter, reference 48).
    """
    parameters = [i for i, flag in enumerate(row.fields) if flag.startswith("2")]
    if not parameters and not stated:
        message = "a powprofiler trace: power over time, without the configuration it was measured at"
        raise InputError(row.fault(0, message, _A_CONFIGURATION))
    if "100" not in row.fields:
        raise InputError(row.fault(0, "no total power", "a column 100 among powprofiler's flags"))
    power = row.fields.index("100")
    if not parameters and stated:
        return _trace(row, power, 1.0, stated, [])
    names = [f"p{row.fields[i]}" for i in parameters]
    return _Layout(names, [""] * len(names), parameters, power, width=len(row.fields))


def heading(field: str) -> tuple[str, str, str]:
    """The name and the unit ('' unknown) of a parameter's column, as in `fps [1/s]`, and what is wrong with them."""
    found = _heading(field)
    return found.name, found.unit, found.problem or ("a power is no parameter" if found.per_watt else "")


@dataclass(frozen=True)
class _Heading:
    """A column's name and unit ('' unknown); for power, how many of the unit make a watt, else 0."""

    name: str
    unit: str
    per_watt: float = 0.0
    problem: str = ""


def _header(row: Row, stated: Configuration | None) -> _Layout:
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
    parameters = sorted(set(range(len(headings))) - set(idle))
    ignored = [(i, headings[i].name) for i in idle if i != power and (parameters or headings[i].per_watt)]
    warnings = [row.fault(i, f"{name} is no parameter of the computations: ignored") for i, name in ignored]
    if not headings[power].unit:
        warnings.append(row.fault(power, "power without a unit: taken as W", "power_w, or power [W]"))
    per_watt = headings[power].per_watt
    if not parameters and stated:
        return _trace(row, power, per_watt, stated, warnings)
    if not parameters:
        raise InputError(row.fault(0, "no column for the configuration", _A_HEADER))
    names, units = [headings[i].name for i in parameters], [headings[i].unit for i in parameters]
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

_Run = list[tuple[float, Row]]
_Readings = dict[tuple[float, ...], list[_Run]]


def _read_rows(rows: Sequence[Row], layout: _Layout, readings: _Readings) -> None:
    """Add a file's power readings [W] and their rows by configuration: rows that follow one another make a run."""
    faults: list[Fault] = []
    before: tuple[float, ...] | None = None
    for row in rows:
        if len(row.fields) != layout.width:
            at = min(len(row.fields), layout.width)
            faults.append(row.fault(at, f"{len(row.fields)} fields", f"{layout.width}, as in the first row"))
            continue
        numbers = [_number(row, i, faults) for i in (*layout.parameters, layout.power)]
        power_w = numbers.pop() / layout.per_watt
        if power_w < 0:
            faults.append(row.fault(layout.power, f"a power of {power_w:g} W", "a power of 0 or more"))
        point = layout.constant or tuple(numbers)
        runs = readings.setdefault(point, [])
        if point != before:
            runs.append([])
        runs[-1].append((power_w, row))
        before = point
    if faults:
        raise capped(faults)


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


def _check_agreement(readings: _Readings, averages: Sequence[SampleMean], layout: _Layout) -> list[Fault]:
    """Refuse repeated configurations that disagree: a few readings by their spread, many by their standard error.

    Returns warnings of many readings that spread wide, though their mean is known well.
    """
    faults, wide = [], []
    for (point, runs), found in zip(readings.items(), averages, strict=True):
        if found.std <= SPREAD_LIMIT * found.mean:
            continue
        group = [reading for run in runs for reading in run]
        low_w, low = min(group, key=lambda reading: reading[0])
        high_w, high = max(group, key=lambda reading: reading[0])
        where = ", ".join(f"{name}={value:g}" for name, value in zip(layout.names, point, strict=True))
        readings_said = f"{where} draws {low_w:g} W in line {low.line} and {high_w:g} W in line {high.line}"
        spread = f"a spread of {100 * found.std / found.mean:.0f} % of the mean"
        later = max(low, high, key=lambda row: row.line)
        if found.samples >= FEW and found.standard_error <= SPREAD_LIMIT * found.mean:
            wide.append(later.fault(layout.power, f"power that varies a lot: {readings_said}, {spread}"))
            continue
        message = f"repeated configurations that disagree: {readings_said}, {spread}"
        faults.append(later.fault(layout.power, message, f"at most {100 * SPREAD_LIMIT:.0f} %"))
    if faults:
        raise capped(faults)
    return wide
