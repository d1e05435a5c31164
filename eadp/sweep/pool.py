"""A pool of processes on this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from eadp.sweep.engines import Done, EngineOptions, Make, QueueEngine, make_task
from eadp.sweep.runs import Run

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


def cores() -> int:
    """The number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS
        return os.cpu_count() or 1


class PoolEngine(QueueEngine):
    """A pool of processes. They end with this one, however it ends.

    A task is one run, whose result is short: of a result longer than a pipe takes at once, a process that is killed
    would leave a part in the pipe, and the reader would wait for the rest for ever.
    """

    def __init__(self, make: Make, jobs: int) -> None:
        super().__init__()
        self.workers = jobs
        self._make = make
        self._start()

    @classmethod
    def chosen(cls, make: Make, options: EngineOptions) -> PoolEngine | None:
        """The engine, if there is work for more than one process."""
        processes = min(options.jobs or cores(), options.runs)
        return cls(make, processes) if processes > 1 else None

    def _start(self) -> None:
        """Open a pool of processes, and the pipe whose closing ends them, see `_end_with`."""
        context = multiprocessing.get_context("spawn")
        self._worker_end, self._line = context.Pipe(duplex=False)
        self._broken = False
        self._executor = ProcessPoolExecutor(
            self.workers, mp_context=context, initializer=_start_worker, initargs=(self._make, self._worker_end)
        )

    def _start_task(self) -> None:
        """As `QueueEngine._start_task`; runs that a broken pool does not take become suspects."""
        runs = self._next_task
        try:
            # processes are started here, and inherit the mask: Ctrl-C is this process's to handle
            with _signals_held():
                super()._start_task()
        except BrokenProcessPool:
            self._broken = True
            self._suspects.extend(runs)

    def _send(self, runs: list[Run]) -> Future[Done]:
        """The future of a task in the pool."""
        return self._executor.submit(_work, runs)

    def _result(self, future: Future[Done]) -> Done | None:
        """The results of a task; None where the pool is broken."""
        try:
            return future.result()
        except BrokenProcessPool:  # a broken pool gives back all its runs at once
            self._broken = True
            return None

    def _recover(self) -> None:
        """Open another pool in place of a broken one."""
        if self._broken:
            self.close()
            self._start()

    def close(self) -> None:
        """End the processes at once; runs under way are dropped."""
        with _signals_held():
            self._line.close()  # processes in the middle of a run end too
            self._worker_end.close()
            self._executor.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _signals_held() -> Iterator[None]:
    """Ctrl-C and SIGTERM wait; a process started meanwhile never sees them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_make: Make | None = None


def _start_worker(make: Make, line: Connection) -> None:
    """Start a worker process: it keeps the function that makes runs, and watches the line to its parent."""
    global _make
    _make = make
    threading.Thread(target=_end_with, args=(line,), daemon=True).start()


def _end_with(line: Connection) -> None:
    """End this process when the parent's end of the line closes, as it does when the parent is killed."""
    with suppress(EOFError, OSError):
        line.recv_bytes()
    os._exit(0)


def _work(runs: list[Run]) -> Done:
    """Make the runs of a task in a worker process, which `_start_worker` has given the function."""
    assert _make is not None
    return make_task(_make, runs)
