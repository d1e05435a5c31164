"""The plan: stages with their paths, triggers and parameter sets. Source: letter, Defs. II.1-II.5."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from eadp.core.expressions.derivatives import PathFunction, bind
from eadp.core.expressions.tree import Expression
from eadp.core.geometry.curves import Point, path_kind
from eadp.core.geometry.tracks import TRACKS, Track
from eadp.errors import EadpError, PathUndefined
from eadp.models.plan.segments import Segment, State

PATH, COMPUTATION = "path", "computation"
TRIGGER_RADIUS_M = 20.0
ROTATIONS = (90, 270)

PointExpression = tuple[Expression, Expression]


@dataclass(frozen=True, slots=True)
class Box:
    """The set [lo, hi] of a parameter."""

    lo: float
    hi: float

    @property
    def fixed(self) -> bool:
        """One value only: nothing to choose."""
        return self.lo == self.hi

    @property
    def inhibited(self) -> bool:
        """[0, 0], which for a computation means that it does not run."""
        return self.lo == 0 and self.hi == 0

    def clip(self, value: float) -> float:
        """The value of the box nearest to `value`."""
        return min(max(value, self.lo), self.hi)

    def share(self, value: float) -> float | None:
        """c̃ = (c − lo)/(hi − lo); None for a box of one value. Source: letter, Sec. V."""
        return None if self.fixed else (self.clip(value) - self.lo) / (self.hi - self.lo)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of the plan: its name (c1, c2, …), its kind, and what the computation calls it."""

    name: str
    kind: str
    title: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Stage:
    """A path to follow until its trigger, and the sets of the parameters there. Source: letter, Def. II.2.

    `segment` is the one that it belongs to, where path and trigger may name its loop variables.
    """

    index: int
    line: int
    gain: float
    rotation_deg: int
    path: Expression
    trigger: PointExpression
    sets: tuple[Box, ...] = ()
    segment: Segment | None = None

    @cached_property
    def kind(self) -> str:
        """`line`, `circle` or `curve`."""
        return path_kind(self.path)

    @property
    def sense(self) -> int:
        """+1 for rotation 90, −1 for rotation 270."""
        return 1 if self.rotation_deg == 90 else -1

    def path_at(self, parameters: Sequence[float], state: State | None = None) -> PathFunction:
        """The path function at given parameters and loop variables; without these, in the first lap.

        Raises
        ------
        PathUndefined
            If it has no value there; the message names the stage.
        """
        try:
            return bind(self.path, parameters, self._variables(parameters, state))
        except PathUndefined as error:
            raise PathUndefined(f"the path of stage {self.index} {error}") from None

    def trigger_at(self, parameters: Sequence[float], state: State | None = None) -> Point:
        """The trigger [m] at given parameters and loop variables; without these, in the first lap.

        Raises
        ------
        PathUndefined
            If it has no value there; the message names the stage.
        """
        variables = self._variables(parameters, state)
        return point_at(self.trigger, parameters, f"the trigger of stage {self.index}", variables)

    def _variables(self, parameters: Sequence[float], state: State | None) -> Mapping[str, float]:
        if self.segment is None:
            return {}
        return self.segment.values(parameters, self.segment.start(parameters) if state is None else state)

    def track(self, path: PathFunction, end: Point) -> Track:
        """Its path, at parameters, as travelled to a point [m]; raises PathUndefined as `Track`."""
        return TRACKS[self.kind](path, end, self.sense)

    def names(self, parameter: str) -> bool:
        """Whether the path or the trigger depends on a parameter."""
        return any(parameter in expression.names for expression in (self.path, *self.trigger))


def point_at(
    point: PointExpression, parameters: Sequence[float], what: str, variables: Mapping[str, float] | None = None
) -> Point:
    """A point [m] at given parameters and loop variables.

    Raises
    ------
    PathUndefined
        If it has no value there; the message starts with `what`.
    """
    try:
        return point[0].at(parameters, variables=variables), point[1].at(parameters, variables=variables)
    except PathUndefined as error:
        raise PathUndefined(f"{what}: {error}") from None


@dataclass(frozen=True)
class Finding:
    """Something that reading or checking a plan shows."""

    severity: str
    stage: int | None
    line: int
    code: str
    message: str
    column: int = 1


@dataclass(frozen=True)
class ShortForm:
    """How a sectioned file writes its primitive stages: named coordinates, and paths and triggers in those names.

    `coordinates` holds name, first value and the shift added for each repetition.
    """

    coordinates: tuple[tuple[str, Expression, Expression], ...]
    stages: tuple[tuple[Expression, PointExpression], ...]


@dataclass(frozen=True)
class Plan:
    """A plan: the stages in order, or the n primitive ones of a plan that repeats.

    `shift` is the letter's d, which moves the stages from one lap to the next. A plan that repeats is flown lap by lap
    until it is beyond the final point, or where `ends_at_trigger` until the last trigger of a lap that reaches it.
    `primitive_stages` and `shift` may also be what explicit stages were found to have. `header_shift` is what the
    file's first line says, with its own sign. A plan of `segments` flies them one after the other; the last once, so
    that its last trigger is the final point.
    """

    name: str
    stages: tuple[Stage, ...]
    path_count: int
    computations: tuple[tuple[str, str], ...] = ()
    repeats: bool = False
    shift: PointExpression | None = None
    final: PointExpression | None = None
    primitive_stages: int | None = None
    trigger_radius_m: float = TRIGGER_RADIUS_M
    min_radius_m: float | None = None
    origin_deg: tuple[float, float] | None = None
    header_shift: PointExpression | None = None
    short_form: ShortForm | None = None
    ends_at_trigger: bool = False
    segments: tuple[Segment, ...] = ()

    @property
    def has_sets(self) -> bool:
        """Whether the stages carry their parameters' sets."""
        return bool(self.stages[0].sets)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters: c1..cρ of the paths, then the computations."""
        count = len(self.stages[0].sets) or max(self.path_count, self.path_count + len(self.computations))
        names = [f"c{i + 1}" for i in range(count)]
        result = [Parameter(name, PATH) for name in names[: self.path_count]]
        for k, name in enumerate(names[self.path_count :]):
            title, unit = self.computations[k] if k < len(self.computations) else ("", "")
            result.append(Parameter(name, COMPUTATION, title, unit))
        return tuple(result)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def final_point(self) -> PointExpression:
        """The final point: as stated, or the last stage's trigger."""
        return self.final or self.stages[-1].trigger

    @property
    def whole_laps(self) -> bool:
        """Whether the plan is laps of the same stages, moved: given as such, or found in explicit stages.

        Found stages are laps where they are whole ones, and agree in gains and sets too.
        """
        n = self.primitive_stages
        if self.repeats or n is None:
            return self.repeats
        if len(self.stages) % n:
            return False
        pairs = zip(self.stages, self.stages[n:], strict=False)
        return all(a.gain == b.gain and a.sets == b.sets for a, b in pairs)

    def laps(self) -> Plan:
        """The plan as it is flown: laps found in explicit stages become a plan that repeats.

        Its final point is the last stage's trigger, so it ends there.
        """
        if self.repeats or not self.whole_laps:
            return self
        final = self.stages[-1].trigger
        first = self.stages[: self.primitive_stages]
        return replace(self, stages=first, repeats=True, final=final, ends_at_trigger=True)

    def hull(self, index: int) -> Box:
        """The smallest box that holds a parameter's sets of all stages; stages that inhibit it are left out.

        Raises
        ------
        EadpError
            If the stages carry no sets.
        """
        boxes = [stage.sets[index] for stage in self.stages if stage.sets]
        if not boxes:
            raise EadpError("the plan's stages carry no sets")
        if self.parameters[index].kind == COMPUTATION:
            boxes = [box for box in boxes if not box.inhibited] or boxes
        return Box(min(box.lo for box in boxes), max(box.hi for box in boxes))

    def with_bounds(self, bounds: Mapping[str, Box]) -> Plan:
        """The same plan with sets for every stage, for a plan whose stages carry none.

        Raises
        ------
        EadpError
            If a parameter has no bounds, or bounds are given for none of its parameters.
        """
        count = max(self.path_count, max((int(name[1:]) for name in bounds), default=0))
        names = [f"c{i + 1}" for i in range(count)]
        missing = [name for name in names if name not in bounds]
        if missing:
            raise EadpError(f"no bounds for {', '.join(missing)}")
        sets = tuple(bounds[name] for name in names)
        return replace(self, stages=tuple(replace(stage, sets=sets) for stage in self.stages))
