"""Expressions as data: grammar, canonical text, values, limits, and that nothing in a text is ever run."""

import ast
import math
import operator
import pickle

import pytest
from common import draws
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from eadp.core.expressions.algebra import is_zero, simplified
from eadp.core.expressions.reader import read_expression, read_expressions
from eadp.core.expressions.tree import (
    CONSTANT_LIMIT,
    DIGITS_LIMIT,
    EXPONENT_LIMIT,
    FUNCTIONS,
    LENGTH_LIMIT,
    NESTING_LIMIT,
    SIZE_LIMIT,
    constant,
    difference,
    named,
    number_text,
    substituted,
    total,
)
from eadp.errors import ExpressionError, PathUndefined

ROUNDING = 1e-12
SAME_VALUE = 1e-9
PLACE = {"x": 1.25, "y": -2.5, "c1": 3.0, "c2": 0.75}


def error_of(text, *names):
    with pytest.raises(ExpressionError) as caught:
        read_expression(text, names)
    return caught.value


def at(expression, parameters=(), x=0.0, y=0.0):
    """The value of an expression at parameters c1, c2, … and a point."""
    return expression.value({"x": x, "y": y, **named(parameters)})


def value_of(text):
    return at(read_expression(text), (PLACE["c1"], PLACE["c2"]), PLACE["x"], PLACE["y"])


def test_arithmetic_of_expressions():
    a, b = (read_expression(text) for text in ("c1*x - 1", "abs(y) + c2"))
    assert at(total(a, b), (3.0, 0.75), 1.25, -2.5) == 3.0 * 1.25 - 1 + 2.5 + 0.75
    assert at(difference(a, b), (3.0, 0.75), 1.25, -2.5) == 3.0 * 1.25 - 1 - 2.5 - 0.75
    assert total(a, b).size == difference(a, b).size == a.size + b.size + 1
    assert {*total(a, b).offsets} == {*a.offsets, *b.offsets}
    shared = read_expression("2 + c1")
    assert total(a, shared).offsets["c1"] == difference(a, shared).offsets["c1"] == a.offsets["c1"]


# --- an oracle: Python's own parser, and real arithmetic over its tree ------------------------------------------------


class NotReal(Exception):
    """The oracle has no finite real value."""


def real(value):
    if isinstance(value, complex) or not math.isfinite(value):
        raise NotReal
    return value


OPERATORS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
WORDS = {name: getattr(math, name) for name in FUNCTIONS if hasattr(math, name)} | {"abs": abs, "min": min, "max": max}


def pythons_value(text):
    """The value of a text as Python reads it, with ** for ^, in real arithmetic."""

    def value(node):
        if isinstance(node, ast.Constant):
            return float(node.value)
        if isinstance(node, ast.Name):
            return math.pi if node.id == "pi" else PLACE[node.id]
        if isinstance(node, ast.UnaryOp):
            return -value(node.operand) if isinstance(node.op, ast.USub) else value(node.operand)
        if isinstance(node, ast.BinOp):
            return real(OPERATORS[type(node.op)](value(node.left), value(node.right)))
        return real(WORDS[node.func.id](*[value(argument) for argument in node.args]))

    try:
        return real(value(ast.parse(text.replace("^", "**").strip(), mode="eval").body))
    except (ArithmeticError, ValueError):
        raise NotReal from None


def unless_limited(read):
    """What `read` gives; None where a constant or an exponent is refused, the one thing allowed to be wrong."""
    try:
        return read()
    except ExpressionError as error:
        if error.message.startswith(("a constant part", "a constant exponent")):
            return None
        raise


# --- texts and trees to try -------------------------------------------------------------------------------------------

ONE_ARGUMENT = sorted(name for name, (_, most) in FUNCTIONS.items() if most == 1)
SEVERAL_ARGUMENTS = sorted(set(FUNCTIONS) - set(ONE_ARGUMENT))

numerals = st.sampled_from(["0", "1", "2", "3", "10", "0.5", ".25", "4.", "1e2", "2.5e-1", "75"])
words = st.sampled_from([*PLACE, "pi"])


def longer_text(shorter):
    """Texts of the grammar without implicit products, so that Python reads them too."""
    binary = st.tuples(shorter, st.sampled_from(["+", "-", " * ", "/", "^", "**", " - ", "^-"]), shorter)
    return st.one_of(
        binary.map("".join),
        shorter.map("({})".format),
        shorter.map("-{}".format),
        shorter.map("+{}".format),
        st.tuples(st.sampled_from(ONE_ARGUMENT), shorter).map(lambda parts: "{}({})".format(*parts)),
        st.tuples(st.sampled_from(SEVERAL_ARGUMENTS), shorter, shorter).map(lambda parts: "{}({}, {})".format(*parts)),
    )


texts = st.recursive(st.one_of(numerals, words), longer_text, max_leaves=12)


# --- grammar ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2-3-4", -5),
        ("2^3^2", 512),
        ("-2^2", -4),
        ("2pi", 2 * math.pi),
        ("3(1+1)", 6),
        ("2sqrt(49)", 14),
        ("2^3(2)", 16),  # ^ binds tighter than the product that is not written
        ("2^3pi", 8 * math.pi),
        ("12/2pi", 6 * math.pi),  # from left to right, as where it is written
        ("2exp(0)", 2),  # not the start of 2e…
        ("atan2(1, -1)", 3 * math.pi / 4),
        ("acos(-1)+asin(1)+atan(1)", 1.75 * math.pi),
        ("0^0", 1),
    ],
)
def test_value_worked_by_hand(text, value):
    assert value_of(text) == pytest.approx(value, rel=ROUNDING)


@pytest.mark.parametrize(
    ("text", "offset"),
    [
        ("", 0),
        ("2 3", 2),
        ("(x)2", 3),
        ("x+", 2),
        ("x,y", 1),
        ("sqrt", 4),
        ("1+sqrt(1,2)", 2),
        ("1+max(x)", 2),
        ("sin(x,)", 6),
        ("1 + C1", 4),
        ("１", 0),  # a digit that is none of the ten
        ("4900−c1", 4),  # the minus sign of print
    ],
)
def test_what_breaks_the_grammar_and_where(text, offset):
    assert error_of(text).offset == offset


def test_the_message_says_what_and_the_expectation_what_else():
    error = error_of("2*(x+radius)")
    assert (error.message, error.offset) == ("unknown name radius", 5)
    assert error.expected.startswith("x, y, c1 … c999, pi")
    assert "left" in error_of("2*radius", "left").expected
    assert "sqrt" in error_of("root(2)").expected
    assert error_of("x\x1b[2J").message == "unexpected character '\\x1b'"
    assert len(error_of("z" * 5000).message) < 100


def test_names_and_offsets():
    expression = read_expression("  y + c12*x - y + pi")
    assert expression.names == {"x", "y", "c12"}
    assert expression.offsets == {"y": 2, "c12": 6, "x": 10}
    assert expression.max_parameter == 12
    assert read_expression("pi").max_parameter == 0


def test_lists_of_expressions():
    first, second = read_expressions("-115, 150 - 2*sqrt(4900 + c1)", count=2)
    assert (at(first), at(second, (0,))) == (-115, 10)
    assert second.offsets == {"c1": 26}, "in the whole text"
    assert len(read_expressions("1, min(2, 3), (4)")) == 3
    with pytest.raises(ExpressionError, match="1 of 2 values") as caught:
        read_expressions("1", count=2)
    assert caught.value.offset == 1
    with pytest.raises(ExpressionError, match="',' cannot stand here"):
        read_expressions("1, 2, 3", count=2)


def test_a_function_that_is_not_smooth_is_known():
    assert read_expression("x + max(x, sqrt(y))").non_smooth == "max"
    assert read_expression("sqrt(x)").non_smooth == ""
    first, second = read_expressions("abs(x), y")
    assert (first.non_smooth, second.non_smooth) == ("abs", "")


@given(texts)
@example("-2^2")
@example("2^-2^2")
def test_values_are_those_of_pythons_own_parser(text):
    try:
        wanted = pythons_value(text)
    except NotReal:
        with pytest.raises((ExpressionError, PathUndefined)):
            value_of(text)
        return
    expression = unless_limited(lambda: read_expression(text))
    if expression is not None:
        assert value_of(text) == pytest.approx(wanted, rel=SAME_VALUE, abs=SAME_VALUE)
        assert read_expression(expression.text).node == expression.node


# --- canonical text ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("(x+45)^2+(y-146)^2-4900-c1", "(x + 45)^2 + (y - 146)^2 - 4900 - c1"),
        ("3(x-1)(y)", "3*(x - 1)*y"),
        ("x-(-y)", "x - -y"),
        ("x-(y-1)", "x - (y - 1)"),
        ("(-x)^2", "(-x)^2"),
        ("max(x,(y))", "max(x, y)"),
    ],
)
def test_canonical_text_worked_by_hand(text, canonical):
    assert read_expression(text).text == canonical


@given(st.floats(0, CONSTANT_LIMIT))
def test_numbers_keep_every_digit(value):
    assert float(number_text(value)) == value
    assert at(read_expression(number_text(value))) == value
    assert at(constant(-value)) == -value
    assert at(read_expression(constant(-value).text)) == -value


# --- constants that are no numbers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "culprit"),
    [
        ("x + 1/0", "/"),
        ("1/x/0", "/"),  # the chain's first operator
        ("x + (-8)^(1/3)", "^"),
        ("x + log(0)", "log"),
    ],
)
def test_constants_that_are_no_finite_real_number(text, culprit):
    error = error_of(text)
    assert error.offset == text.index(culprit)
    assert (error.message, error.expected) == ("a constant part without a finite real value", "a finite real number")


@pytest.mark.parametrize(
    ("text", "offset"), [("x+1e301", 2), ("x+1e200*1e101", 7), ("x*1e200*y*1e200", 1), ("x+10^64^0.9*exp(690)", 11)]
)
def test_constants_that_are_too_large(text, offset):
    error = error_of(text)
    assert (error.offset, error.message) == (offset, "a constant part that is too large")
    assert "1e+300" in error.expected


@pytest.mark.parametrize("text", ["9**9**9", "9^9^9^9", "x^65", "x^-65", "x^64.5", "2^x^65", "x^(8*9)"])
def test_exponents_have_a_limit(text):
    error = error_of(text)
    assert error.message.startswith("a constant exponent of ")
    assert f"-{EXPONENT_LIMIT} to {EXPONENT_LIMIT}" in error.expected
    assert text[error.offset] in "^*"


@pytest.mark.parametrize("text", ["x^64", "x^-64", "1e300*x", "x^c1", "x + 1e150*1e150", "((x^64)^64)^64"])
def test_at_the_limits_it_reads(text):
    assert read_expression(text).names >= {"x"}


# --- other limits -----------------------------------------------------------------------------------------------------


def test_length_limit():
    assert read_expression("x" + " " * (LENGTH_LIMIT - 1)).text == "x"
    error = error_of("x" + " " * LENGTH_LIMIT)
    assert (error.offset, error.message) == (0, "an expression of 10001 characters")
    assert error.expected == "at most 10000 characters"


@pytest.mark.parametrize(
    ("before", "after"), [("(", ")"), ("sqrt(", ")"), ("-", ""), ("+", ""), ("2^", ""), ("x*(", ")"), ("(1 + 2*-", ")")]
)
def test_nesting_limit(before, after):
    def nested(levels):
        return before * levels + "x" + after * levels

    deepest = next(n for n in range(NESTING_LIMIT, 0, -1) if not fails(nested(n)))
    assert deepest in (NESTING_LIMIT, NESTING_LIMIT // 2), "the last has two levels in one"
    error = error_of(nested(deepest + 1))
    assert error.message == f"nested deeper than {NESTING_LIMIT} levels"
    expression = read_expression(nested(deepest))
    assert read_expression(expression.text).node == expression.node
    assert isinstance(expression.names, frozenset)


def fails(text):
    try:
        read_expression(text)
    except ExpressionError:
        return True
    return False


def test_digits_limit():
    assert at(read_expression("1" * DIGITS_LIMIT)) == pytest.approx(1e50 / 9)
    for text in ("x+" + "1" * (DIGITS_LIMIT + 1), "x+0." + "1" * DIGITS_LIMIT, "x+1e" + "0" * DIGITS_LIMIT):
        error = error_of(text)
        assert error.offset == 2
        assert error.expected == f"at most {DIGITS_LIMIT} digits"


# --- nothing is run, nothing but ExpressionError ----------------------------------------------------------------------


@pytest.mark.parametrize("text", ["__import__('os')", "().__class__.__bases__[0]", "x if x else y", "1j", "x@y", "nan"])
def test_code_is_no_expression(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    error_of(text)
    assert not list(tmp_path.iterdir())


@settings(max_examples=draws(0.5))
@given(texts, st.integers(0, 100), st.text(max_size=3), st.integers(0, 3))
def test_a_text_that_is_tampered_with_is_read_or_refused(text, at, inserted, dropped):
    at %= len(text) + 1
    read_or_refuse(text[:at] + inserted + text[at + dropped :])


def read_or_refuse(text):
    if fails(text):
        error = error_of(text)
        assert 0 <= error.offset <= len(text)
        assert error.message
        assert error.message.isprintable()
        return
    expression = read_expression(text)
    assert read_expression(expression.text).node == expression.node
    try:
        assert math.isfinite(at(expression, (1.5,) * 999, 0.25, -2.0))
    except PathUndefined:
        return


# --- values -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "point"),
    [
        ("1/x", (0.0, 0.0)),
        ("exp(x)", (1e4, 0.0)),
        ("x*1e300", (1e300, 0.0)),
        ("x*1e300 - x*1e300", (1e300, 0.0)),  # inf − inf
    ],
)
def test_no_value_at_a_point(text, point):
    with pytest.raises(PathUndefined, match="no finite real value here"):
        at(read_expression(text), (), *point)


def test_a_parameter_without_a_value():
    with pytest.raises(PathUndefined, match="c2 has no value"):
        at(read_expression("c1 + c2"), (1.0,))
    assert at(read_expression("c1 + c2"), (1.0, 2.0, 9.0)) == 3


# --- substitution -----------------------------------------------------------------------------------------------------


@given(texts, texts)
def test_a_substituted_value_is_the_value_of_the_value(outer, inner):
    assume(not fails(outer) and not fails(inner))
    whole = unless_limited(lambda: substituted(read_expression(outer), {"x": read_expression(inner)}))
    if whole is None:
        return
    parameters, y = (PLACE["c1"], PLACE["c2"]), PLACE["y"]
    try:
        wanted = at(read_expression(outer), parameters, value_of(inner), y)
    except PathUndefined:
        return
    assert at(whole, parameters, PLACE["x"], y) == pytest.approx(wanted, rel=SAME_VALUE, abs=SAME_VALUE)


def test_substitution_keeps_offsets_names_and_size():
    outer = read_expression("y - left^2", {"left"})
    inner = read_expression("min(c3, 2) - 1")
    whole = substituted(outer, {"left": inner})
    assert whole.text == "y - (min(c3, 2) - 1)^2"
    assert whole.offsets == {"y": 0, "c3": 4}, "where the name stood"
    assert whole.non_smooth == "min"
    assert (outer.non_smooth, outer.names) == ("", {"y", "left"}), "unchanged"
    assert read_expression(whole.text).node == whole.node


def test_substitution_has_a_limit():
    large = read_expression("+".join(["x"] * 4000))
    outer = read_expression("1 + left + left + left + left + left + left", {"left"})
    with pytest.raises(ExpressionError, match="too many parts") as caught:
        substituted(outer, {"left": large})
    assert caught.value.offset == 4
    assert str(SIZE_LIMIT) in caught.value.expected


@pytest.mark.parametrize("text", ["1/(left - 5)", "sqrt(-left)", "x^(13*left + 1)", "9^9^left", "exp(left^7)"])
def test_constants_that_arise_by_substitution_are_checked(text):
    with pytest.raises(ExpressionError):
        substituted(read_expression(text, {"left"}), {"left": constant(5.0)})


# --- sympy ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "x - x",
        "sin(c1)^2 + cos(c1)^2 - 1",
        "sqrt(c1^2) - abs(c1)",
        "exp(log(2) + c1) - 2*exp(c1)",
        "0.1*x + 0.2*x - 0.3*x",  # exact, where floats leave 5e-17
        "log(0*x + 1)",
    ],
)
def test_zero_in_disguise(text):
    assert is_zero(read_expression(text).node)


@pytest.mark.parametrize(
    "text",
    ["1", "1e-300", "x", "1e-7*c1", "1e-12", "c1 - c2", "x - 0.999999999999*x", "sqrt(c1)", "log(c1)", "1/c1", "0^c1"],
)
def test_not_zero_however_small(text):
    assert not is_zero(read_expression(text).node)


@given(*[st.integers(-9, 9)] * 6, st.sampled_from([0, 1, -1, 1e-7]))
def test_a_product_less_its_expansion_is_zero(a, b, c, d, e, f, rest):
    factored = f"({a}*x + {b}*c1 + {c})*({d}*x + {e}*c1 + {f})"
    expanded = f"{a * d}*x^2 + {a * e + b * d}*x*c1 + {b * e}*c1^2 + {a * f + c * d}*x + {b * f + c * e}*c1 + {c * f}"
    tree = read_expression(f"{factored} - ({expanded}) + {rest}").node
    assert is_zero(tree) == (rest == 0)


@example("atan2(0, -0)")
@example("atan2(0*-1, -2)")
@given(texts)
def test_simpler_has_the_same_value(text):
    try:
        wanted = value_of(text)
        simpler = simplified(read_expression(text))
    except (ExpressionError, PathUndefined):
        return
    got = at(simpler, (PLACE["c1"], PLACE["c2"]), PLACE["x"], PLACE["y"])
    assert got == pytest.approx(wanted, rel=1e-6, abs=1e-6)


def test_an_expression_that_has_been_evaluated_can_be_pickled():
    expression = read_expression("150 - 2*sqrt(4900 + c1)/c2")
    value = at(expression, (-1000.0, 4.0))
    again = pickle.loads(pickle.dumps(expression))
    assert again == expression
    assert at(again, (-1000.0, 4.0)) == value == 150 - 2 * math.sqrt(3900) / 4
