"""What engines share. There is no scheduling here: an engine holds a few runs more than it has workers.

`Make` is a function of a run that can be pickled.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

from eadp.errors import printable
from eadp.sweep.runs import Result, Run

Make = Callable[[Run], Result]

Done = tuple[list[Result], float]
"""Results of the runs of one task, and the time that they took [s]."""

QUEUED = 8
"""Tasks held for each worker: the current one and those that it makes meanwhile."""

GATHER_S, LOOK_S = 0.03, 0.002
"""Time in which finished runs are gathered, to be stored together, until half of the tasks are done; and time between
two looks [s]."""

TASK_S = 0.5
"""Time that the runs of a task shall take together [s]."""


@dataclass(frozen=True)
class EngineOptions:
    """What the choice of an engine depends on: the number of runs, of processes, and a scheduler's address."""

    runs: int
    jobs: int | None = None
    scheduler: str | None = None


class QueueEngine:
    """Base of engines whose tasks, of one run or of several short ones, are futures.

    Runs whose worker died are made again one by one; a run whose worker then dies too is given back with None.

    Futures that are done come through a queue: waiting on the futures themselves takes locks that Ctrl-C, raised while
    they are taken, would leave taken for ever.
    """

    workers: int
    largest_task = 1
    """Most runs of a task."""

    def __init__(self) -> None:
        self._size = 1  # the number of runs in a task to come
        self._next_task: list[Run] = []  # the runs taken for it so far
        self._under_way: dict[Any, list[Run]] = {}  # the runs of each future
        self._suspects: deque[Run] = deque()  # runs whose worker died, to be made one by one
        self._done: SimpleQueue[Any] = SimpleQueue()  # futures that are done
        self._broken = False  # whether workers have to be replaced

    @property
    def room(self) -> int:
        """The number of runs that it takes now: for `QUEUED` tasks of each worker, none while there are suspects."""
        tasks = QUEUED * self.workers - len(self._under_way)
        return 0 if self._suspects else tasks * self._size - len(self._next_task)

    @property
    def busy(self) -> int:
        """The number of runs taken and not given back."""
        return sum(map(len, self._under_way.values())) + len(self._next_task) + len(self._suspects)

    def submit(self, run: Run) -> None:
        """Take a run."""
        self._next_task.append(run)
        if len(self._next_task) >= self._size:
            self._start_task()

    def _start_task(self) -> None:
        """Send the runs taken as a task; its future reports itself when it is done."""
        runs, self._next_task = self._next_task, []
        future = self._send(runs)
        self._under_way[future] = runs
        future.add_done_callback(self._done.put)

    def finished(self) -> list[tuple[Run, Result | None]]:
        """Wait for runs, and give them back with their results; an empty list if all that ended lost their worker.

        Runs that lost their worker become suspects. Once nothing else is under way, one suspect is made alone: if its
        worker dies again, it is given back with None.
        """
        if self._next_task:  # the last runs
            self._start_task()
        alone = not self._under_way  # only suspects are left
        if alone:
            self._recover()
            self._size = 1
            self.submit(self._suspects.popleft())
        # one task, and those that are done soon after it
        results = self._ended()
        end_s = time.monotonic() + GATHER_S
        while 2 * self._done.qsize() < len(self._under_way) and time.monotonic() < end_s:
            time.sleep(LOOK_S)
        while not self._done.empty() or (self._broken and self._under_way):
            results += self._ended()
        self._recover()
        if alone:
            return results
        self._suspects.extend(run for run, result in results if result is None)
        return [(run, result) for run, result in results if result is not None]

    def _ended(self) -> list[tuple[Run, Result | None]]:
        """Wait for a task; return its runs, each with its result, None where the worker died.

        The time that the task took sets the size of the tasks to come.
        """
        future = self._next_done()
        runs, done = self._under_way.pop(future), self._result(future)
        if done is None:
            return [(run, None) for run in runs]
        results, took_s = done
        self._size = max(1, int(min(TASK_S * len(runs) / max(took_s, 1e-9), self.largest_task)))
        return [*zip(runs, results, strict=True)]

    def _next_done(self) -> Any:
        """Wait for a future that is done."""
        return self._done.get()

    def _send(self, runs: list[Run]) -> Any:
        """A future of the results of runs, as `make_task` gives them."""
        raise NotImplementedError

    def _result(self, future: Any) -> Done | None:
        """The results of a future that is done; None if its worker died."""
        raise NotImplementedError

    def _recover(self) -> None:
        """Replace broken workers."""


def make_task(make: Make, runs: list[Run]) -> Done:
    """Make the runs of a task, in a worker."""
    start_s = time.perf_counter()
    results = [make(run) for run in runs]
    return results, time.perf_counter() - start_s


def first_line(error: BaseException) -> str:
    """The first line of an error."""
    return printable((str(error) or type(error).__name__).splitlines()[0], 300)
