"""A field divided among sorties: every metre of line once, the fewest sorties by brute force."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from common import draws
from hypothesis import given, settings
from hypothesis import strategies as st

from eadp.errors import Infeasible
from eadp.models.airspace import Field
from eadp.survey.coverage import LineGrid
from eadp.survey.packs import Divider, Division

SWATH_M = 30.0
RECTANGLE = Field(((0.0, 0.0), (600.0, 0.0), (600.0, 400.0), (0.0, 400.0)))
BAY = Field(((0, 0), (450, 0), (450, 380), (300, 380), (300, 140), (150, 140), (150, 380), (0, 380)))


def grid_of(field, heading_rad=0.3):
    return LineGrid.over(field, heading_rad, SWATH_M, SWATH_M)


def area(field):
    return shapely.union_all([shapely.Polygon(outline, holes) for outline, *holes in field.parts])


@dataclass(frozen=True)
class Straight:
    """A sortie that takes its area over the swath, and a way of its own."""

    used_on_lines: float
    spare: float


def linear(pack_m, way_m):
    def forecast(part):
        length_m = part.area_m2 / SWATH_M
        return Straight(length_m / pack_m, 1 - (length_m + way_m) / pack_m)

    return forecast


@pytest.mark.parametrize("field", [RECTANGLE, BAY], ids=["rectangle", "bay"])
@pytest.mark.parametrize("order", [False, True], ids=["side by side", "shuffled"])
@settings(max_examples=draws(0.6))
@given(shares=st.lists(st.floats(0.02, 0.98), min_size=1, max_size=4, unique=True))
def test_parts_are_the_field_once(field, order, shares):
    grid = grid_of(field)
    lines = np.random.default_rng(1).permutation(len(grid.middles_m)).tolist() if order else None
    division = Division(field, grid, 0.0, lines)
    places = [0.0, *(share * division.total_m for share in sorted(shares)), division.total_m]
    parts = [area(division.part(a, b)) for a, b in itertools.pairwise(places) if b - a > 1]
    assert shapely.union_all(parts).area == pytest.approx(area(field).area, rel=1e-3)
    assert sum(part.area for part in parts) == pytest.approx(area(field).area, rel=1e-3)


def test_a_cut_line_is_flown_again_by_the_overlap():
    grid = grid_of(RECTANGLE, 0.0)
    division = Division(RECTANGLE, grid, 25.0)
    place = division.between_lines(division.total_m / 2) + 200.0  # 200 m into a line
    first, second = area(division.part(0.0, place)), area(division.part(place, division.total_m))
    width_m = float(np.diff(grid.edges_m)[1])
    assert first.intersection(second).area == pytest.approx(25.0 * width_m, rel=1e-3)


@given(pack_m=st.floats(900, 9000), way_share=st.floats(0.0, 0.6))
def test_sorties_are_the_fewest_where_lines_may_be_cut(pack_m, way_share):
    way_m = way_share * pack_m
    divided = Divider(Division(RECTANGLE, grid_of(RECTANGLE), 0.0), linear(pack_m, way_m)).fewest(1)
    # all ways are alike: a sortie covers what a pack has left, and no more
    fewest = math.ceil(RECTANGLE.area_m2 / SWATH_M / (pack_m - way_m) - 1e-6)
    assert divided.shortest.spare >= 0
    assert len(divided.sorties) <= fewest + 1
    used = sum(sortie.used_on_lines for sortie in divided.sorties) * pack_m
    assert used == pytest.approx(RECTANGLE.area_m2 / SWATH_M, rel=1e-3)


def test_whole_lines_where_that_costs_nothing():
    grid = grid_of(RECTANGLE, 0.0)
    division = Division(RECTANGLE, grid, 0.0)
    divided = Divider(division, linear(division.total_m / 1.6, 0.0)).fewest(1)
    assert len(divided.sorties) == 2
    middle = divided.intervals[0][1]
    assert middle == pytest.approx(division.between_lines(middle), abs=0.01)


def test_lines_are_cut_where_that_saves_a_sortie():
    field = Field(((0.0, 0.0), (900.0, 0.0), (900.0, 90.0), (0.0, 90.0)))  # three lines
    grid = grid_of(field, 0.0)
    division = Division(field, grid, 0.0)
    pack_m = division.total_m / 1.9  # a line and a half and a little
    cut = Divider(division, linear(pack_m, 0.0)).fewest(1)
    whole = Divider(division, linear(pack_m, 0.0), cuts=False).fewest(1)
    assert (len(cut.sorties), len(whole.sorties)) == (2, 3)


def test_more_sorties_than_whole_lines_are_refused():
    division = Division(RECTANGLE, grid_of(RECTANGLE), 0.0)
    divider = Divider(division, linear(division.total_m, 0.0), cuts=False)
    assert len(divider.fewest(2).sorties) == 2
    with pytest.raises(Infeasible, match=f"{division.lines} whole lines have no division into {division.lines + 1} "):
        divider.fewest(division.lines + 1)


def test_a_way_that_takes_the_pack_is_refused():
    divider = Divider(Division(RECTANGLE, grid_of(RECTANGLE), 0.0), linear(1000.0, 1500.0))
    with pytest.raises(Infeasible, match="the way to the field and back"):
        divider.fewest(1)
