"""`eadp export`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from typer import Argument, Option

from eadp.cli.options import LapsOption, ScenarioOption
from eadp.cli.output import emit, warn
from eadp.errors import printable
from eadp.io.mission import EXPORT_NAMES, ITEMS_ENDING, WITH_ITEMS

ExportName = StrEnum("ExportName", {name: name for name in EXPORT_NAMES})  # type: ignore[misc]
"""Formats by name."""


def command(
    plan: Annotated[
        str, Argument(help="Plan, or mission (QGroundControl's plan, WPL), - for standard input.", metavar="PLAN")
    ],
    to: Annotated[
        ExportName,
        Option(help="Plan of QGroundControl, WPL for ArduPilot, flight plan of Paparazzi, or a map or track."),
    ],
    altitude: Annotated[
        float | None,
        Option(help="Altitude above home [m], where the plan has none; by default the aircraft's.", metavar="METRES"),
    ] = None,
    home: Annotated[
        str | None, Option(help="Where to take off and return to: LAT,LON [°]; by default neither.", metavar="POINT")
    ] = None,
    origin: Annotated[
        str | None, Option(help="Where the plan's (0, 0) lies: LAT,LON [°], for a plan without.", metavar="POINT")
    ] = None,
    set_: Annotated[
        list[str] | None,
        Option("--set", help="A parameter, as in spacing=20; with --scenario any of its keys.", metavar="NAME=VALUE"),
    ] = None,
    scenario: ScenarioOption = None,
    trigger_distance: Annotated[
        float | None, Option(help="Take a picture every so many metres [m].", metavar="METRES")
    ] = None,
    tolerance: Annotated[
        float, Option(help="Largest distance of the exported path from the plan's [m].", metavar="METRES")
    ] = 1.0,
    min_radius: Annotated[
        float | None, Option(help="Turning radius of a mission's turns [m].", metavar="METRES")
    ] = None,
    laps: LapsOption = None,
    from_: Annotated[
        str | None, Option("--from", help="Write the rest, from this stage of this lap on.", metavar="STAGE,LAP")
    ] = None,
    telemetry: Annotated[
        str | None,
        Option(help="Write what is left where this telemetry ends, as then decided; with --scenario.", metavar="FILE"),
    ] = None,
    out: Annotated[str | None, Option("-o", "--out", help="Write it here.", metavar="FILE")] = None,
) -> int:
    """Example: eadp export plans/survey.plan --to qgc --origin 55.37,10.43 --set spacing=20

    Write a plan as the mission of an autopilot, or as a map: at parameters, by default each at its maximum; with
    --scenario at those that the forecast before take-off chooses, or those decided at the end of --telemetry.

    Beside the mission of an autopilot it writes FILE.items.json, by which `eadp replan` knows the stage of an item.

    Exit code 0 if it is written, 2 on bad input.
    """
    from eadp.api.export import ExportOptions, export

    options = ExportOptions(
        set_ or (), scenario, altitude, home, origin, trigger_distance, tolerance, min_radius, laps, from_, telemetry
    )
    written = export(plan, to.value, options, out, warn=warn)
    if out is None or out == "-":
        emit(written)
    else:
        also = f", {printable(out)}{ITEMS_ENDING}" if to.value in WITH_ITEMS else ""
        emit(f"written    {printable(out)}{also}")
    return 0
