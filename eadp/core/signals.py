"""Signals: harmonics, and the mean of samples that are alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray


def output_row(order: int) -> FloatArray:
    """The row C that reads the power off the state.

    Parameters
    ----------
    order : int
        Number of harmonics r, 0 or more.

    Returns
    -------
    array, shape (2r + 1,)
        [1, 1, 0, …, 1, 0]. The letter's 1/T is in the state, which is in watts.

    Source: letter, Eq. 7.
    """
    row = np.zeros(2 * order + 1)
    row[0] = 1.0
    row[1::2] = 1.0
    return row


def signal_w(times_s: ArrayLike, a: ArrayLike, b: ArrayLike, period_s: float) -> FloatArray:
    """The papers' Fourier series at many times at once.

    Parameters
    ----------
    times_s : array, any shape
        Times [s].
    a : array, shape (r + 1,)
        Coefficients a0, a1, …, ar [W s].
    b : array, shape (r,)
        Coefficients b1, …, br [W s].
    period_s : float
        T [s], above 0.

    Returns
    -------
    array, shape of `times_s`
        Power [W].

    Source: letter, Eq. 3.
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    angle = 2 * np.pi / period_s * np.arange(1, len(a)) * np.asarray(times_s, dtype=float)[..., np.newaxis]
    # h(t) = a0/T + (2/T) Σ_j (a_j cos ωjt + b_j sin ωjt)
    power: FloatArray = (a[0] + 2 * (np.cos(angle) @ a[1:] + np.sin(angle) @ b)) / period_s
    return power


def coefficients_of_state(state_w: ArrayLike, period_s: float) -> tuple[FloatArray, FloatArray]:
    """The papers' coefficients of a state.

    Parameters
    ----------
    state_w : array, shape (2r + 1,)
        q at t = 0 [W].
    period_s : float
        T [s], above 0.

    Returns
    -------
    a, b : array, shapes (r + 1,) and (r,)
        a0..ar and b1..br [W s].

    Source: letter, Lemma III.1, which prints a_j/2 where q0 has 2 a_j.
    """
    state = np.asarray(state_w, dtype=float)
    cosine = np.concatenate([state[:1], state[1::2] / 2])
    return cosine * period_s, state[2::2] / 2 * period_s


def state_of_phases(mean_w: float, amplitude_w: ArrayLike, phase_rad: ArrayLike) -> FloatArray:
    """State at t = 0 of mean + Σ_j amplitude_j cos(ωjt + phase_j).

    Parameters
    ----------
    mean_w : float
        Mean power [W].
    amplitude_w, phase_rad : array, shape (r,)
        Amplitude [W] and phase [rad] of each harmonic.

    Returns
    -------
    array, shape (2r + 1,)
        q [W].
    """
    amplitude, phase = np.asarray(amplitude_w, dtype=float), np.asarray(phase_rad, dtype=float)
    state = np.empty(2 * len(amplitude) + 1)
    # A cos(ωjt + φ) = A cos φ · cos ωjt − A sin φ · sin ωjt
    state[0], state[1::2], state[2::2] = mean_w, amplitude * np.cos(phase), -amplitude * np.sin(phase)
    return state


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
