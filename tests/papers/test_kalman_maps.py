"""Many readings as one map of a covariance, against the same readings one after the other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, solve_discrete_are

from eadp.papers.estimator import applied, composed, predict, step_map, update

SIZE = 4
SAME = 1e-8

seeds = st.integers(0, 10**6)
noises = st.sampled_from([1e-3, 0.1, 1.0, 30.0])


def system(seed):
    """A transition, process noise, output and covariance of no particular kind."""
    rng = np.random.default_rng(seed)
    transition = expm(0.2 * rng.standard_normal((SIZE, SIZE)) - 0.6 * np.eye(SIZE))  # fades: nothing to lose digits to
    roots = rng.standard_normal((2, SIZE, SIZE))
    return transition, 0.05 * roots[0] @ roots[0].T, rng.standard_normal(SIZE), roots[1] @ roots[1].T


def stepped(covariance, steps, transition, noise, output, variance):
    """The filter's own steps; readings do not matter."""
    state = np.zeros(SIZE)
    for _ in range(steps):
        state, covariance = predict(state, covariance, transition, noise)
        state, covariance = update(state, covariance, output, 1.0, variance)
    return covariance


@given(seeds, noises)
def test_one_step_is_a_prediction_and_a_reading(seed, variance):
    transition, noise, output, covariance = system(seed)
    wanted = stepped(covariance, 1, transition, noise, output, variance)
    got = applied(step_map(transition, noise, output, variance), covariance)
    assert got == pytest.approx(wanted, abs=SAME * np.abs(covariance).max())
    assert (got == got.T).all()


@given(seeds, noises, st.integers(0, 5))
def test_doubled_maps_are_the_steps_one_after_the_other(seed, variance, doublings):
    transition, noise, output, covariance = system(seed)
    many = step_map(transition, noise, output, variance)
    for _ in range(doublings):
        many = composed(many, many)
    wanted = stepped(covariance, 2**doublings, transition, noise, output, variance)
    assert applied(many, covariance) == pytest.approx(wanted, abs=SAME * np.abs(covariance).max())


@given(seeds, seeds, noises)
def test_two_different_steps(seed, other, variance):
    first, then = system(seed), system(other)
    both = composed(step_map(*first[:3], variance), step_map(*then[:3], 2.0))
    wanted = stepped(stepped(first[3], 1, *first[:3], variance), 1, *then[:3], 2.0)
    assert applied(both, first[3]) == pytest.approx(wanted, abs=SAME * np.abs(first[3]).max())


def test_for_ever_is_the_riccati_equations_answer():
    transition, noise, output, covariance = system(3)
    many = step_map(transition, noise, output, 0.5)
    for _ in range(20):
        many = composed(many, many)
    before = solve_discrete_are(transition.T, output[:, None], noise, np.array([[0.5]]))
    wanted = update(np.zeros(SIZE), before, output, 0.0, 0.5)[1]
    assert applied(many, covariance) == pytest.approx(wanted, abs=SAME)
