"""Computer algebra on expression trees: the only module that imports sympy, and late."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

from eadp.core.expressions import tree
from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import FUNCTIONS, NON_SMOOTH_FUNCTIONS, Expression, Node
from eadp.errors import EadpError, ExpressionError, printable

SIZE_LIMIT = 400
"""Most nodes of a tree that is given to sympy."""

DEGREE_LIMIT = 1000
"""Highest power that exponents within exponents may make of a part of such a tree."""

TERMS_LIMIT, LOW_DEGREE = 300, 16
"""Bounds of what is multiplied out without a limit of time: the number of terms, and the powers of their parts."""

_COMPARED = {*NON_SMOOTH_FUNCTIONS, "atan2"}
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
        size = 0.0
        for _, term in node.terms:
            size += _magnitude(term, values)
        return size
    if isinstance(node, tree.Product):
        size = 1.0
        for divides, factor in node.factors:
            part = abs(tree.evaluation(factor)(values)) if divides else _magnitude(factor, values)
            size = size / part if divides else size * part
        return size
    if isinstance(node, tree.Negative):
        return _magnitude(node.operand, values)
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
    """The expression multiplied out and collected as by sympy, where that makes it shorter; else unchanged.

    Only trees whose expansion is small are given to sympy: a power of a sum has as many terms as its exponent allows.
    Where it is a number and a multiple of one symbol or of one root, as the shift of most plans, sympy is not imported.
    """
    if not _expands_shortly(expression):
        return expression
    try:
        text = _collected(expression.node)
        if text is not None:
            simple = read_expression(text, expression.names)
        else:
            simple = from_sympy(load_sympy().expand(to_sympy(expression.node)))
    except (ExpressionError, ArithmeticError, ValueError, TypeError):  # for example atan2(0, 0)
        return expression
    return simple if len(simple.text) < len(expression.text) else expression


def _collected(node: Node) -> str | None:
    """What sympy shows of a tree multiplied out, if it is a number and a multiple of one term at most; else None."""
    multiples = _multiples(node)
    if multiples is None:
        return None
    number = multiples.pop("", Fraction(0))
    parts = [f"{number}"] if number or not multiples else []
    for term, multiple in multiples.items():
        above, below = abs(multiple.numerator), multiple.denominator
        text = f"{above}*{term}" if above > 1 else term
        parts += ["-" if multiple < 0 else "+", f"{text}/{below}" if below > 1 else text]
    if not number and multiples:
        parts = ["".join(parts).removeprefix("+")]
    return " ".join(parts) if len(multiples) < 2 else None


def _multiples(node: Node) -> dict[str, Fraction] | None:
    """A tree as the sum of multiples of symbols and roots by their texts, and of a number, whose text is empty.

    None for any other tree. A root is that of a symbol and a whole number: sympy takes factors out of others.
    """
    if isinstance(node, tree.Number):
        return {"": Fraction(repr(node.value))}
    if isinstance(node, tree.Symbol):
        return None if node.name == "pi" else {node.name: Fraction(1)}
    found = []
    for part in tree.children(node):
        multiples = _multiples(part)
        if multiples is None:
            return None
        found.append(multiples)
    if isinstance(node, tree.Call) and node.function == "sqrt":
        number, names = found[0].pop("", Fraction(0)), list(found[0])
        if len(names) == 1 and "(" not in names[0] and found[0][names[0]] == 1 and number.denominator == 1:
            return {f"sqrt({number} + {names[0]})" if number else f"sqrt({names[0]})": Fraction(1)}
        return None
    if isinstance(node, tree.Sum):
        signs = [-1 if minus else 1 for minus, _ in node.terms]
    elif isinstance(node, tree.Negative):
        signs = [-1]
    elif isinstance(node, tree.Product):
        return _product([(divides, part) for (divides, _), part in zip(node.factors, found, strict=True)])
    else:
        return None
    result: dict[str, Fraction] = {}
    for sign, multiples in zip(signs, found, strict=True):
        for term, multiple in multiples.items():
            result[term] = result.get(term, Fraction(0)) + sign * multiple
    return {term: multiple for term, multiple in result.items() if multiple}


def _product(factors: Sequence[tuple[bool, dict[str, Fraction]]]) -> dict[str, Fraction] | None:
    """The product of such sums, of which one at most is no number; None for others, and for a division by 0."""
    result = {"": Fraction(1)}
    for divides, part in factors:
        number = part.get("", Fraction(0))
        if part.keys() <= {""}:
            if divides and not number:
                return None
            result = {term: multiple / number if divides else multiple * number for term, multiple in result.items()}
        elif divides or not result.keys() <= {""}:
            return None
        else:
            result = {term: multiple * result[""] for term, multiple in part.items()}
    return {term: multiple for term, multiple in result.items() if multiple}


def cancels(expression: Expression) -> bool:
    """Whether sympy shows at once that an expression is 0 for every value of its symbols; False: undecided, or not 0.

    Only trees whose expansion is small are given to sympy, as in `simplified`.
    """
    return _expands_shortly(expression) and bool(load_sympy().expand(to_sympy(expression.node)) == 0)


def _expands_shortly(expression: Expression) -> bool:
    """Whether multiplying out costs little: few nodes, few terms, low powers."""
    if expression.size > SIZE_LIMIT / 2:
        return False
    terms, degree = _expansion(expression.node)
    return terms <= TERMS_LIMIT and degree <= LOW_DEGREE


def _expansion(node: Node) -> tuple[float, float]:
    """Bounds of the number of terms of a tree multiplied out, and of the powers in them.

    A function counts as its argument, as powers of a root bring it out; functions whose arguments sympy compares with
    one another at length count 16 times.
    """
    parts = []
    for part in tree.children(node):  # a plain loop: a comprehension would double the depth of the stack
        parts.append(_expansion(part))
    terms, degrees = [part[0] for part in parts], [part[1] for part in parts]
    if not parts:
        return 1.0, 1.0
    if isinstance(node, tree.Product):
        return math.prod(terms), sum(degrees)
    if isinstance(node, tree.Power):
        power = _power(node)
        return math.exp(min(power * math.log(terms[0]), 700.0)), degrees[0] * power
    times = 16 if isinstance(node, tree.Call) and node.function in _COMPARED else 1
    return times * sum(terms), max(degrees)


def _power(node: tree.Power) -> float:
    """What a power does to the number of terms and to the degree of its base; too much for any but a whole constant."""
    try:
        exponent = tree.evaluation(node.exponent)({})
    except (KeyError, ArithmeticError, ValueError):
        return LOW_DEGREE + 1.0
    return max(1.0, abs(exponent), 0.0 if exponent == int(exponent) else LOW_DEGREE + 1.0)


def from_sympy(result: Any) -> Expression:
    """An expression from a sympy tree, read back through the reader so that every check holds.

    Raises
    ------
    ExpressionError
        If the tree holds a function or a constant that plan expressions do not have.
    """
    text = load_sympy().sstr(result, order="none")
    for name in NON_SMOOTH_FUNCTIONS:
        text = text.replace(f"{name.title()}(", f"{name}(")
    return read_expression(text, [symbol.name for symbol in result.free_symbols])


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
        return cls(_limited(path), load_sympy().Matrix([_limited(part) for part in trigger]))

    @cached_property
    def gradient(self) -> Any:
        """∇φ, a matrix of shape (2, 1)."""
        return load_sympy().Matrix([self.path.diff(v) for v in _coordinates()])

    @cached_property
    def hessian(self) -> Any:
        """The Hessian of φ, a symmetric matrix of shape (2, 2)."""
        return load_sympy().hessian(self.path, _coordinates())

    def lines(self, index: int, style: str) -> list[str]:
        """Its expressions in sympy's plain syntax, each with its name as a comment, or as LaTeX.

        Parameters
        ----------
        index : int
            The stage's.
        style : str
            `sympy` or `latex`.
        """
        sympy = load_sympy()
        if style == "latex":
            named = {
                rf"\varphi_{{{index}}}": self.path,
                rf"\nabla \varphi_{{{index}}}": self.gradient,
                rf"\nabla^{{2}} \varphi_{{{index}}}": self.hessian,
                rf"\mathbf{{p}}_{{\Gamma_{{{index}}}}}": self.trigger,
            }
            return [f"{name} = {sympy.latex(value)}" for name, value in named.items()]
        (xx, xy), (_, yy) = self.hessian.tolist()
        values = (self.path, *self.gradient, xx, xy, yy, *self.trigger)
        names = [f"phi_{index}{d}" for d in ("", "_x", "_y", "_xx", "_xy", "_yy")]
        names += [f"trigger_{index}_x", f"trigger_{index}_y"]
        return [f"{sympy.sstr(value)}  # {name}" for name, value in zip(names, values, strict=True)]


def _limited(expression: Expression) -> Any:
    """`to_sympy` of an expression within the limits above."""
    if expression.size > SIZE_LIMIT or _expansion(expression.node)[1] > DEGREE_LIMIT:
        what = f"at most {SIZE_LIMIT} parts, and powers of {DEGREE_LIMIT}"
        raise EadpError(f"{printable(expression.text, 60)} is too large for sympy: {what}")
    return to_sympy(expression.node)


def _coordinates() -> list[Any]:
    return [load_sympy().Symbol(name, real=True) for name in ("x", "y")]


# --- proofs: for a process that may be ended, as sympy knows no limit of time -----------------------------------------


def remainder(expression: Expression) -> str | None:
    """The expression multiplied out by sympy, in its syntax: '0' where it is 0 for every value.

    None where that is undecided, or the text is longer than an expression may be.
    """
    sympy = load_sympy()
    value = sympy.expand(_limited(expression))
    if value != 0 and is_zero(expression.node):
        return "0" if sympy.simplify(value) == 0 else None
    text = str(sympy.sstr(value))
    return None if value.has(sympy.nan, sympy.zoo, sympy.oo) or len(text) > tree.LENGTH_LIMIT else text


def same_direction(
    here: SymbolicStage, there: SymbolicStage, sense: int, ranges: Mapping[str, tuple[float, float]]
) -> bool | None:
    """Whether the gradients of two paths, each at the trigger that comes with it, are parallel for all parameters.

    Parameters
    ----------
    here, there : SymbolicStage
        The trigger of each is the point where they meet, in the frame of its own path.
    sense : int
        +1: they shall point the same way; −1: opposite ways.
    ranges : mapping of str to (float, float)
        The sets of the parameters; a name that is not in it may have any value.

    Returns
    -------
    bool or None
        None: undecided.
    """
    sympy = load_sympy()
    x, y = _coordinates()
    ax, ay = here.gradient.xreplace({x: here.trigger[0], y: here.trigger[1]})
    bx, by = there.gradient.xreplace({x: there.trigger[0], y: there.trigger[1]})
    across = remainder(from_sympy(sympy.expand(ax * by - ay * bx)))
    if across != "0":
        return None if across is None else False
    # the sign of a·b over the box of the sets, by interval arithmetic on exact numbers
    intervals = {
        sympy.Symbol(name, real=True): sympy.AccumBounds(sympy.Rational(repr(lo)), sympy.Rational(repr(hi)))
        for name, (lo, hi) in ranges.items()
    }
    along = sympy.expand(sense * (ax * bx + ay * by)).subs(intervals)
    lowest, highest = (along.min, along.max) if isinstance(along, sympy.AccumBounds) else (along, along)
    return True if lowest.is_positive else False if highest.is_negative else None
