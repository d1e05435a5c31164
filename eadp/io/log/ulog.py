"""The PX4 ULog format.

Source: PX4 user guide, "ULog File Format".
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator

import numpy as np

from eadp.errors import InputError, printable
from eadp.io.log.messages import LIMIT_MESSAGE, Tables, message_columns, message_dtype

ULOG_MAGIC = b"ULog"
KINDS = ("battery_status", "vehicle_local_position")
LIMIT_FIELDS = 10_000

_TYPES = {
    **{f"{sign}int{8 * size}_t": f"<{code}{size}" for sign, code in (("", "i"), ("u", "u")) for size in (1, 2, 4, 8)},
    "float": "<f4",
    "double": "<f8",
    "bool": "<u1",
    "char": "<u1",
}
_FIELD = re.compile(r"([\w/]+?)(?:\[(\d+)\])? (\w+)\Z")


def is_ulog(head: bytes) -> bool:
    """Whether a file is a ULog, by its first bytes."""
    return head.startswith(ULOG_MAGIC)


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
    if not is_ulog(data) or len(data) < 16:
        raise InputError.at(name, 1, 1, "is no PX4 ULog", "a file that starts with ULog")
    tables = Tables()
    formats: dict[str, str] = {}
    topics: dict[int, str] = {}
    found: dict[int, list[bytes]] = {}
    for kind, body in _messages(data, tables):
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
        dtype = _topic_dtype(name, topic.split(" ")[0], formats)
        tables.columns[topic] = message_columns(found[number], dtype, {})
    return tables


def _messages(data: bytes, tables: Tables) -> Iterator[tuple[bytes, bytes]]:
    """The messages of formats, subscriptions and data: kind and body."""
    offset = 16
    while offset + 3 <= len(data):
        size = data[offset] | data[offset + 1] << 8
        kind, start = data[offset + 2], offset + 3
        offset = start + size
        if offset > len(data):
            break
        if kind in b"FAD":
            yield bytes((kind,)), data[start:offset]
    tables.cut = offset != len(data)


def _topic_dtype(name: str, topic: str, formats: dict[str, str]) -> np.dtype[np.void]:
    """The layout of a topic: plain fields under their names, arrays and nested topics as bytes."""
    layout: list[tuple[str, str]] = []
    for raw in filter(None, formats.get(topic, "").split(";")):
        match = _FIELD.match(raw)
        if match is None or len(layout) > LIMIT_FIELDS:
            raise InputError.at(name, 1, 1, f"the format of {printable(topic, 60)} cannot be read", "a PX4 ULog")
        kind, count, label = match[1], match[2], match[3]
        if count is None and kind in _TYPES:
            layout.append((label, _TYPES[kind]))
        else:
            layout.append((label, f"V{min(int(count or 1) * _type_size(name, kind, formats), LIMIT_MESSAGE + 1)}"))
    return message_dtype(name, topic, layout)


def _type_size(name: str, kind: str, formats: dict[str, str], depth: int = 0) -> int:
    if kind in _TYPES:
        return np.dtype(_TYPES[kind]).itemsize
    if kind not in formats or depth > 10:
        raise InputError.at(name, 1, 1, f"the type {printable(kind, 60)} is not described", "a PX4 ULog")
    total = 0
    for raw in filter(None, formats[kind].split(";")):
        match = _FIELD.match(raw)
        if match is not None:
            total += int(match[2] or 1) * _type_size(name, match[1], formats, depth + 1)
    return total
