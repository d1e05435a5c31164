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
    """Means and inverse variances of a, b and c; and the noise of windows, a variance times their length."""

    a: float
    b: float
    c: float
    information_a: float
    information_b: float
    information_c: float
    noise: float


class Sums(NamedTuple):
    """Sums over windows of 1, x, x², y, …, weighted by the windows' times and faded; and their number, faded, too."""

    n: float
    x: float
    xx: float
    y: float
    xy: float
    yy: float
    windows: float
    z: float
    xz: float
    zz: float
    zy: float


NO_SUMS = Sums(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Fit(NamedTuple):
    """Posterior of a, b and c; the noise of windows, see `Prior`; `aa`, `ab`, … variances and covariances."""

    a: float
    b: float
    c: float
    noise: float
    aa: float
    bb: float
    cc: float
    ab: float
    ac: float
    bc: float


class Evidence(NamedTuple):
    """Of a step up and of one down: CUSUM of the log-likelihood ratio, and sums over the windows since it last was 0.

    `before` is the fit without these windows, with which they are compared.
    """

    up: float
    down: float
    since_up: Sums
    since_down: Sums
    before: Fit


class Scatter(NamedTuple):
    """How long errors last: the last window's error times the root of its time, and faded sums of the products of two
    successive ones, and of their squares."""

    last: float
    products: float
    squares: float


class Regression(NamedTuple):
    """State of the regression; so many `steps` of the level were recognised, the last of a size `step`."""

    prior: Prior
    sums: Sums
    fit: Fit
    evidence: Evidence
    steps: int
    step: float
    scatter: Scatter


def started(prior: Prior) -> Regression:
    """The state before the first window."""
    variances = 1 / prior.information_a, 1 / prior.information_b, 1 / prior.information_c
    fit = Fit(prior.a, prior.b, prior.c, prior.noise, *variances, 0.0, 0.0, 0.0)
    return Regression(prior, NO_SUMS, fit, Evidence(0.0, 0.0, NO_SUMS, NO_SUMS, fit), 0, 0.0, Scatter(0.0, 0.0, 0.0))


def lasting_noise(state: Regression) -> float:
    """Variance of the mean over a long time, times that time."""
    return state.fit.noise * _lasting(state.scatter, state.prior.noise)


def in_doubt(state: Regression) -> bool:
    """Whether the level may have changed: the next windows decide."""
    return max(state.evidence.up, state.evidence.down) > DOUBT


# The functions below may be compiled, see `eadp.core.compiled`.


def with_window(state: Regression, seconds: float, mean: float, x: float, z: float, min_step: float) -> Regression:
    """The state after a window: its fit, or where a lasting step of the level is found, a new one since the step.

    Parameters
    ----------
    state : Regression
    seconds : float
        The window's length [s].
    mean, x, z : float
        Means of y, x and z over it.
    min_step : float
        The least step of the level that is to be recognised.
    """
    evidence = _compared(state, seconds, mean, x, z, min_step)
    prior, sums, before = state.prior, _added(state.sums, seconds, mean, x, z), state.fit
    scatter = _scattered(state.scatter, seconds, mean - before.a - before.b * x - before.c * z)
    steps, step = state.steps, state.step
    stepped = max(evidence.up, evidence.down) > ALARM
    if stepped:
        # learn again from the windows since the step, with slopes as before it and a level that may be anywhere
        before = evidence.before
        sums = evidence.since_up if evidence.up > evidence.down else evidence.since_down
        information_a = 1 / (NEW_LEVEL * min_step) ** 2
        # a level that was wrong from the start looks like noise
        noise = min(before.noise, WINDOW_S * (min_step / STANDS_OUT) ** 2)
        prior = Prior(before.a, before.b, before.c, information_a, prior.information_b, prior.information_c, noise)
        scatter = state.scatter  # a step is no scatter
    fit = _fitted(sums, prior, before, _lasting(scatter, prior.noise))
    if stepped:
        steps, step = steps + 1, mean - before.a - before.b * x - before.c * z
        evidence = Evidence(0.0, 0.0, NO_SUMS, NO_SUMS, fit)
    return Regression(prior, sums, fit, evidence, steps, step, scatter)


def _scattered(scatter: Scatter, seconds: float, error: float) -> Scatter:
    """The scatter with one more window, of an error."""
    kept, scaled = math.exp(-seconds / FADE_S), error * math.sqrt(seconds)
    return Scatter(scaled, kept * scatter.products + scaled * scatter.last, kept * scatter.squares + scaled * scaled)


def _lasting(scatter: Scatter, noise: float) -> float:
    """Variance of the mean over a long time to that of independent windows: 1 + 2 ρ, with ρ of successive ones."""
    correlation = scatter.products / (scatter.squares + INDEPENDENT_WINDOWS * noise)
    return 1.0 + 2.0 * max(correlation, 0.0)


def _added(sums: Sums, seconds: float, mean: float, x: float, z: float) -> Sums:
    """The sums with one more window."""
    kept = math.exp(-seconds / FADE_S)
    return Sums(
        kept * sums.n + seconds,
        kept * sums.x + seconds * x,
        kept * sums.xx + seconds * (x * x),
        kept * sums.y + seconds * mean,
        kept * sums.xy + seconds * (x * mean),
        kept * sums.yy + seconds * (mean * mean),
        kept * sums.windows + 1,
        kept * sums.z + seconds * z,
        kept * sums.xz + seconds * (x * z),
        kept * sums.zz + seconds * (z * z),
        kept * sums.zy + seconds * (z * mean),
    )


def _compared(state: Regression, seconds: float, mean: float, x: float, z: float, min_step: float) -> Evidence:
    """The evidence of a step of the level after one more window."""
    was = state.evidence
    # while there may have been a step, windows are compared with the fit before it
    before = was.before if max(was.up, was.down) > DOUBT else state.fit
    # e = y − a − b x − c z, of variance v/t + (1, x, z) P (1, x, z)ᵀ
    error = mean - before.a - before.b * x - before.c * z
    variance = before.noise / seconds + before.aa + 2 * x * before.ab + x * x * before.bb
    variance += z * (z * before.cc + 2 * before.ac + 2 * x * before.bc)
    freedom = 1.0 + INDEPENDENT * state.sums.windows
    # the size of the step as estimated without this window, so that the bound on false alarms holds
    step_up = max(_mean_error(was.since_up, before), min_step)
    step_down = min(_mean_error(was.since_down, before), -min_step)
    # CUSUM: S ← max(0, S + log-likelihood ratio); the step may be since S was last 0
    up = max(0.0, was.up + _log_likelihood_ratio(error, step_up, variance, freedom))
    down = max(0.0, was.down + _log_likelihood_ratio(error, step_down, variance, freedom))
    since_up, since_down = NO_SUMS, NO_SUMS
    if up > 0.0:
        since_up = _added(was.since_up, seconds, mean, x, z)
    if down > 0.0:
        since_down = _added(was.since_down, seconds, mean, x, z)
    return Evidence(up, down, since_up, since_down, before)


def _mean_error(sums: Sums, fit: Fit) -> float:
    """Mean by which windows are above a fit; 0 without a window."""
    if sums.n == 0.0:
        return 0.0
    return (sums.y - fit.b * sums.x - fit.c * sums.z) / sums.n - fit.a


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

    The means are those that the last noise was computed with, the variances those that it leads to. `lasting` is the
    factor of the noise by which windows count as fewer.

    Source: expectation maximisation, Dempster, Laird and Rubin 1977.
    """
    means, noise = before, before.noise
    for _ in range(PASSES):
        means = _posterior(sums, prior, noise * lasting)
        noise = _expected_noise(sums, prior, means)
    spread = _posterior(sums, prior, noise * lasting)
    return Fit(means.a, means.b, means.c, noise, spread.aa, spread.bb, spread.cc, spread.ab, spread.ac, spread.bc)


def _expected_noise(sums: Sums, prior: Prior, fit: Fit) -> float:
    """The noise expected under a posterior of a, b and c."""
    a, b, c = fit.a, fit.b, fit.c
    # Σ t (y − a − b x − c z)²
    of_products = sums.yy - 2 * (a * sums.y + b * sums.xy)
    of_c = c * (c * sums.zz - 2 * sums.zy + 2 * a * sums.z + 2 * b * sums.xz)
    squares = max(of_products + a * a * sums.n + 2 * a * b * sums.x + b * b * sums.xx + of_c, 0.0)
    # Σ t (1, x, z) P (1, x, z)ᵀ
    spread = sums.n * fit.aa + 2 * sums.x * fit.ab + sums.xx * fit.bb
    spread += sums.zz * fit.cc + 2 * (sums.z * fit.ac + sums.xz * fit.bc)
    # the mean of the prior's noise and the residuals', weighted by their windows
    return (PRIOR_WINDOWS * prior.noise + squares + spread) / (PRIOR_WINDOWS + sums.windows)


def _posterior(sums: Sums, prior: Prior, noise: float) -> Fit:
    """Posterior of a, b and c by the sums over windows and a given noise: 3 normal equations, solved by hand."""
    # (P⁻¹ + XᵀX/v) (a, b, c) = P⁻¹ prior + Xᵀy/v, with P the prior covariance and v the noise
    info_aa, info_ab = prior.information_a + sums.n / noise, sums.x / noise
    info_bb = prior.information_b + sums.xx / noise
    info_ac, info_bc, info_cc = sums.z / noise, sums.xz / noise, prior.information_c + sums.zz / noise
    # right-hand sides, for c − prior c: y above what the prior c explains
    rhs_a = prior.information_a * prior.a + (sums.y - prior.c * sums.z) / noise
    rhs_b = prior.information_b * prior.b + (sums.xy - prior.c * sums.xz) / noise
    rhs_c = (sums.zy - prior.c * sums.zz) / noise
    # c eliminated: its Schur complement
    by_a, by_b = info_ac / info_cc, info_bc / info_cc
    info_aa, info_ab, info_bb = info_aa - by_a * info_ac, info_ab - by_a * info_bc, info_bb - by_b * info_bc
    rhs_a, rhs_b = rhs_a - by_a * rhs_c, rhs_b - by_b * rhs_c
    # the 2 × 2 system that is left, by its inverse, the covariance of a and b
    determinant = info_aa * info_bb - info_ab * info_ab
    a, b = (info_bb * rhs_a - info_ab * rhs_b) / determinant, (info_aa * rhs_b - info_ab * rhs_a) / determinant
    aa, ab, bb = info_bb / determinant, -info_ab / determinant, info_aa / determinant
    c = prior.c + (rhs_c - info_ac * a - info_bc * b) / info_cc
    # c = const − by_a a − by_b b + its own error
    ac, bc = -(aa * by_a + ab * by_b), -(ab * by_a + bb * by_b)
    cc = 1 / info_cc - by_a * ac - by_b * bc
    return Fit(a, b, c, noise, aa, bb, cc, ab, ac, bc)
