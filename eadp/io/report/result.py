"""A result as its HTML page: a flight's folder, the log of a flight on telemetry, the results of a sweep."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from eadp.errors import EadpError, InputError, printable
from eadp.io.flight.folder import REPORT
from eadp.io.report.flight import flight_data
from eadp.io.report.page import check_page, page_html
from eadp.io.report.replan_log import log_data
from eadp.io.report.result_folder import SUMMARY, read_folder
from eadp.io.report.sweep import sweep_data
from eadp.io.text.streams import read_text, write_text

SQLITE = b"SQLite format 3\0"


def write_report(result: str, out: str | None = None, keep: str | None = None) -> str:
    """Write the page of a result; return its path.

    Parameters
    ----------
    result : str
        A result folder, the results file of a sweep, or a log of `eadp replan`.
    out : str, optional
        By default `report.html` in the folder, or the file's name with .html beside it; `-` is standard output.

    keep : str, optional
        Where the folders of a sweep's flights are, for links to them.

    Raises
    ------
    InputError
        If it is no result, is damaged, or the page cannot be written.
    """
    page = page_of(result)
    if out is None:
        check_page(page)
    target = str(page) if out is None else out
    kind, data = _data(Path(result), page if target == "-" else Path(target), keep)
    write_text(target, page_html(kind, data))
    return target


def page_of(result: str) -> Path:
    """Where the page of a result goes by default."""
    path = Path(result)
    if os.path.isdir(path):
        return path / REPORT
    return path.with_name(f"{path.name}.html") if path.suffix == ".html" else path.with_suffix(".html")


def _data(path: Path, page: Path, keep: str | None) -> tuple[str, dict[str, Any]]:
    """The kind of a result's page, and its data."""
    faulty = path / SUMMARY if os.path.isdir(path) else path
    try:
        if os.path.isdir(path):
            return "flight", flight_data(read_folder(path))
        if _is_database(path):
            return "sweep", sweep_data(str(path), page, keep)
        return "flight", log_data(read_text(str(path)))
    except EadpError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        what = f"is damaged: {type(error).__name__}: {printable(str(error))}"
        raise InputError.at(str(faulty), 1, 1, what, "a result of eadp, whole") from None


def _is_database(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(SQLITE)) == SQLITE
    except (OSError, ValueError):  # its fault is that of a text
        return False
