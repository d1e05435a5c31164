"""What is given to the use cases: paths or objects, settings, and where warnings go."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Annotated, Any

from eadp.errors import Fault, InputError
from eadp.io.text.options import Flag

File = str | PathLike[str]
Overrides = Mapping[str, Any] | Iterable[str]
Warn = Callable[[Sequence[Fault]], None]
"""Takes warnings."""


@dataclass(frozen=True)
class FlightOptions:
    """What a flight is of, beside its plan."""

    scenario: Annotated[str | None, Flag(metavar="FILE")] = None
    """Scenario (YAML)."""

    profile: Annotated[str | None, Flag(metavar="FILE")] = None
    """Computation profile: its model, or the measurements."""

    at: Annotated[Sequence[str], Flag(metavar="NAME=VALUE,…")] = ()
    """Of a plan without computations: the configuration of the profile, a constant load [the highest]."""

    energy: Annotated[str | None, Flag(metavar="FILE")] = None
    """Energy model made by eadp fit."""

    planner: Annotated[str | None, Flag(metavar="NAME")] = None
    """Which planner decides: joint, paper, static, or one that is installed."""

    set_: Annotated[Sequence[str], Flag(metavar="KEY=VALUE")] = ()
    """Set a scenario key, as in wind.speed_mps=8, spacing=20 or fps=5."""

    @property
    def overrides(self) -> list[str]:
        """Keys of the scenario that are set, those of a load of `at` too; raises InputError."""
        load = [part.strip() for each in self.at for part in each.split(",")]
        for text in load:
            if "=" not in text:
                message = f"{text or 'an empty text'} is no name=value"
                raise InputError.at("--at", 1, 1, message, "NAME=VALUE, as in fps=5", text)
        return [*self.set_, *(f"profile_at.{text}" for text in load)]


def python_warnings(faults: Sequence[Fault]) -> None:
    for fault in faults:
        warnings.warn(str(fault), stacklevel=3)
