"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from eadp.planning.registry import PLANNERS


class Format(StrEnum):
    """Output formats that most commands share."""

    text = "text"
    json = "json"


PlannerName = StrEnum("PlannerName", {name: name for name in PLANNERS})  # type: ignore[misc]
"""Planners by name."""

FormatOption = Annotated[Format, typer.Option("--format", help="How to print.")]
PlotOption = Annotated[str | None, typer.Option(help="Draw it: FILE.svg or FILE.png.", metavar="FILE")]
ScenarioOption = Annotated[str | None, typer.Option(help="Scenario (YAML).", metavar="FILE")]
ProfileOption = Annotated[
    str | None, typer.Option(help="Computation profile: its model, or the measurements.", metavar="FILE")
]
EnergyOption = Annotated[str | None, typer.Option(help="Energy model made by eadp fit.", metavar="FILE")]
PlannerOption = Annotated[PlannerName | None, typer.Option(help="Which planner decides.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", help="Set a scenario key, as in wind.speed_mps=8 or c1=-500.", metavar="KEY=VALUE"),
]
