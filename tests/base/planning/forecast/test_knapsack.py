"""The knapsacks of many places against linear programs, one place at a time."""

import numpy as np
import pytest
from common import few
from common.knapsacks import by_linear_program, knapsack_of

from eadp.planning.forecast.knapsack import FULL, Knapsack, fill_greedy

LP = 1e-8
ROUNDING = 1e-12


def one_of(use, gain, available, base_use=0.0, base_value=0.0):
    """One place, a row of increments a leg."""
    use, gain = np.array(use, dtype=float), np.array(gain, dtype=float)
    numbers = (np.array([value]) for value in (base_use, base_value, available))
    return Knapsack(use, gain, np.zeros(len(use), dtype=np.intp), *numbers)


@pytest.mark.parametrize("seed", few(range(12), 4))
def test_every_place_is_filled_as_its_linear_program(seed):
    rng = np.random.default_rng(seed)
    knapsack = knapsack_of(rng, int(rng.integers(1, 9)))
    found = fill_greedy(knapsack)
    assert ((found.shares >= 0) & (found.shares <= 1)).all()
    assert found.feasible.tolist() == (knapsack.available >= knapsack.base_use - FULL).tolist()
    for place, feasible in enumerate(found.feasible):
        mine = knapsack.place == place
        own, use = found.shares[mine], knapsack.use[mine]
        assert found.use[place] == pytest.approx(knapsack.base_use[place] + (use * own).sum(), abs=ROUNDING)
        if not feasible:
            assert not own[use > 0].any()
            continue
        assert found.use[place] <= knapsack.available[place] + 2 * FULL
        assert found.value[place] == pytest.approx(by_linear_program(knapsack, place), abs=LP)
        partial = (own > 1e-6) & (own < 1 - 1e-6) & (use > 0)
        assert partial.sum() <= 1, "one increment in part"


def test_too_little_charge_is_infeasible_and_nothing_is_taken():
    knapsack = one_of([[0.1, 0.2], [0.3, 0.0]], [[2.0, 1.0], [1.0, 0.0]], 0.1 - 1e-6, 0.1, 0.3)
    found = fill_greedy(knapsack)
    assert not found.feasible[0]
    assert not found.shares[knapsack.use > 0].any()
    assert (found.use[0], found.value[0]) == (0.1, 0.3)
    just = fill_greedy(knapsack._replace(available=np.array([0.1 - FULL / 2])))
    assert just.feasible[0]
    assert just.value[0] >= 0.3


def test_legs_without_a_choice():
    knapsack = one_of(np.zeros((3, 0)), np.zeros((3, 0)), 0.3, 0.2, 0.5)
    assert fill_greedy(knapsack).value[0] == 0.5
    assert fill_greedy(knapsack).feasible[0]
    assert not fill_greedy(knapsack._replace(available=np.array([0.1]))).feasible[0]


def test_increments_that_take_nothing_come_first():
    knapsack = one_of([[0.1], [0.0], [0.2]], [[0.1], [0.01], [0.1]], 0.0)
    assert fill_greedy(knapsack).shares.ravel() == pytest.approx([0, 1, 0], abs=1e-7)
    more = fill_greedy(knapsack._replace(available=np.array([0.2])))
    assert more.shares.ravel() == pytest.approx([1, 1, 0.5], abs=1e-7)
