"""The planner on a stream of telemetry: line by line, with a log to go on from."""

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

Tell = Callable[[dict[str, Any]], None]
Warn = Callable[[Fault], None]


def replan(inputs: FlightInputs, stream: BinaryIO, name: str, log: ReplanLog | None, tell: Tell, warn: Warn) -> bool:
    """Re-plan a flight from its telemetry, to the end of the stream.

    Parameters
    ----------
    inputs : FlightInputs
    stream : binary stream
        Lines of telemetry.
    name : str
        What to call it in messages.
    log : ReplanLog or None
        What stands in it is flown again in silence, then what comes is added.
    tell, warn : functions
        Take each decision and each warning as it is made.

    Returns
    -------
    bool
        Whether the plan is done, or is forecast at the last line to be done before the battery is empty.

    Raises
    ------
    InputError
        At a line of the log that is none.
    """
    settings, estimator = inputs.scenario.planner, inputs.scenario.estimator
    flight = LiveFlight(
        inputs.mission,
        lambda mission: make_planner(settings, estimator, mission),
        lambda mission: HeldForecast(settings, mission),
        settings.every_s,
    )
    screen = OutlierGate(inputs.mission.cruise_mps)
    known_to_s = _restore(flight, screen, log, tell, warn) if log is not None else None
    reader = TelemetryReader(name)
    used = known_to_s is not None
    passed_over = False
    for number, raw in numbered_lines(stream, name):
        fix, document, warnings = reader.read(number, raw)
        for warning in warnings:
            warn(warning)
        if fix is None:
            continue
        if known_to_s is not None and fix.time_s <= known_to_s:
            if not passed_over:  # a recorded flight that is given again from its begin
                passed_over = True
                message = f"lines up to {known_to_s:.15g} s are in the log already, and are passed over"
                warn(reader.fault(number, document, "time_s", message, ""))
            continue
        usable, remark = screen.judge(fix)
        if remark is not None:
            warn(reader.fault(number, document, remark.key, remark.message, remark.expected))
        if not usable:
            continue
        known_to_s, used = None, True
        screen.keep(fix)
        if log is not None:
            log.telemetry(document)
        advice, remarks = flight.take(fix)
        for remark in remarks:
            warn(reader.fault(number, document, remark.key, remark.message, remark.expected))
        if advice is not None:
            line = decision_line(advice)
            tell(line)
            if log is not None:  # told first: after a kill between the two it is told again, not lost
                log.decision(line)
        if log is not None:
            _warn_all(log, warn)
    if not used:
        warn(Fault(name, 1, 1, "no line could be used", "telemetry as JSON lines", severity="warning"))
    return flight.forecast_completes


def _restore(flight: LiveFlight, screen: OutlierGate, log: ReplanLog, tell: Tell, warn: Warn) -> float | None:
    """Fly again what stands in a log; tell what had not been told; return the time of the last line."""
    untold, last_s = None, None
    for entry in log.entries():
        if entry.fix is None:
            untold = None
            continue
        last_s = entry.fix.time_s
        screen.keep(entry.fix)
        untold, _ = flight.take(entry.fix)
    _warn_all(log, warn)
    if untold is not None:
        line = decision_line(untold)
        tell(line)
        log.decision(line)
    return last_s


def _warn_all(log: ReplanLog, warn: Warn) -> None:
    while log.warnings:
        warn(log.warnings.pop(0))
