"""Deferred readings and laps: the answers are those of an estimator that takes them as they come, whenever asked."""

from __future__ import annotations

import numpy as np
import pytest

from eadp.planning.estimation import deferred
from eadp.planning.estimation.deferred import DeferredEstimator
from eadp.planning.estimation.estimator import EstimatorSettings, ExactEstimator, PublishedEstimator

ROUNDING = 1e-9
LAP_S, EVERY_S = 11.3, 0.1


def exact():
    return ExactEstimator(EstimatorSettings(), 10.0)


def published():
    return PublishedEstimator(EstimatorSettings())


def story(seed=0):
    """Readings, some of them missing, laps, and steps of the level, in order: a kind, a time [s], a value."""
    rng = np.random.default_rng(seed)
    lap_at, after = 3.0, "start_lap"
    for k in range(1, 900):
        time_s = EVERY_S * k
        if time_s > lap_at:
            yield after, time_s - 0.03, None
            lap_at, after = lap_at + LAP_S + rng.normal(0.0, 0.2), "lap"
        if k in (300, 610):
            yield "shift_level", time_s - 0.02, -1.5
        power_w = 30 + 2 * np.cos(2 * np.pi * time_s / LAP_S) + rng.normal(0.0, 0.3)
        yield "observe", time_s, None if rng.random() < 0.03 else power_w


def beside_w(time_s):
    """Power of the computations."""
    return 5.0 if time_s < 40 else 9.0


@pytest.mark.parametrize("make", [exact, published])
@pytest.mark.parametrize("asked_every", [1, 7, 250])
def test_it_answers_as_one_that_does_not_wait(make, asked_every):
    eager, waiting = make(), DeferredEstimator(make())
    forecast_w, expected = 0.0, {}

    def ask():
        """At all instants since the last time, at none after a lap or a step of the level."""
        forecasts_w, estimates = waiting.estimates([*expected], 3.0, lambda period_s: 2 * (period_s or 30.0))
        for found_w, one, (known_w, other) in zip(forecasts_w, estimates, expected.values(), strict=True):
            assert found_w == pytest.approx(known_w, abs=ROUNDING)
            assert (one.time_s, one.computing_w) == (other.time_s, 3.0)
            assert one.period_s == pytest.approx(other.period_s, abs=ROUNDING)
            assert one.disturbance_s == pytest.approx(other.disturbance_s, rel=1e-6)
            assert one.horizon_s == 2 * one.period_s
            assert one.state == pytest.approx(other.state, abs=1e-6)
        expected.clear()

    for n, (kind, time_s, value) in enumerate(story()):
        if kind == "observe":
            computing_w = beside_w(time_s)
            forecast_w = computing_w + eager.observe(time_s, None if value is None else value - computing_w)
            waiting.observe([time_s], [value], computing_w)
            expected[time_s + 0.01] = (forecast_w, eager.estimate(3.0, 0.0))
        else:
            if expected:
                ask()
            for estimator in (eager, waiting):
                getattr(estimator, kind)(*([time_s] if value is None else [value]))
        if make is exact:  # the other's period is an answer, too
            assert waiting.period_s == pytest.approx(eager.period_s, abs=ROUNDING)
        if n % asked_every == asked_every - 1 and expected:
            ask()
    assert waiting.now.state_w == pytest.approx(eager.state_w, abs=1e-6)
    ahead_s = np.array([0.0, 3.0])
    assert waiting.now.forecast(ahead_s) == pytest.approx(eager.forecast(ahead_s), abs=1e-6)


@pytest.mark.parametrize("make", [exact, published])
@pytest.mark.parametrize("most_waiting", [40, 10_000])
def test_laps_and_steps_of_the_level_wait_for_their_turn(make, most_waiting, monkeypatch):
    monkeypatch.setattr(deferred, "MOST_WAITING", most_waiting)
    eager, waiting = make(), DeferredEstimator(make())
    for kind, time_s, value in story(1):
        if kind == "observe":
            eager.observe(time_s, value)
            waiting.observe([time_s], [value], 0.0)
        else:
            for estimator in (eager, waiting):
                getattr(estimator, kind)(*([time_s] if value is None else [value]))
    assert len(waiting._waiting) <= most_waiting
    assert waiting.now.state_w == pytest.approx(eager.state_w, abs=1e-6)
    assert waiting.period_s == pytest.approx(eager.period_s, abs=ROUNDING)


def test_before_any_reading_there_is_an_estimate_all_the_same():
    forecasts_w, (estimate,) = DeferredEstimator(exact()).estimates([0.05], 4.0, lambda _: 6.0)
    assert forecasts_w == [0.0]
    assert (estimate.period_s, estimate.computing_w, estimate.horizon_s) == (10.0, 4.0, 6.0)


@pytest.mark.parametrize("make", [exact, published])
def test_a_batch_is_its_readings_one_by_one(make):
    times_s = np.arange(0.1, 4.0, 0.1)
    readings = [None if k in (0, 7, 8) else 30.0 + np.sin(time_s) for k, time_s in enumerate(times_s)]
    together, apart = DeferredEstimator(make()), make()
    together.observe(times_s, readings, 0.0)
    for time_s, reading in zip(times_s.tolist(), readings, strict=True):
        expected_w = apart.observe(time_s, reading)
    forecasts_w, _ = together.estimates([4.0], 0.0, lambda _: 0.0)
    assert forecasts_w == pytest.approx([expected_w], abs=ROUNDING)
    assert together.now.state_w == pytest.approx(apart.state_w, abs=ROUNDING)


def test_an_instant_has_the_last_reading_before_it():
    waiting = DeferredEstimator(exact())
    waiting.observe([1.0, 1.1, 1.2, 1.3], [30.0] * 4, 0.0)
    _, estimates = waiting.estimates([0.9, 1.0, 1.15, 1.2, 9.0], 0.0, lambda _: 0.0)
    assert [one.time_s for one in estimates] == [0.0, 1.0, 1.1, 1.2, 1.3]
    assert waiting.estimates([9.5], 0.0, lambda _: 0.0)[1][0].time_s == 1.3


def test_instants_among_the_last_readings_keep_theirs_where_too_many_wait(monkeypatch):
    monkeypatch.setattr(deferred, "MOST_WAITING", 1)
    waiting = DeferredEstimator(exact())
    waiting.observe([0.1, 0.2, 0.3], [30.0] * 3, 0.0)
    waiting.observe([1.0, 1.1, 1.2, 1.3], [30.0] * 4, 0.0)
    _, estimates = waiting.estimates([1.05, 1.25], 0.0, lambda _: 0.0)
    assert [one.time_s for one in estimates] == [1.0, 1.2]


def test_where_it_is_not_asked_nothing_is_processed(monkeypatch):
    estimator = exact()
    monkeypatch.setattr(ExactEstimator, "observe", lambda *_: pytest.fail("processed"))
    waiting = DeferredEstimator(estimator)
    waiting.start_lap(0.0)
    waiting.observe([1.0, 1.1], [30.0, 31.0], 5.0)
    waiting.lap(12.5)
    assert waiting.period_s == 12.5
