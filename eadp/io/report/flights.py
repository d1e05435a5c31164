"""Several flights beside each other: a figure, a table of what differs, and a page of both."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from eadp.io.figures.flights import DrawnFlight, write_flights_figure
from eadp.io.flight.words import label_of, parameter_text
from eadp.io.text.tables import aligned

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
