"""`eadp sweep`: its options, progress, and what it prints: its runs, a row for each, and summaries."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from typer import Argument

from eadp.cli.output import Progress, alarm, emit, usage_fault, warn
from eadp.errors import printable
from eadp.io.scenario import read_overrides
from eadp.io.text.csv import write_rows
from eadp.io.text.json import aligned
from eadp.io.text.options import Flag
from eadp.io.text.streams import output_file, read_text, write_text
from eadp.plug_ins import plug_in
from eadp.sweep.engines import Result
from eadp.sweep.page import write_page
from eadp.sweep.results import COLUMNS, Results, SweepFlight, completed_interval, distinct, label_of
from eadp.sweep.run import missing_runs
from eadp.sweep.sweep_file import Sweep, read_sweep

PROGRESS_S = 60.0
"""Time between two lines of progress without a terminal [s]."""


@dataclass(frozen=True)
class SweepOptions:
    """Which runs are made, by whom, and where they are kept."""

    out: Annotated[str | None, Flag("-o --out", metavar="FILE")] = None
    """Keep results in this file, or continue it."""

    jobs: Annotated[int | None, Flag(low=1, high=1024)] = None
    """Processes; default: one for each core."""

    scheduler: Annotated[str | None, Flag(metavar="ADDRESS")] = None
    """A Dask scheduler's workers, as in tcp://host:8786."""

    set_: Annotated[Sequence[str], Flag(metavar="KEY=VALUE")] = ()
    """Set a scenario key in every run, as in time_limit_s=60."""

    keep: Annotated[str | None, Flag(metavar="DIR")] = None
    """Keep each flight's result folder here, linked from the page."""

    dry_run: bool = False
    """Print the runs; make none."""


@dataclass(frozen=True)
class SweepOutputs:
    """What is printed of the runs, and what is required of them."""

    require: Literal["completed", "reserve"] | None = None
    """Exit 1 unless every flight completes; or keeps the reserve, too."""

    junit: Annotated[str | None, Flag(metavar="FILE")] = None
    """Write the runs as a JUnit report of what is required [completed]."""

    strict_solver: bool = False
    """Exit 1 also where a run of the solver fails."""

    format: Literal["text", "csv"] = "text"
    """How to print."""


def command(
    file: Annotated[str, Argument(metavar="SWEEP.yaml", help="Sweep file, - for standard input.")],
    options: SweepOptions,
    output: SweepOutputs,
) -> int:
    """Example: eadp sweep scenarios/sweep-wind-battery.yaml --dry-run

    Fly a plan many times: a grid, zipped values, a random sample, several seeds, or a product of these.

    With -o results are stored in a SQLite file one by one. After a stop, the same command makes the missing runs, and
    those that could not be made again.
    Beside it is a page with heat map and curves, under its name with .html.

    Exit code 0 if every run was made, whether its flight completes or not; 1 if some could not be made, or are not what
    --require asks for; 2 on bad input.
    """
    _check_options(options, output)
    out = options.out
    if out is not None and not options.dry_run:
        plug_in("page", "check")(plug_in("page", "place")(out))
    if output.junit is not None:
        output_file(output.junit)
    sweep = read_sweep(read_text(file), read_overrides(options.set_))
    warn(sweep.warnings)
    keys = sweep.keys()
    if options.dry_run:
        print_runs(sweep, output.format, _already_made(out, keys))
        return 0
    with contextlib.closing(Results(out)) as results:
        results.expect(keys)
        _make(sweep, results, options)
        if out is not None:
            write_page(out, options.keep)
        flights = sweep.flights(results.rows())
    _warn_of_repeats(flights)
    if output.junit is not None:
        write_text(output.junit, junit_of(sweep, flights, output.require or "completed"))
    short = [each for each in flights if output.require is not None and not meets(each, output.require)]
    if output.format == "csv":
        print_csv(sweep, flights)
    else:
        print_answer(flights, out)
        _print_required(flights, short, output)
    if short:
        asked = f"what --require {output.require} asks for"
        sys.stderr.write(f"eadp: {len(short)} of {len(flights)} runs are not {asked}\n")
    failures = _solver_text(flights)
    alarm(failures)
    failed = output.strict_solver and failures is not None
    return int(bool(short) or failed or any(flight.error is not None for flight in flights))


def _warn_of_repeats(flights: Sequence[SweepFlight]) -> None:
    """Say where runs are of one flight."""
    made, own = sum(flight.error is None for flight in flights), len(distinct(flights))
    if own < made:
        few = f"{made} flights are {own} distinct ones"
        sys.stderr.write(f"sweep: warning: {few}: seeds change nothing where wind and sensors have no noise\n")


def _print_required(flights: Sequence[SweepFlight], short: Sequence[SweepFlight], output: SweepOutputs) -> None:
    """What the runs are required to be, of which `short` are not, and the report of it."""
    if output.require is not None:
        met = f"NO, not in {len(short)} of" if short else "yes, in all"
        emit(f"required   {output.require}: {met} {len(flights)} runs")
    if output.junit is not None:
        emit(f"written    {printable(output.junit)}")


def _solver_text(flights: Sequence[SweepFlight]) -> str | None:
    """Runs of the solver that failed in all flights, and the decisions of the fallback; None without any."""
    failed = [flight for flight in flights if flight.solver_failed or flight.fallbacks]
    if not failed:
        return None
    runs, fallbacks = (sum(getattr(each, name) or 0 for each in failed) for name in ("solver_failed", "fallbacks"))
    return (
        f"in {len(failed)} of {len(flights)} flights OSQP did not solve: "
        f"{fallbacks} decisions by the fallback, {runs} runs FAILED"
    )


# --- options


def _check_options(options: SweepOptions, output: SweepOutputs) -> None:
    scheduler = options.scheduler
    if options.out == "-":
        raise usage_fault("--out", "-", "results cannot go to standard output", "a file; --format prints them")
    if scheduler is not None and options.jobs is not None:
        raise usage_fault("--jobs", str(options.jobs), "a scheduler has its own workers", "--jobs or --scheduler")
    if scheduler is not None and not re.match(r"[a-z]+://.", scheduler):
        raise usage_fault("--scheduler", scheduler, f"{printable(scheduler)} is no address", "as in tcp://host:8786")


# --- runs


def _already_made(out: str | None, keys: Iterable[str]) -> int | None:
    """The number of the runs that a results file has; None without such a file."""
    if out is None or not os.path.exists(out):
        return None
    with contextlib.closing(Results(out, read_only=True)) as results:
        results.expect(keys)
        return sum(1 for _ in results.rows())


def _make(sweep: Sweep, results: Results, options: SweepOptions) -> None:
    """Make the runs that are missing, with the progress on stderr."""
    with missing_runs(sweep, results, options.jobs, options.scheduler, options.keep) as (missing, workers, made):
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
    """Progress of a sweep, and what is left of it, on stderr."""

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
        self._took_s += result.took_s
        failed = f", {self._failed} could not be made" if self._failed else ""
        self.show(f"{self.done} of {self._total} runs{failed}, {_time_text(self.left_s)} left")

    @property
    def left_s(self) -> float:
        """Time of the other runs, by the mean of those made [s]: the start of the workers is in none."""
        left = self._total - self.done
        return self._took_s / self.done * left / max(1, min(self._workers, left))


def _time_text(time_s: float) -> str:
    if time_s < 90:
        return f"{time_s:.0f} s"
    return f"{time_s / 60:.0f} min" if time_s < 5400 else f"{time_s / 3600:.1f} h"


SHOWN = 10
"""Number of runs that a dry run prints, and of kinds of errors in the summary."""

MAX_WIDTH = 40


# --- a dry run


def print_runs(sweep: Sweep, format_: str, made: int | None) -> None:
    """The runs that a sweep would make."""
    indices = range(len(sweep.design))
    names = _varied(sweep)
    if format_ == "csv":
        _write_csv((*names, "seed"), (_cells(sweep, names, index) for index in indices))
    else:
        emit(_runs_text(sweep, names, made))


def _runs_text(sweep: Sweep, names: Sequence[str], made: int | None) -> str:
    indices = range(len(sweep.design))
    lines = [f"{len(indices)} runs" + ("" if made is None else f", {made} made already")]
    shown = [_cells(sweep, names, index) for index in indices[:SHOWN]]
    rows = [[str(index), *map(_short, cells)] for index, cells in zip(indices, shown, strict=False)]
    lines += aligned([["run", *map(_short, names), "seed"], *rows], "<")
    if len(indices) > SHOWN:
        lines.append(f"… {len(indices) - SHOWN} more; --format csv prints all")
    return "\n".join(lines)


def _varied(sweep: Sweep) -> list[str]:
    """The varied keys without the seed, which every run has."""
    return [name for name in sweep.design.names if name != "seed"]


def _cells(sweep: Sweep, names: Sequence[str], index: int) -> list[str]:
    point = sweep.design.point(index)
    return [*(label_of(point.values[name]) for name in names), str(sweep.seed(point))]


# --- a row for each run


def print_csv(sweep: Sweep, all_flights: Iterable[SweepFlight]) -> None:
    """Print a row for each run; values that are neither numbers nor text are JSON."""
    names = _varied(sweep)
    columns = (*COLUMNS, "seed", "error")
    rows = (
        [*(each.values[name] for name in names), *(getattr(each, name) for name in columns)] for each in all_flights
    )
    _write_csv((*names, *columns), rows)


def _write_csv(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    texts = (["" if value is None else label_of(value) for value in row] for row in rows)
    write_rows(sys.stdout, itertools.chain([head], texts))


def junit_of(sweep: Sweep, all_flights: Sequence[SweepFlight], require: str) -> str:
    """The runs as a JUnit report: a test for each, which fails where it is not what is required."""
    import xml.etree.ElementTree as ET

    suite, name = ET.Element("testsuite"), printable(sweep.name)
    for flight in all_flights:
        values = [f"{key}={label_of(flight.values[key])}" for key in _varied(sweep)]
        title = printable(", ".join([*values, f"seed={flight.seed}"]))
        test = ET.SubElement(suite, "testcase", classname=name, name=title, time=f"{flight.took_s:.3f}")
        kept = "" if flight.soc_final is None else f"; state of charge {flight.soc_final:.3f} at the end"
        if flight.error is not None:
            ET.SubElement(test, "error", message=printable(flight.error, 2000))
        elif not meets(flight, require):
            ET.SubElement(test, "failure", message=printable(f"{flight.reason or 'not completed'}{kept}", 500))
        if (note := _solver_text([flight])) is not None:
            ET.SubElement(test, "system-out").text = printable(note, 2000)
    counts = {f"{kind}s": str(len(suite.findall(f"testcase/{kind}"))) for kind in ("failure", "error")}
    suite.attrib |= {"name": name, "tests": str(len(all_flights)), **counts}
    ET.indent(suite)
    return ET.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"


def meets(flight: SweepFlight, require: str) -> bool:
    """Whether a run is what is required: that it completes, and with `reserve` that it keeps the reserve."""
    return bool(flight.completed and (require != "reserve" or flight.reserve_kept))


# --- summaries


def print_answer(all_flights: Sequence[SweepFlight], out: str | None) -> None:
    """Print counts, and the share that completes."""
    made, own = [flight for flight in all_flights if flight.error is None], distinct(all_flights)
    failed = len(all_flights) - len(made)
    lines = [f"runs       {len(all_flights)}" + (f", {failed} could not be made" if failed else "")]
    if (interval := completed_interval(own)) is not None:
        completed, (low, high) = sum(bool(flight.completed) for flight in made), map(_percent, interval)
        of = "" if len(own) == len(made) else f" of {len(own)} distinct flights"
        share = f"{_percent(completed / len(made))} % (95 % interval{of} {low} to {high} %)"
        lines.append(f"completed  {completed} of {len(made)}: {share}")
    lines += [f"solver     {failures}" for failures in [_solver_text(all_flights)] if failures]
    if out is not None:
        lines.append(f"results    {printable(out)}, {printable(plug_in('page', 'place')(out).name)}")
    lines += _errors(all_flights)
    emit("\n".join(lines))


def _errors(all_flights: Sequence[SweepFlight]) -> list[str]:
    """The kinds of errors, with the first run of each."""
    first: dict[str, int] = {}
    for flight in all_flights:
        if flight.error is not None:
            first.setdefault(flight.error, flight.index)
    lines = [f"error      run {index}: {error}" for error, index in itertools.islice(first.items(), SHOWN)]
    return [*lines, f"error      … {len(first) - SHOWN} more kinds"] if len(first) > SHOWN else lines


def _short(text: str) -> str:
    return printable(text, MAX_WIDTH)


def _percent(share: float) -> str:
    return f"{100 * share:.1f}"
