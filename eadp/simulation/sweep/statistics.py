"""What a sweep says: how many flights complete, and what each varied key has to do with it."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Z_95 = 1.959963984540054
"""The normal distribution's quantile of 0.975."""

LISTED = 12
"""Most values of a key that are told apart; more numbers than that are put into bins."""

BINS = 5


def wilson_interval(successes: int, trials: int, z: float = Z_95) -> tuple[float, float]:
    """Interval of a share that was observed as `successes` of `trials`: where a test of it would not refuse.

    Parameters
    ----------
    successes, trials : int
        Counts; one trial or more.
    z : float
        Standard deviations to either side: 95 % unless given.

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
    """What is told of one run: the varied keys' values, and what came of it; `error` where nothing did."""

    index: int
    values: Mapping[str, Any]
    seed: int
    completed: bool | None = None
    reason: str | None = None
    duration_s: float | None = None
    soc_final: float | None = None
    quality: float | None = None
    error: str | None = None


@dataclass(frozen=True)
class Group:
    """Flights alike in one key: how many, the share that completed, medians of duration [s] and charge at the end."""

    label: str
    flights: int
    completed: float
    duration_s: float
    soc_final: float


@dataclass(frozen=True)
class SweepTotals:
    """All flights of a sweep; runs that could not be made are counted apart."""

    runs: int
    failed: int
    completed: int
    interval: tuple[float, float] | None

    @property
    def flights(self) -> int:
        """Runs that were made."""
        return self.runs - self.failed


def totals(flights: Sequence[SweepFlight]) -> SweepTotals:
    """Counts, and the interval of the share that completes; None where none was flown."""
    failed = sum(flight.error is not None for flight in flights)
    completed = sum(bool(flight.completed) for flight in flights)
    made = len(flights) - failed
    return SweepTotals(len(flights), failed, completed, wilson_interval(completed, made) if made else None)


class KeyBins:
    """The values of one key in order, or bins of alike many flights where they are many numbers.

    Parameters
    ----------
    values : sequence
        The key's value in every flight.
    listed : sequence, optional
        The values it may have, where they are given by name: each is then told apart, in this order.
    """

    def __init__(self, values: Sequence[Any], listed: Sequence[Any] = ()) -> None:
        self.labels = tuple(dict.fromkeys(map(label_of, listed or values)))
        self._edges: np.ndarray[Any, Any] | None = None
        if not listed and len(self.labels) > LISTED and all(map(_is_number, values)):
            edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
            self.labels = tuple(f"{low:.4g} to {high:.4g}" for low, high in itertools.pairwise(edges))
            self._edges = edges[1:-1]
        self._places = {label: place for place, label in enumerate(self.labels)}

    def place(self, value: Any) -> int:
        """Which of `labels` a value belongs to."""
        if self._edges is None:
            return self._places[label_of(value)]
        return int(np.searchsorted(self._edges, value, side="right"))


def label_of(value: Any) -> str:
    """A value as it is told: text as it stands, all else as JSON has it."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def value_of(flight: SweepFlight, key: str) -> Any:
    """The value of a varied key, or the seed."""
    return flight.values.get(key, flight.seed)


def marginal(flights: Sequence[SweepFlight], key: str, listed: Sequence[Any] = ()) -> list[Group]:
    """Flights grouped by one key, over all values of the others; `listed` are its values where they are given."""
    bins = KeyBins([value_of(flight, key) for flight in flights], listed)
    groups: list[list[SweepFlight]] = [[] for _ in bins.labels]
    for flight in flights:
        if flight.error is None:
            groups[bins.place(value_of(flight, key))].append(flight)
    return [_group(label, members) for label, members in zip(bins.labels, groups, strict=True)]


def _group(label: str, members: Sequence[SweepFlight]) -> Group:
    if not members:
        return Group(label, 0, math.nan, math.nan, math.nan)
    share = sum(bool(flight.completed) for flight in members) / len(members)
    duration = float(np.median([flight.duration_s for flight in members if flight.duration_s is not None]))
    charge = float(np.median([flight.soc_final for flight in members if flight.soc_final is not None]))
    return Group(label, len(members), share, duration, charge)


@dataclass(frozen=True)
class Table:
    """Means of one figure for each pair of values of two keys, over all else; None where there is no such flight."""

    keys: tuple[str, str]
    value: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    means: tuple[tuple[float | None, ...], ...]
    flights: tuple[tuple[int, ...], ...]


def table(
    flights: Sequence[SweepFlight], keys: tuple[str, str], value: str, listed: Mapping[str, Sequence[Any]]
) -> Table:
    """Means of `completed`, `duration_s`, `soc_final` or `quality` by two keys."""
    bins = [KeyBins([value_of(flight, key) for flight in flights], listed.get(key, ())) for key in keys]
    rows, columns = (axis.labels for axis in bins)
    sums = np.zeros((len(rows), len(columns)))
    counts = np.zeros((len(rows), len(columns)), dtype=int)
    for flight in flights:
        figure = getattr(flight, value)
        if flight.error is None and figure is not None:
            place = tuple(axis.place(value_of(flight, key)) for axis, key in zip(bins, keys, strict=True))
            sums[place] += figure
            counts[place] += 1
    means = tuple(
        tuple(float(total / n) if n else None for total, n in zip(line, ns, strict=True))
        for line, ns in zip(sums, counts, strict=True)
    )
    return Table(keys, value, rows, columns, means, tuple(tuple(map(int, ns)) for ns in counts))
