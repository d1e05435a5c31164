"""Estimators: what is recovered, what a gate and a missing reading leave, and the published filter by its matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from eadp.core.harmonics import forecast_w, output_row
from eadp.planning.estimator import EstimatorSettings, ExactEstimator, LapClock, PublishedEstimator

PERIOD_S = 46.0
STATE_W = np.array([31.0, 1.5, -0.8, 0.6, 0.4, -0.3, 0.2])
ROUNDING = 1e-9
RECOVERED_W = 1e-3


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


def fed(estimator, times_s, missing=()):
    """An estimator that has read the signal at some times, with nothing to read at some of them."""
    for i, time_s in enumerate(times_s):
        estimator.observe(float(time_s), None if i in missing else float(signal_w(time_s)))
    return estimator


def state_at(time_s):
    """The true state at a time, by the matrix exponential."""
    return expm(system_matrix(3, PERIOD_S) * time_s) @ STATE_W


# --- exact

GRIDS = {
    "0.1 s": np.arange(0.0, 140.0, 0.1),
    "0.7 s": np.arange(0.0, 140.0, 0.7),
    "irregular": np.sort(np.random.default_rng(0).uniform(0.0, 140.0, 700)),
    "dense, then sparse": np.r_[np.arange(0.0, 50.0, 0.05), np.arange(50.0, 140.0, 3.1)],
}


@pytest.mark.parametrize("grid", GRIDS)
def test_a_clean_signal_is_recovered_whatever_the_steps(grid):
    times = GRIDS[grid]
    estimator = fed(ExactEstimator(EstimatorSettings(), PERIOD_S), times)
    assert estimator.state_w == pytest.approx(state_at(times[-1]), abs=RECOVERED_W)
    ahead = np.linspace(0.1, 60.0, 37)
    assert estimator.forecast(ahead) == pytest.approx(signal_w(times[-1] + ahead), abs=5 * RECOVERED_W)


def test_missing_readings_leave_the_prediction_exact():
    times = GRIDS["0.1 s"]
    missing = set(range(600, 900)) | set(range(3, 1400, 7))
    estimator = fed(ExactEstimator(EstimatorSettings(), PERIOD_S), times, missing)
    assert estimator.state_w == pytest.approx(state_at(times[-1]), abs=RECOVERED_W)


def test_prediction_does_not_depend_on_how_time_is_cut():
    """State and covariance: harmonics drift alike in both their parts, so their noise is the same in every turn."""
    fine, coarse = (fed(ExactEstimator(EstimatorSettings(), PERIOD_S), np.arange(0.0, 20.0, 0.1)) for _ in range(2))
    for time_s in 20.0 + np.cumsum(np.random.default_rng(1).uniform(0.01, 0.3, 60)):
        fine.observe(time_s, None)
    coarse.observe(time_s, None)
    assert fine.state_w == pytest.approx(coarse.state_w, abs=ROUNDING)
    assert fine._covariance == pytest.approx(coarse._covariance, abs=ROUNDING)


@pytest.mark.parametrize("seed", range(5))
def test_the_covariance_stays_symmetric_and_positive(seed):
    rng = np.random.default_rng(seed)
    estimator = ExactEstimator(EstimatorSettings(gate_w=0.3), PERIOD_S)
    time_s = 0.0
    for _ in range(1500):
        time_s += rng.choice([1e-4, 0.01, 0.1, 5.0])
        estimator.observe(time_s, None if rng.random() < 0.2 else signal_w(time_s) + rng.normal(0.0, 0.5))
        assert np.array_equal(estimator._covariance, estimator._covariance.T) or np.allclose(
            estimator._covariance, estimator._covariance.T, rtol=0, atol=ROUNDING
        )
        assert np.linalg.eigvalsh(estimator._covariance).min() > 0


def process_noise(settings, step_s, order=3):
    drift = [settings.level_drift_w_per_sqrt_s] + [settings.harmonic_drift_w_per_sqrt_s] * (2 * order)
    return np.diag(np.square(drift)) * step_s


@pytest.mark.parametrize("reading", ["within the gate", "missing"])
def test_where_it_only_predicts_the_covariance_grows_by_the_process_noise(reading):
    settings = EstimatorSettings(gate_w=0.5)
    estimator = fed(ExactEstimator(settings, PERIOD_S), np.arange(0.0, 30.0, 0.1))
    state, covariance, step_s = estimator.state_w.copy(), estimator._covariance.copy(), 0.4
    turn = expm(system_matrix(3, PERIOD_S) * step_s)
    expected_w = float(output_row(3) @ turn @ state)
    value = estimator.observe(29.9 + step_s, None if reading == "missing" else expected_w + 0.49)
    assert value == pytest.approx(expected_w, abs=ROUNDING)
    assert estimator.state_w == pytest.approx(turn @ state, abs=ROUNDING)
    grown = turn @ covariance @ turn.T + process_noise(settings, step_s)
    assert estimator._covariance == pytest.approx(grown, abs=ROUNDING)
    assert np.trace(estimator._covariance) > np.trace(covariance)


def test_a_reading_outside_the_gate_corrects():
    settings = EstimatorSettings(gate_w=0.5)
    estimator = fed(ExactEstimator(settings, PERIOD_S), np.arange(0.0, 30.0, 0.1))
    before = np.trace(estimator._covariance)
    expected_w = estimator.observe(30.0, estimator.forecast(np.array([0.1]))[0] + 0.51)
    assert estimator.forecast(np.zeros(1))[0] > expected_w
    assert np.trace(estimator._covariance) < before + np.trace(process_noise(settings, 0.1))


def test_an_update_is_the_textbook_one():
    """Against (I − KC) P with K from the innovation's variance, which the Joseph form must equal."""
    settings = EstimatorSettings()
    estimator = fed(ExactEstimator(settings, PERIOD_S), [0.0, 0.3, 1.1])
    turn, row = expm(system_matrix(3, PERIOD_S) * 0.6), output_row(3)
    predicted = turn @ estimator._covariance @ turn.T + process_noise(settings, 0.6)
    gain = predicted @ row / (row @ predicted @ row + settings.noise_w**2)
    state = turn @ estimator.state_w
    state = state + gain * (40.0 - row @ state)
    estimator.observe(1.7, 40.0)
    assert estimator.state_w == pytest.approx(state, abs=ROUNDING)
    assert estimator._covariance == pytest.approx((np.eye(7) - np.outer(gain, row)) @ predicted, abs=1e-7)


def test_it_starts_from_the_first_reading_in_the_mean():
    estimator = ExactEstimator(EstimatorSettings(), PERIOD_S)
    estimator.observe(0.0, None)
    assert estimator.state_w == pytest.approx(np.zeros(7))
    estimator = ExactEstimator(EstimatorSettings(), PERIOD_S)
    assert estimator.observe(0.0, 33.0) == pytest.approx(33.0)
    assert estimator.state_w == pytest.approx([33.0, 0, 0, 0, 0, 0, 0])


def test_a_known_state_is_kept():
    estimator = ExactEstimator(EstimatorSettings(), PERIOD_S, STATE_W)
    assert estimator.observe(0.0, None) == pytest.approx(signal_w(0.0))
    assert estimator.state_w == pytest.approx(STATE_W)


def test_without_a_period_the_forecast_is_the_mean():
    estimator = ExactEstimator(EstimatorSettings(), None)
    for time_s in np.arange(0.0, 20.0, 0.1):
        estimator.observe(time_s, 30.0)
    assert estimator.state_w == pytest.approx([30.0])
    assert estimator.forecast(np.array([0.0, 7.0, 100.0])) == pytest.approx(np.full(3, 30.0))


def test_laps_give_the_period_the_first_apart():
    estimator = ExactEstimator(EstimatorSettings(), PERIOD_S)
    estimator.lap(30.0)
    assert estimator.period_s == PERIOD_S
    estimator.lap(75.5)
    assert estimator.period_s == pytest.approx(45.5)


def test_a_new_period_turns_faster_at_once():
    """The step's matrix and the forecast's table follow the period."""
    estimator = ExactEstimator(EstimatorSettings(), PERIOD_S, STATE_W)
    ahead = np.linspace(0.0, 20.0, 50)
    assert estimator.forecast(ahead) == pytest.approx(forecast_w(STATE_W, PERIOD_S, ahead), abs=ROUNDING)
    estimator.observe(0.0, None)
    estimator.observe(1.0, None)
    estimator.lap(1.0)
    estimator.lap(24.0)
    assert estimator.period_s == pytest.approx(23.0)
    before = estimator.state_w
    estimator.observe(2.0, None)
    after = expm(system_matrix(3, 23.0)) @ before
    assert estimator.state_w == pytest.approx(after, abs=ROUNDING)
    assert estimator.forecast(ahead) == pytest.approx(forecast_w(after, 23.0, ahead), abs=ROUNDING)
    assert estimator.forecast(ahead[:7]) == pytest.approx(forecast_w(after, 23.0, ahead[:7]), abs=ROUNDING)


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


@pytest.mark.parametrize("order", [0, 1, 3])
def test_the_published_filter_is_its_transcription(order):
    """Step by step at 100 Hz over two laps, readings missing here and there."""
    rng = np.random.default_rng(order)
    estimator, matrices = PublishedEstimator(EstimatorSettings(order=order)), Transcribed(order)
    clock_s, period_s = 0.0, 1.0
    for i in range(1, 4001):
        time_s = i * 0.01
        if i in (1300, 2700):  # a lap ends: the period is its time, and the clock restarts
            estimator.lap(time_s)
            period_s, clock_s = time_s - clock_s, time_s
        period_s = max(period_s, time_s - clock_s)
        motion_w = None if rng.random() < 0.05 else signal_w(time_s) + rng.normal(0.0, 0.2)
        expected_w = matrices.observe(time_s, motion_w, period_s)
        assert estimator.observe(time_s, motion_w) == pytest.approx(expected_w, abs=1e-8)
        assert estimator.state_w == pytest.approx(matrices.q, abs=1e-8)
    assert estimator.period_s == pytest.approx(period_s)


def test_the_published_forecast_is_exact_from_its_state():
    estimator = PublishedEstimator(EstimatorSettings())
    for i in range(1, 501):
        estimator.observe(i * 0.01, float(signal_w(i * 0.01)))
    ahead = np.array([0.0, 1.0, 2.5])
    state = [expm(system_matrix(3, estimator.period_s) * t) @ estimator.state_w for t in ahead]
    assert estimator.forecast(ahead) == pytest.approx([output_row(3) @ q for q in state], abs=ROUNDING)


def test_the_clock_grows_with_a_lap_longer_than_the_last():
    clock = LapClock(1.0)
    assert clock.tick(0.5) == 1.0
    assert clock.tick(40.0) == 40.0
    clock.lap(46.0)
    assert clock.period_s == 46.0
    assert clock.tick(80.0) == 46.0
    assert clock.tick(93.0) == 47.0
    clock.lap(93.5)
    assert clock.laps == [46.0, 47.5]
