"""Parameters flown, as shares of their sets."""

from __future__ import annotations

from collections.abc import Sequence

from eadp.models.plan.cursor import Vector
from eadp.models.plan.stage import Box


class ParameterAverages:
    """Time integrals of the parameters flown, as shares of their sets, over the time in which each was free."""

    def __init__(self, count: int) -> None:
        self.areas_s = [0.0] * count
        self.times_s = [0.0] * count
        self._since_s = 0.0
        self._held: tuple[Vector, Sequence[Box]] | None = None

    def hold(self, time_s: float, parameters: Vector, sets: Sequence[Box]) -> None:
        """Parameters and sets in force from a time on [s]."""
        if self._held is not None:
            self.times_s, self.areas_s = self.until(time_s)
        self._since_s, self._held = time_s, (parameters, sets)

    def until(self, time_s: float) -> tuple[list[float], list[float]]:
        """Times and areas of shares up to a time [s], the parameters in force included."""
        times, areas = list(self.times_s), list(self.areas_s)
        if self._held is not None and self._held[1]:
            duration = time_s - self._since_s
            for i, (value, box) in enumerate(zip(*self._held, strict=True)):
                share = box.share(value)
                if share is not None:
                    areas[i] += share * duration
                    times[i] += duration
        return times, areas
