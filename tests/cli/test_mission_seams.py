"""What a plan carries, through every door: cover writes it, simulate, plan, export and the page do not forget it."""

from __future__ import annotations

import json

import pytest
from common import ROOT

BOX = "0 0, 600 0, 600 400, 0 400"
LIMITS = {
    "field": "x_m,y_m\n0,0\n600,0\n600,400\n0,400\n",
    "avoid": "x_m,y_m\n250,150\n330,150\n330,260\n250,260\n",
    "inside": "x_m,y_m\n-90,-90\n690,-90\n690,490\n-90,490\n",
}
PROFILE = ("--profile", "profiles/pednet-jetson-nano.yaml")
HEADERS = ("home", "avoid", "inside", "min-radius", "made-for", "swath", "field")


@pytest.fixture
def covered(eadp, tmp_path):
    """A plan of a field with an obstacle, a boundary and a home."""
    for name, text in LIMITS.items():
        (tmp_path / f"{name}.csv").write_text(text)
    options = ("--metres", "--swath", "40", "--home", "-50,-50", "--wind", "3,270")
    limits = ("--avoid", tmp_path / "avoid.csv", "--inside", tmp_path / "inside.csv")
    out = tmp_path / "covered.plan"
    assert eadp("cover", tmp_path / "field.csv", *options, *limits, *PROFILE, "-o", out).code == 0
    return out


def headers(text):
    return {line.split()[1]: line for line in text.splitlines() if line.startswith("%:")}


def moved(plan, tmp_path, corners, name="house"):
    """The plan with its obstacle somewhere else."""
    text = plan.read_text()
    path = tmp_path / "moved.plan"
    path.write_text(text.replace(headers(text)["avoid"], f"%: avoid {name} {corners}"))
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


def test_a_flight_keeps_out_and_says_so(eadp, covered):
    answer = eadp("simulate", covered, *PROFILE, "--set", "wind.speed_mps=3", "--format", "json")
    summary = json.loads(answer.out)
    assert answer.code == 0
    assert summary["completed"]
    assert summary["obstacles"] == []


def test_a_flight_into_an_obstacle_is_not_completed(eadp, covered, tmp_path):
    plan = moved(covered, tmp_path, "100,-20 120,-20 120,500 100,500")
    folder = tmp_path / "out"
    answer = eadp("simulate", plan, *PROFILE, "-o", folder)
    assert answer.code == 1
    assert "NOT completed: entered house at " in answer.out
    summary = json.loads((folder / "summary.json").read_text())
    (entry,) = summary["obstacles"]
    assert (entry["name"], summary["completed"], summary["reserve_kept"]) == ("house", False, False)
    # a wall of 20 m across every line
    assert entry["inside_m"] > 0.99 * 20 * 9
    page = (folder / "report.html").read_text()
    assert "house" in page
    assert "entered house" in page
    ignored = eadp("simulate", plan, *PROFILE, "--set", "obstacles=ignore")
    assert ignored.code == 0


def test_an_obstacle_lower_than_the_flight_is_flown_over(eadp, covered, tmp_path):
    plan = moved(covered, tmp_path, "100,-20 120,-20 120,500 100,500", "house height 12")
    high = eadp("simulate", plan, *PROFILE)  # at the aircraft's own altitude
    plan.write_text("%: altitude 11\n" + plan.read_text())
    low = eadp("simulate", plan, *PROFILE)
    assert (low.code, high.code) == (1, 0)


def test_a_flight_beyond_the_boundary_is_not_completed(eadp, covered, tmp_path):
    text = covered.read_text()
    plan = tmp_path / "small.plan"
    plan.write_text(text.replace(headers(text)["inside"], "%: inside -90,-90 500,-90 500,490 -90,490"))
    answer = eadp("simulate", plan, *PROFILE)
    assert answer.code == 1
    assert "NOT completed: left the boundary at " in answer.out


def test_a_sweep_judges_its_flights_alike(eadp, covered, tmp_path):
    plan = moved(covered, tmp_path, "100,-20 120,-20 120,500 100,500")
    sweep = tmp_path / "sweep.yaml"
    lines = ["schema: eadp.sweep/1", f"plan: {plan}", "profile: profiles/pednet-jetson-nano.yaml"]
    sweep.write_text("\n".join([*lines, "grid: {wind.speed_mps: [0, 3]}"]).replace("profiles/", f"{ROOT}/profiles/"))
    rows = eadp("sweep", sweep, "--format", "csv").out.splitlines()
    assert len(rows) == 3
    assert all("entered house" in row for row in rows[1:])


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
