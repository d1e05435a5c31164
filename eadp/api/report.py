"""A result as its HTML page: a flight's folder, the log of a flight on telemetry, the results of a sweep."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

from eadp.api.flight import REPORT
from eadp.api.given import File
from eadp.api.result_folder import SUMMARY, read_flights, read_folder
from eadp.errors import EadpError, Fault, InputError, printable, refuse
from eadp.io.report.flight import flight_data
from eadp.io.report.flights import comparison, draw_flights, flights_data, table_text
from eadp.io.report.page import check_page, page_html
from eadp.io.report.replan_log import log_data
from eadp.io.report.sweep import sweep_data
from eadp.io.text.streams import output_file, read_text, write_bytes, write_text

SQLITE = b"SQLite format 3\0"
COMPARISON = "comparison.html"


def write_comparison(folders: Sequence[str], out: str | None = None) -> tuple[str, str]:
    """Write the page of several flights, and their figure beside it as .svg and .png; return its path and the table.

    Parameters
    ----------
    folders : sequence of str
        Result folders, two or more.
    out : str, optional
        By default `comparison.html` beside the first folder; `-` is standard output, without a figure.

    Raises
    ------
    InputError
        If one is no result folder or stands twice, or a file cannot be written.
    """
    for folder in folders:
        if not os.path.isdir(folder):
            raise InputError.at(folder, 1, 1, "is no folder of a flight", "folders of eadp simulate, one or more")
    with _whole(folders[0]):
        flights = read_flights(folders)
        pictures = draw_flights(flights)
        table, data = table_text(comparison(flights)), flights_data(flights, pictures[".svg"])
    page = Path(folders[0]).resolve().parent / COMPARISON if out is None else Path(out)
    if out != "-":
        output_file(str(page))
        check_page(page)
        beside = [page.with_suffix(suffix) for suffix in pictures]
        taken = [] if page.exists() else [each for each in beside if os.path.lexists(each)]
        refuse([Fault(str(each), 1, 1, "is no picture of this page", "another -o FILE") for each in taken])
        for suffix, picture in pictures.items():
            write_bytes(str(page.with_suffix(suffix)), picture)
    write_text(str(page) if out != "-" else "-", page_html("flights", data))
    return str(page), table


def page_of(result: str) -> Path:
    """Where the page of a result goes by default."""
    path = Path(result)
    if os.path.isdir(path):
        return path / REPORT
    return path.with_name(f"{path.name}.html") if path.suffix == ".html" else path.with_suffix(".html")


def _data(path: Path, page: Path, keep: str | None) -> tuple[str, dict[str, Any]]:
    """The kind of a result's page, and its data."""
    faulty = path / SUMMARY if os.path.isdir(path) else path
    with _whole(str(faulty)):
        if os.path.isdir(path):
            return "flight", flight_data(read_folder(path))
        if _is_database(path):
            return "sweep", sweep_data(str(path), page, keep)
        return "flight", log_data(read_text(str(path)))


@contextmanager
def _whole(name: str) -> Iterator[None]:
    """Errors of a result that is damaged as faults of its file."""
    try:
        yield
    except EadpError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        what = f"is damaged: {type(error).__name__}: {printable(str(error))}"
        raise InputError.at(name, 1, 1, what, "a result of eadp, whole") from None


def _is_database(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(SQLITE)) == SQLITE
    except (OSError, ValueError):  # its fault is that of a text
        return False


def report(result: File | Sequence[File], out: File | None = None, keep: File | None = None) -> str:
    """Write a result as one HTML page that needs no network.

    Parameters
    ----------
    result : path, or sequence of paths
        A result folder, the results file of a sweep, or a log of `eadp replan`. Several folders of flights are drawn
        beside each other.
    out : path, optional
        By default `report.html` in the folder, or beside the file under its name; `-` is standard output.
    keep : path, optional
        Where the folders of a sweep's flights are, for links to them.

    Returns
    -------
    str
        The page's path.

    Raises
    ------
    InputError
        If it is no result, is damaged, or the page cannot be written.
    """
    if not isinstance(result, str | PathLike):
        return write_comparison([*map(str, result)], None if out is None else str(out))[0]
    page = page_of(str(result))
    target = str(page) if out is None else str(out)
    if target != "-":
        check_page(output_file(target))
    data = _data(Path(result), page if target == "-" else Path(target), None if keep is None else str(keep))
    write_text(target, page_html(*data))
    return target
