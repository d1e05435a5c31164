"""Value, gradient and Hessian of path functions, against differences in 60 digits."""

import mpmath
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eadp.core.expressions.derivatives import bind
from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import named
from eadp.errors import ExpressionError, PathUndefined

RELATIVE, ABSOLUTE = 1e-9, 1e-12
DIGITS = 60
ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
C = (0.7, 2.0, -1.3)
POINT = (1.3, 0.45)


def jet_of(text, point=POINT, parameters=C):
    return bind(read_expression(text), named(parameters))(*point)


WORDS = {name: getattr(mpmath, name) for name in ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp")}
WORDS |= {"log": mpmath.log, "abs": abs, "min": min, "max": max, "pi": mpmath.pi}


def by_differences(text, point=POINT, parameters=C):
    """The jet from differences of the text's value in many digits. The text is the test's own, run as Python."""
    code = compile(text.replace("^", "**"), "<a text of this test>", "eval")
    constants = {f"c{i}": mpmath.mpf(value) for i, value in enumerate(parameters, 1)}

    def function(x, y):
        return eval(code, {"__builtins__": {}}, WORDS | constants | {"x": x, "y": y})

    with mpmath.workdps(DIGITS):
        where = (mpmath.mpf(point[0]), mpmath.mpf(point[1]))
        return [float(mpmath.diff(function, where, n) if any(n) else function(*where)) for n in ORDERS]


@pytest.mark.parametrize(
    "text",
    [
        "x - y - c1 + 3.0", "(x + 45.0)^2.0 + (y - 146.0)^2.0 - 4900.0 - c1", "sqrt(x*y)", "sin(x*y)", "cos(x/y)",
        "tan(x - y^2.0)", "asin(x*y - 0.2)", "acos(x*y - 0.2)", "atan(x*y)", "exp(x*y - c1)", "log(x + y^2.0)",
        "abs(x - 2.0*y)", "atan2(x*y, x - y)", "atan2(x, 2.0)", "atan2(2.0, y)", "atan2(c1*x, c2)", "min(x^2.0, y)",
        "max(y, x^2.0, x*y + 5.0)", "max(x*y, c3)", "x^0.0", "x^-2.0", "(-x)^5.0", "x^0.5", "x^(1.0/3.0)", "x^c1",
        "c2^x", "(x*y + 1.0)^(x - y)", "sin(c1)*x + atan2(c1, c2)*y - min(c1, c2)*x*y + abs(c3)*x^2.0",
    ],
)  # fmt: skip
def test_jet_of_each_function(text):
    assert jet_of(text) == pytest.approx(by_differences(text), rel=RELATIVE, abs=ABSOLUTE)


numerals = st.sampled_from(["2.0", "0.5", "3.0", "1.25", "7.0"])
parts = st.one_of(st.sampled_from(["x", "y", "x", "y", "c1", "c2", "c3"]), numerals)


def longer(shorter):
    """Smooth texts, each defined wherever its parts are."""
    two = st.tuples(shorter, shorter)
    return st.one_of(
        two.map(lambda t: f"({t[0]} + {t[1]})"),
        two.map(lambda t: f"({t[0]} - {t[1]})"),
        two.map(lambda t: f"{t[0]}*{t[1]}"),
        two.map(lambda t: f"{t[0]}/(1.5 + ({t[1]})^2.0)"),
        two.map(lambda t: f"(2.0 + sin({t[0]}))^cos({t[1]})"),
        two.map(lambda t: f"atan2({t[0]}, 1.5 + sin({t[1]}))"),
        two.map(lambda t: f"min({t[0]}, {t[1]})"),
        two.map(lambda t: f"max({t[0]}, {t[1]}, c3)"),
        shorter.map("-({})".format),
        shorter.map("({})^3.0".format),
        shorter.map("(2.5 + cos({}))^c1".format),
        shorter.map("(2.5 + cos({}))^-1.5".format),
        shorter.map("sqrt(1.1 + ({})^2.0)".format),
        shorter.map("log(1.1 + ({})^2.0)".format),
        shorter.map("exp(sin({}))".format),
        shorter.map("tan(atan({})/2.0)".format),
        shorter.map("asin(0.9*cos({}))".format),
        shorter.map("acos(0.9*sin({}))".format),
        shorter.map("abs({})".format),
    )


texts = st.recursive(parts, longer, max_leaves=7)
coordinate = st.integers(-30, 30).map(lambda k: k / 8 + 0.0625)
points = st.tuples(coordinate, coordinate)


def derivative_jumps(text, point):
    """Whether a point is at, or within rounding of, a kink of abs, min or max: there differences mean nothing."""
    try:
        one = bind(read_expression(text), named(C))(*point)
        near = bind(read_expression(text), named(C))(point[0] + 1e-9, point[1] + 2e-9)
    except (ArithmeticError, ValueError):
        return True
    return any(abs(a - b) > 1e-5 * (1 + abs(a)) for a, b in zip(one, near, strict=True))


@given(texts, points)
def test_jet_by_differences(text, point):
    assume(not derivative_jumps(text, point))
    jet, oracle = jet_of(text, point), by_differences(text, point)
    scale = max(map(abs, oracle))
    assume(scale < 1e6)
    assert jet == pytest.approx(oracle, rel=1e-8, abs=1e-10 * (1 + scale))


@given(texts, points)
def test_the_value_is_that_of_the_expression(text, point):
    wanted = read_expression(text).value({**named(C), "x": point[0], "y": point[1]})
    assert jet_of(text, point)[0] == pytest.approx(wanted, rel=RELATIVE, abs=ABSOLUTE)


def test_constants_and_parameters_of_one_path_do_not_reach_another():
    one, other = bind(read_expression("c1*x - 5"), named((2.0,))), bind(read_expression("c1*x - 7"), named((3.0,)))
    assert (one(10, 0)[0], other(10, 0)[0]) == (15, 23)
    again = bind(read_expression("c1*x - 5"), named((4.0,)))
    assert (again(10, 0)[0], one(10, 0)[0]) == (35, 15)


@pytest.mark.quick(2)
@pytest.mark.parametrize("before", ["sin(", "sqrt(1+2*", "-(1 + x*(", "2^("])
def test_the_deepest_expression_that_reads_can_be_flown(before):
    levels = 100
    while True:
        try:
            expression = read_expression(before * levels + "x/1e40" + ")" * before.count("(") * levels)
            break
        except ExpressionError:
            levels -= 1
    path = bind(expression, {})
    try:
        assert len(path(0.5, 0.5)) == 6
    except OverflowError:
        assert before == "2^("


@pytest.mark.parametrize(
    ("text", "point"),
    [
        ("1/x", (0.0, 0.0)),
        ("sqrt(x)", (-1.0, 0.0)),
        ("exp(x)", (1e4, 0.0)),
        ("sqrt(x)", (0.0, 0.0)),  # a value, but no gradient
        ("atan2(x, y)", (0.0, 0.0)),
    ],
)
def test_undefined_at_a_point_is_an_arithmetic_error(text, point):
    path = bind(read_expression(text), {})
    with pytest.raises((ArithmeticError, ValueError)):
        path(*point)


@pytest.mark.parametrize("text", ["x - sqrt(4900 + c1)", "x*log(4900 + c1)", "x/(c1 + 5000)", "(c1 + 4900)^0.5*y"])
def test_undefined_at_parameters_is_said_when_they_are_bound(text):
    bind(read_expression(text), named((0.0,)))
    with pytest.raises(PathUndefined, match="no finite real value at these parameters"):
        bind(read_expression(text), named((-5000.0,)))


def test_a_parameter_without_a_value():
    with pytest.raises(PathUndefined, match="names a parameter that has no value"):
        bind(read_expression("x - c2"), named((1.0,)))
    assert bind(read_expression("x - c2"), named((1.0, 2.0, 3.0)))(5, 0)[0] == 3
