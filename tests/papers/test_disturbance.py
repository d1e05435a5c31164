"""A Matérn-3/2 process as two states: against expm, Lyapunov, van Loan and plain Gaussian conditioning."""

from __future__ import annotations

import math
import sys

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, solve_continuous_lyapunov, solve_discrete_lyapunov
from scipy.stats import multivariate_normal

from eadp.papers.forecasting import (
    MIN_FREE_SAMPLES,
    DisturbanceFit,
    _gamma_3,
    _innovations,
    fit_disturbance,
    process_noise,
    stationary_covariance,
    subsampled,
    transition,
)

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


# --- the exact step


@given(st.floats(0, 1e3) | st.floats(-12, 1).map(lambda power: 10**power))
def test_the_incomplete_gamma_function_is_that_of_mpmath(x):
    with mpmath.workdps(60):
        exact = float(mpmath.gammainc(3, 0, x, regularized=True))
    # below the smallest normal number digits are lost
    assert _gamma_3(x) == pytest.approx(exact, rel=1e-14, abs=sys.float_info.min)


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


def test_short_steps_keep_their_digits():
    # σ² (4/3) (λΔt)³ to first order: 2e-18 where 1 − e^{−2a}(…) would have nothing left
    rate = math.sqrt(3) / 5
    assert process_noise(1e-6, 1.0, 5.0)[0, 0] == pytest.approx(4 / 3 * (rate * 1e-6) ** 3, rel=1e-5)
    assert process_noise(1e-6, 1.0, 5.0)[1, 1] == pytest.approx(4 * rate**3 * 1e-6, rel=1e-5)


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


# --- likelihood


def dense(time_s, found):
    """Covariance of samples by the formula."""
    apart = np.abs(np.subtract.outer(time_s, time_s)) * math.sqrt(3) / found[1]
    return found[0] ** 2 * (1 + apart) * np.exp(-apart) + found[2] ** 2 * np.eye(len(time_s))


def sample(rng, time_s, std_w, length_s, noise_w):
    return np.linalg.cholesky(dense(time_s, (std_w, length_s, noise_w)) + 1e-12 * np.eye(len(time_s))) @ (
        rng.standard_normal(len(time_s))
    )


@pytest.mark.parametrize("share", [0.01, 0.5, 0.999])
def test_innovations_are_gaussian_conditioning(share):
    rng = np.random.default_rng(4)
    at = np.sort(rng.uniform(0, 30, 25))
    series = rng.standard_normal((25, 3))
    innovations, spread = _innovations(np.diff(at), series, np.array([3.0]), np.array([share]))
    covariance = dense(at, (math.sqrt(share), 3.0, math.sqrt(1 - share)))
    for n in range(25):
        weights = np.linalg.solve(covariance[:n, :n], covariance[:n, n])
        assert innovations[n, 0] == pytest.approx(series[n] - weights @ series[:n], abs=1e-6)
        assert spread[n, 0] == pytest.approx(covariance[n, n] - weights @ covariance[:n, n], abs=1e-6)


def test_the_log_likelihood_is_the_density_of_the_samples():
    rng = np.random.default_rng(5)
    at = np.sort(rng.uniform(0, 60, 80))
    power = sample(rng, at, 0.8, 4.0, 0.3)
    found = fit_disturbance(at, power)
    wanted = multivariate_normal(cov=dense(at, (found.std_w, found.time_s, found.noise_w))).logpdf(power)
    assert found.log_likelihood == pytest.approx(wanted, abs=1e-6)


def test_with_columns_it_is_the_density_of_what_they_cannot_follow():
    # restricted: of K y, where the rows of K are an orthonormal basis of what is orthogonal to the columns
    rng = np.random.default_rng(6)
    at = np.sort(rng.uniform(0, 60, 60))
    columns = np.column_stack([np.ones(60), np.cos(at / 5), np.sin(at / 5)])
    power = sample(rng, at, 0.8, 4.0, 0.3) + columns @ [30.0, 2.0, -1.0]
    found = fit_disturbance(at, power, columns=columns)
    free = np.linalg.svd(columns)[0][:, 3:].T
    covariance = free @ dense(at, (found.std_w, found.time_s, found.noise_w)) @ free.T
    wanted = multivariate_normal(cov=covariance).logpdf(free @ power)
    assert found.log_likelihood == pytest.approx(wanted, abs=1e-5)


def test_it_is_the_likeliest():
    rng = np.random.default_rng(7)
    at = np.arange(0, 40, 0.25)
    power = sample(rng, at, 0.8, 4.0, 0.3)
    found = fit_disturbance(at, power)
    for std_w in (0.5, 0.7, 1.0, 1.5):
        for time_s in (1.0, 2.5, 4.0, 8.0):
            for noise_w in (0.1, 0.28, 0.35, 0.6):
                other = multivariate_normal(cov=dense(at, (std_w, time_s, noise_w))).logpdf(power)
                assert other <= found.log_likelihood + 0.1, "a tenth is less than any data can tell"


def test_what_was_put_in_is_found_on_average():
    """20 runs: each logarithm's mean within four of its own standard errors, and a coarse grid's bias, of the truth."""
    rng = np.random.default_rng(8)
    at = np.arange(0, 200, 0.5)
    found = [fit_disturbance(at, sample(rng, at, 0.8, 4.0, 0.3)) for _ in range(20)]
    logs = np.log([[f.std_w, f.time_s, f.noise_w] for f in found]) - np.log([0.8, 4.0, 0.3])
    error = logs.std(axis=0, ddof=1) / math.sqrt(len(found))
    assert (np.abs(logs.mean(axis=0)) < 4 * error + 0.05).all()


def test_coefficients_fitted_beside_do_not_make_the_noise_look_less():
    """Two laps of slow noise and 7 columns: restricted, the variance is right in the mean; of plain residuals less."""
    rng = np.random.default_rng(9)
    at = np.arange(0, 92, 1.0)
    angle = 2 * np.pi * at / 46
    columns = np.column_stack([np.ones(len(at))] + [f(j * angle) for j in (1, 2, 3) for f in (np.cos, np.sin)])
    with_columns, plain = [], []
    for _ in range(30):
        power = sample(rng, at, 0.8, 4.0, 0.3)
        found = fit_disturbance(at, power, columns=columns)
        with_columns.append(found.std_w**2 + found.noise_w**2)
        fitted, *_ = np.linalg.lstsq(columns, power, rcond=None)
        alone = fit_disturbance(at, power - columns @ fitted)
        plain.append(alone.std_w**2 + alone.noise_w**2)
    truth = 0.8**2 + 0.3**2
    error = np.std(with_columns, ddof=1) / math.sqrt(30)
    assert np.mean(with_columns) == pytest.approx(truth, abs=4 * error)
    assert np.mean(plain) < truth - 4 * np.std(plain, ddof=1) / math.sqrt(30)


def test_of_many_samples_both_ends_of_the_scale_are_looked_at():
    kept = subsampled(36_000, 1024)
    assert len(kept) <= 1024
    assert kept[0] == 0
    assert kept[-1] == 35_999
    gaps = np.diff(kept)
    assert (gaps > 0).all()
    assert (gaps == 1).sum() >= 400, "runs of consecutive samples"
    assert gaps.max() < 36_000 / 400, "and none far from any"
    assert subsampled(7, 1024).tolist() == list(range(7))


def test_thinned_samples_tell_the_same():
    rng = np.random.default_rng(10)
    at = 0.1 * np.arange(36_000)
    state, power = np.zeros(2), np.empty(len(at))
    step, root = transition(0.1, 6.0), np.linalg.cholesky(process_noise(0.1, 0.5, 6.0))
    for n, draw in enumerate(rng.standard_normal((len(at), 2))):
        state = step @ state + root @ draw
        power[n] = state[0]
    found = fit_disturbance(at, power + 0.3 * rng.standard_normal(len(at)))
    assert found.std_w == pytest.approx(0.5, rel=0.3)
    assert found.time_s == pytest.approx(6.0, rel=0.5)
    assert found.noise_w == pytest.approx(0.3, rel=0.15)


@pytest.mark.parametrize("count", [0, 1, 2, MIN_FREE_SAMPLES - 1])
def test_few_samples_are_white(count):
    rng = np.random.default_rng(11)
    at, power = np.arange(count, dtype=float), rng.standard_normal(count)
    found = fit_disturbance(at, power)
    assert found.std_w == 0
    assert found.time_s > 0
    assert found.noise_w == pytest.approx(math.sqrt(np.mean(power**2)) if count else 0.0)


@pytest.mark.parametrize("level", [0.0, 5.0])
def test_what_does_not_vary_has_no_noise(level):
    found = fit_disturbance(np.arange(50.0), np.full(50, level), columns=np.ones((50, 1)))
    assert found.std_w == 0
    assert found.noise_w <= 1e-6 * level + 1e-100


def test_fewer_samples_than_columns():
    found = fit_disturbance(np.arange(3.0), np.array([1.0, 2.0, 0.0]), columns=np.eye(3, 4))
    assert found == DisturbanceFit(0.0, 2.0, 0.0, -math.inf)


def test_columns_that_say_nothing_do_no_harm():
    rng = np.random.default_rng(12)
    at, power = np.arange(40.0), rng.standard_normal(40)
    found = fit_disturbance(at, power, columns=np.column_stack([np.ones(40), np.zeros(40), np.ones(40)]))
    assert found.std_w**2 + found.noise_w**2 == pytest.approx(power.var(ddof=1), rel=0.5)


@given(st.integers(0, 10**6), st.integers(8, 40))
def test_any_noise_gives_finite_answers(seed, count):
    rng = np.random.default_rng(seed)
    at = np.cumsum(10 ** rng.uniform(-3, 3, count))
    found = fit_disturbance(at, 10 ** rng.uniform(-3, 3) * rng.standard_normal(count))
    assert all(math.isfinite(value) for value in (found.std_w, found.time_s, found.noise_w, found.log_likelihood))
    assert found.time_s > 0
