"""WPL, the text format of missions of Mission Planner, ArduPilot and QGroundControl: a row for each item."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from eadp.core.geometry.curves import Point
from eadp.errors import Fault, InputError, printable, refuse
from eadp.exchange.items import (
    ABSOLUTE,
    ITEMS_LIMIT,
    MAX_FENCE_M,
    RALLY_LEFT_OUT,
    WAYPOINT,
    DraftItem,
    Fence,
    MissionDraft,
    MissionItem,
    command_text,
)
from eadp.exchange.qgc import is_qgc, qgc_fences, read_qgc
from eadp.io.plan.reader import LIMIT_CHARACTERS
from eadp.io.plan.sources import PlanReader
from eadp.io.text.csv import Row, number_fault, read_rows
from eadp.io.text.streams import HEAD, Location, SourceText, Text
from eadp.models.plan.plan import Finding, Plan
from eadp.plug_ins import plug_ins

VERSION = "QGC WPL 110"
COLUMNS = 12
_WHOLE = {0: "index", 2: "frame", 3: "command"}
_PARAMETERS = range(4, 11)
_ROWS = f"{COLUMNS} columns, separated by tabs or blanks"
FENCE_RETURN, RALLY = 5000, 5100
POLYGONS, CIRCLES = {5001: True, 5002: False}, {5003: True, 5004: False}
"""Commands of the corners of a fence and of a round one, and whether it is kept in."""


def read_wpl(source: SourceText) -> MissionDraft:
    """Read a mission: row 0 is home. Fences may be among its rows; places to rally are left out.

    Raises
    ------
    InputError
        With the faults of the rows, or of the first line; if it has fences or places to rally alone.
    """
    rows, doubts = _rows(source)
    fences = _fences(source, rows)
    items = [each for each in rows if not _is_fence(each)]
    home = items[0] if items and items[0].number == 0 and items[0].command == WAYPOINT else None
    moved = items if home is None else items[1:]
    if len(items) < len(rows) and not moved:
        if not fences:
            raise source.error(rows[0].locations[0], "places to rally, and no mission", "a mission")
        expected = "a mission; a fence belongs to --inside or --avoid of eadp plan, or into the mission's file"
        raise source.error(rows[0].locations[0], "a fence, and no mission", expected)
    if rally := [each for each in rows if each.command == RALLY]:
        doubts.append((rally[0].locations[0], "rally", RALLY_LEFT_OUT))
    draft = MissionDraft((0.0, 0.0, 0.0), rows[0].locations[6], moved, fences=fences, doubts=doubts)
    if home is not None:
        draft.home, draft.home_location = home.parameters[4:], home.locations[6]
    elif rows[0] is items[0]:
        message = f"row 0 is {command_text(rows[0].command)} and no home: it is flown as the first item"
        doubts.append((rows[0].locations[0], "no-home", message))
    return draft


def mission_fences(source: SourceText) -> list[Fence] | None:
    """The fences of a mission, or of a file of fences alone; None of another text. Raises InputError."""
    head = source.body.lstrip()[:HEAD]
    if is_qgc(head):
        return qgc_fences(source)
    return _fences(source, _rows(source)[0]) if head.startswith(VERSION[:7]) else None


def _is_fence(item: DraftItem) -> bool:
    return item.command in POLYGONS or item.command in CIRCLES or item.command in (FENCE_RETURN, RALLY)


def _fences(source: SourceText, rows: Sequence[DraftItem]) -> list[Fence]:
    """The fences among rows; the first row of a polygon says how many its corners are."""
    found: list[Fence] = []
    left, corners_of = 0, 0
    for item in rows:
        command, size, corner, at = item.command, item.parameters[0], item.parameters[4:6], item.locations
        if left and command != corners_of:
            break
        if command in POLYGONS:
            if not left:
                if not 3 <= size <= ITEMS_LIMIT or size != int(size):
                    raise source.error(at[2], f"{size:g} corners", "3 or more, in the rows that follow")
                left, corners_of = int(size), command
                found.append(Fence(POLYGONS[command], [], at[6]))
            found[-1].corners_deg.append((corner[0], corner[1]))
            left -= 1
        elif command in CIRCLES:
            if not 0 < size <= MAX_FENCE_M:
                raise source.error(at[2], f"a radius of {size:g} m", f"above 0, at most {MAX_FENCE_M:g}")
            found.append(Fence.circle(CIRCLES[command], (corner[0], corner[1]), size, at[6]))
        else:
            continue
        if not (abs(corner[0]) <= 90 and abs(corner[1]) <= 180):
            raise source.error(at[6], f"{corner[0]:g}, {corner[1]:g}", "a latitude and a longitude [°]")
    if left:
        raise source.error(found[-1].location, f"a polygon without its last {left} corners", "as many as it states")
    return found


def _rows(source: SourceText) -> tuple[list[DraftItem], list[tuple[Location, str, str]]]:
    """The rows, numbered in their order, and what is odd about them."""
    rows = read_rows(source.name, source.body, "")
    head = next(rows)
    if head.fields != VERSION.split():
        version = printable(" ".join(head.fields), 40)
        raise source.error((head.line, 1), f"the version {version} of this format is not known", VERSION)
    faults: list[Fault] = []
    items: list[DraftItem] = []
    doubts: list[tuple[Location, str, str]] = []
    for index, row in enumerate(rows):
        if index > ITEMS_LIMIT:
            raise source.error((row.line, 1), f"more than {ITEMS_LIMIT} items", "as many or fewer")
        if found := _row_faults(row):
            faults += found
            continue
        if not doubts and float(row.fields[0]) != index:
            message = f"the index {row.fields[0]} in row {index}: items are numbered by their rows, as autopilots do"
            doubts.append(((row.line, row.columns[0]), "index", message))
        numbers = [float(text) for text in row.fields]
        places = [(row.line, row.columns[i]) for i in (3, 2, *range(4, 11))]
        items.append(
            DraftItem(f"item {index}", index, int(numbers[3]), int(numbers[2]), tuple(numbers[4:11]), tuple(places))
        )
    refuse(faults)
    if not items:
        raise source.error((head.line, 1), "no home", "a row for home, and one for each item")
    return items, doubts


def _row_faults(row: Row) -> list[Fault]:
    count = len(row.fields)
    if count != COLUMNS:
        message = f"a row of {count} column{'s' if count != 1 else ''}"
        return [row.fault(0 if count < COLUMNS else COLUMNS, message, _ROWS)]
    faults = [
        row.fault(i, *wrong)
        for i, text in enumerate(row.fields)
        if (wrong := number_fault(text)) and not (i in _PARAMETERS and text.lower() == "nan")  # a parameter not set
    ]
    for i, name in _WHOLE.items():
        if not faults and not re.fullmatch(r"\+?[0-9]{1,5}(\.0*)?", row.fields[i]):
            faults.append(row.fault(i, f"{printable(row.fields[i], 40)} is no {name}", "a whole number of 0 or more"))
    return faults


def fence_text(fences: Sequence[Fence]) -> str:
    """The file of a fence, as ground stations send it beside a mission: a row for each corner."""
    kinds = {inside: command for command, inside in POLYGONS.items()}
    rows = [
        MissionItem(kinds[inclusion], 0, (float(len(corners)), 0.0, 0.0, 0.0, *corner, 0.0))
        for inclusion, corners, _ in fences
        for corner in corners
    ]
    return _text(rows)


def wpl_text(items: Sequence[MissionItem], home_deg: Point, home_m: float = 0.0) -> str:
    """The file of a mission: home, at its height above the sea, 0 where that is not known; then its items."""
    return _text([MissionItem(WAYPOINT, ABSOLUTE, (0.0, 0.0, 0.0, 0.0, *home_deg, home_m)), *items])


def _text(items: Sequence[MissionItem]) -> str:
    """The file of all rows; the first is the current one."""
    lines = [VERSION]
    for index, (command, frame, parameters, _) in enumerate(items):
        numbers = [f"{value:.9f}".rstrip("0").rstrip(".") for value in parameters]
        lines.append("\t".join([str(index), str(int(index == 0)), str(frame), str(command), *numbers, "1"]))
    return "\n".join([*lines, ""])


@dataclass(frozen=True)
class MissionFormat:
    """A format of missions: its name, whether a text that starts so has it, and its reader."""

    name: str
    recognise: Callable[[str], bool]
    read: Callable[[SourceText], MissionDraft]


FORMATS = (
    MissionFormat("QGroundControl plan", lambda head: head.startswith("{"), read_qgc),
    MissionFormat("WPL", lambda head: head.startswith("QGC WPL"), read_wpl),
)
"""Formats of missions; the first that recognises a text reads it, and those of other packages where it has no stage."""


class _Missions:
    """Missions as a source of plans."""

    @staticmethod
    def recognises(text: Text) -> bool:
        """Whether a format of missions recognises a text."""
        return _format_of(text) is not None

    @staticmethod
    def read(text: Text, reader: PlanReader) -> tuple[Plan, list[Finding]]:
        """A mission as a plan, and warnings; raises InputError."""
        chosen = _format_of(text)
        assert chosen is not None
        if len(text.body) > LIMIT_CHARACTERS:
            raise InputError.at(text.name, 1, 1, "is too large for a mission", f"at most {LIMIT_CHARACTERS} characters")
        source = SourceText(text)
        from eadp.exchange.mission_plan import MissionPlan

        return MissionPlan(source, chosen.read(source), reader).plan()


MISSION = _Missions()


def _format_of(text: Text) -> MissionFormat | None:
    """The format of a mission by its first characters; None for a plan of eadp."""
    head = text.body.lstrip()[:HEAD]
    found = next((each for each in FORMATS if each.recognise(head)), None)
    if found is None:
        found = next((each for each in plug_ins("mission_formats") if each.recognise(head)), None)
    return found
