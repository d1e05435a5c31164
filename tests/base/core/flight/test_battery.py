"""Current and charge of a Rint battery against the circuit's own equation, and against integration."""

import math

import numpy as np
import pytest
from common import draws
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from eadp.core.flight import current_slope_a_per_w, drain_per_s, max_power_w, min_voltage_v

EXACT = 1e-12
SECOND = 1.0
PAPER = 14.8, 0.0012  # ../spec/07, Constants

voltages = st.floats(3, 60)
shares = st.floats(-3, 1)  # of the largest power, below 0 charging


def current_a(power, voltage, resistance):
    return drain_per_s(power, voltage, resistance, 1.0)


def largest_w(voltage, resistance):
    return voltage**2 / (4 * resistance)


@given(voltages, st.floats(0, 0.5), shares)
def test_what_the_cells_give_is_delivered_or_lost_in_the_resistance(voltage, resistance, share):
    power = share * (1 - 1e-9) * (largest_w(voltage, resistance) if resistance > 1e-6 else 1000)
    current = current_a(power, voltage, resistance)
    assert voltage * current == pytest.approx(power + resistance * current**2, rel=1e-9)
    assert (voltage - resistance * current) * current == pytest.approx(power, rel=1e-6, abs=1e-9)
    assert math.copysign(1, current) == math.copysign(1, power), "charging turns the current"


def test_without_resistance_it_is_power_over_voltage():
    assert current_a(36.4, 14.8, 0.0) == pytest.approx(36.4 / 14.8, rel=EXACT)
    for resistance in (1e-6, 1e-9, 1e-12, 1e-15, 5e-324):
        # I = y/V (1 + R y/V² + …): the printed form divides two differences of rounding
        wanted = 36.4 / 14.8 * (1 + resistance * 36.4 / 14.8**2)
        assert current_a(36.4, 14.8, resistance) == pytest.approx(wanted, rel=1e-9)


@given(voltages, st.floats(1e-4, 0.5), st.floats(1e-9, 1e6))
def test_beyond_what_it_can_deliver_the_current_goes_on(voltage, resistance, excess):
    power = largest_w(voltage, resistance) * (1 + 1e-9) + excess
    # of a power that is not delivered at all
    assert current_a(power, voltage, resistance) == pytest.approx(2 * power / voltage)


@given(voltages, st.floats(0, 0.2), st.floats(-0.9, 0.9))
def test_slope_by_differences(voltage, resistance, share):
    power = share * (largest_w(voltage, resistance) if resistance > 1e-3 else 1000)
    assume(not resistance or power < 0.9 * largest_w(voltage, resistance))
    h = 1e-4 * (1 + abs(power))
    difference = (current_a(power + h, voltage, resistance) - current_a(power - h, voltage, resistance)) / (2 * h)
    assert current_slope_a_per_w(power, voltage, resistance) == pytest.approx(difference, rel=1e-4)
    assert current_slope_a_per_w(np.array([power]), voltage, resistance).shape == (1,)


@pytest.mark.parametrize(("k_b_per_s", "lasts_s"), [(0.00183, 711), (1 / 3600, 4684)])
def test_how_long_the_papers_battery_lasts(k_b_per_s, lasts_s):
    # 01-model, misprint 14: at 36.4 W
    assert 1 / drain_per_s(36.4, *PAPER, k_b_per_s / 3.2) == pytest.approx(lasts_s, abs=SECOND)


@settings(max_examples=draws(0.8))
@given(st.floats(0.001, 0.1), st.floats(20, 60), st.floats(0, 15), st.floats(5, 100))
def test_charge_over_a_flight_by_integration(resistance, mean_w, amplitude_w, period_s):
    def power(t):
        return mean_w + amplitude_w * math.sin(2 * math.pi * t / period_s)

    def rate(t, _soc):
        return [-drain_per_s(power(t), 14.8, resistance, 1 / 3600 / 3.2)]

    flown = solve_ivp(rate, (0, 300), [1.0], rtol=1e-9, atol=1e-12, max_step=period_s / 10)

    def current(t):  # of the circuit's equation
        return brentq(lambda i: i * (14.8 - resistance * i) - power(t), 0, 14.8 / (2 * resistance), xtol=1e-12)

    ampere_seconds, _ = quad(current, 0, 300, limit=400, epsabs=1e-7)
    assert flown.y[0, -1] == pytest.approx(1 - ampere_seconds / 3600 / 3.2, abs=1e-8)


def is_delivered(power, voltage, resistance, max_current_a, cutoff_v):
    """Whether a root of the circuit's equation R I² − V I + y = 0 keeps to the limits."""
    roots = np.roots([resistance, -voltage, power])
    roots = roots[np.abs(roots.imag) < 1e-9].real
    return any(i <= max_current_a and voltage - resistance * i >= cutoff_v for i in roots)


LIMITS = [(math.inf, 0.0), (10.0, 0.0), (math.inf, 12.0), (30.0, 13.0), (2.0, 13.0), (math.inf, 3.0), (1e4, 0.0)]


@pytest.mark.parametrize(("max_current_a", "cutoff_v"), LIMITS)
@pytest.mark.parametrize("resistance", [0.02, 0.3])
def test_the_largest_power_is_at_the_edge_of_what_the_circuit_delivers(resistance, max_current_a, cutoff_v):
    limits = resistance, max_current_a, cutoff_v
    max_w = float(max_power_w(14.8, *limits))
    assert is_delivered(max_w * (1 - 1e-6), 14.8, *limits)
    assert not is_delivered(max_w * (1 + 1e-6), 14.8, *limits)
    # the inverse
    assert float(min_voltage_v(max_w, *limits)) == pytest.approx(14.8, rel=1e-9)


def test_limits_of_an_array_and_without_resistance():
    volts = np.array([11.0, 12.0, 16.0])
    assert max_power_w(volts, 0.5, 4.0, 11.5).tolist() == pytest.approx([0.0, 1.0 * 11.5, 4.0 * 14.0])
    assert max_power_w(volts, 0.0, 4.0, 11.5).tolist() == pytest.approx([0.0, 48.0, 64.0])
    assert max_power_w(volts, 0.0, math.inf, 0.0).tolist() == [math.inf] * 3
    assert float(min_voltage_v(48.0, 0.0, 4.0, 11.5)) == pytest.approx(12.0)
    assert float(min_voltage_v(48.0, 0.0, math.inf, 0.0)) == 0.0
