"""What several tests need: plans, a planner that is watched."""

from collections.abc import Iterable
from importlib import import_module
from itertools import combinations, product
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

import eadp.cli  # noqa: F401  # before numpy is imported: linear algebra keeps to one thread
from eadp.api.flight import REPORT
from eadp.report.page import GENERATOR

ROOT = Path(__file__).resolve().parents[3]
"""The repository's root."""


def few(values: Iterable[Any], count: int) -> list[Any]:
    """Cases of one kind, as seeds are, for `parametrize`: `count`, spread evenly, and the others marked slow."""
    return few_rows(((value,) for value in values), count)


def few_rows(rows: Iterable[tuple[Any, ...]], count: int) -> list[Any]:
    """The same for several names."""
    cases = list(rows)
    return _slow_but(evenly(len(cases), count), cases)


def evenly(size: int, count: int) -> set[int]:
    """So many of the indices of a list, spread evenly."""
    return {round(i * (size - 1) / max(count - 1, 1)) for i in range(min(size, count))}


def _slow_but(kept: set[int], rows: list[tuple[Any, ...]]) -> list[Any]:
    return [pytest.param(*row, marks=() if i in kept else pytest.mark.slow) for i, row in enumerate(rows)]


def pairwise(*factors: Iterable[Any]) -> list[Any]:
    """All combinations for `parametrize`: some that cover every pair of values, and the others marked slow."""
    cases = list(product(*factors))
    pairs = [set(combinations(enumerate(case), 2)) for case in cases]
    kept, missing = set(), set().union(*pairs)
    while missing:
        best = max(range(len(cases)), key=lambda i: len(pairs[i] & missing))
        kept.add(best)
        missing -= pairs[best]
    return _slow_but(kept, cases)


def _no_picture(path: Path, *_: Any) -> None:
    for ending in (".svg", ".png"):
        path.with_suffix(ending).touch()


def _no_page(_: Any, folder: Path) -> None:
    (folder / REPORT).write_bytes(GENERATOR)


def draw_nothing(patch: pytest.MonkeyPatch, *, page: bool = True) -> None:
    """Result folders whose figures and, with `page`, page, which take longer than a short flight, are empty."""
    for module, name, nothing in (
        ("eadp.io.figures.plan", "write_flight_figure", _no_picture),
        ("eadp.papers.figures", "write_paper_figure", _no_picture),
        ("eadp.survey.folder", "write_sorties_figure", _no_picture),
        *([("eadp.report.flight", "write_page", _no_page)] if page else ()),
    ):
        patch.setattr(import_module(module), name, nothing)  # the package's own names are functions


def draws(share: float) -> int:
    """A share of the profile's examples, for a property whose every example takes long."""
    return round(share * settings().max_examples)


def with_header(path: Path, folder: Path) -> Path:
    """A copy of a log whose first columns, time [s] and power [W], have no names, with a header."""
    body = path.read_text()
    others = "".join(f",c{i}" for i in range(body.partition("\n")[0].count(",") - 1))
    copy = folder / path.name
    copy.write_text(f"time_s,power_w{others}\n{body}")
    return copy
