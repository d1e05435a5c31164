"""Engines of sweeps: a pool of processes, a Dask cluster. None schedules: it holds a few runs more than it has workers.

`Make` is a function of a run that can be pickled.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from eadp.errors import EadpError, InputError, printable
from eadp.plug_ins import code_identity

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


@dataclass(frozen=True)
class Run:
    """One flight to make: a hash of all that it depends on, files by kind, and overrides of the scenario's keys."""

    key: str
    files: Mapping[str, str]
    overrides: Mapping[str, Any]


@dataclass(frozen=True)
class Result:
    """The summary of a run, or the error that prevented it, and the time it took [s]."""

    summary: Mapping[str, Any] | None
    error: str | None = None
    took_s: float = 0.0


Make = Callable[[Run], Result]

Done = tuple[list[Result], float]
"""Results of the runs of one task, and the time that they took [s]."""

QUEUED = 8
"""Tasks held for each worker: the current one and those that it makes meanwhile."""

TASK_S = 0.5
"""Time that the runs of a task shall take together [s]."""


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
        results = self._ended()
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


# --- this process


class SerialEngine:
    """Runs made in this process, one at a time."""

    workers = 1

    def __init__(self, make: Make) -> None:
        self._make = make
        self._runs: deque[Run] = deque()

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


# --- a pool of processes on this machine


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


# --- workers of a Dask cluster

CLUSTER_WAIT_S = 10
"""Longest time for a Dask scheduler to answer [s]."""

WORKERS_S = 1.0
"""Time between two questions for the number of its workers [s]."""

ALONE_S = 120.0
"""Longest time without a worker [s]: those that died are started again within some 10 s, by a loaded machine too."""


class DaskEngine(QueueEngine):
    """Workers of a running Dask scheduler; each needs the same code of eadp and plug-ins, and no files.

    Dask gives up a run that was held when several workers died, whether or not it was the one they died of: it is made
    again with no other under way.
    """

    largest_task = 1000
    """A task costs client and scheduler 9 ms: of a thousand runs, less than the runs' own results."""

    def __init__(self, make: Make, address: str) -> None:
        super().__init__()
        try:
            from distributed import Client
        except ImportError:
            what = "Dask is not installed"
            raise InputError.at("--scheduler", 1, 1, what, "pip install 'eadp[cluster]'", address) from None
        try:
            self._client = Client(address, timeout=CLUSTER_WAIT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            what = f"no scheduler answers: {first_line(error)}"
            raise InputError.at("--scheduler", 1, 1, what, "the address of a running dask scheduler", address) from None
        self._address = address
        self._threads, self._asked_s = 0, -WORKERS_S
        self._make = make  # sent with each task: what one worker holds for all is lost with it

    @property
    def workers(self) -> int:  # type: ignore[override]
        """The number of threads of all workers that the scheduler has, 1 or more; not older than `WORKERS_S`."""
        return max(1, self._count())

    def _count(self) -> int:
        """The number of threads of all workers; not older than `WORKERS_S`."""
        if time.monotonic() >= self._asked_s + WORKERS_S:
            with self._connection_errors():
                self._threads = int(sum(self._client.nthreads().values()))
            self._asked_s = time.monotonic()
        return self._threads

    def _next_done(self) -> Any:
        """As `QueueEngine._next_done`; an error once the scheduler has had no worker for `ALONE_S`."""
        seen_s = time.monotonic()
        while True:
            with suppress(Empty):
                return self._done.get(timeout=WORKERS_S)
            if self._count():
                seen_s = time.monotonic()
            elif time.monotonic() > seen_s + ALONE_S:
                what = f"the scheduler at {self._address} has had no workers for {ALONE_S:g} s"
                raise EadpError(f"{what}; the results so far are kept: start workers, and the same command goes on")

    def _send(self, runs: list[Run]) -> Any:
        """The future of a task on the cluster."""
        with self._connection_errors():
            # one object: Dask would look for its keys in every run of a list
            return self._client.submit(partial(make_task, self._make, runs), pure=False)

    def _result(self, future: Any) -> Done | None:
        """The results of a task; None where its workers died."""
        from distributed import KilledWorker

        with self._connection_errors():
            try:
                done: Done = future.result()
                return done
            except KilledWorker:
                return None
            except (OSError, CancelledError):
                raise
            except Exception as error:  # errors of `make` itself are in its result
                what = f"a worker of {self._address} makes no runs: {type(error).__name__}: {first_line(error)}"
                raise EadpError(f"{what}; workers need the same code as the client: {code_identity()}") from None

    def close(self) -> None:
        """Drop the runs under way and leave the scheduler."""
        with suppress(Exception):
            self._client.cancel(list(self._under_way))
        self._under_way.clear()
        self._client.close()

    @contextmanager
    def _connection_errors(self) -> Iterator[None]:
        """A lost scheduler is an error of its own."""
        try:
            yield
        except (OSError, CancelledError) as error:
            what = f"the scheduler at {self._address} is gone: {first_line(error)}"
            raise EadpError(f"{what}; the results so far are kept") from None


Engine = SerialEngine | PoolEngine | DaskEngine
"""Makes runs somewhere."""


def open_engine(make: Make, runs: int, jobs: int | None = None, scheduler: str | None = None) -> Engine:
    """The engine for a number of runs: of a scheduler's address, else a pool of processes, else of this process."""
    if scheduler is not None:
        return DaskEngine(make, scheduler)
    processes = min(jobs or cores(), runs)
    return PoolEngine(make, processes) if processes > 1 else SerialEngine(make)
