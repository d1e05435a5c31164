"""Orders of lines: against every order there is, against the exact one, and against what no order can beat."""

import itertools
import math

import numpy as np
import pytest
from common import few

from eadp.core.geometry.dubins import lengths_m, times_s
from eadp.survey import line_order
from eadp.survey.line_order import LineCosts, best_order, quick_order

ROUNDING = 1e-9
WELL, QUICK = 1.02, 1.12  # of the whole flight's cost, to the exact order's
AIRSPEED, WIND = 18.0, (6.0, -5.0)
SHAPES = ("rectangle", "trapezoid", "slanted", "triangle", "two arms")
# --- problems ---------------------------------------------------------------------------------------------------------


def lines_of(shape, count, spacing):
    """Lines from west to east over a field, numbered from south to north: y and both ends of each."""
    height = count * spacing
    found = []
    for i in range(count):
        y = (i + 0.5) * spacing
        up = y / height
        spans = {
            "rectangle": [(0.0, height)],
            "trapezoid": [(0.2 * up * height, (2 - 0.7 * up) * height)],
            "slanted": [(0.8 * y, 0.8 * y + 1.1 * height)],
            "triangle": [(0.9 * y, 0.9 * y + 1.3 * (1 - up) * height)],
            "two arms": [(0.0, 0.5 * height), (1.1 * height, 1.5 * height)] if up > 0.4 else [(0.0, 1.5 * height)],
        }
        found += [(y, *span) for span in spans[shape]]
    return found


def field(shape, count, *, spacing=30.0, radius=45.0, wind=None, home=None):
    """Costs of the lines of a field: lengths, or times in wind; ends free, or from and to a pose."""
    starts, ends, own = [], [], []
    for y, west, east in lines_of(shape, count, spacing):
        starts += [(west, y, 0.0), (east, y, math.pi)]
        ends += [(east, y, 0.0), (west, y, math.pi)]
        own += [east - west] * 2
    free = np.zeros(len(own))

    def cost(a, b):
        return times_s(a, b, radius, AIRSPEED, wind) if wind else lengths_m(a, b, radius)

    if wind:
        own = [times_s([a], [b], radius, AIRSPEED, wind)[0, 0] for a, b in zip(starts, ends, strict=True)]
    first = cost([home], starts)[0] if home else free
    last = cost(ends, [home])[:, 0] if home else free
    return LineCosts(cost(ends, starts), np.array(own), first, last)


def arbitrary(seed, count):
    """Costs without any structure: other there than back, and other the other way."""
    rng, directions = np.random.default_rng(seed), 2 * count
    return LineCosts(rng.uniform(0, 10, (directions, directions)), *(rng.uniform(0, 10, directions) for _ in range(3)))


def total(order, problem):
    """An order's cost, added up one by one."""
    costs, own, first, last = problem
    return (
        first[order[0]]
        + sum(own[directed] for directed in order)
        + sum(costs[order[i]][order[i + 1]] for i in range(len(order) - 1))
        + last[order[-1]]
    )


def assert_sound(answer, problem):
    order, cost = answer
    assert sorted(directed // 2 for directed in order) == list(range(len(problem[1]) // 2)), "each line once"
    assert all(isinstance(directed, int) for directed in order)
    assert cost == pytest.approx(total(order, problem), rel=ROUNDING)


def exact_order(problem):
    """The order of least cost, by dynamic programming, whatever `EXACT_LINES`."""
    return problem.with_total(line_order._held_karp(problem))


def searched(monkeypatch, problem):
    """The answer of the local search, also where there are few lines."""
    with monkeypatch.context() as patch:
        patch.setattr(line_order, "EXACT_LINES", 1)
        answer = best_order(problem)
    assert_sound(answer, problem)
    return answer


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("seed", [0, 1])
def test_exact_is_the_least_of_every_order_and_direction(count, seed):
    problem = arbitrary(seed, count)
    every = [
        [2 * line + directed for line, directed in zip(lines, directions, strict=True)]
        for lines in itertools.permutations(range(count))
        for directions in itertools.product((0, 1), repeat=count)
    ]
    answer = exact_order(problem)
    assert_sound(answer, problem)
    assert answer[1] == pytest.approx(min(total(order, problem) for order in every), rel=ROUNDING)


def test_best_is_exact_where_that_is_quick():
    problem = field("slanted", 10, wind=WIND)
    assert best_order(problem) == exact_order(problem)


def test_one_line_is_flown_the_cheaper_way():
    problem = LineCosts(np.zeros((2, 2)), *map(np.array, ([3.0, 2.0], [1.0, 0.0], [0.0, 3.0])))
    for order in (best_order, quick_order, exact_order):
        assert order(problem) == ([0], 4.0)
        assert order(problem._replace(last=np.zeros(2))) == ([1], 2.0)


def test_no_lines():
    nothing = LineCosts(np.zeros((0, 0)), *np.zeros((3, 0)))
    for order in (best_order, quick_order, exact_order):
        assert order(nothing) == ([], 0.0)


def test_collinear_pieces_are_flown_straight_through():
    # three lines, each in two pieces with a gap of 20 m that costs 20 m
    places = [(y, west, west + 200) for y in (0.0, 100.0, 200.0) for west in (0.0, 220.0)]
    starts = [pose for y, west, east in places for pose in ((west, y, 0.0), (east, y, math.pi))]
    ends = [pose for y, west, east in places for pose in ((east, y, 0.0), (west, y, math.pi))]
    free = np.zeros(12)
    order, cost = best_order(LineCosts(lengths_m(ends, starts, 50.0), np.full(12, 200.0), free, free))
    assert cost == pytest.approx(6 * 200 + 3 * 20 + 2 * math.pi * 50)
    assert [directed // 4 for directed in order[::2]] == [directed // 4 for directed in order[1::2]]


@pytest.mark.parametrize("shape", few(SHAPES, 2))
@pytest.mark.parametrize("wind", few([WIND, None], 1))
@pytest.mark.parametrize(
    ("count", "spacing", "radius", "home"),
    [(2, 30.0, 45.0, None), (5, 20.0, 75.0, (-90.0, -60.0, 0.4)), (7, 40.0, 20.0, None), (9, 25.0, 45.0, None)],
)
def test_search_against_the_exact_order(monkeypatch, shape, wind, count, spacing, radius, home):
    problem = field(shape, count, spacing=spacing, radius=radius, wind=wind, home=home)
    least = exact_order(problem)[1]
    _, cost = searched(monkeypatch, problem)
    assert least * (1 - ROUNDING) <= cost <= WELL * least
    jitted = quick_order(problem)
    assert_sound(jitted, problem)
    assert least * (1 - ROUNDING) <= jitted[1] <= QUICK * least


@pytest.mark.parametrize(("count", "radius"), [(20, 45.0), (40, 75.0), (60, 20.0)])
def test_a_large_rectangle_against_what_no_order_can_beat(count, radius):
    problem = field("rectangle", count, radius=radius)
    answer = best_order(problem)
    assert_sound(answer, problem)
    # each way between lines turns half a turn at least
    least = problem[1][::2].sum() + (count - 1) * math.pi * radius
    assert least <= answer[1] <= WELL * least


@pytest.mark.parametrize("wind", [None, WIND])
def test_the_search_beats_back_and_forth(wind):
    problem = field("trapezoid", 24, radius=60.0, wind=wind)
    in_turn = [2 * line + line % 2 for line in range(24)]
    best, jitted = best_order(problem), quick_order(problem)
    assert_sound(best, problem)
    assert best[1] <= jitted[1] * (1 + ROUNDING) < 0.92 * total(in_turn, problem)
