"""Expressions of plan files: text → checked tree → canonical text, values, sympy.

The text is data. It is cut into tokens and read by a recursive-descent reader of our own; nothing in it is ever handed
to `eval`, `sympify` or `parse_expr`, which run code. Limits keep a hostile text from costing time or memory.
Derivatives are the business of `eadp.core.expressions.derivatives`; sympy is imported here, late, and nowhere else.

Grammar (the longest match wins; case matters):

    sum      = product { ("+" | "-") product }
    product  = unary { ("*" | "/") unary | implicit }       implicit: number·name, number·"(" and ")"·"(" alone
    unary    = { "+" | "-" } power
    power    = atom [ ("^" | "**") unary ]                  so −x^2 is −(x²), and 2^3^2 is 2^(3^2)
    atom     = number | name | function "(" sum { "," sum } ")" | "(" sum ")"

Source: draft 002, Appendix II (the format); the limits are ours.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NoReturn

from eadp.errors import ExpressionError, PathUndefined, printable

LENGTH_LIMIT = 10_000
NESTING_LIMIT = 100
DIGITS_LIMIT = 50
EXPONENT_LIMIT = 64
CONSTANT_LIMIT = 1e300
SIZE_LIMIT = 20_000
"""Most nodes of one tree, after the names of coordinates have been put in."""

DEPTH_LIMIT = 4 * NESTING_LIMIT
"""Most nodes above each other once coordinates are put in: what a text of the deepest nesting has."""

FUNCTIONS: dict[str, tuple[int, int]] = {
    **dict.fromkeys(("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "abs", "exp", "log"), (1, 1)),
    "atan2": (2, 2),
    "min": (2, 64),
    "max": (2, 64),
}
"""Function → fewest and most arguments."""

ROUGH_FUNCTIONS = frozenset({"abs", "min", "max"})
"""Functions that are not twice differentiable everywhere."""

PARAMETER = re.compile(r"c([1-9][0-9]{0,2})\Z")


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
class Negative:
    """−operand."""

    operand: Node


@dataclass(frozen=True, slots=True)
class Sum:
    """Terms with whether each is subtracted; the first never is."""

    terms: tuple[tuple[bool, Node], ...]


@dataclass(frozen=True, slots=True)
class Product:
    """Factors with whether each divides, from left to right; the first never does."""

    factors: tuple[tuple[bool, Node], ...]


@dataclass(frozen=True, slots=True)
class Power:
    """base ^ exponent."""

    base: Node
    exponent: Node


@dataclass(frozen=True, slots=True)
class Call:
    """function(arguments)."""

    function: str
    arguments: tuple[Node, ...]


Node = Number | Symbol | Negative | Sum | Product | Power | Call


@dataclass(frozen=True)
class Expression:
    """A checked expression.

    `places` gives, for each name it uses, the offset of its first use in the text it was read from.
    """

    node: Node
    places: Mapping[str, int] = field(default_factory=dict, compare=False)
    size: int = field(default=1, compare=False)
    rough: str = field(default="", compare=False)
    """The first function in it that is not twice differentiable everywhere, or ''."""

    @cached_property
    def text(self) -> str:
        """Canonical text; reading it again gives the same tree."""
        return to_text(self.node)

    @cached_property
    def names(self) -> frozenset[str]:
        """The symbols it depends on, pi left out."""
        return frozenset(_symbols(self.node)) - {"pi"}

    @property
    def highest_parameter(self) -> int:
        """The highest index i of any c_i in it; 0 without."""
        return max((int(name[1:]) for name in self.names if PARAMETER.match(name)), default=0)

    def at(
        self,
        parameters: Sequence[float] = (),
        x: float = 0.0,
        y: float = 0.0,
        quantities: Mapping[str, float] | None = None,
    ) -> float:
        """Value for parameters c1, c2, … at a point, and for other names' values.

        Raises
        ------
        PathUndefined
            If it has no finite real value there, or names a parameter that is not given.
        """
        if isinstance(self.node, Number):
            return self.node.value
        values = {"x": x, "y": y, **{f"c{i + 1}": value for i, value in enumerate(parameters)}, **(quantities or {})}
        return evaluate(self.node, values)


def substituted(expression: Expression, values: Mapping[str, Expression]) -> Expression:
    """The expression with symbols replaced by other expressions.

    Raises
    ------
    ExpressionError
        At the first use of a symbol that makes the tree too large.
    """
    size = expression.size
    places = {name: place for name, place in expression.places.items() if name not in values}
    rough = expression.rough

    def build(node: Node) -> Node:
        nonlocal size, rough
        if isinstance(node, Symbol):
            if node.name not in values:
                return node
            value = values[node.name]
            size += value.size
            rough = rough or value.rough
            place = expression.places.get(node.name, 0)
            if size > SIZE_LIMIT:
                raise ExpressionError(place, "an expression of too many parts", f"at most {SIZE_LIMIT}")
            for name in value.names:
                places.setdefault(name, place)
            return value.node
        if isinstance(node, Sum):
            return Sum(tuple([_joined(minus, term, build(term)) for minus, term in node.terms]))
        if isinstance(node, Product):
            return Product(tuple([(divides, build(factor)) for divides, factor in node.factors]))
        if isinstance(node, Power):
            return Power(build(node.base), build(node.exponent))
        if isinstance(node, Negative):
            return Negative(build(node.operand))
        if isinstance(node, Call):
            return Call(node.function, tuple([build(argument) for argument in node.arguments]))
        return node

    place = min(expression.places.values(), default=0)
    if _depth(expression.node) + max(_depth(value.node) for value in values.values()) > DEPTH_LIMIT:
        raise ExpressionError(place, f"nested deeper than {NESTING_LIMIT} levels", f"at most {NESTING_LIMIT}")
    node = build(expression.node)
    _check_constants(node, place)
    return Expression(node, places, size, rough)


def _depth(node: Node) -> int:
    """How many nodes lie above each other in a tree."""
    deepest = 0
    waiting = [(node, 1)]
    while waiting:
        part, depth = waiting.pop()
        deepest = max(deepest, depth)
        waiting.extend((child, depth + 1) for child in children(part))
    return deepest


def _check_constants(node: Node, place: int) -> float | None:
    """The value of a constant tree, or None; the reader's checks, for constants that arise by substitution.

    Raises
    ------
    ExpressionError
        At `place`, if a constant part has no finite real value, is too large, or is too large an exponent.
    """
    if isinstance(node, Number):
        return node.value
    if isinstance(node, Symbol):
        return math.pi if node.name == "pi" else None
    values = []
    for part in children(node):
        values.append(_check_constants(part, place))
    if isinstance(node, Power) and values[1] is not None and abs(values[1]) > EXPONENT_LIMIT:
        message = f"a constant exponent of {values[1]:g}"
        raise ExpressionError(place, message, f"an exponent from -{EXPONENT_LIMIT} to {EXPONENT_LIMIT}")
    known = [value for value in values if value is not None]
    try:
        if isinstance(node, Sum):
            signed = zip((minus for minus, _ in node.terms), values, strict=True)
            value = _add([-part if minus else part for minus, part in signed if part is not None])
        elif isinstance(node, Product):
            signed = zip((divides for divides, _ in node.factors), values, strict=True)
            value = _multiply([(divides, part) for divides, part in signed if part is not None])
        elif len(known) < len(values):
            return None
        elif isinstance(node, Power):
            value = _raise(known[0], known[1])
        else:
            value = -known[0] if isinstance(node, Negative) else _OPERATIONS[node.function](*known)
    except (ArithmeticError, ValueError):
        raise ExpressionError(place, "a constant part without a finite real value", "a finite real number") from None
    if not abs(value) <= CONSTANT_LIMIT:
        raise ExpressionError(place, "a constant part that is too large", f"at most {CONSTANT_LIMIT:g}")
    return value if len(known) == len(values) else None


def total(a: Expression, b: Expression) -> Expression:
    """a + b."""
    return Expression(Sum(((False, a.node), (False, b.node))), {**b.places, **a.places}, a.size + b.size + 1)


def difference(a: Expression, b: Expression) -> Expression:
    """a − b."""
    return Expression(Sum(((False, a.node), (True, b.node))), {**b.places, **a.places}, a.size + b.size + 1)


def scaled(a: Expression, factor: float) -> Expression:
    """factor · a."""
    number = constant(factor)
    if factor == 0 or not a.names:
        return constant(factor * a.at() if factor else 0.0)
    if factor == 1:
        return a
    return Expression(Product(((False, number.node), (False, a.node))), a.places, a.size + 2, a.rough)


def _joined(minus: bool, old: Node, new: Node) -> tuple[bool, Node]:
    """A term of a sum where a symbol has become −b: a − (−b) is written a + b."""
    if minus and isinstance(old, Symbol) and isinstance(new, Negative):
        return False, new.operand
    return minus, new


def constant(value: float) -> Expression:
    """The expression of a number."""
    return Expression(Number(value) if value >= 0 else Negative(Number(-value)))


# --- reading ----------------------------------------------------------------------------------------------------------

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z][A-Za-z0-9]*)|(?P<op>\*\*|[-+*/^(),])|(?P<end>\Z)|(?P<bad>.))",
    re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    offset: int


@dataclass(slots=True)
class _Part:
    """A tree under construction: the value of a constant one, and how many nodes it has."""

    node: Node
    value: float | None = None
    size: int = 1


def read_expression(text: str, names: Collection[str] = ()) -> Expression:
    """Read one expression. See `read_expressions`."""
    return read_expressions(text, names, count=1)[0]


def read_expressions(text: str, names: Collection[str] = (), *, count: int | None = None) -> list[Expression]:
    """Read expressions with commas between them.

    Parameters
    ----------
    text : str
        At most 10,000 characters.
    names : collection of str, optional
        Further names that may be used; they become symbols.
    count : int, optional
        How many there must be.

    Raises
    ------
    ExpressionError
        With the offset in `text`, on any breach of the grammar or of a limit, and on a constant part that is not a
        finite real number.
    """
    if len(text) > LENGTH_LIMIT:
        start = len(text) - len(text.lstrip())
        raise ExpressionError(start, f"an expression of {len(text)} characters", f"at most {LENGTH_LIMIT} characters")
    reader = _Reader(text, names)
    expressions = [reader.expression()]
    while reader.token.text == "," and (count is None or len(expressions) < count):
        reader.advance()
        expressions.append(reader.expression())
    if count is not None and len(expressions) < count:
        raise ExpressionError(reader.token.offset, f"{len(expressions)} of {count} values", "a comma and another value")
    if reader.token.kind != "end":
        reader.fail("an operator or the end")
    return expressions


class _Reader:
    def __init__(self, text: str, names: Collection[str]) -> None:
        self._tokens = _tokens(text)
        self._names = names
        self._next = 0
        self._depth = 0
        self._places: dict[str, int] = {}
        self._rough = ""
        self.token = self._tokens[0]
        self._before = _Token("start", "", 0)

    def advance(self) -> _Token:
        token = self.token
        if token.kind != "end":
            self._next += 1
            self.token = self._tokens[self._next]
        self._before = token
        return token

    def fail(self, expected: str) -> NoReturn:
        token = self.token
        if token.kind == "end":
            raise ExpressionError(token.offset, "the expression ends too early", expected)
        raise ExpressionError(token.offset, f"{printable(token.text, 40)!r} cannot stand here", expected)

    def expression(self) -> Expression:
        self._places, self._rough = {}, ""
        part = self._sum()
        return Expression(part.node, dict(self._places), part.size, self._rough)

    # each rule of the grammar, from the loosest to the tightest

    def _sum(self) -> _Part:
        terms = [(False, self._product())]
        offset = self.token.offset
        while self.token.text in ("+", "-"):
            minus = self.advance().text == "-"
            terms.append((minus, self._product()))
        if len(terms) == 1:
            return terms[0][1]
        known = [(-1.0 if minus else 1.0) * part.value for minus, part in terms if part.value is not None]
        total = self._checked(offset, _add, known) if known else 0.0
        return _Part(
            Sum(tuple((minus, part.node) for minus, part in terms)),
            total if len(known) == len(terms) else None,
            self._size(offset, [part for _, part in terms]),
        )

    def _product(self) -> _Part:
        factors = [(False, self._unary())]
        offset = self.token.offset
        while True:
            if self.token.text in ("*", "/"):
                divides = self.advance().text == "/"
                factors.append((divides, self._unary()))
            elif self._implicit():
                factors.append((False, self._power()))
            else:
                break
        if len(factors) == 1:
            return factors[0][1]
        known = [(divides, part.value) for divides, part in factors if part.value is not None]
        value = self._checked(offset, _multiply, known) if known else 0.0
        return _Part(
            Product(tuple((divides, part.node) for divides, part in factors)),
            value if len(known) == len(factors) else None,
            self._size(offset, [part for _, part in factors]),
        )

    def _implicit(self) -> bool:
        before, token = self._before, self.token
        if before.kind == "number":
            return token.kind == "name" or token.text == "("
        return before.text == ")" and token.text == "("

    def _unary(self) -> _Part:
        if self.token.text not in ("+", "-"):
            return self._power()
        sign = self._deeper()
        part = self._unary()
        self._depth -= 1
        if sign.text == "+":
            return part
        value = None if part.value is None else -part.value
        return _Part(Negative(part.node), value, part.size + 1)

    def _power(self) -> _Part:
        base = self._atom()
        if self.token.text not in ("^", "**"):
            return base
        offset = self._deeper().offset
        exponent = self._unary()
        self._depth -= 1
        if exponent.value is not None and abs(exponent.value) > EXPONENT_LIMIT:
            what = f"a constant exponent of {exponent.value:g}"
            raise ExpressionError(offset, what, f"an exponent from -{EXPONENT_LIMIT} to {EXPONENT_LIMIT}")
        value = None
        if base.value is not None and exponent.value is not None:
            value = self._checked(offset, _raise, base.value, exponent.value)
        return _Part(Power(base.node, exponent.node), value, self._size(offset, [base, exponent]))

    def _atom(self) -> _Part:
        token = self.token
        if token.kind == "number":
            return self._number(self.advance())
        if token.kind == "name":
            return self._name(self.advance())
        if token.text != "(":
            self.fail("a number, a name or a bracket")
        self._deeper()
        part = self._sum()
        self._close()
        return part

    def _number(self, token: _Token) -> _Part:
        if sum(c.isdigit() for c in token.text) > DIGITS_LIMIT:
            what = f"a number of {len(token.text)} characters"
            raise ExpressionError(token.offset, what, f"at most {DIGITS_LIMIT} digits")
        value = self._checked(token.offset, float, token.text)
        return _Part(Number(value), value)

    def _name(self, token: _Token) -> _Part:
        name = token.text
        if name in FUNCTIONS:
            return self._call(token)
        if self.token.text == "(":
            known = ", ".join(sorted(FUNCTIONS))
            raise ExpressionError(token.offset, f"{printable(name, 40)} is not a function", f"one of {known}")
        if name == "pi":
            return _Part(Symbol(name), math.pi)
        if name not in ("x", "y") and not PARAMETER.match(name) and name not in self._names:
            own = sorted(self._names)[:20]  # a file may name thousands
            known = ", ".join(["x, y, c1 … c999, pi", *own, "a function"])
            raise ExpressionError(token.offset, f"unknown name {printable(name, 40)}", known)
        self._places.setdefault(name, token.offset)
        return _Part(Symbol(name))

    def _call(self, token: _Token) -> _Part:
        name = token.text
        if self.token.text != "(":
            self.fail(f"( after {name}")
        if name in ROUGH_FUNCTIONS:
            self._rough = self._rough or name
        self._deeper()
        arguments = [self._sum()]
        while self.token.text == ",":
            self.advance()
            arguments.append(self._sum())
        self._close()
        fewest, most = FUNCTIONS[name]
        if not fewest <= len(arguments) <= most:
            wanted = str(fewest) if fewest == most else f"{fewest} to {most}"
            raise ExpressionError(token.offset, f"{name} with {len(arguments)} arguments", wanted)
        values = [part.value for part in arguments if part.value is not None]
        value = None
        if len(values) == len(arguments):
            value = self._checked(token.offset, _OPERATIONS[name], *values)
        node = Call(name, tuple(part.node for part in arguments))
        return _Part(node, value, self._size(token.offset, arguments))

    def _deeper(self) -> _Token:
        self._depth += 1
        if self._depth > NESTING_LIMIT:
            what = f"nested deeper than {NESTING_LIMIT} levels"
            raise ExpressionError(self.token.offset, what, f"at most {NESTING_LIMIT}")
        return self.advance()

    def _close(self) -> None:
        if self.token.text != ")":
            self.fail("an operator, a comma or a closing bracket")
        self._depth -= 1
        self.advance()

    def _checked(self, offset: int, operation: Callable[..., float], *arguments: Any) -> float:
        """The value of a constant part, which must be a finite real number."""
        try:
            value = operation(*arguments)
        except (ArithmeticError, ValueError):
            raise ExpressionError(
                offset, "a constant part without a finite real value", "a finite real number"
            ) from None
        if not abs(value) <= CONSTANT_LIMIT:
            raise ExpressionError(offset, "a constant part that is too large", f"at most {CONSTANT_LIMIT:g}")
        return value

    def _size(self, offset: int, parts: Sequence[_Part]) -> int:
        size = 1
        for part in parts:
            size += part.size
        if size > SIZE_LIMIT:
            raise ExpressionError(offset, "an expression of too many parts", f"at most {SIZE_LIMIT}")
        return size


def _tokens(text: str) -> list[_Token]:
    tokens = []
    position = 0
    while True:
        match = _TOKEN.match(text, position)
        assert match is not None  # the pattern ends in "any character"
        kind = match.lastgroup or "bad"
        if kind == "bad":
            shown = printable(match["bad"])
            raise ExpressionError(match.start("bad"), f"unexpected character '{shown}'", "an expression")
        tokens.append(_Token(kind, match[kind], match.start(kind)))
        if kind == "end":
            return tokens
        position = match.end()


# --- values -----------------------------------------------------------------------------------------------------------


def _add(terms: Sequence[float]) -> float:
    # one by one, as the tree is evaluated: another order may round to another value
    total = 0.0
    for term in terms:
        total += term
    return total


def _multiply(factors: Sequence[tuple[bool, float]]) -> float:
    result = 1.0
    for divides, value in factors:
        result = result / value if divides else result * value
    return result


def _raise(base: float, exponent: float) -> float:
    # math.pow refuses what would be complex, where ** would return it
    return math.pow(base, exponent)


_OPERATIONS: dict[str, Callable[..., float]] = {
    **{
        name: getattr(math, name)
        for name in ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log")
    },
    "abs": abs,
    "min": min,
    "max": max,
}


def evaluate(node: Node, values: Mapping[str, float]) -> float:
    """Value of a tree for the values of its symbols.

    Raises
    ------
    PathUndefined
        If it has no finite real value there, or a symbol has no value.
    """
    try:
        value = _evaluate(node, values)
    except (ArithmeticError, ValueError):
        raise PathUndefined(f"{printable(to_text(node), 60)} has no finite real value here") from None
    except KeyError as error:
        raise PathUndefined(f"{error.args[0]} has no value in {printable(to_text(node), 60)}") from None
    if not math.isfinite(value):
        raise PathUndefined(f"{printable(to_text(node), 60)} has no finite real value here")
    return value


def _evaluate(node: Node, values: Mapping[str, float]) -> float:
    # plain loops: a generator would double the depth of the stack
    if isinstance(node, Number):
        return node.value
    if isinstance(node, Symbol):
        return math.pi if node.name == "pi" else values[node.name]
    if isinstance(node, Sum):
        total = 0.0
        for minus, term in node.terms:
            value = _evaluate(term, values)
            total = total - value if minus else total + value
        return total
    if isinstance(node, Product):
        product = 1.0
        for divides, factor in node.factors:
            value = _evaluate(factor, values)
            product = product / value if divides else product * value
        return product
    if isinstance(node, Power):
        return _raise(_evaluate(node.base, values), _evaluate(node.exponent, values))
    if isinstance(node, Negative):
        return -_evaluate(node.operand, values)
    arguments = []
    for argument in node.arguments:
        arguments.append(_evaluate(argument, values))
    return _OPERATIONS[node.function](*arguments)


def _symbols(node: Node) -> set[str]:
    found: set[str] = set()
    waiting = [node]
    while waiting:
        part = waiting.pop()
        if isinstance(part, Symbol):
            found.add(part.name)
        waiting.extend(children(part))
    return found


def children(node: Node) -> tuple[Node, ...]:
    """The parts of a node, from left to right."""
    if isinstance(node, Sum):
        return tuple(term for _, term in node.terms)
    if isinstance(node, Product):
        return tuple(factor for _, factor in node.factors)
    if isinstance(node, Power):
        return (node.base, node.exponent)
    if isinstance(node, Negative):
        return (node.operand,)
    if isinstance(node, Call):
        return node.arguments
    return ()


_PROBES = (0.0, 0.37, -0.61, 1.73, 13.1, -17.9, 211.3, -397.7, 3007.1, -2503.9, 1e5, -9e4)


def is_zero(node: Node) -> bool:
    """Whether a tree is zero for every value of its symbols.

    Decided by its value at twelve places, wherever it has one, against the size of its parts: an expression of this
    language that vanishes at all of them by accident is not met in practice, and no text can make the question costly.
    """
    names = sorted(_symbols(node) - {"pi"})
    seen = False
    for k, probe in enumerate(_PROBES):
        values = {name: probe * (1 + 0.07 * i * (k + 1)) + 0.003 * i for i, name in enumerate(names)}
        try:
            value, size = _evaluate(node, values), _magnitude(node, values)
        except (ArithmeticError, ValueError):
            continue
        if not abs(value) <= 1e-13 * size:
            return False
        seen = True
    return seen


def _magnitude(node: Node, values: Mapping[str, float]) -> float:
    """The sum of the absolute terms of a tree: what its rounding errors are measured by."""
    if isinstance(node, Sum):
        size = 0.0
        for _, term in node.terms:
            size += _magnitude(term, values)
        return size
    if isinstance(node, Product):
        size = 1.0
        for divides, factor in node.factors:
            part = abs(_evaluate(factor, values)) if divides else _magnitude(factor, values)
            size = size / part if divides else size * part
        return size
    if isinstance(node, Negative):
        return _magnitude(node.operand, values)
    return abs(_evaluate(node, values))


# --- text -------------------------------------------------------------------------------------------------------------

_LOOSE, _TERM, _FACTOR, _BASE = range(4)  # what may stand somewhere without brackets, ever less


def to_text(node: Node) -> str:
    """Canonical text of a tree: reading it gives the tree again. A text near the limit of characters has no spaces."""
    text = _text(node, _LOOSE)
    return text if len(text) <= LENGTH_LIMIT else text.replace(" ", "")


def number_text(value: float) -> str:
    """Shortest text of a number that reads as the same number; whole numbers without a point."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)


def _text(node: Node, place: int) -> str:
    if isinstance(node, Number):
        return number_text(node.value)
    if isinstance(node, Symbol):
        return node.name
    if isinstance(node, Call):
        parts = []
        for argument in node.arguments:
            parts.append(_text(argument, _LOOSE))
        return f"{node.function}({', '.join(parts)})"
    if isinstance(node, Sum):
        text = _text(node.terms[0][1], _TERM)
        for minus, term in node.terms[1:]:
            text += (" - " if minus else " + ") + _text(term, _TERM)
        return f"({text})" if place > _LOOSE else text
    if isinstance(node, Product):
        text = _text(node.factors[0][1], _FACTOR)
        for divides, factor in node.factors[1:]:
            text += ("/" if divides else "*") + _text(factor, _FACTOR)
        return f"({text})" if place > _TERM else text
    if isinstance(node, Negative):
        text = "-" + _text(node.operand, _FACTOR)
        return f"({text})" if place > _FACTOR else text
    text = f"{_text(node.base, _BASE)}^{_text(node.exponent, _FACTOR)}"
    return f"({text})" if place > _FACTOR else text


# --- sympy ------------------------------------------------------------------------------------------------------------


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
        if isinstance(part, Number):
            return sympy.Rational(repr(part.value)) if part.value != int(part.value) else sympy.Integer(int(part.value))
        if isinstance(part, Symbol):
            return sympy.pi if part.name == "pi" else sympy.Symbol(part.name, real=True)
        if isinstance(part, Sum):
            return sympy.Add(*[-build(term) if minus else build(term) for minus, term in part.terms])
        if isinstance(part, Product):
            return sympy.Mul(*[1 / build(factor) if divides else build(factor) for divides, factor in part.factors])
        if isinstance(part, Power):
            return sympy.Pow(build(part.base), build(part.exponent))
        if isinstance(part, Negative):
            return -build(part.operand)
        return functions[part.function](*[build(argument) for argument in part.arguments])

    return build(node)


def simplified(expression: Expression) -> Expression:
    """The same value multiplied out and collected, where that makes it shorter; else the expression itself.

    Only trees that cannot blow up are given to sympy: a power of a sum has as many terms as its exponent allows.
    """
    if not _tame(expression):
        return expression
    import sympy

    try:
        simple = from_sympy(sympy.expand(to_sympy(expression.node)))
    except (ExpressionError, ArithmeticError, ValueError, TypeError):  # what sympy makes of atan2(0, 0), for one
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
        if isinstance(node, Power) and not (isinstance(node.exponent, Number) and node.exponent.value in (0, 1, 2)):
            return False
        if isinstance(node, Product | Power):
            sums += sum(isinstance(part, Sum) for part in children(node))
        waiting.extend(children(node))
    return sums <= 6


def from_sympy(tree: Any) -> Expression:
    """An expression from a sympy tree, read back through the reader so that every check holds.

    Raises
    ------
    ExpressionError
        If the tree holds what plan expressions have no word for.
    """
    import sympy

    text = sympy.sstr(tree, order="none").replace("Abs(", "abs(").replace("Min(", "min(").replace("Max(", "max(")
    return read_expression(text)
