"""A survey that QGroundControl can edit: what is flown is the plan, and what it would lay is the same field."""

from __future__ import annotations

import json
import math

import pytest
import shapely
from common.answers import refused

from eadp.api.inputs import load_flight
from eadp.core.geometry.geodesy import to_local_m

ORIGIN = (55.4, 10.4)
CORNERS = ((3, 7), (601, 41), (563, 417), (-43, 396))


def field(tmp_path, corners=CORNERS):
    path = tmp_path / "field.csv"
    path.write_text("x_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in corners))
    return path


def surveyed(eadp, tmp_path, *options, to="qgc"):
    """A coverage, its mission with a survey, and that item."""
    plan, mission = tmp_path / "p.plan", tmp_path / f"{to}.plan"
    words = ("cover", field(tmp_path), "--metres", "--min-radius", "30", "--swath", "80", "--pattern", "dubins")
    assert eadp(*words, "--altitude", "60", *options, "-o", plan).code == 0
    answer = eadp("export", plan, "--to", to, "--survey", "--origin", f"{ORIGIN[0]},{ORIGIN[1]}", "-o", mission)
    assert answer.code == 0, answer.err
    assert "QGroundControl lays its lines anew" in answer.err
    items = json.loads(mission.read_text())["mission"]["items"]
    (survey,) = (item for item in items if item.get("complexItemType") == "survey")
    return plan, mission, survey


def local(positions):
    return [to_local_m(*position, ORIGIN) for position in positions]


def laid_by_qgroundcontrol(survey):
    """The lines that QGroundControl lays, by its `_rebuildTransectsPhase1WorkerSinglePolygon`, east and north [m]."""
    corners = local(survey["polygon"])
    angle = survey["angle"] - (180 if survey["angle"] > 90 else 0)
    spacing_m = survey["TransectStyleComplexItem"]["CameraCalc"]["AdjustedFootprintSide"]
    west, south, east, north = shapely.Polygon(corners).bounds
    middle = ((west + east) / 2, (south + north) / 2)
    half_m = (max(east - west, north - south) + 2000) / 2
    cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    lines = []
    for k in range(int(2 * half_m / spacing_m) + 1):
        x = -half_m + k * spacing_m
        ends = [(middle[0] + x * cosine + y * sine, middle[1] - x * sine + y * cosine) for y in (-half_m, half_m)]
        edges = zip(corners, [*corners[1:], corners[0]], strict=True)
        crossing = [shapely.LineString(ends).intersection(shapely.LineString(edge)) for edge in edges]
        points = [(point.x, point.y) for point in crossing if not point.is_empty]
        if len(points) > 1:
            pairs = [(math.dist(a, b), -i, a, b) for i, a in enumerate(points) for b in points]
            lines.append(max(pairs)[2:])

    def direction(line):
        return math.atan2(line[1][1] - line[0][1], line[1][0] - line[0][0])

    lines = [
        line if abs(math.remainder(direction(line) - direction(lines[0]), 2 * math.pi)) < 0.1 else line[::-1]
        for line in lines
    ]
    if survey["entryLocation"] in (2, 3):
        lines = [line[::-1] for line in lines]
    if survey["entryLocation"] in (1, 3):
        lines = lines[::-1]
    return [line if i % 2 == 0 else line[::-1] for i, line in enumerate(lines)]


@pytest.mark.parametrize("heading", [0, 65, 90, 140])
@pytest.mark.parametrize("start", ["-200,-200", "800,-200", "800,600", "-200,600"])
def test_it_enters_nearest_to_where_the_plan_does_and_is_as_dense(eadp, tmp_path, heading, start):
    _, _, survey = surveyed(eadp, tmp_path, "--heading", str(heading), f"--start={start}")
    flown = local(survey["TransectStyleComplexItem"]["VisualTransectPoints"])
    laid = [laid_by_qgroundcontrol(survey | {"entryLocation": entry}) for entry in range(4)]
    assert abs(len(laid[0]) - len(flown) / 2) <= 1
    starts_m = [math.dist(lines[0][0], flown[0]) for lines in laid]
    assert starts_m[survey["entryLocation"]] == min(starts_m)
    assert survey["angle"] == pytest.approx(heading % 180, abs=0.01)


@pytest.mark.parametrize("to", ["qgc", "px4"])
def test_what_is_flown_is_the_plan(eadp, tmp_path, to):
    home = ("--home", "-100,-100", "--landing=-100,-100,90", "--wind", "2,270")
    plan, mission, survey = surveyed(eadp, tmp_path, "--heading", "90", *home, to=to)
    there, here = (load_flight(str(path)).preflight().forecast for path in (plan, mission))
    assert here.energy_wh == pytest.approx(there.energy_wh, rel=0.01)
    assert here.remaining_s == pytest.approx(there.remaining_s, rel=0.01)
    items = json.loads(mission.read_text())["mission"]["items"]
    commands = [item.get("complexItemType") or item["command"] for item in items]
    assert commands[0] == 22
    assert commands[-1] == ("fwLandingPattern" if to == "qgc" else 21)
    # from the start of the first line to the end of the last
    lines = local(survey["TransectStyleComplexItem"]["VisualTransectPoints"])
    first, *_, last = (item for item in survey["TransectStyleComplexItem"]["Items"] if item["command"] == 16)
    assert math.dist(local([first["params"][4:6]])[0], lines[0]) < 1
    assert math.dist(local([last["params"][4:6]])[0], lines[-1]) < 1


def test_its_keys_are_those_of_qgroundcontrol(eadp, tmp_path, reference):
    """As files of version 5 have them; another version of the camera's values is read, too."""
    camera = ("--sensor-width-mm", "13.2", "--sensor-height-mm", "8.8", "--focal-length-mm", "9", "--forward-overlap",
              "75", "--wind", "0,0")  # fmt: skip
    plan, mission = tmp_path / "p.plan", tmp_path / "m.plan"
    words = ("cover", field(tmp_path), "--metres", "--min-radius", "30", "--altitude", "60", "--heading", "90")
    assert eadp(*words, *camera, "--pattern", "dubins", "-o", plan).code == 0
    assert eadp("export", plan, "--to", "qgc", "--survey", "--origin", "55.4,10.4", "-o", mission).code == 0
    items = json.loads(mission.read_text())["mission"]["items"]
    (survey,) = (item for item in items if item.get("complexItemType") == "survey")
    inner = survey["TransectStyleComplexItem"]
    distance_m = 60 * 8.8 / 9 * 0.25
    assert inner["CameraCalc"]["AdjustedFootprintFrontal"] == pytest.approx(distance_m)
    assert inner["CameraCalc"]["DistanceToSurface"] == 60
    lengths_m = [
        math.dist(*pair)
        for pair in zip(
            local(inner["VisualTransectPoints"])[::2], local(inner["VisualTransectPoints"])[1::2], strict=True
        )
    ]
    assert inner["CameraShots"] == pytest.approx(sum(lengths_m) / distance_m, abs=1.5)
    assert [item["params"][0] for item in inner["Items"] if item["command"] == 206][-1] == 0, "off after the last"
    real = json.loads((reference / "real/neilvaltec_b95e8_test.plan").read_text())["mission"]["items"]
    (other,) = (item for item in real if item.get("complexItemType") == "survey")
    assert survey.keys() == other.keys()
    assert inner.keys() == other["TransectStyleComplexItem"].keys()
    assert inner["CameraCalc"].keys() == other["TransectStyleComplexItem"]["CameraCalc"].keys()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--pattern", "zamboni", "--swath", "80"), "its laps have a spacing that is planned in flight"),
        (("--pattern", "dubins", "--swath", "80"), "the format ardupilot has no surveys"),
    ],
)
def test_what_is_no_survey_is_refused(eadp, tmp_path, options, message):
    plan = tmp_path / "p.plan"
    assert eadp("cover", field(tmp_path), "--metres", "--min-radius", "30", *options, "-o", plan).code == 0
    to = "ardupilot" if "ardupilot" in message else "qgc"
    assert refused(eadp("export", plan, "--to", to, "--survey", "--origin", "55.4,10.4"), message)


def test_several_fields_and_none_are_refused(eadp, tmp_path):
    plan = tmp_path / "p.plan"
    head = "%: origin 55.4 10.4\n"
    plan.write_text(head + "0.1; 90; x\n0, 300\n")
    assert refused(eadp("export", plan, "--to", "qgc", "--survey"), "it has no field")
    parts = "%: field 0 0, 100 0, 100 100, 0 100\n%: field 200 0, 300 0, 300 100, 200 100\n"
    plan.write_text(head + parts + "0.1; 90; x\n0, 300\n")
    assert refused(eadp("export", plan, "--to", "qgc", "--survey"), "its field has 2 parts")
