"""Where runs are made: in this process, in a pool of processes, or on a Dask cluster.

No scheduling of our own: an engine takes a few runs more than it has workers and gives them back made. `make` is a
function of a run that can be pickled; it reaches each worker once.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from eadp import __version__
from eadp.errors import EadpError, InputError, printable
from eadp.simulation.sweep.design import Result, Run

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Make = Callable[[Run], Result]
QUEUED = 2
"""Runs at hand for each worker: the one it makes and the next."""

CLUSTER_WAIT_S = 10
"""How long a Dask scheduler may take to answer [s]."""


def cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS
        return os.cpu_count() or 1


class SerialEngine:
    """Runs made in this process, one at a time."""

    workers = 1

    def __init__(self, make: Make) -> None:
        self._make = make
        self._runs: deque[Run] = deque()

    @property
    def room(self) -> int:
        """How many runs it would take now."""
        return 1 - len(self._runs)

    @property
    def busy(self) -> int:
        """How many runs it has."""
        return len(self._runs)

    def submit(self, run: Run) -> None:
        """Take a run."""
        self._runs.append(run)

    def finished(self) -> list[tuple[Run, Result | None]]:
        """Make the run it has."""
        run = self._runs.popleft()
        return [(run, self._make(run))]

    def close(self) -> None:
        """Nothing is left behind."""


class PoolEngine:
    """A pool of processes. They end with this one, however it ends.

    When a process dies, runs that were under way are made again one by one; one that kills its process then too is
    given back as such.

    Futures that are done come through a queue: waiting on the futures themselves takes locks that Ctrl-C, raised in the
    midst of taking them, would leave taken for ever.
    """

    def __init__(self, make: Make, jobs: int) -> None:
        self.workers = jobs
        self._make = make
        self._busy: dict[Future[Result], Run] = {}
        self._suspects: deque[Run] = deque()
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._worker_end, self._line = context.Pipe(duplex=False)
        self._done: SimpleQueue[Future[Result]] = SimpleQueue()
        self._broken = False
        self._executor = ProcessPoolExecutor(
            self.workers, mp_context=context, initializer=_begin, initargs=(self._make, self._worker_end)
        )

    @property
    def room(self) -> int:
        """How many runs it would take now."""
        return 0 if self._suspects else QUEUED * self.workers - len(self._busy)

    @property
    def busy(self) -> int:
        """How many runs it has and has not given back."""
        return len(self._busy) + len(self._suspects)

    def submit(self, run: Run) -> None:
        """Take a run."""
        try:
            # processes are started here, and inherit the mask: Ctrl-C is this process's to handle
            with _signals_held():
                future = self._executor.submit(_work, run)
                self._busy[future] = run
                future.add_done_callback(self._done.put)
        except BrokenProcessPool:
            self._broken = True
            self._suspects.append(run)

    def finished(self) -> list[tuple[Run, Result | None]]:
        """Wait for runs; none may be made when a process has died."""
        if not self._busy:
            if self._broken:
                self._restart()
            return self._again()
        made, lost = self._taken(self._done.get())
        while not self._done.empty():
            more, also_lost = self._taken(self._done.get())
            made, lost = made + more, lost + also_lost
        if lost:
            made += self._recovered(lost)
        return made

    def _taken(self, future: Future[Result]) -> tuple[list[tuple[Run, Result | None]], list[Run]]:
        """The result of a future that is done, or the run of one that has none because a process died."""
        run = self._busy.pop(future)
        try:
            return [(run, future.result())], []
        except BrokenProcessPool:
            return [], [run]

    def _recovered(self, lost: list[Run]) -> list[tuple[Run, Result | None]]:
        """Start anew after a process has died; results that came before are given back, the rest is made alone."""
        made: list[tuple[Run, Result | None]] = []
        while self._busy:  # a broken pool gives all back at once
            more, also_lost = self._taken(self._done.get())
            made += more
            lost += also_lost
        self._suspects.extend(lost)
        self._restart()
        return made

    def _again(self) -> list[tuple[Run, Result | None]]:
        """Make one run alone that was under way when a process died."""
        run = self._suspects.popleft()
        self.submit(run)
        made, lost = self._taken(self._done.get())
        if lost:
            self._restart()
        return made or [(run, None)]

    def _restart(self) -> None:
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


def _begin(make: Make, line: Connection) -> None:
    """A worker process begins: it keeps what it makes runs with, and watches the line to its parent."""
    global _make
    _make = make
    threading.Thread(target=_end_with, args=(line,), daemon=True).start()


def _end_with(line: Connection) -> None:
    """End this process when the parent's end of the line closes, as it does when the parent is killed."""
    with suppress(EOFError, OSError):
        line.recv_bytes()
    os._exit(0)


def _work(run: Run) -> Result:
    assert _make is not None
    return _make(run)


class DaskEngine:
    """Workers of a Dask scheduler that is running somewhere; each needs eadp of this version, and no files.

    Dask gives up a run that was at hand when several workers died, whether or not it was the one they died of: it is
    made again with no other under way.
    """

    def __init__(self, make: Make, address: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            what = "Dask is not installed"
            raise InputError.at("--scheduler", 1, 1, what, "pip install 'eadp[cluster]'", address) from None
        try:
            self._client = Client(address, timeout=CLUSTER_WAIT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            what = f"no scheduler answers: {_line(error)}"
            raise InputError.at("--scheduler", 1, 1, what, "the address of a running dask scheduler", address) from None
        with _told(address):
            # the result of a task and not scattered data: computed anew where the worker that holds it is lost
            self._make = self._client.submit(_same, make, pure=False)
        self._runs: dict[Any, Run] = {}
        self._suspects: deque[Run] = deque()
        self._done: SimpleQueue[Any] = SimpleQueue()
        self._address = address

    @property
    def workers(self) -> int:
        """Threads of all workers that the scheduler has now, 1 or more."""
        with _told(self._address):
            return max(1, int(sum(self._client.nthreads().values())))

    @property
    def room(self) -> int:
        """How many runs it would take now."""
        return 0 if self._suspects else QUEUED * self.workers - len(self._runs)

    @property
    def busy(self) -> int:
        """How many runs it has and has not given back."""
        return len(self._runs) + len(self._suspects)

    def submit(self, run: Run) -> None:
        """Take a run."""
        with _told(self._address):
            future = self._client.submit(_call, self._make, run, pure=False)
            self._runs[future] = run
            future.add_done_callback(self._done.put)

    def finished(self) -> list[tuple[Run, Result | None]]:
        """Wait for runs; none may be made when workers have died."""
        if not self._runs:
            self.submit(self._suspects.popleft())
            return [self._taken(self._done.get())]
        results = [self._taken(self._done.get())]
        while not self._done.empty():
            results.append(self._taken(self._done.get()))
        self._suspects.extend(run for run, result in results if result is None)
        return [(run, result) for run, result in results if result is not None]

    def _taken(self, future: Any) -> tuple[Run, Result | None]:
        from distributed import KilledWorker

        run = self._runs.pop(future)
        with _told(self._address):
            try:
                return run, future.result()
            except KilledWorker:
                return run, None
            except (OSError, CancelledError):
                raise
            except Exception as error:  # what `make` itself meets is in its result
                what = f"a worker of {self._address} makes no runs: {type(error).__name__}: {_line(error)}"
                raise EadpError(f"{what}; it needs eadp {__version__}") from None

    def close(self) -> None:
        """Drop the runs under way and leave the scheduler."""
        with suppress(Exception):
            self._client.cancel(list(self._runs))
        self._runs.clear()
        self._client.close()


def _same(make: Make) -> Make:
    return make


def _call(make: Make, run: Run) -> Result:
    return make(run)


@contextmanager
def _told(address: str) -> Iterator[None]:
    """A scheduler that is gone is an error in our words."""
    try:
        yield
    except (OSError, CancelledError) as error:
        raise EadpError(f"the scheduler at {address} is gone: {_line(error)}; what was made is kept") from None


def _line(error: BaseException) -> str:
    """The first line of an error."""
    return printable((str(error) or type(error).__name__).splitlines()[0], 300)
