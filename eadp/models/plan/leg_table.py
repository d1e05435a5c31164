"""The legs of a plan's routes in arrays: a leg that repeats from lap to lap is one row, and a route a list of rows."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.flight.wind import ground_speeds_mps, squared_bank_slopes
from eadp.core.geometry.tracks import Nodes
from eadp.models.plan.cursor import Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box, Stage


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
        """The arrays, with every row that is in the table now."""
        if len(self._rows.stages) < len(self.stages):
            old, new = self._rows, self._from(len(self._rows.stages))
            nodes = Nodes(*map(np.concatenate, zip(old.nodes, new.nodes, strict=True)))
            first = np.concatenate([old.first, old.first[-1] + new.first])
            self._rows = LegRows._make([nodes, first, *map(np.concatenate, zip(old[2:], new[2:], strict=True))])
        return self._rows

    def _from(self, number: int) -> LegRows:
        """The rows from a number on; of each, `first` is where its nodes end among theirs."""
        stages, nodes, parameters = self.stages[number:], self._nodes[number:], self.parameters[number:]
        return LegRows(
            Nodes(*map(np.concatenate, zip(*nodes, strict=True))),
            np.cumsum([len(own.weights_m) for own in nodes], dtype=np.intp),
            np.array([stage.airspeed_mps or math.nan for stage in stages]),
            np.array([own.weights_m.sum() for own in nodes]),
            np.array([stage.index for stage in stages], dtype=np.intp),
            np.array([self._free[stage.index - 1] for stage in stages]),
            np.array([self._shares(stage, own) for stage, own in zip(stages, parameters, strict=True)]),
        )

    def _shares(self, stage: Stage, parameters: Vector) -> list[float]:
        """The share of its set that each parameter has."""
        return [
            min(max((value - low) / width, 0.0), 1.0) if width > 0 else 0.0
            for (low, width), value in zip(self._sets[stage.index - 1], parameters, strict=True)
        ]


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
