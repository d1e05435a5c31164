"""Kalman filter, one step at a time, for a scalar measurement.

Source: letter, Alg. 2 l. 28-29; draft 002 l. 9-16, with the sign of its covariance update corrected.
"""

from __future__ import annotations

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.compiled import in_loops


def product(a: FloatArray, b: FloatArray, total: FloatArray) -> FloatArray:
    """A B in loops for compiled code, added to a matrix."""
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                total[i, j] += a[i, k] * b[k, j]
    return total


def _predicted(
    state: FloatArray, covariance: FloatArray, transition: FloatArray, process_noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    n = len(state)
    ahead = np.zeros(n)
    for i in range(n):
        for k in range(n):
            ahead[i] += transition[i, k] * state[k]
    moved = product(transition, covariance, np.zeros((n, n)))
    return ahead, product(moved, transition.T.copy(), process_noise.copy())


def _updated(
    state: FloatArray, covariance: FloatArray, output: FloatArray, measured: float, noise_variance: float
) -> tuple[FloatArray, FloatArray]:
    n = len(state)
    spread, error = noise_variance, measured
    gain, row, column, after = np.zeros(n), np.zeros(n), np.zeros(n), state.copy()
    for i in range(n):
        for k in range(n):
            gain[i] += covariance[i, k] * output[k]
            row[i] += output[k] * covariance[k, i]
    for i in range(n):
        spread += output[i] * gain[i]
        error -= output[i] * state[i]
    for i in range(n):
        gain[i] /= spread
        after[i] += gain[i] * error
    left = covariance.copy()  # (I − K C) P
    for i in range(n):
        for k in range(n):
            left[i, k] -= gain[i] * row[k]
            column[i] += left[i, k] * output[k]
    for i in range(n):
        for k in range(n):
            left[i, k] += (noise_variance * gain[i] - column[i]) * gain[k]
    return after, left


@in_loops(_predicted)
def predict(
    state: FloatArray, covariance: FloatArray, transition: FloatArray, process_noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """One step ahead without a measurement.

    Parameters
    ----------
    state : array, shape (m,)
    covariance, transition, process_noise : array, shape (m, m)
        P, F and the Q of this step.

    Returns
    -------
    state, covariance
        F q and F P Fᵀ + Q.
    """
    return transition @ state, transition @ covariance @ transition.T + process_noise


@in_loops(_updated)
def update(
    state: FloatArray, covariance: FloatArray, output: FloatArray, measured: float, noise_variance: float
) -> tuple[FloatArray, FloatArray]:
    """Correct with one scalar measurement.

    Parameters
    ----------
    state : array, shape (m,)
    covariance : array, shape (m, m)
    output : array, shape (m,)
        C, so that the measurement is C q + noise.
    measured, noise_variance : float
        y, and the variance R of its noise, above 0.

    Returns
    -------
    state, covariance
        The covariance in Joseph form, (I − K C) P (I − K C)ᵀ + K R Kᵀ: symmetric and positive but
        for the last bits, and never larger than before. The papers print (I + K C) P.
    """
    shared = covariance @ output
    gain = shared / (output @ shared + noise_variance)
    state = state + gain * (measured - output @ state)
    left = np.eye(len(state)) - np.outer(gain, output)
    covariance = left @ covariance @ left.T + noise_variance * np.outer(gain, gain)
    return state, covariance
