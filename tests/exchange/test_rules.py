"""What PX4 asks of a mission before it arms: exports of the presets beside its own checks, and what is refused."""

import json
import re

import pytest
from common import ROOT
from common.armed import px4_refuses

PLACE = "55.4712,10.3295"
VEHICLES = ("foam-wing", "survey-wing", "mapper", "small-wing")
FIELD = ("plans/meadow.geojson", "--swath", "60", "--pattern", "dubins", "--heading", "94", "--wind", "4,240")


@pytest.mark.quick(2)
@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("ends", [("--landing", f"{PLACE},250"), ("--home", PLACE)])
def test_exports_of_the_presets_are_armed_or_it_is_said_what_to_set(eadp, tmp_path, vehicle, ends):
    """Without a landing PX4 asks for one until MIS_TKO_LAND_REQ is 0."""
    plan, mission = tmp_path / "p.plan", tmp_path / "m.plan"
    wing = ROOT / f"vehicles/{vehicle}.yaml"
    answer = eadp("cover", *FIELD, "--vehicle", wing, "--altitude", "80", *ends, "-o", plan)
    assert answer.code == 0, answer.err
    assert "PX4 needs" not in answer.out
    answer = eadp("export", plan, "--to", "px4", "-o", mission)
    assert answer.code == 0, answer.err
    lands = ends[0] == "--landing"
    assert px4_refuses(mission) == ([] if lands else ["ends required"])
    assert px4_refuses(mission, required=0) == []
    assert ("MIS_TKO_LAND_REQ" in answer.err) == (not lands)
    if not lands:
        own = "{kind: px4, parameters: {MIS_TKO_LAND_REQ: 0}}"
        (tmp_path / "s.yaml").write_text(f"schema: eadp.scenario/1\nvehicle: {wing}\nautopilot: {own}\n")
        answer = eadp("export", plan, "--to", "px4", "--scenario", tmp_path / "s.yaml", "-o", mission)
        assert "MIS_TKO_LAND_REQ" not in answer.err


def test_a_steep_approach_is_refused_with_what_to_state_and_armed_with_that(eadp, tmp_path):
    plan, mission, scenario = tmp_path / "p.plan", tmp_path / "m.plan", tmp_path / "s.yaml"

    def state(autopilot):
        wing = ROOT / "vehicles/foam-wing.yaml"
        scenario.write_text(f"schema: eadp.scenario/1\nvehicle: {wing}\nautopilot: {autopilot}\n")

    state("{kind: ardupilot}")
    given = ("cover", *FIELD, "--scenario", scenario, "--altitude", "80", "--landing", f"{PLACE},250")
    assert eadp(*given, "-o", plan).code == 0
    answer = eadp("export", plan, "--to", "px4", "-o", mission)
    assert answer.code == 1
    assert not mission.exists()
    said = r"final approach of (\d\.\d)° is steeper than FW_LND_ANG, 5°;.*FW_LND_ANG: (\S+)"
    steep, least = re.search(said, answer.err).groups()
    assert float(steep) > 5.1
    for to in ("ardupilot", "qgc"):
        assert eadp("export", plan, "--to", to, "-o", mission).code == 0
    state(f"{{kind: px4, parameters: {{FW_LND_ANG: {least}}}}}")
    assert eadp("export", plan, "--to", "px4", "--scenario", scenario, "-o", mission).code == 0
    assert px4_refuses(mission) == [f"slope of {steep}°"]
    assert px4_refuses(mission, float(least)) == []
    # and what is planned for PX4 with its factory's value is armed
    state("{kind: px4}")
    assert eadp(*given, "-o", plan).code == 0
    assert eadp("export", plan, "--to", "px4", "-o", mission).code == 0
    assert px4_refuses(mission) == []


@pytest.mark.parametrize(
    ("last", "message"),
    [
        ([(189,), (16, 47.002, 8.02, 60), (20,)], "one DO_LAND_START (189), before a landing"),
        ([(16, 47.002, 8.02, 60), (21, 47.0, 8.02, 60)], "begins no higher than the landing"),
        ([(16, 47.002, 8.02, 60), (21, 47.002, 8.013, 0)], "is steeper than FW_LND_ANG, 5°"),
    ],
)
def test_missions_of_others_that_px4_refuses(eadp, tmp_path, last, message):
    rows, given, mission = ["QGC WPL 110"], tmp_path / "given.waypoints", tmp_path / "m.plan"
    for i, (command, *place) in enumerate([(16, 47.0, 8.0, 0), (22, 0, 0, 50), (16, 47.003, 8.01, 60), *last]):
        lat, lon, up = place or (0, 0, 0)
        rows.append(f"{i}\t0\t3\t{command}\t0\t0\t0\t0\t{lat}\t{lon}\t{up}\t1")
    given.write_text("\n".join(rows) + "\n")
    answer = eadp("export", given, "--to", "px4", "-o", mission)
    assert answer.code == 1
    assert message in answer.err
    assert eadp("export", given, "--to", "ardupilot", "-o", tmp_path / "m.waypoints").code == 0


@pytest.mark.slow
def test_a_circle_that_leads_down_is_a_loiter_to_altitude_in_each_format_and_read_back(eadp, tmp_path):
    """In a boundary that has no room for an approach from 120 m."""
    (tmp_path / "field.csv").write_text("lat_deg,lon_deg\n47,8\n47,8.008\n47.003,8.008\n47.003,8\n")
    (tmp_path / "in.csv").write_text("lat_deg,lon_deg\n46.997,7.996\n46.997,8.012\n47.006,8.012\n47.006,7.996\n")
    wing, plan = ROOT / "vehicles/foam-wing.yaml", tmp_path / "p.plan"
    given = ("--swath", "80", "--vehicle", wing, "--altitude", "120", "--pattern", "dubins", "--heading", "90")
    answer = eadp("cover", tmp_path / "field.csv", *given, "--inside", tmp_path / "in.csv",
                  "--landing", "46.999,8.0,270", "-o", plan)  # fmt: skip
    assert answer.code == 0, answer.err
    assert "°, after a circle down to it" in answer.out
    (tmp_path / "s.yaml").write_text(f"schema: eadp.scenario/1\nvehicle: {wing}\n")

    def forecast_wh(file):
        answer = eadp("simulate", file, "--scenario", tmp_path / "s.yaml", "--planner", "static")
        assert answer.code == 0, answer.out
        return float(re.search(r"([\d.]+) ± \S+ Wh in", answer.out)[1])

    planned_wh = forecast_wh(plan)
    for to, name in (("px4", "a.plan"), ("qgc", "b.plan"), ("ardupilot", "c.waypoints")):
        words = ("export", plan, "--to", to, "--scenario", tmp_path / "s.yaml")
        assert eadp(*words, "-o", tmp_path / name).code == 0
        assert forecast_wh(tmp_path / name) == pytest.approx(planned_wh, rel=0.01)
    assert px4_refuses(tmp_path / "a.plan") == []
    start, circle, land = json.loads((tmp_path / "a.plan").read_text())["mission"]["items"][-3:]
    assert [item["command"] for item in (start, circle, land)] == [189, 31, 21]
    assert (circle["params"][0], circle["params"][3]) == (1, 1), "left along the tangent towards the landing"
    pattern = json.loads((tmp_path / "b.plan").read_text())["mission"]["items"][-1]
    assert pattern["useLoiterToAlt"] is True
    assert pattern["loiterRadius"] == abs(circle["params"][1])
    assert pattern["loiterClockwise"] == (circle["params"][1] > 0)
    assert pattern["landingApproachCoordinate"] == circle["params"][4:]
    rows = [line.split("\t") for line in (tmp_path / "c.waypoints").read_text().splitlines()[1:]]
    assert [row[3] for row in rows[-3:]] == ["189", "31", "21"]
