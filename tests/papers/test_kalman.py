"""One step of the filter against the textbook's forms and least squares; of the forecast's model, against expm."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag, expm

from eadp.papers import forecasting
from eadp.papers.estimator import predict, update

ROUNDING = 1e-9
SIZE = 5

numbers = st.integers(-50, 50).map(lambda k: k / 10)
vectors = st.lists(numbers, min_size=SIZE, max_size=SIZE).map(np.array)
noises = st.sampled_from([1e-4, 0.1, 1.0, 30.0])


@st.composite
def covariances(draw):
    root = np.array([draw(vectors) for _ in range(SIZE)])
    return root @ root.T / 10 + 0.01 * np.eye(SIZE)


@given(vectors, covariances(), vectors, numbers, noises)
def test_covariance_is_the_textbooks(state, covariance, output, measured, noise):
    # K = P Cᵀ (C P Cᵀ + R)⁻¹, q + K (y − C q), (I − K C) P
    row = output.reshape(1, SIZE)
    gain = covariance @ row.T @ np.linalg.inv(row @ covariance @ row.T + noise)
    scale = np.abs(covariance).max()
    got_state, got = update(state, covariance, output, measured, noise)
    assert got_state == pytest.approx(state + (gain * (measured - row @ state)).ravel(), abs=1e-7)
    assert got == pytest.approx((np.eye(SIZE) - gain @ row) @ covariance, abs=ROUNDING * (1 + scale / noise) * scale)


def test_the_printed_sign_grows():
    # misprint 2: with (I + K C) P the variance of what is measured grows with every reading
    covariance, output = np.eye(2), np.array([1.0, 1.0])
    gain = covariance @ output / (output @ covariance @ output + 1)
    printed = (np.eye(2) + np.outer(gain, output)) @ covariance
    _, ours = update(np.zeros(2), covariance, output, 1.0, 1.0)
    assert output @ printed @ output > output @ covariance @ output > output @ ours @ output
    # by hand: 2·1/(2 + 1)
    assert output @ ours @ output == pytest.approx(2 / 3)


@pytest.mark.parametrize("prior", [1.0, 1e4, 1e8])
def test_a_sure_reading_after_a_vague_prior_stays_positive(prior):
    # where (I − K C) P loses its symmetry to rounding
    rng = np.random.default_rng(3)
    state, covariance = np.zeros(3), prior * np.eye(3)
    for _ in range(200):
        state, covariance = update(state, covariance, rng.standard_normal(3), 1.0, 1e-6)
        assert np.linalg.eigvalsh((covariance + covariance.T) / 2).min() >= -1e-15 * prior
        assert covariance == pytest.approx(covariance.T, rel=1e-6, abs=1e-15 * prior)


@given(vectors, covariances(), covariances(), st.floats(0.01, 3))
def test_prediction_is_the_moments_of_the_moved_state(state, covariance, noise, t):
    turning = expm(t * np.diag([1.0, 0, 2, 0], 1) - t * np.diag([1.0, 0, 2, 0], -1))
    got_state, got = predict(state, covariance, turning, noise)
    # sigma points: mean ± the columns of √(n P), moved one by one
    root = np.linalg.cholesky(SIZE * covariance)
    points = np.array([state + sign * column for column in root.T for sign in (1, -1)]) @ turning.T
    assert got_state == pytest.approx(points.mean(axis=0), abs=1e-7)
    spread = points - points.mean(axis=0)
    assert got == pytest.approx(spread.T @ spread / len(points) + noise, abs=1e-7 * (1 + np.abs(covariance).max()))


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
