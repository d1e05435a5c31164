"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from typer import Option

from eadp.planning.registry import PLANNERS

Format = StrEnum("Format", ["text", "json"])
"""Output formats that most commands share."""

PlannerName = StrEnum("PlannerName", {name: name for name in PLANNERS})  # type: ignore[misc]
"""Planners by name."""

VerboseOption = Annotated[bool, Option("-v", "--verbose", help="Say more: the papers' quantities, the solver's runs.")]
FormatOption = Annotated[Format, Option("--format", help="How to print.")]
ScenarioOption = Annotated[str | None, Option(help="Scenario (YAML).", metavar="FILE")]
ProfileOption = Annotated[
    str | None, Option(help="Computation profile: its model, or the measurements.", metavar="FILE")
]
AtOption = Annotated[
    list[str] | None,
    Option(
        "--at",
        help="Of a plan without computations: the configuration of the profile, a constant load [the highest].",
        metavar="NAME=VALUE,…",
    ),
]
EnergyOption = Annotated[str | None, Option(help="Energy model made by eadp fit.", metavar="FILE")]
PlannerOption = Annotated[PlannerName | None, Option(help="Which planner decides.")]
LapsOption = Annotated[
    int | None,
    Option(help="How many times a mission that repeats for ever is flown.", metavar="N", min=1, max=10_000),
]
SetOption = Annotated[
    list[str] | None,
    Option("--set", help="Set a scenario key, as in wind.speed_mps=8, spacing=20 or fps=5.", metavar="KEY=VALUE"),
]


def names_in(raw: str) -> list[str]:
    """The names of an option that lists them, separated by commas."""
    return [name.strip() for name in raw.split(",")] if raw else []


def load_overrides(at: list[str] | None) -> list[str]:
    """The overrides of the scenario that `--at` stands for."""
    from eadp.cli.output import usage_fault

    texts = [part.strip() for each in at or () for part in each.split(",")]
    for text in texts:
        if "=" not in text:
            raise usage_fault("--at", text, f"{text or 'an empty text'} is no name=value", "NAME=VALUE, as in fps=5")
    return [f"profile_at.{text}" for text in texts]
