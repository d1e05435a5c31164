"""A result folder read back, for its page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eadp.api.fences import FENCES
from eadp.api.given import Around
from eadp.api.inputs import Files, FlightInputs, load_flight
from eadp.errors import InputError
from eadp.io.figures.flights import DrawnFlight
from eadp.io.plan.reader import read_plan
from eadp.io.plan.sources import is_mission
from eadp.io.report.flight import FlownFlight
from eadp.io.scenario.scenario_file import read_overrides, vehicle_path
from eadp.io.text.csv import number_fault, read_rows
from eadp.io.text.json import json_lines
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
    inputs = _inputs(folder / "inputs")
    return FlownFlight(
        world=inputs.world,
        scenario=inputs.scenario,
        summary=summary,
        columns=dict(zip(head, map(list, zip(*rows, strict=True)), strict=True)),
        estimates=_table(estimates) if estimates.exists() else [],
        decisions=json_lines(read_text(str(decisions))) if decisions.exists() else [],
    )


def read_flights(folders: Sequence[str]) -> list[DrawnFlight]:
    """The flights of result folders, each named by its planner, or by its folder where two have one planner.

    Raises
    ------
    InputError
        If a folder stands twice, or as `read_folder`.
    """
    places = [Path(folder).resolve() for folder in folders]
    for i, place in enumerate(places):
        if place in places[:i]:
            raise InputError.at(folders[i], 1, 1, "stands twice", "folders of different flights")
    flights = [read_folder(Path(folder)) for folder in folders]
    planners = [flight.summary["planner"] for flight in flights]
    names = planners if len(set(planners)) == len(planners) else [place.name for place in places]
    if len(set(names)) < len(names):
        names = list(folders)
    return [
        DrawnFlight(
            name if flight.summary["completed"] else f"{name}: NOT completed",
            flight.world.plan,
            flight.summary,
            flight.columns,
        )
        for name, flight in zip(names, flights, strict=True)
    ]


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
    chosen: dict[str, Any] = {kind: paths.get(kind) for kind in ("scenario", "profile", "energy")}
    around = Around(avoid=paths.get("avoid"), inside=paths.get("inside"))
    return load_flight(paths["plan"], **chosen, around=around, overrides=overrides, files=files)


def _paths(folder: Path) -> dict[str, str]:
    """The paths of the inputs by kind."""
    paths = {kind: str(path) for kind in FENCES for path in (folder / kind).glob("*")}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name != OVERRIDES and path.is_file():
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
