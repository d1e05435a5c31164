"""The figure of a plan: its nominal path, triggers, and the range of its path parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eadp.errors import PathUndefined
from eadp.io.figures.canvas import COLOURS, Axes, draw_arrow, draw_circles, figure_file, label_map, legend_below
from eadp.models.plan.legs import Leg, leg_points
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import point_at
from eadp.models.plan.trace import nominal_legs


def write_plan_figure(path: str, plan: Plan, parameters: Sequence[float]) -> None:
    """Draw a plan: lines and turns with their direction, triggers with their radius, the range of the parameters.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the file cannot be written.
    PathUndefined
        If the plan has no nominal path at these parameters.
    """
    legs = nominal_legs(plan, parameters)
    scale = max(math.dist(leg.start_m, leg.end_m) for leg in legs)
    step = max(scale / 100, 0.1)
    with figure_file(path, 8.5, 7.5) as figure:
        axes = figure.add_subplot()
        _draw_range(axes, plan, parameters, step)
        _draw_legs(axes, legs, step, scale / 50, named=len(plan.stages) <= len(COLOURS))
        ends = [leg.end_m for leg in legs]
        radii = [plan.radius_m(leg.stage) for leg in legs]
        draw_circles(axes, ends, radii)
        label = f"trigger, radius {' to '.join(f'{r:g}' for r in sorted({min(radii), max(radii)}))} m"
        axes.plot(*zip(*ends, strict=True), "x", color="#444", markersize=4, linewidth=0, label=label)
        axes.plot(*legs[0].start_m, "o", color="black", markersize=5, label="start")
        final = point_at(plan.final_point, parameters, "the final point")
        axes.plot(*final, "*", color="black", markersize=11, label="final point")
        label_map(axes, _title(plan, parameters, sum(leg.distance_m for leg in legs)))
        legend_below(axes)


def _title(plan: Plan, parameters: Sequence[float], length_m: float) -> str:
    values = zip(plan.names[: plan.path_count], parameters, strict=False)
    at = ", ".join(f"{name} = {value:g}" for name, value in values)
    return f"Nominal path, {length_m / 1000:.2f} km" + (f", at {at}" if at else "")


def _draw_legs(axes: Axes, legs: Sequence[Leg], step: float, arrow: float, *, named: bool) -> None:
    """Each leg in the colour of its stage, with an arrow of that length at its middle."""
    seen = set()
    for leg in legs:
        points = list(leg_points(leg, step))
        index = leg.stage.index
        colour = COLOURS[(index - 1) % len(COLOURS)]
        label = f"stage {index} ({leg.stage.kind})" if named and index not in seen else None
        seen.add(index)
        axes.plot([p.x_m for p in points], [p.y_m for p in points], color=colour, linewidth=1.4, label=label)
        middle = points[len(points) // 2]
        dx, dy = arrow * math.cos(middle.heading_rad), arrow * math.sin(middle.heading_rad)
        draw_arrow(axes, (middle.x_m, middle.y_m), (middle.x_m + dx, middle.y_m + dy), colour)


def _draw_range(axes: Axes, plan: Plan, parameters: Sequence[float], step: float) -> None:
    """In grey, first laps at parameters across their sets: the area of the letter's Fig. 2."""
    if not plan.has_sets or not plan.path_count:
        return
    boxes = [plan.hull(i) for i in range(plan.path_count)]
    label: str | None = "range of the parameters, first lap"
    for share in np.linspace(0.0, 1.0, 25).tolist():
        values = [*(box.lo + share * (box.hi - box.lo) for box in boxes), *parameters[plan.path_count :]]
        try:
            legs = nominal_legs(plan, values)
        except PathUndefined:
            continue
        shown = [leg for leg in legs if leg.lap == 0][: 2 * len(COLOURS)]
        points = [point for leg in shown for point in leg_points(leg, step)]
        x, y = [p.x_m for p in points], [p.y_m for p in points]
        axes.plot(x, y, color="#d9dce1", linewidth=3.0, label=label, zorder=0)
        label = None
