"""Forecast model of a periodic power with a correlated disturbance: transition, process noise and output rows.

The state is x = [α0, α1, β1, …, αr, βr, d, ḋ]: the Fourier state of `eadp.core.signals.harmonics`, and the Matérn-3/2
process of `eadp.core.signals.disturbance` beside it. The power is C x with C = [1, 1, 0, …, 1, 0, 1, 0], and
ẋ = A x + noise. The row of a forecast is C e^{At}.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray
from eadp.core.signals.disturbance import process_noise, rate_per_s, transition
from eadp.core.signals.harmonics import output_row, rotation_matrix


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
