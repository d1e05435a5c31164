"""The figure of a computation profile: measured power and the model between configurations."""

from __future__ import annotations

import itertools
import math

import numpy as np

from eadp.errors import InputError
from eadp.io.figures.canvas import COLOURS, GREY, Axes, figure_file, legend_below
from eadp.models.profile import Profile, titles

CURVES = 7
"""Most curves of one family: of more levels, some are left out, never the first and the last."""

MARKS = ("measured", "± 1 standard deviation", "± 2 standard errors")
"""Labels of the marks of all curves; they follow the curves in the legend."""

FINE = 200
"""Points along a curve."""


def write_profile_figure(path: str, profile: Profile) -> None:
    """Draw a profile: measured power, its standard deviation and standard error, the model.

    One changing parameter is a curve, a full grid a family of curves.

    Raises
    ------
    InputError
        If scattered points are of several parameters, the name ends in neither .svg nor .png, or the file cannot be
        written.
    """
    with figure_file(path, 7.0, 4.6) as figure:
        _draw(figure.subplots(), profile)


def _draw(axes: Axes, part: Profile) -> None:
    levels = [np.unique(column) for column in part.configurations.T]
    varying = [axis for axis, values in enumerate(levels) if len(values) > 1]
    axes.set_ylabel("power [W]")
    if len(part.power_w) == math.prod(len(values) for values in levels):
        along = max(varying, key=lambda axis: len(levels[axis]))
        _draw_family(axes, part, along, [axis for axis in varying if axis != along], levels)
    elif len(varying) == 1:
        _draw_family(axes, part, varying[0], [], levels)
    else:
        message = f"scattered configurations of {len(varying)} parameters have no picture"
        raise InputError.at("--plot", 1, 1, message, "one parameter, or a full grid")
    kind = part.interpolation if len(varying) == 1 else "linear between neighbours"
    axes.set_title(f"Power of the computations, {kind}")
    handles, _ = axes.get_legend_handles_labels()
    legend_below(axes, 3, 0.14, handles=sorted(handles, key=lambda mark: mark.get_label() in MARKS))


def _draw_family(axes: Axes, part: Profile, along: int, others: list[int], levels: list[np.ndarray]) -> None:
    """A curve along one parameter for each combination of the others' measured values."""
    combinations = list(itertools.product(*(levels[axis].tolist() for axis in others)))
    if len(combinations) > CURVES:
        kept = np.unique(np.linspace(0, len(combinations) - 1, CURVES).round().astype(int))
        combinations = [combinations[i] for i in kept]
    knots = levels[along]
    fine = np.unique(np.concatenate([np.linspace(knots[0], knots[-1], FINE), knots]))
    for values, colour in zip(combinations, itertools.cycle(COLOURS), strict=False):
        at = np.tile(part.configurations[0], (len(fine), 1))
        at[:, along] = fine
        at[:, others] = values
        label = ", ".join(f"{part.names[axis]} = {value:g}" for axis, value in zip(others, values, strict=True))
        axes.plot(fine, part.interpolant(at), color=colour, linewidth=1.4, label=label or "model")
        rows = np.flatnonzero(np.all(part.configurations[:, others] == np.array(values), axis=1))
        _draw_points(axes, part, rows, along, colour)
    axes.set_xlabel(titles(part.names, part.units)[along])


def _draw_points(axes: Axes, part: Profile, rows: np.ndarray, along: int, colour: str) -> None:
    """Measured points with standard deviation and standard error."""
    measured, deviation, errors = MARKS
    x, power_w = part.configurations[rows, along], part.power_w[rows]
    std_w, error_w = part.std_w[rows], np.nan_to_num(part.standard_error_w[rows])
    if std_w.any():
        axes.errorbar(x, power_w, std_w, fmt="none", ecolor=GREY, elinewidth=0.9, capsize=2, label=deviation)
    if error_w.any():
        axes.errorbar(x, power_w, 2 * error_w, fmt="none", ecolor=colour, elinewidth=3.5, alpha=0.5, label=errors)
    axes.plot(x, power_w, "o", color=colour, markersize=5, label=measured)
