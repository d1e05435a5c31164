"""`eadp report`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from typer import Argument

from eadp.cli.output import emit
from eadp.errors import printable
from eadp.io.text.options import Flag


@dataclass(frozen=True)
class ReportOptions:
    """Where the page goes, and where the flights of a sweep are."""

    out: Annotated[str | None, Flag("-o --out", metavar="FILE")] = None
    """The page; default: report.html in the folder, or beside the file."""

    keep: Annotated[str | None, Flag(metavar="DIR")] = None
    """The folders of a sweep's flights, of eadp sweep --keep."""


def command(
    result: Annotated[
        str,
        Argument(metavar="RESULT", help="Folder of eadp simulate, or results of eadp sweep."),
    ],
    options: ReportOptions,
) -> int:
    """Example: eadp report runs/survey

    Write a result as one HTML page, which opens from disk and needs no network.

    Exit code 0 when the page is written, 2 on bad input.
    """
    from eadp.report.report import report

    target = report(result, options.out, options.keep)
    if target != "-":
        emit(f"written    {printable(target)}")
    return 0
