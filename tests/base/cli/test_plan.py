"""`eadp plan`: the documented JSON, the canonical text, refusals."""

import json

import pytest
import sympy
from common.answers import refused
from common.plans import PARTS

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.models.plan.trace import trace


def test_the_survey_as_json(eadp):
    answer = eadp("plan", "plans/survey.plan", "--format", "json")
    assert answer.code == 0
    document = json.loads(answer.out)
    assert document["schema"] == "eadp.plan/1"
    assert [stage["kind"] for stage in document["stages"]] == ["circle", "line", "circle", "line"]
    assert [stage["rotation_deg"] for stage in document["stages"]] == [90, 270, 90, 90]
    assert document["repeats"] is True
    assert document["primitive_stages"] == 4
    assert document["shift"] == ["150 - 2*sqrt(4900 + c1)", "15 - sqrt(4900 + c1)/5"]
    assert document["final"] == {"x": 175, "y": 161}
    assert document["stages"][1]["trigger"] == {"x": -115, "y": -11}
    assert document["stages"][0]["sets"] == [
        {"name": "c1", "kind": "path", "min": -1000, "max": 0},
        {"name": "c2", "kind": "computation", "min": 2, "max": 10},
    ]
    assert document["findings"] == []


@pytest.mark.parametrize(
    ("function", "direction"),
    [("x^2+y^2-2500", "counter-clockwise"), ("-x^2-y^2+2500", "clockwise"), ("c1*(x^2+y^2-2500)", "rotation 90")],
)
def test_a_circle_is_named_by_the_direction_in_which_it_is_flown(eadp, tmp_path, function, direction):
    path = tmp_path / "circle.plan"
    path.write_text(f"%: start 50 0\n0.1; 90; {function}\n-50, 0\n[2, 10]\n")
    assert f"circle {direction}, gain" in eadp("plan", path).out


def test_a_trigger_with_a_radius_of_its_own(eadp, tmp_path):
    path, figure = tmp_path / "two.plan", tmp_path / "two.svg"
    path.write_text("0.1; 90; x\n0, 100, 5\n0.1; 90; x\n0, 300\n")
    document = json.loads(eadp("plan", path, "--format", "json").out)
    assert [stage["trigger"] for stage in document["stages"]] == [{"x": 0, "y": 100, "radius_m": 5}, {"x": 0, "y": 300}]
    assert "until (0, 100), within 5 m" in eadp("plan", path).out
    assert "short-stage" not in eadp("plan", path, "--check").out
    path.write_text("0.1; 90; x\n0, 100\n0.1; 90; x\n0, 300, 250\n")
    assert "shorter than the trigger radius of 250 m" in eadp("plan", path, "--check").out
    assert eadp("plan", path, "--plot", figure).code == 0
    assert "trigger, radius 20 to 250 m" in figure.read_text()


# --- check, trace, plot


def test_check_of_the_survey_passes_with_warnings(eadp):
    answer = eadp("plan", "plans/survey.plan", "--check")
    assert answer.code == 0
    assert answer.out.count("warning:") == 6
    assert answer.out.endswith("4 stages: 0 errors, 6 warnings; 4 of 4 stages lead to the next for some parameters\n")
    assert "plans/survey.plan:24:1: warning: the trigger of stage 2 lies 3.16 m off" in answer.out
    assert answer.out.splitlines()[-5:-1] == [
        "trigger on its path  for every c1 in stages 1-2, 4; not in stage 3",
        "trigger on the next  for every c1 in stages 1, 3; not in stages 2, 4",
        "direction of travel  for every c1 in stage 1; not in stages 2-4",
        "laps alike           for all values",
    ]


def test_check_says_what_is_proven_and_what_is_sampled(eadp, tmp_path):
    path = tmp_path / "p.plan"
    path.write_text(PARTS)
    assert eadp("plan", path, "--check").out.splitlines() == [
        "trigger on its path  for every c1 in stages 1-6",
        "trigger on the next  for every c1 in stages 2-4; at the places tried in stages 1, 5",
        "direction of travel  for every c1 in stages 2-3; at the places tried in stages 1, 4-5",
        "6 stages: 0 errors, 0 warnings; 6 of 6 stages lead to the next for some parameters",
    ]
    path.write_text("0.1; 90; x\n0, 200\n")
    assert eadp("plan", path, "--check").out.splitlines()[0] == "trigger on its path  holds in stage 1"


def test_sympy_reads_what_it_printed(eadp, root):
    answer = eadp("plan", "plans/survey.plan", "--format", "sympy")
    assert answer.code == 0
    lines = answer.out.splitlines()
    stages = read_plan(read_text(str(root / "plans/survey.plan")))[0].stages
    assert len(lines) == 8 * len(stages)
    names = {name: sympy.Symbol(name, real=True) for name in ("x", "y", "c1")}
    for i, stage in enumerate(stages):
        phi, x, y, xx, xy, yy, *trigger = (sympy.sympify(line, locals=names) for line in lines[8 * i : 8 * i + 8])
        assert phi == stage.sympy.path
        assert sympy.Matrix([x, y]) == stage.sympy.gradient
        assert sympy.Matrix([[xx, xy], [xy, yy]]) == stage.sympy.hessian
        assert sympy.Matrix(trigger) == stage.sympy.trigger
    assert lines[-2:] == ["35  # trigger_4_x", "146  # trigger_4_y"]


def test_a_stage_that_sympy_cannot_print_is_named(eadp, tmp_path):
    path = tmp_path / "large.plan"
    path.write_text("0.1; 90; x\n0, 200\n0.1; 90; " + "*".join(f"(x-{i})" for i in range(1000)) + "\n0.5, 500\n")
    answer = eadp("plan", path, "--format", "sympy")
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.startswith(f"{path}:3:1: error: sympy gives no expressions of stage 2; expected expressions")


@pytest.mark.slow
def test_whether_laps_are_proven_alike_is_shown(eadp, tmp_path):
    path = tmp_path / "p.plan"
    path.write_text("".join(f"0.1; 90; x - {i}*sqrt(2)\n{i}*sqrt(2), 200\n" for i in range(4)))
    assert "laps alike           at the values tried\n" in eadp("plan", path, "--check").out


def test_check_that_finds_an_error_is_a_no(eadp, tmp_path):
    path = tmp_path / "off.plan"
    path.write_text("0.1; 90; x\n30, 200\n")
    answer = eadp("plan", path, "--check", "--format", "json")
    assert answer.code == 1
    document = json.loads(answer.out)
    assert document["valid"] is False
    assert document["leads_on"] == [None]
    assert [(item["severity"], item["code"], item["stage"]) for item in document["findings"]] == [
        ("error", "trigger-off-path", 1)
    ]
    assert eadp("plan", path).code == 0, "without --check it is only read"


def test_min_radius_on_the_command_line(eadp):
    assert eadp("plan", "plans/survey.plan", "--check", "--min-radius", "62").code == 0
    answer = eadp("plan", "plans/survey.plan", "--check", "--min-radius", "65")
    assert answer.code == 1
    # √(4900 − 1000)
    assert "radius of 62.45 m, 2.55 m less" in answer.out


def rows(text):
    lines = text.splitlines()
    assert lines[0].startswith("stage,kind,x_m,y_m,heading_rad")
    return [line.split(",") for line in lines[1:]]


def test_trace_is_the_nominal_path(eadp):
    points = rows(eadp("plan", "plans/survey.plan", "--trace", "5", "--set", "c1=-500").out)
    expected = trace(read_plan(read_text("plans/survey.plan"))[0], (-500.0, 10.0), 5.0)
    assert [(int(row[0]), row[1]) for row in points] == [point[:2] for point in expected]
    found = [[float(cell) for cell in row[2:5]] for row in points]
    assert found == [pytest.approx([point.x_m, point.y_m, point.heading_rad], abs=1e-6) for point in expected]


def test_trace_with_an_origin_tells_latitude_and_longitude(eadp, tmp_path):
    path = tmp_path / "map.plan"
    path.write_text("%: origin 55.37 10.43\n0.1; 90; x\n0, 100\n")
    answer = eadp("plan", path, "--trace", "50")
    assert answer.out.splitlines()[0] == "stage,kind,x_m,y_m,heading_rad,lat_deg,lon_deg"
    first = rows(answer.out)[0]
    assert float(first[5]) == pytest.approx(55.37)
    assert float(first[6]) == pytest.approx(10.43)


@pytest.mark.slow
def test_plots(eadp, tmp_path):
    for name, start in (("plan.svg", b"<?xml"), ("plan.png", b"\x89PNG")):
        assert eadp("plan", "plans/survey.plan", "--plot", tmp_path / name).code == 0
        assert (tmp_path / name).read_bytes().startswith(start)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--set", "c9=1", "--trace", "1"), "no parameter c9"),
        (("--set", "c1=5", "--trace", "1"), "outside its set"),
        (("--trace", "1e-9"), "more than 5000000 points"),
        (("--plot", "plan.pdf"), ".svg or .png"),
        (("--plot", "nosuch/folder/plan.svg"), "cannot be written"),
    ],
)
def test_what_is_refused(eadp, arguments, word):
    assert refused(eadp("plan", "plans/survey.plan", *arguments), word)


def test_triggers_have_latitudes_where_they_are_numbers(eadp, tmp_path):
    path = tmp_path / "a.plan"
    path.write_text("%: origin 55 10\n0.1; 90; x\n0, 300\n0.1; 270; y - 300 - c1\n500, 300 + c1\n")
    document = json.loads(eadp("plan", path, "--format", "json").out)
    first, second = (stage["trigger"] for stage in document["stages"])
    # a degree of the meridian at 55° north is 111,324 m, by pyproj
    assert first["lat_deg"] == pytest.approx(55 + 300 / 111_324, abs=1e-6)
    assert first["lon_deg"] == pytest.approx(10)
    assert set(second) == {"x", "y"}


def test_an_option_that_changes_a_plan_is_answered_with_the_pipe_to_type(eadp):
    answer = eadp("simulate", "plans/survey.plan", "--avoid", "z.csv", "-o", "folder")
    assert (answer.code, answer.out) == (2, "")
    pipe = "eadp plan PLAN --avoid … | eadp simulate -"
    assert answer.err.endswith(f" is an option of eadp plan: {pipe}\n")


def test_a_plan_that_is_changed_is_printed_as_a_plan(eadp, tmp_path):
    """By default alone: what is asked for is printed, and what a check finds."""
    zone = tmp_path / "zone.csv"
    zone.write_text("x_m,y_m\n500,500\n510,500\n510,510\n")
    given = ("plan", "plans/survey.plan", "--avoid", zone)
    plain = eadp("plan", "plans/survey.plan", "--format", "plan").out
    changed = eadp(*given).out
    assert set(changed.splitlines()) - set(plain.splitlines()) == {"%: avoid obstacle 1 500,500 510,500 510,510"}
    assert eadp(*given, "--format", "text").out == eadp("plan", "plans/survey.plan").out
    assert "stages: 0 errors" in eadp(*given, "--check").out


def test_a_plan_in_metres_has_no_terrain(eadp):
    assert refused(eadp("plan", "plans/survey.plan", "--terrain", "any.tif"), "--terrain:1:1", "no place on the earth")
