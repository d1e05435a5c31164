"""Ground that a flight covers, where its plan knows its field."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from eadp.core.geometry.curves import LINE, Point
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import TRIGGER_DISTANCE
from eadp.models.plan.trace import nominal_legs

PARTS = 100
"""Number of times at which the ground covered so far is computed."""

MAX_INTERVAL_S = 2.0
"""Longest interval of a log from which it can be computed [s]."""

Line = tuple[Point, ...]


def covering_stages(plan: Plan) -> list[bool]:
    """Whether each stage covers ground: lines, as turns are banked; with a camera, those on which it is on."""
    switches = [[c[1] > 0 for c in stage.commands if c[0] == TRIGGER_DISTANCE] for stage in plan.stages]
    on, found = not any(switches), []
    for stage, states in zip(plan.stages, switches, strict=True):
        on = states[-1] if states else on
        found.append(on and stage.kind == LINE)
    return found


def planned_lines(plan: Plan, parameters: Sequence[float]) -> list[Line]:
    """The lines of a plan that cover ground. Raises PathUndefined."""
    covers = covering_stages(plan)
    legs = (leg for leg in nominal_legs(plan, parameters) if leg.stage.kind == LINE)
    return [(leg.start_m, leg.end_m) for leg in legs if covers[leg.stage.index - 1]]


def flown_lines(plan: Plan, columns: Mapping[str, Sequence[float]]) -> list[Line]:
    """The paths flown on stages that cover ground; `columns` are those of `flight.csv`."""
    stages = np.array(columns["stage"], dtype=int)
    on_line = np.array(covering_stages(plan))[stages - 1]
    ends = [0, *(np.flatnonzero(np.diff(stages)) + 1).tolist(), len(stages)]
    x, y = columns["x_m"], columns["y_m"]
    # to the first sample of the next stage, which starts between the two
    return [tuple(zip(x[a : b + 1], y[a : b + 1], strict=True)) for a, b in itertools.pairwise(ends) if on_line[a]]


def flown_of_plan(columns: Mapping[str, Sequence[float]], turned_back_s: float | None) -> Mapping[str, Sequence[float]]:
    """The columns of `flight.csv` up to where the flight turned back for home [s], if it did."""
    if turned_back_s is None:
        return columns
    end = bisect.bisect_right(columns["time_s"], turned_back_s)
    return {name: values[:end] for name, values in columns.items()}


def flown_coverage(
    plan: Plan, columns: Mapping[str, Sequence[float]], parts: int = PARTS
) -> tuple[list[float], list[float]] | None:
    """Times [s] and the share of the plan's field that is covered by then.

    None where the plan has no field or no swath, or the log is too coarse.
    """
    times = columns["time_s"]
    if plan.site.field is None or plan.site.swath_m is None or len(times) < 2:
        return None
    if max(np.diff(times)) > MAX_INTERVAL_S:
        return None
    from eadp.core.geometry.polygons import covered_shares

    ends = np.unique(np.linspace(0, len(times) - 1, parts + 1).astype(int)).tolist()
    starts = [0, *(np.flatnonzero(np.diff(columns["stage"])) + 1).tolist()]
    tracks = []
    for a, b in itertools.pairwise(ends):
        first = starts[bisect.bisect_right(starts, a) - 1]  # a line is one piece: its parts would not join in a bend
        tracks.append(flown_lines(plan, {name: columns[name][first : b + 1] for name in ("stage", "x_m", "y_m")}))
    shares = covered_shares(plan.site.field.parts, tracks, plan.site.swath_m)
    return [times[i] for i in ends], shares
