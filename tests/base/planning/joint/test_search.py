"""The search for path parameters against brute force over fine grids, on missions made up and on routes."""

from __future__ import annotations

import math
from statistics import median

import numpy as np
import pytest
from common import few
from common.forecasts import CALM, Forecasting, survey_inputs

from eadp.planning.forecast.evaluate import Objective
from eadp.planning.forecast.knapsack import Knapsack, fill_greedy
from eadp.planning.joint import search as module
from eadp.planning.joint.search import Search

PLACES, EACH = 1001, 31
"""Places of brute force along one parameter, along each of two, and along each of two blocks."""
MEDIAN_GAP, WORST_GAP, SCAN_GAP = 1e-3, 1e-2, 5e-2
"""The last where a step is wider than a cell of the first grid: within one the search looks at its ends alone."""
ON_ROUTES = 3e-3
FINEST = 1 / (module.POINTS[1] - 1) / 2**module.ROUNDS
"""Between two places of a search that halves a cell in every round."""


class Legs:
    """Legs of the places, as many as tell the steps apart."""

    def __init__(self, counts):
        self.last = np.cumsum(counts) - 1
        self.first = self.last + 1 - np.array(counts)


class Evaluated:
    """What a search asks of an evaluation, of made-up missions."""

    def __init__(self, missions, counts, std):
        self.knapsack = stacked(missions)
        self.legs, self.std = Legs(counts), np.array(std)

    def filled(self):
        return fill_greedy(self.knapsack)


def stacked(alone):
    width = max(one.use.shape[1] for one in alone)
    use, gain = (
        np.concatenate([np.pad(getattr(one, name), ((0, 0), (0, width - one.use.shape[1]))) for one in alone])
        for name in ("use", "gain")
    )
    place = np.repeat(np.arange(len(alone)), [len(one.use) for one in alone])
    rest = (np.concatenate([getattr(one, name) for one in alone]) for name in ("base_use", "base_value", "available"))
    return Knapsack(use, gain, place, *rest)


class Mission:
    """Whole laps of a few legs: how many is a staircase in p, and how long they take is smooth on each step.

    Value is by ground: laps share it, whatever their number.
    """

    def __init__(self, seed, dimensions, tight=None, until=1.0):
        rng = np.random.default_rng(seed)
        self.dimensions, self.until = dimensions, until
        self.first, self.rise = rng.uniform(3, 7), rng.uniform(1, 12, dimensions)
        kinds = int(rng.integers(2, 5))
        self.legs_s = rng.uniform(5, 20, kinds)
        self.motion_w = rng.uniform(30, 45, kinds)
        self.powers_w, self.values = [], []
        for _ in range(kinds):
            count = int(rng.integers(0, 5))
            widths, slopes = rng.uniform(0.2, 3, count), np.sort(rng.uniform(0.02, 1, count))[::-1]
            self.powers_w.append(np.cumsum([rng.uniform(0, 4), *widths]))
            self.values.append(np.cumsum([0, *(widths * slopes)]))
        top = max(values[-1] for values in self.values) or 1.0
        self.values = [values / top for values in self.values]
        self.weight = rng.uniform(0.2, 0.8)
        self.margin = rng.uniform(0, 0.03, dimensions)
        self.available = 1.0
        least, most = (self.knapsack((end,) * dimensions)[0] for end in (0.0, 1.0))
        share = rng.uniform(0.05, 1.05) if tight is None else tight
        low, high = float(least.base_use[0]), float(most.base_use[0] + most.use.sum())
        self.available = low + share * (high - low)

    def knapsack(self, shares):
        """The knapsack of a place, and how many legs it has."""
        p = np.array(shares)
        laps = math.ceil(self.first + self.rise @ p - 1e-12)
        over = laps - (self.first + self.rise @ p)
        times = np.tile(self.legs_s, laps)
        times[-1] *= 1 - 0.8 * over  # the last leg ends with the plan
        kinds, width = len(self.legs_s), max(map(len, self.powers_w)) - 1
        use, gain = np.zeros((len(times), width)), np.zeros((len(times), width))
        base = 0.0
        ground = times / times.sum()
        for leg, seconds in enumerate(times.tolist()):
            powers_w, values = self.powers_w[leg % kinds], self.values[leg % kinds]
            base += seconds * (self.motion_w[leg % kinds] + powers_w[0]) * 1e-5
            use[leg, : len(powers_w) - 1] = seconds * np.diff(powers_w) * 1e-5
            gain[leg, : len(values) - 1] = (1 - self.weight) * ground[leg] * np.diff(values)
        value = self.weight * float(p.mean())
        available = self.available - float(self.margin @ p**2)
        numbers = (np.array([each]) for each in (base, value, available))
        return Knapsack(use, gain, np.zeros(len(use), dtype=np.intp), *numbers), len(times)

    def evaluate(self, places):
        """Those that can be flown, with their evaluation."""
        flyable = [shares for shares in places if shares[0] <= self.until]
        if not flyable:
            return [], None
        found = [self.knapsack(shares[: self.dimensions]) for shares in flyable]
        return flyable, Evaluated([one for one, _ in found], [count for _, count in found], [0.01] * len(found))

    def by_brute_force(self):
        """The best value over a fine grid; None where nothing is feasible."""
        count = PLACES if self.dimensions == 1 else EACH
        axes = np.meshgrid(*[np.linspace(0, 1, count)] * self.dimensions)
        places = [tuple(each) for each in np.array([axis.ravel() for axis in axes]).T.tolist() if each[0] <= self.until]
        _, found = self.evaluate(places)
        filling = found.filled()
        return float(filling.value[filling.feasible].max()) if filling.feasible.any() else None


def searched(mission, start=None, **more):
    start = (0.5,) * mission.dimensions if start is None else start
    return Search(mission.evaluate, mission.weight, **more).best(start)


@pytest.mark.parametrize(
    ("dimensions", "seeds"),
    [
        (1, range(3)),
        pytest.param(1, range(4, 12), marks=pytest.mark.slow),
        pytest.param(2, range(100, 104), marks=pytest.mark.slow),
    ],
)
def test_made_up_missions_against_brute_force(dimensions, seeds):
    gaps = []
    for seed in seeds:
        mission = Mission(seed, dimensions)
        best, found = mission.by_brute_force(), searched(mission)
        if best is None:
            continue
        assert found.feasible, "brute force has found something"
        gaps.append(best - found.value)
    assert len(gaps) > len(seeds) / 2
    assert median(gaps) <= MEDIAN_GAP
    assert max(gaps) <= SCAN_GAP
    assert np.mean(np.array(gaps) <= WORST_GAP) >= 0.95


@pytest.mark.quick(1)
@pytest.mark.parametrize("until", [0.05, 0.45, 0.95])
@pytest.mark.parametrize("start", few([0.0, 0.5, 1.0], 1))
def test_a_plan_that_cannot_be_flown_at_some_parameters(until, start):
    mission = Mission(5, 1, tight=0.9, until=until)
    assert mission.by_brute_force() - searched(mission, (start,)).value <= WORST_GAP


def test_a_plan_that_cannot_be_flown_anywhere_has_no_place():
    assert searched(Mission(5, 1, until=-1.0)) is None


def test_too_little_charge_everywhere_finds_what_is_short_of_least():
    mission = Mission(6, 1, tight=-0.5)
    found = searched(mission, (0.7,))
    assert not found.feasible
    knapsacks = stacked([mission.knapsack((p,))[0] for p in np.linspace(0, 1, PLACES).tolist()])
    assert found.shortfall == pytest.approx(float((-knapsacks.spare).min()), abs=1e-3)


def test_a_step_that_is_feasible_at_its_edge_alone():
    """Charge that is enough below 0.31 only, where the path is worth the more the higher p."""

    def evaluate(places):
        alone = [
            Knapsack(np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1, dtype=np.intp), *map(np.array, numbers))
            for (p,) in places
            for numbers in [([0.4 + (p > 0.31)], [p], [0.9])]
        ]
        return places, Evaluated(alone, [1 + int(p * 5) for (p,) in places], [0.0] * len(places))

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
    mission, seen = Mission(3, 1), []

    def evaluate(places):
        seen.extend(places)
        return mission.evaluate(places)

    search = Search(evaluate, mission.weight)
    search.best((0.5,))
    search.best((0.5,))
    assert len(seen) == len(set(seen)) == len(search.known)


# --- on routes --------------------------------------------------------------------------------------------------------


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
