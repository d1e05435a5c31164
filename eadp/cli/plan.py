"""`eadp plan`."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eadp.cli.output import emit, emit_json, warn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eadp.models.plan import Finding, Plan, PointExpression, Stage


class PlanFormat(str, enum.Enum):
    """Output formats of `eadp plan`."""

    text = "text"
    json = "json"
    plan = "plan"


def command(
    file: Annotated[str, typer.Argument(help="Plan file, - for standard input.", metavar="FILE")],
    format_: Annotated[
        PlanFormat, typer.Option("--format", help="What to print: a table, JSON, or the plan in canonical text.")
    ] = PlanFormat.text,
) -> int:
    """Example: eadp plan plans/survey.plan --format json

    Parse a plan into its stages.

    Exit code 0 if the plan can be read, 2 if not.
    """
    from eadp.errors import Fault
    from eadp.io.plan_text import plan_text, read_plan
    from eadp.io.streams import read_text

    text = read_text(file)
    plan, findings = read_plan(text)
    if format_ is PlanFormat.json:
        emit_json(document(plan, findings))
        return 0
    warn(Fault(text.name, item.line, item.column, item.message, severity=item.severity) for item in findings)
    emit(plan_text(plan) if format_ is PlanFormat.plan else _table(plan))
    return 0


def document(plan: Plan, findings: Sequence[Finding]) -> dict[str, Any]:
    """`eadp.plan/1`: a plan as other programs read it."""
    return {
        "schema": "eadp.plan/1",
        "stages": [_stage(plan, stage) for stage in plan.stages],
        "repeats": plan.repeats,
        "shift": None if plan.shift is None else [_number_or_text(part) for part in plan.shift],
        "primitive_stages": plan.primitive_stages,
        "final": _point(plan.final_point),
        "parameters": [
            {"name": item.name, "kind": item.kind, "title": item.title, "unit": item.unit} for item in plan.parameters
        ],
        "trigger_radius_m": plan.trigger_radius_m,
        "min_radius_m": plan.min_radius_m,
        "origin_deg": plan.origin_deg,
        "findings": [
            {
                "severity": item.severity,
                "stage": item.stage,
                "line": item.line,
                "code": item.code,
                "message": item.message,
            }
            for item in findings
        ],
    }


def _stage(plan: Plan, stage: Stage) -> dict[str, Any]:
    return {
        "index": stage.index,
        "line": stage.line,
        "gain": stage.gain,
        "rotation_deg": stage.rotation_deg,
        "path": stage.path.text,
        "kind": stage.kind,
        "trigger": _point(stage.trigger),
        "sets": [
            {"name": item.name, "kind": item.kind, "min": box.lo, "max": box.hi}
            for item, box in zip(plan.parameters, stage.sets, strict=False)
        ],
    }


def _point(point: PointExpression) -> dict[str, Any]:
    return {"x": _number_or_text(point[0]), "y": _number_or_text(point[1])}


def _number_or_text(part: Any) -> float | str:
    """A number where the expression is one, else its canonical text."""
    if part.names:
        return str(part.text)
    value = float(part.at())
    return int(value) if value == int(value) else value


def _table(plan: Plan) -> str:
    """A plan for people."""
    from eadp.core.expressions import number_text

    n = len(plan.stages)
    lines = [f"{n} stage{'s' if n != 1 else ''}" + (", repeated lap by lap" if plan.repeats else "")]
    if plan.shift is not None:
        lines.append(f"shift      ({plan.shift[0].text}, {plan.shift[1].text}) m each lap")
    lines.append(f"final      ({plan.final_point[0].text}, {plan.final_point[1].text}) m")
    for item in plan.parameters:
        what = f"{item.kind}{' ' + item.title if item.title else ''}{' [' + item.unit + ']' if item.unit else ''}"
        lines.append(f"{item.name:<10} {what}")
    for stage in plan.stages:
        direction = "counter-clockwise" if stage.rotation_deg == 90 else "clockwise"
        turn = f" {direction}" if stage.kind == "circle" else f" rotation {stage.rotation_deg}"
        lines.append(f"stage {stage.index:<4} {stage.kind}{turn}, gain {number_text(stage.gain)}: {stage.path.text} = 0")
        lines.append(f"           until ({stage.trigger[0].text}, {stage.trigger[1].text})")
        if stage.sets:
            sets = [
                f"{item.name} in [{number_text(box.lo)}, {number_text(box.hi)}]"
                for item, box in zip(plan.parameters, stage.sets, strict=False)
            ]
            lines.append(f"           {', '.join(sets)}")
    return "\n".join(lines)
