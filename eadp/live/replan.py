"""A flight that is re-planned: live over a link or on telemetry, or again from a log."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Annotated, Any

from eadp.api.given import File, FlightOptions, Warn, python_warnings
from eadp.api.inputs import load_flight
from eadp.errors import Fault, InputError
from eadp.io.scenario import override_texts, read_overrides
from eadp.io.text.options import Flag
from eadp.live.link import LinkOptions, fly, replay_flight
from eadp.live.replanner import DECIDES_AIRSPEED, ReplanLog, ValuesFile, hash_of, replan_lines
from eadp.live.telemetry import open_telemetry
from eadp.models.plan.plan import Plan


@dataclass(frozen=True)
class ReplanOptions:
    """Where readings come from, and where decisions go."""

    telemetry: Annotated[str, Flag(metavar="FILE")] = "-"
    """Telemetry, a JSON object a line; - for standard input."""

    mavlink: Annotated[str | None, Flag(metavar="ADDRESS")] = None
    """Live: an autopilot's link, as in udpin:127.0.0.1:14550 or /dev/ttyACM0,57600."""

    replay: Annotated[str | None, Flag(metavar="FILE")] = None
    """A flight again: a log of --log, a .tlog, or an autopilot's .bin or .ulg."""

    publish: Annotated[str | None, Flag(metavar="FILE")] = None
    """Keep computations as decided in this file, as JSON, for the process to watch."""

    log: Annotated[str | None, Flag(metavar="FILE")] = None
    """Log of samples and decisions; an existing one is resumed from."""

    @property
    def linked(self) -> bool:
        """Whether readings are an autopilot's messages, or were."""
        return self.mavlink is not None or self.replay is not None

    def check(self, link: LinkOptions, files: Mapping[str, Any]) -> None:
        """Refuse options that do not go together; `files` are the flight's other files, - for standard input."""
        telemetry = None if self.telemetry == "-" else self.telemetry
        sources = {"--mavlink": self.mavlink, "--replay": self.replay, "--telemetry": telemetry}
        given = {name: value for name, value in sources.items() if value is not None}
        if len(given) > 1:
            first, (name, value) = next(iter(given)), list(given.items())[1]
            raise InputError.at(name, 1, 1, f"beside {first}", "one of them", value)
        for name, value in vars(link).items():
            if value not in (None, False) and not self.linked:
                message, option = "without a link", f"--{name.replace('_', '-')}"
                raise InputError.at(option, 1, 1, message, "--mavlink or --replay", str(value))
        if link.upload and self.replay is not None:
            raise InputError.at("--upload", 1, 1, "beside --replay", "--mavlink", self.replay)
        if self.publish and self.log and os.path.realpath(self.publish) == os.path.realpath(self.log):
            raise InputError.at("--publish", 1, 1, "is the file of --log", "another file", self.publish)
        if "-" in files.values() and self.telemetry == "-" and not self.linked:
            raise InputError.at("--telemetry", 1, 1, "standard input is another file already", "--telemetry FILE", "-")


def replan(
    plan: File | Plan,
    options: ReplanOptions,
    flight: FlightOptions | None = None,
    link: LinkOptions | None = None,
    *,
    decided: Callable[[dict[str, Any]], None] = lambda _line: None,
    warn: Warn = python_warnings,
) -> bool:
    """Re-plan a flight from its readings, live or recorded.

    Parameters
    ----------
    plan : path or Plan
    options : ReplanOptions
        Where readings come from, and where decisions go.
    flight : FlightOptions, optional
        Scenario, profile and energy; the scenario gives battery, aircraft and planner, its simulated world is unused.
    link : LinkOptions, optional
        What a link may do.
    decided : function, optional
        Called with each decision, the object of a line of `eadp replan`.
    warn : function, optional

    Returns
    -------
    bool
        Whether the plan is complete, or forecast at the last reading to be.

    Raises
    ------
    InputError
        With the faults of the files, or of an option under its name on the command line.
    """
    flight, link = flight or FlightOptions(), link or LinkOptions()
    given = {name: getattr(flight, name) for name in ("scenario", "profile", "energy")}
    options.check(link, {"plan": plan, **given})
    home = ["on_infeasible=home"] if link.return_home else []
    overrides = read_overrides(override_texts([*flight.set_, *home], flight.planner))
    inputs = load_flight(plan, **given, overrides=overrides)
    warn(inputs.warnings)

    def warn_one(fault: Fault) -> None:
        """Warn of one fault."""
        warn([fault])

    published = None
    if options.publish is not None:
        computations = inputs.mission.plan.parameters[inputs.mission.plan.path_count :]
        published = ValuesFile(options.publish, computations, warn_one)

    def emit(line: dict[str, Any]) -> None:
        """Hand a decision to the caller, and to the file of values."""
        decided(line)
        if published is not None:
            published.decided(line)

    with ExitStack() as stack:
        log, hashed = None, hash_of(inputs.sources, overrides)
        if options.log is not None:
            about = {DECIDES_AIRSPEED: False} if options.linked and not link.command_airspeed else {}
            log = ReplanLog(options.log, hashed, about)
            stack.callback(log.close)
        if options.replay is not None:
            return replay_flight(options.replay, inputs, link, log, emit, warn_one, hashed)
        if options.mavlink is not None:
            return fly(options.mavlink, inputs, link, log, emit, warn_one)
        stream = stack.enter_context(open_telemetry(options.telemetry))
        name = "<stdin>" if options.telemetry == "-" else options.telemetry
        return replan_lines(inputs, stream, name, log, emit, warn_one)
