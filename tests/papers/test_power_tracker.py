"""The power of a flight: as an estimator that takes all as it comes has it, whenever it is asked."""

import numpy as np
import pytest
from common import ROOT, few
from common.observations import observation

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.models.battery import Battery
from eadp.models.computing import join_profile
from eadp.models.profile import Profile
from eadp.models.vehicle import FixedWing
from eadp.models.world import Mission
from eadp.papers.estimator import EstimatorSettings
from eadp.papers.power import PowerTracker, _estimator
from eadp.planning.base import Readings
from eadp.planning.state.flight_state import FlightState

ROUNDING = 1e-9
LAP_S, EVERY_S = 11.3, 0.1
PLAN, _ = read_plan(read_text(str(ROOT / "plans/survey.plan")))
PROFILE = Profile(("fps",), ("",), np.array([[2.0], [10.0]]), np.array([4.75376, 9.75462]))
MISSION = Mission(PLAN, join_profile(PLAN, PROFILE), Battery(), FixedWing(), (0.0, 10.0), (-100.0, 220.0))
KINDS = [EstimatorSettings(), EstimatorSettings(kind="published")]


def readings(times_s, powers_w):
    """A batch of readings of the power."""
    others = np.zeros((5, len(times_s)))
    return Readings(np.array(times_s, dtype=float), np.array(powers_w, dtype=float), *others)


def seen(time_s, power_w, started=1, fps=10.0):
    return observation(PLAN, (0.0, fps), time_s, 0.0, 0.0, started=started, power_w=power_w)


class Waiting(PowerTracker):
    """The power of a flight, which takes what its state takes."""

    def __init__(self, settings=KINDS[0], horizon_s=None):
        super().__init__(settings, MISSION, horizon_s)
        self.state = FlightState(MISSION)

    def observe(self, o):
        self.take(self.state.observe(o))

    def ingest(self, readings):
        self.state.ingest(readings)
        self.take(readings)


def computing_w(fps):
    return float(np.interp(fps, [2.0, 10.0], [4.75376, 9.75462]))


def story(seed=0):
    """Readings, some of them missing, stages, laps of four of them, and steps of the level: a kind and its values."""
    rng = np.random.default_rng(seed)
    next_s, started = LAP_S / 4, 1
    for k in range(1, 900):
        time_s, fps = EVERY_S * k, 10.0 if k < 400 else 6.0
        if k in (300, 610):
            yield "shift", time_s, -1.5, started, fps
        power_w = 30 + 2 * np.cos(2 * np.pi * time_s / LAP_S) + rng.normal(0.0, 0.3)
        power_w = None if rng.random() < 0.03 else power_w
        if time_s > next_s:
            started, next_s = started + 1, next_s + LAP_S / 4 + rng.normal(0.0, 0.05)
            yield "stage", time_s, power_w, started, fps
        else:
            yield "reading", time_s, power_w, started, fps


@pytest.mark.parametrize("settings", KINDS, ids=lambda settings: settings.kind)
@pytest.mark.parametrize("asked_every", few([1, 7, 250], 2))
def test_it_answers_as_one_that_does_not_wait(settings, asked_every):
    eager, waiting = _estimator(settings, MISSION), Waiting(settings, 20.0)
    forecast_w, expected = 0.0, {}

    def ask():
        forecasts_w, estimates = waiting.estimates([*expected])
        for found_w, one, (known_w, other) in zip(forecasts_w, estimates, expected.values(), strict=True):
            assert found_w == pytest.approx(known_w, abs=ROUNDING)
            assert (one.time_s, one.horizon_s) == (other.time_s, 20.0)
            assert one.period_s == pytest.approx(other.period_s, abs=ROUNDING)
            assert one.state == pytest.approx(other.state, abs=1e-6)
        expected.clear()

    laps, last_fps = 0, 10.0
    for n, (kind, time_s, power_w, started, fps) in enumerate(story()):
        if kind == "shift":
            if expected:
                ask()
            eager.shift_level(power_w)
            waiting.shift_level(power_w)
            continue
        if kind == "stage" or fps != last_fps or n == 0:
            if kind == "stage" and expected:
                ask()
            if kind == "stage" and started % 4 == 1:
                eager.end_lap(time_s)
                laps += 1
            waiting.observe(seen(time_s, power_w, started, fps))
        else:
            waiting.ingest(readings([time_s], [power_w]))
        last_fps, own_w = fps, computing_w(fps)
        forecast_w = own_w + eager.observe(time_s, None if power_w is None else power_w - own_w)
        expected[time_s + 0.01] = (forecast_w, eager.estimate(own_w, 20.0))
        if settings.kind == "exact":  # the other's period is an answer, too
            assert waiting.period_s == pytest.approx(eager.period_s, abs=ROUNDING)
        if n % asked_every == asked_every - 1:
            ask()
    assert waiting.laps == laps > 5
    assert waiting.estimator.state_w == pytest.approx(eager.state_w, abs=1e-6)
    assert waiting.computing_w == pytest.approx(computing_w(6.0))


@pytest.mark.parametrize("settings", KINDS, ids=lambda settings: settings.kind)
def test_a_batch_is_its_readings_one_by_one(settings):
    times_s = np.arange(0.1, 4.0, 0.1)
    powers_w = [None if k in (0, 7, 8) else 30.0 + np.sin(time_s) for k, time_s in enumerate(times_s)]
    together, apart = Waiting(settings), _estimator(settings, MISSION)
    together.ingest(readings(times_s.tolist(), powers_w))
    for time_s, reading in zip(times_s.tolist(), powers_w, strict=True):
        expected_w = apart.observe(time_s, reading)
    assert together.estimates([4.0])[0] == pytest.approx([expected_w], abs=ROUNDING)
    assert together.estimator.state_w == pytest.approx(apart.state_w, abs=ROUNDING)


@pytest.mark.parametrize("false_w", [1e5, np.inf, np.nan])
def test_what_nothing_delivers_is_no_reading(false_w):
    one, other = Waiting(), Waiting()
    for k in range(1, 200):
        one.observe(seen(0.1 * k, 40.0))
        other.observe(seen(0.1 * k, false_w if 100 < k < 150 else 40.0))
    assert other.estimator.state_w == pytest.approx(one.estimator.state_w, abs=1e-2)


def test_a_lap_ends_once_however_often_it_is_asked_before_its_reading():
    once, often = (Waiting(horizon_s=6.0) for _ in range(2))
    for state in (once, often):
        for k in range(9):
            state.observe(seen(10.0 * k, 40.0, started=4 * k + 1))
            if state is often:
                for instant_s in (10.0 * k - 5, 10.0 * k - 4):
                    state.estimates([instant_s])
    assert often.estimator.state_w == pytest.approx(once.estimator.state_w, abs=ROUNDING)
    assert often.estimator.period_s == once.estimator.period_s == 10.0
