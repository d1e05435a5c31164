"""The drag polar and level turns, beside numbers worked out by hand and by numerical minimisation."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.guidance import (
    GRAVITY_MPS2,
    drag_n,
    dynamic_pressure_pa,
    induced_drag_factor,
    load_factor,
)

speeds = st.floats(6, 60)
banks = st.floats(-1.2, 1.2)


def test_a_wing_worked_out_by_hand():
    # 20 m/s at sea level: q = 245 Pa; 24.5 N on 0.5 m²: C_L = 0.2; C_D = 0.02 + 0.2²/(π·0.8·5) = 0.023183
    assert dynamic_pressure_pa(20, 1.225) == pytest.approx(245)
    assert induced_drag_factor(5, 0.8) == pytest.approx(1 / (4 * math.pi))
    assert drag_n(24.5, 20, 0.5, 1.225, 0.02, 1 / (4 * math.pi)) == pytest.approx(245 * 0.5 * 0.0231831, rel=1e-5)


@given(speeds, banks)
def test_a_level_turn_balances_weight_and_centripetal_force(speed, bank):
    # lift n W: its upright part carries the weight, the other part turns: m V ω
    mass = 1.7
    turn_rate_radps = GRAVITY_MPS2 * math.tan(bank) / speed
    lift = load_factor(bank) * mass * GRAVITY_MPS2
    assert lift * math.cos(bank) == pytest.approx(mass * GRAVITY_MPS2)
    assert lift * math.sin(bank) == pytest.approx(mass * speed * turn_rate_radps, abs=1e-9)
