"""Several flights beside each other: a figure, a table of what differs, and a page of both."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from eadp.core.expressions.tree import number_text
from eadp.io.figures.canvas import COLOURS, GREY, START, Axes, draw_ground, figure_pair, label_map, legend_above
from eadp.io.flight import label_of, parameter_text
from eadp.io.text.json import aligned
from eadp.models.plan.plan import Plan

Row = tuple[str, Callable[[Mapping[str, Any]], str]]


UNKNOWN = "–"
ROWS: tuple[Row, ...] = (
    ("completed", lambda s: "yes" if s["completed"] else f"NO: {s['reason']}"),
    ("time [s]", lambda s: f"{s['duration_s']:.1f}"),
    ("distance [km]", lambda s: f"{s['distance_m'] / 1000:.2f}"),
    ("energy [Wh]", lambda s: f"{s['energy_wh']:.3f}"),
    ("charge at the end", lambda s: f"{s['soc_final']:.3f}"),
    ("reserve kept", lambda s: "yes" if s["reserve_kept"] else "NO"),
    ("quality U", lambda s: UNKNOWN if s["quality"] is None else f"{s['quality']:.3f}"),
    ("ground covered", lambda s: UNKNOWN if s["coverage"] is None else f"{100 * s['coverage']:.1f} %"),
    ("re-plannings", lambda s: f"{s.get('decisions', UNKNOWN)}, failed runs of OSQP {s['solver']['failed']}"),
    ("obstacles entered", lambda s: ", ".join(entry["name"] for entry in s["obstacles"]) or "none"),
)
"""What is compared: its name, and how it is written of a summary."""


def comparison(flights: Sequence[DrawnFlight]) -> list[list[str]]:
    """A table: a header with the flights' names, and a row for each figure and each parameter."""
    table = [["", *(flight.name for flight in flights)]]
    rows = [[name, *(text(flight.summary) for flight in flights)] for name, text in ROWS]
    table += [row for row in rows if set(row[1:]) != {UNKNOWN}]
    parameters = [
        {label_of(name, values): parameter_text(values) for name, values in flight.summary["parameters"].items()}
        for flight in flights
    ]
    for label in dict.fromkeys(label for each in parameters for label in each):
        table.append([label, *(each.get(label, UNKNOWN) for each in parameters)])
    return table


def table_text(table: Sequence[Sequence[str]]) -> str:
    """A table for people."""
    return "\n".join(aligned(table, "<", "<"))


def draw_flights(flights: Sequence[DrawnFlight]) -> dict[str, bytes]:
    """The figure of several flights, drawn once: its files by their endings, .svg and .png."""
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "figure"
        write_flights_figure(draft, flights)
        return {path.suffix: path.read_bytes() for path in draft.parent.iterdir()}


def flights_data(flights: Sequence[DrawnFlight], svg: bytes) -> dict[str, Any]:
    """The data of the page: the figure as an image, and the table."""
    plans = {flight.plan.name.rpartition("/")[2] for flight in flights}
    return {
        "title": f"{len(flights)} flights",
        "plans": sorted(plans),
        "figure": base64.b64encode(svg).decode(),
        "table": comparison(flights),
    }


COLUMNS = 4
"""Most paths side by side."""

DASHES: tuple[Any, ...] = ("-", *((0, dashes) for dashes in ((8, 4), (3, 3), (10, 3, 2, 3), (14, 4), (5, 2, 1, 2))))
"""Of the curves, as in the pages: where some have one value, each shows in the gaps of the next."""


class DrawnFlight(NamedTuple):
    """A flight with its name in the figure: its plan, `summary.json`, and the columns of `flight.csv`."""

    name: str
    plan: Plan
    summary: Mapping[str, Any]
    columns: Mapping[str, Sequence[float]]


def write_flights_figure(path: Path, flights: Sequence[DrawnFlight]) -> None:
    """Draw several flights. Written to `path` with the endings .svg and .png.

    Parameters
    ----------
    path : Path
    flights : sequence of DrawnFlight
        Two or more, with names of their own.
    """
    names = list(dict.fromkeys(item.label for flight in flights for item in flight.plan.parameters))
    across = min(len(flights), COLUMNS)
    maps = -(-len(flights) // across)
    charts = ["power_w", "soc", *names]
    heights = [2.6] * maps + [1.0] * len(charts)
    with figure_pair(path, 11.5, 1.5 * sum(heights)) as figure:
        grid = figure.add_gridspec(len(heights), across, height_ratios=heights)
        xy = [[value for flight in flights for value in flight.columns[name]] for name in ("x_m", "y_m")]
        corners = [tuple(map(min, xy)), tuple(map(max, xy))]
        for i, flight in enumerate(flights):
            axes = figure.add_subplot(grid[i // across, i % across])
            _draw_path(axes, flight, COLOURS[i % len(COLOURS)])
            axes.update_datalim(corners)  # all maps show the same ground
        time: Axes | None = None
        for row, column in enumerate(charts, maps):
            time = figure.add_subplot(grid[row, :], sharex=time)
            _draw_column(time, flights, column)
            if column != charts[-1]:
                time.tick_params(labelbottom=False)
            if row == maps:
                legend_above(time, len(flights), handlelength=3)
        assert time is not None
        time.set_xlabel("time [s]")


def _draw_path(axes: Axes, flight: DrawnFlight, colour: str) -> None:
    columns, site = flight.columns, flight.plan.site
    draw_ground(axes, site.field, site.airspace)
    axes.plot(columns["x_m"], columns["y_m"], color=colour, linewidth=1.0)
    axes.plot(columns["x_m"][0], columns["y_m"][0], **START)
    completed = flight.summary["completed"]
    end: dict[str, Any] = {"marker": "s", "markersize": 4} if completed else {"marker": "X", "markersize": 9}
    axes.plot(columns["x_m"][-1], columns["y_m"][-1], color=colour, **end)
    label_map(axes, flight.name)


def _draw_column(axes: Axes, flights: Sequence[DrawnFlight], column: str) -> None:
    """One column of `flight.csv`, or a parameter by its label, over time, of the flights that have it."""
    title = {"power_w": "Power [W]", "soc": "State of charge"}.get(column)
    steps = "steps-post" if title is None else "default"
    axes.set_title(title or column)
    for i, flight in enumerate(flights):
        item = next((item for item in flight.plan.parameters if item.label == column), None)
        if item is None and title is None:
            continue
        if item is not None and item.unit:
            axes.set_title(f"{item.label} [{item.unit}]")
        values = flight.columns[column] if item is None else [*map(item.shown, flight.columns[item.name])]
        time, colour = flight.columns["time_s"], COLOURS[i % len(COLOURS)]
        style: dict[str, Any] = {"linewidth": 0.6 if column == "power_w" else 1.4, "linestyle": DASHES[i % len(DASHES)]}
        axes.plot(time, values, color=colour, drawstyle=steps, label=flight.name, **style)
        if not flight.summary["completed"]:
            axes.plot(time[-1], values[-1], "X", color=colour, markersize=9)
    if column == "soc":
        for reserve in {flight.summary["soc_reserve"] for flight in flights}:
            axes.axhline(reserve, color=GREY, linewidth=0.9, dashes=(4, 3))
            axes.annotate(f"reserve {number_text(reserve)}", (0, reserve), fontsize=7, color=GREY, va="bottom")
