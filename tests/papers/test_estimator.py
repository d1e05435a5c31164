"""Estimators: what is recovered, what a gate and a missing reading leave, how sure a forecast is; the published one."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from eadp.core.signals import output_row
from eadp.papers import estimator as module
from eadp.papers.estimator import EstimatorSettings, ExactEstimator, PublishedEstimator
from eadp.papers.forecasting import process_noise as disturbance_noise

PERIOD_S = 46.0
STATE_W = np.array([31.0, 1.5, -0.8, 0.6, 0.4, -0.3, 0.2])
ROUNDING = 1e-9
RECOVERED_W = 1e-3
NOISES = EstimatorSettings()
QUIET = replace(NOISES, disturbance_std_w=0.0)


def signal_w(time_s, state_w=STATE_W, period_s=PERIOD_S):
    """The power of a state at time 0, written out."""
    power = state_w[0]
    for j in range(1, (len(state_w) + 1) // 2):
        angle = 2 * np.pi * j * time_s / period_s
        power = power + state_w[2 * j - 1] * np.cos(angle) + state_w[2 * j] * np.sin(angle)
    return power


def system_matrix(order, period_s):
    """A of the letter's Eq. 6."""
    blocks = [np.array([[0.0, w], [-w, 0.0]]) for w in 2 * np.pi / period_s * np.arange(1, order + 1)]
    return block_diag(np.zeros((1, 1)), *blocks)


def whole_matrix(period_s=PERIOD_S, time_s=NOISES.disturbance_time_s):
    """A of level, harmonics and disturbance."""
    rate = math.sqrt(3) / time_s
    return block_diag(system_matrix(3, period_s), np.array([[0.0, 1.0], [-(rate**2), -2 * rate]]))


ROW = np.array([1.0, 1, 0, 1, 0, 1, 0, 1, 0])


def covariance(estimator):
    """P, up to date."""
    return estimator._covariance


def state(estimator):
    """The whole state."""
    return estimator._state.copy()


def fed(estimator, times_s, missing=()):
    """An estimator that has read the signal at some times, with nothing to read at some of them."""
    for i, time_s in enumerate(times_s):
        estimator.observe(float(time_s), None if i in missing else float(signal_w(time_s)))
    return estimator


# --- exact

GRIDS = {
    "0.1 s": np.arange(0.0, 140.0, 0.1),
    "0.7 s": np.arange(0.0, 140.0, 0.7),
    "irregular": np.sort(np.random.default_rng(0).uniform(0.0, 140.0, 700)),
    "dense, then sparse": np.r_[np.arange(0.0, 50.0, 0.05), np.arange(50.0, 140.0, 3.1)],
}
MISSING = {*range(600, 900), *range(3, 1400, 7)}


@pytest.mark.parametrize(("grid", "missing"), [*((grid, ()) for grid in GRIDS), ("0.1 s", MISSING)])
def test_a_clean_signal_is_recovered_whatever_the_steps(grid, missing):
    times = GRIDS[grid]
    estimator = fed(ExactEstimator(QUIET, PERIOD_S), times, missing)
    true_w = expm(system_matrix(3, PERIOD_S) * times[-1]) @ STATE_W
    assert estimator.state_w == pytest.approx(true_w, abs=RECOVERED_W)
    ahead = np.linspace(0.1, 60.0, 37)
    assert estimator.forecast(ahead) == pytest.approx(signal_w(times[-1] + ahead), abs=5 * RECOVERED_W)


def test_prediction_does_not_depend_on_how_time_is_cut():
    """State and covariance: harmonics drift alike in both their parts, so their noise is the same in every turn."""
    fine, coarse = (fed(ExactEstimator(NOISES, PERIOD_S), np.arange(0.0, 20.0, 0.1)) for _ in range(2))
    for time_s in 20.0 + np.cumsum(np.random.default_rng(1).uniform(0.01, 0.3, 60)):
        fine.observe(time_s, None)
    coarse.observe(time_s, None)
    assert state(fine) == pytest.approx(state(coarse), abs=ROUNDING)
    assert covariance(fine) == pytest.approx(covariance(coarse), abs=ROUNDING)


def process_noise(step_s):
    noise_w, std_w, time_s = NOISES.noise_w, NOISES.disturbance_std_w, NOISES.disturbance_time_s
    # a share of the noise, as the settings' own drifts are less; laps have no spread where this is used
    drift = np.full(7, max(NOISES.level_drift_w_per_sqrt_s**2, module.DRIFT_SHARE**2 * (noise_w**2 + std_w**2)))
    return block_diag(np.diag(drift) * step_s, disturbance_noise(step_s, std_w, time_s))


@pytest.mark.parametrize("reading", ["within the gate", "missing"])
def test_where_it_only_predicts_the_covariance_grows_by_the_process_noise(reading):
    settings = replace(NOISES, gate_w=0.5)
    estimator = fed(ExactEstimator(settings, PERIOD_S, period_std_s=0.0), np.arange(0.0, 30.0, 0.1))
    before, known, step_s = state(estimator), covariance(estimator).copy(), 0.4
    turn = expm(whole_matrix() * step_s)
    expected_w = float(ROW @ turn @ before)
    value = estimator.observe(29.9 + step_s, None if reading == "missing" else expected_w + 0.49)
    assert value == pytest.approx(expected_w, abs=ROUNDING)
    assert state(estimator) == pytest.approx(turn @ before, abs=ROUNDING)
    assert covariance(estimator) == pytest.approx(turn @ known @ turn.T + process_noise(step_s), abs=ROUNDING)
    assert np.trace(covariance(estimator)) > np.trace(known)


def test_a_reading_outside_the_gate_corrects():
    estimator = fed(ExactEstimator(replace(NOISES, gate_w=0.5), PERIOD_S), np.arange(0.0, 30.0, 0.1))
    missing = fed(ExactEstimator(replace(NOISES, gate_w=0.5), PERIOD_S), np.arange(0.0, 30.0, 0.1))
    expected_w = estimator.observe(30.0, estimator.forecast(np.array([0.1]))[0] + 0.51)
    missing.observe(30.0, None)
    assert estimator.forecast(np.zeros(1))[0] > expected_w
    assert np.trace(covariance(estimator)) < np.trace(covariance(missing))


def test_it_starts_from_the_first_reading_in_the_mean():
    estimator = ExactEstimator(EstimatorSettings(), PERIOD_S)
    estimator.observe(0.0, None)
    assert estimator.state_w == pytest.approx(np.zeros(7))
    estimator = ExactEstimator(EstimatorSettings(), PERIOD_S)
    assert estimator.observe(0.0, 33.0) == pytest.approx(33.0)
    assert estimator.state_w == pytest.approx([33.0, 0, 0, 0, 0, 0, 0])


def test_harmonics_drift_as_an_uncertain_period_turns_them():
    """A lap that is 0.5 s off 46 s turns harmonic j by 2π j 0.5/46; half of that change squared falls to each part."""
    settings = EstimatorSettings(level_drift_w_per_sqrt_s=0.1, harmonic_drift_w_per_sqrt_s=0.2)
    dynamics = ExactEstimator(settings, PERIOD_S, STATE_W, period_std_s=0.5)._dynamics
    assert (dynamics.order, dynamics.period_s, dynamics.noise_w) == (3, PERIOD_S, 0.5)
    amplitudes = np.array([math.hypot(1.5, -0.8), math.hypot(0.6, 0.4), math.hypot(-0.3, 0.2)])
    off_w = amplitudes * 2 * math.pi * np.array([1, 2, 3]) * 0.5 / 46
    assert dynamics.drift_w2_per_s == pytest.approx([0.01, *(0.04 + off_w**2 / 2 / 46)])
    # where the settings have none, a hundredth of the noise: 1.2² W² of the sensor and 0.5² of the disturbance
    none = replace(settings, level_drift_w_per_sqrt_s=0.0, harmonic_drift_w_per_sqrt_s=0.0, noise_w=1.2)
    dynamics = ExactEstimator(none, PERIOD_S)._dynamics
    assert dynamics.drift_w2_per_s == pytest.approx(np.full(4, 1e-4 * (1.44 + 0.25)))


def test_a_known_state_is_kept():
    estimator = ExactEstimator(EstimatorSettings(), PERIOD_S, STATE_W)
    assert estimator.observe(0.0, None) == pytest.approx(signal_w(0.0))
    assert estimator.state_w == pytest.approx(STATE_W)
    # a first reading corrects it, and does not take its place
    assert estimator.observe(0.0, 50.0) == pytest.approx(signal_w(0.0))
    assert np.count_nonzero(estimator.state_w) == 7
    assert np.ptp(estimator.forecast(np.linspace(0, PERIOD_S, 8))) > 1.0


def test_without_a_period_the_forecast_is_the_mean():
    estimator = ExactEstimator(EstimatorSettings(), None)
    for time_s in np.arange(0.0, 20.0, 0.1):
        estimator.observe(time_s, 30.0)
    assert estimator.state_w == pytest.approx([30.0])
    assert estimator.forecast(np.array([0.0, 7.0, 100.0])) == pytest.approx(np.full(3, 30.0))


def test_a_new_period_turns_faster_at_once():
    """The step's matrix and the forecast's table follow the period, and phases continue."""
    estimator = ExactEstimator(NOISES, PERIOD_S, STATE_W)
    ahead = np.linspace(0.0, 20.0, 50)
    assert estimator.forecast(ahead) == pytest.approx(signal_w(ahead), abs=ROUNDING)
    estimator.observe(0.0, None)
    estimator.observe(1.0, None)
    estimator.end_lap(1.0)
    estimator.end_lap(24.0)
    assert estimator.period_s == pytest.approx(23.0)
    before = estimator.state_w
    estimator.observe(2.0, None)
    after = expm(system_matrix(3, 23.0)) @ before
    assert estimator.state_w == pytest.approx(after, abs=ROUNDING)
    assert estimator.forecast(ahead) == pytest.approx(signal_w(ahead, after, 23.0), abs=ROUNDING)
    assert estimator.forecast(ahead[:7]) == pytest.approx(signal_w(ahead[:7], after, 23.0), abs=ROUNDING)


def test_a_forecast_is_gaussian_conditioning():
    """From all readings at once, by the covariances of everything with them."""
    rng = np.random.default_rng(3)
    settings = replace(NOISES, level_drift_w_per_sqrt_s=0.1, harmonic_drift_w_per_sqrt_s=0.05)
    estimator = ExactEstimator(settings, PERIOD_S, STATE_W, period_std_s=0.0)
    times = np.sort(rng.uniform(0.0, 60.0, 40))
    readings = signal_w(times) + 0.5 * rng.standard_normal(len(times))
    first = covariance(estimator).copy()
    for time_s, reading in zip(times, readings, strict=True):
        estimator.observe(time_s, reading)
    duration_s, count = 70.0, 1400
    middles = times[-1] + (np.arange(count) + 0.5) * duration_s / count
    instants = np.concatenate([times, middles])
    mean, prior = gaussian(instants - times[0], first, settings)
    n = len(times)
    seen = prior[:n, :n] + settings.noise_w**2 * np.eye(n)
    weights = np.linalg.solve(seen, prior[:n, n:]).T
    wanted = mean[n:] + weights @ (readings - mean[:n])
    assert estimator.forecast(middles - times[-1]) == pytest.approx(wanted, abs=1e-6)


def gaussian(times_s, first, settings):
    """Mean and covariance of the power at times from the first reading, by the state's at any two of them."""
    waves = [np.ones(len(times_s))]
    for j in (1, 2, 3):
        waves += [np.cos(2 * np.pi * j * times_s / PERIOD_S), np.sin(2 * np.pi * j * times_s / PERIOD_S)]
    table = np.column_stack(waves)
    early = np.minimum.outer(times_s, times_s)
    apart = np.subtract.outer(times_s, times_s)
    turns = math.sqrt(3) / settings.disturbance_time_s * np.abs(apart)
    drift = settings.harmonic_drift_w_per_sqrt_s**2 * sum(np.cos(2 * np.pi * j * apart / PERIOD_S) for j in (1, 2, 3))
    prior = (
        table @ first[:7, :7] @ table.T
        + early * (settings.level_drift_w_per_sqrt_s**2 + drift)
        + settings.disturbance_std_w**2 * (1 + turns) * np.exp(-turns)
    )
    return table @ STATE_W, prior


def test_laps_give_the_period_the_first_apart():
    """And its spread. The first may have begun anywhere; one that follows no other begins the count anew."""
    estimator, periods_s = ExactEstimator(NOISES, PERIOD_S), []
    assert estimator.period_std_s == pytest.approx(module.NOMINAL_PERIOD_SHARE * PERIOD_S)
    for end_s in (30.0, 76.0, 121.5, 168.0, 214.0):
        estimator.end_lap(end_s)
        periods_s.append(estimator.period_s)
        if end_s == 76.0:
            assert estimator.period_std_s == pytest.approx(module.ONE_LAP_SHARE * 46.0)
    assert periods_s == pytest.approx([PERIOD_S, 46.0, 45.5, 46.5, 46.0]), "the last lap's time"
    # they change by −0.5, 1, −0.5
    assert estimator.period_std_s == pytest.approx(math.sqrt((0.25 + 1 + 0.25) / 3))
    estimator.start_lap(300.0)
    assert estimator.period_s == pytest.approx(46.0)
    estimator.end_lap(340.0)
    assert estimator.period_s == pytest.approx(40.0)


# --- published


class Transcribed:
    """The published filter with its matrices: 1 everywhere in the covariances, A_d = I + A Δt, R = 1, never carried."""

    def __init__(self, order=3):
        self.q = np.ones(2 * order + 1)
        self.order, self.time_s = order, 0.0
        self.row = output_row(order)
        self.ones = np.ones((2 * order + 1, 2 * order + 1))

    def observe(self, time_s, motion_w, period_s):
        euler = np.eye(len(self.q)) + system_matrix(self.order, period_s) * (time_s - self.time_s)
        self.time_s = time_s
        self.q = euler @ self.q
        expected_w = self.row @ self.q
        if motion_w is not None:
            covariance = euler @ self.ones @ euler.T + self.ones
            gain = covariance @ self.row / (self.row @ covariance @ self.row + 1.0)
            self.q = self.q + gain * (motion_w - expected_w)
        return expected_w


@pytest.mark.quick(1)
@pytest.mark.parametrize("order", [3, 1, 0])
def test_the_published_filter_is_its_transcription(order):
    """Step by step at 100 Hz over two laps, readings missing here and there."""
    rng = np.random.default_rng(order)
    estimator, matrices = PublishedEstimator(EstimatorSettings(order=order)), Transcribed(order)
    clock_s, period_s = 0.0, 1.0
    found, expected = [], []
    for i in range(1, 2001):
        time_s = i * 0.01
        if i in (650, 1350):  # a lap ends: the period is its time, and the clock restarts
            estimator.end_lap(time_s)
            period_s, clock_s = time_s - clock_s, time_s
        period_s = max(period_s, time_s - clock_s)
        motion_w = None if rng.random() < 0.05 else signal_w(time_s) + rng.normal(0.0, 0.2)
        expected.append([matrices.observe(time_s, motion_w, period_s), *matrices.q])
        found.append([estimator.observe(time_s, motion_w), *estimator.state_w])
    assert np.array(found) == pytest.approx(np.array(expected), abs=1e-8)
    assert estimator.period_s == pytest.approx(period_s)


def test_the_published_forecast_is_exact_from_its_state():
    estimator = PublishedEstimator(EstimatorSettings())
    for i in range(1, 501):
        estimator.observe(i * 0.01, float(signal_w(i * 0.01)))
    ahead = np.array([0.0, 1.0, 2.5])
    state = [expm(system_matrix(3, estimator.period_s) * t) @ estimator.state_w for t in ahead]
    assert estimator.forecast(ahead) == pytest.approx([output_row(3) @ q for q in state], abs=ROUNDING)


def test_the_published_period_grows_with_a_lap_longer_than_the_last():
    estimator = PublishedEstimator(EstimatorSettings())

    def period_s(time_s):
        estimator.observe(time_s, None)
        return estimator.period_s

    assert period_s(0.5) == 1.0
    assert period_s(40.0) == 40.0
    estimator.end_lap(46.0)
    assert period_s(46.0) == 46.0
    assert period_s(80.0) == 46.0
    assert period_s(93.0) == 47.0
    estimator.end_lap(93.5)
    assert period_s(93.5) == 47.5


@pytest.mark.parametrize("every_s", [0.1, 1.0])
def test_the_published_filter_follows_readings_further_apart(every_s):
    """A single Euler step of a tenth of a second doubles the third harmonic of a period of 1 s."""
    estimator = PublishedEstimator(EstimatorSettings(every_s=every_s))
    errors = [
        abs(estimator.observe(time_s, float(signal_w(time_s))) - signal_w(time_s))
        for time_s in np.arange(every_s, 200.0, every_s).tolist()
    ]
    assert np.median(errors) < 0.3
    assert np.max(np.abs(estimator.state_w)) < 2 * STATE_W[0]


# --- estimates


@pytest.mark.parametrize("kind", [ExactEstimator, PublishedEstimator])
def test_an_estimate_forecasts_as_its_estimator_and_keeps_to_its_reading(kind):
    estimator = kind(EstimatorSettings(), PERIOD_S) if kind is ExactEstimator else kind(EstimatorSettings())
    fed(estimator, np.arange(0.1, 60.0, 0.1))
    ahead = np.array([0.0, 2.0, 7.5])
    estimate = estimator.estimate(9.0, 6.0)
    known = estimator.forecast(ahead) + 9.0
    assert estimate.forecast_w(ahead) == pytest.approx(known, abs=ROUNDING)
    assert estimate.time_s == pytest.approx(59.9)
    assert estimate.state[:-2] == pytest.approx(estimator.state_w)
    assert estimate.horizon_w() == pytest.approx(estimate.forecast_w(np.arange(13) * 0.5))
    estimator.observe(60.0, 50.0)
    assert estimate.forecast_w(ahead) == pytest.approx(known, abs=ROUNDING), "later readings do not change it"
