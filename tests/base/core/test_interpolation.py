"""Interpolation of measured configurations, against numpy's and scipy's own; the upper concave envelope."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import LinearNDInterpolator, RegularGridInterpolator

from eadp.core.arrays import upper_envelope
from eadp.core.interpolation import EDGE, interpolant
from eadp.errors import Infeasible

ROUNDING = 1e-9  # relative to values and coordinates of order 1 to 1000

FPS = np.array([[2.0], [4.0], [6.0], [8.0], [10.0]])
POWER_W = np.array([5.21438, 6.94212, 8.68095, 9.78429, 10.2112])

coordinate = st.integers(-1000, 1000).map(lambda k: k / 8)
value = st.integers(-4000, 4000).map(lambda k: k / 16)
part = st.floats(0, 1)


@st.composite
def curves(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    knots = sorted(draw(st.lists(coordinate, min_size=2, max_size=8, unique=True)))
    values = draw(st.lists(value, min_size=len(knots), max_size=len(knots)))
    return np.array(knots), np.array(values)


@st.composite
def levels(draw: st.DrawFn, d: int) -> list[list[float]]:
    axis = st.lists(coordinate, min_size=2, max_size=4, unique=True).map(sorted)
    return [draw(axis) for _ in range(d)]


def grid_points(axes: list[list[float]]) -> np.ndarray:
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def test_power_between_two_frame_rates_worked_by_hand() -> None:
    # 2.1 is a twentieth of the way from 2 to 4: 5.21438 + 1.72774/20; the letter's printed Eq. 13 gives 22.5
    assert interpolant(FPS, POWER_W).at((2.1,)) == pytest.approx(5.300767, abs=ROUNDING)


@given(curves(), part)
def test_line_is_numpys(curve: tuple[np.ndarray, np.ndarray], t: float) -> None:
    knots, values = curve
    x = float(knots[0] + t * (knots[-1] - knots[0]))
    line = interpolant(knots[:, None], values)
    assert line.at((x,)) == pytest.approx(np.interp(x, knots, values), abs=ROUNDING)


@given(curves())
def test_measured_configurations_keep_their_values_exactly(curve: tuple[np.ndarray, np.ndarray]) -> None:
    knots, values = curve
    for kind in ("linear", "pchip"):
        line = interpolant(knots[::-1, None], values[::-1], kind)  # measured in any order
        assert [line.at((x,)) for x in knots] == list(values)


@given(levels(3), st.data(), st.tuples(part, part, part))
def test_grid_is_scipys(axes: list[list[float]], data: st.DataObject, parts: tuple[float, ...]) -> None:
    points = grid_points(axes)
    values = np.array(data.draw(st.lists(value, min_size=len(points), max_size=len(points))))
    grid = interpolant(points, values)
    within = [axis[0] + t * (axis[-1] - axis[0]) for axis, t in zip(axes, parts, strict=True)]
    asked = np.clip(within, grid.lower, grid.upper)
    oracle = RegularGridInterpolator(axes, values.reshape([len(axis) for axis in axes]))
    assert grid.at(asked) == pytest.approx(float(oracle(asked)[0]), abs=1e-7)
    assert [grid.at(point) for point in points] == pytest.approx(values, abs=ROUNDING)


def test_a_parameter_that_never_changes_is_held() -> None:
    line = interpolant([[2.0, 32.0], [10.0, 32.0]], [5.0, 9.0])
    assert line.at((4.0, 32.0)) == pytest.approx(6.0)
    assert line.nearest((4.0, 64.0)) == (4.0, 32.0)
    with pytest.raises(Infeasible):
        line.at((4.0, 33.0))


SCATTER = np.array([[2.0, 32.0], [10.0, 32.0], [3.0, 448.0], [9.0, 400.0], [6.0, 200.0], [4.5, 100.0]])
IRREGULAR_W = np.array([5.0, 9.0, 6.5, 11.0, 9.5, 6.0])

mixture = st.lists(st.floats(0.01, 1), min_size=len(SCATTER), max_size=len(SCATTER)).map(
    lambda weights: np.array(weights) @ SCATTER / sum(weights)
)


@given(mixture)
def test_scattered_is_scipys(point: np.ndarray) -> None:
    scattered = interpolant(SCATTER, IRREGULAR_W)
    oracle = LinearNDInterpolator(SCATTER, IRREGULAR_W, rescale=True)
    assert scattered.at(point) == pytest.approx(float(oracle(point)[0]))


def test_grid_with_a_hole_is_scattered() -> None:
    points = grid_points([[0, 1, 2], [0, 1, 2]])
    # without the corner (2, 2): points on common circles, flat triangles
    whole = np.delete(points, 8, axis=0)
    scattered = interpolant(whole, whole.sum(axis=1))
    assert scattered.at((1.25, 1.5)) == pytest.approx(2.75)
    with pytest.raises(Infeasible):
        scattered.at((1.75, 1.75))


@pytest.mark.parametrize("kind", ["linear", "pchip"])
@pytest.mark.parametrize("fps", [1.999, 10.001, -math.inf, math.inf, math.nan])
def test_outside_the_range_is_refused(kind: str, fps: float) -> None:
    line = interpolant(FPS, POWER_W, kind)  # type: ignore[arg-type]
    with pytest.raises(Infeasible):
        line.at((fps,))


def test_rounding_at_the_edge_is_inside() -> None:
    line = interpolant(FPS, POWER_W)
    assert line.at((10 + 4 * EDGE,)) == POWER_W[-1]
    assert line.at((2 - 4 * EDGE,)) == POWER_W[0]
    with pytest.raises(Infeasible):
        line.at((10 + 16 * EDGE,))


def test_nearest_goes_to_the_box_and_leaves_what_is_inside() -> None:
    grid = interpolant(grid_points([[2, 10], [32, 448]]), [5, 6, 9, 10])
    assert grid.nearest((12.0, 0.0)) == (10.0, 32.0)
    assert grid.nearest((3.5, 100.0)) == (3.5, 100.0)
    with pytest.raises(Infeasible):
        grid.nearest((math.nan, 100.0))


def test_nearest_of_scattered_points_is_a_measured_one() -> None:
    triangle = interpolant([[2, 32], [10, 448], [2, 448]], [5, 10, 6])
    assert triangle.nearest((6.0, 40.0)) == (2.0, 32.0)
    assert triangle.nearest((3.0, 300.0)) == (3.0, 300.0)
    scattered = interpolant(SCATTER, IRREGULAR_W)
    assert scattered.nearest((12.0, 0.0)) == (10.0, 32.0)
    scattered.at(scattered.nearest((12.0, 500.0)))


@pytest.mark.parametrize(
    "points",
    [
        [[2.0, 32.0]],
        [[2.0, 32.0], [10.0, 448.0]],
        [[2.0, 32.0], [6.0, 240.0], [10.0, 448.0]],
        [[0, 0, 0], [1, 0, 1], [0, 1, 1], [2, 1, 3], [3, 3, 6]],
    ],
    ids=["one point", "two points", "a line", "a plane in space"],
)
def test_degenerate_configurations_are_refused(points: list[list[float]]) -> None:
    with pytest.raises(Infeasible, match=r"one configuration only|on one line"):
        interpolant(points, np.arange(len(points)))


def test_pchip_needs_one_changing_parameter() -> None:
    with pytest.raises(Infeasible, match="pchip needs one"):
        interpolant(grid_points([[0, 1], [0, 1]]), [0, 1, 1, 2], "pchip")


def test_pchip_of_configurations_too_close_together() -> None:
    with pytest.raises(Infeasible, match="too close"):
        interpolant([[0.0], [1e-310], [1.0]], [0.0, 1.0, 2.0], "pchip")


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
