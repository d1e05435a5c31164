"""Pictures of computation profiles: what was measured, and the model between."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from eadp.io.figures.pictures import COLOURS, GREY, picture
from eadp.models.profile import Profile
from eadp.models.profile_sum import AnyProfile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CURVES = 7
"""Most curves of one family: of more levels, some are left out, never the first and the last."""

MARKS = ("measured", "predicted by the others", "spread of the samples", "± 2 standard errors")
"""What the marks of all curves are called in the legend, behind the curves."""

FINE = 200
"""Points along a curve."""

ACROSS = 61
"""Points along each side of filled contours."""


def write_profile_figure(path: str, profile: AnyProfile) -> None:
    """Draw a profile, a panel for each part: measured power, its spread and standard error, and the model.

    One changing parameter is a curve; a full grid a family of curves; scattered points of two parameters filled
    contours; of more, what each point's neighbours predict against what was measured.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the place cannot be written to.
    """
    parts = profile.parts
    with picture(path, 1.0 + 6.0 * len(parts), 4.6) as figure:
        panels = figure.subplots(1, len(parts), squeeze=False)[0]
        for axes, part in zip(panels, parts, strict=True):
            _draw_part(figure, axes, part)


def _draw_part(figure: Figure, axes: Axes, part: Profile) -> None:
    levels = [np.unique(column) for column in part.configurations.T]
    varying = [axis for axis, values in enumerate(levels) if len(values) > 1]
    axes.set_ylabel("power [W]")
    if len(part.power_w) == math.prod(len(values) for values in levels):
        along = max(varying, key=lambda axis: len(levels[axis]))
        _draw_family(axes, part, along, [axis for axis in varying if axis != along], levels)
    elif len(varying) == 1:
        _draw_family(axes, part, varying[0], [], levels)
    elif len(varying) == 2:
        _draw_contours(figure, axes, part, varying)
    else:
        _draw_predictions(axes, part)
    kind = part.interpolation if len(varying) == 1 else "linear between neighbours"
    axes.set_title(f"Power of the computations, {kind}", loc="left", fontsize=10)
    found = zip(*axes.get_legend_handles_labels(), strict=True)
    handles, labels = zip(*sorted(found, key=lambda item: item[1] in MARKS), strict=True)
    axes.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, frameon=False, fontsize=8)


def _title(part: Profile, axis: int) -> str:
    name, unit = part.names[axis], part.units[axis]
    return f"{name} [{unit}]" if unit else name


def _draw_family(axes: Axes, part: Profile, along: int, others: list[int], levels: list[np.ndarray]) -> None:
    """A curve along one parameter for each combination of the others' measured values."""
    combinations = list(itertools.product(*(levels[axis].tolist() for axis in others)))
    if len(combinations) > CURVES:
        kept = np.unique(np.linspace(0, len(combinations) - 1, CURVES).round().astype(int))
        combinations = [combinations[i] for i in kept]
    knots = levels[along]
    fine = np.unique(np.concatenate([np.linspace(knots[0], knots[-1], FINE), knots]))
    for i, values in enumerate(combinations):
        at = np.tile(part.configurations[0], (len(fine), 1))
        at[:, along] = fine
        at[:, others] = values
        colour = COLOURS[i % len(COLOURS)]
        label = ", ".join(f"{part.names[axis]} = {value:g}" for axis, value in zip(others, values, strict=True))
        axes.plot(fine, part.interpolant(at), color=colour, linewidth=1.4, label=label or "model")
        rows = np.flatnonzero(np.all(part.configurations[:, others] == np.array(values), axis=1))
        _draw_points(axes, part, rows, along, colour, named=i == 0)
    axes.set_xlabel(_title(part, along))


def _draw_points(axes: Axes, part: Profile, rows: np.ndarray, along: int, colour: str, *, named: bool) -> None:
    """Measured points with their spread and standard error, and what their neighbours predict."""
    x, power_w = part.configurations[rows, along], part.power_w[rows]
    spread_w, error_w = part.spread_w[rows], np.nan_to_num(part.standard_error_w[rows])
    left_out_w = part.left_out_w[rows]
    if spread_w.any():
        label = "spread of the samples" if named else None
        axes.errorbar(x, power_w, spread_w, fmt="none", ecolor=GREY, elinewidth=0.9, capsize=2, label=label)
    if error_w.any():
        label = "± 2 standard errors" if named else None
        axes.errorbar(x, power_w, 2 * error_w, fmt="none", ecolor=colour, elinewidth=3.5, alpha=0.5, label=label)
    axes.plot(x, power_w, "o", color=colour, markersize=5, label="measured" if named else None)
    if np.isfinite(left_out_w).any():
        label = "predicted by the others" if named else None
        axes.plot(x, left_out_w, "x", color=colour, markersize=6, linewidth=0, label=label)


def _draw_contours(figure: Figure, axes: Axes, part: Profile, varying: list[int]) -> None:
    """Filled contours of the model over two parameters, blank where nothing was measured round about."""
    lower, upper = (part.configurations[:, varying].min(axis=0), part.configurations[:, varying].max(axis=0))
    x, y = (np.linspace(least, most, ACROSS) for least, most in zip(lower, upper, strict=True))
    power_w = np.full((len(y), len(x)), np.nan)
    at = part.configurations[0].tolist()
    for i, j in itertools.product(range(len(y)), range(len(x))):
        at[varying[0]], at[varying[1]] = float(x[j]), float(y[i])
        if part.contains(at):
            power_w[i, j] = part.power_w_at(at)
    filled = axes.contourf(x, y, power_w, levels=12, cmap="viridis")
    figure.colorbar(filled, ax=axes, label="power [W]")
    points = part.configurations[:, varying]
    least_w, most_w = filled.get_clim()
    axes.scatter(
        points[:, 0],
        points[:, 1],
        c=part.power_w,
        cmap="viridis",
        vmin=least_w,
        vmax=most_w,
        edgecolors="black",
        linewidths=0.8,
        clip_on=False,
        zorder=3,
        label="measured",
    )
    axes.set_xlabel(_title(part, varying[0]))
    axes.set_ylabel(_title(part, varying[1]))


def _draw_predictions(axes: Axes, part: Profile) -> None:
    """What the others predict against what was measured, for points in more than two scattered parameters."""
    ends = [float(part.power_w.min()), float(part.power_w.max())]
    axes.plot(ends, ends, color=GREY, linewidth=1.0, label="as measured")
    axes.plot(part.power_w, part.left_out_w, "x", color=COLOURS[0], label="predicted by the others")
    axes.set_xlabel("measured power [W]")
    axes.set_ylabel("predicted power [W]")
