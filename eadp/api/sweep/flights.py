"""The flights of a sweep as a list that a notebook can show."""

from __future__ import annotations

from eadp.io.sweep.results import COLUMNS
from eadp.io.sweep.statistics import SweepFlight, totals
from eadp.io.text.frames import AnyTable, frame, html_table


class SweepFlights(list[SweepFlight]):
    """The flights of a sweep, in the order of its runs."""

    def table(self) -> AnyTable:
        """A row for each run: the varied keys, the figures of its flight, seed and error; see `frames.frame`."""
        keys = list(dict.fromkeys(key for flight in self for key in flight.values))
        columns = {key: [flight.values.get(key) for flight in self] for key in keys}
        return frame(
            columns | {name: [getattr(flight, name) for flight in self] for name in (*COLUMNS, "seed", "error")}
        )

    def __repr__(self) -> str:
        """Counts, not the flights."""
        whole = totals(self)
        return f"<{whole.runs} flights: {whole.completed} completed, {whole.failed} not made>"

    def _repr_html_(self) -> str:
        whole = totals(self)
        rows = [("runs", str(whole.runs)), ("completed", str(whole.completed)), ("not made", str(whole.failed))]
        return html_table(rows)
