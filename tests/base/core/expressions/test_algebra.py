"""What is given to sympy, and what is not: the limits that keep it short."""

import pytest
import sympy
from common import draws
from hypothesis import given, settings
from hypothesis import strategies as st

from eadp.core.expressions import algebra
from eadp.core.expressions.algebra import SymbolicStage, cancels, limited, simplified
from eadp.core.expressions.reader import read_expression
from eadp.errors import EadpError

SUMS = "*".join(f"(c1 + c2 + c3 + c4 + c5 + {i})" for i in range(4))
HALVES = "(" * 60 + "0.5" + ")^2" * 60


@pytest.mark.parametrize(
    "text", ["c1 - c1", "(c1 + 2)^2 - c1^2 - 4*c1 - 4", "sqrt(c1 + 4) - sqrt(4 + c1)", "0.1*x - x/10", "c1^c2 - c1^c2"]
)
def test_what_cancels(text):
    assert cancels(read_expression(text))


@pytest.mark.parametrize("text", ["c1", "c1 - c2", "c1 - 0.999999999999999*c1", "x - x + 1e-30", "1/(c1 - c1)"])
def test_what_does_not(text):
    assert not cancels(read_expression(text))


@pytest.mark.parametrize(
    "text",
    [
        f"{SUMS}*{SUMS}",  # 6^8 terms, 1287 of them different
        f"{HALVES}*c1 - {HALVES}*c1",  # 2^60 digits
    ],
)
def test_what_might_take_long_is_not_tried(text):
    expression = read_expression(text)
    assert not cancels(expression)
    assert simplified(expression) is expression


NUMBERS = st.sampled_from(["0", "1", "2", "3", "75", "0.5", "1.25", "0.1", "4900", "123456.7"])
ROOTS = st.builds("sqrt({} + c1)".format, NUMBERS) | st.builds("sqrt(c1 - {})".format, NUMBERS)
LEAVES = NUMBERS | st.sampled_from(["c1", "c2", "x", "sqrt(c1)", "pi", "sqrt(4*c1 + 8)", "sqrt(4900 - c1)"]) | ROOTS
TREES = st.recursive(
    LEAVES,
    lambda part: st.one_of(
        st.builds("({} + {})".format, part, part),
        st.builds("({} - {})".format, part, part),
        st.builds("{}*{}".format, NUMBERS, part),
        st.builds("{}/{}".format, part, st.sampled_from(["2", "0.3", "10"])),
        st.builds("{}*{}".format, part, part),
        st.builds("(-{})".format, part),
    ),
    max_leaves=8,
)


@settings(max_examples=draws(0.5))
@given(TREES)
def test_what_is_multiplied_out_is_what_sympy_shows(text):
    expression = read_expression(text)
    shown = sympy.expand(algebra.to_sympy(simplified(expression).node) - algebra.to_sympy(expression.node))
    assert shown == 0
    assert cancels(expression) == (sympy.expand(algebra.to_sympy(expression.node)) == 0) or "sqrt" in text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("(45 + 2*(40 - sqrt(4900 + c1)) + 25) - 0", "150 - 2*sqrt(4900 + c1)"),
        ("(2*(75 - sqrt(4900 + c1)))/10", "15 - sqrt(4900 + c1)/5"),
        ("c1/4 + c1/4 - 0.5*c1 + 7", "7"),
        ("(c1 - 3 + 3)/1", "c1"),
        ("c1*c2*c1*3/2 + c1 - 2*c1", "-c1 + 3*c1^2*c2/2"),
    ],
)
def test_shifts_are_shown_short(text, shown):
    assert simplified(read_expression(text)).text == shown


def test_a_stage_as_sympy_has_it():
    x, y, c1 = sympy.symbols("x y c1", real=True)
    path, *trigger = map(read_expression, ("(x - c1)^2 + 3*y^2*x - 4", "c1 + 2", "0"))
    circle = SymbolicStage.of(path, tuple(trigger))
    assert circle.path == (x - c1) ** 2 + 3 * y**2 * x - 4
    assert [sympy.expand(value) for value in circle.gradient] == [2 * x - 2 * c1 + 3 * y**2, 6 * x * y]
    assert circle.hessian == sympy.Matrix([[2, 6 * y], [6 * y, 6 * x]])
    assert list(circle.trigger) == [c1 + 2, 0]


@pytest.mark.parametrize("text", ["((c1^10)^10)^10*c1", "c1 + " * 450 + "c1"])
def test_what_is_too_large_for_sympy_is_refused(text):
    with pytest.raises(EadpError, match="too large for sympy: at most"):
        limited(read_expression(text))
