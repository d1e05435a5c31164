"""Headings that contradict the ground velocity are disbelieved; true ones in wind and gusts are not."""

import math

import numpy as np
import pytest
from common import few

from eadp.core.flight import WindFilter, WindReadings
from eadp.planning.state.wind import RESTORE_S, HeadingGate

LAP_S = 60.0
"""Two lines of 22 s and two half circles of 8 s."""


def flown(
    seed,
    duration_s=900,
    step_s=1.0,
    offset_deg=0.0,
    noise_deg=0.0,
    gust_mps=1.0,
    wind_mps=5.0,
    turn=True,
    first_rad=None,
):
    """Ground velocity, heading and airspeed of an aircraft that flies laps by crabbing, in gusts.

    The heading of a course follows from the wind triangle; gusts are an Ornstein-Uhlenbeck process of 5 s.
    """
    rng = np.random.default_rng(seed)
    count = int(duration_s / step_s)
    times = step_s * np.arange(1, count + 1)
    airspeed = rng.uniform(11, 20)
    phase = times % LAP_S
    first = rng.uniform(-math.pi, math.pi)
    first = first if first_rad is None else first_rad
    side = rng.choice([-1, 1])
    course = first + side * math.pi * (
        np.clip((phase - 22) / 8, 0, 1) + np.clip((phase - 52) / 8, 0, 1) if turn else np.zeros(count)
    )
    wind = wind_mps * np.exp(1j * rng.uniform(-math.pi, math.pi))
    gusts = np.zeros(count, dtype=complex)
    fade = math.exp(-step_s / 5.0)
    for k in range(1, count):
        gusts[k] = fade * gusts[k - 1] + gust_mps * math.sqrt(1 - fade**2) * complex(*rng.normal(size=2))
    # the nose points so that the mean wind's part across the course cancels
    across = np.imag(wind * np.exp(-1j * course))
    theta = course - np.arcsin(np.clip(across / airspeed, -0.95, 0.95))
    v = airspeed * np.exp(1j * theta) + wind + gusts
    heading = theta + np.radians(offset_deg) + np.radians(noise_deg) * rng.normal(size=count)
    return v, heading, airspeed


def disbelieved_at(v, headings, airspeed, batch=1, step_s=1.0, gate=None):
    """Time at which headings are disbelieved first [s]; None for never."""
    gate = gate or HeadingGate()
    for k in range(0, len(v), batch):
        part = slice(k, k + batch)
        count = len(v[part])
        readings = WindReadings(v.real[part], v.imag[part], headings[part], [step_s] * count, [airspeed] * count)
        gate.ingest(readings, WindFilter())
        if gate.disbelieved:
            return k * step_s
    return None


@pytest.mark.parametrize("seed", few(range(12), 4))
def test_true_headings_are_never_disbelieved(seed):
    rng = np.random.default_rng(1000 + seed)
    v, heading, airspeed = flown(
        seed,
        offset_deg=rng.uniform(-15, 15),
        noise_deg=rng.uniform(0, 5),
        gust_mps=rng.uniform(0, 3),
        wind_mps=rng.uniform(0, 8),
    )
    assert disbelieved_at(v, heading, airspeed * rng.uniform(0.9, 1.1)) is None


WRONG = {
    "mathematical": lambda heading: math.pi / 2 - heading,
    "frozen": lambda heading: np.full(len(heading), heading[0]),
    "reversed": lambda heading: heading + math.pi,
    "of another axis": lambda heading: heading + math.pi / 2,
}


@pytest.mark.parametrize("what", WRONG)
@pytest.mark.parametrize("seed", few(range(3), 1))
def test_wrong_headings_are_disbelieved_within_two_laps(seed, what):
    # lines to the north-east and south-west are left out: both angles are nearly the same there
    v, heading, airspeed = flown(seed, gust_mps=1.5, noise_deg=2.0, first_rad=math.radians(6 * seed - 30))
    assert disbelieved_at(v, WRONG[what](heading), airspeed) <= 2 * LAP_S


def test_a_heading_that_implies_a_wind_no_aircraft_flies_in_is_disbelieved_without_a_turn():
    v, heading, airspeed = flown(0, gust_mps=0.5, wind_mps=1.0, turn=False)
    assert disbelieved_at(v, heading, airspeed) is None
    assert disbelieved_at(v, heading + math.pi, airspeed) < LAP_S


def test_a_heading_is_believed_again_when_it_has_fitted_for_long():
    v, heading, airspeed = flown(1, noise_deg=2.0)
    gate = HeadingGate()
    assert disbelieved_at(v, heading + math.pi / 2, airspeed, gate=gate) is not None
    for k in range(len(v)):
        readings = WindReadings([v.real[k]], [v.imag[k]], [heading[k]], [1.0], [airspeed])
        headings = gate.ingest(readings, WindFilter()).headings_rad
        if not gate.disbelieved:
            break
        assert math.isnan(headings[0])
    assert RESTORE_S <= k < RESTORE_S + 6 * LAP_S
    assert headings == [heading[k]]


def test_batches_make_no_difference():
    v, heading, airspeed = flown(2, step_s=0.1, duration_s=300)
    times = [disbelieved_at(v, math.pi / 2 - heading, airspeed, batch, 0.1) for batch in (1, 50)]
    assert times[0] == pytest.approx(times[1], abs=5.0)


def test_what_is_not_measured_is_no_evidence():
    gate = HeadingGate()
    nothing = [math.nan] * 40
    for velocity, headings in ((nothing, [0.0] * 40), ([15.0] * 40, nothing)):
        readings = WindReadings(velocity, velocity, headings, [1.0] * 40, [15.0] * 40)
        assert gate.ingest(readings, WindFilter()) is readings
    assert not gate.disbelieved


def test_the_wind_starts_again_without_headings():
    v, heading, airspeed = flown(3, gust_mps=0.5, wind_mps=6.0)
    gate, wind = HeadingGate(), WindFilter()
    for k in range(len(v)):
        one = WindReadings([v.real[k]], [v.imag[k]], [math.pi / 2 - heading[k]], [1.0], [airspeed])
        wind.ingest(gate.ingest(one, wind))
    true = np.mean(v - airspeed * np.exp(1j * heading))
    assert math.dist(wind.wind_mps, (true.real, true.imag)) < 1.0
