"""Reader of plan expressions: text → checked tree.

The text is data. It is cut into tokens and read by a recursive-descent reader; nothing in it is ever handed to `eval`,
`sympify` or `parse_expr`, which run code. Limits keep a hostile text from costing time or memory.

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
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NoReturn

from eadp.core.expressions import tree
from eadp.core.expressions.tree import Expression, Node
from eadp.errors import ExpressionError, printable

_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z][A-Za-z0-9]*)|(?P<op>\*\*|[-+*/^(),])|(?P<end>\Z)|(?P<blanks>\s+)|(?P<bad>.)",
    re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    offset: int


@dataclass(slots=True)
class _Part:
    """A tree under construction, and its value if it is constant."""

    node: Node
    value: float | None = None


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
    if len(text) > tree.LENGTH_LIMIT:
        start, most = len(text) - len(text.lstrip()), f"at most {tree.LENGTH_LIMIT} characters"
        raise ExpressionError(start, f"an expression of {len(text)} characters", most)
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
        self._offsets: dict[str, int] = {}
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
        self._offsets = {}
        part = self._sum()
        return Expression(part.node, dict(self._offsets))

    # each rule of the grammar, from the loosest to the tightest

    def _sum(self) -> _Part:
        signs, terms = [False], [self._product()]
        offset = self.token.offset
        while self.token.text in ("+", "-"):
            signs.append(self.advance().text == "-")
            terms.append(self._product())
        if len(terms) == 1:
            return terms[0]
        return _joined(offset, tree.Sum(tuple(zip(signs, (part.node for part in terms), strict=True))), terms)

    def _product(self) -> _Part:
        divides, factors = [False], [self._unary()]
        offset = self.token.offset
        while True:
            if self.token.text in ("*", "/"):
                divides.append(self.advance().text == "/")
                factors.append(self._unary())
            elif self._implicit():
                divides.append(False)
                factors.append(self._power())
            else:
                break
        if len(factors) == 1:
            return factors[0]
        return _joined(offset, tree.Product(tuple(zip(divides, (part.node for part in factors), strict=True))), factors)

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
        return _joined(sign.offset, tree.Call(tree.NEGATIVE, (part.node,)), [part])

    def _power(self) -> _Part:
        base = self._atom()
        if self.token.text not in ("^", "**"):
            return base
        offset = self._deeper().offset
        exponent = self._unary()
        self._depth -= 1
        return _joined(offset, tree.Call(tree.POWER, (base.node, exponent.node)), [base, exponent])

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
        if sum(c.isdigit() for c in token.text) > tree.DIGITS_LIMIT:
            what = f"a number of {len(token.text)} characters"
            raise ExpressionError(token.offset, what, f"at most {tree.DIGITS_LIMIT} digits")
        value = float(token.text)
        if value > tree.CONSTANT_LIMIT:
            raise ExpressionError(token.offset, "a constant part that is too large", f"at most {tree.CONSTANT_LIMIT:g}")
        return _Part(tree.Number(value), value)

    def _name(self, token: _Token) -> _Part:
        name = token.text
        if name in tree.FUNCTIONS:
            return self._call(token)
        if self.token.text == "(":
            known = ", ".join(sorted(tree.FUNCTIONS))
            raise ExpressionError(token.offset, f"{printable(name, 40)} is not a function", f"one of {known}")
        if name == "pi":
            return _Part(tree.Symbol(name), math.pi)
        if name not in ("x", "y") and not tree.PARAMETER.match(name) and name not in self._names:
            own = sorted(self._names)[:20]  # a file may name thousands
            known = ", ".join(["x, y, c1 … c999, pi", *own, "a function"])
            raise ExpressionError(token.offset, f"unknown name {printable(name, 40)}", known)
        self._offsets.setdefault(name, token.offset)
        return _Part(tree.Symbol(name))

    def _call(self, token: _Token) -> _Part:
        name = token.text
        if self.token.text != "(":
            self.fail(f"( after {name}")
        self._deeper()
        arguments = [self._sum()]
        while self.token.text == ",":
            self.advance()
            arguments.append(self._sum())
        self._close()
        fewest, most = tree.FUNCTIONS[name]
        if not fewest <= len(arguments) <= most:
            wanted = str(fewest) if fewest == most else f"{fewest} to {most}"
            raise ExpressionError(token.offset, f"{name} with {len(arguments)} arguments", wanted)
        return _joined(token.offset, tree.Call(name, tuple(part.node for part in arguments)), arguments)

    def _deeper(self) -> _Token:
        self._depth += 1
        if self._depth > tree.NESTING_LIMIT:
            what = f"nested deeper than {tree.NESTING_LIMIT} levels"
            raise ExpressionError(self.token.offset, what, f"at most {tree.NESTING_LIMIT}")
        return self.advance()

    def _close(self) -> None:
        if self.token.text != ")":
            self.fail("an operator, a comma or a closing bracket")
        self._depth -= 1
        self.advance()


def _joined(offset: int, node: Node, parts: Sequence[_Part]) -> _Part:
    return _Part(node, tree.constant_value(node, [part.value for part in parts], offset))


def _tokens(text: str) -> list[_Token]:
    tokens = []
    for match in _TOKEN.finditer(text):
        kind = match.lastgroup or "bad"
        if kind == "bad":
            shown = printable(match["bad"])
            raise ExpressionError(match.start("bad"), f"unexpected character '{shown}'", "an expression")
        if kind != "blanks":
            tokens.append(_Token(kind, match[kind], match.start(kind)))
    return tokens
