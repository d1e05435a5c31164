"""Fit of a correlated disturbance, a Matérn-3/2 process, and white noise to samples of a power."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray, IntArray

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
