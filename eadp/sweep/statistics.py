"""Statistics of a sweep: the share of flights that complete, and its dependence on each varied key."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

Z_95 = 1.959963984540054
"""The normal distribution's quantile of 0.975."""

MAX_LABELS = 12
"""Largest number of values of a key that are listed one by one; more numbers than that are binned."""

BINS = 5


def wilson_interval(successes: int, trials: int, z: float = Z_95) -> tuple[float, float]:
    """Wilson score interval of a share that was observed as `successes` of `trials`.

    Parameters
    ----------
    successes, trials : int
        Counts; one trial or more.
    z : float
        Standard deviations to either side; 95 % by default.

    Returns
    -------
    tuple of float
        The p with |successes/trials − p| = z √(p (1 − p) / trials), in order.

    Source: E. B. Wilson, Probable inference, the law of succession, and statistical inference, 1927.
    """
    share, square = successes / trials, z * z / trials
    # p = (s + z²/2n ± z √(s(1−s)/n + z²/4n²)) / (1 + z²/n)
    middle = share + square / 2
    reach = z * math.sqrt(share * (1 - share) / trials + square / (4 * trials))
    return max(0.0, (middle - reach) / (1 + square)), min(1.0, (middle + reach) / (1 + square))


@dataclass(frozen=True)
class SweepFlight:
    """One run of a sweep: the varied keys' values and the figures of its flight; `error` if it could not be made."""

    index: int
    values: Mapping[str, Any]
    seed: int
    completed: bool | None = None
    reason: str | None = None
    duration_s: float | None = None
    soc_final: float | None = None
    quality: float | None = None
    reserve_kept: bool | None = None
    energy_wh: float | None = None
    distance_m: float | None = None
    batteries: int | None = None
    error: str | None = None
    took_s: float = field(default=0.0, compare=False)


_FIGURES = [each.name for each in fields(SweepFlight) if each.name not in ("index", "values", "seed", "took_s")]


@dataclass(frozen=True)
class Group:
    """Flights with one value of a key: their number, the share completed, and of these medians of duration and charge.

    The duration is in s.
    """

    label: str
    flights: int
    completed: float
    duration_s: float
    soc_final: float


@dataclass(frozen=True)
class SweepTotals:
    """Counts of a sweep's runs; `interval` is that of the share of distinct flights that complete, None without any."""

    runs: int
    failed: int
    completed: int
    distinct: int
    interval: tuple[float, float] | None

    @property
    def flights(self) -> int:
        """The number of runs that were made."""
        return self.runs - self.failed


def totals(flights: Sequence[SweepFlight]) -> SweepTotals:
    """The totals of all flights of a sweep."""
    failed = sum(flight.error is not None for flight in flights)
    completed = sum(bool(flight.completed) for flight in flights)
    own = distinct(flights)
    return SweepTotals(len(flights), failed, completed, len(own), completed_interval(own))


def distinct(flights: Sequence[SweepFlight]) -> list[SweepFlight]:
    """The first of each flight that was made: where nothing is drawn, seeds repeat a flight to the bit."""
    first: dict[tuple[Any, ...], SweepFlight] = {}
    for flight in flights:
        if flight.error is None:
            values = json.dumps({key: value for key, value in flight.values.items() if key != "seed"})
            first.setdefault((values, *(getattr(flight, name) for name in _FIGURES)), flight)
    return list(first.values())


def completed_interval(flights: Sequence[SweepFlight]) -> tuple[float, float] | None:
    """The 95 % interval of the share of flights that complete; None without flights."""
    return wilson_interval(sum(bool(flight.completed) for flight in flights), len(flights)) if flights else None


class KeyBins:
    """The values of one key in order, or quantile bins if they are many numbers.

    Parameters
    ----------
    values : sequence
        The key's value in every flight.
    listed : sequence, optional
        The values that it may have, if they are listed: each has its own label, in this order.
    """

    def __init__(self, values: Sequence[Any], listed: Sequence[Any] = ()) -> None:
        self.labels = tuple(dict.fromkeys(map(label_of, listed or values)))
        self._edges: np.ndarray[Any, Any] | None = None
        if not listed and len(self.labels) > MAX_LABELS and all(map(_is_number, values)):
            edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
            self.labels = tuple(f"{low:.4g} to {high:.4g}" for low, high in itertools.pairwise(edges))
            self._edges = edges[1:-1]
        self._indices = {label: i for i, label in enumerate(self.labels)}

    def index(self, value: Any) -> int:
        """The index in `labels` of a value."""
        if self._edges is None:
            return self._indices[label_of(value)]
        return int(np.searchsorted(self._edges, value, side="right"))


def label_of(value: Any) -> str:
    """A value as text: text unchanged, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def value_of(flight: SweepFlight, key: str) -> Any:
    """The value of a varied key, or the seed."""
    return flight.values.get(key, flight.seed)


def marginal(flights: Sequence[SweepFlight], key: str, listed: Sequence[Any] = ()) -> list[Group]:
    """Flights grouped by one key, over all values of the others; `listed` are the values it may have, if listed."""
    bins = KeyBins([value_of(flight, key) for flight in flights], listed)
    groups: list[list[SweepFlight]] = [[] for _ in bins.labels]
    for flight in flights:
        if flight.error is None:
            groups[bins.index(value_of(flight, key))].append(flight)
    return [_group(label, members) for label, members in zip(bins.labels, groups, strict=True)]


def _group(label: str, members: Sequence[SweepFlight]) -> Group:
    if not members:
        return Group(label, 0, math.nan, math.nan, math.nan)
    done = [flight for flight in members if flight.completed]
    duration, charge = (
        float(np.median(values)) if (values := [getattr(flight, name) for flight in done]) else math.nan
        for name in ("duration_s", "soc_final")
    )
    return Group(label, len(members), len(done) / len(members), duration, charge)


@dataclass(frozen=True)
class Table:
    """Means of one figure for each pair of values of two keys, over all else; None where no flight has it.

    Of figures that a flight has only where it completes, `crashed` are the flights that did not: no mean counts them.
    """

    keys: tuple[str, str]
    value: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    means: tuple[tuple[float | None, ...], ...]
    flights: tuple[tuple[int, ...], ...]
    crashed: tuple[tuple[int, ...], ...]

    def text(self, row: int, column: int, digits: int) -> str:
        """A cell: the mean with some digits, and × with the number of flights that did not complete, if any."""
        mean, fell = self.means[row][column], self.crashed[row][column]
        return " ".join(([] if mean is None else [f"{mean:.{digits}f}"]) + ([f"×{fell}"] if fell else []))


OF_ALL = ("completed", "reserve_kept")
"""Figures of all flights; the others are of those that complete."""


def table(
    flights: Sequence[SweepFlight], keys: tuple[str, str], value: str, listed: Mapping[str, Sequence[Any]]
) -> Table:
    """Means of one figure of flights by two keys."""
    bins = [KeyBins([value_of(flight, key) for flight in flights], listed.get(key, ())) for key in keys]
    rows, columns = (axis.labels for axis in bins)
    sums, counts, crashed = np.zeros((3, len(rows), len(columns)))
    for flight in flights:
        figure = getattr(flight, value)
        if flight.error is None and figure is not None:
            cell = tuple(axis.index(value_of(flight, key)) for axis, key in zip(bins, keys, strict=True))
            counted = bool(flight.completed) or value in OF_ALL
            sums[cell] += figure if counted else 0.0
            counts[cell] += counted
            crashed[cell] += not counted
    means = tuple(
        tuple(float(total / n) if n else None for total, n in zip(*line, strict=True))
        for line in zip(sums, counts, strict=True)
    )
    flown, fell = (tuple(tuple(map(int, line)) for line in each) for each in (counts, crashed))
    return Table(keys, value, rows, columns, means, flown, fell)
