"""The picture of a fit: the log with its fit, what is left, the score of every period, and the lap."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from eadp.core.signals.spectrum import periodogram
from eadp.io.figures.pictures import COLOURS, GREY, picture
from eadp.models.energy_fit import EnergyFit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 4000
"""Most samples drawn; of more, every second, third, … is."""


def write_fit_figure(path: str, fitted: EnergyFit) -> None:
    """Draw a fit.

    Parameters
    ----------
    path : str
        A name that ends in .svg or .png.
    fitted : Fitted

    Raises
    ------
    InputError
        If it ends in neither, or the place cannot be written to.
    """
    with picture(path, 10.5, 8.0) as figure:
        grid = figure.add_gridspec(3, 2, height_ratios=(1.25, 0.8, 1.25))
        log = figure.add_subplot(grid[0, :])
        _draw_log(log, fitted)
        _draw_residual(figure.add_subplot(grid[1, :], sharex=log), fitted)
        _draw_scores(figure.add_subplot(grid[2, 0]), fitted)
        _draw_lap(figure.add_subplot(grid[2, 1]), fitted)
        figure.suptitle(_headline(fitted), x=0.01, ha="left", fontsize=11, fontweight="bold")


def _headline(fitted: EnergyFit) -> str:
    model = fitted.model
    if model.period_s is None:
        return f"no period  ·  mean {model.mean_w:.4g} W  ·  spread {model.noise_std_w:.3g} W"
    parts = [f"period {model.period_s:.5g} s", f"order {model.order}", f"mean {model.mean_w:.4g} W"]
    return "  ·  ".join([*parts, f"noise {model.noise_std_w:.3g} W", f"R² {model.cv_r2:.2f} of blocks held out"])


def _draw_log(axes: Axes, fitted: EnergyFit) -> None:
    every = math.ceil(len(fitted.times_s) / POINTS)
    axes.plot(fitted.times_s[::every], fitted.power_w[::every], color=COLOURS[0], linewidth=0.7, alpha=0.7, label="log")
    times = np.linspace(0, fitted.times_s[-1], POINTS)
    axes.plot(times, fitted.model.power_w(times), color=COLOURS[1], linewidth=1.3, label="fit")
    axes.set_ylabel("power [W]")
    axes.set_title("Log", loc="left", fontsize=10)
    axes.tick_params(labelbottom=False)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=8)


def _draw_residual(axes: Axes, fitted: EnergyFit) -> None:
    every = math.ceil(len(fitted.times_s) / POINTS)
    residual = fitted.power_w - fitted.model.power_w(fitted.times_s)
    axes.plot(fitted.times_s[::every], residual[::every], color=GREY, linewidth=0.7)
    axes.axhline(0, color="black", linewidth=0.6)
    axes.set_ylabel("left [W]")
    axes.set_xlabel("time [s]")
    axes.set_title("What the fit leaves", loc="left", fontsize=10)


def _draw_scores(axes: Axes, fitted: EnergyFit) -> None:
    period_s, r2 = periodogram(fitted.times_s, fitted.power_w, fitted.model.order or 1)
    axes.plot(period_s, r2, color=COLOURS[0], linewidth=0.9)
    axes.axhline(0, color="black", linewidth=0.6)
    best_s, counts = fitted.spectrum.period_s, fitted.model.periodic
    if math.isfinite(best_s):
        name = f"{best_s:.5g} s" if counts else f"the best, {best_s:.4g} s: it does not count"
        axes.axvline(
            best_s, color=COLOURS[1] if counts else GREY, linewidth=1.2, dashes=() if counts else (4, 3), label=name
        )
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_ylim(-0.27, max(0.3, min(1.02, 1.1 * float(r2.max()))))
    axes.set_xlabel("period [s]")
    axes.set_ylabel("R² of blocks held out")
    axes.set_title("Score of a period", loc="left", fontsize=10)


def _draw_lap(axes: Axes, fitted: EnergyFit) -> None:
    best_s, counts = fitted.spectrum.period_s, fitted.model.periodic
    axes.set_title("One lap" if counts else "One lap, if the best period were one", loc="left", fontsize=10)
    if not math.isfinite(best_s):
        axes.text(0.5, 0.5, "no period", transform=axes.transAxes, ha="center", va="center", color=GREY)
        axes.set_axis_off()
        return
    every = math.ceil(len(fitted.times_s) / POINTS)
    turn = fitted.times_s[::every] % best_s
    axes.plot(
        turn,
        fitted.power_w[::every],
        ".",
        color=COLOURS[0] if counts else GREY,
        markersize=2.5,
        alpha=0.4,
        label="samples",
    )
    times = np.linspace(0, best_s, 400)
    axes.plot(times, fitted.model.power_w(times), color=COLOURS[1], linewidth=1.5, label="fit")
    axes.set_xlabel("time in the lap [s]")
    axes.set_ylabel("power [W]")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=8)
