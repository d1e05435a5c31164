"""`eadp replan` on recorded flights that went wrong, and on the example made wrong in the same way.

The recordings are no part of the project: each of their tests is skipped where they are absent.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from common import ROOT

from eadp.cli.main import main

TROUBLE = ROOT.parent / "shared/reference/trouble"
SURVEY, PROFILE = "plans/survey.plan", "profiles/pednet-jetson-nano.yaml"
EXAMPLE = [json.loads(line) for line in (ROOT / "scenarios/example-telemetry.jsonl").read_text().splitlines()]


@pytest.fixture
def replan(capsys, monkeypatch, tmp_path):
    """Exit code and decisions of lines of telemetry."""
    monkeypatch.chdir(ROOT)

    def run(lines, plan=SURVEY, scenario="scenarios/survey.yaml", *arguments):
        path = tmp_path / "telemetry.jsonl"
        path.write_text("".join(json.dumps(line) + "\n" for line in lines))
        given = [str(plan), "--scenario", str(scenario), "--profile", PROFILE, "--telemetry", str(path), *arguments]
        code = main(["replan", *given])
        captured = capsys.readouterr()
        return code, [json.loads(line) for line in captured.out.splitlines()], captured.err

    return run


def recorded(name):
    """Scenario and lines of a recorded flight."""
    folder = TROUBLE / name
    if not folder.is_dir():
        pytest.skip(f"no recorded flight {folder}")
    lines = (folder / "telemetry.jsonl").read_text().splitlines()
    return folder / "scenario.yaml", [json.loads(line) for line in lines]


def mathematical(line):
    """The line with its heading sent as a mathematical angle."""
    return line | {"heading_deg": 90 - line["heading_deg"]}


# --- headings


def implied_wind_mps(lines, airspeed_mps, heading_rad):
    """Mean of v − s(cos θ, sin θ)."""
    velocities = np.array([complex(*line["velocity_mps"]) for line in lines])
    return np.mean(velocities - airspeed_mps * np.exp(1j * np.array([heading_rad(line) for line in lines])))


def check_headings(decisions, wind, within_s):
    first = next(line for line in decisions if "heading-disbelieved" in line["warnings"])
    assert first["time_s"] < within_s
    later = [line for line in decisions if line["time_s"] > first["time_s"] + 60 and line["wind_mps"] is not None]
    assert len(later) > 100
    assert all("heading-disbelieved" in line["warnings"] for line in later)
    assert max(abs(complex(*line["wind_mps"]) - wind) for line in later) < 2.0


def test_mathematical_headings_are_disbelieved_and_the_wind_is_found_without(replan):
    code, right, _ = replan(EXAMPLE)
    assert not any("heading-disbelieved" in line["warnings"] for line in right)
    code, decisions, _ = replan([mathematical(line) for line in EXAMPLE])
    assert code == 0
    check_headings(decisions, complex(*right[-2]["wind_mps"]), 100)


def test_a_recorded_flight_with_mathematical_headings(replan):
    scenario, lines = recorded("heading")
    code, decisions, _ = replan(lines, TROUBLE / "meadow.plan", scenario)
    assert code == 0
    wind = implied_wind_mps(lines, 15.0, lambda line: math.radians(line["heading_deg"]))
    check_headings(decisions, wind, 60)
    assert not any("cannot be flown" in line["reason"] for line in decisions if line["time_s"] > 60)
