"""A field divided among sorties: the fewest parts, each of which one pack covers with the way there and back.

The lines of the field stand one after the other, as one length. A sortie has an interval of it: whole lines where that
costs nothing, and part of one at either end where it saves a sortie. What a sortie leaves of its pack is the caller's
forecast. The ends of sorties are moved until all leave the same; where that is too little, there are as many as would
be enough by what they leave.

Source: Prins 2004 (Computers & Operations Research 31) for a tour that is divided; the ends are found by secants.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eadp.api.inputs import FlightInputs
from eadp.core.arrays import FloatArray
from eadp.core.geometry.polygons import FAR_M, clipped, ground_m2
from eadp.errors import Infeasible
from eadp.models.airspace import Field
from eadp.planning.forecast.held import Preflight
from eadp.survey.coverage import LineGrid
from eadp.survey.report import CoveragePlan
from eadp.survey.swaths import CoveragePath

MAX_RISE = 1.25
"""Ratio by which the number of sorties rises at most: what few long ones forecast is less sure."""

ALIKE_ROUNDS = 4
"""Most times that the ends of all sorties are moved until all leave about the same."""

MAX_SORTIES = 200
SAME_M = 1e-2
"""Places so close are the same [m]: a line is not cut for less."""


def whole_lines(ground: Field, field: Field, grid: LineGrid, gap_m: float, min_share: float) -> Field | None:
    """What is left of a field, as ground of lines to fly again: lines with only scraps of it are left out.

    Parameters
    ----------
    ground, field : Field
        What is left, and the whole.
    grid : LineGrid
        The lines of the field.
    gap_m : float
        Shorter gaps of a line are flown, too [m].
    min_share : float
        Share of a line's ground below which it is not flown for what is left of it.

    Returns
    -------
    Field or None
        The whole ground of the lines, from the first place where some is left to the last; None without any.
    """
    windows = []
    for i, spans in enumerate(grid.extents(ground)):
        joined: list[tuple[float, float]] = []  # the spans, with short gaps between them filled
        for low, high in spans:
            if joined and low - joined[-1][1] < gap_m:
                joined[-1] = joined[-1][0], high
            else:
                joined.append((low, high))
        for low, high in joined:
            window = grid.window(i, low, high)
            left_m2, whole_m2 = (
                sum(ground_m2(*part) for part in clipped(each.parts, [window])) for each in (ground, field)
            )
            if left_m2 >= min_share * whole_m2:
                windows.append(window)
    return field.with_parts(clipped(field.parts, windows)) if windows else None


class Division:
    """The lines of a field one after the other, as one length on which a place is counted from the first line's start.

    Parameters
    ----------
    field : Field
    grid : LineGrid
        Its lines.
    overlap_m : float
        Length that both parts of a line that is cut cover [m].
    order : sequence of int, optional
        The lines of the grid in the order in which they stand; by default side by side.
    """

    def __init__(self, field: Field, grid: LineGrid, overlap_m: float, order: Sequence[int] | None = None) -> None:
        self._field, self._grid, self._overlap_m = field, grid, overlap_m
        extents = grid.extents(field)
        self._order = [i for i in (range(len(extents)) if order is None else order) if extents[i]]
        self._extents = [extents[i] for i in self._order]
        lengths = [sum(high - low for low, high in spans) for spans in self._extents]
        # where line k starts, and line k − 1 ends, in the order [m]
        self._ends: FloatArray = np.concatenate([[0.0], np.cumsum(lengths)])

    @property
    def total_m(self) -> float:
        """Length of all lines [m]."""
        return float(self._ends[-1])

    @property
    def lines(self) -> int:
        """The number of lines over ground."""
        return len(self._order)

    @property
    def end_of_first_m(self) -> float:
        """The end of the first line [m]."""
        return float(self._ends[1])

    def between_lines(self, place_m: float) -> float:
        """The nearest place between two lines [m]."""
        return float(self._ends[np.abs(self._ends - place_m).argmin()])

    def part(self, start_m: float, end_m: float) -> Field:
        """The ground of the lines between two places [m]; of a line cut at `start_m`, with the overlap before it."""
        windows = []
        for k, line in enumerate(self._order):
            own_start, own_end = float(self._ends[k]), float(self._ends[k + 1])
            if own_end <= start_m + SAME_M or own_start >= end_m - SAME_M:
                continue
            low = -FAR_M if start_m <= own_start + SAME_M else self._along(k, start_m) - self._overlap_m
            high = FAR_M if end_m >= own_end - SAME_M else self._along(k, end_m)
            windows.append(self._grid.window(line, low, high))
        return self._field.with_parts(clipped(self._field.parts, windows))

    def _along(self, k: int, place_m: float) -> float:
        """The v in the grid's frame of a place on line k of the order, counted from 0 [m]; gaps in a line count 0."""
        rest_m = place_m - float(self._ends[k])
        for low, high in self._extents[k]:
            if rest_m <= high - low:
                return low + rest_m
            rest_m -= high - low
        return self._extents[k][-1][1]


@dataclass(frozen=True)
class PlannedSortie:
    """One flight: its plan, and its forecast, which is that of `SortiePlanner.sortie`.

    Attributes
    ----------
    plan : CoveragePlan
    inputs : FlightInputs
    forecast : Preflight
    spare : float
        Charge at the end above the reserve, and above that with which the autopilot turns back, that is there with the
        probability of the reserve, as a share of a pack.
    """

    plan: CoveragePlan
    inputs: FlightInputs
    forecast: Preflight
    spare: float

    @property
    def used(self) -> float:
        """Charge that the whole flight takes, as a share of a pack."""
        charge, soc_end = self.inputs.mission.battery.soc, self.forecast.forecast.soc_end
        # of a pack that is empty before the end, what the flight would take
        return charge - soc_end if soc_end else charge - self.inputs.scenario.keys.reserve_soc - self.spare

    @property
    def energy_wh(self) -> float:
        """Energy that it takes [Wh]."""
        return self.forecast.forecast.energy_wh or 0.0

    @property
    def used_on_lines(self) -> float:
        """Charge that it takes from the first line to the last, as a share of a pack."""
        return self.used * (1 - self.plan.solution.access_s / self.plan.solution.time_s)

    def path(self) -> CoveragePath:
        """Its path at the spacing that is forecast."""
        solution = self.plan.solution
        return solution.path(self.forecast.decided[0] if solution.min_c1 < 0 else 0.0)


Interval = tuple[float, float]


class Divided(NamedTuple):
    """Sorties in the order of their lines, and the intervals of the lines that they have [m]."""

    intervals: list[Interval]
    sorties: list[PlannedSortie]

    @property
    def lengths_m(self) -> FloatArray:
        """Lengths of the intervals [m]."""
        return np.array([end - start for start, end in self.intervals])

    @property
    def spares(self) -> FloatArray:
        """Charge that each leaves above what has to be left, as a share of a pack."""
        return np.array([sortie.spare for sortie in self.sorties])

    @property
    def used_per_m(self) -> float:
        """Charge that a metre of the lines takes, as a share of a pack."""
        return max(sum(sortie.used_on_lines for sortie in self.sorties) / float(self.lengths_m.sum()), 1e-12)

    def expected(self, lengths_m: FloatArray) -> FloatArray:
        """The spare charge that each is expected to have with other lengths of lines, as a share of a pack."""
        return self.spares + self.used_per_m * (self.lengths_m - lengths_m)

    @property
    def needed(self) -> int:
        """The number of sorties that all lines take, by the mean charge that these have for lines: used and spare."""
        used = sum(sortie.used_on_lines for sortie in self.sorties)
        available = used + float(self.spares.sum())
        return math.ceil(len(self.sorties) * used / available - 1e-9) if available > 0 else MAX_SORTIES + 1

    @property
    def shortest(self) -> PlannedSortie:
        """The sortie with the least charge above what has to be left."""
        return min(self.sorties, key=lambda sortie: sortie.spare)


@dataclass(frozen=True)
class Divider:
    """Finds the fewest sorties.

    Attributes
    ----------
    division : Division
    forecast : function
        The sortie over a part of the field.
    cuts : bool
        Whether lines may be cut.
    on_part : function
        Called with the progress before each forecast.
    """

    division: Division
    forecast: Callable[[Field], PlannedSortie]
    cuts: bool = True
    on_part: Callable[[str], None] = lambda _: None
    _known: dict[Interval, PlannedSortie] = field(default_factory=dict)

    def fewest(self, min_count: int) -> Divided:
        """The division into the fewest sorties found that can all be flown, `min_count` or more.

        Raises
        ------
        Infeasible
            If even a short part of a line is too far, or whole lines cannot be divided so where lines are not cut.
        """
        count = min_count
        while (found := self._alike(count)).shortest.spare < 0:
            needed = found.needed if self.cuts else count + 1
            if max(count + 1, needed) > MAX_SORTIES:
                far = "a pack does not last for the way to the field and back"
                raise Infeasible(far if self.cuts else f"{MAX_SORTIES} sorties are too few")
            count = max(count + 1, min(needed, int(MAX_RISE * count)))
        return found

    def _alike(self, count: int) -> Divided:
        """The division into `count` sorties of about the same spare charge, with whole lines where that is enough.

        Where none is found that can be flown: the last one tried. Raises Infeasible where whole lines are too few, and
        lines are not cut.
        """
        places, found = np.linspace(0.0, self.division.total_m, count + 1), None
        for _ in range(ALIKE_ROUNDS):
            whole = np.array([*map(self.division.between_lines, places)])
            apart = len(set(whole.tolist())) == count + 1
            if not (apart or self.cuts):
                break
            # ends between lines: in the first round, and where all sorties are then expected to be flown
            if not self.cuts or (apart and (found is None or found.expected(np.diff(whole)).min() >= 0)):
                places = whole
            found = self._divided_at(places)
            spares = found.spares
            if spares.min() >= 0 or spares.mean() < 0:
                break
            # a sortie with more spare charge than the mean takes on as much more of the lines as uses it up
            lengths_m = found.lengths_m + (spares - spares.mean()) / found.used_per_m
            lengths_m = np.maximum(lengths_m, 0.02 * found.lengths_m)
            places = np.concatenate([[0.0], np.cumsum(lengths_m)]) * (self.division.total_m / float(lengths_m.sum()))
        if found is None:
            raise Infeasible(f"{self.division.lines} whole lines have no division into {count} sorties or more")
        return found

    def _divided_at(self, ends_m: FloatArray) -> Divided:
        """The sorties between some places along all lines, in their order [m]; empty ones are left out."""
        rounded = [round(end_m, 3) for end_m in ends_m.tolist()]  # `_known` has intervals to the millimetre
        intervals = [pair for pair in itertools.pairwise(rounded) if pair[1] > pair[0]]
        return Divided(intervals, [self._sortie(interval) for interval in intervals])

    def _sortie(self, interval: Interval) -> PlannedSortie:
        """The sortie over an interval [m], forecast once."""
        if interval not in self._known:
            share = interval[1] / self.division.total_m
            self.on_part(f"lines divided up to {100 * share:.0f} %, {len(self._known)} parts tried")
            self._known[interval] = self.forecast(self.division.part(*interval))
        return self._known[interval]
