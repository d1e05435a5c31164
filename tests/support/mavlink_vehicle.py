"""A recorded flight as the messages of an autopilot, encoded by pymavlink alone."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from place import ORIGIN
from pymavlink.dialects.v20 import ardupilotmega as dialect

from eadp.core.geometry.geodesy import to_geodetic_deg

CAPACITY_AH, VOLTS = 0.3, 14.8


class Autopilot:
    """Encodes messages of one system and component; `kind` is 3 for ArduPilot, 12 for PX4."""

    def __init__(self, system: int = 1, component: int = 1, kind: int = 3) -> None:
        self.mav, self.kind = dialect.MAVLink(None, srcSystem=system, srcComponent=component), kind
        self.piloted = False

    def frame(self, name: str, *fields: Any) -> bytes:
        """One message as a frame."""
        frame = bytes(getattr(dialect, f"MAVLink_{name}_message")(*fields).pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256
        return frame

    def heartbeat(self, *, armed: bool, active: bool) -> bytes:
        """Its state."""
        mission = 10 if self.kind == 3 else 4 << 24 | 4 << 16
        mode = 0 if self.piloted else mission
        return self.frame("heartbeat", 1, self.kind, 128 * armed + 8, mode, 4 if active else 3, 3)

    def battery(self, volts: float, amps: float, consumed_ah: float | None, remaining: float | None) -> bytes:
        """Battery 0."""
        cells = [round(volts * 250)] * 4 + [65535] * 6
        consumed = -1 if consumed_ah is None else round(consumed_ah * 1000)
        share = -1 if remaining is None else round(remaining * 100)
        return self.frame("battery_status", 0, 0, 1, 32767, cells, round(amps * 100), consumed, -1, share)

    def position(
        self,
        time_s: float,
        x: float,
        y: float,
        velocity: list[float],
        heading_deg: float,
        altitude_m: float = 25.0,
    ) -> bytes:
        """Where it is."""
        lat, lon = (round(value * 1e7) for value in to_geodetic_deg(x, y, ORIGIN))
        vx, vy = round(velocity[1] * 100), round(velocity[0] * 100)
        hdg = round(heading_deg * 100) % 36000
        return self.frame(
            "global_position_int", round(time_s * 1000), lat, lon, 0, round(altitude_m * 1000), vx, vy, 0, hdg
        )


def recorded(path: str = "scenarios/example-telemetry.jsonl") -> list[dict[str, Any]]:
    """The lines of a recorded flight."""
    return [json.loads(line) for line in Path(path).read_text().splitlines()]


def frames(
    lines: list[dict[str, Any]], autopilot: Autopilot, *, ground_s: float = 3.0, offset_s: float = 100.0
) -> Iterator[tuple[float, list[bytes]]]:
    """The flight in steps, the autopilot's time [s] and its frames: on the ground at first, disarmed at the end."""
    first = lines[0]
    still = (first["x_m"], first["y_m"], [0.0, 0.0], first["heading_deg"])
    for k in range(round(ground_s)):
        time_s = offset_s - ground_s + k
        yield (
            time_s,
            [autopilot.heartbeat(armed=False, active=False), autopilot.position(time_s, *still)],
        )
    drawn_ah = 0.0
    before_s = lines[0]["time_s"]
    for line in lines:
        time_s = offset_s + line["time_s"]
        amps = line["power_w"] / VOLTS
        drawn_ah += amps * (line["time_s"] - before_s) / 3600
        before_s = line["time_s"]
        state = (line["x_m"], line["y_m"], line["velocity_mps"], line["heading_deg"])
        yield (
            time_s,
            [
                autopilot.heartbeat(armed=True, active=True),
                autopilot.battery(VOLTS, amps, None, line["soc"]),
                autopilot.frame("named_value_float", round(time_s * 1000), b"other", 1.0),
                autopilot.position(time_s, *state),
            ],
        )
    end_s, landed = offset_s + before_s + 1, (line["x_m"], line["y_m"], [0.0, 0.0], line["heading_deg"])
    yield end_s, [autopilot.heartbeat(armed=False, active=False), autopilot.position(end_s, *landed)]


def tlog(steps: Iterator[tuple[float, list[bytes]]]) -> bytes:
    """A telemetry log, as ground stations keep it."""
    data = bytearray()
    for time_s, parts in steps:
        for frame in parts:
            data += struct.pack(">Q", round((1.7e9 + time_s) * 1e6)) + frame
    return bytes(data)


def is_near(one: float, other: float, tolerance: float) -> bool:
    """Whether two numbers are near."""
    return math.isclose(one, other, rel_tol=0.0, abs_tol=tolerance)


class MissionHolder:
    """An autopilot's end of the mission protocol: it holds a mission, home at 0, and answers frames with frames.

    `lost` is how many of its first messages are lost; `refuses` lists kinds that it refuses; `spoils` is an item that
    it stores wrong; `resets` whether it goes back to the first item when a mission is written. `parameters` are those
    that it has, by name; it says nothing of others.
    """

    def __init__(
        self, items: list[tuple[int, int, tuple[float, ...]]], *, lost: int = 0, refuses: tuple[str, ...] = (),
        spoils: int | None = None, resets: bool = False,
    ) -> None:  # fmt: skip
        self.autopilot, self.items = Autopilot(), [(16, 0, (0.0, 0.0, 0.0, 0.0, *ORIGIN, 0.0)), *items]
        self.lost, self.refuses, self.spoils, self.resets = lost, refuses, spoils, resets
        self.current, self.writes, self.kinds = 1, [], list[str]()
        self.parameters: dict[str, float] = {}
        self._parser = dialect.MAVLink(None)
        self._due: list[int] = []

    def answer(self, frame: bytes) -> list[bytes]:
        """What it sends when a frame comes."""
        message = self._parser.decode(bytearray(frame))
        kind = message.get_type()
        self.kinds.append(kind)
        if kind.startswith("MISSION") and self.lost > 0:
            self.lost -= 1
            return []
        if kind in self.refuses:
            return [self._frame("mission_ack", 1)]
        if kind == "MISSION_REQUEST_LIST":
            return [self._frame("mission_count", len(self.items))]
        if kind == "MISSION_REQUEST_INT":
            return [self._item(message.seq)]
        if kind == "MISSION_COUNT":
            self._due, self.items = list(range(message.count)), self.items[: message.count]
            return [self._frame("mission_request_int", 0)]
        if kind == "MISSION_WRITE_PARTIAL_LIST":
            self._due = list(range(message.start_index, message.end_index + 1))
            return [self._frame("mission_request_int", self._due[0])]
        if kind == "MISSION_ITEM_INT" and self._due and message.seq == self._due[0]:
            self._store(message)
            self._due.pop(0)
            if self._due:
                return [self._frame("mission_request_int", self._due[0])]
            self.current = 1 if self.resets else self.current
            return [self._frame("mission_ack", 0)]
        if kind == "MISSION_ITEM_INT" and self._due:  # again: what was asked for is lost; as ArduPilot
            return [self._frame("mission_ack", 13), self._frame("mission_request_int", self._due[0])]
        if kind == "MISSION_ITEM_INT":
            return [self._frame("mission_ack", 1)]
        if kind == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
            value = self.parameters[message.param_id]
            return [self._parameter(message.param_id, value)]
        if kind == "MISSION_SET_CURRENT":
            self.current = message.seq
        return []

    @property
    def receives(self) -> bool:
        """Whether an upload goes on."""
        return bool(self._due)

    def give_up(self) -> None:
        """End an upload halfway: the first items are new, the rest is old."""
        self._due = []

    def _parameter(self, name: str, value: float) -> bytes:
        return self.autopilot.frame("param_value", name.encode(), value, 9, len(self.parameters), 65535)

    def _store(self, message: Any) -> None:
        scale = 1e7 if message.frame in (0, 3, 5, 6, 10, 11) else 1.0
        numbers = (message.param1, message.param2, message.param3, message.param4)
        place = (message.x / scale + (0.001 if message.seq == self.spoils else 0.0), message.y / scale, message.z)
        self.writes.append(message.seq)
        self.items[message.seq : message.seq + 1] = [(message.command, message.frame, (*numbers, *place))]

    def _item(self, number: int) -> bytes:
        command, frame, (p1, p2, p3, p4, x, y, z) = self.items[number]
        if command in (20, 178, 206):  # as ArduPilot, which keeps no frame without a position, and whole radii
            frame = 0
        elif command == 18:
            p3 = math.trunc(p3)
        scale = 1e7 if frame in (0, 3, 5, 6, 10, 11) else 1.0
        fields = (1, 191, number, frame, command, 0, 1, p1, p2, p3, p4, round(x * scale), round(y * scale), z)
        return self.autopilot.frame("mission_item_int", *fields)

    def _frame(self, name: str, *fields: Any) -> bytes:
        return self.autopilot.frame(name, 1, 191, *fields)
