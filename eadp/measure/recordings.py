"""What programs record of a computer's power: which columns make the power of the board, in which unit.

One list for `eadp profile` and `eadp fit`: tegrastats as text; jtop, nvidia-smi, turbostat, INA219,
INA226 and INA3221, hwmon, RAPL, and tables with a column of power among others, as CSV.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import islice
from typing import TYPE_CHECKING, Annotated, NamedTuple

from eadp.errors import FAULTS_READ, Fault, InputError, printable, refuse
from eadp.io.profile.measurements import LARGE_W, has_flags, is_parameter, read_heading, stated_source
from eadp.io.text.csv import NUMBER, Row, number_fault, read_rows, repeated
from eadp.io.text.options import Flag
from eadp.io.text.streams import Text
from eadp.models.profile import titles

if TYPE_CHECKING:
    from eadp.measure.measuring import Configuration


class Device(NamedTuple):
    """A board and its rails, by patterns of their names; those that make its power are added, and `also` if there."""

    name: str
    rails: tuple[str, ...]
    also: str = ""
    part: str = ""
    """What the power is of, where it is not the computer's."""


DEVICES = (
    # jetson_stats, pull request 900: the input of the carrier board
    Device("a Jetson AGX Thor", ("VIN",)),
    # NVIDIA, forum 200883: the whole module; energymon, JetsonPowerRails.md: VDD_MUX feeds the carrier of a TX1
    Device("a Jetson TX1, TX2, Xavier NX, Orin NX or Orin Nano", ("VDD_IN|5V_IN",)),
    # NVIDIA, forum 73608: "the overall 5V input to the board"
    Device("a Jetson Nano", ("POM_5V_IN",)),
    # NVIDIA, forum 81016, and energymon, JetsonPowerRails.md: no rail feeds the others
    Device("a Jetson AGX Xavier", ("GPU", "CPU", "SOC", "CV", "VDDRQ", "SYS5V")),
    # jetson_stats, issue 344 and total_power: VIN_SYS_5V0 is the I/O
    Device("a Jetson AGX Orin", ("VDD_GPU_SOC", "VDD_CPU_CV", "VIN_SYS_5V0"), also="VDDQ_VDD2_1V8AO"),
    # jtop leaves the rail of the board out of the others, or adds all
    Device("jtop", ("TOT|TOTAL|CUR",)),
    # kernel, powercap: psys is the platform; the memory is beside a package, and cores are in it
    Device("RAPL", ("PSYS|SYS",)),
    Device("RAPL", (r"(?:CPU[ _-]?)?(?:PACKAGE|PKG)(?:[ _-]?[0-9])?",), also="D?RAM(?:[ _-]?[0-9])?", part="processor"),
    Device("nvidia-smi", (r"POWER\.DRAW(?:\.\w+)?",), part="GPU"),
)
"""The devices known; the first whose rails a recording has makes the power."""

_PER_WATT = {"w": 1.0, "watt": 1.0, "watts": 1.0, "mw": 1e3, "milliwatt": 1e3, "milliwatts": 1e3, "kw": 1e-3}
_PER_WATT |= dict.fromkeys(("uw", "µw", "μw"), 1e6)
_UNIT = r"m?w|[uµμ]w|kw|(?:milli)?watts?"
_HEADING = re.compile(
    rf"(?:(?P<power>power)[ _-])?(?P<rail>.+?)(?:[ _-](?P<mean>avg|mean|average|cur|inst))?"
    rf"(?:[ _-]*[\[(]?(?<![^\W_])(?P<unit>{_UNIT})[\])]?)?(?:[ _-](?:avg|mean|average))?\Z",
    re.IGNORECASE,
)
_JOINED_UNIT = re.compile(r"(?<=[A-Za-z])Watt\Z")  # turbostat: PkgWatt
_STATED_UNIT = re.compile(rf"(.+?)\s*[\[(]({_UNIT})[\])]\Z", re.IGNORECASE)
_RAIL = re.compile(r"(?:POM|VDDQ?|VIN)_\w+\Z|(?:VDDRQ|VIN|SYS5V|5V_IN)\Z")
_DRAWN = "POWER.DRAW"  # nvidia-smi
_LIKE_POWER = re.compile(r"power|pwr|watt|(?:\A|[ _(\[])m?w(?:\Z|[)\]])", re.IGNORECASE)
_WATTS = re.compile(r"(?:.*[ _-])?watts?\Z", re.IGNORECASE)
_MICROWATTS = re.compile(r"power[0-9]+_(?:input|average)\Z")  # hwmon
_TIME = re.compile(r"(?:time|timestamp|date|datetime|elapsed)(?:\Z|[ _\[(])", re.IGNORECASE)
_JTOP = {"uptime", "nvp model", "jetson_clocks"}
_NO_READING = re.compile(r"\[?(?:n/?a|not supported|unknown error|nan|-)\]?\Z", re.IGNORECASE)
_WITH_UNIT = re.compile(r"([-+]?[0-9.]+) (mW|W|kW|uW|µW|mV|V|mA|uA|A|%|MHz|C|MiB|J)\Z")
_VOLTS = re.compile(r"(?!.*shunt)(?:\w*[ _])?volt(?:age|s)?[ _]?[\[(]?(m?v)[\])]?\Z|in1_input\Z", re.IGNORECASE)
_AMPERES = re.compile(r"(?:\w*[ _])?current[ _]?[\[(]?([mu]?a)[\])]?\Z|curr1_input\Z", re.IGNORECASE)
_PER = {"v": 1.0, "mv": 1e3, "a": 1.0, "ma": 1e3, "ua": 1e6}
_TEGRASTATS = re.compile(r"\bRAM [0-9]+/[0-9]+MB")
_TEGRASTATS_RAIL = re.compile(r"(\w+) ([0-9]+)(?:mW)?/[0-9]+(?:mW)?(?= |\Z)")
_TEGRASTATS_TIME = re.compile(r"([0-9]{2}-[0-9]{2}-[0-9]{4} [0-9]{2}:[0-9]{2}:[0-9]{2}) ")
RECORDED = "recorded_power_w"
"""Name of the column of what `Recording.with_power` reads."""

MIN_W = 0.05
"""Mean power below which a unit that is assumed is wrong [W]: no computer that sees draws less."""


@dataclass(frozen=True)
class PowerColumns:
    """Which columns of a recording are read."""

    power: Annotated[Sequence[str], Flag(metavar="COLUMN")] = ()
    """Column of the power, with its unit where its name has none: 'PWR_AVG [W]'. May repeat: they are added."""

    of: Annotated[str, Flag(metavar="NAME,…")] = ""
    """Columns of the parameters, in a table with others."""

    trim: Annotated[int, Flag(low=0)] = 0
    """Leave out so many readings at the start and the end of a trace, as of an idle computer."""

    @property
    def parameters(self) -> list[str]:
        """The names of `of`."""
        return [name.strip() for name in self.of.split(",")] if self.of else []


class PowerColumn(NamedTuple):
    """A column of power, and how many of its units make a watt."""

    place: int
    name: str
    per_watt: float
    assumed: bool = False
    """Whether the unit is usual, and not written."""


@dataclass(frozen=True)
class Recording:
    """A table and what makes its power: `parts` are added, or a voltage and a current multiplied."""

    text: Text
    header: Row
    rows: list[Row]
    parts: list[PowerColumn]
    product: bool
    others: list[int]
    """Columns that are neither power nor time, and have a name."""
    timed: bool
    """Whether a column has the time."""
    device: Device | None

    @property
    def power_text(self) -> str:
        """The columns that make the power."""
        return (" × " if self.product else " + ").join(re.sub(r" \[\w+\]\Z", "", each.name) for each in self.parts)

    def notes(self) -> list[Fault]:
        """What is to be known of the power: that columns are added, and that it is of a part alone."""
        if self.device is None or not (self.device.part or len(self.parts) > 1):
            return []
        why = f"{self.device.name} has no sensor of the whole"
        if self.device.part:
            why = f"that of the {self.device.part} alone, without the rest of the computer"
        fault = self.header.fault(self.parts[0].place, f"the power is {self.power_text}: {why}")
        return [replace(fault, severity="warning")]

    def powers_w(self) -> list[float | None]:
        """The power of each row [W]; None where it has no reading. Raises InputError."""
        faults: list[Fault] = []
        result: list[float | None] = []
        for row in self.rows:
            values, fault = [], None
            for part in self.parts:
                raw = row.fields[part.place] if part.place < len(row.fields) else ""
                if raw and not _NO_READING.match(raw):
                    fault = fault or number_fault(raw, 1e30)
                    values.append(0.0 if fault else float(raw) / part.per_watt)
                if fault:
                    faults.append(row.fault(part.place, *fault))
            whole = len(values) == len(self.parts) and fault is None
            result.append((values[0] * values[1] if self.product else sum(values)) if whole else None)
            if len(faults) >= FAULTS_READ:
                break
        refuse(faults)
        known = [each for each in result if each is not None]
        mean_w = sum(known) / len(known) if known else 0.0
        if any(part.assumed for part in self.parts) and known and not MIN_W <= mean_w <= LARGE_W:
            name = self.parts[0].name
            message = f"{self.power_text} has no unit, and a mean of {mean_w:.4g} W in that which is usual"
            raise InputError(self.header.fault(self.parts[0].place, message, f"its unit, as in --power '{name} [W]'"))
        return result

    def with_power(self) -> Text:
        """The table with a column `RECORDED` beside the others, line by line."""
        mark = self.header.mark or ","
        lines = [""] * self.header.line
        lines[-1] = mark.join([*map(_quoted, self.header.fields), RECORDED])
        for row, power_w in zip(self.rows, self.powers_w(), strict=True):
            lines += [""] * (row.line - len(lines))
            fields = (row.fields + [""] * len(self.header.fields))[: len(self.header.fields)]
            lines[-1] = mark.join([*map(_quoted, fields), "" if power_w is None else f"{power_w:.9g}"])
        return Text(self.text.name, "\n".join([*lines, ""]))

    def measurements(self, places: Sequence[int], configuration: Configuration | None, trim: int) -> Text:
        """The table of measurements, line by line: columns of the parameters, the configuration's, and `power_w`.

        `trim` readings are left out at each end.
        """
        powers_w = self.powers_w()
        known = [i for i, each in enumerate(powers_w) if each is not None]
        kept = set(known[trim : len(known) - trim])
        if not kept:
            message = f"no readings of {self.power_text}{f', {trim} left out at each end' if trim else ''}"
            raise InputError(self.header.fault(self.parts[0].place, message, "readings of the power"))
        stated, values = [], []
        if configuration is not None:
            stated = list(titles(configuration.names, configuration.units))
            values = [repr(value) for value in configuration.values]
        lines = [""] * self.header.line
        lines[-1] = ",".join([*(_quoted(self.header.fields[i]) for i in places), *stated, "power_w"])
        for i, (row, power_w) in enumerate(zip(self.rows, powers_w, strict=True)):
            lines += [""] * (row.line - len(lines))
            if i in kept:
                cells = [row.fields[place] if place < len(row.fields) else "" for place in places]
                lines[-1] = ",".join([*cells, *values, f"{power_w:.10g}"])
        ends = f", {trim} readings left out at each end" if trim else ""
        source = stated_source(self.text) or self.text.name.rpartition("/")[2]
        return Text(self.text.name, "\n".join([*lines, f"# source: {source} ({self.power_text}{ends})", ""]))

    def parameters(self, of: Sequence[str], *, stated: bool) -> list[int]:
        """Places of the columns of the parameters: those `of` names, else the one that may be; none of a trace.

        Where configurations are `stated`, several columns beside the power are no parameters. Raises InputError where
        the parameters are not known.
        """
        fields = self.header.fields
        if of:
            names = {read_heading(name).name: i for i, name in enumerate(fields)} | {n: i for i, n in enumerate(fields)}
            for name in of:
                if name not in names:
                    message, expected = f"no column {printable(name, 80)}", f"one of {_names(self.header, self.others)}"
                    raise InputError.at("--of", 1, 1, message, expected, ",".join(of))
            return [names[name] for name in of]
        if self.timed or not self.others:
            return []
        if len(self.others) > 1:
            if stated:
                return []
            message = f"{len(self.others)} columns beside the power: {_names(self.header, self.others)}"
            expected = "the parameters of the computations by name, as in --of fps,keysize; or --config for a trace"
            raise InputError(self.header.fault(self.others[0], message, expected))
        return self.others


def as_tables(
    texts: Sequence[Text], columns: PowerColumns, configurations: Sequence[Configuration]
) -> tuple[list[Text], list[Fault]]:
    """Texts as tables of measurements: recordings and traces among them are made such; and what is to be known of them.

    Parameters
    ----------
    texts : sequence of Text
    columns : PowerColumns
        Which columns are read.
    configurations : sequence of Configuration
        Those of the traces among the texts, in their order.

    Raises
    ------
    InputError
        Where the power or the parameters of a text are not known, or the configurations are not those of the traces.
    """
    found = [read_recording(text, columns.power, columns.parameters) for text in texts]
    stated = bool(configurations)
    places = [None if each is None else each.parameters(columns.parameters, stated=stated) for each in found]
    traces = [i for i, own in enumerate(places) if own == []]
    if configurations and len(configurations) != len(traces):
        message = f"{len(configurations)} configurations for {len(traces)} files without columns for them"
        raise InputError.at("--config", 1, 1, message, "one for each such file, in order")
    if columns.trim and not traces:
        message = "no file is a trace"
        raise InputError.at("--trim", 1, 1, message, "a trace of power over time", str(columns.trim))
    at = dict(zip(traces, configurations, strict=False))
    tables, notes = list(texts), list[Fault]()
    for i, (each, own) in enumerate(zip(found, places, strict=True)):
        if each is not None and own is not None:
            tables[i] = each.measurements(own, at.get(i), columns.trim if i in traces else 0)
            notes += each.notes()
    return tables, notes


def read_recording(text: Text, asked: Sequence[str] = (), of: Sequence[str] = ()) -> Recording | None:
    """A recording of a computer's power, or a table whose power is asked for; None for another text.

    Parameters
    ----------
    text : Text
    asked : sequence of str
        Columns of power, added, with a unit where theirs is not written: `VDD_IN`, `PWR_AVG [W]`.
    of : sequence of str
        Columns of the parameters, of a table.

    Raises
    ------
    InputError
        Where columns look like a power and it is not known which make that of the board, or in which unit.
    """
    table = _as_table(text)
    rows = read_rows(table.name, table.body)
    top = list(islice(rows, 2))
    if not top:
        return None
    header = top[0]
    if all(NUMBER.match(name) for name in header.fields):
        return _without_names(table, header, [*top[1:], *rows], asked)
    behind = _units_behind_numbers(top)
    kinds = _Kinds.of(header)
    is_plain_text = table is text and not behind
    if not asked and not of and is_plain_text and kinds.are_measurements(header):
        return None
    power = _power_of(header, kinds, asked)
    if power is None:
        return None
    rest = [*top[1:], *rows]
    if behind:
        for row in rest:
            row.fields = [match[1] if (match := _WITH_UNIT.match(cell)) else cell for cell in row.fields]
    timed = next((i for i, name in enumerate(header.fields) if _TIME.match(name)), None)
    others = [] if _is_of_a_program(header, kinds, power.device) else _parameter_like(header, power.parts, timed)
    return Recording(table, header, rest, power.parts, power.product, others, timed is not None, power.device)


def _without_names(table: Text, header: Row, rows: list[Row], asked: Sequence[str]) -> Recording | None:
    """A trace whose first row has numbers: powers under the flag 100; None for another such table."""
    if asked:
        raise InputError.at("--power", 1, 1, "the columns have no names", "a table with a header", asked[0])
    flags = header.fields
    if not has_flags(flags) or "100" not in flags or any(name.startswith("2") for name in flags):
        return None
    power = PowerColumn(flags.index("100"), "power", 1.0)
    return Recording(table, header, rows, [power], False, [], False, None)


class _Kinds(NamedTuple):
    """Places of the columns by what their names say: a power, a voltage, a current, a power of hwmon."""

    plain: list[int]
    volts: list[int]
    amperes: list[int]
    microwatts: list[int]

    @classmethod
    def of(cls, header: Row) -> _Kinds:
        """Those of a header."""
        names = list(enumerate(header.fields))
        plain = [i for i, name in names if read_heading(name).per_watt or _WATTS.match(name)]
        return cls(plain, *([i for i, name in names if each.match(name)] for each in (_VOLTS, _AMPERES, _MICROWATTS)))

    @property
    def has_factors(self) -> bool:
        """Whether a power can be a product."""
        return bool(self.volts and self.amperes)

    def are_measurements(self, header: Row) -> bool:
        """Whether a power is beside parameters, and nothing else that could be one: a table of measurements."""
        names = header.fields
        sure = bool(self.plain) and not any(_WATTS.match(names[i]) for i in self.plain)
        return sure and not self.has_factors and not any(map(_is_rail, names)) and any(map(is_parameter, names))


class _Power(NamedTuple):
    """What makes the power: `parts` added, or multiplied; and the device whose rails they are, if it is known."""

    parts: list[PowerColumn]
    product: bool = False
    device: Device | None = None


def _power_of(header: Row, kinds: _Kinds, asked: Sequence[str]) -> _Power | None:
    """What is asked for, else what is surest; None where nothing looks like a power."""
    if asked:
        return _Power(_asked(header, asked))
    if kinds.plain:
        return _Power([_plain(header, kinds.plain)])
    device, parts = _of_device(header)
    if parts:
        return _Power(parts, device=device)
    if len(kinds.microwatts) == 1:
        return _Power([_with_unit(header, kinds.microwatts[0], "")])
    if len(kinds.volts) == len(kinds.amperes) == 1:
        return _Power([_factor(header, kinds.volts[0]), _factor(header, kinds.amperes[0])], product=True)
    _ask(header)
    return None


def _is_of_a_program(header: Row, kinds: _Kinds, device: Device | None) -> bool:
    """Whether a program wrote the columns beside the power, so that none is a parameter."""
    is_jtop = bool(_JTOP & set(map(str.lower, header.fields)))
    is_turbostat = any(map(_JOINED_UNIT.search, header.fields))
    return kinds.has_factors or is_jtop or is_turbostat or (device is not None and device.name == "nvidia-smi")


def _parameter_like(header: Row, parts: Sequence[PowerColumn], timed: int | None) -> list[int]:
    """Places of the columns that are neither power nor time, and have a name."""
    used = {part.place for part in parts} | {timed}
    names = enumerate(header.fields)
    return [i for i, name in names if i not in used and is_parameter(name) and not _is_power(name)]


# ── columns ──


class _Rail(NamedTuple):
    """The rail that a column is of, in capitals, its unit or "", and whether it is surely one of power."""

    name: str
    unit: str
    sure: bool

    @property
    def has_usual_unit(self) -> bool:
        """Whether it is one of power by its name alone, so that its unit is known without being written."""
        return bool(_RAIL.match(self.name) or self.name.startswith(_DRAWN))


def _rail(heading: str) -> _Rail:
    """The rail of a column: `Power VDD_IN`, `POM_5V_IN (mW)`."""
    if _JOINED_UNIT.search(heading):
        return _Rail(_JOINED_UNIT.sub("", heading).upper(), "w", True)
    found = _HEADING.match(heading)
    if not found:
        return _Rail(heading.upper(), "", False)
    name, unit = found["rail"].strip().upper(), (found["unit"] or "").lower()
    return _Rail(name, unit, bool(unit or found["power"] or _RAIL.match(name) or name.startswith(_DRAWN)))


def _usual_unit(rail: str) -> str:
    """The unit of a rail that has none in its name: nvidia-smi writes watts, and tegrastats and jtop milliwatts."""
    return "w" if rail.startswith(_DRAWN) else "mw"


def _is_rail(name: str) -> bool:
    rail, _, sure = _rail(name)
    return sure and bool(_RAIL.match(rail) or any(re.fullmatch(p, rail) for each in DEVICES for p in each.rails))


def _is_power(name: str) -> bool:
    return bool(_is_rail(name) or _LIKE_POWER.search(name) or read_heading(name).per_watt)


def _of_device(header: Row) -> tuple[Device | None, list[PowerColumn]]:
    """The first device that has all its rails here, and the columns that make its power."""
    rails: dict[str, PowerColumn] = {}
    sure: dict[str, bool] = {}
    for i, name in enumerate(header.fields):
        rail, unit, certain = _rail(name)
        mean = re.search(r"(?i)(?:avg|mean|average)", name)
        if rail not in rails or (certain and not sure[rail]) or (certain and not mean):
            rails[rail] = PowerColumn(i, name, _PER_WATT[unit or _usual_unit(rail)], not unit)
            sure[rail] = certain
    everywhere = {"GPU", "CPU", "SOC", "CV", "VDDRQ", "SYS5V"} <= rails.keys()
    known = {rail: column for rail, column in rails.items() if sure[rail] or everywhere}
    if "VDD_IN" in known and "VDD_MUX" in known:
        return None, []
    for device in DEVICES:
        found = [[column for rail, column in known.items() if re.fullmatch(p, rail)] for p in device.rails]
        if all(found):
            more = [column for rail, column in known.items() if device.also and re.fullmatch(device.also, rail)]
            first = [columns if device.name == "RAPL" else columns[:1] for columns in found]
            return device, [*(column for columns in first for column in columns), *more]
    return None, []


def _asked(header: Row, asked: Sequence[str]) -> list[PowerColumn]:
    """The columns asked for by name, with a unit where it is stated."""
    parts = []
    for raw in asked:
        stated = None if raw in header.fields else _STATED_UNIT.match(raw)
        name, unit = (stated[1], stated[2].lower()) if stated else (raw, "")
        places = _places(name, header)
        if len(places) != 1:
            message = f"{'several columns' if places else 'no column'} {printable(name, 80)}"
            expected = "columns with names of their own" if places else f"one of {_names(header)}"
            raise InputError.at("--power", 1, 1, message, expected, raw)
        written = _written_per_watt(header.fields[places[0]])
        if stated and (stated[2] == "MW" or written not in (None, _PER_WATT[unit])):
            message = f"{stated[2]} is not the unit of the column {printable(header.fields[places[0]], 80)}"
            raise InputError.at("--power", 1, 1, message, "the unit that it has", raw)
        parts.append(_with_unit(header, places[0], unit))
    if twice := repeated([part.name for part in parts]):
        raise InputError.at("--power", 1, 1, f"{parts[twice[0]].name} stands twice", "each once", asked[twice[0]])
    return parts


def _places(name: str, header: Row) -> list[int]:
    """Places of the columns of a name; where none has it, of those of a rail of that name."""
    exact = [i for i, field in enumerate(header.fields) if field == name]
    return exact or [i for i, field in enumerate(header.fields) if _rail(field).name == name.upper()]


def _with_unit(header: Row, place: int, unit: str) -> PowerColumn:
    """A column with its unit: stated, else that in its name, else that of its kind, which is assumed."""
    name = header.fields[place]
    if unit:
        return PowerColumn(place, name, _PER_WATT[unit])
    if _MICROWATTS.match(name):
        return PowerColumn(place, name, 1e6, assumed=True)
    if (per_watt := _written_per_watt(name)) is not None:
        return PowerColumn(place, name, per_watt)
    rail = _rail(name)
    if rail.has_usual_unit or name.lower().startswith("power "):
        return PowerColumn(place, name, _PER_WATT[_usual_unit(rail.name)], assumed=True)
    message = f"{printable(name, 80)} has no unit of power"
    raise InputError(header.fault(place, message, f"--power '{name} [W]', or '{name} [mW]'"))


def _written_per_watt(name: str) -> float | None:
    """How many of the unit that a column's name has make a watt; None where it has none."""
    if _WATTS.match(name):
        return 1.0
    heading = read_heading(name)
    if heading.per_watt and heading.unit:
        return heading.per_watt
    unit = _rail(name).unit
    return _PER_WATT[unit] if unit else None


def _plain(header: Row, places: Sequence[int]) -> PowerColumn:
    """The column that is called power; raises InputError where several are, or it has no unit."""
    first = [i for i in places if header.fields[i].lower().startswith("power")] or list(places)
    if len(first) > 1:
        several = ", ".join(header.fields[i] for i in first)
        raise InputError(header.fault(first[1], f"several columns of power: {several}", "--power NAME"))
    return _with_unit(header, first[0], "")


def _factor(header: Row, place: int) -> PowerColumn:
    name = header.fields[place]
    found = _VOLTS.match(name) or _AMPERES.match(name)
    unit = (found[1] if found else "") or "mv"  # of hwmon: mV and mA
    return PowerColumn(place, name, _PER[unit.lower()])


def _ask(header: Row) -> None:
    """Ask which columns make the power, where some look like it."""
    like = [i for i, name in enumerate(header.fields) if _is_power(name)]
    if not like:
        if header.fields == ["time_s"]:
            raise InputError.at(header.file, 1, 1, "is a log of tegrastats without a power", "a log with its rails")
        return
    first = header.fields[like[0]]
    unit = "" if _rail(first).unit or _is_rail(first) or _MICROWATTS.match(first) else " [W]"
    message = f"which column is the power of the computer? These may be: {_names(header, like)}"
    expected = f"--power '{first}{unit}'; more than one --power are added"
    raise InputError(header.fault(like[0], message, expected))


def _names(header: Row, places: Sequence[int] | None = None) -> str:
    chosen = range(len(header.fields)) if places is None else places
    return ", ".join(printable(header.fields[i], 40) for i in list(chosen)[:20] if header.fields[i])


# ── texts ──


def _units_behind_numbers(top: Sequence[Row]) -> bool:
    """Whether numbers have units behind them, as nvidia-smi writes them; these become those of the names."""
    if len(top) < 2 or not any(map(_WITH_UNIT.match, top[1].fields)):
        return False
    names = top[0].fields
    for i, cell in enumerate(top[1].fields[: len(names)]):
        if (found := _WITH_UNIT.match(cell)) and found[2] != "%" and not re.search(r"[\[(]", names[i]):
            names[i] = f"{names[i]} [{found[2].replace('µ', 'u')}]"
    return True


def _as_table(text: Text) -> Text:
    """A log of tegrastats as a table, line by line; another text as it is."""
    if _TEGRASTATS.search(next((line for line in text.body.splitlines() if line.strip()), "")):
        return _tegrastats(text)
    return text


def _tegrastats(text: Text) -> Text:
    """A row for each line: the time, spread where lines share a second, and the rails."""
    lines = text.body.splitlines()
    found = [dict(_TEGRASTATS_RAIL.findall(line)) for line in lines]
    names = list(dict.fromkeys(name for rails in found for name in rails))
    stamps = [match[1] if (match := _TEGRASTATS_TIME.match(line)) else "" for line in lines]
    known = [datetime.strptime(each, "%m-%d-%Y %H:%M:%S") for each in stamps if each]
    times_s: list[float] = [float(i) for i in range(len(lines))]  # it writes a line a second unless asked
    if len(known) == len(lines) > 1:
        times_s = [(each - known[0]).total_seconds() for each in known]
        if len(set(times_s)) < len(times_s):
            times_s = [times_s[-1] * i / (len(times_s) - 1) for i in range(len(times_s))]
    rows = [
        ",".join([f"{time_s:.10g}", *(rails.get(name, "") for name in names)]) if rails or not names else ""
        for time_s, rails in zip(times_s, found, strict=True)
    ]
    # the header is in the first line, before its reading
    return Text(text.name, "\n".join([",".join(["time_s", *(f"{name} [mW]" for name in names)]), *rows, ""]))


def _quoted(cell: str) -> str:
    return f'"{cell}"' if re.search(r"[,;\t]", cell) else cell
