"""Path functions compiled to floats: value, gradient and Hessian in one call.

Forward-mode differentiation over the expression tree, written out as straight-line Python once per *shape* of an
expression: every part without x and y becomes an argument, so that the fifty circles of a survey share one compiled
function. The work is linear in the size of the expression, where a computer-algebra derivative of a product of a
thousand factors has a million terms. No text of a file reaches the compiler: the generated source holds operators,
generated names and the numbers of the differentiation rules.

What depends on parameters only is computed once, when parameters are bound; the inner function takes x and y.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from eadp.core.expressions import tree
from eadp.core.expressions.tree import Evaluation, Expression, Node
from eadp.errors import PathUndefined

Jet = tuple[float, float, float, float, float, float]
"""φ, ∂φ/∂x, ∂φ/∂y, ∂²φ/∂x², ∂²φ/∂x∂y, ∂²φ/∂y²."""

PathFunction = Callable[[float, float], Jet]
"""A path function with its parameters bound: (x, y) [m] → jet. Raises ValueError or ArithmeticError where undefined."""


def bind(expression: Expression, values: Mapping[str, float]) -> PathFunction:
    """The path function of an expression at given parameters.

    Parameters
    ----------
    expression : Expression
        In x, y, parameters and other names.
    values : mapping of str to float
        Of every name in it but x and y.

    Returns
    -------
    function (x, y) → (φ, φx, φy, φxx, φxy, φyy)

    Raises
    ------
    PathUndefined
        If a part that depends on the parameters alone has no finite real value.
    """
    source, fixed = _generate(expression.node)
    try:
        function: PathFunction = _compiled(source)([value_of(values) for value_of in fixed])
    except (ArithmeticError, ValueError):
        raise PathUndefined(f"{expression.text[:60]} has no finite real value at these parameters") from None
    except LookupError:
        raise PathUndefined(f"{expression.text[:60]} names a parameter that has no value") from None
    return function


@lru_cache(maxsize=512)
def _compiled(source: str) -> Callable[[Sequence[float]], PathFunction]:
    namespace: dict[str, Any] = {
        name: getattr(math, name)
        for name in ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "pow", "copysign")
    } | {"atan2": tree.atan2}
    exec(compile(source, "<path function>", "exec"), namespace)
    return namespace["make"]  # type: ignore[no-any-return]


# --- generating -------------------------------------------------------------------------------------------------------


_Term = str | None
"""A value by its name in the source; None is one that is zero by its form."""


class _Jet(NamedTuple):
    """A value and its derivatives."""

    v: str
    x: _Term = None
    y: _Term = None
    xx: _Term = None
    xy: _Term = None
    yy: _Term = None


@lru_cache(maxsize=4096)
def _generate(root: Node) -> tuple[str, tuple[Evaluation, ...]]:
    """The source of a tree, and the values of its parts without x and y, in the order of the source's arguments."""
    writer = _Writer()
    results = ", ".join(part or "0.0" for part in writer.jet(root))
    unpack = [f"    {', '.join(writer.fixed.values())}, = k"] if writer.fixed else []
    outer = [f"    {line}" for line in writer.outer]
    inner = [f"        {line}" for line in writer.inner]
    lines = ["def make(k):", *unpack, *outer, "    def path(x, y):", *inner, f"        return {results}"]
    return "\n".join([*lines, "    return path", ""]), tuple(map(tree.evaluation, writer.fixed))


_DERIVATIVES = {
    "sqrt": ("0.5 / {f}", "-{g} * {g} / {f}"),
    "sin": ("cos({u})", "-{f}"),
    "cos": ("-sin({u})", "-{f}"),
    "tan": ("1.0 + {f} * {f}", "2.0 * {f} * {g}"),
    "asin": ("1.0 / sqrt(1.0 - {u} * {u})", "{u} * {g} * {g} * {g}"),
    "acos": ("-1.0 / sqrt(1.0 - {u} * {u})", "{u} * {g} * {g} * {g}"),
    "atan": ("1.0 / (1.0 + {u} * {u})", "-2.0 * {u} * {g} * {g}"),
    "exp": ("{f}", "{f}"),
    "log": ("1.0 / {u}", "-{g} * {g}"),
    "abs": ("copysign(1.0, {u})", ""),
}
"""f' and f'' of f(u); {g} stands for f'."""

_NAMES = re.compile(r"[a-z]\w*")


class _Writer:
    """Generator of source lines, each naming one new value; common subexpressions are written once.

    `inner` lines depend on x or y, `outer` ones are computed once, when parameters are bound.
    """

    def __init__(self) -> None:
        self.fixed: dict[Node, str] = {}
        self.outer: list[str] = []
        self.inner: list[str] = []
        self._known: dict[str, str] = {}
        self._of_point = {"x", "y"}  # names of what depends on them

    def let(self, text: str) -> str:
        if text not in self._known:
            name = self._known[text] = f"t{len(self._known)}"
            inner = not self._of_point.isdisjoint(_NAMES.findall(text))
            (self.inner if inner else self.outer).append(f"{name} = {text}")
            if inner:
                self._of_point.add(name)
        return self._known[text]

    def add(self, a: _Term, b: _Term) -> _Term:
        return self.let(f"{a} + {b}") if a and b else a or b

    def subtract(self, a: _Term, b: _Term) -> _Term:
        if b is None:
            return a
        return self.let(f"{a} - {b}") if a else self.let(f"-{b}")

    def times(self, a: _Term, b: _Term) -> _Term:
        if a is None or b is None:
            return None
        if a == "1.0":
            return b
        return a if b == "1.0" else self.let(f"{a} * {b}")

    # jets

    def jet(self, node: Node) -> _Jet:
        if not _depends_on_point(node):
            return _Jet(self._fixed(node))
        if isinstance(node, tree.Symbol):
            return _Jet("x", "1.0", None) if node.name == "x" else _Jet("y", None, "1.0")
        if isinstance(node, tree.Sum):
            jet = self.jet(node.parts[0][1])
            for minus, term in node.parts[1:]:
                jet = _each(self.subtract if minus else self.add, jet, self.jet(term))
            return jet
        if isinstance(node, tree.Product):
            jet = self.jet(node.parts[0][1])
            for divides, factor in node.parts[1:]:
                other = self.jet(factor)
                jet = self._multiply(jet, self._reciprocal(other) if divides else other)
            return jet
        assert isinstance(node, tree.Call)
        if node.function == tree.POWER:
            return self._power(*node.arguments)
        jets = [self.jet(argument) for argument in node.arguments]
        if node.function == tree.NEGATIVE:
            derivatives = [part and self.let(f"-{part}") for part in jets[0][1:]]
            return _Jet(self.let(f"-{jets[0].v}"), *derivatives)
        if node.function == "atan2":
            return self._atan2(*jets)
        if node.function in ("min", "max"):
            jet = jets[0]
            for other in jets[1:]:
                jet = self._choose(jet, other, "<=" if node.function == "min" else ">=")
            return jet
        return self._function(node.function, jets[0])

    def _fixed(self, node: Node) -> str:
        """A part without x and y, which becomes an argument."""
        return self.fixed.setdefault(node, f"k{len(self.fixed)}")

    def _chain(self, f: str, a: _Jet, b: _Jet, slopes: tuple[_Term, _Term], bends: tuple[_Term, ...]) -> _Jet:
        """f(a, b) from f, (f_a, f_b) and (f_aa, f_ab, f_bb)."""
        (fa, fb), (faa, fab, fbb) = slopes, bends

        def first(ap: _Term, bp: _Term) -> _Term:
            return self.add(self.times(fa, ap), self.times(fb, bp))

        def second(ap: _Term, aq: _Term, apq: _Term, bp: _Term, bq: _Term, bpq: _Term) -> _Term:
            # f_pq = f_a a_pq + f_aa a_p a_q + f_ab (a_p b_q + a_q b_p) + f_bb b_p b_q + f_b b_pq
            bend = faa and self.times(faa, self.times(ap, aq))
            if fab:
                bend = self.add(bend, self.times(fab, self.add(self.times(ap, bq), self.times(aq, bp))))
            if fbb:
                bend = self.add(bend, self.times(fbb, self.times(bp, bq)))
            return self.add(self.add(self.times(fa, apq), bend), self.times(fb, bpq))

        xx, xy = second(a.x, a.x, a.xx, b.x, b.x, b.xx), second(a.x, a.y, a.xy, b.x, b.y, b.xy)
        return _Jet(f, first(a.x, b.x), first(a.y, b.y), xx, xy, second(a.y, a.y, a.yy, b.y, b.y, b.yy))

    def _multiply(self, a: _Jet, b: _Jet) -> _Jet:
        return self._chain(self.let(f"{a.v} * {b.v}"), a, b, (b.v, a.v), (None, "1.0", None))

    def _compose(self, u: _Jet, f: str, f1: _Term, f2: _Term) -> _Jet:
        """f(u) from f, f' and f'' at u."""
        return self._chain(f, u, _Jet("0.0"), (f1, None), (f2, None, None))

    def _reciprocal(self, u: _Jet) -> _Jet:
        f = self.let(f"1.0 / {u.v}")
        f1 = self.let(f"-{f} * {f}")
        return self._compose(u, f, f1, self.let(f"-2.0 * {f1} * {f}"))

    def _power(self, base: Node, exponent: Node) -> _Jet:
        if _depends_on_point(exponent):  # u^w = exp(w log u)
            logarithm = self._function("log", self.jet(base))
            return self._function("exp", self._multiply(self.jet(exponent), logarithm))
        u = self.jet(base)
        if tree.symbols(exponent) <= {"pi"}:
            number = tree.evaluation(exponent)({})
            if number == int(number):
                return self._whole_power(u, int(number))
        e = self._fixed(exponent)
        f = self.let(f"pow({u.v}, {e})")
        f1 = self.let(f"{e} * pow({u.v}, {e} - 1.0)")
        return self._compose(u, f, f1, self.let(f"{e} * ({e} - 1.0) * pow({u.v}, {e} - 2.0)"))

    def _whole_power(self, u: _Jet, n: int) -> _Jet:
        def raised(power: int) -> str:
            if power in (0, 1):
                return u.v if power else "1.0"
            return self.let(f"{u.v} * {u.v}" if power == 2 else f"{u.v} ** {power}")

        f1 = self.times(f"{n}.0", raised(n - 1)) if n != 0 else None
        f2 = self.times(f"{n * (n - 1)}.0", raised(n - 2)) if n not in (0, 1) else None
        return self._compose(u, raised(n), f1, f2)

    def _function(self, name: str, u: _Jet) -> _Jet:
        f = self.let(f"{name}({u.v})")
        first, second = _DERIVATIVES[name]
        f1 = self.let(first.format(u=u.v, f=f))
        return self._compose(u, f, f1, self.let(second.format(u=u.v, f=f, g=f1)) if second else None)

    def _atan2(self, a: _Jet, b: _Jet) -> _Jet:
        """atan2(a, b): the derivatives of atan(a/b) where b ≠ 0, and of its continuation elsewhere."""
        f = self.let(f"atan2({a.v}, {b.v})")
        s = self.let(f"{a.v} * {a.v} + {b.v} * {b.v}")
        fa, fb = self.let(f"{b.v} / {s}"), self.let(f"-{a.v} / {s}")
        fbb = self.let(f"-2.0 * {fa} * {fb}")
        fab = self.let(f"{fb} * {fb} - {fa} * {fa}")
        return self._chain(f, a, b, (fa, fb), (self.let(f"-{fbb}"), fab, fbb))

    def _choose(self, a: _Jet, b: _Jet, relation: str) -> _Jet:
        def pick(one: _Term, two: _Term) -> _Term:
            return self.let(f"{one or '0.0'} if {a.v} {relation} {b.v} else {two or '0.0'}") if one or two else None

        return _each(pick, a, b)


def _each(join: Callable[[_Term, _Term], _Term], a: _Jet, b: _Jet) -> _Jet:
    """Each part of two jets joined."""
    v, *derivatives = map(join, a, b)
    assert v is not None
    return _Jet(v, *derivatives)


@lru_cache(maxsize=65536)
def _depends_on_point(node: Node) -> bool:
    return not tree.symbols(node).isdisjoint({"x", "y"})
