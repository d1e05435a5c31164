"""A result folder read back, for its page."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from eadp.errors import InputError
from eadp.io.flight.inputs import Files, FlightInputs, load_flight
from eadp.io.mission.reader import is_mission
from eadp.io.plan.reader import read_plan
from eadp.io.report.flight import FlownFlight
from eadp.io.scenario.scenario_file import read_overrides, vehicle_path
from eadp.io.text.csv import number_fault, read_rows
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import read_yaml

SUMMARY, OVERRIDES = "summary.json", "overrides.txt"


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
    return FlownFlight(
        inputs=_inputs(folder / "inputs"),
        summary=summary,
        columns=dict(zip(head, map(list, zip(*rows, strict=True)), strict=True)),
        estimates=_table(estimates) if estimates.exists() else [],
        decisions=json_lines(read_text(str(decisions))) if decisions.exists() else [],
    )


def json_lines(text: Text, *, whole: bool = False) -> list[dict[str, Any]]:
    """The objects of a text, one a line; with `whole`, the one that the text is.

    Raises
    ------
    InputError
        At what is no JSON object.
    """
    documents = []
    for number, line in enumerate([text.body] if whole else text.body.splitlines(), 1):
        try:
            document = json.loads(line)
        except (ValueError, RecursionError) as error:
            place = getattr(error, "lineno", 1) + number - 1, getattr(error, "colno", 1)
            raise InputError.at(text.name, *place, "is not JSON", "a JSON object") from None
        if not isinstance(document, dict):
            raise InputError.at(text.name, number, 1, "is no JSON object", "a JSON object")
        documents.append(document)
    return documents


def _table(path: Path) -> list[list[Any]]:
    """Head and rows of a table of numbers; an empty field is None."""
    rows = read_rows(str(path), read_text(str(path)).body)
    head = next(rows, None)
    if head is None:
        raise InputError.at(str(path), 1, 1, "is empty", "a table of a result folder")
    numbers: list[list[Any]] = []
    for row in rows:
        if len(row.fields) != len(head.fields):
            raise InputError(row.fault(0, f"{len(row.fields)} fields", f"{len(head.fields)}"))
        try:
            values = [float(field) if field else None for field in row.fields]
        except ValueError:
            values = [math.nan]  # found below, with its column
        if not all(value is None or math.isfinite(value) for value in values):
            faults = ((i, number_fault(field)) for i, field in enumerate(row.fields) if field)
            raise InputError(*(row.fault(i, *fault) for i, fault in faults if fault))
        numbers.append(values)
    if not numbers:
        raise InputError.at(str(path), 2, 1, "no rows", "a row for each logged moment")
    return [head.fields, *numbers]


# --- inputs


def _inputs(folder: Path) -> FlightInputs:
    """The flight of the copies of its inputs, which are recognised by their content."""
    paths = _paths(folder)
    if "plan" not in paths:
        raise InputError.at(str(folder), 1, 1, "has no plan", "the copies of a flight's inputs")
    given = folder / OVERRIDES
    overrides = read_overrides(read_text(str(given)).body.splitlines()) if given.exists() else {}
    files = Files()
    if "vehicle" in paths:
        document = files.document(paths.get("scenario"))
        named = vehicle_path(document, overrides)
        if named is not None:
            files.texts[named] = files.text(paths["vehicle"])
    chosen = {f"{kind}_path": paths.get(kind) for kind in ("scenario", "profile", "energy")}
    return load_flight(paths["plan"], **chosen, overrides=overrides, files=files)


def _paths(folder: Path) -> dict[str, str]:
    """The paths of the inputs by kind."""
    paths: dict[str, str] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name != OVERRIDES:
            paths[_kind(read_text(str(path)))] = str(path)
    return paths


def _kind(text: Text) -> str:
    """What an input is: of YAML its schema says it; else a plan or a mission, or a profile's measurements."""
    if is_mission(text):
        return "plan"
    try:
        document = read_yaml(text).value
        return str(document["schema"]).removeprefix("eadp.").partition("/")[0]
    except (InputError, TypeError, KeyError):
        pass
    try:
        read_plan(text)
    except InputError:
        return "profile"
    return "plan"
