"""The figure of a sweep: the mean of a result over two keys."""

from __future__ import annotations

import math

import numpy as np

from eadp.errors import printable
from eadp.io.figures.canvas import Axes, figure_file
from eadp.simulation.sweep.statistics import Table

TITLES = {
    "completed": "share of flights that complete",
    "duration_s": "duration, mean [s]",
    "soc_final": "state of charge at the end, mean",
    "quality": "quality U, mean",
}
SHARES = ("completed", "quality")
"""Results whose colours always go from 0 to 1, so that two figures can be compared."""

TICKS = 25
WRITTEN = 12
"""Most columns of cells that have their number written in."""


def write_table_figure(path: str, table: Table) -> None:
    """Draw a table as a heat map: the first key upwards, the second to the right; cells without a flight stay empty.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the file cannot be written.
    """
    rows, columns = len(table.rows), len(table.columns)
    with figure_file(path, min(12.0, 3.2 + 0.42 * columns), min(9.0, 1.8 + 0.36 * rows)) as figure:
        axes = figure.add_subplot()
        means = np.array([[math.nan if mean is None else mean for mean in line] for line in table.means])
        low, high = _ends(table)
        x, y = np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5
        image = axes.pcolormesh(x, y, np.ma.masked_invalid(means), cmap="viridis", vmin=low, vmax=high)
        figure.colorbar(image, ax=axes, label=TITLES[table.value])
        axes.grid(False)
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
    axes.set_ylabel(printable(upward, 60))
    axes.set_xlabel(printable(rightward, 60))
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
    digits = 0 if table.value == "duration_s" else 2
    for i, line in enumerate(table.means):
        for j, mean in enumerate(line):
            if mean is not None:
                colour = "black" if mean > low + 0.6 * (high - low) else "white"
                axes.text(j, i, f"{mean:.{digits}f}", ha="center", va="center", fontsize=7, color=colour)
