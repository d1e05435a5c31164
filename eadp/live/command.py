"""`eadp replan`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Annotated, Any

from typer import Argument

from eadp.api.given import FlightOptions
from eadp.cli.output import alarm, warn
from eadp.live.link import LinkOptions
from eadp.live.replan import ReplanOptions, replan
from eadp.live.telemetry import json_line
from eadp.planning.base import BY_FALLBACK


@dataclass(frozen=True)
class ReplanOutputs:
    """What the exit code says."""

    strict_solver: bool = False
    """Exit 1 also where the solver fails, and decisions are made without it."""


def command(
    plan: Annotated[str, Argument(help="Plan, or mission (QGroundControl's plan, WPL).", metavar="PLAN")],
    flight: FlightOptions,
    options: ReplanOptions,
    link: LinkOptions,
    output: ReplanOutputs,
) -> int:
    """Example: eadp replan plans/survey.plan --scenario scenarios/survey.yaml --telemetry
    scenarios/example-telemetry.jsonl

    The planner on a live or recorded flight: telemetry in, decisions out, as JSON lines. The scenario gives battery,
    aircraft and planner; its simulated world is unused.

    A line in has time_s, x_m, y_m, power_w and soc; lat_deg and lon_deg in place of x_m and y_m, current_consumed_ah
    in place of soc; stage, stages_started, flies_mission (the autopilot flies a list of items; false: a
    pilot flies, or it holds), returns_home (the autopilot flies home), wind_mps, velocity_mps, airspeed_mps,
    altitude_m, voltage_v, heading_deg and parameters are optional. A line out has time_s, stage, parameters,
    soc_end_forecast, completes_probability, reason, warnings and more. An invalid value gives a warning and counts as
    null; an invalid line is skipped.

    With --mavlink the lines are made of an autopilot's messages while it flies, and decisions are sent to it, too, as
    NAMED_VALUE_FLOAT and STATUSTEXT. Nothing is commanded but, with --return-home, a return, and, with
    --command-airspeed, an airspeed; nothing is written but, with --upload, the rest of the mission. It ends when the
    aircraft has flown and is disarmed.

    Exit code 0 if the plan is complete or forecast to be at the last line, 1 if not, 2 on bad input.
    """

    failed_s = list[float]()

    def decided(line: dict[str, Any]) -> None:
        if BY_FALLBACK in line["reason"]:
            if not failed_s:
                alarm(f"OSQP does not solve, at {line['time_s']:g} s: decisions are made without it")
            failed_s.append(line["time_s"])
        sys.stdout.write(json_line(line))
        sys.stdout.flush()

    finishes = replan(plan, options, flight, link, decided=decided, warn=warn)
    if failed_s:
        alarm(f"OSQP did not solve: {len(failed_s)} decisions by the fallback, the last at {failed_s[-1]:g} s")
    return 0 if finishes and not (output.strict_solver and failed_s) else 1
