"""Forecast model of a periodic power with a correlated disturbance: transition, process noise and output rows.

The state is x = [α0, α1, β1, …, αr, βr, d, ḋ]: the Fourier state of `eadp.core.signals`, and the Matérn-3/2
process of `eadp.papers.forecasting` beside it. The power is C x with C = [1, 1, 0, …, 1, 0, 1, 0], and
ẋ = A x + noise. The row of a forecast is C e^{At}.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.signals import output_row, rotation_matrix


def output(order: int) -> FloatArray:
    """C, shape (2r + 3,): the Fourier state's power and the disturbance."""
    return np.concatenate([output_row(order), [1.0, 0.0]])


def step_matrix(order: int, period_s: float, time_s: float, step_s: float) -> FloatArray:
    """e^{A Δt}, shape (2r + 3, 2r + 3), of r harmonics of a period and a disturbance of a time constant [s]."""
    size = 2 * order + 1
    matrix = np.zeros((size + 2, size + 2))
    matrix[:size, :size] = rotation_matrix(order, period_s, step_s)
    matrix[size:, size:] = transition(step_s, time_s)
    return matrix


def step_noise(drift_w2_per_s: FloatArray, std_w: float, time_s: float, step_s: float) -> FloatArray:
    """Covariance that one step adds to the state, shape (2r + 3, 2r + 3).

    Parameters
    ----------
    drift_w2_per_s : array, shape (r + 1,)
        Growth of the variance of the level, and of either part of each harmonic [W²/s]. Alike in both parts, a
        harmonic's drift is the same in every turn, so this is exact.
    std_w, time_s : float
        The disturbance's [W], [s].
    step_s : float
        [s], 0 or more.
    """
    size = 2 * len(drift_w2_per_s) - 1
    noise = np.zeros((size + 2, size + 2))
    noise[:size, :size] = np.diag(np.repeat(drift_w2_per_s, 2)[1:]) * step_s
    noise[size:, size:] = process_noise(step_s, std_w, time_s)
    return noise


def power_rows(order: int, period_s: float, time_s: float, ahead_s: ArrayLike) -> FloatArray:
    """C e^{A t}: what a state is multiplied by for the power at instants.

    Parameters
    ----------
    order : int
        r, 0 or more.
    period_s, time_s : float
        The period and the disturbance's time constant [s], above 0.
    ahead_s : array, shape (n,)
        t [s], 0 or more.

    Returns
    -------
    array, shape (n, 2r + 3)
    """
    ahead = np.asarray(ahead_s, dtype=float)
    angle = 2 * math.pi / period_s * ahead[:, None] * np.arange(1, order + 1)
    rows = np.ones((len(ahead), 2 * order + 3))
    rows[:, 1:-2:2], rows[:, 2:-2:2] = np.cos(angle), np.sin(angle)
    # the first row of the disturbance's e^{Ft}: e^{−λt} [1 + λt, t]
    turns = rate_per_s(time_s) * ahead
    rows[:, -2], rows[:, -1] = np.exp(-turns) * (1 + turns), np.exp(-turns) * ahead
    return rows


def scaling_factors(low: float, high: float, at_low: float, at_high: float) -> tuple[float, float]:
    """ν and τ of a parameter.

    Parameters
    ----------
    low, high : float
        The parameter's set.
    at_low, at_high : float
        û at its ends. Of a computation its power [W], of one of ρ path parameters its share of the time of the whole
        coverage [s]: t̲/ρ with all of them at their lowest and t̄/ρ at their highest.

    Returns
    -------
    nu, tau : float
        [W or s per unit] and [W or s]; a set of one value has ν = 0 and what holds at `high`.

    Source: letter, Eqs. 10 and 11; the τ of Eq. 10 does not give t̲ at c̲ as printed and is corrected.
    """
    if low == high:
        return 0.0, at_high
    # ν = (g(c̄) − g(c̲))/(c̄ − c̲),  τ = c̲ (g(c̲) − g(c̄))/(c̄ − c̲) + g(c̲)
    nu = (at_high - at_low) / (high - low)
    tau = low * (at_low - at_high) / (high - low) + at_low
    return nu, tau


def rate_per_s(time_s: float) -> float:
    """λ = √3/ℓ [1/s] of a time constant ℓ [s], above 0."""
    return math.sqrt(3) / time_s


def transition(step_s: float, time_s: float) -> FloatArray:
    """The exact step of the two states, e^{F Δt}.

    Parameters
    ----------
    step_s : float
        Δt [s], 0 or more.
    time_s : float
        ℓ [s], above 0.

    Returns
    -------
    array, shape (2, 2)

    Source: Hartikainen and Särkkä 2010, Sec. 4.1.
    """
    rate = rate_per_s(time_s)
    turns = rate * step_s
    # e^{FΔt} = e^{−λΔt} [[1 + λΔt, Δt], [−λ²Δt, 1 − λΔt]]
    return math.exp(-turns) * np.array([[1 + turns, step_s], [-rate * turns, 1 - turns]])


def process_noise(step_s: float, std_w: float, time_s: float) -> FloatArray:
    """Process noise of one step of the two states.

    Parameters
    ----------
    step_s : float
        Δt [s], 0 or more.
    std_w, time_s : float
        σ [W], 0 or more, and ℓ [s], above 0.

    Returns
    -------
    array, shape (2, 2)
        Q with units W², W²/s, W²/s²: P∞ − e^{FΔt} P∞ e^{FᵀΔt}, in a form that keeps its digits for short steps.
    """
    rate = rate_per_s(time_s)
    turns = rate * step_s
    fade = math.exp(-2 * turns)
    # 1 − e^{−2a} (1 + 2a + 2a²), a = λΔt
    place = _gamma_3(2 * turns)
    both = 2 * turns**2 * fade
    # 1 − e^{−2a} (1 − 2a + 2a²)
    slope = -math.expm1(-2 * turns) + 2 * turns * (1 - turns) * fade
    return std_w**2 * np.array([[place, rate * both], [rate * both, rate**2 * slope]])


def _gamma_3(x: float) -> float:
    """The incomplete gamma function P(3, x): 1 − e^{−x} (1 + x + x²/2), for small x the rest of the series of e^x.

    Importing scipy's takes a tenth of a second.
    """
    if x > 3:
        return 1 - math.exp(-x) * (1 + x + x * x / 2)
    term, total, k = x**3 / 6, 0.0, 3
    while total + term != total:
        total, k = total + term, k + 1
        term *= x / k
    return math.exp(-x) * total


def stationary_covariance(std_w: float, time_s: float) -> FloatArray:
    """Stationary covariance of the two states: P∞ = diag(σ², λ²σ²), shape (2, 2)."""
    return std_w**2 * np.diag([1.0, rate_per_s(time_s) ** 2])


# --- noise and disturbance, estimated from readings

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
