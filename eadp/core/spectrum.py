"""Samples of a power → its period, order, Fourier coefficients and noise; or the finding that it has no period.

How a period is found:

1. Every frequency of a fine grid is scored by cross-validated harmonic least squares: the samples are cut into
   contiguous blocks, each is forecast by a fit that has seen neither it nor its two neighbours, and the score is
   the squared error that remains. Noise that is alike from one sample to the next cannot leak over a whole block.
2. The best peaks, their multiples and their parts are scored again at every order. Of those that forecast no worse
   than the best the shortest is the period: a signal of period T also repeats every 2T.
3. The period is refined on all samples, at their own times, by a bounded one-dimensional search, and the order is
   the smallest that forecasts no worse than the best.
4. Slow noise, a random walk or a drift can look periodic in a short log. The period counts only if harmonics
   explain the samples better than such noise can: see `analyse`.

Nothing is resampled: gaps, drop-outs and irregular steps are only fewer rows of the least squares.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, optimize, special

from eadp.core.harmonics import phases_of_state
from eadp.errors import Infeasible

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]

MIN_SAMPLES = 20
"""Fewer samples than this are not analysed."""
MIN_PERIODS = 1.9
"""A period must fit twice into the log, less a little: the last sample of two laps is one step short of them."""
MIN_SAMPLES_PER_PERIOD = 4
MAX_PERIODS = 400
"""The shortest period looked for is this part of the log, or 4 mean sampling steps if that is longer."""
MAX_ORDER = 12
MIN_CV_R2 = 0.05
"""A period must explain this part of the variance of what it has not seen."""
MAX_CHANCE = 1e-4
"""And noise without a period may look as periodic as this with at most this probability."""

_BLOCKS = 12
_SCAN_ORDER = 3
_SCAN_STRIDE = 3
_OVERSAMPLING = 64  # grid steps in 1/span: a step turns harmonic 12 by 0.19 of a cycle from end to end
_PEAKS = 6
_PATIENCE = 4
_NEAR = 4  # grid steps that the best order may move a peak of the scan
_TICKS_PER_PERIOD = 16  # of the shortest period: the scan rounds times to ticks, nothing later does
_RELATED = (1, 2, 3, 4, 5, 6, 1 / 2, 1 / 3, 1 / 4, 1 / 5, 1 / 6)
_TEST_BINS = 256
_TEST_BINS_PER_PERIOD = 12  # or 3 for each harmonic
_COLOURED_PARTS = 1 - np.geomspace(1e-6, 1, 19)  # from all but a millionth of the variance down to none


@dataclass(frozen=True)
class Spectrum:
    """What `analyse` found.

    Attributes
    ----------
    periodic : bool
    period_s, period_std_s : float
        The best period and its standard deviation [s], also where it does not count as one; NaN where
        there is not even a candidate (a constant signal).
    mean_w : float
        Mean power [W]: the constant of the fit, or the mean of the samples without a period.
    amplitude_w, phase_rad : array, shape (r,)
        Harmonics [W], [rad]: power = mean + Σ_j amplitude_j cos(2πjt/period + phase_j), t from the first
        sample. Empty without a period.
    noise_std_w : float
        Standard deviation of what the fit leaves [W].
    cv_r2 : float
        Part of the variance about the mean that the period explains of blocks it has not seen; 0 or less is nothing.
    chance : float
        Probability, at most 1, that noise without a period looks as periodic anywhere in the range searched; 1 where
        `cv_r2` rules the period out already.
    samples : int
    span_s : float
        Time from the first sample to the last [s].
    """

    periodic: bool
    period_s: float
    period_std_s: float
    mean_w: float
    amplitude_w: FloatArray
    phase_rad: FloatArray
    noise_std_w: float
    cv_r2: float
    chance: float
    samples: int
    span_s: float


def analyse(
    times_s: ArrayLike, power_w: ArrayLike, *, order: int | None = None, period_prior_s: float | None = None
) -> Spectrum:
    """Find the period of a sampled power and fit its Fourier series.

    Periods are searched from 4 mean sampling steps, or a 400th of the log, up to a half of the log. A signal counts
    as periodic if (a) its cross-validated R² against the mean is `MIN_CV_R2` or more, and (b) a likelihood-ratio test
    of harmonics in coloured noise against coloured noise alone gives a chance of `MAX_CHANCE` or less, counted over
    all the frequencies searched. The coloured noise of (b) is an exponential or a Matérn-3/2 correlation of any length,
    up to what cannot be told from a random walk or a drift, plus white noise: each at its best for the samples.

    The standard deviation of the period is that of least squares, from the curvature in the period, times the factor
    by which the noise fitted in (b) spreads that estimate more than white noise of the same variance would.

    Parameters
    ----------
    times_s : array, shape (n,)
        Strictly increasing [s]; n is `MIN_SAMPLES` or more.
    power_w : array, shape (n,)
        Power [W].
    order : int, optional
        Number of harmonics of the result. Default: the smallest that forecasts held-out blocks no worse than the best.
        The period is found at the best order, whatever is asked for here.
    period_prior_s : float, optional
        Look from 1/√2 to √2 times this period only [s].

    Returns
    -------
    Spectrum

    Raises
    ------
    Infeasible
        If there are too few samples, no period near the prior fits twice into the log, or the order asked for
        needs more samples.
    """
    times = np.asarray(times_s, dtype=float)
    power = np.asarray(power_w, dtype=float)
    if len(times) < MIN_SAMPLES:
        raise Infeasible(f"{len(times)} samples are too few to find a period in: {MIN_SAMPLES} are needed")
    samples = _Samples(times - times[0], power - power.mean())
    shortest_s, longest_s = _range_s(samples, period_prior_s)
    mean_w, spread_w = float(power.mean()), float(power.std(ddof=1))
    if spread_w <= 1e-9 * np.max(np.abs(power), initial=0.0):
        return _aperiodic(samples, mean_w, spread_w, cv_r2=0.0)
    frequency_hz = _search(samples, shortest_s, longest_s)
    frequency_hz, free_order = _refine(samples, frequency_hz)
    free_r2 = _cv_r2(samples, frequency_hz, free_order)
    if free_r2 < MIN_CV_R2:
        return _aperiodic(samples, mean_w, spread_w, cv_r2=free_r2, period_s=1 / frequency_hz)
    frequencies = max(1.0, samples.span_s * (1 / shortest_s - 1 / longest_s))
    evidence = _evidence(samples, 1 / frequency_hz, free_order)
    chance = min(1.0, evidence.chance * frequencies)
    if chance > MAX_CHANCE:
        return _aperiodic(samples, mean_w, spread_w, cv_r2=free_r2, period_s=1 / frequency_hz, chance=chance)
    if order is not None and order > (highest := _max_order(samples, 1 / frequency_hz, order)):
        least = f"{len(times)} samples every {samples.step_s:.3g} s tell a period of {1 / frequency_hz:.4g} s"
        raise Infeasible(f"order {order} is too high: {least} to order {highest} at most")
    return _periodic(samples, frequency_hz, order or free_order, mean_w, evidence, chance)


# ---- samples and least squares -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Samples:
    """Times from the first sample, and power less its mean, in blocks of equal numbers of samples."""

    times_s: FloatArray
    power_w: FloatArray

    @property
    def span_s(self) -> float:
        return float(self.times_s[-1])

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


class _Sums(NamedTuple):
    """Normal equations of each block: XᵀX, Xᵀy, yᵀy. Columns 1, cos, sin, cos 2, sin 2, …: lower orders lead."""

    gram: FloatArray  # (..., blocks, m, m)
    moment: FloatArray  # (..., blocks, m)
    square: FloatArray  # (blocks,)


def _columns(times_s: FloatArray, frequency_hz: float, order: int) -> FloatArray:
    """Least-squares matrix, shape (n, 2 order + 1)."""
    turn = np.exp(2j * np.pi * frequency_hz * times_s)
    columns = np.ones((2 * order + 1, len(times_s)))
    power = turn
    for harmonic in range(1, order + 1):
        columns[2 * harmonic - 1], columns[2 * harmonic] = power.real, power.imag
        power = power * turn
    return columns.T


def _sums(samples: _Samples, frequency_hz: float, order: int) -> _Sums:
    """Normal equations at one frequency, from the samples themselves."""
    columns = _columns(samples.times_s, frequency_hz, order)
    cuts = samples.edges[1:-1]
    parts = zip(np.split(columns, cuts), np.split(samples.power_w, cuts), strict=True)
    gram, moment = zip(*((x.T @ x, x.T @ y) for x, y in parts), strict=True)
    return _Sums(np.array(gram), np.array(moment), samples.square)


def _held_out(sums: _Sums, order: int) -> FloatArray:
    """Squared error of each block, forecast without it and its neighbours: shape (..., blocks) [W²]."""
    m = 2 * order + 1
    gram, moment = sums.gram[..., :m, :m], sums.moment[..., :m]
    count = gram[..., 0, 0].sum(axis=-1)[..., np.newaxis, np.newaxis]
    seen_gram = gram.sum(axis=-3, keepdims=True) - _with_neighbours(gram, -3)
    seen_moment = moment.sum(axis=-2, keepdims=True) - _with_neighbours(moment, -2)
    # a ridge of a millionth keeps a phase that no other lap has seen from being anything at all
    seen_gram[..., np.arange(m), np.arange(m)] += 1e-6 * count
    fitted = np.linalg.solve(seen_gram, seen_moment[..., np.newaxis])[..., 0]
    # ‖y − Xβ‖² = yᵀy − 2βᵀXᵀy + βᵀXᵀXβ
    quadratic = np.einsum("...i,...ij,...j->...", fitted, gram, fitted)
    error: FloatArray = sums.square - 2 * np.sum(fitted * moment, axis=-1) + quadratic
    return error


def _by_order(sums: _Sums, highest: int) -> FloatArray:
    """Held-out errors of orders 1, 2, …, shape (orders, ..., blocks), until four in a row have brought nothing."""
    errors = [_held_out(sums, 1)]
    least, at = float(errors[0].sum(axis=-1).min()), 1
    for order in range(2, highest + 1):
        errors.append(_held_out(sums, order))
        error = float(errors[-1].sum(axis=-1).min())
        if error < least:
            least, at = error, order
        if order >= at + _PATIENCE:
            break
    return np.array(errors)


def _with_neighbours(blocks: FloatArray, axis: int) -> FloatArray:
    """Each block plus the one before and the one after it."""
    moved = np.moveaxis(blocks, axis, 0)
    total = moved.copy()
    total[1:] += moved[:-1]
    total[:-1] += moved[1:]
    return np.moveaxis(total, 0, axis)


def _cv_r2(samples: _Samples, frequency_hz: float, order: int) -> float:
    sums = _sums(samples, frequency_hz, order)
    return float(1 - _held_out(sums, order).sum() / _held_out(sums, 0).sum())


def _no_worse(error: FloatArray, best: FloatArray, total: float) -> bool:
    """Whether a simpler model forecasts the blocks no worse than the best one.

    That is: by no more than two standard errors of the difference over the blocks and a tenth of what the best
    leaves; a millionth of the signal never counts.
    """
    excess = error - best
    standard_error = math.sqrt(len(excess)) * float(np.std(excess, ddof=1))
    worse = float(excess.sum())
    return worse <= min(2 * standard_error, 0.1 * float(best.sum())) or worse <= 1e-6 * total


def _max_order(samples: _Samples, period_s: float, limit: int = MAX_ORDER) -> int:
    """Highest order that the sampling resolves at a period, and that leaves four samples to a coefficient."""
    resolved = math.ceil(period_s / (2 * samples.step_s)) - 1
    return max(1, min(limit, resolved, (len(samples.times_s) // 4 - 1) // 2))


# ---- 1 and 2: the search -----------------------------------------------------------------------------------------


def _range_s(samples: _Samples, prior_s: float | None) -> tuple[float, float]:
    shortest = max(MIN_SAMPLES_PER_PERIOD * samples.step_s, samples.span_s / MAX_PERIODS)
    longest = samples.span_s / MIN_PERIODS
    if prior_s is None:
        return shortest, longest
    low, high = max(shortest, prior_s / math.sqrt(2)), min(longest, prior_s * math.sqrt(2))
    if low >= high:
        raise Infeasible(
            f"no period near {prior_s:g} s can be found in {len(samples.times_s)} samples over {samples.span_s:g} s:"
            f" {shortest:.4g} s to {longest:.4g} s can"
        )
    return low, high


class _Grid:
    """Normal equations at every frequency k · `step_hz`, from one FFT of each block of the samples' times.

    Harmonic least squares needs nothing but sums of e^{2πi f t} and y e^{2πi f t} over the samples, at multiples of
    the frequency: the grid holds them all. Times are rounded to ticks, a 16th of the shortest period.
    """

    def __init__(self, samples: _Samples, shortest_s: float) -> None:
        tick_s = shortest_s / _TICKS_PER_PERIOD
        self._length = int(fft.next_fast_len(math.ceil(_OVERSAMPLING * samples.span_s / tick_s) + 1, real=True))
        self.step_hz = 1 / (self._length * tick_s)
        tick = np.rint(samples.times_s / tick_s).astype(int)
        shape = (_BLOCKS, int(tick[-1]) + 1)
        place = samples.block * shape[1] + tick
        self._one = self._transform(np.bincount(place, minlength=shape[0] * shape[1]).reshape(shape))
        weighted = np.bincount(place, samples.power_w, minlength=shape[0] * shape[1])
        self._power = self._transform(weighted.reshape(shape))
        self._square = samples.square

    def _transform(self, blocks: NDArray[np.float64] | IntArray) -> ComplexArray:
        transform: ComplexArray = np.conj(fft.rfft(blocks.astype(float), self._length, axis=1))
        return transform

    def _at(self, transform: ComplexArray, index: IntArray) -> ComplexArray:
        """Values at indices of shape (k, j), shape (k, blocks, j): the transform of reals is Hermitian."""
        index = index % self._length
        mirrored = index > self._length // 2
        values = transform[:, np.where(mirrored, self._length - index, index)]
        return np.moveaxis(np.where(mirrored, np.conj(values), values), 0, 1)

    def sums(self, index: IntArray, order: int) -> _Sums:
        """Normal equations at frequencies `index` · step, shape (k,)."""
        multiples = np.arange(2 * order + 1)
        one = self._at(self._one, index[:, np.newaxis] * multiples)
        power = self._at(self._power, index[:, np.newaxis] * multiples[: order + 1])
        # column c is Re(w e^{ihx}): h = 0, 1, 1, 2, 2, …, w = 1 for a cosine and −i for a sine; and
        # Re(w e^{ihx}) Re(v e^{igx}) = ½ Re(w v e^{i(h+g)x} + w v̄ e^{i(h−g)x})
        harmonic = (multiples + 1) // 2
        weight = np.where((multiples % 2 == 0) & (multiples > 0), -1j, 1)
        both, apart = harmonic[:, np.newaxis] + harmonic, harmonic[:, np.newaxis] - harmonic
        difference = np.where(apart < 0, np.conj(one[..., np.abs(apart)]), one[..., np.abs(apart)])
        gram = np.outer(weight, weight) * one[..., both] + np.outer(weight, np.conj(weight)) * difference
        return _Sums(gram.real / 2, (weight * power[..., harmonic]).real, self._square)


class _Candidate(NamedTuple):
    place: int  # on the grid
    order: int
    error: FloatArray  # of each block at its best order

    @property
    def total(self) -> float:
        return float(self.error.sum())


def _search(samples: _Samples, shortest_s: float, longest_s: float) -> float:
    """Frequency of the true period, within a grid step [Hz]."""
    grid = _Grid(samples, shortest_s)
    first = math.ceil(1 / longest_s / grid.step_hz)
    last = max(first, math.floor(1 / shortest_s / grid.step_hz))
    peaks = _peaks(samples, grid, np.arange(first, last + 1, _SCAN_STRIDE))
    related = sorted({round(peak * factor) for peak in peaks for factor in _RELATED})
    near = [k for k in related if first - _NEAR <= k <= last + _NEAR]
    apart = [k for k, before in zip(near, [-_NEAR, *near], strict=False) if k - before > 1]
    windows = [np.unique(np.clip(np.arange(k - _NEAR, k + _NEAR + 1), first, last)) for k in apart]
    candidates = list({c.place: c for c in (_best_near(samples, grid, window) for window in windows)}.values())
    best = min(candidates, key=lambda candidate: candidate.total)
    by_length = sorted(candidates, key=lambda candidate: -candidate.place)
    shortest = next((c for c in by_length if _suffices(samples, c, best, grid.step_hz)), best)
    return shortest.place * grid.step_hz


def _suffices(samples: _Samples, part: _Candidate, best: _Candidate, step_hz: float) -> bool:
    """Whether a whole part of the best period is as good as the best.

    It forecasts no worse; or it explains half of what the best does and more, and the rest may well be noise: a long
    period at a high order follows slow noise a little way even over a held-out block. A rest that gains little must be
    surer by far: two laps that differ by chance are seen again in no third one.
    """
    if not _is_part(part.place, best.place):
        return False
    total = float(samples.square.sum())
    if _no_worse(part.error, best.error, total):
        return True
    if part.total > (total + best.total) / 2:
        return False
    evidence = _evidence(samples, 1 / (best.place * step_hz), best.order, part=round(part.place / best.place))
    gains_little = part.total < 1.5 * best.total
    return evidence.chance > (MAX_CHANCE**2 if gains_little else MAX_CHANCE)


def _is_part(index: int, of: int) -> bool:
    """Whether a frequency is a multiple of another, within what the grid can tell."""
    return round(index / of) >= 2 and abs(index - round(index / of) * of) <= _OVERSAMPLING // 4


def _peaks(samples: _Samples, grid: _Grid, index: IntArray) -> IntArray:
    """The best local minima of the held-out error over a scan of the whole range."""
    errors = []
    for chunk in np.array_split(index, 8 + len(index) // 300):  # a few MB, and one order, at a time
        order = _max_order(samples, 1 / (grid.step_hz * chunk[-1]), _SCAN_ORDER)
        errors.append(_held_out(grid.sums(chunk, order), order).sum(axis=-1))
    error = np.concatenate(errors)
    padded = np.pad(error, 1, constant_values=np.inf)
    lowest = np.flatnonzero((error <= padded[:-2]) & (error <= padded[2:]))
    return index[lowest[np.argsort(error[lowest], kind="stable")[:_PEAKS]]]


def _best_near(samples: _Samples, grid: _Grid, index: IntArray) -> _Candidate:
    """The best of some neighbouring frequencies and all orders."""
    highest = _max_order(samples, 1 / (grid.step_hz * index[0]))
    sums = grid.sums(index, highest)
    errors = _by_order(sums, highest)
    best, k = np.unravel_index(np.argmin(errors.sum(axis=-1)), errors.shape[:2])
    return _Candidate(int(index[k]), int(best) + 1, errors[best, k])


# ---- 3: the refinement -------------------------------------------------------------------------------------------


def _refine(samples: _Samples, frequency_hz: float) -> tuple[float, int]:
    """Frequency on all samples [Hz], and the order."""
    order = _choose_order(samples, frequency_hz)
    for _ in range(2):  # the order may change with the frequency, and the frequency with the order
        frequency_hz = _minimise(samples, frequency_hz, order)
        order = _choose_order(samples, frequency_hz)
    return frequency_hz, order


def _choose_order(samples: _Samples, frequency_hz: float) -> int:
    """The smallest order that forecasts no worse than the best."""
    highest = _max_order(samples, 1 / frequency_hz)
    sums = _sums(samples, frequency_hz, highest)
    errors = _by_order(sums, highest)
    best = errors[np.argmin(errors.sum(axis=-1))]
    total = float(samples.square.sum())
    return 1 + next(i for i, error in enumerate(errors) if _no_worse(error, best, total))


def _minimise(samples: _Samples, frequency_hz: float, order: int) -> float:
    """Frequency of the least squared error of all samples near a start [Hz]."""
    step_hz = 1 / (_OVERSAMPLING * samples.span_s)

    def error(steps: float) -> float:
        return _fit(samples, frequency_hz + steps * step_hz, order)[1]

    # the error has a side lobe at each turn of the highest harmonic over the log: bracket its lowest first
    reach = _OVERSAMPLING // 8
    coarse = min(range(-reach, reach + 1), key=error) if order > 1 else 0
    low, high = (coarse - 1.5, coarse + 1.5) if order > 1 else (-2.0 * reach, 2.0 * reach)
    found = optimize.minimize_scalar(error, bounds=(low, high), method="bounded", options={"xatol": 1e-7})
    return frequency_hz + float(found.x) * step_hz


def _fit(samples: _Samples, frequency_hz: float, order: int) -> tuple[FloatArray, float]:
    """Coefficients [W] and the squared error that remains [W²]."""
    columns = _columns(samples.times_s, frequency_hz, order)
    # least squares of the normal equations: samples in bursts may leave a harmonic undetermined
    solution, *_ = np.linalg.lstsq(columns.T @ columns, columns.T @ samples.power_w, rcond=None)
    fitted = np.asarray(solution, dtype=np.float64)
    residual = samples.power_w - columns @ fitted
    return fitted, float(residual @ residual)


# ---- 4: is it a period, and how well is it known? ----------------------------------------------------------------


class _Noise(NamedTuple):
    """A noise model at its best for some columns: its likelihood, and its covariance in units of `variance`."""

    log_likelihood: float
    correlation: FloatArray  # (bins, bins)
    variance: float


class _Evidence(NamedTuple):
    chance: float  # of this frequency alone
    times_s: FloatArray  # of the bins
    noise: _Noise  # with the period
    samples_per_bin: float


def _evidence(samples: _Samples, period_s: float, order: int, part: int = 0) -> _Evidence:
    """Likelihood ratio of harmonics in coloured noise against coloured noise alone.

    With `part`, against noise and the harmonics that are multiples of `part`: the period a `part`-th as long. On at
    most 256 bins, at least 12 to a period and 3 to a harmonic: the middle of a log that is longer than that.
    """
    per_period = max(_TEST_BINS_PER_PERIOD, 3 * order)
    width_s = max(samples.step_s, min(samples.span_s / _TEST_BINS, period_s / per_period))
    middle = np.abs(samples.times_s - np.median(samples.times_s)) <= width_s * _TEST_BINS / 2
    times, power, per_bin = _binned(samples.times_s[middle], samples.power_w[middle], width_s)
    columns = _columns(times, 1 / period_s, order)
    harmonic = (np.arange(2 * order + 1) + 1) // 2
    granted = harmonic % part == 0 if part else harmonic == 0
    if len(times) <= len(granted) + 1:
        return _Evidence(1.0, times, _Noise(0.0, np.eye(len(times)), float(np.var(power))), per_bin)
    alone, periodic = _best_noise(times, power, width_s, samples.span_s, (columns[:, granted], columns))
    # Wilks: 2 ln of the ratio is χ² with a degree of freedom for each coefficient added; and Bartlett: in a few
    # samples it is larger by about n/(n − m)
    few = max(0.0, 1 - len(granted) / len(times))
    half_ratio = few * max(0.0, periodic.log_likelihood - alone.log_likelihood)
    chance = float(special.gammaincc(int(np.count_nonzero(~granted)) / 2, float(half_ratio)))
    return _Evidence(chance, times, periodic, per_bin)


def _binned(times_s: FloatArray, power_w: FloatArray, width_s: float) -> tuple[FloatArray, FloatArray, float]:
    """Mean time and power of every bin that is not empty, and the mean number of samples in one."""
    bins = np.rint((times_s - times_s[0]) / width_s).astype(int)
    count = np.bincount(bins)
    full = count > 0
    times = np.bincount(bins, times_s)[full] / count[full]
    return times, np.bincount(bins, power_w)[full] / count[full], float(count[full].mean())


def _best_noise(
    times_s: FloatArray, power_w: FloatArray, width_s: float, span_s: float, designs: Sequence[FloatArray]
) -> list[_Noise]:
    """For each matrix of columns, the noise model under which the samples are likeliest, coefficients included."""
    best = [_Noise(-np.inf, np.empty((0, 0)), 0.0) for _ in designs]
    for correlation in _correlations(times_s, width_s, span_s):
        # one eigendecomposition serves every mixture with white noise: ρK + (1 − ρ)I has the same eigenvectors
        eigenvalues, vectors = np.linalg.eigh(correlation)
        turned = vectors.T @ power_w
        for number, columns in enumerate(vectors.T @ design for design in designs):
            for part in _COLOURED_PARTS:
                spread = part * np.maximum(eigenvalues, 0.0) + (1 - part)
                likelihood, variance = _profile(columns, turned, spread)
                if likelihood > best[number].log_likelihood:
                    mixed = part * correlation + (1 - part) * np.eye(len(times_s))
                    best[number] = _Noise(likelihood, mixed, variance)
    return best


def _correlations(times_s: FloatArray, width_s: float, span_s: float) -> Iterator[FloatArray]:
    """Exponential and Matérn-3/2 correlations of the times, from a bin to ten spans long."""
    apart = np.abs(times_s[:, np.newaxis] - times_s)
    for length_s in np.geomspace(width_s, 10 * span_s, 9):
        yield np.exp(-apart / length_s)
        scaled = math.sqrt(3) * apart / length_s
        yield (1 + scaled) * np.exp(-scaled)


def _profile(columns: FloatArray, power_w: FloatArray, spread: FloatArray) -> tuple[float, float]:
    """Log-likelihood at the best coefficients and variance, and that variance, unbiased [W²]."""
    n, m = columns.shape
    root = np.sqrt(spread)
    white, target = columns / root[:, np.newaxis], power_w / root
    fitted, *_ = np.linalg.lstsq(white, target, rcond=None)
    residual = target - white @ fitted
    # rounding is no noise: a clean signal keeps a billionth of its variance
    error = max(float(residual @ residual), 1e-9 * float(power_w @ power_w), 1e-200)
    return -0.5 * (n * math.log(error / n) + float(np.log(spread).sum())), error / max(1, n - m)


def _period_std_s(
    samples: _Samples, frequency_hz: float, fitted: FloatArray, noise: float, evidence: _Evidence
) -> float:
    """Standard deviation of the period [s]."""
    slope = _slope(samples.times_s, frequency_hz, fitted)
    # white noise: var T = σ² / Σ (∂y/∂T)², what the other coefficients could follow taken off the derivative
    white = noise**2 / float(slope @ slope)
    binned = _slope(evidence.times_s, frequency_hz, fitted)
    correlated = evidence.noise.variance * float(binned @ evidence.noise.correlation @ binned)
    # the same noise as the bins have it, if the samples in them were independent
    independent = noise**2 / evidence.samples_per_bin * float(binned @ binned)
    return math.sqrt(white * max(1.0, correlated / independent)) if independent > 0 else 0.0


def _slope(times_s: FloatArray, frequency_hz: float, fitted: FloatArray) -> FloatArray:
    """Derivative of the fit by the period, less what the fit's own columns can follow [W/s]."""
    order = len(fitted) // 2
    columns = _columns(times_s, frequency_hz, order)
    harmonic = np.arange(1, order + 1)
    # ∂/∂T [α cos(2πjt/T) + β sin(2πjt/T)] = (2πjt/T²) (α sin − β cos)
    turning = columns[:, 2::2] @ (harmonic * fitted[1::2]) - columns[:, 1::2] @ (harmonic * fitted[2::2])
    slope = 2 * np.pi * frequency_hz**2 * times_s * turning
    followed, *_ = np.linalg.lstsq(columns, slope, rcond=None)
    free: FloatArray = slope - columns @ followed
    return free


# ---- results -----------------------------------------------------------------------------------------------------


def _periodic(
    samples: _Samples, frequency_hz: float, order: int, mean_w: float, evidence: _Evidence, chance: float
) -> Spectrum:
    fitted, error = _fit(samples, frequency_hz, order)
    noise = math.sqrt(error / (len(samples.times_s) - 2 * order - 2))
    offset_w, amplitude, phase = phases_of_state(fitted)
    return Spectrum(
        periodic=True,
        period_s=1 / frequency_hz,
        period_std_s=_period_std_s(samples, frequency_hz, fitted, noise, evidence),
        mean_w=mean_w + offset_w,
        amplitude_w=amplitude,
        phase_rad=phase,
        noise_std_w=noise,
        cv_r2=_cv_r2(samples, frequency_hz, order),
        chance=chance,
        samples=len(samples.times_s),
        span_s=samples.span_s,
    )


def _aperiodic(
    samples: _Samples, mean_w: float, spread_w: float, *, cv_r2: float, period_s: float = math.nan, chance: float = 1.0
) -> Spectrum:
    return Spectrum(
        periodic=False,
        period_s=period_s,
        period_std_s=math.nan,
        mean_w=mean_w,
        amplitude_w=np.empty(0),
        phase_rad=np.empty(0),
        noise_std_w=spread_w,
        cv_r2=cv_r2,
        chance=chance,
        samples=len(samples.times_s),
        span_s=samples.span_s,
    )
