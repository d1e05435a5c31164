"""The filter in blocks beside the filter step by step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eadp.papers import forecasting
from eadp.papers.estimator import BLOCK, STEPPING, EnergyDynamics, EnergyFilter, predict, update

SAME = 1e-8
DYNAMICS = EnergyDynamics(2, 46.0, np.array([1e-3, 1e-3, 1e-3]), 0.5, 4.0, 0.3)
FIRST = np.diag([100.0, 25.0, 25.0, 25.0, 25.0, 0.25, 0.05])
STEP_S = 0.1


def by_steps(covariance, count, dynamics=DYNAMICS, step_s=STEP_S, read=True):
    """P after some steps, each with a reading or none."""
    state, output = np.zeros(len(covariance)), forecasting.output(2)
    for _ in range(count):
        moves = dynamics.transition(step_s), dynamics.process_noise(step_s)
        state, covariance = predict(state, covariance, *moves)
        if read:
            state, covariance = update(state, covariance, output, 0.0, dynamics.noise_w**2)
    return covariance


def settled():
    """A filter that holds its gain, and how many readings that took."""
    tracker = EnergyFilter(np.zeros(7), FIRST, DYNAMICS)
    for count in range(1, 10_000):
        tracker.follow(STEP_S, 0.0)
        if tracker._held != STEPPING:
            return tracker, count
    raise AssertionError("never held")


@pytest.mark.parametrize("more", [0, 1, 5, BLOCK - 1, BLOCK, BLOCK + 3, 5 * BLOCK + 9])
def test_the_covariance_is_that_of_every_step(more):
    tracker, count = settled()
    for _ in range(more):
        tracker.follow(STEP_S, 0.0)
    assert tracker.covariance == pytest.approx(by_steps(FIRST, count + more), abs=SAME)
    assert tracker.covariance == pytest.approx(by_steps(FIRST, count + more), abs=SAME), "asking twice changes nothing"
    tracker.follow(STEP_S, 0.0)
    assert tracker.covariance == pytest.approx(by_steps(FIRST, count + more + 1), abs=SAME), "nor what follows"


def test_a_drop_out_within_a_block():
    tracker, count = settled()
    for _ in range(6):
        tracker.follow(STEP_S, 0.0)
    tracker.follow(STEP_S, None)
    assert tracker._held == STEPPING
    tracker.follow(STEP_S, 0.0)
    wanted = by_steps(by_steps(by_steps(FIRST, count + 6), 1, read=False), 1)
    assert tracker.covariance == pytest.approx(wanted, abs=SAME)


def test_another_step_within_a_block():
    tracker, count = settled()
    tracker.follow(STEP_S, 0.0)
    tracker.follow(0.35, 0.0)
    assert tracker.covariance == pytest.approx(by_steps(by_steps(FIRST, count + 1), 1, step_s=0.35), abs=SAME)


def test_another_model_within_a_block_keeps_the_state():
    tracker, count = settled()
    tracker.follow(STEP_S, 3.0)
    before, other = tracker.state.copy(), replace(DYNAMICS, period_s=40.0, noise_w=0.6)
    tracker.dynamics = other
    assert tracker.dynamics is other
    assert tracker.state == pytest.approx(before), "phases continue"
    tracker.follow(STEP_S, 0.0)
    assert tracker.covariance == pytest.approx(by_steps(by_steps(FIRST, count + 1), 1, other), abs=SAME)


def test_wider():
    tracker, _ = settled()
    before = tracker.covariance.copy()
    tracker.widen(4.0)
    assert tracker.covariance == pytest.approx(4 * before)
