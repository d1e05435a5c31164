"""The figure of a computation profile: measured power and the model between configurations."""

from __future__ import annotations

import itertools
import math

import numpy as np

from eadp.errors import InputError
from eadp.io.figures.canvas import COLOURS, GREY, Axes, figure_file, legend_below, write_headline
from eadp.models.performance import Performance
from eadp.models.profile import Profile, titles
from eadp.models.vehicle import Airframe, FixedWing

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


ABOVE = 1.6
"""Right end of the axis, over the airspeed held."""


def write_vehicle_figure(path: str, name: str, airframe: Airframe, found: Performance, computing_w: float) -> None:
    """Draw the power of an aircraft over its airspeed, computations among it.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the file cannot be written.
    """
    low, high = airframe.level_speeds_mps()
    speeds = np.linspace(low, max(min(high, ABOVE * max(found.airspeed_mps, found.range_mps)), low), 300)
    banks = [0.0, 30.0, airframe.max_bank_deg] if airframe.takes_commands else [0.0]
    with figure_file(path, 7.0, 4.4) as figure:
        axes = figure.subplots()
        for bank, colour in zip(banks, COLOURS, strict=False):
            label = f"bank {bank:g}°" if bank else "level flight"
            powers = [airframe.level_power_w(float(v), math.radians(bank)) + computing_w for v in speeds]
            if isinstance(airframe, FixedWing):  # no curve where the wing stalls
                powers = np.where(speeds < airframe.stall_in_turn_mps(math.radians(bank)), math.nan, powers).tolist()
            axes.plot(speeds, powers, color=colour, label=label, marker="" if high > low else "s")
        held_w = found.level_power_w + computing_w
        axes.plot(found.airspeed_mps, held_w, "o", color="black", label=f"as it flies, {held_w:.3g} W")
        for speed, mark, text in ((found.endurance_mps, "v", "longest time"), (found.range_mps, "^", "longest way")):
            watts = airframe.level_power_w(speed) + computing_w
            axes.plot(speed, watts, mark, color=GREY, label=f"{text}, {speed:.3g} m/s")
        if found.range_w > 0:
            # the tangent from the origin touches the curve where power over airspeed is least
            axes.plot([0, found.range_mps * 1.25], [0, found.range_w * 1.25], color=GREY, linewidth=0.6)
        if found.stall_mps is not None:
            axes.axvline(found.stall_mps, color=GREY, linestyle=":", label=f"stall, {found.stall_mps:.3g} m/s")
        axes.set(xlabel="airspeed [m/s]", ylabel="electrical power [W]", xlim=(0, None), ylim=(0, None))
        axes.legend(loc="upper left")
        write_headline(figure, [name or "aircraft", f"turning radius {found.turn_radius_m:.0f} m"])
