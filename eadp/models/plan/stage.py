"""A stage of a plan: its path, trigger and parameter sets; the laps that it belongs to; and a stage as flown.

A segment is flown once, or lap by lap with loop variables that change from lap to lap. The letter's plans are laps of
primitive stages moved by one shift (Def. II.5). A field with slanted ends needs laps whose length changes too, and a
whole mission has stages before its laps and after them. A plan may therefore have several segments, one after the
other, and the laps of a segment may be written in loop variables of their own.

Source: letter, Defs. II.2-II.4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from eadp.core.arrays import FloatArray
from eadp.core.expressions.algebra import SymbolicStage
from eadp.core.expressions.derivatives import PathFunction, bind
from eadp.core.expressions.tree import Expression, named, substituted
from eadp.core.geometry.curves import TRACKS, Point, Track, path_kind
from eadp.errors import PathUndefined

State = tuple[float, ...]
"""The values, in this lap, of a segment's loop variables that change from lap to lap."""


@dataclass(frozen=True, slots=True)
class LoopVariable:
    """A named number of a segment: a first value and an increment for each lap; without `shift`, a formula.

    Formulas may name parameters, variables that change from lap to lap and formulas above them; a first value, only
    parameters; a shift, all of them.
    """

    name: str
    first: Expression
    shift: Expression | None = None


@dataclass(frozen=True)
class Segment:
    """Stages `first` (from 0) to `first + count`, flown once, or lap by lap until `until` holds.

    `until` is (a, b) for a ≥ b; it is evaluated before every lap, the first included.
    """

    first: int
    count: int
    variables: tuple[LoopVariable, ...] = ()
    until: tuple[Expression, Expression] | None = None

    @property
    def repeats(self) -> bool:
        """Whether the segment is flown lap by lap."""
        return self.until is not None

    @cached_property
    def _changing(self) -> list[tuple[LoopVariable, Expression]]:
        """The loop variables that change from lap to lap, and their increments."""
        return [(q, q.shift) for q in self.variables if q.shift is not None]

    def dependent(self, name: str) -> set[str]:
        """A parameter, and the loop variables whose formula depends on it, through formulas of formulas."""
        found = {name}
        for q in self.variables:
            if q.shift is None and q.first.names & found:
                found.add(q.name)
        return found

    def start(self, parameters: Sequence[float]) -> State:
        """The state of the first lap.

        Raises
        ------
        PathUndefined
            If a first value is no finite real number; so do the other methods for what they evaluate.
        """
        values = named(parameters)
        return tuple([q.first.value(values) for q, _ in self._changing])

    def next(self, parameters: Sequence[float], state: State) -> State:
        """The state of the next lap."""
        known = self.values(parameters, state)
        return tuple([value + shift.value(known) for (_, shift), value in zip(self._changing, state, strict=True)])

    def over(self, parameters: Sequence[float], state: State) -> bool:
        """Whether no further lap is to be flown."""
        return self.until is None or self.left(parameters, state) <= 0

    def left(self, parameters: Sequence[float], state: State) -> float:
        """How far the end of a repeated segment is at a state: b − a, 0 or less where no further lap is flown."""
        assert self.until is not None
        known = self.values(parameters, state)
        return self.until[1].value(known) - self.until[0].value(known)

    def first_lap(self) -> dict[str, Expression]:
        """Every loop variable in the first lap, in parameters alone.

        Raises
        ------
        ExpressionError
            If formulas of formulas grow too large.
        """
        return self.formulas({q.name: q.first for q, _ in self._changing})

    def formulas(self, known: Mapping[str, Expression]) -> dict[str, Expression]:
        """`known`, and every formula with what is known and the formulas above it substituted.

        Raises
        ------
        ExpressionError
            If formulas of formulas grow too large.
        """
        known = dict(known)
        for q in self.variables:
            if q.shift is None:
                known[q.name] = substituted(q.first, known) if known else q.first
        return known

    def values(self, parameters: Sequence[float], state: State) -> dict[str, float]:
        """Every name's value in a lap: parameters, then what changes from lap to lap, then formulas in their order."""
        known = named(parameters)
        known.update(zip([q.name for q, _ in self._changing], state, strict=True))
        for q in self.variables:
            if q.shift is None:
                known[q.name] = q.first.value(known)
        return known


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
            return bind(self.path, self._values(parameters, state))
        except PathUndefined as error:
            raise PathUndefined(f"the path of stage {self.index} {error}") from None

    def trigger_at(self, parameters: Sequence[float], state: State | None = None) -> Point:
        """The trigger [m] at given parameters and loop variables; without these, in the first lap.

        Raises
        ------
        PathUndefined
            If it has no value there; the message names the stage.
        """
        return _point(self.trigger, self._values(parameters, state), f"the trigger of stage {self.index}")

    def _values(self, parameters: Sequence[float], state: State | None) -> Mapping[str, float]:
        """The values of parameters and loop variables by name."""
        if self.segment is None:
            return named(parameters)
        return self.segment.values(parameters, self.segment.start(parameters) if state is None else state)

    def track(self, path: PathFunction, end: Point) -> Track:
        """Its path, at parameters, as travelled to a point [m]; raises PathUndefined as `Track`."""
        return TRACKS[self.kind](path, end, self.sense)


def point_at(point: PointExpression, parameters: Sequence[float], what: str) -> Point:
    """A point [m] at given parameters.

    Raises
    ------
    PathUndefined
        If it has no value there; the message starts with `what`.
    """
    return _point(point, named(parameters), what)


def _point(point: PointExpression, values: Mapping[str, float], what: str) -> Point:
    """`point_at` by values of parameters and loop variables."""
    try:
        return point[0].value(values), point[1].value(values)
    except PathUndefined as error:
        raise PathUndefined(f"{what}: {error}") from None


class Leg(NamedTuple):
    """One stage of a route: from where it is joined to its trigger.

    `track` is its path as travelled to its trigger, in the frame of lap 0. `flown_m` is less than `length_m` for the
    leg on which the plan ends.
    """

    lap: int
    stage: Stage
    track: Track
    offset_m: Point
    start_m: Point
    end_m: Point
    length_m: float
    flown_m: float = math.inf

    @property
    def path(self) -> PathFunction:
        """Its path function, in the frame of lap 0."""
        return self.track.path

    @property
    def distance_m(self) -> float:
        """The distance flown along the leg [m]."""
        return min(self.length_m, self.flown_m)

    @property
    def flown_share(self) -> float:
        """The share of its length that is flown; 1 of a leg without length."""
        return self.distance_m / self.length_m if self.length_m else 1.0

    def local_m(self, point: Point) -> Point:
        """A point [m] in the frame of lap 0."""
        return point[0] - self.offset_m[0], point[1] - self.offset_m[1]


def leg_points(leg: Leg, step_m: float) -> FloatArray:
    """Points of a leg at most `step_m` [m] apart, to where the plan ends on it; shape (n, 3).

    Of each x, y [m] and the direction of travel [rad]; the first and the last are exact, and all are on its path.
    """
    count = max(1, math.ceil(leg.distance_m / step_m - 1e-9))
    points = leg.track.points(leg.local_m(leg.start_m), leg.distance_m, leg.flown_share, count)
    points[:, :2] += leg.offset_m
    return points


def left_m(leg: Leg, position: Point, flown_m: float, early_m: float = 0.0) -> float:
    """The distance left of a leg at a position [m]; up to `early_m` more than the leg, where the last one ended early.

    Parameters
    ----------
    leg : Leg
    position : (float, float)
        Where the aircraft is [m].
    flown_m : float
        Distance flown on it so far, roughly [m]: it resolves turns round a circle, and is the measure on a curve.
    """
    cut_m = leg.length_m - leg.distance_m
    left = leg.track.remaining_m(leg.local_m(position), leg.distance_m - flown_m + cut_m) - cut_m
    return min(max(left, 0.0), leg.distance_m + early_m)
