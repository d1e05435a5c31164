"""Spikes in a sampled power: isolated samples far from the running median, such as sensor glitches."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

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
