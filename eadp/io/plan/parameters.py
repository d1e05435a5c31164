"""Parameters of a plan given as texts, by name or by title."""

from __future__ import annotations

import math
from collections.abc import Sequence

from eadp.core.expressions.tree import number_text
from eadp.errors import InputError
from eadp.models.plan.plan import Plan


def parameters_of(plan: Plan, overrides: Sequence[str] | None) -> list[float]:
    """Parameters from texts as of --set, else those at take-off: each at its maximum, or 0 without a set.

    Raises
    ------
    InputError
        If a text names no parameter or no number of its set.
    """
    values = [plan.hull(i).hi if plan.has_sets else 0.0 for i in range(len(plan.parameters))]
    for raw in overrides or []:
        name, _, number = raw.partition("=")
        index = plan.parameter(name.strip())
        if index is None:
            raise _fault(raw, f"no parameter {name.strip()}", plan.expected_name(name.strip()))
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise _fault(raw, f"{number or 'nothing'} is not a number", "as in c1=-500", len(name) + 2)
        item = plan.parameters[index]
        by_title = name.strip() != item.name and item.stands_for is not None
        if plan.has_sets:
            box = plan.hull(index)
            value = item.of_shown(value, box) if by_title else value
            if box.clip(value) != value:
                ends = sorted(map(item.shown, (box.lo, box.hi))) if by_title else (box.lo, box.hi)
                message = f"{name} = {number} is outside its set"
                expected = f"a value in [{', '.join(number_text(end) for end in ends)}]"
                raise _fault(raw, message, expected, len(name) + 2)
        values[index] = value
    return values


def _fault(raw: str, message: str, expected: str, column: int = 1) -> InputError:
    return InputError.at("--set", 1, column, message, expected, raw)
