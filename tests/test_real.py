"""Missions that others made, of a folder beside the project: refused with the reason, or forecast as they are flown."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from eadp.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

import real  # noqa: E402

REFUSED = {
    "ArduPilot_ace97_fence-110.txt": "a fence, and no mission",
    "ArduPilot_ce1e8_rally-110.txt": "places to rally, and no mission",
    "CubePilot_e2b1b_OldFileFormat.mission": "a mission of QGroundControl 3.1 or older, which is not read",
    "mavlink_57f7f_qgroundcontrol_sample_with_structured_scan.plan": "a StructureScan",
    "qgroundcontrol_sample_wrong_mission_version.plan": "mission.version: 7 is not known",
}
MISSIONS = [path for path in real.missions(real.FOLDERS) if path.suffix != ".geojson"]


@pytest.mark.skipif(not MISSIONS, reason="the folder of missions of others is not there")
@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.name)
def test_a_mission_of_others_is_forecast_as_it_is_flown(path):
    if path.name in REFUSED:
        with pytest.raises(InputError, match=REFUSED[path.name]):
            real.compared(path, {})
        return
    found = real.compared(path, real.WINDS["calm"])
    assert found.outcome.completed
    assert found.right
    assert found.power_w <= found.limit_w
