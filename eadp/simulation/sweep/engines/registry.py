"""The one list of sweep engines. A new engine is a module with `chosen`, and a line here."""

from __future__ import annotations

from collections.abc import Callable

from eadp.models.sweep import Engine
from eadp.simulation.sweep.engines.base import EngineOptions, Make
from eadp.simulation.sweep.engines.dask import DaskEngine
from eadp.simulation.sweep.engines.pool import PoolEngine
from eadp.simulation.sweep.engines.serial import SerialEngine

ENGINES: dict[str, Callable[[Make, EngineOptions], Engine | None]] = {
    "dask": DaskEngine.chosen,
    "pool": PoolEngine.chosen,
    "serial": SerialEngine.chosen,
}
"""Engines by name, in the order in which they are asked; each is None where the options are not for it."""


def open_engine(make: Make, options: EngineOptions) -> Engine:
    """The first engine that the options are for."""
    return next(engine for choose in ENGINES.values() if (engine := choose(make, options)) is not None)
