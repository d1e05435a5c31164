"""Lap time from the autocorrelation of the position, the drift from lap to lap removed."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from eadp.core.arrays import FloatArray
from eadp.core.signals.spectrum import MIN_PERIODS, vertex

MAX_POINTS = 2000
"""Most points of the even grid that positions are interpolated on."""
MIN_CORRELATION = 0.5
"""Smallest correlation of one lap with the next."""
PEAK_SHARE = 0.8
"""The first peak with this share of the largest correlation is the lap: two laps correlate too."""
MIN_POSITIONS = 20


def lap_time_s(times_s: ArrayLike, position_m: ArrayLike) -> float | None:
    """Time of a lap, from the autocorrelation of the position.

    Parameters
    ----------
    times_s : array, shape (n,)
        Strictly increasing [s].
    position_m : array, shape (n, 2)
        x and y [m]; NaN where it is not known.

    Returns
    -------
    float or None
        The lap [s]; None where no lag correlates, as on a flight that does not return, or fewer than `MIN_POSITIONS`
        positions are known.
    """
    times, position = np.asarray(times_s, dtype=float), np.asarray(position_m, dtype=float)
    known = np.isfinite(position).all(axis=1)
    if np.count_nonzero(known) < MIN_POSITIONS:
        return None
    times, position = times[known], position[known]
    grid = np.linspace(times[0], times[-1], min(MAX_POINTS, 4 * len(times)))
    even = np.stack([np.interp(grid, times, axis) for axis in position.T], axis=1)
    # laps drift in a straight line: the survey's shift
    drift = np.polynomial.polynomial.polyfit(grid - grid[0], even, 1)
    correlation = _correlation(even - np.polynomial.polynomial.polyval(grid - grid[0], drift).T)
    lag = _first_peak(correlation[: int(len(grid) / MIN_PERIODS) + 1])
    return None if lag is None else lag * float(grid[1] - grid[0])


def _correlation(position_m: FloatArray) -> FloatArray:
    """Normalised correlation of the overlap at each lag, both axes together."""
    n = len(position_m)
    size = fft.next_fast_len(2 * n, real=True)
    products = fft.irfft(np.abs(fft.rfft(position_m, size, axis=0)) ** 2, size, axis=0)[:n].sum(axis=1)
    square = np.concatenate([[0.0], np.cumsum(np.sum(position_m**2, axis=1))])
    lag = np.arange(n)
    power = np.sqrt(square[n - lag] * (square[n] - square[lag]))
    correlation: FloatArray = products / np.maximum(power, 1e-12 * square[n] + 1e-300)
    return correlation


def _first_peak(correlation: FloatArray) -> float | None:
    """The first lag [steps] beyond the first descent below 0 whose peak is within `PEAK_SHARE` of the largest."""
    below = np.flatnonzero(correlation < 0)
    if not len(below) or below[0] + 2 >= len(correlation):
        return None
    start = int(below[0])
    inner = correlation[start + 1 : -1]
    peaks = start + 1 + np.flatnonzero((inner >= correlation[start:-2]) & (inner >= correlation[start + 2 :]))
    if not len(peaks) or correlation[peaks].max() < MIN_CORRELATION:
        return None
    at = int(peaks[correlation[peaks] >= PEAK_SHARE * correlation[peaks].max()][0])
    return at + vertex(correlation, at)
