"""The replayed trace; a voltage that falls with the charge."""

import math

import pytest
from common import ROOT
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from eadp.core.flight import replayed_soc
from eadp.io.text.streams import read_text
from eadp.io.vehicle import read_vehicle
from eadp.models.battery import CELL_V, CURRENT, CUT_OFF, DELIVERABLE, LIMITS, Battery

TRACE = Battery(prescribed=((0, 1.0), (10, 0.9), (10, 0.8), (20, 0.4)))


@pytest.mark.parametrize(
    ("time_s", "soc"), [(-1, 1.0), (0, 1.0), (5, 0.95), (9.999, 0.90001), (10, 0.8), (15, 0.6), (20, 0.4), (99, 0.4)]
)
def test_a_trace_is_linear_with_steps_and_held_after_its_end(time_s, soc):
    assert replayed_soc(TRACE.replay, time_s) == pytest.approx(soc)


def test_the_largest_power_allowed_has_its_unit():
    battery = Battery(voltage_v=14.8, capacity_ah=3.2, letter_crate_per_h=1)
    assert 0.77 * battery.power_per_soc_w == pytest.approx(36.47, abs=0.01), "36 W is forbidden below b = 0.77"
    # b Q_c V: 3.2 Ah × 14.8 V in an hour are 47.36 W at full charge
    limits = [battery.power_limit_w(soc) for soc in (1.0, 0.77, 0.25)]
    assert limits == pytest.approx([47.36, 36.4672, 11.84], abs=1e-9)


def test_the_voltage_falls_in_a_straight_line_with_the_charge():
    battery = Battery(voltage_v=16.8, voltage_empty_v=13.2)
    assert [battery.voltage_at(soc) for soc in (1.0, 0.5, 0.0)] == pytest.approx([16.8, 15.0, 13.2])
    assert Battery(voltage_v=14.8).voltage_at(0.1) == 14.8


# resting voltages of a cell of lithium polymer at 10, 20, … 100 % of the charge, as chargers' tables have them [V]
RESTING_V = (3.69, 3.73, 3.77, 3.80, 3.84, 3.87, 3.95, 4.02, 4.11, 4.20)


def test_cells_have_the_voltage_of_their_chemistry():
    battery = Battery(cells=4, capacity_ah=5.0)
    assert [battery.voltage_at(soc / 10) / 4 for soc in range(1, 11)] == pytest.approx(RESTING_V, abs=0.125)
    assert Battery(cells=2, chemistry="lifepo4").voltage_v == pytest.approx(6.8)
    assert all(volts[-1] > volts[0] for volts in CELL_V.values())


@given(st.floats(0.2, 1), st.floats(0, 0.9))
def test_endurance_down_to_a_reserve(power_c, reserve):
    battery = Battery(voltage_v=10.0, resistance_ohm=0.0, capacity_ah=1.0)
    assert battery.endurance_s(10 * power_c, reserve) == pytest.approx(3600 / power_c * (1 - reserve))


def soc_at_end(battery, power_w, time_s):
    """Charge after a constant power, by integrating letter Eq. 22 with scipy."""

    def rate(_time_s, soc):
        volts = battery.voltage_at(float(soc[0]))
        root = math.sqrt(max(volts**2 - 4 * battery.resistance_ohm * power_w, 0.0))
        amperes = (volts - root) / (2 * battery.resistance_ohm)
        return [-battery.k_b_per_s * amperes / battery.capacity_ah]

    return solve_ivp(rate, (0.0, time_s), [1.0], rtol=1e-9, atol=1e-12).y[0, -1]


@pytest.mark.parametrize("battery", [Battery(), Battery(voltage_v=16.8, voltage_empty_v=13.2, k_b_per_s=0.00183)])
@pytest.mark.parametrize("power_w", [5.0, 36.39])
def test_endurance_empties_a_full_battery(battery, power_w):
    assert soc_at_end(battery, power_w, battery.endurance_s(power_w)) == pytest.approx(0.0, abs=1e-6)


def test_endurance_ends_where_the_power_can_no_longer_be_delivered():
    battery = Battery(voltage_v=10.0, voltage_empty_v=5.0, resistance_ohm=0.5)
    power_w = 7.5**2 / (4 * 0.5)  # at half the charge and below it is more than V²/4R
    assert soc_at_end(battery, power_w, battery.endurance_s(power_w)) == pytest.approx(0.5, abs=0.01)
    assert battery.endurance_s(100.0) == 0.0


def test_the_energy_is_charge_times_capacity_times_voltage():
    assert Battery(voltage_v=14.8, capacity_ah=3.2).energy_wh(0.5) == pytest.approx(23.68)
    assert Battery(voltage_v=16.0, voltage_empty_v=12.0, capacity_ah=2.0).energy_wh(0.5) == pytest.approx(14.0)


@pytest.mark.parametrize(
    ("keys", "limit", "max_w"),
    [
        ({}, DELIVERABLE, 14.8**2 / 0.2),
        ({"max_c_rate": 5.0}, CURRENT, 10 * (14.8 - 0.5)),
        ({"cutoff_voltage_v": 13.0}, CUT_OFF, 13 * 1.8 / 0.05),
        ({"max_c_rate": 5.0, "cutoff_voltage_v": 14.5}, CUT_OFF, 14.5 * 6),
        ({"max_c_rate": 5.0, "cutoff_voltage_v": 14.0}, CURRENT, 143),
        ({"max_c_rate": 100.0}, DELIVERABLE, 14.8**2 / 0.2),
        ({"cutoff_voltage_v": 5.0}, DELIVERABLE, 14.8**2 / 0.2),
    ],
)
def test_the_limit_that_is_the_largest_power_is_named(keys, limit, max_w):
    battery = Battery(capacity_ah=2.0, **keys)
    assert battery.limit_at(14.8) == limit
    assert battery.max_power_w(14.8) == pytest.approx(max_w)
    said = f"2000.0 W exceeds the {max_w:.1f} W that {LIMITS[limit]} allows at 14.8 V"
    assert battery.undeliverable(2000.0, 1.0) == said


def test_the_letters_limit_is_off_by_default():
    assert Battery(capacity_ah=2.0).power_limit_w(0.5) == pytest.approx(14.8**2 / 0.2)
    assert Battery(resistance_ohm=0.0).power_limit_w(0.5) == Battery().power_per_soc_w == math.inf


@pytest.mark.parametrize("name", ["foam-wing", "mapper", "small-wing"])
def test_the_resistance_that_is_assumed_is_near_to_that_of_known_packs(name):
    known = read_vehicle(read_text(str(ROOT / f"vehicles/{name}.yaml"))).battery
    assumed = Battery(cells=known.cells, chemistry=known.chemistry, capacity_ah=known.capacity_ah)
    assert 1 / 1.5 < assumed.resistance_ohm / known.resistance_ohm < 1.5
