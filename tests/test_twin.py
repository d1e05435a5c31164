"""The plant of benchmarks/twin.py is the aeroplane that it says it is; skipped without jsbsim."""

import importlib.util
import math
import sys

import pytest
from common import ROOT

pytest.importorskip("jsbsim")
SHAFT_W, TOLERANCE_W = 50.0, 1.0


@pytest.fixture(scope="module")
def plant():
    spec = importlib.util.spec_from_file_location("twin_plant", ROOT / "benchmarks/plant.py")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_level_flight_at_15_mps_takes_50_w_at_the_shaft(plant):
    plane, powers = plant.Aeroplane((0.0, 0.0), 0.0, (0.0, 0.0)), []
    while plane.time_s < 5:
        plane.control(0.0)
        powers.append(plane.shaft_w)
    assert sum(powers) / len(powers) == pytest.approx(SHAFT_W, abs=TOLERANCE_W)
    assert plane.airspeed_mps == pytest.approx(plant.AIRSPEED_MPS, abs=0.05)
    assert math.hypot(plane.x_m, plane.y_m) == pytest.approx(5 * plant.AIRSPEED_MPS, rel=0.01)


def test_the_pack_is_empty_below_its_cut_off_and_not_for_a_moment(plant):
    pack = plant.Lipo(1.0, 0.15)
    pack.step(400.0, 1.0)
    assert pack.voltage_v < plant.CUTOFF_CELL_V * pack.cells
    assert not pack.empty
    pack.step(400.0, 1.5)
    assert pack.empty
    assert pack.consumed_ah == pytest.approx(1 - pack.soc)
