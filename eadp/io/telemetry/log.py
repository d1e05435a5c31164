"""The log of a flight that is re-planned: every line that was used and every decision, to go on from after a kill.

One JSON object a line with a `kind`: `start`, with a hash of what the planner was told; `telemetry`; `decision`.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO, NamedTuple

from eadp import __version__
from eadp.errors import Fault, InputError
from eadp.io.telemetry.reader import KEYS, TelemetryReader
from eadp.io.text.streams import Text
from eadp.planning.live import Sample

SCHEMA = "eadp.replan-log/1"
START, TELEMETRY, DECISION = "start", "telemetry", "decision"
SYNC_EVERY_S = 1.0
"""A loss of power may cost this much; a kill costs nothing that is written."""


class Entry(NamedTuple):
    """A line of telemetry that was used, or, where `fix` is None, that its decision was told."""

    fix: Sample | None


def hash_of(texts: Mapping[str, Text], overrides: Mapping[str, Any]) -> str:
    """A hash of the texts that a planner was told, and of what was set on the command line."""
    told = {kind: text.body for kind, text in texts.items()}
    whole = json.dumps([told, dict(overrides)], sort_keys=True, default=str)
    return "sha256:" + hashlib.sha256(whole.encode("utf-8", "surrogatepass")).hexdigest()


class ReplanLog:
    """A log that is appended to; entries that stand in it are to be read before.

    Parameters
    ----------
    path : str
    inputs : str
        As `hash_of` gives it.

    Attributes
    ----------
    warnings : list of Fault
        What was odd about what stands in it, or about writing to it.

    Raises
    ------
    InputError
        If the file cannot be written to, is in use, is no such log, or is one of other inputs.
    """

    def __init__(self, path: str, inputs: str) -> None:
        self._path = path
        self.warnings: list[Fault] = []
        self._broken = False
        self._sync_due_s = time.monotonic() + SYNC_EVERY_S
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o666)
        except (OSError, ValueError) as error:  # ValueError: a NUL in the name
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError.at(path, 1, 1, f"cannot be written: {reason}", "a writable place") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._file)
            raise InputError.at(
                path, 1, 1, "is in use by another process", "a log of its own for each flight"
            ) from None
        except OSError:  # a file system without locks
            pass
        start = {"kind": START, "schema": SCHEMA, "eadp": __version__, "inputs": inputs}
        try:
            self._begin(start)
        except BaseException:
            os.close(self._file)
            raise

    def entries(self) -> Iterator[Entry]:
        """What stands in the log; a last line that was torn by a kill is dropped with a warning.

        Raises
        ------
        InputError
            At a line that is none of a log.
        """
        reader = TelemetryReader(self._path)
        with self._open() as stream:
            number, kept = 1, len(stream.readline())
            while raw := stream.readline():
                number += 1
                entry, fault = self._entry(number, raw, reader)
                if fault is not None:
                    if raw.endswith(b"\n") and stream.read(1):
                        raise InputError(fault)
                    self._drop(number, kept)
                    return
                kept += len(raw)
                if entry is not None:
                    yield entry

    def telemetry(self, document: Mapping[str, Any]) -> None:
        """Append a line of telemetry that is going to be used."""
        self._write({"kind": TELEMETRY, **{key: document[key] for key in KEYS if key in document}})

    def decision(self, line: Mapping[str, Any]) -> None:
        """Append a decision that has been told."""
        self._write({"kind": DECISION, **line})

    def close(self) -> None:
        """Bring everything to the disk."""
        with contextlib.suppress(OSError):  # what has no disk behind it, such as a pipe
            os.fsync(self._file)
        os.close(self._file)

    # --- what stands in it

    def _open(self) -> BinaryIO:
        os.lseek(self._file, 0, os.SEEK_SET)
        return os.fdopen(os.dup(self._file), "rb")

    def _begin(self, start: Mapping[str, Any]) -> None:
        try:
            with self._open() as stream:
                raw = stream.readline(10_000)
        except OSError as error:
            raise InputError.at(self._path, 1, 1, f"cannot be read: {error.strerror}", "a file") from None
        whole = _encoded(start)
        if not raw.endswith(b"\n") and whole.startswith(raw):
            if raw:
                self._drop(1, 0)
            self._write(start)
            return
        try:
            first = json.loads(raw)
        except (ValueError, RecursionError):
            first = None
        if not isinstance(first, dict) or first.get("kind") != START or first.get("schema") != SCHEMA:
            raise InputError.at(self._path, 1, 1, "is no log of eadp replan", f"a new file, or a log of {SCHEMA}")
        if first.get("inputs") != start["inputs"]:
            what = "is a log of another plan, profile, scenario or settings"
            raise InputError.at(self._path, 1, 1, what, "the log of these, or a new file")
        if first.get("eadp") != __version__:
            what = f"was begun by eadp {first.get('eadp')}; this is {__version__}, whose decisions may differ"
            self.warnings.append(Fault(self._path, 1, 1, what, severity="warning"))

    def _entry(self, number: int, raw: bytes, reader: TelemetryReader) -> tuple[Entry | None, Fault | None]:
        expected = "a JSON object with the kind telemetry or decision"
        try:
            line = json.loads(raw)
        except (ValueError, RecursionError):  # of which UnicodeDecodeError is one
            line = None
        kind = line.get("kind") if isinstance(line, dict) else None
        if kind == DECISION:
            return Entry(None), None
        if kind != TELEMETRY:
            return None, Fault(self._path, number, 1, "is no line of a log", expected)
        del line["kind"]
        fix, _, faults = reader.read(number, _encoded(line))
        if fix is None:
            return None, Fault(self._path, number, 1, f"is no line of a log: {faults[0].message}", expected)
        return Entry(fix), None

    def _drop(self, number: int, kept: int) -> None:
        os.ftruncate(self._file, kept)
        message = "the last line was torn; it is dropped"
        self.warnings.append(Fault(self._path, number, 1, message, severity="warning"))

    # --- writing

    def _write(self, line: Mapping[str, Any]) -> None:
        if self._broken:
            return
        data = _encoded(line)
        try:
            while data:
                data = data[os.write(self._file, data) :]
            if time.monotonic() >= self._sync_due_s:
                os.fsync(self._file)
                self._sync_due_s = time.monotonic() + SYNC_EVERY_S
        except OSError as error:  # the flight goes on without
            self._broken = True
            message = f"cannot be written any more, and the flight goes on without: {error.strerror}"
            self.warnings.append(Fault(self._path, 1, 1, message, severity="warning"))


def _encoded(line: Mapping[str, Any]) -> bytes:
    return (json.dumps(line, allow_nan=False) + "\n").encode("ascii")
