"""What is given to the use cases: paths or objects, settings, and where warnings go."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from typing import Any

from eadp.errors import Fault
from eadp.io.plan import writer
from eadp.io.profile import model_file
from eadp.io.scenario.scenario_file import value_text
from eadp.io.text.streams import Text
from eadp.models.energy import EnergyModel
from eadp.models.plan.plan import Plan

File = str | PathLike[str]
Overrides = Mapping[str, Any] | Iterable[str]
Warn = Callable[[Sequence[Fault]], None]
"""Takes warnings."""


def python_warnings(faults: Sequence[Fault]) -> None:
    for fault in faults:
        warnings.warn(str(fault), stacklevel=3)


def path_of(given: Any, texts: dict[str, Text], schema: str = "") -> str:
    """The path of a file; an object becomes the text of its file, under the name that is returned."""
    if isinstance(given, str | PathLike):
        return str(given)
    if isinstance(given, Plan):
        text = Text("given.plan", writer.plan_text(given))
    elif isinstance(given, EnergyModel):
        from eadp.io.energy.model_file import energy_yaml

        text = Text("given-energy.yaml", energy_yaml(given))
    elif isinstance(given, Mapping):
        text = Text("given-keys.yaml", value_text({"schema": schema, **given}))
    else:
        text = Text("given-profile.yaml", model_file.profile_yaml(given))
    texts[text.name] = text
    return text.name
