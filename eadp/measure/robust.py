"""Linear regression of a time series: weights that bound outliers, a covariance that holds under correlated noise.

Source: Huber 1964 for the weights; Newey and West 1987 for the covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from eadp.core.arrays import FloatArray

HUBER = 1.345
"""Residuals beyond this many standard deviations count less: 95 % efficient where the noise is normal."""

PASSES = 50


@dataclass(frozen=True)
class HuberFit:
    """Coefficients; root mean square and correlation time of the residuals [s].

    `covariance` makes no assumption on the noise's spectrum, and is too small in short logs; `first_order` is that of
    first-order noise and of regressors that change slowly.
    """

    values: FloatArray
    covariance: FloatArray
    first_order: FloatArray
    rms: float
    correlation_s: float

    def std(self, index: int) -> float:
        """Standard error of a coefficient."""
        return math.sqrt(max(0.0, float(self.covariance[index, index])))


def regressed(columns: FloatArray, target: FloatArray, times_s: FloatArray) -> HuberFit:
    """Least squares with Huber's weights and an autocorrelation-consistent covariance.

    Parameters
    ----------
    columns, target, times_s : array, shapes (n, m), (n,), (n,)
        Regressors, what they explain, and times [s].

    Source: Huber 1964; Newey and West 1987.
    """
    weights: FloatArray = np.ones(len(target))
    values: FloatArray = np.zeros(columns.shape[1])
    residual: FloatArray = target
    for _ in range(PASSES):
        root = np.sqrt(weights)
        new: FloatArray = np.asarray(
            np.linalg.lstsq(columns * root[:, None], target * root, rcond=None)[0], dtype=np.float64
        )
        residual = target - columns @ new
        scale = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
        done = bool(np.allclose(new, values, rtol=1e-10, atol=1e-12))
        values = new
        if done or scale == 0:
            break
        weights = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))
    lags = _correlation_lags(residual)
    inner = columns.T @ (columns * weights[:, None])
    scores = columns * (weights * residual)[:, None]
    middle = scores.T @ scores
    for lag in range(1, lags + 1):
        # Bartlett's weights keep the sum of autocovariances positive
        cross = scores[lag:].T @ scores[:-lag]
        middle += (1 - lag / (lags + 1)) * (cross + cross.T)
    inverse: FloatArray = np.asarray(np.linalg.pinv(inner), dtype=np.float64)
    covariance = inverse @ middle @ inverse * len(target) / max(1, len(target) - len(values))
    rms = math.sqrt(float(np.mean(residual**2)))
    # (1 + ρ)/(1 − ρ) times that of white noise; ρ of n residuals comes out (1 + 3ρ)/n too low
    rho = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300)
    rho = min(max(rho + (1 + 3 * rho) / len(target), 0.0), 0.99)
    first_order = inverse * rms**2 * (1 + rho) / (1 - rho)
    return HuberFit(values, covariance, first_order, rms, lags / 2 * float(np.median(np.diff(times_s))))


def _correlation_lags(residual: FloatArray) -> int:
    """Lags over which residuals correlate: twice those until their autocorrelation falls below a twentieth."""
    n = len(residual)
    centred = residual - residual.mean()
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    correlation = np.fft.irfft(spectrum, size)[: n // 4 + 1]
    if correlation[0] <= 0:
        return 0
    below = np.flatnonzero(correlation < 0.05 * correlation[0])
    return int(min(n // 4, 2 * (below[0] if len(below) else n // 4)))


WINDOW = 11
"""Length of the running median: five samples before and five after."""
SIGMAS = 8.0
"""Distance of a spike from the median in robust standard deviations, and"""
SHARE_OF_RANGE = 0.5
"""as a share of the range of the middle 90 % of all samples, so that crests of a clean signal are kept."""
MAX_RUN = 2
"""Longest run of samples that counts as a spike: a longer one is an event."""
MAX_SHARE = 0.1
"""Largest share of a log that may be spikes: more is heavy-tailed noise."""


def spikes(power_w: ArrayLike) -> NDArray[np.bool_]:
    """Mask of the samples that are spikes.

    Parameters
    ----------
    power_w : array, shape (n,)
        Power in the order of time [W].

    Returns
    -------
    array of bool, shape (n,)
        All false where there are fewer samples than the window, or more than `MAX_SHARE` of them would be.
    """
    power = np.asarray(power_w, dtype=float)
    if len(power) < WINDOW:
        return np.zeros(len(power), dtype=np.bool_)
    away = power - ndimage.median_filter(power, WINDOW, mode="mirror")
    scale = 1.4826 * float(np.median(np.abs(away - np.median(away))))
    low, high = np.quantile(power, (0.05, 0.95)).tolist()
    far: NDArray[np.bool_] = np.abs(away) > max(SIGMAS * scale, SHARE_OF_RANGE * (high - low), 1e-12 * abs(high))
    found = far & ~ndimage.binary_opening(far, np.ones(MAX_RUN + 1))  # which keeps longer runs
    return found if np.mean(found) <= MAX_SHARE else np.zeros_like(found)
