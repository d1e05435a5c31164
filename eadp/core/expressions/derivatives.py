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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from eadp.core.expressions import tree
from eadp.core.expressions.tree import Evaluation, Expression, Node
from eadp.errors import PathUndefined

Jet = tuple[float, float, float, float, float, float]
"""φ, ∂φ/∂x, ∂φ/∂y, ∂²φ/∂x², ∂²φ/∂x∂y, ∂²φ/∂y²."""

PathFunction = Callable[[float, float], Jet]
"""A path function with its parameters bound: (x, y) [m] → jet. Raises ValueError or ArithmeticError where undefined."""


def bind(
    expression: Expression, parameters: Sequence[float], variables: Mapping[str, float] | None = None
) -> PathFunction:
    """The path function of an expression at given parameters.

    Parameters
    ----------
    expression : Expression
        In x, y and parameters.
    parameters : sequence of float
        c1, c2, …; at least as many as the expression names.
    variables : mapping of str to float, optional
        Values of the other names in it.

    Returns
    -------
    function (x, y) → (φ, φx, φy, φxx, φxy, φyy)

    Raises
    ------
    PathUndefined
        If a part that depends on the parameters alone has no finite real value.
    """
    source, fixed = _generate(expression.node)
    values = {**tree.named(parameters), **(variables or {})}
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
        for name in ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "pow", "copysign")
    }
    exec(compile(source, "<path function>", "exec"), namespace)
    return namespace["make"]  # type: ignore[no-any-return]


# --- generating -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Value:
    """The name of a computed value, and whether it depends on x or y (else it is computed once, when bound)."""

    text: str
    inner: bool


@dataclass(frozen=True, slots=True)
class _Jet:
    """Six values; None is a derivative that is zero by its form."""

    v: _Value
    x: _Value | None = None
    y: _Value | None = None
    xx: _Value | None = None
    xy: _Value | None = None
    yy: _Value | None = None


_ONE = _Value("1.0", False)
_TWO = _Value("2.0", False)


@lru_cache(maxsize=4096)
def _generate(root: Node) -> tuple[str, tuple[Evaluation, ...]]:
    """The source of a tree, and the values of its parts without x and y, in the order of the source's arguments."""
    writer = _Writer()
    jet = writer.jet(root)
    results = ", ".join(part.text if part else "0.0" for part in (jet.v, jet.x, jet.y, jet.xx, jet.xy, jet.yy))
    unpack = [f"    {', '.join(value.text for value in writer.fixed.values())}, = k"] if writer.fixed else []
    outer = [f"    {line}" for line in writer.outer]
    inner = [f"        {line}" for line in writer.inner]
    lines = ["def make(k):", *unpack, *outer, "    def path(x, y):", *inner, f"        return {results}"]
    return "\n".join([*lines, "    return path", ""]), tuple(map(tree.evaluation, writer.fixed))


class _Writer:
    """Generator of source lines, each naming one new value; common subexpressions are written once."""

    def __init__(self) -> None:
        self.fixed: dict[Node, _Value] = {}
        self.outer: list[str] = []
        self.inner: list[str] = []
        self._known: dict[str, _Value] = {}

    def let(self, text: str, *operands: _Value) -> _Value:
        if text not in self._known:
            inner = any(operand.inner for operand in operands)
            lines = self.inner if inner else self.outer
            name = f"t{len(self._known)}"
            lines.append(f"{name} = {text}")
            self._known[text] = _Value(name, inner)
        return self._known[text]

    # sums and products of values, where None is zero

    def add(self, a: _Value | None, b: _Value | None) -> _Value | None:
        if a is None or b is None:
            return a or b
        return self.let(f"{a.text} + {b.text}", a, b)

    def subtract(self, a: _Value | None, b: _Value | None) -> _Value | None:
        if b is None:
            return a
        return self.let(f"{a.text} - {b.text}", a, b) if a else self.negate(b)

    def negate(self, a: _Value | None) -> _Value | None:
        return self.let(f"-{a.text}", a) if a else None

    def times(self, a: _Value | None, b: _Value | None) -> _Value | None:
        if a is None or b is None:
            return None
        if a.text == "1.0":
            return b
        if b.text == "1.0":
            return a
        return self.let(f"{a.text} * {b.text}", a, b)

    # jets

    def jet(self, node: Node) -> _Jet:
        if not _depends_on_point(node):
            return _Jet(self._fixed(node))
        if isinstance(node, tree.Symbol):
            one_x, one_y = (_ONE, None) if node.name == "x" else (None, _ONE)
            return _Jet(_Value(node.name, True), one_x, one_y)
        if isinstance(node, tree.Sum):
            return self._sum(node)
        if isinstance(node, tree.Product):
            jet = self.jet(node.factors[0][1])
            for divides, factor in node.factors[1:]:
                other = self.jet(factor)
                jet = self._multiply(jet, self._reciprocal(other) if divides else other)
            return jet
        if isinstance(node, tree.Negative):
            jet = self.jet(node.operand)
            negative = [self.negate(part) for part in (jet.x, jet.y, jet.xx, jet.xy, jet.yy)]
            return _Jet(self.let(f"-{jet.v.text}", jet.v), *negative)
        if isinstance(node, tree.Power):
            return self._power(node)
        assert isinstance(node, tree.Call)
        jets = [self.jet(argument) for argument in node.arguments]
        if node.function == "atan2":
            return self._atan2(*jets)
        if node.function in ("min", "max"):
            jet = jets[0]
            for other in jets[1:]:
                jet = self._choose(jet, other, "<=" if node.function == "min" else ">=")
            return jet
        return self._function(node.function, jets[0])

    def _fixed(self, node: Node) -> _Value:
        """A part without x and y, which becomes an argument."""
        return self.fixed.setdefault(node, _Value(f"k{len(self.fixed)}", False))

    def _sum(self, node: tree.Sum) -> _Jet:
        jet = self.jet(node.terms[0][1])
        for minus, term in node.terms[1:]:
            jet = _each(self.subtract if minus else self.add, jet, self.jet(term))
        return jet

    def _multiply(self, a: _Jet, b: _Jet) -> _Jet:
        v = self.times(a.v, b.v)
        assert v is not None
        twice = (self.times(_TWO, self.times(a.x, b.x)), self.times(_TWO, self.times(a.y, b.y)))
        mixed = self.add(self.times(a.x, b.y), self.times(a.y, b.x))
        return self._two(v, a, b, (b.v, a.v), (twice[0], mixed, twice[1]))

    def _two(
        self,
        f: _Value,
        a: _Jet,
        b: _Jet,
        slopes: tuple[_Value, _Value],
        bends: tuple[_Value | None, _Value | None, _Value | None],
    ) -> _Jet:
        """f(a, b) from f, (f_a, f_b), and the parts of its xx, xy, yy that hold products of first derivatives."""

        def first(da: _Value | None, db: _Value | None) -> _Value | None:
            return self.add(self.times(slopes[0], da), self.times(slopes[1], db))

        def second(daa: _Value | None, bend: _Value | None, dbb: _Value | None) -> _Value | None:
            return self.add(self.add(self.times(slopes[0], daa), bend), self.times(slopes[1], dbb))

        pairs = zip((a.xx, a.xy, a.yy), bends, (b.xx, b.xy, b.yy), strict=True)
        return _Jet(f, first(a.x, b.x), first(a.y, b.y), *(second(*parts) for parts in pairs))

    def _compose(self, u: _Jet, f: _Value, f1: _Value | None, f2: _Value | None) -> _Jet:
        """f(u) from f, f' and f'' at u: (f∘u)_ab = f'' u_a u_b + f' u_ab."""

        def second(ua: _Value | None, ub: _Value | None, uab: _Value | None) -> _Value | None:
            return self.add(self.times(f2, self.times(ua, ub)), self.times(f1, uab))

        first_x, first_y = self.times(f1, u.x), self.times(f1, u.y)
        return _Jet(f, first_x, first_y, second(u.x, u.x, u.xx), second(u.x, u.y, u.xy), second(u.y, u.y, u.yy))

    def _reciprocal(self, u: _Jet) -> _Jet:
        f = self.let(f"1.0 / {u.v.text}", u.v)
        f1 = self.let(f"-{f.text} * {f.text}", f)
        return self._compose(u, f, f1, self.let(f"-2.0 * {f1.text} * {f.text}", f1, f))

    def _power(self, node: tree.Power) -> _Jet:
        if _depends_on_point(node.exponent):  # u^w = exp(w log u)
            logarithm = self._function("log", self.jet(node.base))
            return self._function("exp", self._multiply(self.jet(node.exponent), logarithm))
        u = self.jet(node.base)
        if tree.symbols(node.exponent) <= {"pi"}:
            exponent = tree.evaluation(node.exponent)({})
            if exponent == int(exponent):
                return self._whole_power(u, int(exponent))
        e = self._fixed(node.exponent)
        f = self.let(f"pow({u.v.text}, {e.text})", u.v, e)
        f1 = self.let(f"{e.text} * pow({u.v.text}, {e.text} - 1.0)", u.v, e)
        f2 = self.let(f"{e.text} * ({e.text} - 1.0) * pow({u.v.text}, {e.text} - 2.0)", u.v, e)
        return self._compose(u, f, f1, f2)

    def _whole_power(self, u: _Jet, n: int) -> _Jet:
        def raised(power: int) -> _Value:
            if power == 0:
                return _ONE
            if power == 1:
                return u.v
            return self.let(f"{u.v.text} * {u.v.text}" if power == 2 else f"{u.v.text} ** {power}", u.v)

        f1 = self.times(_Value(f"{n}.0", False), raised(n - 1)) if n != 0 else None
        f2 = self.times(_Value(f"{n * (n - 1)}.0", False), raised(n - 2)) if n not in (0, 1) else None
        return self._compose(u, raised(n), f1, f2)

    def _function(self, name: str, u: _Jet) -> _Jet:
        t = u.v.text
        f = self.let(f"{name}({t})", u.v)
        derivatives = {  # f' and f'' from u and f; {g} stands for f'
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
        first, second = derivatives[name]
        f1 = self.let(first.format(u=t, f=f.text), u.v, f)
        f2 = self.let(second.format(u=t, f=f.text, g=f1.text), u.v, f, f1) if second else None
        return self._compose(u, f, f1, f2)

    def _atan2(self, a: _Jet, b: _Jet) -> _Jet:
        """atan2(a, b): the derivatives of atan(a/b) where b ≠ 0, and of its continuation elsewhere."""
        f = self.let(f"atan2({a.v.text}, {b.v.text})", a.v, b.v)
        s = self.let(f"{a.v.text} * {a.v.text} + {b.v.text} * {b.v.text}", a.v, b.v)
        fa = self.let(f"{b.v.text} / {s.text}", b.v, s)
        fb = self.let(f"-{a.v.text} / {s.text}", a.v, s)
        fbb = self.let(f"-2.0 * {fa.text} * {fb.text}", fa, fb)
        fab = self.let(f"{fb.text} * {fb.text} - {fa.text} * {fa.text}", fa, fb)
        faa = self.negate(fbb)

        def bend(a1: _Value | None, a2: _Value | None, b1: _Value | None, b2: _Value | None) -> _Value | None:
            total = self.times(faa, self.times(a1, a2))
            total = self.add(total, self.times(fab, self.add(self.times(a1, b2), self.times(a2, b1))))
            return self.add(total, self.times(fbb, self.times(b1, b2)))

        bends = (bend(a.x, a.x, b.x, b.x), bend(a.x, a.y, b.x, b.y), bend(a.y, a.y, b.y, b.y))
        return self._two(f, a, b, (fa, fb), bends)

    def _choose(self, a: _Jet, b: _Jet, relation: str) -> _Jet:
        test = f"{a.v.text} {relation} {b.v.text}"

        def pick(first: _Value | None, second: _Value | None) -> _Value | None:
            if first is None and second is None:
                return None
            one, two = first or _Value("0.0", False), second or _Value("0.0", False)
            return self.let(f"{one.text} if {test} else {two.text}", one, two, a.v, b.v)

        return _each(pick, a, b)


def _each(join: Callable[[_Value | None, _Value | None], _Value | None], a: _Jet, b: _Jet) -> _Jet:
    """Each part of two jets joined."""
    v = join(a.v, b.v)
    assert v is not None
    pairs = ((a.x, b.x), (a.y, b.y), (a.xx, b.xx), (a.xy, b.xy), (a.yy, b.yy))
    return _Jet(v, *(join(one, two) for one, two in pairs))


@lru_cache(maxsize=65536)
def _depends_on_point(node: Node) -> bool:
    return not tree.symbols(node).isdisjoint({"x", "y"})
