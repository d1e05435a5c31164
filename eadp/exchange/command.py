"""`eadp export`."""

from __future__ import annotations

from typing import Annotated

from typer import Argument, Option

from eadp.cli.output import emit, warn
from eadp.errors import Fault, Infeasible, printable
from eadp.exchange.export import ExportOptions, export
from eadp.exchange.path import EXPORT_NAMES, ITEMS_ENDING, WITH_ITEMS


def command(
    plan: Annotated[
        str, Argument(help="Plan, or mission (QGroundControl's plan, WPL), - for standard input.", metavar="PLAN")
    ],
    to: Annotated[
        str,
        Option(
            help="Plan of QGroundControl (px4: for PX4), WPL for ArduPilot, flight plan of Paparazzi, a map or track.",
            metavar=f"[{'|'.join(EXPORT_NAMES)}]",
        ),
    ],
    options: ExportOptions,
    out: Annotated[str | None, Option("-o", "--out", help="Write it here.", metavar="FILE")] = None,
) -> int:
    """Example: eadp export plans/survey.plan --to qgc --origin 55.37,10.43 --set spacing=20

    Write a plan as the mission of an autopilot, or as a map: at parameters, by default each at its maximum; with
    --scenario at those that the forecast before take-off chooses, or those decided at the end of --telemetry.

    Beside the mission of an autopilot it writes FILE.items.json, by which `eadp replan` knows the stage of an item.

    Exit code 0 if it is written; 1 if PX4 would not arm it, or the flight is forecast to enter an obstacle or to leave
    its boundary; 2 on bad input.
    """
    try:
        written = export(plan, to, options, out, warn=warn)
    except Infeasible as error:
        warn([Fault("<stdin>" if plan == "-" else plan, 1, 1, str(error), error.advice)])
        return 1
    if out is None or out == "-":
        emit(written)
    else:
        also = f", {printable(out)}{ITEMS_ENDING}" if to in WITH_ITEMS else ""
        emit(f"written    {printable(out)}{also}")
    return 0
