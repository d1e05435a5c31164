"""The legs of a plan's routes in arrays: a leg that repeats from lap to lap is one row, and a route a list of rows."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.flight.wind import ground_speeds_mps, squared_bank_slopes
from eadp.core.geometry.tracks import Nodes
from eadp.models.plan.cursor import Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box, Stage

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
        self._sets = [[(box.lo, box.hi - box.lo) for box in own or no_sets] for own in plan.quality_sets]
        self._nodes: list[Nodes] = []
        self._numbers: dict[tuple[int, int, Vector], int] = {}
        self._contents: dict[object, int] = {}
        self._alike: list[int] = []
        none, nothing = np.zeros(0), np.zeros((0, len(plan.names)))
        zero = np.zeros(1, dtype=np.intp)
        self._rows = LegRows(Nodes(none, none, none, none), zero, none, none, zero[1:], nothing, none, np.zeros((0, 2)))

    def row(self, stage: Stage, parameters: Vector, nodes: Nodes) -> int:
        """The row of a leg; a new one for what is not in the table yet."""
        key = stage.index, id(nodes), parameters
        number = self._numbers.setdefault(key, len(self.stages))
        if number == len(self.stages):
            self.stages.append(stage)
            self.parameters.append(parameters)
            self._nodes.append(nodes)
        return number

    @property
    def rows(self) -> LegRows:
        """The arrays, with every row that is in the table now."""
        if len(self._rows.stages) < len(self.stages):
            old, new = self._rows, self._from(len(self._rows.stages))
            nodes = Nodes(*map(np.concatenate, zip(old.nodes, new.nodes, strict=True)))
            first = np.concatenate([old.first, old.first[-1] + new.first])
            self._rows = LegRows._make([nodes, first, *map(np.concatenate, zip(old[2:], new[2:], strict=True))])
        return self._rows

    @property
    def alike(self) -> IntArray:
        """For each row the first one on which an aircraft flies the same, shape (rows,): as that of an earlier lap of a
        mission."""
        known = len(self._alike)
        for stage, parameters, nodes in zip(
            self.stages[known:], self.parameters[known:], self._nodes[known:], strict=True
        ):
            flown = stage.gain, stage.rotation_deg, stage.radius_m, stage.altitude_m, stage.airspeed_mps
            key = stage.path, *flown, parameters, *(own.tobytes() for own in nodes)
            self._alike.append(self._contents.setdefault(key, len(self._alike)))
        return np.array(self._alike, dtype=np.intp)

    def _from(self, number: int) -> LegRows:
        """The rows from a number on; of each, `first` is where its nodes end among theirs."""
        stages, nodes, parameters = self.stages[number:], self._nodes[number:], self.parameters[number:]
        return LegRows(
            Nodes(*map(np.concatenate, zip(*nodes, strict=True))),
            np.cumsum([len(own.weights_m) for own in nodes], dtype=np.intp),
            np.array([stage.airspeed_mps or math.nan for stage in stages]),
            np.array([own.weights_m.sum() for own in nodes]),
            np.array([stage.index for stage in stages], dtype=np.intp),
            np.array([self._shares(stage, own) for stage, own in zip(stages, parameters, strict=True)]),
            np.array([np.abs(own.curvature_per_m).max() for own in nodes]),
            np.array([[_course_rad(own, 0), _course_rad(own, -1)] for own in nodes]),
        )

    def _shares(self, stage: Stage, parameters: Vector) -> list[float]:
        """The share of its set that each parameter has."""
        return [
            min(max((value - low) / width, 0.0), 1.0) if width > 0 else 0.0
            for (low, width), value in zip(self._sets[stage.index - 1], parameters, strict=True)
        ]


def _course_rad(nodes: Nodes, at: int) -> float:
    """The course at the start (0) or the end (-1) of a leg [rad]: the outer nodes have 0.4 of their weights beyond."""
    beyond_m = (NODE_SHARE if at else -NODE_SHARE) * nodes.weights_m[at]
    return float(np.arctan2(nodes.sine[at], nodes.cosine[at]) + beyond_m * nodes.curvature_per_m[at])


class TightLegs(NamedTuple):
    """Of each leg of routes: whether it bends tighter than the aircraft can turn, and whether the path has a corner
    at its start."""

    bends: BoolArray
    corners: BoolArray


def tight_legs(
    rows: LegRows, order: IntArray, first: IntArray, radius_m: float, airspeed_mps: float, wind_mps: float
) -> TightLegs:
    """Which legs an aircraft cannot follow.

    Parameters
    ----------
    rows, order
        As for `leg_times_s`.
    first : array of int, shape (routes,)
        First leg of each route.
    radius_m, airspeed_mps : float
        The aircraft's least radius of a turn without wind [m], at its airspeed [m/s].
    wind_mps : float
        Speed of the wind [m/s].

    Source: `eadp.models.performance.ground_radius_m`; a corner of θ that is turned at a radius r is overshot by
    r (1 − cos θ).
    """
    own = np.where(np.isnan(rows.airspeeds_mps), airspeed_mps, rows.airspeeds_mps)
    min_radius_m = radius_m * ((own + wind_mps) / airspeed_mps) ** 2
    bends = (rows.bends_per_m * min_radius_m > 1 - SAME_RADIUS)[order]
    corner_rad = np.zeros(len(order))
    corner_rad[1:] = rows.courses_rad[order[1:], 0] - rows.courses_rad[order[:-1], 1]
    corner_rad[first] = 0.0
    return TightLegs(bends, radius_m * (1 - np.cos(corner_rad)) > OVERSHOOT_M)


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
        pairs, of_leg = np.unique(np.stack((order, airspeed_mps)), axis=1, return_inverse=True)
        chosen, airspeed_mps = pairs[0].astype(np.intp), pairs[1]
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
