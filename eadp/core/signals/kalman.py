"""Kalman filter for a scalar measurement: one step at a time, and its covariance over many readings as one map.

A prediction and a reading, and any sequence of them, take a covariance P to

    H + A P (I + G P)⁻¹ Aᵀ

whatever the readings' values, and two such maps in a row are one more. So n equal steps take log₂ n compositions once,
and one solve each time. A map is an array of shape (3, m, m): A, G and H.

Source: letter, Alg. 2 l. 28-29; draft 002 l. 9-16, with the sign of its covariance update corrected. Of maps: Anderson
and Moore 1979, Sec. 6.7 (doubling); Särkkä and García-Fernández 2021, Lemma 8 (composition).
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


def applied(step: FloatArray, covariance: FloatArray) -> FloatArray:
    """The covariance after the steps of a map, shape (m, m), symmetric to the last bit."""
    transition, information, added = step
    # P (I + G P)⁻¹ = (I + P G)⁻¹ P
    left = np.linalg.solve(np.eye(len(covariance)) + covariance @ information, covariance)
    result: FloatArray = transition @ left @ transition.T + added
    return 0.5 * (result + result.T)


def composed(step: FloatArray, then: FloatArray) -> FloatArray:
    """One map, then another, as a map: shape (3, m, m)."""
    transition, information, added = step
    identity = np.eye(len(added))
    # A₂ (I + H₁ G₂)⁻¹
    through = np.linalg.solve((identity + added @ then[1]).T, then[0].T).T
    grown = then[2] + through @ added @ then[0].T
    # G = G₁ + A₁ᵀ (I + G₂ H₁)⁻¹ G₂ A₁
    seen = np.linalg.solve(identity + then[1] @ added, then[1] @ transition)
    known = information + transition.T @ seen
    return np.array([through @ transition, 0.5 * (known + known.T), 0.5 * (grown + grown.T)])


def step_map(
    transition: FloatArray, process_noise: FloatArray, output: FloatArray, noise_variance: float
) -> FloatArray:
    """One step ahead, then one scalar reading: `predict` and `update`.

    Parameters
    ----------
    transition, process_noise : array, shape (m, m)
        F and the Q of the step.
    output : array, shape (m,)
        C.
    noise_variance : float
        R of the reading, above 0.

    Returns
    -------
    array, shape (3, m, m)
    """
    nothing, identity = np.zeros_like(transition), np.eye(len(output))
    predicted = np.array([transition, nothing, process_noise])
    read = np.array([identity, np.outer(output, output) / noise_variance, nothing])
    return composed(predicted, read)
