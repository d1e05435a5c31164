"""The battery drained in flight, beside the differential equation solved by scipy."""

from __future__ import annotations

import math

import pytest
from scipy.integrate import solve_ivp

from eadp.models.battery import Battery, Fault
from eadp.simulation.loop import BATTERY_EMPTY, _Charge

STEP_S = 0.01


def drained(battery, power_w, seconds, faults=()):
    charge = _Charge(battery, tuple(faults), STEP_S)
    for k in range(round(seconds / STEP_S)):
        if not charge.drain((k + 1) * STEP_S, power_w((k + 1) * STEP_S)):
            break
    return charge


@pytest.mark.parametrize("empty_v", [None, 12.4])
def test_the_charge_follows_its_equation(empty_v):
    battery = Battery(16.8, 0.08, 1.2, 1 / 3600, 0.95, 10.0, (), empty_v)

    def power(t):
        return 40 + 8 * math.sin(t / 7)

    def slope(t, soc):
        volts = 16.8 if empty_v is None else empty_v + (16.8 - empty_v) * soc[0]
        current = (volts - math.sqrt(volts**2 - 4 * 0.08 * power(t))) / (2 * 0.08)  # letter, Eq. 22
        return [-current / 3600 / 1.2]

    expected = solve_ivp(slope, (0, 600), [0.95], rtol=1e-9, atol=1e-12).y[0, -1]
    assert drained(battery, power, 600).soc == pytest.approx(expected, abs=2e-6)


def test_a_voltage_that_falls_empties_the_battery_sooner():
    flat, falling = Battery(16.8, capacity_ah=0.1), Battery(16.8, capacity_ah=0.1, voltage_empty_v=12.0)
    assert drained(falling, lambda _t: 40.0, 60).soc < drained(flat, lambda _t: 40.0, 60).soc


def test_a_battery_that_sags_below_what_is_drawn_says_so():
    # 4 R y = 4·0.5·100 = 200 V²: above 14.14 V it can, below it cannot
    battery = Battery(16.0, 0.5, 0.5, 1 / 3600, 1.0, 10.0, (), 12.0)
    charge = drained(battery, lambda _t: 100.0, 600)
    assert "cannot deliver" in charge.failure
    assert battery.voltage_at(charge.soc) == pytest.approx(math.sqrt(200), abs=0.01)


def test_faults_and_the_end():
    charge = drained(Battery(capacity_ah=1.0), lambda _t: 30.0, 100, [Fault(5.0, 0.3), Fault(6.0, 0.9)])
    assert charge.soc == 0
    assert charge.failure == BATTERY_EMPTY
