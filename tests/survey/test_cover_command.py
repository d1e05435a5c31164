"""`eadp cover`: from files of outlines to plans that pass the check and are flown; refusals."""

import json
import math
import re

import pytest
from common import few_rows
from common.answers import refused

from eadp.api.inputs import load_flight
from eadp.core.geometry.geodesy import to_local_m
from eadp.io.figures.canvas import COLOURS

FLAGS = ("--min-radius", "30", "--swath", "30", "--heading", "90")
"""A heading, as its search is not the subject here."""

BOX = "x_m,y_m\n0,0\n400,0\n400,300\n0,300\n"


@pytest.fixture
def box(tmp_path):
    path = tmp_path / "box.csv"
    path.write_text(BOX)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("pattern", ["dubins", "zamboni"])
def test_the_plan_is_checked_traced_and_flown(eadp, tmp_path, pattern):
    plan = tmp_path / "meadow.plan"
    asked = "auto" if pattern == "dubins" else pattern
    answer = eadp("cover", "plans/meadow.geojson", *FLAGS, "--pattern", asked, "-o", plan, "--format", "json")
    document = json.loads(answer.out)
    assert (document["schema"], document["pattern"], document["normalised"]) == ("eadp.cover/1", pattern, [])
    assert min(document["coverage"], document["coverage_min"]) >= 0.9999
    assert document["min_radius_m"] >= 30
    assert min(document[key] for key in ("length_m", "time_s", "lines", "heading_deg")) > 0
    assert document["plan"] == plan.read_text()
    check = json.loads(eadp("plan", plan, "--check", "--format", "json").out)
    assert check["findings"] == []
    assert check["repeats"] is (pattern == "zamboni")
    assert check["primitive_stages"] == (4 if pattern == "zamboni" else None)
    assert check["origin_deg"] is not None
    points = [check["final"], *(stage["trigger"] for stage in check["stages"])]
    for point in (each for each in points if not isinstance(each["x"], str) and not isinstance(each["y"], str)):
        place = to_local_m(point["lat_deg"], point["lon_deg"], check["origin_deg"])
        assert place == pytest.approx((point["x"], point["y"]), abs=1e-3)
    trace = eadp("plan", plan, "--trace", "5").out.splitlines()
    assert trace[0] == "stage,kind,x_m,y_m,heading_rad,lat_deg,lon_deg"
    assert eadp("simulate", plan, "--planner", "static", "--set", "step_s=0.05").code == 0


def test_the_fields_name_and_area_go_with_the_plan(eadp, tmp_path):
    plan, folder = tmp_path / "meadow.plan", tmp_path / "flight"
    given = ("--min-radius", "30", "--swath", "90", "--pattern", "dubins", "--heading", "94")
    answer = eadp("cover", "plans/meadow.geojson", *given, "--format", "json", "-o", plan)
    area_m2 = json.loads(answer.out)["field"]["area_m2"]
    field = json.loads(eadp("plan", plan, "--format", "json").out)["field"]
    assert field == {"name": "meadow", "area_m2": pytest.approx(area_m2, abs=0.1)}
    assert eadp("plan", plan, "--format", "plan").out.count("%: field-name meadow\n") == 1
    assert eadp("simulate", plan, "--planner", "static", "--set", "time_limit_s=1", "-o", folder).code == 1
    assert json.loads((folder / "summary.json").read_text())["field"]["name"] == "meadow"
    assert "<name>meadow</name>" in eadp("export", plan, "--to", "kml").out


def test_an_aircraft_that_cannot_fly_so_is_refused(eadp, tmp_path):
    wing = tmp_path / "wing.yaml"
    wing.write_text("schema: eadp.vehicle/1\nairframe: {airspeed_mps: 14, airspeed_range_mps: [14, 11.5]}\n")
    given = ("cover", "plans/meadow.geojson", "--swath", "40", "--vehicle", wing)
    for more, fault in (
        ((), f"{wing}:1:1: error: the airspeed of 14 m/s is not in"),
        (("--airspeed", "3"), "--airspeed:1:1"),
    ):
        answer = eadp(*given, *more)
        assert (answer.code, answer.out) == (2, "")
        assert answer.err.startswith(fault)


CAMERA = {"--altitude": 80, "--sensor-width-mm": 13.2, "--focal-length-mm": 8.8, "--side-overlap": 70}
PICTURES = {"--sensor-height-mm": 8.8, "--forward-overlap": 80}


def flags(options):
    return [str(word) for pair in options.items() for word in pair]


@pytest.mark.quick(1)
@pytest.mark.parametrize("pattern", ["zamboni", "dubins"])
def test_the_camera_gives_swath_altitude_and_pictures(eadp, tmp_path, pattern):
    plan, mission = tmp_path / "meadow.plan", tmp_path / "meadow.waypoints"
    given = ("cover", "plans/meadow.geojson", "--min-radius", "30", "--pattern", pattern, "--heading", "94")
    # 80 m · 13.2 mm / 8.8 mm = 120 m of ground across, of which 30 % are new; along 80 m, of which 20 %
    answer, alike = (
        json.loads(eadp(*given, *more, "--format", "json").out)
        for more in (
            (*flags(CAMERA | PICTURES), "--image-width-px", "6000"),
            # rolls from 45° to 2° with a time constant of 0.3 s, at 15 m/s
            ("--swath", "36", "--lead-in", str(math.ceil(15 * 0.3 * math.log(45 / 2)))),
        )
    )
    assert (answer["lines"], answer["length_m"]) == (alike["lines"], alike["length_m"])
    plan.write_text(answer["plan"])
    stages = json.loads(eadp("plan", plan, "--format", "json").out)["stages"]
    assert {stage["altitude_m"] for stage in stages} == {80}
    assert eadp("simulate", plan, "--planner", "static", "--set", "step_s=0.05").code == 0
    assert eadp("export", plan, "--to", "ardupilot", "-o", mission).code == 0
    rows = [[float(word) for word in line.split()] for line in mission.read_text().splitlines()[1:]]
    pictures = [row[4] for row in rows if row[3] == 206]
    assert set(pictures) == {16, 0}
    assert pictures[0] == 16
    assert pictures[-1] == 0
    camera = answer["camera"]
    assert (camera["width_m"], camera["distance_m"], answer["forward_overlap"]) == pytest.approx((120, 16, 0.8))
    assert answer["side_overlap"] == pytest.approx([1 - apart_m / 120 for apart_m in answer["spacing_m"]])
    assert min(answer["side_overlap"]) >= 0.7
    assert answer["gsd_cm"] == pytest.approx(100 * 120 / 6000)
    assert answer["batteries"] is None
    # the field once, or with lines of half the distance twice; and what lines show beyond its edge
    apart_m = 18 if pattern == "zamboni" else 36
    assert 1.0 < answer["pictures"] * 16 * apart_m / answer["field"]["area_m2"] < 1.35
    # on along a line, off after it
    on = sum(before == 0 and now == 16 for before, now in zip([0, *pictures], pictures, strict=False))
    assert on == answer["lines"]


LINES = ("cover", "plans/meadow.geojson", "--min-radius", "30", "--pattern", "dubins", "--heading", "94")
PHANTOM = {"--camera": "dji-phantom-4-pro", "--side-overlap": 70, "--forward-overlap": 80, "--picture-interval": 2}


def test_the_altitude_follows_from_the_size_of_a_pixel(eadp, tmp_path):
    """DJI's own formula of this camera, of the Phantom 4 RTK: a pixel has H/36.5 cm, H in metres."""
    plan = tmp_path / "meadow.plan"
    given = (*LINES, "--wind", "3,0", *flags(PHANTOM))
    answer = eadp(*given, "--gsd", "2", "--format", "json")
    document = json.loads(answer.out)
    altitude_m = document["camera"]["altitude_m"]
    assert altitude_m == pytest.approx(2 * 36.5, rel=1e-3)
    assert document["gsd_cm"] == pytest.approx(2)
    assert document["camera"]["name"] == "DJI Phantom 4 Pro"
    # the other way round
    back = json.loads(eadp(*given, "--altitude", altitude_m, "--format", "json").out)
    assert back["gsd_cm"] == pytest.approx(2)
    assert back["plan"] == document["plan"]
    # by the camera's values alone
    own = {"--sensor-width-mm": 13.2, "--sensor-height-mm": 8.8, "--focal-length-mm": 8.8, "--image-width-px": 5472}
    words = flags({key: value for key, value in PHANTOM.items() if key != "--camera"} | own)
    alike = json.loads(eadp(*given[:10], *words, "--gsd", "2", "--format", "json").out)
    assert alike["camera"] == document["camera"] | {"name": ""}
    plan.write_text(document["plan"])
    shown = json.loads(eadp("plan", plan, "--format", "json").out)
    assert shown["camera"] == {
        "name": document["camera"]["name"], "altitude_m": pytest.approx(altitude_m, abs=1e-3), "gsd_cm": 2.0,
    }  # fmt: skip
    assert {stage["altitude_m"] for stage in shown["stages"]} == {shown["camera"]["altitude_m"]}
    assert f"camera     {document['camera']['name']} from {altitude_m:.4g} m, 2 cm a pixel\n" in eadp("plan", plan).out


def test_pictures_faster_than_the_camera_are_warned_of(eadp):
    answer = eadp(*LINES, "--gsd", "2", *flags(PHANTOM), "--airspeed", "15", "--wind", "6,0", "--heading", "90")
    assert "--forward-overlap:1:1: warning: a picture each 14.6 m" in answer.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "--swath, or --altitude"),
        ({"--camera": "sony"}, "no camera sony; expected a camera file (.yaml), or one of canon-s100"),
        ({"--camera": "sony-rx0"}, "--altitude:1:1: error: the camera needs --altitude too; expected --gsd or"),
        ({**PHANTOM, "--gsd": 2, "--altitude": 73}, "--gsd:1:1: error: the size of a pixel beside the altitude"),
        ({**PHANTOM, "--gsd": 0.02}, "--gsd:1:1: error: 0.02 is out of range; expected from 0.1 to 1000"),
        ({"--swath": 30, "--side-overlap": 70}, "one of the two"),
        ({**CAMERA, "--side-overlap": 0.7}, "--side-overlap:1:1: error: 0.7 %; expected percent"),
        ({**CAMERA, "--side-overlap": "60:70"}, "wanted and acceptable, as 70:60"),
        ({**CAMERA, "--forward-overlap": 80}, "the camera needs --sensor-height-mm too"),
    ],
)
def test_a_camera_that_is_none_is_refused(eadp, options, words):
    assert refused(eadp("cover", "plans/meadow.geojson", "--min-radius", "30", *flags(options)), words)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "options",
    [
        ("--pattern", "zamboni", "--profile", "profiles/pednet-letter.yaml"),
        ("--home", "55.4665,10.325", "--altitude", "80"),
        ("--landing", "55.4665,10.325,60", "--wind", "4,200"),
    ],
)
def test_its_energy_is_that_of_the_forecast(eadp, tmp_path, options):
    """At both ends of the spacing, with a vehicle beside the shell's folder and not the scenario's."""
    plan, scenario = tmp_path / "meadow.plan", "scenarios/rising-wind.yaml"
    words = ("cover", "plans/meadow.geojson", "--swath", 30, "--scenario", scenario, "--airspeed", 19, *options)
    answer = eadp(*words, "--vehicle", "vehicles/mapper.yaml", "-o", plan, "--format", "json")
    assert answer.code == 0, answer.err
    document = json.loads(answer.out)
    stated = [document["energy_wh"], document["at_lowest_c1"]["energy_wh"]]
    keys = {"vehicle": "vehicles/mapper.yaml", "vehicle.airframe.airspeed_mps": 19, "planner.name": "static"}
    keys["vehicle.airframe.airspeed_range_mps"] = [12.5, 19]
    if "--wind" in options:
        keys |= {"wind.speed_mps": 4, "wind.from_deg": 200}
    profile = options[3] if "--profile" in options else None
    whole = load_flight(plan, scenario=scenario, profile=profile, overrides=keys).world.mission.plan
    lowest = {"parameters.c1": whole.hull(0).lo} if "zamboni" in options else {}
    for energy_wh, own in zip(stated, ({}, lowest), strict=True):
        flight = load_flight(plan, scenario=scenario, profile=profile, overrides=keys | own)
        assert energy_wh == pytest.approx(flight.preflight().forecast.energy_wh, rel=1e-6)
    assert (stated[0] > stated[1]) == ("zamboni" in options)


def test_a_scenario_of_another_plan_serves_for_the_vehicle_and_leaves_the_energy_out(eadp):
    given = ("cover", "plans/meadow.geojson", *FLAGS, "--scenario", "scenarios/paper-drained.yaml")
    answer = eadp(*given, "--format", "json")
    assert answer.code == 0
    assert "note: no energy is stated: the plan has no parameter c2" in answer.err
    assert "energy_wh" not in json.loads(answer.out)


def test_a_profile_that_does_not_measure_whole_settings_is_refused_and_nothing_written(eadp, tmp_path):
    profile, plan = tmp_path / "p.csv", tmp_path / "p.plan"
    profile.write_text("fps,qp,power_w\n2,1,1\n4,2,2\n6,5,4\n7,1,3\n")
    answer = eadp("cover", "plans/meadow.geojson", *FLAGS, "--profile", profile, "-o", plan)
    refused(answer, "outside the hull of the measured ones")
    assert not plan.exists()


@pytest.mark.slow
def test_a_profile_brings_computations_that_stop_on_turns(eadp, tmp_path, box):
    plan = tmp_path / "p.plan"
    profile = ("--profile", "profiles/pednet-jetson-nano.yaml")
    answer = eadp("cover", box, *FLAGS, "--pattern", "zamboni", "--turns-off", *profile, "-o", plan, "--format", "json")
    document = json.loads(answer.out)
    assert document["energy_wh"] > document["at_lowest_c1"]["energy_wh"] > 0
    stages = json.loads(eadp("plan", plan, "--format", "json").out)["stages"]
    for stage in stages:
        computation = stage["sets"][-1]
        assert computation["kind"] == "computation"
        assert stage["kind"] == "line" or computation["max"] == 0  # a straight between blocks is a turn, too
    assert {(stage["kind"], stage["sets"][-1]["max"]) for stage in stages} >= {("line", 10), ("circle", 0)}
    assert eadp("simulate", plan, *profile, "--planner", "static", "--set", "step_s=0.05").code == 0


def test_repairs_are_noted(eadp, tmp_path):
    path = tmp_path / "field.csv"
    path.write_text("x_m,y_m\n0,0\n0,300\n400,300\n450,350\n400,300\n400,0\n")
    for sorties in ((), ("--home=-50,0", "--sorties", "1", "--vehicle", "vehicles/foam-wing.yaml")):
        answer = eadp("cover", path, *FLAGS, *sorties)
        assert "note: 1 outline that crossed or touched itself repaired" in answer.err
    document = json.loads(eadp("cover", path, *FLAGS, "--format", "json").out)
    assert len(document["normalised"]) == 1


def test_the_pictures(eadp, tmp_path, box):
    plot = tmp_path / "field.svg"
    answer = eadp("cover", box, *FLAGS, "--pattern", "zamboni", "--plot", plot, "--format", "json")
    # the lines at both ends of c1, beside those of the table: c1 = 0 has more of them
    document, shown = json.loads(answer.out), plot.read_text()
    ways = re.findall(rf"stroke: {COLOURS[0]}; stroke-width: 1.3", shown)
    assert len(ways) == document["lines"] + document["at_lowest_c1"]["lines"] + 1, "and one in the legend"


def test_a_field_too_narrow_for_the_pattern_is_a_no(eadp, tmp_path):
    path = tmp_path / "narrow.csv"
    path.write_text("x_m,y_m\n0,0\n120,0\n120,60\n0,60\n")
    answer = eadp("cover", path, *FLAGS, "--pattern", "zamboni", "-o", tmp_path / "p.plan")
    assert answer.code == 1
    assert "too narrow" in answer.err
    assert answer.out == ""
    assert not (tmp_path / "p.plan").exists()
    assert eadp("cover", path, *FLAGS).code == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ("--min-radius", "0"), ("--start", "1e9,0"), ("--plot", "nowhere/at/all.svg"), ("--swath", "nan"),
        ("--radius", "20"), ("--spacing", "31"), ("--wind", "15,0"), ("--heading", "inf"), ("--home", "1,2,3"),
        ("--lead-in", "-1"),
    ],
)  # fmt: skip
def test_options_out_of_range_are_refused(eadp, box, tmp_path, arguments):
    out = tmp_path / "p.plan"
    answer = eadp("cover", box, *FLAGS, *arguments, "-o", out)
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.startswith(f"{arguments[0]}:1:1: error: ")
    assert not out.exists()


def test_standard_output_takes_one_document(eadp, box):
    assert eadp("cover", box, *FLAGS, "-o", "-").out.startswith("%")
    answer = eadp("cover", box, *FLAGS, "-o", "-", "--format", "json")
    assert answer.code == 2
    assert answer.out == ""


def test_the_fields_own_file_is_not_overwritten(eadp, box, tmp_path):
    assert eadp("cover", box, *FLAGS, "-o", box).code == 2
    assert box.read_text() == BOX
    same = tmp_path / "same.svg"
    assert eadp("cover", box, *FLAGS, "-o", same, "--plot", same).code == 2
    assert not same.exists()


LIMITS = {
    "field": "x_m,y_m\n0,0\n600,0\n600,400\n0,400\n",
    "avoid": "x_m,y_m\n250,150\n330,150\n330,260\n250,260\n",
    "inside": "x_m,y_m\n-60,-60\n660,-60\n660,460\n-60,460\n",
}


@pytest.fixture
def limits(tmp_path):
    """Files of a field, an obstacle and a boundary, and the options that all commands have."""
    for name, text in LIMITS.items():
        (tmp_path / f"{name}.csv").write_text(text)
    return (tmp_path / "field.csv", "--metres", "--min-radius", "25", "--swath", "40", "--heading", "90")


def test_obstacles_and_a_boundary(eadp, limits, tmp_path):
    out, picture = tmp_path / "p.plan", tmp_path / "p.png"
    more = ("--avoid", tmp_path / "avoid.csv", "--inside", tmp_path / "inside.csv")
    answer = eadp("cover", *limits, *more, "-o", out, "--plot", picture)
    assert answer.code == 0
    assert "stays      out of 1 obstacle and inside the boundary\nleft       " in answer.out
    assert picture.stat().st_size > 10_000
    assert eadp("plan", out, "--check").code == 0
    # the plan as it is flown, point by point
    rows = [row.split(",") for row in eadp("plan", out, "--trace", "1").out.splitlines()[1:]]
    for x, y in ((float(row[2]), float(row[3])) for row in rows):
        assert not (250.6 < x < 329.4 and 150.6 < y < 259.4)
        assert -60.6 < x < 660.6
        assert -60.6 < y < 460.6
    document = json.loads(eadp("cover", *limits, *more, "--format", "json").out)
    assert (document["obstacles"], document["boundary"]) == (1, True)
    left_m2 = (1 - document["coverage"]) * 240_000
    assert sum(each["area_m2"] for each in document["left"]) == pytest.approx(left_m2, rel=0.01)
    assert document["left"][0]["at_deg"] is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("altitude", "home", "avoided"),
    few_rows([(55, "-50,-50", False), (54, "-50,-50", True), (102, "220,210", True)], 3),
)
def test_an_obstacle_that_is_low_enough_is_flown_over(eadp, limits, tmp_path, altitude, home, avoided):
    """By its height and the clearance of 20 m, but not by a climb from a home beside it."""
    w, s, e, n = 290, 170, 310, 190
    pole = {"type": "Feature", "units": "m", "properties": {"name": "pole", "height": 35}}
    pole["geometry"] = {"type": "Polygon", "coordinates": [[[w, s], [e, s], [e, n], [w, n], [w, s]]]}
    (tmp_path / "pole.geojson").write_text(json.dumps(pole))
    plan = tmp_path / "field.plan"
    wing = ("--vehicle", "vehicles/foam-wing.yaml", "--altitude", altitude, "--pattern", "dubins")
    answer = eadp("cover", *limits, *wing, f"--home={home}", "--avoid", tmp_path / "pole.geojson", "-o", plan)
    assert answer.code == 0, answer.err
    assert ("out of 1 obstacle" in answer.out) == avoided
    assert ("an obstacle is flown over at" in answer.err) != avoided
    rows = [row.split(",") for row in eadp("plan", plan, "--trace", "5").out.splitlines()[1:]]
    assert any(w < float(row[2]) < e and s < float(row[3]) < n for row in rows) != avoided
    assert eadp("plan", plan, "--check").code == 0
    fences = json.loads(eadp("export", plan, "--to", "qgc", "--origin", "55,10").out)["geoFence"]["polygons"]
    assert len(fences) == avoided, "a fence has no height"
    given = (*limits, *wing, f"--home={home}", "--avoid", tmp_path / "pole.geojson")
    answer = eadp("cover", *given, "--sorties", "1", "-o", tmp_path / "job")
    assert answer.code == 0, answer.err
    kept = [path.read_text().count("%: avoid pole height 35 ") for path in (plan, tmp_path / "job/sortie-01.plan")]
    assert kept == [1, 1]


@pytest.mark.slow
def test_holes_that_are_not_flown_over(eadp, tmp_path):
    path = tmp_path / "field.geojson"
    hole = [[250, 150], [330, 150], [330, 260], [250, 260]]
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [600, 0], [600, 400], [0, 400]], hole]}))
    arguments = ("cover", path, "--metres", "--min-radius", "25", "--swath", "40", "--format", "json")
    over, round_them = (json.loads(eadp(*arguments, "--holes", holes).out) for holes in ("cover", "avoid"))
    assert (over["obstacles"], round_them["obstacles"]) == (0, 1)
    assert over["coverage"] > 0.9999


def test_bad_limits(eadp, limits, tmp_path):
    answer = eadp("cover", *limits, "--avoid", "plans/meadow.geojson")
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.startswith("plans/meadow.geojson:1:1: error: an obstacle of 0.0")
    assert "if these are metres and not degrees" in answer.err
    (tmp_path / "bow.csv").write_text("x_m,y_m\n0,0\n100,100\n100,0\n0,100\n")
    answer = eadp("cover", *limits, "--inside", tmp_path / "bow.csv")
    assert refused(answer, "bow.csv:1:1: error: the outline crosses itself at (50.00, 50.00) m")
    (tmp_path / "all.csv").write_text("x_m,y_m\n-99,-99\n999,-99\n999,999\n-99,999\n")
    answer = eadp("cover", *limits, "--avoid", tmp_path / "all.csv")
    assert (answer.code, answer.out) == (1, "")
    assert "no line of the field has room for a turn" in answer.err


def test_a_wanted_and_an_acceptable_overlap(eadp, tmp_path):
    """Laps are flown at the wanted overlap, and widen up to the acceptable one."""
    path = tmp_path / "field.csv"
    path.write_text("x_m,y_m\n0,0\n600,0\n600,400\n0,400\n")
    camera = {**CAMERA, "--side-overlap": "70:60", "--pattern": "zamboni", "--heading": "90"}
    document = json.loads(eadp("cover", path, "--metres", *flags(camera), "--format", "json").out)
    # of a footprint of 120 m, 40 % and 30 %
    stated = ("--swath", "48", "--spacing", "36", "--pattern", "zamboni", "--altitude", "80", "--heading", "90")
    same = json.loads(eadp("cover", path, "--metres", *stated, "--format", "json").out)
    assert document["plan"].replace("%: camera altitude 80\n", "") == same["plan"]
    assert document["lines"] > document["at_lowest_c1"]["lines"]


def rectangle(west, south, east, north):
    return "x_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in ((west, south), (east, south), (east, north), (west, north)))


@pytest.mark.parametrize("option", ["--start", "--home"])
@pytest.mark.parametrize("limit", ["avoid", "inside"])
def test_a_start_or_a_home_where_none_may_fly_is_refused(eadp, limits, tmp_path, option, limit):
    outline = rectangle(-60, -60, -40, -40) if limit == "avoid" else rectangle(-30, -30, 650, 450)
    (tmp_path / "limit.csv").write_text(outline)
    answer = eadp("cover", *limits, f"--{limit}", tmp_path / "limit.csv", option, "-50,-50")
    assert refused(answer, f"{option}:1:1: error: lies in an obstacle or beyond the boundary")


def test_pictures_are_taken_on_the_line_alone(eadp, box):
    """After the lead-in, which the flight has besides."""
    given = ("--min-radius", "30", "--pattern", "dubins", "--heading", "90", *flags(CAMERA | PICTURES))
    bare, led = (json.loads(eadp("cover", box, *given, "--lead-in", lead, "--format", "json").out) for lead in (0, 60))
    assert (led["pictures"], led["lines"], led["coverage"]) == (bare["pictures"], bare["lines"], bare["coverage"])
    assert led["length_m"] >= bare["length_m"] + led["lines"] * 60 - 1e-6
    assert led["lead_in_m"] == 60
    on = [line for line in led["plan"].splitlines() if line.startswith("%: command 206")]
    assert len(on) == 2 * led["lines"] - 1  # the path ends with a line


@pytest.mark.slow
def test_a_pack_too_small_at_cruise_flies_every_line_slower(eadp, tmp_path):
    """README's field and camera: at 15 m/s the first two of these packs have 0.00 and 0.39."""
    plan, wing = tmp_path / "meadow.plan", "vehicles/foam-wing.yaml"
    camera = {"--gsd": 1.4, "--camera": "canon-sx260", "--side-overlap": "70:55", "--forward-overlap": 75}
    given = ("--vehicle", wing, "--wind", "4,240", "--pattern", "zamboni", *flags(camera))
    assert eadp("cover", "plans/meadow.geojson", *given, "-o", plan).code == 0
    for pack_ah, quality in (("1.2", 0.35), ("1.5", 0.99), ("1.8", 1.0)):
        keys = {"battery.capacity_ah": pack_ah, "wind.speed_mps": 4, "wind.from_deg": 240, "vehicle": wing}
        sets = [part for key, value in keys.items() for part in ("--set", f"{key}={value}")]
        flight = json.loads(eadp("simulate", plan, *sets, "--format", "json").out)
        assert flight["reserve_kept"]
        assert flight["quality"] >= quality
