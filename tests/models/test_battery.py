"""The replayed trace."""

from __future__ import annotations

import pytest

from eadp.models.battery import Battery

TRACE = Battery(prescribed=((0, 1.0), (10, 0.9), (10, 0.8), (20, 0.4)))


@pytest.mark.parametrize(
    ("time_s", "soc"), [(-1, 1.0), (0, 1.0), (5, 0.95), (9.999, 0.90001), (10, 0.8), (15, 0.6), (20, 0.4), (99, 0.4)]
)
def test_a_trace_is_linear_with_steps_and_held_after_its_end(time_s, soc):
    assert TRACE.prescribed_soc(time_s) == pytest.approx(soc)


def test_the_largest_power_allowed_has_its_unit():
    battery = Battery(voltage_v=14.8, capacity_ah=3.2, crate_per_h=1)
    assert 0.77 * battery.power_per_soc_w == pytest.approx(36.47, abs=0.01), "36 W is forbidden below b = 0.77"
