"""The mission that an autopilot holds: read, and replaced, by MAVLink's mission protocol.

Source: mavlink.io, "Mission Protocol": a request is repeated after 1.5 s, one of an item after 0.25 s, five
times. ArduPilot answers an item that comes twice with an error, and goes on receiving.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eadp.io.link.mavlink import is_number
from eadp.io.mission.draft import FRAMES, ITEMS_LIMIT, MissionItem

RETRY_S, ITEM_RETRY_S, MAX_TRIES = 1.5, 0.25, 6
ACCEPTED, INVALID_SEQUENCE = 0, 13
SCALE = 1e7
"""Positions are sent in units of 1e-7 degrees."""

PROTOCOL = frozenset(("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"))
"""Messages of the protocol that an autopilot sends."""

Give = Callable[[str, Mapping[str, Any]], None]


class MissionClient:
    """One transfer at a time: a mission from an autopilot, or to it.

    Parameters
    ----------
    give : function
        Sends a message of the protocol, by its name and fields, to the autopilot.
    """

    def __init__(self, give: Give) -> None:
        self._give = give
        self._request: tuple[str, dict[str, Any]] = ("", {})
        self._due_s, self._tries = 0.0, 0
        self._received: list[MissionItem] = []
        self._count: int | None = None
        self._sent: dict[int, MissionItem] = {}
        self._downloaded: Callable[[list[MissionItem] | None], None] | None = None
        self._uploaded: Callable[[], None] | None = None

    @property
    def busy(self) -> bool:
        """Whether a transfer goes on."""
        return self._downloaded is not None or self._uploaded is not None

    def download(self, now_s: float, then: Callable[[list[MissionItem] | None], None]) -> None:
        """Read the mission; `then` takes its items, or None where it cannot be read."""
        self._received, self._count, self._downloaded = [], None, then
        self._ask(now_s, "MISSION_REQUEST_LIST", {})

    def upload(
        self, now_s: float, items: Sequence[MissionItem], first: int, then: Callable[[], None], *, partial: bool
    ) -> None:
        """Write a mission, or with `partial` its items from the `first` on, and call `then` however it ends."""
        self._sent, self._uploaded = dict(enumerate(items)), then
        if partial:
            self._ask(now_s, "MISSION_WRITE_PARTIAL_LIST", {"start_index": first, "end_index": len(items) - 1})
        else:
            self._ask(now_s, "MISSION_COUNT", {"count": len(items)})

    def take(self, kind: str, fields: Mapping[str, Any], now_s: float) -> None:
        """Take a message of the protocol that has come for this computer."""
        if self._downloaded is not None:
            self._receive(kind, fields, now_s)
        elif self._uploaded is not None:
            if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                if fields["seq"] in self._sent:
                    self._ask(now_s, "MISSION_ITEM_INT", _fields(fields["seq"], self._sent[fields["seq"]]))
            elif kind == "MISSION_ACK" and fields["type"] != INVALID_SEQUENCE:
                self._end_upload()

    def tick(self, now_s: float) -> None:
        """Repeat what is not answered; give up after `MAX_TRIES`."""
        if not self.busy or now_s < self._due_s:
            return
        if self._tries < MAX_TRIES:
            self._tries += 1
            self._send(now_s)
        elif self._downloaded is not None:
            self._end_download(None)
        else:
            self._end_upload()

    # --- steps

    def _receive(self, kind: str, fields: Mapping[str, Any], now_s: float) -> None:
        if kind == "MISSION_COUNT" and self._count is None:
            self._count = min(fields["count"], ITEMS_LIMIT)
        elif kind == "MISSION_ITEM_INT" and self._count is not None and fields["seq"] == len(self._received):
            self._received.append(_item(fields))
        elif kind == "MISSION_ACK" and fields["type"] != ACCEPTED:
            self._end_download(None)
            return
        else:
            return
        if len(self._received) < (self._count or 0):
            self._ask(now_s, "MISSION_REQUEST_INT", {"seq": len(self._received)})
        else:
            self._give("MISSION_ACK", {"type": ACCEPTED})
            self._end_download(self._received)

    def _ask(self, now_s: float, kind: str, fields: dict[str, Any]) -> None:
        self._request, self._tries = (kind, fields), 1
        self._send(now_s)

    def _send(self, now_s: float) -> None:
        kind, fields = self._request
        self._due_s = now_s + (ITEM_RETRY_S if kind == "MISSION_REQUEST_INT" else RETRY_S)
        self._give(kind, fields)

    def _end_download(self, items: list[MissionItem] | None) -> None:
        then, self._downloaded = self._downloaded, None
        if then is not None:
            then(items)

    def _end_upload(self) -> None:
        then, self._uploaded = self._uploaded, None
        if then is not None:
            then()


def _fields(number: int, item: MissionItem) -> dict[str, Any]:
    """The fields of the message of an item."""
    factor = SCALE if item.frame in FRAMES else 1.0
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
    factor = SCALE if fields["frame"] in FRAMES else 1.0
    values = (*(fields[f"param{k}"] for k in range(1, 5)), fields["x"] / factor, fields["y"] / factor, fields["z"])
    return MissionItem(fields["command"], fields["frame"], tuple(v if is_number(v) else math.nan for v in values))
