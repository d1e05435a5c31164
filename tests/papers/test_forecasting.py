"""Steps of the forecast's model against expm and van Loan, and of the disturbance."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag, expm

from eadp.papers import forecasting

PERIOD_S, TIME_S, STD_W = 46.0, 4.0, 0.7
SAME = 1e-8
DRIFT = np.array([3e-3, 1e-3, 2e-3, 5e-4])

durations = st.sampled_from([0.0, 0.01, 0.3, 2.0, 23.0, 46.0, 300.0])
orders = st.integers(0, 3)


def system(order, period_s=PERIOD_S, time_s=TIME_S):
    """A: a level, rotations, the disturbance."""
    rate = math.sqrt(3) / time_s
    turns = [np.array([[0.0, w], [-w, 0.0]]) for w in 2 * np.pi / period_s * np.arange(1, order + 1)]
    return block_diag(np.zeros((1, 1)), *turns, np.array([[0.0, 1.0], [-(rate**2), -2 * rate]]))


def density(order):
    """Spectral density of the noise on each state."""
    drive = 4 * (math.sqrt(3) / TIME_S) ** 3 * STD_W**2
    return np.diag([DRIFT[0], *np.repeat(DRIFT[1 : order + 1], 2), 0.0, drive])


def row(order):
    """C."""
    return np.array([1.0, *([1.0, 0.0] * order), 1.0, 0.0])


def van_loan(matrix, noise, duration_s):
    """e^{A t} and the covariance that noise adds, in short pieces."""
    size, pieces = len(matrix), max(1, math.ceil(duration_s))
    big = expm(np.block([[-matrix, noise], [np.zeros_like(matrix), matrix.T]]) * (duration_s / pieces))
    turn, added = big[size:, size:].T, big[size:, size:].T @ big[:size, size:]
    total, covariance = np.eye(size), np.zeros_like(matrix)
    for _ in range(pieces):
        total, covariance = turn @ total, turn @ covariance @ turn.T + added
    return total, covariance


@given(orders, st.floats(0.5, 500), st.floats(-3, 3))
def test_rotation_is_the_matrix_exponential(order, period_s, turns):
    step_s, size = turns * period_s, 2 * order + 1
    turned = expm(system(order, period_s)[:size, :size] * step_s)
    assert forecasting.rotation_matrix(order, period_s, step_s) == pytest.approx(turned, abs=1e-10)


def test_states_ahead_are_the_matrix_exponentials():
    state, ahead_s = [30.0, 2.0, -1.0, 0.5, 0.3], np.array([0.0, 1.5, 40.0, -7.0])
    for one, step_s in zip(forecasting.rotated(state, PERIOD_S, ahead_s), ahead_s, strict=True):
        assert one == pytest.approx(expm(system(2)[:5, :5] * step_s) @ state, abs=1e-9)
    assert forecasting.rotated([30.0], PERIOD_S, ahead_s).tolist() == [[30.0]] * 4
    assert forecasting.rotated([30.0], None, ahead_s[:2]).tolist() == [[30.0]] * 2


@given(orders, durations)
def test_a_step_is_the_matrix_exponential(order, step_s):
    turn, noise = van_loan(system(order), density(order), step_s)
    assert forecasting.step_matrix(order, PERIOD_S, TIME_S, step_s) == pytest.approx(turn, abs=SAME)
    assert forecasting.step_noise(DRIFT[: order + 1], STD_W, TIME_S, step_s) == pytest.approx(noise, abs=SAME)
    assert forecasting.output(order).tolist() == row(order).tolist()


@pytest.mark.parametrize("time_s", [0.2, 5.0, 900.0])
def test_the_disturbance_is_a_matern_process(time_s):
    """Its covariance is stationary, and over a time apart as Rasmussen and Williams 2006 have it, Eq. 4.17."""
    stationary, rate = forecasting.stationary_covariance(STD_W, time_s), math.sqrt(3) / time_s
    scale = STD_W**2 * np.outer([1.0, rate], [1.0, rate])
    for apart_s in np.array([0.0, 0.06, 0.5, 2.8]) * time_s:
        turn = forecasting.transition(apart_s, time_s)
        again = turn @ stationary @ turn.T + forecasting.process_noise(apart_s, STD_W, time_s)
        assert again / scale == pytest.approx(stationary / scale, abs=1e-9)
        known = STD_W**2 * (1 + rate * apart_s) * math.exp(-rate * apart_s)
        assert (turn @ stationary)[0, 0] == pytest.approx(known)
