"""Variances of the estimator's forecasts and the energy they add up to, in closed form.

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

_SHORT = 0.05
"""λ times a duration below which a difference of nearly equal numbers is replaced by its series."""


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


def energy_forecast(estimator: ExactEstimator, duration_s: float) -> tuple[float, float]:
    """Energy [J] of the motion from the last reading on, over a duration [s], and its variance [J²]."""
    known, model = estimator._filter, estimator._filter.dynamics
    row = energy_row(model.order, model.period_s, model.time_s, duration_s)
    variance = float(row @ known.covariance @ row) + energy_variance_j2(
        model.drift_w2_per_s, model.period_s, model.std_w, model.time_s, duration_s
    )
    if estimator.period_s is not None:
        slope = energy_by_period(known.state, estimator.period_s, duration_s)
        omega = 2 * math.pi / estimator.period_s * np.arange(1, model.order + 1)
        most = float((_squared_amplitudes(known.state) / omega**2).sum())
        variance += min((slope * estimator.period_std_s) ** 2, most)
    return float(row @ known.state), variance


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


def energy_row(order: int, period_s: float, time_s: float, duration_s: float) -> FloatArray:
    """∫ C e^{A t} dt from 0 to a duration: what a state is multiplied by for the energy [J].

    Parameters
    ----------
    order, period_s, time_s
        As for `power_rows`.
    duration_s : float
        [s], 0 or more.

    Returns
    -------
    array, shape (2r + 3,)
        [s], and [s²] for the disturbance's slope.
    """
    omega = 2 * math.pi / period_s * np.arange(1, order + 1)
    row = np.empty(2 * order + 3)
    row[0] = duration_s
    # ∫ cos ωt = sin ωD/ω,  ∫ sin ωt = (1 − cos ωD)/ω = 2 sin²(ωD/2)/ω
    row[1:-2:2], row[2:-2:2] = np.sin(omega * duration_s) / omega, 2 * np.sin(omega * duration_s / 2) ** 2 / omega
    rate = rate_per_s(time_s)
    turns = rate * duration_s
    fade = math.exp(-turns)
    # ∫ (1 + λt) e^{−λt} = (2 − (2 + λD) e^{−λD})/λ,  ∫ t e^{−λt} = (1 − (1 + λD) e^{−λD})/λ²
    row[-2] = (-2 * math.expm1(-turns) - turns * fade) / rate
    row[-1] = float(gammainc(2, turns)) / rate**2
    return row


def energy_variance_j2(
    drift_w2_per_s: FloatArray, period_s: float, std_w: float, time_s: float, duration_s: float
) -> float:
    """Variance [J²] that noise yet to come adds to the energy of a duration [s].

    What comes at s is felt from s to D: ∫ G(D − s) Q G(D − s)ᵀ ds, with G the row of `energy_row`, in closed form.
    Drifts and disturbance as for `step_noise`.
    """
    d = duration_s
    omega = 2 * math.pi / period_s * np.arange(1, len(drift_w2_per_s))
    # level: ∫ u² du;  harmonic: ∫ (sin² ωu + (1 − cos ωu)²)/ω² du = 2 (D − sin ωD/ω)/ω²
    drift = drift_w2_per_s[0] * d**3 / 3 + float(drift_w2_per_s[1:] @ (2 * (d - np.sin(omega * d) / omega) / omega**2))
    # disturbance: 4λ³σ² ∫ ((1 − (1 + λu) e^{−λu})/λ²)² du
    rate = rate_per_s(time_s)
    return float(drift + 4 * std_w**2 / rate**2 * _settled(rate * d))


def _settled(turns: float) -> float:
    """∫ (1 − (1 + v) e^{−v})² dv from 0 to b."""
    b = turns
    if b < _SHORT:
        return b**5 / 20 * (1 - 10 * b / 9 + 85 * b**2 / 126 - 7 * b**3 / 24)
    once = 2 * (2 - (2 + b) * math.exp(-b))
    twice = 5 / 4 - (5 / 4 + 3 * b / 2 + b**2 / 2) * math.exp(-2 * b)
    return b - once + twice


def power_by_period(state: FloatArray, period_s: float, ahead_s: ArrayLike) -> FloatArray:
    """∂/∂T of the power at instants [W/s], shape (n,), of the harmonics α, β in a state of shape (2r + 3,)."""
    ahead = np.asarray(ahead_s, dtype=float)
    harmonic = np.arange(1, len(state) // 2)
    angle = 2 * math.pi / period_s * ahead[:, None] * harmonic
    # ∂/∂T (α cos(2πjt/T) + β sin(2πjt/T)) = (2πjt/T²) (α sin − β cos)
    turning = np.sin(angle) @ (harmonic * state[1:-2:2]) - np.cos(angle) @ (harmonic * state[2:-2:2])
    slope: FloatArray = 2 * math.pi / period_s**2 * ahead * turning
    return slope


def energy_by_period(state: FloatArray, period_s: float, duration_s: float) -> float:
    """∂/∂T of the energy of a duration [J/s]: the integral of `power_by_period`."""
    harmonic = np.arange(1, len(state) // 2)
    omega = 2 * math.pi / period_s * harmonic
    alpha, beta = state[1:-2:2], state[2:-2:2]
    cosine, sine = np.cos(omega * duration_s), np.sin(omega * duration_s)
    # E = Σ (α sin ωD + β (1 − cos ωD))/ω and ∂ω/∂T = −ω/T: ∂E/∂T = (E − D h(D))/T
    energy = (alpha @ (sine / omega)) + (beta @ ((1 - cosine) / omega))
    return float((energy - duration_s * (alpha @ cosine + beta @ sine)) / period_s)
