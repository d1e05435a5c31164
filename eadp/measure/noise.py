"""Correlated noise in a time series: regression that holds under it, and the likelihood of harmonics in it.

Regression has weights that bound outliers and a covariance for any spectrum of the noise. The likelihood is maximised
over an exponential or a Matérn-3/2 correlation of any length, up to five times the log, where it resembles a random
walk or a drift, plus white noise. Samples are averaged in bins of equal width first, so that the matrices stay small;
each correlation matrix is decomposed once for a set of times.

Source: Huber 1964 for the weights; Newey and West 1987 for the covariance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

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


_LENGTHS = 12
_COLOURED_PARTS = 1 - np.geomspace(1e-6, 1, 19)  # from all but a millionth of the variance down to none
_SCANNED_PARTS = (0.99999, 0.999, 0.99, 0.93, 0.75, 0.4)
_MAX_LENGTH_SHARE = 1 / 3  # of the time covered: longer correlation is not distinguishable from the mean
_MAX_STD_RATIO = 2.0
EULER_GAMMA = 0.5772156649015329


class _Eigenbasis(NamedTuple):
    """Eigenvalues and eigenvectors of a correlation matrix K: ρK + (1 − ρ)I has the same vectors."""

    eigenvalues: FloatArray
    vectors: FloatArray
    length_s: float


class NoiseModel(NamedTuple):
    """ρK + (1 − ρ)I with ρ the `part`, times a variance [W²], and its likelihood with some columns.

    The restricted likelihood accounts for the fitted coefficients: the full one underestimates the noise by the part
    that the columns have fitted.

    Source: Patterson and Thompson 1971.
    """

    log_likelihood: float
    restricted: float
    part: float
    variance: float
    eigenbasis: _Eigenbasis

    @property
    def correlation(self) -> FloatArray:
        """The covariance over the variance, shape (bins, bins)."""
        values, vectors, _ = self.eigenbasis
        return (vectors * (self.part * values + 1 - self.part)) @ vectors.T


class LikelihoodScan(NamedTuple):
    """Log-likelihoods over noise models and frequencies."""

    gain: FloatArray  # (orders, frequencies): maximum over noise models, less the maximum without harmonics
    posterior: FloatArray  # (orders, frequencies): the logarithm of the density at a flat prior


@dataclass(frozen=True, eq=False)
class TimeBins:
    """Mean times and powers of n bins of equal width; bins without a sample are left out.

    Attributes
    ----------
    times_s, power_w : array, shape (n,)
    width_s, span_s : float
        Width of a bin; duration of the whole log [s].
    samples_per_bin : float
        The mean number of samples in one.
    """

    times_s: FloatArray
    power_w: FloatArray
    width_s: float
    span_s: float
    samples_per_bin: float

    @property
    def covered_s(self) -> float:
        """Time from the first bin to the last [s]."""
        return float(self.times_s[-1] - self.times_s[0])

    @cached_property
    def _eigenbases(self) -> list[_Eigenbasis]:
        eigenbasis = ((np.linalg.eigh(correlation), length_s) for correlation, length_s in self._correlations())
        return [_Eigenbasis(np.maximum(w, 0.0), v, length_s) for (w, v), length_s in eigenbasis]

    def _correlations(self) -> Iterator[tuple[FloatArray, float]]:
        """Exponential and Matérn-3/2 correlations of the times, from a bin to five spans long."""
        apart = np.abs(self.times_s[:, np.newaxis] - self.times_s)
        for length_s in np.geomspace(self.width_s, 5 * self.span_s, _LENGTHS).tolist():
            yield np.exp(-apart / length_s), length_s
            scaled = math.sqrt(3) * apart / length_s
            yield (1 + scaled) * np.exp(-scaled), length_s

    def best_noise(self, columns: FloatArray) -> NoiseModel:
        """The maximum-likelihood noise model for columns, shape (n, m), their coefficients estimated too."""
        return max(self._models(columns), key=lambda model: model.log_likelihood)

    def white_noise(self) -> NoiseModel:
        """Noise of the variance of the powers, with no correlation and no columns."""
        return NoiseModel(0.0, 0.0, 0.0, float(np.var(self.power_w)), self._eigenbases[0])

    def coefficient_covariance(self, columns: FloatArray) -> FloatArray:
        """Covariance of least-squares coefficients, averaged over noise models.

        Models are weighted by their likelihood: few bins do not separate correlated from white noise. Correlation
        longer than a third of the time covered is not distinguishable from the mean and is left out; so is noise of
        more than twice the standard deviation of the residuals, which would be nearly a random walk.

        Parameters
        ----------
        columns : array, shape (n, m)
            m < n.

        Returns
        -------
        array, shape (m, m)
            [W²].
        """
        inverse = np.linalg.pinv(columns)
        max_length_s = max(self.width_s, _MAX_LENGTH_SHARE * self.covered_s)
        residual = self.power_w - columns @ (inverse @ self.power_w)
        max_variance = _MAX_STD_RATIO**2 * float(residual @ residual) / (len(residual) - columns.shape[1])
        identifiable = [model for model in self._models(columns) if model.eigenbasis.length_s <= max_length_s]
        models = [model for model in identifiable if model.variance <= max_variance] or identifiable
        likelihood = np.array([model.restricted for model in models])
        weight = np.exp(likelihood - likelihood.max())
        total = np.zeros((columns.shape[1], columns.shape[1]))
        for share, model in zip(weight / weight.sum(), models, strict=True):
            # (XᵀX)⁻¹ Xᵀ s²V X (XᵀX)⁻¹
            back = inverse @ model.eigenbasis.vectors
            total += (
                share * model.variance * (back * (model.part * model.eigenbasis.eigenvalues + 1 - model.part)) @ back.T
            )
        return total

    def _models(self, columns: FloatArray) -> Iterator[NoiseModel]:
        """Every noise model with its likelihood, the coefficients of columns estimated too."""
        n, m = columns.shape
        for eigenbasis in self._eigenbases:
            rotated_columns, rotated_power = eigenbasis.vectors.T @ columns, eigenbasis.vectors.T @ self.power_w
            # of all parts at once; the first axis is theirs
            variances = _COLOURED_PARTS[:, np.newaxis] * eigenbasis.eigenvalues + (1 - _COLOURED_PARTS[:, np.newaxis])
            root = 1 / np.sqrt(variances)
            basis, factor = np.linalg.qr(rotated_columns * root[:, :, np.newaxis])
            target = (rotated_power * root)[:, :, np.newaxis]
            residual = target - basis @ (basis.transpose(0, 2, 1) @ target)
            # rounding is no noise: a clean signal keeps a billionth of its variance
            least = max(1e-9 * float(self.power_w @ self.power_w), 1e-200)
            error = np.maximum(np.sum(residual**2, axis=(1, 2)), least)
            volume = 2 * np.log(np.maximum(np.abs(np.diagonal(factor, axis1=1, axis2=2)), 1e-150)).sum(axis=1)
            spread = np.log(variances).sum(axis=1)
            full = -0.5 * (n * np.log(error / n) + spread)
            # −½ ((n − m) ln s² + ln |V| + ln |XᵀV⁻¹X|)
            restricted = -0.5 * ((n - m) * np.log(error) + spread + volume)
            numbers = (full, restricted, _COLOURED_PARTS, error / max(1, n - m))
            for log_likelihood, of_differences, part, variance in np.transpose(numbers).tolist():
                yield NoiseModel(log_likelihood, of_differences, part, variance, eigenbasis)

    def scan(self, designs: FloatArray, power_w: FloatArray | None = None) -> list[LikelihoodScan]:
        """Likelihood of every order at every frequency, for each of several powers.

        Parameters
        ----------
        designs : array, shape (f, n, 2 order + 1)
            Columns 1, cos, sin, cos 2, … at f frequencies; lower orders lead.
        power_w : array, shape (n, s), optional
            Powers in the bins [W]. Default: the bins' own, s = 1.

        Returns
        -------
        list of s Scan
            Of orders 1 to `order`.
        """
        powers = self.power_w[:, np.newaxis] if power_w is None else power_w
        powers = powers / np.maximum(np.std(powers, axis=0), 1e-300)
        f, n, m = designs.shape
        gain = np.full((f, m // 2, powers.shape[1]), -np.inf)
        density = np.full_like(gain, -np.inf)
        alone = np.full(powers.shape[1], -np.inf)
        flat = designs.transpose(1, 0, 2).reshape(n, f * m)
        for number, eigenbasis in enumerate(self._eigenbases):
            columns, target = eigenbasis.vectors.T @ flat, eigenbasis.vectors.T @ powers
            for part in _SCANNED_PARTS if number else (0.0, *_SCANNED_PARTS):
                variances = part * eigenbasis.eigenvalues + (1 - part)
                root = 1 / np.sqrt(variances)[:, np.newaxis]
                error, volume = _errors((columns * root).reshape(n, f, m), target * root)
                penalty = 0.5 * float(np.log(variances).sum())
                alone = np.maximum(alone, -0.5 * n * np.log(error[0, 0]) - penalty)
                likelihood = -0.5 * n * np.log(error[:, 1:]) - penalty
                np.maximum(gain, likelihood, out=gain)
                degrees = n - np.arange(3, m + 1, 2)[:, np.newaxis]
                marginal = -0.5 * (degrees * np.log(error[:, 1:]) + volume[:, 1:, np.newaxis]) - penalty
                np.logaddexp(density, marginal, out=density)
        gain -= alone
        return [LikelihoodScan(gain[..., i].T, density[..., i].T) for i in range(powers.shape[1])]

    def surrogates(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draws [W] from the maximum-likelihood noise model without harmonics, shape (n, count)."""
        noise = self.best_noise(np.ones((len(self.times_s), 1)))
        w, v = np.linalg.eigh(noise.correlation)
        draws: FloatArray = v @ (np.sqrt(np.maximum(w, 0.0))[:, np.newaxis] * rng.normal(size=(len(w), count)))
        return draws


def binned(times_s: FloatArray, power_w: FloatArray, width_s: float, span_s: float) -> TimeBins:
    """Averages of samples in bins of a width.

    Parameters
    ----------
    times_s, power_w : array, shape (n,)
        Increasing times [s] and powers [W].
    width_s, span_s : float
        Width of a bin; duration of the log that the samples are part of [s].

    Returns
    -------
    TimeBins
    """
    bins = np.rint((times_s - times_s[0]) / width_s).astype(int)
    count = np.bincount(bins)
    full = count > 0
    times = np.bincount(bins, times_s)[full] / count[full]
    power = np.bincount(bins, power_w)[full] / count[full]
    return TimeBins(times, power, width_s, span_s, float(count[full].mean()))


def tail(statistic: float, drawn: FloatArray) -> float:
    """p-value of a maximum: Gumbel's law fitted by moments to maxima of noise.

    Parameters
    ----------
    statistic : float
    drawn : array, shape (n,)
        Maxima of noise.

    Returns
    -------
    float
        In [0, 1].
    """
    scale = max(math.sqrt(6) / math.pi * float(np.std(drawn, ddof=1)), 1e-12)
    mode = float(np.mean(drawn)) - EULER_GAMMA * scale
    return float(-np.expm1(-np.exp(-min(700.0, max(-700.0, (statistic - mode) / scale)))))


def _errors(white: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squared errors of orders 0, 1, …, shape (f, orders, s), and ln |XᵀX| of each, shape (f, orders).

    `white`, the columns, has the shape (n, f, 2 orders − 1): the products with all targets are one of matrices.

    The Cholesky factor of all columns has that of the first of them in its corner: one serves every order.
    """
    n, f, m = white.shape
    gram = white.transpose(1, 2, 0) @ white.transpose(1, 0, 2)
    moment = (white.reshape(n, -1).T @ target).reshape(f, m, -1)
    # a ridge of the size of rounding: bins may leave a column undetermined
    gram[:, np.arange(m), np.arange(m)] += 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, np.newaxis]
    factor = np.linalg.cholesky(gram)
    fitted = np.linalg.solve(factor, moment)
    total = np.sum(target**2, axis=0)
    explained = np.cumsum(fitted**2, axis=1)[:, 0::2]
    volume = 2 * np.cumsum(np.log(np.diagonal(factor, axis1=1, axis2=2)), axis=1)[:, 0::2]
    # rounding is no noise: a clean signal keeps a billionth of its variance
    return np.maximum(total - explained, 1e-9 * total), volume
