"""The replayed trace; a voltage that falls with the charge."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.models.battery import VOLTAGE_STEP_V, Battery

TRACE = Battery(prescribed=((0, 1.0), (10, 0.9), (10, 0.8), (20, 0.4)))


@pytest.mark.parametrize(
    ("time_s", "soc"), [(-1, 1.0), (0, 1.0), (5, 0.95), (9.999, 0.90001), (10, 0.8), (15, 0.6), (20, 0.4), (99, 0.4)]
)
def test_a_trace_is_linear_with_steps_and_held_after_its_end(time_s, soc):
    assert TRACE.prescribed_soc(time_s) == pytest.approx(soc)


def test_the_largest_power_allowed_has_its_unit():
    battery = Battery(voltage_v=14.8, capacity_ah=3.2, letter_crate_per_h=1)
    assert 0.77 * battery.power_per_soc_w == pytest.approx(36.47, abs=0.01), "36 W is forbidden below b = 0.77"


def test_the_voltage_falls_in_a_straight_line_with_the_charge():
    battery = Battery(voltage_v=16.8, voltage_empty_v=13.2)
    assert [battery.voltage_at(soc) for soc in (1.0, 0.5, 0.0)] == pytest.approx([16.8, 15.0, 13.2])
    assert Battery(voltage_v=14.8).voltage_at(0.1) == 14.8


@given(st.floats(0, 1))
def test_near_a_charge_the_battery_has_one_voltage_a_little_below(soc):
    battery = Battery(voltage_v=16.8, voltage_empty_v=13.2)
    near = battery.near(soc)
    assert near.voltage_empty_v is None
    assert -1e-9 <= battery.voltage_at(soc) - near.voltage_v <= VOLTAGE_STEP_V + 1e-9
    assert Battery().near(soc) == Battery()
