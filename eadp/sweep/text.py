"""Output of `eadp sweep`: its runs, a row for each, and summaries."""

from __future__ import annotations

import csv
import itertools
import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from eadp.cli.output import emit, json_text
from eadp.errors import printable
from eadp.io.page import page_of
from eadp.io.text.json import aligned
from eadp.sweep.results import COLUMNS, Results
from eadp.sweep.statistics import (
    Group,
    SweepFlight,
    Table,
    distinct,
    label_of,
    marginal,
    table,
    totals,
    wilson_interval,
)
from eadp.sweep.sweep_file import Sweep

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
    elif format_ == "jsonl":
        for index in indices:
            _print_line(_head(sweep, index))
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


def _head(sweep: Sweep, index: int) -> dict[str, Any]:
    point = sweep.design.point(index)
    return {"run": index, "varied": dict(point.values), "seed": sweep.seed(point)}


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
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(["" if value is None else label_of(value) for value in row] for row in rows)


def junit_of(sweep: Sweep, all_flights: Sequence[SweepFlight], require: str) -> str:
    """The runs as a JUnit report: a test for each, which fails where it is not what is required."""
    from eadp.cli.junit import Case, junit_text

    cases = []
    for flight in all_flights:
        values = [f"{key}={label_of(flight.values[key])}" for key in _varied(sweep)]
        kept = "" if flight.soc_final is None else f"; state of charge {flight.soc_final:.3f} at the end"
        wrong = None if meets(flight, require) else f"{flight.reason or 'not completed'}{kept}"
        title = ", ".join([*values, f"seed={flight.seed}"])
        kind = "failure" if flight.error is None else "error"
        cases.append(Case(title, flight.took_s, flight.error or wrong, kind))
    return junit_text(sweep.name, cases)


def meets(flight: SweepFlight, require: str) -> bool:
    """Whether a run is what is required: that it completes, and with `reserve` that it keeps the reserve."""
    return bool(flight.completed and (require != "reserve" or flight.reserve_kept))


def print_summaries(sweep: Sweep, results: Results) -> None:
    """Print a JSON object a line for each run, with its whole summary."""
    for index, row in enumerate(results.rows(summaries=True)):
        _print_line({**_head(sweep, index), "error": row["error"], "summary": row["summary"]})


def _print_line(document: dict[str, Any]) -> None:
    emit(json_text(document))


# --- summaries


def print_answer(sweep: Sweep, all_flights: Sequence[SweepFlight], out: str | None) -> None:
    """Print counts, the share that completes, and the figures for each value of each varied key."""
    whole = totals(all_flights)
    lines = [f"runs       {whole.runs}" + (f", {whole.failed} could not be made" if whole.failed else "")]
    if whole.interval is not None:
        low, high = (_percent(end) for end in whole.interval)
        share = _percent(whole.completed / whole.flights)
        of = "" if whole.distinct == whole.flights else f" of {whole.distinct} distinct flights"
        lines.append(
            f"completed  {whole.completed} of {whole.flights}: {share} % (95 % interval{of} {low} to {high} %)"
        )
    lines += _batteries(all_flights)
    if out is not None:
        lines.append(f"results    {printable(out)}, {printable(page_of(out).name)}")
    lines += _errors(all_flights)
    keys = list(dict.fromkeys((*sweep.design.names, *(["seed"] if sweep.design.seeds else []))))
    for key in keys if whole.flights else []:
        lines += ["", *_marginal_lines(key, marginal(all_flights, key, sweep.design.listed(key)))]
    emit("\n".join(lines))


def _batteries(all_flights: Sequence[SweepFlight]) -> list[str]:
    """Of jobs of several sorties, with what probability they are done with so many batteries."""
    made = [flight for flight in all_flights if flight.batteries is not None]
    if all(flight.batteries == 1 for flight in made):
        return []
    own = distinct(made)
    done = Counter(flight.batteries for flight in own if flight.completed and flight.reserve_kept)
    lines, so_far = [], 0
    for count in sorted(filter(None, done)):
        so_far += done[count]
        low, high = (_percent(end) for end in wilson_interval(so_far, len(own)))
        share = _percent(so_far / len(own))
        lines.append(f"batteries  {count}: the job is done, with all reserves kept, in {share} % ({low} to {high} %)")
    return lines or ["batteries  no job is done with all reserves kept"]


def _errors(all_flights: Sequence[SweepFlight]) -> list[str]:
    """The kinds of errors, with the first run of each."""
    first: dict[str, int] = {}
    for flight in all_flights:
        if flight.error is not None:
            first.setdefault(flight.error, flight.index)
    lines = [f"error      run {index}: {error}" for error, index in itertools.islice(first.items(), SHOWN)]
    return [*lines, f"error      … {len(first) - SHOWN} more kinds"] if len(first) > SHOWN else lines


def _marginal_lines(key: str, groups: Sequence[Group]) -> list[str]:
    rows = [[_short(key), "flights", "completed [%]", "of these: duration, median [s]", "SoC at the end, median"]]
    for group in groups:
        share = "" if math.isnan(group.completed) else _percent(group.completed)
        duration = "" if math.isnan(group.duration_s) else f"{group.duration_s:.1f}"
        charge = "" if math.isnan(group.soc_final) else f"{group.soc_final:.3f}"
        rows.append([_short(group.label), str(group.flights), share, duration, charge])
    return aligned(rows, "<")


def print_table(
    sweep: Sweep, all_flights: Sequence[SweepFlight], keys: tuple[str, str], value: str, format_: str, plot: str | None
) -> None:
    """Print means by two keys, and draw them."""
    means = table(all_flights, keys, value, {key: sweep.design.listed(key) for key in keys})
    if plot is not None:
        from eadp.sweep.page import write_table_figure

        write_table_figure(plot, means)
    if format_ == "text":
        emit("\n".join(_table_lines(means)))
        return
    columns = (*keys, value, "flights", "not_completed")
    if format_ == "csv":
        _write_csv(columns, _table_rows(means))
    else:
        for line in _table_rows(means):
            _print_line(dict(zip(columns, line, strict=True)))


def _table_rows(means: Table) -> Iterator[tuple[str, str, float | None, int, int]]:
    for i, row in enumerate(means.rows):
        for j, column in enumerate(means.columns):
            yield row, column, means.means[i][j], means.flights[i][j], means.crashed[i][j]


def _table_lines(means: Table) -> list[str]:
    digits = 1 if means.value in ("duration_s", "distance_m") else 3
    rows = [
        [_short(label), *(means.text(i, j, digits) for j in range(len(means.columns)))]
        for i, label in enumerate(means.rows)
    ]
    title = f"{means.value}, mean; {printable(means.keys[0])} downwards, {printable(means.keys[1])} to the right"
    fell = "; ×: flights not completed, in no mean" if any(map(any, means.crashed)) else ""
    return [title + fell, *aligned([["", *map(_short, means.columns)], *rows], "<")]


def _short(text: str) -> str:
    return printable(text, MAX_WIDTH)


def _percent(share: float) -> str:
    return f"{100 * share:.1f}"
