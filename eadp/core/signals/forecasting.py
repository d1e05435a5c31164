"""What a periodic power with a disturbance will be and what energy it takes: rows that multiply a state, and variances.

The state is x = [α0, α1, β1, …, αr, βr, d, ḋ]: the Fourier state of `eadp.core.signals.harmonics`, and the Matérn-3/2
process of `eadp.core.signals.disturbance` beside it. The power is C x with C = [1, 1, 0, …, 1, 0, 1, 0], and x moves by
ẋ = A x + noise. A forecast's row is C e^{At}, an energy's its integral. Noise that is yet to come adds a variance to
either; what it does at one instant it does to all that follow, which the integral's closed form takes into account.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammainc

from eadp.core.arrays import FloatArray
from eadp.core.signals.disturbance import process_noise, rate_per_s, transition
from eadp.core.signals.harmonics import output_row, rotation_matrix

_SHORT = 0.05
"""λ times a duration below which a difference of nearly equal numbers is replaced by its series."""


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
