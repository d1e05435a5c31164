"""Flights over MAVLink on the loopback, beside the same flights over JSON lines; latency and processor.

    python benchmarks/link.py [--flights 30] [--px4 20] [--speed 1] [--jobs 20] [--lines 5] [--alone] [--write]

- **Flights**: `docs/examples/vehicle.py` and `eadp replan --mavlink --upload`, two processes, `--speed` times as
  fast as the clock. `--flights` are as ArduPilot, `--px4` as PX4, with the parameters that `eadp export --parameters`
  writes. Each is launched by hand at 5 to 18 times the power of level flight. Every message is lost with 5 %, with
  15 % in the flights as PX4 and in some others, either way, and comes up to 0.05 s late, so that messages overtake one
  another. Some flights lose a cell, which the voltage alone shows; in some the link is silent amid an upload, which the
  vehicle gives up; in some a pilot flies for a minute. Beside it the same vehicle, take-off, pack, gusts and losses of
  charge by JSON lines once a second through the re-planner of `eadp replan`: nothing is lost, and what is decided is
  flown at once. U of both is that of the stages and parameters that their lines of telemetry report. A decision near a
  threshold depends on when in the second a line comes: the flight by JSON lines is flown `--lines` times, with lines
  that begin up to 0.8 s later.
- **Latency and processor**: `eadp replan --mavlink` gets a recorded flight at 5 positions a second, alone, amid 50 Hz
  of ten kinds of messages, and amid as many messages of another sender as can be sent. Latency is the time from sending
  a position to receiving the decision about it.
- **Computations**: `docs/examples/detector.py`, a process that works, measured by `eadp profile --measure`, whose rate
  `eadp replan --publish` then sets while the vehicle flies; and one that does not obey. Where the computer has no
  sensor, the detector's meter stands for one.

Needs jsbsim and pymavlink: pip install 'eadp[bench,mavlink]'.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from measured import options, recorded, share, table, yes

ROOT = Path(__file__).resolve().parents[1]
sys.path += [str(ROOT / "tests/support"), str(ROOT / "docs/examples")]

import mavlink_vehicle  # noqa: E402
from common.plans import placed  # noqa: E402
from mavlink_vehicle import Autopilot  # noqa: E402
from twin import OWNER, PROFILE, plans  # noqa: E402
from vehicle import GROUND_S, SECOND_STEPS, TELEMETRY_STEPS, Vehicle, parameters_of, rows_of  # noqa: E402

from eadp.api.inputs import FlightInputs, load_flight  # noqa: E402
from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m  # noqa: E402
from eadp.exchange.writer import read_items  # noqa: E402
from eadp.live.mavlink import Codec  # noqa: E402
from eadp.live.mission import PROTOCOL, HeldMission, Mapped, Outgoing, Output, Warned  # noqa: E402  # noqa: E402
from eadp.live.replanner import Replanner  # noqa: E402
from eadp.simulation.metrics import ParameterLog  # noqa: E402

LOSS, HIGH_LOSS, DELAY_S, SEED, FIRST_PORT = 0.05, 0.15, 0.05, 33, 15_100
BY_HAND_S, RESERVED_AH = 60.0, 0.2
"""How long a pilot flies [s]; charge for 100 s of level flight and the way home, at which PX4 turns back [Ah]."""
BOOT_S = 100.0
"""The autopilot's time at the launch [s]."""
CAPACITIES_AH = {"survey": (0.6, 1.2), "meadow": (0.75, 1.1), "slanted": (0.65, 0.95), "corner": (1.1, 1.9)}
TAKE_OFFS, OHM_AH, SILENT_S = (5.0, 18.0), 0.02, 12.0
"""Power of the take-off beside that of level flight; resistance times capacity of a pack that can give it; and how long
a link is silent [s]."""
CLIMB_AH, FULL_AH = 0.06, 0.0125
"""Charge for the climb; and for ten seconds at the power of level flight, 70 W."""
LOW_AH = 0.52
"""A battery that lasts for the survey's widest lines at low rates alone."""
EADP = [sys.executable, "-m", "eadp"]
VEHICLE = [sys.executable, str(ROOT / "docs/examples/vehicle.py")]


@dataclass(frozen=True)
class Mission:
    """A flight: its plan, air and pack, and a loss of charge, or one of a cell: when [s], and which share."""

    index: int
    place: str
    folder: Path
    wind_mps: tuple[float, float]
    capacity_ah: float
    drop: tuple[float, float] | None
    cell: tuple[float, float] | None = None
    take_off: float = 1.0
    interrupted: bool = False
    px4: bool = False
    by_hand: tuple[float, float] | None = None
    loss: float = LOSS

    def file(self, name: str) -> Path:
        """A file of this flight."""
        return self.folder / f"{self.index}-{name}"

    @property
    def plan(self) -> str:
        """The plan, with a place on the earth."""
        return str(self.folder / f"{self.place}.plan")

    @property
    def waypoints(self) -> str:
        """The mission at the parameters of the forecast before take-off."""
        return str(self.file("mission.plan" if self.px4 else "mission.waypoints"))

    @property
    def parameters(self) -> str:
        """The autopilot's parameters that the forecast holds for."""
        return str(self.file("autopilot.params" if self.px4 else "autopilot.param"))

    @property
    def inputs(self) -> FlightInputs:
        """As the owner states them."""
        return load_flight(self.plan, scenario=str(self.file("scenario.yaml")))


def missions(count: int, folder: Path, px4: int = 0) -> list[Mission]:
    """Random missions as ArduPilot, then as PX4; their plans and scenarios."""
    rng, made = np.random.default_rng(SEED), []
    (folder / "made").mkdir(parents=True)
    for name, file in plans(folder / "made").items():
        (folder / f"{name}.plan").write_text(placed(Path(file).read_text()))
    for index, place in zip(range(count + px4), itertools.cycle(CAPACITIES_AH)):
        speed, course = rng.uniform(0, 6), rng.uniform(0, 2 * math.pi)
        loss = round(rng.uniform(60, 250), 1), round(rng.uniform(0.04, 0.1), 3)
        wind = round(speed * math.cos(course), 2), round(speed * math.sin(course), 2)
        take_off = round(rng.uniform(*TAKE_OFFS), 1)
        capacity_ah = round(rng.uniform(*CAPACITIES_AH[place]) + CLIMB_AH + FULL_AH * take_off, 3)
        drop, cell = (loss if index % 3 == 2 else None), None
        if index % 6 == 3:  # so much as no straight line of the voltage hides, and a battery that has it
            cell = loss[0], round(0.1 + loss[1], 3)
            capacity_ah = round(capacity_ah / (1 - cell[1]), 3)
        is_px4 = index >= count
        by_hand = (loss[0] + 20, BY_HAND_S) if index % 5 == 1 else None
        if by_hand is not None:  # at 20 m/s he draws twice as much
            capacity_ah = round(capacity_ah + 12 * FULL_AH, 3)
        capacity_ah = round(capacity_ah + RESERVED_AH * is_px4, 3)
        lost = HIGH_LOSS if is_px4 or index % 5 == 2 else LOSS
        ways = index % 4 == 0, is_px4, by_hand, lost
        mission = Mission(index, place, folder, wind, capacity_ah, drop, cell, take_off, *ways)
        lay_out(mission)
        made.append(mission)
    return made


def lay_out(mission: Mission) -> None:
    """Write its scenario and its waypoints."""
    battery = {"capacity_ah": mission.capacity_ah, "resistance_ohm": round(OHM_AH / mission.capacity_ah, 4)}
    scenario = {"schema": "eadp.scenario/1", "vehicle": str(OWNER), "profile": str(PROFILE), "battery": battery}
    mission.file("scenario.yaml").write_text(json.dumps({**scenario, "reserve_soc": 0.05}))
    to = "px4" if mission.px4 else "ardupilot"
    export = [*EADP, "export", mission.plan, "--to", to, "--altitude", "100", "-o", mission.waypoints]
    export += ["--scenario", str(mission.file("scenario.yaml")), "--parameters", mission.parameters]
    subprocess.run(export, check=True, capture_output=True)
    if mission.px4:  # it arms without a landing by the exported parameters, and turns back by itself to the start
        home_deg, _ = rows_of(Path(mission.waypoints))
        scenario |= {"autopilot": {"kind": "px4", "parameters": {"MIS_TKO_LAND_REQ": 0}}}
        scenario |= {"home": dict(zip(("lat_deg", "lon_deg"), home_deg, strict=True))}
        mission.file("scenario.yaml").write_text(json.dumps({**scenario, "reserve_soc": 0.05}))
        subprocess.run(export, check=True, capture_output=True)


# --- flights


@dataclass(frozen=True)
class Flown:
    """What came of a flight."""

    completed: bool
    soc: float
    u: float
    uploads: int = 0
    accepted: int = 0
    turned_back: bool = False
    decided_by_hand: int = 0
    interrupted: int = 0
    warned: tuple[str, ...] = ()
    cell_s: float | None = None
    """When a lost cell is reported [s]."""
    infeasible: int = 0
    """Decisions of the first minute with the reason “battery short”."""


def listens(port: int) -> bool:
    """Whether a UDP port is open on this computer."""
    return any(f":{port:04X} " in row for row in Path("/proc/net/udp").read_text().splitlines())


def replan(mission: Mission, port: int, *options: str) -> subprocess.Popen[bytes]:
    """`eadp replan` on a port; returns when it listens."""
    log = mission.file("log.jsonl")
    log.unlink(missing_ok=True)
    command = [*EADP, "replan", mission.plan, "--scenario", str(mission.file("scenario.yaml")), "--upload"]
    command += ["--items", f"{mission.waypoints}.items.json", "--log", str(log), *options]
    with mission.file("out.jsonl").open("wb") as out, mission.file("said.txt").open("wb") as said:
        process = subprocess.Popen([*command, "--mavlink", f"udpin:127.0.0.1:{port}"], stdout=out, stderr=said)
    while not listens(port):
        if process.poll() is not None:
            sys.exit(mission.file("said.txt").read_text())
        time.sleep(0.05)
    return process


def vehicle(mission: Mission, port: int, speed: float, *options: str) -> dict[str, Any]:
    """The vehicle on its mission, to its end."""
    command = [*VEHICLE, mission.waypoints, "--to", f"127.0.0.1:{port}"]
    command += ["--speed", str(speed), "--capacity", str(mission.capacity_ah), "--seed", str(mission.index)]
    command += ["--wind", *map(str, mission.wind_mps)]
    command += ["--drop", *map(str, mission.drop)] if mission.drop else []
    command += ["--cell", *map(str, mission.cell)] if mission.cell else []
    command += ["--take-off", str(mission.take_off), "--ohm-ah", str(OHM_AH), "--parameters", mission.parameters]
    command += ["--pilot", *map(str, mission.by_hand)] if mission.by_hand else []
    done = subprocess.run([*command, *options], check=True, capture_output=True, text=True)
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def over_link(mission: Mission, speed: float) -> Flown:
    """A flight over MAVLink."""
    port = FIRST_PORT + mission.index
    process = replan(mission, port)
    try:
        silent = ("--interrupt", str(SILENT_S)) if mission.interrupted else ()
        end = vehicle(mission, port, speed, "--loss", str(mission.loss), "--delay", str(DELAY_S), *silent)
        process.wait(30)
    finally:
        process.kill()
    rows = [json.loads(row) for row in mission.file("log.jsonl").read_text().splitlines()]
    lines = [json.dumps(row).encode() for row in rows if row.pop("kind") == "telemetry"]
    decided = [json.loads(row) for row in mission.file("out.jsonl").read_text().splitlines()]
    told = [row["time_s"] - BOOT_S for row in decided if "cell-lost" in row["warnings"]]
    said = mission.file("said.txt").read_text()
    return Flown(
        end["completed"],
        end["soc"],
        quality(mission.inputs, lines),
        said.count("uploaded and verified"),
        end["uploads"],
        end["turned_back"],
        changes_by_hand(mission, decided),
        end["interrupted"],
        tuple(sorted(set(re.findall(r"warning: (.*)", said)))),
        told[0] if told else None,
        sum("battery short" in row["reason"] for row in decided if row["time_s"] < BOOT_S + 60),
    )


def changes_by_hand(mission: Mission, decided: list[dict[str, Any]]) -> int:
    """How many decisions of other parameters there are while a pilot flies, from two seconds on."""
    from_s, for_s = mission.by_hand or (math.inf, 0.0)
    rows = [row["parameters"] for row in decided if 2 < row["time_s"] - BOOT_S - from_s < for_s]
    return sum(one != other for one, other in itertools.pairwise(rows))


class Bridge:
    """The reference: what `eadp replan` decides by JSON lines is flown at once, and nothing is lost or late.

    A line a second tells what the aeroplane measures, the item that it flies to, and the parameters in force; other
    path parameters replace the rest of the mission before the next step. The first line comes after `begin_step` steps.
    """

    def __init__(self, mission: Mission, begin_step: int = 0) -> None:
        self.inputs = mission.inputs
        self._begin_step = begin_step
        self.plan = self.inputs.mission.plan
        self.vehicle = Vehicle(
            Path(mission.waypoints),
            mission.wind_mps,
            mission.capacity_ah,
            mission.index,
            mission.drop,
            mission.cell,
            mission.take_off,
            OHM_AH,
            by_hand=mission.by_hand,
            parameters=parameters_of(Path(mission.parameters)),
        )
        self.names = self.plan.names[: self.plan.path_count]
        self.items = read_items(f"{mission.waypoints}.items.json", self.names)
        self.lines, self.decisions = list[bytes](), list[dict[str, Any]]()
        self.replanner = Replanner(self.inputs, "lines", None, self.decisions.append, str)
        self._held = HeldMission(self.plan, self.inputs.mission.cruise_mps, self.items)
        self._codec, self._answers = Codec(frozenset()), Codec(PROTOCOL)
        self._held.ardupilot = not mission.px4
        self._exchange(self._held.read(0.0), 0.0)

    def _exchange(self, outputs: list[Output], now_s: float) -> None:
        """Exchange messages of the mission protocol until there are none."""
        while outputs:
            match outputs.pop(0):
                case Mapped(items) if items is not None:
                    self.items = items
                case Warned(text):
                    print(text)
                case Outgoing(kind, fields):
                    frame = self._codec.encoded(1, kind, {"target_system": 1, "target_component": 1, **fields})
                    for answer in self.vehicle.holder.answer(frame):
                        for message in self._answers.decoded(answer):
                            outputs += self._held.take(message.kind, message.fields, now_s)

    def fly(self) -> Flown:
        """The flight, from the ground on."""
        vehicle, step = self.vehicle, 0
        self._send(
            self._line() | {"time_s": -GROUND_S, "velocity_mps": [0.0, 0.0], "airspeed_mps": 0.0, "altitude_m": 0.0}
        )
        while vehicle.flies:
            vehicle.step()
            step += 1
            if step % SECOND_STEPS != self._begin_step:
                continue
            count = len(self.decisions)
            self._send(self._line())
            if len(self.decisions) == count:
                continue
            decided = self.decisions[-1]
            vehicle.fps = decided["parameters"][self.plan.names[-1]]
            if self.replanner.planned and vehicle.pilot.mode == "mission":
                path = tuple([decided["parameters"][name] for name in self.names])
                now_s = vehicle.plane.time_s
                self._exchange(self._held.tick(now_s, vehicle.holder.current), now_s)
                for _ in ("checked", "sent"):
                    self._exchange(self._held.decide(now_s, path, self.replanner.rest), now_s)
        return Flown(vehicle.completed, float(vehicle.pack.soc), quality(self.inputs, self.lines))

    def _send(self, line: dict[str, Any]) -> None:
        self.lines.append(json.dumps(line).encode())
        self.replanner.take(self.replanner.reader.read(len(self.lines), self.lines[-1]))

    def _line(self) -> dict[str, Any]:
        vehicle, plane = self.vehicle, self.vehicle.plane
        item = self.items[min(vehicle.holder.current - vehicle.holder.first, len(self.items) - 1)]
        stage = {"stages_started": item.first} if item.first == item.last else {}
        lat_deg, lon_deg = to_geodetic_deg(plane.x_m, plane.y_m, vehicle.origin_deg)
        return stage | {
            "flies_mission": vehicle.pilot.mode == "mission",
            "time_s": round(plane.time_s, 3), "lat_deg": lat_deg, "lon_deg": lon_deg,
            "power_w": round(vehicle.power_w, 2), "current_consumed_ah": round(vehicle.consumed_ah, 3),
            "velocity_mps": [round(plane.east_mps, 2), round(plane.north_mps, 2)],
            "heading_deg": round(90 - math.degrees(plane.heading_rad), 1) % 360,
            "airspeed_mps": round(plane.airspeed_mps, 2), "altitude_m": round(plane.altitude_m, 2),
            "voltage_v": round(float(vehicle.pack.voltage_v), 3) or None,
            "parameters": dict(zip(self.names, item.parameters, strict=True)) | {self.plan.names[-1]: vehicle.fps},
        }  # fmt: skip


def quality(inputs: FlightInputs, lines: Iterable[bytes]) -> float:
    """U of the stages and parameters that lines of telemetry report."""
    replanner, log, before = Replanner(inputs, "log", None, str, str), None, (0, ())
    for number, raw in enumerate(lines, 1):
        replanner.take(replanner.reader.read(number, raw))
        flight, said = replanner._flight, json.loads(raw)
        if not flight._started or flight._flight is None:
            continue
        executor, time_s = flight._tracker.executor, said["time_s"] - flight._origin_s
        now = executor.stages_started, executor.parameters
        if log is None:
            log = ParameterLog(inputs.mission.plan, executor.cursor, executor.joined_m)
        elif now != before:
            log.change(time_s, executor.cursor, executor.joined_m if now[0] != before[0] else None)
        before = now
    assert log is not None
    origin = inputs.mission.plan.site.origin_deg
    assert origin is not None
    at = to_local_m(said["lat_deg"], said["lon_deg"], origin)
    log.close(time_s, None if executor.complete else (at, inputs.mission.cruise_mps))
    return log.quality({}) or 0.0


def by_lines(mission: Mission, count: int) -> list[Flown]:
    """A flight by JSON lines, so many times, up to five."""
    return [Bridge(mission, step).fly() for step in range(0, SECOND_STEPS, TELEMETRY_STEPS)[:count]]


def flights(found: list[Mission], speed: float, jobs: int, count: int) -> None:
    """All flights, both ways: a line of each on standard error, and what they show."""
    spare = ProcessPoolExecutor(os.cpu_count(), initializer=os.nice, initargs=(10,))
    with spare as processes, ThreadPoolExecutor(jobs) as pool:
        fives = processes.map(functools.partial(by_lines, count=count), found)
        linked = list(pool.map(lambda mission: over_link(mission, speed), found))
        reference = list(fives)
    apart, beyond = [], []
    for mission, one, five in zip(found, linked, reference, strict=True):
        least, most = min(flown.u for flown in five), max(flown.u for flown in five)
        apart.append(one.u - five[0].u)
        beyond.append(one.u - min(max(one.u, least), most))
        kind = "PX4" if mission.px4 else "ArduPilot"
        text = f"{mission.index} {kind} {mission.place}, {mission.capacity_ah} Ah, lost {mission.drop or mission.cell}"
        text += f": {yes(one.completed)}, SoC {one.soc:.3f}, U {one.u:.3f}; by lines {least:.3f} to {most:.3f}"
        print(text, file=sys.stderr)
    table(("flights", "value"), shown(found, linked, reference, np.abs(apart), np.abs(beyond)))


def shown(
    found: list[Mission], linked: list[Flown], reference: list[list[Flown]], apart: Any, beyond: Any
) -> Iterator[tuple[str, object]]:
    """What flights show: U beside those by JSON lines, take-offs, lost cells, uploads, pilots, and warnings."""
    count, pairs = len(found), list(zip(found, linked, strict=True))
    completed = sum(one.completed for one in linked), sum(all(one.completed for one in five) for five in reference)
    yield "completed over MAVLink, over JSON lines", f"{completed[0]}, {completed[1]} of {count}"
    yield "U within 0.02 of those by JSON lines; most apart", f"{(beyond <= 0.02).sum()} of {count}; {beyond.max():.3f}"
    sizes = f"{(apart <= 0.02).sum()} of {count}; {np.median(apart):.4f}; {apart.max():.3f}"
    yield "U within 0.02 of the first of them; median apart; most", sizes
    hopeless = sum(one.infeasible > 0 for one in linked)
    yield "“battery short” within a minute of the launch", f"{hopeless} of {count}"
    reported = [None if one.cell_s is None else one.cell_s - mission.cell[0] for mission, one in pairs if mission.cell]
    yield "a lost cell is reported after", ", ".join("not" if each is None else f"{each:.0f} s" for each in reported)
    false = sum(one.cell_s is not None for mission, one in pairs if not mission.cell)
    yield "a lost cell is reported that is none", f"{false} of {count - len(reported)}"
    yield "uploads interrupted", sum(one.interrupted for one in linked)
    uploads = sum(one.uploads for one in linked), sum(one.accepted for one in linked)
    yield "uploads verified, of those that the autopilot accepted", f"{uploads[0]} of {uploads[1]}"
    by_hand = [one.decided_by_hand for mission, one in pairs if mission.by_hand]
    yield "other parameters decided while a pilot flies", f"{sum(by_hand)}, in {len(by_hand)} flights"
    turned = [one.turned_back for mission, one in pairs if mission.px4]
    yield "PX4 has turned back by itself", f"{sum(turned)} of {len(turned)}"
    warned = Counter(text for one in linked for text in one.warned)
    for text, flown in sorted(warned.items()):
        yield f"flights with the warning “{text}”", flown


# --- latency and processor


LATENCY = (
    *("beside 5 positions a second", "messages a second", "share of a core", "latency, median [ms]"),
    *("99th percentile [ms]", "decisions"),
)


def load(folder: Path, seconds: float) -> Iterator[list[str]]:
    """Latency and processor time, alone and amid floods."""
    for port, (name, rate) in enumerate((("nothing", 0), ("50 Hz of ten kinds", 500), ("another sender", 1e6)), 15_000):
        yield [name, *loaded(folder, port, rate, seconds)]


def loaded(folder: Path, port: int, rate: float, seconds: float) -> list[str]:
    """One row: what `eadp replan` does with a recorded flight at 5 Hz, amid so many other messages a second."""
    command = [*EADP, "replan", str(folder / "survey.plan"), "--scenario", str(ROOT / "scenarios/survey.yaml")]
    command += ["--mavlink", f"udpin:127.0.0.1:{port}"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not listens(port):
        time.sleep(0.05)
    lines = mavlink_vehicle.recorded(str(ROOT / "scenarios/example-telemetry.jsonl"))
    times = [each["time_s"] for each in lines]
    steps = [
        {key: float(np.interp(times[0] + k / 5, times, [each[key] for each in lines])) for key in ("x_m", "y_m", "soc")}
        | {key: lines[k // 5][key] for key in ("power_w", "velocity_mps", "heading_deg")}
        for k in range(int(5 * seconds))
    ]
    ours, codec = Autopilot(), Codec(frozenset({"NAMED_VALUE_FLOAT"}))
    # the flood is of the autopilot's own messages where there are ten kinds, else of another system
    others = kinds(Autopilot() if rate < 1e4 else Autopilot(system=7), rate < 1e4)
    sent_s, delays, count, answered = {}, [], 0, set()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port_out:
        port_out.bind(("127.0.0.1", 0))
        port_out.setblocking(False)
        begun, cpu = time.monotonic(), cpu_s(process.pid)
        step = 0
        while (now := time.monotonic() - begun) < seconds:
            if now >= step / 5 and step < len(steps):
                each, at_s = steps[step], 100 + step / 5
                frames = [ours.heartbeat(armed=True, active=True)] if step % 5 == 0 else []
                frames += [ours.battery(14.8, each["power_w"] / 14.8, None, each["soc"])]
                frames += [ours.position(at_s, each["x_m"], each["y_m"], each["velocity_mps"], each["heading_deg"])]
                for frame in frames:
                    port_out.sendto(frame, ("127.0.0.1", port))
                sent_s[round(at_s * 1000)] = time.monotonic()
                step, count = step + 1, count + len(frames)
            until = begun + now + 0.001
            flood = 0
            while rate and (count < rate * now or rate > 1e4) and time.monotonic() < until and flood < 100:
                port_out.sendto(next(others), ("127.0.0.1", port))
                flood, count = flood + 1, count + 1
            try:
                data = port_out.recv(4096)
            except OSError:
                time.sleep(0.0002 if rate < 1e4 else 0)
                continue
            for message in codec.decoded(data):
                stamp = message.fields["time_boot_ms"]
                if stamp not in answered and stamp in sent_s:
                    answered.add(stamp)
                    delays.append(1e3 * (time.monotonic() - sent_s[stamp]))
        share = (cpu_s(process.pid) - cpu) / seconds
    process.terminate()
    process.wait()
    figures = np.percentile(delays, [50, 99]) if delays else (math.nan, math.nan)
    return [f"{count / seconds:,.0f}", f"{share:.1%}", *(f"{figure:.1f}" for figure in figures), str(len(delays))]


def kinds(autopilot: Autopilot, wanted: bool) -> Iterable[bytes]:
    """Messages for a flood."""
    frame = autopilot.frame
    made = [
        frame("attitude", 0, 0, 0, 0, 0, 0, 0),
        frame("raw_imu", 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        frame("nav_controller_output", 0, 0, 0, 0, 0, 0, 0, 0),
        frame("servo_output_raw", 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        frame("vfr_hud", 12.0, 12.0, 90, 50, 100.0, 0.0),
        frame("wind", 180.0, 5.0, 0.0),
        frame("sys_status", 0, 0, 0, 0, 14800, 100, 90, 0, 0, 0, 0, 0, 0),
        frame("mission_current", 3),
        frame("named_value_float", 0, b"other", 1.0),
        frame("battery_status", 1, 0, 1, 0, [3700] * 10, 100, 10, -1, 90),
    ]
    return itertools.cycle(made if wanted else [frame("global_position_int", 5, 1, 1, 0, 0, 0, 0, 0, 0)])


def cpu_s(pid: int) -> float:
    """Processor time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


# --- computations


def computing(mission: Mission, speed: float) -> None:
    """A detector that runs: its power, then a flight in which it obeys, and one in which it does not.

    The battery lasts at the lowest rate alone.
    """
    mission = replace(mission, index=50, capacity_ah=LOW_AH, drop=None, take_off=1.0)
    lay_out(mission)
    folder = mission.folder / "sys"
    chip = folder / "class/hwmon/hwmon0"
    chip.mkdir(parents=True)
    (chip / "name").write_text("detector\n")
    (chip / "power1_input").write_text("2000000\n")
    detector = [sys.executable, str(ROOT / "docs/examples/detector.py"), "--meter", str(folder), "--rate", "{fps}"]
    measure = ["--measure", "--sysfs", str(folder), "--config", "fps=2,4,6,8,10", "--accuracy", "3%", "--longest", "40"]
    measured = mission.folder / "detector.csv"
    subprocess.run([*EADP, "profile", *measure, "-o", str(measured), "--", *detector], check=True, capture_output=True)
    watts = {}
    for row in measured.read_text().splitlines():
        if re.match(r"[0-9]", row):
            rate, power = map(float, row.split(","))
            watts.setdefault(rate, []).append(power)
    table(
        ("fps", *(f"{rate:g}" for rate in watts)),
        [("power by `eadp profile --measure` [W]", *(f"{np.mean(each):.2f}" for each in watts.values()))],
    )
    lines = ("lines whose rate reached is within 1 of it", "lines with `not-applied`")
    titles = "detector", "rates decided", *lines, "completed", "SoC", "SoC forecast half-way"
    flown = []
    for port, (name, deaf) in enumerate((("obeys", ()), ("does not", ("--deaf",))), 15_050):
        rates = str(mission.file(f"{port}.json"))
        process = replan(mission, port, "--publish", rates)
        end = vehicle(mission, port, speed, "--rates", rates, *deaf)
        process.wait(30)
        rows = [json.loads(row) for row in mission.file("out.jsonl").read_text().splitlines()]
        asked = np.array([row["parameters"]["c2"] for row in rows])
        reached = np.array([row["in_force"]["c2"] for row in rows])
        near = share((np.abs(reached - asked) <= 1).tolist())
        half = rows[len(rows) // 2]["soc_end_forecast"]
        refused = share(["not-applied" in row["warnings"] for row in rows])
        rates_asked = [f"{rate:g}" for rate, _ in itertools.groupby(asked)]
        flown.append([name, ", ".join(rates_asked), near, refused, yes(end["completed"])])
        flown[-1] += [f"{end['soc']:.3f}", f"{half:.3f}"]
    table(titles, flown)


def main() -> None:
    parser = options(__doc__, "link")
    parser.add_argument("--flights", type=int, default=30)
    parser.add_argument("--px4", type=int, default=20)
    parser.add_argument("--alone", action="store_true", help="flights, and nothing else")
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--jobs", type=int, default=20)
    parser.add_argument("--lines", type=int, default=5, help="how often each is flown by JSON lines")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--keep", type=Path, help="a folder for the flights' files")
    asked = parser.parse_args()
    with recorded("link", write=asked.write), tempfile.TemporaryDirectory() as own:
        folder = Path(asked.keep or own)
        found = missions(max(asked.flights, 1), folder, asked.px4)
        if flown := found[asked.flights == 0 :]:
            flights(flown, asked.speed, asked.jobs, asked.lines)
        if not asked.alone:
            table(LATENCY, load(folder, asked.seconds))
            computing(found[0], 4.0)


if __name__ == "__main__":
    main()
