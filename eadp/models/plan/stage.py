"""A stage of a plan: its path, trigger and parameter sets. Source: letter, Defs. II.2-II.4."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from eadp.core.expressions.algebra import SymbolicStage
from eadp.core.expressions.derivatives import PathFunction, bind
from eadp.core.expressions.tree import Expression
from eadp.core.geometry.curves import Point, path_kind
from eadp.core.geometry.tracks import TRACKS, Track
from eadp.errors import PathUndefined
from eadp.models.plan.segments import Segment, State

PATH, COMPUTATION = "path", "computation"
ROTATIONS = (90, 270)
SHOWN_SHARE = 1e-3
"""Share of what a set shows by which a value may miss an end of it: values are printed with four digits."""

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


class Title(NamedTuple):
    """What people call a parameter: a name, a unit, and for a path parameter what it stands for, an expression in it.

    As in `spacing [m] = 150 - 2*sqrt(4900 + c1)`.
    """

    name: str
    unit: str = ""
    stands_for: Expression | None = None


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of the plan: its name (c1, c2, …), its kind, and what people call it."""

    name: str
    kind: str
    title: str = ""
    unit: str = ""
    stands_for: Expression | None = None

    @property
    def label(self) -> str:
        """What people read: the title where it has one, else the name."""
        return self.title or self.name

    def shown(self, value: float) -> float:
        """A value as people read it: of what the parameter stands for."""
        return value if self.stands_for is None else self.stands_for.value({self.name: value})

    def text(self, value: float) -> str:
        """A value as people read it, to six digits, with its unit where it stands for something else."""
        return f"{self.shown(value):.6g}" if self.stands_for is None else f"{self.shown(value):.4g} {self.unit}".strip()

    def of_shown(self, shown: float, box: Box) -> float:
        """The value of a set for which `shown` is read; beyond it where there is none.

        Raises
        ------
        PathUndefined
            If what it stands for is undefined within the set.
        """
        if self.stands_for is None:
            return shown
        from scipy.optimize import brentq  # plans that state a value are few

        ends = [self.shown(end) - shown for end in (box.lo, box.hi)]
        for end, apart in zip((box.lo, box.hi), ends, strict=True):
            if abs(apart) <= SHOWN_SHARE * abs(ends[1] - ends[0]):
                return end
        if ends[0] * ends[1] > 0:
            rises, above = ends[1] > ends[0], ends[0] > 0
            return box.lo - 1.0 if rises == above else box.hi + 1.0
        return float(brentq(lambda value: self.shown(value) - shown, box.lo, box.hi, xtol=1e-9))


RETURN, LAND, TAKEOFF, LOITER_TO_ALTITUDE, TRIGGER_DISTANCE = 20, 21, 22, 31, 206
"""MAVLink's commands that say how a stage is flown: to its end, then home; down to its end; up from the ground; round
and round until the aircraft is at its altitude."""


@dataclass(frozen=True)
class Stage:
    """A path to follow until its trigger, and the sets of the parameters there. Source: letter, Def. II.2.

    `radius_m` is the radius of its trigger where it has its own (the letter's ε_i); `Plan.radius_m` is the one that
    holds. `segment` is the one that it belongs to, where path and trigger may name its loop variables. `altitude_m` is
    above the origin. `commands` are what an autopilot does as the stage starts, as MAVLink's numbers: a command and its
    parameters; they do not move it, but for `TAKEOFF`, `LAND`, `RETURN` and `LOITER_TO_ALTITUDE`. `item` is what
    messages call the item of a mission that it leads to.
    """

    index: int
    line: int
    gain: float
    rotation_deg: int
    path: Expression
    trigger: PointExpression
    sets: tuple[Box, ...] = ()
    segment: Segment | None = None
    radius_m: float | None = None
    altitude_m: float | None = None
    airspeed_mps: float | None = None
    commands: tuple[tuple[float, ...], ...] = ()
    item: str = field(default="", compare=False)

    @property
    def label(self) -> str:
        """What messages call it."""
        return self.item or f"stage {self.index}"

    def command(self, number: int) -> tuple[float, ...]:
        """Its command of a number; empty without."""
        return next((each for each in self.commands if each[0] == number), ())

    @cached_property
    def kind(self) -> str:
        """`line`, `circle` or `curve`."""
        return path_kind(self.path)

    @cached_property
    def sympy(self) -> SymbolicStage:
        """φ, ∇φ, Hessian and trigger as sympy objects, in x, y, the parameters and loop variables.

        Raises
        ------
        EadpError
            If sympy cannot be imported, or an expression is too large for it (`algebra.SIZE_LIMIT`).
        """
        return SymbolicStage.of(self.path, self.trigger)

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
