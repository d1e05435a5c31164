"""The planner on a stream of telemetry, line by line, with a log from which it resumes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, BinaryIO

from eadp.api.inputs import FlightInputs
from eadp.api.replan.decisions import decision_line
from eadp.errors import Fault
from eadp.io.telemetry.log import ReplanLog
from eadp.io.telemetry.reader import Reading, TelemetryReader, numbered_lines, open_telemetry
from eadp.models.plan.route import PlannedLegs
from eadp.planning.base import Sample
from eadp.planning.flight import make_flight
from eadp.planning.forecast.held import HeldForecast
from eadp.planning.track.gate import Notice, OutlierGate
from eadp.planning.track.live import UNDECIDED, Advice, LiveFlight

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
        settings, estimator = inputs.scenario.planner, inputs.scenario.estimator
        self._mission = inputs.mission
        self._flight = LiveFlight(
            inputs.mission,
            lambda mission: make_flight(settings, estimator, mission),
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
