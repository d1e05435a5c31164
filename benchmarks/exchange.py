"""Missions exported and read back, and the time to read and check one of many items.

    python benchmarks/exchange.py [--random 200] [--items 700] [--write]

Random missions are exported as WPL and as a QGroundControl plan and read back: the largest distance between the two
paths, and the largest difference of their lengths. Last the CPU seconds that a mission of many items takes to be read
and to be checked.
"""

from __future__ import annotations

import math
import random
import time

import shapely
from measured import options, recorded

from eadp.check.check import check_plan
from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m
from eadp.errors import InputError
from eadp.exchange.path import PlannedPath, planned_sections
from eadp.exchange.writer import EXPORTS
from eadp.io.plan.sources import PlanReader
from eadp.io.text.streams import Text
from eadp.models.plan.plan import Plan
from eadp.models.plan.trace import nominal_legs, trace

HOME = (47.0, 8.0)
RADIUS_M, TOLERANCE_M, STEP_M, SIMPLIFIED_M = 20.0, 1.0, 2.0, 0.005


def random_mission(draw: random.Random) -> str:
    """A WPL file of waypoints, flown past or not, and loiters."""
    lines = ["QGC WPL 110", f"0 1 0 16 0 0 0 0 {HOME[0]} {HOME[1]} 400 1"]
    for number in range(1, draw.randint(2, 12)):
        latitude, longitude = to_geodetic_deg(draw.uniform(-800, 800), draw.uniform(-800, 800), HOME)
        loiter = f"18 {draw.choice([0.5, 1, 2.3])} 0 {draw.choice([-60, 40, 90])} 1"
        waypoint = f"16 0 {draw.choice([0, 0, 5])} {draw.choice([0, 0, 0, 40])} 0"
        what = loiter if draw.random() < 0.25 else waypoint
        lines.append(f"{number} 0 3 {what} {latitude:.9f} {longitude:.9f} 50 1")
    return "\n".join(lines)


def drawn(plan: Plan) -> shapely.LineString:
    points = [(point.x_m, point.y_m) for point in trace(plan, (), STEP_M)]
    assert plan.site.origin_deg is not None
    line = shapely.LineString([to_local_m(*to_geodetic_deg(*point, plan.site.origin_deg), HOME) for point in points])
    return line.simplify(SIMPLIFIED_M)


def distance_m(path: shapely.LineString, other: shapely.LineString) -> float:
    """The largest distance of a point of a path from another path [m]."""
    return float(shapely.distance(shapely.points(shapely.segmentize(path, 5 * STEP_M).coords), other).max())


def exported(count: int) -> None:
    draw, reader = random.Random(1), PlanReader(turn_radius_m=RADIUS_M)
    apart, longer, made, refused = 0.0, 0.0, 0, 0
    while made < count:
        try:
            plan, _ = reader(Text("m", random_mission(draw)))
        except InputError:  # circles that overlap
            refused += 1
            continue
        made += 1
        path = PlannedPath("m", planned_sections(nominal_legs(plan, ())), HOME, 50.0, 15.0, tolerance_m=TOLERANCE_M)
        before = drawn(plan)
        for to in ("ardupilot", "qgc"):
            after = drawn(reader(Text("m", EXPORTS[to](path)))[0])
            apart = max(apart, distance_m(before, after), distance_m(after, before))
            longer = max(longer, abs(after.length / before.length - 1))
    overlap = f"{refused} with circles that overlap left out"
    print(f"{made} random missions exported and read back, twice each ({overlap}):")
    print(f"at most {apart:.2f} m apart (stated: {TOLERANCE_M:g} m), lengths within {100 * longer:.2f} %")


def timed(count: int) -> None:
    lines = ["QGC WPL 110", f"0 1 0 16 0 0 0 0 {HOME[0]} {HOME[1]} 400 1"]
    for number in range(1, count + 1):
        angle, radius = 0.35 * number, 200 + 3 * number
        latitude, longitude = to_geodetic_deg(radius * math.cos(angle), radius * math.sin(angle), HOME)
        lines.append(f"{number} 0 3 16 0 0 0 0 {latitude:.8f} {longitude:.8f} 100 1")
    text = Text("m", "\n".join(lines))
    start = time.process_time()
    plan, _ = PlanReader()(text)
    read = time.process_time()
    report = check_plan(plan)
    checked = time.process_time()
    found = ", ".join(sorted({finding.code for finding in report.findings})) or "nothing"
    print(f"a mission of {count} items ({len(plan.stages)} stages): read in {read - start:.2f} s of CPU, ", end="")
    print(f"checked in {checked - read:.2f} s; the check finds {found}")


def main() -> None:
    parser = options(__doc__, "exchange")
    parser.add_argument("--random", type=int, default=200)
    parser.add_argument("--items", type=int, default=700)
    asked = parser.parse_args()
    with recorded("exchange", write=asked.write):
        exported(asked.random)
        timed(asked.items)


if __name__ == "__main__":
    main()
