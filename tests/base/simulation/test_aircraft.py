"""The aircraft: against a transcription of the published step, and against physics where it claims any."""

import math

import numpy as np
import pytest

from eadp.core.expressions.derivatives import bind
from eadp.core.expressions.reader import read_expression
from eadp.models.vehicle import Guidance, PaperVehicle
from eadp.models.weather import Wind
from eadp.simulation.aircraft import (
    ALTITUDE,
    GUST_X,
    GUST_Y,
    HEADING,
    NOISE_LEFT,
    X,
    Y,
    advance_gust,
    constants_of,
    fly_step,
    state_of,
)

LINE = bind(read_expression("x"), {})
CIRCLE = bind(read_expression("x^2+y^2-75^2"), {})
STILL = (0.0, 0.0)


def fly(path, gain, sense, wind, start, heading, seconds, vehicle=None, guidance=None, step_s=0.01):
    vehicle = vehicle or PaperVehicle()
    s = state_of(vehicle, wind, start, math.radians(heading), 25.0)
    c = constants_of(vehicle, guidance or Guidance(), Wind(), step_s)
    track, power = [], []
    for _ in range(round(seconds / step_s)):
        power.append(fly_step(s, c, path(s[X], s[Y]), gain, sense, *wind))
        track.append((s[X], s[Y]))
    return np.array(track), np.array(power), s


def test_one_step_is_the_published_one():
    """The letter's step with matrices, from 20 m altitude, off its path, in wind that lifts."""
    wind = np.array([5.0, 0.0])
    vehicle = PaperVehicle(wind_in_lift=True)
    s = state_of(vehicle, tuple(wind), (-100.0, 220.0), math.radians(270), 20.0)
    c = constants_of(vehicle, Guidance(-0.001, False), Wind(), 0.01)
    power = fly_step(s, c, CIRCLE(-100.0, 220.0), 0.006, 1, *wind)

    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    p, theta = np.array([-100.0, 220.0]), math.radians(270)
    velocity = 15 * np.array([math.cos(theta), math.sin(theta)]) + wind
    phi, gradient, hessian = p @ p - 75**2, 2 * p, 2 * np.eye(2)
    desired = turn @ gradient - 0.006 * phi * gradient
    rate = (turn - 0.006 * phi * np.eye(2)) @ hessian @ velocity - 0.006 * (gradient @ velocity) * gradient
    size = np.linalg.norm(desired)
    hat = -turn @ np.outer(desired, desired) @ turn @ rate / size**3
    u = hat @ turn @ desired / size - (-0.001) * (velocity @ turn @ desired) / (np.linalg.norm(velocity) * size)
    throttle = 5 * (25 - 20)
    lift_speed = 0.3 * (50 + throttle) + wind @ [math.cos(theta), math.sin(theta)]
    climb = (9.8 / 225 * lift_speed**2 - 9.8) * 0.01
    velocity = 0.3 * (50 + throttle) * np.array([math.cos(theta), math.sin(theta)]) + wind
    assert (s[X], s[Y]) == pytest.approx(tuple(p + velocity * 0.01), abs=1e-12)
    assert s[ALTITUDE] == pytest.approx(20 + climb * 0.01, abs=1e-12)
    assert math.remainder(s[HEADING] - (theta + u * 0.01), 2 * math.pi) == pytest.approx(0, abs=1e-12)
    assert power == pytest.approx(20 * (50 + throttle) / 100 + 16, abs=1e-12)


def test_level_flight_costs_the_cruise_power_whatever_the_wind():
    for wind in ((0.0, 0.0), (5.0, 0.0), (-3.0, 4.0)):
        _, power, s = fly(LINE, 0.1, 1, wind, (0.0, 0.0), 90, 20)
        assert np.ptp(power[500:]) < 1e-6, "airspeed is the throttle's alone: the wind changes no power"
        assert power[-1] == pytest.approx(26.0)
        assert s[ALTITUDE] == pytest.approx(25.0, abs=1e-6)


def test_a_tailwind_lifts_only_where_that_is_asked_for():
    _, power, _ = fly(LINE, 0.1, 1, (0.0, 5.0), (0.0, 0.0), 90, 60, vehicle=PaperVehicle(wind_in_lift=True))
    # lift balances the weight at 15 m/s, of which the wind gives 5: the throttle's share is 10 m/s, 33.3 of 100
    assert power[-1] == pytest.approx(16 + 20 * (10 / 0.3) / 100, abs=1e-3)


@pytest.mark.parametrize("wind", [(0.0, 0.0), (5.0, 0.0), (0.0, -8.0)])
@pytest.mark.parametrize(
    ("path", "gain", "sense", "start"), [(LINE, 0.1, -1, (30.0, 0.0)), (CIRCLE, 0.006, 1, (100.0, 0.0))]
)
def test_the_path_is_followed_in_wind(wind, path, gain, sense, start):
    track, _, _ = fly(path, gain, sense, wind, start, 90, 60)
    off = [abs(path(x, y)[0]) / math.hypot(*path(x, y)[1:3]) for x, y in track[-1500:]]
    assert max(off) < 0.5


@pytest.mark.parametrize("turns", [-3, -1, 0, 1, 2])
@pytest.mark.parametrize("heading", [-3.14, -0.5, 0.0, 3.0, math.pi])
def test_a_heading_stays_within_a_turn(heading, turns):
    s = state_of(PaperVehicle(), STILL, (0.0, 0.0), heading + 2 * math.pi * turns, 25.0)
    fly_step(s, constants_of(PaperVehicle(), Guidance(), Wind(), 0.01), CIRCLE(0.0, 0.0), 0.006, 1, 0.0, 0.0)
    assert -math.pi <= s[HEADING] <= math.pi
    assert abs(math.remainder(s[HEADING] - heading, 2 * math.pi)) < 1e-14 * (1 + abs(turns))


def test_a_smaller_step_flies_the_same_path():
    coarse, _, _ = fly(CIRCLE, 0.006, 1, (3.0, 0.0), (100.0, 0.0), 90, 30, step_s=0.01)
    fine, _, _ = fly(CIRCLE, 0.006, 1, (3.0, 0.0), (100.0, 0.0), 90, 30, step_s=0.001)
    assert np.hypot(*(coarse[-1] - fine[-1])) < 1.0


@pytest.mark.slow
def test_gusts_have_their_spread_and_their_time():
    wind = Wind(4.0, 180.0, gust_std_mps=1.5, gust_time_s=2.0)
    s, c = state_of(PaperVehicle(), STILL, (0.0, 0.0), 0.0, 25.0), constants_of(PaperVehicle(), Guidance(), wind, 0.1)
    count = 200_000
    noise = np.random.default_rng(3).standard_normal(2 * count).tolist()
    s[NOISE_LEFT] = len(noise)
    samples = np.empty((count, 2))
    for row in samples:
        advance_gust(s, c, noise)
        row[:] = s[GUST_X], s[GUST_Y]
    assert s[NOISE_LEFT] == 0
    assert samples.mean(axis=0) == pytest.approx((0, 0), abs=0.06)
    assert samples.std(axis=0) == pytest.approx((1.5, 1.5), rel=0.03)
    gust = samples[:, 0] - samples[:, 0].mean()
    lag = 20  # 2 s
    assert np.mean(gust[lag:] * gust[:-lag]) / gust.var() == pytest.approx(math.exp(-1), abs=0.03)
    assert abs(np.corrcoef(samples.T)[0, 1]) < 0.03
