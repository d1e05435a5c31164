"""The plan: stages with their paths, triggers and parameter sets. Source: letter, Defs. II.1-II.5."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

from eadp.core.expressions.tree import Expression
from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, Fault, one_of
from eadp.models.airspace import CLEARANCE_M, EVERYWHERE, Airspace, Field
from eadp.models.plan.stage import COMPUTATION, PATH, Box, Parameter, PointExpression, Segment, Stage, Title

TRIGGER_RADIUS_M = 20.0


@dataclass(frozen=True)
class Finding:
    """Something that reading or checking a plan shows.

    `formula` is φ at a trigger that lies off a path, in sympy's syntax. `proven` is whether it holds whatever the check
    has sampled; None where nothing is sampled.
    """

    severity: str
    stage: int | None
    line: int
    code: str
    message: str
    column: int = 1
    formula: str = ""
    proven: bool | None = None

    def fault(self, file: str) -> Fault:
        """The finding at its place in a file."""
        return Fault(file, self.line, self.column, self.message, severity=self.severity)


@dataclass(frozen=True)
class CheckReport:
    """What a check of a plan found: the base of those that say more."""

    findings: tuple[Finding, ...]

    @property
    def has_errors(self) -> bool:
        """Whether any finding is an error."""
        return any(finding.severity == "error" for finding in self.findings)

    def lines(self, plan: Plan) -> list[str]:
        """What it says to people besides its findings; the last line ends the summary."""
        return []

    def document(self, plan: Plan) -> Any:
        """What it adds to `eadp.plan/1`: a mapping of keys."""
        return {}


@dataclass(frozen=True)
class ShortForm:
    """How a sectioned file writes its primitive stages: named coordinates, and paths and triggers in those names.

    `coordinates` holds name, first value and the shift added for each repetition.
    """

    coordinates: tuple[tuple[str, Expression, Expression], ...]
    stages: tuple[tuple[Expression, PointExpression], ...]


class MadeFor(NamedTuple):
    """What a path was made for: an aircraft by name, its airspeed, the wind, and the bearing it comes from [m/s, °]."""

    vehicle: str
    airspeed_mps: float
    wind_mps: float
    wind_from_deg: float

    @property
    def aircraft(self) -> str:
        """The aircraft and its airspeed, for people."""
        speed = f"{self.airspeed_mps:g} m/s"
        return f"{self.vehicle} at {speed}" if self.vehicle else f"an aircraft at {speed}"


class SurveyCamera(NamedTuple):
    """The pictures that a path was made for: a camera by name, the altitude above ground [m], the size of a pixel [cm].

    The name is '' and the size None where they are not known.
    """

    name: str
    altitude_m: float
    gsd_cm: float | None

    @property
    def text(self) -> str:
        """For people."""
        name = f"{self.name} " if self.name else ""
        size = "" if self.gsd_cm is None else f", {self.gsd_cm:.2g} cm a pixel"
        return f"{name}from {self.altitude_m:.4g} m{size}"


class Site(NamedTuple):
    """Where a plan is, what it covers and what it keeps to, as far as that is known.

    Attributes
    ----------
    origin_deg : (float, float) or None
        Latitude and longitude of the local frame's origin [°].
    start_m : (float, float) or None
        Where a flight starts by default [m].
    field : Field or None
        The area to cover.
    swath_m : float or None
        Width of ground that a line covers [m].
    home_m : (float, float) or None
        Where a flight returns to [m].
    airspace : Airspace
        Obstacles and boundary.
    made_for : MadeFor or None
    camera : SurveyCamera or None
    ground_m : float or None
        Height of the ground above the sea where altitudes are 0 [m], of a plan that follows the ground.
    home_altitude_m : float or None
        Altitude at which a straight way home is clear of ground and obstacles, from anywhere on the plan [m].
    height_m : float or None
        Height of the altitude 0 above the sea [m], where a mission's home has one, or a terrain beside the plan.
    clearance_m : float
        How high above obstacles a flight passes [m].
    """

    origin_deg: tuple[float, float] | None = None
    start_m: Point | None = None
    field: Field | None = None
    swath_m: float | None = None
    home_m: Point | None = None
    airspace: Airspace = EVERYWHERE
    made_for: MadeFor | None = None
    camera: SurveyCamera | None = None
    ground_m: float | None = None
    home_altitude_m: float | None = None
    height_m: float | None = None
    clearance_m: float = CLEARANCE_M

    @property
    def above_sea_m(self) -> float | None:
        """Height of the altitude 0 above the sea [m], of a plan over terrain or of a mission; None if not known."""
        return self.height_m if self.ground_m is None else self.ground_m


@dataclass(frozen=True)
class Plan:
    """A plan: the stages in order, or the n primitive ones of a plan that repeats.

    `shift` is the letter's d, which moves the stages from one lap to the next. `primitive_stages` and `shift` may also
    be what explicit stages were found to have. `header_shift` is what the file's first line says, with its own sign.
    `titles` are what people call the path parameters. A plan of `segments` flies them one after the other; the last
    once, so that its last trigger is the final point.
    """

    name: str
    stages: tuple[Stage, ...]
    path_count: int
    computations: tuple[tuple[str, str], ...] = ()
    titles: tuple[Title, ...] = ()
    repeats: bool = False
    shift: PointExpression | None = None
    final: PointExpression | None = None
    primitive_stages: int | None = None
    trigger_radius_m: float = TRIGGER_RADIUS_M
    min_radius_m: float | None = None
    site: Site = field(default_factory=Site)
    header_shift: PointExpression | None = None
    short_form: ShortForm | None = None
    segments: tuple[Segment, ...] = ()

    def __hash__(self) -> int:
        """Cheap, as plans are keys of what is kept from one flight to the next."""
        return hash((self.name, len(self.stages)))

    def __repr__(self) -> str:
        """One line, not the stages."""
        named = ", ".join(item.label for item in self.parameters) or "none"
        return f"<Plan {self.name.rpartition('/')[2]}: {len(self.stages)} stages, parameters {named}>"

    @property
    def has_sets(self) -> bool:
        """Whether the stages carry their parameters' sets."""
        return bool(self.stages[0].sets)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters: c1..cρ of the paths, then the computations."""
        names = [f"c{i + 1}" for i in range(len(self.stages[0].sets) or self.path_count + len(self.computations))]
        titles = itertools.chain(self.titles, itertools.repeat(Title("")))
        computations = itertools.chain(self.computations, itertools.repeat(("", "")))
        paths = [Parameter(name, PATH, *title) for name, title in zip(names[: self.path_count], titles, strict=False)]
        others = zip(names[self.path_count :], computations, strict=False)
        return (*paths, *(Parameter(name, COMPUTATION, *title) for name, title in others))

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names in order."""
        return tuple(parameter.name for parameter in self.parameters)

    def parameter(self, name: str) -> int | None:
        """The index of a parameter by its name or its title; None if the plan has no such one."""
        return next((i for i, own in enumerate(self.parameters) if name in (own.name, own.title) and name), None)

    def shown(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of parameters by name as people read them: by title, and of what they stand for."""
        return {item.label: item.shown(values[item.name]) for item in self.parameters if item.name in values}

    def expected_name(self, name: str) -> str:
        """What is expected where a parameter is given by a name that the plan does not know."""
        return one_of([item.label for item in self.parameters], name) or "none: the plan has no parameters"

    @cached_property
    def quality_sets(self) -> tuple[tuple[Box, ...], ...]:
        """The sets of each stage as the quality U counts them: path parameters that alter nothing there have no choice.

        A stage depends on what its path or trigger names; where laps repeat, on what any of them, a loop variable or
        the shift names.
        """
        segments = self.segments or (Segment(0, len(self.stages)),)
        return tuple(sets for segment in segments for sets in self._quality_sets(segment))

    def _quality_sets(self, segment: Segment) -> list[tuple[Box, ...]]:
        stages = self.stages[segment.first : segment.first + segment.count]
        named = [stage.path.names.union(*(part.names for part in stage.trigger)) for stage in stages]
        if segment.repeats or self.repeats:
            of_lap = [part.names for part in (*(segment.until or ()), *(self.shift or ()))]
            of_lap += [part.names for q in segment.variables if q.shift for part in (q.first, q.shift)]
            named = [frozenset().union(*named, *of_lap)] * len(stages)
        dependent = [segment.dependent(name) for name in self.names[: self.path_count]]
        counted = []
        for stage, names in zip(stages, named, strict=True):
            paths = zip(stage.sets, dependent, strict=False)
            chosen = (box if names & own else Box(box.lo, box.lo) for box, own in paths)
            counted.append((*chosen, *stage.sets[self.path_count :]))
        return counted

    @property
    def ends_at_trigger(self) -> bool:
        """Whether the laps end at the last trigger of one that reaches the final point, as explicit stages do.

        Those of a short form end wherever the aircraft is beyond that point.
        """
        return self.repeats and self.short_form is None

    @property
    def final_point(self) -> PointExpression:
        """The final point: as stated, or the last stage's trigger."""
        return self.final or self.stages[-1].trigger

    def radius_m(self, stage: Stage) -> float:
        """The trigger radius of a stage [m]: its own, else the plan's. Source: letter, Def. II.4."""
        return self.trigger_radius_m if stage.radius_m is None else stage.radius_m

    @cached_property
    def final_radius_m(self) -> float:
        """The trigger radius of the last stage [m], whose trigger is the final point."""
        return self.radius_m(self.stages[-1])

    @cached_property
    def max_radius_m(self) -> float:
        """The largest trigger radius of a stage [m]."""
        return max(map(self.radius_m, self.stages))

    @property
    def whole_laps(self) -> bool:
        """Whether the plan is laps of the same stages, moved: given as such, or found in explicit stages.

        Found stages are laps where they are whole ones, and agree in all but their paths and triggers too.
        """
        n = self.primitive_stages
        if self.repeats or n is None:
            return self.repeats
        if len(self.stages) % n:
            return False
        rules = [
            (stage.gain, stage.sets, self.radius_m(stage), stage.altitude_m, stage.airspeed_mps, stage.commands)
            for stage in self.stages
        ]
        return rules[n:] == rules[:-n]

    def laps(self) -> Plan:
        """The plan as it is flown: laps found in explicit stages become a plan that repeats.

        Its final point is the last stage's trigger, so it ends there.
        """
        if self.repeats or not self.whole_laps:
            return self
        final = self.stages[-1].trigger
        first = self.stages[: self.primitive_stages]
        return replace(self, stages=first, repeats=True, final=final)

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
