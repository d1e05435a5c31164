"""Paths as travelled to a point: a circle, a line and a curve whose lengths and directions are known."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from eadp.core.expressions.derivatives import bind
from eadp.core.expressions.reader import read_expression
from eadp.core.geometry.curves import TRACKS, path_kind, radius_of_curvature_m

NANOMETRE, MILLIMETRE = 1e-9, 1e-3
BACK = math.radians(30)


def track(text, end, sense):
    expression = read_expression(text)
    return TRACKS[path_kind(expression)](bind(expression, {}), end, sense)


def on_round(angle, radius=50.0):
    return 10 + radius * math.cos(angle), 20 + radius * math.sin(angle)


@pytest.mark.parametrize("sense", [1, -1])
def test_a_circle(sense):
    circle = track("(x - 10)^2 + (y - 20)^2 - 2500", (60.0, 20.0), sense)  # to its easternmost point
    before = on_round(-sense * BACK)
    assert circle.radius_m() == pytest.approx(50)
    assert circle.nearest(on_round(1.0, 80.0)) == pytest.approx(on_round(1.0))
    assert circle.ahead_m(before) == pytest.approx(50 * BACK)
    assert circle.ahead_m(on_round(sense * BACK)) == pytest.approx(50 * (2 * math.pi - BACK))
    assert circle.approach() == pytest.approx(on_round(-sense * math.pi / 2))
    # the distance left is known but for whole turns
    for turns, guess_m in ((0, 30.0), (0, 150.0), (0, -110.0), (1, 330.0), (2, 660.0), (-1, -300.0)):
        assert circle.remaining_m(before, guess_m) == pytest.approx(50 * (BACK + turns * 2 * math.pi))
    for k, (x, y, heading) in enumerate(circle.points(before, 50 * BACK, 1.0, 3)):
        angle = -sense * BACK * (1 - k / 3)
        assert (x, y) == pytest.approx(on_round(angle), abs=NANOMETRE)
        assert heading == pytest.approx(angle + sense * math.pi / 2)
    for x, y, heading in circle.points((60.0, 20.0), 100 * math.pi, 1.0, 8):
        assert (math.cos(heading), math.sin(heading)) == pytest.approx(
            (sense * (20 - y) / 50, sense * (x - 10) / 50), abs=NANOMETRE
        )
        assert abs(heading) <= math.pi + NANOMETRE
    nodes = circle.nodes(before, 50 * BACK, 1.0)
    assert len(nodes.weights_m) == 2
    assert nodes.weights_m.sum() == pytest.approx(50 * BACK)
    assert nodes.curvature_per_m == pytest.approx([sense / 50] * 2)
    # ∫ (cos, sin) ds is the way made good
    end = (60.0, 20.0)
    assert nodes.weights_m @ nodes.cosine == pytest.approx(end[0] - before[0], abs=0.001)
    assert nodes.weights_m @ nodes.sine == pytest.approx(end[1] - before[1], abs=0.001)
    assert len(circle.nodes(end, 100 * math.pi, 1.0).weights_m) == 16, "four in a quarter"
    assert len(circle.nodes(end, 200 * math.pi, 1.0).weights_m) == 16


def test_a_line():
    # 3 y = 4 x, travelled up, by (0.6, 0.8)
    line = track("3*y - 4*x", (30.0, 40.0), -1)
    assert line.radius_m() == math.inf
    assert line.nearest((8.0, -6.0)) == pytest.approx((0, 0), abs=NANOMETRE)
    assert line.ahead_m((8.0, -6.0)) == pytest.approx(50)
    assert line.ahead_m((36.0, 48.0)) == pytest.approx(-10)
    assert line.remaining_m((0.0, 0.0), 7.0) == pytest.approx(50)
    assert line.approach() == pytest.approx((30 - 60, 40 - 80))
    x, y, headings = line.points((0.0, 0.0), 25.0, 0.5, 2).T
    assert x == pytest.approx([0, 7.5, 15], abs=NANOMETRE)
    assert y == pytest.approx([0, 10, 20], abs=NANOMETRE)
    assert headings == pytest.approx([math.atan2(4, 3)] * 3)
    nodes = line.nodes((0.0, 0.0), 25.0, 0.5)
    assert [part.tolist() for part in nodes] == [[25.0], pytest.approx([0.6]), pytest.approx([0.8]), [0.0]]


def parabola_m(x):
    """Length of y = x²/100 from x = 0."""
    return quad(lambda at: math.hypot(1, at / 50), 0, x)[0]


def test_a_curve():
    # y = x²/100, travelled to the east; at its lowest point the radius is 1/y'' = 50 m
    curve = track("y - x^2/100", (30.0, 9.0), -1)
    assert curve.nearest((0.0, -3.0)) == pytest.approx((0, 0), abs=NANOMETRE)
    assert curve.ahead_m((0.0, 0.0)) == pytest.approx(parabola_m(30), rel=1e-3)
    assert curve.remaining_m((0.0, 0.0), 7.0) == 7.0
    # (1 + y'²)^1.5 / y''
    assert curve.radius_m() == pytest.approx((1 + 0.6**2) ** 1.5 * 50)
    x, y = curve.approach()
    assert y == pytest.approx(x * x / 100, abs=MILLIMETRE)
    assert parabola_m(30) - parabola_m(x) == pytest.approx(100, rel=0.01)
    length_m = parabola_m(30)
    points = curve.points((0.0, 0.0), length_m, 1.0, 4)
    for k, (x, y, heading) in enumerate(points):
        assert y == pytest.approx(x * x / 100, abs=MILLIMETRE)
        assert parabola_m(x) == pytest.approx(length_m * k / 4, abs=0.05)
        assert heading == pytest.approx(math.atan(x / 50), abs=1e-6)
    assert points[-1, :2] == pytest.approx((30, 9))
    half = curve.points((0.0, 0.0), length_m / 2, 0.5, 2)
    assert half[-1, :2] == pytest.approx(points[2, :2], abs=0.01)
    nodes = curve.nodes((0.0, 0.0), length_m, 1.0)
    assert len(nodes.weights_m) == 24
    assert nodes.weights_m.sum() == pytest.approx(length_m)
    assert nodes.weights_m @ nodes.cosine == pytest.approx(30, abs=0.01)
    assert nodes.weights_m @ nodes.sine == pytest.approx(9, abs=0.01)
    # ∫ κ ds is the turn
    assert nodes.weights_m @ nodes.curvature_per_m == pytest.approx(math.atan(0.6), abs=1e-6)
    assert len(curve.nodes((0.0, 0.0), 0.0, 0.0).weights_m) == 1


def test_a_curve_that_turns_by_more_than_half_a_circle_has_no_jump():
    # an ellipse, from its easternmost point round to its southernmost: the heading turns from 90° to 360°
    ellipse = track("x^2/400 + y^2/100 - 1", (0.0, -10.0), 1)
    length_m = quad(lambda a: math.hypot(20 * math.sin(a), 10 * math.cos(a)), 0, 1.5 * math.pi)[0]
    nodes = ellipse.nodes((20.0, 0.0), length_m, 1.0)
    assert nodes.weights_m @ nodes.curvature_per_m == pytest.approx(1.5 * math.pi, abs=1e-6)
    assert np.all(nodes.curvature_per_m > 0)


def test_the_radius_of_curvature():
    def radius(text, point):
        return radius_of_curvature_m(bind(read_expression(text), {}), point)

    # ellipse x²/a² + y²/b² = 1: b²/a and a²/b at its vertices
    assert radius("x^2/400 + y^2/100 - 1", (20.0, 0.0)) == pytest.approx(5)
    assert radius("x^2/400 + y^2/100 - 1", (0.0, 10.0)) == pytest.approx(40)
    # hyperbola x y = 50 at (5, 10): (x² + y²)^1.5 / (2 · 50)
    assert radius("x*y - 50", (5.0, 10.0)) == pytest.approx(125**1.5 / 100)
    assert radius("x + y", (1.0, -1.0)) == math.inf
