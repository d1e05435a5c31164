"""Plans as missions and maps: read back they are the same path, and other software takes them."""

import itertools
import json
import math
import re
import xml.etree.ElementTree as ET

import pytest
import shapely
from common import ROOT, draws
from common.answers import refused
from common.terrains import write_degrees
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m
from eadp.errors import InputError
from eadp.exchange.autopilot import wanted_parameters
from eadp.exchange.path import NUMBER_LIMIT, WITH_ITEMS, PlannedPath, planned_sections
from eadp.exchange.writer import EXPORTS, held_radius_m, mission_items
from eadp.io.plan.reader import read_plan
from eadp.io.plan.sources import PlanReader
from eadp.io.text.streams import Text, read_text
from eadp.models.airspace import Airspace
from eadp.models.battery import Battery
from eadp.models.plan.trace import nominal_legs, trace
from eadp.models.vehicle import FixedWing

HOME = (47.0, 8.0)
RADIUS_M = 20.0
READER = PlanReader(turn_radius_m=RADIUS_M)
TOLERANCE_M, ROUNDED_M, STEP_M = 1.0, 0.05, 2.0
SAME_LENGTH = 0.005
LINES = "0.1; 90; x\n0, 300\n0.0005; 270; (x - 50)^2 + (y - 300)^2 - 2500\n100, 300\n0.1; 270; x - 100\n100, 0\n"
LANDING = f"%: altitude 60\n{LINES}%: altitude 0\n%: command 21 0 0 0 0 0 0 0\n0.1; 270; x - 100\n100, -400\n"


def path_of(plan, parameters=(), **options):
    given = {"altitude_m": 50.0, "airspeed_mps": 15.0, "tolerance_m": TOLERANCE_M} | options
    sections = planned_sections(nominal_legs(plan, parameters))
    return PlannedPath("a path", sections, plan.site.origin_deg or HOME, **given)


def drawn(plan, origin, parameters=()):
    """The path of a plan as a line in the plane at an origin."""
    points = [(point.x_m, point.y_m) for point in trace(plan, parameters, STEP_M)]
    own = plan.site.origin_deg or origin
    return shapely.LineString([to_local_m(*to_geodetic_deg(*point, own), origin) for point in points])


def read_back(path, to):
    return READER(Text("m", EXPORTS[to](path)))


def same(plan, back, parameters=()):
    origin = plan.site.origin_deg or HOME
    there, here = drawn(plan, origin, parameters), drawn(back, origin)
    assert shapely.hausdorff_distance(there, here) < TOLERANCE_M + ROUNDED_M
    assert here.length == pytest.approx(there.length, rel=SAME_LENGTH)
    return True


KINDS = [
    (16, 0, 0, 0), (16, 0, 0, 0), (16, 0, 5, 0), (16, 0, 0, 40), (18, 0.5, 0, -60), (18, 1, 0, 40), (18, 2.3, 0, 90),
]  # fmt: skip
coordinates = st.integers(-7000, 7000).map(lambda i: i / 10)
items = st.tuples(st.sampled_from(KINDS), coordinates, coordinates)


@settings(max_examples=draws(0.4))
@given(flown=st.lists(items, min_size=1, max_size=7), to=st.sampled_from(WITH_ITEMS))
def test_what_is_exported_reads_back_as_the_same_path(flown, to):
    """A loiter round the place of a neighbour is left out: where it is left turns with a millimetre."""
    places = [(0.0, 0.0), *(flown_at[1:] for flown_at in flown)]
    radii = [0.0, *(abs(item[3]) if item[0] == 18 else 0.0 for item, *_ in flown)]
    for (one, near), (other, far) in itertools.pairwise(zip(places, radii, strict=True)):
        assume(math.dist(one, other) > max(near, far) + 1)
    rows = ["QGC WPL 110", f"0 1 0 16 0 0 0 0 {HOME[0]} {HOME[1]} 400 1"]
    for number, ((command, p1, p2, p3), east, north) in enumerate(flown, 1):
        lat, lon = to_geodetic_deg(east, north, HOME)
        rows.append(f"{number} 0 3 {command} {p1} {p2} {p3} 1 {lat:.9f} {lon:.9f} 50 1")
    try:
        plan, findings = READER(Text("m", "\n".join(rows)))
    except InputError:
        assume(False)
    # turns without room have radii for which another reader's turns may have none either
    assume(not findings)
    back, _ = read_back(path_of(plan), to)
    assert same(plan, back)


@pytest.mark.slow
def test_a_coverage_reads_back_as_the_same_path(eadp, tmp_path):
    out = tmp_path / "meadow.plan"
    assert eadp("cover", "plans/meadow.geojson", "--min-radius", "20", "--swath", "40", "-o", out).code == 0
    plan, _ = read_plan(read_text(str(out)))
    for c1 in {plan.hull(0).hi, plan.hull(0).lo} if plan.path_count else {0.0}:
        for to in WITH_ITEMS:
            back, _ = read_back(path_of(plan, (c1,)), to)
            assert same(plan, back, (c1,))


def test_half_and_whole_turns_are_loiters_and_lines_have_their_ends():
    plan, _ = read_plan(Text("p", LINES))
    exported = mission_items(path_of(plan))
    points = [to_local_m(*item.parameters[4:6], HOME) for item in exported]
    (loiter,) = (item for item in exported if item.command == 18)
    assert loiter.parameters[:4] == (0.5, 0, pytest.approx(50), 1)
    assert to_local_m(*loiter.parameters[4:6], HOME) == pytest.approx((50, 300), abs=1e-3)
    for end in ((0, 200), (0, 300), (100, 300), (100, 0)):
        assert min(math.dist(end, point) for point in points) < 1e-3
    twice, _ = READER(Text("m", EXPORTS["ardupilot"](path_of(plan))))
    assert sum(item.command == 18 for item in mission_items(path_of(twice))) == 1


@pytest.mark.parametrize("then", ["altitude 90", "airspeed 9", f"command 206 9{6 * ' 0'}", f"command 31{7 * ' 0'}"])
def test_turns_round_one_centre_keep_what_they_are_flown_with(then):
    turn = "0.0005; 270; (x - 50)^2 + (y - 300)^2 - 2500\n0, 300\n"
    text = f"%: altitude 60\n0.1; 90; x\n0, 300\n{2 * turn}%: {then}\n{turn}0.1; 90; x\n0, 900\n"
    exported = mission_items(path_of(read_plan(Text("p", text))[0]))
    circles = [(item.command, item.parameters[6]) for item in exported if item.command in (18, 31)]
    assert circles == [(18, 60), (31 if "31" in then else 18, 90 if "altitude" in then else 60)]


@pytest.mark.parametrize("tolerance_m", [0.2, 1.0, 5.0])
def test_turns_of_px4_are_waypoints_within_the_tolerance(tolerance_m):
    """PX4 refuses a mission with LOITER_TURNS (18), and one whose first position is far away, as 0, 0 is."""
    plan, _ = read_plan(Text("p", LINES))
    home = to_geodetic_deg(-400, 0, HOME)
    path = path_of(plan, home_deg=home, tolerance_m=tolerance_m)
    mission = json.loads(EXPORTS["px4"](path))["mission"]
    assert mission["firmwareType"] == 12
    assert {item["command"] for item in mission["items"]} == {16, 20, 22}
    line = drawn(plan, HOME)
    placed = [item["params"][4:6] for item in mission["items"] if item["command"] in (16, 22)]  # the take-off, too
    places = [to_local_m(*place, HOME) for place in placed]
    off_m = [line.distance(shapely.Point(place)) for place in places]
    assert max(off_m) < tolerance_m + ROUNDED_M
    flown = shapely.LineString(places)
    assert shapely.hausdorff_distance(shapely.segmentize(flown, STEP_M), line) < tolerance_m + ROUNDED_M
    turn = [section.arc for section in path.sections if section.arc]
    needed = sum(arc.sweep_rad / (2 * math.acos(arc.radius_m / (arc.radius_m + tolerance_m))) for arc in turn)
    assert needed <= sum(off > 1e-3 for off in off_m) < needed + len(turn), "as few as the tolerance needs"


def test_lines_are_flown_to_their_ends():
    """ArduPilot leaves a waypoint before a loiter 39 to 77 m early, unless its acceptance radius (p2) is small."""
    plan, _ = read_plan(Text("p", LINES.replace("2500", "2496").replace("x - 100", "x - 99.96")))
    for to in ("qgc", "ardupilot"):
        again, _ = READER(Text("m", EXPORTS[to](path_of(plan))))
        flown = mission_items(path_of(again))
        (k,) = (k for k, item in enumerate(flown) if item.command == 18)
        assert flown[k - 1].parameters[:2] == (0, 2)
        # an aircraft that comes out of a loiter beyond the next waypoint may not have to turn back to it
        assert flown[k + 1].parameters[:2] == (0, 0)
        assert flown[k].parameters[2] == 50  # of 49.96: ArduPilot holds whole metres


@pytest.mark.parametrize("model", ["fixed-wing", "power-curve", "paper"])
def test_the_altitude_is_the_plans_whatever_the_airframe(eadp, tmp_path, model):
    """An aircraft fitted to a log holds another altitude; one that holds its own overrules no plan."""
    plan, out = tmp_path / "high.plan", tmp_path / "m.waypoints"
    plan.write_text("%: origin 55.37 10.43\n%: altitude 60\n" + LINES)
    keys = [f"vehicle.airframe.model={model}", "battery.capacity_ah=2"]
    keys += ["vehicle.airframe.cruise_altitude_m=100"] if model != "paper" else []
    options = [word for key in keys for word in ("--set", key)]
    given = ("export", plan, "--to", "ardupilot", "--scenario", ROOT / "scenarios/survey.yaml", *options, "-o", out)
    if model == "paper":
        assert refused(eadp(*given), "the airframe paper holds its own", "--altitude")
        assert not out.exists()
        given = (*given, "--altitude", "60")
    answer = eadp(*given)
    assert answer.code == 0, answer.err
    rows = [line.split("\t") for line in out.read_text().splitlines()[2:]]
    assert {row[10] for row in rows if row[3] in ("16", "18")} == {"60"}


ON, OFF = "%: command 206 20 0 1 0 0 0 0\n", "%: command 206 0 0 1 0 0 0 0\n"


def pictured(radius_m, last=""):
    """Two lines of 300 m with pictures, and the half turn between them."""
    x = 2 * radius_m
    turn = f"0.0005; 270; (x - {radius_m})^2 + (y - 300)^2 - {radius_m}^2\n{x}, 300\n"
    text = f"{ON}0.1; 90; x\n0, 300\n{OFF}{turn}{ON}0.1; 270; x - {x}\n{x}, 0\n{last and OFF + last}"
    return read_plan(Text("p", text))[0]


@pytest.mark.parametrize("radius_m", [12, 20, 40, 120])
@pytest.mark.parametrize(("to", "last"), [("px4", ""), ("px4", "0.1; 270; x - 0\n0, -900\n"), ("ardupilot", "")])
def test_px4_ends_pictures_beyond_the_line(radius_m, to, last):
    """It does what follows a waypoint from the switching distance before it on: 2.24 s of the ground speed."""
    last = last.replace("x - 0\n0", f"x - {2 * radius_m}\n{2 * radius_m}")
    path = path_of(pictured(radius_m, last), airspeed_mps=14.0)
    here, ends, off_at, line_end = (0.0, 0.0), [(0, 300), (2 * radius_m, 0)], [], None
    for item in mission_items(path, px4=to == "px4"):
        if item.placed:
            here = to_local_m(*item.position_deg, HOME)
        if item.command == 206 and item.parameters[0] > 0:
            line_end = ends.pop(0)
        elif item.command == 206 and item.parameters[0] == 0:
            off_at.append(math.dist(here, line_end))
            line_end = None
    assert line_end is None, "pictures end"
    if to == "ardupilot":
        assert off_at == pytest.approx([0, 0], abs=1e-3), "it flies lines to their ends"
    else:
        assert len(off_at) == (1 if 2 * radius_m < 47 else 2), "pictures go on to a line that is near"
        assert min(off_at) > 2.24 * (14 + 7)
        assert max(off_at) < 2.24 * (14 + 7) + max(0.8 * radius_m, 30)


@pytest.mark.parametrize("ends", [(), (0,), (9, 0)])
@pytest.mark.parametrize("to", WITH_ITEMS)
def test_pictures_are_on_along_the_last_line_and_off_after_it(ends, to):
    on, *off = (f"1 0 2 206 {distance} 0 1 0 0 0 0 1\n" for distance in (25, *ends))
    rows = ["QGC WPL 110\n0 1 0 16 0 0 0 0 47 8 400 1\n", on, "2 0 3 16 0 0 0 0 47.003 8 60 1\n", *off]
    plan, _ = READER(Text("m", "".join(rows)))
    exported = [(item.command, item.parameters[0]) for item in mission_items(path_of(plan), px4=to == "px4")]
    assert exported == [(16, 0), (206, 25), (16, 0), (206, 0)]
    for each in (plan, read_back(path_of(plan), to)[0]):
        assert [command[:2] for stage in each.stages for command in stage.commands] == [(206, 25)]


def test_a_waypoint_beyond_the_path_is_within_the_boundary():
    for boundary, more in ((), 1), ((((-50, -40), (100, -40), (100, 400), (-50, 400)),), 0):
        path = path_of(pictured(40), airspeed_mps=14.0, airspace=Airspace(boundary=boundary))
        *_, before, off = mission_items(path, px4=True)
        assert off.command == 206
        beyond_m = math.dist(to_local_m(*before.position_deg, HOME), (80, 0))
        assert (beyond_m > 47) if more else (beyond_m < 1e-3)


OF_ARDUPILOT = {
    "AIRSPEED_CRUISE": 15, "ROLL_LIMIT_DEG": 40, "WP_RADIUS": 27, "WP_LOITER_RAD": 27, "BATT_CAPACITY": 1200,
}  # fmt: skip
OF_PX4 = {
    "FW_AIRSPD_TRIM": 15, "FW_R_LIM": 40, "NAV_ACC_RAD": 2, "NAV_LOITER_RAD": 27, "BAT1_CAPACITY": 1200,
    "NPFG_SW_DST_MLT": 0.1, "MIS_TKO_LAND_REQ": 0,
}  # fmt: skip


@pytest.mark.parametrize(
    ("to", "ending", "expected"),
    [("ardupilot", ".param", OF_ARDUPILOT), ("qgc", ".param", OF_ARDUPILOT), ("px4", ".params", OF_PX4)],
)
def test_the_parameters_of_the_autopilot(eadp, tmp_path, to, ending, expected):
    """The radius is that of a bank of 40° at 15 m/s; the battery in mAh."""
    settings = ["vehicle.airframe.max_bank_deg=40", "battery.capacity_ah=1.2"]
    given = ["--scenario", ROOT / "scenarios/survey.yaml", *(word for each in settings for word in ("--set", each))]
    path, plan, out = tmp_path / f"p{ending}", ROOT / "plans/survey.plan", tmp_path / "m"
    to = ("--to", to, "--origin", "55.37,10.43", "-o", out, "--parameters")
    other = tmp_path / {".param": "p.params", ".params": "p.param"}[ending]
    assert refused(eadp("export", plan, *given, *to, other), "is no file of parameters for --to", f"a name in {ending}")
    assert refused(eadp("export", plan, *given, *to, tmp_path / "p.txt"), "is no file of parameters")
    assert refused(eadp("export", plan, *to, path), "needs an aircraft and a battery", "--scenario")
    assert not out.exists()
    answer = eadp("export", plan, *given, *to, path)
    assert answer.code == 0, answer.err
    rows = [line.replace(",", "\t").split("\t") for line in path.read_text().splitlines() if line[0] != "#"]
    found = {row[-3 if ending == ".params" else 0]: float(row[-2 if ending == ".params" else 1]) for row in rows}
    assert found.items() >= expected.items()
    assert all(f"{name} {value:g}" in answer.err for name, value in expected.items())
    if ending == ".params":  # MAVLink's types: INT32 is 6, a number in single precision 9
        assert {row[2] for row in rows if row[4] == "6"} == {"MIS_TKO_LAND_REQ"}


@pytest.mark.parametrize(("down_m", "slope_deg"), [(400, 8.6), (700, 4.9), (1200, 2.9)])
def test_a_landing_needs_its_slope_and_no_leave_to_do_without(down_m, slope_deg):
    """Of 60 m: PX4 arms no mission whose approach is steeper than FW_LND_ANG, and as delivered none without."""
    plan, _ = read_plan(Text("p", LANDING.replace("100, -400", f"100, -{down_m}").replace("60", "60.0")))
    wanted = {each.name: each for each in wanted_parameters(plan, FixedWing(), Battery(), ardupilot=False)}
    assert "MIS_TKO_LAND_REQ" not in wanted
    steepest = wanted["FW_LND_ANG"]
    assert steepest.value == pytest.approx(slope_deg)
    assert steepest.difference("FW_LND_ANG", slope_deg + 1) == ""
    said = f"FW_LND_ANG is 2, less than {slope_deg:g}, so that the mission is not armed"
    assert steepest.difference("FW_LND_ANG", 2.0) == said


@pytest.mark.parametrize(("ardupilot", "altitude"), [(True, "RTL_ALTITUDE"), (False, "RTL_RETURN_ALT")])
def test_a_return_is_as_high_as_the_way_home_and_lands_where_the_mission_does(ardupilot, altitude):
    """Of 60 m: by default as high as the plan. ArduPlane does not arm a mission that lands with RTL_AUTOLAND 0."""
    made = []
    for text, home_m in ((LINES, None), (LANDING, None), (LANDING, 123.4)):
        plan, _ = read_plan(Text("p", text if text == LANDING else f"%: altitude 60\n{text}"))
        wanted = wanted_parameters(plan, FixedWing(), Battery(), ardupilot=ardupilot, home_altitude_m=home_m)
        made.append({each.name: each for each in wanted})
    assert [wanted[altitude].value for wanted in made] == [60, 60, 124]
    assert made[2][altitude].difference(altitude, 130) == ""
    assert made[2][altitude].difference(altitude, 100) == f"{altitude} is 100, less than 124"
    lands = {"RTL_AUTOLAND": 2, "RTL_TYPE": 1}
    assert [{name: each[name].value for name in lands if name in each} for each in made] == [
        {},
        *[{"RTL_AUTOLAND": 2} if ardupilot else {"RTL_TYPE": 1}] * 2,
    ]
    if ardupilot:
        assert made[2][altitude].difference("ALT_HOLD_RTL", 12400) == ""
        assert made[2][altitude].difference("ALT_HOLD_RTL", 9000) == "ALT_HOLD_RTL is 9000, less than 12400"


@pytest.mark.parametrize(
    ("radius_m", "held_m"), [(82.16, 82), (72.76, 73), (254.9, 255), (255.6, 260), (1234.0, 1230), (4.5, 4)]
)
def test_radii_are_those_that_ardupilot_holds(radius_m, held_m):
    """A byte, in metres or in tens of metres."""
    assert held_radius_m(radius_m) == held_m
    assert held_m <= 255 or held_m % 10 == 0


def test_home_adds_take_off_and_return_and_stages_their_settings():
    text = f"%: altitude 60\n{LINES}"
    plan, _ = read_plan(Text("p", text))
    home = to_geodetic_deg(-400, 0, HOME)
    exported = mission_items(path_of(plan, home_deg=home, trigger_distance_m=25.0))
    assert [exported[0].command, exported[-1].command] == [22, 20]
    assert [item.parameters[0] for item in exported if item.command == 206] == [25, 0]
    assert {item.parameters[6] for item in exported if item.command in (16, 18)} == {60}
    assert exported[0].parameters[6] == 50, "ArduPilot climbs straight ahead to there"
    back, _ = read_back(path_of(plan, home_deg=home), "qgc")
    assert back.site.origin_deg == pytest.approx(home)
    assert back.stages[-1].trigger_at(()) == (0, 0)


@pytest.mark.parametrize("elsewhere", [False, True])
def test_px4_takes_off_along_the_path_or_towards_its_start_from_elsewhere(elsewhere):
    plan, _ = read_plan(Text("p", f"%: command 22 10 0 0 0 0 0 30\n{LINES}"))
    home = to_geodetic_deg(-400, 0, HOME) if elsewhere else None
    items = mission_items(path_of(plan, home_deg=home), px4=True)
    takeoff, *waypoints = [to_local_m(*item.parameters[4:6], HOME) for item in items if item.command in (22, 16)]
    assert items[0].command == 22
    assert takeoff == pytest.approx(waypoints[0], abs=0.01)
    assert items[0].parameters[6] == 30


def test_commands_and_speeds_are_written_back():
    body = (
        "QGC WPL 110\n0 1 0 16 0 0 0 0 47 8 400 1\n1 0 2 530 0 2 0 0 0 0 0 1\n2 0 3 16 0 0 0 0 47.003 8 60 1\n"
        "3 0 2 178 0 21 -1 0 0 0 0 1\n4 0 2 206 25 0 1 0 0 0 0 1\n5 0 3 16 0 0 0 0 47.003 8.006 80 1\n"
    )
    plan, _ = READER(Text("m", body))
    for to in ("qgc", "ardupilot"):
        back, _ = read_back(path_of(plan), to)
        for each in (plan, back):
            assert [command[0] for stage in each.stages for command in stage.commands] == [530, 206]
            assert (each.stages[0].altitude_m, each.stages[-1].altitude_m) == (60, 80)
            # calibrated for true, 400 m above the sea: 0.9616 of the density
            true_mps = pytest.approx(21 / math.sqrt(0.96217), rel=1e-4)
            assert (each.stages[0].airspeed_mps, each.stages[-1].airspeed_mps) == (None, true_mps)


@pytest.mark.parametrize(
    ("ground", "density", "share", "beside"),
    [
        ("", 1.225, 1.0, None),
        ("", 1.0065, 0.9064, None),
        ("%: ground 2000\n", 1.225, 0.9064, None),
        ("", 1.225, 0.9064, 2000),
        ("%: ground 2000\n", 1.225, 0.9064, 0),
    ],
)
def test_an_autopilot_gets_calibrated_airspeeds(eadp, tmp_path, ground, density, share, beside):
    """At 2000 m the standard atmosphere has 1.0065 kg/m³, √(ρ/ρ0) is 0.9064; the forecast is of the true airspeed.

    The height is the plan's, else that of a terrain beside it.
    """
    plan = tmp_path / "p.plan"
    plan.write_text(f"%: origin 47 8\n{ground}0.1; 90; x\n0, 300\n%: airspeed 18\n0.1; 90; x\n0, 600\n")
    given = ["--scenario", ROOT / "scenarios/survey.yaml", "--set", f"vehicle.airframe.air_density_kgpm3={density}"]
    given += ["--set", "energy=null"]
    if beside is not None:
        pytest.importorskip("rasterio")
        write_degrees(tmp_path / "ground.tif", lambda *_: float(beside), (46.98, 7.98), (47.04, 8.02))
        plan.write_text(eadp("plan", plan, "--terrain", tmp_path / "ground.tif").out)
    for to, ending, name in (("ardupilot", ".param", "AIRSPEED_CRUISE"), ("px4", ".params", "FW_AIRSPD_TRIM")):
        out, parameters = tmp_path / f"m-{to}", tmp_path / f"p{ending}"
        answer = eadp("export", plan, *given, "--to", to, "-o", out, "--parameters", parameters)
        assert answer.code == 0, answer.err
        written = read_text(str(parameters)).body
        assert float(re.search(rf"{name}[,\t]([0-9.]+)", written)[1]) == pytest.approx(15 * share, abs=1e-3)
        held = [float(row) for row in re.findall(r"\t178\t0\t([0-9.]+)\t", out.read_text())] or [
            each["params"][1] for each in json.loads(out.read_text())["mission"]["items"] if each["command"] == 178
        ]
        assert held == pytest.approx([15 * share, 18 * share], abs=1e-3)
        # read back for the same aircraft, it flies at the true airspeeds again
        wing = FixedWing(air_density_kgpm3=density)
        back, _ = PlanReader.of(wing, Battery())(read_text(str(out)))
        assert [back.stages[i].airspeed_mps for i in (0, -1)] == pytest.approx([15, 18], abs=1e-4)


@pytest.mark.parametrize("to", ["qgc", "ardupilot"])
def test_the_take_off_has_a_pitch_and_the_mission_its_airspeed_from_the_start(to):
    plan, _ = read_plan(Text("p", LINES))
    path = path_of(plan, home_deg=to_geodetic_deg(-400, 0, HOME), stated_mps=17.0, climb_deg=11.0)
    first, speed, *others = mission_items(path)
    assert (first.command, first.parameters[0]) == (22, 11.0)
    assert (speed.command, *speed.parameters[:2]) == (178, 0, 17)
    assert 178 not in [item.command for item in others]
    back, _ = read_back(path, to)
    assert {stage.airspeed_mps for stage in back.stages} == {17}
    # what is read is written again as it was
    given = {"home_deg": back.site.origin_deg, "climb_deg": 11.0}
    again = [item for item in mission_items(path_of(back, **given)) if item.command in (22, 178)]
    assert [(item.command, *item.parameters[:2]) for item in again] == [(22, 11.0, 0), (178, 0, 17)]


def test_an_airspeed_that_ends_is_commanded_and_read_back():
    *rows, path, trigger = LINES.splitlines(keepends=True)
    plan, _ = read_plan(Text("p", "".join(["%: airspeed 18\n", *rows, "%: airspeed default\n", path, trigger])))
    commanded = [item.parameters[1] for item in mission_items(path_of(plan)) if item.command == 178]
    assert commanded == [18, -2]
    back, _ = read_back(path_of(plan), "ardupilot")
    assert (back.stages[0].airspeed_mps, back.stages[-1].airspeed_mps) == (18, None)


# --- maps and Paparazzi -----------------------------------------------------------------------------------------------


def test_maps_and_tracks_lie_on_the_path():
    plan, _ = read_plan(Text("p", LINES))
    path = path_of(plan)
    line = drawn(plan, HOME)
    kml = ET.fromstring(EXPORTS["kml"](path))
    text = kml.find(".//{http://www.opengis.net/kml/2.2}coordinates").text
    from_kml = [tuple(map(float, part.split(",")))[:2] for part in text.split()]
    geometry = json.loads(EXPORTS["geojson"](path))["features"][0]["geometry"]
    assert geometry["type"] == "LineString"
    gpx = ET.fromstring(EXPORTS["gpx"](path))
    tracked = gpx.iter("{http://www.topografix.com/GPX/1/1}trkpt")
    from_gpx = [(float(point.get("lon")), float(point.get("lat"))) for point in tracked]
    for points in (from_kml, [point[:2] for point in geometry["coordinates"]], from_gpx):
        shown = shapely.LineString([to_local_m(lat, lon, HOME) for lon, lat in points])
        assert shapely.hausdorff_distance(shapely.segmentize(shown, STEP_M), line) < TOLERANCE_M + ROUNDED_M


@pytest.fixture
def root():
    """Paparazzi's flight plan of two lines and a half circle."""
    text = EXPORTS["paparazzi"](path_of(read_plan(Text("p", LINES))[0]))
    assert text.count("<!DOCTYPE flight_plan SYSTEM") == 1
    return ET.fromstring(text)


def test_a_flight_plan_of_paparazzi_has_its_structure(root):
    assert [each.tag for each in root] == ["header", "waypoints", "modules", "blocks"]
    assert {"lat0", "lon0", "max_dist_from_home", "ground_alt", "security_height", "alt"} < set(root.keys())
    names = {each.get("name") for each in root.iter("waypoint")}
    used = {word.split(")")[0].split(",")[0] for call in root.iter("call") for word in call.get("fun").split("WP_")[1:]}
    assert used | {"HOME"} <= names
    assert len(root.findall(".//block")) == 4


def test_gains_of_paparazzi_are_those_of_the_plan(root):
    """The two fields, each from its own φ, point the same way near the path."""
    gain_line, gain_circle = 0.1, 0.0005
    values = {each.get("var"): float(each.get("value")) for each in root.iter("set")}

    def angle(value, gradient):
        # the correction over the tangent, |k φ ∇φ| / |∇φ|, is the tangent of the angle to the path
        return math.atan(value * gradient)

    for off in (0.5, 2.0, -3.0):
        ours = angle(gain_line * off, 1.0)
        assert angle(0.01 * values["gvf_line_par.ke"] * off, 1.0) == pytest.approx(ours)
        distance = 50 + off
        ours = angle(gain_circle * (distance**2 - 50**2), 1.0)
        assert angle(values["gvf_ellipse_par.ke"] * ((distance / 50) ** 2 - 1), 1.0) == pytest.approx(ours, rel=1e-5)
    directions = [each.get("fun") for each in root.iter("call_once") if "direction" in each.get("fun")]
    assert directions == ["gvf_set_direction(1)"]  # clockwise


def test_arcs_of_paparazzi_end_where_they_say(root):
    calls = [call.get("until") for call in root.iter("call") if call.get("until")]
    assert len(calls) == 2
    angle = math.pi  # clockwise round (50, 300) from (0, 300)
    for until, end in zip(calls, (math.pi / 2, 0.0), strict=True):
        passed = lambda a, until=until: eval(  # noqa: E731
            until, {"GetPosX": lambda: 50 + 50 * math.cos(a), "GetPosY": lambda: 300 + 50 * math.sin(a)}
        )
        while angle > end + 0.01:
            assert not passed(angle)
            angle -= 0.005
        assert passed(end - 0.01)


def test_paparazzi_has_no_more_numbers_than_a_byte():
    rows = ["QGC WPL 110", "0 1 0 16 0 0 0 0 47 8 400 1"]
    rows += [f"{k} 0 3 16 0 0 0 0 {47 + 0.002 * k:.6f} {8 + 0.003 * (k % 2):.6f} 50 1" for k in range(1, 200)]
    plan, _ = READER(Text("m", "\n".join(rows)))
    with pytest.raises(InputError, match=f"at most {NUMBER_LIMIT}"):
        EXPORTS["paparazzi"](path_of(plan))


# --- the command ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_writes_every_format_at_the_parameters_given(eadp, tmp_path):
    lengths = {}
    for c1 in ("0", "-900"):
        for to in EXPORTS:
            out = tmp_path / f"out{c1}.{to}"
            options = ("--to", to, "--origin", "47,8", "--altitude", "60", "--set", f"c1={c1}", "-o", out)
            answer = eadp("export", "plans/survey.plan", *options)
            also = f", {out}.items.json" if to in WITH_ITEMS else ""
            assert (answer.code, answer.out) == (0, f"written    {out}{also}\n")
            assert ("PX4 does not arm a mission without a landing" in answer.err) == (to == "px4")
            assert answer.err.count("\n") == (to == "px4")
            assert out.read_text(encoding="utf-8").endswith("\n")
        lengths[c1] = drawn(READER(read_text(str(tmp_path / f"out{c1}.qgc")))[0], HOME).length
    assert lengths["-900"] < 0.6 * lengths["0"]
    options = ("--to", "gpx", "--origin", "47,8", "--altitude", "60", "--set", "c1=0")
    assert eadp("export", "plans/survey.plan", *options).out == (tmp_path / "out0.gpx").read_text(encoding="utf-8")


def test_with_a_scenario_the_forecast_chooses(eadp):
    options = ("--scenario", "scenarios/survey.yaml", "--origin", "47,8", "--to", "geojson")
    full = eadp("export", "plans/survey.plan", *options)
    assert full.code == 0
    low = eadp("export", "plans/survey.plan", *options, "--set", "battery.soc=0.3")
    assert low.code == 0

    def length(answer):
        points = json.loads(answer.out)["features"][0]["geometry"]["coordinates"]
        return shapely.LineString([to_local_m(lat, lon, HOME) for lon, lat, _ in points]).length

    assert length(low) < length(full) - 100


def test_airspeeds_that_are_decided_are_commanded_and_read_back(eadp, tmp_path):
    """By every door alike: what is forecast, what the mission's items command, and what is forecast of the mission."""
    keys = ("vehicle.airframe.airspeed_range_mps=[11, 15]", "battery.capacity_ah=0.3", "wind.speed_mps=2")
    given = ("--scenario", "scenarios/survey.yaml", *(word for key in keys for word in ("--set", key)))
    given += ("--set", "time_limit_s=1")  # the forecast alone
    decides = (*given, "--set", "planner.joint.airspeed=when-short", "--origin", "47,8")
    mission = tmp_path / "slow.waypoints"
    written = eadp("export", "plans/survey.plan", *decides, "--to", "ardupilot", "-o", mission)
    assert written.code == 0
    rows = [line.split("\t") for line in mission.read_text().splitlines()[1:]]
    commanded = [float(row[5]) for row in rows if row[3] == "178"]
    assert 11 <= min(commanded) < 14.5
    assert f"airspeed {min(commanded):g}" in written.err
    own = json.loads(eadp("simulate", "plans/survey.plan", *decides[:-2], "--format", "json").out)["energy_forecast"]
    assert {*commanded} == {*own["airspeeds_mps"]}
    assert own["at_cruise"]["airspeed_mps"] == 15
    assert own["quality"] > own["at_cruise"]["quality"]
    flown = json.loads(eadp("simulate", mission, *given, "--set", "planner.name=static", "--format", "json").out)
    assert flown["energy_forecast"]["time_s"] == pytest.approx(own["time_s"], rel=0.02)
    at_one = "--set", "planner.joint.airspeed=fixed", "--origin", "47,8", "--to", "ardupilot"
    fixed = eadp("export", "plans/survey.plan", *given, *at_one)
    assert [row.split("\t")[5] for row in fixed.out.splitlines()[1:] if row.split("\t")[3] == "178"] == ["15"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "no place on the earth"),
        (("--origin", "91,8"), "no position"),
        (("--origin", "47,8", "--home", "x,y"), "no position"),
        (("--origin", "47,8", "--set", "c9=1"), "no parameter c9"),
        (("--origin", "47,8", "--tolerance", "0"), "out of range"),
        (("--origin", "47,8", "--to", "shp"), "shp"),
    ],
)
def test_what_cannot_be_exported_writes_nothing(eadp, tmp_path, arguments, words):
    out = tmp_path / "out"
    assert refused(eadp("export", "plans/survey.plan", "--to", "qgc", *arguments, "-o", out), words)
    assert not out.exists()


def test_a_mission_and_parameters_are_two_files(eadp, tmp_path):
    one = tmp_path / "one.param"
    given = "--origin", "47,8", "--scenario", "scenarios/survey.yaml", "--parameters", one
    assert refused(eadp("export", "plans/survey.plan", "--to", "qgc", *given, "-o", one), "is the file of -o")
    assert not one.exists()


# --- software of others -----------------------------------------------------------------------------------------------


def test_pymavlink_loads_it(tmp_path):
    mavwp = pytest.importorskip("pymavlink.mavwp")
    plan, _ = read_plan(Text("p", LANDING))
    exported = mission_items(path_of(plan, home_deg=HOME))
    assert [item.command for item in exported[-3:]] == [189, 16, 21]
    file = tmp_path / "m.waypoints"
    file.write_text(EXPORTS["ardupilot"](path_of(plan, home_deg=HOME)))
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(file)) == len(exported) + 1
    for index, item in enumerate(exported, 1):
        loaded = loader.wp(index)
        assert (loaded.command, loaded.frame) == (item.command, item.frame)
        assert (loaded.x, loaded.y, loaded.z) == pytest.approx(item.parameters[4:], abs=1e-6)


def test_pictures_end_before_a_landing():
    path = path_of(read_plan(Text("p", LANDING))[0], trigger_distance_m=20.0)
    assert [item.command for item in mission_items(path)[-4:]] == [206, 189, 16, 21]
    assert json.loads(EXPORTS["qgc"](path))["mission"]["items"][-1]["complexItemType"] == "fwLandingPattern"


def test_an_altitude_is_not_taken_beside_those_of_the_plan(eadp, tmp_path):
    plan, out, given = tmp_path / "p.plan", tmp_path / "m", ("--to", "qgc", "--origin", "47,8", "--altitude", "80")
    plan.write_text(f"%: altitude 60\n{LINES}")
    assert refused(eadp("export", plan, *given, "-o", out), "--altitude:1:1: error: the plan has altitudes of its own")
    assert not out.exists()
    plan.write_text(LINES)
    assert eadp("export", plan, *given, "-o", out).code == 0
