"""Signals: harmonics by least squares, and the correlated part of what they leave."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray, IntArray


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


def rotation_matrix(order: int, period_s: float, step_s: float) -> FloatArray:
    """The exact step of the state, e^{A Δt}: one rotation for each harmonic.

    Parameters
    ----------
    order : int
        Number of harmonics r, 0 or more.
    period_s : float
        T [s], above 0.
    step_s : float
        Δt [s], of any size and sign.

    Returns
    -------
    array, shape (2r + 1, 2r + 1)

    Source: letter, Eqs. 4 and 6.
    """
    harmonic = np.arange(1, order + 1)
    angle = 2 * np.pi / period_s * harmonic * step_s
    cosine, sine = 2 * harmonic - 1, 2 * harmonic  # where α_j and β_j stand in the state
    matrix = np.eye(2 * order + 1)
    # A_j = [[0, ωj], [−ωj, 0]]  →  e^{A_j Δt} = [[cos ωjΔt, sin ωjΔt], [−sin ωjΔt, cos ωjΔt]]
    matrix[cosine, cosine] = matrix[sine, sine] = np.cos(angle)
    matrix[cosine, sine] = np.sin(angle)
    matrix[sine, cosine] = -np.sin(angle)
    return matrix


def rotated(state_w: ArrayLike, period_s: float | None, ahead_s: FloatArray) -> FloatArray:
    """The states that a state leads to, e^{A t} q, at many times ahead.

    Parameters
    ----------
    state_w : array, shape (2r + 1,)
        q now [W].
    period_s : float or None
        T [s], above 0; None without harmonics.
    ahead_s : array, shape (n,)
        Times from now [s].

    Returns
    -------
    array, shape (n, 2r + 1)
        States [W].

    Source: letter, Eqs. 4 and 6.
    """
    state = np.asarray(state_w, dtype=float)
    states = np.repeat(state[None], len(ahead_s), axis=0)
    if period_s is not None and len(state) > 1:
        angle = 2 * np.pi / period_s * np.arange(1, (len(state) + 1) // 2) * ahead_s[:, None]
        cosine, sine = np.cos(angle), np.sin(angle)
        states[:, 1::2] = cosine * state[1::2] + sine * state[2::2]
        states[:, 2::2] = cosine * state[2::2] - sine * state[1::2]
    return states


def design_matrix(times_s: FloatArray, frequency_hz: float, order: int) -> FloatArray:
    """Columns of harmonic least squares: 1, cos, sin, cos 2, sin 2, …, so that lower orders lead.

    Parameters
    ----------
    times_s : array, shape (n,)
        Times [s].
    frequency_hz : float
        1/T [Hz].
    order : int
        Number of harmonics r, 0 or more.

    Returns
    -------
    array, shape (n, 2r + 1)
    """
    turn = np.exp(2j * np.pi * frequency_hz * times_s)
    columns = np.ones((2 * order + 1, len(times_s)))
    power = turn
    for harmonic in range(1, order + 1):
        columns[2 * harmonic - 1], columns[2 * harmonic] = power.real, power.imag
        power = power * turn
    return columns.T


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


def phases_of_state(state_w: ArrayLike) -> tuple[float, FloatArray, FloatArray]:
    """Mean, amplitudes and phases of a state: the inverse of `state_of_phases`.

    Parameters
    ----------
    state_w : array, shape (2r + 1,)
        q at t = 0 [W].

    Returns
    -------
    mean_w : float
        Mean power [W].
    amplitude_w, phase_rad : array, shape (r,)
        Amplitudes, 0 or more [W], and phases in (−π, π] [rad].
    """
    state = np.asarray(state_w, dtype=float)
    cosine, sine = state[1::2], state[2::2]
    return float(state[0]), np.hypot(cosine, sine), np.arctan2(-sine, cosine)


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


MAX_SAMPLES = 1024
"""Most samples that `fit_disturbance` uses by default."""
RUNS = 8
"""Of more samples, half are taken evenly and half in this many runs of consecutive ones."""
MIN_FREE_SAMPLES = 8
"""Fewest degrees of freedom: samples beyond the columns; with fewer all noise counts as white."""

_TIMES, _SHARES = 8, 8
_ZOOM_OFFSETS = np.linspace(-1.0, 1.0, 5)
_ZOOMS = 3
_MAX_LOGIT = 12.0
_FORGOTTEN = 40.0
_MIN_NOISE = 1e-12


@dataclass(frozen=True, slots=True)
class DisturbanceFit:
    """Fitted σ [W] and ℓ [s] of the disturbance, standard deviation of the white noise [W], and the log-likelihood."""

    std_w: float
    time_s: float
    noise_w: float
    log_likelihood: float


def fit_disturbance(
    time_s: ArrayLike, residual_w: ArrayLike, *, columns: ArrayLike | None = None, samples: int = MAX_SAMPLES
) -> DisturbanceFit:
    """Maximum-likelihood fit of a disturbance and white noise to residuals.

    The likelihood is that of the innovations of a Kalman filter with the exact step, so sampling may be irregular. The
    variance is eliminated, the time constant and the disturbance's share of the variance are searched on a grid, then
    on finer grids round its maximum. With `columns` the likelihood is the restricted one, so that coefficients fitted
    to the same samples do not bias the noise downwards.

    Parameters
    ----------
    time_s : array, shape (n,)
        Strictly increasing [s].
    residual_w : array, shape (n,)
        [W]; its mean counts as 0 unless a column is constant.
    columns : array, shape (n, p), optional
        Regressors that the residual may also contain, with any coefficients.
    samples : int
        Of more samples than this a subset is used: half evenly spaced, half in `RUNS` runs of consecutive ones, so
        that both long and short correlation show.

    Returns
    -------
    DisturbanceFit
        The time constant is between the shortest step and the span. All white (`std_w` 0) where there are fewer than
        `MIN_FREE_SAMPLES` samples more than columns, or where they do not vary.

    Source: Schweppe 1965 (likelihood of the innovations); Patterson and Thompson 1971 (restricted likelihood).
    """
    times = np.asarray(time_s, dtype=float)
    power = np.asarray(residual_w, dtype=float)
    table = np.empty((len(times), 0)) if columns is None else np.asarray(columns, dtype=float)
    keep = subsampled(len(times), samples)
    times, series = times[keep], _orthonormal(table[keep], power[keep])
    least = max((1e-7 * float(np.max(np.abs(power), initial=0.0))) ** 2, 1e-300)
    white = _white(series, least)
    span_s = float(times[-1] - times[0]) if len(times) > 1 else 0.0
    if len(times) - series.shape[1] + 1 < MIN_FREE_SAMPLES or white[0] <= least:
        return DisturbanceFit(0.0, span_s or 1.0, math.sqrt(white[0]), white[1])
    likelihood, variance, log_time, logit = _searched(times, series, least)
    if white[1] >= likelihood:
        return DisturbanceFit(0.0, span_s, math.sqrt(white[0]), white[1])
    share = 1 / (1 + math.exp(-logit))
    return DisturbanceFit(
        math.sqrt(share * variance), math.exp(log_time), math.sqrt((1 - share) * variance), likelihood
    )


def subsampled(count: int, most: int) -> IntArray:
    """Indices of at most `most` of `count` samples: half of them evenly, half in runs; fewer where the two meet."""
    if count <= most:
        return np.arange(count)
    length = most // (2 * RUNS)
    even = np.linspace(0, count - 1, most - RUNS * length).astype(np.int64)
    starts = np.linspace(0, count - length, RUNS).astype(np.int64)
    return np.unique(np.concatenate([even, (starts[:, np.newaxis] + np.arange(length)).ravel()]))


def _orthonormal(columns: FloatArray, power_w: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns and the power's residual, side by side."""
    basis, size, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, size > 1e-10 * np.max(size, initial=0.0)]
    return np.column_stack([basis, power_w - basis @ (basis.T @ power_w)])


def _searched(times_s: FloatArray, series: FloatArray, least: float) -> tuple[float, float, float, float]:
    """The maximum log-likelihood, its variance, log ℓ and the logit of the disturbance's share of the variance."""
    steps = np.diff(times_s)
    low, high = math.log(float(steps.min())), math.log(float(times_s[-1] - times_s[0]))
    spacing = np.array([(high - low) / (_TIMES - 1), 2 * _MAX_LOGIT / (_SHARES - 1)])
    log_times, logits = np.linspace(low, high, _TIMES), np.linspace(-_MAX_LOGIT, _MAX_LOGIT, _SHARES)
    best = (-math.inf, 0.0, low, 0.0)
    for _ in range(1 + _ZOOMS):
        grid = [axis.ravel() for axis in np.meshgrid(log_times, logits)]
        likelihood, variance = _likelihoods(steps, series, np.exp(grid[0]), 1 / (1 + np.exp(-grid[1])), least)
        i = int(np.argmax(likelihood))
        if likelihood[i] > best[0]:
            best = (float(likelihood[i]), float(variance[i]), float(grid[0][i]), float(grid[1][i]))
        log_times = np.clip(best[2] + spacing[0] * _ZOOM_OFFSETS, low, high)
        logits = best[3] + spacing[1] * _ZOOM_OFFSETS
        spacing /= 2
    return best


def _likelihoods(
    steps_s: FloatArray, series: FloatArray, time_s: FloatArray, share: FloatArray, least: float
) -> tuple[FloatArray, FloatArray]:
    """Log-likelihood and best variance of each candidate (time_s, share): shapes (k,)."""
    innovations, spread = _innovations(steps_s, series, time_s, share)
    root = (innovations / np.sqrt(spread)[..., np.newaxis]).transpose(1, 0, 2)
    gram = root.transpose(0, 2, 1) @ root
    return _restricted(gram, np.log(spread).sum(axis=0), len(series), least)


def _restricted(gram: FloatArray, log_spread: FloatArray, count: int, least: float) -> tuple[FloatArray, FloatArray]:
    """Restricted log-likelihood and variance from [X y]ᵀ V⁻¹ [X y], shape (k, p + 1, p + 1), and log |V|."""
    p = gram.shape[-1] - 1
    free = count - p
    error = gram[:, p, p].copy()
    log_columns = np.zeros(len(gram))
    if p:
        inner = gram[:, :p, :p]
        fitted = np.linalg.solve(inner, gram[:, :p, p:])[..., 0]
        error -= np.einsum("ki,ki->k", fitted, gram[:, :p, p])
        log_columns = np.linalg.slogdet(inner)[1]
    variance = np.maximum(error / free, least)
    # −½ ((n − p)(ln 2πs² + 1) + ln |V| + ln |XᵀV⁻¹X|)
    likelihood: FloatArray = -0.5 * (free * (np.log(2 * np.pi * variance) + 1) + log_spread + log_columns)
    return likelihood, variance


def _white(series: FloatArray, least: float) -> tuple[float, float]:
    """Variance and log-likelihood of white noise alone."""
    count, p = len(series), series.shape[1] - 1
    if count <= p:
        return 0.0, -math.inf
    likelihood, variance = _restricted((series.T @ series)[np.newaxis], np.zeros(1), count, least)
    return float(variance[0]), float(likelihood[0])


def _innovations(
    steps_s: FloatArray, series: FloatArray, time_s: FloatArray, share: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Innovations of every series under every candidate, shape (n, k, p + 1), and their variance, shape (n, k).

    The total variance is 1, of which the disturbance has `share`. The states are d and ḋ/λ, both of that variance. The
    recursion carries the reduction Δ = P∞ − P of their covariance: Δ ← Φ Δ Φᵀ needs no process noise.
    """
    size = series.shape[1]
    # e^{F Δt} of d and ḋ/λ for every step and time constant, shape (steps, k, 2, 2)
    turns = steps_s[:, np.newaxis] * (math.sqrt(3) / time_s)
    fade = np.where(turns < _FORGOTTEN, np.exp(-turns), 0.0)  # denormal numbers are slow
    matrix = np.stack([1 + turns, turns, -turns, 1 - turns], axis=-1) * fade[..., np.newaxis]
    phi = matrix.reshape(*turns.shape, 2, 2)
    # `carried` is the state of every series, then Δ; a row of `left` is y − C x of each, then P Cᵀ = P∞ Cᵀ − Δ Cᵀ
    carried = np.zeros((len(time_s), 2, size + 2))
    left = np.zeros((len(series), len(time_s), size + 2))
    left[:, :, :size], left[:, :, size] = series[:, np.newaxis, :], share
    noise = 1 - share + _MIN_NOISE
    for n, row in enumerate(left):
        if n:
            step = phi[n - 1]
            carried = step @ carried
            carried[:, :, size:] = carried[:, :, size:] @ step.transpose(0, 2, 1)
        row -= carried[:, 0, :]
        # K = P Cᵀ / S, S = C P Cᵀ + R;  x ← x + K e,  Δ ← Δ + K C P
        gain = row[:, size:] / (row[:, size] + noise)[:, np.newaxis]
        carried += gain[:, :, np.newaxis] * row[:, np.newaxis, :]
    return left[:, :, :size], left[:, :, size] + noise
