"""Fields divided among sorties: how near the fewest, and whether they fly, on 40 fields.

    python benchmarks/sorties.py [FIELDS.geojson] [--seed 0] [--seconds 10] [--jobs 2] [--write]

FIELDS has outlines in metres. Each is taken at three sizes, and an L of our own at one: with an aircraft of 2 kg, a
pack of 0.6 to 2 Ah, a wind of 0 to 6 m/s from anywhere, gusts of 0.5 m/s, and a home beside the field.

- Sorties beside OR-tools' routing (--seconds for each field, whole lines, the same times,
  a pack of the same time): fewer sorties first, then less time.
- All sorties are flown, each with a fresh pack.
- Every second job is stopped at random, in the air, and resumed: ground covered twice, and missed.
"""

from __future__ import annotations

import json
import multiprocessing
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from measured import options, recorded, table

import eadp
from eadp.core.geometry.polygons import covered_share
from eadp.errors import EadpError, Infeasible
from eadp.io.flight import flown_lines, flown_of_plan
from eadp.survey.coverage import LineGrid, cover, line_costs
from eadp.survey.folder import write_sorties
from eadp.survey.sorties import SortieOptions, SortiePlan

ROOT = Path(__file__).resolve().parents[1]
FIELDS = ROOT.parent / "shared/reference/fields/real_outlines_m.geojson"
SCALES = (1.0, 2.0, 3.0)
OWN = [[0, 0], [900, 0], [900, 350], [400, 350], [400, 800], [0, 800]]
VEHICLE = ROOT / "vehicles/foam-wing.yaml"


def jobs(path: Path, seed: int) -> list[dict[str, Any]]:
    """The jobs: name, outline [m], pack [Ah], wind, home, swath."""
    features = json.loads(path.read_text())["features"]
    outlines = [
        (f"{each['properties']['id']} ×{scale:g}", scale * np.array(each["geometry"]["coordinates"][0])[:-1])
        for each in features
        for scale in SCALES
    ]
    rng, found = np.random.default_rng(seed), []
    for name, ring in [*outlines, ("L", np.array(OWN, dtype=float))]:
        corner = ring[int(rng.integers(len(ring)))]
        outward = corner - ring.mean(axis=0)
        home = corner + 40 * outward / np.linalg.norm(outward)
        found.append(
            {
                "name": name,
                "ring": ring.round(2).tolist(),
                "capacity_ah": round(float(rng.uniform(0.6, 2.0)), 2),
                "wind": [round(float(rng.uniform(0, 6)), 1), round(float(rng.uniform(0, 359)))],
                "home": home.round(1).tolist(),
                "swath_m": round(float(rng.uniform(25, 60)), 1),
            }
        )
    return found


def planned(job: dict[str, Any], folder: Path, warn: Any = lambda _: None, resume: Any = ()) -> SortiePlan:
    """The sorties of a job."""
    field, scenario = folder / "field.csv", folder / "given.yaml"
    field.write_text("x_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in job["ring"]))
    wind = {"speed_mps": job["wind"][0], "from_deg": job["wind"][1], "gust_std_mps": 0.5}
    keys = {"schema": "eadp.scenario/1", "vehicle": str(VEHICLE), "wind": wind}
    scenario.write_text(json.dumps(keys | {"battery": {"capacity_ah": job["capacity_ah"]}}))
    options = eadp.CoverageOptions(swath_m=job["swath_m"], metres=True, home=tuple(job["home"]), pattern="dubins")
    return eadp.cover_in_sorties(field, options, SortieOptions(resume=resume), scenario=scenario, warn=warn)


def by_routing(plan: SortiePlan, seconds: int) -> tuple[int, float] | None:
    """Sorties and their time by OR-tools' routing, of whole lines and of packs that last as long; None without one."""
    from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    planner, motion = plan.planner, plan.planner.task.motion
    request = planner._request
    assert request.heading_rad is not None
    grid = LineGrid.over(plan.ground, request.heading_rad, motion.swath_m, motion.swath_m)
    whole = cover(replace(request, field=plan.ground, grid=grid, pattern="dubins"))
    legs = [leg for leg in whole.path(0.0).legs if leg.sensing]
    directed = [way for leg in legs for way in (leg, leg.backward())]
    between, own, first, last = line_costs(request, directed)
    # the time that a pack lasts, as the forecasts of the sorties have it
    sorties = [(each, each.forecast.forecast.remaining_s or 0.0) for each in plan.divided.sorties]
    pack_s = statistics.median(time_s * (1 + each.spare / each.used) for each, time_s in sorties)
    climb_s = statistics.median(time_s - each.plan.solution.time_s for each, time_s in sorties)
    n = len(directed)
    times = np.zeros((n + 1, n + 1))
    times[1:, 1:] = between + own[None, :]
    times[0, 1:], times[1:, 0] = first + own + max(climb_s, 0.0), last
    scaled = np.round(10 * times).astype(int)
    vehicles = len(plan.divided.sorties) + 2
    manager = pywrapcp.RoutingIndexManager(n + 1, vehicles, 0)
    routing = pywrapcp.RoutingModel(manager)
    table = scaled.tolist()
    index = routing.RegisterTransitMatrix(table)
    routing.SetArcCostEvaluatorOfAllVehicles(index)
    routing.AddDimension(index, 0, int(10 * pack_s), True, "time")
    routing.SetFixedCostOfAllVehicles(int(100 * pack_s))
    for i in range(0, n, 2):
        routing.AddDisjunction([manager.NodeToIndex(i + 1), manager.NodeToIndex(i + 2)], 10**9)
    parameters = pywrapcp.DefaultRoutingSearchParameters()
    parameters.first_solution_strategy = routing_enums_pb2.FirstSolutionStrategy.PATH_CHEAPEST_ARC
    parameters.local_search_metaheuristic = routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    parameters.time_limit.seconds = seconds
    found = routing.SolveWithParameters(parameters)
    if found is None or found.ObjectiveValue() >= 10**9:
        return None
    used = sum(routing.IsVehicleUsed(found, k) for k in range(vehicles))
    return used, (found.ObjectiveValue() - used * int(100 * pack_s)) / 10


def measure(job: dict[str, Any], index: int, seconds: int) -> dict[str, Any]:
    """The figures of one job."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        start = time.perf_counter()
        try:
            plan = planned(job, folder)
        except Infeasible as error:
            return {"name": job["name"], "error": str(error)}
        took_s = time.perf_counter() - start
        write_sorties(plan, str(folder / "job"))
        row = {
            "name": job["name"],
            "count": len(plan.sorties),
            "took_s": took_s,
            "time_s": sum(each.plan.solution.time_s for each in plan.divided.sorties),
            "routing": by_routing(plan, seconds) if seconds else None,
            "planned": plan.covered.share,
        }
        flown = eadp.simulate_sorties(folder / "job", seed=index, warn=lambda _: None)
        summary = flown.summary
        row |= {
            "home": all(each["completed"] or "returned" in each["reason"] for each in summary["flights"]),
            "reserve": summary["reserve_kept"],
            "covered": summary["coverage"],
        }
        if index % 2 == 0 and len(plan.sorties) > 1:
            row |= interrupted(job, plan, flown, folder, np.random.default_rng(index))
        return row


def interrupted(
    job: dict[str, Any], plan: SortiePlan, flown: Any, folder: Path, rng: np.random.Generator
) -> dict[str, Any]:
    """Ground covered twice and missed, as shares, where a job is stopped in the air and resumed."""
    names = plan.names
    stopped = int(rng.integers(len(names)))
    sources, lines = [], []
    for name in names[: stopped + 1]:
        flight = flown.flights[name]
        columns = flown_of_plan(flight.columns, None)
        if name == names[stopped]:
            end = int(rng.uniform(0.2, 0.9) * len(columns["time_s"]))
            columns = {key: values[:end] for key, values in columns.items()}
            log = folder / "stopped.jsonl"
            rows = zip(columns["time_s"], columns["x_m"], columns["y_m"], strict=True)
            log.write_text("".join(json.dumps({"time_s": t, "x_m": x, "y_m": y}) + "\n" for t, x, y in rows))
            sources.append(str(log))
        else:
            flight.write(folder / f"flown-{name}")
            sources.append(str(folder / f"flown-{name}"))
        lines += flown_lines(flight.inputs.mission.plan, columns)
    try:
        rest = planned(job, folder, resume=sources)
    except EadpError as error:
        return {"resume_error": str(error)}
    task = plan.planner.task
    again = [(leg.start[:2], leg.end[:2]) for each in rest.sorties for leg in each.path().legs if leg.sensing]
    parts, swath_m = task.field.parts, task.motion.swath_m
    missed = 1 - covered_share(parts, [*lines, *again], swath_m)
    # a line's own ground reaches half way to its neighbours: what these overlap anyway is not twice
    assert plan.planner._request.heading_rad is not None
    grid = LineGrid.over(task.field, plan.planner._request.heading_rad, swath_m, swath_m)
    own_m = float(np.diff(grid.edges_m)[1:-1].min(initial=swath_m))
    first, both = (covered_share(parts, each, own_m) for each in (lines, [*lines, *again]))
    alone = covered_share(parts, again, own_m)
    return {"missed": missed, "twice": first + alone - both}


def main() -> None:
    """Print the table."""
    parser = options(__doc__, "sorties")
    parser.add_argument("fields", type=Path, nargs="?", default=FIELDS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=int, default=10, help="of OR-tools for each field; 0 leaves it out")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", type=int, nargs="*")
    asked = parser.parse_args()
    with recorded("sorties", write=asked.write):
        given = jobs(asked.fields, asked.seed)
        chosen = [(job, i, asked.seconds) for i, job in enumerate(given) if not asked.only or i in asked.only]
        with multiprocessing.Pool(asked.jobs) as pool:
            rows = pool.starmap(measure, chosen, chunksize=1)
        for row in rows:
            print(json.dumps(row), file=sys.stderr)
        table(("figure", "value"), figures([row for row in rows if "error" not in row]))


def figures(made: list[dict[str, Any]]) -> Iterator[tuple[str, object]]:
    """The figures of all jobs."""
    yield "fields", len(made)
    beside = [row for row in made if row["routing"] is not None]
    if beside:
        more = [int(np.sign(row["count"] - row["routing"][0])) for row in beside]
        yield "sorties fewer, as many, more than OR-tools", ", ".join(str(more.count(sign)) for sign in (-1, 0, 1))
        same = [row["time_s"] / row["routing"][1] for row in beside if row["count"] == row["routing"][0]]
        yield "time over OR-tools', same number, median", f"{statistics.median(same):.3f}" if same else "–"
    yield "all flights home, with the reserve", f"{sum(row['home'] and row['reserve'] for row in made)} of {len(made)}"
    yield "least ground covered", f"{min(row['covered'] for row in made):.4f}"
    cut = [row for row in made if "missed" in row]
    if cut:
        twice = [100 * row["twice"] for row in cut]
        yield "resumed jobs", len(cut)
        yield f"missed, largest of {len(cut)}", f"{100 * max(row['missed'] for row in cut):.2f} %"
        yield (
            f"covered twice, median and largest of {len(cut)}",
            f"{statistics.median(twice):.2f} %, {max(twice):.2f} %",
        )


if __name__ == "__main__":
    main()
