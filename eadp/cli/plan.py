"""`eadp plan`."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument

from eadp.cli.output import emit, emit_json, usage_fault, warn
from eadp.io.text.options import Flag

if TYPE_CHECKING:
    from eadp.core.expressions.tree import Expression
    from eadp.errors import Fault
    from eadp.models.plan.plan import Finding, Plan
    from eadp.models.plan.stage import PointExpression, Stage
    from eadp.validation.check import Report


STAGE_SETTINGS = ("altitude_m", "airspeed_mps", "commands")
"""Attributes of a stage that JSON has where they are set."""


@dataclass(frozen=True)
class PlanOptions:
    """What is checked, printed and drawn of a plan."""

    verbose: Annotated[bool, Flag("-v --verbose")] = False
    """Say more: the papers' quantities, the solver's runs."""

    format: Literal["text", "json", "plan", "sympy", "latex"] = "text"
    """What to print: a table, JSON, the plan in canonical text, or the stages' path functions, gradients, Hessians and
    triggers as sympy or LaTeX expressions."""

    check: bool = False
    """Check the geometry over the whole range of every path parameter, by value and by proof."""

    min_radius_m: Annotated[float | None, Flag(low=0)] = None
    """Smallest turning radius [m], for --check and the turns of a mission."""

    set_: Annotated[Sequence[str], Flag(metavar="NAME=VALUE")] = ()
    """A parameter for --trace and --plot, as in spacing=20."""

    trace_m: float | None = None
    """Print points along the nominal path, at most so far apart, as CSV."""

    plot: Annotated[str | None, Flag(metavar="FILE")] = None
    """Draw the plan: FILE.svg or FILE.png."""

    junit: Annotated[str | None, Flag(metavar="FILE")] = None
    """Write a JUnit report, which fails on errors."""

    laps: Annotated[int | None, Flag(metavar="N", low=1, high=10_000)] = None
    """How many times a mission that repeats for ever is flown."""

    avoid: Annotated[str | None, Flag(metavar="FILE")] = None
    """Polygons that the path stays out of: a fence, GeoJSON, KML or CSV."""

    inside: Annotated[str | None, Flag(metavar="FILE")] = None
    """Polygons that the path stays inside of, as --avoid."""

    terrain: Annotated[Sequence[str], Flag(metavar="FILE")] = ()
    """Heights of the ground, as of eadp cover, for a mission whose altitudes are above it."""


def command(
    file: Annotated[
        str,
        Argument(
            help="Plan in the papers' TEE format (trajectory explicit equations), or mission (QGroundControl's plan, "
            "WPL); - for standard input.",
            metavar="FILE",
        ),
    ],
    options: PlanOptions,
) -> int:
    """Example: eadp plan plans/survey.plan --check

    Parse a plan into its stages.

    Exit code 0 if the plan can be read, 1 if --check finds an error, 2 if it cannot be read.
    """
    from eadp.api.plan import check_plan
    from eadp.errors import InputError, PathUndefined
    from eadp.io.plan.parameters import parameters_of
    from eadp.io.plan.writer import plan_text
    from eadp.io.text.streams import output_file, write_text

    trace, plot = options.trace_m, options.plot
    if trace is not None and not 0 < trace < math.inf:
        message = "a step that is not above 0, or not finite"
        raise usage_fault("--trace", f"{trace:g}", message, "metres, as in --trace 1")
    if options.junit is not None:
        output_file(options.junit)
    start_s = time.perf_counter()
    read = check_plan(
        file,
        min_radius_m=options.min_radius_m,
        laps=options.laps,
        avoid=options.avoid,
        inside=options.inside,
        terrain=options.terrain,
        geometry=options.check,
    )
    plan, report, lines = read.plan, read.report, read.faults
    if options.junit is not None:
        from eadp.cli.junit import Case, junit_text

        wrong = "\n".join(str(line) for line in lines if line.severity == "error") or None
        case = Case("geometry" if options.check else "text", time.perf_counter() - start_s, wrong)
        write_text(options.junit, junit_text(file, [case]))
    parameters = parameters_of(plan, options.set_)
    try:
        if plot is not None:
            from eadp.io.figures.plan import write_plan_figure

            write_plan_figure(plot, plan, parameters)
        points = _trace_csv(plan, parameters, trace) if trace is not None else None
    except PathUndefined as error:
        raise InputError.at(read.name, plan.stages[0].line, 1, str(error), "a path that can be flown") from None
    if points is not None:
        warn(lines)
        emit(points)
    elif options.format == "json":
        emit_json(document(plan, read.findings, report))
    elif options.format == "plan":
        warn(lines)
        emit(plan_text(plan))
    elif options.format in ("sympy", "latex"):
        expressions = _expressions(plan, read.name, options.format)
        warn(lines)
        emit("\n".join(expressions))
    elif report is not None:
        emit(_check_text(plan, lines, report))
    else:
        warn(lines)
        emit(_table(plan, verbose=options.verbose))
    return 1 if report is not None and report.has_errors else 0


def _trace_csv(plan: Plan, parameters: Sequence[float], step_m: float) -> str:
    """The nominal path as CSV, with latitude and longitude where the plan has an origin."""
    from eadp.core.geometry.geodesy import to_geodetic_deg
    from eadp.models.plan.legs import TracePoint
    from eadp.models.plan.trace import trace

    origin = plan.site.origin_deg
    header = ",".join([*TracePoint._fields, *(["lat_deg", "lon_deg"] if origin else [])])
    lines = [header]
    for point in trace(plan, parameters, step_m):
        cells = [str(point.stage), point.kind, *(repr(value) for value in point[2:])]
        if origin:
            cells += [f"{value:.9f}" for value in to_geodetic_deg(point.x_m, point.y_m, origin)]
        lines.append(",".join(cells))
    return "\n".join(lines)


def _expressions(plan: Plan, file: str, style: str) -> list[str]:
    """Every stage as sympy has it, printed by the process that may be ended."""
    from eadp.core.expressions.algebra import SIZE_LIMIT
    from eadp.errors import InputError
    from eadp.validation.worker import ANSWER_LIMIT_S, AlgebraProcess, texts_of

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
    return lines


def _check_text(plan: Plan, lines: Sequence[Fault], report: Report) -> str:
    """Text report of a check: the findings, what is proven and what is sampled, then a summary."""
    errors = sum(line.severity == "error" for line in lines)
    leads = sum(parameters is not None for parameters in report.witness)
    total = f"{len(plan.stages)} stages: {errors} errors, {len(lines) - errors} warnings; "
    total += f"{leads} of {len(plan.stages)} stages lead to the next for some parameters"
    return "\n".join([*(str(line) for line in lines), *_proof_lines(plan, report), total])


_SHOWN = (
    ("trigger on its path", "own", "trigger-off-path"),
    ("trigger on the next", "next", "trigger-off-next"),
    ("direction of travel", "direction", "direction"),
)


def _proof_lines(plan: Plan, report: Report) -> list[str]:
    """For each condition of validity, the stages where it is proven, where it holds as far as tried, and the others."""
    free = plan.path_names
    proven = f"for every {', '.join(free)}" if len(free) < 5 else f"for every value of {len(free)} parameters"
    lines = []
    for title, attribute, code in _SHOWN:
        off = {finding.stage for finding in report.findings if finding.code in (code, "no-path")}
        found: dict[str, list[int]] = {how: [] for how in (proven, "at the places tried", "holds", "not")}
        for stage, proof in zip(plan.stages, report.proofs, strict=True):
            if attribute != "own" and stage is plan.stages[-1] and not plan.repeats:
                continue
            how = proven if getattr(proof, attribute) in ("0", True) else "at the places tried"
            found["not" if stage.index in off else how if free else "holds"].append(stage.index)
        parts = [f"{how} in {_numbered(stages)}" for how, stages in found.items() if stages]
        lines += [f"{title:<20} {'; '.join(parts)}"] if parts else []
    return lines


def _numbered(stages: Sequence[int]) -> str:
    """Stages by number, neighbours as a range."""
    ranges: list[list[int]] = []
    for index in stages:
        if ranges and ranges[-1][1] == index - 1:
            ranges[-1][1] = index
        else:
            ranges.append([index, index])
    texts = [f"{first}" if first == last else f"{first}-{last}" for first, last in ranges]
    return f"stage{'s' if len(stages) > 1 else ''} {', '.join(texts)}"


def document(plan: Plan, findings: Sequence[Finding], report: Report | None = None) -> dict[str, Any]:
    """`eadp.plan/1`: a plan as other programs read it."""
    result: dict[str, Any] = {
        "schema": "eadp.plan/1",
        "stages": [_stage(plan, stage) for stage in plan.stages],
        "repeats": plan.whole_laps or any(segment.repeats for segment in plan.segments),
        "shift": None if plan.shift is None else [_number_or_text(part) for part in plan.shift],
        "primitive_stages": plan.primitive_stages,
        "final": _point(plan, plan.final_point),
        "parameters": [asdict(item) for item in plan.parameters],
        "trigger_radius_m": plan.trigger_radius_m,
        "min_radius_m": plan.min_radius_m,
        "origin_deg": plan.site.origin_deg,
        **({} if plan.site.start_m is None else {"start_m": plan.site.start_m}),
        **({} if plan.site.field is None else {"field": plan.site.field.summary}),
        **({} if plan.site.camera is None else {"camera": plan.site.camera._asdict()}),
        "findings": [_finding(item) for item in findings],
    }
    if plan.segments:
        result["segments"] = [
            {
                "first": segment.first + 1,
                "stages": segment.count,
                "repeats": segment.repeats,
                "until": " >= ".join(side.text for side in segment.until) if segment.until else None,
            }
            for segment in plan.segments
        ]
    if report is not None:
        result["valid"] = report.valid
        result["leads_on"] = [
            None if values is None else dict(zip(plan.names, values, strict=False)) for values in report.witness
        ]
        result["proofs"] = [asdict(proof) for proof in report.proofs]
    return result


def _finding(finding: Finding) -> dict[str, Any]:
    result = {key: getattr(finding, key) for key in ("severity", "stage", "line", "code", "message")}
    if finding.formula:
        result["formula"] = finding.formula
    if finding.proven is not None:
        result["proven"] = finding.proven
    return result


def _stage(plan: Plan, stage: Stage) -> dict[str, Any]:
    """A stage as JSON; of a repeating segment, with the values of its first lap."""
    path, trigger = _in_first_lap(stage)
    return {
        "index": stage.index,
        "line": stage.line,
        "gain": stage.gain,
        "rotation_deg": stage.rotation_deg,
        "path": path.text,
        "kind": stage.kind,
        "trigger": _point(plan, trigger) | ({} if stage.radius_m is None else {"radius_m": stage.radius_m}),
        **{key: value for key in STAGE_SETTINGS if (value := getattr(stage, key)) not in (None, ())},
        "sets": [
            {"name": item.name, "kind": item.kind, "min": box.lo, "max": box.hi}
            for item, box in zip(plan.parameters, stage.sets, strict=False)
        ],
    }


def _in_first_lap(stage: Stage) -> tuple[Expression, PointExpression]:
    """A stage's path and trigger in the first lap, the loop variables substituted."""
    from eadp.core.expressions.tree import substituted
    from eadp.errors import ExpressionError

    if stage.segment is None or not stage.segment.variables:
        return stage.path, stage.trigger
    try:
        known = stage.segment.first_lap()
        x, y = (substituted(part, known) for part in stage.trigger)
        return substituted(stage.path, known), (x, y)
    except ExpressionError:  # too large when substituted: as written in the file
        return stage.path, stage.trigger


def _structure(plan: Plan) -> str:
    """Lap structure, as the end of the first line."""
    if plan.segments:
        laps = sum(segment.repeats for segment in plan.segments)
        return f" in {len(plan.segments)} segments, {laps} of them flown lap by lap"
    if plan.repeats:
        return ", repeated lap by lap"
    if plan.primitive_stages is None:
        return ""
    return f": laps of {plan.primitive_stages}" + ("" if plan.whole_laps else ", not all whole or alike")


def _point(plan: Plan, point: PointExpression) -> dict[str, Any]:
    """A point; where it does not depend on parameters and the plan has an origin, its latitude and longitude, too."""
    from eadp.core.geometry.geodesy import to_geodetic_deg

    x, y = (_number_or_text(part) for part in point)
    result: dict[str, Any] = {"x": x, "y": y}
    if plan.site.origin_deg is not None and not isinstance(x, str) and not isinstance(y, str):
        result |= zip(("lat_deg", "lon_deg"), to_geodetic_deg(x, y, plan.site.origin_deg), strict=True)
    return result


def _number_or_text(part: Any) -> float | str:
    """A number where the expression is one, else its canonical text."""
    if part.names:
        return str(part.text)
    value = float(part.at())
    return int(value) if value == int(value) else value


def _table(plan: Plan, *, verbose: bool) -> str:
    """A plan as a text table; `verbose` has the structure in the papers' quantities."""
    from eadp.core.expressions.tree import number_text
    from eadp.models.plan.structure import structure_proven

    n = len(plan.stages)
    lines = [f"{n} stage{'s' if n != 1 else ''}" + _structure(plan)]
    if plan.shift is not None:
        lines.append(f"shift      ({plan.shift[0].text}, {plan.shift[1].text}) m each lap")
        names, proven = ", ".join(["x", "y", *plan.path_names]), structure_proven(plan)
        if verbose:
            known = "for every" if proven else "at sampled"
            lines.append(f"structure  n = {plan.primitive_stages}, e_j = 0 {known} {names}")
        else:
            lines.append(f"laps       are alike but for the shift: {'proven' if proven else 'sampled'}")
    lines.append(f"final      ({plan.final_point[0].text}, {plan.final_point[1].text}) m")
    if (camera := plan.site.camera) is not None:
        lines.append(f"camera     {camera.text}")
    for i, item in enumerate(plan.parameters):
        what = f"{item.kind}{' ' + item.title if item.title else ''}{' [' + item.unit + ']' if item.unit else ''}"
        if item.stands_for is not None:
            what += f" = {item.stands_for.text}"
            if plan.has_sets:
                low, high = sorted(map(item.shown, (plan.hull(i).lo, plan.hull(i).hi)))
                what += f", from {low:.4g} to {high:.4g}"
        lines.append(f"{item.name:<10} {what}")
    for stage in plan.stages:
        direction = "counter-clockwise" if stage.rotation_deg == 90 else "clockwise"
        turn = f" {direction}" if stage.kind == "circle" else f" rotation {stage.rotation_deg}"
        lines.append(
            f"stage {stage.index:<4} {stage.kind}{turn}, gain {number_text(stage.gain)}: {stage.path.text} = 0"
        )
        own = "" if stage.radius_m is None else f", within {number_text(stage.radius_m)} m"
        lines.append(f"           until ({stage.trigger[0].text}, {stage.trigger[1].text}){own}")
        if stage.sets:
            sets = [
                f"{item.name} in [{number_text(box.lo)}, {number_text(box.hi)}]"
                for item, box in zip(plan.parameters, stage.sets, strict=False)
            ]
            lines.append(f"           {', '.join(sets)}")
    return "\n".join(lines)
