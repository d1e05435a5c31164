"""The battery drained in flight, beside the differential equation solved by scipy."""

import math

import pytest
from common import ROOT
from scipy.integrate import solve_ivp

import eadp
from eadp.models.battery import Battery
from eadp.simulation.aircraft import STEP_S as STEP_S_PLACE
from eadp.simulation.inner_loop import (
    CONSTANTS,
    DRAIN,
    DROP,
    EMPTY,
    EMPTY_V,
    FAULT_AT,
    SAGS,
    SOC,
    STATE,
    StepTables,
    drain,
    drain_constants,
)

STEP_S = 0.01


def drained(battery, power_w, seconds, fault=(0, 0.0)):
    """The charge after some time of a power, and what ended it."""
    s, c = [0.0] * STATE, [0.0] * CONSTANTS
    c[EMPTY_V : DRAIN + 1] = drain_constants(battery, STEP_S)
    c[FAULT_AT], c[DROP] = fault
    s[SOC] = battery.soc
    for k in range(1, round(seconds / STEP_S) + 1):
        if failed := drain(s, c, power_w(k * STEP_S), k, StepTables([], battery.curve, [])):
            return s[SOC], failed
    return s[SOC], 0


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
    assert drained(battery, power, 600)[0] == pytest.approx(expected, abs=2e-6)


def test_a_battery_that_sags_below_what_is_drawn_says_so():
    # 4 R y = 4·0.5·100 = 200 V²: above 14.14 V it can, below it cannot
    battery = Battery(16.0, 0.5, 0.5, 1 / 3600, 1.0, 10.0, (), 12.0)
    soc, failed = drained(battery, lambda _t: 100.0, 600)
    assert failed == SAGS
    assert battery.voltage_at(soc) == pytest.approx(math.sqrt(200), abs=0.01)


@pytest.mark.parametrize("keys", [{"max_c_rate": 8.0}, {"cutoff_voltage_v": 14.0}])
def test_a_limit_of_the_power_ends_the_flight(keys):
    battery = Battery(voltage_v=16.0, voltage_empty_v=12.0, resistance_ohm=0.2, capacity_ah=0.5, **keys)
    soc, failed = drained(battery, lambda _t: 56.0, 600)
    assert failed == SAGS
    # 56 W are 4 A at 14 V, both limits at once
    assert battery.voltage_at(soc) == pytest.approx(14.0 + 0.2 * 4.0, abs=0.01)


def test_a_loss_of_charge_and_the_end():
    battery = Battery(capacity_ah=1.0)
    before, after = (drained(battery, lambda _t: 30.0, 100, fault)[0] for fault in ((0, 0.0), (500, 0.3)))
    assert before - after == pytest.approx(0.3, abs=1e-12)
    assert drained(battery, lambda _t: 30.0, 100, (600, 0.999)) == (0, EMPTY)
    # of a scenario, in a flight whose voltage does not depend on the charge
    keys = {"planner.name": "static", "battery": {"voltage_v": 14.8}, "time_limit_s": 3}
    faults = [[], [{"at_s": 1, "soc_drop": 0.06}, {"at_s": 2, "soc_drop": 0.1}]]
    given = ROOT / "plans/survey.plan", ROOT / "scenarios/paper-I-static.yaml"
    ends = [eadp.simulate(*given, overrides=keys | {"faults": each}).summary["soc_final"] for each in faults]
    assert ends[0] - ends[1] == pytest.approx(0.16, abs=1e-12)


def test_a_replayed_charge_is_not_drained():
    s, c = [0.0] * STATE, [0.0] * CONSTANTS
    c[EMPTY_V : DRAIN + 1] = drain_constants(Battery(), STEP_S)
    c[STEP_S_PLACE] = STEP_S
    assert drain(s, c, 30.0, 50, StepTables([], [], [0.0, 0.0, 1.0, 1.0])) == 0
    assert s[SOC] == 0.5
