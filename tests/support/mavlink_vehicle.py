"""A recorded flight as the messages of an autopilot, encoded by pymavlink alone."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from eadp.core.geometry.geodesy import to_geodetic_deg

ORIGIN = (55.37, 10.43)
CAPACITY_AH, VOLTS = 0.3, 14.8


class Autopilot:
    """Encodes messages of one system and component; `kind` is 3 for ArduPilot, 12 for PX4."""

    def __init__(self, system: int = 1, component: int = 1, kind: int = 3) -> None:
        self.mav, self.kind = dialect.MAVLink(None, srcSystem=system, srcComponent=component), kind

    def frame(self, name: str, *fields: Any) -> bytes:
        """One message as a frame."""
        frame = bytes(getattr(dialect, f"MAVLink_{name}_message")(*fields).pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256
        return frame

    def heartbeat(self, *, armed: bool, active: bool) -> bytes:
        """Its state."""
        return self.frame("heartbeat", 1, self.kind, 128 * armed, 0, 4 if active else 3, 3)

    def battery(self, volts: float, amps: float, consumed_ah: float | None, remaining: float | None) -> bytes:
        """Battery 0."""
        cells = [round(volts * 250)] * 4 + [65535] * 6
        consumed = -1 if consumed_ah is None else round(consumed_ah * 1000)
        share = -1 if remaining is None else round(remaining * 100)
        return self.frame("battery_status", 0, 0, 1, 32767, cells, round(amps * 100), consumed, -1, share)

    def position(self, time_s: float, x: float, y: float, velocity: list[float], heading_deg: float) -> bytes:
        """Where it is."""
        lat, lon = (round(value * 1e7) for value in to_geodetic_deg(x, y, ORIGIN))
        vx, vy = round(velocity[1] * 100), round(velocity[0] * 100)
        hdg = round(heading_deg * 100) % 36000
        return self.frame("global_position_int", round(time_s * 1000), lat, lon, 0, 0, vx, vy, 0, hdg)


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
    yield offset_s + before_s + 1, [autopilot.heartbeat(armed=False, active=False)]


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
