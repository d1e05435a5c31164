"""Runs made in this process, one at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from eadp.sweep.dask import DaskEngine
from eadp.sweep.engines import EngineOptions, Make
from eadp.sweep.pool import PoolEngine
from eadp.sweep.runs import Engine, Result, Run


class SerialEngine:
    """Runs made in this process, one at a time."""

    workers = 1

    def __init__(self, make: Make) -> None:
        self._make = make
        self._runs: deque[Run] = deque()

    @classmethod
    def chosen(cls, make: Make, options: EngineOptions) -> SerialEngine:
        """The engine; any options will do."""
        return cls(make)

    @property
    def room(self) -> int:
        """The number of runs that it takes now."""
        return 1 - len(self._runs)

    @property
    def busy(self) -> int:
        """The number of runs taken and not given back."""
        return len(self._runs)

    def submit(self, run: Run) -> None:
        """Take a run."""
        self._runs.append(run)

    def finished(self) -> list[tuple[Run, Result | None]]:
        """Make the run."""
        run = self._runs.popleft()
        return [(run, self._make(run))]

    def close(self) -> None:
        """Nothing is left to close."""


ENGINES: dict[str, Callable[[Make, EngineOptions], Engine | None]] = {
    "dask": DaskEngine.chosen,
    "pool": PoolEngine.chosen,
    "serial": SerialEngine.chosen,
}
"""Engines by name, in the order in which they are asked; each is None where the options are not for it."""


def open_engine(make: Make, options: EngineOptions) -> Engine:
    """The first engine that the options are for."""
    return next(engine for choose in ENGINES.values() if (engine := choose(make, options)) is not None)
