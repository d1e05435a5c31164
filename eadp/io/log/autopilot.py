"""Autopilots' logs as tables of numbers: PX4 ULog, ArduPilot DataFlash, binary and as text.

Only what is asked for is read: a log of an hour holds millions of messages of other kinds. A file that ends in the
middle of a message, as after a crash, is read up to there; what is no message is skipped. Both are counted.

Source: PX4 user guide, "ULog File Format"; ArduPilot, libraries/AP_Logger/LogStructure.h.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import InputError, printable

ULOG_MAGIC = b"ULog\x01\x12"
DATAFLASH_MAGIC = b"\xa3\x95"
LIMIT_FIELDS = 10_000
LIMIT_MESSAGE = 65_535
"""Bytes of the longest message."""
LIMIT_BYTES = 2_000_000_000
"""Largest log read."""

_ULOG_TYPES = {
    "int8_t": "<i1",
    "uint8_t": "<u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "<u1",
    "char": "<u1",
}
# a letter of a DataFlash format: the type, and how many of its units make one of the value's
_DATAFLASH_TYPES: dict[str, tuple[str, float]] = {
    "a": ("V64", 0),
    "b": ("<i1", 1),
    "B": ("<u1", 1),
    "h": ("<i2", 1),
    "H": ("<u2", 1),
    "i": ("<i4", 1),
    "I": ("<u4", 1),
    "f": ("<f4", 1),
    "g": ("<f2", 1),
    "d": ("<f8", 1),
    "n": ("V4", 0),
    "N": ("V16", 0),
    "Z": ("V64", 0),
    "c": ("<i2", 100),
    "C": ("<u2", 100),
    "e": ("<i4", 100),
    "E": ("<u4", 100),
    "L": ("<i4", 1e7),
    "M": ("<u1", 1),
    "q": ("<i8", 1),
    "Q": ("<u8", 1),
}
_ULOG_FIELD = re.compile(r"([\w/]+?)(?:\[(\d+)\])? (\w+)\Z")


@dataclass
class Tables:
    """Messages by kind: columns by name, one row for each message.

    Attributes
    ----------
    columns : dict of str to dict of str to array, shape (n,)
        Kinds are named as in the log; of a ULog, `battery_status 0`, with the instance.
    skipped_bytes : int
        How much of the file was no message.
    cut : bool
        Whether the file ends in the middle of a message.
    """

    columns: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    skipped_bytes: int = 0
    cut: bool = False


def read_ulog(name: str, data: bytes, kinds: Collection[str]) -> Tables:
    """Messages of a PX4 ULog.

    Parameters
    ----------
    name : str
        The file, for messages.
    data : bytes
        All of it.
    kinds : collection of str
        Topics to read, as `battery_status`.

    Returns
    -------
    Tables

    Raises
    ------
    InputError
        If it is no ULog.
    """
    if not data.startswith(ULOG_MAGIC[:4]) or len(data) < 16:
        raise InputError.at(name, 1, 1, "is no PX4 ULog", "a file that starts with ULog")
    tables = Tables()
    formats: dict[str, str] = {}
    topics: dict[int, str] = {}
    found: dict[int, list[bytes]] = {}
    for kind, body in _ulog_messages(data, tables):
        if kind == b"F":
            topic, _, fields = body.decode("ascii", "replace").partition(":")
            formats[topic] = fields
        elif kind == b"A" and len(body) > 3:
            topic = body[3:].decode("ascii", "replace")
            if topic in kinds:
                number = int.from_bytes(body[1:3], "little")
                topics[number], found[number] = f"{topic} {body[0]}", []
        elif kind == b"D" and (rows := found.get(int.from_bytes(body[:2], "little"))) is not None:
            rows.append(body[2:])
    for number, topic in topics.items():
        dtype = _ulog_dtype(name, topic.split(" ")[0], formats)
        tables.columns[topic] = _columns(found[number], dtype, {})
    return tables


def _ulog_messages(data: bytes, tables: Tables) -> Iterator[tuple[bytes, bytes]]:
    place = 16
    wanted = b"FAD"
    while place + 3 <= len(data):
        size = data[place] | data[place + 1] << 8
        kind, start = data[place + 2], place + 3
        place = start + size
        if place > len(data):
            break
        if kind in wanted:
            yield bytes((kind,)), data[start:place]
    tables.cut = place != len(data)


def _ulog_dtype(name: str, topic: str, formats: dict[str, str]) -> np.dtype[np.void]:
    """The layout of a topic: plain fields under their names, arrays and nested topics as bytes."""
    layout: list[tuple[str, str]] = []
    for raw in filter(None, formats.get(topic, "").split(";")):
        match = _ULOG_FIELD.match(raw)
        if match is None or len(layout) > LIMIT_FIELDS:
            raise InputError.at(name, 1, 1, f"the format of {printable(topic, 60)} cannot be read", "a PX4 ULog")
        kind, count, label = match[1], match[2], match[3]
        if count is None and kind in _ULOG_TYPES:
            layout.append((label, _ULOG_TYPES[kind]))
        else:
            layout.append((label, f"V{min(int(count or 1) * _ulog_size(name, kind, formats), LIMIT_MESSAGE + 1)}"))
    return _dtype(name, topic, layout)


def _dtype(name: str, kind: str, layout: list[tuple[str, str]]) -> np.dtype[np.void]:
    """The layout of a message, checked."""
    labels = {label for label, _ in layout}
    widths = [int(code[1:]) if code[0] == "V" else 8 for _, code in layout]
    if not layout or len(labels) < len(layout) or "" in labels or sum(widths) > LIMIT_MESSAGE:
        raise InputError.at(name, 1, 1, f"the format of {printable(kind, 60)} cannot be read", "fields with names")
    return np.dtype(layout)


def _ulog_size(name: str, kind: str, formats: dict[str, str], depth: int = 0) -> int:
    if kind in _ULOG_TYPES:
        return np.dtype(_ULOG_TYPES[kind]).itemsize
    if kind not in formats or depth > 10:
        raise InputError.at(name, 1, 1, f"the type {printable(kind, 60)} is not described", "a PX4 ULog")
    total = 0
    for raw in filter(None, formats[kind].split(";")):
        match = _ULOG_FIELD.match(raw)
        if match is not None:
            total += int(match[2] or 1) * _ulog_size(name, match[1], formats, depth + 1)
    return total


def _columns(rows: list[bytes], dtype: np.dtype[np.void], per: dict[str, float]) -> dict[str, FloatArray]:
    """Numbers of the plain fields; rows that are cut off are filled up, as trailing padding is not in the log."""
    size = dtype.itemsize
    table = np.frombuffer(b"".join(row[:size].ljust(size, b"\0") for row in rows), dtype)
    plain = [label for label in dtype.names or () if dtype[label].kind != "V"]
    with np.errstate(invalid="ignore"):  # rubbish may be a signalling NaN
        return {label: table[label].astype(float) / per.get(label, 1.0) for label in plain}


def read_dataflash(name: str, data: bytes, kinds: Collection[str]) -> Tables:
    """Messages of a binary ArduPilot DataFlash log; parameters and errors as `read_ulog`."""
    if not data.startswith(DATAFLASH_MAGIC):
        raise InputError.at(name, 1, 1, "is no DataFlash log", "a file that starts with bytes A3 95")
    tables = Tables()
    lengths = {0x80: 89}
    wanted: dict[int, tuple[str, str, list[str]]] = {}
    found: dict[int, list[bytes]] = {}
    place = 0
    while place + 3 <= len(data):
        kind = data[place + 2]
        length = lengths.get(kind, 0)
        if data[place : place + 2] != DATAFLASH_MAGIC or not length:
            after = data.find(DATAFLASH_MAGIC, place + 1)
            after = len(data) if after < 0 else after
            tables.skipped_bytes += after - place
            place = after
            continue
        if place + length > len(data):
            break
        if kind == 0x80:
            number, size, title, form, labels = struct.unpack_from("<BB4s16s64s", data, place + 3)
            lengths[number] = size if size > 3 else 0
            label = _text(title)
            if label in kinds:
                wanted[number], found[number] = (label, _text(form), _text(labels).split(",")), []
        elif kind in found:
            found[kind].append(data[place + 3 : place + length])
        place += length
    tables.cut = place != len(data)
    for number, (label, form, labels) in wanted.items():
        layout = [
            (name_, _DATAFLASH_TYPES[c][0]) for name_, c in zip(labels, form, strict=False) if c in _DATAFLASH_TYPES
        ]
        per = {name_: _DATAFLASH_TYPES[c][1] for name_, c in zip(labels, form, strict=False) if c in _DATAFLASH_TYPES}
        if len(layout) < len(form):
            raise InputError.at(name, 1, 1, f"the format {printable(form, 20)} of {label} cannot be read", "DataFlash")
        tables.columns[label] = _columns(found[number], _dtype(name, label, layout), per)
    return tables


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("ascii", "replace")


def is_dataflash_text(head: str) -> bool:
    """Whether a text is a DataFlash log: it tells the formats of its messages first."""
    return bool(re.match(r"\s*(?:PARM|MSG|FMT)U?, *\d+, *[^,\n]+, *[^,\n]+", head)) and "FMT," in head[:20_000]


def read_dataflash_text(name: str, body: str, kinds: Collection[str]) -> Tables:
    """Messages of a DataFlash log as text; values are as printed, already scaled. Lines that do not fit are skipped."""
    tables = Tables()
    labels: dict[str, list[str]] = {}
    rows: dict[str, list[list[float]]] = {}
    for line in body.split("\n"):
        kind, _, rest = line.partition(",")
        kind = kind.strip()
        if kind == "FMT":
            parts = [part.strip() for part in rest.split(",")]
            if len(parts) >= 5 and parts[2] in kinds:
                labels[parts[2]], rows[parts[2]] = parts[4:], []
        elif kind in labels:
            values = [_number(part) for part in rest.split(",")]
            if len(values) == len(labels[kind]):
                rows[kind].append(values)
            else:
                tables.skipped_bytes += len(line) + 1
    for kind, names in labels.items():
        table = np.array(rows[kind], dtype=float).reshape(len(rows[kind]), len(names))
        tables.columns[kind] = {label: table[:, i] for i, label in enumerate(names)}
    return tables


def _number(raw: str) -> float:
    try:
        return float(raw)
    except ValueError:
        return float("nan")
