"""Periods found in made signals of known period, and none found in noise.

Oracles: the signals' own parameters, a refit by scipy's non-linear least squares, cross-validation written as a loop.
"""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from common import few, few_rows
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.signal import lfilter

from eadp.core.arrays import FloatArray
from eadp.errors import Infeasible
from eadp.measure.harmonics import PowerSamples, harmonic_fit, nearest_minimum
from eadp.measure.spectrum import MAX_CHANCE, MIN_CV_R2, MIN_SAMPLES, Spectrum, analyse, periodogram

NoiseModel = Callable[[np.random.Generator, int], FloatArray]
Terms = tuple[tuple[float, float], ...]

PERIOD_S = 46.05
MEAN_W = 36.4
THREE = ((2.1, 0.8), (1.4, -1.9), (0.6, 2.6))  # amplitude [W] and phase [rad] of each harmonic
SIGMAS = 4.0  # of the period's own standard deviation


def signal(times_s: FloatArray, terms: Terms = THREE, period_s: float = PERIOD_S) -> FloatArray:
    waves = (a * np.cos(2 * np.pi * j * times_s / period_s + f) for j, (a, f) in enumerate(terms, start=1))
    return np.asarray(MEAN_W + sum(waves))


def sampled(periods: float, step_s: float = 1.0, period_s: float = PERIOD_S) -> FloatArray:
    return np.arange(0.0, periods * period_s, step_s)


def noisy(times_s: FloatArray, std_w: float = 0.5, seed: int = 0, **kind: object) -> FloatArray:
    return signal(times_s, **kind) + np.random.default_rng(seed).normal(0, std_w, len(times_s))  # type: ignore[arg-type]


def assert_found(found: Spectrum, period_s: float = PERIOD_S, order: int = 3, near: float = 0.01) -> None:
    assert found.periodic
    assert abs(found.period_s - period_s) < SIGMAS * found.period_std_s
    assert found.period_s == pytest.approx(period_s, rel=near)
    assert len(found.amplitude_w) == order


# what is found


def test_a_periodogram_peaks_at_the_period() -> None:
    times = sampled(8, step_s=0.5)
    period, share = periodogram(times + 1000.0, noisy(times, 0.1), order=3, points=200)
    assert np.all(np.diff(np.log(period)) == pytest.approx(np.log(period[-1] / period[0]) / 199))
    assert period[0] == pytest.approx(8 * 0.5)
    assert period[-1] == pytest.approx((times[-1] - times[0]) / 1.9, rel=1e-6)
    assert period[np.argmax(share)] == pytest.approx(PERIOD_S, rel=0.03)
    assert share.max() == pytest.approx(1.0, abs=0.05)
    # a period of the log and the grid: no harmonic fits well at a fifth of it
    assert share[np.argmin(np.abs(period - PERIOD_S / 5))] < 0.1
    _, flat = periodogram(times, np.full(len(times), MEAN_W), order=3, points=7)
    assert flat.tolist() == [0.0] * 7


@pytest.mark.quick(1)
@pytest.mark.parametrize("periods", [2, 2.5, 7.4])
def test_period_of_a_clean_log(periods: float) -> None:
    times = sampled(periods)
    found = analyse(times, noisy(times))
    assert_found(found)
    assert found.mean_w == pytest.approx(MEAN_W, abs=0.2)
    assert found.amplitude_w == pytest.approx([2.1, 1.4, 0.6], abs=0.25)
    assert found.noise_std_w == pytest.approx(0.5, rel=0.15)
    assert (found.samples, found.span_s) == (len(times), times[-1])


@pytest.mark.parametrize(("period_s", "noise_w"), few_rows([(3.0, 0.5), (5.0, 0.0)], 1))
def test_a_period_below_the_range_is_not_given_as_its_multiple(period_s: float, noise_w: float) -> None:
    times = np.arange(0.0, 2400.0, 1.2)
    found = analyse(times, noisy(times, noise_w, terms=((2.0, 0.3),), period_s=period_s))
    assert found.range_s[0] == pytest.approx(6.0, rel=1e-3)
    assert (found.period_s, len(found.amplitude_w)) == (pytest.approx(period_s, rel=1e-4), 1)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.05])
def test_a_period_that_drifts_is_stated(share: float) -> None:
    times = sampled(13, step_s=0.5)
    period = PERIOD_S * (1 + share * (2 * times / times[-1] - 1))
    turns = np.cumsum(0.5 / period) * PERIOD_S  # the time at which a constant period is at the same phase
    found = analyse(times, noisy(turns))
    assert found.periodic
    if not share:
        assert found.drift_s is None
        assert found.period_std_s < 0.02
        return
    assert found.drift_s is not None
    assert found.drift_s == (pytest.approx(0.965 * PERIOD_S, rel=0.01), pytest.approx(1.035 * PERIOD_S, rel=0.01))
    assert 1.0 < found.period_std_s < 2.0


FOURTH_AND_FIFTH = ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (3.0, 1.0), (2.0, 0.5))


@pytest.mark.quick(1)
@pytest.mark.parametrize("terms", [THREE, ((2.1, 0.8),), ((0.0, 0.0), (3.0, 1.0), (2.0, 0.0)), FOURTH_AND_FIFTH])
def test_a_log_without_noise_gives_the_period_and_the_phases_exactly(terms: Terms) -> None:
    times = sampled(3.3)
    found = analyse(times, signal(times, terms))
    assert found.period_s == pytest.approx(PERIOD_S, rel=1e-8)
    assert len(found.amplitude_w) == len(terms)
    for amplitude, phase, (a, f) in zip(found.amplitude_w, found.phase_rad, terms, strict=True):
        assert amplitude * np.exp(1j * phase) == pytest.approx(a * np.exp(1j * f), abs=1e-6)


@pytest.mark.quick(1)
@pytest.mark.parametrize("periods", [2.1, 9])
def test_a_stronger_second_harmonic_is_not_the_period(periods: float) -> None:
    times = sampled(periods)
    assert_found(analyse(times, noisy(times, terms=((0.6, 0.3), (4.0, 1.0), (1.0, -2.0)))))


@pytest.mark.quick(1)
@pytest.mark.parametrize("kept", few(["irregular", "30 % dropped", "gap of 40 %", "bursts", "a date"], 3))
def test_sampling_of_any_kind(kept: str) -> None:
    rng = np.random.default_rng(3)
    times = sampled(4)
    if kept == "irregular":
        times = np.sort(rng.uniform(0, 4 * PERIOD_S, len(times)))
    elif kept == "gap of 40 %":
        times = times[(times < 55) | (times > 129)]
    elif kept == "30 % dropped":
        times = times[rng.random(len(times)) > 0.3]
    elif kept == "bursts":
        times = np.sort(np.concatenate([times, times + 0.01, times + 0.02]))
    power = noisy(times)
    assert_found(analyse(times + 1.7e9 if kept == "a date" else times, power))


@pytest.mark.slow
def test_a_trend_hides_no_period() -> None:
    times = sampled(5)
    found = analyse(times, noisy(times) - times / 60)
    assert found.periodic
    assert found.period_s == pytest.approx(PERIOD_S, rel=0.02)


UNITS = (sampled(3), noisy(sampled(3)))


@cache
def in_its_units() -> Spectrum:
    return analyse(*UNITS)


@pytest.mark.slow
@settings(max_examples=1)
@given(st.floats(0.01, 100), st.floats(0.01, 1000), st.floats(-1e6, 1e6))
def test_units_do_not_matter(per_second: float, per_watt: float, start: float) -> None:
    (times, power), one = UNITS, in_its_units()
    other = analyse(per_second * times + start, per_watt * power - 7)
    assert other.period_s == pytest.approx(per_second * one.period_s, rel=1e-5)
    assert other.period_std_s == pytest.approx(per_second * one.period_std_s, rel=1e-2)
    assert other.mean_w == pytest.approx(per_watt * one.mean_w - 7, rel=1e-5, abs=1e-5 * per_watt)
    assert other.amplitude_w == pytest.approx(per_watt * one.amplitude_w, rel=1e-3)


# the fit, against other ways to it


def columns(times_s: FloatArray, period_s: float, order: int) -> FloatArray:
    angles = 2 * np.pi * np.outer(times_s, np.arange(1, order + 1)) / period_s
    return np.hstack([np.ones((len(times_s), 1)), np.cos(angles), np.sin(angles)])


def test_fit_is_that_of_non_linear_least_squares() -> None:
    times = sampled(3.7)
    power = noisy(times)
    found = analyse(times, power)

    def residual(parameters: FloatArray) -> FloatArray:
        return columns(times, parameters[0], 3) @ parameters[1:] - power

    exactly = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-14)
    oracle = least_squares(residual, [47.0, MEAN_W, 1, 1, 1, 1, 1, 1], x_scale="jac", **exactly)
    assert found.period_s == pytest.approx(oracle.x[0], rel=1e-6)
    assert found.mean_w == pytest.approx(oracle.x[1], rel=1e-6)
    assert found.amplitude_w == pytest.approx(np.hypot(oracle.x[2:5], oracle.x[5:8]), rel=1e-4)
    degrees = len(times) - len(oracle.x)
    assert found.noise_std_w == pytest.approx(math.sqrt(2 * oracle.cost / degrees), rel=1e-6)
    # of white noise, the standard deviation is that of the Jacobian, or a little more
    white = math.sqrt(np.linalg.inv(oracle.jac.T @ oracle.jac)[0, 0] * 2 * oracle.cost / degrees)
    assert 0.999 * white < found.period_std_s < 1.3 * white


@pytest.mark.parametrize("order", [1, 3])
def test_a_search_by_stretches_of_a_long_log_is_one_by_all_samples(order: int) -> None:
    rng = np.random.default_rng(order)
    times = np.sort(rng.uniform(0.0, 9000.0, 20_000))
    angle = 2 * np.pi * times[:, np.newaxis] / 7.3 * np.arange(1, order + 1)
    log = PowerSamples(times - times[0], np.cos(angle).sum(axis=1) + rng.normal(size=len(times)))
    found = nearest_minimum(log, 1 / 7.3 + 0.05 / log.span_s, order)
    steps = np.linspace(-1.0, 1.0, 41) * 1e-3 / log.span_s
    errors = [harmonic_fit(log, found + step, order)[1] for step in steps]
    bend, slope, _ = np.polyfit(steps * log.span_s, errors, 2)
    # the vertex of the error of all samples, beside the standard deviation that its bend has
    assert abs(slope / (2 * bend)) < 0.01 / math.sqrt(bend)


def test_score_is_that_of_blocks_left_out_with_their_neighbours() -> None:
    times = sampled(3.7)
    power = noisy(times)
    found = analyse(times, power)
    n, blocks = len(times), 12
    block = np.repeat(np.arange(blocks), np.diff([n * b // blocks for b in range(blocks + 1)]))
    error = about_mean = 0.0
    for b in range(blocks):
        seen, left_out = np.abs(block - b) > 1, block == b
        matrix = columns(times, found.period_s, 3)
        fitted, *_ = np.linalg.lstsq(matrix[seen], power[seen], rcond=None)
        error += np.sum((power[left_out] - matrix[left_out] @ fitted) ** 2)
        about_mean += np.sum((power[left_out] - power[seen].mean()) ** 2)
    assert found.cv_r2 == pytest.approx(1 - error / about_mean, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", few(range(3), 1))
def test_a_period_in_slow_noise_as_strong_as_the_signal(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = sampled(6)
    memory = math.exp(-1 / 5)
    slow = lfilter([math.sqrt(1 - memory**2)], [1, -memory], rng.normal(size=len(times) + 400))[-len(times) :]
    std_w = math.sqrt(sum(a**2 for a, _ in THREE) / 2)
    found = analyse(times, signal(times) + std_w * slow, period_prior_s=PERIOD_S * rng.uniform(0.75, 1.25))
    assert found.periodic
    assert found.period_s == pytest.approx(PERIOD_S, rel=0.05)
    assert abs(found.period_s - PERIOD_S) < SIGMAS * found.period_std_s


# what is not


def white(rng: np.random.Generator, n: int) -> FloatArray:
    return rng.normal(size=n)


def walk(rng: np.random.Generator, n: int) -> FloatArray:
    return np.cumsum(rng.normal(size=n))


def first_order(memory: float) -> NoiseModel:
    def noise(rng: np.random.Generator, n: int) -> FloatArray:
        return np.asarray(lfilter([1], [1, -memory], rng.normal(size=n + 500))[-n:])

    return noise


def smooth(rng: np.random.Generator, n: int) -> FloatArray:
    return np.asarray(lfilter([1], [1, -1.8, 0.81], rng.normal(size=n + 500))[-n:])


NOISES = {
    "white": (white, 60),
    "random walk": (walk, 60),
    "smooth": (smooth, 60),
    "long first order, 0.95": (first_order(0.95), 300),
}


@pytest.mark.parametrize(
    ("kind", "share"), [("white", 0.15), *(pytest.param(kind, 0.5, marks=pytest.mark.slow) for kind in NOISES)]
)
def test_noise_has_no_period(kind: str, share: float) -> None:
    noise, n = NOISES[kind]
    trials = round(share * (20 if n == 60 else 8))
    times = 0.5 * np.arange(n)
    found = [analyse(times, 30 + noise(np.random.default_rng(seed), n)).periodic for seed in range(trials)]
    assert sum(found) <= 0.05 * trials, "in 95 % and more of the trials"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["decay", "step", "one bump"])
def test_what_happens_once_has_no_period(kind: str) -> None:
    part = np.linspace(0, 1, 120)
    power = {
        "decay": 30 + 20 * np.exp(-8 * part),
        "step": np.where(part > 0.4, 35.0, 30.0),
        "one bump": 30 + 5 * np.exp(-(((part - 0.5) / 0.1) ** 2)),
    }[kind]
    noise_w = np.random.default_rng(2).normal(0, 0.02, len(part))
    assert not analyse(300 * part, power + noise_w).periodic


@pytest.mark.parametrize("level_w", [0.0, 12.3, -5e8])
def test_a_constant_has_no_period(level_w: float) -> None:
    found = analyse(np.arange(100.0), np.full(100, level_w))
    assert not found.periodic
    assert (found.mean_w, found.noise_std_w) == pytest.approx((level_w, 0.0), abs=1e-9)
    assert (found.cv_r2, found.chance) == (0.0, 1.0)
    assert math.isnan(found.period_s)


@pytest.mark.slow
def test_no_period_leaves_mean_and_spread() -> None:
    power = 30 + 2 * np.random.default_rng(0).normal(size=100)
    found = analyse(np.arange(100.0), power)
    assert not found.periodic
    assert (len(found.amplitude_w), len(found.phase_rad)) == (0, 0)
    assert found.mean_w == pytest.approx(power.mean())
    assert found.noise_std_w == pytest.approx(power.std(ddof=1))
    assert found.cv_r2 < MIN_CV_R2 or found.chance > MAX_CHANCE


@pytest.mark.quick(2)
@pytest.mark.parametrize("kind", ["an outlier", "a late start", "two levels", "all but one alike", "two times"])
def test_odd_samples_are_survived(kind: str) -> None:
    times, power = np.arange(80.0), 30 + np.random.default_rng(4).normal(size=80)
    if kind == "an outlier":
        power[40] = 1e9
    elif kind == "a late start":
        times[1:] += 1.7e9
    elif kind == "two levels":
        power = np.round(power)
    elif kind == "all but one alike":
        power[:] = 30
        power[70] = 31
    else:
        times = np.concatenate([np.linspace(0, 1e-6, 40), 1 + np.linspace(0, 1e-6, 40)])
    found = analyse(times, power)
    assert not found.periodic
    assert math.isfinite(found.cv_r2)


# what is asked for


@pytest.mark.quick(1)
@pytest.mark.parametrize("order", [1, 2, 5])
def test_order_asked_for(order: int) -> None:
    times = sampled(4)
    assert_found(analyse(times, noisy(times), order=order), order=order)


def test_an_order_that_the_samples_cannot_tell() -> None:
    times = sampled(4, step_s=2.0)
    with pytest.raises(Infeasible, match=r"order 30 is too high: .* to order 11 at most"):
        analyse(times, noisy(times), order=30)


@pytest.mark.slow
def test_a_prior_confines_the_search() -> None:
    times = sampled(6)
    power = noisy(times, terms=((1.0, 0.3), (4.0, 1.0)))
    assert_found(analyse(times, power, period_prior_s=40), order=2)
    assert analyse(times, power, period_prior_s=24).period_s == pytest.approx(PERIOD_S / 2, rel=0.02)


def test_a_prior_of_which_only_a_sliver_fits_into_the_log() -> None:
    times = sampled(5)
    # within a factor of 1.3 of the prior, but for a thousandth of it, is more than the log has
    found = analyse(times, noisy(times), period_prior_s=1.299 * times[-1] / 1.9)
    assert not found.periodic


@pytest.mark.slow
def test_standard_deviations_of_mean_and_amplitudes_in_white_noise() -> None:
    # of n samples over whole periods: σ/√n of the mean, σ√(2/n) of an amplitude
    times, std_w = sampled(8, step_s=0.5), 2.0
    found = analyse(times, noisy(times, std_w, seed=3))
    assert found.mean_std_w == pytest.approx(std_w / math.sqrt(len(times)), rel=0.25)
    assert found.amplitude_std_w == pytest.approx(3 * [std_w * math.sqrt(2 / len(times))], rel=0.25)


@pytest.mark.slow
def test_a_period_that_does_not_fit_twice_does_not_count() -> None:
    times = sampled(1.5)
    found = analyse(times, noisy(times, std_w=0.1, terms=((2.1, 0.8),)))
    assert not found.periodic
    assert math.isnan(found.period_std_s)


@pytest.mark.slow
def test_surrogates_are_the_same_each_time() -> None:
    times = sampled(3, step_s=2.0)
    rng = np.random.default_rng(8)
    power = signal(times) + 2 * np.asarray(lfilter([0.4], [1, -0.9], rng.normal(size=len(times))))
    one, other = analyse(times, power), analyse(times, power)
    assert 0 < one.chance == other.chance < 1


def test_too_few_samples() -> None:
    few = np.arange(float(MIN_SAMPLES - 1))
    with pytest.raises(Infeasible, match=f"{MIN_SAMPLES} are needed"):
        analyse(few, few)
    found = analyse(np.arange(float(MIN_SAMPLES)), np.cos(np.arange(MIN_SAMPLES)))
    assert found.period_s == pytest.approx(2 * math.pi, rel=1e-6)
