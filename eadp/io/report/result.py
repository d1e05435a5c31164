"""A result as its HTML page: a flight's folder, the log of a flight on telemetry."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eadp.errors import EadpError, InputError, printable
from eadp.io.report.flight import flight_data
from eadp.io.report.page import check_page, page_html
from eadp.io.report.replan_log import log_data
from eadp.io.report.result_folder import SUMMARY, read_folder
from eadp.io.text.streams import read_text, write_text

REPORT = "report.html"


def write_report(result: str, out: str | None = None) -> str:
    """Write the page of a result; return its path.

    Parameters
    ----------
    result : str
        A result folder, or a log of `eadp replan`.
    out : str, optional
        By default `report.html` in the folder, or the file's name with .html beside it; `-` is standard output.

    Raises
    ------
    InputError
        If it is no result, is damaged, or the page cannot be written.
    """
    path = Path(result)
    usual = path / REPORT if path.is_dir() else path.with_suffix(".html")
    if out is None:
        check_page(usual)
    kind, data = _data(path)
    target = str(usual) if out is None else out
    write_text(target, page_html(kind, data))
    return target


def _data(path: Path) -> tuple[str, dict[str, Any]]:
    """The kind of a result's page, and its data."""
    faulty = path / SUMMARY if path.is_dir() else path
    try:
        if path.is_dir():
            return "flight", flight_data(read_folder(path))
        return "flight", log_data(read_text(str(path)))
    except EadpError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        what = f"is damaged: {type(error).__name__}: {printable(str(error))}"
        raise InputError.at(str(faulty), 1, 1, what, "a result of eadp, whole") from None
