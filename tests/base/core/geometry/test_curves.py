"""Kinds of paths, lines and circles as travelled, angles swept, lengths along curves."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad

from eadp.core.expressions.derivatives import bind
from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import named
from eadp.core.geometry.curves import (
    CIRCLE,
    CURVE,
    LINE,
    Circle,
    circle_of,
    curve_length_m,
    line_of,
    path_kind,
    points_along,
    project,
    tangent,
    wrap_angle_rad,
)
from eadp.errors import PathUndefined

NANOMETRE = 1e-9
LENGTH_SHARE = 1e-3
COUNTER_CLOCKWISE, CLOCKWISE = 1, -1

coordinate = st.floats(-500, 500)
points = st.tuples(coordinate, coordinate)
senses = st.sampled_from([1, -1])
whole = st.integers(-40, 40)


def path(text, *parameters):
    return bind(read_expression(text), named(parameters))


def near(point):
    return pytest.approx(point, abs=NANOMETRE)


# --- kinds ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (LINE, "x"),
        (LINE, "y"),
        (LINE, "3*x+4*y-10"),
        (LINE, "x*x - x^2 + y"),
        (LINE, "x^2*(c1-c1) + x"),
        (LINE, "(0*x)*y^2 + x"),
        (LINE, "x*((c1+1)^64)^64 + y"),
        (LINE, "x*1e-9*(" + "+".join(f"sin({i}*c1)*cos(c2/{i})" for i in range(1, 60)) + ")"),
        (CIRCLE, "(x+45)^2+(y-146)^2-4900"),
        (CIRCLE, "((x-c1)^2+(y-c2)^2-25)/(c1^2+1)"),
        (CIRCLE, "(x+y)^2+(x-y)^2-8"),  # 2x² + 2y² − 8
        (CIRCLE, "(x + 2*sqrt(4900+c1)-105)^2+(y-147)^2-4900-c1"),
        (CIRCLE, "x^2+y^2"),  # a point, but the form of a circle
        (CIRCLE, "x^2+x*y+y^2-y*x-1"),
        (CURVE, "(x-y)^2 - 4"),
        (CURVE, "y - sin(x)"),
        (CURVE, "x^2 - y^2"),
        (CURVE, "x^3 + y"),
        (CURVE, "sqrt(x^2+y^2) - 5"),
        (CURVE, "x^c1 + y"),
        (CURVE, "max(x, y)"),
        (CURVE, "atan2(y, x)"),
        (CURVE, "0*x + 5"),  # no x is left: nothing to follow
    ],
)
def test_the_kind_of_a_path(kind, text):
    assert path_kind(read_expression(text)) == kind


@pytest.mark.parametrize(
    "text",
    [
        "x/(0*c1)",
        "x/((x - x)*0)",
        "(1e300*x)*(1e300*x)*c1",
        "+".join(["c1*x"] * 2000),
        "x*min(sqrt(-c1^2 - 1), 1)",
        "*".join(["(c1 + c2 + c3 + c4 + c5 + x)"] * 8),
    ],
)
def test_every_path_that_reads_has_a_kind(text):
    assert path_kind(read_expression(text)) in (LINE, CIRCLE, CURVE)


@given(whole, whole, whole, whole, whole, whole)
def test_the_kind_of_a_quadratic_is_that_of_its_coefficients(xx, xy, yy, x, y, one):
    text = f"{xx}*x^2 + {xy}*x*y + {yy}*y^2 + {x}*x + {y}*y + {one}"
    straight, round_ = xx == xy == yy == 0, xx == yy != 0 and xy == 0
    wanted = (LINE if (x, y) != (0, 0) else CURVE) if straight else CIRCLE if round_ else CURVE
    assert path_kind(read_expression(text)) == wanted


# --- lines ------------------------------------------------------------------------------------------------------------


@given(whole, whole, whole, points, senses, st.sampled_from([1.0, -1.0, 0.01, 50.0]))
def test_the_foot_is_on_the_line_and_straight_below(a, b, c, point, sense, scale):
    assume((a, b) != (0, 0))
    line = line_of(path(f"{scale}*({a}*x+{b}*y+{c})"), point, sense)
    norm = math.hypot(a, b)
    (fx, fy), (tx, ty) = line.point_m, line.direction
    assert a * fx + b * fy + c == pytest.approx(0, abs=1e-9 * norm * 1000)
    assert tx * (point[0] - fx) + ty * (point[1] - fy) == pytest.approx(0, abs=1e-9 * 1000)
    # 90° to the left of the gradient, or to its right
    turned = np.array([[0, -1], [1, 0]]) @ np.array([a, b]) / norm * sense * math.copysign(1, scale)
    assert line.direction == near(tuple(turned))


# --- circles ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "parameters", "centre", "radius", "turn"),
    [
        ("(x+45)^2+(y-146)^2-4900-c1", (-1000,), (-45, 146), math.sqrt(3900), 1),
        ("2*x^2+2*y^2-8*x-5", (), (2, 0), math.sqrt(6.5), 1),
        ("-3*x^2-3*y^2+6*x+12*y+33", (), (1, 2), 4, -1),
        ("c1*(x^2+y^2)-25", (4,), (0, 0), 2.5, 1),
        ("25-c1*(x^2+y^2)", (4,), (0, 0), 2.5, -1),
    ],
)
def test_circles_worked_by_hand(text, parameters, centre, radius, turn):
    for point in ((0.0, 0.0), (300.0, -20.0), (1.0, 2.0)):
        for sense in (1, -1):
            circle = circle_of(path(text, *parameters), point, sense)
            assert circle.centre_m == near(centre)
            assert circle.radius_m == near(radius)
            assert circle.turn == turn * sense


@pytest.mark.parametrize(
    ("text", "parameter"),
    [("x^2+y^2+1", 0.0), ("x^2+y^2", 0.0), ("x^2+y^2-4900-c1", -5000.0), ("c1*(x^2+y^2)-25", 0.0)],
)
def test_no_circle_at_these_parameters(text, parameter):
    with pytest.raises(PathUndefined, match=r"is no circle|whose radius² is"):
        circle_of(path(text, parameter), (3.0, 4.0), 1)


def test_rotation_90_is_counter_clockwise_round_a_circle_positive_outside():
    outside = path("x^2+y^2-25")
    assert tangent(outside, (5.0, 0.0), COUNTER_CLOCKWISE) == near((0, 1))
    assert tangent(outside, (0.0, 5.0), COUNTER_CLOCKWISE) == near((-1, 0))
    assert tangent(outside, (5.0, 0.0), CLOCKWISE) == near((0, -1))
    inside = path("25-x^2-y^2")
    assert tangent(inside, (5.0, 0.0), COUNTER_CLOCKWISE) == near((0, -1)), "its gradient points to the centre"
    for function, sense in itertools.product((outside, inside), (1, -1)):
        circle = circle_of(function, (1.0, 1.0), sense)
        tx, ty = tangent(function, (3.0, 4.0), sense)
        assert math.copysign(1, 3 * ty - 4 * tx) == circle.turn, "r × t tells the turn"


@given(points, st.floats(0.1, 300), senses, st.floats(-10, 10), st.floats(0.01, 6.27))
def test_sweep_is_the_angle_travelled(centre, radius, turn, begin, sweep):
    circle = Circle(centre, radius, turn)
    start, end = circle.point_at(begin), circle.point_at(begin + turn * sweep)
    rounding = 1e-12 * (1 + math.hypot(*centre)) / radius + 1e-12
    assume(sweep < 2 * math.pi - 10 * rounding)
    assert circle.sweep_rad(start, end) == pytest.approx(sweep, abs=rounding)
    back = circle.sweep_rad(end, start)
    assert back == pytest.approx(2 * math.pi - sweep, abs=rounding)


@pytest.mark.parametrize("turn", [1, -1])
def test_the_same_point_but_for_rounding_is_a_whole_turn_in_the_west_too(turn):
    circle = Circle((-45.0, 146.0), 70.0, turn)
    for rounding in (1e-12, -1e-12):
        sweep = circle.sweep_rad((-115.0, 146.0 + rounding), (-115.0, 146.0 - rounding))
        assert sweep == pytest.approx(2 * math.pi)


# --- angles -----------------------------------------------------------------------------------------------------------


@given(st.floats(-1e4, 1e4))
def test_a_wrapped_angle_is_the_same_direction(angle):
    wrapped = wrap_angle_rad(angle)
    assert -math.pi < wrapped <= math.pi
    assert (math.cos(wrapped), math.sin(wrapped)) == near((math.cos(angle), math.sin(angle)))


# --- onto a path and along it -----------------------------------------------------------------------------------------


@given(points)
def test_projection_lands_on_a_curve(point):
    x, y = project(path("y - 10*sin(x/20)"), point)
    assert y == pytest.approx(10 * math.sin(x / 20), abs=1e-7)
    if abs(point[1]) < 12:  # near it, at the foot: the way there is along the gradient
        off = np.array([point[0] - x, point[1] - y])
        assert abs(off @ [1, 0.5 * math.cos(x / 20)]) <= 0.5 * np.linalg.norm(off) + 1e-6


@pytest.mark.parametrize(
    ("text", "point"), [("x^2+y^2+1", (1.0, 2.0)), ("x^2+y^2-25", (0.0, 0.0)), ("c1*x + 1", (1.0, 1.0))]
)
def test_projection_that_is_not_to_be_had(text, point):
    with pytest.raises(PathUndefined, match="no point near"):
        project(path(text, 0.0), point)


def test_no_value_no_direction_and_no_line_are_said():
    with pytest.raises(PathUndefined, match="no line"):
        line_of(path("c1*x", 0.0), (1.0, 1.0), 1)
    with pytest.raises(PathUndefined, match="has no value"):
        project(path("sqrt(x) - y"), (-1.0, 0.0))
    with pytest.raises(PathUndefined, match="no direction"):
        tangent(path("x^2+y^2-25"), (0.0, 0.0), 1)


def test_walking_keeps_to_the_path_with_even_steps():
    steps = list(itertools.islice(points_along(path("y - 10*sin(x/20)"), (0.0, 3.0), -1, 0.5), 200))
    for (x0, y0), (x1, y1) in itertools.pairwise(steps):
        assert y1 == pytest.approx(10 * math.sin(x1 / 20), abs=1e-7)
        assert math.dist((x0, y0), (x1, y1)) == pytest.approx(0.5, rel=LENGTH_SHARE)
        assert x1 > x0, "rotation 270 of y − f(x) runs east"


@pytest.mark.parametrize(("begin", "end"), [(0.0, 100.0), (-37.0, 3.0), (10.0, 12.0), (0.0, 400.0)])
def test_length_along_a_sine_is_its_integral(begin, end):
    wanted, _ = quad(lambda x: math.sqrt(1 + (0.5 * math.cos(x / 20)) ** 2), begin, end)
    start, stop = ((x, 10 * math.sin(x / 20)) for x in (begin, end))
    assert curve_length_m(path("y - 10*sin(x/20)"), start, stop, -1) == pytest.approx(wanted, rel=LENGTH_SHARE)
    assert curve_length_m(path("10*sin(x/20) - y"), start, stop, 1) == pytest.approx(wanted, rel=LENGTH_SHARE)
    assert curve_length_m(path("y - 10*sin(x/20)"), stop, start, 1) == pytest.approx(wanted, rel=LENGTH_SHARE)


def test_length_round_a_closed_curve_that_starts_at_its_end():
    # an ellipse of 60 by 40: Ramanujan's second formula is exact to 1e-9 here
    a, b = 60.0, 40.0
    h = ((a - b) / (a + b)) ** 2
    wanted = math.pi * (a + b) * (1 + 3 * h / (10 + math.sqrt(4 - 3 * h)))
    ellipse = path("x^2/3600 + y^2/1600 - 1")
    assert curve_length_m(ellipse, (60.0, 0.0), (60.0, 0.0), 1) == pytest.approx(wanted, rel=LENGTH_SHARE)
    assert curve_length_m(ellipse, (60.0, 0.0), (-60.0, 0.0), 1) == pytest.approx(wanted / 2, rel=LENGTH_SHARE)
