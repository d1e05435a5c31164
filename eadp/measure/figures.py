"""The figures of a fit: the log and the fit, residuals, periodogram, the power over one period; and of a profile."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import InputError
from eadp.io.figures.canvas import (
    COLOURS,
    GREY,
    Axes,
    figure_file,
    legend_above,
    legend_below,
    scale_by_decades,
    write_headline,
    write_none,
)
from eadp.models.profile import Profile, titles

if TYPE_CHECKING:
    from eadp.measure.power import EnergyFit, FilteredLog

POINTS = 4000
"""Most samples drawn: a longer log is thinned evenly."""

GAP_INTERVALS = 10.0
"""A line breaks where samples are farther apart than so many of their usual intervals."""


def write_fit_figure(path: str, fitted: EnergyFit) -> None:
    """Draw a fit.

    Parameters
    ----------
    path : str
        A name that ends in .svg or .png.
    fitted : EnergyFit

    Raises
    ------
    InputError
        If it ends in neither, or the file cannot be written.
    """
    with figure_file(path, 10.5, 8.0) as figure:
        grid = figure.add_gridspec(3, 2, height_ratios=(1.25, 0.8, 1.25))
        log = figure.add_subplot(grid[0, :])
        every = math.ceil(len(fitted.times_s) / POINTS)
        _draw_log(log, fitted, every)
        _draw_residuals(figure.add_subplot(grid[1, :], sharex=log), fitted, every)
        _draw_periodogram(figure.add_subplot(grid[2, 0]), fitted)
        _draw_folded(figure.add_subplot(grid[2, 1]), fitted, every)
        write_headline(figure, _headline(fitted))


def write_filter_figure(path: str, log: FilteredLog) -> None:
    """Draw the estimator's run over a log: power and estimate, what was left over, the states; as `write_fit_figure`.

    Source: draft 002, Fig. 3.
    """
    with figure_file(path, 10.5, 8.0) as figure:
        power, errors, states = figure.subplots(3, 1, sharex=True, height_ratios=(1.25, 0.8, 1.0))
        power.plot(*_broken(log.times_s, log.power_w), color=COLOURS[0], linewidth=0.7, alpha=0.7, label="log")
        power.plot(*_broken(log.times_s, log.estimate_w), color=COLOURS[6], linewidth=1.3, label="estimate")
        power.set(ylabel="power [W]", title="Log, and the estimate after each reading")
        legend_above(power)
        errors.plot(*_broken(log.times_s, log.power_w - log.forecast_w), color=GREY, linewidth=0.7)
        for edge_w in (-log.gate_w, log.gate_w) if log.gate_w else (0.0,):
            errors.axhline(edge_w, color=COLOURS[1] if log.gate_w else "black", linewidth=0.8)
        errors.set_ylabel("error [W]")
        gate = f"; within {log.gate_w:g} W it corrects nothing" if log.gate_w else ""
        errors.set_title(f"Reading less its forecast{gate}")
        states.plot(log.times_s, log.states_w[:, 0] - log.states_w[-1, 0], color="black", label="level less its last")
        pairs = zip(log.states_w[:, 1::2].T, log.states_w[:, 2::2].T, strict=True)
        for j, (alpha, beta) in enumerate(pairs, 1):
            states.plot(log.times_s, np.hypot(alpha, beta), color=COLOURS[j % len(COLOURS)], label=f"harmonic {j}")
        low, high = np.percentile(log.states_w[len(log.times_s) // 10 :, 0] - log.states_w[-1, 0], [0, 100])
        top = max(high, *np.hypot(log.states_w[-1, 1::2], log.states_w[-1, 2::2]), 0.1)
        states.set(
            ylim=(1.3 * min(low, 0.0) - 0.1 * top, 1.5 * top),
            ylabel="[W]",
            xlabel="time [s]",
            title="States: the level, and the harmonics' amplitudes",
        )
        legend_above(states)
        period = "no period" if log.period_s is None else f"period {log.period_s:.5g} s"
        write_headline(figure, [period, f"{100 * log.used:.0f} % of the readings correct the state"])


def _headline(fitted: EnergyFit) -> list[str]:
    model = fitted.model
    if model.period_s is None:
        return ["no period", f"mean {model.mean_w:.4g} W", f"standard deviation {model.noise_std_w:.3g} W"]
    parts = [f"period {model.period_s:.5g} s", f"order {model.order}", f"mean {model.mean_w:.4g} W"]
    return [*parts, f"noise {model.noise_std_w:.3g} W", f"cross-validated R² {model.cv_r2:.2f}"]


def _draw_log(axes: Axes, fitted: EnergyFit, every: int) -> None:
    times, power = _broken(fitted.times_s[::every], fitted.power_w[::every])
    axes.plot(times, power, color=COLOURS[0], linewidth=0.7, alpha=0.7, label="log")
    even = np.linspace(0, fitted.times_s[-1], POINTS)
    known = np.interp(even, times, np.isnan(power)) == 0
    axes.plot(even, np.where(known, fitted.model.power_w(even), np.nan), color=COLOURS[1], linewidth=1.3, label="fit")
    axes.set(ylabel="power [W]", title="Log and fit")
    axes.tick_params(labelbottom=False)
    legend_above(axes)


def _broken(times_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A line that breaks at gaps: a NaN within each interval that is much longer than usual."""
    apart_s = np.diff(times_s)
    gaps: Any = np.flatnonzero(apart_s > GAP_INTERVALS * np.median(apart_s)) + 1 if len(apart_s) else []
    within_s = (times_s[gaps] + times_s[np.subtract(gaps, 1)]) / 2
    return np.insert(times_s, gaps, within_s), np.insert(values, gaps, np.nan)


def _draw_residuals(axes: Axes, fitted: EnergyFit, every: int) -> None:
    residuals = fitted.power_w - fitted.model.power_w(fitted.times_s)
    axes.plot(*_broken(fitted.times_s[::every], residuals[::every]), color=GREY, linewidth=0.7)
    axes.axhline(0, color="black", linewidth=0.6)
    axes.set(ylabel="residual [W]", xlabel="time [s]", title="Residuals")


def draw_periodogram(axes: Axes, times_s: FloatArray, power_w: FloatArray, order: int) -> None:
    """The periodogram of a power log; times [s] and power [W] as `eadp.measure.spectrum.periodogram`."""
    from eadp.measure.spectrum import periodogram  # slow to import, and no matter of a profile

    period_s, r2 = periodogram(times_s, power_w, order)
    axes.plot(period_s, r2, color=COLOURS[0], linewidth=0.9)
    axes.axhline(0, color="black", linewidth=0.6)
    scale_by_decades(axes)
    axes.set(ylim=(-0.27, max(0.3, min(1.02, 1.1 * float(r2.max())))), xlabel="period [s]", ylabel="cross-validated R²")


def _draw_periodogram(axes: Axes, fitted: EnergyFit) -> None:
    axes.set_title("Periodogram")
    draw_periodogram(axes, fitted.times_s, fitted.power_w, fitted.model.order or 1)
    best_s = fitted.spectrum.period_s
    if math.isfinite(best_s):
        if fitted.model.periodic:
            axes.axvline(best_s, color=COLOURS[1], linewidth=1.2, label=f"{best_s:.5g} s")
        else:
            axes.axvline(best_s, color=GREY, linewidth=1.2, dashes=(4, 3), label=f"{best_s:.4g} s, not significant")
        legend_above(axes)


def _draw_folded(axes: Axes, fitted: EnergyFit, every: int) -> None:
    best_s, periodic = fitted.spectrum.period_s, fitted.model.periodic
    axes.set_title("Folded over the period" if periodic else "Folded over the best candidate")
    if not math.isfinite(best_s):
        write_none(axes, "no period")
        return
    phase_s, colour = fitted.times_s[::every] % best_s, COLOURS[0] if periodic else GREY
    axes.plot(phase_s, fitted.power_w[::every], ".", color=colour, markersize=2.5, alpha=0.4, label="samples")
    times = np.linspace(0, best_s, 400)
    axes.plot(times, fitted.model.power_w(times), color=COLOURS[1], linewidth=1.5, label="fit")
    axes.set(xlabel="time within the period [s]", ylabel="power [W]")
    legend_above(axes)


# --- a profile

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
        _draw_profile(figure.subplots(), profile)


def _draw_profile(axes: Axes, part: Profile) -> None:
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
        powers_w = [part.interpolant.at(each) for each in at.tolist()]
        axes.plot(fine, powers_w, color=colour, linewidth=1.4, label=label or "model")
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
