"""`eadp report`."""

from __future__ import annotations

from typing import Annotated

from typer import Argument, Option

from eadp.cli.output import emit
from eadp.errors import printable


def command(
    result: Annotated[
        str, Argument(metavar="RESULT", help="Folder of eadp simulate, results of eadp sweep, or log of eadp replan.")
    ],
    out: Annotated[
        str | None,
        Option("-o", "--out", metavar="FILE", help="The page; default: report.html in the folder, or beside the file."),
    ] = None,
    keep: Annotated[
        str | None, Option(metavar="DIR", help="The folders of a sweep's flights, of eadp sweep --keep.")
    ] = None,
) -> int:
    """Example: eadp report runs/survey

    Write a result as one HTML page, which opens from disk and needs no network.

    Exit code 0 when the page is written, 2 on bad input.
    """
    from eadp import api

    target = api.report(result, out, keep)
    if target != "-":
        emit(f"written    {printable(target)}")
    return 0
