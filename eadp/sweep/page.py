"""The data of a sweep's page: counts over all runs, and the runs themselves, or a random sample of them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from eadp.api.given import PageSource
from eadp.errors import printable
from eadp.io.text.json import significant
from eadp.io.text.streams import write_text
from eadp.plug_ins import plug_in
from eadp.sweep.results import COLUMNS, Results, SweepFlight, completed_interval, distinct, label_of, wilson_interval

MAX_RUNS = 20_000
MAX_BYTES = 2_500_000
"""Most bytes of the runs in a page: of more, a random sample is kept."""

LABEL = 100
"""Most characters of a value that is text, and of an error."""

FIGURES = ("duration_s", "soc_final", "quality")


def sweep_data(path: str, page: Path, keep: str | None = None) -> dict[str, Any]:
    """The data of the page of a results file.

    Parameters
    ----------
    path : str
        The results file.
    page : Path
        Where the page goes: its links are relative to it.
    keep : str, optional
        Where the runs' folders are.

    Raises
    ------
    InputError
        If it is no results file, or is damaged.
    """
    with closing(Results(path, read_only=True)) as results:
        completed, reasons, errors = map(results.counts, ("completed", "reason", "error"))
        kept = [_KeptRun.of(row) for row in results.everything(MAX_RUNS)]
    names = _varied(kept)
    while len(json.dumps(runs := _runs(kept, names, keep))) > MAX_BYTES:
        kept = kept[: len(kept) // 2]
    flights = [each.flight(i, names) for i, each in enumerate(kept)]
    failed, count = sum(errors.values()), sum(errors.values()) + sum(reasons.values())
    own = {flight.index for flight in distinct(flights)}
    runs["distinct"] = [int(flight.index in own) for flight in flights]
    words = sweep_words(count, completed.get(1, 0), reasons, errors, flights)
    return {
        "title": Path(path).name,
        "words": words,
        "completed": None,
        "count": count,
        "failed": failed,
        "keys": names,
        "folder": None if keep is None else Path(os.path.relpath(keep, page.parent)).as_posix(),
        "runs": runs,
    }


def write_page(path: str, keep: str | None = None) -> None:
    """Write the page of a results file beside it. `keep` is where the runs' folders are."""
    page = plug_in("page", "place")(path)
    write_text(str(page), plug_in("page", "html")("sweep", sweep_data(path, page, keep)))


SQLITE = b"SQLite format 3\0"


def _is_database(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(SQLITE)) == SQLITE
    except (OSError, ValueError):  # its fault is that of a text
        return False


PAGE = PageSource("sweep", _is_database, lambda path, page, keep: sweep_data(str(path), page, keep))


class _KeptRun(NamedTuple):
    """A run of the page: its key, what it was made with, and its row in the results."""

    key: str
    values: Mapping[str, Any]
    row: Mapping[str, Any]

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> _KeptRun:
        """That of a row."""
        return cls(row["key"], {**row["files"], **row["overrides"], "seed": row["seed"]}, row)

    def flight(self, index: int, names: Sequence[str]) -> SweepFlight:
        """Its values of some names, and its figures."""
        values, figures = {name: self.values.get(name) for name in names}, (*COLUMNS, "error")
        own = {name: self.row[name] for name in figures}
        return SweepFlight(index=index, values=values, seed=self.values["seed"], **own)


def _varied(kept: Sequence[_KeptRun]) -> list[str]:
    """Names of what differs between runs, the seed last."""
    first = kept[0].values if kept else {}
    names = {name for each in kept for name in {**first, **each.values} if first.get(name) != each.values.get(name)}
    return sorted(names, key=lambda name: (name == "seed", name))


def _runs(kept: Sequence[_KeptRun], names: Sequence[str], keep: str | None) -> dict[str, Any]:
    """Runs by column; values that are not all numbers by their number in a list."""
    rows = [each.row for each in kept]
    columns: dict[str, Any] = {name: _column([each.values.get(name) for each in kept]) for name in names}
    texts = {name: _column([row[name] for row in rows]) for name in ("reason", "error")}
    figures = {name: [significant(row[name]) for row in rows] for name in FIGURES}
    flown: dict[str, Any] = {"completed": [None if row["completed"] is None else int(row["completed"]) for row in rows]}
    if keep is not None:
        pages = [os.path.join(keep, each.key, "report.html") for each in kept]
        flown["folder"] = [each.key if os.path.isfile(page) else None for each, page in zip(kept, pages, strict=True)]
    return {"values": columns, **texts, **figures, **flown}


def _column(values: Sequence[Any]) -> Any:
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [value if isinstance(value, int) else significant(value) for value in values]
    known: dict[str, int] = {}
    places = [None if value is None else known.setdefault(label_of(value)[:LABEL], len(known)) for value in values]
    return {"of": [*known], "at": places}


SHOWN = 3
"""Most texts that are named one by one."""


def sweep_words(
    count: int, completed: int, reasons: Mapping[str, int], errors: Mapping[str, int], flights: Sequence[SweepFlight]
) -> list[str]:
    """Sentences on a sweep: counts over all runs."""
    made, broken = count - sum(errors.values()), sum(errors.values())
    words = [f"{count} runs."]
    if made:
        own = distinct(flights)
        repeated = len(own) < sum(flight.error is None for flight in flights)
        low, high = (completed_interval(own) if repeated else None) or wilson_interval(completed, made)
        of = f" of {len(own)} distinct flights" if repeated else ""
        share, least, most = (f"{100 * each:.3g} %" for each in (completed / made, low, high))
        words[0] = f"{completed} of {made} flights completed: {share} (95 % interval{of} {least} to {most})."
        words.append(f"They ended so: {_counts(reasons)}.")
    if broken:
        words.append(f"{broken} of {count} runs could not be made: {_counts(errors)}.")
    if failed := sum(bool(flight.solver_failed or flight.fallbacks) for flight in flights):
        words.append(f"OSQP did not solve in {failed} of {len(flights)} flights: decisions there are of a fallback.")
    if len(flights) < count:
        words.append(f"The charts and the list show {len(flights)} of the {count} runs, a random sample.")
    return words


def _counts(found: Mapping[str, int]) -> str:
    """The most frequent texts with their counts."""
    first = sorted(found.items(), key=lambda item: -item[1])
    more = [f"{len(first) - SHOWN} other texts"] if len(first) > SHOWN else []
    return "; ".join([f"{printable(text, LABEL)} ({number})" for text, number in first[:SHOWN]] + more)
