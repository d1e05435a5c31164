"""Series of a page, thinned within errors that it states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from eadp.io.page import Series

ERRORS = dict.fromkeys(("x", "y"), 0.3) | dict.fromkeys(("lat", "lon"), 1e-5) | {"m": 0.5}
ERRORS |= {"heading": 0.05, "soc": 5e-4, "ah": 1e-3}
"""Errors of thinned positions [m] and [°], altitudes [m], headings [rad], charges and charges drawn [Ah]."""

POWER_SHARE, MIN_POWER_W = 1 / 400, 0.01
"""Error of thinned powers, as a share of their range, and at least [W]."""

MAX_SAMPLES = 10_000
"""Most samples of a series: one that needs more is reduced to the extremes of equal intervals."""

Values = Sequence[float | None]


def kept_samples(times_s: Sequence[float], columns: Sequence[Values], errors: Sequence[float]) -> list[int] | None:
    """Indices of samples between which linear interpolation gives all others, each column within its error.

    Parameters
    ----------
    times_s : sequence of float, length n
        Ascending.
    columns : sequence of sequences of float or None, each of length n
        Of samples in a row of which some value is missing, the first and the last are kept.
    errors : sequence of float
        Above 0, one for each column.

    Returns
    -------
    list of int
        In order; the first and the last sample are kept. None if they are more than `MAX_SAMPLES`.

    Source: the swinging door of E. H. Bristol (1990), with every end on a sample.
    """
    count, anchor, indices = len(times_s), 0, [0] if times_s else []
    gap = _gaps(columns)
    while anchor < count - 1:
        if gap[anchor]:
            after = next((i for i in range(anchor + 1, count) if not gap[i]), count)
            end = max(anchor + 1, after - 1)
        else:
            end = _farthest(times_s, columns, errors, anchor, gap)
        indices.append(end)
        if len(indices) > MAX_SAMPLES:
            return None
        anchor = end
    return indices


def _gaps(columns: Sequence[Values]) -> list[bool]:
    """Where the value of a column is missing."""
    return [None in values for values in zip(*columns, strict=True)]


def _farthest(
    times_s: Sequence[float], columns: Sequence[Values], errors: Sequence[float], anchor: int, gap: Sequence[bool]
) -> int:
    """The last sample in a row that a straight line from `anchor` reaches within the errors of those between."""
    start_s = times_s[anchor]
    known = [cast(Sequence[float], column) for column in columns]
    lows, highs = [-math.inf] * len(known), [math.inf] * len(known)
    for i in range(anchor + 1, len(times_s)):
        after_s = times_s[i] - start_s
        if gap[i] or after_s <= 0:
            return max(anchor + 1, i - 1)
        for k, (column, error) in enumerate(zip(known, errors, strict=True)):
            rise = column[i] - column[anchor]
            if not lows[k] <= rise / after_s <= highs[k]:
                return i - 1
            lows[k], highs[k] = max(lows[k], (rise - error) / after_s), min(highs[k], (rise + error) / after_s)
    return len(times_s) - 1


def thinned(times_s: Sequence[float], columns: Mapping[str, Values], errors: Mapping[str, float]) -> dict[str, Any]:
    """Columns on fewer common times.

    Returns
    -------
    dict
        `t`, the columns by name, and `error`, the bound that holds for each; values are rounded within it. Where
        `MAX_SAMPLES` are too few for the given errors, there is `extremes_s`, too: the lowest and the highest values
        of each interval of this length are kept, and `error` is what that amounts to.
    """
    indices = kept_samples(times_s, [*columns.values()], [0.9 * errors[name] for name in columns])
    extremes: dict[str, float] = {}
    if indices is None:
        indices, extremes["extremes_s"] = _extremes(times_s, columns)
    series: dict[str, Any] = {"t": [round(times_s[i], 6) for i in indices]}
    for name, values in columns.items():
        digits = max(0, math.ceil(-math.log10(0.2 * errors[name])))
        series[name] = [None if (value := values[i]) is None else round(value, digits) for i in indices]
    if extremes:
        errors = {name: _error(times_s, columns[name], series["t"], series[name]) for name in columns}
    return {**series, **extremes, "error": dict(errors)}


def _extremes(times_s: Sequence[float], columns: Mapping[str, Values]) -> tuple[list[int], float]:
    """Samples with the lowest and the highest values of each column in equal intervals, and their length [s]."""
    gap = np.array(_gaps([*columns.values()]))
    times = np.array(times_s)
    known = np.flatnonzero(~gap)
    every_s = float(times[-1] - times[0]) / (MAX_SAMPLES // (2 * len(columns)))
    interval = ((times[known] - times[0]) / every_s).astype(int)
    starts = np.flatnonzero(np.diff(interval, prepend=-1))
    kept = {0, len(times) - 1, *(np.flatnonzero(np.diff(gap)) + 1).tolist(), *np.flatnonzero(np.diff(gap)).tolist()}
    for values in columns.values():
        numbers = np.array(values, dtype=float)[known]
        order = np.lexsort((numbers, interval))
        kept |= {*known[order[starts]].tolist(), *known[order[np.append(starts[1:], len(known)) - 1]].tolist()}
    return sorted(kept), every_s


def _error(times_s: Sequence[float], values: Values, kept_s: Sequence[float], kept: Values) -> float:
    """The largest difference of values from the lines between those that are kept, rounded up."""
    given, shown = (np.array(each, dtype=float) for each in (values, kept))
    error = float(np.nanmax(np.abs(np.interp(times_s, kept_s, shown) - given), initial=0.0))
    return float(f"{1.001 * error:.4g}")


def changes(times_s: Sequence[float], values: Sequence[Any]) -> dict[str, Any]:
    """A series that is constant between its changes: `t`, when each value starts, and `v`, the values.

    `error_s` is how late a change may be shown: 0, but for a series of more than `MAX_SAMPLES` changes.
    """
    late_s = 0.0
    while True:
        shown_s: list[float] = []
        shown: list[Any] = []
        for time_s, value in zip(times_s, values, strict=True):
            if not shown or (value != shown[-1] and time_s >= shown_s[-1] + late_s):
                shown_s.append(round(time_s, 6))
                shown.append(value)
        if len(shown) <= MAX_SAMPLES:
            return {"t": shown_s, "v": shown, "error_s": late_s}
        late_s = 2 * late_s or (times_s[-1] - times_s[0]) / MAX_SAMPLES


def evenly(count: int, limit: int) -> list[int]:
    """At most `limit` of the indices below `count`, evenly, the last among them."""
    every = max(1, math.ceil(count / limit))
    return [*range((count - 1) % every, count, every)]


def of_errors(series: Series) -> dict[str, Any]:
    """A series thinned within `ERRORS`, by its columns; those without an error there are powers."""
    known = [value for values in series.columns.values() for value in values if value is not None]
    power_w = max((max(known) - min(known)) * POWER_SHARE, MIN_POWER_W) if known else MIN_POWER_W
    return thinned(*series, {name: ERRORS.get(name, power_w) for name in series.columns})
