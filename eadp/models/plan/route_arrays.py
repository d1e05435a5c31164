"""Several routes at once: their legs one after the other in flat arrays, and sums over the legs of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.models.plan.ground import FlownGround
from eadp.models.plan.leg_table import LegRows
from eadp.models.plan.route import Route


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
        order, run, scales = (
            np.concatenate(arrays)
            for arrays in zip(*((route.order, route.runs, route.scales) for route in routes), strict=True)
        )
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
