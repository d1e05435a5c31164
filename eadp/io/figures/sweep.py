"""The figure of a sweep: the mean of a result over two keys."""

from __future__ import annotations

import math

import numpy as np

from eadp.errors import printable
from eadp.io.figures.canvas import COLOURS, Axes, figure_file
from eadp.io.sweep.statistics import Table

TITLES = {
    "completed": "share of flights that complete",
    "duration_s": "duration, mean [s]",
    "soc_final": "state of charge at the end, mean",
    "quality": "quality U, mean",
    "reserve_kept": "share of flights that complete and keep the reserve",
    "energy_wh": "energy, mean [Wh]",
    "distance_m": "distance, mean [m]",
}
SHARES = ("completed", "quality", "reserve_kept")
"""Results whose colours always go from 0 to 1, so that two figures can be compared."""

TICKS = 25
WRITTEN = 12
"""Most columns of cells that have their number written in."""


def write_table_figure(path: str, table: Table) -> None:
    """Draw a table as a heat map: the first key upwards, the second to the right; cells without a flight stay empty.

    Cells with flights that did not complete are hatched, and say how many.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the file cannot be written.
    """
    rows, columns = len(table.rows), len(table.columns)
    beside_in, below_in = (0.06 * max(map(len, _ticks(labels)[1])) for labels in (table.rows, table.columns))
    width_in = 3.0 + beside_in + (0.6 if any(map(any, table.crashed)) else 0.42) * columns
    with figure_file(path, min(12.0, width_in), min(9.0, 1.8 + 0.7 * below_in + 0.36 * rows)) as figure:
        axes = figure.add_subplot()
        means = np.array([[math.nan if mean is None else mean for mean in line] for line in table.means])
        low, high = _ends(table)
        x, y = np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5
        image = axes.pcolormesh(x, y, np.ma.masked_invalid(means), cmap="viridis", vmin=low, vmax=high)
        figure.colorbar(image, ax=axes, label=TITLES[table.value])
        axes.grid(False)
        fell = [(j, i) for i, line in enumerate(table.crashed) for j, count in enumerate(line) if count]
        for j, i in fell:
            corners = [j - 0.5, j + 0.5, j + 0.5, j - 0.5], [i - 0.5, i - 0.5, i + 0.5, i + 0.5]
            axes.fill(*corners, fill=False, hatch="////", edgecolor=COLOURS[6], linewidth=0)
        if fell:
            axes.set_title("hatched: × flights not completed, in no mean")
        _label_axes(axes, table)
        if columns <= WRITTEN:
            _write_cells(axes, table)


def _ends(table: Table) -> tuple[float, float]:
    """The ends of the colour scale."""
    known = [mean for line in table.means for mean in line if mean is not None]
    if table.value in SHARES or not known:
        return 0.0, 1.0
    low, high = (0.0 if table.value == "soc_final" else min(known)), max(known)
    return (low, high) if low < high else (low, low + 1.0)


def _label_axes(axes: Axes, table: Table) -> None:
    upward, rightward = table.keys
    axes.set(ylabel=printable(upward, 60), xlabel=printable(rightward, 60))
    axes.set_yticks(*_ticks(table.rows))
    positions, labels = _ticks(table.columns)
    turned = max(map(len, labels)) > 4
    axes.set_xticks(positions, labels, rotation=45 if turned else 0, ha="right" if turned else "center")


def _ticks(labels: tuple[str, ...]) -> tuple[list[int], list[str]]:
    """Every label, or every n-th where there are many."""
    positions = list(range(0, len(labels), math.ceil(len(labels) / TICKS)))
    return positions, [printable(labels[i], 24) for i in positions]


def _write_cells(axes: Axes, table: Table) -> None:
    low, high = _ends(table)
    for i, line in enumerate(table.means):
        for j, mean in enumerate(line):
            text = table.text(i, j, 0 if table.value in ("duration_s", "distance_m") else 2)
            light = mean is None or mean > low + 0.6 * (high - low)
            axes.text(j, i, text, ha="center", va="center", fontsize=7, color="black" if light else "white")
