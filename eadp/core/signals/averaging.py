"""Mean of a time series and its standard error under autocorrelation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray


class SampleMean(NamedTuple):
    """Mean of samples [their unit] with its uncertainty.

    `std` is the standard deviation of the samples, `standard_error` that of their mean, `effective` the effective
    sample size, at most `samples`. Both deviations of a single sample are 0.
    """

    mean: float
    std: float
    standard_error: float
    samples: int
    effective: float


def average(runs: Sequence[ArrayLike]) -> SampleMean:
    """Mean of samples, and its standard error with the autocorrelation within each run.

    Parameters
    ----------
    runs : sequence of arrays, each shape (n_i,)
        Evenly sampled, one array for each uninterrupted run. Samples of different runs count as independent; a
        difference between the levels of runs shows in both deviations.

    Returns
    -------
    SampleMean
        The standard error is at least that of as many independent samples: a negative autocorrelation, which would
        allow less, cannot be established from few samples.

    Raises
    ------
    ValueError
        If there is no sample.

    Source: Geyer, Practical Markov chain Monte Carlo, Statistical Science 7 (1992), sec. 3.3: initial monotone
    positive sequence. Wolff, Monte Carlo errors with less errors, Comput. Phys. Commun. 156 (2004): the factor
    1 + (2W + 1)/n for what subtracting the samples' own mean takes away.
    """
    series = [np.asarray(run, dtype=np.float64) for run in runs if np.size(run)]
    n = sum(map(len, series))
    if not n:
        raise ValueError("no samples have no mean")
    values = np.concatenate(series)
    if values.min() == values.max():  # exact, without the rounding of a sum
        return SampleMean(float(values[0]), 0.0, 0.0, n, float(n))
    mean = math.fsum(values.tolist()) / n
    variance = math.fsum(((values - mean) ** 2).tolist()) / (n - 1)
    lags = _autocovariances([run - mean for run in series], n)
    pairs = lags[: len(lags) // 2 * 2].reshape(-1, 2).sum(axis=1)
    ended = np.flatnonzero(pairs <= 0)
    kept = np.minimum.accumulate(pairs[: ended[0] if len(ended) else None])
    # var(mean) = (γ0 + 2 Σ_{k=1..W} γ_k)/n = (2 Σ_m (γ_2m + γ_2m+1) − γ0)/n, W the last lag kept
    window = max(0, min(2 * len(kept), max(map(len, series))) - 1)
    of_mean = (2 * float(kept.sum()) - float(lags[0])) / n * (1 + (2 * window + 1) / n)
    of_mean = max(of_mean, variance / n)
    return SampleMean(mean, math.sqrt(variance), math.sqrt(of_mean), n, variance / of_mean)


def _autocovariances(runs: Sequence[FloatArray], n: int) -> FloatArray:
    """γ_k = 1/n Σ x_t x_(t+k) over pairs within a run, for k below the longest run's length; at least two of them."""
    total = np.zeros(max(2, max(map(len, runs))))
    singles = [run for run in runs if len(run) == 1]
    if singles:
        total[0] += float(np.sum(np.concatenate(singles) ** 2))
    for run in runs:
        if len(run) > 1:
            spectrum = np.fft.rfft(run, 2 * len(run))
            products = np.fft.irfft(np.abs(spectrum) ** 2, 2 * len(run))[: len(run)]
            total[: len(run)] += products
    return total / n
