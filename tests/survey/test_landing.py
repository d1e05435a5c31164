"""A flight that takes off in a direction and lands: plan, forecast, flight and missions have the same ends."""

import json
import math
import re

import pytest
from common import ROOT
from common.answers import refused

from eadp.api.flight import simulate as fly
from eadp.api.inputs import load_flight
from eadp.cli.main import main
from eadp.core.geometry.geodesy import to_local_m
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text

LAND = (55.4712, 10.3295, 250.0)
WIND = "4,240"
FLOWN = {"vehicle": str(ROOT / "vehicles/foam-wing.yaml"), "wind.speed_mps": 4.0, "wind.from_deg": 240.0}
COVER = (
    "cover", "plans/meadow.geojson", "--swath", "60", "--pattern", "dubins", "--heading", "94", "--altitude", "60",
    "--vehicle", "vehicles/foam-wing.yaml", "--wind", WIND,
)  # fmt: skip
SPEED_MPS, CLIMB_MPS = 15.0, 3.0
FLAT_DEG = 5.0
TAKE_OFF_M = 50.0
ENDINGS = {"qgc": "plan", "px4": "plan", "ardupilot": "waypoints"}
FIELD = "x_m,y_m\n0,0\n600,0\n600,300\n0,300\n"


def sink_mps():
    """Sink rate of the foam wing in a glide at 15 m/s: D V / W of its drag polar."""
    area, aspect, mass, oswald, drag = 0.45, 7.85, 2.0, 0.8, 0.035
    pressure, weight = 0.5 * 1.225 * SPEED_MPS**2 * area, mass * 9.81
    lift = weight / pressure
    return pressure * (drag + lift**2 / (math.pi * oswald * aspect)) * SPEED_MPS / weight


def rows(path):
    """The rows of a WPL file as numbers."""
    return [[float(word) for word in line.split("\t")] for line in path.read_text().splitlines()[1:]]


@pytest.fixture(scope="module")
def landing(tmp_path_factory):
    """A coverage that takes off into the wind and lands, and its missions."""
    folder = tmp_path_factory.mktemp("landing")
    plan, scenario = folder / "landing.plan", folder / "s.yaml"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        assert main([*COVER, "--landing", ",".join(map(str, LAND)), "-o", str(plan)]) == 0
    wind = f"{{speed_mps: {FLOWN['wind.speed_mps']}, from_deg: {FLOWN['wind.from_deg']}}}"
    scenario.write_text(f"schema: eadp.scenario/1\nvehicle: {FLOWN['vehicle']}\nwind: {wind}\n")
    for to, ending in ENDINGS.items():
        words = ("export", str(plan), "--to", to, "--scenario", str(scenario))
        assert main([*words, "-o", str(folder / f"{to}.{ending}")]) == 0
    return folder


def test_the_climb_out_goes_into_the_wind_and_the_approach_descends_in_a_glide_to_the_place(landing):
    """On the ellipsoid, by pyproj; lengths by the rate of climb and by the glide's sink rate, no headwind counted."""
    geod = pytest.importorskip("pyproj").Geod(ellps="WGS84")
    home, takeoff, _, out, *_, start, approach, land = rows(landing / "ardupilot.waypoints")
    assert [row[3] for row in (takeoff, out, start, approach, land)] == [22, 16, 189, 16, 21]
    assert takeoff[10] == TAKE_OFF_M
    assert land[8:11] == [pytest.approx(LAND[0], abs=1e-6), pytest.approx(LAND[1], abs=1e-6), 0]
    assert home[8:10] == pytest.approx(LAND[:2], abs=1e-6), "without --home it takes off where it lands"
    azimuth, _, length_m = geod.inv(home[9], home[8], out[9], out[8])
    assert azimuth % 360 == pytest.approx(240, abs=0.1)
    assert length_m == pytest.approx(TAKE_OFF_M / CLIMB_MPS * SPEED_MPS, rel=0.002)
    azimuth, _, length_m = geod.inv(approach[9], approach[8], land[9], land[8])
    assert azimuth % 360 == pytest.approx(LAND[2], abs=0.1)
    assert length_m == pytest.approx(60 / math.tan(math.radians(FLAT_DEG)), rel=1e-3), "as flat as PX4 asks"
    assert approach[10] == 60


def test_an_approach_is_as_steep_as_the_autopilot_accepts_and_longer_with_the_wind_behind(eadp, tmp_path):
    def length_m(heading, autopilot):
        out, scenario = tmp_path / "p.plan", tmp_path / "s.yaml"
        scenario.write_text(f"schema: eadp.scenario/1\nautopilot: {autopilot}\n")
        answer = eadp(*COVER, "--scenario", scenario, "--landing", f"55.4712,10.3295,{heading}", "-o", out)
        assert answer.code == 0, answer.err
        assert ("m/s of wind behind" in answer.err) == (heading == 60)
        *_, before, last = read_plan(read_text(str(out)))[0].stages
        return math.dist(before.trigger_at(()), last.trigger_at(()))

    # ArduPilot flies a glide; 15 m/s over ground is the least that is reckoned with; with 4 m/s behind it is 19
    glide_m = length_m(240, "{kind: ardupilot}")
    assert glide_m == pytest.approx(60 / sink_mps() * SPEED_MPS, rel=0.01)
    assert length_m(60, "{kind: ardupilot}") / glide_m == pytest.approx(19 / 15, rel=1e-3)
    for autopilot, limit_deg in (("{kind: px4}", 5), ("{kind: px4, parameters: {FW_LND_ANG: 6}}", 6), ("{}", 5)):
        assert length_m(240, autopilot) == pytest.approx(60 / math.tan(math.radians(limit_deg)), rel=1e-6)
    # no steeper than a glide
    assert length_m(240, "{kind: px4, parameters: {FW_LND_ANG: 12}}") == pytest.approx(glide_m)


@pytest.mark.quick(1)
@pytest.mark.parametrize("to", ENDINGS)
def test_the_forecast_of_a_mission_is_that_of_the_plan(landing, to):
    """A mission that is read back has its take-off, its approach and its landing."""
    plan = load_flight(str(landing / "landing.plan"), overrides=FLOWN)
    mission = load_flight(str(landing / f"{to}.{ENDINGS[to]}"), overrides=FLOWN)
    assert plan.world.start.altitude_m == mission.world.start.altitude_m == 0
    assert mission.world.mission.plan.stages[-1].altitude_m == 0
    there, here = plan.preflight().forecast, mission.preflight().forecast
    assert here.energy_wh == pytest.approx(there.energy_wh, rel=0.01)
    assert here.remaining_s == pytest.approx(there.remaining_s, rel=0.01)


def test_the_flight_starts_on_the_ground_and_ends_there(eadp, landing, tmp_path):
    out = tmp_path / "flown"
    given = ("--scenario", landing / "s.yaml", "--planner", "static", "-o", out)
    answer = eadp("simulate", landing / "landing.plan", *given)
    assert answer.code == 0, answer.err
    header, *lines = (out / "flight.csv").read_text().splitlines()
    altitudes_m = [float(line.split(",")[header.split(",").index("altitude_m")]) for line in lines]
    assert altitudes_m[0] < 1
    assert max(altitudes_m) == pytest.approx(60, abs=1)
    assert altitudes_m[-1] == pytest.approx(0, abs=0.5)


def test_qgroundcontrol_has_a_landing_pattern_and_px4_the_items_that_it_makes_one_of(landing):
    """Its keys as `LandingComplexItem._save` writes them; the items as its `_scanForItem` wants them."""
    mission = json.loads((landing / "qgc.plan").read_text())["mission"]
    pattern = mission["items"][-1]
    assert (pattern["complexItemType"], pattern["version"]) == ("fwLandingPattern", 2)
    assert pattern["landCoordinate"] == [pytest.approx(LAND[0], abs=1e-6), pytest.approx(LAND[1], abs=1e-6), 0]
    assert pattern["landingApproachCoordinate"][2] == 60
    assert (pattern["useLoiterToAlt"], pattern["altitudesAreRelative"]) == (False, True)
    start, approach, land = json.loads((landing / "px4.plan").read_text())["mission"]["items"][-3:]
    assert [(item["command"], item["frame"]) for item in (start, approach, land)] == [(189, 2), (16, 3), (21, 3)]
    assert start["params"] == [0] * 7
    assert approach["params"][:4] == [0, 0, 0, None]
    assert land["params"][:4] == [0] * 4


def test_a_mission_of_others_keeps_its_take_off_and_landing(eadp, tmp_path):
    mission = "QGC WPL 110\n" + "\n".join(
        "\t".join(map(str, (i, int(i == 0), 3, command, p1, 0, 0, p4, lat, lon, up, 1)))
        for i, (command, p1, p4, lat, lon, up) in enumerate([
            (16, 0, 0, 47.0, 8.0, 0), (22, 15, 0, 0, 0, 80), (16, 0, 0, 47.004, 8.0, 100), (189, 0, 0, 0, 0, 0),
            (16, 0, 0, 47.004, 8.01, 60), (16, 0, 0, 47.0, 8.008, 40), (21, 0, 1, 47.0, 8.001, 0),
            (5100, 0, 0, 47.001, 8.002, 45),
        ])
    )  # fmt: skip
    given, again = tmp_path / "given.waypoints", tmp_path / "again.waypoints"
    given.write_text(mission + "\n")
    answer = eadp("export", given, "--to", "ardupilot", "-o", again)
    assert answer.code == 0
    assert f"{given}:9:7: warning: places to rally are left out" in answer.err
    found = rows(again)
    kept = [row for row in found if row[3] in (22, 189, 21)]
    assert [(row[3], row[4], row[7]) for row in kept] == [(22, 15, 0), (189, 0, 0), (21, 0, 1)]
    assert kept[0][10] == 80
    # all of the approach comes after the start of the landing
    after = found[found.index(kept[1]) + 1 :]
    assert any(row[8:10] == pytest.approx([47.0, 8.008], abs=1e-5) for row in after)
    assert not (tmp_path / "again.waypoints.rally.waypoints").exists()
    qgc = json.loads(eadp("export", given, "--to", "qgc").out)
    assert qgc["rallyPoints"] == {"points": [], "version": 2}


@pytest.mark.slow
@pytest.mark.parametrize("to", ENDINGS)
def test_circles_up_to_the_first_line_are_in_plan_flight_and_mission(eadp, tmp_path, to):
    flight, out = tmp_path / "p.plan", tmp_path / f"m.{ENDINGS[to]}"
    words = ("cover", "plans/meadow.geojson", "--swath", "60", "--pattern", "dubins", "--heading", "94")
    given = ("--altitude", "100", "--vehicle", "vehicles/foam-wing.yaml", "--home", "55.47,10.327", "-o", flight)
    answer = eadp(*words, *given)
    assert answer.code == 0, answer.err
    assert "climb      a circle of 36 m radius before the first line" in answer.out
    assert eadp("plan", flight, "--check").code == 0
    assert eadp("export", flight, "--to", to, "-o", out).code == 0
    plan, mission = (load_flight(str(file), overrides={"vehicle": FLOWN["vehicle"]}) for file in (flight, out))
    (circle,) = {stage.trigger_at(()) for stage in plan.world.mission.plan.stages if stage.command(31)}
    assert any(stage.command(31) for stage in mission.world.mission.plan.stages)
    there, here = plan.preflight().forecast, mission.preflight().forecast
    assert here.energy_wh == pytest.approx(there.energy_wh, rel=0.01)
    if to != "ardupilot":
        return
    (item,) = (row for row in rows(out) if row[3] == 31)
    # heading required, to the left round 36 m, left along the tangent, up to the altitude of the lines
    assert (item[4], item[5], item[7], item[10]) == (1, -36, 1, 100)
    after = rows(out)[rows(out).index(item) + 1]
    place = to_local_m(after[8], after[9], plan.world.mission.plan.site.origin_deg)
    assert place == pytest.approx(circle, abs=0.01), "the line begins where the circle does"
    flown = fly(str(flight), overrides={"vehicle": FLOWN["vehicle"]}, warn=lambda _: None)
    first = next(stage.index for stage in plan.world.mission.plan.stages if stage.command(31))
    after = flown.columns["stage"].astype(int) > first
    assert flown.columns["altitude_m"][after].min() >= 98


def test_sorties_land(eadp, tmp_path):
    (tmp_path / "field.csv").write_text(FIELD)
    out = tmp_path / "job"
    words = ("cover", tmp_path / "field.csv", "--metres", "--swath", "80", "--vehicle", "vehicles/foam-wing.yaml")
    given = ("--altitude", "60", "--landing", "-100,-100,90", "--takeoff", "200", "--sorties", "2", "-o", out)
    answer = eadp(*words, *given, "--pattern", "dubins", "--heading", "90")
    assert answer.code == 0, answer.err
    for name in ("sortie-01", "sortie-02"):
        plan, _ = read_plan(read_text(str(out / f"{name}.plan")))
        first, last = plan.stages[0], plan.stages[-1]
        assert first.command(22)[-1] == TAKE_OFF_M
        (x, y), home = first.trigger_at(()), plan.site.home_m
        assert math.degrees(math.atan2(x - home[0], y - home[1])) % 360 == pytest.approx(200, abs=0.1)
        assert last.trigger_at(()) == pytest.approx((-100, -100), abs=1e-3)
        assert last.altitude_m == 0
    again = load_flight(str(out / "sortie-01.plan"), scenario=str(out / "scenario.yaml")).preflight().forecast
    row = json.loads((out / "sorties.json").read_text())["sorties"][0]
    assert row["energy_wh"] == pytest.approx(again.energy_wh, rel=1e-3)


@pytest.mark.slow
def test_an_approach_that_leaves_the_boundary_is_none_and_one_over_a_low_wall_is(eadp, tmp_path):
    files = {"field": FIELD, "inside": "x_m,y_m\n-300,-300\n900,-300\n900,600\n-300,600\n"}
    for name, text in files.items():
        (tmp_path / f"{name}.csv").write_text(text)
    ring = [(500, -150), (520, -150), (520, -50), (500, -50), (500, -150)]
    wall = {"type": "Feature", "units": "m", "properties": {"name": "wall", "height": 10}}
    wall["geometry"] = {"type": "Polygon", "coordinates": [ring]}
    (tmp_path / "wall.geojson").write_text(json.dumps(wall))
    words = ("cover", tmp_path / "field.csv", "--metres", "--swath", "80", "--vehicle", "vehicles/foam-wing.yaml",
             "--altitude", "60", "--pattern", "dubins", "--heading", "90")  # fmt: skip
    given = ("--inside", tmp_path / "inside.csv", "--altitude", "120")
    answer = eadp(*words, *given, "--landing", "870,-100,270")
    assert answer.code == 1
    # it begins beyond the boundary's east, at x = 900, from any height
    where = r"the final approach of \d+ m .* does not stay inside the boundary at \((\d+), -100\) m"
    assert float(re.search(where, answer.err)[1]) > 900
    assert "expected another heading" in answer.err
    assert eadp(*words, *given, "--landing", "870,-100,90").code == 0
    # with more room it begins within, lower, after a circle down to it
    answer = eadp(*words, *given, "--landing", "0,-100,270", "--format", "text")
    assert answer.code == 0, answer.err
    approach = re.search(r"final approach of (\d+) m from (\d+) m, 5.0°, after a circle down to it", answer.out)
    assert float(approach[1]) < 900
    assert 30 <= float(approach[2]) < 120
    # a sortie flies as many circles
    for out, more in (("one.plan", ()), ("job", ("--sorties", "1"))):
        answer = eadp(*words, *given, "--landing", "0,-100,270", *more, "-o", tmp_path / out)
        assert answer.code == 0, answer.err
    one, sortie = ((tmp_path / out).read_text().count(": command 31 ") for out in ("one.plan", "job/sortie-01.plan"))
    assert one == sortie > 0
    plan = tmp_path / "p.plan"
    # 500 m before the place, the approach is half way down; the wall is 10 m high
    ends = ("--landing", "0,-100,270", "--home", "-50,300")
    answer = eadp(*words, *ends, "--avoid", tmp_path / "wall.geojson", "-o", plan)
    assert answer.code == 0, answer.err
    assert "flown over" in answer.err
    assert eadp("plan", plan, "--check").code == 0
    answer = eadp("simulate", plan, "--set", f"vehicle={ROOT / 'vehicles/foam-wing.yaml'}")
    assert answer.code == 0, answer.out


def test_a_place_that_no_way_leads_to_is_named_before_the_search(eadp, tmp_path):
    # the approach to the east begins 20 m from the boundary, nearer than an aircraft turns
    (tmp_path / "field.csv").write_text(FIELD)
    (tmp_path / "s.yaml").write_text("schema: eadp.scenario/1\nautopilot: {kind: px4}\n")
    begins_m = 300 - 30 / math.tan(math.radians(FLAT_DEG))
    words = ("cover", tmp_path / "field.csv", "--metres", "--swath", "80", "--vehicle", "vehicles/foam-wing.yaml",
             "--altitude", "30", "--landing", "300,-100,90", "--home", "-50,100", "--heading", "90",
             "--scenario", tmp_path / "s.yaml")  # fmt: skip
    west_m = begins_m - 20
    (tmp_path / "inside.csv").write_text(f"x_m,y_m\n{west_m},-300\n900,-300\n900,600\n{west_m},600\n")
    answer = eadp(*words, "--inside", tmp_path / "inside.csv")
    assert answer.code == 1
    assert f"no way between the lines and ({begins_m:.0f}, -100) m is found that stays inside the" in answer.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--landing", "55.47,10.33"), "--landing:1:1: error: no place and heading"),
        (("--landing", "55.47,10.33,400"), "--landing:1:1: error: no heading"),
        (("--landing", "10.33,55.47,90"), "--landing:1:1"),
        (("--takeoff", "90"), "--takeoff:1:1: error: no home to take off from"),
        (("--home", "55.47,10.33", "--takeoff", "-400"), "--takeoff:1:1: error: no heading"),
    ],
)
def test_what_cannot_be_landed_is_refused(eadp, words, message):
    assert refused(eadp(*COVER, *words), message)


def test_a_plan_that_lands_and_an_aircraft_that_holds_its_altitude_are_refused(eadp, tmp_path):
    scenario = tmp_path / "s.yaml"
    scenario.write_text("schema: eadp.scenario/1\nvehicle: {airframe: {model: paper}}\n")
    cover = ("cover", "plans/meadow.geojson", "--swath", "60", "--min-radius", "30", "--scenario", scenario)
    assert refused(eadp(*cover, "--landing", ",".join(map(str, LAND))), "holds its altitude")
