"""What a plan carries, through every door: cover writes it, simulate, plan, export and the page do not forget it."""

import itertools
import json
import math

import pytest
from common import ROOT, few
from common.answers import refused

from eadp.cli.main import main
from eadp.core.geometry.geodesy import to_local_m
from eadp.exchange.reader import mission_fences
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text

LIMITS = {
    "field": "x_m,y_m\n0,0\n600,0\n600,400\n0,400\n",
    "avoid": "x_m,y_m\n250,150\n330,150\n330,260\n250,260\n",
    "inside": "x_m,y_m\n-90,-90\n690,-90\n690,490\n-90,490\n",
}
PROFILE = ("--profile", "profiles/pednet-jetson-nano.yaml")
COARSE = ("--set", "step_s=0.05")
FLIGHT = (*PROFILE, "--planner", "static", *COARSE)
HEADERS = ("home", "avoid", "inside", "min-radius", "made-for", "swath", "field")


@pytest.fixture(scope="module")
def covered(tmp_path_factory):
    """A plan of a field with an obstacle, a boundary and a home."""
    folder = tmp_path_factory.mktemp("covered")
    for name, text in LIMITS.items():
        (folder / f"{name}.csv").write_text(text)
    options = ("--metres", "--swath", "80", "--home", "-50,-50", "--wind", "3,270")
    limits = ("--avoid", str(folder / "avoid.csv"), "--inside", str(folder / "inside.csv"))
    profile = ("--profile", str(ROOT / PROFILE[1]))
    out = folder / "covered.plan"
    assert main(["cover", str(folder / "field.csv"), *options, *limits, *profile, "-o", str(out)]) == 0
    return out


def headers(text):
    return {line.split()[1]: line for line in text.splitlines() if line.startswith("%:")}


def planned(eadp, path, *given):
    """The file of a plan that `eadp plan` changes, as it stands in a pipe."""
    answer = eadp("plan", *given)
    assert answer.code == 0, answer.err
    path.write_text(answer.out)
    return path


def test_cover_writes_the_mission_and_plan_keeps_it(eadp, covered):
    text = covered.read_text()
    found = headers(text)
    assert set(HEADERS) <= set(found)
    assert found["home"] == "%: home -50,-50"
    assert found["avoid"] == "%: avoid obstacle 1 250,150 330,150 330,260 250,260"
    assert found["made-for"] == "%: made-for airspeed 15 wind 3 270"
    again = eadp("plan", covered, "--format", "plan")
    assert headers(again.out) == found


@pytest.mark.usefixtures("drawn")
def test_a_flight_into_an_obstacle_or_beyond_the_boundary_is_not_completed(eadp, covered, tmp_path):
    plan, folder, text = tmp_path / "moved.plan", tmp_path / "out", covered.read_text()
    plan.write_text(text.replace(headers(text)["avoid"], "%: avoid house 100,-20 120,-20 120,500 100,500"))
    answer = eadp("simulate", plan, *FLIGHT, "-o", folder)
    assert answer.code == 1
    assert "NOT completed: entered house at " in answer.out
    summary = json.loads((folder / "summary.json").read_text())
    (entry,) = summary["obstacles"]
    assert (entry["name"], summary["completed"], summary["reserve_kept"]) == ("house", False, False)
    # a wall of 20 m across every line
    assert entry["inside_m"] > 0.99 * 20 * 4
    assert "entered house" in (folder / "report.html").read_text()
    assert eadp("simulate", plan, *FLIGHT, "--set", "obstacles=ignore").code == 0
    plan.write_text(text.replace(headers(text)["inside"], "%: inside -90,-90 500,-90 500,490 -90,490"))
    answer = eadp("simulate", plan, *FLIGHT)
    assert answer.code == 1
    assert "NOT completed: left the boundary at " in answer.out


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("%: avoid house", "no corners of an area; expected three or more"),
        ("%: avoid house 0,0 1,0", "no corners of an area"),
        ("%: avoid house height -3 0,0 9,0 9,9", "a height above the origin"),
        ("%: inside yard 0,0 9,0 9,9", "no corners of an area"),
        ("%: home 5", "expected x and y in metres"),
        ("%: made-for nothing", "no aircraft, airspeed and wind"),
    ],
)
def test_bad_headers(eadp, tmp_path, header, message):
    path = tmp_path / "bad.plan"
    path.write_text(f"{header}\n0.1; 90; x\n0, 400\n")
    answer = eadp("simulate", path)
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.startswith(f"{path}:1:")
    assert message in answer.err


# --- what is forecast is what is exported

HALVES = "x_m,y_m\n0,0\n700,0\n700,250\n350,250\n350,500\n0,500\n"
SCENARIO = """schema: eadp.scenario/1
wind: {speed_mps: 3, from_deg: 240}
reserve_soc: 0.1
start: {altitude_m: 25} # a mission starts on the ground otherwise
"""


@pytest.fixture(scope="module")
def blocks(tmp_path_factory):
    """A plan of a field of two blocks, and its scenario."""
    folder = tmp_path_factory.mktemp("blocks")
    (folder / "field.csv").write_text(HALVES)
    (folder / "scenario.yaml").write_text(SCENARIO)
    plan = folder / "blocks.plan"
    options = ("--metres", "--swath", "30", "--pattern", "zamboni", "--wind", "3,240")
    assert main(["cover", str(folder / "field.csv"), *options, "-o", str(plan)]) == 0
    return plan, folder / "scenario.yaml"


FORECAST = ("--set", "time_limit_s=1")
"""A flight of a second, for its forecast alone."""


@pytest.mark.quick(1)
@pytest.mark.parametrize("capacity_ah", [0.8, 1.2])
@pytest.mark.parametrize("to", ["qgc", "ardupilot"])
def test_the_mission_is_the_forecast(eadp, blocks, tmp_path, capacity_ah, to):
    plan, scenario = blocks
    mission = tmp_path / "mission"
    given = ("--scenario", scenario, "--set", f"battery.capacity_ah={capacity_ah}", *FORECAST)
    expected = json.loads(eadp("simulate", plan, *given, "--format", "json").out)["energy_forecast"]
    chosen = expected["parameters"]["c1"]
    assert chosen < 0 or capacity_ah > 1
    answer = eadp("export", plan, "--to", to, "--origin", "55.37,10.43", *given, "-o", mission)
    assert answer.code == 0
    spacing = read_plan(read_text(str(plan)))[0].parameters[0].text(chosen)
    assert f"at spacing = {spacing}: " in answer.err
    assert f"{expected['time_s']:.0f} s, {expected['energy_wh']:.2f} Wh" in answer.err
    flown = json.loads(eadp("simulate", mission, *given, "--format", "json").out)
    assert flown["energy_forecast"]["time_s"] == pytest.approx(expected["time_s"], rel=0.01)
    assert flown["energy_forecast"]["energy_wh"] == pytest.approx(expected["energy_wh"], rel=0.01)


LINES = "0.1; 90; x\n0, 300\n0.0005; 270; (x - 50)^2 + (y - 300)^2 - 2500\n100, 300\n0.1; 270; x - 100\n100, 0\n"


@pytest.mark.slow
def test_the_rest_of_a_mission(eadp, blocks):
    plan, scenario = blocks
    place = ("--to", "geojson", "--origin", "55.37,10.43")
    whole, rest = (
        json.loads(eadp("export", plan, *place, "--scenario", scenario, *more).out)["features"][0]["geometry"]
        for more in ((), ("--from", "3,2"))
    )
    count = len(rest["coordinates"])
    assert 0 < count < len(whole["coordinates"])
    assert rest["coordinates"] == whole["coordinates"][-count:]


def test_the_rest_goes_on_with_the_pictures_that_were_begun(eadp, tmp_path):
    plan = tmp_path / "lines.plan"
    plan.write_text(f"%: origin 55 10\n%: command 206 25 0 1 0 0 0 0\n{LINES}")
    whole, rest = (eadp("export", plan, "--to", "ardupilot", *more).out for more in ((), ("--from", "3,0")))
    assert whole.count("\t206\t25\t") == rest.count("\t206\t25\t") == 1


@pytest.mark.parametrize(
    ("place", "message"), [("x", "no stage and lap"), ("99,0", "stage 99 is not flown"), ("3,99", "a lap from 0 to")]
)
def test_a_rest_that_is_not_flown(eadp, blocks, place, message):
    assert refused(eadp("export", blocks[0], "--to", "qgc", "--origin", "55.37,10.43", "--from", place), message)


def test_fences_go_out_and_come_in(eadp, covered, tmp_path):
    mission = tmp_path / "mission.plan"
    assert eadp("export", covered, "--to", "qgc", "--origin", "55.37,10.43", "-o", mission).code == 0
    fences = json.loads(mission.read_text())["geoFence"]["polygons"]
    assert [each["inclusion"] for each in fences] == [False, True]
    text = eadp("plan", mission, "--format", "plan").out
    found = headers(text)
    shift = [float(number) for number in found["avoid"].split()[-1].split(",")]
    # the corners by the origin of the mission, the home, which lies at (-50, -50)
    assert shift == pytest.approx([250 + 50, 260 + 50], abs=0.01)
    gpx = eadp("export", covered, "--to", "gpx", "--origin", "55.37,10.43")
    assert "obstacles and boundary are not in the format gpx" in gpx.err
    rows = tmp_path / "m.waypoints"
    answer = eadp("export", covered, "--to", "ardupilot", "--origin", "55.37,10.43", "-o", rows)
    assert f"ArduPilot's fence, {rows}.fence.waypoints" in answer.err
    fence = mission_fences(read_text(f"{rows}.fence.waypoints"))
    assert [(each.inclusion, len(each.corners_deg)) for each in fence] == [(False, 4), (True, 4)]
    circle = {"circle": {"center": [55.37, 10.43], "radius": 40}, "inclusion": False, "version": 1}
    document = json.loads(mission.read_text())
    document["geoFence"] = {"circles": [circle], "polygons": [], "version": 2}
    mission.write_text(json.dumps(document))
    corners = headers(eadp("plan", mission, "--format", "plan").out)["avoid"].split()[4:]
    assert len(corners) == 32
    # around the circle, by no more than a hundredth
    radii = [math.dist(tuple(map(float, corner.split(","))), (50, 50)) for corner in corners]
    assert radii == pytest.approx([40 / math.cos(math.pi / 32)] * 32, abs=0.05)


AROUND = [(55.366, 10.425), (55.366, 10.445), (55.376, 10.445), (55.376, 10.425)]
ACROSS = [(55.370, 10.434), (55.370, 10.436), (55.3702, 10.436), (55.3702, 10.434)]
"""Corners of a boundary round a leg to the east, and of an obstacle across it, by latitude and longitude [°]."""


def fence_rows(*rings):
    """A fence file of Mission Planner: each ring's command and corners."""
    corners = [(command, len(ring), *corner) for command, ring in rings for corner in ring]
    return "QGC WPL 110\n" + "".join(
        f"{i}\t0\t0\t{command}\t{count:.6f}\t0.000000\t0.000000\t0.000000\t{lat:.6f}\t{lon:.6f}\t0.000000\t0\n"
        for i, (command, count, lat, lon) in enumerate(corners)
    )


@pytest.fixture
def leg(tmp_path):
    """A mission of a leg of 630 m to the east."""
    path = tmp_path / "leg.waypoints"
    rows = [(0, 16, 55.37, 10.43, 0), (3, 22, 0, 0, 60), (3, 16, 55.37, 10.44, 60)]
    path.write_text("QGC WPL 110\n" + "".join(
        f"{i}\t{int(i == 0)}\t{frame}\t{command}\t0\t0\t0\t0\t{lat}\t{lon}\t{height}\t1\n"
        for i, (frame, command, lat, lon, height) in enumerate(rows)
    ))  # fmt: skip
    return path


def test_a_mission_flies_beside_a_fence_of_its_own_file(eadp, leg, tmp_path):
    fence = tmp_path / "fence"
    fence.write_text(fence_rows((5001, AROUND), (5002, ACROSS)))
    wide = (leg, "--inside", fence)
    inside = planned(eadp, tmp_path / "inside.plan", *wide)
    assert "%: inside" in inside.read_text()
    assert eadp("plan", *wide, "--check").code == 0
    narrow = (*wide, "--avoid", fence)
    assert "enters obstacle 1" in eadp("plan", *narrow, "--check").out
    told = json.loads(eadp("simulate", inside, *COARSE, "--format", "json").out)
    assert (told["completed"], told["obstacles"], told["energy_forecast"]["obstacles"]) == (True, [], [])
    both = planned(eadp, tmp_path / "both.plan", *narrow)
    flown = json.loads(eadp("simulate", both, *COARSE, "--format", "json", "-o", tmp_path / "flown").out)
    assert [each["name"] for each in flown["obstacles"]] == ["obstacle 1"]
    assert flown["energy_forecast"]["obstacles"] == [{"name": "obstacle 1", "probability": 1.0}]
    # the folder has them, too
    page = tmp_path / "page.html"
    assert eadp("report", tmp_path / "flown", "-o", page).code == 0
    assert "obstacle 1" in page.read_text()
    assert (tmp_path / "flown/inputs/plan/both.plan").read_text() == both.read_text()


@pytest.mark.parametrize("forecast", [False, True])
def test_a_mission_is_exported_with_a_fence_of_its_own_file(eadp, leg, tmp_path, forecast):
    fence, scenario = tmp_path / "fence.txt", tmp_path / "scenario.yaml"
    fence.write_text(fence_rows((5001, AROUND), (5002, ACROSS)))
    scenario.write_text("schema: eadp.scenario/1\nbattery: {capacity_ah: 2.0}\n")
    more = ("--scenario", scenario) if forecast else ()
    plan = planned(eadp, tmp_path / "both.plan", leg, "--inside", fence, "--avoid", fence)
    assert "warning: the path leads through obstacle 1, first on the way to " in eadp("plan", plan).err
    given = ("export", plan, "--to", "qgc", *more)
    if forecast:  # it flies through one
        out = tmp_path / "m.plan"
        no = eadp(*given, "-o", out, "--parameters", tmp_path / "p.param")
        assert (no.code, no.out) == (1, "")
        assert "error: the flight enters obstacle 1 with a probability of 100 %: not written; expected" in no.err
        assert not {out, tmp_path / "p.param"} & {*tmp_path.iterdir()}
    answer = eadp(*given, *(("--force",) if forecast else ()))
    assert answer.code == 0
    assert ("warning: the path leads through obstacle 1" in answer.err) != forecast
    found = json.loads(answer.out)["geoFence"]["polygons"]
    rings = {each["inclusion"]: sorted(map(tuple, each["polygon"])) for each in found}
    assert len(found) == 2
    for inclusion, ring in ((True, AROUND), (False, ACROSS)):
        assert rings[inclusion] == [pytest.approx(corner, abs=1e-6) for corner in sorted(ring)]
    assert ("enters obstacle 1" in answer.err) == forecast


def test_boundaries_of_a_plan_and_beside_it_both_hold(eadp, covered, tmp_path):
    for name, (west, east) in {"half": (-200, 300), "far": (2000, 2300)}.items():
        rows = f"{west},-200\n{east},-200\n{east},600\n{west},600\n"
        (tmp_path / f"{name}.csv").write_text(f"x_m,y_m\n{rows}")
    both = headers(eadp("plan", covered, "--inside", tmp_path / "half.csv", "--format", "plan").out)["inside"]
    corners = sorted(tuple(map(float, word.split(","))) for word in both.split()[2:])
    assert corners == [(-90, -90), (-90, 490), (300, -90), (300, 490)]
    assert refused(eadp("plan", covered, "--inside", tmp_path / "far.csv"), "no ground in common")


@pytest.mark.parametrize(
    ("plan", "option", "rings", "message"),
    [
        (None, "--avoid", [(5001, AROUND)], "expected a fence; those of this file belong to --inside"),
        (None, "--inside", [(5001, [(0, 0), (0, 1), (1, 1)])], "1 polygon farther than 100 km left out"),
        ("plans/survey.plan", "--inside", [(5001, AROUND)], "is in degrees, and what it lies beside is in metres"),
    ],
)
def test_a_fence_that_is_of_no_use_is_refused(eadp, leg, tmp_path, plan, option, rings, message):
    (tmp_path / "fence.txt").write_text(fence_rows(*rings))
    assert refused(eadp("plan", plan or leg, option, tmp_path / "fence.txt"), message)


@pytest.mark.parametrize("seconds", few([130, 400], 1))
def test_the_rest_of_a_flight_is_exported_from_where_its_telemetry_ends(eadp, tmp_path, seconds):
    plan, scenario = "plans/survey.plan", "scenarios/survey.yaml"
    lines = (ROOT / "scenarios/example-telemetry.jsonl").read_text().splitlines()[:seconds]
    (tmp_path / "sofar.jsonl").write_text("\n".join(lines) + "\n")
    place = ("--to", "geojson", "--origin", "55.37,10.43", "--scenario", scenario, "--telemetry")
    answer = eadp("export", plan, *place, tmp_path / "sofar.jsonl")
    assert answer.code == 0, answer.err
    replan = eadp("replan", plan, "--scenario", scenario, "--telemetry", tmp_path / "sofar.jsonl")
    decided = json.loads(replan.out.splitlines()[-1])
    c1 = decided["parameters"]["c1"]
    spacing = read_plan(read_text(str(ROOT / plan)))[0].parameters[0].text(c1)
    assert f"in stage {decided['stage']} of lap {decided['lap']}, at spacing = {spacing}" in answer.err
    # it begins where the aircraft is, and is as long as what is forecast to be left
    places = json.loads(answer.out)["features"][0]["geometry"]["coordinates"]
    path = [to_local_m(lat, lon, (55.37, 10.43)) for lon, lat, _ in places]
    last = json.loads(lines[-1])
    assert math.dist(path[0], (last["x_m"], last["y_m"])) < 30
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(path))
    assert length == pytest.approx(decided["remaining_s"] * 14.0, rel=0.06)  # at the airspeed, in a wind of 5 m/s


@pytest.mark.slow
def test_telemetry_that_leaves_nothing_or_has_no_planner_is_refused(eadp, tmp_path):
    telemetry = ("--telemetry", "scenarios/example-telemetry.jsonl")
    place = ("export", "plans/survey.plan", "--to", "qgc", "--origin", "55.37,10.43", *telemetry)
    assert refused(eadp(*place), "needs a planner")
    static = ("--scenario", "scenarios/survey.yaml", "--set", "planner.name=static")
    assert refused(eadp(*place, *static), "leaves nothing to fly")


@pytest.mark.parametrize(("key", "place"), [("start", "[0, 0]"), ("home", "[0, 0]")])
def test_a_start_or_a_home_in_an_obstacle_is_refused(eadp, tmp_path, key, place):
    plan = tmp_path / "house.plan"
    plan.write_text("%: avoid house height 30 -20,-20 20,-20 20,20 -20,20\n1; 0; y-200\n300,200\n")
    setting = ("--set", f"{key}.position_m={place}")
    away = () if key == "start" else ("--set", "start.position_m=[-200, 200]")
    assert refused(eadp("simulate", plan, *setting, *away), f"the {key} (0, 0) lies in an obstacle")
    for free in (("obstacles=ignore",), ("vehicle.airframe.cruise_altitude_m=40",)):
        assert eadp("simulate", plan, *setting, *away, *(word for s in free for word in ("--set", s))).code == 0


def test_a_start_beyond_a_fence_is_refused(eadp, leg, tmp_path):
    (tmp_path / "fence.txt").write_text(fence_rows((5001, ACROSS)))
    plan = planned(eadp, tmp_path / "fenced.plan", leg, "--inside", tmp_path / "fence.txt")
    assert refused(eadp("simulate", plan), "the start (0, 0) lies in an obstacle or beyond the boundary")
