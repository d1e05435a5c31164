"""The vehicle of the page flies the mission that the page exports."""

import importlib.util
import re
import shlex
from pathlib import Path

import pytest
from common.plans import placed_survey

from eadp.cli.main import main

ROOT = Path(__file__).resolve().parents[1]


def test_the_vehicle_flies_the_mission_that_the_page_exports(tmp_path, monkeypatch):
    """With the pack asked for; home before the mission's last item it has not completed it."""
    pytest.importorskip("jsbsim", reason="the aeroplane flies in JSBSim: pip install 'eadp[bench]'")
    placed_survey(tmp_path).rename(tmp_path / "desk.plan")
    (export,) = re.findall(r"^(eadp export .*)$", (ROOT / "docs/companion.md").read_text(), re.M)
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(export)[1:]) == 0
    spec = importlib.util.spec_from_file_location("vehicle", ROOT / "docs/examples/vehicle.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    vehicle = module.Vehicle(tmp_path / "desk.waypoints", (0.0, 0.0), 1.3, 0, cells=6)
    vehicle.step()
    assert 6 * 3.9 < vehicle.pack.voltage_v < 6 * 4.2
    vehicle.pilot.mode, vehicle.pilot.done = "return", True
    assert not vehicle.completed
    vehicle.holder.current = len(vehicle.holder.items)
    assert vehicle.completed
