"""Forecast model of a periodic power with a correlated disturbance: transition, process noise and output rows.

The state is x = [α0, α1, β1, …, αr, βr, d, ḋ]: the Fourier state of `eadp.core.signals`, and the Matérn-3/2
process of `eadp.papers.forecasting` beside it. The power is C x with C = [1, 1, 0, …, 1, 0, 1, 0], and
ẋ = A x + noise. The row of a forecast is C e^{At}.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray
from eadp.core.signals import output_row


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
    at_s = np.array([step_s])
    return np.stack([rotated(unit, period_s, at_s)[0] for unit in np.eye(2 * order + 1)], axis=1)


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
        # e^{A_j t} of A_j = [[0, ωj], [−ωj, 0]]
        states[:, 1::2] = cosine * state[1::2] + sine * state[2::2]
        states[:, 2::2] = cosine * state[2::2] - sine * state[1::2]
    return states


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
        Q with units W², W²/s, W²/s²: P∞ − e^{FΔt} P∞ e^{FᵀΔt}.
    """
    rate = rate_per_s(time_s)
    turns = rate * step_s
    fade = math.exp(-2 * turns)
    # 1 − e^{−2a} (1 ± 2a + 2a²), a = λΔt
    place = -math.expm1(-2 * turns) - 2 * turns * (1 + turns) * fade
    slope = -math.expm1(-2 * turns) + 2 * turns * (1 - turns) * fade
    both = 2 * turns**2 * fade
    return std_w**2 * np.array([[place, rate * both], [rate * both, rate**2 * slope]])


def stationary_covariance(std_w: float, time_s: float) -> FloatArray:
    """Stationary covariance of the two states: P∞ = diag(σ², λ²σ²), shape (2, 2)."""
    return std_w**2 * np.diag([1.0, rate_per_s(time_s) ** 2])
