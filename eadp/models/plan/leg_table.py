"""The legs of a plan's routes in arrays: a leg that repeats from lap to lap is one row, and a route a list of rows."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeVar

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.flight.wind import ground_speeds_mps, squared_bank_slopes
from eadp.core.geometry.tracks import Nodes
from eadp.models.plan.cursor import Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box, Stage

A = TypeVar("A", FloatArray, IntArray)


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
    free : array, shape (rows, parameters)
        1 where a parameter has a choice on a leg that depends on it, else 0.
    shares : array, shape (rows, parameters)
        Share of its set that each parameter has; 0 where it has no choice.
    """

    nodes: Nodes
    first: IntArray
    airspeeds_mps: FloatArray
    lengths_m: FloatArray
    stages: IntArray
    free: FloatArray
    shares: FloatArray


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
        self._free = [[float(width > 0) for _, width in own] for own in self._sets]
        self._nodes: list[Nodes] = []
        self._numbers: dict[tuple[int, int, Vector], int] = {}
        self._filled = 0
        none, nothing = np.zeros(0), np.zeros((0, len(plan.names)))
        zero = np.zeros(1, dtype=np.intp)
        self._rows = LegRows(Nodes(none, none, none, none), zero, none, none, zero[1:], nothing, nothing)

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
        """The arrays, with every row that is in the table now; some behind them are of no row."""
        if self._filled < len(self.stages):
            self._fill()
        return self._rows

    def _fill(self) -> None:
        """Write the new rows to the arrays."""
        old, known, count = self._rows, self._filled, len(self.stages)
        used = int(old.first[known])
        last = used + sum([len(nodes.weights_m) for nodes in self._nodes[known:]])
        if len(old.nodes.weights_m) >= last and len(old.first) > count and len(old.stages) >= count:
            rows = old
        else:
            rows = self._grown(known, count, used, last)
        for number in range(known, count):
            stage, nodes = self.stages[number], self._nodes[number]
            last = used + len(nodes.weights_m)
            for array, values in zip(rows.nodes, nodes, strict=True):
                array[used:last] = values
            rows.first[number + 1] = used = last
            rows.airspeeds_mps[number] = stage.airspeed_mps or math.nan
            rows.lengths_m[number] = nodes.weights_m.sum()
            rows.stages[number] = stage.index
            sets, own = self._sets[stage.index - 1], self.parameters[number]
            rows.free[number] = self._free[stage.index - 1]
            rows.shares[number] = [
                min(max((value - low) / width, 0.0), 1.0) if width > 0 else 0.0
                for (low, width), value in zip(sets, own, strict=True)
            ]
        self._rows, self._filled = rows, count

    def _grown(self, known: int, count: int, used: int, last: int) -> LegRows:
        """The arrays with room for `count` rows and `last` nodes, of which `known` and `used` are as they are."""
        old = self._rows
        return LegRows(
            Nodes(*(grown(array, used, last) for array in old.nodes)),
            grown(old.first, known + 1, count + 1),
            grown(old.airspeeds_mps, known, count),
            grown(old.lengths_m, known, count),
            grown(old.stages, known, count),
            grown(old.free, known, count),
            grown(old.shares, known, count),
        )


def grown(array: A, used: int, needed: int) -> A:
    """An array with room for `needed` rows, the first `used` of them as they are."""
    if len(array) >= needed:
        return array
    grown = np.zeros((2 * needed, *array.shape[1:]), dtype=array.dtype)
    grown[:used] = array[:used]
    return grown


def leg_times_s(
    rows: LegRows, order: IntArray, airspeed_mps: float, winds_mps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Time on each leg, infinite where it cannot be flown, and the time integral of tan² of its bank [s].

    Parameters
    ----------
    rows : LegRows
    order : array of int, shape (legs,)
        Row of each leg.
    airspeed_mps : float
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
    chosen, of_leg = np.unique(order, return_inverse=True)
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
