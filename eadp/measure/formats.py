"""The list of log formats, and the reader of a power log in any of them."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

from eadp.errors import InputError
from eadp.io.logs.tables import read_tables
from eadp.io.text.streams import Text, is_tlog, read_text
from eadp.measure.autopilot_log import DATAFLASH_TOPICS, MOTION_TOPICS, ULOG_TOPICS, battery_log
from eadp.measure.csv_log import read_csv_log
from eadp.measure.power_log import Columns, PowerLog
from eadp.measure.tlog import tlog_tables
from eadp.plug_ins import plug_ins

HEAD = 20_000
"""Bytes from the start of a file by which its format is recognised."""
_OF_A_PIPE = "UTF-8 text from a pipe; a ULog or a binary DataFlash log as a file"


@dataclass
class LogSource:
    """A log by its path, or as a text; read once, when it is needed."""

    name: str

    @cached_property
    def head(self) -> bytes:
        """The first bytes; those of the text where the file, a pipe, can be read only once. Raises InputError."""
        if os.path.isfile(self.name):
            try:
                with open(self.name, "rb") as stream:
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


def _tlog(source: LogSource, columns: Columns) -> PowerLog:
    return battery_log(source.name, tlog_tables(source.name), columns)


FORMATS = (
    LogFormat("PX4 ULog", lambda head: head.startswith(b"ULog"), partial(_autopilot, "ulog", ULOG_TOPICS)),
    LogFormat(
        "ArduPilot DataFlash",
        lambda head: head.startswith(b"\xa3\x95"),
        partial(_autopilot, "dataflash", DATAFLASH_TOPICS),
    ),
    LogFormat("telemetry log", is_tlog, _tlog),
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
