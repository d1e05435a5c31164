"""The planner on a stream of telemetry, line by line, with a log from which it resumes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, BinaryIO

from eadp.errors import Fault
from eadp.io.flight.inputs import FlightInputs
from eadp.io.telemetry.decisions import decision_line
from eadp.io.telemetry.log import ReplanLog
from eadp.io.telemetry.reader import TelemetryReader, numbered_lines
from eadp.planning.joint.held import HeldForecast
from eadp.planning.live import LiveFlight, OutlierGate
from eadp.planning.registry import make_planner

Emit = Callable[[dict[str, Any]], None]
Warn = Callable[[Fault], None]


def replan(inputs: FlightInputs, stream: BinaryIO, name: str, log: ReplanLog | None, emit: Emit, warn: Warn) -> bool:
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
    settings, estimator = inputs.scenario.planner, inputs.scenario.estimator
    flight = LiveFlight(
        inputs.mission,
        lambda mission: make_planner(settings, estimator, mission),
        lambda mission: HeldForecast(settings, mission),
        settings.every_s,
    )
    gate = OutlierGate(inputs.mission.cruise_mps)
    logged_to_s = _restore(flight, gate, log, emit, warn) if log is not None else None
    reader = TelemetryReader(name)
    used = logged_to_s is not None
    skipped = False
    for number, raw in numbered_lines(stream, name):
        sample, document, warnings = reader.read(number, raw)
        for warning in warnings:
            warn(warning)
        if sample is None:
            continue
        if logged_to_s is not None and sample.time_s <= logged_to_s:
            if not skipped:  # a recorded flight, again from its start
                skipped = True
                message = f"lines up to {logged_to_s:.15g} s are in the log already, and are skipped"
                warn(reader.fault(number, document, "time_s", message, ""))
            continue
        accepted, notice = gate.accept(sample)
        if notice is not None:
            warn(reader.fault(number, document, *notice))
        if not accepted:
            continue
        logged_to_s, used = None, True
        if log is not None:
            log.telemetry(document)
        advice, notices = flight.update(sample)
        for notice in notices:
            warn(reader.fault(number, document, *notice))
        if advice is not None:
            line = decision_line(advice)
            emit(line)
            if log is not None:  # emitted first: after a kill between the two it is repeated, not lost
                log.decision(line)
        if log is not None:
            _warn_all(log, warn)
    if not used:
        warn(Fault(name, 1, 1, "no line could be used", "telemetry as JSON lines", severity="warning"))
    return flight.forecast_completes


def _restore(flight: LiveFlight, gate: OutlierGate, log: ReplanLog, emit: Emit, warn: Warn) -> float | None:
    """Replay a log; emit the last decision if it is missing; return the time of the last line."""
    pending, last_s = None, None
    for sample in log.entries():
        if sample is None:
            pending = None
            continue
        last_s = sample.time_s
        gate.keep(sample)
        pending, _ = flight.update(sample)
    _warn_all(log, warn)
    if pending is not None:
        line = decision_line(pending)
        emit(line)
        log.decision(line)
    return last_s


def _warn_all(log: ReplanLog, warn: Warn) -> None:
    while log.warnings:
        warn(log.warnings.pop(0))
