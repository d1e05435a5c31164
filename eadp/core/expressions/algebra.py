"""Computer algebra on expression trees: the only module that imports sympy, and late."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eadp.core.expressions import tree
from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import Expression, Node
from eadp.errors import ExpressionError

_PROBES = (0.0, 0.37, -0.61, 1.73, 13.1, -17.9, 211.3, -397.7, 3007.1, -2503.9, 1e5, -9e4)


def is_zero(node: Node) -> bool:
    """Whether a tree is zero for every value of its symbols.

    Decided numerically, at twelve points, relative to the magnitude of its terms: expressions that vanish at all of
    them by coincidence do not occur in practice, and the cost is linear in the size of the tree.
    """
    names = sorted(tree.symbols(node) - {"pi"})
    seen = False
    for k, probe in enumerate(_PROBES):
        values = {name: probe * (1 + 0.07 * i * (k + 1)) + 0.003 * i for i, name in enumerate(names)}
        try:
            value, size = tree.unchecked_value(node, values), _magnitude(node, values)
        except (ArithmeticError, ValueError):
            continue
        if not abs(value) <= 1e-13 * size:
            return False
        seen = True
    return seen


def _magnitude(node: Node, values: Mapping[str, float]) -> float:
    """The sum of the absolute values of the terms of a tree: the scale of its rounding errors."""
    if isinstance(node, tree.Sum):
        size = 0.0
        for _, term in node.terms:
            size += _magnitude(term, values)
        return size
    if isinstance(node, tree.Product):
        size = 1.0
        for divides, factor in node.factors:
            part = abs(tree.unchecked_value(factor, values)) if divides else _magnitude(factor, values)
            size = size / part if divides else size * part
        return size
    if isinstance(node, tree.Negative):
        return _magnitude(node.operand, values)
    return abs(tree.unchecked_value(node, values))


def to_sympy(node: Node) -> Any:
    """The tree as a sympy expression over real symbols, with exact rational numbers.

    Built node by node: no text reaches sympy's own parser.
    """
    import sympy

    functions = {
        **{name: getattr(sympy, name) for name in ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2")},
        "abs": sympy.Abs,
        "min": sympy.Min,
        "max": sympy.Max,
        "exp": sympy.exp,
        "log": sympy.log,
    }

    def build(part: Node) -> Any:
        if isinstance(part, tree.Number):
            return sympy.Rational(repr(part.value)) if part.value != int(part.value) else sympy.Integer(int(part.value))
        if isinstance(part, tree.Symbol):
            return sympy.pi if part.name == "pi" else sympy.Symbol(part.name, real=True)
        if isinstance(part, tree.Sum):
            return sympy.Add(*[-build(term) if minus else build(term) for minus, term in part.terms])
        if isinstance(part, tree.Product):
            return sympy.Mul(*[1 / build(factor) if divides else build(factor) for divides, factor in part.factors])
        if isinstance(part, tree.Power):
            return sympy.Pow(build(part.base), build(part.exponent))
        if isinstance(part, tree.Negative):
            return -build(part.operand)
        return functions[part.function](*[build(argument) for argument in part.arguments])

    return build(node)


def simplified(expression: Expression) -> Expression:
    """The expression multiplied out and collected by sympy, where that makes it shorter; else unchanged.

    Only trees whose expansion is small are given to sympy: a power of a sum has as many terms as its exponent allows.
    """
    if not _tame(expression):
        return expression
    import sympy

    try:
        simple = from_sympy(sympy.expand(to_sympy(expression.node)))
    except (ExpressionError, ArithmeticError, ValueError, TypeError):  # for example atan2(0, 0)
        return expression
    return simple if len(simple.text) < len(expression.text) else expression


def _tame(expression: Expression) -> bool:
    """Whether multiplying out costs little: few nodes, small whole exponents, few sums within products."""
    if expression.size > 200:
        return False
    sums = 0
    waiting = [expression.node]
    while waiting:
        node = waiting.pop()
        if isinstance(node, tree.Power) and not (
            isinstance(node.exponent, tree.Number) and node.exponent.value in (0, 1, 2)
        ):
            return False
        if isinstance(node, tree.Product | tree.Power):
            sums += sum(isinstance(part, tree.Sum) for part in tree.children(node))
        waiting.extend(tree.children(node))
    return sums <= 6


def from_sympy(result: Any) -> Expression:
    """An expression from a sympy tree, read back through the reader so that every check holds.

    Raises
    ------
    ExpressionError
        If the tree holds a function or a constant that plan expressions do not have.
    """
    import sympy

    text = sympy.sstr(result, order="none").replace("Abs(", "abs(").replace("Min(", "min(").replace("Max(", "max(")
    return read_expression(text)
