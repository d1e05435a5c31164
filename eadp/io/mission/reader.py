"""Plans and missions of other software, recognised by their content, as plans.

`FORMATS` lists the formats of missions: a recogniser and a reader each. A reader returns a draft, which is checked and
flown through here, item by item. A text that none of them recognises is a plan of eadp.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from eadp.errors import InputError
from eadp.io.mission.draft import MissionDraft
from eadp.io.mission.qgc import read_qgc
from eadp.io.mission.wpl import read_wpl
from eadp.io.plan.reader import LIMIT_CHARACTERS
from eadp.io.plan.sources import PlanReader
from eadp.io.text.source import SourceText
from eadp.io.text.streams import Text
from eadp.models.plan.plan import Finding, Plan
from eadp.plug_ins import plug_ins


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

HEAD = 200
"""Characters from the start of a text by which its format is recognised."""


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
        from eadp.io.mission.plan import MissionPlan

        return MissionPlan(source, chosen.read(source), reader).plan()


MISSION = _Missions()


def _format_of(text: Text) -> MissionFormat | None:
    """The format of a mission by its first characters; None for a plan of eadp."""
    head = text.body.lstrip()[:HEAD]
    found = next((each for each in FORMATS if each.recognise(head)), None)
    if found is None:
        found = next((each for each in plug_ins("mission_formats") if each.recognise(head)), None)
    return found
