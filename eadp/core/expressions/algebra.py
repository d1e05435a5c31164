"""Computer algebra on expression trees: multiplying out, and the only door to sympy, which is imported late."""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

from eadp.core.expressions import tree
from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import FUNCTIONS, Expression, Node
from eadp.errors import EadpError, ExpressionError, printable

SIZE_LIMIT = 400
"""Most nodes of a tree that is given to sympy."""

DEGREE_LIMIT = 1000
"""Highest power that exponents within exponents may make of a part of such a tree."""

TERMS_LIMIT, DEGREE_KEPT, MAX_WHOLE = 300, 16, 10**1000
"""Bounds of what is multiplied out: the number of terms, the powers of sums, the whole numbers in fractions."""

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
            value, size = tree.evaluation(node)(values), _magnitude(node, values)
        except (ArithmeticError, ValueError):
            continue
        if not abs(value) <= 1e-13 * size:
            return False
        seen = True
    return seen


def _magnitude(node: Node, values: Mapping[str, float]) -> float:
    """The sum of the absolute values of the terms of a tree: the scale of its rounding errors."""
    if isinstance(node, tree.Sum):
        return sum(_magnitude(term, values) for _, term in node.parts)
    if isinstance(node, tree.Product):
        size = 1.0
        for divides, factor in node.parts:
            part = abs(tree.evaluation(factor)(values)) if divides else _magnitude(factor, values)
            size = size / part if divides else size * part
        return size
    if isinstance(node, tree.Call) and node.function == tree.NEGATIVE:
        return _magnitude(node.arguments[0], values)
    return abs(tree.evaluation(node)(values))


def load_sympy() -> Any:
    """The module sympy.

    Raises
    ------
    EadpError
        If it cannot be imported.
    """
    try:
        import sympy
    except ImportError as error:
        raise EadpError(f"sympy cannot be imported ({error}); install it, as in: pip install sympy") from None
    return sympy


def to_sympy(node: Node) -> Any:
    """The tree as a sympy expression over real symbols, with exact rational numbers.

    Built node by node: no text reaches sympy's own parser.
    """
    sympy = load_sympy()
    functions = {name: getattr(sympy, {"abs": "Abs", "min": "Min", "max": "Max"}.get(name, name)) for name in FUNCTIONS}
    functions |= {tree.NEGATIVE: operator.neg, tree.POWER: sympy.Pow}

    def build(part: Node) -> Any:
        if isinstance(part, tree.Number):
            return sympy.Rational(repr(part.value)) if part.value != int(part.value) else sympy.Integer(int(part.value))
        if isinstance(part, tree.Symbol):
            return sympy.pi if part.name == "pi" else sympy.Symbol(part.name, real=True)
        if isinstance(part, tree.Sum):
            return sympy.Add(*[-build(term) if minus else build(term) for minus, term in part.parts])
        if isinstance(part, tree.Product):
            return sympy.Mul(*[1 / build(factor) if divides else build(factor) for divides, factor in part.parts])
        return functions[part.function](*[build(argument) for argument in part.arguments])

    return build(node)


_Expanded = dict[tuple[str, ...], Fraction]


def expanded(node: Node) -> _Expanded:
    """A tree multiplied out, exactly: the multiple of each of its monomials, none of them 0.

    A monomial is the sorted texts of its factors: symbols, functions, and powers and reciprocals that stay as they are.

    Raises
    ------
    ArithmeticError
        If a number is divided by 0, or the result is beyond the bounds above.
    """
    if isinstance(node, tree.Number):
        return {(): Fraction(repr(node.value))} if node.value else {}
    parts = []
    for part in tree.children(node):  # a plain loop: a comprehension would double the depth of the stack
        parts.append(expanded(part))
    if isinstance(node, tree.Sum):
        return _summed([(-1 if minus else 1, part) for (minus, _), part in zip(node.parts, parts, strict=True)])
    if isinstance(node, tree.Product):
        factors = [_inverse(part) if divides else part for (divides, _), part in zip(node.parts, parts, strict=True)]
        return functools.reduce(_times, factors)
    if isinstance(node, tree.Symbol):
        return {(node.name,): Fraction(1)}
    if node.function == tree.NEGATIVE:
        return _summed([(-1, parts[0])])
    if node.function == tree.POWER:
        exponent = parts[1].get((), 0)
        if parts[1].keys() <= {()} and exponent in range(DEGREE_KEPT + 1):
            return functools.reduce(_times, [parts[0]] * int(exponent), {(): Fraction(1)})
        return {(f"(({_text(parts[0])})^({_text(parts[1])}))",): Fraction(1)}
    return {(f"{node.function}({', '.join(map(_text, parts))})",): Fraction(1)}


def _summed(parts: Sequence[tuple[int | Fraction, _Expanded]]) -> _Expanded:
    """The sum of multiples of trees multiplied out."""
    result: _Expanded = {}
    for factor, part in parts:
        for monomial, multiple in part.items():
            result[monomial] = result.get(monomial, Fraction(0)) + factor * multiple
    if len(result) > TERMS_LIMIT or any(max(abs(m.numerator), m.denominator) > MAX_WHOLE for m in result.values()):
        raise ArithmeticError("too large to be multiplied out")
    return {monomial: multiple for monomial, multiple in result.items() if multiple}


def _times(a: _Expanded, b: _Expanded) -> _Expanded:
    """The product of two trees multiplied out."""
    return _summed([(n, {tuple(sorted(one + other)): m for other, m in b.items()}) for one, n in a.items()])


def _inverse(part: _Expanded) -> _Expanded:
    """1 over a tree multiplied out."""
    if part.keys() <= {()}:
        return {(): 1 / part.get((), Fraction(0))}
    return {(f"(1/({_text(part)}))",): Fraction(1)}


def _text(terms: _Expanded) -> str:
    """A tree multiplied out as text: a number first, then the monomials in order."""
    text = ""
    for monomial, multiple in sorted(terms.items()):
        above, below = abs(multiple.numerator), multiple.denominator
        factors = [f"{factor}^{len([*same])}" for factor, same in itertools.groupby(monomial)]
        number = [] if factors and above == 1 else [str(above)]
        text += " - " if multiple < 0 else " + "
        text += "*".join([*number, *(factor.removesuffix("^1") for factor in factors)])
        text += f"/{below}" if below > 1 else ""
    return text.removeprefix(" + ") or "0"


def simplified(expression: Expression) -> Expression:
    """The expression multiplied out and collected, where that makes it shorter; else unchanged."""
    try:
        simple = read_expression(_text(expanded(expression.node)), expression.names)
    except (ExpressionError, ArithmeticError):
        return expression
    return simple if len(simple.text) < len(expression.text) else expression


def cancels(expression: Expression) -> bool:
    """Whether an expression multiplied out is 0 for every value of its symbols; False: undecided, or not 0."""
    try:
        return not expanded(expression.node)
    except ArithmeticError:
        return False


def _degree(node: Node) -> float:
    """A bound of the powers in a tree multiplied out; a function counts as its argument, as sympy brings roots out."""
    parts = []
    for part in tree.children(node):
        parts.append(_degree(part))
    if isinstance(node, tree.Product):
        return sum(parts)
    if isinstance(node, tree.Call) and node.function == tree.POWER:
        try:
            return parts[0] * max(1.0, abs(tree.evaluation(node.arguments[1])({})))
        except (KeyError, ArithmeticError, ValueError):  # an exponent that is no number
            return parts[0]
    return max(parts, default=1.0)


# --- stages -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SymbolicStage:
    """A stage as sympy objects: φ(x, y, c1, …), its gradient and Hessian in x and y, and the trigger.

    Symbols are real, numbers exact fractions. Derivatives are taken when they are asked for.
    """

    path: Any
    trigger: Any

    @classmethod
    def of(cls, path: Expression, trigger: tuple[Expression, Expression]) -> SymbolicStage:
        """The stage of a path function and a trigger.

        Raises
        ------
        EadpError
            If sympy cannot be imported, or an expression is beyond the limits above.
        """
        return cls(limited(path), load_sympy().Matrix([limited(part) for part in trigger]))

    @cached_property
    def gradient(self) -> Any:
        """∇φ, a matrix of shape (2, 1)."""
        return load_sympy().Matrix([self.path.diff(v) for v in coordinates()])

    @cached_property
    def hessian(self) -> Any:
        """The Hessian of φ, a symmetric matrix of shape (2, 2)."""
        return load_sympy().hessian(self.path, coordinates())


def limited(expression: Expression) -> Any:
    """`to_sympy` of an expression within the limits above."""
    if expression.size > SIZE_LIMIT or _degree(expression.node) > DEGREE_LIMIT:
        what = f"at most {SIZE_LIMIT} parts, and powers of {DEGREE_LIMIT}"
        raise EadpError(f"{printable(expression.text, 60)} is too large for sympy: {what}")
    return to_sympy(expression.node)


def coordinates() -> list[Any]:
    """x and y as sympy's symbols."""
    return [load_sympy().Symbol(name, real=True) for name in ("x", "y")]
