"""Scaling factors against the straight line through the two ends, and against the published survey."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.papers.forecasting import scaling_factors

ends = st.floats(-1e4, 1e4).map(lambda value: round(value, 3))
seconds = st.floats(0, 1e4)


@given(ends, st.floats(0.01, 1e4), seconds, seconds, st.integers(1, 4), st.floats(0, 1))
def test_path_parameters_share_the_line_from_shortest_to_longest(low, width, shortest, longest, count, share):
    high = low + width
    nu, tau = scaling_factors(low, high, shortest / count, longest / count)
    c = low + share * width
    expected = np.interp(c, [low, high], [shortest, longest])
    rounding = 1e-12 * (1 + abs(low) / width) * max(shortest, longest, 1)
    assert count * (nu * c + tau) == pytest.approx(expected, rel=1e-9, abs=rounding * 10)


def test_the_published_survey_takes_its_published_times():
    nu, tau = scaling_factors(-1000, 0, 270.15, 705.96)
    assert nu * -1000 + tau == pytest.approx(270.15, abs=1e-9), "as printed, τ does not give the shortest time here"
    assert tau == pytest.approx(705.96, abs=1e-9)


def test_a_set_of_one_value_changes_nothing():
    assert scaling_factors(3, 3, 50, 100) == (0, 100)
    assert scaling_factors(4, 4, 7.5, 7.5) == (0, 7.5)
