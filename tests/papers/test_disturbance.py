"""A Matérn-3/2 process as two states: against expm, Lyapunov, van Loan and plain Gaussian conditioning."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, solve_continuous_lyapunov, solve_discrete_lyapunov

from eadp.papers.forecasting import process_noise, stationary_covariance, transition

ROUNDING = 1e-9

steps = st.sampled_from([0.0, 1e-4, 0.01, 0.1, 1.0, 7.3, 60.0, 2000.0])
stds = st.sampled_from([0.0, 0.05, 1.0, 30.0])
times = st.sampled_from([0.2, 1.0, 5.0, 46.0, 900.0])


def system(time_s):
    """F of the process, written out."""
    rate = math.sqrt(3) / time_s
    return np.array([[0.0, 1.0], [-(rate**2), -2 * rate]])


def drive(std_w, time_s):
    """The spectral density of what drives it: 4 λ³ σ² on the slope."""
    return np.diag([0.0, 4 * (math.sqrt(3) / time_s) ** 3 * std_w**2])


def units(std_w, time_s):
    """What one unit of the states is, so that tolerances mean something."""
    return max(std_w, 1e-12) * np.array([1.0, math.sqrt(3) / time_s])


@given(steps, times)
def test_the_step_is_the_matrix_exponential(step_s, time_s):
    scale = np.outer(units(1, time_s), 1 / units(1, time_s))
    assert transition(step_s, time_s) / scale == pytest.approx(expm(system(time_s) * step_s) / scale, abs=ROUNDING)


@given(steps, stds, times)
def test_the_noise_of_a_step_is_van_loans(step_s, std_w, time_s):
    # exp([[−F, G], [0, Fᵀ]] Δt) = [[…, e^{−FΔt} Q], [0, e^{FᵀΔt}]], in pieces short enough for e^{−FΔt}
    pieces = max(1, math.ceil(step_s / time_s))
    size = step_s / pieces
    big = np.block([[-system(time_s), drive(std_w, time_s)], [np.zeros((2, 2)), system(time_s).T]])
    loan = expm(big * size)
    turn, added = loan[2:, 2:].T, loan[2:, 2:].T @ loan[:2, 2:]
    noise = np.zeros((2, 2))
    for _ in range(pieces):
        noise = turn @ noise @ turn.T + added
    scale = np.outer(units(std_w, time_s), units(std_w, time_s))
    assert process_noise(step_s, std_w, time_s) / scale == pytest.approx(noise / scale, rel=1e-6, abs=ROUNDING)


@given(stds, times)
def test_the_stationary_covariance_solves_lyapunovs_equation(std_w, time_s):
    scale = np.outer(units(std_w, time_s), units(std_w, time_s))
    wanted = solve_continuous_lyapunov(system(time_s), -drive(std_w, time_s))
    assert stationary_covariance(std_w, time_s) / scale == pytest.approx(wanted / scale, abs=ROUNDING)
    step = transition(0.5, time_s)
    again = solve_discrete_lyapunov(step, process_noise(0.5, std_w, time_s))
    assert stationary_covariance(std_w, time_s) / scale == pytest.approx(again / scale, rel=1e-4, abs=ROUNDING)


@given(st.lists(st.floats(0.001, 5.0), min_size=1, max_size=6), stds, times)
def test_prediction_does_not_depend_on_how_time_is_cut(cuts, std_w, time_s):
    scale = np.outer(units(std_w, time_s), units(std_w, time_s))
    covariance = np.zeros((2, 2))
    for step_s in cuts:
        turn = transition(step_s, time_s)
        covariance = turn @ covariance @ turn.T + process_noise(step_s, std_w, time_s)
    wanted = process_noise(sum(cuts), std_w, time_s)
    assert covariance / scale == pytest.approx(wanted / scale, abs=ROUNDING)


def test_the_states_have_the_covariance_of_a_matern():
    apart = np.array([0.0, 0.3, 2.0, -2.0, 11.0])
    ours = [(transition(abs(t), 4.0) @ stationary_covariance(0.7, 4.0))[0, 0] for t in apart]
    # σ² (1 + λ|τ|) e^{−λ|τ|}: Rasmussen and Williams 2006, Eq. 4.17
    turns = math.sqrt(3) / 4.0 * np.abs(apart)
    assert 0.7**2 * (1 + turns) * np.exp(-turns) == pytest.approx(ours)
