"""Pictures, and the only import of matplotlib."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eadp.core.expressions.expression import number_text
from eadp.coverage.swaths import CoveragePath
from eadp.errors import InputError, PathUndefined
from eadp.io.text.streams import write_bytes
from eadp.models.field import Field
from eadp.models.plan.plan import COMPUTATION, Plan, point_at
from eadp.models.plan.trace import Leg, leg_points, nominal_legs
from eadp.planning.base import DecisionRecord
from eadp.planning.joint.program import INFEASIBLE
from eadp.simulation.loop import Step, World

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#3b6fb6", "#d1752b", "#3f8f5b", "#a2437c", "#7a6a4f", "#5b5bb0", "#b0413e", "#2f8f8f")
GREY = "#8a8f98"
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "svg.hashsalt": "eadp",
    "svg.fonttype": "path",
    "figure.dpi": 110,
}


@contextmanager
def _figure(path: Path, width_in: float, height_in: float) -> Iterator[Figure]:
    """A figure that is saved as SVG and PNG under a name without its ending; same data, same bytes."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        figure.savefig(path.with_suffix(".svg"), metadata={"Date": None, "Creator": "eadp"})
        figure.savefig(path.with_suffix(".png"), metadata={"Software": "eadp"})


def draw_flight(
    path: Path, world: World, steps: Sequence[Step], summary: Mapping[str, Any], records: Sequence[DecisionRecord] = ()
) -> None:
    """The path over the field by stage, power with its forecast, state of charge with the reserve, parameters.

    Where and when re-plannings changed parameters is marked. Written to `path` with the endings .svg and .png.
    """
    with _figure(path, 11.5, 7.0) as figure:
        grid = figure.add_gridspec(3, 2, width_ratios=(1.15, 1))
        path_axes = figure.add_subplot(grid[:, 0])
        _draw_path(path_axes, world, steps)
        time = np.array([step.time_s for step in steps])
        power = figure.add_subplot(grid[0, 1])
        _draw_power(power, time, steps)
        charge = figure.add_subplot(grid[1, 1], sharex=power)
        _draw_charge(charge, time, steps, world, float(summary["soc_reserve"]))
        lower = figure.add_subplot(grid[2, 1], sharex=power)
        _draw_parameters(lower, time, steps, world)
        _draw_decisions(path_axes, lower, steps, records)
        lower.set_xlabel("time [s]")
        for axes in (power, charge):
            axes.tick_params(labelbottom=False)
        figure.suptitle(_headline(summary), x=0.01, ha="left", fontsize=11, fontweight="bold")


def _headline(summary: Mapping[str, Any]) -> str:
    state = "completed" if summary["completed"] else f"not completed: {summary['reason']}"
    quality = summary["quality"]
    parts = [state, f"{summary['duration_s']:.1f} s", f"{summary['energy_wh']:.2f} Wh"]
    parts.append(f"SoC {100 * summary['soc_final']:.0f} % at the end")
    if quality is not None:
        parts.append(f"quality U = {quality:.2f}")
    return "  ·  ".join(parts)


def _draw_path(axes: Axes, world: World, steps: Sequence[Step]) -> None:
    x = np.array([step.x_m for step in steps])
    y = np.array([step.y_m for step in steps])
    stage = np.array([step.stage for step in steps])
    n = len(world.plan.stages)
    few = n <= len(COLOURS)
    begins = np.flatnonzero(np.diff(stage)) + 1
    runs = zip(np.concatenate([[0], begins]), np.concatenate([begins, [len(steps) - 1]]), strict=True)
    named = set()
    for start, end in runs:
        index = int(stage[start])
        colour = COLOURS[(index - 1) % len(COLOURS)]
        label = f"stage {index} ({world.plan.stages[index - 1].kind})" if few and index not in named else None
        named.add(index)
        axes.plot(x[start : end + 1], y[start : end + 1], color=colour, linewidth=1.2, label=label)
    axes.plot(x[0], y[0], "o", color="black", markersize=5, label="start")
    final = point_at(world.plan.final_point, steps[-1].parameters, "the final point")
    axes.plot(*final, "*", color="black", markersize=11, label="final point")
    axes.plot(x[-1], y[-1], "s", color="black", markersize=4, markerfacecolor="white", label="end of the flight")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, east [m]")
    axes.set_ylabel("y, north [m]")
    axes.set_title("Path flown", loc="left", fontsize=10)
    speed = world.wind.speed_mps
    if speed:
        wx, wy = world.wind.steady_mps
        axes.annotate(
            "",
            xy=(0.93 + 0.05 * wx / speed, 0.05 + 0.05 * wy / speed),
            xytext=(0.93, 0.05),
            xycoords="axes fraction",
            arrowprops={"arrowstyle": "->", "color": GREY, "linewidth": 1.5},
        )
        axes.text(0.90, 0.05, f"wind {speed:g} m/s", transform=axes.transAxes, color=GREY, ha="right", va="center")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=4, frameon=False, fontsize=8)


def _draw_power(axes: Axes, time: Any, steps: Sequence[Step]) -> None:
    power = np.array([step.power_w for step in steps])
    forecast = np.array([step.power_forecast_w for step in steps])
    low, high = float(power.min()), float(power.max())
    margin = 0.1 * max(high - low, 1.0)
    axes.plot(time, power, color=COLOURS[0], linewidth=2.4, alpha=0.45, label="measured")
    axes.plot(time, forecast, color=COLOURS[1], linewidth=0.8, label="forecast one step ahead")
    axes.set_ylim(low - margin, high + margin)
    axes.set_ylabel("power [W]")
    axes.set_title("Power", loc="left", fontsize=10)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=8)


def _draw_charge(axes: Axes, time: Any, steps: Sequence[Step], world: World, reserve: float) -> None:
    soc = 100 * np.array([step.soc for step in steps])
    axes.plot(time, soc, color=COLOURS[2], linewidth=1.3, label="state of charge")
    axes.axhline(100 * reserve, color=COLOURS[6], linewidth=1.0, linestyle="--", label="reserve")
    for fault in world.faults:
        if fault.at_s <= time[-1] and not world.battery.prescribed:
            axes.axvline(fault.at_s, color=GREY, linewidth=0.8, linestyle=":")
    axes.set_ylim(0, 104)
    axes.set_ylabel("state of charge [%]")
    axes.set_title("Battery", loc="left", fontsize=10)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=8)


def _draw_parameters(axes: Axes, time: Any, steps: Sequence[Step], world: World) -> None:
    """Each parameter as its share of its set, with the set's ends named in the legend."""
    plan = world.plan
    for i, parameter in enumerate(plan.parameters):
        box = plan.hull(i)
        width = box.hi - box.lo
        values = np.array([step.parameters[i] for step in steps])
        share = (values - box.lo) / width if width else np.ones(len(values))
        title = parameter.title or ("computation" if parameter.kind == COMPUTATION else "path")
        label = f"{parameter.name} ({title}) {number_text(box.lo)} … {number_text(box.hi)}"
        axes.step(time, share, where="post", color=COLOURS[i % len(COLOURS)], linewidth=1.3, label=label)
    axes.set_ylim(-0.06, 1.06)
    axes.set_ylabel("share of the set")
    axes.set_title("Parameters", loc="left", fontsize=10)
    if plan.parameters:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=8)


def _draw_decisions(path: Axes, lower: Axes, steps: Sequence[Step], records: Sequence[DecisionRecord]) -> None:
    """Where and when a re-planning has changed parameters; in grey, the time in which nothing was feasible."""
    times = [step.time_s for step in steps]
    before = [steps[0].parameters, *(record.parameters for record in records)]
    changed = [record for old, record in zip(before, records, strict=False) if record.parameters != old]
    places = [steps[min(bisect.bisect_left(times, record.time_s), len(steps) - 1)] for record in changed]
    if places:
        x, y = [place.x_m for place in places], [place.y_m for place in places]
        path.plot(x, y, "D", color="black", markersize=4, markerfacecolor="gold", label="decision", zorder=5)
        path.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=4, frameon=False, fontsize=8)
        lower.plot(
            [record.time_s for record in changed],
            [1.06] * len(changed),
            "D",
            color="black",
            markersize=4,
            markerfacecolor="gold",
            clip_on=False,
        )
    for record, after in itertools.pairwise(records):
        if record.status == INFEASIBLE:
            lower.axvspan(record.time_s, after.time_s, color=GREY, alpha=0.2, linewidth=0)


def write_plan_figure(path: str, plan: Plan, parameters: Sequence[float]) -> None:
    """Draw a plan: lines and turns, triggers with their radius, arrows, and the band that the parameters allow.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the place cannot be written to.
    PathUndefined
        If the plan has no nominal path at these parameters.
    """
    legs = nominal_legs(plan, parameters)
    with picture(path, 8.5, 7.5) as figure:
        _draw_plan(figure.add_subplot(), plan, parameters, legs)


def check_picture_name(path: str) -> None:
    """Refuse a picture's name that ends in neither .svg nor .png; raises InputError."""
    if Path(path).suffix.lower() not in (".svg", ".png"):
        raise InputError.at(path, 1, 1, "is no picture's name", "a name that ends in .svg or .png")


@contextmanager
def picture(path: str, width_in: float, height_in: float) -> Iterator[Figure]:
    """A figure that is saved under a name that says whether as SVG or PNG.

    Raises
    ------
    InputError
        If the name ends in neither, or the place cannot be written to.
    """
    import tempfile

    check_picture_name(path)
    ending = Path(path).suffix.lower()
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "picture"
        with _figure(draft, width_in, height_in) as figure:
            yield figure
        write_bytes(path, draft.with_suffix(ending).read_bytes())


def write_coverage_figure(path: str, field: Field, ways: Mapping[str, CoveragePath], swath_m: float) -> None:
    """Draw a field and ways that cover it side by side under their titles: ground covered, lines, turns.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the place cannot be written to.
    """
    x, y = zip(*field.outline, strict=True)
    wide = min(1.6, max(0.5, (max(x) - min(x) + 150) / (max(y) - min(y) + 150)))
    with picture(path, 0.8 + 5.5 * wide * len(ways), 6.5) as figure:
        all_axes = np.atleast_1d(figure.subplots(1, len(ways), sharex=True, sharey=True, squeeze=True))
        for axes, (title, way) in zip(all_axes, ways.items(), strict=True):
            _draw_field(axes, field)
            _draw_way(axes, way, swath_m)
            axes.set_title(title, loc="left", fontsize=10)
            axes.set_aspect("equal")
            axes.set_xlabel("x, east [m]")
        all_axes[0].set_ylabel("y, north [m]")
        handles, labels = all_axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)


def _draw_field(axes: Axes, field: Field) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    rings = [(*ring, ring[0]) for ring in (field.outline, *field.holes)]
    outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
    axes.add_patch(PathPatch(outline, facecolor="#eef3e6", edgecolor="#6f8f4f", linewidth=1.4, zorder=1, label="field"))


def _draw_way(axes: Axes, way: CoveragePath, swath_m: float) -> None:
    """Strips of ground covered, lines and turns over them, arrows on the lines, begin and end."""
    named: set[str] = set()
    pieces = way.pieces
    reach = max((piece.length_m for piece in pieces), default=1.0) / 30
    for leg in way.legs:
        piece = leg.piece
        (x0, y0, heading), (x1, y1, _) = piece.start, piece.end
        if leg.sensing:
            nx, ny = -math.sin(heading) * swath_m / 2, math.cos(heading) * swath_m / 2
            label = None if "ground" in named else f"ground covered, {swath_m:g} m wide"
            named.add("ground")
            strip_x, strip_y = (x0 + nx, x1 + nx, x1 - nx, x0 - nx), (y0 + ny, y1 + ny, y1 - ny, y0 - ny)
            axes.fill(strip_x, strip_y, color=COLOURS[0], alpha=0.13, linewidth=0, zorder=2, label=label)
        kind = "line" if leg.sensing else "turn"
        steps = max(1, math.ceil(piece.length_m / 3)) if piece.turn else 1
        points = [piece.pose_at(piece.length_m * i / steps) for i in range(steps + 1)]
        axes.plot(
            [p[0] for p in points],
            [p[1] for p in points],
            color=COLOURS[0] if leg.sensing else COLOURS[1],
            linewidth=1.3 if leg.sensing else 1.0,
            label=None if kind in named else kind,
            zorder=3,
        )
        named.add(kind)
        if leg.sensing:
            middle = piece.pose_at(piece.length_m / 2)[:2]
            ahead = (middle[0] + reach * math.cos(heading), middle[1] + reach * math.sin(heading))
            arrow = {"arrowstyle": "-|>", "color": COLOURS[0], "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", xy=ahead, xytext=middle, arrowprops=arrow)
    axes.plot(*pieces[0].start[:2], "o", color="black", markersize=5, zorder=4, label="begin")
    axes.plot(*pieces[-1].end[:2], "s", color="black", markersize=5, zorder=4, label="end")


def _draw_plan(axes: Axes, plan: Plan, parameters: Sequence[float], legs: Sequence[Leg]) -> None:
    scale = max(math.dist(leg.start_m, leg.end_m) for leg in legs)
    step = max(scale / 100, 0.1)
    _draw_band(axes, plan, parameters, step)
    n = len(plan.stages)
    named = set()
    for leg in legs:
        points = list(leg_points(leg, step))
        index = leg.stage.index
        colour = COLOURS[(index - 1) % len(COLOURS)]
        label = f"stage {index} ({leg.stage.kind})" if n <= len(COLOURS) and index not in named else None
        named.add(index)
        axes.plot([p.x_m for p in points], [p.y_m for p in points], color=colour, linewidth=1.4, label=label)
        middle = points[len(points) // 2]
        reach = scale / 50
        axes.annotate(
            "",
            xy=(middle.x_m + reach * math.cos(middle.heading_rad), middle.y_m + reach * math.sin(middle.heading_rad)),
            xytext=(middle.x_m, middle.y_m),
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0},
        )
    _draw_triggers(axes, plan, legs)
    axes.plot(*legs[0].start_m, "o", color="black", markersize=5, label="start")
    axes.plot(
        *point_at(plan.final_point, parameters, "the final point"),
        "*",
        color="black",
        markersize=11,
        label="final point",
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, east [m]")
    axes.set_ylabel("y, north [m]")
    at = ", ".join(
        f"{name} = {value:g}" for name, value in zip(plan.names[: plan.path_count], parameters, strict=False)
    )
    length = sum(leg.distance_m for leg in legs)
    axes.set_title(f"Nominal path, {length / 1000:.2f} km" + (f", at {at}" if at else ""), loc="left", fontsize=10)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=4, frameon=False, fontsize=8)


def _draw_band(axes: Axes, plan: Plan, parameters: Sequence[float], step: float) -> None:
    """In grey, the first laps at parameters across their sets: the area the letter's Fig. 2 shows."""
    if not plan.has_sets or not plan.path_count:
        return
    shares = np.linspace(0.0, 1.0, 25)
    label: str | None = "what the parameters allow, first lap"
    for share in shares:
        values = list(parameters)
        for i in range(plan.path_count):
            box = plan.hull(i)
            values[i] = box.lo + float(share) * (box.hi - box.lo)
        try:
            legs = nominal_legs(plan, values)
        except PathUndefined:
            continue
        begun = [leg for leg in legs if leg.lap == 0][: 2 * len(COLOURS)]
        points = [point for leg in begun for point in leg_points(leg, step)]
        axes.plot(
            [p.x_m for p in points], [p.y_m for p in points], color="#d9dce1", linewidth=3.0, label=label, zorder=0
        )
        label = None


def _draw_triggers(axes: Axes, plan: Plan, legs: Sequence[Leg]) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle

    discs = [Circle(leg.end_m, plan.trigger_radius_m) for leg in legs]
    axes.add_collection(PatchCollection(discs, facecolor="#00000008", edgecolor=GREY, linewidth=0.6, linestyle=":"))
    x, y = zip(*(leg.end_m for leg in legs), strict=True)
    axes.plot(x, y, "x", color="#444", markersize=4, linewidth=0, label=f"trigger, radius {plan.trigger_radius_m:g} m")
