"""Computations measured apart: the sum answers as its parts do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.errors import Infeasible
from eadp.models.profile import Profile, ProfileSum, added

DETECTOR = Profile(("fps",), ("1/s",), np.array([[2.0], [10.0]]), np.array([4.0, 8.0]), source="detector")
ENCODER = Profile(
    ("keysize", "rate"), ("bit", ""), np.array([[32, 1], [32, 3], [448, 1], [448, 3]]), np.array([1.0, 2, 3, 5])
)
BOTH = ProfileSum((DETECTOR, ENCODER))


@given(st.floats(2, 10), st.floats(32, 448), st.floats(1, 3))
def test_power_is_the_sum(fps: float, keysize: float, rate: float) -> None:
    # the detector by hand: 4 W and half a watt for each frame above 2
    expected_w = 4 + 0.5 * (fps - 2) + ENCODER.power_w_at((keysize, rate))
    assert BOTH.power_w_at((fps, keysize, rate)) == pytest.approx(expected_w, abs=1e-9)


def test_names_units_ranges_levels_and_source_are_the_parts() -> None:
    assert BOTH.names == ("fps", "keysize", "rate")
    assert BOTH.units == ("1/s", "bit", "")
    assert (BOTH.range_of("fps"), BOTH.range_of("rate")) == ((2, 10), (1, 3))
    assert BOTH.levels(0, 2, 4) == (2, 3, 4)
    assert BOTH.levels(2, 1, 3) == (1, 2, 3)
    with pytest.raises(KeyError, match="speed"):
        BOTH.range_of("speed")
    with pytest.raises(IndexError):
        BOTH.levels(3, 0, 1)


def test_outside_one_part_is_outside() -> None:
    assert not BOTH.contains((12, 32, 1))
    with pytest.raises(Infeasible, match="fps=12"):
        BOTH.power_w_at((12, 32, 1))
    assert (
        BOTH.outside((12, 500, 1))
        == "fps=12 is outside the measured 2 to 10; keysize=500 is outside the measured 32 to 448"
    )
    assert BOTH.nearest((12, 500, 1)) == (10, 448, 1)
    assert BOTH.power_w_at((12, 500, 1), clamp=True) == 8 + 3
    with pytest.raises(Infeasible):
        BOTH.power_w_at((math.nan, 32, 1), clamp=True)
    with pytest.raises(ValueError, match="2 values"):
        BOTH.power_w_at((2, 32))


def test_added_flattens_and_one_stays_itself() -> None:
    other = Profile(("volume",), ("",), np.array([[0.0], [1.0]]), np.array([0.0, 1.0]))
    assert added([DETECTOR]) is DETECTOR
    assert added([BOTH, other]) == ProfileSum((DETECTOR, ENCODER, other))


def test_a_parameter_in_two_parts_is_refused() -> None:
    with pytest.raises(Infeasible, match="parameter fps"):
        added([DETECTOR, DETECTOR])
    with pytest.raises(ValueError, match="two"):
        ProfileSum((DETECTOR,))
