"""The figure of a plan: its nominal path, triggers, and the range of its path parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import LINE
from eadp.errors import PathUndefined
from eadp.io.figures.canvas import (
    COLOURS,
    START,
    Axes,
    draw_areas,
    draw_arrow,
    draw_circles,
    draw_ground,
    figure_file,
    label_map,
    legend_below,
    span_text,
    stage_style,
)
from eadp.models.plan.legs import Leg, leg_points
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import point_at
from eadp.models.plan.trace import nominal_legs, varied_legs

VALUES = 5
"""Values across the sets of the path parameters between which the range is filled."""

CORNERS = 24
"""Parts of a leg, if it is no line, that bounds the range."""

MIN_STEP_M = 1e-3

NAMED = 12
"""Most stages whose names are written beside their paths."""


def write_plan_figure(path: str, plan: Plan, parameters: Sequence[float]) -> None:
    """Draw a plan: lines and turns with their direction, triggers with their radius, the range of the parameters.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the file cannot be written.
    PathUndefined
        If the plan has no nominal path at these parameters.
    """
    plan = plan.laps()
    legs = nominal_legs(plan, parameters)
    scale = max(math.dist(leg.start_m, leg.end_m) for leg in legs)
    step = max(scale / 100, 0.1)
    with figure_file(path, 8.5, 7.5, formulas=True) as figure:
        axes = figure.add_subplot()
        _draw_range(axes, plan, parameters)
        draw_ground(axes, None, plan.site.airspace)
        _draw_legs(axes, plan, legs, step, scale / 50)
        ends = [leg.end_m for leg in legs]
        radii = [plan.radius_m(leg.stage) for leg in legs]
        first = [i for i, leg in enumerate(legs) if leg.lap == 0 and legs[0].lap == 0] or range(len(legs))
        draw_circles(axes, [ends[i] for i in first], [radii[i] for i in first])
        _draw_bounds(axes, plan, parameters)
        label = f"trigger, radius {span_text(radii)} m"
        axes.plot(*zip(*ends, strict=True), "x", color="#444", markersize=4, linewidth=0, label=label)
        axes.plot(*legs[0].start_m, **START)
        final = point_at(plan.final_point, parameters, "the final point")
        axes.plot(*final, "*", color="black", markersize=11, label="final point")
        _name_stages(axes, plan, legs)
        label_map(axes, _title(plan, parameters, sum(leg.distance_m for leg in legs)))
        legend_below(axes)


def _title(plan: Plan, parameters: Sequence[float], length_m: float) -> str:
    values = enumerate(parameters[: plan.path_count], 1)
    at = ", ".join(f"$c_{{i,{i}}}$ = {value:g}" for i, value in values)
    return f"Nominal path, {length_m / 1000:.2f} km" + (f", at {at}" if at else "")


def _draw_legs(axes: Axes, plan: Plan, legs: Sequence[Leg], step: float, arrow: float) -> None:
    """Each leg in the colour of its stage, with an arrow of that length at its middle."""
    for leg in legs:
        points = list(leg_points(leg, step))
        index = leg.stage.index
        colour, label = stage_style(plan.stages, index)
        if len(plan.stages) <= len(COLOURS):
            label = f"$\\Gamma_{{{index}}}$: $\\varphi_{{{index}}}$, {leg.stage.kind}"
        axes.plot([p.x_m for p in points], [p.y_m for p in points], color=colour, linewidth=1.4, label=label)
        middle = points[len(points) // 2]
        dx, dy = arrow * math.cos(middle.heading_rad), arrow * math.sin(middle.heading_rad)
        draw_arrow(axes, (middle.x_m, middle.y_m), (middle.x_m + dx, middle.y_m + dy), colour)


def _draw_range(axes: Axes, plan: Plan, parameters: Sequence[float]) -> None:
    """In grey, between the paths at values across their sets, where each lap of the nominal path lies."""
    if not plan.has_sets or all(plan.hull(i).fixed for i in range(plan.path_count)):
        return
    boxes = [plan.hull(i) for i in range(plan.path_count)]
    rest = parameters[plan.path_count :]
    before: list[FloatArray] = []
    strips: list[FloatArray] = []
    for share in np.linspace(0.0, 1.0, VALUES).tolist():
        values = [*(box.lo + share * (box.hi - box.lo) for box in boxes), *rest]
        try:
            laps = varied_legs(plan, parameters, values)
        except PathUndefined:
            before = []
            continue
        paths = [_points(leg, leg.length_m / (1 if leg.stage.kind == LINE else CORNERS)) for lap in laps for leg in lap]
        strips += [np.concatenate([first, last[::-1]]) for first, last in zip(before, paths, strict=False)]
        before = paths
    if strips:
        label = "range of the path parameters, lap by lap"
        draw_areas(axes, strips, color="#c9ced6", alpha=0.45, linewidth=0, zorder=0, label=label)


def _draw_bounds(axes: Axes, plan: Plan, parameters: Sequence[float]) -> None:
    """The second lap, which the parameters move, at both ends c̲ and c̄ of the path parameters' sets, dashed."""
    rho = plan.path_count
    if not plan.has_sets or all(plan.hull(i).fixed for i in range(rho)):
        return
    for end, name, dashes in (("lo", "underline", (2, 2)), ("hi", "overline", (6, 3))):
        values = [getattr(plan.hull(i), end) for i in range(rho)]
        try:
            laps = list(varied_legs(plan, parameters, [*values, *parameters[rho:]]))
        except PathUndefined:
            continue
        lap = laps[min(1, len(laps) - 1)]
        path = np.concatenate([_points(leg, leg.length_m / (1 if leg.stage.kind == LINE else CORNERS)) for leg in lap])
        at = ", ".join(f"$\\{name}{{c}}_{{i,{i}}}$ = {value:g}" for i, value in enumerate(values, 1))
        axes.plot(
            *path.T,
            color="black",
            linewidth=1.0,
            dashes=dashes,
            zorder=5,
            label=f"second lap at {at}" if len(laps) > 1 else at,
        )


def _points(leg: Leg, step_m: float) -> FloatArray:
    """Points along a leg [m], shape (n, 2)."""
    return np.array([(point.x_m, point.y_m) for point in leg_points(leg, max(step_m, MIN_STEP_M))])


def _name_stages(axes: Axes, plan: Plan, legs: Sequence[Leg]) -> None:
    """φ_i on the paths, and p_Γi at the triggers, of the first lap, but for short stages."""
    style: dict[str, Any] = {"fontsize": 9, "textcoords": "offset points", "zorder": 6}
    back = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}
    named_m = max(leg.distance_m for leg in legs) / 10
    for leg in [leg for leg in legs if leg.lap == 0 and leg.distance_m > named_m][:NAMED]:
        middle = _points(leg, leg.distance_m / 2)[1]
        colour, _ = stage_style(plan.stages, leg.stage.index)
        name = f"$\\varphi_{{{leg.stage.index}}}$"
        axes.annotate(name, middle, xytext=(7, 7), color=colour, bbox=back, **style)
        axes.annotate(f"$p_{{\\Gamma_{{{leg.stage.index}}}}}$", leg.end_m, xytext=(-20, 3), color="#444", **style)
