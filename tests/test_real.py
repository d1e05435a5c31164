"""Missions that others made, of a folder beside the project: refused with the reason, or forecast as they are flown."""

import sys
from pathlib import Path

import pytest
from common import few

from eadp.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

import real  # noqa: E402

MISSIONS = [path for path in real.missions(real.FOLDERS) if path.suffix != ".geojson"]


@pytest.mark.slow
@pytest.mark.skipif(not MISSIONS, reason="the folder of missions of others is not there")
@pytest.mark.parametrize("path", few(MISSIONS, 1), ids=lambda path: path.name)
def test_a_mission_of_others_is_forecast_as_it_is_flown(path):
    if path.name in real.REFUSED:
        with pytest.raises(InputError, match=real.REFUSED[path.name]):
            real.compared(path, {})
        return
    found = real.compared(path, real.WINDS["no wind"])
    assert found.outcome.completed
    assert found.right
    assert found.power_w <= found.limit_w


FOLDER = real.FOLDERS[0]
OTHERS = [path for path in sorted(FOLDER.glob("*_*.*")) if path not in MISSIONS]


@pytest.mark.skipif(not OTHERS, reason="the folder of files of others is not there")
@pytest.mark.parametrize("path", OTHERS, ids=lambda path: path.name)
def test_a_file_of_others_is_right_or_refused_with_its_reason(path):
    assert real.judged(path)[1] not in ("wrong", "refused wrongly")
