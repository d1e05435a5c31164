"""The aircraft: against a transcription of the published step, and against physics where it claims any."""

from __future__ import annotations

import math

import numpy as np
import pytest

from eadp.core.derivatives import bind
from eadp.core.expressions import read_expression
from eadp.models.vehicle import Guidance, PaperVehicle
from eadp.models.weather import Wind
from eadp.simulation.aircraft import Gusts, PaperAircraft

LINE = bind(read_expression("x"), [])
CIRCLE = bind(read_expression("x^2+y^2-75^2"), [])
STILL = (0.0, 0.0)


def fly(path, gain, sense, wind, start, heading, seconds, vehicle=None, guidance=None, step_s=0.01):
    aircraft = PaperAircraft(
        vehicle or PaperVehicle(), guidance or Guidance(), wind, start, math.radians(heading), 25.0
    )
    track, power = [], []
    for _ in range(round(seconds / step_s)):
        power.append(aircraft.step(path, STILL, gain, sense, wind, step_s))
        track.append((aircraft.x_m, aircraft.y_m))
    return np.array(track), np.array(power), aircraft


def test_one_step_is_the_published_one():
    """The letter's step with matrices, from 20 m altitude, off its path, in wind that lifts."""
    wind = np.array([5.0, 0.0])
    vehicle = PaperVehicle(wind_in_lift=True)
    aircraft = PaperAircraft(vehicle, Guidance(-0.001, False), tuple(wind), (-100.0, 220.0), math.radians(270), 20.0)
    power = aircraft.step(CIRCLE, STILL, 0.006, 1, tuple(wind), 0.01)

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
    assert (aircraft.x_m, aircraft.y_m) == pytest.approx(tuple(p + velocity * 0.01), abs=1e-12)
    assert aircraft.altitude_m == pytest.approx(20 + climb * 0.01, abs=1e-12)
    assert math.remainder(aircraft.heading_rad - (theta + u * 0.01), 2 * math.pi) == pytest.approx(0, abs=1e-12)
    assert power == pytest.approx(20 * (50 + throttle) / 100 + 16, abs=1e-12)


def test_level_flight_costs_the_cruise_power_whatever_the_wind():
    for wind in ((0.0, 0.0), (5.0, 0.0), (-3.0, 4.0)):
        _, power, aircraft = fly(LINE, 0.1, 1, wind, (0.0, 0.0), 90, 20)
        assert np.ptp(power[500:]) < 1e-6, "airspeed is the throttle's alone: the wind changes no power"
        assert power[-1] == pytest.approx(26.0)
        assert aircraft.altitude_m == pytest.approx(25.0, abs=1e-6)


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


@pytest.mark.parametrize(("path", "sense", "start"), [(LINE, -1, (30.0, 0.0)), (CIRCLE, 1, (100.0, 0.0))])
def test_one_normalised_gain_serves_lines_and_circles(path, sense, start):
    track, _, _ = fly(path, 0.006, sense, STILL, start, 90, 90, guidance=Guidance(normalised=True))
    off = [abs(path(x, y)[0]) / math.hypot(*path(x, y)[1:3]) for x, y in track[-1500:]]
    assert max(off) < 0.5


def test_at_the_centre_of_a_circle_the_heading_is_kept():
    aircraft = PaperAircraft(PaperVehicle(), Guidance(), STILL, (0.0, 0.0), 1.0, 25.0)
    aircraft.step(CIRCLE, STILL, 0.006, 1, STILL, 0.01)
    assert aircraft.heading_rad == 1.0


def test_a_smaller_step_flies_the_same_path():
    coarse, _, _ = fly(CIRCLE, 0.006, 1, (3.0, 0.0), (100.0, 0.0), 90, 30, step_s=0.01)
    fine, _, _ = fly(CIRCLE, 0.006, 1, (3.0, 0.0), (100.0, 0.0), 90, 30, step_s=0.001)
    assert np.hypot(*(coarse[-1] - fine[-1])) < 1.0


def test_gusts_have_their_spread_and_their_time():
    wind = Wind(4.0, 90.0, gust_std_mps=1.5, gust_time_s=2.0)
    gusts = Gusts(wind, 0.1, np.random.default_rng(3))
    samples = np.array([gusts.next_mps() for _ in range(200_000)])
    assert samples.mean(axis=0) == pytest.approx((0, 4), abs=0.06)
    assert samples.std(axis=0) == pytest.approx((1.5, 1.5), rel=0.03)
    gust = samples[:, 0] - samples[:, 0].mean()
    lag = 20  # 2 s
    assert np.mean(gust[lag:] * gust[:-lag]) / gust.var() == pytest.approx(math.exp(-1), abs=0.03)
    assert abs(np.corrcoef(samples.T)[0, 1]) < 0.03


def test_without_gusts_the_wind_is_steady():
    gusts = Gusts(Wind(5.0, 180.0), 0.01, np.random.default_rng(0))
    assert {gusts.next_mps() for _ in range(10)} == {Wind(5.0, 180.0).steady_mps}
    assert Wind(5.0, 90.0).steady_mps == pytest.approx((0, 5), abs=1e-12)
