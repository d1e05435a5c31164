"""The runs of a sweep: each loaded from texts that are read once, flown without a log, and summarised."""

from __future__ import annotations

import gc
import itertools
import json
import math
import random
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from eadp.api.flight import fly_flight, repeatable
from eadp.api.given import File, Overrides, Warn, python_warnings
from eadp.api.inputs import Files, FlightInputs
from eadp.core.compiled import enable, enabled
from eadp.errors import EadpError, Fault, InputError, printable
from eadp.io.scenario import override_texts, read_overrides
from eadp.io.text.streams import read_text
from eadp.plug_ins import code_identity
from eadp.simulation.loop import Outcome, fly
from eadp.sweep.engines import Engine, Result, Run, open_engine
from eadp.sweep.results import Results, SweepFlight
from eadp.sweep.sweep_file import Sweep, load_run, read_sweep

DIED = "the process that made it died, alone and twice (out of memory?)"
COLLECTED_AFTER = 100_000
"""New objects after which Python looks for cycles during a flight: its 700 cost a fifteenth of the time."""


class FlyRun:
    """A function that makes runs and can be sent to another process.

    `fast` is whether flights are compiled if possible; `keep` is where their result folders go, by their keys.
    """

    def __init__(self, files: Files, *, fast: bool = True, keep: str | None = None) -> None:
        self._files = files
        self._keep = keep
        self._fast = fast
        self._warm = False

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "code": code_identity()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        sent_by = state.pop("code")
        if sent_by != code_identity():  # other code's flights may differ
            raise EadpError(f"it has {code_identity()}, and the sender {sent_by}")
        vars(self).update(state)

    def __call__(self, run: Run) -> Result:
        """Fly; any error is in the result."""
        if enable(self._fast) and not self._warm:
            self._warm = True
            self._warm_up(run)
        start_s, collected_after = time.perf_counter(), gc.get_threshold()
        gc.set_threshold(collected_after[0] and max(COLLECTED_AFTER, collected_after[0]))  # 0 is never
        try:
            return Result(self._summary(run), None, time.perf_counter() - start_s)
        except Exception as error:
            return Result(None, _message(error), time.perf_counter() - start_s)
        finally:
            gc.set_threshold(*collected_after)

    def _warm_up(self, run: Run) -> None:
        """Fly a step, so that machine code is loaded before runs are timed for the sweep's estimate."""
        with suppress(Exception):  # the run itself reports it
            inputs = self._inputs(run)
            clock = inputs.world.clock
            world = replace(inputs.world, clock=clock._replace(time_limit_s=clock.step_s))
            for _ in fly(world, inputs.flight(), Outcome()):
                pass

    def _inputs(self, run: Run) -> FlightInputs:
        """The inputs of a run, without a log where its folder is not kept."""
        inputs = load_run(self._files, run)
        if self._keep is not None:
            return inputs
        clock = inputs.world.clock._replace(log_every_s=math.inf)
        return replace(inputs, world=replace(inputs.world, clock=clock))

    def _summary(self, run: Run) -> dict[str, Any]:
        inputs = self._inputs(run)
        flight = fly_flight(inputs, overrides=override_texts(run.overrides))
        if self._keep is not None:
            flight.write(Path(self._keep) / run.key, force=True)
        summary = repeatable(flight.summary)
        json.dumps(summary, allow_nan=False)  # a figure that cannot be stored is this run's error
        return summary


@contextmanager
def missing_runs(
    sweep: Sweep, results: Results, jobs: int | None = None, scheduler: str | None = None, keep: str | None = None
) -> Iterator[tuple[int, int, Iterator[tuple[Run, Result]]]]:
    """The number of the runs that are not made yet, that of workers, and an iterator that makes them as it goes.

    The engine ends with the block. `keep` is where the flights' result folders go, if anywhere.
    """
    missing = results.missing()
    if not missing:
        yield 0, 1, iter(())
        return
    # at random: the first runs, from which the time is estimated, are of all the sweep, and two sweeps that write to
    # one file rarely make the same run at once
    random.shuffle(missing)
    engine = open_engine(FlyRun(sweep.kept, keep=keep), len(missing), jobs, scheduler)
    try:
        yield len(missing), engine.workers, make_runs(map(sweep.run, missing), engine, results)
    finally:
        engine.close()


def make_runs(runs: Iterable[Run], engine: Engine, results: Results) -> Iterator[tuple[Run, Result]]:
    """Make every run that is not made yet, here or by another process; each result is stored before it is yielded."""
    pending = iter(runs)
    while True:
        while (room := engine.room) > 0 and (batch := [*itertools.islice(pending, room)]):
            for run in results.unmade(batch):
                engine.submit(run)
        if not engine.busy:
            return
        made = [(run, result or Result(None, DIED)) for run, result in engine.finished()]
        results.store(made)
        yield from made


def _message(error: Exception) -> str:
    """An error in one line; a fault of an overridden key without its source."""
    if isinstance(error, InputError):
        return "; ".join(_fault(fault) for fault in error.faults)
    if isinstance(error, EadpError):
        return printable(str(error), 1000)
    return f"a bug: {type(error).__name__}: {printable(str(error), 1000)}"


def _fault(fault: Fault) -> str:
    head = str(replace(fault, source=""))
    return head.partition(": error: ")[2] if fault.file.startswith("--set") else head


def sweep(
    file: File | Mapping[str, Any],
    jobs: int | None = 1,
    *,
    overrides: Overrides = (),
    out: File | None = None,
    scheduler: str | None = None,
    warn: Warn = python_warnings,
) -> list[SweepFlight]:
    """Fly a plan many times: a grid, zipped values, a random sample, several seeds, or a product of these.

    Parameters
    ----------
    file : path or mapping
        A sweep file, or its keys, whose paths are relative to the working directory.
    jobs : int or None, optional
        Number of processes; None is one for each core. A script that asks for more than one needs the guard
        `if __name__ == "__main__"`.
    overrides : mapping, or iterable of str, optional
        Set in every run, as for `simulate`.
    out : path, optional
        Results file that keeps the runs; those that it has are not made again.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers make the runs.
    warn : function, optional

    Returns
    -------
    list of SweepFlight
        A row for each run, in order: the varied keys' values and the figures of its flight, or its error.

    Raises
    ------
    InputError
        With every fault of the first file that has any.
    """
    given = file if isinstance(file, Mapping) else read_text(str(file))
    checked = read_sweep(given, read_overrides(override_texts(overrides)))
    warn(checked.warnings)
    compiled = enabled()
    try:
        with closing(Results(None if out is None else str(out))) as results:
            results.expect(checked.keys())
            with missing_runs(checked, results, jobs, scheduler) as (_, _, made):
                for _ in made:
                    pass
            return checked.flights(results.rows())
    finally:
        enable(compiled)
