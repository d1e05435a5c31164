"""A recorded flight as the messages of an autopilot, encoded by pymavlink alone."""

import itertools
import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from place import ORIGIN
from pymavlink.dialects.v20 import ardupilotmega as dialect

from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m

CAPACITY_AH, VOLTS = 0.3, 14.8

ARDUPILOT, PX4 = 3, 12
MODES = {
    ARDUPILOT: {"mission": 10, "pilot": 6, "hold": 12, "return": 11},  # AUTO, FBWB, LOITER, RTL
    PX4: {"mission": 4 << 24 | 4 << 16, "pilot": 3 << 16, "hold": 3 << 24 | 4 << 16, "return": 5 << 24 | 4 << 16},
}
"""Modes of an aeroplane by autopilot, as its heartbeat has them; PX4's are Mission, Position, Hold and Return."""
GLOBAL_FRAMES = (0, 3, 5, 6, 10, 11)
WAYPOINT, LOITER_TURNS, RETURN, LAND, TAKEOFF, LAND_START = 16, 18, 20, 21, 22, 189
WITHOUT_PLACE = (RETURN, 178, LAND_START, 206)
SLOPE_DEG = 0.1
"""By how much a landing may be steeper than PX4's FW_LND_ANG [°]."""

Item = tuple[int, int, tuple[float, ...]]
"""Command, frame, and seven numbers."""


class Autopilot:
    """Encodes messages of one system and component; `kind` is 3 for ArduPilot, 12 for PX4."""

    def __init__(self, system: int = 1, component: int = 1, kind: int = 3) -> None:
        self.mav, self.kind = dialect.MAVLink(None, srcSystem=system, srcComponent=component), kind
        self.mode = "mission"

    def frame(self, name: str, *fields: Any) -> bytes:
        """One message as a frame."""
        frame = bytes(getattr(dialect, f"MAVLink_{name}_message")(*fields).pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256
        return frame

    def heartbeat(self, *, armed: bool, active: bool) -> bytes:
        """Its state."""
        mode = MODES.get(self.kind, {}).get(self.mode, 0)
        return self.frame("heartbeat", 1, self.kind, 128 * armed + 8, mode, 4 if active else 3, 3)

    def battery(self, volts: float, amps: float, consumed_ah: float | None, remaining: float | None) -> bytes:
        """Battery 0."""
        cells = [round(volts * 250)] * 4 + [65535] * 6
        consumed = -1 if consumed_ah is None else round(consumed_ah * 1000)
        share = -1 if remaining is None else round(remaining * 100)
        return self.frame("battery_status", 0, 0, 1, 32767, cells, round(amps * 100), consumed, -1, share)

    def position(
        self, time_s: float, x: float, y: float, velocity: list[float], heading_deg: float, altitude_m: float = 25.0
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
        yield (time_s, [autopilot.heartbeat(armed=False, active=False), autopilot.position(time_s, *still)])
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


def single(value: float) -> float:
    """A number in single precision."""
    return float(struct.unpack("f", struct.pack("f", value))[0])


def as_ardupilot(command: int, frame: int, numbers: tuple[float, ...]) -> Item:
    """What ArduPlane keeps of an item: a byte for an acceptance radius, whole centimetres of altitude, no frame."""
    p1, p2, p3, p4, x, y, z = numbers
    if command == WAYPOINT:
        p1, p2, p3, p4 = 0.0, float(min(int(single(p2)), 255)), float(min(int(single(p3)), 255)), 0.0
    elif command == LOITER_TURNS:
        p2, p3 = 0.0, float(int(p3) if abs(p3) < 256 else 10 * int(p3 / 10))
    elif command == LAND:
        p2, p3, p4 = 0.0, 0.0, -1.0 if p4 < 0 else 1.0
    elif command == TAKEOFF:
        p1 = float(int(p1))
    return command, 0 if command in WITHOUT_PLACE else frame, (p1, p2, p3, p4, x, y, int(single(z) * 100) / 100)


def as_px4(command: int, frame: int, numbers: tuple[float, ...]) -> Item:
    """What PX4 keeps of an item: frames of whole numbers, no pitch of a take-off."""
    frame = {0: 5, 3: 6}.get(frame, frame)
    return command, frame, ((0.0, *numbers[1:]) if command == TAKEOFF else numbers)


class MissionHolder:
    """An autopilot's end of the mission protocol: it holds a mission, and answers frames with frames.

    `kind` is that of `Autopilot`. ArduPilot's home is item 0; what is sent replaces its items one by one. PX4 has no
    home, and a new mission is in force at its acknowledgement; it sends NAMED_VALUE_FLOAT back as its own.

    `lost` is how many of its first messages are lost; `refuses` lists kinds that it refuses; `spoils` is an item that
    it stores wrong; `resets` whether it goes back to the first item when a mission is written. `parameters` are those
    that it has, by name; it says nothing of others.
    """

    def __init__(
        self, items: list[Item], *, kind: int = ARDUPILOT, lost: int = 0, refuses: tuple[str, ...] = (),
        spoils: int | None = None, resets: bool = False,
    ) -> None:  # fmt: skip
        self.autopilot, self.px4 = Autopilot(kind=kind), kind == PX4
        home = [] if self.px4 else [(16, 0, (0.0, 0.0, 0.0, 0.0, *ORIGIN, 0.0))]
        self.items = [*home, *(self._kept(*item) for item in items)]
        self.lost, self.refuses, self.spoils, self.resets = lost, refuses, spoils, resets
        self.first = len(home)
        self.current, self.writes, self.kinds = self.first, [], list[str]()
        self.parameters: dict[str, float] = {}
        self._parser = dialect.MAVLink(None)
        self._due: list[int] = []
        self._coming: list[Item] = []  # a mission that PX4 gets

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
            self._due, self._coming = list(range(message.count)), []
            if not self.px4:
                self.items = self.items[: message.count]
            return [self._frame("mission_request_int", 0)]
        if kind == "MISSION_ITEM_INT" and self._due and message.seq == self._due[0]:
            if self.px4 and message.command == LOITER_TURNS:
                self._due = []
                return [self._frame("mission_ack", 3)]
            self._store(message)
            self._due.pop(0)
            if self._due:
                return [self._frame("mission_request_int", self._due[0])]
            self.items = self._coming if self.px4 else self.items
            self.current = self.first if self.resets else self.current
            return [self._frame("mission_ack", 0), *self._text(self.refusal)]
        if kind == "MISSION_ITEM_INT" and self._due:  # again: what was asked for is lost; as ArduPilot
            return [self._frame("mission_ack", 13), self._frame("mission_request_int", self._due[0])]
        if kind == "MISSION_ITEM_INT":
            return [self._frame("mission_ack", 0 if self.px4 else 1)]
        if kind == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
            value = self.parameters[message.param_id]
            return [self._parameter(message.param_id, value)]
        if kind == "MISSION_SET_CURRENT":
            self.current = message.seq
        if kind == "NAMED_VALUE_FLOAT" and self.px4:
            return [
                self.autopilot.frame("named_value_float", message.time_boot_ms, message.name.encode(), message.value)
            ]
        return []

    @property
    def current_item(self) -> bytes:
        """The item that is flown to, the number of items, and the state of the mission, as `MISSION_CURRENT`."""
        count, last = len(self.items) - self.first, len(self.items) - 1
        if count <= 0:
            return self.autopilot.frame("mission_current", 65535 if self.px4 else 0, 65535 if self.px4 else 0)
        state = 1 if self.px4 and self.refusal else 3
        return self.autopilot.frame("mission_current", min(self.current, last), count, state)

    @property
    def refusal(self) -> str:
        """What the autopilot says against its mission as it is armed; empty where it can be armed with it."""
        commands = [item[0] for item in self.items]
        if not self.px4:
            autoland = LAND_START in commands and not self.parameters.get("RTL_AUTOLAND", 0.0)
            return "PreArm: DO_LAND_START set and RTL_AUTOLAND disabled" if autoland else ""
        if self.parameters.get("MIS_TKO_LAND_REQ", 2.0) == 2 and LAND not in commands:
            return "Mission rejected: Landing waypoint/pattern required.\t"
        limit_deg = self.parameters.get("FW_LND_ANG", 5.0)
        for (_, _, before), (command, _, landing) in itertools.pairwise(self.items):
            distance_m = math.dist(to_local_m(*before[4:6], landing[4:6]), (0.0, 0.0)) if command == LAND else 0.0
            if command == LAND and math.degrees(math.atan2(before[6] - landing[6], distance_m)) > limit_deg + SLOPE_DEG:
                steeper = f"steeper than the vehicle setting of {limit_deg} degrees"
                return f"Mission rejected: the landing glide slope is {steeper}.\t"
        return ""

    def armed(self) -> list[bytes]:
        """What is said as it is asked to arm: nothing where it arms, else why it does not."""
        if not self.refusal:
            return []
        return self._text("Arming denied: Resolve system health failures first\t" if self.px4 else self.refusal)

    def _kept(self, command: int, frame: int, numbers: tuple[float, ...]) -> Item:
        return (as_px4 if self.px4 else as_ardupilot)(command, frame, numbers)

    def _text(self, text: str) -> list[bytes]:
        """A critical text, in pieces of 50 characters."""
        pieces = [text[start : start + 50].encode() for start in range(0, len(text), 50)]
        number = len(self.kinds) % 65_535 + 1 if len(pieces) > 1 else 0
        return [self.autopilot.frame("statustext", 2, piece, number, k) for k, piece in enumerate(pieces)]

    def _parameter(self, name: str, value: float) -> bytes:
        return self.autopilot.frame("param_value", name.encode(), value, 9, len(self.parameters), 65535)

    def _store(self, message: Any) -> None:
        scale = 1e7 if message.frame in GLOBAL_FRAMES else 1.0
        numbers = (message.param1, message.param2, message.param3, message.param4)
        place = (message.x / scale + (0.001 if message.seq == self.spoils else 0.0), message.y / scale, message.z)
        self.writes.append(message.seq)
        items = self._coming if self.px4 else self.items
        items[message.seq : message.seq + 1] = [self._kept(message.command, message.frame, (*numbers, *place))]

    def _item(self, number: int) -> bytes:
        command, frame, (p1, p2, p3, p4, x, y, z) = self.items[number]
        scale = 1e7 if frame in GLOBAL_FRAMES else 1.0
        fields = (1, 191, number, frame, command, 0, 1, p1, p2, p3, p4, round(x * scale), round(y * scale), z)
        return self.autopilot.frame("mission_item_int", *fields)

    def _frame(self, name: str, *fields: Any) -> bytes:
        return self.autopilot.frame(name, 1, 191, *fields)
