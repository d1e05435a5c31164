"""What is left of a plan: the stages still to be flown at any parameters, as courses whose times are told in any wind.

A `RoutePredictor` keeps the place in the plan as the flight goes through it, told at each new stage; it lays out
the rest for parameters that begin where latched ones would, lap by lap to the plan's own end. So the time that remains
is the staircase of whole laps, not a straight line between two constants.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.compiled import jitted
from eadp.core.expressions.derivatives import PathFunction
from eadp.core.flight.wind import ground_speeds_mps, squared_bank_slopes
from eadp.core.geometry.curves import CIRCLE, LINE, Point, circle_of, line_of
from eadp.errors import EadpError, PathUndefined
from eadp.models.plan.cursor import LAP_LIMIT, PlanCursor
from eadp.models.plan.executor import LIVE, Rules, Vector, latch_stage, reaches, shift_at, shifting_stage
from eadp.models.plan.plan import COMPUTATION, Plan, Stage, point_at
from eadp.models.plan.trace import Leg, first_beyond_m, leg_length_m, leg_points

NODES_PER_QUARTER, MOST_NODES = 4, 16
CURVE_NODES = 24
SAME_PLACE_M = 1e-6
MARGIN_M = 1.0
"""An end that the path passes by less than this is not counted on, nor by less than the aircraft is off its path:
whoever looks for the best parameters finds those that just reach the end."""


class Nodes(NamedTuple):
    """Quadrature over a leg: lengths [m], directions of travel, curvatures [1/m]."""

    weights_m: FloatArray
    cosine: FloatArray
    sine: FloatArray
    curvature_per_m: FloatArray


@dataclass(frozen=True)
class Route:
    """The rest of a plan at some path parameters: legs, and nodes along them to integrate over.

    `parameters` holds for each leg the parameters in force on it; computations there mean nothing.
    """

    legs: tuple[Leg, ...]
    parameters: tuple[Vector, ...]
    nodes: tuple[Nodes, ...]

    @cached_property
    def _flat(self) -> tuple[Nodes, IntArray, IntArray]:
        """The nodes of all legs that differ, to which of these each belongs, and which each leg has: laps repeat."""
        places: dict[int, int] = {}
        order = np.array([places.setdefault(id(nodes), len(places)) for nodes in self.nodes])
        different = {id(nodes): nodes for nodes in self.nodes}.values()
        flat = Nodes(*(np.concatenate(arrays) for arrays in zip(*different, strict=True)))
        return flat, np.repeat(np.arange(len(different)), [len(nodes.weights_m) for nodes in different]), order

    @cached_property
    def _kinds(self) -> tuple[list[int], IntArray]:
        """The first leg of each stage with the same parameters in force, and which of them each leg is like."""
        places: dict[tuple[int, Vector], int] = {}
        keys = [(leg.stage.index, own) for leg, own in zip(self.legs, self.parameters, strict=True)]
        order = np.array([places.setdefault(key, len(places)) for key in keys])
        return [keys.index(key) for key in places], order

    def times_s(self, airspeed_mps: float, wind_mps: Point) -> tuple[FloatArray, FloatArray]:
        """Time on each leg, and the time integral of tan² of the bank that it takes.

        Parameters
        ----------
        airspeed_mps : float
            Airspeed [m/s].
        wind_mps : (float, float)
            Wind [m/s].

        Returns
        -------
        times, turning : array, shape (legs,)
            [s]; infinite where a leg cannot be flown in this wind.

        Source: ∫ ds/v over each leg, v from the wind triangle.
        """
        if not self.legs:
            return np.zeros(0), np.zeros(0)
        nodes, of_node, order = self._flat
        return jitted(_times_s, ground_speeds_mps, squared_bank_slopes)(*nodes, of_node, order, airspeed_mps, wind_mps)

    @cached_property
    def free(self) -> FloatArray:
        """1 where a parameter has a choice on a leg, else 0, shape (parameters, legs)."""
        count, (firsts, order) = len(self.parameters[0]), self._kinds
        free = [[not box.fixed for box in self.legs[i].stage.sets] or [False] * count for i in firsts]
        return np.ascontiguousarray(np.array(free, dtype=float).T[:, order])

    @cached_property
    def shares(self) -> FloatArray:
        """Share of its set that each parameter has on each leg, shape (parameters, legs); 0 where it has no choice."""
        firsts, order = self._kinds
        shares = []
        for i in firsts:
            sets, own = self.legs[i].stage.sets, self.parameters[i]
            told = [box.share(value) or 0.0 for box, value in zip(sets, own, strict=True)] if sets else [0.0] * len(own)
            shares.append(told)
        return np.ascontiguousarray(np.array(shares, dtype=float).T[:, order])

    def grouped(self, key: Callable[[Stage, Vector], object]) -> list[tuple[int, IntArray]]:
        """Legs whose stage and parameters in force have the same key: the first of them, and all of them."""
        firsts, order = self._kinds
        places: dict[object, int] = {}
        keys = [key(self.legs[i].stage, self.parameters[i]) for i in firsts]
        of_leg = np.array([places.setdefault(each, len(places)) for each in keys])[order]
        members = [np.nonzero(of_leg == place)[0] for place in places.values()]
        return [(int(legs[0]), legs) for legs in members]

    def after(self) -> Route:
        """The same without its first leg."""
        return Route(self.legs[1:], self.parameters[1:], self.nodes[1:])

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Which stages it consists of: courses of one shape are parts of one step of the staircase."""
        return tuple(leg.stage.index for leg in self.legs)

    @cached_property
    def stages(self) -> IntArray:
        """The stage of each leg, from 1, shape (legs,)."""
        return np.array(self.shape, dtype=np.intp)


class RoutePredictor:
    """Where a flight is in its plan, and what is left from there.

    Parameters
    ----------
    plan : Plan
    parameters : tuple of float
        At take-off.
    start_m : (float, float)
        Where the flight begins [m].
    rules : Rules

    Attributes
    ----------
    margin_m : float
        By how much the end of the plan has to be passed to be counted on [m].
    """

    def __init__(self, plan: Plan, parameters: Vector, start_m: Point, rules: Rules) -> None:
        self._plan = plan
        self._live = rules.parameter_changes == LIVE
        self._ends_anywhere = rules.box_triggers
        self._walk = PlanCursor(plan, parameters) if plan.parts else None
        self._latch = [latch_stage(plan, i) for i in range(len(plan.parameters))]
        self._shifting = [shifting_stage(plan, parameter.name) for parameter in plan.parameters]
        self._index = 0
        self._base: Point = (0.0, 0.0)
        self._pending = self._live and plan.repeats and len(plan.stages) == 1
        self._decided_before = self._decided = self._waiting = tuple(parameters)
        self._begin = start_m
        self._geometry: dict[object, _Geometry] = {}
        self._bound: dict[object, tuple[PathFunction, Point]] = {}
        self._ends: dict[Vector, tuple[Point, Point, Point]] = {}
        self.lap = 0
        self.margin_m = MARGIN_M

    @property
    def stage(self) -> Stage:
        """The stage being flown."""
        return self._plan.stages[self._index] if self._walk is None else self._walk.place.stage

    @property
    def before_latch(self) -> bool:
        """Whether a path parameter decided during this stage takes effect with the next one."""
        if self._live:
            return True
        if self._walk is not None:
            rest = self._decided[self._plan.path_count :]
            ends = [(*[end] * self._plan.path_count, *rest) for end in (-math.inf, math.inf)]
            return any(_takes(copy.copy(self._walk), moved, self._plan.path_count) for moved in ends)
        n = len(self._plan.stages)
        following = (self._index + 1) % n if self._plan.repeats else self._index + 1
        return any(latch in (following, None) for latch in self._latch[: self._plan.path_count])

    def decide(self, parameters: Vector) -> None:
        """Take parameters that have been decided."""
        rho = self._plan.path_count
        if parameters[:rho] != self._decided[:rho]:
            self._decided_before = self._decided
        self._decided = tuple(parameters)
        if self._walk is not None:
            self._walk.decide(parameters)
        else:
            self._waiting = tuple(
                new if self._live or parameter.kind == COMPUTATION else old
                for new, old, parameter in zip(parameters, self._waiting, self._plan.parameters, strict=True)
            )

    def next_stage(self, parameters: Vector) -> None:
        """The next stage has begun, with parameters in force as observed: they decide where doubt is left.

        Raises
        ------
        PathUndefined
            If the next lap's quantities have no value.
        """
        if self._walk is not None:
            self._next_of_parts(parameters)
            return
        rho = self._plan.path_count
        offset = self._offset(self._index, self._base, self._pending, self._waiting)
        self._begin = self._trigger(self.stage, self._clipped(self.stage, self._waiting), offset)
        if self._index < len(self._plan.stages) - 1:
            self._index += 1
        elif self._plan.repeats:
            if not self._live:
                self._base = self._shifted(self._base, self._waiting)
            self.lap += 1
            self._index = 0
        else:
            return
        if self._live and self._plan.repeats and self._index == len(self._plan.stages) - 1:
            self._base, self._pending = self._frozen(self._base, self._pending, self._decided)
        self._waiting = self._latched(self._index, self._waiting, self._decided)
        expected = self._clipped(self.stage, self._waiting)
        if expected[:rho] != parameters[:rho]:  # a decision has come a moment earlier or later than was thought
            path = self._behind(parameters, self._waiting, self._decided, self._decided_before)
            self._waiting = (*path, *self._waiting[rho:])

    def _behind(self, told: Vector, *decided: Vector) -> Vector:
        """Of path parameters in force as observed, cut to the stage's sets, the decided values that they are."""
        known = list(told[: self._plan.path_count])
        for values in reversed(decided):
            clipped = self._clipped(self.stage, values)
            known = [values[i] if clipped[i] == told[i] else before for i, before in enumerate(known)]
        return tuple(known)

    def _next_of_parts(self, parameters: Vector) -> None:
        assert self._walk is not None
        if self._walk.done:
            return
        rho, before = self._plan.path_count, copy.copy(self._walk)
        self._begin = self._walk.place.trigger_m()
        self._walk.next()
        if not self._walk.done and self._walk.place.parameters[:rho] != parameters[:rho]:
            path = self._behind(parameters, self._decided, self._decided_before)
            before.decide((*path, *parameters[rho:]))
            before.next()
            before.decide(self._decided)
            self._walk = before
        if not self._walk.done:
            self.lap = self._walk.place.lap

    def course(self, parameters: Vector) -> Route:
        """The rest of the plan from the begin of the stage being flown, at parameters decided now.

        Raises
        ------
        PathUndefined
            If a path or trigger has no value, or the plan's end is not reached.
        """
        return self._course_of_parts(parameters) if self._walk is not None else self._course_of_laps(parameters)

    # --- laps moved by a shift, and plans flown once

    def _course_of_laps(self, decided: Vector) -> Route:
        plan, n = self._plan, len(self._plan.stages)
        index, base, begin, lap, pending = self._index, self._base, self._begin, self.lap, self._pending
        waiting = decided if self._live and not (plan.repeats and index == n - 1) else self._waiting
        legs: list[Leg] = []
        values: list[Vector] = []
        nodes: list[Nodes] = []
        before: dict[int, tuple[Vector, Point, Vector, _Geometry]] = {}  # the last lap's: most laps are like it
        asked: tuple[Vector, Point] | None = None
        reached = False
        for _ in range(LAP_LIMIT * n):
            stage = plan.stages[index]
            offset = self._offset(index, base, pending, waiting)
            local = begin[0] - offset[0], begin[1] - offset[1]
            known = before.get(index)
            if known is not None and known[0] == waiting and math.dist(known[1], local) < SAME_PLACE_M:
                own, geometry = known[2], known[3]
            else:
                own = self._clipped(stage, waiting)
                geometry = self._leg(stage, own, local)
                before[index] = waiting, local, own, geometry
            if asked != (own, offset):
                asked, reached = (own, offset), self._reaches(own, offset)
            end = (geometry.end[0] + offset[0], geometry.end[1] + offset[1])
            leg = Leg(lap, stage, geometry.path, offset, begin, end, geometry.length_m)
            last = index == n - 1
            whole, over_m = self._end(own, leg) if reached else (False, None)
            values.append(own)
            if over_m is not None:
                leg = Leg(lap, stage, leg.path, offset, begin, end, leg.length_m, over_m)
                legs.append(leg)
                nodes.append(_nodes(leg))
                return Route(tuple(legs), tuple(values), tuple(nodes))
            legs.append(leg)
            nodes.append(geometry.nodes)
            if last and (not plan.repeats or whole):
                return Route(tuple(legs), tuple(values), tuple(nodes))
            if last:
                base = base if self._live else self._shifted(base, waiting)
                index, lap = 0, lap + 1
            else:
                index += 1
            if waiting != decided:
                waiting = self._latched(index, waiting, decided)
            if self._live and plan.repeats and index == n - 1:
                base, pending = self._frozen(base, pending, waiting)
            begin = end
        raise PathUndefined(f"the plan does not reach its final point within {LAP_LIMIT} laps")

    def _offset(self, index: int, base: Point, pending: bool, waiting: Vector) -> Point:
        """How far a stage lies from lap 0's [m]: live, the lap's shift is that of the parameters of the moment."""
        last = index == len(self._plan.stages) - 1
        return self._shifted(base, waiting) if self._live and pending and not last else base

    def _frozen(self, base: Point, pending: bool, waiting: Vector) -> tuple[Point, bool]:
        """Live, a lap's last stage begins: where the lap lies now, it stays, and a shift is due."""
        return (self._shifted(base, waiting) if pending else base), True

    def _reaches(self, own: Vector, offset: Point) -> bool:
        """Whether a lap goes so far that the plan may be over in it."""
        plan = self._plan
        if not plan.repeats:
            return False
        final, shift, last = self._ends_at(own)
        place = last[0] + offset[0], last[1] + offset[1]
        return self._ends_anywhere or reaches(place, final, shift, plan.trigger_radius_m)

    def _end(self, own: Vector, leg: Leg) -> tuple[bool, float | None]:
        """In a lap that reaches the end: whether its last trigger is it, and where on this leg it is [m], if it is."""
        plan = self._plan
        final, shift, _ = self._ends_at(own)
        if plan.ends_at_trigger and not self._ends_anywhere:
            return True, None
        return False, first_beyond_m(leg, final, shift, plan.trigger_radius_m, -self.margin_m)

    def _ends_at(self, own: Vector) -> tuple[Point, Point, Point]:
        """Final point, shift, and last trigger of lap 0 at some parameters [m]."""
        key = own[: self._plan.path_count]
        if key not in self._ends:
            final = point_at(self._plan.final_point, own, "the final point")
            self._ends[key] = final, shift_at(self._plan, own), self._plan.stages[-1].trigger_at(own)
        return self._ends[key]

    def _shifted(self, base: Point, waiting: Vector) -> Point:
        values = waiting
        if self._plan.has_sets:
            stages = self._plan.stages
            values = tuple(
                stages[place].sets[i].clip(value)
                for i, (place, value) in enumerate(zip(self._shifting, waiting, strict=True))
            )
        _, (dx, dy), _ = self._ends_at(values)
        return base[0] + dx, base[1] + dy

    def _latched(self, begun: int, waiting: Vector, decided: Vector) -> Vector:
        return tuple(
            new if self._live or latch in (begun, None) else old
            for new, old, latch in zip(decided, waiting, self._latch, strict=True)
        )

    def _clipped(self, stage: Stage, values: Vector) -> Vector:
        if not stage.sets:
            return values
        return tuple(box.clip(value) for box, value in zip(stage.sets, values, strict=True))

    def _trigger(self, stage: Stage, own: Vector, base: Point) -> Point:
        x, y = self._path(stage, own)[1]
        return x + base[0], y + base[1]

    def _path(self, stage: Stage, own: Vector) -> tuple[PathFunction, Point]:
        key = (stage.index, own[: self._plan.path_count])
        if key not in self._bound:
            self._bound[key] = stage.path_at(own), stage.trigger_at(own)
        return self._bound[key]

    def _leg(self, stage: Stage, own: Vector, begin: Point) -> _Geometry:
        """A leg in the frame of lap 0, remembered: laps repeat them."""
        key = (
            stage.index,
            own[: self._plan.path_count],
            round(begin[0] / SAME_PLACE_M),
            round(begin[1] / SAME_PLACE_M),
        )
        if key not in self._geometry:
            path, trigger = self._path(stage, own)
            self._geometry[key] = _geometry(stage, path, begin, trigger)
        return self._geometry[key]

    # --- parts

    def _course_of_parts(self, decided: Vector) -> Route:
        assert self._walk is not None
        walk = copy.copy(self._walk)
        walk.decide(decided)
        legs: list[Leg] = []
        values: list[Vector] = []
        nodes: list[Nodes] = []
        begin = self._begin
        while not walk.done:
            place = walk.place
            key = (place.stage.index, place.parameters[: self._plan.path_count], place.state, begin)
            if key not in self._geometry:
                self._geometry[key] = _geometry(place.stage, place.path(), begin, place.trigger_m())
            known = self._geometry[key]
            legs.append(Leg(place.lap, place.stage, known.path, (0.0, 0.0), begin, known.end, known.length_m))
            values.append(place.parameters)
            nodes.append(known.nodes)
            begin = known.end
            walk.next()
        return Route(tuple(legs), tuple(values), tuple(nodes))


def _takes(walk: PlanCursor, moved: Vector, rho: int) -> bool:
    """Whether a walk's next stage takes over path parameters decided now."""
    before = walk.place.parameters[:rho]
    walk.decide(moved)
    try:
        walk.next()
    except EadpError:
        return True
    return walk.done or walk.place.parameters[:rho] != before


class _Geometry(NamedTuple):
    path: PathFunction
    end: Point
    length_m: float
    nodes: Nodes


def _geometry(stage: Stage, path: PathFunction, begin: Point, trigger: Point) -> _Geometry:
    length_m = leg_length_m(stage, path, begin, trigger)
    if not math.isfinite(length_m):
        raise PathUndefined(f"the path of stage {stage.index} does not lead to its trigger")
    return _Geometry(path, trigger, length_m, _nodes(Leg(0, stage, path, (0.0, 0.0), begin, trigger, length_m)))


def left_m(leg: Leg, position: Point, flown_m: float, early_m: float = 0.0) -> float:
    """How much of a leg is left at a position [m], and up to `early_m` to its begin, where the last one ended early.

    Parameters
    ----------
    leg : Leg
    position : (float, float)
        Where the aircraft is [m].
    flown_m : float
        About how much of it has been flown [m]: what tells turns round a circle apart, and all there is on a curve.
    """
    stage, (ox, oy) = leg.stage, leg.offset_m
    local, end = (position[0] - ox, position[1] - oy), (leg.end_m[0] - ox, leg.end_m[1] - oy)
    cut_m = leg.length_m - leg.distance_m
    if stage.kind == LINE:
        left = -line_of(leg.path, end, stage.sense).progress_m(local) - cut_m
    elif stage.kind == CIRCLE:
        circle = circle_of(leg.path, end, stage.sense)
        turn_m = 2 * math.pi * circle.radius_m
        left = circle.radius_m * circle.sweep_rad(local, end) - cut_m
        left += turn_m * round((leg.distance_m - flown_m - left) / turn_m)
    else:
        left = leg.distance_m - flown_m
    return min(max(left, 0.0), leg.distance_m + early_m)


def _times_s(
    weights_m: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    curvature_per_m: FloatArray,
    of_node: IntArray,
    order: IntArray,
    airspeed_mps: float,
    wind_mps: Point,
) -> tuple[FloatArray, FloatArray]:
    """`Route.times_s` by the nodes of the legs that differ; in that part of numpy that may be compiled."""
    speeds, along = ground_speeds_mps(cosine, sine, airspeed_mps, wind_mps)
    forward = speeds > 0.0
    seconds = weights_m / np.where(forward, speeds, 1.0)
    slopes = squared_bank_slopes(curvature_per_m, speeds, along, airspeed_mps)
    turning = np.bincount(of_node, np.where(forward, seconds * slopes, 0.0)).astype(np.float64)
    times_s = np.bincount(of_node, np.where(forward, seconds, np.inf)).astype(np.float64)
    return times_s[order], turning[order]


# --- nodes ------------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=MOST_NODES + 1)
def _gauss(count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre nodes and weights over [0, 1]."""
    places, weights = np.polynomial.legendre.leggauss(count)
    return (places + 1) / 2, weights / 2


def _nodes(leg: Leg) -> Nodes:
    """Quadrature over what is flown of a leg."""
    stage, length = leg.stage, leg.distance_m
    start = (leg.start_m[0] - leg.offset_m[0], leg.start_m[1] - leg.offset_m[1])
    end = (leg.end_m[0] - leg.offset_m[0], leg.end_m[1] - leg.offset_m[1])
    if stage.kind == LINE:
        dx, dy = line_of(leg.path, end, stage.sense).direction
        return Nodes(np.array([length]), np.array([dx]), np.array([dy]), np.zeros(1))
    if stage.kind == CIRCLE:
        circle = circle_of(leg.path, end, stage.sense)
        sweep = length / circle.radius_m
        count = min(max(2, math.ceil(NODES_PER_QUARTER * sweep / (math.pi / 2))), MOST_NODES)
        places, weights = _gauss(count)
        course = circle.angle_rad(start) + circle.turn * (sweep * places + math.pi / 2)
        curvature = np.full(count, circle.turn / circle.radius_m)
        return Nodes(weights * length, np.cos(course), np.sin(course), curvature)
    headings = np.unwrap([point.heading_rad for point in leg_points(leg, max(length / CURVE_NODES, 1e-3))])
    middle = (headings[1:] + headings[:-1]) / 2
    step = length / len(middle)
    return Nodes(np.full(len(middle), step), np.cos(middle), np.sin(middle), np.diff(headings) / max(step, 1e-9))
