"""Structure found in explicit stages: the number n of primitive ones, and the shift d(c) between laps.

Source: letter, Def. II.5 and Eq. 2; draft 004, Eq. 1. The rank test of draft 003 (Prop. II.2) says less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.expressions.algebra import is_zero, simplified
from eadp.core.expressions.tree import Expression, Symbol, constant, difference, substituted, total
from eadp.errors import ExpressionError, PathUndefined
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import PointExpression

SAMPLES = (0.0, 0.137, 0.574, 0.911)
"""Sampled values of the parameters, as shares of their sets; without sets, the parameters themselves."""

OFFSETS_M = [(11.9 * i * math.cos(2.4 * i), 11.9 * i * math.sin(2.4 * i)) for i in range(8)]
"""Points on a spiral round its trigger at which a path is evaluated: more than a quadratic has coefficients."""

TOLERANCE = 1e-9


def find_structure(plan: Plan) -> tuple[int, PointExpression] | None:
    """n and d(c): the smallest n for which every stage is the one n before it, moved by the same d(c); None without.

    Two whole laps are needed. φ_{i+n}(p + d) = φ_i(p) is required without the letter's constant e_j: with it, the
    stages of a lap would not be those of the last one moved. The travel's direction must agree, and triggers move by d.

    Compared at sample parameters and points; the answer's d(c) is symbolic.
    """
    stages = plan.stages
    if len(stages) < 2:
        return None
    signature = _signature(plan)
    if signature is None:
        return None
    values, triggers = signature
    scale = 1 + np.abs(values).max(axis=1)
    for n in range(1, len(stages) // 2 + 1):
        if not _repeats(values, triggers, scale, n, n + 1):  # the first pair decides most cases
            continue
        if _repeats(values, triggers, scale, n, len(stages)):
            first, later = stages[0].trigger, stages[n].trigger
            return n, (tidy(difference(later[0], first[0])), tidy(difference(later[1], first[1])))
    return None


def moves_with(shift: PointExpression, first: Expression, later: Expression) -> bool:
    """Whether later(p + d, c) − first(p, c) is the same for every p, by value; so, too, where it is too large to tell.

    Source: letter, Eq. 2, in which it is the constant e_j.
    """
    try:
        gap = difference(moved(later, shift), first)
        return equal(gap, moved(gap, (constant(37.3), constant(-11.9))))
    except ExpressionError:
        return True


def moved(path: Expression, shift: PointExpression) -> Expression:
    """A path function of p, of p + d."""
    dx, dy = shift
    return substituted(path, {"x": total(symbol("x"), dx), "y": total(symbol("y"), dy)})


def symbol(name: str) -> Expression:
    """The expression of a name."""
    return Expression(Symbol(name), {name: 0})


def shifts_agree(stated: PointExpression, found: PointExpression) -> bool:
    """Whether the shift that a file's first line states is that of the stages, or its opposite."""
    opposite = [difference(constant(0.0), part) for part in found]
    return any(all(map(equal, stated, parts)) for parts in (found, opposite))


def _repeats(values: FloatArray, triggers: FloatArray, scale: FloatArray, n: int, end: int) -> bool:
    """Whether stages n..end are those n before them, moved alike."""
    gap = np.abs(values[n:end] - values[: end - n]).max(axis=1)
    if (gap > TOLERANCE * scale[n:end]).any():
        return False
    moves = triggers[n:end] - triggers[: end - n]
    reach = 1 + np.abs(triggers[:end]).max()
    same = np.abs(moves - moves[0]).max() <= TOLERANCE * reach
    return bool(same and np.abs(moves[0]).max() > TOLERANCE * reach)


def _signature(plan: Plan) -> tuple[FloatArray, FloatArray] | None:
    """Each stage's path round its trigger with its sense, shape (L, ·), and its triggers, shape (L, ·)."""
    values, triggers = [], []
    samples = _samples(plan)
    for stage in plan.stages:
        row: list[float] = [100.0 * stage.sense]
        points: list[float] = []
        for parameters in samples:
            try:
                path = stage.path_at(parameters)
                x, y = stage.trigger_at(parameters)
                row += [path(x + dx, y + dy)[0] for dx, dy in OFFSETS_M]
            except (PathUndefined, ArithmeticError, ValueError):
                return None
            points += [x, y]
        if not np.isfinite(row).all():
            return None
        values.append(row)
        triggers.append(points)
    return np.array(values), np.array(triggers)


def _samples(plan: Plan) -> list[Sequence[float]]:
    rho = plan.path_count
    if not rho:
        return [()]
    if not plan.has_sets:
        return [[share * (1 + 0.1 * i) for i in range(rho)] for share in SAMPLES]
    boxes = [plan.hull(i) for i in range(rho)]
    return [[box.lo + (share + 0.01 * i) * (box.hi - box.lo) for i, box in enumerate(boxes)] for share in SAMPLES]


def equal(a: Expression, b: Expression) -> bool:
    """Whether two expressions have the same value for all values of their symbols."""
    gap = difference(a, b)
    return is_zero(gap.node) if gap.names else abs(gap.value({})) < TOLERANCE


def tidy(expression: Expression) -> Expression:
    """A number where it is one, else as simple as sympy makes it."""
    return simplified(expression) if expression.names else constant(round(expression.value({}), 12))
