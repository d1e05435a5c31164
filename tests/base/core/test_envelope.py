"""The upper concave envelope against its definition."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.arrays import upper_envelope


def below_a_chord(points, k):
    """Whether a point lies on or below a segment between two others."""
    x, y = points[k]
    for a, b in points:
        for c, d in points:
            if a < x < c and y <= b + (d - b) * (x - a) / (c - a):
                return True
    return False


@given(st.lists(st.tuples(st.integers(0, 12), st.integers(-6, 12)), min_size=1, max_size=9))
def test_vertices_are_what_no_chord_is_above(points):
    points = sorted(set(points), key=lambda point: (point[0], -point[1]))
    rising = [
        k
        for k, (x, y) in enumerate(points)
        if not below_a_chord(points, k) and all(b < y for a, b in points if (a, -b) < (x, -y))
    ]
    x, y = np.array(points, dtype=float).T
    assert upper_envelope(x, y) == rising


def test_a_small_rise_counts_as_none():
    x, y = np.array([0.0, 1.0, 2.0, 3.0]), np.array([1.0, 1.5, 1.55, 1.6])
    assert upper_envelope(x, y) == [0, 1, 3]
    assert upper_envelope(x, y, tolerance=0.07) == [0, 1, 3]
    assert upper_envelope(x, y, tolerance=0.1) == [0, 1]
    assert upper_envelope(x, y, tolerance=0.5) == [0, 2]
