"""Log of a flight on telemetry: every sample read and every decision, to resume from after a kill.

One JSON object a line with a `kind`: `start`, with a hash of the inputs and what a page needs of them; `telemetry`;
`decision`; `applied`, what came of a command that applies computations; `mission`, the stages of the items of a mission
that was uploaded.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO

from eadp import __version__
from eadp.errors import Fault, InputError
from eadp.io.text.streams import Text
from eadp.live.telemetry import KEYS, TelemetryReader, numbered_lines
from eadp.planning.base import Mission, Sample

SCHEMA = "eadp.replan-log/1"
START, TELEMETRY, DECISION, APPLIED, MISSION = "start", "telemetry", "decision", "applied", "mission"
SYNC_EVERY_S = 1.0
"""Maximum loss at a power cut [s]; a kill loses nothing that is written."""


def hash_of(texts: Mapping[str, Any], overrides: Mapping[str, Any]) -> str:
    """Hash of the texts of the inputs, and of the settings on the command line."""
    bodies = {kind: text.body for kind, text in texts.items()}
    whole = json.dumps([bodies, dict(overrides)], sort_keys=True, default=str)
    return "sha256:" + hashlib.sha256(whole.encode("utf-8", "surrogatepass")).hexdigest()


def described(mission: Mission, reserve_soc: float) -> dict[str, Any]:
    """What the first line has of a mission: its battery, and what people call the path parameters."""
    battery = mission.battery
    titled = [
        {"name": each.name, "title": each.title, "unit": each.unit}
        | ({} if each.stands_for is None else {"stands_for": each.stands_for.text})
        for each in mission.plan.parameters
        if each.title
    ]
    counted = {"soc": battery.soc, "soc_per_ah": 3600 * battery.drain_per_as, "reserve_soc": reserve_soc}
    return counted | {"parameters": titled}


def telemetry_lines(stream: BinaryIO, name: str) -> Iterator[tuple[int, bytes]]:
    """As `numbered_lines`; of a log the lines of telemetry alone, as they came."""
    for number, raw in numbered_lines(stream, name):
        try:
            line = json.loads(raw)
        except (ValueError, RecursionError):  # a line that is none, as its reader says
            line = None
        kind = line.pop("kind", None) if isinstance(line, dict) else None
        if kind is None:
            yield number, raw
        elif kind == TELEMETRY:
            yield number, _encoded(line)


class ReplanLog:
    """A log to append to; its entries are read first.

    Parameters
    ----------
    path : str
    inputs : str
        As `hash_of` gives it.
    about : mapping, optional
        As `described` gives it.

    Attributes
    ----------
    warnings : list of Fault
        About its entries, or about writing to it.
    items : Text or None
        The map of the last mission that was uploaded, as its entries have it.

    Raises
    ------
    InputError
        If the file cannot be written to, is in use, is no such log, or is one of other inputs.
    """

    def __init__(self, path: str, inputs: str, about: Mapping[str, Any] | None = None) -> None:
        self._path = path
        self.warnings: list[Fault] = []
        self.items: Text | None = None
        self._broken = False
        self._sync_due_s = time.monotonic() + SYNC_EVERY_S
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o666)
        except (OSError, ValueError) as error:  # ValueError: a NUL in the name
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError.at(path, 1, 1, f"cannot be written: {reason}", "a writable path") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._file)
            expected = "a log of its own for each flight"
            raise InputError.at(path, 1, 1, "is in use by another process", expected) from None
        except OSError:  # a file system without locks
            pass
        start = {"kind": START, "schema": SCHEMA, "eadp": __version__, "inputs": inputs, **(about or {})}
        try:
            self._start(start)
        except BaseException:
            os.close(self._file)
            raise

    def entries(self, mission: Mission | None = None) -> Iterator[Sample | None]:
        """Samples of the log, and None for each decision; an incomplete last line is dropped with a warning.

        Raises
        ------
        InputError
            At a line that is no entry of a log.
        """
        reader = TelemetryReader(self._path, mission)
        with self._open() as stream:
            number, kept = 1, len(stream.readline())
            while raw := stream.readline():
                number += 1
                kind, sample, fault = self._entry(number, raw, reader)
                if fault is not None or not raw.endswith(b"\n"):
                    if fault is not None and raw.endswith(b"\n") and stream.read(1):
                        raise InputError(fault)
                    self._drop(number, kept)
                    return
                kept += len(raw)
                if kind in (TELEMETRY, DECISION):
                    yield sample

    def telemetry(self, document: Mapping[str, Any]) -> None:
        """Append a sample before it is used."""
        self._write({"kind": TELEMETRY, **{key: document[key] for key in KEYS if key in document}})

    def decision(self, line: Mapping[str, Any]) -> None:
        """Append a decision that was emitted."""
        self._write({"kind": DECISION, **line})

    def applied(self, line: Mapping[str, Any]) -> None:
        """Append what came of a command that applies computations."""
        self._write({"kind": APPLIED, **line})

    def mission(self, items: str) -> None:
        """Append the map of a mission that was uploaded, as `items_text` has it."""
        self._write({"kind": MISSION, "items": items})

    def close(self) -> None:
        """Sync and close the file."""
        with contextlib.suppress(OSError):  # a pipe cannot be synced
            os.fsync(self._file)
        os.close(self._file)

    # --- reading

    def _open(self) -> BinaryIO:
        os.lseek(self._file, 0, os.SEEK_SET)
        return os.fdopen(os.dup(self._file), "rb")

    def _start(self, start: Mapping[str, Any]) -> None:
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
            what = f"was started by eadp {first.get('eadp')}; this is {__version__}, whose decisions may differ"
            self.warnings.append(Fault(self._path, 1, 1, what, severity="warning"))

    def _entry(
        self, number: int, raw: bytes, reader: TelemetryReader
    ) -> tuple[str | None, Sample | None, Fault | None]:
        expected = "a JSON object with the kind telemetry or decision"
        try:
            line = json.loads(raw)
            kind = line.pop("kind", None) if isinstance(line, dict) else None
            telemetry = _encoded(line)
        except (ValueError, RecursionError):  # includes UnicodeDecodeError, and a number that is not finite
            kind = None
        if kind == MISSION and isinstance(line.get("items"), str):
            self.items = Text(self._path, line["items"])
        elif kind == TELEMETRY:
            reading = reader.read(number, telemetry)
            if reading.sample is None:
                message = f"is no line of a log: {reading.warnings[0].message}"
                return None, None, Fault(self._path, number, 1, message, expected)
            return kind, reading.sample, None
        elif kind not in (DECISION, APPLIED):
            return None, None, Fault(self._path, number, 1, "is no line of a log", expected)
        return kind, None, None

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
        except OSError as error:  # the flight goes on without a log
            self._broken = True
            message = f"cannot be written any more, and the flight goes on without: {error.strerror}"
            self.warnings.append(Fault(self._path, 1, 1, message, severity="warning"))


def _encoded(line: Mapping[str, Any]) -> bytes:
    return (json.dumps(line, allow_nan=False) + "\n").encode("ascii")
