"""An aeroplane that speaks MAVLink, to try `eadp replan --mavlink` with: it flies the mission that it holds.

usage: python docs/examples/vehicle.py MISSION.waypoints [--to 127.0.0.1:14550] [--wind X Y]

The aeroplane, its battery and its air are benchmarks/plant.py, which knows nothing of eadp's models; the autopilot here
knows waypoints, loiters, changes of speed and the return, and MAVLink's mission protocol. It starts in the air, at the
first waypoint of the mission: a file of `eadp export --to ardupilot`, or of `--to px4` (`.plan`). Its detector is a
number: it runs at the rate that it is sent as NAMED_VALUE_FLOAT `fps`, and reports it, unless `--deaf`.

It keeps and flies missions as the autopilot of the file does. PX4 does not arm with a mission that has no landing, or a
steep one, leaves lines early, turns back by itself when its time left is short, and takes a mission up again at the
start of the line that was left. Both hold calibrated airspeed, within their limits.

- `--speed` is how many times as fast as the clock it flies.
- `--loss`, `--delay`: share of messages that are lost either way, and their largest delay [s], so that they overtake.
- `--drop S SHARE`: a loss of charge, after so many seconds, that the charge drawn counts; `--cell S SHARE`: one that
  the voltage alone shows, as of a cell that is lost.
- `--take-off FACTOR`: launched by hand, it climbs to its altitude, and draws so many times the power of level flight
  in the first 10 s.
- `--interrupt S`: in the midst of an upload the link is silent for so long, once, and the vehicle gives the upload up.
- `--parameters FILE`: the autopilot's, as `eadp export --parameters` writes them; without, those of the factory.
- `--pilot S SECONDS`: a pilot flies from S on, for so many seconds, at 20 m/s and on a circle.
- `--elevation`: height of the field above the sea [m].
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

from linked_flight import qgc_items  # noqa: E402
from mavlink_vehicle import ARDUPILOT, PX4, Autopilot, MissionHolder, dialect  # noqa: E402
from plant import (  # noqa: E402
    AIRSPEED_MPS,
    ALTITUDE_M,
    CONTROL_S,
    GRAVITY_MPS2,
    Aeroplane,
    Dryden,
    Lipo,
    _turn_rad,
    _wrapped,
    battery_w,
)
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
PILOT_MPS, PILOT_RAD = 20.0, math.radians(15)
"""Airspeed and bank of a pilot who flies by hand."""
EARLY_S, HOLD_S = 6.25, 5.0
"""By how many seconds of flight PX4 leaves a waypoint early, times NPFG_SW_DST_MLT: 24 to 34 m at 14 m/s with 0.32; and
how long it holds before it turns back by itself."""
FACTORY = {
    ARDUPILOT: {"AIRSPEED_MIN": 9.0, "AIRSPEED_MAX": 22.0},
    PX4: {
        "FW_AIRSPD_MIN": 9.0,
        "FW_AIRSPD_MAX": 22.0,
        "NPFG_SW_DST_MLT": 0.32,
        "MIS_TKO_LAND_REQ": 2.0,
        "FW_LND_ANG": 5.0,
        "COM_FLTT_LOW_ACT": 3.0,
        "RTL_TIME_FACTOR": 1.1,
        "RTL_TIME_MARGIN": 100.0,
    },
}
"""Parameters of the autopilots before somebody changes them; the limits of the airspeed are this aeroplane's."""
LIMITS = {False: ("AIRSPEED_MIN", "AIRSPEED_MAX"), True: ("FW_AIRSPD_MIN", "FW_AIRSPD_MAX")}
"""Names of the limits of the airspeed, of ArduPilot and of PX4."""
ACCEPTED, FAILED = 0, 4
"""Answers to a command."""
ASK_AGAIN_S = {False: 0.5, True: 0.25}
"""After how long ArduPilot and PX4 ask again for an item that has not come [s]."""
CURRENT_SHARE = 0.001
"""Share of the present current in PX4's mean, each CONTROL_S: that of level flight."""
LEVEL_MPS = 0.5
"""Climb up to which a flight is level."""
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
    """Flies the items of a mission: lines between waypoints, loiters, and the way home.

    `mode` is that of `Autopilot`: on its mission, in a pilot's hands, holding or returning.
    """

    def __init__(self, holder: MissionHolder, origin_deg: tuple[float, float]) -> None:
        self.holder, self.origin_deg, self.home_m = holder, origin_deg, (0.0, 0.0)
        self.mode, self.done, self.calibrated = "mission", False, 1.0
        self._from: tuple[float, float] | None = None
        self._turned, self._angle = 0.0, None
        self._item: tuple[Any, ...] | None = None

    def place(self, item: tuple[int, int, tuple[float, ...]]) -> tuple[float, float]:
        """Where an item lies [m]."""
        return to_local_m(*item[2][4:6], self.origin_deg)

    def bank_rad(self, plane: Aeroplane) -> float:
        """The bank to fly with; goes on to the next item where one is done."""
        at = plane.x_m, plane.y_m
        if self.mode in ("pilot", "hold"):
            return PILOT_RAD
        while self.mode == "mission" and not self.done:
            items, number = self.holder.items, self.holder.current
            if number >= len(items):
                self.done = True
                break
            item = items[number]
            if item != self._item:
                self._item, self._turned, self._angle = item, 0.0, None
            if item[0] == RETURN:
                self.mode = "return"
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
                    self.change_speed(plane, item[2][1])
                self.holder.current += 1
        if math.dist(at, self.home_m) < HOME_M:
            self.done = True
        return self._to(plane, self.home_m)

    def take_over(self, plane: Aeroplane) -> None:
        """A pilot flies by hand."""
        self.mode, plane.airspeed_target_mps = "pilot", PILOT_MPS

    def give_back(self, plane: Aeroplane) -> None:
        """Fly the mission again: PX4 from the start of the line that was left, ArduPilot from here to its end.

        A mode is entered with the airspeed of cruise.
        """
        self.mode, plane.airspeed_target_mps, self._from = "mission", AIRSPEED_MPS, None
        if self.holder.px4:
            before = range(self.holder.first, self.holder.current)
            self.holder.current = next(
                (k for k in reversed(before) if self.holder.items[k][0] == WAYPOINT), self.holder.first
            )

    def change_speed(self, plane: Aeroplane, speed_mps: float) -> int:
        """Fly at another calibrated airspeed: ArduPilot refuses one that is outside its limits, PX4 limits it.

        Returns MAVLink's result of the command.
        """
        low, high = (self.holder.parameters[name] for name in LIMITS[self.holder.px4])
        limited = min(max(speed_mps, low), high)
        if self.mode != "mission" or not (self.holder.px4 or limited == speed_mps):
            return FAILED
        plane.airspeed_target_mps = limited / self.calibrated
        return ACCEPTED

    def _arrived(self, plane: Aeroplane, at: tuple[float, float], item: Any, number: int) -> bool:
        """Whether a waypoint is passed, or it is time to turn to the next one."""
        x, y = self.place(item)
        course = math.atan2(y - (self._from or at)[1], x - (self._from or at)[0])
        left = (x - at[0]) * math.cos(course) + (y - at[1]) * math.sin(course)
        if self.holder.px4:
            ground = math.hypot(plane.east_mps, plane.north_mps)
            return left < EARLY_S * self.holder.parameters["NPFG_SW_DST_MLT"] * ground
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


def rows_of(path: Path) -> tuple[tuple[float, float], list[tuple[int, int, tuple[float, ...]]]]:
    """Latitude and longitude of home, and the items of a mission: of a WPL file, or a plan of QGroundControl."""
    if path.suffix == ".plan":
        return tuple(json.loads(path.read_text())["mission"]["plannedHomePosition"][:2]), qgc_items(path)
    home, *items = [line.split("\t") for line in path.read_text().splitlines()[1:] if line.strip()]
    return (float(home[8]), float(home[9])), [(int(row[3]), int(row[2]), tuple(map(float, row[4:11]))) for row in items]


def parameters_of(path: Path) -> dict[str, float]:
    """The parameters of a file of `eadp export --parameters`, by name."""
    rows = [line.replace(",", "\t").split("\t") for line in path.read_text().splitlines() if not line.startswith("#")]
    return {row[-3] if len(row) > 2 else row[0]: float(row[-2] if len(row) > 2 else row[1]) for row in rows}


class Vehicle:
    """The aeroplane, its pack and its pilot on the mission that it holds, from the first waypoint on.

    Parameters
    ----------
    mission : Path
        A file of `eadp export --to ardupilot`, or of `--to px4`, whose autopilot it is.
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
    by_hand : (float, float), optional
        From when on a pilot flies, and for how long [s].
    parameters : dict, optional
        The autopilot's, in place of those of the factory.
    elevation_m : float
        Height of the field above the sea [m].
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
        by_hand: tuple[float, float] | None = None,
        parameters: dict[str, float] | None = None,
        elevation_m: float = 0.0,
    ) -> None:
        self.origin_deg, items = rows_of(mission)
        kind = PX4 if mission.suffix == ".plan" else ARDUPILOT
        self.holder = MissionHolder(items, kind=kind)
        self.holder.parameters = {**FACTORY[kind], **(parameters or {})}
        if not self.holder.px4:
            self.holder.items[0] = (16, 0, (0.0, 0.0, 0.0, 0.0, *self.origin_deg, elevation_m))
        self.pilot = Pilot(self.holder, self.origin_deg)
        # dynamic pressure is that of the calibrated airspeed at sea level, in the standard atmosphere
        self.pilot.calibrated = math.sqrt((1 - 2.25577e-5 * (elevation_m + ALTITUDE_M)) ** 4.2559)
        points = [self.pilot.place(item) for item in items if item[0] == WAYPOINT]
        course = math.atan2(points[1][1] - points[0][1], points[1][0] - points[0][0])
        gusts, start_m = Dryden(math.hypot(*wind_mps), seed, 7200.0), LAUNCH_M if take_off > 1 else ALTITUDE_M
        self.plane = Aeroplane(points[0], course, wind_mps, gusts, elevation_m + start_m)
        self.plane.altitude_target_m = elevation_m + ALTITUDE_M
        self.pack, self._drop = Lipo(capacity_ah, ohm_ah / capacity_ah, cells), drop
        self._cell, self._take_off, self._by_hand, self.elevation_m = cell, take_off, by_hand, elevation_m
        self.fps, self.power_w, self.consumed_ah = float(LEVELS[-1]), 0.0, 0.0
        self._mean_a, self._hold_to_s, self.turned_back = 0.0, math.inf, False

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

    @property
    def altitude_m(self) -> float:
        """Above home."""
        return float(self.plane.altitude_m) - self.elevation_m

    def _change_mode(self) -> None:
        """Have the pilot take over and give back; turn back where PX4's time left is too short, after a hold."""
        pilot, now_s = self.pilot, self.plane.time_s
        if self._by_hand is not None and pilot.mode == "mission" and now_s >= self._by_hand[0]:
            pilot.take_over(self.plane)
        elif self._by_hand is not None and pilot.mode == "pilot" and now_s >= sum(self._by_hand):
            pilot.give_back(self.plane)
            self._by_hand = None
        parameters = self.holder.parameters
        if parameters.get("COM_FLTT_LOW_ACT") != 3 or pilot.mode not in ("mission", "hold"):
            return
        if now_s > TAKE_OFF_S and abs(self.plane.climb_mps) < LEVEL_MPS:
            self._mean_a += (self.pack.current_a - self._mean_a) * (CURRENT_SHARE if self._mean_a else 1.0)
        left_s = 3600 * max(self.pack.capacity_ah - self.consumed_ah, 0.0) / max(self._mean_a, 0.1)
        home_s = math.dist((self.plane.x_m, self.plane.y_m), pilot.home_m) / AIRSPEED_MPS
        if now_s >= self._hold_to_s:
            pilot.mode, self.turned_back = "return", True
            return
        needed_s = parameters["RTL_TIME_FACTOR"] * home_s + parameters["RTL_TIME_MARGIN"]
        if pilot.mode == "mission" and left_s < needed_s:
            pilot.mode, self._hold_to_s = "hold", now_s + HOLD_S

    def step(self) -> None:
        """Fly for CONTROL_S."""
        self._change_mode()
        self.plane.control(self.pilot.bank_rad(self.plane))
        self.holder.autopilot.mode = self.pilot.mode
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
        options.pilot,
        parameters_of(Path(options.parameters)) if options.parameters else None,
        options.elevation,
    )
    holder, detector = vehicle.holder, Autopilot(component=DETECTOR)
    autopilot, wire = holder.autopilot, Wire(options.to, options.loss, options.delay, options.seed)
    plane, pack, pilot = vehicle.plane, vehicle.pack, vehicle.pilot
    runs = None
    if options.rates:
        runs = Detector(*(() if options.deaf else ("--rates", options.rates)), rate=vehicle.fps)
    parser, step, counts = dialect.MAVLink(None), 0, {"commands": 0, "fps": 0, "interrupted": 0}
    parser.robust_parsing = True
    if vehicle.holder.refusal:  # it does not arm
        for _ in range(30):
            wire.send(autopilot.heartbeat(armed=False, active=False))
            wire.send(holder.current_item)
            for frame in (*holder._text(holder.refusal), *holder.armed()):
                wire.send(frame)
            time.sleep(0.1)
            wire.flush()
            answer(wire, parser, holder)
        return {"armed": False, "completed": False, "refusal": holder.refusal.strip()}
    for k in range(round(GROUND_S / CONTROL_S / TELEMETRY_STEPS) if options.take_off > 1 else 0):
        wire.send(autopilot.heartbeat(armed=False, active=False))
        wire.send(autopilot.frame("vfr_hud", 0.0, 0.0, 0, 0, 0.0, 0.0))
        now_s = 100 - GROUND_S + k * CONTROL_S * TELEMETRY_STEPS
        wire.send(position(autopilot, now_s, plane, vehicle.origin_deg, None))
        time.sleep(CONTROL_S * TELEMETRY_STEPS / options.speed)
        wire.flush()
    started, interrupt_s = time.monotonic(), options.interrupt
    asked_s, written = started, 0
    while vehicle.flies:
        now_s = 100 + plane.time_s
        vehicle.fps = vehicle.fps if runs is None else runs.rate
        vehicle.step()
        if step % SECOND_STEPS == 0:
            wire.send(autopilot.heartbeat(armed=True, active=True))
            wire.send(holder.current_item)
            wire.send(detector.frame("named_value_float", round(now_s * 1000), b"fps", vehicle.fps))
        if step % BATTERY_STEPS == 0:
            drawn_ah = vehicle.consumed_ah
            wire.send(autopilot.battery(pack.voltage_v, pack.current_a, drawn_ah, 1 - drawn_ah / pack.capacity_ah))
        if step % TELEMETRY_STEPS == 0:
            calibrated_mps = plane.airspeed_mps * pilot.calibrated
            wire.send(autopilot.frame("vfr_hud", calibrated_mps, 0.0, 0, 50, plane.altitude_m, plane.climb_mps))
            wire.send(position(autopilot, now_s, plane, vehicle.origin_deg, vehicle.altitude_m))
        for data in wire.receive():
            for frame in (message.get_msgbuf() for message in parser.parse_buffer(data) or ()):
                message = dialect.MAVLink(None).decode(bytearray(frame))
                kind = message.get_type()
                for echo in holder.answer(bytes(frame)) if kind == "NAMED_VALUE_FLOAT" else ():
                    wire.send(echo)
                if kind == "NAMED_VALUE_FLOAT" and message.name == "fps" and not options.deaf and runs is None:
                    counts["fps"] += message.value != vehicle.fps
                    vehicle.fps = float(message.value)
                elif kind == "COMMAND_LONG":
                    counts["commands"] += message.command != SET_INTERVAL
                    pilot.mode = "return" if message.command == RETURN else pilot.mode
                    slows = message.command == CHANGE_SPEED
                    result = pilot.change_speed(plane, message.param2) if slows else ACCEPTED
                    wire.send(autopilot.frame("command_ack", message.command, result))
                elif kind == "STATUSTEXT":
                    print(f"{plane.time_s:7.1f} s  {message.text}", file=sys.stderr)
                elif kind != "NAMED_VALUE_FLOAT":
                    for said in holder.answer(bytes(frame)):
                        wire.send(said)
                    if interrupt_s and holder.receives and len(holder.writes) >= INTERRUPTED:
                        wire.silent_until_s, interrupt_s = time.monotonic() + interrupt_s, 0.0
                        holder.give_up()
                        counts["interrupted"] = 1
        if len(holder.writes) != written:
            asked_s, written = time.monotonic(), len(holder.writes)
        elif holder.receives and time.monotonic() - asked_s > ASK_AGAIN_S[holder.px4]:
            asked_s = time.monotonic()
            wire.send(holder.request)
        wire.flush()
        step += 1
        ahead_s = plane.time_s / options.speed - (time.monotonic() - started)
        if ahead_s > 0.005:
            time.sleep(ahead_s)
    if runs is not None:
        runs.close()
    for _ in range(20):
        wire.send(autopilot.heartbeat(armed=False, active=False))
        wire.send(position(autopilot, 100 + plane.time_s, plane, vehicle.origin_deg, None))
        time.sleep(0.05)
        wire.flush()
    return {
        "armed": True,
        "completed": vehicle.completed,
        "turned_back": vehicle.turned_back,
        "time_s": round(plane.time_s, 1),
        "soc": round(float(pack.soc), 4),
        "items_written": len(holder.writes),
        "uploads": holder.uploads,
        **counts,
    }


def answer(wire: Wire, parser: Any, holder: MissionHolder) -> None:
    """Answer what has come of the mission protocol."""
    for data in wire.receive():
        for message in parser.parse_buffer(data) or ():
            for frame in holder.answer(bytes(message.get_msgbuf())):
                wire.send(frame)


def position(
    autopilot: Autopilot, now_s: float, plane: Aeroplane, origin: tuple[float, float], altitude_m: float | None
) -> bytes:
    """Where the aeroplane is, with its altitude above home; None where it has landed."""
    lat, lon = (round(value * 1e7) for value in to_geodetic_deg(plane.x_m, plane.y_m, origin))
    heading = round(100 * (math.degrees(math.pi / 2 - plane.heading_rad) % 360)) % 36000
    landed = altitude_m is None
    speeds = (0, 0, 0) if landed else (round(plane.north_mps * 100), round(plane.east_mps * 100), 0)
    altitude = round(1000 * (altitude_m or 0.0))
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
    parser.add_argument("--parameters")
    parser.add_argument("--pilot", type=float, nargs=2)
    parser.add_argument("--elevation", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=0)
    print(json.dumps(fly(parser.parse_args())))


if __name__ == "__main__":
    main()
