"""Geometric validity of a plan over the whole range of its path parameters.

For each stage, over the sets of every path parameter (their ends, and a grid inside; of more than two, a sample): its
trigger lies on its path and on the next one, the direction of travel agrees there, its radius is at least the
aircraft's, the trigger lies ahead of where the stage is joined, the path exists and is smooth. And, for each stage, a
parameter value that leads to the next: validity as the drafts define it, shown by construction. A plan of
segments, whose stages depend on the parameters of earlier laps, is checked along whole flights instead. Where `proof`
has shown what holds for every parameter, the findings say so.

Source: draft 002, Def. III.1; draft 003, Def. IV.1.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from eadp.check.proof import ON_PATH, StageProof, prove_plan
from eadp.core.expressions.algebra import cancels
from eadp.core.expressions.derivatives import PathFunction
from eadp.core.expressions.tree import Expression, difference, substituted, total
from eadp.core.geometry.curves import Point, tangent, wrap_angle_rad
from eadp.core.geometry.geodesy import compass_deg
from eadp.errors import ExpressionError, PathUndefined, printable
from eadp.models.airspace import BOUNDARY, entered
from eadp.models.plan.cursor import PlanCursor, Vector, shift_at
from eadp.models.plan.plan import CheckReport, Finding, Plan
from eadp.models.plan.stage import Box, PointExpression, Stage
from eadp.models.plan.structure import moved, symbol
from eadp.models.plan.trace import nominal_legs

ERROR, WARNING = "error", "warning"
POSITION_WARNING_M = 1e-3
DIRECTION_WARNING_DEG = 0.1
DIRECTION_ERROR_DEG = 45.0
RADIUS_TOLERANCE_M = 1e-6

GRID = {1: 65, 2: 9}
RANDOM_SAMPLES = 200
CORNERS_LIMIT = 256
CHANGING_FLIGHTS = 24


PathTrigger = tuple[Expression, PointExpression]

_SHOWN = (
    ("trigger on its path", "own", "trigger-off-path"),
    ("trigger on the next", "next", "trigger-off-next"),
    ("direction of travel", "direction", "direction"),
)


@dataclass(frozen=True)
class GeometryReport(CheckReport):
    """What this check found.

    `witness` has, for each stage, parameters that lead to the next one, or None; `proofs`, what is proven of it.
    """

    witness: tuple[Vector | None, ...]
    proofs: tuple[StageProof, ...] = ()

    @property
    def valid(self) -> bool:
        """Whether every stage leads to the next for some parameters."""
        return all(parameters is not None for parameters in self.witness)

    def document(self, plan: Plan) -> dict[str, Any]:
        """Whether it is valid, the parameters that lead on, and the proofs."""
        leads_on = [None if values is None else dict(zip(plan.names, values, strict=False)) for values in self.witness]
        return {"valid": self.valid, "leads_on": leads_on, "proofs": [asdict(proof) for proof in self.proofs]}

    def lines(self, plan: Plan) -> list[str]:
        """For each condition of validity, the stages where it is proven, where it holds as far as tried, the others."""
        free = _path_names(plan)
        proven = f"for every {', '.join(free)}" if len(free) < 5 else f"for every value of {len(free)} parameters"
        lines = []
        for title, attribute, code in _SHOWN:
            off = {finding.stage for finding in self.findings if finding.code in (code, "no-path")}
            found: dict[str, list[int]] = {how: [] for how in (proven, "at the places tried", "holds", "not")}
            for stage, proof in zip(plan.stages, self.proofs, strict=True):
                if attribute != "own" and stage is plan.stages[-1] and not plan.repeats:
                    continue
                how = proven if getattr(proof, attribute) in (ON_PATH, True) else "at the places tried"
                found["not" if stage.index in off else how if free else "holds"].append(stage.index)
            parts = [f"{how} in {_numbered(stages)}" for how, stages in found.items() if stages]
            lines += [f"{title:<20} {'; '.join(parts)}"] if parts else []
        if plan.shift is not None:
            lines.append(f"{'laps alike':<20} {'for all values' if laps_proven(plan) else 'at the values tried'}")
        leads = sum(parameters is not None for parameters in self.witness)
        return [*lines, f"{leads} of {len(plan.stages)} stages lead to the next for some parameters"]


def _path_names(plan: Plan) -> tuple[str, ...]:
    """The path parameters that a stage, a loop variable or the shift names."""
    parts = [part for stage in plan.stages for part in (stage.path, *stage.trigger)]
    parts += [q.first for segment in plan.segments for q in segment.variables]
    parts += [q.shift for segment in plan.segments for q in segment.variables if q.shift]
    named = frozenset().union(*(part.names for part in (*parts, *(plan.shift or ()))))
    return tuple(name for name in plan.names[: plan.path_count] if name in named)


def laps_proven(plan: Plan) -> bool:
    """Whether every stage is shown symbolically to be the one n before it, moved by d(c): e_j = 0 for all x, y and c.

    False where the structure is known by value alone: in plans of segments, and of what is too large.

    Source: letter, Eq. 2.
    """
    if plan.shift is None:
        return False
    dx, dy = plan.shift
    try:
        return all(
            cancels(difference(moved(later, plan.shift), path))
            and cancels(difference(later_x, total(x, dx)))
            and cancels(difference(later_y, total(y, dy)))
            for (path, (x, y)), (later, (later_x, later_y)) in _lap_pairs(plan)
        )
    except ExpressionError:  # too large when substituted
        return False


def _lap_pairs(plan: Plan) -> list[tuple[PathTrigger, PathTrigger]]:
    """Path and trigger of each stage that has one n before it: of that one, and its own."""
    if plan.short_form is None:
        parts: list[PathTrigger] = [(stage.path, stage.trigger) for stage in plan.stages]
        return list(zip(parts, parts[plan.primitive_stages :], strict=False))
    # in the names of the coordinates, which the shift moves from any lap to the next
    moves = {name: total(symbol(name), move) for name, _, move in plan.short_form.coordinates}
    return [
        ((path, (x, y)), (substituted(path, moves), (substituted(x, moves), substituted(y, moves))))
        for path, (x, y) in plan.short_form.stages
    ]


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


@dataclass
class _Measures:
    """What is measured of a stage at parameters, between the stages before and after; infinite: not at all."""

    parameters: Vector
    own_m: float = -math.inf
    next_m: float = -math.inf
    turn_deg: float = -math.inf
    radius_m: float = math.inf
    ahead_m: float = math.inf
    trouble: str = ""
    foot_m: Point = (math.nan, math.nan)
    headings_deg: tuple[float, float] = field(default=(math.nan, math.nan))
    before: Stage | None = None
    after: Stage | None = None


def check_plan(plan: Plan, *, min_radius_m: float | None = None, proofs: Sequence[StageProof] = ()) -> GeometryReport:
    """Check a plan over the whole range of its path parameters.

    Parameters
    ----------
    plan : Plan
        With sets, or without: then it is checked with all parameters 0.
    min_radius_m : float, optional
        Smallest turning radius of the aircraft [m]; the plan's own without.
    proofs : sequence of StageProof, optional
        What `proof.prove_plan` shows of the plan.

    Returns
    -------
    GeometryReport
        Findings by stage, errors beyond the thresholds above and a stage's trigger radius.
    """
    least = plan.min_radius_m if min_radius_m is None else min_radius_m
    findings: list[Finding] = []
    witness: list[Vector | None] = []
    if plan.segments:
        sampled = _measured_flights(plan)
    else:
        sampled = [
            (stage, [_measure(plan, stage, point) for point in _points(_boxes(plan, stage))]) for stage in plan.stages
        ]
    troubled = any(each.trouble for _, measured in sampled for each in measured)
    for stage, measured in sampled:
        if troubled and not measured:  # no flight came so far
            witness.append(None)
            continue
        proof = proofs[stage.index - 1] if proofs else StageProof()
        findings += _stage_findings(plan, stage, measured, least, proof)
        witness.append(_leads_on(plan.radius_m(stage), measured))
    findings += _airspace_findings(plan)
    return GeometryReport(tuple(findings), tuple(witness), tuple(proofs))


def checked(plan: Plan, min_radius_m: float | None, *, proven: bool) -> GeometryReport:
    """As `check_plan`, with proofs if they are asked for."""
    proofs = prove_plan(plan) if proven else (StageProof(),) * len(plan.stages)
    return check_plan(plan, min_radius_m=min_radius_m, proofs=proofs)


def _neighbours(plan: Plan, stage: Stage) -> tuple[Stage | None, Stage | None]:
    """The stage that this one is joined from, and the next; None beyond the plan's ends."""
    stages, i = plan.stages, stage.index - 1
    before = stages[i - 1] if i or plan.repeats else None
    after = stages[(i + 1) % len(stages)] if i + 1 < len(stages) or plan.repeats else None
    return before, after


# --- samples ----------------------------------------------------------------------------------------------------------


def _boxes(plan: Plan, stage: Stage) -> list[Box]:
    """The sets of the path parameters that matter round a stage; [0, 0] for those that do not, or have none."""
    near = [one for one in (stage, *_neighbours(plan, stage)) if one is not None]
    named = set().union(*(part.names for one in near for part in (one.path, *one.trigger)))
    if plan.repeats and plan.shift is not None and stage.index in (1, len(plan.stages)):
        named = named.union(*(part.names for part in plan.shift))
    boxes = []
    for i in range(plan.path_count):
        if not plan.has_sets:
            boxes.append(Box(0.0, 0.0))
        elif f"c{i + 1}" in named:
            boxes.append(stage.sets[i])
        else:
            boxes.append(Box(stage.sets[i].hi, stage.sets[i].hi))
    return boxes


def _corners(count: int) -> list[Vector]:
    """Corners of the unit box: all, or of more than `CORNERS_LIMIT` a seeded sample with the first and the last."""
    if 2**count <= CORNERS_LIMIT:
        return list(itertools.product((0.0, 1.0), repeat=count))
    drawn = np.random.default_rng(1).integers(0, 2, (CORNERS_LIMIT - 2, count)).astype(float)
    return [(0.0,) * count, (1.0,) * count, *map(tuple, drawn.tolist())]


def _points(boxes: Sequence[Box]) -> list[Vector]:
    """Corners first, then points inside: a grid of one or two parameters, a seeded sample of more."""
    free = [i for i, box in enumerate(boxes) if not box.fixed]
    shares = _corners(len(free))
    if len(free) in GRID:
        shares += itertools.product(np.linspace(0, 1, GRID[len(free)]).tolist(), repeat=len(free))
    elif free:
        shares += map(tuple, np.random.default_rng(0).random((RANDOM_SAMPLES, len(free))).tolist())
    points = []
    for share in shares:
        point = [box.lo for box in boxes]
        for i, value in zip(free, share, strict=True):
            point[i] = boxes[i].lo + value * (boxes[i].hi - boxes[i].lo)
        points.append(tuple(point))
    return list(dict.fromkeys(points))


# --- what is measured -------------------------------------------------------------------------------------------------


def _measured_flights(plan: Plan) -> list[tuple[Stage, list[_Measures]]]:
    """Every stage of a plan of segments on flights with fixed parameters, and with ones that keep changing.

    The parameters of a flight that changes are drawn anew at every stage, at the ends of their sets half of the time.
    """
    rho = plan.path_count
    fixed = [plan.hull(i).hi if plan.has_sets else 0.0 for i in range(len(plan.parameters))]
    boxes = [plan.hull(i) if plan.has_sets else Box(0.0, 0.0) for i in range(rho)]
    measured: dict[int, list[_Measures]] = {stage.index: [] for stage in plan.stages}
    rng = np.random.default_rng(0)

    def drawn() -> Vector:
        shares = [share if rng.random() < 0.5 else round(share) for share in rng.random(rho).tolist()]
        free = [box.lo + share * (box.hi - box.lo) for box, share in zip(boxes, shares, strict=True)]
        return (*free, *fixed[rho:])

    flights: list[tuple[Vector, _Decide]] = [((*p, *fixed[rho:]), lambda here: here) for p in _points(boxes)]
    if not all(box.fixed for box in boxes):
        flights += [(drawn(), lambda here: here.decide(drawn())) for _ in range(CHANGING_FLIGHTS)]
    for start, decide in flights:
        # a flight that comes to no end is as long as flights may be: one is enough
        if not _measure_flight(plan, start, decide, measured):
            break
    return [(stage, measured[stage.index]) for stage in plan.stages]


_Decide = Callable[[PlanCursor], PlanCursor]
"""Of a stage that begins, the same with the parameters that are decided on it."""


def _measure_flight(plan: Plan, parameters: Vector, decide: _Decide, measured: dict[int, list[_Measures]]) -> bool:
    """Measure every stage of a flight through a plan of segments; return whether it reaches the end."""
    stage, before = plan.stages[0], None
    join: Point | None = None
    try:
        here: PlanCursor | None = PlanCursor.start(plan, parameters)
        while here is not None:
            stage, following = here.stage, decide(here).next()
            path, trigger = here.path(), here.trigger_m()
            measures = _measure_stage(here.parameters, stage, path, trigger, before, join)
            if following is not None and not measures.trouble:
                _measure_joint(measures, stage, path, trigger, following.stage, join=trigger, path_after=following.path)
            measured[stage.index].append(measures)
            before, join, here = stage, trigger, following
    except PathUndefined as error:
        measured[stage.index].append(_Measures(parameters, trouble=str(error)))
        return False
    return True


def _measure(plan: Plan, stage: Stage, parameters: Vector) -> _Measures:
    """A stage between its neighbours, of the laps before and after where it is the first or the last of one."""
    before, after = _neighbours(plan, stage)
    try:
        path, trigger = stage.path_at(parameters), stage.trigger_at(parameters)
        dx, dy = shift_at(plan, parameters) if plan.repeats else (0.0, 0.0)
        join = None if before is None else before.trigger_at(parameters)
        if join is not None and stage.index == 1:
            join = (join[0] - dx, join[1] - dy)
    except PathUndefined as error:
        return _Measures(parameters, trouble=str(error), before=before, after=after)
    measures = _measure_stage(parameters, stage, path, trigger, before, join)
    measures.after = after
    if after is not None and not measures.trouble:
        here = (trigger[0] - dx, trigger[1] - dy) if stage.index == len(plan.stages) else trigger
        _measure_joint(measures, stage, path, trigger, after, here, lambda: after.path_at(parameters))
    return measures


def _measure_stage(
    parameters: Vector, stage: Stage, path: PathFunction, trigger: Point, before: Stage | None, join: Point | None
) -> _Measures:
    """A stage by itself, and how its trigger lies from where it is joined."""
    measures = _Measures(parameters, before=before)
    try:
        track = stage.track(path, trigger)
        measures.foot_m = track.nearest(trigger)
        measures.own_m = math.dist(trigger, measures.foot_m)
        measures.radius_m = track.radius_m()
        if join is not None:
            ahead_m = track.ahead_m(join)
            measures.ahead_m = ahead_m if math.isfinite(ahead_m) else -math.inf
    except PathUndefined as error:
        measures.trouble = str(error)
    return measures


def _measure_joint(
    measures: _Measures,
    stage: Stage,
    path: PathFunction,
    trigger: Point,
    after: Stage,
    join: Point,
    path_after: Callable[[], PathFunction],
) -> None:
    """How a stage leads to the next one, whose frame its trigger is `join` in."""
    measures.after = after
    try:
        following = path_after()
        measures.next_m = math.dist(join, after.track(following, join).nearest(join))
        measures.headings_deg = (_heading_deg(path, trigger, stage.sense), _heading_deg(following, join, after.sense))
        turn = math.radians(measures.headings_deg[1] - measures.headings_deg[0])
        measures.turn_deg = abs(math.degrees(wrap_angle_rad(turn)))
    except PathUndefined as error:
        measures.trouble = f"stage {after.index}: {error}"


def _heading_deg(path: PathFunction, point: Point, sense: int) -> float:
    x, y = tangent(path, point, sense)
    return compass_deg(math.atan2(y, x))


# --- what is said -----------------------------------------------------------------------------------------------------


def _stage_findings(
    plan: Plan, stage: Stage, measured: list[_Measures], least: float | None, proof: StageProof
) -> Iterator[Finding]:
    about = _About(plan, stage)
    if stage.gain == 0:
        message = f"stage {stage.index} has a gain of 0: nothing leads back to its path"
        yield about.finding(WARNING, "no-gain", message)
    if not measured:
        message = f"stage {stage.index} is never flown: its laps are over before they start"
        yield about.finding(WARNING, "never-flown", message)
        return
    trouble = next((each for each in measured if each.trouble), None)
    if trouble is not None:
        yield about.finding(ERROR, "no-path", f"stage {stage.index} cannot be flown: {trouble.trouble}", trouble)
    fine = [each for each in measured if not each.trouble] or measured
    yield from _own_findings(about, max(fine, key=lambda each: each.own_m), proof.own_gap)
    yield from _next_findings(about, max(fine, key=lambda each: each.next_m), proof.next_gap)
    yield from _direction_findings(about, max(fine, key=lambda each: each.turn_deg), proven=proof.direction is False)
    if least is not None:
        yield from _radius_findings(about, min(fine, key=lambda each: each.radius_m), least)
    yield from _order_findings(about, min(fine, key=lambda each: each.ahead_m))


class _About(NamedTuple):
    """A stage that something is said about."""

    plan: Plan
    stage: Stage

    def finding(
        self,
        severity: str,
        code: str,
        message: str,
        at: _Measures | None = None,
        *,
        formula: str = "",
        proven: bool = False,
    ) -> Finding:
        """A finding, at the parameters of what was measured."""
        where = "" if at is None else _at(self.plan, at.parameters)
        return Finding(
            severity, self.stage.index, self.stage.line, code, message + where, formula=formula, proven=proven
        )

    def off_path(self, gap_m: float, formula: str, path: str) -> tuple[str, str]:
        """Severity and words of a trigger that lies off a path, by φ there where that is proven."""
        where = f", where φ = {printable(formula)}" if formula else ""
        message = f"the trigger of stage {self.stage.index} lies {gap_m:.2f} m off {path}{where}"
        return ERROR if gap_m > self.plan.radius_m(self.stage) else WARNING, message


def _own_findings(about: _About, worst: _Measures, formula: str) -> Iterator[Finding]:
    """A trigger off its own path."""
    if worst.own_m > POSITION_WARNING_M:
        severity, message = about.off_path(worst.own_m, formula, "its path")
        message += "; its path passes ({:.6g}, {:.6g})".format(*worst.foot_m)
        yield about.finding(severity, "trigger-off-path", message, worst, formula=formula, proven=bool(formula))


def _next_findings(about: _About, worst: _Measures, formula: str) -> Iterator[Finding]:
    """A trigger off the next path."""
    if worst.next_m > POSITION_WARNING_M:
        severity, message = about.off_path(worst.next_m, formula, "the path of the next stage")
        yield about.finding(severity, "trigger-off-next", message, worst, formula=formula, proven=bool(formula))


def _direction_findings(about: _About, worst: _Measures, *, proven: bool) -> Iterator[Finding]:
    """Two paths that are travelled in other directions where they meet."""
    if worst.turn_deg > DIRECTION_WARNING_DEG and worst.after is not None:
        here, there = worst.headings_deg
        message = (
            f"stage {about.stage.index} reaches its trigger heading {here:.1f}°, where stage {worst.after.index} "
            f"starts heading {there:.1f}°: {worst.turn_deg:.1f}° apart"
        )
        severity = ERROR if worst.turn_deg > DIRECTION_ERROR_DEG else WARNING
        yield about.finding(severity, "direction", message, worst, proven=proven)


def _radius_findings(about: _About, worst: _Measures, least: float) -> Iterator[Finding]:
    """A turn that the aircraft cannot fly."""
    if worst.radius_m < least - RADIUS_TOLERANCE_M:
        message = (
            f"stage {about.stage.index} turns with a radius of {worst.radius_m:.2f} m, {least - worst.radius_m:.2f} m "
            f"less than the aircraft's {least:g} m"
        )
        yield about.finding(ERROR, "radius", message, worst)


def _order_findings(about: _About, worst: _Measures) -> Iterator[Finding]:
    """Triggers that do not follow one another in the direction flown, or too closely."""
    index, limit, ahead_m = about.stage.index, about.plan.radius_m(about.stage), worst.ahead_m
    if worst.before is None:
        return
    if ahead_m < 0:
        how = f"{-ahead_m:.2f} m behind" if math.isfinite(ahead_m) else "nowhere ahead of"
        message = (
            f"the trigger of stage {index} lies {how} where stage {worst.before.index} leads to it, in the "
            f"direction flown: the other rotation, or another trigger"
        )
        yield about.finding(ERROR, "behind", message, worst)
    elif ahead_m < limit and ahead_m < math.inf:
        message = (
            f"stage {index} is {ahead_m:.2f} m long, shorter than the trigger radius of {limit:g} m: it may end as it "
            f"starts"
        )
        yield about.finding(WARNING, "short-stage", message, worst)


def _at(plan: Plan, parameters: Vector) -> str:
    known = dict(zip(plan.names, parameters, strict=False))
    named = [f"{name} = {known[name]:.6g}" for name in _path_names(plan)]
    return f" (at {', '.join(named)})" if named else ""


def _leads_on(limit: float, measured: list[_Measures]) -> Vector | None:
    """The sampled parameters that lead to the next stage best; None where none leads there."""

    def rank(m: _Measures) -> float:
        gaps = [gap for gap in (m.own_m, m.next_m) if math.isfinite(gap)]
        return max([*gaps, (m.turn_deg if math.isfinite(m.turn_deg) else 0.0)], default=math.inf)

    def leads(m: _Measures) -> bool:
        near = all(not gap > limit for gap in (m.own_m, m.next_m))
        return not m.trouble and near and not m.turn_deg > DIRECTION_ERROR_DEG and m.ahead_m >= 0

    good = [each for each in measured if leads(each)]
    return min(good, key=rank).parameters if good else None


def _airspace_findings(plan: Plan) -> Iterator[Finding]:
    """Where the nominal path enters an obstacle, or leaves the boundary, at values across the path parameters' sets.

    A stage without an altitude counts as low; a landing descends evenly.
    """
    if not any(plan.site.airspace):
        return
    boxes = [plan.hull(i) for i in range(plan.path_count)] if plan.has_sets else []
    found: set[str] = set()
    for share in (1.0, 0.75, 0.5, 0.25, 0.0) if boxes else (1.0,):
        values = tuple(box.lo + share * (box.hi - box.lo) for box in boxes)
        try:
            legs = nominal_legs(plan.laps(), values)
        except PathUndefined:  # found where its stages are measured
            continue
        for stage, name in entered(legs, plan.site.airspace):
            if name not in found:
                found.add(name)
                does = "leaves" if name == BOUNDARY else "enters"
                yield Finding(
                    "error", stage.index, stage.line, "airspace", f"the path {does} {name}{_at(plan, values)}"
                )
