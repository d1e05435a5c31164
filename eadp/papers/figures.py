"""The letter's figures of a flight: power, estimate and constraint (Fig. 6b), and the power spectrum (Fig. 1)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eadp.api.flight import Flight
from eadp.core.arrays import FloatArray
from eadp.io.figures.canvas import COLOURS, Axes, figure_pair, legend_above, write_none
from eadp.models.world import Step, World
from eadp.papers.estimator import PowerEstimate
from eadp.plug_ins import plug_in

DETAIL_PERIODS = 4
DETAIL_S = 120.0
"""Length of the detail, from take-off, in periods, or in seconds without a period."""

FORECASTS = 16
"""Most forecasts drawn in the detail."""

POINTS = 200
"""Points of a forecast."""

MIN_SAMPLES = 100
"""Fewest steps of a flight whose spectrum is drawn."""

MAX_HARMONICS = 6
"""Frequencies up to this multiple of 1/T are shown, or up to as many tenths of a hertz without a period."""


def write_figure(flight: Flight, folder: Path) -> None:
    """Draw the figure of a flight into its result folder, see `write_paper_figure`."""
    write_paper_figure(folder / "paper.svg", flight.inputs.world, flight.steps, flight.estimates)


def write_paper_figure(path: Path, world: World, steps: Sequence[Step], estimates: Sequence[PowerEstimate]) -> None:
    """Draw a flight as the letter's Figs. 6b and 1 do.

    Power and estimate; a detail with the forecasts over the horizon; period; battery and output constraint; the state
    q; the power spectrum of the motion, and its periodogram. Written to `path` with the endings .svg and .png.

    Source: letter, Figs. 1 and 6b.
    """
    time = np.array([step.time_s for step in steps])
    power = np.array([step.power_w for step in steps])
    last = estimates[-1]
    until = DETAIL_PERIODS * last.period_s if last.period_s else DETAIL_S
    early = [one for one in estimates if one.time_s <= until]
    with figure_pair(path, 11.5, 15.0) as figure:
        grid = figure.add_gridspec(5, 2)
        whole, detail = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, :])
        _draw_power(whole, time, power, estimates)
        whole.set_title("Power and estimate")
        legend_above(whole)
        _draw_detail(detail, time, power, early, min(until, float(time[-1])))
        _draw_period(figure.add_subplot(grid[2, 0]), time, estimates)
        _draw_battery(figure.add_subplot(grid[2, 1]), world, steps, estimates)
        _draw_state(figure.add_subplot(grid[3, 0]), figure.add_subplot(grid[3, 1]), early)
        motion = power - np.array([one.computing_w for one in estimates])
        _draw_spectra(figure.add_subplot(grid[4, 0]), figure.add_subplot(grid[4, 1]), time, motion, last)


def _draw_power(axes: Axes, time: FloatArray, power: FloatArray, estimates: Sequence[PowerEstimate]) -> None:
    axes.plot(time, power, color=COLOURS[0], linewidth=2.4, alpha=0.45, label="power Υ")
    read, now = [one.time_s for one in estimates], [one.horizon_w()[0] for one in estimates]
    axes.plot(read, now, color=COLOURS[1], linewidth=0.8, label="estimate y")
    low, high = float(power.min()), float(power.max())
    margin = 0.15 * max(high - low, 1.0)
    axes.set(ylim=(low - margin, high + margin), xlabel="time [s]", ylabel="power [W]")


def _draw_detail(
    axes: Axes, time: FloatArray, power: FloatArray, estimates: Sequence[PowerEstimate], until: float
) -> None:
    """The first periods, with forecasts over the horizon that do not overlap."""
    shown = time <= until
    _draw_power(axes, time[shown], power[shown], estimates)
    next_s = 0.0
    for one in estimates:
        if one.time_s >= next_s:
            next_s = one.time_s + max(one.horizon_s, until / FORECASTS)
            ahead = np.linspace(0.0, one.horizon_s, POINTS)
            label = "forecast ŷ over the horizon"
            axes.plot(one.time_s + ahead, one.forecast_w(ahead), color="black", linewidth=0.9, label=label)
            axes.plot(one.time_s, one.horizon_w()[0], "o", color="black", markersize=3)
    axes.set(xlim=(0, until), title="Detail: the first periods")
    legend_above(axes, 3)


def _draw_period(axes: Axes, time: FloatArray, estimates: Sequence[PowerEstimate]) -> None:
    periods = np.array([np.nan if one.period_s is None else one.period_s for one in estimates])
    axes.plot(time, periods, color=COLOURS[3], linewidth=1.3)
    axes.set(ylim=(0, None), xlabel="time [s]", ylabel="T [s]", title="Period T")
    if np.isnan(periods).all():
        write_none(axes, "no period")


def _draw_battery(axes: Axes, world: World, steps: Sequence[Step], estimates: Sequence[PowerEstimate]) -> None:
    """State of charge, and the letter's output constraint beside the largest power of each horizon."""
    time, battery = [step.time_s for step in steps], world.mission.battery
    limit = np.array([battery.power_limit_w(step.soc) for step in steps])
    limit[np.isinf(limit)] = np.nan
    label = "largest power" if battery.letter_crate_per_h is None else "limit b Q_c V"
    axes.plot(time, limit, color=COLOURS[6], linewidth=4.0, alpha=0.4, label=label)
    largest = [float(one.horizon_w().max()) for one in estimates]
    axes.plot([one.time_s for one in estimates], largest, color=COLOURS[1], linewidth=0.9, label="largest ŷ")
    axes.set(
        ylim=(0, 1.08 * np.nanmax([*limit, *largest])),
        xlabel="time [s]",
        ylabel="power [W]",
        title="Battery and horizon",
    )
    charge = axes.twinx()
    charge.plot(time, [100 * step.soc for step in steps], color=COLOURS[2], linewidth=1.3, label="b")
    charge.spines["right"].set_visible(True)
    charge.grid(False)
    charge.set(ylim=(0, 108), ylabel="state of charge b [%]")
    handles = [*axes.get_lines(), *charge.get_lines()]
    legend_above(axes, 3, handles=handles)


def _draw_state(level: Axes, harmonics: Axes, estimates: Sequence[PowerEstimate]) -> None:
    """q in the detail: the mean α0, and the harmonics α1, β1, …"""
    time = np.array([one.time_s for one in estimates])
    states = np.array([one.state[:-2] for one in estimates])
    settled = states[time >= time[-1] / DETAIL_PERIODS]
    level.plot(time, states[:, 0], color="black", linewidth=1.3)
    level.set_title("State q: the mean of the motion, α0")
    harmonics.set_title("State q: harmonics")
    for j in range(1, (states.shape[1] + 1) // 2):
        colour = COLOURS[(j - 1) % len(COLOURS)]
        harmonics.plot(time, states[:, 2 * j - 1], color=colour, linewidth=1.2, label=f"α{j}")
        harmonics.plot(time, states[:, 2 * j], color=colour, linewidth=1.2, dashes=(3, 1.5), label=f"β{j}")
    if states.shape[1] > 1:
        legend_above(harmonics, 6, columnspacing=0.9, handlelength=1.4)
    else:
        write_none(harmonics, "no harmonics")
    for axes, values in ((level, settled[:, :1]), (harmonics, settled[:, 1:])):
        axes.set(xlabel="time [s]", ylabel="coefficient [W]")
        if values.size:  # the first period's are far off: the figure is of what follows
            low, high = float(values.min()), float(values.max())
            axes.set_ylim(low - 0.5 * (high - low) - 0.5, high + 0.5 * (high - low) + 0.5)


def _draw_spectra(left: Axes, right: Axes, time: FloatArray, motion: FloatArray, last: PowerEstimate) -> None:
    """The power spectrum and the periodogram of the motion's power; T and its harmonics are marked."""
    left.set_title("Power spectrum of the motion")
    right.set_title("Periodogram of the motion")
    left.set(xlabel="frequency [Hz]", ylabel="power spectral density [W²/Hz]")
    if len(time) < MIN_SAMPLES or np.ptp(motion) < 1e-9:
        for axes in (left, right):
            write_none(axes, "no spectrum")
        return
    from scipy.signal import periodogram as spectrum

    every_s = float(time[1] - time[0])
    frequency, density = spectrum(motion[:-1], 1 / every_s, window="hann")  # the last step may be a part of one
    order = (len(last.state) - 3) // 2
    shown = (frequency > 0) & (frequency <= MAX_HARMONICS / (last.period_s or 10.0))
    left.plot(frequency[shown], density[shown], color=COLOURS[0], linewidth=1.1)
    plug_in("charts", "periodogram")(right, time, motion, order or 1)
    if last.period_s:
        for j in range(1, order + 1):
            label = f"j/T, j = 1 … {order}"
            left.axvline(j / last.period_s, color=COLOURS[1], linewidth=0.9, dashes=(4, 3), label=label)
        right.axvline(last.period_s, color=COLOURS[1], linewidth=0.9, dashes=(4, 3), label=f"T = {last.period_s:.1f} s")
        legend_above(right)
        if order:
            legend_above(left)
