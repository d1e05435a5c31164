"""The planner on a stream of telemetry, line by line, with a log from which it resumes."""

from __future__ import annotations

import contextlib
import shlex
import subprocess
import time
from collections.abc import Callable, Mapping
from typing import Any, BinaryIO

from eadp.api.inputs import FlightInputs
from eadp.errors import Fault, InputError, printable
from eadp.io.text.streams import output_file, write_text
from eadp.live.flight import UNDECIDED, Advice, LiveFlight
from eadp.live.gate import Notice, OutlierGate
from eadp.live.telemetry import Reading, TelemetryReader, decision_line, json_line, numbered_lines, open_telemetry
from eadp.live.telemetry_log import ReplanLog
from eadp.models.plan.route import PlannedLegs
from eadp.models.plan.stage import Parameter
from eadp.planning.base import Sample
from eadp.planning.flight import make_flight
from eadp.planning.forecast.held import HeldForecast

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
            lambda mission: make_flight(settings, mission),
            lambda mission: HeldForecast(settings, mission),
            settings.every_s,
        )
        self._gate, self.reader = OutlierGate(inputs.mission.cruise_mps), TelemetryReader(name, inputs.mission)
        self._log, self._emit, self._warn = log, emit, warn
        # samples of the log that is resumed from, by `Sample.reading`; emptied at the first reading that is new
        self._logged: set[tuple[object, ...]] = set()
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
        if advice is not None:
            self._decide(advice)
        self._warn_of_log()

    def _update(self, sample: Sample) -> tuple[Advice | None, tuple[Notice, ...]]:
        """Update the gate and the flight with a sample; return advice, at the sample's own time, and notices."""
        if sample.autopilot is not None:
            self._flight.know(sample.autopilot)
        accepted, notice = self._gate.accept(sample)
        advice, notices = self._flight.update(accepted) if accepted is not None else (None, ())
        if advice is not None:  # the gate may have moved the sample to another clock
            advice = advice._replace(time_s=sample.time_s)
        self.planned |= advice is not None and advice.reason not in UNDECIDED
        return advice, notices if notice is None else (notice, *notices)

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


LIMIT_S = 10.0
"""Time after which a command is ended [s]: in it a parameter should be in force."""

STDERR = 2


class Hook:
    """Runs a command with computations as they are decided, one at a time and only where they change.

    It never waits for the command. The values follow the command as arguments, as in `fps=7`.

    Parameters
    ----------
    command : str
        The command and its first arguments, as a shell splits them; no shell runs.
    parameters : sequence of Parameter
        The computations.
    log : ReplanLog or None
        Takes the exit code and the time of each run.
    warn : function
        Called with a text where a run fails.

    Raises
    ------
    InputError
        If the command is none.
    """

    def __init__(
        self, command: str, parameters: tuple[Parameter, ...], log: ReplanLog | None, warn: Callable[[str], None]
    ) -> None:
        try:
            self._command = shlex.split(command)
        except ValueError:
            self._command = []
        if not self._command:
            raise InputError.at("--apply", 1, 1, "is no command", "a program and its arguments", command)
        self._parameters, self._log, self._warn = parameters, log, warn
        self._process: subprocess.Popen[bytes] | None = None
        self._started_s = 0.0
        # as of `_values`: the values last decided, and those of the last run, empty where that run failed
        self._wanted: dict[str, Any] = {}
        self._run: dict[str, Any] = {}

    def decided(self, decision: Mapping[str, Any]) -> None:
        """Take a decision: start the command if values have changed, unless a run goes on."""
        self._wanted = _values(decision, self._parameters)
        self._poll()
        self._start()

    def close(self) -> None:
        """Wait for the run that goes on, and for one more run where other values were decided meanwhile."""
        for _ in range(2):
            if self._process is not None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(max(0.0, self._started_s + LIMIT_S - time.monotonic()))
                failed = self._poll(last=True)
                if not failed:
                    self._start()

    def _start(self) -> None:
        """Start the command with the values last decided, unless a run goes on, or the last run had these values."""
        if self._process is not None or self._wanted.get("parameters") == self._run.get("parameters"):
            return
        self._run, self._started_s = self._wanted, time.monotonic()
        arguments = [f"{name}={value:.10g}" for name, value in self._run["parameters"].items()]
        try:  # what it prints is not mixed with decisions
            self._process = subprocess.Popen([*self._command, *arguments], stdin=subprocess.DEVNULL, stdout=STDERR)
        except (OSError, ValueError) as error:
            self._ended(None, getattr(error, "strerror", None) or str(error))

    def _poll(self, *, last: bool = False) -> bool:
        """See whether the run has ended, and end it after `LIMIT_S`, or at once if `last`; return whether it failed."""
        process = self._process
        code = None if process is None else process.poll()
        if process is None or (code is None and not last and time.monotonic() - self._started_s <= LIMIT_S):
            return False
        if code is None:
            process.kill()
            process.wait()
        self._process = None
        self._ended(code, f"took more than {LIMIT_S:g} s" if code is None else f"exit code {code}")
        return code != 0

    def _ended(self, code: int | None, what: str) -> None:
        """Log the end of a run by its exit code, None without one; warn if it failed, for the reason `what`."""
        run = self._run  # the time of the decision [s], and its values
        if self._log is not None:
            self._log.applied({**run, "exit_code": code, "took_s": round(time.monotonic() - self._started_s, 3)})
        if code != 0:
            values = ", ".join(f"{name} {value:g}" for name, value in run["parameters"].items())
            self._run = {}  # tried again with the next decision
            self._warn(f"{printable(self._command[0])} did not apply {values}: {printable(what)}")


class ValuesFile:
    """A file that holds computations as last decided: one line of JSON, replaced whole where they change.

    Parameters
    ----------
    path : str
    parameters : sequence of Parameter
        The computations.
    warn : function
        Called with a text where the file cannot be written.

    Raises
    ------
    InputError
        If the path is no regular file's.
    """

    def __init__(self, path: str, parameters: tuple[Parameter, ...], warn: Callable[[str], None]) -> None:
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
                self._warn(error.faults[0].message)


def _values(decision: Mapping[str, Any], parameters: tuple[Parameter, ...]) -> dict[str, Any]:
    """The time of a decision [s], and its computations as people read them."""
    shown = {each.label: each.shown(decision["parameters"][each.name]) for each in parameters}
    return {"time_s": decision["time_s"], "parameters": shown}
