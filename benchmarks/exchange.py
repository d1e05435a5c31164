"""Missions of other software: lengths beside geodesics, missions exported and read back, the time to read and check.

    python benchmarks/exchange.py [--missions FOLDER] [--plant] [--random 200] [--items 700]

For each mission of the folder (WPL and QGroundControl plans): its length as a plan and as simulated without wind, its
time, and the sum of the geodesics between its waypoints with its loiters' circles, by pyproj over the file's own rows
(`pip install pyproj`). Jumps for ever are flown twice. With `--plant`, time and energy that eadp forecasts and
simulates for the aircraft of `twin/owner.yaml` beside a flight of the same mission in JSBSim (`plant.py`, `pip install
'eadp[bench]'`), at the altitudes of the mission, from the ground on. Then random missions are exported as WPL and as a
QGroundControl plan and read back: the largest distance between the two paths, and the largest difference of their
lengths. The presets' coverages of a field are exported with and without a landing: whether PX4 arms them with its
factory values, by its own checks (`tests/support/common/armed.py`), and which parameter either autopilot needs besides.
Last the CPU seconds that a mission of many items takes to be read and to be checked.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import shapely
from measured import add_option, head, line, recorded
from pyproj import Geod

import eadp
from eadp.api.inputs import Files, load_flight
from eadp.check.check import check_plan
from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m
from eadp.errors import InputError
from eadp.exchange.path import PlannedPath, planned_sections
from eadp.exchange.writer import EXPORTS
from eadp.io.plan.sources import PlanReader
from eadp.io.text.streams import Text, read_text
from eadp.models.plan.plan import Plan
from eadp.models.plan.trace import nominal_legs, trace
from eadp.models.vehicle import FixedWing
from eadp.simulation.loop import Outcome, fly

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "tests/support"))
FIELD, PLACE, PRESETS = "plans/meadow.geojson", "55.4712,10.3295", ("foam-wing", "survey-wing", "mapper", "small-wing")
HOME = (47.0, 8.0)
LAPS = 2
AIRSPEED_MPS, LOITER_RADIUS_M = FixedWing.airspeed_mps, 60.0
RADIUS_M, TOLERANCE_M, STEP_M, SIMPLIFIED_M = 20.0, 1.0, 2.0, 0.005
WAYPOINTS, RETURN, LANDS, JUMP = {16, 19, 18, 17, 21, 22, 82}, 20, {21, 85}, 177


def rows(text: str) -> tuple[tuple[float, float], list[tuple[float, ...]]]:
    """Home, and the command, p1, p2, p3, latitude and longitude of every item, read without eadp."""
    if not text.startswith("{"):
        table = [[float(word) for word in line.split()] for line in text.splitlines()[1:]]
        return (table[0][8], table[0][9]), [(r[3], *r[4:7], r[8], r[9]) for r in table[1:]]
    mission = json.loads(text)["mission"]
    simple = []
    for item in mission["items"]:
        simple += item.get("TransectStyleComplexItem", {}).get("Items", [item])
    items = [(i["command"], *((v or 0.0) for v in [*i["params"][:3], *i["params"][4:6]])) for i in simple]
    return tuple(mission["plannedHomePosition"][:2]), items


def geodesic_m(text: str) -> float:
    """The sum of the geodesics between the waypoints in the order flown, and of the circles round loiters [m]."""
    geod, (home, items) = Geod(ellps="WGS84"), rows(text)
    left = {i: (LAPS - 1 if item[2] < 0 else int(item[2])) for i, item in enumerate(items) if item[0] == JUMP}
    here, length, i = home, 0.0, 0
    while i < len(items):
        command, p1, _, p3, *place = items[i]
        if command == JUMP and left[i] > 0:
            left[i] -= 1
            i = int(p1) - 1
            continue
        if (command in WAYPOINTS and any(place)) or command == RETURN:
            there = home if command == RETURN else (place[0], place[1])
            length += geod.inv(here[1], here[0], there[1], there[0])[2]
            here = there
            length += {18: 2 * math.pi * abs(p3 if abs(p3) > 1 else LOITER_RADIUS_M) * p1, 19: AIRSPEED_MPS * p1}.get(
                int(command), 0.0
            )
        if command == RETURN or command in LANDS:
            break
        i += 1
    return length


def reference(folder: Path) -> None:
    titles = "plan over geodesics", "plan [m]", "geodesics [m]", "flown [m]", "time [s]"
    print(head("mission", "stages", *titles))
    for path in sorted(folder.iterdir()):
        text = read_text(str(path))
        try:
            plan, _ = PlanReader(laps=LAPS)(text)
        except InputError as error:
            print(line(path.name, f"refused: {error.faults[0].message}", *[""] * 5))
            continue
        length, straight = sum(leg.length_m for leg in nominal_legs(plan, ())), geodesic_m(text.body)
        calm = {"step_s": 0.05, "wind.speed_mps": 0.0}
        summary = eadp.simulate(plan, overrides=calm, warn=lambda _: None).summary
        figures = length, straight, summary["distance_m"], summary["duration_s"]
        lengths = f"{length / straight:.3f}", *(f"{figure:.0f}" for figure in figures)
        print(line(path.name, len(plan.stages), *lengths))


def plant_flight(plan: Plan) -> tuple[bool, float, float]:
    """Whether JSBSim's aeroplane completes a mission, its time [s] and its energy [Wh]."""
    from plant import ALTITUDE_M, SAMPLE_S, PlanFlight, battery_w

    flight = PlanFlight(plan, (), (0.0, 0.0), (0.0, 0.0))
    energy_j, time_s = 0.0, 0.0
    flight.plane.altitude_target_m = ALTITUDE_M + (plan.stages[0].altitude_m or 0.0)
    for sample in flight.samples():
        # the plant trims at its altitude, which is the ground here
        flight.plane.altitude_target_m = ALTITUDE_M + (flight.executor.stage.altitude_m or 0.0)
        energy_j += float(battery_w(sample.shaft_w)) * SAMPLE_S
        time_s = sample.time_s
    return flight.executor.complete, time_s, energy_j / 3600


def plant(folder: Path) -> None:
    print(head("mission", "time in the plant [s]", "simulated", "energy in the plant [Wh]", "forecast", "simulated"))
    owner = {"vehicle": str(HERE / "twin/owner.yaml"), "vehicle.airframe.max_climb_rate_mps": 2.5}
    keys = {**owner, "battery.capacity_ah": 20.0, "wind.speed_mps": 0.0, "planner.name": "static", "step_s": 0.02}
    keys_of = Files().scenario(None, keys).keys
    reader = replace(PlanReader.of(keys_of.vehicle.airframe, keys_of.battery), laps=LAPS)
    for path in sorted(folder.iterdir()):
        try:
            inputs = load_flight(reader(read_text(str(path)))[0], overrides=keys)
        except InputError:
            continue
        forecast, outcome = inputs.preflight().forecast, Outcome()
        for _ in fly(inputs.world, inputs.flight(), outcome):
            pass
        completed, time_s, energy_wh = plant_flight(inputs.world.plan)
        ratios = forecast.energy_wh / energy_wh, outcome.totals.energy_j / 3600 / energy_wh
        name = path.name if completed else f"{path.name}, not completed"
        off = [f"{100 * (ratio - 1):+.1f} %" for ratio in (outcome.duration_s / time_s, *ratios)]
        print(line(name, f"{time_s:.1f}", off[0], f"{energy_wh:.3f}", *off[1:]))


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
    print(
        f"\n{made} random missions exported and read back, twice each ({refused} with circles that overlap left out):"
    )
    print(f"  at most {apart:.2f} m apart (stated: {TOLERANCE_M:g} m), lengths within {100 * longer:.2f} %")


def armed() -> None:
    """Whether exports of the presets, with a landing and without, are armed by PX4, and what is to be set besides."""
    from common.armed import px4_refuses

    print()
    print(head("preset", "ends with", "energy [Wh]", "PX4", "PX4 with MIS_TKO_LAND_REQ 0", "ArduPilot"))
    for preset in PRESETS:
        for ends, given in (("a landing", {"landing": f"{PLACE},250"}), ("the return", {"home": PLACE})):
            options = eadp.CoverageOptions(swath_m=60.0, altitude_m=80.0, pattern="dubins", wind="4,240", **given)
            vehicle = HERE.parent / f"vehicles/{preset}.yaml"
            found = eadp.cover(HERE.parent / FIELD, options, vehicle=vehicle, warn=lambda _: None)
            with tempfile.TemporaryDirectory() as folder:
                mission = Path(folder) / "m.plan"
                eadp.export(found.plan, "px4", out=mission, warn=lambda _: None)
                armed = [", ".join(px4_refuses(mission, required=value)) or "armed" for value in (2, 0)]
            # ArduPilot's arming check of a mission: DO_LAND_START needs RTL_AUTOLAND
            starts = "\t189\t" in eadp.export(found.plan, "ardupilot", warn=lambda _: None)
            other = "armed with RTL_AUTOLAND 1 or 2" if starts else "armed"
            print(line(preset, ends, f"{found.report.full.energy_wh:.2f}", *armed, other))


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
    print(f"\na mission of {count} items ({len(plan.stages)} stages): read in {read - start:.2f} s of CPU, ", end="")
    print(f"checked in {checked - read:.2f} s; the check finds {found}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--missions", type=Path, help="folder of missions")
    parser.add_argument("--plant", action="store_true", help="fly them in JSBSim, too")
    parser.add_argument("--random", type=int, default=200)
    parser.add_argument("--items", type=int, default=700)
    add_option(parser, "exchange")
    options = parser.parse_args()
    with recorded("exchange", write=options.write):
        _print(options)


def _print(options: argparse.Namespace) -> None:
    if options.missions:
        reference(options.missions)
        if options.plant:
            plant(options.missions)
    exported(options.random)
    armed()
    timed(options.items)


if __name__ == "__main__":
    main()
