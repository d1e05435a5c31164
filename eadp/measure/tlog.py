"""Telemetry logs of ground stations, by the topics and names that autopilots' logs have."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from eadp.io.logs.tables import Tables, check_readable
from eadp.plug_ins import plug_in

_CLOCKS = ("ATTITUDE", "GLOBAL_POSITION_INT", "SYSTEM_TIME")
"""Messages with the autopilot's time, which those of the battery do not have."""
_WANTED = frozenset((*_CLOCKS, "SYS_STATUS", "BATTERY_STATUS", "VFR_HUD"))


def tlog_tables(path: str) -> Tables:
    """The messages of a telemetry log by the topics and names that autopilots' logs have; raises InputError."""
    check_readable(path, path, "pymavlink", "a telemetry log")
    rows: dict[str, list[dict[str, float]]] = {}
    time_us, system = math.nan, None
    for message in plug_in("message_readers", "tlog")(Path(path).read_bytes(), _WANTED):
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
