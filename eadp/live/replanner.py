"""The planner on a stream of telemetry, line by line, with a log from which it resumes after a kill.

The log has every sample read and every decision, one JSON object a line with a `kind`: `start`, with a hash of the
inputs; `telemetry`; `decision`; `mission`, the stages of the items of a mission that was uploaded.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, BinaryIO, NamedTuple

from eadp import __version__
from eadp.api.inputs import FlightInputs
from eadp.errors import Fault, InputError
from eadp.io.text.streams import Text, output_file, write_text
from eadp.live.flight import UNDECIDED, Advice, LiveFlight
from eadp.live.gate import Notice, OutlierGate
from eadp.live.telemetry import KEYS, Reading, TelemetryReader, decision_line, json_line, numbered_lines, open_telemetry
from eadp.models.battery import misfit
from eadp.models.plan.route import PlannedLegs
from eadp.models.plan.stage import Parameter
from eadp.models.world import Mission
from eadp.planning.base import Sample
from eadp.planning.forecast.held import HeldForecast
from eadp.planning.registry import make_flight
from eadp.plug_ins import code_identity

SCHEMA = "eadp.replan-log/1"
START, TELEMETRY, DECISION, MISSION = "start", "telemetry", "decision", "mission"
DECIDES_AIRSPEED = "decides_airspeed"
"""Key of the first line, false where the airspeed may not be decided."""
SYNC_EVERY_S = 1.0
"""Maximum loss at a power cut [s]; a kill loses nothing that is written."""


def hash_of(texts: Mapping[str, Any], overrides: Mapping[str, Any]) -> str:
    """Hash of the texts of the inputs, and of the settings on the command line."""
    bodies = {kind: text.body for kind, text in texts.items()}
    whole = json.dumps([bodies, dict(overrides)], sort_keys=True, default=str)
    return "sha256:" + hashlib.sha256(whole.encode("utf-8", "surrogatepass")).hexdigest()


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


class _Entry(NamedTuple):
    """A line of a log: its kind, and the sample or the items that it has."""

    kind: str
    sample: Sample | None = None
    items: Text | None = None


class ReplanLog:
    """A log to append to; its entries are read first.

    Parameters
    ----------
    path : str
    inputs : str
        As `hash_of` gives it.
    about : mapping, optional
        More keys of its first line.

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
        self._broken, new = False, not os.path.lexists(path)
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
        code = {"eadp": __version__, "code": code_identity()}
        start = {"kind": START, "schema": SCHEMA, **code, "inputs": inputs, **(about or {})}
        try:
            self._start(start)
        except BaseException:
            os.close(self._file)
            raise
        self._unused = new  # of a file that is made here, whether it has no entry yet

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
                entry, torn = self._entry(number, raw, reader), not raw.endswith(b"\n")
                if isinstance(entry, Fault) and not torn and stream.read(1):
                    raise InputError(entry)
                if isinstance(entry, Fault) or torn:
                    self._drop(number, kept)
                    return
                kept += len(raw)
                self.items = entry.items or self.items
                if entry.kind in (TELEMETRY, DECISION):
                    yield entry.sample

    def telemetry(self, document: Mapping[str, Any]) -> None:
        """Append a sample before it is used."""
        self._write({"kind": TELEMETRY, **{key: document[key] for key in KEYS if key in document}})

    def decision(self, line: Mapping[str, Any]) -> None:
        """Append a decision that was emitted."""
        self._write({"kind": DECISION, **line})

    def mission(self, items: str) -> None:
        """Append the map of a mission that was uploaded, as `items_text` has it."""
        self._write({"kind": MISSION, "items": items})

    def close(self) -> None:
        """Sync and close the file; a new one without an entry is removed."""
        with contextlib.suppress(OSError):  # a pipe cannot be synced
            os.fsync(self._file)
        os.close(self._file)
        if self._unused:
            with contextlib.suppress(OSError):
                os.unlink(self._path)

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
        if (code := first.get("code")) != start["code"]:
            what = f"was started by {code}; this is {start['code']}, whose decisions may differ"
            self.warnings.append(Fault(self._path, 1, 1, what, severity="warning"))

    def _entry(self, number: int, raw: bytes, reader: TelemetryReader) -> _Entry | Fault:
        """A line as it was written; a fault where it is none."""
        message, expected = "is no line of a log", f"a JSON object with the kind {TELEMETRY}, {DECISION} or {MISSION}"
        try:
            line = json.loads(raw)
            kind = line.pop("kind", None) if isinstance(line, dict) else None
            telemetry = _encoded(line)
        except (ValueError, RecursionError):  # includes UnicodeDecodeError, and a number that is not finite
            return Fault(self._path, number, 1, message, expected)
        if kind == DECISION:
            return _Entry(kind)
        if kind == MISSION and isinstance(line.get("items"), str):
            return _Entry(kind, items=Text(self._path, line["items"]))
        if kind == TELEMETRY:
            reading = reader.read(number, telemetry)
            if reading.sample is not None:
                return _Entry(kind, reading.sample)
            message = f"{message}: {reading.warnings[0].message}"
        return Fault(self._path, number, 1, message, expected)

    def _drop(self, number: int, kept: int) -> None:
        os.ftruncate(self._file, kept)
        message = "the last line was torn; it is dropped"
        self.warnings.append(Fault(self._path, number, 1, message, severity="warning"))

    # --- writing

    def _write(self, line: Mapping[str, Any]) -> None:
        if self._broken:
            return
        data, self._unused = _encoded(line), False
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


Emit = Callable[[dict[str, Any]], None]
Warn = Callable[[Fault], None]


def replan_lines(
    inputs: FlightInputs, stream: BinaryIO, name: str, log: ReplanLog | None, emit: Emit, warn: Warn
) -> bool:
    """Re-plan a flight from its telemetry, to the end of the stream.

    Parameters
    ----------
    inputs : FlightInputs
    stream : binary stream
        Lines of telemetry.
    name : str
        Name of the stream in messages.
    log : ReplanLog or None
        Its entries are replayed without output, then new ones are appended.
    emit, warn : functions
        Called with each decision and with each warning.

    Returns
    -------
    bool
        Whether the plan is complete, or forecast at the last line to be complete before the battery is empty.

    Raises
    ------
    InputError
        At a line that is no entry of a log.
    """
    flight = Replanner(inputs, name, log, emit, warn)
    flight.restore()
    for number, raw in numbered_lines(stream, name):
        if number == 1 and re.match(rb"(?:\xef\xbb\xbf)?\s*[A-Za-z_][^{,;]*[,;]", raw):
            expected = 'an object a line, as {"time_s": 0, "x_m": 0, …}; --replay reads .tlog, .bin and .ulg'
            raise InputError.at(name, 1, 1, "is a table (CSV), and no telemetry", expected)
        flight.take(flight.reader.read(number, raw))
    if not flight.used:
        warn(Fault(name, 1, 1, "no line could be used", "telemetry as JSON lines", severity="warning"))
    return flight.completes


def rest_after(inputs: FlightInputs, telemetry: str, warn: Warn) -> tuple[PlannedLegs | None, dict[str, Any] | None]:
    """What is left to fly after the telemetry of a file, and the last decision.

    Raises
    ------
    PathUndefined
        If the rest cannot be laid out.
    """
    decisions: list[dict[str, Any]] = []
    flight = Replanner(inputs, telemetry, None, decisions.append, warn)
    with open_telemetry(telemetry) as stream:
        for number, raw in numbered_lines(stream, telemetry):
            flight.take(flight.reader.read(number, raw))
    return flight.rest(), decisions[-1] if decisions else None


class Replanner:
    """The planner on readings of telemetry, see `replan_lines`.

    Attributes
    ----------
    reader : TelemetryReader
        Makes the readings, of lines.
    used : bool
        Whether any line could be used.
    planned : bool
        Whether the planner has made a plan since take-off.
    """

    def __init__(self, inputs: FlightInputs, name: str, log: ReplanLog | None, emit: Emit, warn: Warn) -> None:
        settings = inputs.scenario.planner
        self._mission = inputs.mission
        self._flight = LiveFlight(
            inputs.mission,
            lambda mission: (make_flight(settings, mission), HeldForecast(settings, mission)),
            settings.every_s,
        )
        self._gate, self.reader = OutlierGate(inputs.mission.cruise_mps), TelemetryReader(name, inputs.mission)
        self._log, self._emit, self._warn = log, emit, warn
        # samples of the log that is resumed from, by `Sample.reading`; emptied at the first reading that is new
        self._logged: set[tuple[object, ...]] = set()
        self._misfits: set[str] = set()  # what was warned of the voltage
        self._logged_to_s = 0.0  # the time of the last of them [s]
        self._skipped = self.used = self.planned = False  # `_skipped`: whether it was warned that lines are skipped

    @property
    def completes(self) -> bool:
        """Whether the plan is complete, or forecast to be before the battery is empty."""
        return self._flight.forecast_completes

    def rest(self) -> PlannedLegs | None:
        """What is left to fly, see `LiveFlight.rest`."""
        return self._flight.rest()

    def take(self, reading: Reading) -> None:
        """Take a reading: warn of what is wrong, log it, and emit the decision if one is due.

        Readings that the resumed log has already are skipped, up to the first new one.
        """
        sample, document, warnings, number = reading
        for warning in warnings:
            self._warn(warning)
        if sample is None:
            return
        if self._logged and sample.reading in self._logged:
            if not self._skipped:  # a recorded flight, again from its start
                self._skipped = True
                message = f"lines up to {self._logged_to_s:.15g} s are in the log already, and are skipped"
                self._warn(self.reader.fault(number, document, "time_s", message, ""))
            return
        self._logged.clear()
        self.used = True
        if self._log is not None:
            self._log.telemetry(document)
        advice, notices = self._update(sample)
        for notice in notices:
            self._warn(self.reader.fault(number, document, *notice))
        if (said := self._misfit(sample)) and said not in self._misfits:
            self._misfits.add(said)
            message = f"the voltage is far {said} that of the charge: another battery, or one that was not full"
            self._warn(self.reader.fault(number, document, "voltage_v", message, ""))
        if advice is not None:
            self._decide(advice)
        self._warn_of_log()

    def _misfit(self, sample: Sample) -> str:
        """Whether the voltage is above or below that of the charge; empty where it fits, or is not known."""
        volts, soc, battery = sample.voltage_v, sample.soc, self._mission.battery
        if not volts or soc is None or battery.voltage_empty_v is None or battery.prescribed:
            return ""
        drop_v = battery.resistance_ohm * max((sample.power_w or 0.0) / volts, 0.0)
        off_v = volts + drop_v - float(battery.voltage_at(soc))
        return misfit(off_v, battery.voltage_v - battery.voltage_empty_v, drop_v)

    def _update(self, sample: Sample) -> tuple[Advice | None, tuple[Notice, ...]]:
        """Update the gate and the flight with a sample; return advice, at the sample's own time, and notices."""
        if sample.mode.autopilot is not None:
            self._flight.know(sample.mode.autopilot)
        accepted, of_sample = self._gate.accept(sample)
        advice, notices = self._flight.update(accepted) if accepted is not None else (None, ())
        if advice is not None:  # the gate may have moved the sample to another clock
            advice = advice._replace(time_s=sample.time_s)
        self.planned |= advice is not None and advice.reason not in UNDECIDED
        return advice, (*of_sample, *notices)

    def _decide(self, advice: Advice) -> None:
        """Emit advice as a line of decisions, and log it."""
        line = decision_line(advice)
        self._emit(line)
        if self._log is not None:  # emitted first: after a kill between the two it is repeated, not lost
            self._log.decision(line)

    def restore(self) -> None:
        """Replay the log, if there is one, without output; emit and log its last decision where it is missing."""
        if self._log is None:
            return
        # advice with no decision logged after it: of the last sample alone, where a kill came between the two
        pending: Advice | None = None
        for sample in self._log.entries(self._mission):
            if sample is None:  # the entry of a decision
                pending = None
                continue
            self._logged.add(sample.reading)
            self._logged_to_s = sample.time_s
            pending, _ = self._update(sample)
        self._warn_of_log()
        self.used = bool(self._logged)
        if pending is not None:
            self._decide(pending)

    def _warn_of_log(self) -> None:
        """Pass on what the log has had to warn of."""
        while self._log is not None and self._log.warnings:
            self._warn(self._log.warnings.pop(0))


class ValuesFile:
    """A file that holds computations as last decided: one line of JSON, replaced whole where they change.

    Parameters
    ----------
    path : str
    parameters : sequence of Parameter
        The computations.
    warn : function
        Called with a fault where the file cannot be written.

    Raises
    ------
    InputError
        If the path is no regular file's.
    """

    def __init__(self, path: str, parameters: tuple[Parameter, ...], warn: Warn) -> None:
        output_file(path)
        self._path, self._parameters, self._warn = path, parameters, warn
        self._written: dict[str, Any] = {}
        self._failed = ""

    def decided(self, decision: Mapping[str, Any]) -> None:
        """Take a decision: write the file if values have changed."""
        values = _values(decision, self._parameters)
        if values["parameters"] == self._written.get("parameters"):
            return
        try:
            write_text(self._path, json_line(values))
            self._written, self._failed = values, ""
        except InputError as error:  # tried again with the next decision
            if self._failed != str(error):
                self._failed = str(error)
                self._warn(Fault(self._path, 1, 1, error.faults[0].message, severity="warning"))


def _values(decision: Mapping[str, Any], parameters: tuple[Parameter, ...]) -> dict[str, Any]:
    """The time of a decision [s], and its computations as people read them."""
    shown = {each.label: each.shown(decision["parameters"][each.name]) for each in parameters}
    return {"time_s": decision["time_s"], "parameters": shown}
