"""Power logs in any format: the battery and the motion in logs of autopilots, and the list of formats."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from eadp.core.arrays import FloatArray
from eadp.core.guidance import SEA_LEVEL_KGPM3, air_density_kgpm3, calibrated_share
from eadp.errors import Fault, InputError, printable
from eadp.io.text.streams import Text, read_text
from eadp.measure.autopilot_logs import Tables, at_times, read_tables
from eadp.measure.power_log import (
    AIRSPEED,
    BANK,
    CLIMB,
    DENSITY,
    LARGEST_W,
    Columns,
    LogReadings,
    PowerLog,
    counted,
    in_order,
    read_csv_log,
    rows_text,
)
from eadp.plug_ins import plug_ins

# names changed from version to version: the first that has readings is taken
_VOLTAGE = ("voltage_v", "voltage_filtered_v", "Volt")
_CURRENT = ("current_a", "current_filtered_a", "Curr")
_TIME_US = ("timestamp", "TimeUS")
_TIME_MS = ("TimeMS",)
ULOG_TOPICS = ("battery_status",)
DATAFLASH_TOPICS = ("BAT", "BAT2", "CURR", "CUR2")
BAG_TOPICS = ("sensor_msgs/msg/BatteryState",)
_USED = ("discharged_mah", "CurrTot")
PARAMETERS, LARGEST_MAH = "parameters", 1e6
"""The topic of the parameters; no battery holds so much."""
_INSTANCE = ("Instance", "Inst", "I")


def battery_log(name: str, tables: Tables, columns: Columns) -> PowerLog:
    """The power log of one battery, voltage times current; raises InputError."""
    _refuse_columns(name, columns)
    table, factors, notes = _battery(name, tables, columns.instance)
    time_us = _time_us(name, table)
    for what, values in zip(("voltage", "current"), factors.T, strict=True):
        if len(values) and not (np.isfinite(values) & (values != 0) & (values != -1)).any():
            message = f"no {what} is measured: it is -1 or 0 throughout"
            raise InputError.at(name, 1, 1, message, "a log of a power module")
    readings = LogReadings(
        name,
        raw=time_us,
        per_second=1e6,
        factors=factors,
        lines=np.ones(len(time_us), dtype=np.int64),
        also=autopilot_motion(tables, time_us) if columns.motion else {},
        warnings=[Fault(name, 1, 1, note, severity="warning") for note in notes],
        counts={"rows": len(time_us)},
    )
    known = _is_known(factors) & (factors[:, 0] > 0) & (np.abs(factors) <= LARGEST_W).all(axis=1)
    if unknown := int(np.count_nonzero(~known)):
        readings.counts["unknown"] = unknown
        readings.warn(1, f"{rows_text(unknown)} with an unknown voltage (0 or -1) or current (-1) left out")
    return replace(in_order(readings.at(known)), battery=_charges(tables, table))


def _refuse_columns(name: str, columns: Columns) -> None:
    """Refuse options that name columns of a CSV."""
    asked = {"--power": ", ".join(columns.power), "--voltage": columns.voltage, "--current": columns.current}
    asked |= {"--time": columns.time, "--time-unit": columns.time_unit or ""}
    for option, given in asked.items():
        if given:
            raise InputError.at(option, 1, 1, "an autopilot's log has no such columns", "none of it", given)
    if columns.also:
        raise InputError.at(name, 1, 1, f"an autopilot's log has no column {columns.also[0]}", "a CSV file")


def _charges(tables: Tables, table: Mapping[str, FloatArray]) -> dict[str, float]:
    """The capacity among the parameters, and the count of the charge that a battery used, see `counted` [Ah]."""
    found = {}
    capacity_mah = tables.columns.get(PARAMETERS, {}).get("capacity_mah")
    if capacity_mah is not None and len(capacity_mah) and capacity_mah[-1] > 0:
        found["capacity_ah"] = float(capacity_mah[-1]) / 1e3
    used_mah = next((table[label] for label in _USED if label in table), None)
    return found if used_mah is None else found | counted(used_mah[(used_mah > 0) & (used_mah < LARGEST_MAH)] / 1e3)


def _battery(name: str, tables: Tables, instance: int | None) -> tuple[dict[str, FloatArray], FloatArray, list[str]]:
    """One battery, by default that with the most readings of a voltage and a current, the first of equals.

    Its columns; its readings, shape (n, 2), as logged: voltage [V] and current [A]; and notes on how it was read.

    Raises
    ------
    InputError
        If there is no battery, none of that instance, or one without voltage or current.
    """
    batteries = dict(_batteries(tables))
    if not batteries:
        raise InputError.at(name, 1, 1, "no messages of a battery", "battery_status, BAT or CURR")
    if instance is not None and instance not in batteries:
        known = ", ".join(map(str, sorted(batteries)))
        raise InputError.at("--instance", 1, 1, f"no battery {instance} in {printable(name)}", known, str(instance))
    fields = {"voltage": _VOLTAGE, "current": _CURRENT}
    found = {
        number: np.stack([_column(name, what, table, names) for what, names in fields.items()], axis=1)
        for number, table in sorted(batteries.items())
        if instance in (None, number)
    }
    number = max(found, key=lambda key: (np.count_nonzero(_is_known(found[key])), -key))
    notes = []
    if instance is None and len(batteries) > 1:
        others = ", ".join(str(other) for other in sorted(batteries) if other != number)
        notes.append(f"battery {number} of several is read; --instance takes another: {others}")
    return batteries[number], found[number], [*notes, *tables.notes]


def _batteries(tables: Tables) -> Iterator[tuple[int, dict[str, FloatArray]]]:
    """Each battery's number and columns."""
    modern = any(kind == "BAT" for kind in tables.columns)
    for kind, table in tables.columns.items():
        if kind.startswith("battery_status "):
            yield int(kind.split(" ")[1]), table
        elif kind in ("BAT", "BAT2") or (kind in ("CURR", "CUR2") and not modern):
            column = next((table[label] for label in _INSTANCE if label in table), None)
            numbers = np.zeros(len(next(iter(table.values()), ())))
            numbers = numbers + (kind[-1] == "2") if column is None else column
            for number in np.unique(numbers[np.isfinite(numbers)]).tolist():
                yield int(number), {label: values[numbers == number] for label, values in table.items()}


def _column(name: str, what: str, table: dict[str, FloatArray], names: tuple[str, ...]) -> FloatArray:
    """The first known field with a reading."""
    there = [table[label] for label in names if label in table]
    if not there:
        raise InputError.at(name, 1, 1, f"the battery has no {what}", " or ".join(names))
    return next((values for values in there if np.any(np.isfinite(values) & (values != 0) & (values != -1))), there[0])


def _is_known(readings: FloatArray) -> NDArray[np.bool_]:
    """Rows whose values are all known: autopilots write −1 for unknown, and 0 for a voltage. 0 A is a motor at rest."""
    known: NDArray[np.bool_] = (np.isfinite(readings) & (readings != -1)).all(axis=1) & (readings[:, 0] != 0)
    return known


def _time_us(name: str, table: dict[str, FloatArray]) -> FloatArray:
    for labels, factor in ((_TIME_US, 1.0), (_TIME_MS, 1e3)):
        for label in labels:
            if label in table:
                return table[label] * factor
    raise InputError.at(name, 1, 1, "messages of the battery have no time", "timestamp, TimeUS or TimeMS")


_TRUE = (("airspeed_validated", "true_airspeed_m_s"), ("airspeed", "true_airspeed_m_s"))
_CALIBRATED = (
    ("airspeed_validated", "calibrated_airspeed_m_s"),
    ("airspeed", "indicated_airspeed_m_s"),
    ("ARSP", "Airspeed"),
    ("CTUN", "As"),
)
_TRUE_OVER_CALIBRATED = (("CTUN", "E2T"),)
_HEIGHTS = (("vehicle_global_position", "alt"), ("POS", "Alt"), ("GPS", "Alt"))
"""Above the sea [m]."""
_CLIMBS = (
    ("vehicle_local_position", "vz", -1.0),
    ("XKF1", "VD", -1.0),
    ("NKF1", "VD", -1.0),
    ("BARO", "CRt", 1.0),
    ("GPS", "VZ", -1.0),
)
"""Topics and fields, the first that a log has is taken; −1 turns down into up."""

_OF_THE_AIR = (*_TRUE, *_CALIBRATED, *_TRUE_OVER_CALIBRATED, *_HEIGHTS)
MOTION_TOPICS = ("vehicle_attitude", "ATT", *dict.fromkeys(topic for topic, *_ in (*_OF_THE_AIR, *_CLIMBS)))


def autopilot_motion(tables: Tables, time_us: FloatArray) -> dict[str, FloatArray]:
    """Columns of the motion that a log has, by their names; NaN before its first message and after its last.

    Parameters
    ----------
    tables : Tables
        Messages of `MOTION_TOPICS`.
    time_us : array, shape (n,)
        Times [µs].
    """
    found = _air(tables, time_us)
    attitude = _table(tables, "vehicle_attitude", "q[3]")
    if attitude:
        w, x, y, z = (attitude[f"q[{i}]"] for i in range(4))
        # roll of a quaternion, body to earth
        found[BANK] = at_times(attitude["time_us"], np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), time_us)
    elif table := _table(tables, "ATT", "Roll"):
        found[BANK] = at_times(table["time_us"], np.radians(table["Roll"]), time_us)
    for topic, label, sign in _CLIMBS:
        if table := _table(tables, topic, label):
            found[CLIMB] = at_times(table["time_us"], sign * table[label], time_us)
            break
    return found


def _air(tables: Tables, time_us: FloatArray) -> dict[str, FloatArray]:
    """True airspeed and density of the air, by which a calibrated airspeed becomes true; without a density it is."""

    def first(fields: tuple[tuple[str, str], ...]) -> FloatArray | None:
        for topic, label in fields:
            table = _table(tables, topic, label)
            if table and (table[label] > 0).any():
                return at_times(table["time_us"], table[label], time_us)
        return None

    true, calibrated, ratio, height_m = map(first, (_TRUE, _CALIBRATED, _TRUE_OVER_CALIBRATED, _HEIGHTS))
    share = None  # calibrated over true
    if ratio is not None:
        share = 1 / np.maximum(ratio, 0.1)
    elif true is not None and calibrated is not None:
        share = np.where(true > 1.0, calibrated / np.maximum(true, 1.0), np.nan)
    elif height_m is not None:
        share = calibrated_share(air_density_kgpm3(height_m))
    if true is None and calibrated is not None:
        true = calibrated if share is None else calibrated / share
    found = {} if true is None else {AIRSPEED: true}
    # ρ = ρ0 (V_c/V)²
    return found if share is None else found | {DENSITY: SEA_LEVEL_KGPM3 * share**2}


def _table(tables: Tables, topic: str, label: str) -> dict[str, FloatArray]:
    """A topic's first instance that has a field; empty if there is none."""
    for name, table in tables.columns.items():
        times = [time for time in ("timestamp", "TimeUS") if time in table]
        if name.split(" ")[0] == topic and label in table and times and len(table[label]) > 1:
            instances = next((table[key] for key in ("C", "I", "Instance") if key in table), None)
            first = slice(None) if instances is None else instances == instances[0]
            return {"time_us": table[times[0]][first]} | {key: values[first] for key, values in table.items()}
    return {}


HEAD = 20_000
"""Bytes from the start of a file by which its format is recognised."""
BAG_INDEX = "metadata.yaml"
BAG_MAGICS = (b"#ROSBAG V2", b"SQLite format 3\0", b"\x89MCAP", b"rosbag2_bagfile_information")
"""The file of a folder that is a bag, and how bags begin: of ROS 1; of ROS 2 either store, and that file."""
_OF_A_PIPE = "UTF-8 text from a pipe; a ULog or a binary DataFlash log as a file"


@dataclass
class LogSource:
    """A log by its path, or as a text; read once, when it is needed."""

    name: str

    @cached_property
    def head(self) -> bytes:
        """The first bytes; those of the text where the file, a pipe, can be read only once. Raises InputError."""
        path = os.path.join(self.name, BAG_INDEX) if os.path.isdir(self.name) else self.name
        if os.path.isfile(path):
            try:
                with open(path, "rb") as stream:
                    return stream.read(HEAD)
            except OSError:
                pass  # reading the text raises it as an InputError
        return self.text.body[:HEAD].encode()

    @cached_property
    def text(self) -> Text:
        """The content as a text. Raises InputError."""
        try:
            return read_text(self.name)
        except InputError as error:
            if os.path.isfile(self.name) or "UTF-8" not in str(error):
                raise
            raise InputError(replace(error.faults[0], expected=_OF_A_PIPE)) from None


@dataclass(frozen=True)
class LogFormat:
    """A format of power logs: its name, whether a file has it, by its first bytes, and its reader."""

    name: str
    recognise: Callable[[bytes], bool]
    read: Callable[[LogSource, Columns], PowerLog]


def is_dataflash_text(head: bytes) -> bool:
    """Whether a text is a DataFlash log, by its first characters: it starts with the formats of its messages."""
    text = head.decode("utf-8-sig", "replace")
    return bool(re.match(r"\s*+(?:PARM|MSG|FMT)U?, *+\d+, *+[^,\n]+, *+[^,\n]", text)) and "FMT," in text


def _autopilot(form: str, topics: Sequence[str], source: LogSource, columns: Columns) -> PowerLog:
    if not os.path.isfile(source.name):
        raise InputError.at(source.text.name, 1, 1, "is not a regular file", _OF_A_PIPE)
    wanted = (*topics, *(MOTION_TOPICS if columns.motion else ()))
    return battery_log(source.name, read_tables(source.name, source.name, form, wanted), columns)


def _dataflash_text(source: LogSource, columns: Columns) -> PowerLog:
    """As `_autopilot`, through a file with line ends of one kind: pymavlink reads no pipe."""
    with tempfile.NamedTemporaryFile("w", encoding="utf-8", suffix=".log") as copy:
        copy.write(source.text.body)
        copy.flush()
        wanted = (*DATAFLASH_TOPICS, *(MOTION_TOPICS if columns.motion else ()))
        tables = read_tables(source.text.name, copy.name, "dataflash-text", wanted)
        return battery_log(source.text.name, tables, columns)


def _bag(source: LogSource, columns: Columns) -> PowerLog:
    if not (os.path.isfile(source.name) or os.path.isdir(source.name)):
        raise InputError.at(source.text.name, 1, 1, "is not a regular file", _OF_A_PIPE)
    tables = read_tables(source.name, source.name, "bag", BAG_TOPICS)
    names = {int(name.split(" ")[1]): name for name in sorted(tables.columns)}
    if not names:
        found = printable(", ".join(tables.notes) or "none", 1000)
        raise InputError.at(source.name, 1, 1, f"has no messages of sensor_msgs/BatteryState; its topics: {found}")
    if len(names) > 1 and columns.instance is None:
        known = ", ".join(f"{number} is {name.split(' ', 2)[2]}" for number, name in names.items())
        what = f"{len(names)} batteries in {printable(source.name)}"
        raise InputError.at("--instance", 1, 1, what, f"one of {known}")
    amps = tables.columns[names.get(columns.instance or 0, names[min(names)])]["current_a"]
    if np.nansum(amps) < 0:  # a driver that does not keep to the message's definition: it flew, and charged nothing
        amps *= -1
        tables.notes = ["the current is above 0 as the battery discharges, against BatteryState's definition"]
    return battery_log(source.name, tables, columns)


FORMATS = (
    LogFormat("PX4 ULog", lambda head: head.startswith(b"ULog"), partial(_autopilot, "ulog", ULOG_TOPICS)),
    LogFormat(
        "ArduPilot DataFlash",
        lambda head: head.startswith(b"\xa3\x95"),
        partial(_autopilot, "dataflash", DATAFLASH_TOPICS),
    ),
    LogFormat("ROS bag", lambda head: head.startswith(BAG_MAGICS), _bag),
    LogFormat("ArduPilot DataFlash as text", is_dataflash_text, _dataflash_text),
    LogFormat("CSV", lambda head: True, lambda source, columns: read_csv_log(source.text, columns)),
)
"""Formats of power logs; the first that recognises a file reads it, and those of other packages if none can."""


def read_power_log(path: str, columns: Columns | None = None) -> PowerLog:
    """Read a power log.

    Parameters
    ----------
    path : str
        A file in one of `FORMATS`; `-` is standard input, for the formats that are text.
    columns : Columns, optional
        The columns to read. Default: those with the names `time_s` or `timestamp` (µs), and `power_w`, or `voltage_v`
        and `current_a`.

    Returns
    -------
    PowerLog

    Raises
    ------
    InputError
        With the faults of the file or of `columns`; and if fewer than `MIN_SAMPLES` readings are left.
    """
    source = LogSource(path)
    chosen = next(each for each in FORMATS if each.recognise(source.head))
    try:
        return chosen.read(source, columns or Columns())
    except InputError:
        if chosen is not FORMATS[-1]:
            raise
        other: LogFormat | None = next((each for each in plug_ins("log_formats") if each.recognise(source.head)), None)
        if other is None:
            raise
    return other.read(source, columns or Columns())
