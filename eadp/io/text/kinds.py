"""Files of eadp by their kind, as their texts show it: a fault says where a file in another's place belongs."""

from __future__ import annotations

import re

from eadp.errors import InputError, printable
from eadp.io.text.streams import Text

_SCHEMA = re.compile(r"^schema: *['\"]?eadp\.([a-z]+)/", re.MULTILINE)
_FIELD = re.compile(r"\s*(<\?xml[^>]*>\s*)?<kml|\s*\{.{0,2000}?\"type\"\s*:\s*\"(Feature|Polygon|Multi)", re.DOTALL)
HEAD = 4000
"""Characters of a file in which its kind is searched."""
_FOREIGN = (
    (r"<!DOCTYPE\s+flight_plan|<flight_plan\b", "is a flight plan of Paparazzi, which is not read"),
    (r"<gpx\b", "is a track (GPX), which is not read"),
    (r"\A\s*<", "is XML, of no kind that is read"),
)
"""Files of other software that stand where a plan belongs: a pattern of their heads, and what they are."""
_MISSIONS = "a plan; a mission as WPL (*.waypoints) or a plan of QGroundControl"

USES = {
    "scenario": ("a scenario", "--scenario {}"),
    "vehicle": ("a vehicle file", "--set vehicle={}, or eadp vehicle {}"),
    "camera": ("a camera", "eadp cover FIELD --camera {}"),
    "profile": ("a profile", "--profile {}"),
    "energy": ("an energy model", "--energy {}"),
    "sweep": ("a sweep", "eadp sweep {}"),
    "field": ("a field", "eadp cover {}, which makes a plan of it"),
}
"""What each kind of file is, and where it belongs."""


def refuse_others(text: Text, own: str) -> None:
    """Refuse a file that is of another kind than its place has; `own` is the kind that is expected.

    Raises
    ------
    InputError
        With the option or the command that takes such a file.
    """
    head = text.body[:HEAD]
    found = _SCHEMA.search(head)
    kind = "field" if _FIELD.match(head) else found[1] if found else own
    if kind == own == "plan":
        for pattern, message in _FOREIGN:
            if re.search(pattern, head, re.DOTALL):
                raise InputError.at(text.name, 1, 1, message, _MISSIONS)
    if kind != own and kind in USES:
        what, use = USES[kind]
        use = use.replace("{}", printable(text.name))
        raise InputError.at(text.name, 1, 1, f"is {what}, not a {own}", f"a {own}; it belongs to {use}")


MARKS = {0xFD: (12, 10), 0xFE: (8, 6)}
"""First bytes of frames of MAVLink 2 and 1: the bytes of a frame beside its payload, and of these the header's."""
TLOG_HEAD = 8
"""Bytes of the time before each frame of a telemetry log."""


def is_tlog(head: bytes) -> bool:
    """Whether a file that starts so is one: a time of this century in microseconds, then a frame of MAVLink."""
    return len(head) > TLOG_HEAD and head[0] == 0 and 3 <= head[1] <= 8 and head[TLOG_HEAD] in MARKS
