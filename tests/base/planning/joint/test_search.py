"""The search for path parameters against brute force over fine grids, on missions made up and on routes."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from common import few
from common.forecasts import CALM, Forecasting, survey_inputs

from eadp.planning.forecast.evaluate import Objective
from eadp.planning.forecast.knapsack import Knapsack, fill_greedy
from eadp.planning.joint import search as module
from eadp.planning.joint.search import Search

PLACES, EACH = 1001, 31
"""Places of brute force along one parameter, and along each of two."""
WEIGHT, WORST_GAP = 0.4, 1e-2
ON_ROUTES = 3e-3
FINEST = 1 / (module.POINTS[1] - 1) / 2**module.ROUNDS
"""Between two places of a search that halves a cell in every round."""


def evaluation(base_use, base_value, available, legs, use=0.0, gain=0.0):
    """What a search asks of an evaluation: of places with an increment each, and as many legs as tell steps apart."""
    count, last = len(legs), np.cumsum(legs) - 1
    column = np.ones((count, 1))
    knapsack = Knapsack(use * column, gain * column, np.arange(count), base_use, base_value, available)
    of_places = SimpleNamespace(first=last + 1 - legs, last=last)
    return SimpleNamespace(
        knapsack=knapsack, legs=of_places, std=np.full(count, 0.01), filled=lambda: fill_greedy(knapsack)
    )


def made_up(*rise, until=1.0, available=0.6):
    """Whole laps: how many is a staircase in p, and how long they take is smooth on each step; value is by ground."""

    def evaluate(places):
        flyable = [shares for shares in places if shares[0] <= until]
        if not flyable:
            return [], None
        p = np.array(flyable)
        exact = 4.3 + p @ rise
        laps = np.ceil(exact - 1e-12)
        seconds = laps - 0.3 * (laps - exact)  # the last lap ends with the plan
        left = available - 0.02 * (p**2).sum(axis=1)
        return flyable, evaluation(
            0.05 * seconds, WEIGHT * p.mean(axis=1), left, laps.astype(int), 0.02 * seconds[:, None], 1 - WEIGHT
        )

    return evaluate


def everywhere(evaluate, dimensions=1):
    axis = np.linspace(0, 1, PLACES if dimensions == 1 else EACH).tolist()
    return evaluate(list(itertools.product(axis, repeat=dimensions)))[1]


def best_of(found):
    filling = found.filled()
    return float(filling.value[filling.feasible].max())


@pytest.mark.parametrize("rise", [(1.5,), (4.7,), (11.2,), (2.3, 7.1), (8.9, 3.4)])
def test_made_up_missions_against_brute_force(rise):
    evaluate = made_up(*rise)
    found = Search(evaluate, WEIGHT).best((0.5,) * len(rise))
    assert found.feasible
    assert best_of(everywhere(evaluate, len(rise))) - found.value <= WORST_GAP


@pytest.mark.parametrize("until", [0.05, 0.45, 0.95])
def test_a_plan_that_cannot_be_flown_at_some_parameters(until):
    evaluate = made_up(4.7, until=until)
    assert best_of(everywhere(evaluate)) - Search(evaluate, WEIGHT).best((0.5,)).value <= WORST_GAP


def test_a_plan_that_cannot_be_flown_anywhere_has_no_place():
    assert Search(made_up(4.7, until=-1.0), WEIGHT).best((0.5,)) is None


def test_too_little_charge_everywhere_finds_what_is_short_of_least():
    evaluate = made_up(4.7, available=0.1)
    found = Search(evaluate, WEIGHT).best((0.7,))
    assert not found.feasible
    assert found.shortfall == pytest.approx(float((-everywhere(evaluate).knapsack.spare).min()), abs=1e-3)


def test_a_step_that_is_feasible_at_its_edge_alone():
    """Charge that is enough below 0.31 only, where the path is worth the more the higher p."""

    def evaluate(places):
        (p,) = np.array(places).T
        return places, evaluation(0.4 + (p > 0.31), p, np.full(len(p), 0.9), 1 + (5 * p).astype(int))

    found = Search(evaluate).best((1.0,))
    assert 0.31 - FINEST <= found.value <= 0.31


def test_rounding_does_not_choose_between_places():
    place = module.Place((0.2,), feasible=True, value=0.6, shortfall=0.0, steps=3)
    other = place._replace(shares=(0.7,), value=0.6 + 3e-16)
    assert module._best([place, other]) is place
    assert module._best([other, place]) is other
    more = place._replace(value=0.6 + 1e-9)
    assert module._best([place, more]) is more
    short = place._replace(feasible=False, shortfall=0.1)
    assert module._best([short, short._replace(shortfall=0.1 - 3e-16)]) is short
    assert module._best([short._replace(value=9.0), place]) is place


def test_a_place_is_evaluated_once():
    mission, seen = made_up(4.7), []

    def evaluate(places):
        seen.extend(places)
        return mission(places)

    search = Search(evaluate, WEIGHT)
    search.best((0.5,))
    search.best((0.5,))
    assert len(seen) == len(set(seen)) == len(search.known)


@pytest.mark.quick(1)
@pytest.mark.parametrize("capacity_ah", few([0.34, 0.6, 0.28], 2))
@pytest.mark.parametrize("wind_mps", few([(0.0, 0.0), (5.0, -3.0)], 1))
def test_the_survey_against_every_place(capacity_ah, wind_mps):
    inputs = survey_inputs(**CALM, **{"battery.capacity_ah": capacity_ah, "parameters.c1": -1000.0})
    forecasting = Forecasting(inputs, wind_mps=wind_mps, objective=Objective(0.05, 0.95))
    found = Search(forecasting.evaluate, forecasting.evaluator.path_weight).best((0.0,))
    flyable, everywhere = forecasting.evaluate([(share,) for share in np.linspace(0, 1, PLACES).tolist()])
    filling = everywhere.filled()
    assert len(flyable) == PLACES
    if not filling.feasible.any():
        assert not found.feasible
        assert found.shortfall == pytest.approx(float((-everywhere.knapsack.spare).min()), abs=1e-4)
        return
    best = float(filling.value[filling.feasible].max())
    assert found.feasible
    assert best - found.value <= ON_ROUTES
