"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from typer import Option

Format = StrEnum("Format", ["text", "json"])
"""Output formats that most commands share."""

FormatOption = Annotated[Format, Option("--format", help="How to print.")]
VerboseOption = Annotated[bool, Option("-v", "--verbose", help="Say more: the papers' quantities, the solver's runs.")]
LapsOption = Annotated[
    int | None,
    Option(help="How many times a mission that repeats for ever is flown.", metavar="N", min=1, max=10_000),
]


def names_in(raw: str) -> list[str]:
    """The names of an option that lists them, separated by commas."""
    return [name.strip() for name in raw.split(",")] if raw else []
