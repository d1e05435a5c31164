"""How much of a mission each planner keeps, beside the best constant parameters in hindsight.

Random missions: wind of 0 to 8 m/s from anywhere, gusts, a battery of 0.5 to 1.3 times what the highest parameters
need, sudden, unannounced losses of charge, parameters at take-off anywhere. Flown on the survey and on three
covered fields, with the vehicles `paper` and `fixed-wing`, by

- `highest`, `lowest`: constant parameters;
- `paper`: the letter's algorithm, its remaining time corrected;
- `lap budget`: a simple rule, described below;
- `joint`; and with its airspeed decided, from 10 to 15 m/s, where the vehicle is `fixed-wing`;
- `before take-off`: the constants that its own forecast chooses before take-off, flown to the end;
- a clairvoyant: the best path of the grid below with computations mixed in time, so that just the reserve is left;
- `hindsight`: the best constant parameters of a grid, each flown, with wind and losses known beforehand. It
  keeps the reserve where any constant parameters do, and else completes where any do.

    python benchmarks/quality.py [--missions 200] [--seed 1] [--jobs 2] [--ablate] [--write]

`--ablate` flies the variants of `ablation.py` instead.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import multiprocessing
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ablation import AS_IT_IS, VARIANTS, ablated, compare, plans_of_several, value
from measured import covered, options, recorded, table

from eadp.api.inputs import FlightInputs, load_flight
from eadp.core.compiled import enable
from eadp.models.plan.ground import lap_scale
from eadp.models.plan.route import MARGIN_M, RoutePredictor
from eadp.planning.base import Decision, Observation
from eadp.planning.registry import Planner
from eadp.planning.state.flight_state import FlightState
from eadp.simulation.loop import Outcome, fly
from eadp.simulation.metrics import ParameterLog

enable()
ROOT = Path(__file__).resolve().parents[1]
PROFILE = str(ROOT / "profiles/pednet-jetson-nano.yaml")
STEP_S, LONGEST_S = 0.05, 20_000.0
SAMPLE_S = 0.5
"""Of the power of a flight whose battery is drained afterwards."""
GRID = 21
"""Places of c1 that hindsight looks at, with every level of c2, and that the lap budget chooses from."""
RESERVE = 0.05
FIELDS: Mapping[str, list[list[float]]] = {
    "oblong": [[0, 0], [620, 60], [600, 420], [-20, 360]],
    "slanted": [[0, 0], [500, 120], [560, 560], [120, 480]],
    "corner": [[0, 0], [700, 0], [700, 300], [350, 300], [350, 520], [0, 520]],
}


@dataclass(frozen=True)
class Case:
    """One mission: its plan, and the scenario's keys."""

    index: int
    place: str
    vehicle: str
    keys: Mapping[str, Any]


def plans(folder: Path) -> dict[str, str]:
    """The survey, and plans that cover the fields, with c1 and the computations free."""
    return {"survey": str(ROOT / "plans/survey.plan")} | covered(folder, FIELDS, PROFILE, 30)


def load(plan: str, keys: Mapping[str, Any], **more: Any) -> FlightInputs:
    """A flight of a plan."""
    overrides = {
        "step_s": STEP_S,
        "log_every_s": LONGEST_S,  # no rows: only the outcome counts
        "time_limit_s": LONGEST_S,
        **keys,
        **more,
    }
    return load_flight(plan, profile=PROFILE, overrides=overrides)


def cases(count: int, seed: int, found: Mapping[str, str]) -> list[Case]:
    """Random missions; capacities are shares of what the highest parameters need in that wind."""
    rng = np.random.default_rng(seed)
    made = []
    for index, (place, vehicle) in enumerate(
        itertools.islice(itertools.cycle(itertools.product(found, ("paper", "fixed-wing"))), count)
    ):
        keys: dict[str, Any] = {
            "vehicle.airframe.model": vehicle,
            "guidance.k_d": 1.0,
            "wind.speed_mps": float(rng.uniform(0, 8)),
            "wind.towards_deg": float(rng.uniform(0, 360)),
            "wind.gust_std_mps": float(rng.uniform(0, 1.5)),
            "seed": int(rng.integers(1 << 30)),
        }
        share, drops = float(rng.uniform(0.5, 1.3)), int(rng.integers(0, 4))
        whens, sizes = rng.uniform(0, 1, drops), rng.uniform(0.02, 0.12, drops)
        highest = flown(load(found[place], {**keys, "battery.capacity_ah": 50.0}, **{"planner.name": "static"}))
        need_ah = (1 - highest["soc"]) * 50.0 / (1 - RESERVE)
        duration = highest["time_s"]
        keys["battery.capacity_ah"] = share * need_ah
        keys["faults"] = [
            {"at_s": float(when * duration), "soc_drop": float(size)}
            for when, size in sorted(zip(whens, sizes, strict=True))
        ]
        plan = load(found[place], keys).mission.plan
        boxes = [plan.hull(i) for i in range(len(plan.names))]
        starts = [
            box.lo + share * (box.hi - box.lo) for box, share in zip(boxes, rng.uniform(0, 1, len(boxes)), strict=True)
        ]
        starts[plan.path_count :] = [float(round(start)) for start in starts[plan.path_count :]]
        keys["parameters"] = dict(zip(plan.names, starts, strict=True))
        made.append(Case(index, place, vehicle, keys))
    return made


def flown(inputs: FlightInputs, planner: Planner | None = None) -> dict[str, Any]:
    """Fly, and tell what came of it."""
    flight, outcome = inputs.flight(), Outcome()
    flight.planner = planner or flight.planner
    started = time.process_time()
    for _ in fly(inputs.world, flight, outcome):
        pass
    log = outcome.parameters
    assert log is not None
    quality = log.quality(inputs.scenario.planner.weights)
    changes = sum(len(record.history) for record in log.records)
    return {
        "completed": outcome.completed,
        "kept": outcome.completed and outcome.soc_final >= RESERVE,
        "u": quality,
        "soc": outcome.soc_final,
        "time_s": outcome.duration_s,
        "changes": changes,
        "cpu_s": time.process_time() - started,
        "failures": flight.planner.report.failed,
        "replans": flight.planner.report.replans,
    }


# --- hindsight --------------------------------------------------------------------------------------------------------


def hindsight(plan: str, case: Case) -> dict[str, Any]:
    """The best constant parameters of a grid: one flight for each c1, its power taken with every c2.

    Neither path nor motion power depend on the computations, so that the charge of every c2 follows from one flight.
    """
    base = {**case.keys, "planner.name": "static", "faults": [], "battery.capacity_ah": 1000.0, "log_every_s": SAMPLE_S}
    inputs = load(plan, base)
    box, levels_box = inputs.mission.plan.hull(0), inputs.mission.plan.hull(1)
    levels = inputs.mission.computing.levels(0, levels_box)
    battery = load(plan, case.keys).world.mission.battery
    best: dict[str, Any] = {"kept": False, "completed": False, "u": 0.0, "c": None}
    clairvoyant = 0.0
    for c1 in np.linspace(box.lo, box.hi, GRID):
        inputs = load(plan, {**base, "parameters": {"c1": float(c1), "c2": float(levels[0])}})
        outcome = Outcome()
        power, stages = [], []
        for step in fly(inputs.world, inputs.flight(), outcome):
            power.append(step.power_w)
            stages.append(step.stage)
        if not outcome.completed:
            continue
        sets = inputs.mission.plan.stages
        runs = np.array([not stage.sets[1].fixed for stage in sets])[np.array(stages) - 1]
        motion = np.array(power)
        log = outcome.parameters
        assert log is not None
        rates = ground_rates(log, len(power))
        # with the lowest computations, and what the highest add where they run
        lowest_u, added_u = log.quality({}) or 0.0, float((rates * runs).sum() / rates.sum()) / 2
        mixes = []
        for c2 in levels:
            more = inputs.mission.computing.power_w((c1, c2), _free(sets)) - inputs.mission.computing.power_w(
                (c1, levels[0]), _free(sets)
            )
            end, lowest = _charged(battery, motion + more * runs, case.keys["faults"])
            completed, kept = lowest > 0, lowest > 0 and end >= RESERVE
            u = lowest_u + added_u * (levels_box.share(c2) or 0.0)
            if (kept, completed, u) > (best["kept"], best["completed"], best["u"]) and completed:
                best = {"kept": kept, "completed": completed, "u": u, "c": (float(c1), c2), "soc": end}
            if kept:
                mixes.append((end, u))
            elif mixes:  # charge and U are linear in the share of time at this level
                mixes.append((end, u))
                break
        if mixes:
            clairvoyant = max(clairvoyant, float(np.interp(RESERVE, *np.array(mixes[::-1]).T)))
    # where none keeps the reserve it does not bind
    return best | {"clairvoyant": clairvoyant or best["u"]}


def constants_before(plan: str, case: Case) -> dict[str, Any]:
    """The constants that the forecast before take-off chooses, at most its mean level of the computations, flown."""
    inputs = load(plan, case.keys, **{"planner.name": "joint"})
    found, names = inputs.preflight(), inputs.mission.plan.names
    assert found is not None
    levels = inputs.mission.computing.levels(0, inputs.mission.plan.hull(1))
    level = max(each for each in (levels[0], *levels) if each <= max(found.parameters[names[1]], levels[0]) + 1e-6)
    keys = {**case.keys, "parameters": dict(zip(names, (found.decided[0], level), strict=True))}
    return flown(load(plan, keys, **{"planner.name": "static"}))


def ground_rates(log: ParameterLog, steps: int) -> Any:
    """Ground per second that a flight stands for, at each step: that of a lap is shared by time.

    Source: `eadp.models.plan.ground`.
    """
    predictor, runs = RoutePredictor(), []
    for time_s, cursor, joined_m in log._events:
        if joined_m is not None:
            if not runs or runs[-1][2] != (cursor.segment, cursor.lap):
                runs.append((time_s, 0.0, (cursor.segment, cursor.lap), cursor))
            start_s, length_m, lap, _ = runs[-1]
            runs[-1] = start_s, length_m + predictor.leg(cursor, joined_m).legs[0].length_m, lap, cursor
    rates, ends = np.zeros(steps), [*(round(run[0] / SAMPLE_S) for run in runs[1:]), steps]
    for (start_s, length_m, _, cursor), end in zip(runs, ends, strict=True):
        start = round(start_s / SAMPLE_S)
        rates[start:end] = lap_scale(cursor) * length_m / max(end - start, 1)
    return rates


def _free(stages: Any) -> Any:
    return next(stage.sets for stage in stages if not stage.sets[1].fixed)


def _charged(battery: Any, power: Any, faults: Any) -> tuple[float, float]:
    """State of charge at the end and its lowest on the way, of a power sampled at every row."""
    soc = battery.soc - np.cumsum(battery.drain_per_s(power, battery.voltage_v)) * SAMPLE_S
    times = np.arange(1, len(power) + 1) * SAMPLE_S
    for fault in faults:
        soc = soc - fault["soc_drop"] * (times >= fault["at_s"] - 1e-9)
    return float(soc[-1]), float(soc.min())


# --- the plain rule ---------------------------------------------------------------------------------------------------


class LapBudget(Planner):
    """At each new lap: what a metre has cost so far, times what is left of the plan, against the charge that is left.

    Takes the highest c1 that fits with the computations at their highest; at the lowest c1, the highest that fits.
    """

    next_update_s = 0.0

    def __init__(self, inputs: FlightInputs) -> None:
        super().__init__(inputs.scenario.planner, inputs.mission)
        self._predictor = RoutePredictor()
        self._energy_j = self._metres = 0.0
        self._last: Observation | None = None
        self._lap = -1

    def update(self, state: FlightState) -> Decision:
        """Take an observation; at a new lap, decide."""
        o = state.now
        if self._last is not None:
            step_s = o.time_s - self._last.time_s
            self._metres += math.dist(o.position_m, self._last.position_m)
            assert o.sample.power_w is not None
            sets = o.cursor.stage.sets
            self._energy_j += (o.sample.power_w - self.mission.computing.power_w(o.parameters, sets)) * step_s
        self._last = o
        if o.cursor.lap != self._lap and self._metres > 100:
            self._lap = o.cursor.lap
            chosen = self._chosen(o)
            self._decision = self._decision._replace(parameters=chosen)
        return self._decision

    def _chosen(self, o: Observation) -> tuple[float, ...]:
        plan, computing, battery = self.mission.plan, self.mission.computing, self.mission.battery
        box, levels_box = plan.hull(0), plan.hull(1)
        levels = computing.levels(0, levels_box)
        motion_w = self._energy_j / o.time_s
        speed = self._metres / o.time_s
        for c1, c2 in [
            *((float(c1), levels[-1]) for c1 in np.linspace(box.hi, box.lo, GRID)),
            *((box.lo, level) for level in reversed(levels)),
        ]:
            try:
                route = self._predictor.route(o.cursor.decide((c1, c2)), o.joined_m, MARGIN_M)
            except Exception:
                continue
            seconds = sum(leg.distance_m for leg in route.legs) / speed
            power = motion_w + computing.power_w((c1, c2), _free(plan.stages))
            if o.soc - battery.drain_per_s(power, battery.voltage_v) * seconds >= self.settings.reserve_soc:
                return c1, c2
        return box.lo, levels[0]


class Lowest(Planner):
    """The planner of a flight until a time, then the lowest parameters: whether it could still be completed."""

    next_update_s = 0.0

    def __init__(self, inputs: FlightInputs, from_s: float) -> None:
        super().__init__(inputs.scenario.planner, inputs.mission)
        self._inner, self._from_s = inputs.flight().planner, from_s
        plan = inputs.mission.plan
        self._lowest = Decision(tuple(plan.hull(i).lo for i in range(len(plan.parameters))))

    def update(self, state: FlightState) -> Decision:
        """The planner's decision, or the lowest."""
        return self._lowest if state.now.time_s >= self._from_s - 1e-9 else self._inner.update(state)


def could(plan: str, case: Case, name: str) -> bool:
    """Whether, at take-off and at each loss, the lowest parameters from there on still finish, as this planner flew."""
    for at_s in [0.0, *(fault["at_s"] for fault in case.keys["faults"])]:
        inputs = load(plan, case.keys, **{"planner.name": name})
        if not flown(inputs, Lowest(inputs, at_s))["completed"]:
            return False
    return True


def run(task: tuple[dict[str, str], Case]) -> dict[str, Any]:
    """One mission by every planner."""
    found, case = task
    plan = found[case.place]
    result: dict[str, Any] = {"index": case.index, "place": case.place, "vehicle": case.vehicle, "keys": case.keys}
    probe = load(plan, case.keys).mission.plan
    ends = {
        "highest": {"c1": probe.hull(0).hi, "c2": probe.hull(1).hi},
        "lowest": {"c1": probe.hull(0).lo, "c2": probe.hull(1).lo},
    }
    for name, parameters in ends.items():
        result[name] = flown(load(plan, {**case.keys, "parameters": parameters}, **{"planner.name": "static"}))
    for name in ("paper", "joint"):
        result[name] = flown(load(plan, case.keys, **{"planner.name": name}))
    result[PACED] = result["joint"]
    if case.vehicle == "fixed-wing":
        result[PACED] = flown(load(plan, case.keys, **{"planner.name": "joint", RANGE: [10.0, 15.0]}))
    inputs = load(plan, case.keys, **{"planner.name": "static"})
    result["lap budget"] = flown(inputs, LapBudget(inputs))
    result["before take-off"] = constants_before(plan, case)
    result["hindsight"] = hindsight(plan, case)
    if not result["joint"]["completed"]:
        result["could"] = could(plan, case, "joint")
    return result


PACED, RANGE = "joint, 10 to 15 m/s", "vehicle.airframe.airspeed_range_mps"
NAMES = ("highest", "lowest", "paper", "lap budget", "before take-off", "joint", PACED, "hindsight")
TITLES = ("completed", "reserve kept", "U, mean", "U, worst", "changes", "CPU [s]", "U, all")


def row(name: str, flights: list[dict[str, Any]]) -> list[object]:
    """What came of a planner's flights: U of those completed, and in the last column the others as 0."""
    us = [flight["u"] for flight in flights if flight["completed"]]
    changes = statistics.mean([flight.get("changes", 0) for flight in flights])
    cpu = statistics.median([flight.get("cpu_s", 0.0) for flight in flights])
    figures = f"{statistics.mean(us) if us else 0:.3f}", f"{min(us, default=0):.3f}", f"{changes:.1f}", f"{cpu:.2f}"
    counts = (sum(flight[key] for flight in flights) for key in ("completed", "kept"))
    return [name, *counts, *figures, f"{statistics.mean(map(value, flights)):.3f}"]


def verdict(results: list[dict[str, Any]]) -> Iterator[str]:
    """Joint beside the reference and the rules; a flight that does not complete counts as U = 0."""

    def u(r: dict[str, Any], name: str) -> float:
        return value(r[name])

    lost = [r["index"] for r in results if not r["joint"]["completed"] and r.get("could")]
    yield f"not completed though it could have been: {len(lost)} {lost or ''}"
    done = [r for r in results if r["hindsight"]["completed"]]
    could_be = [r for r in done if r["joint"]["completed"] or r.get("could")]
    for rows, which in ((done, "all"), (could_be, "that could be completed at every loss of charge")):
        ratio = [u(r, "joint") / u(r, "hindsight") if u(r, "hindsight") else 1.0 for r in rows]
        total = sum(u(r, "joint") for r in rows) / sum(u(r, "hindsight") for r in rows)
        yield f"U of joint over hindsight, {which}: mean of ratios {statistics.mean(ratio):.3f}, of means {total:.3f}"
    limits = ((r, min(0.93 * u(r, "hindsight"), u(r, "hindsight") - 0.03)) for r in done)
    shortfall = [r for r, limit in limits if u(r, "joint") < limit]
    hopeless = sum(r not in could_be for r in shortfall)
    yield f"below 0.93 of hindsight and by more than 0.03: {len(shortfall)}, of these {hopeless} not to be completed"


def gained(results: list[dict[str, Any]]) -> None:
    """What re-planning gains of what it can, where hindsight keeps the reserve: U, 0 without the reserve."""
    kept = [r for r in results if r["hindsight"]["kept"]]
    before, ours = (
        statistics.mean(r[name]["u"] * r[name]["kept"] for r in kept) for name in ("before take-off", "joint")
    )
    bound = statistics.mean(r["hindsight"]["clairvoyant"] for r in kept)
    share = f"{(ours - before) / (bound - before):.2f}" if bound > before else ""
    title = f"{len(kept)} missions whose reserve hindsight keeps"
    figures = f"{before:.3f}", f"{ours:.3f}", f"{bound:.3f}", share
    table((title, "before take-off", "joint", "clairvoyant", "share gained"), [("U, 0 without the reserve", *figures)])


def main() -> None:
    """Run and print."""
    parser = options(__doc__, "quality or ablation, of another seed than 1 with it")
    parser.add_argument("--missions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", help="indices of missions")
    parser.add_argument("--out", help="JSON lines, one mission each")
    parser.add_argument("--ablate", action="store_true", help="fly variants of joint that leave a concept out")
    asked = parser.parse_args()
    page = "ablation" if asked.ablate else "quality"
    with recorded(page if asked.seed == 1 else f"{page}_{asked.seed}", write=asked.write):
        fly_all(asked)


def fly_all(asked: argparse.Namespace) -> None:
    """Fly the missions, and print the tables."""
    results = []
    with tempfile.TemporaryDirectory() as folder:
        found = plans(Path(folder)) | (plans_of_several(Path(folder)) if asked.ablate else {})
        missions = cases(asked.missions, asked.seed, found)
        tasks = [(found, missions[i]) for i in (asked.only or range(len(missions)))]
        with multiprocessing.get_context("spawn").Pool(asked.jobs) as pool:
            for result in pool.imap_unordered(_ablated if asked.ablate else run, tasks):
                results.append(result)
                print(f"{len(results)} of {len(tasks)}", file=sys.stderr)
                if asked.out:
                    with open(asked.out, "a") as file:
                        file.write(json.dumps(result) + "\n")
    print(f"seed {asked.seed}, {len(results)} missions; U, all, is 0 where a mission is not completed")
    if asked.ablate:
        compare("planner `joint`", VARIANTS, AS_IT_IS, results)
    else:
        table(("all", *TITLES), (row(name, [r[name] for r in results]) for name in NAMES))
        own = [r for r in results if r["vehicle"] == "fixed-wing"]
        table((f"{len(own)} of fixed-wing", *TITLES), (row(name, [r[name] for r in own]) for name in NAMES[-4:]))
        print("\n".join(verdict(results)))
        gained(results)


def _ablated(task: tuple[dict[str, str], Case]) -> dict[str, dict[str, Any]]:
    found, case = task
    return ablated(lambda keys: flown(load(found[case.place], {**case.keys, "planner.name": "joint", **keys})))


if __name__ == "__main__":
    main()
