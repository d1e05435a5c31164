"""What is left of a plan: the legs still to be flown at any parameters, and their times in any wind.

The route follows the plan's own state machine lap by lap to its end, so the time that remains is the staircase of whole
laps, not a straight line between two constants.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.flight import ground_speeds_mps, squared_bank_slopes
from eadp.core.geometry.curves import Nodes, Point, Track
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import PlanCursor, PlanEnd, Vector, cursors
from eadp.models.plan.executor import signs
from eadp.models.plan.ground import FlownGround, lap_scale
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box, Leg, Stage, leg_points

NODE_SHARE = 0.4
"""Share of the weight of a leg's first node that lies before it: 0.39 to 0.42 of Gauss's nodes, 0.5 of a curve's."""
SAME_RADIUS = 1e-3
"""Share by which a turn of the least radius misses it for the rounding of coordinates."""
OVERSHOOT_M = 1.0
"""Overshoot of a corner that is followed as well as gusts allow [m]."""


class LegRows(NamedTuple):
    """Arrays of a `LegTable`.

    Attributes
    ----------
    nodes : Nodes
        Quadrature of all rows, one after the other.
    first : array of int, shape (rows + 1,)
        Where the nodes of each row begin, and of the last one end.
    airspeeds_mps : array, shape (rows,)
        Airspeed that the stage commands [m/s]; NaN for none.
    stages : array of int, shape (rows,)
        Stage of each row, from 1.
    shares : array, shape (rows, parameters)
        Share of its set that each parameter has; 0 where it has no choice.
    bends_per_m, courses_rad : array, shape (rows,) and (rows, 2)
        Greatest curvature [1/m], and the courses at both ends [rad].
    """

    nodes: Nodes
    first: IntArray
    airspeeds_mps: FloatArray
    lengths_m: FloatArray
    stages: IntArray
    shares: FloatArray
    bends_per_m: FloatArray
    courses_rad: FloatArray


class LegTable:
    """Rows of legs: a stage, the parameters in force on it, and nodes to integrate over.

    Rows stay: the routes of four hours of flight are some 8,000, of 150 bytes and more each.

    Parameters
    ----------
    plan : Plan

    Attributes
    ----------
    stages : list of Stage
        Stage of each row.
    parameters : list of tuple of float
        Parameters in force on each row; computations there mean nothing.
    """

    def __init__(self, plan: Plan) -> None:
        self.stages: list[Stage] = []
        self.parameters: list[Vector] = []
        no_sets = (Box(0.0, 0.0),) * len(plan.names)
        self._sets = [own or no_sets for own in plan.quality_sets]
        self._nodes: list[Nodes] = []
        none, nothing = np.zeros(0), np.zeros((0, len(plan.names)))
        zero = np.zeros(1, dtype=np.intp)
        self._rows = LegRows(Nodes(none, none, none, none), zero, none, none, zero[1:], nothing, none, np.zeros((0, 2)))

    def add(self, stage: Stage, parameters: Vector, nodes: Nodes) -> int:
        """Add the row of a leg; return its number."""
        self.stages.append(stage)
        self.parameters.append(parameters)
        self._nodes.append(nodes)
        return len(self.stages) - 1

    @property
    def rows(self) -> LegRows:
        """The arrays, with every row that is in the table now."""
        if len(self._rows.stages) < len(self.stages):
            old, new = self._rows, self._rows_from(len(self._rows.stages))
            nodes = Nodes(*map(np.concatenate, zip(old.nodes, new.nodes, strict=True)))
            first = np.concatenate([old.first, old.first[-1] + new.first[1:]])
            self._rows = LegRows._make([nodes, first, *map(np.concatenate, zip(old[2:], new[2:], strict=True))])
        return self._rows

    def _rows_from(self, number: int) -> LegRows:
        """The arrays of the rows from a number on."""
        stages, nodes, parameters = self.stages[number:], self._nodes[number:], self.parameters[number:]
        return LegRows(
            nodes=Nodes(*map(np.concatenate, zip(*nodes, strict=True))),
            first=np.cumsum([0, *(len(own.weights_m) for own in nodes)], dtype=np.intp),
            airspeeds_mps=np.array([stage.airspeed_mps or math.nan for stage in stages]),
            lengths_m=np.array([own.weights_m.sum() for own in nodes]),
            stages=np.array([stage.index for stage in stages], dtype=np.intp),
            shares=np.array([self._shares(stage, own) for stage, own in zip(stages, parameters, strict=True)]),
            bends_per_m=np.array([np.abs(own.curvature_per_m).max() for own in nodes]),
            courses_rad=np.array([[_course_rad(own, 0), _course_rad(own, -1)] for own in nodes]),
        )

    def _shares(self, stage: Stage, parameters: Vector) -> list[float]:
        """The share of its set that each parameter has."""
        sets = self._sets[stage.index - 1]
        return [box.share(value) or 0.0 for box, value in zip(sets, parameters, strict=True)]


def _course_rad(nodes: Nodes, at: int) -> float:
    """The course at the start (0) or the end (-1) of a leg [rad]: the outer nodes have 0.4 of their weights beyond."""
    beyond_m = (NODE_SHARE if at else -NODE_SHARE) * nodes.weights_m[at]
    return float(np.arctan2(nodes.sine[at], nodes.cosine[at]) + beyond_m * nodes.curvature_per_m[at])


def follows(route: Route, radius_m: float, airspeed_mps: float, wind_mps: float) -> bool:
    """Whether an aircraft can follow all of a route: nothing of it bends too tightly, and there is no corner.

    Parameters
    ----------
    route : Route
    radius_m, airspeed_mps : float
        The aircraft's least radius of a turn without wind [m], at its airspeed [m/s].
    wind_mps : float
        Speed of the wind [m/s].

    Source: `eadp.models.performance.ground_radius_m`; a corner of θ that is turned at a radius r is overshot by
    r (1 − cos θ).
    """
    rows, order = route.table.rows, route.order
    own = np.where(np.isnan(rows.airspeeds_mps), airspeed_mps, rows.airspeeds_mps)
    min_radius_m = radius_m * ((own + wind_mps) / airspeed_mps) ** 2
    bends = (rows.bends_per_m * min_radius_m)[order] > 1 - SAME_RADIUS
    corners_rad = rows.courses_rad[order[1:], 0] - rows.courses_rad[order[:-1], 1]
    return not bends.any() and not (radius_m * (1 - np.cos(corners_rad)) > OVERSHOOT_M).any()


def leg_times_s(
    rows: LegRows, order: IntArray, airspeed_mps: float | FloatArray, winds_mps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Time on each leg, infinite where it cannot be flown, and the time integral of tan² of its bank [s].

    Parameters
    ----------
    rows : LegRows
    order : array of int, shape (legs,)
        Row of each leg.
    airspeed_mps : float, or array of shape (legs,)
        Airspeed where a stage has none of its own [m/s].
    winds_mps : array, shape (winds, 2)
        [m/s].

    Returns
    -------
    times_s, turning_s : array, shape (winds, legs)

    Source: ∫ ds/v over each leg, v from the wind triangle.
    """
    if not len(order):
        return np.zeros((len(winds_mps), 0)), np.zeros((len(winds_mps), 0))
    if isinstance(airspeed_mps, float):
        chosen, of_leg = np.unique(order, return_inverse=True)
    else:  # legs of one row and one airspeed are alike
        speeds_mps, of_speed = np.unique(airspeed_mps, return_inverse=True)
        pairs, of_leg = np.unique(order * len(speeds_mps) + of_speed, return_inverse=True)
        chosen, airspeed_mps = pairs // len(speeds_mps), speeds_mps[pairs % len(speeds_mps)]
    first, counts = rows.first[chosen], rows.first[chosen + 1] - rows.first[chosen]
    ends = np.cumsum(counts)
    at = np.arange(int(ends[-1])) + np.repeat(first - ends + counts, counts)
    weights_m, cosine, sine, curvature_per_m = (array[at] for array in rows.nodes)
    own = rows.airspeeds_mps[chosen]
    airspeeds = np.repeat(np.where(np.isnan(own), airspeed_mps, own), counts)
    speeds, along = ground_speeds_mps(cosine, sine, airspeeds, (winds_mps[:, :1], winds_mps[:, 1:]))
    forward = speeds > 0.0
    seconds = np.where(forward, weights_m / np.where(forward, speeds, 1.0), np.inf)
    slopes = squared_bank_slopes(curvature_per_m, speeds, along, airspeeds)
    turning = np.where(forward, seconds, 0.0) * slopes
    starts = ends - counts
    times_s, turning_s = np.add.reduceat(seconds, starts, axis=1), np.add.reduceat(turning, starts, axis=1)
    return times_s[:, of_leg], turning_s[:, of_leg]


END_STEP_M = 1.0
"""Distance of the points at which the end of a plan is looked for [m]."""
ROUNDING_M = 1e-9
"""A line along the bound of the end is not beyond it by rounding [m]."""

SAME_POINT_M = 1e-6
MARGIN_M = 1.0
"""Clearance of the end beyond which a lap is certainly the last, at least [m]."""


class PlannedLegs(NamedTuple):
    """Legs to fly, in order.

    Attributes
    ----------
    legs : tuple of Leg
    parameters : tuple of tuple of float
        In force on each leg; computations there mean nothing.
    started : int
        Number of stages started over the whole flight with the first of them, itself included.
    """

    legs: tuple[Leg, ...]
    parameters: tuple[Vector, ...]
    started: int = 1

    def after(self, count: int) -> PlannedLegs:
        """The same without the first legs."""
        return PlannedLegs(self.legs[count:], self.parameters[count:], self.started + count)


@dataclass(frozen=True)
class Route:
    """The rest of a plan at some path parameters.

    Attributes
    ----------
    table : LegTable
    order : array of int, shape (legs,)
        Row of each leg in the table.
    legs : tuple of Leg
    runs : array of int, shape (legs,)
        The lap, or run of stages outside laps, that each leg belongs to, from 0.
    scales : array, shape (runs,)
        Ground per metre of each, see `eadp.models.plan.ground.lap_scale`.
    beyond_m : float
        Length of the last lap beyond the end of the plan [m]: its strip is as long as any other.
    cursor : PlanCursor
        The plan's position at its start.
    """

    table: LegTable
    order: IntArray
    legs: tuple[Leg, ...]
    runs: IntArray
    scales: FloatArray
    beyond_m: float
    cursor: PlanCursor

    @cached_property
    def of_legs(self) -> tuple[Stage, ...]:
        """The stage of each leg."""
        return tuple([leg.stage for leg in self.legs])

    @cached_property
    def parameters(self) -> tuple[Vector, ...]:
        """Parameters in force on each leg; computations there mean nothing."""
        parameters = self.table.parameters
        return tuple([parameters[row] for row in self.order.tolist()])

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
        times_s, turning_s = leg_times_s(self.table.rows, self.order, airspeed_mps, np.array([wind_mps]))
        return times_s[0], turning_s[0]

    def planned(self) -> PlannedLegs:
        """The legs to fly, from the start of the flight."""
        return PlannedLegs(self.legs, self.parameters)

    @property
    def stages(self) -> IntArray:
        """The stage of each leg, from 1, shape (legs,)."""
        return self.table.rows.stages[self.order]


class RoutePredictor:
    """Lays out what is left of one plan; legs that repeat from lap to lap are computed once."""

    def __init__(self) -> None:
        self._shapes: dict[object, _Shape] = {}
        self._table: LegTable | None = None

    def route(self, cursor: PlanCursor, joined_m: Point, margin_m: float = 0.0) -> Route:
        """The rest of the plan from the start of the stage being flown.

        Parameters
        ----------
        cursor : PlanCursor
            The stage being flown.
        joined_m : (float, float)
            Where it was joined [m].
        margin_m : float
            By how much the end of the plan has to be passed to be one [m]: an aircraft may miss one that is passed by
            less.

        Raises
        ------
        PathUndefined
            If a path or trigger has no value, a trigger is not met, or the plan's end is not reached.
        """
        flown, start = list[tuple[PlanCursor, Leg, int]](), joined_m
        end: PlanEnd | None = None
        of_lap: object = None
        for here in cursors(cursor):
            leg, row = self._leg(here, start)
            if (here.lap, here.parameters) != of_lap:
                end, of_lap = here.end(), (here.lap, here.parameters)
            if end is not None and not end.at_trigger:
                flown_m = flown_to_end_m(leg, end, here.table.plan.final_radius_m, margin_m)
                if flown_m is not None:
                    cut = leg._replace(flown_m=flown_m)
                    nodes = cut.track.nodes(cut.local_m(cut.start_m), cut.distance_m, cut.flown_share)
                    flown.append((here, cut, self._rows(here).add(cut.stage, here.parameters, nodes)))
                    return self._route(flown, cut.length_m - cut.distance_m + self._rest_m(here, leg.end_m))
            flown.append((here, leg, row))
            start = leg.end_m
        return self._route(flown)

    def _rows(self, cursor: PlanCursor) -> LegTable:
        """The table of the plan's legs."""
        self._table = self._table or LegTable(cursor.table.plan)
        return self._table

    def _route(self, flown: Sequence[tuple[PlanCursor, Leg, int]], beyond_m: float = 0.0) -> Route:
        """The route of legs with their places in the plan and rows; see its `beyond_m`."""
        of_legs, legs, rows = zip(*flown, strict=True)
        places = [(cursor.segment, cursor.lap) for cursor in of_legs]
        ended = [place != after for place, after in itertools.pairwise([*places, None])]
        runs = np.cumsum([False, *ended[:-1]])
        # what shifts the next lap is known where a lap is complete
        last = [cursor for cursor, over in zip(of_legs, ended, strict=True) if over]
        scales = [lap_scale(cursor, last=i == len(last)) for i, cursor in enumerate(last, 1)]
        table, order = self._rows(of_legs[0]), np.array(rows, dtype=np.intp)
        return Route(table, order, legs, runs, np.array(scales), beyond_m, of_legs[0])

    def leg(self, cursor: PlanCursor, joined_m: Point) -> Route:
        """The whole of a stage alone, from where it is joined.

        Raises
        ------
        PathUndefined
            As `route`.
        """
        return self._route([(cursor, *self._leg(cursor, joined_m))])

    def length_m(self, cursor: PlanCursor, joined_m: Point) -> float:
        """Length of the whole of a stage, from where it is joined [m]; raises PathUndefined as `route`."""
        return self._leg(cursor, joined_m)[0].length_m

    def _rest_m(self, cursor: PlanCursor, start: Point) -> float:
        """Length of the stages of a lap after this one [m]."""
        total_m, following = 0.0, cursor.next()
        while following is not None and (following.segment, following.lap) == (cursor.segment, cursor.lap):
            leg, _ = self._leg(following, start)
            total_m, start, following = total_m + leg.length_m, leg.end_m, following.next()
        return total_m

    def _leg(self, cursor: PlanCursor, start: Point) -> tuple[Leg, int]:
        """The leg of a stage from where it is joined, and its row."""
        (ox, oy), stage = cursor.offset_m, cursor.stage
        shape = self._shape(cursor, (start[0] - ox, start[1] - oy))
        goal = (shape.end[0] + ox, shape.end[1] + oy)
        leg = Leg(cursor.lap, stage, shape.track, cursor.offset_m, start, goal, shape.length_m)
        return leg, shape.row

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
            row = self._rows(cursor).add(stage, cursor.parameters, track.nodes(start, length_m, 1.0))
            self._shapes[key] = _Shape(track, trigger, length_m, row)
        return self._shapes[key]


def flown_to_end_m(leg: Leg, end: PlanEnd, radius_m: float, margin_m: float) -> float | None:
    """The distance flown along a leg on which the plan ends [m]; None where it does not end on it.

    Parameters
    ----------
    leg : Leg
    end : PlanEnd
    radius_m : float
        Radius across the shift [m].
    margin_m : float
        By how much the end has to be passed to be one [m].
    """
    sides = signs(end.shift_m)
    if not margin_m < _max_beyond_m(leg, end.final_m, sides) < math.inf:
        return None
    points = leg_points(leg._replace(flown_m=math.inf), END_STEP_M)
    # how far each point is beyond the end along the shift, and within the radius across it
    away_m, along = points[:, :2] - end.final_m, np.array(sides) != 0
    beyond_m = np.where(along, sides * away_m, math.inf).min(axis=1)
    inside_m = np.where(along, math.inf, radius_m - np.abs(away_m)).min(axis=1)
    if not (np.minimum(beyond_m - margin_m, inside_m) > ROUNDING_M).any():
        return None
    # it ends where it is beyond the end first, whatever the margin
    over_m = np.minimum(beyond_m, inside_m)
    i = int(np.argmax(over_m > ROUNDING_M))
    at_m = np.arange(len(points)) * (leg.length_m / (len(points) - 1))
    return float(np.interp(0.0, over_m[i - 1 : i + 1], at_m[i - 1 : i + 1])) if i else 0.0


def _max_beyond_m(leg: Leg, final_m: Point, sides: Point) -> float:
    """A distance beyond the end that no point of a leg exceeds [m]; 0 where there is no shift."""
    # the way from the start to a point, and on to the end, is the leg's length
    ways = [each for each in zip(sides, leg.start_m, leg.end_m, final_m, strict=True) if each[0]]
    return min([(leg.length_m + side * (a - to) + side * (b - to)) / 2 for side, a, b, to in ways], default=0.0)


def _grid(point: Point) -> tuple[int, int]:
    """A point's cell: points of one cell are the same."""
    return round(point[0] / SAME_POINT_M), round(point[1] / SAME_POINT_M)


class _Shape(NamedTuple):
    track: Track
    end: Point
    length_m: float
    row: int


class RouteArrays(NamedTuple):
    """Routes of one plan from one place, at different parameters.

    Attributes
    ----------
    rows : LegRows
        Rows of the plan's table of legs.
    order, place : array of int, shape (legs,)
        Row of each leg, and the route that it belongs to.
    first, last : array of int, shape (routes,)
        First and last leg of each route.
    run : array of int, shape (legs,)
        Lap, or run of stages outside laps, of each leg: numbered over all routes.
    first_run : array of int, shape (routes,)
        The run that is being flown.
    scales, beyond_m : array, shape (runs,)
        Ground per metre of each run, and its length beyond the end of the plan [m].
    """

    rows: LegRows
    order: IntArray
    place: IntArray
    first: IntArray
    last: IntArray
    run: IntArray
    first_run: IntArray
    scales: FloatArray
    beyond_m: FloatArray

    @classmethod
    def of(cls, routes: Sequence[Route]) -> RouteArrays:
        """One or more routes, each of one leg or more, with a common table."""
        counts = np.array([len(route.order) for route in routes])
        runs = np.array([len(route.scales) for route in routes])
        after, runs_after = counts.cumsum(), runs.cumsum()
        first_run = runs_after - runs
        beyond_m = np.zeros(int(runs_after[-1]))
        beyond_m[runs_after - 1] = [route.beyond_m for route in routes]
        order = np.concatenate([route.order for route in routes])
        run = np.concatenate([route.runs for route in routes])
        scales = np.concatenate([route.scales for route in routes])
        place = np.repeat(np.arange(len(routes)), counts)
        rows = routes[0].table.rows
        return cls(rows, order, place, after - counts, after - 1, run + first_run[place], first_run, scales, beyond_m)

    @property
    def stages(self) -> IntArray:
        """Stage of each leg, from 1, shape (legs,)."""
        return self.rows.stages[self.order]

    def sums(self, values: FloatArray) -> FloatArray:
        """Sums of values of legs, shape (legs,) or (legs, k), over each route: shape (routes,) or (routes, k)."""
        total: FloatArray = np.add.reduceat(values, self.first, axis=0)
        return total

    def running(self, values: FloatArray) -> FloatArray:
        """Sums of values of legs up to each leg within its route, that leg included, shape (legs,)."""
        total = np.cumsum(values)
        before = np.concatenate(([0.0], total[self.last[:-1]]))
        running: FloatArray = total - before[self.place]
        return running

    def ground(self, flown: FlownGround, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ground of each leg that is left, and of each second flown in the run being flown.

        Parameters
        ----------
        flown : FlownGround
        times_s : array, shape (legs,)
            Time left on each leg [s].

        Returns
        -------
        ground : array, shape (legs,)
            [m]; see `eadp.models.plan.ground`.
        flown_per_s : array, shape (routes,)
            Ground of a second with a choice, of the run that each route is in [m/s].
        """
        flying = np.zeros(len(self.scales))
        flying[self.first_run] = 1.0
        of_legs_m = np.bincount(self.run, self.rows.lengths_m[self.order], len(self.scales))
        lengths_m = of_legs_m + self.beyond_m + flying * flown.run.flown_m
        seconds = np.bincount(self.run, times_s, len(self.scales)) + flying * flown.run.flown_s
        per_s = self.scales * lengths_m / np.maximum(seconds, 1e-9)
        return per_s[self.run] * times_s, per_s[self.first_run]
