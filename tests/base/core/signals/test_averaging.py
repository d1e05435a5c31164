"""The standard error of a mean: against the exact variance of the mean of an AR(1), and against plain definitions."""

import math
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.signals import average

sample = st.integers(-1000, 1000).map(lambda k: k / 16)


def autoregression(phi: float, n: int, rng: np.random.Generator) -> np.ndarray:
    """x_t = φ x_(t−1) + e_t, stationary from its first value, of variance 1."""
    x = np.empty(n)
    x[0] = rng.standard_normal()
    noise = rng.standard_normal(n) * math.sqrt(1 - phi * phi)
    for t in range(1, n):
        x[t] = phi * x[t - 1] + noise[t]
    return x


def exact_error(phi: float, n: int) -> float:
    """The standard deviation of the mean of n values of it, by the double sum of its covariances φ^|i − j|."""
    lags = np.arange(1, n)
    return math.sqrt((n + 2 * float(np.sum((n - lags) * phi**lags))) / n**2)


@pytest.mark.parametrize(("phi", "n"), [(0.0, 400), (0.5, 400), (0.9, 1000), (0.97, 3000)])
def test_error_of_an_autoregression(phi: float, n: int) -> None:
    rng = np.random.default_rng(7)
    found = [average([autoregression(phi, n, rng)]).standard_error for _ in range(120)]
    assert statistics.median(found) == pytest.approx(exact_error(phi, n), rel=0.12)


@given(st.lists(sample, min_size=1, max_size=40))
def test_mean_and_spread_are_those_of_statistics(values: list[float]) -> None:
    found = average([values])
    assert found.mean == pytest.approx(statistics.fmean(values), abs=1e-9)
    assert found.std == pytest.approx(statistics.stdev(values) if len(values) > 1 else 0, abs=1e-9)
    assert found.samples == len(values)
    assert 0 < found.effective <= len(values) * (1 + 1e-12)
    assert found.standard_error == pytest.approx(found.std / math.sqrt(found.effective))


@pytest.mark.parametrize(
    ("runs", "squared_error"),
    [
        # n = 4, γ = 4/16, 1/16, −2/16, −1/16: one positive pair, so W = 1
        ([[0, 0, 1, 1]], (2 * 5 / 16 - 4 / 16) / 4 * (1 + 3 / 4)),
        # n = 8, γ = 8/32, 5/32, 2/32, −1/32, −4/32, …: two positive pairs, so W = 3
        ([[0, 0, 0, 0, 1, 1, 1, 1]], (2 * 14 / 32 - 8 / 32) / 8 * (1 + 7 / 8)),
        # the same in two runs: γ = 8/32, 6/32, 4/32, 2/32, two positive pairs
        ([[0, 0, 0, 0], [1, 1, 1, 1]], (2 * 20 / 32 - 8 / 32) / 8 * (1 + 7 / 8)),
        # n = 6, γ = 6/24, and 2/24 within the runs of two
        ([[0], [1, 1], [1], [0, 0]], (2 * 8 / 24 - 6 / 24) / 6 * (1 + 3 / 6)),
    ],
)
def test_errors_worked_by_hand(runs: list[list[float]], squared_error: float) -> None:
    found = average(runs)
    assert found.standard_error == pytest.approx(math.sqrt(squared_error))
    # Σ (x − ½)² = n/4
    n = found.samples
    assert found.effective == pytest.approx(n / 4 / (n - 1) / squared_error)


def test_one_value_and_none() -> None:
    assert average([[0.1]]) == (0.1, 0.0, 0.0, 1, 1.0)
    assert average([[0.1, 0.1], [0.1]]) == (0.1, 0.0, 0.0, 3, 3.0)
    with pytest.raises(ValueError, match="no samples"):
        average([[]])
