"""The power of an aeroplane from a log: closed forms, standard errors in gusts, what is missing."""

import math

import numpy as np
import pytest

from eadp.errors import Infeasible
from eadp.measure.vehicle import fit_power

# P = 0.016 V³ + 140 (1 + tan² φ)/V + 4 + 38 (ḣ + V V̇/g), the motor never below 4 W
PARASITIC, INDUCED, AVIONICS, CLIMB = 0.016, 140.0, 4.0, 38.0


def flight(speeds=(12.0, 14.0, 16.0, 18.0), bank_deg=35.0, gust_w=0.0, seed=0, minutes=4):
    """A log of 5 Hz: at each airspeed level flight, a turn, a climb and a glide."""
    rng = np.random.default_rng(seed)
    n = 300 * minutes
    speed = np.repeat(speeds, n).astype(float)
    part = np.tile(np.repeat([0, 1, 2, 3], n // 4), len(speeds))
    bank = np.where(part == 1, math.radians(bank_deg), 0.0)
    climb = np.select([part == 2, part == 3], [2.0, -3.0], 0.0)
    t = np.arange(len(speed)) / 5
    speed += 0.2 * np.sin(t / 9)
    rise = climb + np.gradient(speed**2, t) / (2 * 9.80665)
    power = PARASITIC * speed**3 + INDUCED * (1 + np.tan(bank) ** 2) / speed + AVIONICS + CLIMB * rise
    gusts = rng.standard_normal(len(t))
    for i in range(1, len(t)):  # correlated over 7 s
        gusts[i] = 0.972 * gusts[i - 1] + 0.235 * gusts[i]
    return t, np.maximum(power + gust_w * gusts, AVIONICS), speed, bank, climb


def level_w(speed):
    return PARASITIC * speed**3 + INDUCED / speed + AVIONICS


def test_a_column_without_readings_is_none():
    t, power, speed, bank, climb = flight()
    empty = np.full_like(t, np.nan)
    assert fit_power(t, power, speed, empty, climb) == fit_power(t, power, speed, None, climb)
    assert fit_power(t, power, speed, bank, empty) == fit_power(t, power, speed, bank, None)


@pytest.mark.parametrize("constant_w", [None, AVIONICS])
def test_the_closed_form_is_recovered(constant_w):
    fit = fit_power(*flight(), constant_w=constant_w)
    assert fit.polar
    for speed in (12, 15, 18):
        assert fit.level_power_w(speed) == pytest.approx(level_w(speed), rel=2e-3)
    assert fit.bank_w == pytest.approx(INDUCED / fit.airspeed_mps, rel=0.01)
    assert fit.climb_w_per_mps == pytest.approx(CLIMB, rel=0.01)
    assert fit.constant_w == pytest.approx(AVIONICS, abs=0.5)
    assert fit.idle > 0
    assert fit.notes == ()


def test_standard_errors_hold_in_gusts():
    fits = [fit_power(*flight(gust_w=6.0, seed=seed), constant_w=AVIONICS) for seed in range(24)]
    z = [(fit.level_power_w(fit.airspeed_mps) - level_w(fit.airspeed_mps)) / fit.stds["level_w"] for fit in fits]
    turns = [(fit.induced_w - INDUCED / fit.airspeed_mps) / fit.stds["induced_w"] for fit in fits]
    for errors in (z, turns):
        assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.6
        assert abs(np.mean(errors)) < 0.8


def test_one_airspeed_gives_the_power_at_it():
    t, power, speed, bank, climb = flight(speeds=(15.0,), minutes=12)
    fit = fit_power(t, power, speed, bank, climb)
    assert not fit.polar
    assert fit.level_power_w(fit.airspeed_mps) == pytest.approx(level_w(15.0), rel=0.01)
    assert fit.bank_w == pytest.approx(INDUCED / 15, rel=0.1)
    assert fit.climb_w_per_mps == pytest.approx(CLIMB, rel=0.03)
    assert "the drag polar: airspeeds from 14.8 to 15.2 m/s" in fit.notes[0]


def test_an_uncertain_rise_is_not_claimed():
    t, power, speed, bank, climb = flight(speeds=(15.0,), bank_deg=12.0, gust_w=12.0)
    fit = fit_power(t, power, speed, bank, climb)
    assert fit.bank_w is None
    assert any("tan² of the bank" in note and "too uncertain" in note for note in fit.notes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v: np.where(np.arange(len(v)) < 15, v, np.nan), "15 readings in flight"),
        (lambda v: np.where(np.arange(len(v)) < 300, v, 0.0), "12 windows of 5 s"),
        (lambda v: 0 * v, "0 readings in flight"),
    ],
)
def test_too_little_flight(change, words):
    t, power, speed, bank, climb = flight()
    with pytest.raises(Infeasible, match=words):
        fit_power(t, power, change(speed), bank, climb)


def test_a_log_that_glides_alone():
    t, power, speed, bank, climb = flight()
    with pytest.raises(Infeasible, match="0 windows with the motor running"):
        fit_power(t, power, speed, bank, climb - 5)
