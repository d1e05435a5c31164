"""The stages of a plan as sympy's expressions, or as LaTeX."""

from __future__ import annotations

from eadp.core.expressions.algebra import SIZE_LIMIT
from eadp.errors import InputError
from eadp.models.plan.plan import Plan
from eadp.validation.worker import ANSWER_LIMIT_S, AlgebraProcess, texts_of


def sympy_text(plan: Plan, file: str) -> str:
    """Path functions, gradients, Hessians and triggers in sympy's syntax; raises InputError at a stage of `file`."""
    return _expressions(plan, file, "sympy")


def latex_text(plan: Plan, file: str) -> str:
    """As `sympy_text`, in LaTeX."""
    return _expressions(plan, file, "latex")


def _expressions(plan: Plan, file: str, style: str) -> str:
    """Every stage as sympy has it, printed by the process that may be ended."""
    lines = []
    with AlgebraProcess() as process:
        for stage in plan.stages:
            names = [q.name for q in stage.segment.variables] if stage.segment else []
            printed = process.ask("lines", texts_of(stage.path, stage.trigger), names, stage.index, style)
            if printed is None:
                message = f"sympy gives no expressions of stage {stage.index}"
                expected = f"expressions of at most {SIZE_LIMIT} parts, printed within {ANSWER_LIMIT_S:g} s"
                raise InputError.at(file, stage.line, 1, message, expected)
            lines += printed
    return "\n".join(lines)
