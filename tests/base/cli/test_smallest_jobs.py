"""Every command on the smallest jobs: a field of one line, plans of one stage or lap, missions of one waypoint."""

import json

import pytest
from common import few_rows
from common.answers import refused

from eadp.exchange.writer import EXPORTS

SWATH = ("--swath", "30", "--min-radius", "30")
FIELDS = {  # 25 m by 18 m
    "degrees": ([[10, 55], [10.0004, 55], [10.0004, 55.00016], [10, 55.00016]], {}, "55.0005,10.0002", "55.001,10,270"),
    "metres": ([[0, 0], [25, 0], [25, 18], [0, 18]], {"units": "m"}, "10,50", "10,100,270"),
}
WPL = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t55\t10\t0\t1\n1\t0\t3\t{}\t0\t0\t0\t0\t55.002\t10\t50\t1\n"
PLANS = {  # whether it has a place on the earth
    "one stage": ("%: origin 55 10\n0.1; 90; x - 12.5\n12.5, 180\n", True),
    "one stage of a parameter": ("0.1; 90; x - c1\nc1, 180\n[10, 20]\n", False),
    "one circle": ("0.001; 270; x^2 + y^2 - 80^2\n0, 80\n", False),
    "one lap": (
        "init:\nn=2\na = 0, 30\nb = 15, 30\npath:\n0.1; 90; x - a\na, 200\n0.1; 270; x - b\nb, 0\ntrig:\n15, 0\n",
        False,
    ),
    "one waypoint": (WPL.format(16), True),
    "one take-off": (WPL.format(22), True),
    "one landing": (WPL.format(21), True),
}


def field_file(folder, name):
    corners, stated, home, landing = FIELDS[name]
    path = folder / "field.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [[*corners, corners[0]]], **stated}))
    return path, home, landing


@pytest.fixture
def done(eadp):
    """Runs a command that has nothing to refuse."""

    def run(*arguments):
        answer = eadp(*arguments)
        assert answer.code == 0, (arguments, answer.err)
        return answer

    return run


@pytest.mark.parametrize("name", few_rows(((name,) for name in ("a line", "a landing", *PLANS)), 1))
def test_every_command_on_a_plan_of_one(done, eadp, tmp_path, name):
    plan = tmp_path / "a.plan"
    if name in PLANS:
        text, placed = PLANS[name]
        plan.write_text(text)
    else:
        field, home, landing = field_file(tmp_path, "degrees")
        placed = True
        ends = ("--home", home) if name == "a line" else ("--landing", landing)
        done("cover", field, *SWATH, *ends, "-o", plan)
    for form in ("text", "json", "plan", "sympy", "latex"):
        done("plan", plan, "--format", form)
    done("plan", plan, "--trace", "5")
    done("plan", plan, "--plot", tmp_path / "plan.svg")
    assert eadp("plan", plan, "--check").code in (0, 1)
    origin = () if placed else ("--origin", "55,10")
    for to in EXPORTS:
        if (name, to) == ("one landing", "px4"):  # which has no approach
            answer = eadp("export", plan, "--to", to)
            assert (answer.code, answer.out) == (1, "")
            assert "PX4 does not arm" in answer.err
        else:
            done("export", plan, "--to", to, *origin)
    done("export", plan, "--to", "ardupilot", *origin, "--from", "1,0")
    done("export", plan, "--to", "qgc", *origin, "--home", "55.001,10")
    scenario, wanted = tmp_path / "scenario.yaml", tmp_path / "a.param"
    scenario.write_text("schema: eadp.scenario/1\n")
    done("export", plan, "--to", "ardupilot", *origin, "--scenario", scenario, "--parameters", wanted)
    answer = eadp("export", plan, "--to", "qgc", *origin, "--landing", "55.01,10,270")
    assert answer.code == 0 or refused(answer)
    for planner in ("static", "joint", "paper"):
        done("simulate", plan, "--planner", planner, "-o", tmp_path / planner)
    done("report", tmp_path / "joint")
    telemetry, log = tmp_path / "telemetry.jsonl", tmp_path / "log.jsonl"
    rows = [{"time_s": k, "x_m": 12.5, "y_m": 15.0 * k, "power_w": 60, "soc": 0.9} for k in range(8)]
    telemetry.write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    assert eadp("replan", plan, "--telemetry", telemetry, "--log", log).code in (0, 1)
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text(f"schema: eadp.sweep/1\nplan: {plan}\ngrid:\n  wind.speed_mps: [0, 2]\n")
    done("sweep", sweep, "-o", tmp_path / "s.db", "--jobs", "1")
