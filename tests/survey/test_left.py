"""Ground that is left: its area on a raster, its place within it, and its reason."""

from __future__ import annotations

import numpy as np
import pytest

from eadp.models.airspace import Airspace, Field, Obstacle
from eadp.survey.report import left_ground, left_text
from eadp.survey.swaths import MotionLimits

BOX = ((0.0, 0.0), (600.0, 0.0), (600.0, 400.0), (0.0, 400.0))
SWATH_M = 40.0
MOTION = MotionLimits(SWATH_M, 25.0, 37.5, 20.0)
MAST = Obstacle(((250.0, 165.0), (290.0, 165.0), (290.0, 175.0), (250.0, 175.0)), "mast")


def lines(cut=None):
    """Lines to the east over the whole field, some of them cut: number → intervals."""
    cut = cut or {}
    spans = [(20.0 + SWATH_M * i, cut.get(i, [(0.0, 600.0)])) for i in range(10)]
    return [((a, y), (b, y)) for y, parts in spans for a, b in parts]


def left_on_raster(flown, step=1.0):
    """Cells of the field beyond half a swath of every line [m²]."""
    x, y = np.meshgrid(np.arange(step / 2, 600, step), np.arange(step / 2, 400, step))
    covered = np.zeros(x.shape, dtype=bool)
    for (a, at), (b, _) in flown:
        covered |= (np.abs(y - at) < SWATH_M / 2) & (x > a) & (x < b)
    return float((~covered).sum()) * step**2


@pytest.mark.parametrize(
    ("cut", "airspace", "reason"),
    [
        ({4: [(0, 190), (350, 600)]}, Airspace((MAST,)), "no room for a turn beside mast"),
        ({4: [(0, 245), (295, 600)]}, Airspace((MAST._replace(outline=((245.0, 160.0), (295.0, 160.0), (295.0, 200.0),
            (245.0, 200.0))),)), "mast, and no room for a turn beside it"),
        ({5: [(0, 500)]}, Airspace((), (((-60.0, -60.0), (610.0, -60.0), (610.0, 460.0), (-60.0, 460.0)),)),
            "no room for a turn inside the boundary"),
        ({5: [(0, 300)]}, Airspace((), (((-60.0, -60.0), (350.0, -60.0), (350.0, 460.0), (-60.0, 460.0)),)),
            "beyond the boundary"),
        ({2: []}, Airspace(), "beside or between the lines, narrower than their swath"),
    ],
)  # fmt: skip
def test_a_place_has_its_area_and_its_reason(cut, airspace, reason):
    flown = lines(cut)
    (found,) = left_ground(Field(BOX, airspace=airspace), flown, MOTION)
    assert found.reason == reason
    assert found.area_m2 == pytest.approx(left_on_raster(flown), rel=0.01)
    (x, y), (number,) = found.place_m, cut
    assert abs(y - (20 + SWATH_M * number)) <= SWATH_M / 2
    assert all(not a < x < b for a, b in cut[number])


def test_all_places_the_largest_first():
    cut = {0: [(0, 550)], 2: [(0, 400)], 4: [(100, 600)], 6: [(0, 580)], 8: []}
    found = left_ground(Field(BOX), lines(cut), MOTION)
    assert [each.area_m2 for each in found] == [pytest.approx(SWATH_M * w) for w in (600, 200, 100, 50, 20)]
    total, *places = left_text(found, 0.1617, None)
    assert total == "left       16.17 % of the field, 3.88 ha in 5 places; the largest:"
    assert [line.split(" at ")[0].strip() for line in places] == ["2.40 ha", "0.80 ha", "0.40 ha"]
    assert left_ground(Field(BOX), lines(), MOTION) == []
    assert left_text([], 0.0, None) == []
