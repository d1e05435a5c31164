"""What is left of a plan: the legs still to be flown at any parameters, and their times in any wind.

The route follows the plan's own state machine lap by lap to its end, so the time that remains is the staircase of whole
laps, not a straight line between two constants.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.compiled import in_loops, jitted
from eadp.core.flight.aerodynamics import GRAVITY_MPS2
from eadp.core.flight.wind import ground_speeds_mps, squared_bank_slopes
from eadp.core.geometry.curves import Point
from eadp.core.geometry.tracks import Nodes, Track
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.legs import Leg, first_beyond_m
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box, Stage

SAME_POINT_M = 1e-6
MARGIN_M = 1.0
"""Clearance of the end beyond which a lap is certainly the last, at least [m]."""

CLEARANCE_STEP_M = 0.05
"""Accuracy of an uncertain end's clearance [m]."""


class UncertainEnd(NamedTuple):
    """Where a plan may or may not end: on a leg that passes the end, or misses it, by little.

    Attributes
    ----------
    leg : int
        Index of the leg.
    flown_m : float
        Distance flown along it to the end [m].
    clearance_m : float
        How far the leg passes the end [m]; negative where it misses it.
    length_m : float
        Length of the leg [m].
    """

    leg: int
    flown_m: float
    clearance_m: float
    length_m: float


@dataclass(frozen=True)
class Route:
    """The rest of a plan at some path parameters: legs, and nodes along them to integrate over.

    `of_legs` holds the stage of each leg, `parameters` the parameters in force on it; computations there mean nothing.
    `ends` are those before the last leg's, in the order of their clearance. `choices` are lower ends and widths of the
    plan's `quality_sets`, shape (stages, parameters), 0 wide for none. `pieces` are the legs, those of laps that are
    alike together.
    """

    of_legs: tuple[Stage, ...]
    parameters: tuple[Vector, ...]
    nodes: tuple[Nodes, ...]
    ends: tuple[UncertainEnd, ...]
    choices: tuple[FloatArray, FloatArray]
    pieces: tuple[Leg | AlikeLaps, ...]

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """The legs with their places."""
        legs: list[Leg] = []
        for piece in self.pieces:
            legs += [piece] if isinstance(piece, Leg) else piece.legs()
        return tuple(legs)

    @property
    def first(self) -> Leg:
        """The first leg."""
        return self.pieces[0] if isinstance(self.pieces[0], Leg) else self.legs[0]

    @cached_property
    def _flat(self) -> tuple[Nodes, IntArray, IntArray]:
        """The nodes of all legs that differ, to which of these each belongs, and which each leg has: laps repeat."""
        index: dict[int, int] = {}
        order = np.array([index.setdefault(id(nodes), len(index)) for nodes in self.nodes])
        different = {id(nodes): nodes for nodes in self.nodes}.values()
        flat = Nodes(*(np.concatenate(arrays) for arrays in zip(*different, strict=True)))
        return flat, np.repeat(np.arange(len(different)), [len(nodes.weights_m) for nodes in different]), order

    @cached_property
    def _own_airspeeds(self) -> FloatArray | None:
        """Airspeed that the stage of each node of `_flat` commands [m/s], NaN for none; None where no stage does."""
        if all(stage.airspeed_mps is None for stage in self.of_legs):
            return None
        _, of_node, order = self._flat
        own = np.full(order.max() + 1, math.nan)
        own[order] = [stage.airspeed_mps or math.nan for stage in self.of_legs]
        return own[of_node]

    @cached_property
    def kinds(self) -> tuple[list[int], IntArray]:
        """The first leg of each stage with the same parameters in force, and which of them each leg is like."""
        index: dict[tuple[int, Vector], int] = {}
        keys = list(zip(self.shape, self.parameters, strict=True))
        order = np.array([index.setdefault(key, len(index)) for key in keys])
        return [keys.index(key) for key in index], order

    def times_s(self, airspeed_mps: float, wind_mps: Point) -> tuple[FloatArray, FloatArray]:
        """Time on each leg, and the time integral of tan² of the bank that it takes.

        Parameters
        ----------
        airspeed_mps : float
            Airspeed where a stage has none of its own [m/s].
        wind_mps : (float, float)
            Wind [m/s].

        Returns
        -------
        times, turning : array, shape (legs,)
            [s]; infinite where a leg cannot be flown in this wind.

        Source: ∫ ds/v over each leg, v from the wind triangle.
        """
        if not self.of_legs:
            return np.zeros(0), np.zeros(0)
        nodes, of_node, order = self._flat
        own = self._own_airspeeds
        speed = np.full(len(of_node), airspeed_mps) if own is None else np.where(np.isnan(own), airspeed_mps, own)
        return jitted(_times_s)(*nodes, of_node, order, speed, wind_mps)

    @cached_property
    def free(self) -> FloatArray:
        """1 where a parameter has a choice on a leg that depends on it, else 0, shape (parameters, legs)."""
        firsts, order = self.kinds
        return np.ascontiguousarray((self.choices[1][self.stages[firsts] - 1] > 0).astype(float)[order].T)

    @cached_property
    def shares(self) -> FloatArray:
        """Share of its set that each parameter has on each leg, shape (parameters, legs); 0 where it has no choice."""
        firsts, order = self.kinds
        low, width = (array[self.stages[firsts] - 1] for array in self.choices)
        above = np.array([self.parameters[i] for i in firsts]).reshape(low.shape) - low
        shares = np.divide(np.minimum(np.maximum(above, 0.0), width), width, out=np.zeros(low.shape), where=width > 0)
        return np.ascontiguousarray(shares[order].T)

    def after(self) -> Route:
        """The same without its first leg."""
        ends = tuple(end._replace(leg=end.leg - 1) for end in self.ends if end.leg)
        pieces = self.pieces[1:] if isinstance(self.pieces[0], Leg) else self.legs[1:]
        return Route(self.of_legs[1:], self.parameters[1:], self.nodes[1:], ends, self.choices, pieces)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Indices of its stages: routes of one shape lie on one step of the staircase."""
        return tuple([stage.index for stage in self.of_legs])

    @cached_property
    def stages(self) -> IntArray:
        """The stage of each leg, from 1, shape (legs,)."""
        return np.array(self.shape, dtype=np.intp)


class RoutePredictor:
    """Lays out what is left of one plan; legs that repeat from lap to lap are computed once."""

    def __init__(self) -> None:
        self._shapes: dict[object, _Shape] = {}
        self._laps: dict[object, _Lap | None] = {}
        self._choices: tuple[FloatArray, FloatArray] | None = None

    def route(self, cursor: PlanCursor, joined_m: Point, margin_m: float = 0.0, later: Vector | None = None) -> Route:
        """The rest of the plan from the start of the stage being flown.

        Parameters
        ----------
        cursor : PlanCursor
            The stage being flown.
        joined_m : (float, float)
            Where it was joined [m].
        margin_m : float
            By how much the end of the plan has to be passed to be certain [m]. Ends that are passed by less, or missed
            by less, are uncertain.
        later : tuple of float, optional
            Parameters decided as the first segment of laps ends, this one or the next.

        Raises
        ------
        PathUndefined
            If a path or trigger has no value, a trigger is not met, or the plan's end is not reached.
        """
        pieces: list[Leg | AlikeLaps] = []
        stages: list[Stage] = []
        values: list[Vector] = []
        nodes: list[Nodes] = []
        ends: list[UncertainEnd] = []
        plan, start = cursor.table.plan, joined_m
        if self._choices is None:
            self._choices = _choices(plan)
        following: PlanCursor | None = cursor
        while following is not None:
            cursor = following
            lap = self._lap(cursor, start) if cursor.repeats_alike else None
            if lap is not None:
                offsets, after = cursor.laps_before_end()
                if offsets:
                    pieces.append(AlikeLaps(lap, cursor.lap, offsets, start))
                    stages += lap.stages * len(offsets)
                    values += lap.parameters * len(offsets)
                    nodes += lap.nodes * len(offsets)
                    start, cursor = pieces[-1].end_m, after
            (ox, oy), stage = cursor.offset_m, cursor.stage
            shape = self._shape(cursor, (start[0] - ox, start[1] - oy))
            goal = (shape.end[0] + ox, shape.end[1] + oy)
            leg = Leg(cursor.lap, stage, shape.track, cursor.offset_m, start, goal, shape.length_m)
            stages.append(stage)
            values.append(cursor.parameters)
            end = cursor.end()
            if end is not None and not end.at_trigger:
                over_m = partial(first_beyond_m, leg, end.final_m, end.shift_m, plan.final_radius_m)
                certain_m = over_m(-margin_m)
                if certain_m is None and margin_m > 0:
                    # the stage ends where its trigger fires: the next one passes what lies beyond
                    clearance_m = _clearance_m(over_m, margin_m, leg.length_m - plan.radius_m(stage))
                    if clearance_m is not None and all(before.clearance_m < clearance_m for before in ends):
                        flown_m = over_m(max(0.0, -clearance_m))
                        assert flown_m is not None
                        ends.append(UncertainEnd(len(nodes), flown_m, clearance_m, leg.length_m))
                if certain_m is not None:
                    flown_m = over_m(0.0) if margin_m > 0 else certain_m
                    assert flown_m is not None
                    leg = leg._replace(flown_m=flown_m)
                    share = leg.distance_m / leg.length_m if leg.length_m else 1.0
                    pieces.append(leg)
                    nodes.append(leg.track.nodes((start[0] - ox, start[1] - oy), leg.distance_m, share))
                    break
            pieces.append(leg)
            nodes.append(shape.nodes)
            following, start = cursor.next(), goal
            if later is not None and cursor.repeats and (following is None or following.segment != cursor.segment):
                following, later = cursor.decide(later).next(), None
        return Route(tuple(stages), tuple(values), tuple(nodes), tuple(ends), self._choices, tuple(pieces))

    def _lap(self, cursor: PlanCursor, start: Point) -> _Lap | None:
        """A lap of those that are alike; None where its legs, or their parameters, are not the same in every lap."""
        (ox, oy), rho = cursor.offset_m, cursor.table.plan.path_count
        local = (start[0] - ox, start[1] - oy)
        key = (cursor.decided, _grid(local))
        if key not in self._laps:
            shapes, values, following, at = list[_Shape](), list[Vector](), cursor, local
            try:
                for _ in cursor.table.plan.stages:
                    here = following
                    shapes.append(self._shape(here, at))
                    values.append(here.parameters)
                    following = here.next() or here
                    (x, y), (ox, oy), (px, py) = shapes[-1].end, here.offset_m, following.offset_m
                    at = (x + ox - px, y + oy - py)
                alike = _grid(at) == key[1] and all(own[:rho] == values[0][:rho] for own in values)
            except PathUndefined:  # the plan may end before
                alike = False
            nodes = [shape.nodes for shape in shapes]
            self._laps[key] = _Lap([*cursor.table.plan.stages], shapes, values, nodes) if alike else None
        return self._laps[key]

    def _shape(self, cursor: PlanCursor, start: Point) -> _Shape:
        """A leg in the frame of lap 0."""
        stage, rho = cursor.stage, cursor.table.plan.path_count
        key = (stage.index, cursor.parameters[:rho], cursor.state, _grid(start))
        if key not in self._shapes:
            path, trigger = cursor.path(), cursor.local_trigger_m()
            track = stage.track(path, trigger)
            length_m = abs(track.ahead_m(start))
            if not math.isfinite(length_m):
                raise PathUndefined(f"the path of stage {stage.index} does not lead to its trigger")
            self._shapes[key] = _Shape(track, trigger, length_m, track.nodes(start, length_m, 1.0))
        return self._shapes[key]


def _choices(plan: Plan) -> tuple[FloatArray, FloatArray]:
    """Lower ends and widths of a plan's `quality_sets`, see `Route`."""
    sets = [own or (Box(0.0, 0.0),) * len(plan.names) for own in plan.quality_sets]
    shape = len(plan.stages), len(plan.names)
    low = np.array([[box.lo for box in own] for own in sets]).reshape(shape)
    return low, np.array([[box.hi for box in own] for own in sets]).reshape(shape) - low


def _clearance_m(over_m: Callable[[float], float | None], margin_m: float, length_m: float) -> float | None:
    """Greatest clearance within ±`margin_m` at which the plan ends on `length_m` of a leg [m], from below."""

    def ends(clearance_m: float) -> bool:
        flown_m = over_m(-clearance_m)
        return flown_m is not None and flown_m <= length_m

    low, high = -margin_m, margin_m
    if not ends(low):
        return None
    while high - low > CLEARANCE_STEP_M:
        middle = (low + high) / 2
        low, high = (middle, high) if ends(middle) else (low, middle)
    return low


def _grid(point: Point) -> tuple[int, int]:
    """A point's cell: points of one cell are the same."""
    return round(point[0] / SAME_POINT_M), round(point[1] / SAME_POINT_M)


class _Shape(NamedTuple):
    track: Track
    end: Point
    length_m: float
    nodes: Nodes


class _Lap(NamedTuple):
    """Legs of a lap, and the parameters in force on each."""

    stages: list[Stage]
    shapes: list[_Shape]
    parameters: list[Vector]
    nodes: list[Nodes]


class AlikeLaps(NamedTuple):
    """Laps that are alike but for their offsets [m], the number of the first, and where it starts [m]."""

    lap: _Lap
    number: int
    offsets_m: list[Point]
    start_m: Point

    @property
    def end_m(self) -> Point:
        """Where the last one ends [m]."""
        (x, y), (ox, oy) = self.lap.shapes[-1].end, self.offsets_m[-1]
        return x + ox, y + oy

    def legs(self) -> list[Leg]:
        """The legs with their places."""
        legs: list[Leg] = []
        start = self.start_m
        for number, offset in enumerate(self.offsets_m, self.number):
            for stage, shape in zip(self.lap.stages, self.lap.shapes, strict=True):
                end = (shape.end[0] + offset[0], shape.end[1] + offset[1])
                legs.append(Leg(number, stage, shape.track, offset, start, end, shape.length_m))
                start = end
        return legs


def _times_in_loops(
    weights_m: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    curvature_per_m: FloatArray,
    of_node: IntArray,
    order: IntArray,
    airspeed_mps: FloatArray,
    wind_mps: Point,
) -> tuple[FloatArray, FloatArray]:
    """`_times_s` for compiled code."""
    (wx, wy), count = wind_mps, of_node[-1] + 1
    times_s, turning_s = np.zeros(count), np.zeros(count)
    for i in range(len(of_node)):
        leg, s = of_node[i], airspeed_mps[i]
        cross = wx * sine[i] - wy * cosine[i]
        along = math.sqrt(max(s * s - cross * cross, 0.0))
        speed = wx * cosine[i] + wy * sine[i] + along if abs(cross) < s else 0.0
        if speed > 0.0:
            seconds = weights_m[i] / speed
            turn = curvature_per_m[i] * speed * speed / max(along, 1e-3 * s)
            times_s[leg] += seconds
            turning_s[leg] += seconds * (s * turn / GRAVITY_MPS2) ** 2
        else:
            times_s[leg] = math.inf
    return times_s[order], turning_s[order]


@in_loops(_times_in_loops)
def _times_s(
    weights_m: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    curvature_per_m: FloatArray,
    of_node: IntArray,
    order: IntArray,
    airspeed_mps: FloatArray,
    wind_mps: Point,
) -> tuple[FloatArray, FloatArray]:
    """`Route.times_s` by the nodes of the legs that differ."""
    speeds, along = ground_speeds_mps(cosine, sine, airspeed_mps, wind_mps)
    forward = speeds > 0.0
    seconds = weights_m / np.where(forward, speeds, 1.0)
    slopes = squared_bank_slopes(curvature_per_m, speeds, along, airspeed_mps)
    turning = np.bincount(of_node, np.where(forward, seconds * slopes, 0.0)).astype(np.float64)
    times_s = np.bincount(of_node, np.where(forward, seconds, np.inf)).astype(np.float64)
    return times_s[order], turning[order]
