"""The mission that an autopilot holds: read and replaced by MAVLink's mission protocol, and the rest of it in flight.

Items up to the stage being flown stay as they are, so that the autopilot's item stays the same one: a new path
parameter waits for a later stage. The mission is read before each upload, and one that somebody has changed is left
alone. A new mission is flown from its acknowledgement on, and its map holds from then on; it counts as uploaded once
the autopilot has given it back. If that gives the old one, its map holds again. One that is torn, the first items of
the new mission before the rest of the old one, is sent again.

Source: mavlink.io, "Mission Protocol": a request is repeated after 1.5 s, one of an item after 0.25 s, five
times. One of an item is repeated more often here: of 300 items, one or another has six answers lost in a row where a
link loses 15 % either way. PX4 ends a transfer after 5 s of silence. ArduPilot answers an item that comes twice with an
error, and goes on receiving.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from eadp.errors import PathUndefined
from eadp.exchange import items as d
from eadp.exchange.items import GLOBAL_FRAMES, ITEMS_LIMIT, MissionItem
from eadp.exchange.path import PlannedPath, planned_sections
from eadp.exchange.writer import MappedItem, mapped_items, mission_items, same_items
from eadp.live.mavlink import is_number
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import PlannedLegs

RETRY_S, ITEM_RETRY_S, MAX_TRIES, ITEM_TRIES = 1.5, 0.25, 6, 16
"""Time after which a request, and one of an item, is repeated [s]; how often each is sent at most."""
ACCEPTED, NO_SPACE, INVALID_SEQUENCE = 0, 4, 13
"""How a transfer ended, or what is wrong with it: `type` of MISSION_ACK."""
SCALE = 1e7
"""Positions are sent in units of 1e-7 degrees."""

PROTOCOL = frozenset(("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"))
"""Messages of the protocol that an autopilot sends."""


class Outgoing(NamedTuple):
    """A message to the autopilot: its name and fields."""

    kind: str
    fields: Mapping[str, Any]


class Received(NamedTuple):
    """The end of a reading: the items, or None where the mission cannot be read."""

    items: list[MissionItem] | None


class Sent(NamedTuple):
    """The end of a writing, and whether the autopilot has accepted what was sent."""

    accepted: bool


class MissionClient:
    """One transfer at a time: a mission from an autopilot, or to it.

    Attributes
    ----------
    messages : list of Outgoing
        To be sent; the caller takes them.
    """

    def __init__(self) -> None:
        self.messages: list[Outgoing] = []
        self._request = Outgoing("", {})  # waits for an answer
        self._due_s, self._tries = 0.0, 0  # when the request is repeated [s], and how often it was sent
        self._received: list[MissionItem] | None = None  # while reading, else None: the items that have come
        self._count: int | None = None  # while reading: how many items there are; None before the autopilot says it
        self._sent: list[MissionItem] | None = None  # while writing, else None: the items

    @property
    def busy(self) -> bool:
        """Whether a transfer goes on."""
        return self._received is not None or self._sent is not None

    def download(self, now_s: float) -> None:
        """Begin to read the mission."""
        self._received, self._count, self._sent = [], None, None
        self._ask(now_s, "MISSION_REQUEST_LIST", {})

    def upload(self, now_s: float, items: Sequence[MissionItem]) -> None:
        """Begin to write a mission."""
        self._received, self._sent = None, list(items)
        self._ask(now_s, "MISSION_COUNT", {"count": len(items)})

    def take(self, kind: str, fields: Mapping[str, Any], now_s: float) -> Received | Sent | None:
        """Take a message of the protocol that has come for this computer; return the end of a transfer, if it ends.

        An autopilot that is written to asks for each item, and acknowledges at the end.
        """
        if self._received is not None:
            return self._receive(self._received, kind, fields, now_s)
        if self._sent is None:
            return None
        if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            if fields["seq"] < len(self._sent):
                self._ask(now_s, "MISSION_ITEM_INT", _fields(fields["seq"], self._sent[fields["seq"]]))
        elif kind == "MISSION_ACK" and fields["type"] != INVALID_SEQUENCE:
            last = self._request.fields.get("seq") == len(self._sent) - 1
            return self._end(accepted=last and fields["type"] == ACCEPTED)
        return None

    def tick(self, now_s: float) -> Received | Sent | None:
        """Repeat a request that is not answered in time; after `MAX_TRIES` give up, and return the transfer's end."""
        if not self.busy or now_s < self._due_s:
            return None
        if self._tries < (ITEM_TRIES if self._request.kind == "MISSION_REQUEST_INT" else MAX_TRIES):
            self._tries += 1
            self._send(now_s)
            return None
        return self._end()

    # --- steps

    def _receive(
        self, received: list[MissionItem], kind: str, fields: Mapping[str, Any], now_s: float
    ) -> Received | Sent | None:
        """Take a message of a reading: the number of items, or the next item; ask for the item after it.

        Returns what was read once the last item has come, or the reading has failed, as it does where there are more
        items than `ITEMS_LIMIT` and home; else None. Other messages, and items out of order, are passed over: a request
        that is not answered is repeated.
        """
        if kind == "MISSION_COUNT" and self._count is None:
            if fields["count"] > ITEMS_LIMIT + 1:
                self.messages.append(Outgoing("MISSION_ACK", {"type": NO_SPACE}))
                return self._end()
            self._count = fields["count"]
        elif kind == "MISSION_ITEM_INT" and self._count is not None and fields["seq"] == len(received):
            received.append(_item(fields))
        elif kind == "MISSION_ACK" and fields["type"] != ACCEPTED:
            return self._end()
        else:
            return None
        if len(received) < (self._count or 0):
            self._ask(now_s, "MISSION_REQUEST_INT", {"seq": len(received)})
            return None
        self.messages.append(Outgoing("MISSION_ACK", {"type": ACCEPTED}))
        return self._end(received)

    def _ask(self, now_s: float, kind: str, fields: dict[str, Any]) -> None:
        """Send a message that is repeated until it is answered."""
        self._request, self._tries = Outgoing(kind, fields), 1
        self._send(now_s)

    def _send(self, now_s: float) -> None:
        """Send the present request, once more."""
        self._due_s = now_s + (ITEM_RETRY_S if self._request.kind == "MISSION_REQUEST_INT" else RETRY_S)
        self.messages.append(self._request)

    def _end(self, items: list[MissionItem] | None = None, *, accepted: bool = False) -> Received | Sent:
        """End the transfer; `items` are those read, None where they could not be."""
        ended = Sent(accepted) if self._received is None else Received(items)
        self._received = self._sent = None
        return ended


def _fields(number: int, item: MissionItem) -> dict[str, Any]:
    """The fields of MISSION_ITEM_INT for an item, numbered from 0: degrees as whole numbers, see `SCALE`."""
    factor = SCALE if item.frame in GLOBAL_FRAMES else 1.0
    *numbers, x, y, z = item.parameters
    return {
        "seq": number,
        "frame": item.frame,
        "command": item.command,
        "current": 0,
        "autocontinue": 1,
        **{f"param{k}": value for k, value in enumerate(numbers, 1)},
        "x": round(x * factor),
        "y": round(y * factor),
        "z": z,
    }


def _item(fields: Mapping[str, Any]) -> MissionItem:
    """The mission item of a message MISSION_ITEM_INT, its position in degrees where its frame is a global one."""
    factor = SCALE if fields["frame"] in GLOBAL_FRAMES else 1.0
    values = (*(fields[f"param{k}"] for k in range(1, 5)), fields["x"] / factor, fields["y"] / factor, fields["z"])
    return MissionItem(fields["command"], fields["frame"], tuple(v if is_number(v) else math.nan for v in values))


class RestLayout:
    """Lays out what is left of a plan as items.

    Parameters
    ----------
    plan : Plan
    airspeed_mps, calibrated : float
        Of the aircraft [m/s], and the airspeed that an autopilot holds over it.
    """

    def __init__(self, plan: Plan, airspeed_mps: float, calibrated: float = 1.0) -> None:
        self._plan, self._airspeed_mps, self._calibrated = plan, airspeed_mps, calibrated

    def altitude_fault(self, held: Sequence[MissionItem]) -> str | None:
        """Why new items cannot have the altitudes of the items held, None where they can.

        New items are above home, all at one altitude, but where the plan's stages have altitudes of their own. That up
        to which a take-off climbs is none of the plan.
        """
        if any(item.placed and d.GLOBAL_FRAMES[item.frame] != d.RELATIVE for item in held):
            return "altitudes of the mission are not above home"
        at_one_altitude = all(stage.altitude_m is None for stage in self._plan.stages)
        if at_one_altitude and len({round(altitude_m, 1) for altitude_m in _altitudes_m(held)}) > 1:
            return "altitudes of the mission are not those of the plan"
        return None

    def after(
        self, held: Sequence[MissionItem], mapped: Sequence[MappedItem], planned: PlannedLegs, *, px4: bool
    ) -> tuple[int, list[MappedItem]]:
        """The number of items held that stay, the first ones, and the new items that follow them.

        Parameters
        ----------
        held, mapped : sequence
            The items that are held, home aside, and the stages of each; in order.
        planned : PlannedLegs
            What is left to fly, from the stage being flown on.
        px4 : bool
            Whether turns are waypoints, see `mission_items`.

        Raises
        ------
        PathUndefined
            If it cannot be laid out.
        """
        # stages count from 1; `started` is the one being flown
        kept, last_stage = 0, planned.started
        for each in mapped:  # one that stays may lead on along the next stage, all of whose items stay then
            if each.first > last_stage:
                break
            kept, last_stage = kept + 1, max(last_stage, each.last)
        left = planned.after(last_stage - planned.started + 1)
        if not any(leg.distance_m > 0 for leg in left.legs):
            return kept, []
        site, commanded_mps = self._plan.site, self._commanded_mps(held[:kept])
        assert site.origin_deg is not None
        path = PlannedPath(
            name="the rest",
            sections=planned_sections(left.legs),
            origin_deg=site.origin_deg,
            altitude_m=_altitude_from_m(held, kept),
            airspeed_mps=self._airspeed_mps,
            home_deg=site.origin_deg if held[-1].command == d.RETURN else None,
            trigger_distance_m=self._trigger_distance_m(held),
            airspace=site.airspace,
            stated_mps=self._airspeed_mps if self._airspeed_mps in self._commanded_mps(held) else None,
            flown_mps=commanded_mps[-1] if commanded_mps else None,
            calibrated=self._calibrated,
        )
        return kept, mapped_items(mission_items(path, flying=True, px4=px4), left, self._plan.path_count)

    def _commanded_mps(self, items: Sequence[MissionItem]) -> list[float | None]:
        """True airspeeds that items command [m/s], None for the aircraft's own; its cruise to the last digit."""
        changes = [item.parameters for item in items if item.command == d.CHANGE_SPEED]
        speeds = [
            speed for of_ground, speed, *_ in changes if not of_ground and (speed > 0 or speed == d.DEFAULT_SPEED)
        ]
        cruise_mps, scale = self._airspeed_mps, self._calibrated

        def true_mps(speed: float) -> float | None:
            if speed < 0:
                return None
            return cruise_mps if abs(speed - cruise_mps * scale) < 1e-3 else speed / scale

        return [true_mps(speed) for speed in speeds]

    def _trigger_distance_m(self, held: Sequence[MissionItem]) -> float | None:
        """Distance between pictures, for a mission that takes them all the way [m]; None without, or where stages have
        commands for it."""
        if any(command[0] == d.TRIGGER_DISTANCE for stage in self._plan.stages for command in stage.commands):
            return None
        distances = (item.parameters[0] for item in held if item.command == d.TRIGGER_DISTANCE)
        return next((distance_m for distance_m in distances if distance_m > 0), None)


def _altitudes_m(items: Sequence[MissionItem]) -> list[float]:
    """Altitudes of the items with a position [m], without the take-off's."""
    return [item.altitude_m for item in items if item.placed and item.command != d.TAKEOFF]


def _altitude_from_m(items: Sequence[MissionItem], index: int) -> float:
    """Altitude at which an index is come to [m]: that before it, or else the first one, or else of the first item."""
    if before_m := _altitudes_m(items[:index]):
        return before_m[-1]
    return next(iter(_altitudes_m(items[index:])), items[0].altitude_m)


SETTLED_S = 5.0
"""Time in which an autopilot goes back to the item that it flew to, after an upload [s]."""
AGAIN_S, RECHECK_S = 10.0, 60.0
"""Time after which what failed is tried again, as is the reading of an unknown mission; and after which a known mission
is read again [s]."""


class Warned(NamedTuple):
    """Something that the pilot is to know."""

    text: str


class Noted(NamedTuple):
    """Something that has happened as it should."""

    text: str


class Holds(NamedTuple):
    """The autopilot holds the mission of a map, of so many items."""

    items: int


class Mapped(NamedTuple):
    """The map that holds from now on; None where the mission is another."""

    items: list[MappedItem] | None


Output = Outgoing | Warned | Noted | Holds | Mapped

Rest = Callable[[], PlannedLegs | None]
"""Gives what is left to fly."""


class State(Enum):
    """What is known of the mission that the autopilot holds, and what is done about it."""

    UNKNOWN = "not read, or not ours: read again after `AGAIN_S`"
    READING = "being read"
    HELD = "ours: read again after `RECHECK_S`"
    REFUSED = "ours, but the rest could not be replaced: tried again after `AGAIN_S`"
    CHECKING = "being read, so that nothing that somebody else has sent is replaced"
    CHECKED = "as it was: the rest is laid out and sent at the next decision within `AGAIN_S`"
    UPLOADING = "the rest is being sent"
    VERIFYING = "being read back"
    TORN = "the first items of the new one, then the rest of the old one: replaced at the next decision"


REPLACING = (State.CHECKING, State.CHECKED, State.UPLOADING, State.VERIFYING, State.TORN)
"""States in which a mission with the parameters decided is on its way."""


class _Upload(NamedTuple):
    """What is being uploaded.

    Attributes
    ----------
    items : list of MissionItem
        The whole new mission, home included.
    mission : list of MappedItem
        Its map, home aside.
    decided : tuple of float
        The path parameters that it has.
    """

    items: list[MissionItem]
    mission: list[MappedItem]
    decided: tuple[float, ...]


class _ItemFlown:
    """The item that the aircraft flies to, as the autopilot numbers it.

    After an upload some autopilots start again from the first item: they are sent back to the item of before.
    """

    def __init__(self) -> None:
        self.item: int | None = None
        """The item flown to, None where it is unknown."""
        self._beyond: int | None = None
        """The last item flown to other than the first of the mission."""
        self._resume: tuple[int, float] | None = None
        """After an upload: the item to fly to, and until when an autopilot may be sent back to it [s]."""

    def uploaded(self, now_s: float) -> None:
        """Note the end of an upload: the item flown to before it is still the one to fly to."""
        if self._beyond is not None:
            self._resume = self._beyond, now_s + SETTLED_S

    def take(self, item: int | None, first: int, now_s: float) -> int | None:
        """Take the item that is flown to; return the item to go back to where the autopilot started again, else None.

        `first` is the number of the first item of the mission.
        """
        self.item = item
        if item is not None and item > first:
            self._beyond = item
        if self._resume is None:
            return None
        number, until_s = self._resume
        if now_s > until_s:
            self._resume = None
            return None
        # an autopilot that started again is at the first item; to any other item a pilot may have gone back
        return number if item is not None and item <= first < number else None


class HeldMission:
    """What the autopilot holds, as a state machine (`State`): each event returns what is to be done.

    UNKNOWN → READING → HELD. Where another path is decided: HELD → CHECKING → CHECKED → UPLOADING → VERIFYING → HELD,
    or REFUSED or TORN, from which the upload is tried again.

    Parameters
    ----------
    plan : Plan
    airspeed_mps : float
        Of the aircraft [m/s].
    items : sequence of MappedItem
        The map of the mission that was exported.
    latest : sequence of MappedItem, optional
        The map of the last mission that was uploaded, if one was.
    calibrated : float, optional
        The airspeed that an autopilot holds, over the aircraft's.

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
        latest: Sequence[MappedItem] | None = None,
        calibrated: float = 1.0,
    ) -> None:
        self._layout, self._client = RestLayout(plan, airspeed_mps, calibrated), MissionClient()
        self.ardupilot = False
        self._state = State.UNKNOWN
        # maps: of the mission exported, and of the one that the autopilot holds, or held last
        self._exported, self._items = list(items), list(items if latest is None else latest)
        self._held: list[MissionItem] | None = None
        """The items as read, home included where the autopilot has one; None where the mission is of neither map."""
        self._upload: _Upload | None = None
        self._uploaded: tuple[float, ...] | None = None  # path parameters of the mission held, where it was uploaded
        self._count: int | None = None  # the number of items that the autopilot said last
        # when something is tried again in this state, and the time of the present event [s]
        self._again_s, self._now_s = math.inf, 0.0
        self._flown = _ItemFlown()
        self._outputs: list[Output] = []

    # --- events

    def read(self, now_s: float) -> list[Output]:
        """Have the autopilot's mission read; once it has come it is judged, see `_judge`."""
        if not self._client.busy:
            self._go(State.READING if self._upload is None else State.VERIFYING)
            self._client.download(now_s)
        return self._done()

    def count(self, items: int | None, now_s: float) -> list[Output]:
        """Take the number of items that the autopilot says it holds; have the mission read again where that changes.

        Of a mission that was sent it says that it is flown, too, as the acknowledgement may be lost. ArduPilot cuts the
        old mission first where the new one is shorter.
        """
        upload, before_upload = self._upload, len(self._items)
        cut = upload is not None and self.ardupilot and len(upload.mission) < before_upload
        if upload is not None and not cut and before_upload != items == len(upload.mission):
            self._outputs.append(Mapped(upload.mission))
            return self._done()
        if items == self._count or self._client.busy:
            return []
        before, self._count = self._count, items
        return [] if before is None and self._state is not State.UNKNOWN else self.read(now_s)

    def take(self, kind: str, fields: Mapping[str, Any], now_s: float) -> list[Output]:
        """Pass a message of the mission protocol to the transfer, and go on where that ends."""
        self._now_s = now_s
        self._ended(self._client.take(kind, fields, now_s))
        return self._done()

    def tick(self, now_s: float, item: int | None) -> list[Output]:
        """Repeat a request that is not answered, and what is due to be tried again; `item` is the item flown to."""
        self._now_s = now_s
        self._ended(self._client.tick(now_s))
        if self._state in (State.UNKNOWN, State.HELD) and now_s >= self._again_s:
            self._outputs += self.read(now_s)
        if (number := self._flown.take(item, self._home, now_s)) is not None:
            self._outputs.append(Outgoing("MISSION_SET_CURRENT", {"seq": number}))
        return self._done()

    def decide(self, now_s: float, decided: tuple[float, ...], rest: Rest) -> list[Output]:
        """Take the path parameters decided: have the rest of the mission replaced where its parameters are others.

        The mission is read first (CHECKING); when it has come (CHECKED), the next decision lays the rest out and sends
        it.
        """
        self._now_s = now_s
        waits = self._state is State.REFUSED and now_s < self._again_s
        if self._state in (State.HELD, State.REFUSED, State.CHECKED, State.TORN) and not waits:
            if self._has(decided):
                if self._state is not State.HELD:  # HELD already: the time of its next reading stays
                    self._go(State.HELD, RECHECK_S)
            elif self._state is State.CHECKED and now_s < self._again_s:
                self._send(decided, rest)
            elif (why := self._layout.altitude_fault((self._held or [])[self._home :])) is not None:
                self._refuse(f"{why}; no upload")
            else:
                self._go(State.CHECKING)
                self._client.download(now_s)
        return self._done()

    def gets(self, decided: tuple[float, ...] | None) -> bool:
        """Whether the mission has the path parameters decided, or an upload with them is under way or due."""
        replacing = self._state in REPLACING or self._upload is not None
        return self._held is not None and (replacing or self._has(decided))

    # --- steps

    @property
    def _home(self) -> int:
        """Number of the first item that is of the mission: 1 where item 0 is home."""
        return int(self.ardupilot)

    def _done(self) -> list[Output]:
        """Take out what is to be done after an event, messages of the transfer first."""
        outputs, self._outputs = [*self._client.messages, *self._outputs], []
        self._client.messages.clear()
        return outputs

    def _go(self, state: State, again_s: float = math.inf) -> None:
        """Enter a state, and set after what time its next try, or reading, is due [s]."""
        self._state, self._again_s = state, self._now_s + again_s

    def _ended(self, transfer: Received | Sent | None) -> None:
        """Go on after a transfer, if one has ended: what was sent is read back, what was read is judged."""
        if isinstance(transfer, Sent):
            if transfer.accepted and self._upload is not None:
                self._outputs.append(Mapped(self._upload.mission))
            self._flown.uploaded(self._now_s)
            self._go(State.VERIFYING)
            self._client.download(self._now_s)
        elif isinstance(transfer, Received):
            held = transfer.items
            if self._state is State.CHECKING and held is not None and self._equal(held, self._held or []):
                self._go(State.CHECKED, AGAIN_S)
            else:
                self._judge(held)

    def _judge(self, held: list[MissionItem] | None) -> None:
        """See which mission an autopilot holds by the items read, None where they could not be; enter the state for it.

        After an upload see `_judge_upload`. Else it is the mission of one of the two maps, or another one.
        """
        if held is None:
            self._go(State.UNKNOWN, AGAIN_S)
            self._outputs.append(Warned("mission cannot be read: read again each 10 s, and taken as that of before"))
            return
        upload, self._upload = self._upload, None
        if upload is not None and self._held is not None:
            self._judge_upload(upload, held, self._held)
            return
        for mapped in (self._items, self._exported):
            if same_items([each.item for each in mapped], held[self._home :]):
                if self._held is None:
                    self._outputs.append(Holds(len(mapped)))
                self._hold(held, mapped, self._uploaded if mapped is self._items else None)
                return
        if len(held) <= self._home and self._held is None:  # none has been sent yet
            self._go(State.UNKNOWN, AGAIN_S)
        else:
            self._lose("another mission than that of --items is held: the stage is found by the position")

    def _judge_upload(self, upload: _Upload, held: list[MissionItem], before: list[MissionItem]) -> None:
        """See what an upload has left: the new mission, the one before, the start of the new one before the rest of the
        old one, or another."""
        new = self._shared(held, upload.items)  # how many items, from the first on, are those of the new mission
        if new == len(held) == len(upload.items):
            self._count = None
            self._hold(held, upload.mission, upload.decided)
            self._outputs.append(Noted(f"the rest of the mission is uploaded and verified: {new} items"))
        elif self._equal(held, before):
            self._outputs.append(Mapped(self._items))
            self._refuse("new mission refused; the old one is kept")
        elif self._equal(held[new:], before[new : len(held)], home=False):
            # torn: until it is sent again it is flown as it is, by the start of the new map and the rest of the old one
            mixed = [*upload.mission[: new - self._home], *self._items[new - self._home :]]
            self._count = None
            self._hold(held, mixed[: len(held) - self._home], None, State.TORN)
            self._outputs.append(Warned("upload interrupted: it is sent again"))
        else:
            self._lose("mission unknown after an upload: see to it")

    def _hold(
        self,
        held: list[MissionItem],
        items: list[MappedItem],
        uploaded: tuple[float, ...] | None,
        state: State = State.HELD,
    ) -> None:
        """Note the mission that is held, its map, and the path parameters that it was uploaded with, if it was."""
        self._held, self._items, self._uploaded = held, items, uploaded
        self._go(state, RECHECK_S)
        self._outputs.append(Mapped(items))

    def _lose(self, what: str) -> None:
        """Note, with a warning, that a mission is held that no map is of."""
        self._held = None
        self._go(State.UNKNOWN, AGAIN_S)
        self._outputs += [Warned(what), Mapped(None)]

    def _refuse(self, why: str) -> None:
        """Note, with a warning, that the rest of the mission is not replaced."""
        self._go(State.REFUSED, AGAIN_S)
        self._outputs.append(Warned(why))

    def _has(self, decided: tuple[float, ...] | None) -> bool:
        """Whether the mission that is held has these path parameters.

        A mission that was uploaded has the parameters that it was uploaded with. Another one has them if all items
        after the stage being flown have; where that stage is not known, if the last item has.
        """
        if self._state is State.TORN:
            return False
        if self._uploaded is not None:
            return decided == self._uploaded
        index = -1 if self._flown.item is None else self._flown.item - self._home
        if not 0 <= index < len(self._items):
            return decided == self._items[-1].parameters if self._items else True
        return all(each.parameters == decided for each in self._items if each.first > self._items[index].first)

    # --- writing

    def _send(self, decided: tuple[float, ...], rest: Rest) -> None:
        """Lay the rest of the mission out, and begin to upload it after the items that stay."""
        assert self._held is not None
        try:
            if (planned := rest()) is None:
                self._go(State.REFUSED, AGAIN_S)
                return
            held, px4 = self._held[self._home :], not self.ardupilot
            kept, new = self._layout.after(held, self._items, planned, px4=px4)
        except PathUndefined as error:
            self._refuse(f"the rest cannot be laid out; no upload: {error}")
            return
        items = [*self._held[: self._home + kept], *(each.item for each in new)]
        # the parameters laid out may be others than those decided: one that was held may be asked for anew meanwhile
        laid_out = planned.parameters[-1][: len(decided)]
        self._upload = _Upload(items, [*self._items[:kept], *new], laid_out)
        self._go(State.UPLOADING)
        self._client.upload(self._now_s, items)

    def _equal(self, held: Sequence[MissionItem], written: Sequence[MissionItem], *, home: bool = True) -> bool:
        """Whether items held are those written, in all numbers but those of home, which ArduPilot sets."""
        first = self._home if home else 0
        return equal_items(held[first:], written[first:])

    def _shared(self, held: Sequence[MissionItem], written: Sequence[MissionItem]) -> int:
        """How many items held are those written, from the first on, home included."""
        pairs = zip(held[self._home :], written[self._home :], strict=False)
        different = (k for k, (one, other) in enumerate(pairs) if not equal_items([one], [other]))
        return self._home + next(different, min(len(held), len(written)) - self._home)


SINGLE = 1e-6
"""Relative error of numbers that were sent in single precision."""
ALTITUDE_M = 0.011
"""How far an altitude may be off that is kept in whole centimetres, cut off [m]."""
LARGE_M, TENS = 255.0, 10.0
"""ArduPilot has a byte for a radius: from this one on it keeps tens of metres [m]."""

Kept = Callable[[float], float]


def _same(value: float) -> float:
    return value


def _nothing(_value: float) -> float:
    return 0.0


def _whole(value: float) -> float:
    """Cut off, as it is in single precision."""
    return float(np.trunc(np.float32(value))) if math.isfinite(value) else 0.0


def _byte(value: float) -> float:
    return min(_whole(value), LARGE_M)


def _radius(value: float) -> float:
    """The radius of a loiter with turns."""
    return _whole(value) if abs(value) <= LARGE_M else TENS * _whole(value / TENS)


def _sign(value: float) -> float:
    return -1.0 if value < 0 else 1.0


def _flag(value: float) -> float:
    return float(value > 0)


Row = tuple[Kept, Kept, Kept, Kept]
_AS_SENT: Row = (_same, _same, _same, _same)
_NOTHING: Row = (_nothing, _nothing, _nothing, _nothing)

KEPT: dict[int, tuple[Row, Row]] = {
    d.WAYPOINT: ((_nothing, _byte, _byte, _nothing), (_same, _same, _nothing, _same)),
    d.LOITER_UNLIMITED: ((_nothing, _nothing, _whole, _nothing), (_nothing, _nothing, _same, _same)),
    d.LOITER_TURNS: ((_same, _nothing, _radius, _flag), _AS_SENT),
    d.LOITER_TIME: ((_whole, _nothing, _sign, _flag), (_same, _flag, _same, _flag)),
    d.RETURN: (_NOTHING, _AS_SENT),
    d.LAND: ((_whole, _nothing, _nothing, _sign), (_nothing, _whole, _nothing, _same)),
    d.TAKEOFF: ((_whole, _nothing, _nothing, _nothing), (_nothing, _nothing, _nothing, _same)),
    d.LOITER_TO_ALTITUDE: ((_nothing, _whole, _nothing, _flag), (_flag, _same, _nothing, _flag)),
    d.CHANGE_SPEED: ((_same, _same, _same, _nothing), _AS_SENT),
    d.LAND_START: (_NOTHING, _AS_SENT),
    d.TRIGGER_DISTANCE: ((_same, _nothing, _nothing, _nothing), _AS_SENT),
}
"""What ArduPilot and PX4 keep of the first four numbers of a command. A number that comes back as sent is kept, too."""
OTHERS: tuple[Row, Row] = ((_whole, _whole, _whole, _whole), _NOTHING)
"""Of commands that do not move the aircraft, as those of cameras and servos: each number is whole, or left out."""


def equal_items(held: Sequence[MissionItem], written: Sequence[MissionItem]) -> bool:
    """Whether the items held are the items written: as many of them, and the same numbers as far as they are kept."""
    return same_items(written, held) and all(map(_is_kept, held, written))


def _is_kept(held: MissionItem, written: MissionItem) -> bool:
    """Whether an item held is what an autopilot keeps of the one written.

    The frame and the altitude count only of an item that has a position.
    """
    if written.frame in d.GLOBAL_FRAMES:
        if d.GLOBAL_FRAMES.get(held.frame) != d.GLOBAL_FRAMES[written.frame]:
            return False
        if not math.isclose(held.altitude_m, written.altitude_m, rel_tol=SINGLE, abs_tol=ALTITUDE_M):
            return False
    rows = zip(_AS_SENT, *KEPT.get(written.command, OTHERS), strict=True)
    numbers = zip(held.parameters[:4], written.parameters[:4], rows, strict=True)
    return all(any(_is_near(has, keep(sent)) for keep in kept) for has, sent, kept in numbers)


def _is_near(one: float, other: float) -> bool:
    """Whether two numbers are the same in single precision, or neither is one."""
    return math.isclose(one, other, rel_tol=SINGLE, abs_tol=SINGLE) or (math.isnan(one) and math.isnan(other))
