"""Which stages the items of a mission lead along: written beside a mission, and read where the mission is flown.

A ground station may load, show and send the mission, and drops what it does not know: the map is a file of its own.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

from annotated_types import Ge, Le, MaxLen

from eadp.errors import Fault
from eadp.exchange.items import ITEMS_LIMIT, NO_POSITION, MissionItem
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import STRICT, keys_document, validated
from eadp.models.plan.route import PlannedLegs

SCHEMA = "eadp.items/1"
SAME_DEG = 2e-7
"""How far a position may be off that was sent in units of 1e-7 degrees, or as single precision's next one."""


class MappedItem(NamedTuple):
    """An item of a mission, and the stages that it leads along.

    Attributes
    ----------
    item : MissionItem
    first, last : int
        The numbers of the first and last stage that is started on the way to it, over the whole flight, from 1.
    parameters : tuple of float
        Path parameters in force there.
    """

    item: MissionItem
    first: int
    last: int
    parameters: tuple[float, ...]


def mapped_items(items: Sequence[MissionItem], planned: PlannedLegs, path_count: int) -> list[MappedItem]:
    """Items that lead along legs, with their stages and the path parameters in force."""
    started = planned.started
    return [
        MappedItem(item, started + item.legs[0], started + item.legs[1], planned.parameters[item.legs[0]][:path_count])
        for item in items
    ]


def items_text(items: Sequence[MappedItem], path_names: Sequence[str]) -> str:
    """The file of a map: a row for each item, home aside."""
    head = {"schema": SCHEMA, "path_parameters": list(path_names)}
    rows = [
        json.dumps([each.item.command, *each.item.parameters[4:6], each.first, each.last, *each.parameters])
        for each in items
    ]
    return json.dumps(head)[:-1] + ', "items": [\n' + ",\n".join(rows) + "\n]}\n"


@dataclass(frozen=True)
class _ItemsFile:
    __pydantic_config__ = STRICT

    schema: Literal["eadp.items/1"]
    path_parameters: list[str]
    items: Annotated[list[list[Annotated[float, Ge(-1e12), Le(1e12)]]], MaxLen(ITEMS_LIMIT)]


def read_items(path: str, path_names: Sequence[str]) -> list[MappedItem]:
    """A map of the mission of a plan with these path parameters.

    Raises
    ------
    InputError
        If it is no such file, or the map of another plan's mission.
    """
    return parse_items(read_text(path), path_names)


def parse_items(text: Text, path_names: Sequence[str]) -> list[MappedItem]:
    """As `read_items`, of a text."""
    document = keys_document(text, SCHEMA)

    def check(file: _ItemsFile) -> list[Fault]:
        if file.path_parameters != list(path_names):
            known = ", ".join(path_names) or "none"
            return [document.fault(("path_parameters",), "is of another plan", f"the path parameters {known}")]
        width, started, faults = 5 + len(path_names), 1, []
        for number, row in enumerate(file.items):
            whole = len(row) == width and all(value == int(value) for value in (row[0], *row[3:5]))
            if not whole or not started <= row[3] <= row[4]:
                expected = "command, latitude, longitude, first and last stage, and the path parameters"
                faults.append(document.fault(("items", number), "is no row of an item", expected))
            else:
                started = int(row[3])
        return faults

    file = validated(_ItemsFile, document, document.value, check)
    return [_item(row) for row in file.items]


def _item(row: Sequence[float]) -> MappedItem:
    command, latitude, longitude, first, last, *parameters = row
    item = MissionItem(int(command), NO_POSITION, (0.0, 0.0, 0.0, 0.0, latitude, longitude, 0.0))
    return MappedItem(item, int(first), int(last), tuple(parameters))


def same_items(ours: Sequence[MissionItem], held: Sequence[MissionItem]) -> bool:
    """Whether a mission that an autopilot holds has the commands and positions of ours, in the same order.

    A position of 0, 0 is that of the aircraft, which a ground station may fill in.
    """
    return len(ours) == len(held) and all(_same(*pair) for pair in zip(ours, held, strict=True))


def _same(one: MissionItem, other: MissionItem) -> bool:
    place = one.parameters[4:6]
    there = place == (0.0, 0.0) or all(
        math.isclose(a, b, rel_tol=0.0, abs_tol=SAME_DEG) for a, b in zip(place, other.parameters[4:6], strict=True)
    )
    return one.command == other.command and there
