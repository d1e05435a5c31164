"""`eadp replan`."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from typing import Annotated, Any, BinaryIO

from typer import Argument, Option

from eadp.cli.options import (
    AtOption,
    EnergyOption,
    LapsOption,
    PlannerOption,
    ProfileOption,
    ScenarioOption,
    SetOption,
    load_overrides,
)
from eadp.cli.output import usage_fault, warn


def command(
    plan: Annotated[str, Argument(help="Plan, or mission (QGroundControl's plan, WPL).", metavar="PLAN")],
    telemetry: Annotated[
        str, Option(help="Telemetry, a JSON object a line; - for standard input.", metavar="FILE")
    ] = "-",
    scenario: ScenarioOption = None,
    profile: ProfileOption = None,
    at: AtOption = None,
    energy: EnergyOption = None,
    planner: PlannerOption = None,
    set_: SetOption = None,
    laps: LapsOption = None,
    mavlink: Annotated[
        str | None,
        Option(help="Live: an autopilot's link, as in udpin:127.0.0.1:14550 or /dev/ttyACM0,57600.", metavar="ADDRESS"),
    ] = None,
    items: Annotated[
        str | None, Option(help="Stages of the mission's items, as eadp export writes them.", metavar="FILE")
    ] = None,
    system: Annotated[
        int | None, Option(help="The autopilot's MAVLink system; by default the first one heard.", min=1, max=255)
    ] = None,
    replay: Annotated[
        str | None,
        Option(help="A flight again: a log of --log, a .tlog, or an autopilot's .bin or .ulg.", metavar="FILE"),
    ] = None,
    upload: Annotated[
        bool, Option("--upload", help="Replace the rest of the autopilot's mission where another path is decided.")
    ] = False,
    return_home: Annotated[
        bool, Option("--return-home", help="Command the autopilot to return where only home can be reached.")
    ] = False,
    signing_key: Annotated[
        str | None,
        Option(help="Passphrase of MAVLink's signatures: others' messages are ignored, ours signed.", metavar="FILE"),
    ] = None,
    apply: Annotated[
        str | None,
        Option(help="Run this with computations as decided, as in fps=7; a failure is warned of.", metavar="COMMAND"),
    ] = None,
    publish: Annotated[
        str | None,
        Option(help="Keep computations as decided in this file, as JSON, for the process to watch.", metavar="FILE"),
    ] = None,
    log: Annotated[
        str | None, Option(help="Log of samples and decisions; an existing one is resumed from.", metavar="FILE")
    ] = None,
) -> int:
    """Example: eadp replan plans/survey.plan --scenario scenarios/survey.yaml --telemetry
    scenarios/example-telemetry.jsonl

    The planner on a live or recorded flight: telemetry in, decisions out, as JSON lines. The scenario gives battery,
    aircraft and planner; its simulated world is unused.

    A line in has time_s, x_m, y_m, power_w and soc; lat_deg and lon_deg in place of x_m and y_m, current_consumed_ah
    in place of soc; stage, stages_started, flies_mission (the autopilot flies a list of items), wind_mps,
    velocity_mps, airspeed_mps, heading_deg and parameters are optional. A line out has time_s, stage, parameters,
    soc_end_forecast, completes_probability, reason, warnings and more. An invalid value gives a warning and counts as
    null; an invalid line is skipped.

    With --mavlink the lines are made of an autopilot's messages while it flies, and decisions are sent to it, too, as
    NAMED_VALUE_FLOAT and STATUSTEXT. Nothing is commanded but, with --return-home, a return, and nothing written
    but, with --upload, the rest of the mission. It ends when the aircraft has flown and is disarmed.

    Exit code 0 if the plan is complete or forecast to be at the last line, 1 if not, 2 on bad input.
    """
    from eadp.api.inputs import load_flight
    from eadp.api.replan.apply import Hook, ValuesFile
    from eadp.api.replan.decisions import json_line
    from eadp.api.replan.replanner import replan
    from eadp.errors import Fault
    from eadp.io.scenario.scenario_file import override_texts, read_overrides
    from eadp.io.telemetry.log import ReplanLog, hash_of
    from eadp.io.telemetry.reader import open_telemetry

    sources = {"--mavlink": mavlink, "--replay": replay, "--telemetry": None if telemetry == "-" else telemetry}
    given_sources = [name for name, value in sources.items() if value is not None]
    if len(given_sources) > 1:
        raise usage_fault(given_sources[1], str(sources[given_sources[1]]), f"beside {given_sources[0]}", "one of them")
    linked = mavlink is not None or replay is not None
    for name, value in (
        ("--items", items),
        ("--system", system),
        ("--upload", upload or None),
        ("--return-home", return_home or None),
        ("--signing-key", signing_key),
    ):
        if value is not None and not linked:
            raise usage_fault(name, str(value), "without a link", "--mavlink or --replay")
    if upload and replay is not None:
        raise usage_fault("--upload", replay, "beside --replay", "--mavlink")
    for given in (plan, scenario, profile, energy):
        if given == "-" and telemetry == "-" and not linked:
            raise usage_fault("--telemetry", "-", "standard input is another file already", "--telemetry FILE")
    home = ["on_infeasible=home"] if return_home else []
    overrides = read_overrides(
        override_texts([*(set_ or ()), *home, *load_overrides(at)], planner=planner and planner.value, laps=laps)
    )
    inputs = load_flight(plan, scenario_path=scenario, profile_path=profile, energy_path=energy, overrides=overrides)
    warn(inputs.warnings)

    doors: list[Hook | ValuesFile] = []

    def emit(line: dict[str, Any]) -> None:
        sys.stdout.write(json_line(line))
        sys.stdout.flush()
        for door in doors:
            door.decided(line)

    def warn_of(where: str, what: str) -> None:
        warn([Fault(where, 1, 1, what, severity="warning")])

    with ExitStack() as stack:
        if not linked:
            stream: BinaryIO = stack.enter_context(open_telemetry(telemetry))
        hashed = hash_of(inputs.texts, overrides)
        kept = ReplanLog(log, hashed) if log is not None else None
        if kept is not None:
            stack.callback(kept.close)
        computations = inputs.mission.plan.parameters[inputs.mission.plan.path_count :]
        if publish is not None:
            doors.append(ValuesFile(publish, computations, lambda what: warn_of(publish, what)))
        if apply is not None:
            hook = Hook(apply, computations, kept, lambda what: warn_of("--apply", what))
            doors.append(hook)
            stack.callback(hook.close)
        if linked:
            from eadp.api.replan.link import LinkOptions, fly, replay_flight

            options = LinkOptions(items, system, upload, return_home, signing_key)
            link = (inputs, options, kept, emit, lambda fault: warn([fault]))
            completes = replay_flight(replay, *link, hashed) if replay is not None else fly(mavlink or "", *link)
            return 0 if completes else 1
        name = "<stdin>" if telemetry == "-" else telemetry
        completes = replan(inputs, stream, name, kept, emit, lambda fault: warn([fault]))
    return 0 if completes else 1
