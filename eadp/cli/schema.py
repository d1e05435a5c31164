"""`eadp schema`: the JSON Schema of a file format."""

from __future__ import annotations

import importlib
from typing import Annotated

from typer import Argument

from eadp.cli.output import emit_json, usage_fault

# each module has a function, `json_schema` if it has no other name, and is imported only for its own schema
_MODULES = {
    "profile": "eadp.io.profile.model_file",
    "energy": "eadp.io.energy.model_file",
    "scenario": "eadp.io.scenario.scenario_file",
    "vehicle": "eadp.io.vehicle.vehicle_file",
    "camera": "eadp.io.vehicle.camera_file",
    "sweep": "eadp.api.sweep.sweep_file",
    "telemetry": "eadp.io.telemetry.reader",
    "decision": "eadp.api.replan.decisions",
    "summary": "eadp.api.flight_schemas:summary",
    "decisions": "eadp.api.flight_schemas:decisions",
}
_NAMES = ", ".join(_MODULES)


def command(
    name: Annotated[str, Argument(metavar="NAME", help=f"File format: {_NAMES}.")],
) -> int:
    """Example: eadp schema profile

    Print the JSON Schema of a file format, for editors to check and complete files with.
    """
    if name not in _MODULES:
        raise usage_fault("NAME", name, "no such file format", _NAMES)
    module, _, function = _MODULES[name].partition(":")
    emit_json(getattr(importlib.import_module(module), function or "json_schema")())
    return 0
