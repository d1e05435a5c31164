"""What is given to sympy, and what is not: the limits that keep it short."""

from __future__ import annotations

import pytest

from eadp.core.expressions.algebra import cancels, simplified
from eadp.core.expressions.reader import read_expression

SUMS = "*".join(f"(c1 + c2 + c3 + c4 + c5 + {i})" for i in range(4))
HALVES = "(" * 60 + "0.5" + ")^2" * 60


@pytest.mark.parametrize("text", ["c1 - c1", "(c1 + 2)^2 - c1^2 - 4*c1 - 4", "sqrt(c1 + 4)^2 - c1 - 4", "0.1*x - x/10"])
def test_what_cancels(text):
    assert cancels(read_expression(text))


@pytest.mark.parametrize("text", ["c1", "c1 - c2", "c1 - 0.999999999999999*c1"])
def test_what_does_not(text):
    assert not cancels(read_expression(text))


@pytest.mark.parametrize(
    "text",
    [
        f"{SUMS} - {SUMS}",  # 6^4 terms
        "c1^17 - c1^17",
        "*".join(["c1"] * 17) + " - c1^2",
        f"{HALVES}*c1 - {HALVES}*c1",  # 2^60 digits
        "c1^c2 - c1^c2",
        "max(c1, max(c2, max(c3, max(c4, 1)))) - max(c1, max(c2, max(c3, max(c4, 1))))",
    ],
)
def test_what_might_take_long_is_not_tried(text):
    expression = read_expression(text)
    assert not cancels(expression)
    assert simplified(expression) is expression
