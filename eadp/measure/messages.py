"""Messages of autopilots' logs as tables of numbers: only the topics asked for, read by `autopilot_process`."""

from __future__ import annotations

import importlib.util
import io
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import InputError, printable
from eadp.live.mavlink import MARKS, TLOG_HEAD, tlog_messages

LIMIT_BYTES = 2_000_000_000
"""Largest log of an autopilot."""
_PROCESS = Path(__file__).with_name("autopilot_process.py")


@dataclass
class Tables:
    """Messages by topic: columns by name, one row for each message.

    Attributes
    ----------
    columns : dict of str to dict of str to array, shape (n,)
        Topics are named as in the log; of a ULog, `battery_status 0`, with the instance.
    notes : list of str
        What was left out of the log.
    """

    columns: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def read_tables(name: str, path: str, form: str, topics: Sequence[str]) -> Tables:
    """Messages of a log.

    Parameters
    ----------
    name, path : str
        The file, for messages; and where it is.
    form : str
        `ulog`, `dataflash` or `dataflash-text`.
    topics : sequence of str
        Topics to read.

    Raises
    ------
    InputError
        If the library that reads the format is not installed, or the log is too large, cannot be read, or takes more
        memory or time than a log of its size.
    """
    library, title = ("pyulog", "a PX4 ULog") if form == "ulog" else ("pymavlink", "an ArduPilot DataFlash log")
    check_readable(name, path, library, title)
    command = [sys.executable, "-P", str(_PROCESS), form, path, ",".join(topics)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode:
        ended = done.stderr.decode(errors="replace") or "takes more memory or time than a log of its size"
        raise InputError.at(name, 1, 1, f"cannot be read by {library}: {printable(ended)}", title)
    tables = Tables()
    # rubbish may be a signalling NaN
    with np.load(io.BytesIO(done.stdout)) as columns, np.errstate(invalid="ignore"):
        for key, values in columns.items():
            topic, _, label = key.partition("/")
            if label:
                tables.columns.setdefault(topic, {})[label] = values.astype(float)
            else:
                tables.notes += [str(note) for note in values]
    return tables


def check_readable(name: str, path: str, library: str, title: str) -> None:
    """Refuse a log whose library is not installed, or that is too large; raises InputError."""
    if importlib.util.find_spec(library) is None:
        raise InputError.at(name, 1, 1, f"{library}, which reads {title}, is missing", "pip install 'eadp[logs]'")
    if os.path.getsize(path) > LIMIT_BYTES:
        raise InputError.at(name, 1, 1, "is too large", f"at most {LIMIT_BYTES} bytes")


def at_times(known_us: FloatArray, values: FloatArray, time_us: FloatArray) -> FloatArray:
    """Values [shape (n,)] at other times [µs]: linear in between, NaN before the first and after the last."""
    order = np.argsort(known_us, kind="stable")
    result: FloatArray = np.interp(time_us, known_us[order], values[order], left=np.nan, right=np.nan)
    return result


_CLOCKS = ("ATTITUDE", "GLOBAL_POSITION_INT", "SYSTEM_TIME")
"""Messages with the autopilot's time, which those of the battery do not have."""
_WANTED = frozenset((*_CLOCKS, "SYS_STATUS", "BATTERY_STATUS", "VFR_HUD"))


def is_tlog(head: bytes) -> bool:
    """Whether a file that starts so is one: a time of this century in microseconds, then a frame of MAVLink."""
    return len(head) > TLOG_HEAD and head[0] == 0 and 3 <= head[1] <= 8 and head[TLOG_HEAD] in MARKS


def tlog_tables(path: str) -> Tables:
    """The messages of a telemetry log by the topics and names that autopilots' logs have; raises InputError."""
    check_readable(path, path, "pymavlink", "a telemetry log")
    rows: dict[str, list[dict[str, float]]] = {}
    time_us, system = math.nan, None
    for message in tlog_messages(Path(path).read_bytes(), _WANTED):
        fields = message.fields
        if message.kind == "SYS_STATUS" and system is None:
            system = message.system  # that of the first vehicle with a battery
        if system not in (None, message.system):
            continue
        if message.kind in _CLOCKS:
            time_us = fields["time_boot_ms"] * 1e3
        for topic, row in _rows(message.kind, fields) if math.isfinite(time_us) else ():
            rows.setdefault(topic, []).append({"timestamp": time_us, "TimeUS": time_us, **row})
    columns = {
        topic: {name: np.array([row[name] for row in found]) for name in found[0]} for topic, found in rows.items()
    }
    return Tables(columns)


def _rows(kind: str, fields: Any) -> Iterator[tuple[str, dict[str, float]]]:
    """What a message says, as rows of topics of autopilots' logs; −1 and 0 are unknown there, too."""
    if kind == "SYS_STATUS":
        amps = fields["current_battery"]
        volts = fields["voltage_battery"] % 65535  # 65535 is unknown
        yield "battery_status 0", {"voltage_v": volts / 1e3, "current_a": -1.0 if amps < 0 else amps / 100}
    elif kind == "BATTERY_STATUS" and fields["id"] > 0:
        volts, amps = sum(cell for cell in fields["voltages"] if cell != 65535), fields["current_battery"]
        row = {"voltage_v": volts / 1e3, "current_a": -1.0 if amps < 0 else amps / 100}
        yield f"battery_status {fields['id']}", row
    elif kind == "VFR_HUD":
        yield "VFR_HUD", {"airspeed": fields["airspeed"]}
        yield "BARO", {"CRt": fields["climb"]}
    elif kind == "ATTITUDE":
        yield "ATT", {"Roll": math.degrees(fields["roll"])}
    elif kind == "GLOBAL_POSITION_INT" and (fields["lat"] or fields["lon"]):
        yield "POS", {"Lat": fields["lat"] / 1e7, "Lng": fields["lon"] / 1e7, "Alt": fields["alt"] / 1e3}
