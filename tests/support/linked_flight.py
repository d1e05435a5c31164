"""A recorded flight over a link, without a socket, with an autopilot that holds a mission; time goes on by messages."""

import json
from pathlib import Path

from mavlink_vehicle import Item, MissionHolder, frames

from eadp.live.link import LinkFlight, LinkOptions
from eadp.live.mavlink import Codec
from eadp.live.messages import WANTED


def wpl_items(path: Path) -> list[Item]:
    """The items of a WPL file, home aside."""
    rows = [line.split("\t") for line in path.read_text().splitlines()[2:]]
    return [(int(row[3]), int(row[2]), tuple(map(float, row[4:11]))) for row in rows]


def qgc_items(path: Path) -> list[Item]:
    """The items of a plan of QGroundControl."""
    rows = json.loads(path.read_text())["mission"]["items"]
    return [(row["command"], row["frame"], tuple(value or 0.0 for value in row["params"])) for row in rows]


class Flying:
    """A recorded flight with an autopilot that holds a mission; time goes on by the messages."""

    def __init__(self, inputs, mission, log=None, upload=True, return_home=False, **given):
        self.path, items = mission
        self.holder, self.decisions, self.faults, self.now_s = MissionHolder(list(items), **given), [], [], 0.0
        self._codec, self._queue, self.sent = Codec(WANTED), [], []
        self._heard = Codec(frozenset({"STATUSTEXT", "NAMED_VALUE_FLOAT", "COMMAND_LONG"}))
        self.autopilot = self.holder.autopilot
        options = LinkOptions(f"{self.path}.items.json", upload=upload, return_home=return_home)
        self.flight = LinkFlight(inputs, "link", options, log, self.decisions.append, self.faults.append, self._send)

    def _send(self, *message):
        self._queue.append(self._codec.encoded(*message))
        self.sent += self._heard.decoded(self._queue[-1])

    def _give(self, frame):
        for message in self._codec.decoded(frame):
            self.flight.take(message, self.now_s)
        while self._queue:
            for answer in self.holder.answer(self._queue.pop(0)):
                for message in self._codec.decoded(answer):
                    self.flight.take(message, self.now_s)

    def fly(self, lines, current=False):
        for now_s, parts in frames(lines, self.autopilot):
            self.now_s = now_s
            for frame in parts[:-1]:
                self._give(frame)
            if current:
                self._give(self.holder.autopilot.frame("mission_current", self.holder.current, self.total))
            self._give(parts[-1])
            self.flight.tick(self.now_s)
            self._give(b"")
        return self

    @property
    def total(self):
        """The number of items, as the autopilot reports it."""
        return len(self.holder.items) - self.holder.first

    @property
    def said(self):
        return [fault.message for fault in self.faults]

    @property
    def texts(self):
        """What the pilot reads, put together of its pieces."""
        pieces = [message.fields for message in self.sent if message.kind == "STATUSTEXT"]
        return "".join(("" if piece["chunk_seq"] else "\n") + piece["text"] for piece in pieces).split("\n")[1:]


class Finely(Flying):
    """The link is looked after ten times a second."""

    def fly(self, lines, current=True):
        for now_s, parts in frames(lines, self.autopilot):
            for tenth in range(9, -1, -1):
                self.now_s = now_s - tenth / 10
                self.flight.tick(self.now_s)
                self._give(b"")
            for frame in parts[:-1]:
                self._give(frame)
            self._give(self.holder.autopilot.frame("mission_current", self.holder.current, self.total))
            self._give(parts[-1])
        return self
