"""Coverage: ground covered, length beside the best Dubins order of the same lines, time to plan.

    python benchmarks/fields.py [--outlines FILE.geojson] [--fly] [--seconds 10]

Over generated fields (rectangles turned, trapezoids, L, U, T, star, comb, a hole) and, where given, the outlines of a
file of polygons in metres. Every field is covered by both patterns and by `auto`, with several swaths and radii. The
best Dubins order of a path's lines, with its ends, is found exactly up to 14 lines by dynamic programming and by
OR-tools' guided local search beyond (`pip install -e '.[bench]'`), and never worse than any order that eadp finds.
With `--fly` each plan is flown in simulation without wind and in 5 m/s from eight directions, and what the aircraft
really passed over is measured from its positions, ten a second.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import itertools
import json
import math
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import shapely
from measured import add_option, recorded

from eadp.api.inputs import load_flight
from eadp.core.geometry.polygons import signed_area_m2
from eadp.coverage.cover import AUTO, DUBINS, ZAMBONI, CoverageRequest, cover, line_costs
from eadp.coverage.line_order import EXACT_LINES, best_order
from eadp.coverage.plan_builder import build_plan
from eadp.coverage.report import covered_by_lines
from eadp.coverage.swaths import MotionLimits, frame_of
from eadp.errors import Infeasible
from eadp.io.plan.reader import read_plan
from eadp.io.plan.writer import plan_text
from eadp.io.text.streams import Text
from eadp.models.field import Field
from eadp.simulation.loop import Outcome, fly
from eadp.validation.check import check_plan

SEED = 1
SIZES = ((20, 20), (30, 30), (40, 20), (30, 50), (20, 75))
"""Swath and smallest radius [m]."""


def generated() -> list[Field]:
    """Fields of the usual hard kinds, turned at random."""
    rng = np.random.default_rng(SEED)
    shapes = {
        "rectangle": [(0, 0), (600, 0), (600, 350), (0, 350)],
        "strip": [(0, 0), (900, 0), (900, 220), (0, 220)],
        "trapezoid": [(0, 0), (640, 0), (480, 420), (100, 420)],
        "slanted": [(0, 0), (500, 0), (700, 400), (200, 400)],
        "triangle": [(0, 0), (700, 60), (250, 520)],
        "L": [(0, 0), (620, 0), (620, 240), (260, 240), (260, 560), (0, 560)],
        "U": [(0, 0), (600, 0), (600, 500), (400, 500), (400, 200), (200, 200), (200, 500), (0, 500)],
        "T": [(0, 320), (0, 540), (660, 540), (660, 320), (440, 320), (440, 0), (220, 0), (220, 320)],
        "comb": [(0, 0), (700, 0), (700, 420), (580, 420), (580, 150), (410, 150), (410, 420), (290, 420),
                 (290, 150), (120, 150), (120, 420), (0, 420)],
        "star": [(380 + r * math.cos(k * math.pi / 5), 380 + r * math.sin(k * math.pi / 5))
                 for k, r in zip(range(10), itertools.cycle((380, 190)), strict=False)],
    }  # fmt: skip
    holes = {"hole": ([(0, 0), (640, 0), (640, 520), (0, 520)], [(230, 180), (240, 340), (420, 330), (400, 170)])}
    fields = []
    for name, rings in {**{name: (ring,) for name, ring in shapes.items()}, **holes}.items():
        angle = rng.uniform(0, 2 * math.pi)
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        turned = [tuple(map(tuple, (np.array(ring) @ turn.T).tolist())) for ring in rings]
        fields.append(Field(turned[0], tuple(turned[1:]), name))
    return fields


def outlines(path: str) -> list[Field]:
    """The polygons of a file in metres."""
    fields = []
    for feature in json.loads(Path(path).read_text())["features"]:
        rings = [tuple(map(tuple, ring[:-1])) for ring in feature["geometry"]["coordinates"]]
        rings = [ring if (signed_area_m2(ring) > 0) == (i == 0) else ring[::-1] for i, ring in enumerate(rings)]
        fields.append(Field(rings[0], tuple(rings[1:]), str(feature["properties"]["id"]).removeprefix("real_")))
    return fields


def directed_lines(solution, path):
    """A path's lines in both directions, numbered across the field."""
    frame = frame_of(solution.heading_rad)
    upward = []
    for leg in path.legs:
        if leg.sensing:
            (_, v0), (_, v1) = frame.into(np.array([leg.start[:2], leg.end[:2]]))
            upward.append(leg if v0 <= v1 else leg.backward())
    upward.sort(key=lambda leg: frame.into(np.array([leg.start[:2]]))[0, 0])
    return [directed for leg in upward for directed in (leg, leg.backward())]


def best_known_s(problem, seconds: float) -> tuple[float, str]:
    """The least time known of an order of lines, and who found it."""
    ours = best_order(*problem)[1]
    if len(problem[1]) // 2 <= EXACT_LINES:
        return ours, "exact"
    theirs = routed_s(problem, seconds)
    return (theirs, "OR-tools") if theirs < ours else (ours, "ours")


def routed_s(problem, seconds: float) -> float:
    """OR-tools' order: two nodes a line, one of them to be visited, as one vehicle's route."""
    from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    costs, own, first, last = problem
    directed = len(own)
    matrix = np.zeros((directed + 1, directed + 1))
    matrix[:directed, :directed] = costs + own[None, :]
    matrix[directed, :directed] = first + own
    matrix[:directed, directed] = last
    scaled = np.round(matrix * 1000).astype(int).tolist()
    manager = pywrapcp.RoutingIndexManager(directed + 1, 1, directed)
    routing = pywrapcp.RoutingModel(manager)
    arc = routing.RegisterTransitCallback(lambda a, b: scaled[manager.IndexToNode(a)][manager.IndexToNode(b)])
    routing.SetArcCostEvaluatorOfAllVehicles(arc)
    for line in range(directed // 2):
        routing.AddDisjunction([manager.NodeToIndex(2 * line), manager.NodeToIndex(2 * line + 1)], 10**9, 1)
    settings = pywrapcp.DefaultRoutingSearchParameters()
    settings.first_solution_strategy = routing_enums_pb2.FirstSolutionStrategy.PATH_CHEAPEST_ARC
    settings.local_search_metaheuristic = routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    settings.time_limit.FromMilliseconds(int(seconds * 1000))
    found = routing.SolveWithParameters(settings)
    return found.ObjectiveValue() / 1000 if found else math.inf


def flown_share(plan: str, field: Field, swath_m: float, wind_deg: float | None, c1: float) -> tuple[bool, float]:
    """Whether a flight completes, and the share of the field within half a swath of the lines that it flew."""
    wind = {} if wind_deg is None else {"wind.speed_mps": 5, "wind.towards_deg": wind_deg}
    parameters = {"parameters": {"c1": c1}} if c1 < 0 else {}
    settings = {"planner.name": "static", "battery.capacity_ah": 50, "time_limit_s": 20000, **wind, **parameters}
    inputs = load_flight(plan, overrides=settings)
    outcome, rest = Outcome(), shapely.Polygon(field.outline, field.holes)
    kinds = {stage.index: stage.kind for stage in inputs.world.plan.stages}
    for stage, steps in itertools.groupby(fly(inputs.world, inputs.flight(), outcome), key=lambda step: step.stage):
        points = [(step.x_m, step.y_m) for step in steps]
        if kinds[stage] == "line" and len(points) > 1:
            rest = shapely.difference(rest, shapely.LineString(points).buffer(swath_m / 2, cap_style="flat"))
    return outcome.completed, 1 - rest.area / field.area_m2


def measure(
    field: Field, motion: MotionLimits, pattern: str, seconds: float, fly_too: bool
) -> dict[str, object] | None:
    """A field covered by a pattern."""
    request = CoverageRequest(field, motion, pattern)
    begin = time.process_time()
    try:
        solution = cover(request)
    except Infeasible:
        return None
    planned_s = time.process_time() - begin
    path = solution.path(solution.min_c1)
    best_s, by = best_known_s(line_costs(request, directed_lines(solution, path)), seconds)
    text = plan_text(build_plan(solution, min_radius_m=motion.min_radius_m))
    plan, findings = read_plan(Text("plan", text))
    row: dict[str, object] = {
        "pattern": solution.pattern,
        "lines": path.lines,
        "length_m": path.length_m,
        "ratio": solution.time_s / best_s,
        "by": by,
        "coverage": min(covered_by_lines(solution.path(c1), field, motion.swath_m) for c1 in (0.0, solution.min_c1)),
        "planned_s": planned_s,
        "findings": len(findings) + len(check_plan(plan).findings),
        "lines_at_0": solution.path(0.0).lines,
    }
    if fly_too:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "field.plan"
            file.write_text(text)
            flights = [
                flown_share(str(file), field, motion.swath_m, wind, solution.min_c1)
                for wind in (None, *range(0, 360, 45))
            ]
        row["completed"] = sum(completed for completed, _ in flights)
        row["flown"] = min(share for _, share in flights)
    return row


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--outlines", help="GeoJSON of polygons in metres")
    parser.add_argument("--fly", action="store_true", help="fly every plan, too")
    parser.add_argument("--seconds", type=float, default=10.0, help="OR-tools' time for an order")
    parser.add_argument("--sizes", default=None, help="swath,radius pairs, as in 30,30;20,75")
    parser.add_argument("--patterns", default=f"{ZAMBONI},{DUBINS},{AUTO}")
    add_option(parser, "fields")
    arguments = parser.parse_args()
    with recorded("fields", write=arguments.write):
        _print(arguments)


def _print(arguments: argparse.Namespace) -> None:
    sizes = SIZES
    if arguments.sizes:
        sizes = tuple(tuple(float(v) for v in pair.split(",")) for pair in arguments.sizes.split(";"))
    groups = {"generated": generated()} | ({"outlines": outlines(arguments.outlines)} if arguments.outlines else {})
    print(f"seed {SEED}; ratio: flight time at the lowest c1 / best Dubins order of the same lines")
    for (group, fields), (swath, radius) in itertools.product(groups.items(), sizes):
        motion = MotionLimits(float(swath), float(radius), 1.5 * radius, 0.5 * swath)
        for pattern in arguments.patterns.split(","):
            rows = []
            for field in fields:
                row = measure(field, motion, pattern, arguments.seconds, arguments.fly)
                if row is None:
                    print(f"  {field.name:24s} {pattern:8s} too narrow")
                    continue
                rows.append(row)
                flown = f" flown {row['completed']}/9, {row['flown']:.4f}" if arguments.fly else ""
                print(
                    f"  {field.name:24s} {pattern:8s} {row['pattern']:8s} {row['lines']:3d} lines "
                    f"({row['lines_at_0']} at c1 = 0) {row['length_m']:8.0f} m, "
                    f"ratio {row['ratio']:.3f} ({row['by']}), covered {row['coverage']:.6f}, "
                    f"planned in {row['planned_s']:.2f} s, "
                    f"{row['findings']} findings{flown}",
                    flush=True,
                )
            if rows:
                ratios = [row["ratio"] for row in rows]
                times = [row["planned_s"] for row in rows]
                print(
                    f"{group}, swath {swath} m, radius {radius} m, {pattern}: {len(rows)} fields, ratio median "
                    f"{statistics.median(ratios):.3f}, worst {max(ratios):.3f}; covered at least "
                    f"{min(row['coverage'] for row in rows):.6f}; planned in {statistics.median(times):.2f} s, worst "
                    f"{max(times):.2f} s",
                    flush=True,
                )


if __name__ == "__main__":
    sys.exit(main())
