"""Structure found in explicit stages: the number n of primitive ones, and the shift d(c) between laps.

Source: letter, Def. II.5 and Eq. 2; draft 004, Eq. 1. The rank test of draft 003 (Prop. II.2) says less.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.expressions.algebra import cancels, is_zero, load_sympy, simplified
from eadp.core.expressions.tree import Expression, Symbol, constant, difference, scaled, substituted, total
from eadp.core.geometry.curves import is_zero_polynomial
from eadp.errors import ExpressionError, PathUndefined
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import LoopVariable, PointExpression, Segment, Stage, State

SAMPLES = (0.0, 0.137, 0.574, 0.911)
"""Sampled values of the parameters, as shares of their sets; without sets, the parameters themselves."""

OFFSETS_M = (
    (0.0, 0.0),
    (31.7, 8.9),
    (-23.3, 41.1),
    (5.3, -37.9),
    (-47.7, -13.1),
    (67.1, 61.3),
    (11.9, 83.3),
    (-71.3, 29.9),
)
"""Points round its trigger at which a path is evaluated: more than a quadratic has coefficients."""

SYMBOLIC_STAGES, SYMBOLIC_LIMIT_S = 200, 1.0
"""Most stages of a plan whose structure is shown symbolically, and processor time for it [s], checked at each step."""

TOLERANCE = 1e-9
SMALL_STEP_M = 0.1


_PathTrigger = tuple[Expression, PointExpression]


@dataclass(frozen=True, slots=True)
class Structure:
    """n, and d(c)."""

    primitive_stages: int
    shift: PointExpression


def find_structure(plan: Plan) -> Structure | None:
    """The smallest n for which every stage is the one n before it, moved by the same d(c); None without.

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
            return Structure(n, (tidy(difference(later[0], first[0])), tidy(difference(later[1], first[1]))))
    return None


def structure_proven(plan: Plan) -> bool:
    """Whether every stage is shown symbolically to be the one n before it, moved by d(c): e_j = 0 for all x, y and c.

    False where the structure is known by value alone: in plans of segments, with functions that are not smooth, which
    keep sympy busy for long, and beyond the limits above.

    Source: letter, Eq. 2.
    """
    if plan.shift is None or plan.segments or len(plan.stages) > SYMBOLIC_STAGES:
        return False
    if any(part.non_smooth for stage in plan.stages for part in (stage.path, *stage.trigger)):
        return False
    dx, dy = plan.shift
    moved = {"x": total(_symbol("x"), dx), "y": total(_symbol("y"), dy)}
    gaps = []
    try:
        for (path, (x, y)), (later, (later_x, later_y)) in _lap_pairs(plan):
            gaps += [difference(substituted(later, moved), path)]
            gaps += [difference(later_x, total(x, dx)), difference(later_y, total(y, dy))]
    except ExpressionError:  # too large when substituted
        return False
    open_gaps = [gap for gap in gaps if not is_zero_polynomial(gap)]
    if open_gaps:  # to be imported is no part of the time
        load_sympy()
    end_s = time.process_time() + SYMBOLIC_LIMIT_S
    return all(time.process_time() < end_s and cancels(gap) for gap in open_gaps)


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


def find_shift(plan: Plan) -> PointExpression | None:
    """The shift d(c) of the first lap of a plan of segments; None unless one has laps, whose form does not change.

    Looked for as the step of the one variable that changes, along the direction in which the first trigger moves with
    it. Seen from a small step: a last lap may be cut short.
    """
    laps = [segment for segment in plan.segments if segment.repeats]
    if len(laps) != 1 or sum(q.shift is not None for q in laps[0].variables) != 1:
        return None
    segment = laps[0]
    stages = plan.stages[segment.first : segment.first + segment.count]
    moves = []
    for parameters in _samples(plan):
        try:
            state = segment.start(parameters)
            later = (state[0] + SMALL_STEP_M,)
            start, end = (stages[0].trigger_at(parameters, s) for s in (state, later))
            moves.append(((end[0] - start[0]) / SMALL_STEP_M, (end[1] - start[1]) / SMALL_STEP_M))
            d = (end[0] - start[0], end[1] - start[1])
            if not all(_moved_by(stage, parameters, state, later, d) for stage in stages):
                return None
        except PathUndefined:
            return None
    if any(abs(a - b) > 1e-6 for move in moves for a, b in zip(move, moves[0], strict=True)):
        return None
    moving = next(q for q in segment.variables if q.shift is not None)
    step_of = _first_step(segment, moving)
    if step_of is None:
        return None
    x, y = (scaled(step_of, round(value, 9)) for value in moves[0])
    return x, y


def _moved_by(stage: Stage, parameters: Sequence[float], state: State, later: State, d: tuple[float, float]) -> bool:
    """Whether a stage of the next lap is that of this lap, moved by d."""
    x, y = stage.trigger_at(parameters, state)
    u, v = stage.trigger_at(parameters, later)
    reach = 1 + abs(x) + abs(y)
    if abs(u - x - d[0]) + abs(v - y - d[1]) > 1e-6 * reach:
        return False
    here, there = stage.path_at(parameters, state), stage.path_at(parameters, later)
    for dx, dy in OFFSETS_M:
        a, b = here(x + dx, y + dy)[0], there(x + dx + d[0], y + dy + d[1])[0]
        if abs(a - b) > 1e-6 * (1 + abs(a) + abs(b)):
            return False
    return True


def _first_step(segment: Segment, moving: LoopVariable) -> Expression | None:
    """The increment of the one changing loop variable after the first lap, in parameters alone."""
    assert moving.shift is not None
    try:
        return tidy(substituted(moving.shift, segment.first_lap()))
    except ExpressionError:
        return None


def header_disagrees(plan: Plan) -> bool:
    """Whether the file's first line says a shift that the stages' is neither, nor the opposite of."""
    if plan.header_shift is None or plan.shift is None:
        return False
    dx, dy = plan.shift
    hx, hy = plan.header_shift
    same = equal(hx, dx) and equal(hy, dy)
    opposite = _opposite(hx, dx) and _opposite(hy, dy)
    return not (same or opposite)


def equal(a: Expression, b: Expression) -> bool:
    """Whether two expressions have the same value for all values of their symbols."""
    gap = difference(a, b)
    return is_zero(gap.node) if gap.names else abs(gap.at()) < TOLERANCE


def _opposite(a: Expression, b: Expression) -> bool:
    return equal(a, difference(constant(0.0), b))


def tidy(expression: Expression) -> Expression:
    """A number where it is one, else as simple as sympy makes it."""
    return simplified(expression) if expression.names else constant(round(expression.at(), 12))
