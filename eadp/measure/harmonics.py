"""Harmonic least squares of a sampled power: errors of blocks held out, over a grid of frequencies, and near one.

Every frequency is judged by cross-validation. The samples are cut into contiguous blocks, each is forecast by a fit
without it and its two neighbours, and the criterion is the squared forecast error. Correlated noise does not leak over
a whole block.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, optimize

from eadp.core.arrays import FloatArray, IntArray

ComplexArray = NDArray[np.complex128]

MAX_ORDER = 12
OVERSAMPLING = 64  # grid steps in 1/span: a step turns harmonic 12 by 0.19 of a cycle from end to end
_BLOCKS = 12
_APART = (np.abs(np.arange(_BLOCKS) - np.arange(_BLOCKS)[:, np.newaxis]) > 1).astype(float)  # not itself or a neighbour
_PATIENCE = 4
_STRETCHES = 1024  # of a log, for the search near a frequency
_TICKS_PER_PERIOD = 16  # of the shortest period: the scan rounds times to ticks, nothing later does


@dataclass(frozen=True)
class PowerSamples:
    """Times from the first sample, and power less its mean, in blocks of equal numbers of samples."""

    times_s: FloatArray
    power_w: FloatArray

    @property
    def span_s(self) -> float:
        return float(self.times_s[-1])

    def part(self, start: int, stop: int) -> PowerSamples:
        """The samples from one place to another, at their own times since the first of them."""
        if stop - start >= len(self.times_s):
            return self
        return PowerSamples(self.times_s[start:stop] - self.times_s[start], self.power_w[start:stop])

    @property
    def step_s(self) -> float:
        return self.span_s / (len(self.times_s) - 1)

    @cached_property
    def edges(self) -> list[int]:
        return [len(self.times_s) * b // _BLOCKS for b in range(_BLOCKS + 1)]

    @cached_property
    def block(self) -> IntArray:
        return np.repeat(np.arange(_BLOCKS), np.diff(self.edges))

    @cached_property
    def square(self) -> FloatArray:
        return np.add.reduceat(self.power_w**2, self.edges[:-1])


class BlockSums(NamedTuple):
    """Normal equations of each block: XᵀX, Xᵀy, yᵀy. Columns 1, cos, sin, cos 2, sin 2, …: lower orders lead."""

    gram: FloatArray  # (..., blocks, m, m)
    moment: FloatArray  # (..., blocks, m)
    square: FloatArray  # (blocks,)


def block_sums(samples: PowerSamples, frequency_hz: float, order: int) -> BlockSums:
    """Normal equations at one frequency, from the samples themselves."""
    columns = design_matrix(samples.times_s, frequency_hz, order)
    cuts = samples.edges[1:-1]
    parts = zip(np.split(columns, cuts), np.split(samples.power_w, cuts), strict=True)
    gram, moment = zip(*((x.T @ x, x.T @ y) for x, y in parts), strict=True)
    return BlockSums(np.array(gram), np.array(moment), samples.square)


def held_out(sums: BlockSums, order: int) -> FloatArray:
    """Squared error of each block, forecast without it and its neighbours: shape (..., blocks) [W²]."""
    m = 2 * order + 1
    gram, moment = sums.gram[..., :m, :m], sums.moment[..., :m]
    count = gram[..., 0, 0].sum(axis=-1)[..., np.newaxis, np.newaxis]
    seen_gram = (_APART @ gram.reshape(*gram.shape[:-2], m * m)).reshape(gram.shape)
    seen_moment = _APART @ moment
    # a ridge of a millionth bounds coefficients that the other blocks leave undetermined
    seen_gram[..., np.arange(m), np.arange(m)] += 1e-6 * count
    fitted = np.linalg.solve(seen_gram, seen_moment[..., np.newaxis])[..., 0]
    # ‖y − Xβ‖² = yᵀy − 2βᵀXᵀy + βᵀXᵀXβ
    quadratic = np.einsum("...i,...ij,...j->...", fitted, gram, fitted)
    error: FloatArray = sums.square - 2 * np.sum(fitted * moment, axis=-1) + quadratic
    return error


def held_out_by_order(sums: BlockSums, max_order: int) -> FloatArray:
    """Held-out errors of orders 1, 2, …, shape (orders, ..., blocks), until four in a row bring no improvement."""
    errors = [held_out(sums, 1)]
    min_error, at = float(errors[0].sum(axis=-1).min()), 1
    for order in range(2, max_order + 1):
        errors.append(held_out(sums, order))
        error = float(errors[-1].sum(axis=-1).min())
        if error < min_error:
            min_error, at = error, order
        if order >= at + _PATIENCE:
            break
    return np.array(errors)


def held_out_errors(samples: PowerSamples, frequency_hz: float, order: int) -> FloatArray:
    return held_out(block_sums(samples, frequency_hz, order), order)


def explained_r2(samples: PowerSamples, frequency_hz: float, order: int) -> float:
    sums = block_sums(samples, frequency_hz, order)
    return float(1 - held_out(sums, order).sum() / held_out(sums, 0).sum())


def no_worse(error: FloatArray, best: FloatArray, total: float) -> bool:
    """Whether a simpler model forecasts the blocks no worse than the best one.

    The excess is at most two standard errors of the difference over the blocks and a tenth of the best error; a
    millionth of the signal never counts.
    """
    excess = error - best
    standard_error = math.sqrt(len(excess)) * float(np.std(excess, ddof=1))
    worse = float(excess.sum())
    return worse <= min(2 * standard_error, 0.1 * float(best.sum())) or worse <= 1e-6 * total


def top_order(samples: PowerSamples, period_s: float, limit: int = MAX_ORDER) -> int:
    """Highest order that the sampling resolves at a period, and that leaves four samples to a coefficient."""
    resolved = math.ceil(period_s / (2 * samples.step_s)) - 1
    return max(1, min(limit, resolved, (len(samples.times_s) // 4 - 1) // 2))


class Grid:
    """Normal equations at every frequency k · `step_hz`, from one FFT of each block of the samples' times.

    Harmonic least squares needs nothing but sums of e^{2πi f t} and y e^{2πi f t} over the samples, at multiples of
    the frequency: the grid holds them all. Times are rounded to ticks, a 16th of the shortest period.
    """

    def __init__(self, samples: PowerSamples, shortest_s: float) -> None:
        tick_s = shortest_s / _TICKS_PER_PERIOD
        self._length = int(fft.next_fast_len(math.ceil(OVERSAMPLING * samples.span_s / tick_s) + 1, real=True))
        self.step_hz = 1 / (self._length * tick_s)
        tick = np.rint(samples.times_s / tick_s).astype(int)
        shape = (_BLOCKS, int(tick[-1]) + 1)
        place = samples.block * shape[1] + tick
        self._one = self._transform(np.bincount(place, minlength=shape[0] * shape[1]).reshape(shape))
        weighted = np.bincount(place, samples.power_w, minlength=shape[0] * shape[1])
        self._power = self._transform(weighted.reshape(shape))
        self._square = samples.square

    def _transform(self, blocks: FloatArray | IntArray) -> ComplexArray:
        transform: ComplexArray = np.conj(fft.rfft(blocks.astype(float), self._length, axis=1))
        return transform

    def _at(self, transform: ComplexArray, index: IntArray) -> ComplexArray:
        """Values at indices of shape (k, j), shape (k, blocks, j): the transform of reals is Hermitian."""
        index = index % self._length
        mirrored = index > self._length // 2
        values = transform[:, np.where(mirrored, self._length - index, index)]
        return np.moveaxis(np.where(mirrored, np.conj(values), values), 0, 1)

    def sums(self, index: IntArray, order: int) -> BlockSums:
        """Normal equations at frequencies `index` · step, shape (k,)."""
        multiples = np.arange(2 * order + 1)
        one = self._at(self._one, index[:, np.newaxis] * multiples)
        power = self._at(self._power, index[:, np.newaxis] * multiples[: order + 1])
        return BlockSums(*_normal(one, power), self._square)


def _normal(one: ComplexArray, power: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """XᵀX and Xᵀy, (..., m, m) and (..., m), from sums of e^{ikx}, k = 0 … 2r, and of y e^{ikx}, k = 0 … r."""
    multiples = np.arange(one.shape[-1])
    # column c is Re(w e^{ihx}): h = 0, 1, 1, 2, 2, …, w = 1 for a cosine and −i for a sine; and
    # Re(w e^{ihx}) Re(v e^{igx}) = ½ Re(w v e^{i(h+g)x} + w v̄ e^{i(h−g)x})
    harmonic = (multiples + 1) // 2
    weight = np.where((multiples % 2 == 0) & (multiples > 0), -1j, 1)
    both, apart = harmonic[:, np.newaxis] + harmonic, harmonic[:, np.newaxis] - harmonic
    difference = np.where(apart < 0, np.conj(one[..., np.abs(apart)]), one[..., np.abs(apart)])
    gram = np.outer(weight, weight) * one[..., both] + np.outer(weight, np.conj(weight)) * difference
    return gram.real / 2, (weight * power[..., harmonic]).real


def refined(samples: PowerSamples, frequency_hz: float) -> tuple[float, int]:
    """Frequency on all samples [Hz], and the order."""
    order = chosen_order(samples, frequency_hz)
    for _ in range(2):  # the order may change with the frequency, and the frequency with the order
        frequency_hz = nearest_minimum(samples, frequency_hz, order)
        order = chosen_order(samples, frequency_hz)
    return frequency_hz, order


def chosen_order(samples: PowerSamples, frequency_hz: float) -> int:
    """The smallest order that forecasts no worse than the best."""
    max_order = top_order(samples, 1 / frequency_hz)
    sums = block_sums(samples, frequency_hz, max_order)
    errors = held_out_by_order(sums, max_order)
    best = errors[np.argmin(errors.sum(axis=-1))]
    total = float(samples.square.sum())
    return 1 + next(i for i, error in enumerate(errors) if no_worse(error, best, total))


def nearest_minimum(samples: PowerSamples, frequency_hz: float, order: int) -> float:
    """Frequency of the least squared error of all samples near a start [Hz].

    Sums of e^{2πi k f t} are taken at the start, in stretches so short that a near frequency turns each as a whole.
    """
    step_hz = 1 / (OVERSAMPLING * samples.span_s)
    starts = np.arange(0, len(samples.times_s), math.ceil(len(samples.times_s) / _STRETCHES))
    turn = np.exp(2j * np.pi * frequency_hz * samples.times_s)
    one, power = np.empty((2, 2 * order + 1, len(starts)), dtype=complex)
    wave = np.ones_like(turn)
    for k in range(2 * order + 1):
        one[k], power[k] = np.add.reduceat(wave, starts), np.add.reduceat(wave * samples.power_w, starts)
        wave *= turn
    # 2πi k t, t the middle of a stretch
    middle_s = np.add.reduceat(samples.times_s, starts) / np.diff(starts, append=len(samples.times_s))
    turned = 2j * np.pi * np.arange(2 * order + 1)[:, np.newaxis] * middle_s

    def error(steps: float) -> float:
        """The squared error less that without a fit [W²]."""
        factors = np.exp(steps * step_hz * turned)
        gram, moment = _normal((factors * one).sum(axis=1), (factors * power).sum(axis=1))
        return -float(moment @ np.linalg.lstsq(gram, moment, rcond=None)[0])

    # the error has a side lobe at each turn of the top harmonic over the log: bracket its minimum first
    reach = OVERSAMPLING // 8
    coarse = min(range(-reach, reach + 1), key=error) if order > 1 else 0
    low, high = (coarse - 1.5, coarse + 1.5) if order > 1 else (-2.0 * reach, 2.0 * reach)
    found = optimize.minimize_scalar(error, bounds=(low, high), method="bounded", options={"xatol": 1e-7})
    return frequency_hz + float(found.x) * step_hz


def design_matrix(times_s: FloatArray, frequency_hz: float, order: int) -> FloatArray:
    """Columns of harmonic least squares: 1, cos, sin, cos 2, sin 2, …, so that lower orders lead.

    Parameters
    ----------
    times_s : array, shape (n,)
        Times [s].
    frequency_hz : float
        1/T [Hz].
    order : int
        Number of harmonics r, 0 or more.

    Returns
    -------
    array, shape (n, 2r + 1)
    """
    turn = np.exp(2j * np.pi * frequency_hz * times_s)
    columns = np.ones((2 * order + 1, len(times_s)))
    power = turn
    for harmonic in range(1, order + 1):
        columns[2 * harmonic - 1], columns[2 * harmonic] = power.real, power.imag
        power = power * turn
    return columns.T


def harmonic_fit(samples: PowerSamples, frequency_hz: float, order: int) -> tuple[FloatArray, float]:
    """Coefficients [W] and the squared error that remains [W²]."""
    columns = design_matrix(samples.times_s, frequency_hz, order)
    # least squares of the normal equations: samples in bursts may leave a harmonic undetermined
    solution, *_ = np.linalg.lstsq(columns.T @ columns, columns.T @ samples.power_w, rcond=None)
    fitted = np.asarray(solution, dtype=np.float64)
    residual = samples.power_w - columns @ fitted
    return fitted, float(residual @ residual)


def slope_by_period(times_s: FloatArray, frequency_hz: float, fitted: FloatArray) -> FloatArray:
    """Derivative of the fit by the period, orthogonal to the fit's columns [W/s]."""
    order = len(fitted) // 2
    columns = design_matrix(times_s, frequency_hz, order)
    harmonic = np.arange(1, order + 1)
    # ∂/∂T [α cos(2πjt/T) + β sin(2πjt/T)] = (2πjt/T²) (α sin − β cos)
    turning = columns[:, 2::2] @ (harmonic * fitted[1::2]) - columns[:, 1::2] @ (harmonic * fitted[2::2])
    slope = 2 * np.pi * frequency_hz**2 * times_s * turning
    followed, *_ = np.linalg.lstsq(columns, slope, rcond=None)
    return slope - columns @ followed
