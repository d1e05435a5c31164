"""Rows and variances of forecasts against expm, quadrature, van Loan and finite differences."""

from __future__ import annotations

import math

import forecast_variance
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import block_diag, expm

from eadp.papers import forecasting

PERIOD_S, TIME_S, STD_W = 46.0, 4.0, 0.7
SAME = 1e-8
DRIFT = np.array([3e-3, 1e-3, 2e-3, 5e-4])
STATE = np.array([30.0, 1.0, 2.0, 0.5, -0.6, 0.3, 0.1, 0.4, 0.2])

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


def with_energy(order):
    """A and noise with the energy as one more state, ė = C x."""
    size = 2 * order + 3
    matrix, noise = np.zeros((size + 1, size + 1)), np.zeros((size + 1, size + 1))
    matrix[:size, :size], matrix[size, :size] = system(order), row(order)
    noise[:size, :size] = density(order)
    return matrix, noise


@given(orders, durations)
def test_a_step_is_the_matrix_exponential(order, step_s):
    turn, noise = van_loan(system(order), density(order), step_s)
    assert forecasting.step_matrix(order, PERIOD_S, TIME_S, step_s) == pytest.approx(turn, abs=SAME)
    assert forecasting.step_noise(DRIFT[: order + 1], STD_W, TIME_S, step_s) == pytest.approx(noise, abs=SAME)
    assert forecasting.output(order).tolist() == row(order).tolist()


@given(orders, st.lists(durations, min_size=1, max_size=4))
def test_power_rows_and_variances(order, ahead):
    rows = forecasting.power_rows(order, PERIOD_S, TIME_S, ahead)
    added = forecast_variance.power_variance_w2(DRIFT[: order + 1], STD_W, TIME_S, ahead)
    for k, t in enumerate(ahead):
        turn, noise = van_loan(system(order), density(order), t)
        assert rows[k] == pytest.approx(row(order) @ turn, abs=SAME)
        assert added[k] == pytest.approx(row(order) @ noise @ row(order), abs=SAME)


@given(orders, durations)
def test_energy_is_one_more_state(order, duration_s):
    turn, noise = van_loan(*with_energy(order), duration_s)
    ours = forecast_variance.energy_row(order, PERIOD_S, TIME_S, duration_s)
    assert ours == pytest.approx(turn[-1, :-1], rel=1e-7, abs=SAME)
    added = forecast_variance.energy_variance_j2(DRIFT[: order + 1], PERIOD_S, STD_W, TIME_S, duration_s)
    assert added == pytest.approx(noise[-1, -1], rel=1e-6, abs=SAME)


@pytest.mark.parametrize("turns", [0.01, 0.049999, 0.050001, 0.3, 3.0, 80.0])
def test_what_has_settled_is_its_integral_on_both_sides_of_the_series(turns):
    wanted, _ = quad(lambda v: (1 - (1 + v) * math.exp(-v)) ** 2, 0, turns, epsabs=0, epsrel=1e-9)
    assert forecast_variance._settled(turns) == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize("duration_s", [0.5, 20.0, 46.0, 300.0])
def test_slopes_by_the_period(duration_s):
    h = 1e-4
    power = [forecasting.power_rows(3, T, TIME_S, [duration_s]) @ STATE for T in (PERIOD_S - h, PERIOD_S + h)]
    energy = [forecast_variance.energy_row(3, T, TIME_S, duration_s) @ STATE for T in (PERIOD_S - h, PERIOD_S + h)]
    assert forecast_variance.power_by_period(STATE, PERIOD_S, [duration_s]) == pytest.approx(
        (power[1] - power[0]) / (2 * h), abs=1e-6
    )
    assert forecast_variance.energy_by_period(STATE, PERIOD_S, duration_s) == pytest.approx(
        (energy[1] - energy[0]) / (2 * h), abs=1e-5
    )


def test_energy_of_noise_by_a_dense_gaussian_process():
    """The disturbance alone, from what is known at 0: its covariance at every pair of instants, summed up."""
    step_s, count = 0.05, 800
    at = (np.arange(count) + 0.5) * step_s
    rate = math.sqrt(3) / TIME_S

    def matern(apart):
        turns = rate * np.abs(apart)
        return STD_W**2 * (1 + turns) * np.exp(-turns)

    wanted = matern(np.subtract.outer(at, at)).sum() * step_s**2
    # from the stationary state, whose own part is the row's
    ours = forecast_variance.energy_row(0, PERIOD_S, TIME_S, count * step_s)
    spread = np.array([0.0, STD_W, rate * STD_W])
    total = float(np.square(ours * spread).sum()) + forecast_variance.energy_variance_j2(
        np.zeros(1), PERIOD_S, STD_W, TIME_S, count * step_s
    )
    assert total == pytest.approx(wanted, rel=1e-3)
