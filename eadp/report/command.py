"""`eadp report`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from typer import Argument

from eadp.cli.output import emit, usage_fault
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
        list[str],
        Argument(
            metavar="RESULT…",
            help="Folder of eadp simulate, results of eadp sweep, or log of eadp replan; or several folders.",
        ),
    ],
    options: ReportOptions,
) -> int:
    """Example: eadp report runs/survey

    Write a result as one HTML page, which opens from disk and needs no network. Of several folders it has paths side by
    side, power, charge and parameters over each other, and a table of what differs, which is printed too.

    Exit code 0 when the page is written, 2 on bad input.
    """
    from eadp.report.report import report, write_comparison

    out, keep = options.out, options.keep
    if len(result) > 1:
        if keep is not None:
            raise usage_fault("--keep", keep, "is of a sweep's results", "no --keep beside several folders")
        target, table = write_comparison(result, out)
        if target != "-":
            emit(table)
    else:
        target = report(result[0], out, keep)
    if target != "-":
        emit(f"written    {printable(target)}")
    return 0
