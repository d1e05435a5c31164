"""WPL, the text format of missions of Mission Planner, ArduPilot and QGroundControl: a row for each item."""

from __future__ import annotations

import re
from collections.abc import Sequence

from eadp.core.geometry.curves import Point
from eadp.errors import Fault, printable, refuse
from eadp.io.mission.draft import ABSOLUTE, ITEMS_LIMIT, WAYPOINT, DraftItem, MissionDraft, MissionItem
from eadp.io.text.csv import Row, number_fault, read_rows
from eadp.io.text.source import SourceText

VERSION = "QGC WPL 110"
COLUMNS = 12
_WHOLE = {0: "index", 2: "frame", 3: "command"}
_ROWS = f"{COLUMNS} columns, separated by tabs or blanks"


def read_wpl(source: SourceText) -> MissionDraft:
    """Read a mission: row 0 is home.

    Raises
    ------
    InputError
        With the faults of the rows, or of the first line.
    """
    rows = read_rows(source.name, source.body, "")
    head = next(rows)
    if head.fields != VERSION.split():
        version = printable(" ".join(head.fields), 40)
        raise source.error((head.line, 1), f"the version {version} of this format is not known", VERSION)
    faults: list[Fault] = []
    items: list[DraftItem] = []
    for index, row in enumerate(rows):
        if index > ITEMS_LIMIT:
            raise source.error((row.line, 1), f"more than {ITEMS_LIMIT} items", "as many or fewer")
        if found := _row_faults(row, index):
            faults += found
            continue
        numbers = [float(text) for text in row.fields]
        places = [(row.line, row.columns[i]) for i in (3, 2, *range(4, 11))]
        items.append(
            DraftItem(f"item {index}", index, int(numbers[3]), int(numbers[2]), tuple(numbers[4:11]), tuple(places))
        )
    refuse(faults)
    if not items:
        raise source.error((head.line, 1), "no home", "a row for home, and one for each item")
    return MissionDraft(items[0].parameters[4:], items[0].locations[6], items[1:])


def _row_faults(row: Row, index: int) -> list[Fault]:
    count = len(row.fields)
    if count != COLUMNS:
        message = f"a row of {count} column{'s' if count != 1 else ''}"
        return [row.fault(0 if count < COLUMNS else COLUMNS, message, _ROWS)]
    faults = [row.fault(i, *wrong) for i, text in enumerate(row.fields) if (wrong := number_fault(text))]
    for i, name in _WHOLE.items():
        if not faults and not re.fullmatch(r"\+?[0-9]{1,5}(\.0*)?", row.fields[i]):
            faults.append(row.fault(i, f"{printable(row.fields[i], 40)} is no {name}", "a whole number of 0 or more"))
    if not faults and float(row.fields[0]) != index:
        faults.append(
            row.fault(0, f"the index {row.fields[0]}", f"{index}: the rows are counted from 0, which is home")
        )
    return faults


def wpl_text(items: Sequence[MissionItem], home_deg: Point) -> str:
    """The file of a mission: home, then its items."""
    home = MissionItem(WAYPOINT, ABSOLUTE, (0.0, 0.0, 0.0, 0.0, *home_deg, 0.0))
    lines = [VERSION]
    for index, (command, frame, parameters, _) in enumerate([home, *items]):
        numbers = [f"{value:.9f}".rstrip("0").rstrip(".") for value in parameters]
        lines.append("\t".join([str(index), str(int(index == 0)), str(frame), str(command), *numbers, "1"]))
    return "\n".join([*lines, ""])
