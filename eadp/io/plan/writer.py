"""Writer of plan text: the canonical form of the papers' format.

Source: draft 002, Appendix II.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from eadp.core.expressions.tree import Expression, number_text
from eadp.errors import InputError
from eadp.io.plan.headers import DEFAULT, HELD, header_lines
from eadp.io.text.csv import number_fault
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import PointExpression, Segment, Stage


def plan_text(plan: Plan) -> str:
    """Canonical text of a plan; reading it again gives the same plan."""
    lines = header_lines(plan)
    if plan.header_shift is not None:
        lines.append(point_text(plan.header_shift))
    if plan.segments:
        for part in plan.segments:
            lines += _part_lines(plan, part)
        return "\n".join([*lines, ""])
    short = plan.short_form
    if short is None:
        parts = tuple((stage.path, stage.trigger) for stage in plan.stages)
    else:
        parts = short.stages
        lines += ["init:", f"n = {len(plan.stages)}"]
        lines += [f"{name} = {first.text}, {move.text}" for name, first, move in short.coordinates]
        lines.append("path:")
    for stage, (path, trigger) in zip(plan.stages, parts, strict=True):
        lines += _stage_lines(plan, stage, path, trigger)
    if short is not None and plan.final is not None:
        lines += ["trig:", point_text(plan.final)]
    return "\n".join([*lines, ""])


def _part_lines(plan: Plan, part: Segment) -> list[str]:
    """The sections of a segment."""
    lines = []
    if part.repeats or part.variables:
        lines += ["init:", f"n = {part.count}"]
        for q in part.variables:
            lines.append(f"{q.name} = {q.first.text}" + (f", {q.shift.text}" if q.shift is not None else ""))
    lines.append("path:")
    for stage in plan.stages[part.first : part.first + part.count]:
        lines += _stage_lines(plan, stage, stage.path, stage.trigger)
    if part.until is not None:
        lines += ["trig:", f"{part.until[0].text} >= {part.until[1].text}"]
    return lines


def _stage_lines(plan: Plan, stage: Stage, path: Expression, trigger: PointExpression) -> list[str]:
    """A stage with its headers, of which a held one stands where it changes."""
    radius_text = "" if stage.radius_m is None else f", {number_text(stage.radius_m)}"
    before = plan.stages[stage.index - 2] if stage.index > 1 else None
    return [
        *_changed_settings(before, stage),
        *(f"%: command {' '.join(map(number_text, command))}" for command in stage.commands),
        f"{number_text(stage.gain)}; {stage.rotation_deg}; {path.text}",
        point_text(trigger) + radius_text,
        *(f"[{number_text(box.lo)}, {number_text(box.hi)}]" for box in stage.sets),
    ]


def _changed_settings(before: Stage | None, stage: Stage) -> Iterator[str]:
    """Headers of what a stage holds and the one before did not; `DEFAULT` ends what that one held."""
    for key, attribute in HELD.items():
        held, value = getattr(before, attribute, None), getattr(stage, attribute)
        if value != held:
            yield f"%: {key} {DEFAULT if value is None else number_text(value)}"


def point_text(point: PointExpression) -> str:
    """The two coordinates of a point, with a comma between them."""
    return f"{point[0].text}, {point[1].text}"


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
        if wrong := number_fault(number.strip()):
            raise _fault(raw, *wrong, len(name) + 2)
        value = float(number)
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
