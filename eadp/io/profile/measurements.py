"""Measurements of computations as CSV: a header, powprofiler's flags, or numbers alone."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from eadp.core.signals import average
from eadp.errors import FAULTS_READ, Fault, Infeasible, InputError, printable, refuse
from eadp.io.text.csv import NOT_FINITE, NUMBER, Row, number_fault, read_rows, repeated
from eadp.io.text.streams import Text
from eadp.models.profile import Profile

LARGEST = 1e30
"""Largest magnitude of a number in a profile: no power or parameter, and far from where floats end."""

LARGE_W = 1e3
"""Power beyond which measurements may be in mW [W]: onboard computers draw up to some hundred."""

PARAMETERS_LIMIT = 8
"""Most parameters of a configuration: interpolating between points costs 2^parameters."""

NAME = re.compile(r"[^\W\d](?:[\w .+/-]{0,62}\w)?\Z")
A_NAME = "a name: a letter first, then letters, digits, _ - + . / or spaces, 64 at most"

# a division by 1000 keeps the digits of a value in mW, where a product with 0.001 would not
_PER_WATT = {"w": 1.0, "W": 1.0, "watt": 1.0, "watts": 1.0, "mW": 1e3, "mw": 1e3, "kW": 1e-3, "kw": 1e-3}
_A_HEADER = "a header such as fps,power_w"

_SOURCE = re.compile(r"^[^\S\n]*#[^\S\n]*source:(.*)$", re.IGNORECASE | re.MULTILINE)
_HEADING = re.compile(r"([^\[(]*)(?:[\[(]([^\])]*)[\])])?\Z")
_POWER = re.compile(r"(?:.*[ _-])?power(?:[ _-]([a-zµ]?w|watts?))?\Z", re.IGNORECASE)
_NO_PARAMETER = re.compile(
    r"(?:time|timestamp|energy|soc)(?:[ _-](?:s|ms|us|j|mj|wh|mwh))?\Z"
    r"|(?:std|standard_error)[ _-][mk]?w\Z|samples\Z|extrapolated\Z",  # as eadp writes them
    re.IGNORECASE,
)


def read_measurements(tables: Sequence[Text]) -> tuple[Profile, list[Fault]]:
    """The profile of measurements: repeated configurations averaged, with their standard deviation and number.

    Parameters
    ----------
    tables : sequence of Text
        One or more, of the same parameters.

    Returns
    -------
    Profile
    list of Fault
        Warnings, first by line.

    Raises
    ------
    InputError
        With the faults of the file.
    """
    readings: dict[tuple[float, ...], _Reading] = {}
    layouts: list[_Layout] = []
    sources: list[str] = []
    for table in tables:
        rows = read_rows(table.name, table.body)
        first = next(rows, None)
        if first is None:
            raise InputError.at(table.name, 1, 1, "no measurements", f"{_A_HEADER} and a row for each measurement")
        layout = _layout(first)
        if layouts and layout.measured != layouts[0].measured:
            expected = f"{layouts[0].measured}, as in the first file"
            raise InputError(first.fault(0, f"measurements of {layout.measured}", expected))
        _read_rows(rows if layout.header else chain([first], rows), layout, readings)
        layouts.append(layout)
        name = "standard input" if table.name == "<stdin>" else os.path.basename(table.name)
        sources.append(stated_source(table) or name)
    if len(readings) < 2:
        message = "one configuration only" if readings else "no measurements"
        raise InputError.at(tables[-1].name, 1, 1, message, "measurements of two configurations or more")
    warnings = [warning for each in layouts for warning in each.warnings]
    warnings += _too_large(max(readings.values(), key=lambda each: each.max_w))
    averages = [average(each.runs) for each in readings.values()]
    try:
        profile = Profile(
            names=tuple(column.name for column in layouts[0].configuration),
            units=tuple(column.unit for column in layouts[0].configuration),
            configurations=np.array(list(readings)),
            power_w=np.array([each.mean for each in averages]),
            std_w=np.array([each.std for each in averages]),
            samples=np.array([each.samples for each in averages]),
            source=" + ".join(dict.fromkeys(sources)),
            standard_error_w=np.array([each.standard_error if each.samples > 1 else np.nan for each in averages]),
        )
    except Infeasible as error:
        first = next(iter(readings.values())).row
        raise InputError(first.fault(0, str(error), "a full grid, or points that span an area")) from None
    found = [replace(fault, severity="warning") for fault in warnings]
    return profile, sorted(found, key=lambda fault: (fault.file, fault.line, fault.column))


def _too_large(largest: _Reading) -> list[Fault]:
    """A warning of a power too large for a computer; raises InputError if it has no unit."""
    if largest.max_w <= LARGE_W:
        return []
    power, message = largest.layout.power, f"a power of {largest.max_w:g} W"
    fault = largest.row.fault(power, message, f"at most {LARGE_W:g} W of a computer; mW in power_mw")
    refuse([] if largest.layout.columns[power].unit else [fault])
    return [fault]


def stated_source(text: Text) -> str:
    """Where measurements come from, by their comments `# source:`; empty without any."""
    return " ".join(map(str.strip, _SOURCE.findall(text.body)))


# ── columns ──


@dataclass(frozen=True)
class ColumnHeading:
    """A column's name and unit ('' unknown); for power, how many of the unit make a watt, else 0."""

    name: str
    unit: str
    per_watt: float = 0.0
    problem: str = ""


@dataclass(frozen=True)
class _Layout:
    """What the columns of a table are, and the places of the parameters and the power; whether a row is the header."""

    columns: Sequence[ColumnHeading]
    parameters: list[int]
    power: int
    header: bool = True
    warnings: Sequence[Fault] = ()

    @property
    def configuration(self) -> list[ColumnHeading]:
        """The columns of the parameters."""
        return [self.columns[i] for i in self.parameters]

    @property
    def measured(self) -> str:
        """The parameters with their units, for people."""
        return ", ".join(f"{column.name} {column.unit}".strip() for column in self.configuration)


_NUMBERS_ALONE = (ColumnHeading("c", ""), ColumnHeading("power", "W", 1.0))
"""A parameter, which is called c, and the power."""


class _Reading(NamedTuple):
    """What was measured at a configuration: the row with the first of it, its file's layout, and power [W] by run."""

    row: Row
    layout: _Layout
    runs: list[list[float]]

    @property
    def max_w(self) -> float:
        """The greatest power [W]."""
        return max(map(max, self.runs))


def _layout(row: Row) -> _Layout:
    """Read the first row: a header, powprofiler's flags, or the first measurement of numbers alone."""
    headings = _headings(row.fields)
    if headings and not any(map(_is_parameter, headings)) and any(each.per_watt for each in headings):
        message = "no column for the configuration: it is a trace"
        expected = "that of each file, as in --config fps=2 --config fps=10"
        raise InputError(row.fault(0, message, expected))
    if len(row.fields) == 1:
        raise InputError(row.fault(0, "one column only", f"{_A_HEADER}, fields separated by commas"))
    if headings is None and len(row.fields) > 2:
        raise InputError(row.fault(0, f"{len(row.fields)} columns without names", _A_HEADER))
    layout = _header(row, headings or _NUMBERS_ALONE)
    if len(layout.parameters) > PARAMETERS_LIMIT:
        message = f"{len(layout.parameters)} columns of parameters"
        raise InputError(row.fault(layout.parameters[PARAMETERS_LIMIT], message, f"at most {PARAMETERS_LIMIT}"))
    return replace(layout, header=headings is not None)


def _headings(fields: Sequence[str]) -> list[ColumnHeading] | None:
    """What a header or powprofiler's flags name; None for the numbers of a first measurement.

    Of powprofiler's columns, 2xx are parameters, 100 is the total average power, 101 and 102 are those of CPU and GPU,
    which are parts of the total. 130 to 132, called energy, are W·samples, and 160 to 162 states of charge.

    Source: powprofiler, doi 10.5281/zenodo.5562457 (letter, reference 48).
    """
    if has_flags(fields):
        flags = {"100": ColumnHeading("power", "W", 1.0)}
        return [flags.get(field, ColumnHeading(f"p{field}" if field.startswith("2") else "", "")) for field in fields]
    if all(NUMBER.match(field) or NOT_FINITE.match(field) for field in fields):
        return None
    return [read_heading(field) for field in fields]


def has_flags(fields: Sequence[str]) -> bool:
    """Whether numbers are powprofiler's column flags, and not a first measurement such as `200,130`."""
    known = {f"{kind}{part}" for kind in ("10", "13", "16") for part in "012"}
    flags = all(field in known or re.fullmatch("2[0-9]{2}", field) for field in fields)
    return flags and len(set(fields)) == len(fields) and ("100" in fields or len(fields) > 2)


def is_parameter(name: str) -> bool:
    """Whether a column may be a parameter, by its name: it is no power, time, energy or statistic."""
    return _is_parameter(read_heading(name))


def _is_parameter(heading: ColumnHeading) -> bool:
    return bool(heading.name) and not heading.per_watt and not _NO_PARAMETER.match(heading.name)


def _header(row: Row, headings: Sequence[ColumnHeading]) -> _Layout:
    _check_headings(row, headings)
    power = _power_column(row, headings)
    parameters = [i for i, heading in enumerate(headings) if _is_parameter(heading)]
    warnings = [
        row.fault(i, f"{heading.name} is no parameter of the computations: ignored")
        for i, heading in enumerate(headings)
        if heading.name and i != power and not _is_parameter(heading)
    ]
    if not headings[power].unit:
        warnings.append(row.fault(power, "power without a unit: taken as W", "power_w, or power [W]"))
    return _Layout(headings, parameters, power, warnings=warnings)


def _check_headings(row: Row, headings: Sequence[ColumnHeading]) -> None:
    faults = [row.fault(i, heading.problem, _A_HEADER) for i, heading in enumerate(headings) if heading.problem]
    twice = repeated([heading.name for heading in headings])
    faults += [row.fault(i, f"the column {printable(headings[i].name, 80)} stands twice", "each once") for i in twice]
    refuse(faults)


def read_heading(field: str) -> ColumnHeading:
    """Read `fps`, `fps [1/s]`, `power_w`, `power (mW)`."""
    split = _HEADING.match(field)
    name, unit = (split.group(1).strip(), (split.group(2) or "").strip()) if split else (field, "")
    shown = printable(field, 80) or "an empty field"
    if not NAME.match(name):
        return ColumnHeading(name, unit, problem=f"{shown} is no name")
    if not unit.isprintable() or len(unit) > 64:
        return ColumnHeading(name, unit, problem=f"{printable(unit, 80)} is no unit")
    if not (power := _POWER.match(name)):
        return ColumnHeading(name, unit)
    suffix = power.group(1) or ""
    if unit and suffix and _PER_WATT.get(unit) != _PER_WATT.get(suffix):
        return ColumnHeading(name, unit, problem=f"{shown} names two units of power")
    given = unit or suffix
    if given and given not in _PER_WATT:
        return ColumnHeading(name, unit, problem=f"{printable(given)} is no known unit of power")
    return ColumnHeading(name, given, _PER_WATT.get(given, 1.0))


def _power_column(row: Row, headings: Sequence[ColumnHeading]) -> int:
    """The column `power`; else the only one whose name ends so (`total_power_w`)."""
    powers = [i for i, heading in enumerate(headings) if heading.per_watt]
    chosen = [i for i in powers if headings[i].name.lower().startswith("power")] or powers
    if not chosen:
        raise InputError(row.fault(0, "no column for the power", f"{_A_HEADER}, or powprofiler's flag 100"))
    if len(chosen) > 1:
        several = ", ".join(headings[i].name for i in chosen)
        expected = "one, called power_w, or --power NAME"
        raise InputError(row.fault(chosen[1], f"several columns of power: {several}", expected))
    return chosen[0]


# ── rows ──


def _read_rows(rows: Iterable[Row], layout: _Layout, readings: dict[tuple[float, ...], _Reading]) -> None:
    """Add a file's power readings by configuration: consecutive rows make a run."""
    faults: list[Fault] = []
    before: tuple[float, ...] | None = None
    columns = (*layout.parameters, layout.power)
    for row in rows:
        if len(faults) >= FAULTS_READ:
            break
        width = len(layout.columns)
        if len(row.fields) != width:
            at = min(len(row.fields), width)
            faults.append(row.fault(at, f"{len(row.fields)} fields", f"{width}, as in the first row"))
            continue
        wrong = [row.fault(i, *fault) for i in columns if (fault := number_fault(row.fields[i], LARGEST))]
        if wrong:
            faults += wrong
            continue
        *values, power = (float(row.fields[i]) for i in columns)
        power_w = power / layout.columns[layout.power].per_watt
        if power_w < 0:
            faults.append(row.fault(layout.power, f"a power of {power_w:g} W", "a power of 0 or more"))
        point = tuple(values)
        runs = readings.setdefault(point, _Reading(row, layout, [])).runs
        if point != before:
            runs.append([])
        runs[-1].append(power_w)
        before = point
    refuse(faults)
