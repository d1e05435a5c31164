"""The one door to pyulog, pymavlink and rosbags: a script that reads a log under limits, in a process of its own.

The libraries trust what a file declares of itself: a few hundred bytes can ask for terabytes or hours. Some print as
they read. The system ends the process at its limits of memory and CPU time. Standard output is an `.npz` of columns
named `TOPIC/FIELD`; standard error is the reason why a log cannot be read.

`python autopilot_process.py ulog|dataflash|dataflash-text|bag FILE TOPIC,…`: imports nothing of eadp.
"""

from __future__ import annotations

import contextlib
import os
import sys
from array import array
from functools import cache
from pathlib import Path
from typing import Any

MEMORY_BYTES, MEMORY_PER_BYTE = 400_000_000, 8
"""Address space of the process: a constant, and more for each byte of the file."""
CPU_S, BYTES_PER_S = 10, 500_000
"""CPU time of the process [s], and one more second for so many bytes of the file."""
CAPACITIES = ("BATT_CAPACITY", "BAT1_CAPACITY", "BAT_CAPACITY")
"""Parameters with the capacity of the first battery [mAh]."""
MAX_FIELDS = 10_000
"""Most fields of a topic, nested ones included."""


def main(form: str, path: str, topics: list[str], output: int) -> None:
    """Read a log and write its columns to a file descriptor."""
    size = sum(each.stat().st_size for each in (Path(path), *Path(path).rglob("*")))  # a bag may be a folder
    with contextlib.suppress(ImportError):  # a system without such limits
        import resource

        memory, cpu_s = MEMORY_BYTES + MEMORY_PER_BYTE * size, CPU_S + size // BYTES_PER_S
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))
    import numpy as np

    if form in ("ulog", "bag"):
        columns = (_ulog if form == "ulog" else _bag)(path, topics)
    else:
        columns = _dataflash(form, path, topics)
    with open(output, "wb") as stream:
        np.savez(stream, **columns)


def _ulog(path: str, topics: list[str]) -> dict[str, Any]:
    from pyulog import ULog

    # pyulog lays out every topic field by field, those that are not asked for too
    formats = {name: each.fields for name, each in ULog(path, parse_header_only=True).message_formats.items()}

    @cache
    def fields(kind: str) -> int:
        return sum(max(1, count) * fields(nested) for nested, count, _ in formats[kind]) if kind in formats else 1

    for name in formats:
        if (count := fields(name)) > MAX_FIELDS:
            raise ValueError(f"{name} has {count} fields; at most {MAX_FIELDS} are read")
    log = ULog(path, topics)
    columns = {f"{data.name} {data.multi_id}/{label}": v for data in log.data_list for label, v in data.data.items()}
    stated = [log.initial_parameters[name] for name in CAPACITIES if name in log.initial_parameters]
    columns |= {"parameters/capacity_mah": stated[:1]} if stated else {}
    if log.file_corruption:
        columns["notes"] = ["messages that are damaged left out"]
    return columns


def _dataflash(form: str, path: str, topics: list[str]) -> dict[str, Any]:
    """Tables of ArduPilot's messages, binary or as text; where the fields of a topic change, of its longest part."""
    import numpy as np
    from pymavlink import DFReader

    binary = form == "dataflash"
    log = (DFReader.DFReader_binary if binary else DFReader.DFReader_text)(path, zero_time_base=True)
    parts: dict[str, dict[tuple[str, ...], array[float]]] = {}
    capacities: list[float] = []
    while (message := log.recv_match(type=[*topics, "PARM"], strict=True)) is not None:
        if message.get_type() != "PARM":
            fields = tuple(message.get_fieldnames())
            part = parts.setdefault(message.get_type(), {}).setdefault(fields, array("d"))
            part.extend(_numbers(message, fields))
        elif getattr(message, "Name", "") in CAPACITIES:
            capacities.append(_number(message, "Value"))
    columns: dict[str, Any] = {"parameters/capacity_mah": capacities} if capacities else {}
    for topic, by_fields in parts.items():
        fields, flat = max(by_fields.items(), key=lambda part: len(part[1]))
        table = np.array(flat).reshape(-1, len(fields))
        columns |= {f"{topic}/{field}": table[:, i] for i, field in enumerate(fields)}
    if skipped := _skipped_bytes(log) if binary else 0:
        columns["notes"] = [f"{skipped} bytes that are no message skipped"]
    return columns


def _skipped_bytes(log: Any) -> int:
    """Bytes of a binary log that are in none of its messages."""
    return int(log.data_len - sum(len(log.offsets[number]) * each.len for number, each in log.formats.items()))


def _bag(path: str, topics: list[str]) -> dict[str, Any]:
    """Batteries of a ROS bag, numbered by their topics' names."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    (battery,) = topics
    # rosbag2 did not store definitions at first
    with AnyReader([Path(path)], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
        kinds = {name: info.msgtype for name, info in sorted(bag.topics.items())}
        names = [f"{name} ({kind})" for name, kind in kinds.items()]
        batteries = [name for name, kind in kinds.items() if kind == battery]
        tables = {name: f"battery_status {i} {name}" for i, name in enumerate(batteries)}
        if not tables:
            return {"notes": names}
        rows: dict[str, dict[str, array[float]]] = {}
        for each, time_ns, raw in bag.messages([each for each in bag.connections if each.topic in tables]):
            message: Any = bag.deserialize(raw, each.msgtype)
            stamp = message.header.stamp
            time_us = (stamp.sec * 1_000_000_000 + stamp.nanosec or time_ns) / 1e3
            # the current is below 0 while it discharges
            row = {"timestamp": time_us, "voltage_v": message.voltage, "current_a": -message.current}
            table = rows.setdefault(tables[each.topic], {name: array("d") for name in row})
            for name, value in row.items():
                table[name].append(value)
    columns: dict[str, Any] = {f"{key}/{name}": value for key, table in rows.items() for name, value in table.items()}
    return columns or {"notes": names}


def _numbers(message: Any, fields: tuple[str, ...]) -> list[float]:
    """The values of fields; volts and amperes that old firmware wrote as whole numbers are in hundredths."""
    letters = dict(zip(message.fmt.columns, message.fmt.format, strict=False))
    return [
        _number(message, field) / (100 if field in ("Volt", "Curr") and letters.get(field) in tuple("bBhHiI") else 1)
        for field in fields
    ]


def _number(message: Any, field: str) -> float:
    try:
        return float(getattr(message, field))
    except (TypeError, ValueError):
        return float("nan")


if __name__ == "__main__":
    output, reason = os.dup(1), os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    try:
        main(sys.argv[1], sys.argv[2], sys.argv[3].split(","), output)
    except Exception as error:
        os.write(reason, f"{type(error).__name__}: {error}".encode(errors="replace"))
        sys.exit(1)
