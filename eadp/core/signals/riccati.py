"""Kalman filter's covariance over many readings as one map, independent of the readings' values.

A prediction and a reading, and any sequence of them, take a covariance P to

    H + A P (I + G P)⁻¹ Aᵀ

and two such maps in a row are one more. So n equal steps take log₂ n compositions once, and one solve each time.

Source: Anderson and Moore 1979, Sec. 6.7 (doubling); Särkkä and García-Fernández 2021, Lemma 8 (composition).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.compiled import enabled, jitted


@dataclass(frozen=True, slots=True)
class CovarianceMap:
    """P → H + A P (I + G P)⁻¹ Aᵀ, each array of shape (m, m)."""

    transition: FloatArray
    information: FloatArray
    added: FloatArray

    def apply(self, covariance: FloatArray) -> FloatArray:
        """The covariance after the steps of the map, shape (m, m), symmetric to the last bit."""
        if enabled():
            return jitted(_apply)(self.transition, self.information, self.added, covariance)
        # P (I + G P)⁻¹ = (I + P G)⁻¹ P
        left = np.linalg.solve(np.eye(len(covariance)) + covariance @ self.information, covariance)
        result = self.transition @ left @ self.transition.T + self.added
        return 0.5 * (result + result.T)

    def then(self, other: CovarianceMap) -> CovarianceMap:
        """Composition: this map, then another."""
        identity = np.eye(len(self.added))
        # A₂ (I + H₁ G₂)⁻¹
        through = np.linalg.solve((identity + self.added @ other.information).T, other.transition.T).T
        transition = through @ self.transition
        added = other.added + through @ self.added @ other.transition.T
        # G = G₁ + A₁ᵀ (I + G₂ H₁)⁻¹ G₂ A₁
        seen = np.linalg.solve(identity + other.information @ self.added, other.information @ self.transition)
        information = self.information + self.transition.T @ seen
        return CovarianceMap(transition, 0.5 * (information + information.T), 0.5 * (added + added.T))


def _apply(transition: FloatArray, information: FloatArray, added: FloatArray, covariance: FloatArray) -> FloatArray:
    """H + A P (I + G P)⁻¹ Aᵀ in loops, for compiled code: numba takes ten seconds over `np.linalg.solve`."""
    n = len(covariance)
    matrix, left = np.eye(n), covariance.copy()
    for i in range(n):
        for k in range(n):
            for j in range(n):
                matrix[i, j] += covariance[i, k] * information[k, j]
    # (I + P G) L = P by elimination with row pivots
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        for j in range(n):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
            left[k, j], left[pivot, j] = left[pivot, j], left[k, j]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(n):
                matrix[i, j] -= factor * matrix[k, j]
                left[i, j] -= factor * left[k, j]
    for i in range(n - 1, -1, -1):
        for j in range(n):
            for k in range(i + 1, n):
                left[i, j] -= matrix[i, k] * left[k, j]
            left[i, j] /= matrix[i, i]
    half = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            for j in range(n):
                half[i, j] += transition[i, k] * left[k, j]
    result = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            total = added[i, j]
            for k in range(n):
                total += half[i, k] * transition[j, k]
            result[i, j] += 0.5 * total
            result[j, i] += 0.5 * total
    return result


def step_map(
    transition: FloatArray, process_noise: FloatArray, output: FloatArray, noise_variance: float
) -> CovarianceMap:
    """One step ahead, then one scalar reading: `eadp.core.signals.kalman.predict` and `update`.

    Parameters
    ----------
    transition, process_noise : array, shape (m, m)
        F and the Q of the step.
    output : array, shape (m,)
        C.
    noise_variance : float
        R of the reading, above 0.
    """
    nothing, identity = np.zeros_like(transition), np.eye(len(output))
    predicted = CovarianceMap(transition, nothing, process_noise)
    return predicted.then(CovarianceMap(identity, np.outer(output, output) / noise_variance, nothing))
