"""One step of the filter against the textbook's forms, the information form and least squares."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

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


def smallest_eigenvalue(matrix):
    return np.linalg.eigvalsh((matrix + matrix.T) / 2).min()


# --- update -----------------------------------------------------------------------------------------------------------


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
        assert smallest_eigenvalue(covariance) >= -1e-15 * prior
        assert covariance == pytest.approx(covariance.T, rel=1e-6, abs=1e-15 * prior)


# --- prediction -------------------------------------------------------------------------------------------------------


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
