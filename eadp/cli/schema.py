"""`eadp schema`: the JSON Schema of a file format."""

from __future__ import annotations

import importlib
from typing import Annotated

from typer import Argument

from eadp.cli.output import emit_json, usage_fault
from eadp.io.text.yaml import schema_of

# the dataclass or model of each format, or a function of its schema; its module is imported only for it
_FORMATS = {
    "profile": "eadp.io.profile.model_file:ProfileFile",
    "energy": "eadp.io.energy:EnergyFile",
    "scenario": "eadp.io.scenario:json_schema",
    "vehicle": "eadp.io.vehicle:VehicleFile",
    "camera": "eadp.survey.camera:CameraFile",
    "sweep": "eadp.sweep.sweep_file:SweepKeys",
    "telemetry": "eadp.live.telemetry:TelemetryLine",
    "decision": "eadp.live.telemetry:DecisionLine",
    "items": "eadp.exchange.writer:ItemsFile",
}
_NAMES = ", ".join(_FORMATS)


def command(name: Annotated[str, Argument(metavar="NAME", help=f"File format: {_NAMES}.")]) -> int:
    """Example: eadp schema profile

    Print the JSON Schema of a file format, for editors to check and complete files with.
    """
    if name not in _FORMATS:
        raise usage_fault("NAME", name, "no such file format", _NAMES)
    module, _, attribute = _FORMATS[name].partition(":")
    found = getattr(importlib.import_module(module), attribute)
    schema = schema_of(found) if isinstance(found, type) else found()
    emit_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema})
    return 0
