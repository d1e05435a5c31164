"""The ArduPilot DataFlash format, binary and as text.

Source: ArduPilot, libraries/AP_Logger/LogStructure.h.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Collection

import numpy as np

from eadp.errors import InputError, printable
from eadp.io.log.messages import Tables, message_columns, message_dtype

DATAFLASH_MAGIC = b"\xa3\x95"
KINDS = ("BAT", "BAT2", "CURR", "CUR2", "POS", "GPS")

# a letter of a DataFlash format: the type, and how many of its units make one of the value's
_TYPES: dict[str, tuple[str, float]] = {
    **{letter: (f"<{letter}", 1) for letter in "bBhHiIfdqQ"},  # as numpy's
    "a": ("V64", 0),
    "g": ("<f2", 1),
    "n": ("V4", 0),
    "N": ("V16", 0),
    "Z": ("V64", 0),
    "c": ("<i2", 100),
    "C": ("<u2", 100),
    "e": ("<i4", 100),
    "E": ("<u4", 100),
    "L": ("<i4", 1e7),
    "M": ("<u1", 1),
}


def is_dataflash(head: bytes) -> bool:
    """Whether a file is a binary DataFlash log, by its first bytes."""
    return head.startswith(DATAFLASH_MAGIC)


def read_dataflash(name: str, data: bytes, kinds: Collection[str]) -> Tables:
    """Messages of a binary ArduPilot DataFlash log; parameters and errors as `read_ulog`."""
    if not is_dataflash(data):
        raise InputError.at(name, 1, 1, "is no DataFlash log", "a file that starts with bytes A3 95")
    tables = Tables()
    lengths = {0x80: 89}
    wanted: dict[int, tuple[str, str, list[str]]] = {}
    found: dict[int, list[bytes]] = {}
    offset = 0
    while offset + 3 <= len(data):
        kind = data[offset + 2]
        length = lengths.get(kind, 0)
        if data[offset : offset + 2] != DATAFLASH_MAGIC or not length:
            after = data.find(DATAFLASH_MAGIC, offset + 1)
            after = len(data) if after < 0 else after
            tables.skipped_bytes += after - offset
            offset = after
            continue
        if offset + length > len(data):
            break
        if kind == 0x80:
            number, size, title, form, labels = struct.unpack_from("<BB4s16s64s", data, offset + 3)
            lengths[number] = size if size > 3 else 0
            label = _text(title)
            if label in kinds:
                wanted[number], found[number] = (label, _text(form), _text(labels).split(",")), []
        elif kind in found:
            found[kind].append(data[offset + 3 : offset + length])
        offset += length
    tables.cut = offset != len(data)
    for number, (label, form, labels) in wanted.items():
        layout = [(name_, _TYPES[c][0]) for name_, c in zip(labels, form, strict=False) if c in _TYPES]
        per = {name_: _TYPES[c][1] for name_, c in zip(labels, form, strict=False) if c in _TYPES}
        if len(layout) < len(form):
            raise InputError.at(name, 1, 1, f"the format {printable(form, 20)} of {label} cannot be read", "DataFlash")
        tables.columns[label] = message_columns(found[number], message_dtype(name, label, layout), per)
    return tables


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("ascii", "replace")


def is_dataflash_text(head: bytes) -> bool:
    """Whether a text is a DataFlash log, by its first characters: it starts with the formats of its messages."""
    text = head.decode("utf-8-sig", "replace")
    return bool(re.match(r"\s*(?:PARM|MSG|FMT)U?, *\d+, *[^,\n]+, *[^,\n]+", text)) and "FMT," in text


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
