"""Kalman filter, one step at a time, for a scalar measurement.

Source: letter, Alg. 2 l. 28-29; draft 002 l. 9-16, with the sign of its covariance update corrected.
"""

from __future__ import annotations

import numpy as np

from eadp.core.arrays import FloatArray


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
