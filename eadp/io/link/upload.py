"""The mission in flight: whether the autopilot holds the one that the map is of, and the rest of it replaced.

Items up to the stage being flown stay as they are, so that the autopilot's item stays the same one: a new path
parameter waits for a later stage. The mission is read before each upload, and one that somebody has changed is left
alone. A mission counts as uploaded once the autopilot has given it back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from eadp.core.geometry.curves import Point
from eadp.errors import PathUndefined
from eadp.io.link.mission import MissionClient
from eadp.io.mission import draft as d
from eadp.io.mission.draft import MissionItem
from eadp.io.mission.export import mission_items
from eadp.io.mission.items import MappedItem, mapped_items, same_items
from eadp.io.mission.path import PlannedPath, planned_sections
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import PlannedLegs

SETTLED_S = 5.0
"""Time in which an autopilot goes back to the item that it flew to, after an upload [s]."""
AGAIN_S = 10.0
"""Time after which a transfer that failed is tried again [s]."""
SINGLE = 1e-6
"""Relative error of numbers that were sent in single precision."""
WHOLE_M = 10.0
"""ArduPilot keeps the radius of a loiter in whole metres, above 255 m in tens [m]."""


class _Upload(NamedTuple):
    """An upload that is not verified yet: its items, home included, their map, and the path parameters decided."""

    items: list[MissionItem]
    mission: list[MappedItem]
    decided: tuple[float, ...]
    partial: bool


class HeldMission:
    """What the autopilot holds, beside the map of the mission's items.

    Parameters
    ----------
    plan : Plan
    airspeed_mps : float
        Of the aircraft [m/s].
    items : sequence of MappedItem
        The map.
    give : function
        Sends a message to the autopilot, by its name and fields.
    say, note : function
        Take a warning, and what happened.
    changed : function
        Takes the map that holds from now on; None where the mission is unknown.

    Attributes
    ----------
    ardupilot : bool
        Whether the autopilot is ArduPilot, whose item 0 is home.
    """

    def __init__(
        self,
        plan: Plan,
        airspeed_mps: float,
        items: Sequence[MappedItem],
        give: Callable[[str, Mapping[str, Any]], None],
        say: Callable[[str], None],
        note: Callable[[str], None],
        changed: Callable[[list[MappedItem] | None], None],
    ) -> None:
        self._plan, self._airspeed_mps, self._items = plan, airspeed_mps, list(items)
        self._give, self._say, self._note, self._changed = give, say, note, changed
        self._client = MissionClient(give)
        self.ardupilot = False
        self._held: list[MissionItem] | None = None
        """As read from the autopilot, home included where it has one."""
        self._upload: _Upload | None = None
        self._takes_parts = True
        self._asked: tuple[float, ...] | None = None
        self._count: int | None = None
        self._failed_s = -math.inf
        self._unread = False
        self._now_s = 0.0
        self._item: int | None = None
        self._beyond: int | None = None
        """The item that is flown to, and the last one beyond the first: to that one an autopilot goes back."""
        self._resume: tuple[int, float] | None = None

    @property
    def _home(self) -> int:
        return int(self.ardupilot)

    # --- reading

    def read(self, now_s: float) -> None:
        """Read the autopilot's mission, and see whether it is that of the map."""
        if not self._client.busy:
            self._client.download(now_s, self._judge)

    def count(self, items: int | None, now_s: float) -> None:
        """Read the mission again where the autopilot has another number of items than before."""
        if items == self._count or self._client.busy:
            return
        if self._count is not None:
            self.read(now_s)
        self._count = items

    def take(self, kind: str, fields: Mapping[str, Any], now_s: float) -> None:
        """Take a message of the mission protocol."""
        self._now_s = now_s
        self._client.take(kind, fields, now_s)

    def tick(self, now_s: float, item: int | None) -> None:
        """Repeat what is not answered; and go back to the item that was flown to, where an upload has reset it."""
        self._now_s = now_s
        self._client.tick(now_s)
        if self._unread and now_s - self._failed_s >= AGAIN_S:
            self.read(now_s)
        self._item = item
        if item is not None and item > self._home:
            self._beyond = item
        if self._resume is not None:
            number, until_s = self._resume
            if now_s > until_s:
                self._resume = None
            elif item is not None and item <= self._home < number:  # to any other one a pilot may have gone back
                self._give("MISSION_SET_CURRENT", {"seq": number})

    def _judge(self, held: list[MissionItem] | None) -> None:
        """See which mission the autopilot holds: the one uploaded, the one before, or another."""
        upload, self._unread = self._upload, held is None
        if held is None:
            self._failed_s = self._now_s
            self._say("mission cannot be read: read again each 10 s, and taken as that of before")
            return
        self._upload = None
        if upload is not None and self._equal(held, upload.items):
            self._held, self._items, self._asked, self._count = held, upload.mission, upload.decided, None
            self._changed(upload.mission)
            self._note(f"the rest of the mission is uploaded and verified: {len(upload.mission)} items")
        elif upload is not None and self._held is not None and self._equal(held, self._held):
            self._failed_s, self._takes_parts = self._now_s, self._takes_parts and not upload.partial
            self._say("new mission refused; the old one is kept")
        elif upload is not None:
            self._lose("mission unknown after an upload: see to it")
        elif same_items([each.item for each in self._items], held[self._home :]):
            if self._held is None:
                self._note(f"the autopilot holds the mission of --items: {len(self._items)} items")
            self._held = held
            self._changed(self._items)
        else:
            self._lose("another mission than that of --items is held: the stage is found by the position")

    def _lose(self, what: str) -> None:
        self._held = None
        self._say(what)
        self._changed(None)

    def gets(self, decided: tuple[float, ...] | None) -> bool:
        """Whether the mission has the path parameters decided, or they are on their way."""
        return self._held is not None and (self._client.busy or self._upload is not None or self._has(decided))

    def _has(self, decided: tuple[float, ...] | None) -> bool:
        """Whether these were uploaded, or the items of the stages ahead have them; the last, where none is flown to."""
        if self._asked is not None:
            return decided == self._asked
        index = -1 if self._item is None else self._item - self._home
        if not 0 <= index < len(self._items):
            return decided == self._items[-1].parameters if self._items else True
        return all(each.parameters == decided for each in self._items if each.first > self._items[index].first)

    # --- writing

    def update(self, now_s: float, decided: tuple[float, ...], rest: Callable[[], PlannedLegs | None]) -> None:
        """Replace the rest of the mission where other path parameters are decided; `rest` gives what is left to fly."""
        if self._held is None or self._unread or self.gets(decided) or now_s - self._failed_s < AGAIN_S:
            return
        if (why := self._altitude_fault(self._held)) is not None:
            self._failed_s = now_s
            self._say(f"{why}; no upload")
            return
        self._client.download(now_s, lambda held: self._replace(held, decided, rest))

    def _replace(
        self, held: list[MissionItem] | None, decided: tuple[float, ...], rest: Callable[[], PlannedLegs | None]
    ) -> None:
        """Upload, if the autopilot holds what it held."""
        assert self._held is not None
        if held is None or not self._equal(held, self._held):
            self._judge(held)
            return
        try:
            planned = rest()
            made = None if planned is None else self._replaced(planned)
        except PathUndefined as error:
            self._say(f"the rest cannot be laid out; no upload: {error}")
            made = None
        if made is None:
            self._failed_s = self._now_s
            return
        kept, new = made
        items = [*self._held[: self._home + kept], *(each.item for each in new)]
        partial = self._takes_parts and self.ardupilot and len(items) == len(self._held) and bool(new)
        self._upload = _Upload(items, [*self._items[:kept], *new], decided, partial)

        def verify() -> None:
            if self._beyond is not None:
                self._resume = self._beyond, self._now_s + SETTLED_S
            self._client.download(self._now_s, self._judge)

        self._client.upload(self._now_s, items, self._home + kept, verify, partial=partial)

    def _altitude_fault(self, held: list[MissionItem]) -> str | None:
        """Why the altitudes of the mission cannot be kept: new items are above home, at the altitude of the others."""
        placed = [item for item in held[self._home :] if item.frame in d.FRAMES and any(item.parameters[4:6])]
        if any(d.FRAMES[item.frame] != d.RELATIVE for item in placed):
            return "altitudes of the mission are not above home"
        own = all(stage.altitude_m is None for stage in self._plan.stages)
        if own and len({round(item.parameters[6], 1) for item in placed}) > 1:
            return "altitudes of the mission are not those of the plan"
        return None

    def _replaced(self, planned: PlannedLegs) -> tuple[int, list[MappedItem]] | None:
        """How many items stay, and those that follow."""
        assert self._held is not None
        kept = sum(each.first <= planned.started for each in self._items)
        done = max([planned.started, *(each.last for each in self._items[:kept])])
        left = planned.after(done - planned.started + 1)
        if not any(leg.distance_m > 0 for leg in left.legs):
            return kept, []
        held = self._held[self._home :]
        altitudes_m = [
            item.parameters[6] for item in held[:kept] if item.frame in d.FRAMES and any(item.parameters[4:6])
        ]
        triggers_m = [
            item.parameters[0] for item in held if item.command == d.TRIGGER_DISTANCE and item.parameters[0] > 0
        ]
        returns = held[-1].command == d.RETURN
        site = self._plan.site
        assert site.origin_deg is not None
        home: Point | None = site.origin_deg if returns else None
        path = PlannedPath(
            "the rest",
            planned_sections(left.legs),
            site.origin_deg,
            altitudes_m[-1] if altitudes_m else held[0].parameters[6],
            self._airspeed_mps,
            home,
            triggers_m[0] if triggers_m else None,
            airspace=site.airspace,
        )
        return kept, mapped_items(mission_items(path, flying=True), left, self._plan.path_count)

    def _equal(self, held: Sequence[MissionItem], written: Sequence[MissionItem]) -> bool:
        """Whether the mission held is the one written, in all numbers but home, which ArduPilot sets."""
        return _equal(held[self._home :], written[self._home :])


def _equal(held: Sequence[MissionItem], written: Sequence[MissionItem]) -> bool:
    return same_items(written, held) and all(map(_is_same, held, written))


def _is_same(held: MissionItem, written: MissionItem) -> bool:
    """Whether an item is the one written, as an autopilot keeps it: one without a position has any frame."""
    numbers = list(zip(held.parameters[:4], written.parameters[:4], strict=True))
    if written.command == d.LOITER_TURNS:
        radius, kept = numbers.pop(2)
        if not abs(radius - kept) < (WHOLE_M if abs(kept) > 255 else 1.0):
            return False
    if written.frame in d.FRAMES:
        if d.FRAMES.get(held.frame) != d.FRAMES[written.frame]:
            return False
        numbers.append((held.parameters[6], written.parameters[6]))
    return all(
        math.isclose(x, y, rel_tol=SINGLE, abs_tol=SINGLE) or (math.isnan(x) and math.isnan(y)) for x, y in numbers
    )
