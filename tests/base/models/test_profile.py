"""The computation energy model: power at a configuration, ranges, levels."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.errors import Infeasible
from eadp.models.profile import LEVELS_LIMIT, Profile


def profile(power_by_fps: dict[float, float]) -> Profile:
    points = np.array([[fps] for fps in power_by_fps], dtype=float)
    return Profile(("fps",), ("1/s",), points, np.array(list(power_by_fps.values())))


PEDNET = profile({2: 5.21438, 4: 6.94212, 6: 8.68095, 8: 9.78429, 10: 10.2112})
HALF = profile({0.5: 3.33, 1: 3.34, 2: 3.36, 10: 3.46})


def test_outside_is_refused() -> None:
    with pytest.raises(Infeasible, match=r"^fps=12 is outside the measured 2 to 10$"):
        PEDNET.power_w_at((12.0,))
    assert PEDNET.power_w_at(PEDNET.interpolant.nearest((12.0,))) == 10.2112
    assert PEDNET.power_w_at(PEDNET.interpolant.nearest((0.0,))) == 5.21438
    with pytest.raises(Infeasible):
        PEDNET.power_w_at((math.nan,))
    with pytest.raises(Infeasible):
        PEDNET.interpolant.nearest((math.nan,))


def test_outside_the_hull_though_inside_each_range() -> None:
    points = np.array([[2, 32], [10, 32], [2, 448]])
    corner = Profile(("fps", "keysize"), ("", ""), points, np.array([5, 9, 6]))
    with pytest.raises(Infeasible, match="fps=9, keysize=400 is outside the hull of the measured ones"):
        corner.power_w_at((9.0, 400.0))


def test_arrays_are_sorted_read_only_copies() -> None:
    points, power_w = np.array([[4.0], [2.0]]), np.array([7.0, 5.0])
    made = Profile(("fps",), ("",), points, power_w, np.array([0.2, 0.1]), np.array([3, 1]))
    points[0], power_w[0] = 99, 99
    assert made.configurations.tolist() == [[2], [4]]
    assert made.power_w.tolist() == [5, 7]
    assert made.std_w.tolist() == [0.1, 0.2]
    assert made.samples.tolist() == [1, 3]
    with pytest.raises(ValueError, match="read-only"):
        made.power_w[0] = 1


# levels


def test_levels_are_whole_steps() -> None:
    assert PEDNET.levels(0, 2, 10) == tuple(range(2, 11))
    assert PEDNET.levels(0, 2.5, 5) == (2.5, 3.5, 4.5), "the measured values are whole steps apart: whole steps"
    assert PEDNET.levels(0, 4.5, 5.75) == (4.5, 5.5), "no measured value between: whole steps from the bound"


def test_levels_are_the_measured_values_where_whole_steps_miss_one() -> None:
    assert HALF.levels(0, 0.5, 10) == (0.5, 1, 2, 10)
    assert HALF.levels(0, 0, 2) == (0.5, 1, 2)
    assert HALF.levels(0, 0.7, 2) == (0.7, 1, 2), "the lower bound lies between two measured values"
    assert HALF.levels(0, 1, 4) == (1, 2, 3, 4), "0.5 is not within the bounds"


def test_too_many_levels() -> None:
    with pytest.raises(Infeasible, match="whole steps"):
        PEDNET.levels(0, 0, LEVELS_LIMIT)
    assert len(PEDNET.levels(0, 0, LEVELS_LIMIT - 1)) == LEVELS_LIMIT


@given(st.integers(0, 80).map(lambda k: k / 8), st.integers(0, 80).map(lambda k: k / 8))
def test_levels_are_within_the_bounds_and_hold_what_is_measured(lo: float, hi: float) -> None:
    for made in (PEDNET, HALF):
        levels = made.levels(0, lo, hi)
        assert all(lo <= level <= hi for level in levels)
        assert list(levels) == sorted(set(levels))
        if made is PEDNET:  # measured at whole steps: whole steps from the bound, wherever that is
            assert all(level - lo == k for k, level in enumerate(levels))
            continue
        measured = {fps for (fps,) in made.configurations.tolist() if lo <= fps <= hi}
        assert measured <= set(levels)
