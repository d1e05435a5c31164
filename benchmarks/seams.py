"""Random missions through every door: what the next command forgets of what the one before knew.

    python benchmarks/seams.py [--missions 100] [--seed 0] [--write]

Each mission is a field with up to three obstacles, an aircraft, a wind and a battery. It is covered, forecast, flown
by `static` and by `joint`, exported for QGroundControl, read back and forecast again, and its flight by `joint`, where
it completes, is given to the planner of `eadp replan` as telemetry. The table has the largest and the median difference
at each seam, in per cent, with the missions that have the largest. No flight that is said to complete may have been
inside an obstacle, and none may leave its planned path by more than the swath.
"""

from __future__ import annotations

import argparse
import bisect
import io
import json
import math
import statistics
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from measured import add_option, head, line, recorded
from scipy.spatial import cKDTree

import eadp
from eadp.api.inputs import FlightInputs, load_flight
from eadp.api.replan.replanner import replan_lines
from eadp.core.geometry.bearings import compass_deg
from eadp.errors import Infeasible
from eadp.models.plan.legs import leg_points
from eadp.models.plan.plan import Plan
from eadp.planning.base import DecisionRecord

ROOT = Path(__file__).resolve().parents[1]
PROFILE = ROOT / "profiles/pednet-jetson-nano.yaml"
AIRCRAFT = ("small-wing", "survey-wing", "foam-wing", "mapper")
ORIGIN = "55.37,10.43"
PEDNET, RATES = eadp.read_profile(PROFILE), np.linspace(2, 10, 401).tolist()


def ring(rng: np.random.Generator, centre: tuple[float, float], half: tuple[float, float]) -> list[tuple[float, float]]:
    """A rectangle, turned."""
    angle = float(rng.uniform(0, math.pi))
    c, s = math.cos(angle), math.sin(angle)
    corners = [(-half[0], -half[1]), (half[0], -half[1]), (half[0], half[1]), (-half[0], half[1])]
    return [(round(centre[0] + c * x - s * y, 1), round(centre[1] + s * x + c * y, 1)) for x, y in corners]


def files(rng: np.random.Generator, folder: Path) -> dict[str, Any]:
    """The files of a mission, and its scenario's keys."""
    half = float(rng.uniform(200, 450)), float(rng.uniform(150, 350))
    field = ring(rng, (0.0, 0.0), half)
    text = "x_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in field)
    (folder / "field.csv").write_text(text)
    count = int(rng.integers(0, 4))
    features = []
    for i in range(count):
        centre = float(rng.uniform(-1, 1)) * half[0], float(rng.uniform(-1, 1)) * half[1]
        corners = ring(rng, centre, (float(rng.uniform(5, 40)), float(rng.uniform(5, 40))))
        polygon = {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}
        features.append({"type": "Feature", "properties": {"name": f"house {i}"}, "geometry": polygon})
    (folder / "avoid.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "units": "m", "features": features}) if features else ""
    )
    wing = str(rng.choice(AIRCRAFT))
    wind = {"speed_mps": round(float(rng.uniform(0, 7)), 1), "from_deg": round(float(rng.uniform(0, 359)))}
    return {"obstacles": count, "wing": str(ROOT / f"vehicles/{wing}.yaml"), "wind": wind}


def mission(index: int, seed: int, folder: Path) -> dict[str, Any] | None:
    """The differences at the seams of a mission; None where its field cannot be covered."""
    rng = np.random.default_rng([seed, index])
    given = files(rng, folder)
    wind, plan, exported = given["wind"], folder / "mission.plan", folder / "exported.plan"
    scenario = folder / "scenario.yaml"
    keys = {"schema": "eadp.scenario/1", "vehicle": given["wing"], "profile": str(PROFILE), "wind": wind}
    scenario.write_text(json.dumps(keys))
    swath_m = float(rng.uniform(25, 60))
    options = eadp.CoverageOptions(
        swath_m=swath_m,
        metres=True,
        avoid=str(folder / "avoid.geojson") if given["obstacles"] else None,
    )
    try:
        covered = eadp.cover(folder / "field.csv", options, scenario=scenario, warn=lambda _: None)
    except Infeasible:
        return None
    plan.write_text(covered.text)
    inputs = load_flight(str(plan), scenario=str(scenario), overrides={"planner.name": "static"})
    need_wh = inputs.preflight().forecast.energy_wh
    battery = inputs.world.battery
    capacity_ah = float(rng.uniform(0.7, 1.5)) * need_wh / battery.voltage_v
    keys |= {"battery": {"capacity_ah": capacity_ah}, "start": {"altitude_m": inputs.world.start.altitude_m}}
    scenario.write_text(json.dumps(keys))
    return _differences(covered, plan, scenario, exported, inputs.world.start.altitude_m) | {"swath_m": swath_m}


def off_path_m(flight: eadp.Flight, inputs: FlightInputs) -> float:
    """The greatest distance of a flight from the path of its forecast, once it has joined it [m]."""
    legs = inputs.preflight().planned(inputs.mission).legs
    path = cKDTree([(point.x_m, point.y_m) for leg in legs for point in leg_points(leg, 1.0)])
    track = np.array([(step.x_m, step.y_m) for step in flight.steps])
    return float(path.query(track)[0].max())


def _differences(covered: Any, plan: Path, scenario: Path, exported: Path, altitude_m: float) -> dict[str, Any]:
    static = eadp.simulate(
        plan, scenario=scenario, overrides={"planner.name": "static", "battery.capacity_ah": 50.0}, warn=lambda _: None
    )
    joint = eadp.simulate(plan, scenario=scenario, warn=lambda _: None)
    expected, before = static.summary["energy_forecast"], joint.summary["energy_forecast"]
    command = ["export", str(plan), "--scenario", str(scenario), "--to", "qgc", "--origin", ORIGIN, "-o", str(exported)]
    subprocess.run(
        [sys.executable, "-m", "eadp", *command, "--altitude", f"{altitude_m}"], check=True, capture_output=True
    )
    # a constant load of the computations' mean power
    mean_w = before["computing_wh"] * 3600 / before["time_s"]
    load = {"profile_at.fps": float(np.interp(mean_w, [PEDNET.power_w_at([fps]) for fps in RATES], RATES))}
    read = load_flight(str(exported), scenario=str(scenario), overrides={"planner.name": "static", **load})
    again = read.preflight().forecast
    inputs = load_flight(str(plan), scenario=str(scenario))
    decisions = replanned(inputs, joint) if joint.summary["completed"] else []
    ends = [row["soc_end_forecast"] for row in decisions if row["soc_end_forecast"] is not None]
    apart = [others(covered.plan, joint.decisions, row) for row in decisions]
    soc = joint.summary["soc_final"]
    steady = {"planner.name": "static", "battery.capacity_ah": 50.0}
    own = load_flight(str(plan), scenario=str(scenario), overrides=steady)
    found = {
        "cover to forecast: time": relative(expected["time_s"], covered.report.full.time_s),
        "forecast to flight: time": relative(static.summary["duration_s"], expected["time_s"]),
        "forecast to flight: energy": relative(static.summary["energy_wh"], expected["energy_wh"]),
        "forecast to exported mission, read back: time": relative(again.remaining_s, before["time_s"]),
        "forecast to exported mission, read back: energy": relative(again.energy_wh, before["energy_wh"]),
        "cover to flight: ground covered": 100 * abs(static.summary["coverage"] - covered.report.full.coverage),
        "replan on the flight, last decision: charge at the end": 100 * abs(ends[-1] - soc) if ends else math.nan,
        "flight to replan: decided parameters, of their sets": 100 * statistics.mean(apart) if apart else math.nan,
    }
    flights = (static, joint)
    inside = [sum(entry["inside_m"] for entry in flight.summary["obstacles"]) for flight in flights]
    said = [flight.summary["completed"] for flight in flights]
    return {
        "differences": found,
        "off_path_m": off_path_m(static, own),
        "inside_m": sum(metres for metres, completed in zip(inside, said, strict=True) if completed),
        "entered": sum(metres > 0 for metres in inside),
        "flights": len(flights),
        "completed": sum(said),
    }


def others(plan: Plan, records: Sequence[DecisionRecord], row: dict[str, Any]) -> float:
    """By how much a re-planning's parameters differ from those last decided in flight, as a share of their sets."""
    at = max(0, bisect.bisect_right([record.time_s for record in records], row["time_s"]) - 1)
    spans = [plan.hull(i).hi - plan.hull(i).lo or 1.0 for i in range(len(plan.names))]
    pairs = zip(row["parameters"].values(), records[at].parameters, spans, strict=True)
    return max(abs(a - b) / span for a, b, span in pairs)


def relative(value: float, expected: float) -> float:
    """A difference in per cent."""
    return 100 * abs(value / expected - 1)


def replanned(inputs: FlightInputs, flight: eadp.Flight) -> list[dict[str, Any]]:
    """The decisions of the planner on the flight's rows as telemetry, each second."""
    lines = []
    for step in flight.steps[:: max(1, round(1.0 / inputs.world.clock.log_every_s))]:
        names = dict(zip(inputs.world.plan.names, step.parameters, strict=True))
        row = {"time_s": step.time_s, "x_m": step.x_m, "y_m": step.y_m, "power_w": step.power_w, "soc": step.soc}
        heading = {"heading_deg": compass_deg(step.heading_rad)}
        lines.append(json.dumps({**row, **heading, "parameters": names}))
    decisions: list[dict[str, Any]] = []
    stream = io.BytesIO("\n".join(lines).encode())
    replan_lines(inputs, stream, "flight", None, decisions.append, lambda _: None)
    return decisions


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    add_option(parser, "seams")
    options = parser.parse_args()
    with recorded("seams", write=options.write):
        show(options.missions, options.seed)


def show(missions: int, seed: int) -> None:
    """Print the table of the seams, and what was flown into."""
    found: dict[str, dict[int, float]] = defaultdict(dict)
    totals: dict[str, float] = defaultdict(float)
    entered: list[int] = []
    off: dict[int, tuple[float, float]] = {}
    for index in range(missions):
        with tempfile.TemporaryDirectory() as folder:
            result = mission(index, seed, Path(folder))
        if result is None:
            totals["fields that cannot be covered"] += 1
            continue
        for seam, difference in result["differences"].items():
            if math.isfinite(difference):
                found[seam][index] = difference
        if result["entered"]:
            entered.append(index)
        off[index] = result["off_path_m"], result["off_path_m"] / result["swath_m"]
        for key in ("inside_m", "entered", "flights", "completed"):
            totals[key] += result[key]
    uncovered = totals["fields that cannot be covered"]
    print(f"seed {seed}, {missions} missions, {uncovered:.0f} of whose fields cannot be covered")
    print(head("seam", "median [%]", "largest [%]", "missions with the largest"))
    for seam, values in found.items():
        worst = sorted(values, key=values.__getitem__, reverse=True)[:3]
        print(line(seam, f"{statistics.median(values.values()):.2f}", f"{max(values.values()):.2f}", worst))
    flights, completed = totals["flights"], totals["completed"]
    print(f"flights: {flights:.0f}, completed {completed:.0f}, into an obstacle {totals['entered']:.0f}: {entered}")
    (far_m, _), share = max(off.values()), max(share for _, share in off.values())
    print(f"farthest from the planned path: {far_m:.1f} m; of the swath, {100 * share:.0f} %")
    print(f"metres inside obstacles of flights that are said to complete: {totals['inside_m']:.1f}")


if __name__ == "__main__":
    main()
