"""A level and two slopes from means over windows, where the level may change for good.

    y = a + b x + c z

The noise is estimated from the residuals, and from the posterior's own variance, without which the first windows would
be believed more than they scatter. Gusts last: what one window is off, the next one is off in part, so that windows
count as fewer. Information fades, so that slow changes are followed. A lasting step of a is recognised by the
innovations: a CUSUM of the likelihood ratio of a step up and of one down, whose mean time between false alarms is
`FALSE_ALARM_H` at least where windows are independent and scatter as assumed; where they scatter more, alarms are more
frequent until the noise is learned. The windows before the step are dropped then, and a is wide: it is learned again
from those since.

Source: Bayesian linear regression; Page 1954; Lorden 1971 for the bound; Lorden and Pollak 2005 for the step's size.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray

WINDOW_S, FADE_S = 5.0, 900.0
PRIOR_WINDOWS, PASSES = 2, 6
"""Weight of the prior noise in windows; and how often the fit and the noise are computed in turns."""

INDEPENDENT_WINDOWS = 4
"""Weight of the prior that successive windows are independent, in windows."""

FALSE_ALARM_H = 100.0
"""Mean time between false alarms [h]: some hundred flights."""

ALARM = math.log(2 * FALSE_ALARM_H * 3600 / WINDOW_S)
"""Logarithm of the likelihood ratio of a step, up or down, from which on it is one."""

STANDS_OUT = 3.0
"""Standard deviations of a window by which a least step stands out of the noise, at least."""

INDEPENDENT = 0.25
"""Degrees of freedom of a window, chosen by trial: with 1, noise of twice the prior's gave several times the alarms in
the first minutes of flights; steps were found as soon."""

DOUBT = math.log(20.0)
"""From which on it may be one: less than one in 20 windows without a step is there."""

NEW_LEVEL = 10.0
"""Prior standard deviation of the level after a step, in the least steps: it may be anywhere."""


class Prior(NamedTuple):
    """Means and inverse variances of (a, b, c), shape (3,); and the noise of windows, a variance times their length."""

    mean: FloatArray
    information: FloatArray
    noise: float


class Sums(NamedTuple):
    """Sums over windows of the products of (1, x, z, y), shape (4, 4), weighted by times and faded; their number, too.

    A window is a `row` (1, x, z, y) of means.
    """

    products: FloatArray = np.zeros((4, 4))
    windows: float = 0.0

    def added(self, seconds: float, row: FloatArray) -> Sums:
        """The sums with one more window."""
        kept = math.exp(-seconds / FADE_S)
        return Sums(kept * self.products + seconds * np.outer(row, row), kept * self.windows + 1)


class Fit(NamedTuple):
    """Posterior of (a, b, c): means, shape (3,), and covariance, shape (3, 3); the noise of windows, see `Prior`."""

    mean: FloatArray
    covariance: FloatArray
    noise: float

    @property
    def residual(self) -> FloatArray:
        """(−a, −b, −c, 1), shape (4,): times a row it is by how much that is above the fit."""
        return np.array([*-self.mean, 1.0])


class Cusum(NamedTuple):
    """CUSUM of the log-likelihood ratio of a step up, or down, and sums over the windows since it last was 0."""

    ratio: float = 0.0
    since: Sums = Sums()


class Evidence(NamedTuple):
    """Of a step up and of one down; `before` is the fit without these windows, with which they are compared."""

    before: Fit
    up: Cusum = Cusum()
    down: Cusum = Cusum()

    @property
    def ratio(self) -> float:
        """The greater one."""
        return max(self.up.ratio, self.down.ratio)


class Scatter(NamedTuple):
    """How long errors last: the last window's error times the root of its time, and faded sums of the products of two
    successive ones, and of their squares."""

    last: float = 0.0
    products: float = 0.0
    squares: float = 0.0

    def lasting(self, noise: float) -> float:
        """Variance of the mean over a long time to that of independent windows: 1 + 2 ρ, with ρ of successive ones."""
        return 1.0 + 2.0 * max(self.products / (self.squares + INDEPENDENT_WINDOWS * noise), 0.0)


class Regression(NamedTuple):
    """State of the regression; so many `steps` of the level were recognised, the last of a size `step`."""

    prior: Prior
    sums: Sums
    fit: Fit
    evidence: Evidence
    steps: int = 0
    step: float = 0.0
    scatter: Scatter = Scatter()

    @classmethod
    def started(cls, prior: Prior) -> Regression:
        """The state before the first window."""
        fit = Fit(prior.mean, np.diag(1 / prior.information), prior.noise)
        return cls(prior, Sums(), fit, Evidence(fit))

    @property
    def lasting_noise(self) -> float:
        """Variance of the mean over a long time, times that time."""
        return self.fit.noise * self.scatter.lasting(self.prior.noise)

    @property
    def in_doubt(self) -> bool:
        """Whether the level may have changed: the next windows decide."""
        return self.evidence.ratio > DOUBT

    def with_window(self, seconds: float, mean: float, x: float, z: float, min_step: float) -> Regression:
        """The state after a window: its fit, or where a lasting step of the level is found, a new one since the step.

        Parameters
        ----------
        seconds : float
            The window's length [s].
        mean, x, z : float
            Means of y, x and z over it.
        min_step : float
            The least step of the level that is to be recognised.
        """
        row = np.array([1.0, x, z, mean])
        evidence = _compared(self, seconds, row, min_step)
        if evidence.ratio <= ALARM:
            sums, scaled = self.sums.added(seconds, row), float(row @ self.fit.residual) * math.sqrt(seconds)
            kept, (last, products, squares) = math.exp(-seconds / FADE_S), self.scatter
            scatter = Scatter(scaled, kept * products + scaled * last, kept * squares + scaled * scaled)
            fit = _fitted(sums, self.prior, self.fit, scatter.lasting(self.prior.noise))
            return self._replace(sums=sums, fit=fit, evidence=evidence, scatter=scatter)
        # learn again from the windows since the step, with slopes as before it and a level that may be anywhere
        before, (_, sums) = evidence.before, max(evidence.up, evidence.down, key=lambda each: each.ratio)
        information = np.array([1 / (NEW_LEVEL * min_step) ** 2, *self.prior.information[1:]])
        # a level that was wrong from the start looks like noise
        prior = Prior(before.mean, information, min(before.noise, WINDOW_S * (min_step / STANDS_OUT) ** 2))
        fit = _fitted(sums, prior, before, self.scatter.lasting(prior.noise))
        # a step is no scatter
        return Regression(prior, sums, fit, Evidence(fit), self.steps + 1, float(row @ before.residual), self.scatter)


def _compared(state: Regression, seconds: float, row: FloatArray, min_step: float) -> Evidence:
    """The evidence of a step of the level after one more window."""
    was = state.evidence
    # while there may have been a step, windows are compared with the fit before it
    before = was.before if state.in_doubt else state.fit
    # e = y − a − b x − c z, of variance v/t + (1, x, z) P (1, x, z)ᵀ
    residual, terms = before.residual, row[:3]
    error, variance = float(row @ residual), float(before.noise / seconds + terms @ before.covariance @ terms)
    freedom = 1.0 + INDEPENDENT * state.sums.windows

    def after(cusum: Cusum, side: int) -> Cusum:
        # the size of the step as estimated without this window, so that the bound on false alarms holds
        sums = cusum.since.products[0]
        size = side * float(sums @ residual / sums[0]) if sums[0] else 0.0
        # CUSUM: S ← max(0, S + log-likelihood ratio); the step may be since S was last 0
        ratio = cusum.ratio + _log_likelihood_ratio(error, side * max(size, min_step), variance, freedom)
        return Cusum(ratio, cusum.since.added(seconds, row)) if ratio > 0 else Cusum()

    return Evidence(before, after(was.up, 1), after(was.down, -1))


def _log_likelihood_ratio(error: float, step: float, variance: float, freedom: float) -> float:
    """Logarithm of the likelihood ratio of an error: with a step of the level to without one.

    The error has Student's t distribution, as the noise is estimated.
    """
    # (ν + 1)/2 · [log(1 + e²/(ν σ²)) − log(1 + (e − d)²/(ν σ²))]
    scale = freedom * variance
    with_step = error - step
    return (freedom + 1) / 2 * (math.log1p(error * error / scale) - math.log1p(with_step * with_step / scale))


def _fitted(sums: Sums, prior: Prior, before: Fit, lasting: float) -> Fit:
    """Posterior of a, b, c and the noise by the sums over windows; the noise of `before` starts the iteration.

    `lasting` is the factor of the noise by which windows count as fewer.

    Source: expectation maximisation, Dempster, Laird and Rubin 1977.
    """
    information, noise, xx = np.diag(prior.information), before.noise, sums.products[:3, :3]
    # what the prior means leave to explain: Xᵀ(y − X prior)
    left = sums.products[:3, 3] - xx @ prior.mean

    def covariance_by(noise: float) -> FloatArray:
        return np.asarray(np.linalg.inv(information + xx / (noise * lasting)), dtype=float)

    for _ in range(PASSES):
        # (P⁻¹ + XᵀX/v) (θ − prior) = Xᵀ(y − X prior)/v, with P the prior covariance and v the noise
        covariance = covariance_by(noise)
        fit = Fit(prior.mean + covariance @ left / (noise * lasting), covariance, noise)
        # Σ t (y − a − b x − c z)², and Σ t (1, x, z) P (1, x, z)ᵀ
        squares, spread = float(fit.residual @ sums.products @ fit.residual), float((xx * covariance).sum())
        # the mean of the prior's noise and the residuals', weighted by their windows
        noise = (PRIOR_WINDOWS * prior.noise + max(squares, 0.0) + spread) / (PRIOR_WINDOWS + sums.windows)
    return Fit(fit.mean, covariance_by(noise), noise)
