"""`eadp sweep`."""

from __future__ import annotations

import contextlib
import os
import re
import statistics
import sys
import time
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from eadp.cli.output import Progress, usage_fault, warn
from eadp.errors import printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eadp.io.sweep.results import Results
    from eadp.io.sweep.sweep_file import Sweep
    from eadp.simulation.sweep.design import Result
    from eadp.simulation.sweep.engines import DaskEngine, PoolEngine, SerialEngine

PROGRESS_S = 60.0
"""Between two lines of progress where there is no terminal [s]."""

WORTH_TELLING_S = 10.0
"""The shortest sweep whose time is estimated [s]."""

FIRST = 3
"""Runs, or one for each worker if that is more, before a sweep's time is estimated."""


class SweepFormat(StrEnum):
    """How a sweep is told."""

    text = "text"
    csv = "csv"
    jsonl = "jsonl"


class Figure(StrEnum):
    """What a table holds."""

    completed = "completed"
    duration_s = "duration_s"
    soc_final = "soc_final"
    quality = "quality"


def command(
    file: Annotated[str, typer.Argument(metavar="SWEEP.yaml", help="Sweep file, - for standard input.")],
    out: Annotated[
        str | None, typer.Option("-o", "--out", metavar="FILE", help="Keep results in this file, or go on with it.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, max=1024, help="Processes; default: one for each core.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler's workers, as in tcp://host:8786.")
    ] = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Part I of N alone, for an array of jobs on many machines.")
    ] = None,
    merge: Annotated[
        list[str] | None, typer.Option(metavar="FILE", help="Take over another file's results first; may repeat.")
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Try runs again that could not be made.")] = False,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="Set a scenario key in every run, as in time_limit_s=60.", metavar="KEY=VALUE"),
    ] = None,
    table: Annotated[
        tuple[str, str] | None, typer.Option(metavar="KEY1 KEY2", help="Means by two keys, over all others.")
    ] = None,
    value: Annotated[Figure, typer.Option(help="The table's figure.")] = Figure.completed,
    plot: Annotated[str | None, typer.Option(metavar="FILE", help="The table as a heat map, .svg or .png.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the runs; make none.")] = False,
    format_: Annotated[SweepFormat, typer.Option("--format", help="How to print.")] = SweepFormat.text,
) -> int:
    """Example: eadp sweep scenarios/sweep-wind-battery.yaml --dry-run

    Fly a plan many times: a grid, values that go together, a random sample, several seeds, or a product of these.

    With -o results are kept in a SQLite file as they come. Stopped at any moment, the same line makes what is missing.

    Exit code 0 if every run was made, whether its flight completes or not; 1 if some could not be made; 2 on bad input.
    """
    from eadp.cli import sweep_text
    from eadp.io.scenario.scenario_file import read_override
    from eadp.io.sweep.sweep_file import read_sweep
    from eadp.simulation.sweep.design import shard as part_of

    _check_options(out, jobs, scheduler, table, plot)
    part, parts = _shard(shard)
    sweep = read_sweep(file, dict(read_override(raw) for raw in set_ or []))
    _check_table(table, sweep)
    warn(sweep.warnings)
    indices = part_of(len(sweep.design), part, parts)
    if dry_run:
        made = _already_made(sweep, indices, out)
        sweep_text.print_runs(sweep, indices, format_.value, made)
        return 0
    with _results(out) as results:
        for other in merge or []:
            results.merge(other)
        results.expect(sweep.run(index).key for index in indices)
        if retry:
            results.forget_failures()
        _make(sweep, [indices[place] for place in results.missing()], results, out, jobs, scheduler)
        if format_ is SweepFormat.jsonl and table is None:
            return int(sweep_text.print_summaries(sweep, indices, results))
        flights = sweep_text.flights(sweep, indices, results)
    if table is not None:
        sweep_text.print_table(sweep, flights, table, value.value, format_.value, plot)
    elif format_ is SweepFormat.csv:
        sweep_text.print_csv(sweep, flights)
    else:
        sweep_text.print_answer(sweep, flights, out)
    return int(any(flight.error is not None for flight in flights))


# --- what is asked


def _check_options(
    out: str | None, jobs: int | None, scheduler: str | None, table: tuple[str, str] | None, plot: str | None
) -> None:
    if out == "-":
        raise usage_fault("--out", out, "results cannot go to standard output", "a file; --format prints them")
    if scheduler is not None and jobs is not None:
        raise usage_fault("--jobs", str(jobs), "a scheduler has its own workers", "--jobs or --scheduler")
    if scheduler is not None and not re.match(r"[a-z]+://.", scheduler):
        raise usage_fault("--scheduler", scheduler, f"{printable(scheduler)} is no address", "as in tcp://host:8786")
    if plot is not None and table is None:
        raise usage_fault("--plot", plot, "a picture of no table", "--table KEY1 KEY2 too")
    if plot is not None and os.path.splitext(plot)[1].lower() not in (".svg", ".png"):
        raise usage_fault("--plot", plot, "is no picture's name", "a name that ends in .svg or .png")


def _shard(raw: str | None) -> tuple[int, int]:
    if raw is None:
        return 1, 1
    found = re.fullmatch(r"([0-9]{1,7})/([0-9]{1,7})", raw)
    part, parts = (int(found[1]), int(found[2])) if found else (0, 0)
    if not 1 <= part <= parts:
        raise usage_fault("--shard", raw, f"{printable(raw)} is no part", "I/N with I from 1 to N, as in 3/8")
    return part, parts


def _check_table(table: tuple[str, str] | None, sweep: Sweep) -> None:
    known = dict.fromkeys((*sweep.design.names, "seed"))
    for key in table or ():
        if key not in known:
            what = f"the sweep does not vary {printable(key)}"
            raise usage_fault("--table", key, what, f"two of {', '.join(known)}")
    if table is not None and table[0] == table[1]:
        raise usage_fault("--table", table[0], "the same key twice", "two keys")


def _already_made(sweep: Sweep, indices: Sequence[int], out: str | None) -> int | None:
    """How many of the runs a results file has; None where there is no such file."""
    from eadp.io.sweep.results import Results

    if out is None or not os.path.exists(out):
        return None
    with contextlib.closing(Results(out, read_only=True)) as results:
        results.expect(sweep.run(index).key for index in indices)
        return sum(1 for _ in results.rows())


# --- making it so


def _results(out: str | None) -> contextlib.closing[Results]:
    from eadp.io.sweep.results import Results

    return contextlib.closing(Results(out))


def _make(
    sweep: Sweep, missing: Sequence[int], results: Results, out: str | None, jobs: int | None, scheduler: str | None
) -> None:
    """Make the runs that are missing."""
    from eadp.simulation.sweep.design import make_runs, spread

    if not missing:
        return
    engine = _engine(sweep, len(missing), jobs, scheduler)
    pace = _Pace(len(missing), engine.workers)
    try:
        for _, result in make_runs((sweep.run(index) for index in spread(missing)), engine, results):
            pace.made(result)
    except KeyboardInterrupt:
        pace.close()
        if out is not None:
            sys.stderr.write(f"sweep: {pace.done} of {len(missing)} runs made; the same line makes the rest\n")
        raise
    finally:
        engine.close()
        pace.close()


def _engine(
    sweep: Sweep, count: int, jobs: int | None, scheduler: str | None
) -> SerialEngine | PoolEngine | DaskEngine:
    from eadp.io.sweep.run import FlyRun
    from eadp.simulation.sweep.engines import DaskEngine, PoolEngine, SerialEngine, cores

    make = FlyRun(sweep.kept)
    if scheduler is not None:
        return DaskEngine(make, scheduler)
    processes = min(jobs or cores(), count)
    return PoolEngine(make, processes) if processes > 1 else SerialEngine(make)


class _Pace:
    """How far a sweep is, and how long it takes, on stderr."""

    def __init__(self, total: int, workers: int) -> None:
        self.done = 0
        self._failed = 0
        self._total = total
        self._workers = workers
        self._took_s: list[float] = []
        self._progress = Progress("sweep", PROGRESS_S)
        self._begun_s = time.monotonic()

    def made(self, result: Result) -> None:
        """One more run is made."""
        self.done += 1
        self._failed += result.error is not None
        if self.done <= self._first:
            self._took_s.append(result.took_s)
            if self.done == self._first:
                self._estimate()
        left_s = (time.monotonic() - self._begun_s) / self.done * (self._total - self.done)
        failed = f", {self._failed} could not be made" if self._failed else ""
        self._progress.show(f"{self.done} of {self._total} runs{failed}, {_time_text(left_s)} left")

    @property
    def _first(self) -> int:
        return max(FIRST, self._workers)

    def _estimate(self) -> None:
        """What the first runs, from all over the sweep, let one expect of the rest."""
        each_s, left = statistics.fmean(self._took_s), self._total - self.done
        whole_s = each_s * left / self._workers
        if whole_s >= WORTH_TELLING_S:
            times = f"{each_s:.2g} s each, {self._workers} at a time"
            sys.stderr.write(f"sweep: {left} more runs take about {_time_text(whole_s)} ({times})\n")
            sys.stderr.flush()

    def close(self) -> None:
        """Clear the line from a terminal."""
        self._progress.close()


def _time_text(time_s: float) -> str:
    if time_s < 90:
        return f"{time_s:.0f} s"
    return f"{time_s / 60:.0f} min" if time_s < 5400 else f"{time_s / 3600:.1f} h"
