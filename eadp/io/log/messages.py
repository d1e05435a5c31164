"""Messages of autopilots' logs as tables of numbers.

Only the kinds asked for are read: a log of an hour holds millions of messages of other kinds. A file that ends in the
middle of a message, as after a crash, is read up to there; bytes that are no message are skipped. Both are counted.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import InputError, printable

LIMIT_MESSAGE = 65_535
"""Bytes of the longest message."""


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


def message_dtype(name: str, kind: str, layout: list[tuple[str, str]]) -> np.dtype[np.void]:
    """The layout of a message, checked."""
    labels = {label for label, _ in layout}
    widths = [int(code[1:]) if code[0] == "V" else 8 for _, code in layout]
    if not layout or len(labels) < len(layout) or "" in labels or sum(widths) > LIMIT_MESSAGE:
        raise InputError.at(name, 1, 1, f"the format of {printable(kind, 60)} cannot be read", "fields with names")
    return np.dtype(layout)


def message_columns(rows: list[bytes], dtype: np.dtype[np.void], per: dict[str, float]) -> dict[str, FloatArray]:
    """Numbers of the plain fields; rows that are cut off are filled up, as trailing padding is not in the log."""
    size = dtype.itemsize
    table = np.frombuffer(b"".join(row[:size].ljust(size, b"\0") for row in rows), dtype)
    plain = [label for label in dtype.names or () if dtype[label].kind != "V"]
    with np.errstate(invalid="ignore"):  # rubbish may be a signalling NaN
        return {label: table[label].astype(float) / per.get(label, 1.0) for label in plain}
