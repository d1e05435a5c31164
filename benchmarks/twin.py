"""`joint` by `eadp replan` on an aeroplane that knows nothing of eadp, beside the best constant parameters.

    python benchmarks/twin.py [--missions 40] [--seed 0] [--jobs 2] [--only INDEX …] [--write]

The plant is benchmarks/plant.py: JSBSim, an autopilot, gusts, lithium cells and a gauge. `eadp replan` runs as a
process. Each second it gets one line of telemetry, and the autopilot takes the parameters of the line that answers it;
neither waits for a clock. What it knows of the aeroplane is `twin/owner.yaml`, with a level power up to 10 % off and a
capacity up to 5 %.

Missions: the survey and three covered fields, wind of 0 to 8 m/s from anywhere, and in every second one, one or two
sudden losses of charge. The capacity lies between what the lowest and what the highest parameters need, and a little
beyond. `best` is the best of a grid of constant parameters, refined, each flown in the same wind, gusts and losses: of
those that keep the reserve, or else complete, the one with the largest U. Two bounds of what re-planning can gain
stand beside it: `before`, the constants that the forecast before take-off chooses, with the wind known, flown; and
`clairvoyant`, the best c1 with computations mixed in time, with all losses known, that leaves above the reserve what no
one can know of the gauge.

- `--log DIR` keeps the files of each mission: plan, scenario, the flight as CSV, log and messages of `eadp replan`; and
  the CSV of a flight at several airspeeds, banks and climbs.
- `--cache DIR` keeps the flights with constant parameters for other runs.
- `--paced` lets the airspeed be decided, from 10.5 to 15 m/s, beside the same at 15 m/s; the clairvoyant then chooses
  one of the airspeeds as well, for the whole flight. With `--draw INDEX` a picture of one of the flights is made.
- Each mission is a line on standard error. An interrupt ends the flights; the table is of those that are complete.

Needs jsbsim: pip install 'eadp[bench]'.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import hashlib
import json
import math
import multiprocessing
import resource
import select
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "benchmarks"))

from measured import covered, line, options, recorded, rms, table  # noqa: E402
from plant import AIRSPEED_MPS, CONTROL_S, SAMPLE_S, Aeroplane, Dryden, Lipo, PlanFlight, Sample, battery_w, sampled  # noqa: E402

from eadp import read_plan  # noqa: E402
from eadp.api.inputs import Files, load_flight  # noqa: E402
from eadp.io.figures.canvas import COLOURS, GREY, figure_pair, legend_above  # noqa: E402
from eadp.io.text.streams import Text  # noqa: E402
from eadp.models.plan.cursor import PlanCursor, Rules  # noqa: E402
from eadp.models.plan.executor import PlanExecutor  # noqa: E402
from eadp.models.plan.plan import Plan  # noqa: E402
from eadp.models.plan.trace import default_start  # noqa: E402
from eadp.simulation.metrics import ParameterLog  # noqa: E402

PICTURE = ROOT / "docs/pictures/plant-loss"
PROFILE = ROOT / "profiles/pednet-jetson-nano.yaml"
OWNER, PLANT = ROOT / "benchmarks/twin/owner.yaml", ROOT / "benchmarks/plant.py"
FIELDS = {
    "meadow": ROOT / "plans/meadow.geojson",
    "slanted": [[0, 0], [400, 100], [450, 450], [100, 380]],
    "corner": [[0, 0], [560, 0], [560, 240], [280, 240], [280, 420], [0, 420]],
}
GRID, REFINED, RESERVE, PER_LINE = 6, 4, 0.05, round(1 / SAMPLE_S)
OHM_AH = 0.06
"""Resistance of a pack times its capacity."""
GAUGE_ERROR = 0.02
"""Greatest error of the gauge's gain."""
GAUGE_MARGIN = 0.9 * GAUGE_ERROR * (1 - RESERVE)
"""Charge to leave above the reserve for it to be kept in 95 % of flights, whoever plans: the 0.95 quantile of what the
gauge is off."""
ANSWER_S = 20.0
LEVELS, LEVELS_W = zip(
    *((p["at"][0], p["power_w"]) for p in yaml.safe_load(PROFILE.read_text())["points"]), strict=True
)


# --- missions


@dataclass(frozen=True)
class Mission:
    """One mission: its plan and air, what the owner knows, and its pack once that is chosen."""

    index: int
    place: str
    plan_file: str
    wind_mps: tuple[float, float]
    seed: int
    losses: tuple[tuple[float, float], ...]
    """Share of the shortest flight after which charge is lost, and how much."""
    capacity_share: float
    """0: what the lowest parameters need, 1: what the highest need."""
    level_factor: float
    capacity_factor: float
    resistance_factor: float
    computing_factor: float
    gauge_factor: float

    def lipo(self, capacity_ah: float | np.ndarray) -> Lipo:
        """A full pack of this mission."""
        return Lipo(capacity_ah, OHM_AH / capacity_ah * self.resistance_factor)

    def noise(self, count: int) -> np.ndarray:
        """Factors of the computations' power, a sample each."""
        return self.computing_factor * (1 + 0.03 * np.random.default_rng(self.seed + 1).standard_normal(count))


def plans(folder: Path) -> dict[str, str]:
    """The survey, and plans that cover fields."""
    return {"survey": str(ROOT / "plans/survey.plan")} | covered(folder, FIELDS, PROFILE, 45)


def missions(count: int, seed: int, found: dict[str, str]) -> list[Mission]:
    """Random missions: one is the same whatever the number of missions."""
    made = []
    for index in range(count):
        rng = np.random.default_rng([seed, index])
        place = list(found)[index % len(found)]
        speed, towards = rng.uniform(0, 8), rng.uniform(0, 2 * math.pi)
        count_lost = int(rng.integers(1, 3)) if (index // len(found) + index) % 2 else 0
        losses = tuple((float(rng.uniform(0.1, 0.8)), float(rng.uniform(0.02, 0.08))) for _ in range(count_lost))
        made.append(
            Mission(
                index,
                place,
                found[place],
                (speed * math.cos(towards), speed * math.sin(towards)),
                int(rng.integers(1 << 30)),
                losses,
                capacity_share=rng.uniform(-0.02, 1.1),
                level_factor=rng.uniform(0.9, 1.1),
                capacity_factor=rng.uniform(0.95, 1.02),
                resistance_factor=rng.uniform(0.8, 1.5),
                computing_factor=rng.uniform(0.97, 1.03),
                gauge_factor=rng.uniform(1 - GAUGE_ERROR, 1 + GAUGE_ERROR),
            )
        )
    return made


def ends(plan: Plan, index: int) -> tuple[float, float]:
    """Lowest and highest value of a parameter."""
    boxes = [stage.sets[index] for stage in plan.stages]
    return min(box.lo for box in boxes), max(box.hi for box in boxes)


# --- constant parameters


@dataclass(frozen=True)
class Constant:
    """A flight with constant parameters."""

    c: tuple[float, float]
    completed: bool
    soc: float
    u: float
    time_s: float

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """What is better: the reserve kept, the plan complete, U."""
        return self.completed and self.soc >= RESERVE, self.completed, self.u


class Constants:
    """Flights with constant parameters: neither path nor motion depend on computations and battery."""

    def __init__(
        self, mission: Mission, cache: str | None, other: Constants | None = None, airspeed_mps: float = AIRSPEED_MPS
    ) -> None:
        """With `other` its losses and its capacity, at another airspeed."""
        self._cache, self._airspeed_mps = cache, airspeed_mps
        self.plan = read_plan(mission.plan_file, warn=lambda _: None)
        self.mission = mission
        self.flights: dict[float, list[Sample]] = {}
        for c1 in np.linspace(*ends(self.plan, 0), GRID):
            self._fly(float(c1))
        shortest_s = min(samples[-1].time_s for samples in self.flights.values())
        drops = {round(share * shortest_s / SAMPLE_S): drop for share, drop in mission.losses}
        self.losses = other.losses if other else drops
        self.capacity_ah = other.capacity_ah if other else self._capacity_ah()
        self.flown = [constant for c1 in self.flights for constant in self._flown(c1)]
        # U rises with c1 up to the step at which one more lap is flown
        for _ in range(REFINED):
            higher = [c1 for c1 in self.flights if c1 > self.best.c[0]]
            if higher:
                c1 = (self.best.c[0] + min(higher)) / 2
                self._fly(c1)
                self.flown += self._flown(c1)

    @property
    def best(self) -> Constant:
        """The best of them."""
        return max(self.flown, key=lambda constant: constant.rank)

    @property
    def clairvoyant(self) -> float:
        """U of the best path with computations mixed in time; 0 where none keeps the reserve and the gauge's margin."""
        found = [0.0]
        for c1 in self.flights:
            # by level: the charge falls, and U rises; both are linear in the share of time at a level
            rows = [(each.soc, each.u) for each in self.flown if each.c[0] == c1 and each.completed][::-1]
            if rows and rows[-1][0] >= RESERVE + GAUGE_MARGIN:
                found.append(float(np.interp(RESERVE + GAUGE_MARGIN, *np.array(rows).T)))
        return max(found)

    def before_take_off(self) -> Constant:
        """The constants that the forecast before take-off chooses, the wind known: at most its mean level, flown."""
        (east, north), (scenario, efficiency) = self.mission.wind_mps, owner(self.mission, self.capacity_ah)
        wind = {"speed_mps": math.hypot(east, north), "towards_deg": math.degrees(math.atan2(north, east)) % 360}
        text = Text("mission.yaml", json.dumps({**scenario, "wind": wind}))
        keys = {"vehicle.airframe.propulsive_efficiency": efficiency}
        plan = self.mission.plan_file
        inputs = load_flight(plan, scenario=text.name, overrides=keys, files=Files({text.name: text}))
        found = inputs.preflight()
        assert found is not None
        c1, mean = found.decided[0], found.parameters[self.plan.names[1]]
        self._fly(c1)
        self.flown += self._flown(c1)
        return max((each for each in self._flown(c1) if each.c[1] <= mean + 1e-6), key=lambda each: each.c[1])

    def _fly(self, c1: float) -> None:
        mission, saved = self.mission, self._saved(c1)
        if saved is not None and saved.exists():
            self.flights[c1] = [Sample(*row) for row in json.loads(saved.read_text())]
            return
        flight = plan_flight(mission, self.plan, (c1, float(LEVELS[-1])))
        flight.plane.airspeed_target_mps = self._airspeed_mps
        self.flights[c1] = samples = list(flight.samples())
        if not flight.executor.complete:
            raise SystemExit(f"mission {mission.index}: the plan does not end at c1 = {c1:g}")
        if saved is not None:
            saved.write_text(json.dumps(samples))

    def _saved(self, c1: float) -> Path | None:
        """The file that keeps a flight, named after all that it depends on."""
        if not self._cache:
            return None
        # comments name the folder of the field's outline
        plan = [line for line in Path(self.mission.plan_file).read_text().splitlines() if not line.startswith("% ")]
        sources = [*sorted((ROOT / "benchmarks/twin").rglob("*.xml")), PLANT]
        given = [plan, *(source.read_text() for source in sources), self.mission.wind_mps, self.mission.seed, c1]
        given += [self._airspeed_mps] * (self._airspeed_mps != AIRSPEED_MPS)
        return Path(self._cache) / f"{hashlib.sha256(repr(given).encode()).hexdigest()[:24]}.json"

    def _capacity_ah(self) -> float:
        """The mission's capacity: between those that keep the reserve with the lowest and the highest parameters."""
        tried = np.linspace(0.3, 4.0, 371)
        needs = []
        for c1, level in ((min(self.flights), LEVELS[0]), (max(self.flights), LEVELS[-1])):
            completed, soc = self._drained(tried, self.flights[c1], level)
            needs.append(float(tried[np.argmax(completed & (soc >= RESERVE))]))
        return needs[0] + self.mission.capacity_share * (needs[1] - needs[0])

    def _drained(self, capacity_ah: Any, samples: list[Sample], level: Any) -> tuple[Any, Any]:
        """Whether packs last, and their charge at the end: of a flight, its computations at one level or several."""
        pack = self.mission.lipo(capacity_ah)
        noise = self.mission.noise(len(samples))
        watts = np.interp(level, LEVELS, LEVELS_W)
        for k, sample in enumerate(samples):
            computing_w = watts * noise[k] * (sample.parameters[1] > 0)
            pack.step(battery_w(sample.shaft_w) + computing_w, SAMPLE_S, self.losses.get(k, 0.0))
        return ~np.asarray(pack.empty), pack.soc

    def _flown(self, c1: float) -> list[Constant]:
        """One c1 with every level of the computations."""
        samples, levels = self.flights[c1], np.array(LEVELS)
        completed, soc = self._drained(np.full(len(LEVELS), self.capacity_ah), samples, levels)
        # linear in the computations
        u = np.interp(
            levels, (levels[0], levels[-1]), [constant_quality(self.plan, samples, end) for end in ends(self.plan, 1)]
        )
        return [
            Constant((c1, level), bool(completed[j]), float(soc[j]), float(u[j]), samples[-1].time_s)
            for j, level in enumerate(LEVELS)
        ]


def plan_flight(mission: Mission, plan: Plan, parameters: Sequence[float]) -> PlanFlight:
    """The aeroplane at the start of a mission."""
    start, _ = default_start(plan, tuple(parameters))
    gusts = Dryden(math.hypot(*mission.wind_mps), mission.seed, 3600.0)
    return PlanFlight(plan, parameters, start, mission.wind_mps, gusts)


class Seen:
    """The ground that a flight of the plant has seen: U, from the stages and parameters of its executor."""

    def __init__(self, plan: Plan, executor: PlanExecutor) -> None:
        self._executor, self._started, self._values = executor, executor.stages_started, executor.parameters
        self._log = ParameterLog(plan, executor.cursor, executor.joined_m)

    def update(self, time_s: float) -> None:
        """Record a new stage, or new parameters."""
        executor = self._executor
        started = executor.stages_started != self._started
        if started or executor.parameters != self._values:
            self._started, self._values = executor.stages_started, executor.parameters
            self._log.change(time_s, executor.cursor, executor.joined_m if started else None)

    def quality(self, sample: Sample) -> float:
        """U at the end of a flight, with its last sample."""
        short_of = (sample.x_m, sample.y_m), sample.airspeed_mps
        self._log.close(sample.time_s, None if self._executor.complete else short_of)
        return self._log.quality({}) or 0.0


def constant_quality(plan: Plan, samples: list[Sample], level: float) -> float:
    """U of a flight along the same positions, with its c1 and a constant level of the computations."""
    start, _ = default_start(plan, samples[0].parameters)
    executor = PlanExecutor(PlanCursor.start(plan, (samples[0].parameters[0], level), Rules()), start)
    seen = Seen(plan, executor)
    for sample in samples:
        executor.advance(sample.x_m, sample.y_m)
        seen.update(sample.time_s)
    return seen.quality(samples[-1])


# --- eadp


def owner(mission: Mission, capacity_ah: float) -> tuple[dict[str, Any], float]:
    """The scenario that the owner of the aeroplane writes, and its propulsive efficiency."""
    efficiency = yaml.safe_load(OWNER.read_text())["airframe"]["propulsive_efficiency"] / mission.level_factor
    stated_ah = round(capacity_ah / mission.capacity_factor, 3)
    scenario = {
        "schema": "eadp.scenario/1",
        "vehicle": str(OWNER),
        "profile": str(PROFILE),
        "battery": {"capacity_ah": stated_ah, "resistance_ohm": round(OHM_AH / stated_ah, 4)},
        "reserve_soc": RESERVE,
    }
    return scenario, round(efficiency, 4)


Keys = Mapping[str, str]


class Replan:
    """`eadp replan` as a process, asked line by line."""

    def __init__(self, mission: Mission, capacity_ah: float, folder: Path, keys: Keys) -> None:
        scenario, efficiency = owner(mission, capacity_ah)
        name = f"mission-{mission.index}"
        (folder / f"{name}.yaml").write_text(json.dumps(scenario))
        log, self.messages = folder / f"{name}.jsonl", folder / f"{name}.txt"
        log.unlink(missing_ok=True)
        command = [sys.executable, "-m", "eadp", "replan", mission.plan_file, "--log", str(log)]
        command += ["--scenario", str(folder / f"{name}.yaml")]
        for key, value in {"vehicle.airframe.propulsive_efficiency": efficiency, **keys}.items():
            command += ["--set", f"{key}={value}"]
        self._errors = self.messages.open("wb")
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self._errors, bufsize=0)
        self.unanswered, self._complete = 0, False

    def ask(self, line: dict[str, Any]) -> dict[str, Any] | None:
        """The decision on a line; None where none comes."""
        process = self._process
        if self._complete:
            return None
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write((json.dumps(line) + "\n").encode())
        except BrokenPipeError:
            self.unanswered += 1
            return None
        while select.select([process.stdout], [], [], ANSWER_S)[0]:
            text = process.stdout.readline()
            if not text:
                break
            decision: dict[str, Any] = json.loads(text)
            if decision["time_s"] == line["time_s"]:
                self._complete = decision["reason"] == "final point reached"
                return decision
        self.unanswered += 1
        return None

    def close(self) -> None:
        """End it."""
        self._process.communicate()
        self._errors.close()


@dataclass
class Flown:
    """What came of a flight by `joint`."""

    completed: bool = False
    soc: float = 0.0
    u: float = 0.0
    time_s: float = 0.0
    unanswered: int = 0
    warnings: int = 0
    changes: list[int] = field(default_factory=list)
    decisions: list[dict[str, Any]] = field(default_factory=list)
    last_loss_s: float = 0.0

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """As that of a `Constant`."""
        return self.completed and self.soc >= RESERVE, self.completed, self.u


def fly_joint(constants: Constants, folder: Path, log: TextIO, keys: Keys | None = None) -> Flown:
    """A mission with `eadp replan` on board, with more keys of its scenario."""
    mission, plan = constants.mission, constants.plan
    highest = (ends(plan, 0)[1], ends(plan, 1)[1])
    flight = plan_flight(mission, plan, highest)
    replan = Replan(mission, constants.capacity_ah, folder, keys or {})
    paced = "planner.joint.airspeed" in (keys or {})
    pack, telemetry = mission.lipo(constants.capacity_ah), Telemetry(mission, plan.names, paced=paced)
    noise = mission.noise(round(7200 / SAMPLE_S))
    samples, result, seen = [], Flown(), Seen(plan, flight.executor)
    writer = csv.writer(log)
    writer.writerow(LOG_COLUMNS)
    for k, sample in enumerate(flight.samples()):
        samples.append(sample)
        seen.update(sample.time_s)
        loss = constants.losses.get(k, 0.0)
        watts = np.interp(sample.parameters[1], LEVELS, LEVELS_W) * noise[k] * (sample.parameters[1] > 0)
        power_w = float(battery_w(sample.shaft_w) + watts)
        pack.step(power_w, SAMPLE_S, loss)
        telemetry.gauge(pack, loss)
        if loss:
            result.last_loss_s = sample.time_s
        writer.writerow(log_row(sample, pack, power_w))
        if pack.empty:
            break
        if (k + 1) % PER_LINE == 0:
            line = telemetry.line(sample, power_w, float(pack.voltage_v))
            decision = replan.ask(line)
            if decision is not None:
                result.decisions.append(decision)
                flight.decide(tuple(float(decision["parameters"][name]) for name in plan.names))
                flight.plane.airspeed_target_mps = decision["airspeed_mps"] or AIRSPEED_MPS
    replan.close()
    result.completed, result.soc = flight.executor.complete and not pack.empty, float(pack.soc)
    result.u = seen.quality(samples[-1])
    result.time_s, result.unanswered = samples[-1].time_s, replan.unanswered
    result.warnings = len(replan.messages.read_text().splitlines())
    decided = [[d["parameters"][name] for d in result.decisions] for name in plan.names]
    result.changes = [int(np.count_nonzero(np.diff(values))) for values in decided]
    return result


class Telemetry:
    """What the autopilot measures and sends: noise, and the gauge's steps."""

    def __init__(self, mission: Mission, names: Sequence[str], *, paced: bool = False) -> None:
        self._mission, self._names, self._paced = mission, names, paced
        self._rng, self._volts = (np.random.default_rng(mission.seed + 2 + k) for k in range(2))
        self._scale = 1 + np.random.default_rng(mission.seed + 4).normal(0, 0.02)
        self._soc, self._last_ah = 1.0, 0.0

    def gauge(self, pack: Lipo, loss: float) -> None:
        """Count the charge: by the current, with an error of gain; a loss is seen."""
        consumed = float(pack.consumed_ah)
        self._soc -= (consumed - self._last_ah) / pack.capacity_ah * self._mission.gauge_factor + loss
        self._last_ah = consumed

    def line(self, sample: Sample, power_w: float, voltage_v: float) -> dict[str, Any]:
        """A line of telemetry."""
        rng = self._rng
        line = {
            "time_s": round(sample.time_s, 3),
            "x_m": round(sample.x_m + rng.normal(0, 0.8), 2),
            "y_m": round(sample.y_m + rng.normal(0, 0.8), 2),
            "power_w": round(power_w * (1 + rng.normal(0, 0.01)) + rng.normal(0, 0.5), 2),
            "soc": max(round(self._soc + rng.normal(0, 0.002), 2), 0.01),
            "voltage_v": round(voltage_v + self._volts.normal(0, 0.02), 2),
            "velocity_mps": [round(v + rng.normal(0, 0.1), 2) for v in (sample.east_mps, sample.north_mps)],
            "heading_deg": round(sample.heading_deg + rng.normal(0, 1.5), 1) % 360,
            "parameters": dict(zip(self._names, sample.parameters, strict=True)),
        }
        if self._paced:  # a pitot tube, of 2 % scale and its noise
            line["airspeed_mps"] = round(sample.airspeed_mps * self._scale + rng.normal(0, 0.3), 2)
        return line


# --- logs

LOG_COLUMNS = (
    *("time_s", "x_m", "y_m", "altitude_m", "airspeed_mps", "groundspeed_mps", "heading_deg", "bank_deg", "climb_mps"),
    *("power_w", "voltage_v", "current_a", "current_consumed_ah", "soc", "stage", "c1", "c2"),
)


def log_row(sample: Sample, pack: Lipo, power_w: float) -> list[float]:
    """A row of a telemetry log, without noise."""
    motion = [*sample[:5], math.hypot(sample.east_mps, sample.north_mps), *sample[7:10]]
    electric = [power_w, pack.voltage_v, pack.current_a, pack.consumed_ah, pack.soc]
    return [round(float(value), 4) for value in (*motion, *electric, sample.stage, *sample.parameters)]


def write_identification(file: Path) -> None:
    """Log a flight for the identification of the aeroplane: airspeeds, banks and climbs in wind and gusts."""
    plane = Aeroplane((0.0, 0.0), 0.0, (3.0, 0.0), Dryden(3.0, 1, 3600.0))
    pack, shaft_w = Lipo(3.0, OHM_AH / 3.0), 0.0
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(LOG_COLUMNS)
        for speed in (12.0, 13.5, 15.0, 17.0, 19.0):
            plane.airspeed_target_mps = speed
            for bank_deg, climb_m, seconds in (
                (0, 0, 60),
                (20, 0, 30),
                (0, 0, 20),
                (40, 0, 30),
                (0, 40, 40),
                (0, -40, 40),
            ):
                plane.altitude_target_m += climb_m
                for k in range(round(seconds / CONTROL_S)):
                    plane.control(math.radians(bank_deg))
                    shaft_w += plane.shaft_w / round(SAMPLE_S / CONTROL_S)
                    if (k + 1) % round(SAMPLE_S / CONTROL_S) == 0:
                        power_w = float(battery_w(shaft_w))
                        pack.step(power_w, SAMPLE_S)
                        writer.writerow(log_row(sampled(plane, shaft_w), pack, power_w))
                        shaft_w = 0.0


# --- one mission

SLOWER_MPS = 13.0, 11.5, 10.5
PACED = {
    "planner.joint.airspeed": "when-short",
    "vehicle.airframe.airspeed_range_mps": f"[{SLOWER_MPS[-1]}, {AIRSPEED_MPS:g}]",
}


def run(task: tuple[Mission, str, str | None]) -> dict[str, Any]:
    """A mission with constant parameters and with `joint`."""
    mission, folder, cache = task
    constants = Constants(mission, cache)
    before = constants.before_take_off()
    joint, _ = timed_joint(constants, folder)
    return {**described(constants), "before": before, "clairvoyant": constants.clairvoyant, "joint": joint}


def described(constants: Constants) -> dict[str, Any]:
    """A mission, and its flights with constant parameters."""
    lowest, highest = (pick(constants.flown, key=lambda constant: constant.c) for pick in (min, max))
    return {
        "mission": constants.mission,
        "capacity_ah": constants.capacity_ah,
        "losses": {round(k * SAMPLE_S): drop for k, drop in constants.losses.items()},
        "lowest": lowest,
        "highest": highest,
        "best": constants.best,
    }


def timed_joint(constants: Constants, folder: str, keys: Keys | None = None) -> tuple[Flown, float]:
    """A flight by `joint`, as `fly_joint`, and the CPU seconds of `eadp replan`."""
    before_s = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    with (Path(folder) / f"mission-{constants.mission.index}.csv").open("w", newline="") as stream:
        joint = fly_joint(constants, Path(folder), stream, keys)
    return joint, resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before_s


def paced(task: tuple[Mission, str, str | None]) -> dict[str, Any]:
    """A mission by `joint` at one airspeed, and with the airspeed decided; and a clairvoyant's U at each airspeed."""
    mission, folder, cache = task
    constants = Constants(mission, cache)
    slower = [Constants(mission, cache, constants, speed) for speed in SLOWER_MPS]
    flights = {name: timed_joint(constants, folder, keys) for name, keys in (("fixed", {}), ("joint", PACED))}
    return {
        **described(constants),
        "clairvoyant": [each.clairvoyant for each in (constants, *slower)],
        "cpu_s": {name: cpu_s for name, (_, cpu_s) in flights.items()},
        **{name: flown for name, (flown, _) in flights.items()},
    }


def forecasts(joint: Flown) -> Iterator[dict[str, float]]:
    """Errors of the decisions' forecasts of a completed flight, from 10 % of it on.

    `known` is 1 after the last loss of charge, and 2 where the parameters do not change any more; `path` is whether
    lines of the spacing flown then are flown to the end.
    """
    final = joint.decisions[-1]["parameters"] if joint.decisions else {}
    changes_s = [decision["time_s"] for decision in joint.decisions if decision["parameters"] != final]
    changed_s = max([joint.last_loss_s, *changes_s])
    wider_s = max((each["time_s"] for each in joint.decisions if each["parameters"]["c1"] != final["c1"]), default=-1.0)
    for decision in joint.decisions:
        part = decision["time_s"] / joint.time_s
        if part < 0.1 or decision["remaining_s"] is None or decision["soc_end_forecast"] is None:
            continue
        error = decision["soc_end_forecast"] - joint.soc
        yield {
            "part": part,
            "known": (decision["time_s"] > joint.last_loss_s) + (decision["time_s"] > changed_s),
            "path": decision["time_s"] > wider_s,
            "time": (decision["time_s"] + decision["remaining_s"]) / joint.time_s - 1,
            "charge": error,
            "z": math.nan if decision["soc_end_std"] is None else error / max(decision["soc_end_std"], 1e-9),
        }


def draw(mission: Mission, losses: Mapping[int, float], folder: Path) -> None:
    """Draw charge, airspeed and spacing of a flight by the log of `eadp replan` in a folder."""
    texts = (folder / f"mission-{mission.index}.jsonl").read_text().splitlines()
    rows = [json.loads(text) for text in texts]
    measured = [row for row in rows if row["kind"] == "telemetry"]
    decided = [row for row in rows if row["kind"] == "decision" and row["time_s"] > 5]
    measured_s = [row["time_s"] for row in measured]
    at_s, spacing = [row["time_s"] for row in decided], read_plan(mission.plan_file, warn=lambda _: None).parameters[0]
    end, std = (np.array([row[key] for row in decided]) for key in ("soc_end_forecast", "soc_end_std"))
    with figure_pair(PICTURE, 8.0, 6.0, (".png",)) as figure:
        charge, airspeed, lines = figure.subplots(3, 1, sharex=True)
        charge.plot(measured_s, [100 * row["soc"] for row in measured], label="charge")
        charge.plot(at_s, 100 * end, COLOURS[1], label="forecast of the end, ± 2 σ")
        charge.fill_between(at_s, 100 * (end - 2 * std), 100 * (end + 2 * std), color=COLOURS[1], alpha=0.2, lw=0)
        charge.axhline(100 * RESERVE, color=GREY, ls="--", label="reserve")
        airspeed.plot(measured_s, [row["airspeed_mps"] for row in measured], GREY, lw=0.8, label="measured")
        airspeed.step(at_s, [row["airspeed_mps"] for row in decided], where="post", label="commanded")
        lines.step(at_s, [spacing.shown(row["parameters"][spacing.name]) for row in decided], where="post")
        for axes, label in ((charge, "charge [%]"), (airspeed, "airspeed [m/s]"), (lines, "spacing [m]")):
            axes.set_ylabel(label)
            for lost_s in losses:
                axes.axvline(lost_s, color=COLOURS[6], ls=":")
        legend_above(charge, 3)
        legend_above(airspeed)
        lines.set_xlabel("time [s]; dotted: losses of " + ", ".join(f"{100 * lost:.0f} %" for lost in losses.values()))


# --- tables


def row(result: dict[str, Any]) -> str:
    """A mission's line; D: not completed though the lowest parameters complete, u: behind the best constants."""
    mission, best, joint = result["mission"], result["best"], result["joint"]
    losses = " ".join(f"{100 * drop:.0f}%@{at}" for at, drop in result["losses"].items()) or "-"
    marks = ("D" if result["lowest"].completed and not joint.completed else "") + ("u" if behind(result) else "")
    return line(
        *(mission.index, mission.place, f"{math.hypot(*mission.wind_mps):.1f} m/s"),
        *(f"{result['capacity_ah']:.3f} Ah", losses, f"best {best.c[0]:.0f}, {best.c[1]:.0f}: {best.soc:.3f}"),
        *(f"U {best.u:.3f}", f"joint {joint.soc:.3f}", f"U {joint.u:.3f}", f"{joint.time_s:.0f} s", marks),
    )


def value(result: dict[str, Any]) -> float:
    """U of `joint`, 0 where it does not complete."""
    return result["joint"].u if result["joint"].completed else 0.0


def behind(result: dict[str, Any]) -> bool:
    """Whether `joint` is neither at 0.95 of the best constants nor within 0.03 of them."""
    best = result["best"]
    return best.completed and value(result) < min(0.95 * best.u, best.u - 0.03)


def report(results: list[dict[str, Any]]) -> None:
    """The measures of all missions."""
    done = [r for r in results if r["joint"].completed]
    lowest = [r for r in results if r["lowest"].completed]
    kept = [r for r in lowest if r["lowest"].rank[0]]
    print(f"completes where the lowest parameters do: {sum(r['joint'].completed for r in lowest)} of {len(lowest)}")
    print(f"keeps the reserve where they do: {sum(r['joint'].soc >= RESERVE for r in kept)} of {len(kept)}")
    ratios = [value(r) / r["best"].u for r in results if r["best"].completed and r["best"].u > 0]
    if ratios:
        print(f"U over best constants: mean {statistics.fmean(ratios):.3f} (aim 1.03), least {min(ratios):.3f}")
        means = [statistics.fmean(values) for values in ((value(r) for r in results), (r["best"].u for r in results))]
        print(f"mean U: {means[0]:.3f}, best constants {means[1]:.3f}")
    us = {who: statistics.fmean(r[who].u * r[who].rank[0] for r in kept) for who in ("before", "joint")}
    bound = statistics.fmean(r["clairvoyant"] for r in kept)
    print(f"U, 0 without the reserve: before take-off {us['before']:.3f}, a clairvoyant {bound:.3f}")
    if bound > us["before"]:
        share_gained = (us["joint"] - us["before"]) / (bound - us["before"])
        print(f"of what re-planning can gain, {share_gained:.0%} is gained, in {len(kept)} missions")
    print(f"below 0.95 of them and more than 0.03 behind: {sum(map(behind, results))} missions")
    left = [r["joint"].soc - RESERVE for r in done if not r["highest"].rank[0]]
    if left:
        print(f"charge above the reserve where it binds: median {statistics.median(left):.3f} (aim 0.04)")
    print(f"lines without an answer: {sum(r['joint'].unanswered for r in results)}")
    lost = [any("cell-lost" in each["warnings"] for each in r["joint"].decisions) for r in results]
    print(f"missions with a loss by the voltage alone, of which there is none: {sum(lost)}")
    few = [sum(most <= 6 for most in r["joint"].changes) == 2 for r in results]
    print(f"missions with at most 6 changes of each parameter: {sum(few)} of {len(few)} (aim 95 %)")
    table(FORECASTS, report_forecasts(done))


def report_paced(results: list[dict[str, Any]]) -> None:
    """The airspeed decided, beside one airspeed and the bound."""
    lowest = [r for r in results if r["lowest"].rank[0]]
    enough = [r for r in results if r["highest"].rank[0]]
    bounds = [statistics.fmean(column) for column in zip(*(r["clairvoyant"] for r in results), strict=True)]
    bound = statistics.fmean(max(r["clairvoyant"]) for r in results)
    rows = []
    for name, title in (("fixed", f"{AIRSPEED_MPS:g} m/s"), ("joint", f"{SLOWER_MPS[-1]:g} to {AIRSPEED_MPS:g} m/s")):
        flown = [r[name] for r in results]
        mean = statistics.fmean(each.u * each.completed for each in flown)
        limit = bounds[0] if name == "fixed" else bound
        # near the end the deviation is that of the gauge's last step
        errors = [
            [e for e in forecasts(each) if abs(e["z"]) >= 0 and e["part"] < 0.9] for each in flown if each.completed
        ]
        z, settled = (
            [values for each in errors if (values := [e["z"] for e in each if e["path"] >= path])] for path in (0, 1)
        )
        rows.append(
            [
                *(title, f"{mean:.3f}", f"{limit:.3f}", f"{mean / limit:.2f}"),
                f"{sum(r[name].completed for r in lowest)} of {len(lowest)}",
                f"{sum(r[name].rank[0] for r in lowest)} of {len(lowest)}",
                f"{statistics.fmean(each.time_s for each in flown):.0f}",
                *(cell for each in (z, settled) for cell in spread(each)),
                f"{statistics.fmean(r['cpu_s'][name] for r in results):.1f}",
                f"{statistics.fmean(1e3 * r['cpu_s'][name] / r[name].time_s for r in results):.1f}",
            ]
        )
    table(PACED_COLUMNS, rows)
    speeds = ", ".join(f"{at:g} m/s {u:.3f}" for at, u in zip((AIRSPEED_MPS, *SLOWER_MPS), bounds, strict=True))
    print(f"U of the clairvoyant at one airspeed: {speeds}; at the best of these in each mission {bound:.3f}")
    longer = [r["joint"].time_s / r["fixed"].time_s - 1 for r in enough]
    if longer:
        mean = f"{statistics.fmean(longer):+.1%} of the time, n = {len(longer)}"
        print(f"where the battery suffices for the highest parameters: {mean}")


def spread(z: list[list[float]]) -> tuple[str, str]:
    """Root mean square of z, and the share within 2 σ: each flight has the same weight."""
    inside = statistics.fmean(statistics.fmean(abs(v) <= 2 for v in values) for values in z)
    return f"{rms(rms(values) for values in z):.2f}", f"{inside:.3f}"


PACED_COLUMNS = (
    *("airspeed", "U, all", "of a clairvoyant", "ratio", "completed of those that can be", "reserves kept of these"),
    *(
        "mean time [s]",
        "charge at the end, from 10 to 90 % of a flight: z, rms",
        "within 2 σ",
        "since the last change of the path: z, rms",
        "within 2 σ then",
        "CPU of `eadp replan` [s]",
        "a second of flight [ms]",
    ),
)


FORECASTS = (
    *("forecasts from 10 % of the flight on", "time at the end [%]: bias (aim 2)", "rms"),
    *("charge [% of full]: bias (aim 2)", "rms", "within 2 σ (aim 0.90 to 0.99)"),
)


def report_forecasts(done: list[dict[str, Any]]) -> Iterator[list[str]]:
    """Bias and spread of the forecasts, each flight with the same weight."""
    titles = "all", "after the last loss of charge", "after the last change of parameters"
    for since, title in enumerate(titles):
        flights = [[e for e in forecasts(r["joint"]) if e["known"] >= since] for r in done]
        flights = [errors for errors in flights if errors]
        if not flights:
            continue
        cells = [title]
        for key in ("time", "charge"):
            cells.append(
                f"{100 * statistics.fmean(statistics.fmean(e[key] for e in errors) for errors in flights):+.2f}"
            )
            cells.append(f"{100 * rms(rms(e[key] for e in errors) for errors in flights):.2f}")
        z = [[e["z"] for e in errors if not math.isnan(e["z"])] for errors in flights]
        inside = [statistics.fmean(abs(v) <= 2 for v in values) for values in z if values]
        yield [*cells, f"{statistics.fmean(inside):.3f}" if inside else ""]


def main() -> None:
    """Fly, and print the tables."""
    parser = options(__doc__, "twin, with --paced twin_paced, of another seed with _SEED")
    parser.add_argument("--missions", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="+", metavar="INDEX")
    parser.add_argument("--log", metavar="DIR")
    parser.add_argument("--cache", metavar="DIR")
    parser.add_argument("--paced", action="store_true")
    parser.add_argument("--draw", type=int, metavar="INDEX")
    asked = parser.parse_args()
    page = "twin_paced" if asked.paced else "twin"
    with recorded(page + (f"_{asked.seed}" if asked.seed else ""), write=asked.write):
        fly_all(asked)


def fly_all(asked: argparse.Namespace) -> None:
    """Fly the missions, and print the tables."""
    for made_folder in filter(None, (asked.log, asked.cache)):
        Path(made_folder).mkdir(parents=True, exist_ok=True)
    if asked.log:
        write_identification(Path(asked.log) / "identification.csv")
    with tempfile.TemporaryDirectory() as passing:
        folder = asked.log or passing
        made = missions(asked.missions, asked.seed, plans(Path(folder)))
        tasks = [(m, folder, asked.cache) for m in made if not asked.only or m.index in asked.only]
        results = []
        with multiprocessing.Pool(asked.jobs) as pool, contextlib.suppress(KeyboardInterrupt):
            for result in pool.imap(paced if asked.paced else run, tasks):
                results.append(result)
                print(row(result), file=sys.stderr, flush=True)
                if result["mission"].index == asked.draw:
                    draw(result["mission"], result["losses"], Path(folder))
    print(f"seed {asked.seed}, {len(results)} missions; U is 0 where a mission is not completed")
    (report_paced if asked.paced else report)(results)


if __name__ == "__main__":
    main()
