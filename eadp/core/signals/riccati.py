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
from eadp.core.compiled import in_loops, jitted
from eadp.core.signals.kalman import product


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """The X of (I + M) X = R by elimination with row pivots; numba takes ten seconds over `np.linalg.solve`."""
    n, width = right.shape
    for i in range(n):
        matrix[i, i] += 1.0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        for j in range(n):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        for j in range(width):
            right[k, j], right[pivot, j] = right[pivot, j], right[k, j]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(n):
                matrix[i, j] -= factor * matrix[k, j]
            for j in range(width):
                right[i, j] -= factor * right[k, j]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            for j in range(width):
                right[i, j] -= matrix[i, k] * right[k, j]
        for j in range(width):
            right[i, j] /= matrix[i, i]
    return right


def _applied(step: FloatArray, covariance: FloatArray) -> FloatArray:
    n = len(covariance)
    left = _solve(product(covariance, step[1], np.zeros((n, n))), covariance.copy())
    half = product(step[0], left, np.zeros((n, n)))
    result = product(half, step[0].T.copy(), step[2].copy())
    for i in range(n):
        for j in range(i + 1):
            result[i, j] = result[j, i] = 0.5 * (result[i, j] + result[j, i])
    return result


def _composed(step: FloatArray, then: FloatArray) -> FloatArray:
    # A₂ (I + H₁ G₂)⁻¹ = Xᵀ and G₂ A₁ = M Y, with M X = A₂ᵀ and M = I + G₂ H₁
    n = len(step[0])
    matrix, turned = product(then[1], step[2], np.zeros((n, n))), then[0].T.copy()
    through = _solve(matrix.copy(), turned.copy()).T.copy()
    seen = _solve(matrix, product(then[1], step[0], np.zeros((n, n))))
    moved = product(through, step[0], np.zeros((n, n)))
    known = product(step[0].T.copy(), seen, step[1].copy())
    grown = product(product(through, step[2], np.zeros((n, n))), turned, then[2].copy())
    result = np.empty((3, n, n))
    for i in range(n):
        for j in range(n):
            result[0, i, j] = moved[i, j]
            result[1, i, j], result[2, i, j] = 0.5 * (known[i, j] + known[j, i]), 0.5 * (grown[i, j] + grown[j, i])
    return result


@in_loops(_applied)
def applied(step: FloatArray, covariance: FloatArray) -> FloatArray:
    """The covariance after the steps of a map, shape (m, m), symmetric to the last bit."""
    transition, information, added = step
    # P (I + G P)⁻¹ = (I + P G)⁻¹ P
    left = np.linalg.solve(np.eye(len(covariance)) + covariance @ information, covariance)
    result: FloatArray = transition @ left @ transition.T + added
    return 0.5 * (result + result.T)


@in_loops(_composed)
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
    return jitted(composed, *MAPPING)(predicted, read)


MAPPING = (product, _solve)
"""Functions that the compiled forms of the functions here call."""
