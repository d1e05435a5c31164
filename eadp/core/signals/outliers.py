"""Spikes in a sampled power: single samples far from their neighbours, as a sensor's glitches are."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eadp.core.arrays import FloatArray

WINDOW = 11
"""Samples whose median one is compared with: five before it and five after it."""
SIGMAS = 8.0
"""A spike is this many robust standard deviations from that median, and"""
SHARE_OF_RANGE = 0.5
"""this part of the range of the middle 90 % of all samples, so that no crest of a clean signal is one."""
MAX_RUN = 2
"""More samples in a row are no spike: something happened."""
MAX_SHARE = 0.1
"""A larger part of a log is no spikes: its noise is so."""


def spikes(power_w: ArrayLike) -> NDArray[np.bool_]:
    """Which samples are spikes.

    Parameters
    ----------
    power_w : array, shape (n,)
        Power in the order of time [W].

    Returns
    -------
    array of bool, shape (n,)
        All false where the samples are fewer than the window, or the rule would take more than `MAX_SHARE` of them.
    """
    power = np.asarray(power_w, dtype=float)
    if len(power) < WINDOW:
        return np.zeros(len(power), dtype=np.bool_)
    away = power - _running_median(power)
    scale = 1.4826 * float(np.median(np.abs(away - np.median(away))))
    low, high = np.quantile(power, (0.05, 0.95)).tolist()
    far: NDArray[np.bool_] = np.abs(away) > max(SIGMAS * scale, SHARE_OF_RANGE * (high - low), 1e-12 * abs(high))
    found = far & ~_in_long_runs(far)
    return found if np.mean(found) <= MAX_SHARE else np.zeros_like(found)


def _running_median(power_w: FloatArray) -> FloatArray:
    """Median of the window round each sample; at the ends, of what there is of it, mirrored."""
    padded = np.pad(power_w, WINDOW // 2, mode="reflect")
    median: FloatArray = np.median(np.lib.stride_tricks.sliding_window_view(padded, WINDOW), axis=1)
    return median


def _in_long_runs(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    result = np.zeros_like(mask)
    for start, end in edges.reshape(-1, 2).tolist():
        result[start:end] = end - start > MAX_RUN
    return result
