"""What sympy proves of a plan's triggers for every value of the parameters, where a check by value samples them.

For each stage: φ at its trigger, of its own path and of the next one (0: the trigger lies on it), and whether the two
are travelled in one direction there. A proof that takes longer, or an expression that is larger, than the limits of
`worker` and `algebra.SIZE_LIMIT` is given up. In segments that repeat, the variables that change from lap to lap are
symbols: what holds, holds in every lap. From one lap of theirs to the next, and between segments, nothing is proven.

Source: draft 002, Def. III.1; draft 003, Def. IV.1.
"""

from __future__ import annotations

from dataclasses import dataclass

from eadp.check.worker import AlgebraProcess, texts_of
from eadp.core.expressions.algebra import SIZE_LIMIT
from eadp.core.expressions.tree import PARAMETER, Expression, difference, substituted
from eadp.errors import ExpressionError
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import PointExpression, Stage

PROOFS_LIMIT_S = 10.0
"""Processor time for all proofs of a plan [s]; each has `worker.ANSWER_LIMIT_S`."""


@dataclass(frozen=True)
class StageProof:
    """What is proven of a stage; None: undecided, or there is no next stage.

    `own` and `next` are φ_i and φ_{i+1} at the trigger of stage i, in sympy's syntax: '0' where it lies on the path for
    every parameter. `direction` is whether both are travelled in one direction there, for every parameter of the sets.
    """

    own: str | None = None
    next: str | None = None
    direction: bool | None = None


_Placed = tuple[Expression, PointExpression]
"""A path, and a point in the frame of that path."""


def prove_plan(plan: Plan) -> tuple[StageProof, ...]:
    """What sympy proves of each stage of a plan, within the limits of time and size.

    Raises
    ------
    EadpError
        If sympy cannot be imported.
    """
    with AlgebraProcess() as process:
        return tuple([_proof(process, plan, stage) for stage in plan.stages])


def _proof(process: AlgebraProcess, plan: Plan, stage: Stage) -> StageProof:
    try:
        here, there = _meeting(plan, stage)
        own = _remainder(process, here)
        if there is None:
            return StageProof(own)
        return StageProof(own, _remainder(process, there[0]), _direction(process, stage, here, there))
    except ExpressionError:  # too large, once substituted
        return StageProof()


def _meeting(plan: Plan, stage: Stage) -> tuple[_Placed, tuple[_Placed, Stage] | None]:
    """A stage's path at its trigger, and the next one's there; None where that is no single one in the same lap."""
    here = _in_a_lap(stage)
    last = stage.index == len(plan.stages)
    after = None if last and not plan.repeats else plan.stages[stage.index % len(plan.stages)]
    if after is None or after.segment is not stage.segment:
        return here, None
    path, _ = _in_a_lap(after)
    x, y = here[1]
    if last and plan.shift is not None:
        x, y = difference(x, plan.shift[0]), difference(y, plan.shift[1])
    return here, ((path, (x, y)), after)


def _in_a_lap(stage: Stage) -> _Placed:
    """A stage in any lap: formulas substituted, the variables that change from lap to lap as symbols."""
    formulas = stage.segment.formulas({}) if stage.segment else {}
    if not formulas:
        return stage.path, stage.trigger
    return substituted(stage.path, formulas), (
        substituted(stage.trigger[0], formulas),
        substituted(stage.trigger[1], formulas),
    )


def _remainder(process: AlgebraProcess, placed: _Placed) -> str | None:
    path, (x, y) = placed
    value = substituted(path, {"x": x, "y": y})
    if value.size > SIZE_LIMIT or process.spent_s > PROOFS_LIMIT_S:
        return None
    answer: str | None = process.ask("remainder", value.text, _loop_variables(value))
    return answer


def _direction(process: AlgebraProcess, stage: Stage, here: _Placed, meeting: tuple[_Placed, Stage]) -> bool | None:
    there, after = meeting
    parts = (here[0], *here[1], there[0], *there[1])
    if sum(part.size for part in parts) > SIZE_LIMIT or process.spent_s > PROOFS_LIMIT_S:
        return None
    ranges = {f"c{i}": (box.lo, box.hi) for i, box in enumerate(stage.sets, 1)}
    names = sorted({name for part in parts for name in _loop_variables(part)})
    answer: bool | None = process.ask(
        "same_direction", texts_of(*here), texts_of(*there), names, stage.sense * after.sense, ranges
    )
    return answer


def _loop_variables(expression: Expression) -> list[str]:
    return sorted(name for name in expression.names - {"x", "y"} if not PARAMETER.match(name))
