"""An aircraft's performance as a JSON-ready document."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from eadp.io.vehicle.vehicle_file import VehicleFile
from eadp.models.performance import Performance


def document(vehicle: VehicleFile, found: Performance) -> dict[str, Any]:
    """The values of `eadp.performance/1`."""
    return {"schema": "eadp.performance/1", "name": vehicle.name, "model": vehicle.airframe.model, **asdict(found)}
