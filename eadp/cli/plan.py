"""`eadp plan`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument

from eadp.cli.output import emit, emit_json, warn
from eadp.errors import ExpressionError, InputError, PathUndefined, counted
from eadp.io.text.options import Flag, check_range
from eadp.plug_ins import plug_in

if TYPE_CHECKING:
    from eadp.api.plan import CheckedPlan
    from eadp.core.expressions.tree import Expression
    from eadp.models.plan.plan import CheckReport, Finding, Plan
    from eadp.models.plan.stage import PointExpression, Stage


CHANGES = ("laps", "avoid", "inside", "terrain")
"""Options that change the plan, which other commands read through a pipe."""


@dataclass(frozen=True)
class PlanOptions:
    """What is checked, printed and drawn of a plan."""

    format: Literal["text", "json", "plan", "sympy", "latex"] | None = None
    """What to print: a table (text), JSON, the plan in canonical text, or the stages' path functions, gradients,
    Hessians and triggers as sympy or LaTeX expressions [text; plan with --laps, --avoid, --inside or --terrain]."""

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

    laps: Annotated[int | None, Flag(metavar="N", low=1, high=10_000)] = None
    """How many times a mission that repeats for ever is flown."""

    avoid: Annotated[str | None, Flag(metavar="FILE")] = None
    """Polygons that the path stays out of: a fence, GeoJSON, KML or CSV."""

    inside: Annotated[str | None, Flag(metavar="FILE")] = None
    """Polygons that the path stays inside of, as --avoid."""

    terrain: Annotated[Sequence[str], Flag(metavar="FILE")] = ()
    """Heights of the ground, as of eadp cover, for a mission whose altitudes are above it, and for that of home."""

    @property
    def printed(self) -> str:
        """What is printed: by default a plan that is changed, or what is found in it."""
        changed = not self.check and any(getattr(self, name) for name in CHANGES)
        return self.format or ("plan" if changed else "text")


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

    Parse a plan into its stages; or change it for other commands, as in eadp plan mission.waypoints --avoid
    zones.geojson | eadp simulate -

    Exit code 0 if the plan can be read, 1 if --check finds an error, 2 if it cannot be read.
    """
    from eadp.api.plan import check_plan
    from eadp.io.plan.writer import parameters_of, plan_text

    trace, plot = options.trace_m, options.plot
    if trace is not None:
        check_range("--trace", trace, 0, math.inf)
    changes: dict[str, Any] = {name: getattr(options, name) for name in CHANGES}
    read = check_plan(file, min_radius_m=options.min_radius_m, **changes, geometry=options.check)
    plan, parameters = read.plan, parameters_of(read.plan, options.set_)
    try:
        if plot is not None:
            from eadp.io.figures.plan import write_plan_figure

            write_plan_figure(plot, plan, parameters)
        points = _trace_csv(plan, parameters, trace) if trace is not None else None
    except PathUndefined as error:
        raise InputError.at(read.name, plan.stages[0].line, 1, str(error), "a path that can be flown") from None
    if points is None and options.printed == "json":
        emit_json(document(plan, read.findings, read.reports))
    elif points is None and options.printed == "text" and options.check:
        emit(_check_text(read))
    else:
        if points is not None:
            text = points
        elif options.printed in ("sympy", "latex"):
            text = plug_in("plan_writers", options.printed)(plan, read.name)
        else:
            text = plan_text(plan) if options.printed == "plan" else _table(plan)
        warn(read.faults)
        emit(text)
    return 1 if read.has_errors else 0


def _trace_csv(plan: Plan, parameters: Sequence[float], step_m: float) -> str:
    """The nominal path as CSV, with latitude and longitude where the plan has an origin."""
    from eadp.core.geometry.geodesy import to_geodetic_deg
    from eadp.models.plan.trace import TracePoint, trace

    origin = plan.site.origin_deg
    rows: list[Sequence[Any]] = [[*TracePoint._fields, *(["lat_deg", "lon_deg"] if origin else [])]]
    for point in trace(plan, parameters, step_m):
        place = to_geodetic_deg(point.x_m, point.y_m, origin) if origin else ()
        rows.append([*point, *(f"{value:.9f}" for value in place)])
    return "\n".join(",".join(map(str, row)) for row in rows)


def _check_text(checked: CheckedPlan) -> str:
    """Text report of checks: the findings, what they say, then a summary."""
    plan, lines = checked.plan, checked.faults
    errors = sum(line.severity == "error" for line in lines)
    *said, end = checked.reports[0].lines(plan)
    said += [line for report in checked.reports[1:] for line in report.lines(plan)]
    total = f"{len(plan.stages)} stages: {errors} errors, {len(lines) - errors} warnings; {end}"
    return "\n".join([*(str(line) for line in lines), *said, total])


def document(plan: Plan, findings: Sequence[Finding], reports: Sequence[CheckReport] = ()) -> dict[str, Any]:
    """`eadp.plan/1`: a plan as other programs read it."""
    site = plan.site
    result: dict[str, Any] = {
        "schema": "eadp.plan/1",
        "stages": [_stage(plan, stage) for stage in plan.stages],
        "repeats": plan.whole_laps or any(segment.repeats for segment in plan.segments),
        "shift": None if plan.shift is None else [_number_or_text(part) for part in plan.shift],
        "primitive_stages": plan.primitive_stages,
        "final": _point(plan, plan.final_point),
        "parameters": [
            {name: getattr(item, name) for name in ("name", "kind", "title", "unit")}
            | {"stands_for": item.stands_for and item.stands_for.text}
            for item in plan.parameters
        ],
        "trigger_radius_m": plan.trigger_radius_m,
        "min_radius_m": plan.min_radius_m,
        "origin_deg": site.origin_deg,
        "findings": [_finding(item) for item in findings],
    }
    camera = site.camera and site.camera._asdict()
    result |= _stated(start_m=site.start_m, field=site.field and site.field.summary, camera=camera)
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
    for report in reports:
        result.update(report.document(plan))
    return result


def _stated(**values: Any) -> dict[str, Any]:
    """Those that are known."""
    return {name: value for name, value in values.items() if value is not None}


def _finding(finding: Finding) -> dict[str, Any]:
    always = {name: getattr(finding, name) for name in ("severity", "stage", "line", "code", "message")}
    return always | _stated(formula=finding.formula or None, proven=finding.proven)


def _stage(plan: Plan, stage: Stage) -> dict[str, Any]:
    """A stage as JSON; of a repeating segment, with the values of its first lap."""
    path, trigger = _in_first_lap(stage)
    result: dict[str, Any] = {
        "index": stage.index,
        "line": stage.line,
        "gain": stage.gain,
        "rotation_deg": stage.rotation_deg,
        "path": path.text,
        "kind": stage.kind,
        "trigger": _point(plan, trigger) | _stated(radius_m=stage.radius_m),
        "sets": [
            {"name": item.name, "kind": item.kind, "min": box.lo, "max": box.hi}
            for item, box in zip(plan.parameters, stage.sets, strict=False)
        ],
    }
    commands = stage.commands or None
    return result | _stated(altitude_m=stage.altitude_m, airspeed_mps=stage.airspeed_mps, commands=commands)


def _in_first_lap(stage: Stage) -> tuple[Expression, PointExpression]:
    """A stage's path and trigger in the first lap, the loop variables substituted."""
    from eadp.core.expressions.tree import substituted

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


def _point(plan: Plan, point: PointExpression) -> dict[str, float | str]:
    """A point; where it does not depend on parameters and the plan has an origin, its latitude and longitude, too."""
    from eadp.core.geometry.geodesy import to_geodetic_deg

    x, y = (_number_or_text(part) for part in point)
    result: dict[str, float | str] = {"x": x, "y": y}
    if plan.site.origin_deg is not None and not isinstance(x, str) and not isinstance(y, str):
        result |= zip(("lat_deg", "lon_deg"), to_geodetic_deg(x, y, plan.site.origin_deg), strict=True)
    return result


def _number_or_text(part: Any) -> float | str:
    """A number where the expression is one, else its canonical text."""
    if part.names:
        return str(part.text)
    value = float(part.value({}))
    return int(value) if value == int(value) else value


def _items(plan: Plan) -> list[str]:
    """The items of a mission that is flown in one way: how far to each, where it is, and what is held; else nothing."""
    from eadp.core.geometry.geodesy import point_text
    from eadp.models.plan.trace import nominal_legs

    if plan.parameters or not any(stage.item for stage in plan.stages):
        return []
    try:
        legs = nominal_legs(plan, ())
    except PathUndefined:
        return []
    total_m = sum(leg.distance_m for leg in legs)
    lines = [f"length     {total_m / 1000:.2f} km, without wind"]
    for label, of_item in itertools.groupby(legs, lambda leg: leg.stage.label):
        flown = list(of_item)
        last, far_m = flown[-1], sum(leg.distance_m for leg in flown)
        held = "" if last.stage.altitude_m is None else f", at {last.stage.altitude_m:.4g} m"
        held += "" if last.stage.airspeed_mps is None else f", {last.stage.airspeed_mps:.3g} m/s"
        lines.append(f"{label:<10} {far_m:6.0f} m to {point_text(last.end_m, plan.site.origin_deg)}{held}")
    return lines


def _table(plan: Plan) -> str:
    """A plan as a text table."""
    from eadp.core.expressions.tree import number_text

    lines = [counted(len(plan.stages), "stage") + _structure(plan)]
    if items := _items(plan):
        return "\n".join([*lines, *items])
    if plan.shift is not None:
        lines.append(f"shift      ({plan.shift[0].text}, {plan.shift[1].text}) m each lap")
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
        track = f"{stage.kind} {_direction(stage)}, gain {number_text(stage.gain)}"
        lines.append(f"stage {stage.index:<4} {track}: {stage.path.text} = 0")
        own = "" if stage.radius_m is None else f", within {number_text(stage.radius_m)} m"
        lines.append(f"           until ({stage.trigger[0].text}, {stage.trigger[1].text}){own}")
        if stage.sets:
            named = zip(plan.parameters, stage.sets, strict=False)
            sets = (f"{item.name} in [{number_text(box.lo)}, {number_text(box.hi)}]" for item, box in named)
            lines.append(f"           {', '.join(sets)}")
    return "\n".join(lines)


def _direction(stage: Stage) -> str:
    """Which way a stage is flown: round a circle, or by its rotation."""
    from eadp.core.expressions.algebra import expanded

    # below 0, the path function is positive inside the circle
    square = expanded(stage.path.node).get(("x", "x")) if stage.kind == "circle" else None
    if square is None:  # no circle, or one whose sign depends on parameters
        return f"rotation {stage.rotation_deg}"
    return "counter-clockwise" if stage.sense * square > 0 else "clockwise"
