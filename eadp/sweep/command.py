"""`eadp sweep`."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument

from eadp.cli.output import Progress, emit, usage_fault, warn
from eadp.errors import printable
from eadp.io.text.options import Flag

if TYPE_CHECKING:
    from eadp.sweep.results import Results
    from eadp.sweep.runs import Result
    from eadp.sweep.sweep_file import Sweep

PROGRESS_S = 60.0
"""Time between two lines of progress without a terminal [s]."""

MIN_ESTIMATE_S = 10.0
"""Shortest estimate that is printed [s]."""

FIRST_RUNS = 3
"""Runs from which a sweep's time is estimated; one for each worker if that is more."""


@dataclass(frozen=True)
class SweepOptions:
    """Which runs are made, by whom, and where they are kept."""

    out: Annotated[str | None, Flag("-o --out", metavar="FILE")] = None
    """Keep results in this file, or continue it."""

    jobs: Annotated[int | None, Flag(low=1, high=1024)] = None
    """Processes; default: one for each core."""

    scheduler: Annotated[str | None, Flag(metavar="ADDRESS")] = None
    """A Dask scheduler's workers, as in tcp://host:8786."""

    retry: bool = False
    """Try again the runs that could not be made."""

    set_: Annotated[Sequence[str], Flag(metavar="KEY=VALUE")] = ()
    """Set a scenario key in every run, as in time_limit_s=60."""

    keep: Annotated[str | None, Flag(metavar="DIR")] = None
    """Keep each flight's result folder here, linked from the page."""

    dry_run: bool = False
    """Print the runs; make none."""


@dataclass(frozen=True)
class SweepOutputs:
    """What is printed of the runs, and what is required of them."""

    table: Annotated[tuple[str, str] | None, Flag(metavar="KEY1 KEY2")] = None
    """Means by two keys, over all others."""

    value: Literal["completed", "reserve_kept", "duration_s", "soc_final", "quality", "energy_wh", "distance_m"] = (
        "completed"
    )
    """The table's figure."""

    plot: Annotated[str | None, Flag(metavar="FILE")] = None
    """The table as a heat map, .svg or .png."""

    require: Literal["completed", "reserve"] | None = None
    """Exit 1 unless every flight completes; or keeps the reserve, too."""

    junit: Annotated[str | None, Flag(metavar="FILE")] = None
    """Write the runs as a JUnit report of what is required [completed]."""

    format: Literal["text", "csv", "jsonl"] = "text"
    """How to print."""


def command(
    file: Annotated[str, Argument(metavar="SWEEP.yaml", help="Sweep file, - for standard input.")],
    options: SweepOptions,
    output: SweepOutputs,
) -> int:
    """Example: eadp sweep scenarios/sweep-wind-battery.yaml --dry-run

    Fly a plan many times: a grid, zipped values, a random sample, several seeds, or a product of these.

    With -o results are stored in a SQLite file one by one. After a stop, the same command makes the missing runs.
    Beside it is a page with heat map and curves, under its name with .html.

    Exit code 0 if every run was made, whether its flight completes or not; 1 if some could not be made, or are not what
    --require asks for; 2 on bad input.
    """
    from eadp.io.page import check_page, page_of
    from eadp.io.scenario import read_overrides
    from eadp.io.text.streams import output_file, read_text, write_text
    from eadp.sweep import text as sweep_text
    from eadp.sweep.page import write_page
    from eadp.sweep.results import Results
    from eadp.sweep.statistics import totals
    from eadp.sweep.sweep_file import read_sweep

    _check_options(options, output)
    out, table, require = options.out, output.table, output.require
    if out is not None and not options.dry_run:
        check_page(page_of(out))
    if output.junit is not None:
        output_file(output.junit)
    sweep = read_sweep(read_text(file), read_overrides(options.set_))
    _check_table(table, sweep)
    warn(sweep.warnings)
    keys = sweep.keys()
    if options.dry_run:
        sweep_text.print_runs(sweep, output.format, _already_made(out, keys))
        return 0
    with contextlib.closing(Results(out)) as results:
        results.expect(keys)
        if options.retry:
            results.forget_failures()
        _make(sweep, results, options)
        if out is not None:
            write_page(out, options.keep)
        flights = sweep.flights(results.rows())
        whole = totals(flights)
        if whole.distinct < whole.flights:
            few = f"{whole.flights} flights are {whole.distinct} distinct ones"
            sys.stderr.write(f"sweep: warning: {few}: seeds change nothing where wind and sensors have no noise\n")
        if output.junit is not None:
            write_text(output.junit, sweep_text.junit_of(sweep, flights, require or "completed"))
        if output.format == "jsonl" and table is None:
            sweep_text.print_summaries(sweep, results)
    if table is not None:
        sweep_text.print_table(sweep, flights, table, output.value, output.format, output.plot)
    elif output.format == "csv":
        sweep_text.print_csv(sweep, flights)
    elif output.format == "text":
        sweep_text.print_answer(sweep, flights, out)
    short = [] if require is None else [flight for flight in flights if not sweep_text.meets(flight, require)]
    if output.format == "text" and table is None:
        if require is not None:
            met = f"NO, not in {len(short)} of" if short else "yes, in all"
            emit(f"required   {require}: {met} {len(flights)} runs")
        if output.junit is not None:
            emit(f"written    {printable(output.junit)}")
    if short:
        sys.stderr.write(f"eadp: {len(short)} of {len(flights)} runs are not what --require {require} asks for\n")
    return int(bool(short) or any(flight.error is not None for flight in flights))


# --- options


def _check_options(options: SweepOptions, output: SweepOutputs) -> None:
    scheduler, plot = options.scheduler, output.plot
    if options.out == "-":
        raise usage_fault("--out", "-", "results cannot go to standard output", "a file; --format prints them")
    if scheduler is not None and options.jobs is not None:
        raise usage_fault("--jobs", str(options.jobs), "a scheduler has its own workers", "--jobs or --scheduler")
    if scheduler is not None and not re.match(r"[a-z]+://.", scheduler):
        raise usage_fault("--scheduler", scheduler, f"{printable(scheduler)} is no address", "as in tcp://host:8786")
    if plot is not None and output.table is None:
        raise usage_fault("--plot", plot, "a picture of no table", "--table KEY1 KEY2 too")
    if plot is not None and os.path.splitext(plot)[1].lower() not in (".svg", ".png"):
        raise usage_fault("--plot", plot, "is no picture's name", "a name that ends in .svg or .png")


def _check_table(table: tuple[str, str] | None, sweep: Sweep) -> None:
    known = dict.fromkeys((*sweep.design.names, "seed"))
    for key in table or ():
        if key not in known:
            what = f"the sweep does not vary {printable(key)}"
            raise usage_fault("--table", key, what, f"two of {', '.join(known)}")
    if table is not None and table[0] == table[1]:
        raise usage_fault("--table", table[0], "the same key twice", "two keys")


# --- runs


def _already_made(out: str | None, keys: Iterable[str]) -> int | None:
    """The number of the runs that a results file has; None without such a file."""
    from eadp.sweep.results import Results

    if out is None or not os.path.exists(out):
        return None
    with contextlib.closing(Results(out, read_only=True)) as results:
        results.expect(keys)
        return sum(1 for _ in results.rows())


def _make(sweep: Sweep, results: Results, options: SweepOptions) -> None:
    """Make the runs that are missing, with the progress on stderr."""
    from eadp.core import compiled
    from eadp.sweep.run import missing_runs

    with missing_runs(sweep, results, options.jobs, options.scheduler, options.keep) as (missing, workers, made):
        if missing and options.scheduler is None:
            why = compiled.why_off()
            if why is None and not compiled.kept():
                sys.stderr.write(
                    "sweep: compiling for this machine first, for some seconds; later sweeps start at once\n"
                )
            elif why not in (None, compiled.NOT_INSTALLED):
                sys.stderr.write(f"sweep: flights are not compiled, and take longer: {why}\n")
            sys.stderr.flush()
        progress = _SweepProgress(missing, workers)
        try:
            for _, result in made:
                progress.add(result)
        except KeyboardInterrupt:
            progress.close()
            if options.out is not None:
                sys.stderr.write(f"sweep: {progress.done} of {missing} runs made; the same command makes the rest\n")
            raise
        finally:
            progress.close()


class _SweepProgress(Progress):
    """Progress of a sweep and an estimate of its time, on stderr."""

    def __init__(self, total: int, workers: int) -> None:
        super().__init__("sweep", PROGRESS_S)
        self.done = 0
        self._failed = 0
        self._total = total
        self._workers = workers
        self._took_s = 0.0

    def add(self, result: Result) -> None:
        """Count one more run."""
        self.done += 1
        self._failed += result.error is not None
        first = max(FIRST_RUNS, self._workers)
        self._took_s += result.took_s
        if self.done == first:
            self._estimate()
        failed = f", {self._failed} could not be made" if self._failed else ""
        self.show(f"{self.done} of {self._total} runs{failed}, {_time_text(self.left_s)} left")

    @property
    def left_s(self) -> float:
        """Time of the other runs, by the mean of those made [s]: the start of the workers is in none."""
        left = self._total - self.done
        return self._took_s / self.done * left / max(1, min(self._workers, left))

    def _estimate(self) -> None:
        """Print the time of the other runs, estimated from the first, which are distributed over the sweep."""
        from eadp.core import compiled

        if self.left_s >= MIN_ESTIMATE_S:
            left, times = self._total - self.done, f"{self._took_s / self.done:.2g} s each, {self._workers} at a time"
            sys.stderr.write(f"sweep: {left} more runs take about {_time_text(self.left_s)} ({times})\n")
            if compiled.why_off() == compiled.NOT_INSTALLED:
                sys.stderr.write("sweep: pip install 'eadp[fast]' compiles flights, which takes a fraction of that\n")
            sys.stderr.flush()


def _time_text(time_s: float) -> str:
    if time_s < 90:
        return f"{time_s:.0f} s"
    return f"{time_s / 60:.0f} min" if time_s < 5400 else f"{time_s / 3600:.1f} h"
