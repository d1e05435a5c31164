"""What engines share. There is no scheduling here: an engine holds a few runs more than it has workers.

`Make` is a function of a run that can be pickled; it reaches each worker once.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

from eadp.errors import printable
from eadp.simulation.sweep.design import Result, Run

Make = Callable[[Run], Result]

QUEUED = 8
"""Runs held for each worker: the current one and those that it makes meanwhile."""

GATHER_S = 0.03
"""Time in which finished runs are gathered, to be stored together [s]."""


@dataclass(frozen=True)
class EngineOptions:
    """What the choice of an engine depends on: the number of runs, of processes, and a scheduler's address."""

    runs: int
    jobs: int | None = None
    scheduler: str | None = None


class QueueEngine:
    """Base of engines whose runs are futures.

    Runs whose worker died are made again one by one; a run whose worker then dies too is given back with None.

    Futures that are done come through a queue: waiting on the futures themselves takes locks that Ctrl-C, raised while
    they are taken, would leave taken for ever.
    """

    workers: int

    def __init__(self) -> None:
        self._under_way: dict[Any, Run] = {}
        self._suspects: deque[Run] = deque()
        self._done: SimpleQueue[Any] = SimpleQueue()
        self._broken = False

    @property
    def room(self) -> int:
        """The number of runs that it takes now."""
        return 0 if self._suspects else QUEUED * self.workers - len(self._under_way)

    @property
    def busy(self) -> int:
        """The number of runs taken and not given back."""
        return len(self._under_way) + len(self._suspects)

    def submit(self, run: Run) -> None:
        """Take a run."""
        future = self._send(run)
        self._under_way[future] = run
        future.add_done_callback(self._done.put)

    def finished(self) -> list[tuple[Run, Result | None]]:
        """Wait for runs; the list is empty if all those that ended lost their worker."""
        alone = not self._under_way
        if alone:
            self._recover()
            self.submit(self._suspects.popleft())
        results = [self._next()]
        if self._under_way:
            time.sleep(GATHER_S)
        while not self._done.empty() or (self._broken and self._under_way):
            results.append(self._next())
        self._recover()
        if alone:
            return results
        self._suspects.extend(run for run, result in results if result is None)
        return [(run, result) for run, result in results if result is not None]

    def _next(self) -> tuple[Run, Result | None]:
        future = self._done.get()
        return self._under_way.pop(future), self._result(future)

    def _send(self, run: Run) -> Any:
        """A future of a run's result."""
        raise NotImplementedError

    def _result(self, future: Any) -> Result | None:
        """The result of a future that is done; None if its worker died."""
        raise NotImplementedError

    def _recover(self) -> None:
        """Replace broken workers."""


def first_line(error: BaseException) -> str:
    """The first line of an error."""
    return printable((str(error) or type(error).__name__).splitlines()[0], 300)
