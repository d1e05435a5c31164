"""Period, order, Fourier coefficients and noise of a sampled power, or the finding that it has no period.

Method:

1. Periodogram: every frequency of a fine grid is evaluated by cross-validated harmonic least squares, see `harmonics`.
2. The best peaks, their multiples and submultiples are evaluated again at every order. The shortest period that
   forecasts no worse than the best is chosen: a signal of period T also repeats every 2T.
3. The period is refined on all samples, at their own times, by a bounded one-dimensional search; the order is the
   smallest that forecasts no worse than the best.
4. Where the residuals are not white, the range is searched again by likelihood, the noise fitted at every frequency:
   least squares is inefficient in coloured noise.
5. A signal whose period is below the range is found at a multiple, of which most harmonics are zero: the period is
   divided while those that a submultiple lacks are zero within their standard deviations.
   A period that fits more than 400 times into the log is searched in parts of it, and followed from each over the rest.
6. The period is fitted again in parts of the log: where they differ by more than their standard deviations, it drifts;
   so it does where parts at start, middle and end have a period, and the whole has none.
7. Coloured noise, a random walk or a drift can look periodic in a short log. The period counts only if harmonics
   explain the samples better than they explain such noise: see `analyse`.

Samples are not interpolated: gaps, drop-outs and irregular steps only mean fewer rows of the least squares.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from eadp.core.arrays import FloatArray, IntArray
from eadp.errors import Infeasible
from eadp.measure.harmonics import (
    OVERSAMPLING,
    Grid,
    PowerSamples,
    chosen_order,
    design_matrix,
    explained_r2,
    harmonic_fit,
    held_out,
    held_out_by_order,
    held_out_errors,
    nearest_minimum,
    no_worse,
    refined,
    slope_by_period,
    top_order,
)
from eadp.measure.noise import LikelihoodScan, NoiseModel, TimeBins, binned, tail

MIN_SAMPLES = 20
"""Fewer samples than this are not analysed."""
MIN_PERIODS = 1.9
"""A period must fit twice into the log, less a little: the last sample of two laps is one step short of them."""
MIN_SAMPLES_PER_PERIOD = 4
MAX_PERIODS = 400
"""The shortest period searched is the log divided by this, or 4 mean sampling steps if that is longer."""
MIN_CV_R2 = 0.05
"""Smallest cross-validated R² of a period."""
MAX_CHANCE = 0.03
"""Largest p-value of a period: probability that noise without one looks as periodic."""
MAX_STD_RATIO = 0.1
"""Largest relative standard deviation of a period: an event that occurs once fits any period."""
RANGE_MARGIN = 1.02
"""Factor by which a refined period may leave the range searched."""
PRIOR_RATIO = 1.3
"""A period is searched within this factor of a prior."""

_SCAN_ORDER = 3
_SCAN_STRIDE = 3
_PEAKS = 6
_NEAR = 4  # grid steps that the best order may move a peak of the scan
_PARTS_AT = (0.0, 0.5, 1.0)  # of a long log, as shares of what is beside them
_PART_RATIO = 10  # of the shortest periods of two searches in parts
_PART_SHARE = 1 / 6  # of a log that is searched whole: a part in which a drift is less than a turn
_RELATED = (1, 2, 3, 4, 5, 6, 1 / 2, 1 / 3, 1 / 4, 1 / 5, 1 / 6)
_TEST_BINS = 220
_TEST_BINS_PER_PERIOD = 20  # or 3 for each harmonic
_SURE = 1e-4  # p-value of one frequency below which a period is kept over its submultiple
_EVIDENT = 1e-9  # p-value below which no surrogates are drawn
_SURROGATES, _SEED = 48, 20260101
_COLOURED_OVERSAMPLING = 12
_COLOURED_BINS = 9  # to the shortest period
_MARGIN = 2.0  # of log-likelihood that another period must be better by
_HARMONIC_PENALTY = 2.5  # log-likelihood that a harmonic, of two coefficients, must add
_ZOOMS = 6
_WIDENED = 1.1  # the grid of noise models is coarse: without this intervals of 95 % hold for 88 to 96 %
_WHITE = 1.3  # an inflation up to which noise counts as white
_CLEAN = 0.01  # of the variance
_PICTURE_BINS = 2000
_MEAN_BINS = 120
_MAX_PARTS, _MIN_LAPS, _MAX_LAPS = 8, 4, 25  # parts of the log in which the period is fitted again, and their laps


@dataclass(frozen=True)
class Spectrum:
    """Result of `analyse`: period, harmonics and noise.

    Attributes
    ----------
    period_s, period_std_s : float
        The best period and its standard deviation [s], also where the signal does not count as periodic; NaN where
        there is no candidate (a constant signal). Of a period that drifts, the standard deviation is over the log.
    mean_w : float
        Mean power [W]: the constant of the fit, or the mean of the samples without a period.
    amplitude_w, phase_rad : array, shape (r,)
        Harmonics [W], [rad]: power = mean + Σ_j amplitude_j cos(2πjt/period + phase_j), t from the first
        sample. Empty without a period.
    mean_std_w : float
    amplitude_std_w : array, shape (r,)
        Standard deviations of the mean and the amplitudes under correlated noise [W].
    noise_std_w : float
        Standard deviation of the residuals [W].
    cv_r2 : float
        Cross-validated R²: share of the variance about the mean that is explained in held-out blocks.
    chance : float
        p-value: probability, at most 1, that noise without a period looks as periodic anywhere in the range searched;
        1 where `cv_r2` already rules the period out.
    samples : int
    span_s : float
        Time from the first sample to the last [s].
    range_s : pair of float
        Shortest and longest period searched [s].
    drift_s : pair of float or None
        Shortest and longest period of a part of the log, where they differ significantly [s].
    """

    period_s: float
    period_std_s: float
    mean_w: float
    mean_std_w: float
    amplitude_w: FloatArray
    amplitude_std_w: FloatArray
    phase_rad: FloatArray
    noise_std_w: float
    cv_r2: float
    chance: float
    samples: int
    span_s: float
    range_s: tuple[float, float]
    drift_s: tuple[float, float] | None = None

    @property
    def periodic(self) -> bool:
        """Whether the signal counts as periodic: it has harmonics."""
        return len(self.amplitude_w) > 0


def analyse(
    times_s: ArrayLike, power_w: ArrayLike, *, order: int | None = None, period_prior_s: float | None = None
) -> Spectrum:
    """Find the period of a sampled power and fit its Fourier series.

    Periods are searched from 4 mean sampling steps, or a 400th of the log, up to a half of the log; near a prior,
    from 4 mean sampling steps. A shorter period is found if one of its first multiples is in the range. A signal counts
    as periodic if (a) its cross-validated R² against the mean is `MIN_CV_R2` or more, (b) its standard deviation is at
    most `MAX_STD_RATIO` of it, (c) it lies in the range searched, and (d) noise looks as periodic with a chance of
    `MAX_CHANCE` or less: a likelihood ratio of harmonics in coloured noise against coloured noise alone, the best over
    frequencies and orders, is compared with that of surrogates drawn from the maximum-likelihood noise without
    harmonics, with a fixed seed. Where the ratio itself is decisive no surrogates are drawn. The coloured noise has an
    exponential or a Matérn-3/2 correlation of any length, up to five times the log, where it resembles a random walk or
    a drift, plus white noise: see `eadp.measure.noise`.

    In noise that is nearly white the period is that of least squares, and its standard deviation that from the
    curvature in the period, times the factor by which the fitted noise raises its variance over that of white noise of
    the same variance. In coloured noise the period is the likeliest, and its standard deviation the root mean
    square of the distance from it under the likelihood.

    Parameters
    ----------
    times_s : array, shape (n,)
        Strictly increasing [s]; n is `MIN_SAMPLES` or more.
    power_w : array, shape (n,)
        Power [W].
    order : int, optional
        Number of harmonics of the result. Default: the smallest that forecasts held-out blocks no worse than the best.
        The period is found at the best order in either case.
    period_prior_s : float, optional
        Search only within a factor of `PRIOR_RATIO` of this period [s].

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
    samples = PowerSamples(times - times[0], power - power.mean())
    searched_s = _range_s(samples, period_prior_s)
    mean_w, std_w = float(power.mean()), float(power.std(ddof=1))
    if std_w <= 1e-9 * np.max(np.abs(power), initial=0.0):
        return _aperiodic(samples, mean_w, std_w, searched_s, None)
    found = _anywhere(samples, searched_s) if period_prior_s is None else _near_prior(samples, searched_s)
    if not (found.periodic and found.inside):
        drifting = _drifting(samples, mean_w, searched_s) if period_prior_s is None else None
        return drifting or _aperiodic(samples, mean_w, std_w, searched_s, found)
    if order is not None and order > (max_order := top_order(samples, 1 / found.frequency_hz, order)):
        period = f"a period of {1 / found.frequency_hz:.4g} s"
        what = f"{len(times)} samples every {samples.step_s:.3g} s resolve {period} to order {max_order} at most"
        raise Infeasible(f"order {order} is too high: {what}")
    drift_s, local_std_s = _drift_s(samples, found)
    found = found._replace(std_s=max(found.std_s, local_std_s))
    spectrum = _periodic(samples, found, order or found.order, mean_w, searched_s)
    return replace(spectrum, drift_s=drift_s)


class _Found(NamedTuple):
    frequency_hz: float
    std_s: float  # of the period
    order: int
    cv_r2: float
    chance: float
    range_s: tuple[float, float]  # of the periods among which noise might look as periodic
    evidence: _Evidence | None  # none where `cv_r2` rules the period out already

    @property
    def inside(self) -> bool:
        """Whether the period lies in its range."""
        shortest_s, longest_s = self.range_s
        return shortest_s / RANGE_MARGIN <= 1 / self.frequency_hz <= longest_s * RANGE_MARGIN

    @property
    def periodic(self) -> bool:
        known = self.std_s * self.frequency_hz <= MAX_STD_RATIO
        return known and self.chance <= MAX_CHANCE and self.cv_r2 >= MIN_CV_R2


def _near_prior(samples: PowerSamples, range_s: tuple[float, float]) -> _Found:
    """The period in the range about a prior: the likelihood may find one where least squares sees little."""
    return _assess(samples, *_located(samples, *range_s), range_s)


def _anywhere(samples: PowerSamples, range_s: tuple[float, float]) -> _Found:
    """The period in a range, or a shorter one of which that in the range is a multiple."""
    shortest_s, longest_s = range_s
    frequency_hz, order = _short(samples, *_located(samples, *range_s), shortest_s)
    range_s = min(shortest_s, 1 / frequency_hz), longest_s
    cv_r2 = explained_r2(samples, frequency_hz, order)
    if cv_r2 < MIN_CV_R2:
        return _Found(frequency_hz, math.inf, order, cv_r2, 1.0, range_s, None)
    found = _assess(samples, frequency_hz, order, range_s)
    while found.periodic and (multiple := _multiple(samples, found)) > 1:
        frequency_hz, order = refined(samples, found.frequency_hz * multiple)
        shorter = _assess(samples, frequency_hz, order, (min(found.range_s[0], 1 / frequency_hz), longest_s))
        if shorter.frequency_hz < math.sqrt(multiple) * found.frequency_hz:  # nearer to the longer one: found again
            break
        found = shorter
    return found


def _assess(samples: PowerSamples, frequency_hz: float, order: int, range_s: tuple[float, float]) -> _Found:
    """The period in white or coloured noise, and the chance that noise alone looks as periodic in a range."""
    shortest_s, longest_s = range_s
    bins = _bins(samples, 1 / frequency_hz, order)
    evidence = _evidence(bins, 1 / frequency_hz, order)
    white = _white_fit(samples, frequency_hz, order, evidence)
    std_s = white.std_s * math.sqrt(white.inflation)
    chance = min(1.0, evidence.chance * max(1.0, samples.span_s * (1 / shortest_s - 1 / longest_s)))
    found = _Found(frequency_hz, std_s, order, explained_r2(samples, frequency_hz, order), chance, range_s, evidence)
    # the residuals of a clean signal come from binning, not from noise
    clean = white.error < _CLEAN * float(samples.square.sum())
    coloured = white.inflation > _WHITE and not clean and bins.covered_s > 0.9 * samples.span_s
    doubtful = chance > _EVIDENT
    if not (doubtful or coloured):
        return found
    peak = _coloured(bins, found, judge=doubtful)
    if peak.chance is not None:
        chance = peak.chance
    if not coloured:
        return found._replace(chance=chance)
    frequency_hz, std_s = peak.frequency_hz, _WIDENED * peak.std_hz / peak.frequency_hz**2
    order = chosen_order(samples, frequency_hz)
    evidence = _evidence(bins, 1 / frequency_hz, order)
    return _Found(frequency_hz, std_s, order, explained_r2(samples, frequency_hz, order), chance, range_s, evidence)


def _multiple(samples: PowerSamples, found: _Found) -> int:
    """The period over the shortest one of which it is a multiple: all harmonics that one lacks are zero.

    They are if their square is a millionth of the signal's, or compatible with noise, βᵀ (cov β)⁻¹ β being χ², and the
    others forecast no worse: in slow noise the first alone has little power.
    """
    fitted, _ = harmonic_fit(samples, found.frequency_hz, found.order)
    covariance = _covariance(samples, found, found.order)
    best, total = held_out_errors(samples, found.frequency_hz, found.order), float(samples.square.sum())
    harmonic = (np.arange(len(fitted)) + 1) // 2
    for part in range(found.order, 1, -1):
        lacking = harmonic % part != 0
        rest = fitted[lacking]
        if float(rest @ rest) <= 1e-6 * float(fitted[1:] @ fitted[1:]):
            return part
        half = 0.5 * float(rest @ np.linalg.lstsq(covariance[np.ix_(lacking, lacking)], rest, rcond=None)[0])
        zero = special.gammaincc(len(rest) / 2, half) > _SURE
        if zero and no_worse(held_out_errors(samples, found.frequency_hz * part, found.order // part), best, total):
            return part
    return 1


def _drift_s(samples: PowerSamples, found: _Found) -> tuple[tuple[float, float] | None, float]:
    """Shortest and longest period of the log's parts if they differ significantly, and their standard deviation [s].

    The correlation of the noise is that in the middle part.
    """
    fits = _part_fits(samples, found)
    if not fits:
        return None, 0.0
    part, frequency_hz, order = fits[len(fits) // 2]
    evidence = _evidence(_bins(part, 1 / frequency_hz, order), 1 / frequency_hz, order)
    whites = [_white_fit(*each, evidence) for each in fits]
    variances = [white.std_s**2 * white.inflation for white in whites]
    period = np.array([1 / each.frequency_hz for each in fits])
    weight = 1 / np.maximum(variances, (1e-6 * period[0]) ** 2)
    square = float(weight @ (period - weight @ period / weight.sum()) ** 2)
    if special.gammaincc((len(fits) - 1) / 2, square / 2) > _SURE:
        return None, 0.0
    return (float(period.min()), float(period.max())), float(period.std(ddof=1))


class _PartFit(NamedTuple):
    """The period fitted again in a part of the log."""

    samples: PowerSamples
    frequency_hz: float
    order: int


def _part_fits(samples: PowerSamples, found: _Found) -> list[_PartFit]:
    """The period fitted again in parts of the log, of some laps each; empty of a log of few laps."""
    laps = samples.span_s * found.frequency_hz
    parts = min(_MAX_PARTS, int(laps / _MIN_LAPS))
    if parts <= 1:
        return []
    share = min(1.0, _MAX_LAPS * parts / laps)
    fits = []
    for part in np.array_split(np.arange(len(samples.times_s)), parts):
        kept = part[: math.ceil(share * len(part))]
        times, power = samples.times_s[kept], samples.power_w[kept]
        fits.append(_part_fit(PowerSamples(times - times[0], power - power.mean()), found))
    return fits


def _part_fit(part: PowerSamples, found: _Found) -> _PartFit:
    """The period of a part, near that of the whole log: the best of a grid, refined."""
    order = min(max(found.order, _SCAN_ORDER), top_order(part, 1 / found.frequency_hz))
    # steps of an eighth of a turn of the top harmonic
    steps = math.ceil(8 * order * MAX_STD_RATIO * part.span_s * found.frequency_hz)
    grid = found.frequency_hz * (1 + MAX_STD_RATIO * np.arange(-steps, steps + 1) / steps)
    errors = [harmonic_fit(part, frequency_hz, order)[1] for frequency_hz in grid.tolist()]
    return _PartFit(part, nearest_minimum(part, float(grid[int(np.argmin(errors))]), order), order)


# ---- 1 and 2: the search -----------------------------------------------------------------------------------------


def _range_s(samples: PowerSamples, prior_s: float | None) -> tuple[float, float]:
    shortest, longest = MIN_SAMPLES_PER_PERIOD * samples.step_s, samples.span_s / MIN_PERIODS
    if prior_s is None:
        return max(shortest, samples.span_s / MAX_PERIODS), longest
    low, high = max(shortest, prior_s / PRIOR_RATIO), min(longest, prior_s * PRIOR_RATIO)
    if low >= high:
        raise Infeasible(
            f"no period near {prior_s:g} s can be found in {len(samples.times_s)} samples over {samples.span_s:g} s:"
            f" {shortest:.4g} s to {longest:.4g} s can"
        )
    return low, high


def _part(samples: PowerSamples, shortest_s: float, share: float, most: float = 1.0) -> tuple[int, int]:
    """A part of the log, at a share of what is beside it: `MAX_PERIODS` of the shortest long, at most `most` of it."""
    n = len(samples.times_s)
    count = min(n, math.ceil(n * min(most, MAX_PERIODS * shortest_s / samples.span_s)))
    start = round(share * (n - count))
    return start, start + count


def _searched(part: PowerSamples, shortest_s: float, longest_s: float) -> tuple[float, int]:
    """Frequency [Hz] and order in a part of the log."""
    return refined(part, _search(part, shortest_s, min(longest_s, part.span_s / MIN_PERIODS)))


def _located(samples: PowerSamples, shortest_s: float, longest_s: float, share: float = 0.0) -> tuple[float, int]:
    """Frequency [Hz] and order: searched in a part of the log, then followed over parts twice as long, to all of it.

    A part knows the period to a share of a turn over the next one: over a long log it is not mistaken by turns.
    """
    start, stop = _part(samples, shortest_s, share)
    frequency_hz, order = _searched(samples.part(start, stop), shortest_s, longest_s)
    n = len(samples.times_s)
    while stop - start < n:
        count = min(n, 2 * (stop - start))
        start = min(max(0, start - count // 4), n - count)
        stop = start + count
        frequency_hz, order = refined(samples.part(start, stop), frequency_hz)
    return frequency_hz, order


def _short(samples: PowerSamples, frequency_hz: float, order: int, shortest_s: float) -> tuple[float, int]:
    """A period too short for a search over the whole log, where it forecasts better than the one found there."""
    best = held_out_errors(samples, frequency_hz, order)
    for from_s in _short_from_s(samples, shortest_s):
        for share in _PARTS_AT:
            found = _located(samples, from_s, shortest_s, share)
            if not no_worse(best, held_out_errors(samples, *found), float(samples.square.sum())):
                return found
    return frequency_hz, order


def _short_from_s(samples: PowerSamples, shortest_s: float) -> list[float]:
    """The shortest periods of searches in parts of the log: each finds up to 200 times its own."""
    found = [MIN_SAMPLES_PER_PERIOD * samples.step_s]
    while found[-1] < shortest_s:
        found.append(_PART_RATIO * found[-1])
    return found[:-1]


def _drifting(samples: PowerSamples, mean_w: float, searched_s: tuple[float, float]) -> Spectrum | None:
    """The period that parts of the log have, and the whole has not, as it drifts: that of the middle; None without one.

    The first, the middle and the last part have it, for sure, and nearly the same.
    """
    shortest_s, longest_s = searched_s
    min_s = max(shortest_s, MIN_SAMPLES_PER_PERIOD * samples.step_s)
    for from_s, most in (*((each, 1.0) for each in _short_from_s(samples, shortest_s)), (min_s, _PART_SHARE)):
        bounds = [_part(samples, from_s, share, most) for share in _PARTS_AT]
        parts = list(_sure_in_parts(samples, from_s, longest_s, bounds))
        hz = [found.frequency_hz for _, found in parts]
        if len(parts) < len(bounds) or max(hz) > (1 + 2 * MAX_STD_RATIO) * min(hz):
            continue
        part, found = parts[1]
        drift_s, std_s = _drift_s(samples, found)
        if drift_s is not None:
            spectrum = _periodic(part, found._replace(std_s=max(found.std_s, std_s)), found.order, mean_w, searched_s)
            return replace(spectrum, drift_s=drift_s, samples=len(samples.times_s), span_s=samples.span_s)
    return None


def _sure_in_parts(
    samples: PowerSamples, shortest_s: float, longest_s: float, bounds: Sequence[tuple[int, int]]
) -> Iterator[tuple[PowerSamples, _Found]]:
    """Parts of the log with the period of each, up to the first part that has none for sure."""
    for start, stop in bounds:
        if np.ptp(samples.power_w[start:stop]) == 0:
            return
        part = samples.part(start, stop)
        frequency_hz, order = _searched(part, shortest_s, longest_s)
        part = replace(part, power_w=part.power_w - part.power_w.mean())
        found = _assess(part, frequency_hz, order, (shortest_s, part.span_s / MIN_PERIODS))
        if not (found.periodic and found.chance <= _SURE):
            return
        yield part, found


class _Candidate(NamedTuple):
    place: int  # on the grid
    order: int
    error: FloatArray  # of each block at its best order

    @property
    def total(self) -> float:
        return float(self.error.sum())


def _search(samples: PowerSamples, shortest_s: float, longest_s: float) -> float:
    """Frequency of the true period, within a grid step [Hz]."""
    grid = Grid(samples, shortest_s)
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


def _suffices(samples: PowerSamples, part: _Candidate, best: _Candidate, step_hz: float) -> bool:
    """Whether a submultiple of the best period is as good as the best.

    It forecasts no worse; or it explains at least half of what the best does, and the rest is compatible with noise: a
    long period at a high order follows coloured noise a little even over a held-out block. A rest that gains little
    needs stronger evidence.
    """
    if not _is_part(part.place, best.place):
        return False
    total = float(samples.square.sum())
    if no_worse(part.error, best.error, total):
        return True
    if part.total > (total + best.total) / 2:
        return False
    period_s = 1 / (best.place * step_hz)
    bins = _bins(samples, period_s, best.order)
    evidence = _evidence(bins, period_s, best.order, part=round(part.place / best.place))
    gains_little = part.total < 1.5 * best.total
    return evidence.chance > (_SURE**2 if gains_little else _SURE)


def _is_part(index: int, of: int) -> bool:
    """Whether a frequency is a multiple of another, within the resolution of the grid."""
    return round(index / of) >= 2 and abs(index - round(index / of) * of) <= OVERSAMPLING // 4


def _peaks(samples: PowerSamples, grid: Grid, index: IntArray) -> IntArray:
    """The best local minima of the held-out error over a scan of the whole range."""
    errors = []
    # a few MB, and one order, at a time; near a prior there may be few frequencies
    for chunk in np.array_split(index, min(len(index), 8 + len(index) // 300)):
        order = top_order(samples, 1 / (grid.step_hz * chunk[-1]), _SCAN_ORDER)
        errors.append(held_out(grid.sums(chunk, order), order).sum(axis=-1))
    error = np.concatenate(errors)
    padded = np.pad(error, 1, constant_values=np.inf)
    minima = np.flatnonzero((error <= padded[:-2]) & (error <= padded[2:]))
    return index[minima[np.argsort(error[minima], kind="stable")[:_PEAKS]]]


def _best_near(samples: PowerSamples, grid: Grid, index: IntArray) -> _Candidate:
    """The best of some neighbouring frequencies and all orders."""
    max_order = top_order(samples, 1 / (grid.step_hz * index[0]))
    sums = grid.sums(index, max_order)
    errors = held_out_by_order(sums, max_order)
    best, k = np.unravel_index(np.argmin(errors.sum(axis=-1)), errors.shape[:2])
    return _Candidate(int(index[k]), int(best) + 1, errors[best, k])


# ---- 4: significance and standard deviation of the period --------------------------------------------------------


class _Evidence(NamedTuple):
    chance: float  # of this frequency alone
    bins: TimeBins
    noise: NoiseModel  # with the period


def _bins(samples: PowerSamples, period_s: float, order: int) -> TimeBins:
    """At most 220 bins, 20 to a period and 3 to a harmonic: of a longer log, the middle."""
    per_period = max(_TEST_BINS_PER_PERIOD, 3 * order)
    width_s = max(samples.step_s, period_s / per_period)
    middle = np.abs(samples.times_s - np.median(samples.times_s)) <= width_s * _TEST_BINS / 2
    return binned(samples.times_s[middle], samples.power_w[middle], width_s, samples.span_s)


def _evidence(bins: TimeBins, period_s: float, order: int, part: int = 0) -> _Evidence:
    """Likelihood ratio of harmonics in coloured noise against coloured noise alone.

    With `part`, against noise and the harmonics that are multiples of `part`: the period a `part`-th as long.
    """
    columns = design_matrix(bins.times_s, 1 / period_s, order)
    n = len(bins.times_s)
    harmonic = (np.arange(2 * order + 1) + 1) // 2
    granted = harmonic % part == 0 if part else harmonic == 0
    if n <= len(granted) + 1:
        return _Evidence(1.0, bins, bins.white_noise())
    alone, periodic = bins.best_noise(columns[:, granted]), bins.best_noise(columns)
    # Wilks: 2 ln of the ratio is χ² with a degree of freedom for each coefficient added; and Bartlett: in a few
    # samples it is larger by about n/(n − m)
    few = max(0.0, 1 - len(granted) / n)
    half_ratio = few * max(0.0, periodic.log_likelihood - alone.log_likelihood)
    chance = float(special.gammaincc(int(np.count_nonzero(~granted)) / 2, float(half_ratio)))
    return _Evidence(chance, bins, periodic)


class _ColouredResult(NamedTuple):
    """Maximum-likelihood period in coloured noise, and its p-value if asked for."""

    frequency_hz: float
    std_hz: float
    chance: float | None


def _coloured(bins: TimeBins, found: _Found, *, judge: bool) -> _ColouredResult:
    """Maximum-likelihood frequency over the range of what least squares found, the noise fitted with it.

    Surrogates, drawn from the maximum-likelihood noise without a period, go through the same search. Bins limit it to
    longer periods than the range asked for, so the p-value is raised by the ratio of the ranges.
    """
    frequency_hz, (shortest_s, longest_s) = found.frequency_hz, found.range_s
    low_hz, high_hz = 1 / longest_s, 1 / shortest_s
    step_hz = 1 / (_COLOURED_OVERSAMPLING * bins.covered_s)
    low, high = max(low_hz, MIN_PERIODS / bins.covered_s), min(high_hz, 1 / (_COLOURED_BINS * bins.width_s))
    grid = np.append(np.arange(low, max(high, low + step_hz / 2), step_hz), frequency_hz)
    max_order = max(1, min(max(_SCAN_ORDER, found.order), (len(bins.times_s) - 3) // 4))
    designs = np.stack([design_matrix(bins.times_s, f, max_order) for f in grid])
    penalty = _HARMONIC_PENALTY * np.arange(1, max_order + 1)[:, np.newaxis]
    powers = bins.power_w[:, np.newaxis]
    if judge:
        powers = np.hstack([powers, bins.surrogates(_SURROGATES, np.random.default_rng(_SEED))])
    scans = bins.scan(designs, powers)
    penalised = scans[0].gain - penalty
    likeliest = float(grid[int(np.argmax(penalised.max(axis=0)))])
    if penalised[:, -1].max() >= penalised.max() - _MARGIN:
        likeliest = frequency_hz
    chance = None
    if judge:
        drawn = np.array([float((one.gain - penalty).max()) for one in scans[1:]])
        wider = max(1.0, (high_hz - low_hz) / max(high - low, step_hz))
        chance = min(1.0, tail(float(penalised.max()), drawn) * wider)
    return _ColouredResult(*_posterior(bins, likeliest, max_order, step_hz, low, high), chance)


def _posterior(
    bins: TimeBins, frequency_hz: float, order: int, step_hz: float, low_hz: float, high_hz: float
) -> tuple[float, float]:
    """Frequency of the greatest density near a start, and the root mean square of the distance from it [Hz]."""
    low, high = max(low_hz, 0.75 * frequency_hz), min(high_hz, 1.25 * frequency_hz)
    low, high = min(low, frequency_hz), max(high, frequency_hz)
    grid = np.linspace(low, high, max(9, 2 * math.ceil((high - low) / (2 * step_hz)) + 1))
    for _ in range(_ZOOMS):
        designs = np.stack([design_matrix(bins.times_s, f, order) for f in grid])
        density = _mixture(bins.scan(designs)[0])
        weight = np.exp(density - density.max())
        at, step = int(np.argmax(density)), float(grid[1] - grid[0])
        std = math.sqrt(float(weight @ (grid - grid[at]) ** 2 / weight.sum()))
        if std > 1.5 * step:
            break
        grid = np.linspace(grid[at] - 3 * step, grid[at] + 3 * step, 25)
    return float(grid[at]) + step * vertex(density, at), max(std, step / 4)


def _mixture(scan: LikelihoodScan) -> FloatArray:
    """Log-density of the frequency, averaged over orders by their penalised maximum likelihood."""
    orders = np.arange(1, len(scan.gain) + 1)
    weight = scan.gain.max(axis=1) - _HARMONIC_PENALTY * orders - scan.posterior.max(axis=1)
    density: FloatArray = np.logaddexp.reduce(scan.posterior + weight[:, np.newaxis], axis=0)
    return density


def vertex(density: FloatArray, at: int) -> float:
    """Vertex of the parabola through a maximum and its neighbours, in steps from it."""
    if not 0 < at < len(density) - 1:
        return 0.0
    before, here, after = density[at - 1 : at + 2].tolist()
    bend = before - 2 * here + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


class _WhiteFit(NamedTuple):
    """Least squares at a period: the squared error [W²], the period's standard deviation in white noise [s].

    `inflation` is the variance of the period in the fitted noise over that in white noise, 1 or more.
    """

    error: float
    std_s: float
    inflation: float


def _white_fit(samples: PowerSamples, frequency_hz: float, order: int, evidence: _Evidence) -> _WhiteFit:
    """Least squares at a period, beside the noise of the evidence."""
    fitted, error = harmonic_fit(samples, frequency_hz, order)
    noise = math.sqrt(error / max(1, len(samples.times_s) - 2 * order - 2))
    # var T = σ² / Σ (∂y/∂T)², the derivative projected off the other columns
    slope = slope_by_period(samples.times_s, frequency_hz, fitted)
    square = float(slope @ slope)
    std_s = noise / math.sqrt(square) if square > 0 else 0.0
    bins = evidence.bins
    slope = slope_by_period(bins.times_s, frequency_hz, fitted)
    correlated = evidence.noise.variance * float(slope @ evidence.noise.correlation @ slope)
    # the same noise as the bins have it, if the samples in them were independent
    independent = noise**2 / bins.samples_per_bin * float(slope @ slope)
    return _WhiteFit(error, std_s, max(1.0, correlated / independent) if independent > 0 else 1.0)


# ---- results -----------------------------------------------------------------------------------------------------


def _periodic(
    samples: PowerSamples, found: _Found, order: int, mean_w: float, range_s: tuple[float, float]
) -> Spectrum:
    fitted, error = harmonic_fit(samples, found.frequency_hz, order)
    cosine, sine = fitted[1::2], fitted[2::2]
    mean_std_w, amplitude_std_w = _coefficient_std_w(samples, found, fitted)
    return Spectrum(
        period_s=1 / found.frequency_hz,
        period_std_s=found.std_s,
        mean_w=mean_w + float(fitted[0]),
        mean_std_w=mean_std_w,
        amplitude_w=np.hypot(cosine, sine),
        amplitude_std_w=amplitude_std_w,
        phase_rad=np.arctan2(-sine, cosine),
        noise_std_w=math.sqrt(error / (len(samples.times_s) - 2 * order - 2)),
        cv_r2=explained_r2(samples, found.frequency_hz, order),
        chance=found.chance,
        samples=len(samples.times_s),
        span_s=samples.span_s,
        range_s=range_s,
    )


def _coefficient_std_w(samples: PowerSamples, found: _Found, fitted: FloatArray) -> tuple[float, FloatArray]:
    """Standard deviations of the mean and of the amplitudes in the fitted noise [W]."""
    covariance = _covariance(samples, found, len(fitted) // 2)
    amplitude = np.maximum(np.hypot(fitted[1::2], fitted[2::2]), 1e-300)
    along = np.zeros((len(amplitude), len(fitted)))
    rows = np.arange(len(amplitude))
    along[rows, 2 * rows + 1], along[rows, 2 * rows + 2] = fitted[1::2] / amplitude, fitted[2::2] / amplitude
    variance = np.einsum("ij,jk,ik->i", along, covariance, along)
    return math.sqrt(max(0.0, float(covariance[0, 0]))), np.sqrt(np.maximum(variance, 0.0))


def _covariance(samples: PowerSamples, found: _Found, order: int) -> FloatArray:
    """Covariance of the coefficients in the fitted noise [W²]."""
    assert found.evidence is not None
    bins = found.evidence.bins
    covariance = bins.coefficient_covariance(design_matrix(bins.times_s, found.frequency_hz, order))
    # the bins may be the middle of the log alone
    scaled: FloatArray = covariance * min(1.0, bins.covered_s / samples.span_s)
    return scaled


def _aperiodic(
    samples: PowerSamples, mean_w: float, std_w: float, range_s: tuple[float, float], found: _Found | None
) -> Spectrum:
    """The result without a period; `found` is the best candidate, None of a constant power."""
    return Spectrum(
        period_s=math.nan if found is None else 1 / found.frequency_hz,
        period_std_s=math.nan,
        mean_w=mean_w,
        mean_std_w=0.0 if found is None else _mean_std_w(samples),
        amplitude_w=np.empty(0),
        amplitude_std_w=np.empty(0),
        phase_rad=np.empty(0),
        noise_std_w=std_w,
        cv_r2=0.0 if found is None else found.cv_r2,
        chance=1.0 if found is None else found.chance,
        samples=len(samples.times_s),
        span_s=samples.span_s,
        range_s=range_s,
    )


def _mean_std_w(samples: PowerSamples) -> float:
    """Standard deviation of the mean of the samples, in noise of any colour [W]."""
    bins = binned(samples.times_s, samples.power_w, samples.span_s / _MEAN_BINS, samples.span_s)
    return math.sqrt(float(bins.coefficient_covariance(np.ones((len(bins.times_s), 1)))[0, 0]))


# ---- periodogram -------------------------------------------------------------------------------------------------


def periodogram(times_s: ArrayLike, power_w: ArrayLike, order: int, points: int = 500) -> tuple[FloatArray, FloatArray]:
    """Periodogram: cross-validated R² over the range of periods.

    Parameters
    ----------
    times_s, power_w : array, shape (n,)
        As `analyse`; more than 2000 samples are averaged in as many bins, and periods below 8 bins are left out.
    order : int
        Number of harmonics, 1 or more; fewer where a period is sampled too coarsely for them.
    points : int
        Number of periods, evenly spaced in their logarithm.

    Returns
    -------
    period_s, cv_r2 : array, shape (points,)
        Increasing periods [s], and the share of the variance explained in held-out blocks.
    """
    times, power = np.asarray(times_s, dtype=float), np.asarray(power_w, dtype=float)
    width_s = max((times[-1] - times[0]) / _PICTURE_BINS, 1e-12)
    if len(times) > _PICTURE_BINS:
        bins = binned(times, power, width_s, times[-1] - times[0])
        times, power = bins.times_s, bins.power_w
    samples = PowerSamples(times - times[0], power - power.mean())
    shortest_s, longest_s = _range_s(samples, None)
    if np.ptp(power) <= 1e-9 * np.max(np.abs(power)):
        return np.geomspace(shortest_s, longest_s, points), np.zeros(points)
    period = np.geomspace(max(shortest_s, 8 * samples.step_s), longest_s, points)
    orders = [top_order(samples, one, order) for one in period.tolist()]
    return period, np.array([explained_r2(samples, 1 / t, r) for t, r in zip(period.tolist(), orders, strict=True)])
