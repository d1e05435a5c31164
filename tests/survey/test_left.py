"""Ground that is left: its area on a raster, and its place within it."""

import numpy as np
import pytest

from eadp.models.airspace import Field
from eadp.survey.report import left_ground, left_text

BOX = ((0.0, 0.0), (600.0, 0.0), (600.0, 400.0), (0.0, 400.0))
SWATH_M = 40.0


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


@pytest.mark.parametrize("cut", [{4: [(0, 190), (350, 600)]}, {5: [(0, 500)]}, {2: []}])
def test_a_place_has_its_area(cut):
    flown = lines(cut)
    (found,) = left_ground(Field(BOX), flown, SWATH_M)
    assert found.area_m2 == pytest.approx(left_on_raster(flown), rel=0.01)
    (x, y), (number,) = found.place_m, cut
    assert abs(y - (20 + SWATH_M * number)) <= SWATH_M / 2
    assert all(not a < x < b for a, b in cut[number])


def test_all_places_the_largest_first():
    cut = {0: [(0, 550)], 2: [(0, 400)], 4: [(100, 600)], 6: [(0, 580)], 8: []}
    found = left_ground(Field(BOX), lines(cut), SWATH_M)
    assert [each.area_m2 for each in found] == [pytest.approx(SWATH_M * w) for w in (600, 200, 100, 50, 20)]
    total, *places = left_text(found, 0.1617, None)
    assert total == "left       16.17 % of the field, 3.88 ha in 5 places; the largest:"
    assert [line.split(" at ")[0].strip() for line in places] == ["2.40 ha", "0.80 ha", "0.40 ha"]
    assert left_ground(Field(BOX), lines(), SWATH_M) == []
    assert left_text([], 0.0, None) == []
