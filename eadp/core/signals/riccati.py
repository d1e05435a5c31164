"""Kalman filter's covariance over many readings as one map, independent of the readings' values.

A prediction and a reading, and any sequence of them, take a covariance P to

    H + A P (I + G P)⁻¹ Aᵀ

and two such maps in a row are one more. So n equal steps take log₂ n compositions once, and one solve each time. A map
is an array of shape (3, m, m): A, G and H.

Source: Anderson and Moore 1979, Sec. 6.7 (doubling); Särkkä and García-Fernández 2021, Lemma 8 (composition).
"""

from __future__ import annotations

import numpy as np

from eadp.core.arrays import FloatArray


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
    """One step ahead, then one scalar reading: `eadp.core.signals.kalman.predict` and `update`.

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
