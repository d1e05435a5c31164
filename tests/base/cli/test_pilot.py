"""A survey pilot's field on a slope: landings on headings near the wind."""

import numpy as np
import pytest
from common import ROOT

import eadp
from eadp.core.geometry.geodesy import compass_deg
from eadp.models.plan.stage import LOITER_TO_ALTITUDE
from eadp.survey.terrain import read_terrain

PILOT = ROOT.parent / "shared/reference/pilot"
pytestmark = pytest.mark.skipif(not PILOT.exists(), reason="the pilot's inputs are not here")
HOME, PLACE = "48.6973022,8.8904725", "48.6976619,8.8907447"
CAMERA = {"camera": "sony-a6000-20mm", "gsd_cm": 2.0, "side_overlap": 65.0, "forward_overlap": 70.0}
WIND_DEG = 250


def covered(scenario=None, warn=lambda _: None, **given):
    options = eadp.CoverageOptions(home=HOME, **CAMERA, **given)
    return eadp.cover(PILOT / "field.geojson", options, scenario=scenario or PILOT / "day.yaml", warn=warn)


def lands(heading_deg, scenario=None):
    return covered(scenario, landing=f"{PLACE},{heading_deg}", terrain=[str(PILOT / "ground.tif")])


@pytest.mark.slow
@pytest.mark.parametrize("turn_deg", [-20, 15])
def test_headings_near_the_wind_are_landed_on_over_the_slope(turn_deg):
    """The ground rises by 5 % from where it lands; the flight comes down on a circle where the way is too short."""
    found = lands(WIND_DEG + turn_deg)
    profile = found.heights.profile
    above_m = profile.flown_m - profile.ground_m
    *_, circle, approach = found.plan.stages
    before = profile.samples.legs < profile.samples.legs[-1]
    assert above_m[np.maximum.accumulate(above_m >= 20) & before].min() >= 20 - 0.01
    (x0, y0), (x1, y1) = circle.trigger_at(()), approach.trigger_at(())
    assert compass_deg(np.arctan2(y1 - y0, x1 - x0)) % 360 == pytest.approx(WIND_DEG + turn_deg, abs=0.01)
    flight = eadp.simulate(found.plan, scenario=PILOT / "day.yaml", seed=1, planner="static", warn=lambda _: None)
    points_m = np.column_stack([flight.columns["x_m"], flight.columns["y_m"]])
    ground = read_terrain([str(PILOT / "ground.tif")], points_m, found.plan.site.origin_deg)
    up_m = flight.columns["altitude_m"] + found.plan.site.ground_m - ground.heights_m(points_m)
    there = flight.columns["stage"].astype(int)
    begins = there == len(found.plan.stages)
    climbed = np.maximum.accumulate(up_m >= 20)
    assert up_m[climbed & ~begins].min() >= 19, "of the clearance of 20 m, in gusts"
    # the height that the flight has above where the approach is planned to begin: within the tolerance of lines
    assert flight.columns["altitude_m"][begins][0] - circle.altitude_m <= 0.1 * found.pictures.altitude_m
    if circle.command(LOITER_TO_ALTITUDE):
        assert flight.columns["altitude_m"][there < len(found.plan.stages) - 1][-1] > circle.altitude_m
