"""Whether a change leaves flights as they were: a hash of each of some sixty flights and replays.

Each planner flies the same missions: winds, gusts, covered fields of several blocks, stages that command altitudes and
airspeeds, two computations, losses of charge, limits of the battery, a way home, noisy sensors, the published flights;
and follows telemetry. A row has three hashes (sha256): of the rows of `flight.csv`, of the decisions without the
figures of the solver, and of the summary without wall-clock times and without U, which has a column of its own.

    python benchmarks/hashes.py -o before.json
    python benchmarks/hashes.py --compare before.json [--only static,paper]

Hashes hold for one machine and one set of libraries: numbers differ in their last digits elsewhere. Exit code 1 where a
flight differs.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from measured import covered

ROOT = Path(__file__).resolve().parents[1]
PROFILE = ROOT / "profiles/pednet-jetson-nano.yaml"
LETTER = ROOT / "profiles/pednet-letter.yaml"
SURVEY = ROOT / "plans/survey.plan"
PLANNERS = "static", "paper", "joint"
FIELDS: Mapping[str, list[list[float]]] = {
    "oblong": [[0, 0], [620, 60], [600, 420], [-20, 360]],
    "corner": [[0, 0], [700, 0], [700, 300], [350, 300], [350, 520], [0, 520]],
}
TWO = """schema: eadp.profile/1
source: "made up: two computations"
parameters: [{name: fps}, {name: size}]
interpolation: linear
points:
  - {at: [2, 32], power_w: 5}
  - {at: [10, 32], power_w: 9}
  - {at: [2, 448], power_w: 6}
  - {at: [10, 448], power_w: 12}
"""
SMALL: Mapping[str, Any] = {"battery.capacity_ah": 0.5}


class Case(NamedTuple):
    """A flight: its plan and profile by name, and the scenario's keys; a replay has telemetry, too."""

    name: str
    plan: str
    keys: Mapping[str, Any]
    profile: str | None = "pednet"
    scenario: str | None = None
    replay: bool = False


def cases() -> list[Case]:
    """The missions that each planner flies."""
    wind = {"wind.speed_mps": 5, "wind.from_deg": 180}
    gusts = {"wind.speed_mps": 4, "wind.from_deg": 40, "wind.gust_std_mps": 1.2, "seed": 3}
    fixed = {"vehicle.airframe.model": "fixed-wing"}
    ranged = {**fixed, "vehicle.airframe.airspeed_range_mps": [10, 15]}
    faults = {"faults": [{"at_s": 93, "soc_drop": 0.06}, {"at_s": 270, "soc_drop": 0.09}]}
    noisy = {"sensors.power_noise_w": 1.0, "sensors.position_noise_m": 1.0, "sensors.soc_noise": 0.003}
    limits = {"battery.max_c_rate": 9, "battery.cutoff_voltage_v": 13.2, "battery.resistance_ohm": 0.2}
    return [
        Case("survey", "survey", SMALL),
        Case("survey in wind", "survey", {**SMALL, **wind}),
        Case("survey in gusts", "survey", {**SMALL, **gusts, **fixed}),
        Case("survey with losses", "survey", {"battery.capacity_ah": 0.7, **wind, **faults}),
        Case("survey with noise", "survey", {**SMALL, **gusts, **noisy}),
        Case("survey with limits", "survey", {**SMALL, **limits}),
        Case("survey by the letter's limit", "survey", {"battery.capacity_ah": 0.7, "battery.letter_crate_per_h": 12}),
        Case("survey and home", "survey", {"battery.capacity_ah": 0.3, "home.position_m": [0, 0], **wind}),
        Case("survey with weights", "survey", {**SMALL, "planner.weights.c1": 0.8, "planner.weights.c2": 0.2}),
        Case("survey changed live", "survey", {**SMALL, "parameter_changes": "live"}),
        Case("blocks", "oblong", {"battery.capacity_ah": 1.0}),
        Case("blocks in gusts", "corner", {"battery.capacity_ah": 1.2, **gusts, **fixed}),
        Case("blocks at an airspeed decided", "corner", {"battery.capacity_ah": 1.2, **ranged, **wind}),
        Case("slow blocks", "corner", {"battery.capacity_ah": 2.0, "vehicle.airframe.airspeed_mps": 14, **wind}),
        Case("climbs", "climbs", {"battery.capacity_ah": 0.8, **fixed, **wind}),
        Case("two computations", "two", {"battery.capacity_ah": 0.6, **wind}, "two"),
        Case("published I", "survey", {}, "letter", "paper-I-static"),
        Case("published i", "survey", {}, "letter", "paper-i-dynamic"),
        Case("published, drained", "survey", {}, "letter", "paper-drained"),
        Case("example telemetry", "survey", {}, None, "survey", replay=True),
        Case("telemetry with gaps", "survey", {"sensors.delay_s": 0}, None, "survey", replay=True),
    ]


def write_files(folder: Path) -> dict[str, str]:
    """Plans and profiles by name."""
    two, climbs = folder / "two.plan", folder / "climbs.plan"
    (folder / "two.yaml").write_text(TWO)
    survey = SURVEY.read_text()
    header = "%: computations fps, size"
    two.write_text(survey.replace("%: computations fps", header).replace("[2, 10]", "[2, 10]\n[32, 448]"))
    lines = survey.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("0.1; 270"))
    climbs.write_text("\n".join([*lines[:at], "%: altitude 60", "%: airspeed 16", *lines[at:]]) + "\n")
    found = {"survey": SURVEY, "two": two, "climbs": climbs}
    found |= covered(folder, FIELDS, PROFILE, 30)
    profiles = {"pednet": PROFILE, "letter": LETTER, "two profile": folder / "two.yaml"}
    return {name: str(path) for name, path in (found | profiles).items()}


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else str(value)


def digest(value: Any) -> str:
    """The hash of a document, numbers to the last digit."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=_plain).encode()).hexdigest()[:16]


def flown(case: Case, planner: str, files: Mapping[str, str]) -> dict[str, Any]:
    """Hashes and figures of a flight."""
    from eadp.api.flight import fly_flight
    from eadp.api.inputs import load_flight

    keys = {**case.keys, "planner.name": planner, "log_every_s": 0.5, "step_s": 0.05}
    if case.scenario and case.scenario.startswith("paper"):
        keys = {**case.keys, "planner.name": planner}
    profile = case.profile and files[{"two": "two profile"}.get(case.profile, case.profile)]
    scenario = case.scenario and str(ROOT / f"scenarios/{case.scenario}.yaml")
    inputs = load_flight(files[case.plan], scenario=scenario, profile=profile, overrides=keys)
    if case.replay:
        return replayed(case, inputs)
    flight = fly_flight(inputs, inputs.preflight(), lambda _: None, ())
    summary = {**flight.summary}
    quality = summary.pop("quality")
    summary.pop("energy_forecast")
    summary["solver"] = {key: value for key, value in summary["solver"].items() if not key.endswith("_ms")}
    changes = sum(parameter["changes"] for parameter in summary["parameters"].values())
    return {
        "rows": digest([(*step[:9], step.parameters) for step in flight.steps]),  # up to the charge
        "decisions": digest([[r.time_s, r.cause, r.stage, r.lap, r.parameters] for r in flight.decisions]),
        "summary": digest(summary),
        "u": quality,
        "completed": summary["completed"],
        "soc": summary["soc_final"],
        "changes": changes,
    }


def replayed(case: Case, inputs: Any) -> dict[str, Any]:
    """Hashes of what `eadp replan` prints on the example's telemetry, whole or with gaps."""
    from eadp.live.replanner import replan_lines

    lines = (ROOT / "scenarios/example-telemetry.jsonl").read_bytes().splitlines(keepends=True)
    if "gaps" in case.name:
        lines = [line for i, line in enumerate(lines) if i % 97 < 80]
    advice: list[dict[str, Any]] = []
    warnings: list[str] = []
    completes = replan_lines(
        inputs, io.BytesIO(b"".join(lines)), "telemetry", None, advice.append, lambda fault: warnings.append(str(fault))
    )
    stages = [[line["time_s"], line["stage"], line["parameters"]] for line in advice]
    summary = [completes, warnings]
    return {"rows": digest(stages), "decisions": digest(advice), "summary": digest(summary), "completed": completes}


def _one(task: tuple[Case, str, dict[str, str]]) -> tuple[str, dict[str, Any]]:
    case, planner, files = task
    try:
        found = flown(case, planner, files)
    except Exception as error:  # a fault is a result, too: it may come or go with a change
        found = {"error": f"{type(error).__name__}: {error}"}
    return f"{planner}: {case.name}", found


def table(jobs: int, only: tuple[str, ...]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every flight's name, hashes and figures."""
    with tempfile.TemporaryDirectory() as folder:
        files = write_files(Path(folder))
        tasks = [(case, planner, files) for planner in only for case in cases()]
        with multiprocessing.Pool(jobs) as pool:
            yield from pool.imap(_one, tasks)


def main() -> int:
    """Print the table, write it, or compare it with one that was written before."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path)
    parser.add_argument("--compare", type=Path)
    parser.add_argument("--only", default=",".join(PLANNERS), help="planners, separated by commas")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    found = json.loads(json.dumps(dict(table(options.jobs, tuple(options.only.split(",")))), default=_plain))
    if options.out:
        options.out.write_text(json.dumps(found, indent=1) + "\n")
    if not options.compare:
        for name, row in found.items():
            print(f"{name:44}", *(f"{key} {value}" for key, value in row.items()))
        return 0
    before, differing = json.loads(options.compare.read_text()), 0
    for name, row in found.items():
        hashed = [key for key in ("rows", "decisions", "summary", "error") if row.get(key) != before[name].get(key)]
        differing += bool(hashed)
        if hashed:
            print(f"{name}: {', '.join(hashed)} differ; {before[name]} → {row}")
    print(f"{len(found) - differing} of {len(found)} flights are the same")
    return differing > 0


if __name__ == "__main__":
    sys.exit(main())
