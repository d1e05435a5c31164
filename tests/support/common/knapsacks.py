"""Knapsacks at random, and their exact answers."""

import numpy as np
from scipy.optimize import linprog

from eadp.planning.forecast.knapsack import Knapsack


def knapsack_of(rng, places, depth=4, share=None):
    """Concave increments at random: some legs without a choice, some of several slopes, some that take nothing."""
    legs = rng.integers(1, 12, places)
    count = int(legs.sum())
    use, gain = np.zeros((count, depth)), np.zeros((count, depth))
    for leg in range(count):
        steps = int(rng.integers(0, depth + 1))
        widths = rng.uniform(0.001, 0.05, steps) * rng.choice([0.0, 1.0], steps, p=[0.05, 0.95])
        slopes = np.sort(rng.choice([1.0, 2.0, rng.uniform(0.1, 3)], steps))[::-1]
        use[leg, :steps] = widths
        gain[leg, :steps] = np.where(widths > 0, widths * slopes, 0.0)
        if steps and widths[0] == 0:
            gain[leg, 0] = rng.uniform(0, 0.1)
    place = np.repeat(np.arange(places), legs)
    base_use, base_value = rng.uniform(0.05, 0.2, places), rng.uniform(0, 0.5, places)
    whole = np.bincount(place, use.sum(axis=1), places)
    available = base_use + (rng.uniform(-0.2, 1.1, places) if share is None else share) * whole
    return Knapsack(use, gain, place, base_use, base_value, available)


def by_linear_program(knapsack, place=0):
    """The best value of one place: max gain·x, use·x ≤ spare, 0 ≤ x ≤ 1."""
    mine = knapsack.place == place
    use, gain = knapsack.use[mine].ravel(), knapsack.gain[mine].ravel()
    spare = knapsack.available[place] - knapsack.base_use[place]
    # use and spare in thousandths: the solver's tolerances are absolute
    exact = linprog(-gain, A_ub=1e3 * use[None, :], b_ub=[1e3 * spare], bounds=(0, 1))
    return knapsack.base_value[place] - exact.fun
