"""The figures of a plan and of a flight: path, triggers, ranges; power and its forecast, charge, parameters."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import LINE
from eadp.errors import PathUndefined, printable
from eadp.io.figures.canvas import (
    COLOURS,
    GREY,
    START,
    Axes,
    draw_area,
    draw_areas,
    draw_arrow,
    draw_circles,
    draw_ground,
    figure_file,
    figure_pair,
    label_map,
    legend_above,
    legend_below,
    span_text,
    stage_style,
    write_callouts,
    write_headline,
)
from eadp.io.flight import flown_lines, flown_of_plan
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Leg, leg_points, point_at
from eadp.models.plan.trace import PlanReplay, nominal_legs, varied_legs
from eadp.models.world import Step, World
from eadp.planning.base import INFEASIBLE, JUMPED, TURNS_BACK, DecisionRecord

VALUES = 5
"""Values across the sets of the path parameters between which the range is filled."""

CORNERS = 24
"""Parts of a leg, if it is no line, that bounds the range."""

MIN_STEP_M = 1e-3


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
    with figure_file(path, 8.5, 7.5) as figure:
        axes = figure.add_subplot()
        _draw_range(axes, plan, parameters)
        draw_ground(axes, None, plan.site.airspace)
        _draw_legs(axes, plan, legs, step, scale / 50)
        ends = [leg.end_m for leg in legs]
        radii = [plan.radius_m(leg.stage) for leg in legs]
        draw_circles(axes, ends, radii)
        label = f"trigger, radius {span_text(radii)} m"
        axes.plot(*zip(*ends, strict=True), "x", color="#444", markersize=4, linewidth=0, label=label)
        axes.plot(*legs[0].start_m, **START)
        final = point_at(plan.final_point, parameters, "the final point")
        axes.plot(*final, "*", color="black", markersize=11, label="final point")
        named = zip(plan.names[: plan.path_count], parameters, strict=False)
        at = ", ".join(f"{name} = {value:g}" for name, value in named)
        length_km = sum(leg.distance_m for leg in legs) / 1000
        label_map(axes, f"Nominal path, {length_km:.2f} km" + (f", at {at}" if at else ""))
        legend_below(axes)


def _draw_legs(axes: Axes, plan: Plan, legs: Sequence[Leg], step: float, arrow: float) -> None:
    """Each leg in the colour of its stage, with an arrow of that length at its middle."""
    for leg in legs:
        points = leg_points(leg, step)
        colour, label = stage_style(plan.stages, leg.stage.index)
        axes.plot(*points.T[:2], color=colour, linewidth=1.4, label=label)
        x, y, course = points[len(points) // 2].tolist()
        draw_arrow(axes, (x, y), (x + arrow * math.cos(course), y + arrow * math.sin(course)), colour)


def _draw_range(axes: Axes, plan: Plan, parameters: Sequence[float]) -> None:
    """In grey, between the paths at values across their sets, where each lap of the nominal path lies."""
    boxes = [plan.hull(i) for i in range(plan.path_count)] if plan.has_sets else []
    if all(box.fixed for box in boxes):
        return
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
        steps_m = ((leg, leg.length_m / (1 if leg.stage.kind == LINE else CORNERS)) for lap in laps for leg in lap)
        paths = [leg_points(leg, max(step_m, MIN_STEP_M))[:, :2] for leg, step_m in steps_m]
        strips += [np.concatenate([first, last[::-1]]) for first, last in zip(before, paths, strict=False)]
        before = paths
    if strips:
        label = "range of the path parameters, lap by lap"
        draw_areas(axes, strips, color="#c9ced6", alpha=0.45, linewidth=0, zorder=0, label=label)


_DECISION: dict[str, Any] = {"color": "black", "markersize": 4, "markerfacecolor": "gold"}


def write_flight_figure(
    path: Path, world: World, steps: Sequence[Step], summary: Mapping[str, Any], records: Sequence[DecisionRecord] = ()
) -> None:
    """Draw a flight: path by stage, power and its forecast, state of charge and reserve, parameters, decisions.

    Where stages command altitudes, the altitude, too, and the airspeed where it changes.

    Written to `path` with the endings .svg and .png.
    """
    plan, climbs = world.mission.plan, any(stage.altitude_m is not None for stage in world.mission.plan.stages)
    slows = len({step.airspeed_commanded_mps for step in steps}) > 1
    rows = 2 + climbs + slows + len(plan.parameters)
    with figure_pair(path, 11.5, 4.0 + rows) as figure:
        grid = figure.add_gridspec(rows, 2, width_ratios=(1.15, 1))
        map_axes = figure.add_subplot(grid[:, 0])
        power = figure.add_subplot(grid[0, 1])
        panels = [power, *(figure.add_subplot(grid[row, 1], sharex=power) for row in range(1, rows))]
        _, charge, *others = panels
        time = np.array([step.time_s for step in steps])
        lost = [record for record in records if record.cause == JUMPED]
        _draw_path(map_axes, world, steps, summary["turned_back_s"])
        if lost:
            _draw_answer(map_axes, world, steps, lost)
        if summary["turned_back_m"] is not None:
            style: dict[str, Any] = {"color": COLOURS[6], "markersize": 9, "label": "turned back home", "zorder": 6}
            map_axes.plot(*summary["turned_back_m"], "X", **style)
        _draw_power(power, time, steps)
        _draw_charge(charge, time, steps, world, float(summary["soc_reserve"]))
        if climbs:
            others[0].plot(time, [step.altitude_m for step in steps], color=COLOURS[0], linewidth=1.3)
            others[0].set(ylabel="altitude [m]", title="Altitude")
        if slows:
            speed = others[climbs]
            speed.plot(time, [step.airspeed_mps for step in steps], color=COLOURS[0], linewidth=1.3, label="flown")
            commanded = [step.airspeed_commanded_mps for step in steps]
            speed.step(time, commanded, where="post", color=COLOURS[1], linewidth=1.0, label="commanded")
            speed.set(ylabel="airspeed [m/s]", title="Airspeed")
            legend_above(speed)
        for i, axes in enumerate(others[climbs + slows :]):
            _draw_parameter(axes, time, steps, plan, i)
        _draw_decisions(map_axes, panels[-1], steps, records)
        legend_below(map_axes)
        if panels[-1].get_legend_handles_labels()[1]:
            legend_above(panels[-1])
        panels[-1].set_xlabel("time [s]")
        for axes in panels[:-1]:
            axes.tick_params(labelbottom=False)
        write_headline(figure, _headline(summary))


def _headline(summary: Mapping[str, Any]) -> list[str]:
    state = "completed" if summary["completed"] else f"not completed: {printable(summary['reason'], 120)}"
    parts = [state, f"{summary['duration_s']:.1f} s", f"{summary['energy_wh']:.2f} Wh"]
    parts.append(f"{100 * summary['soc_final']:.0f} % of the charge at the end")
    quality = summary["quality"]
    return parts if quality is None else [*parts, f"quality {quality:.2f}"]


def _draw_path(axes: Axes, world: World, steps: Sequence[Step], turned_back_s: float | None = None) -> None:
    x, y = [step.x_m for step in steps], [step.y_m for step in steps]
    stages = np.array([step.stage for step in steps])
    draw_ground(axes, world.mission.plan.site.field, world.mission.plan.site.airspace)
    _draw_swath(axes, world.mission.plan, steps, turned_back_s)
    starts = [0, *(np.flatnonzero(np.diff(stages)) + 1).tolist()]
    for start, end in itertools.pairwise([*starts, len(steps) - 1]):
        colour, label = stage_style(world.mission.plan.stages, int(stages[start]))
        axes.plot(x[start : end + 1], y[start : end + 1], color=colour, linewidth=1.2, label=label)
    axes.plot(x[0], y[0], **START)
    final = point_at(world.mission.plan.final_point, steps[-1].parameters, "the final point")
    axes.plot(*final, "*", color="black", markersize=11, label="final point")
    axes.plot(x[-1], y[-1], "s", color="black", markersize=4, markerfacecolor="white", label="end of the flight")
    label_map(axes, "Path flown")
    speed = world.wind.speeds_mps[1]
    if speed:
        east, north = (0.05 * part / speed for part in world.wind.steady_mps)
        arrow = {"arrowstyle": "->", "color": GREY, "linewidth": 1.5}
        axes.annotate("", (0.93 + east, 0.05 + north), (0.93, 0.05), xycoords="axes fraction", arrowprops=arrow)
        style: dict[str, Any] = {"color": GREY, "ha": "right", "va": "center"}
        axes.text(0.90, 0.05, f"wind {span_text(world.wind.speeds_mps)} m/s", transform=axes.transAxes, **style)


def _draw_answer(axes: Axes, world: World, steps: Sequence[Step], lost: Sequence[DecisionRecord]) -> None:
    """What was decided at losses of charge, in its words, and the path that was planned before the last of them."""
    rows = ((step.time_s, step.stage, step.x_m, step.y_m, step.parameters) for step in steps)
    start = PlanCursor.start(world.mission.plan, world.mission.parameters, world.mission.rules)
    replay = PlanReplay(start, world.start.position_m, rows)
    style: dict[str, Any] = {"color": GREY, "linewidth": 0.8, "dashes": (3, 3), "label": "plan before the loss"}
    for leg in replay.before(lost[-1].time_s):
        axes.plot(*leg_points(leg, max(leg.distance_m / 40, 1.0)).T[:2], zorder=1, **style)
    callouts = []
    for record in lost:
        step = min(steps, key=lambda step: abs(step.time_s - record.time_s))
        text = f"{record.time_s:.0f} s: charge lost\n" + record.reason.replace(", ", "\n")
        callouts.append((text, (step.x_m, step.y_m)))
    write_callouts(axes, callouts)


def _draw_swath(axes: Axes, plan: Plan, steps: Sequence[Step], turned_back_s: float | None) -> None:
    """The ground of the field within half a swath of the lines flown."""
    if plan.site.field is None or plan.site.swath_m is None:
        return
    from eadp.core.geometry.polygons import strips

    columns = {name: [getattr(step, name) for step in steps] for name in ("time_s", "stage", "x_m", "y_m")}
    lines = flown_lines(plan, flown_of_plan(columns, turned_back_s))
    label = f"ground covered, {plan.site.swath_m:g} m wide"
    for rings in strips(plan.site.field.parts, lines, plan.site.swath_m):
        draw_area(axes, rings, facecolor=COLOURS[0], alpha=0.18, linewidth=0, zorder=1, label=label)


def _draw_power(axes: Axes, time: Any, steps: Sequence[Step]) -> None:
    power = [step.power_w for step in steps]
    low, high = min(power), max(power)
    margin = 0.1 * max(high - low, 1.0)
    axes.plot(time, power, color=COLOURS[0], linewidth=2.4, alpha=0.45, label="measured")
    forecast = [step.power_forecast_w for step in steps]
    axes.plot(time, forecast, color=COLOURS[1], linewidth=0.8, label="one-step forecast")
    axes.set(ylim=(low - margin, high + margin), ylabel="power [W]", title="Power")
    legend_above(axes)


def _draw_charge(axes: Axes, time: Any, steps: Sequence[Step], world: World, reserve: float) -> None:
    soc = [100 * step.soc for step in steps]
    axes.plot(time, soc, color=COLOURS[2], linewidth=1.3, label="state of charge")
    axes.axhline(100 * reserve, color=COLOURS[6], linewidth=1.0, linestyle="--", label="reserve")
    for i, fault in enumerate(world.faults):
        if fault.at_s <= time[-1] and not world.mission.battery.prescribed:
            axes.axvline(fault.at_s, color=GREY, linewidth=0.8, linestyle=":")
            side = "right" if fault.at_s > time[-1] / 2 else "left"
            text = f" {100 * fault.soc_drop:.3g} % lost "
            axes.annotate(text, (fault.at_s, 96 - 14 * (i % 4)), fontsize=8, color=GREY, va="top", ha=side)
    axes.set(ylim=(0, 104), ylabel="state of charge [%]", title="Battery")
    legend_above(axes)


def _draw_parameter(axes: Axes, time: Any, steps: Sequence[Step], plan: Plan, index: int) -> None:
    """A parameter of the plan, by its index from 0, as people read it."""
    parameter, box = plan.parameters[index], plan.hull(index)
    values = [parameter.shown(step.parameters[index]) for step in steps]
    axes.step(time, values, where="post", color=COLOURS[index % len(COLOURS)], linewidth=1.5)
    low, high = sorted(map(parameter.shown, (box.lo, box.hi)))
    margin = 0.06 * (high - low) or 1.0
    unit = f"[{parameter.unit}]" if parameter.unit else ""
    axes.set(ylim=(low - margin, high + margin), ylabel=unit, title=parameter.label)


def _draw_decisions(path: Axes, lower: Axes, steps: Sequence[Step], records: Sequence[DecisionRecord]) -> None:
    """Where and when a re-planning changed parameters; in grey, the periods in which nothing was feasible."""
    times = [step.time_s for step in steps]
    before = [steps[0].parameters, *(record.parameters for record in records)]
    changed_s = [
        record.time_s
        for old, record in zip(before, records, strict=False)
        if record.parameters != old or record.reason.startswith(TURNS_BACK)
    ]
    if changed_s:
        at = [steps[min(bisect.bisect_left(times, time_s), len(steps) - 1)] for time_s in changed_s]
        path.plot([s.x_m for s in at], [s.y_m for s in at], "D", **_DECISION, label="decision", zorder=5)
        top = lower.get_xaxis_transform()
        lower.plot(changed_s, [1.0] * len(at), "D", **_DECISION, transform=top, clip_on=False)
    for record, after in itertools.pairwise(records):
        if record.status == INFEASIBLE:
            style: dict[str, Any] = {"color": GREY, "alpha": 0.2, "linewidth": 0, "label": "nothing was feasible"}
            lower.axvspan(record.time_s, after.time_s, **style)
