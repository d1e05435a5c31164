"""Structure found in explicit stages: the number n of primitive ones, and the shift d(c) between laps.

Source: letter, Def. II.5 and Eq. 2; draft 004, Eq. 1. The rank test of draft 003 (Prop. II.2) says less.
"""

from __future__ import annotations

from fractions import Fraction

from eadp.core.expressions.algebra import cancels, expanded, simplified
from eadp.core.expressions.tree import Expression, Symbol, constant, difference, substituted, total
from eadp.errors import ExpressionError
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import PointExpression, Stage

TOLERANCE = Fraction(1, 10**9)
"""Share of the largest number of an expression that is rounding: of stages that a script has written, too."""

_PathTrigger = tuple[Expression, PointExpression]


def find_structure(plan: Plan) -> tuple[int, PointExpression] | None:
    """n and d(c): the smallest n for which every stage is the one n before it, moved by the same d(c); None without.

    Two whole laps are needed. φ_{i+n}(p + d) = φ_i(p) is required without the letter's constant e_j: with it, the
    stages of a lap would not be those of the last one moved. The travel's direction must agree, and triggers move by d.

    Compared multiplied out, within rounding; what is too large for that has none.
    """
    for n in range(1, len(plan.stages) // 2 + 1):
        pairs = list(zip(plan.stages, plan.stages[n:], strict=False))
        (x, y), (later_x, later_y) = pairs[0][0].trigger, pairs[0][1].trigger
        shift = difference(later_x, x), difference(later_y, y)
        shown = tidy(shift[0]), tidy(shift[1])
        moves = any(part.names or part.at() != 0 for part in shown)
        # triggers first: they are short, and most stages that differ do so there
        if moves and all(agree(*pair, shift) for agree in (_triggers_agree, _paths_agree) for pair in pairs):
            return n, shown
    return None


def _triggers_agree(stage: Stage, later: Stage, shift: PointExpression) -> bool:
    """Whether a later stage has the sense of another, and its trigger, moved."""
    parts = zip(stage.trigger, shift, later.trigger, strict=True)
    return stage.sense == later.sense and all(equal(total(one, d), other, unknown=False) for one, d, other in parts)


def _paths_agree(stage: Stage, later: Stage, shift: PointExpression) -> bool:
    """Whether a later stage has the path of another, moved."""
    try:
        return equal(stage.path, _moved(later.path, shift), unknown=False)
    except ExpressionError:  # too large when substituted
        return False


def structure_proven(plan: Plan) -> bool:
    """Whether every stage is shown symbolically to be the one n before it, moved by d(c): e_j = 0 for all x, y and c.

    False where the structure is known within rounding alone, in plans of segments, and of what is too large.

    Source: letter, Eq. 2.
    """
    if plan.shift is None:
        return False
    dx, dy = plan.shift
    try:
        return all(
            cancels(difference(_moved(later, plan.shift), path))
            and cancels(difference(later_x, total(x, dx)))
            and cancels(difference(later_y, total(y, dy)))
            for (path, (x, y)), (later, (later_x, later_y)) in _lap_pairs(plan)
        )
    except ExpressionError:  # too large when substituted
        return False


def moves_with(shift: PointExpression, first: Expression, later: Expression) -> bool:
    """Whether later(p + d, c) − first(p, c) is the same for every p, by value; so, too, where it is too large to tell.

    Source: letter, Eq. 2, in which it is the constant e_j.
    """
    try:
        gap = difference(_moved(later, shift), first)
        return equal(gap, _moved(gap, (constant(37.3), constant(-11.9))))
    except ExpressionError:
        return True


def _moved(path: Expression, shift: PointExpression) -> Expression:
    """A path function of p, of p + d."""
    dx, dy = shift
    return substituted(path, {"x": total(_symbol("x"), dx), "y": total(_symbol("y"), dy)})


def _symbol(name: str) -> Expression:
    return Expression(Symbol(name), {name: 0})


def _lap_pairs(plan: Plan) -> list[tuple[_PathTrigger, _PathTrigger]]:
    """Path and trigger of each stage that has one n before it: of that one, and its own."""
    if plan.short_form is None:
        parts: list[_PathTrigger] = [(stage.path, stage.trigger) for stage in plan.stages]
        return list(zip(parts, parts[plan.primitive_stages :], strict=False))
    # in the names of the coordinates, which the shift moves from any lap to the next
    moves = {name: total(_symbol(name), move) for name, _, move in plan.short_form.coordinates}
    return [
        ((path, (x, y)), (substituted(path, moves), (substituted(x, moves), substituted(y, moves))))
        for path, (x, y) in plan.short_form.stages
    ]


def shifts_agree(stated: PointExpression, found: PointExpression) -> bool:
    """Whether the shift that a file's first line states is that of the stages, or its opposite."""
    opposite = [difference(constant(0.0), part) for part in found]
    return any(all(map(equal, stated, parts)) for parts in (found, opposite))


def equal(a: Expression, b: Expression, *, unknown: bool = True) -> bool:
    """Whether two expressions are the same multiplied out, within rounding; `unknown` where they are too large."""
    try:
        one, other = expanded(a.node), expanded(b.node)
    except ArithmeticError:
        return unknown
    none = Fraction(0)
    within = TOLERANCE * (1 + max(map(abs, one.values()), default=none))
    return all(abs(one.get(each, none) - other.get(each, none)) <= within for each in one.keys() | other.keys())


def tidy(expression: Expression) -> Expression:
    """A number where it is one, else multiplied out where that is shorter."""
    return simplified(expression) if expression.names else constant(round(expression.at(), 12))
