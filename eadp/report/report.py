"""`eadp report`: a result as its HTML page: a flight's folder, a sweep."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from typer import Argument

from eadp.api.flight import OVERRIDES, SUMMARY
from eadp.api.given import File, PageSource
from eadp.api.inputs import Files, FlightInputs, load_flight
from eadp.cli.output import emit
from eadp.errors import EadpError, InputError, printable
from eadp.io.scenario import read_overrides, vehicle_path
from eadp.io.text.json import json_lines
from eadp.io.text.options import Flag
from eadp.io.text.streams import output_file, read_text, write_text
from eadp.plug_ins import plug_ins
from eadp.report.flight import FlownFlight, flight_data
from eadp.report.page import check_page, page_html, page_of


def _data(path: Path, page: Path, keep: str | None) -> tuple[str, dict[str, Any]]:
    """The kind of a result's page, and its data."""
    faulty = path / SUMMARY if os.path.isdir(path) else path
    with _whole(str(faulty)):
        source: PageSource | None = next((each for each in plug_ins("pages") if each.recognises(path)), None)
        if source is None:
            read_text(str(path))  # a file that is missing, or cannot be read, is said to be
            expected = "a folder of eadp simulate -o DIR, or the results of eadp sweep -o FILE.db"
            raise InputError.at(str(path), 1, 1, "is no result that has a page", expected)
        return source.kind, dict(source.data(path, page, keep))


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


def report(result: File, out: File | None = None, keep: File | None = None) -> str:
    """Write a result as one HTML page that needs no network.

    Parameters
    ----------
    result : path
        A result folder, or the results file of a sweep.
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
    page = page_of(str(result))
    target = str(page) if out is None else str(out)
    if target != "-":
        check_page(output_file(target))
    data = _data(Path(result), page if target == "-" else Path(target), None if keep is None else str(keep))
    write_text(target, page_html(*data))
    return target


@dataclass(frozen=True)
class ReportOptions:
    """Where the page goes, and where the flights of a sweep are."""

    out: Annotated[str | None, Flag("-o --out", metavar="FILE")] = None
    """The page; default: report.html in the folder, or beside the file."""

    keep: Annotated[str | None, Flag(metavar="DIR")] = None
    """The folders of a sweep's flights, of eadp sweep --keep."""


def command(
    result: Annotated[str, Argument(metavar="RESULT", help="Folder of eadp simulate, or results of eadp sweep.")],
    options: ReportOptions,
) -> int:
    """Example: eadp report runs/survey

    Write a result as one HTML page, which opens from disk and needs no network.

    Exit code 0 when the page is written, 2 on bad input.
    """
    target = report(result, options.out, options.keep)
    if target != "-":
        emit(f"written    {printable(target)}")
    return 0


def read_folder(folder: Path) -> FlownFlight:
    """The flight of a result folder.

    Raises
    ------
    InputError
        If a file is missing or damaged.
    """
    if not (folder / SUMMARY).exists():
        raise InputError.at(str(folder), 1, 1, "is no folder of a flight", "a folder of eadp simulate -o DIR")
    (summary,) = json_lines(read_text(str(folder / SUMMARY)), whole=True)
    estimates, decisions = folder / "estimate.csv", folder / "decisions.jsonl"
    head, *rows = _table(folder / "flight.csv")
    inputs = _inputs(folder / "inputs")
    return FlownFlight(
        world=inputs.world,
        scenario=inputs.scenario,
        summary=summary,
        columns=dict(zip(head, map(list, zip(*rows, strict=True)), strict=True)),
        estimates=_table(estimates) if estimates.exists() else [],
        decisions=json_lines(read_text(str(decisions))) if decisions.exists() else [],
    )


FOLDER = PageSource("flight", os.path.isdir, lambda path, page, keep: flight_data(read_folder(path)))
"""The page of a result folder."""


def _table(path: Path) -> list[list[Any]]:
    """Head and rows of a table of numbers; an empty field is None."""
    with _whole(str(path)):
        head, first, *rows = csv.reader(read_text(str(path)).body.splitlines())
        return [head, *([float(field) if field else None for field in row] for row in (first, *rows))]


# --- inputs


def _inputs(folder: Path) -> FlightInputs:
    """The flight of the copies of its inputs, each in a folder of its kind."""
    paths = {path.parent.name: str(path) for path in folder.glob("*/*")}
    if "plan" not in paths:
        raise InputError.at(str(folder), 1, 1, "has no plan", "the copies of a flight's inputs")
    given = folder / OVERRIDES
    overrides = read_overrides(read_text(str(given)).body.splitlines()) if given.exists() else {}
    files = Files()
    if "vehicle" in paths:
        named = vehicle_path(files.document(paths.get("scenario")), overrides)
        if named is not None:
            files.texts[named] = files.text(paths["vehicle"])
    chosen: dict[str, Any] = {kind: paths.get(kind) for kind in ("scenario", "profile", "energy")}
    return load_flight(paths["plan"], **chosen, overrides=overrides, files=files)
