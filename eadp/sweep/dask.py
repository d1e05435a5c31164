"""Workers of a Dask cluster."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from queue import Empty
from typing import Any

from eadp.errors import EadpError, InputError
from eadp.plug_ins import code_identity
from eadp.sweep.engines import Done, EngineOptions, Make, QueueEngine, first_line, make_task
from eadp.sweep.runs import Run

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

    @classmethod
    def chosen(cls, make: Make, options: EngineOptions) -> DaskEngine | None:
        """The engine, if there is a scheduler's address."""
        return None if options.scheduler is None else cls(make, options.scheduler)

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
            return self._client.submit(make_task, self._make, runs, pure=False)

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
