"""The list of log formats, and the reader of a power log in any of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from eadp.errors import InputError
from eadp.io.log import dataflash, ulog
from eadp.io.log.autopilot_battery import battery_log
from eadp.io.log.csv_log import read_csv_log
from eadp.io.log.power_log import Columns, PowerLog
from eadp.io.text.streams import Text, read_text

HEAD = 20_000
"""Bytes from the start of a file by which its format is recognised."""
LIMIT_BYTES = 2_000_000_000
"""Largest binary log."""


@dataclass
class LogSource:
    """A log by its path, or as a text; read once, when it is needed."""

    name: str

    @cached_property
    def head(self) -> bytes:
        """The first bytes; those of the text where the file, a pipe, can be read only once."""
        if os.path.isfile(self.name):
            try:
                with open(self.name, "rb") as stream:
                    return stream.read(HEAD)
            except OSError:
                pass  # reading the text raises it as an InputError
        return self.text.body[:HEAD].encode()

    @cached_property
    def text(self) -> Text:
        """The content as a text."""
        return read_text(self.name)

    @property
    def data(self) -> bytes:
        """The content as bytes."""
        if os.path.getsize(self.name) > LIMIT_BYTES:
            raise InputError.at(self.name, 1, 1, "is too large", f"at most {LIMIT_BYTES} bytes")
        with open(self.name, "rb") as stream:
            return stream.read()


@dataclass(frozen=True)
class LogFormat:
    """A format of power logs: its name, whether a file has it, by its first bytes, and its reader."""

    name: str
    recognise: Callable[[bytes], bool]
    read: Callable[[LogSource, Columns], PowerLog]


def _read_ulog(source: LogSource, columns: Columns) -> PowerLog:
    return battery_log(source.name, ulog.read_ulog(source.name, source.data, ulog.KINDS), columns)


def _read_dataflash(source: LogSource, columns: Columns) -> PowerLog:
    return battery_log(source.name, dataflash.read_dataflash(source.name, source.data, dataflash.KINDS), columns)


def _read_dataflash_text(source: LogSource, columns: Columns) -> PowerLog:
    name, body = source.text.name, source.text.body
    return battery_log(name, dataflash.read_dataflash_text(name, body, dataflash.KINDS), columns)


FORMATS = (
    LogFormat("PX4 ULog", ulog.is_ulog, _read_ulog),
    LogFormat("ArduPilot DataFlash", dataflash.is_dataflash, _read_dataflash),
    LogFormat("ArduPilot DataFlash as text", dataflash.is_dataflash_text, _read_dataflash_text),
    LogFormat("CSV", lambda head: True, lambda source, columns: read_csv_log(source.text, columns)),
)
"""Formats of power logs; the first that recognises a file reads it."""


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
    return chosen.read(source, columns or Columns())
