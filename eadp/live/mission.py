"""The mission that an autopilot holds: read, and replaced, by MAVLink's mission protocol.

Source: mavlink.io, "Mission Protocol": a request is repeated after 1.5 s, one of an item after 0.25 s, five
times. One of an item is repeated more often here: of 300 items, one or another has six answers lost in a row where a
link loses 15 % either way. PX4 ends a transfer after 5 s of silence. ArduPilot answers an item that comes twice with an
error, and goes on receiving.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from eadp.exchange import items as d
from eadp.exchange.item_map import MappedItem, mapped_items
from eadp.exchange.items import GLOBAL_FRAMES, ITEMS_LIMIT, MissionItem
from eadp.exchange.path import PlannedPath, planned_sections
from eadp.exchange.writer import mission_items
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
        self._sent: dict[int, MissionItem] | None = None  # while writing, else None: the items by number

    @property
    def busy(self) -> bool:
        """Whether a transfer goes on."""
        return self._received is not None or self._sent is not None

    def download(self, now_s: float) -> None:
        """Begin to read the mission."""
        self._received, self._count, self._sent = [], None, None
        self._ask(now_s, "MISSION_REQUEST_LIST", {})

    def upload(self, now_s: float, items: Sequence[MissionItem], first: int, *, partial: bool) -> None:
        """Begin to write a mission, or with `partial` its items from the `first` on."""
        self._received, self._sent = None, dict(enumerate(items))
        if partial:
            self._ask(now_s, "MISSION_WRITE_PARTIAL_LIST", {"start_index": first, "end_index": len(items) - 1})
        else:
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
            if fields["seq"] in self._sent:
                self._ask(now_s, "MISSION_ITEM_INT", _fields(fields["seq"], self._sent[fields["seq"]]))
        elif kind == "MISSION_ACK" and fields["type"] != INVALID_SEQUENCE:
            last = self._request.fields.get("seq") == max(self._sent)
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
        # stages count from 1; `started` is the one being flown; `mapped` is in order, so that the count is a prefix
        kept = sum(each.first <= planned.started for each in mapped)
        # new items follow the last stage that an item that stays leads along: `left` is without its leg, too
        last_stage = max([planned.started, *(each.last for each in mapped[:kept])])
        left = planned.after(last_stage - planned.started + 1)
        if not any(leg.distance_m > 0 for leg in left.legs):
            return kept, []
        site = self._plan.site
        assert site.origin_deg is not None
        path = PlannedPath(
            name="the rest",
            sections=planned_sections(left.legs),
            origin_deg=site.origin_deg,
            altitude_m=(_altitudes_m(held[:kept]) or _altitudes_m(held)[::-1] or [held[0].altitude_m])[-1],
            airspeed_mps=self._airspeed_mps,
            home_deg=site.origin_deg if held[-1].command == d.RETURN else None,
            trigger_distance_m=self._trigger_distance_m(held),
            airspace=site.airspace,
            calibrated=self._calibrated,
        )
        return kept, mapped_items(mission_items(path, flying=True, px4=px4), left, self._plan.path_count)

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
