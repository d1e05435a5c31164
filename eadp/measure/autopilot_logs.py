"""Messages of autopilots' logs as tables of numbers: only the topics asked for, read by `autopilot_process`."""

from __future__ import annotations

import importlib.util
import io
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import InputError, printable

LIMIT_BYTES = 2_000_000_000
"""Largest log of an autopilot."""
_PROCESS = Path(__file__).with_name("autopilot_process.py")


@dataclass
class Tables:
    """Messages by topic: columns by name, one row for each message.

    Attributes
    ----------
    columns : dict of str to dict of str to array, shape (n,)
        Topics are named as in the log; of a ULog, `battery_status 0`, with the instance; of a bag, with its topic, too.
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
        `ulog`, `dataflash`, `dataflash-text`, or `bag`, which may be a folder.
    topics : sequence of str
        Topics to read.

    Raises
    ------
    InputError
        If the library that reads the format is not installed, or the log is too large, cannot be read, or takes more
        memory or time than a log of its size.
    """
    own = {"ulog": ("pyulog", "a PX4 ULog"), "bag": ("rosbags", "a ROS bag")}
    library, title = own.get(form, ("pymavlink", "an ArduPilot DataFlash log"))
    if importlib.util.find_spec(library) is None:
        extra = "ros" if library == "rosbags" else "logs"
        raise InputError.at(name, 1, 1, f"{library}, which reads {title}, is missing", f"pip install 'eadp[{extra}]'")
    if os.path.getsize(path) > LIMIT_BYTES:
        raise InputError.at(name, 1, 1, "is too large", f"at most {LIMIT_BYTES} bytes")
    command = [sys.executable, "-P", str(_PROCESS), form, path, ",".join(topics)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode:
        ended = done.stderr.decode(errors="replace") or "takes more memory or time than a log of its size"
        raise InputError.at(name, 1, 1, f"cannot be read by {library}: {printable(ended)}", title)
    tables = Tables()
    # rubbish may be a signalling NaN
    with np.load(io.BytesIO(done.stdout)) as columns, np.errstate(invalid="ignore"):
        for key, values in columns.items():
            *topic, label = key.rsplit("/", 1)
            if topic:
                tables.columns.setdefault(topic[0], {})[label] = values.astype(float)
            else:
                tables.notes += [str(note) for note in values]
    return tables


def at_times(known_us: FloatArray, values: FloatArray, time_us: FloatArray) -> FloatArray:
    """Values [shape (n,)] at other times [µs]: linear in between, NaN before the first and after the last."""
    order = np.argsort(known_us, kind="stable")
    result: FloatArray = np.interp(time_us, known_us[order], values[order], left=np.nan, right=np.nan)
    return result
