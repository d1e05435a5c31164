"""Likelihoods in coloured noise, against scipy's normal distribution and dense generalised least squares."""

import math

import numpy as np
import pytest
from scipy.linalg import solve
from scipy.stats import multivariate_normal

from eadp.measure.harmonics import design_matrix
from eadp.measure.noise import _COLOURED_PARTS, TimeBins, binned, tail

N = 60


def bins(seed: int = 0) -> TimeBins:
    rng = np.random.default_rng(seed)
    times = np.sort(rng.uniform(0, 100, N))
    power = 2 * np.cos(2 * np.pi * times / 30) + np.cumsum(rng.normal(0, 0.3, N)) + rng.normal(0, 0.2, N)
    return TimeBins(times, power, 100 / N, 100.0, 1.0)


def dense_likelihood(power: np.ndarray, columns: np.ndarray, correlation: np.ndarray) -> tuple[float, float]:
    """Log-likelihood at the best coefficients and variance, and that of the restricted kind without constants."""
    n, m = columns.shape
    whitened = solve(correlation, columns)
    fitted = solve(columns.T @ whitened, whitened.T @ power)
    residual = power - columns @ fitted
    error = float(residual @ solve(correlation, residual))
    density = multivariate_normal(np.zeros(n), correlation * error / n, allow_singular=True).logpdf(residual)
    volume = np.linalg.slogdet(columns.T @ whitened)[1] + np.linalg.slogdet(correlation)[1]
    return float(density), -0.5 * ((n - m) * math.log(error) + float(volume))


def correlations(table: TimeBins) -> list[np.ndarray]:
    return [v * w @ v.T for w, v in ((t.eigenvalues, t.vectors) for t in table._eigenbases)]


def test_noise_is_the_likeliest_of_all_mixtures() -> None:
    table = bins()
    columns = design_matrix(table.times_s, 1 / 30, 1)
    found = table.best_noise(columns)
    best = max(
        dense_likelihood(table.power_w, columns, part * k + (1 - part) * np.eye(N))[0]
        for k in correlations(table)
        for part in _COLOURED_PARTS[2:]
    )
    constant = -0.5 * N * (1 + math.log(2 * math.pi))
    assert found.log_likelihood + constant == pytest.approx(best, abs=1e-3)
    np.testing.assert_allclose(np.diag(found.correlation), 1, atol=1e-6)
    assert np.linalg.eigvalsh(found.correlation).min() > 0


def test_covariance_of_coefficients_is_that_of_every_noise_by_its_restricted_likelihood() -> None:
    table = bins(2)
    columns = design_matrix(table.times_s, 1 / 30, 1)
    fitted, *_ = np.linalg.lstsq(columns, table.power_w, rcond=None)
    left = float(np.sum((table.power_w - columns @ fitted) ** 2)) / (N - 3)
    back = np.linalg.inv(columns.T @ columns) @ columns.T
    likelihoods, covariances = [], []
    for turned, k in zip(table._eigenbases, correlations(table), strict=True):
        for part in _COLOURED_PARTS:
            correlation = part * k + (1 - part) * np.eye(N)
            whitened = solve(correlation, columns)
            residual = table.power_w - columns @ solve(columns.T @ whitened, whitened.T @ table.power_w)
            variance = float(residual @ solve(correlation, residual)) / (N - 3)
            if turned.length_s <= table.covered_s / 3 and variance <= 4 * left:
                likelihoods.append(dense_likelihood(table.power_w, columns, correlation)[1])
                covariances.append(back @ (variance * correlation) @ back.T)
    weight = np.exp(np.array(likelihoods) - max(likelihoods))
    expected = np.einsum("k,kij->ij", weight / weight.sum(), np.array(covariances))
    np.testing.assert_allclose(table.coefficient_covariance(columns), expected, rtol=1e-4, atol=1e-9)


def test_scan_finds_the_wave_in_the_noise() -> None:
    table = bins()
    frequency = np.linspace(0.02, 0.1, 41)
    found = table.scan(np.stack([design_matrix(table.times_s, f, 2) for f in frequency]))[0]
    assert found.gain.shape == found.posterior.shape == (2, 41)
    assert np.all(np.diff(found.gain, axis=0) >= -1e-9), "a higher order is never less likely"
    assert frequency[np.argmax(found.gain[0])] == pytest.approx(1 / 30, abs=0.003)
    assert frequency[np.argmax(found.posterior[0])] == pytest.approx(1 / 30, abs=0.003)


def test_surrogates_have_the_noise_of_the_samples() -> None:
    table = bins()
    noise = table.best_noise(np.ones((N, 1)))
    draws = table.surrogates(4000, np.random.default_rng(3))
    np.testing.assert_allclose(np.cov(draws), noise.correlation, atol=0.12)
    again = table.surrogates(4000, np.random.default_rng(3))
    np.testing.assert_array_equal(draws, again)


def test_bins_are_averages_and_empty_ones_are_left_out() -> None:
    times = np.array([0.0, 0.1, 0.2, 5.0, 9.0, 9.2])
    table = binned(times, times**2, 1.0, 9.2)
    np.testing.assert_allclose(table.times_s, [0.1, 5.0, 9.1])
    np.testing.assert_allclose(table.power_w, [0.05 / 3, 25, (81 + 9.2**2) / 2])
    assert (table.samples_per_bin, table.covered_s) == (2.0, pytest.approx(9.0))


def test_tail_is_that_of_gumbels_law() -> None:
    rng = np.random.default_rng(4)
    drawn = rng.gumbel(5, 2, 20_000)
    for statistic in (3.0, 6.0, 12.0, 20.0):
        assert tail(statistic, drawn) == pytest.approx(-math.expm1(-math.exp(-(statistic - 5) / 2)), rel=0.1)
    assert tail(1e9, drawn) < 1e-300
    assert tail(-1e9, drawn) == 1
