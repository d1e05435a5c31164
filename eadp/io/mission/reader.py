"""Plans and missions of other software, recognised by their content, as plans.

`FORMATS` lists the formats of missions: a recogniser and a reader each. A reader returns a draft, which is checked and
flown through here, item by item. A text that none of them recognises is a plan of eadp.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from eadp.errors import InputError
from eadp.io.mission.draft import MissionDraft, MissionMotion
from eadp.io.mission.qgc import read_qgc
from eadp.io.mission.wpl import read_wpl
from eadp.io.plan import reader as plan_reader
from eadp.io.plan.reader import LIMIT_CHARACTERS
from eadp.io.text.kinds import refuse_others
from eadp.io.text.source import SourceText
from eadp.io.text.streams import Text
from eadp.models.battery import Battery
from eadp.models.performance import calibrated_over_true
from eadp.models.plan.plan import Finding, Plan, Site
from eadp.models.vehicle import Airframe, FixedWing, PaperVehicle
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
_STAGES = re.compile(r"^[^\S\n]*path\s*:|^[^;\n]*;[^;\n]*;[^;\n]*[xy]", re.MULTILINE)
"""What a plan of eadp has: a section of stages, or a stage."""


class PlanReader(MissionMotion):
    """Reads a plan, or a mission as a plan of an aircraft: called with a text, returns the plan and warnings."""

    @classmethod
    def of(cls, airframe: Airframe, battery: Battery, laps: int | None = None) -> PlanReader:
        """The reader for an aircraft: what repeats for ever is longer than the battery lasts."""
        wing = FixedWing() if isinstance(airframe, PaperVehicle) else airframe
        rates_mps = wing.climb_rates_mps(wing.airspeed_mps)
        endurance_s = battery.endurance_s(airframe.cruise_power_w)
        repeated_m = min(1.25 * endurance_s * airframe.airspeed_mps, 1e6)
        calibrated = calibrated_over_true(Site(), airframe)
        return cls(airframe.turn_radius_m, airframe.airspeed_mps, *rates_mps, repeated_m, laps, calibrated=calibrated)

    def turning(self, radius_m: float | None) -> PlanReader:
        """The reader for turns of a radius [m]; the same for None."""
        return self if radius_m is None else replace(self, turn_radius_m=radius_m)

    def __call__(self, text: Text) -> tuple[Plan, list[Finding]]:
        """Read a text.

        Raises
        ------
        InputError
            With every fault of the file.
        """
        chosen = _format_of(text)
        if chosen is None:
            refuse_others(text, "plan")
            return plan_reader.read_plan(text)
        if len(text.body) > LIMIT_CHARACTERS:
            raise InputError.at(text.name, 1, 1, "is too large for a mission", f"at most {LIMIT_CHARACTERS} characters")
        source = SourceText(text)
        from eadp.io.mission.plan import MissionPlan

        return MissionPlan(source, chosen.read(source), self).plan()


def is_mission(text: Text) -> bool:
    """Whether a text is a mission of other software."""
    return _format_of(text) is not None


def _format_of(text: Text) -> MissionFormat | None:
    """The format of a mission by its first characters; None for a plan of eadp."""
    head = text.body.lstrip()[:HEAD]
    found = next((each for each in FORMATS if each.recognise(head)), None)
    if found is None and not _STAGES.search(text.body):
        found = next((each for each in plug_ins("mission_formats") if each.recognise(head)), None)
    return found
