"""A field divided among sorties: the fewest parts, each of which one pack covers with the way there and back.

The lines of the field stand one after the other, as one length. A sortie has an interval of it: whole lines where that
costs nothing, and part of one at either end where it saves a sortie. What a sortie leaves of its pack is the caller's
forecast; the ends of the intervals are moved until all sorties leave the same.

Source: Prins 2004 (Computers & Operations Research 31) for routes that are divided; the balance is a secant method.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.polygons import clipped
from eadp.coverage.cover import LineGrid
from eadp.errors import Infeasible
from eadp.models.field import Field

ROUNDS = 6
"""Most times that the ends of sorties are moved until all leave the same."""

EVEN = 0.01
"""Sorties that leave the same charge within this share of a pack are even."""

OPTIMISM = 0.3
"""How much less than their estimate the sorties may be that are tried next: it may be too high."""

MAX_SORTIES = 200
FAR_M = 1e6
"""Beyond any field [m]."""

SAME_M = 1e-2
"""Places so close are the same [m]: a line is not cut for less."""

SEAM_M = 1e-6
"""By how much windows beside each other overlap [m]."""


class Division:
    """The lines of a field one after the other, and the ground of an interval of them.

    Parameters
    ----------
    field : Field
    grid : LineGrid
        Its lines.
    overlap_m : float
        What both parts of a line that is cut have in common [m].
    order : sequence of int, optional
        The lines of the grid in the order in which they stand; by default side by side.
    """

    def __init__(self, field: Field, grid: LineGrid, overlap_m: float, order: Sequence[int] | None = None) -> None:
        self._field, self._grid, self._overlap_m = field, grid, overlap_m
        extents = grid.extents(field)
        self._order = [i for i in (range(len(extents)) if order is None else order) if extents[i]]
        self._extents = [extents[i] for i in self._order]
        lengths = [sum(high - low for low, high in spans) for spans in self._extents]
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
        """The ground of the lines of an interval [m]."""
        windows = []
        for k, line in enumerate(self._order):
            own_start, own_end = float(self._ends[k]), float(self._ends[k + 1])
            if own_end <= start_m + SAME_M or own_start >= end_m - SAME_M:
                continue
            low = -FAR_M if start_m <= own_start + SAME_M else self._along(k, start_m) - self._overlap_m
            high = FAR_M if end_m >= own_end - SAME_M else self._along(k, end_m)
            windows.append(self._window(line, low, high))
        (outline, *holes), *others = clipped(self._field.parts, windows)
        return replace(self._field, outline=outline, holes=tuple(holes), others=tuple(map(tuple, others)))

    def _along(self, k: int, place_m: float) -> float:
        """The place along the k-th line, in the frame, at which so much of the length of all lines is flown."""
        left = place_m - float(self._ends[k])
        for low, high in self._extents[k]:
            if left <= high - low:
                return low + left
            left -= high - low
        return self._extents[k][-1][1]

    def _window(self, line: int, low_m: float, high_m: float) -> list[Point]:
        left, right = float(self._grid.edges_m[line]) - SEAM_M, float(self._grid.edges_m[line + 1]) + SEAM_M
        corners = ((left, low_m), (right, low_m), (right, high_m), (left, high_m))
        return [self._grid.frame.out(*corner) for corner in corners]


class Sortie(Protocol):
    """What is forecast of a sortie."""

    @property
    def spare(self) -> float:
        """Charge that it leaves above what has to be left, as a share of a pack; below 0 where it cannot be flown."""

    @property
    def used_on_lines(self) -> float:
        """Charge that it takes from the first line to the last, as a share of a pack."""


AnySortie = TypeVar("AnySortie", bound=Sortie)
Interval = tuple[float, float]


class Divided(NamedTuple, Generic[AnySortie]):
    """Sorties in the order of their lines, and the intervals of the lines that they have [m]."""

    intervals: list[Interval]
    sorties: list[AnySortie]

    @property
    def least(self) -> float:
        """The least charge that a sortie leaves above what has to be left."""
        return min(sortie.spare for sortie in self.sorties)


@dataclass(frozen=True)
class Divider(Generic[AnySortie]):
    """Finds the fewest sorties.

    Attributes
    ----------
    division : Division
    forecast : function
        The sortie over a part of the field.
    cuts : bool
        Whether lines may be cut.
    step : int
        The number of sorties is a whole multiple of it: of the aircraft.
    """

    division: Division
    forecast: Callable[[Field], AnySortie]
    cuts: bool = True
    step: int = 1

    @cached_property
    def _known(self) -> dict[Interval, AnySortie]:
        return {}

    def fewest(self, min_count: int) -> Divided[AnySortie]:
        """The division into the fewest sorties that can all be flown, of `min_count` or more.

        Raises
        ------
        Infeasible
            If even a short part of a line is too far.
        """
        most = MAX_SORTIES if self.cuts else min(MAX_SORTIES, self.division.lines)
        count = -(-max(min_count, 1) // self.step) * self.step
        while count <= most:
            found = self._even(count)
            whole = self._whole(found) if self.cuts and found.least >= -EVEN else found
            if whole is not None and whole.least >= 0:
                return whole
            if found.least >= 0:
                return found
            count = max(count + self.step, -(-self._enough(found) // self.step) * self.step)
        raise Infeasible(f"{most} sorties are too few")

    def _enough(self, found: Divided[AnySortie]) -> int:
        """About how many sorties are enough: what all lines take, over what one sortie has for lines."""
        each = np.mean([sortie.used_on_lines + sortie.spare for sortie in found.sorties])
        if each <= 0:
            raise Infeasible("a pack does not last for the way to the field and back")
        return math.ceil(sum(sortie.used_on_lines for sortie in found.sorties) / float(each) - OPTIMISM)

    def _even(self, count: int) -> Divided[AnySortie]:
        """The division into so many sorties whose ends are moved until each leaves enough, or all about the same.

        Where they leave too little in the mean, it is not searched further.
        """
        total_m = self.division.total_m
        places = np.linspace(0.0, total_m, count + 1)
        best: Divided[AnySortie] | None = None
        for _ in range(ROUNDS):
            found = self._at(places if self.cuts else np.array([*map(self.division.between_lines, places)]))
            if best is None or found.least > best.least:
                best = found
            spares = np.array([sortie.spare for sortie in found.sorties])
            used = np.array([sortie.used_on_lines for sortie in found.sorties])
            if found.least >= 0 or np.ptp(spares) <= EVEN or spares.mean() < 0:
                break
            lengths = np.diff(places)
            per_m = max(float(used.sum()) / total_m, 1e-12)
            lengths = np.maximum(lengths + (spares - spares.mean()) / per_m, 0.02 * lengths)
            places = np.concatenate([[0.0], np.cumsum(lengths)]) * (total_m / float(lengths.sum()))
        assert best is not None
        return best

    def _whole(self, found: Divided[AnySortie]) -> Divided[AnySortie] | None:
        """The division at places between lines, where that leaves enough; elsewhere as it is."""
        cut = np.array([start for start, _ in found.intervals] + [self.division.total_m])
        whole = np.array([*map(self.division.between_lines, cut)])
        if len(set(whole.tolist())) < len(whole):
            return None
        for _ in range(len(cut)):
            tried = self._at(whole)
            short = [i for i, sortie in enumerate(tried.sorties) if sortie.spare < 0]
            moved = {place for i in short for place in (i, i + 1) if whole[place] != cut[place]}
            if not moved:
                return tried
            for place in moved:
                whole[place] = cut[place]
        return None

    def _at(self, places: FloatArray) -> Divided[AnySortie]:
        """The sorties between some places."""
        rounded = [round(place, 3) for place in places.tolist()]  # a place that is known is found again
        intervals = [pair for pair in itertools.pairwise(rounded) if pair[1] > pair[0]]
        for interval in intervals:
            if interval not in self._known:
                self._known[interval] = self.forecast(self.division.part(*interval))
        return Divided(intervals, [self._known[interval] for interval in intervals])


def min_time_s(lines_s: FloatArray, access_s: FloatArray, pack_s: float) -> float:
    """A lower bound of the time that all sorties take together [s].

    A sortie takes its lines, and a way there and back that is no shorter than the mean way to its lines. As its lines
    take no longer than a pack less the shortest way, the ways are at least Σ tᵢ rᵢ / Q.

    Parameters
    ----------
    lines_s : array, shape (n,)
        tᵢ: times of parts of the lines [s].
    access_s : array, shape (n,)
        rᵢ: the shortest way from home to each part, and home from it [s].
    pack_s : float
        Time that a pack lasts before it has to be back [s], above all of `access_s`.

    Source: the radial bound of Haimovich and Rinnooy Kan, Math. Oper. Res. 10 (1985), for parts that may be cut.
    """
    longest_s = pack_s - float(access_s.min())
    return float(lines_s.sum() + lines_s @ access_s / longest_s)


def tours(count: int, aircraft: int) -> list[Sequence[int]]:
    """The sorties of each aircraft, side by side: `count` is a multiple of `aircraft`."""
    each = count // aircraft
    return [range(k * each, (k + 1) * each) for k in range(aircraft)]
