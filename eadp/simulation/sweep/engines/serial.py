"""Runs made in this process, one at a time."""

from __future__ import annotations

from collections import deque

from eadp.models.sweep import Result, Run
from eadp.simulation.sweep.engines.base import EngineOptions, Make


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
