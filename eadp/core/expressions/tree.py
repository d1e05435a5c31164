"""Expression trees: nodes, limits, evaluation, substitution and canonical text.

Derivatives are compiled in `eadp.core.expressions.derivatives`; `eadp.core.expressions.algebra` gives a tree to sympy.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import itemgetter

from eadp.errors import ExpressionError, PathUndefined, printable

LENGTH_LIMIT = 10_000
NESTING_LIMIT = 100
DIGITS_LIMIT = 50
EXPONENT_LIMIT = 64
CONSTANT_LIMIT = 1e300
SIZE_LIMIT = 20_000
"""Most nodes of one tree, after coordinates have been substituted."""

DEPTH_LIMIT = 4 * NESTING_LIMIT
"""Greatest depth of a tree after substitution: that of a text of the deepest nesting."""

FUNCTIONS: dict[str, tuple[int, int]] = {
    **dict.fromkeys(("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "abs", "exp", "log"), (1, 1)),
    "atan2": (2, 2),
    "min": (2, 64),
    "max": (2, 64),
}
"""Function → minimum and maximum number of arguments."""

NEGATIVE, POWER = "-", "^"
"""Operators of one and of two operands, which trees have as functions."""

NON_SMOOTH_FUNCTIONS = frozenset({"abs", "min", "max"})
"""Functions that are not twice differentiable everywhere."""

PARAMETER = re.compile(r"c([1-9][0-9]{0,2})\Z")
_PARAMETERS = tuple(f"c{i}" for i in range(1, 1000))

Evaluation = Callable[[Mapping[str, float]], float]
"""A value by values of names; raises KeyError for a name without one, ArithmeticError or ValueError where undefined."""


# --- the tree ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Number:
    """A literal, 0 or more."""

    value: float


@dataclass(frozen=True, slots=True)
class Symbol:
    """x, y, pi or a parameter c1, c2, …."""

    name: str


@dataclass(frozen=True, slots=True)
class Sum:
    """Terms with whether each is subtracted; the first never is."""

    parts: tuple[tuple[bool, Node], ...]


@dataclass(frozen=True, slots=True)
class Product:
    """Factors with whether each divides, from left to right; the first never does."""

    parts: tuple[tuple[bool, Node], ...]


@dataclass(frozen=True, slots=True)
class Call:
    """function(arguments): one of `FUNCTIONS`, `NEGATIVE` of an operand, or `POWER` of a base and an exponent."""

    function: str
    arguments: tuple[Node, ...]


Node = Number | Symbol | Sum | Product | Call


@dataclass(frozen=True)
class Expression:
    """A checked expression.

    `offsets` gives, for each name in it, the offset of its first use in the text that it was read from.
    """

    node: Node
    offsets: Mapping[str, int] = field(default_factory=dict, compare=False)

    @cached_property
    def size(self) -> int:
        """The number of its nodes."""
        return sum(1 for _ in nodes(self.node))

    @property
    def non_smooth(self) -> str:
        """A function in it that is not twice differentiable everywhere, or ''."""
        used = {part.function for part, _ in nodes(self.node) if isinstance(part, Call)}
        return min(used & NON_SMOOTH_FUNCTIONS, default="")

    @cached_property
    def text(self) -> str:
        """Canonical text; reading it again gives the same tree."""
        return to_text(self.node)

    @cached_property
    def names(self) -> frozenset[str]:
        """The symbols it depends on, pi left out."""
        return frozenset(symbols(self.node)) - {"pi"}

    @property
    def max_parameter(self) -> int:
        """The largest index i of any c_i in it; 0 without."""
        return max((int(name[1:]) for name in self.names if PARAMETER.match(name)), default=0)

    def value(self, values: Mapping[str, float]) -> float:
        """Value for values of its names.

        Raises
        ------
        PathUndefined
            If it has no finite real value there, or a name has no value.
        """
        try:
            value = self._function(values)
        except (ArithmeticError, ValueError):
            value = math.nan
        except KeyError as error:
            raise PathUndefined(f"{error.args[0]} has no value in {printable(self.text, 60)}") from None
        if not math.isfinite(value):
            raise PathUndefined(f"{printable(self.text, 60)} has no finite real value here")
        return value

    @cached_property
    def _function(self) -> Evaluation:
        """The value by values of the names."""
        return evaluation(self.node)

    def __getstate__(self) -> dict[str, object]:
        """Functions cannot be pickled."""
        return {key: value for key, value in self.__dict__.items() if key != "_function"}


def named(parameters: Sequence[float]) -> dict[str, float]:
    """Values of parameters by their names c1, c2, …."""
    return dict(zip(_PARAMETERS, parameters, strict=False))


def substituted(expression: Expression, values: Mapping[str, Expression]) -> Expression:
    """The expression with symbols replaced by other expressions.

    Raises
    ------
    ExpressionError
        At the first symbol whose replacement makes the tree too large, or on a constant part that is not allowed.
    """
    size = expression.size
    offsets = {name: offset for name, offset in expression.offsets.items() if name not in values}

    def build(node: Node) -> Node:
        nonlocal size
        if isinstance(node, Symbol):
            if node.name not in values:
                return node
            value = values[node.name]
            size += value.size
            offset = expression.offsets.get(node.name, 0)
            if size > SIZE_LIMIT:
                raise ExpressionError(offset, "an expression of too many parts", f"at most {SIZE_LIMIT}")
            for name in value.names:
                offsets.setdefault(name, offset)
            return value.node
        if isinstance(node, Sum):
            return Sum(tuple([_joined(minus, term, build(term)) for minus, term in node.parts]))
        if isinstance(node, Product):
            return Product(tuple([(divides, build(factor)) for divides, factor in node.parts]))
        if isinstance(node, Call):
            return Call(node.function, tuple([build(argument) for argument in node.arguments]))
        return node

    offset = min(expression.offsets.values(), default=0)
    if _depth(expression.node) + max(_depth(value.node) for value in values.values()) > DEPTH_LIMIT:
        raise ExpressionError(offset, f"nested deeper than {NESTING_LIMIT} levels", f"at most {NESTING_LIMIT}")
    node = build(expression.node)
    _check_constants(node, offset)
    return Expression(node, offsets)


def _depth(node: Node) -> int:
    """Depth of a tree."""
    return max(depth for _, depth in nodes(node))


def _check_constants(node: Node, offset: int) -> float | None:
    """The value of a constant tree, or None: `constant_value` for constants that arise by substitution."""
    values = []
    for part in children(node):
        values.append(_check_constants(part, offset))
    return constant_value(node, values, offset)


def constant_value(node: Node, values: Sequence[float | None], offset: int) -> float | None:
    """The value of a node from the values of its parts; None where it or one of its parts is not constant.

    Raises
    ------
    ExpressionError
        At `offset`, if a constant part has no finite real value, is too large, or is too large an exponent.
    """
    if isinstance(node, Number):
        return node.value
    if isinstance(node, Symbol):
        return math.pi if node.name == "pi" else None
    exponent = values[1] if isinstance(node, Call) and node.function == POWER else None
    if exponent is not None and abs(exponent) > EXPONENT_LIMIT:
        message = f"a constant exponent of {exponent:g}"
        raise ExpressionError(offset, message, f"an exponent from -{EXPONENT_LIMIT} to {EXPONENT_LIMIT}")
    known = [value for value in values if value is not None]
    if isinstance(node, Sum | Product):  # checked over their constant parts
        node = type(node)(tuple([part for part, value in zip(node.parts, values, strict=True) if value is not None]))
    elif len(known) < len(values):
        return None
    try:
        value = _combined(node, known)
    except (ArithmeticError, ValueError):
        raise ExpressionError(offset, "a constant part without a finite real value", "a finite real number") from None
    if not abs(value) <= CONSTANT_LIMIT:
        raise ExpressionError(offset, "a constant part that is too large", f"at most {CONSTANT_LIMIT:g}")
    return value if len(known) == len(values) else None


def total(a: Expression, b: Expression) -> Expression:
    """a + b."""
    return Expression(Sum(((False, a.node), (False, b.node))), {**b.offsets, **a.offsets})


def difference(a: Expression, b: Expression) -> Expression:
    """a − b."""
    return Expression(Sum(((False, a.node), (True, b.node))), {**b.offsets, **a.offsets})


def _joined(minus: bool, old: Node, new: Node) -> tuple[bool, Node]:
    """A term of a sum after substitution: a − (−b) is written a + b."""
    if minus and isinstance(old, Symbol) and isinstance(new, Call) and new.function == NEGATIVE:
        return False, new.arguments[0]
    return minus, new


def constant(value: float) -> Expression:
    """The expression of a number."""
    return Expression(Number(value) if value >= 0 else Call(NEGATIVE, (Number(-value),)))


# --- values -----------------------------------------------------------------------------------------------------------


def atan2(y: float, x: float) -> float:
    """The angle of a vector [rad]; a zero has no sign, as in the proofs, where floats have one."""
    return math.atan2(y + 0.0, x + 0.0)


_OPERATIONS: dict[str, Callable[..., float]] = {
    **{name: getattr(math, name) for name in ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "exp", "log")},
    "atan2": atan2,
    "abs": abs,
    "min": min,
    "max": max,
    NEGATIVE: operator.neg,
    POWER: math.pow,  # refuses what would be complex, where ** would return it
}


def evaluation(node: Node) -> Evaluation:
    """The value of a tree by values of its symbols, without looking at the tree again."""
    if isinstance(node, Number) or node == Symbol("pi"):
        number = node.value if isinstance(node, Number) else math.pi
        return lambda _: number
    if isinstance(node, Symbol):
        return itemgetter(node.name)
    functions = []
    for part in children(node):  # plain loops: a comprehension would double the depth of the stack
        functions.append(evaluation(part))
    if isinstance(node, Call) and len(functions) == 1:
        operation, argument = _OPERATIONS[node.function], functions[0]
        return lambda values: operation(argument(values))

    def combined(values: Mapping[str, float]) -> float:
        parts = []
        for function in functions:
            parts.append(function(values))
        return _combined(node, parts)

    return combined


def _combined(node: Node, values: Sequence[float]) -> float:
    """Value of a node from the values of its parts."""
    if isinstance(node, Sum):
        total = 0.0
        for (minus, _), value in zip(node.parts, values, strict=True):
            total = total - value if minus else total + value
        return total
    if isinstance(node, Product):
        product = 1.0
        for (divides, _), value in zip(node.parts, values, strict=True):
            product = product / value if divides else product * value
        return product
    assert isinstance(node, Call)
    return _OPERATIONS[node.function](*values)


def symbols(node: Node) -> set[str]:
    """Names of the symbols in a tree."""
    return {part.name for part, _ in nodes(node) if isinstance(part, Symbol)}


def nodes(node: Node) -> Iterator[tuple[Node, int]]:
    """A tree's nodes, each with its depth, from 1."""
    waiting = [(node, 1)]
    while waiting:
        part, depth = waiting.pop()
        yield part, depth
        waiting.extend((child, depth + 1) for child in children(part))


def children(node: Node) -> tuple[Node, ...]:
    """The parts of a node, from left to right."""
    if isinstance(node, Sum | Product):
        return tuple(part for _, part in node.parts)
    if isinstance(node, Call):
        return node.arguments
    return ()


# --- text -------------------------------------------------------------------------------------------------------------

_LOOSE, _TERM, _FACTOR, _BASE = range(4)  # what needs no brackets in a context, from the loosest to the tightest


def to_text(node: Node) -> str:
    """Canonical text of a tree: reading it gives the tree again. A text near the limit of characters has no spaces."""
    text = _text(node, _LOOSE)
    return text if len(text) <= LENGTH_LIMIT else text.replace(" ", "")


def number_text(value: float) -> str:
    """Shortest text of a number that reads as the same number; whole numbers without a point."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)


def _text(node: Node, level: int) -> str:
    if isinstance(node, Number):
        return number_text(node.value)
    if isinstance(node, Symbol):
        return node.name
    if isinstance(node, Sum):
        text = _text(node.parts[0][1], _TERM)
        for minus, term in node.parts[1:]:
            text += (" - " if minus else " + ") + _text(term, _TERM)
        return f"({text})" if level > _LOOSE else text
    if isinstance(node, Product):
        text = _text(node.parts[0][1], _FACTOR)
        for divides, factor in node.parts[1:]:
            text += ("/" if divides else "*") + _text(factor, _FACTOR)
        return f"({text})" if level > _TERM else text
    if node.function == NEGATIVE:
        text = "-" + _text(node.arguments[0], _FACTOR)
    elif node.function == POWER:
        base, exponent = node.arguments
        text = f"{_text(base, _BASE)}^{_text(exponent, _FACTOR)}"
    else:
        parts = []
        for argument in node.arguments:
            parts.append(_text(argument, _LOOSE))
        return f"{node.function}({', '.join(parts)})"
    return f"({text})" if level > _FACTOR else text
