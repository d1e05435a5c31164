"""An aeroplane that speaks MAVLink, to try `eadp replan --mavlink` with: it flies the mission that it holds.

usage: python docs/examples/vehicle.py MISSION.waypoints [--to 127.0.0.1:14550] [--wind X Y]

The aeroplane, its battery and its air are benchmarks/plant.py, which knows nothing of eadp's models; the autopilot here
knows waypoints, loiters, changes of speed and the return, and MAVLink's mission protocol. It starts in the air, at the
first waypoint of the mission, a file of `eadp export --to ardupilot`. Its detector is a number: it runs at the rate
that it is sent as NAMED_VALUE_FLOAT `fps`, and reports it, unless `--deaf`.

- `--speed` is how many times as fast as the clock it flies.
- `--loss`, `--delay`: share of messages that are lost either way, and their largest delay [s], so that they overtake.
- `--drop S SHARE`: a loss of charge, after so many seconds, that the charge drawn counts; `--cell S SHARE`: one that
  the voltage alone shows, as of a cell that is lost.
- `--take-off FACTOR`: launched by hand, it climbs to its altitude, and draws so many times the power of level flight
  in the first 10 s.
- `--interrupt S`: in the midst of an upload the link is silent for so long, once, and the vehicle gives the upload up.
- `--capacity`, `--cells`: the pack's capacity [Ah], 1, and its cells in series, 4 by default, as the scenario
  has them (full, a cell has 4.2 V); `--ohm-ah`: its resistance times its capacity.
- `--rates FILE`: a detector that runs, `docs/examples/detector.py`, which watches the file of `eadp replan
  --publish`; the rate that it reaches is what is reported, and what draws power. With `--deaf` it stays at the highest
  rate.

Needs jsbsim and pymavlink: pip install 'eadp[bench,mavlink]'.
"""

from __future__ import annotations

import argparse
import heapq
import json
import math
import random
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "benchmarks"), str(ROOT / "tests/support")]

from mavlink_vehicle import Autopilot, MissionHolder, dialect  # noqa: E402
from plant import ALTITUDE_M, CONTROL_S, GRAVITY_MPS2, Aeroplane, Dryden, Lipo, _turn_rad, _wrapped, battery_w  # noqa: E402
from twin import LEVELS, LEVELS_W, OHM_AH  # noqa: E402

from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m  # noqa: E402

WAYPOINT, LOITER_TURNS, RETURN, TAKEOFF, CHANGE_SPEED = 16, 18, 20, 22, 178
BANK_RAD, HOME_M, SET_INTERVAL = math.radians(35), 60.0, 511
EARLY_M = 50.0
"""How early ArduPilot leaves a waypoint before a loiter without an acceptance radius."""
INSIDE, LINED_UP_RAD = 1.05, math.radians(10)
"""As ArduPlane leaves a loiter: its turns done where the next waypoint is within so many radii, else heading so near to
that waypoint, and as much again after each further turn."""
GROUND_S, LAUNCH_M, TAKE_OFF_S, LEVEL_W = 2.0, 10.0, 10.0, 70.0
"""Time on the ground before a launch, its altitude, the time of full throttle, and the power of level flight."""
INTERRUPTED = 3
"""Items after which an upload is interrupted."""
TELEMETRY_STEPS, BATTERY_STEPS, SECOND_STEPS = 4, 10, 20
"""Steps of CONTROL_S between messages."""
DETECTOR = 192
"""The component that runs the detector."""


class Wire:
    """A UDP socket that loses and delays what goes through it."""

    def __init__(self, to: str, loss: float, delay_s: float, seed: int) -> None:
        host, _, port = to.rpartition(":")
        self._to, self._loss, self._delay_s, self._rng = (host, int(port)), loss, delay_s, random.Random(seed)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(("127.0.0.1", 0))
        self._out: list[tuple[float, int, bytes]] = []
        self._sent, self.silent_until_s = 0, 0.0

    def send(self, frame: bytes) -> None:
        """Send a frame, later, or not at all."""
        if not self._loses():
            self._sent += 1
            heapq.heappush(self._out, (time.monotonic() + self._rng.uniform(0, self._delay_s), self._sent, frame))

    def flush(self) -> None:
        """Send what is due."""
        while self._out and self._out[0][0] <= time.monotonic():
            self._socket.sendto(heapq.heappop(self._out)[2], self._to)

    def receive(self) -> list[bytes]:
        """Frames that have come, but for those that are lost."""
        frames = []
        while True:
            try:
                frames.append(self._socket.recv(4096))
            except OSError:
                return [frame for frame in frames if not self._loses()]

    def _loses(self) -> bool:
        return self._rng.random() < self._loss or time.monotonic() < self.silent_until_s


class Detector:
    """A process that detects, and says which rate it reaches."""

    def __init__(self, *options: str, rate: float) -> None:
        command = [sys.executable, str(ROOT / "docs/examples/detector.py"), "--rate", str(rate), *options]
        self.rate = rate
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.rate = float(line)

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()


class Pilot:
    """Flies the items of a mission: lines between waypoints, loiters, and the way home."""

    def __init__(self, holder: MissionHolder, origin_deg: tuple[float, float]) -> None:
        self.holder, self.origin_deg, self.home_m = holder, origin_deg, (0.0, 0.0)
        self.returns = self.done = False
        self._from: tuple[float, float] | None = None
        self._turned, self._angle = 0.0, None
        self._item: tuple[Any, ...] | None = None

    def place(self, item: tuple[int, int, tuple[float, ...]]) -> tuple[float, float]:
        """Where an item lies [m]."""
        return to_local_m(*item[2][4:6], self.origin_deg)

    def bank_rad(self, plane: Aeroplane) -> float:
        """The bank to fly with; goes on to the next item where one is done."""
        at = plane.x_m, plane.y_m
        while not self.returns and not self.done:
            items, number = self.holder.items, self.holder.current
            if number >= len(items):
                self.done = True
                break
            item = items[number]
            if item != self._item:
                self._item, self._turned, self._angle = item, 0.0, None
            if item[0] == RETURN:
                self.returns = True
            elif item[0] == WAYPOINT:
                if not self._arrived(plane, at, item, number):
                    return self._to(plane, self.place(item))
                self._from = self.place(item)
                self.holder.current += 1
            elif item[0] == LOITER_TURNS:
                if self._circles(plane, at, item, number):
                    return self._around(plane, self.place(item), item[2][2])
                self._from = at
                self.holder.current += 1
            else:
                if item[0] == CHANGE_SPEED:
                    plane.airspeed_target_mps = item[2][1]
                self.holder.current += 1
        if math.dist(at, self.home_m) < HOME_M:
            self.done = True
        return self._to(plane, self.home_m)

    def _arrived(self, plane: Aeroplane, at: tuple[float, float], item: Any, number: int) -> bool:
        """Whether a waypoint is passed, or it is time to turn to the next one."""
        x, y = self.place(item)
        course = math.atan2(y - (self._from or at)[1], x - (self._from or at)[0])
        left = (x - at[0]) * math.cos(course) + (y - at[1]) * math.sin(course)
        if item[2][1] > 0:
            return left < item[2][1]
        later = next((other for other in self.holder.items[number + 1 :] if other[0] in (WAYPOINT, LOITER_TURNS)), None)
        early = 5.0 if later is None or later[0] == WAYPOINT else EARLY_M
        if later is not None and later[0] == WAYPOINT:
            nx, ny = self.place(later)
            turn = abs(_wrapped(math.atan2(ny - y, nx - x) - course))
            radius = math.hypot(plane.east_mps, plane.north_mps) ** 2 / (GRAVITY_MPS2 * math.tan(BANK_RAD))
            early = max(early, radius * math.tan(min(turn, 2.0) / 2))
        return left < early

    def _to(self, plane: Aeroplane, target: tuple[float, float]) -> float:
        """Along the line to a point."""
        start = self._from or (plane.x_m, plane.y_m)
        course = math.atan2(target[1] - start[1], target[0] - start[0])
        right = (plane.x_m - start[0]) * math.sin(course) - (plane.y_m - start[1]) * math.cos(course)
        ground = math.hypot(plane.east_mps, plane.north_mps)
        return _turn_rad(plane, 1.1 * _wrapped(course + math.atan(right / (1.6 * ground)) - plane.course_rad))

    def _around(self, plane: Aeroplane, centre: tuple[float, float], radius: float) -> float:
        """Along a circle; a negative radius turns counter-clockwise."""
        sense = 1 if radius < 0 else -1
        angle = math.atan2(plane.y_m - centre[1], plane.x_m - centre[0])
        off = math.dist((plane.x_m, plane.y_m), centre) - abs(radius)
        ground = math.hypot(plane.east_mps, plane.north_mps)
        course = angle + sense * (math.pi / 2 + math.atan(off / (1.6 * ground)))
        return _turn_rad(plane, sense * ground / abs(radius) + 1.1 * _wrapped(course - plane.course_rad))

    def _circles(self, plane: Aeroplane, at: tuple[float, float], item: Any, number: int) -> bool:
        """Whether a loiter goes on: it has turns left, or the next waypoint is not ahead yet."""
        centre, sense = self.place(item), 1 if item[2][2] < 0 else -1
        angle = math.atan2(at[1] - centre[1], at[0] - centre[0])
        if self._angle is not None:
            self._turned += sense * _wrapped(angle - self._angle)
        self._angle = angle
        if self._turned < 2 * math.pi * item[2][0] - math.radians(30):
            return True
        later = next((other for other in self.holder.items[number + 1 :] if other[0] == WAYPOINT), None)
        if later is None:
            return self._turned < 2 * math.pi * item[2][0]
        x, y = target = self.place(later)
        if math.dist(target, centre) < INSIDE * abs(item[2][2]):
            return self._turned < 2 * math.pi * item[2][0]
        further = max(self._turned / (2 * math.pi) - item[2][0], 0.0)
        return abs(_wrapped(math.atan2(y - at[1], x - at[0]) - plane.course_rad)) > LINED_UP_RAD * (1 + int(further))


def rows_of(path: Path) -> list[tuple[int, int, tuple[float, ...]]]:
    """The items of a WPL file, home first."""
    rows = [line.split("\t") for line in path.read_text().splitlines()[1:] if line.strip()]
    return [(int(row[3]), int(row[2]), tuple(map(float, row[4:11]))) for row in rows]


class Vehicle:
    """The aeroplane, its pack and its pilot on the mission that it holds, from the first waypoint on.

    Parameters
    ----------
    mission : Path
        A file of `eadp export --to ardupilot`.
    wind_mps, capacity_ah, seed
        Air, pack, and the gusts' numbers.
    drop, cell : (float, float), optional
        A loss of charge: when [s], and which share; and one that the charge drawn does not count.
    take_off : float
        How many times the power of level flight it draws in a take-off; 1: it starts at its altitude.
    ohm_ah : float
        Resistance of the pack times its capacity.
    cells : int
        Of the pack, in series: it has 4.2 V each when full.
    """

    def __init__(
        self,
        mission: Path,
        wind_mps: tuple[float, float],
        capacity_ah: float,
        seed: int,
        drop: tuple[float, float] | None = None,
        cell: tuple[float, float] | None = None,
        take_off: float = 1.0,
        ohm_ah: float = OHM_AH,
        cells: int = 4,
    ) -> None:
        home, *items = rows_of(mission)
        self.origin_deg = home[2][4], home[2][5]
        self.holder = MissionHolder(items)
        self.holder.items[0] = home
        self.pilot = Pilot(self.holder, self.origin_deg)
        points = [self.pilot.place(item) for item in items if item[0] == WAYPOINT]
        course = math.atan2(points[1][1] - points[0][1], points[1][0] - points[0][0])
        gusts, start_m = Dryden(math.hypot(*wind_mps), seed, 7200.0), LAUNCH_M if take_off > 1 else ALTITUDE_M
        self.plane = Aeroplane(points[0], course, wind_mps, gusts, start_m)
        self.plane.altitude_target_m = ALTITUDE_M
        self.pack, self._drop = Lipo(capacity_ah, ohm_ah / capacity_ah, cells), drop
        self._cell, self._take_off = cell, take_off
        self.fps, self.power_w, self.consumed_ah = float(LEVELS[-1]), 0.0, 0.0

    @property
    def flies(self) -> bool:
        """Whether it is neither home nor out of charge."""
        return not (self.pilot.done or self.pack.empty)

    @property
    def completed(self) -> bool:
        """Whether it is home with charge, after all waypoints and loiters of its mission."""
        left = self.holder.items[self.holder.current :]
        flown = not any(item[0] in (WAYPOINT, LOITER_TURNS) for item in left)
        return flown and self.pilot.done and not self.pack.empty

    def step(self) -> None:
        """Fly for CONTROL_S."""
        self.plane.control(self.pilot.bank_rad(self.plane))
        self.power_w = float(battery_w(self.plane.shaft_w) + np.interp(self.fps, LEVELS, LEVELS_W))
        if self._take_off > 1 and self.plane.time_s < TAKE_OFF_S:
            self.power_w = max(self.power_w, self._take_off * LEVEL_W)
        lost = uncounted = 0.0
        if self._drop is not None and self.plane.time_s >= self._drop[0]:
            lost, self._drop = self._drop[1], None
        if self._cell is not None and self.plane.time_s >= self._cell[0]:
            uncounted, self._cell = self._cell[1], None
        before = float(self.pack.soc) - uncounted
        self.pack.step(self.power_w, CONTROL_S, lost + uncounted)
        self.consumed_ah += (before - float(self.pack.soc)) * self.pack.capacity_ah


def fly(options: argparse.Namespace) -> dict[str, Any]:
    """A flight over a link, from the first waypoint until it is home or out of charge; what came of it."""
    vehicle = Vehicle(
        Path(options.mission),
        tuple(options.wind),
        options.capacity,
        options.seed,
        options.drop,
        options.cell,
        options.take_off,
        options.ohm_ah,
        options.cells,
    )
    holder, detector = vehicle.holder, Autopilot(component=DETECTOR)
    autopilot, wire = holder.autopilot, Wire(options.to, options.loss, options.delay, options.seed)
    plane, pack, pilot = vehicle.plane, vehicle.pack, vehicle.pilot
    runs = None
    if options.rates:
        runs = Detector(*(() if options.deaf else ("--rates", options.rates)), rate=vehicle.fps)
    parser, step, counts = dialect.MAVLink(None), 0, {"commands": 0, "fps": 0, "interrupted": 0}
    parser.robust_parsing = True
    for k in range(round(GROUND_S / CONTROL_S / TELEMETRY_STEPS) if options.take_off > 1 else 0):
        wire.send(autopilot.heartbeat(armed=False, active=False))
        wire.send(autopilot.frame("vfr_hud", 0.0, 0.0, 0, 0, 0.0, 0.0))
        now_s = 100 - GROUND_S + k * CONTROL_S * TELEMETRY_STEPS
        wire.send(position(autopilot, now_s, plane, vehicle.origin_deg, landed=True))
        time.sleep(CONTROL_S * TELEMETRY_STEPS / options.speed)
        wire.flush()
    begun, interrupt_s = time.monotonic(), options.interrupt
    while vehicle.flies:
        now_s = 100 + plane.time_s
        vehicle.fps = vehicle.fps if runs is None else runs.rate
        vehicle.step()
        if step % SECOND_STEPS == 0:
            wire.send(autopilot.heartbeat(armed=True, active=True))
            wire.send(autopilot.frame("mission_current", min(holder.current, len(holder.items) - 1)))
            wire.send(detector.frame("named_value_float", round(now_s * 1000), b"fps", vehicle.fps))
        if step % BATTERY_STEPS == 0:
            drawn_ah = vehicle.consumed_ah
            wire.send(autopilot.battery(pack.voltage_v, pack.current_a, drawn_ah, 1 - drawn_ah / pack.capacity_ah))
        if step % TELEMETRY_STEPS == 0:
            wire.send(autopilot.frame("vfr_hud", plane.airspeed_mps, 0.0, 0, 50, plane.altitude_m, plane.climb_mps))
            wire.send(position(autopilot, now_s, plane, vehicle.origin_deg))
        for data in wire.receive():
            for frame in (message.get_msgbuf() for message in parser.parse_buffer(data) or ()):
                message = dialect.MAVLink(None).decode(bytearray(frame))
                kind = message.get_type()
                if kind == "NAMED_VALUE_FLOAT" and message.name == "fps" and not options.deaf and runs is None:
                    counts["fps"] += message.value != vehicle.fps
                    vehicle.fps = float(message.value)
                elif kind == "COMMAND_LONG":
                    counts["commands"] += message.command != SET_INTERVAL
                    pilot.returns |= message.command == RETURN
                    wire.send(autopilot.frame("command_ack", message.command, 0))
                elif kind == "STATUSTEXT":
                    print(f"{plane.time_s:7.1f} s  {message.text}", file=sys.stderr)
                else:
                    for answer in holder.answer(bytes(frame)):
                        wire.send(answer)
                    if interrupt_s and holder.receives and len(holder.writes) >= INTERRUPTED:
                        wire.silent_until_s, interrupt_s = time.monotonic() + interrupt_s, 0.0
                        holder.give_up()
                        counts["interrupted"] = 1
        wire.flush()
        step += 1
        ahead_s = plane.time_s / options.speed - (time.monotonic() - begun)
        if ahead_s > 0.005:
            time.sleep(ahead_s)
    if runs is not None:
        runs.close()
    for _ in range(20):
        wire.send(autopilot.heartbeat(armed=False, active=False))
        wire.send(position(autopilot, 100 + plane.time_s, plane, vehicle.origin_deg, landed=True))
        time.sleep(0.05)
        wire.flush()
    return {
        "completed": vehicle.completed,
        "time_s": round(plane.time_s, 1),
        "soc": round(float(pack.soc), 4),
        "items_written": len(holder.writes),
        **counts,
    }


def position(
    autopilot: Autopilot, now_s: float, plane: Aeroplane, origin: tuple[float, float], *, landed: bool = False
) -> bytes:
    """Where the aeroplane is."""
    lat, lon = (round(value * 1e7) for value in to_geodetic_deg(plane.x_m, plane.y_m, origin))
    heading = round(100 * (math.degrees(math.pi / 2 - plane.heading_rad) % 360)) % 36000
    speeds = (0, 0, 0) if landed else (round(plane.north_mps * 100), round(plane.east_mps * 100), 0)
    altitude = 0 if landed else round(plane.altitude_m * 1000)
    return autopilot.frame("global_position_int", round(now_s * 1000), lat, lon, 0, altitude, *speeds, heading)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mission")
    parser.add_argument("--to", default="127.0.0.1:14550")
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--wind", type=float, nargs=2, default=(0.0, 0.0))
    parser.add_argument("--capacity", type=float, default=1.0)
    parser.add_argument("--cells", type=int, default=4)
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--delay", type=float, default=0.0)
    parser.add_argument("--drop", type=float, nargs=2)
    parser.add_argument("--cell", type=float, nargs=2)
    parser.add_argument("--take-off", type=float, default=1.0)
    parser.add_argument("--interrupt", type=float, default=0.0)
    parser.add_argument("--ohm-ah", type=float, default=OHM_AH)
    parser.add_argument("--deaf", action="store_true")
    parser.add_argument("--rates")
    parser.add_argument("--seed", type=int, default=0)
    print(json.dumps(fly(parser.parse_args())))


if __name__ == "__main__":
    main()
