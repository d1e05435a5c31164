"""Variances of the estimator's forecasts, in closed form.

No planner asks for them; they hold the estimator's covariance to account in tests.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammainc

from eadp.core.arrays import FloatArray
from eadp.papers.estimator import ExactEstimator
from eadp.papers.forecasting import power_rows, rate_per_s


def forecast_w(state_w: ArrayLike, period_s: float, ahead_s: ArrayLike) -> FloatArray:
    """Power [W] that a state leads to, C e^{A t} q, at times ahead [s]. Source: letter, Eq. 4 with u = 0."""
    state = np.asarray(state_w, dtype=float)
    harmonic = np.arange(1, (len(state) + 1) // 2)
    angle = 2 * np.pi / period_s * harmonic * np.asarray(ahead_s, dtype=float)[..., np.newaxis]
    # the first row of each block: [cos ωjt, sin ωjt]
    return state[0] + np.cos(angle) @ state[1::2] + np.sin(angle) @ state[2::2]


def forecast_with_variance(estimator: ExactEstimator, ahead_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Motion power [W] and its variance [W²], `ahead_s` [s] after the last reading; the sensor's noise is apart.

    The variance is that of the state's estimate, of the noise yet to come, and of the period: the slope of the forecast
    by it times its standard deviation, and never more than a uniformly distributed phase would make.
    """
    known, model = estimator._filter, estimator._filter.dynamics
    rows = power_rows(model.order, model.period_s, model.time_s, ahead_s)
    # C e^{At} P e^{Aᵀt} Cᵀ + what noise adds + (∂h/∂T)² var T
    variance = np.einsum("ni,ij,nj->n", rows, known.covariance, rows)
    variance += power_variance_w2(model.drift_w2_per_s, model.std_w, model.time_s, ahead_s)
    if estimator.period_s is not None:
        slope = power_by_period(known.state, estimator.period_s, ahead_s)
        variance += np.minimum((slope * estimator.period_std_s) ** 2, float(_squared_amplitudes(known.state).sum()))
    return rows @ known.state, variance


def _squared_amplitudes(state: FloatArray) -> FloatArray:
    return state[1:-2:2] ** 2 + state[2:-2:2] ** 2


def power_variance_w2(drift_w2_per_s: FloatArray, std_w: float, time_s: float, ahead_s: ArrayLike) -> FloatArray:
    """Variance [W²] that noise yet to come adds to the power at instants `ahead_s` [s], shape (n,).

    Drifts and disturbance as for `step_noise`.
    """
    ahead = np.asarray(ahead_s, dtype=float)
    # a harmonic's parts drift alike: (cos² + sin²) q t
    noise: FloatArray = drift_w2_per_s.sum() * ahead + std_w**2 * gammainc(3, 2 * rate_per_s(time_s) * ahead)
    return noise


def power_by_period(state: FloatArray, period_s: float, ahead_s: ArrayLike) -> FloatArray:
    """∂/∂T of the power at instants [W/s], shape (n,), of the harmonics α, β in a state of shape (2r + 3,)."""
    ahead = np.asarray(ahead_s, dtype=float)
    harmonic = np.arange(1, len(state) // 2)
    angle = 2 * math.pi / period_s * ahead[:, None] * harmonic
    # ∂/∂T (α cos(2πjt/T) + β sin(2πjt/T)) = (2πjt/T²) (α sin − β cos)
    turning = np.sin(angle) @ (harmonic * state[1:-2:2]) - np.cos(angle) @ (harmonic * state[2:-2:2])
    slope: FloatArray = 2 * math.pi / period_s**2 * ahead * turning
    return slope
