"""Time series with fewer samples, within a stated error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

MAX_SAMPLES = 10_000
"""Most samples of a series; the error is doubled until it has no more."""

MAX_SCALE = 2.0**60
"""Largest factor of the errors: beyond it nothing becomes simpler."""

Values = Sequence[float | None]


def kept_samples(times_s: Sequence[float], columns: Sequence[Values], errors: Sequence[float]) -> list[int]:
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
        In order; the first and the last sample are kept.

    Source: the swinging door of E. H. Bristol (1990), with every end on a sample.
    """
    count, anchor, indices = len(times_s), 0, [0] if times_s else []
    gap = [any(column[i] is None for column in columns) for i in range(count)]
    while anchor < count - 1:
        if gap[anchor]:
            after = next((i for i in range(anchor + 1, count) if not gap[i]), count)
            end = max(anchor + 1, after - 1)
        else:
            end = _farthest(times_s, columns, errors, anchor, gap)
        indices.append(end)
        anchor = end
    return indices


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
    """Columns on fewer common times: `t`, the columns by name, and `error`, the bound that holds for each.

    The errors are doubled until at most `MAX_SAMPLES` are left. Values are rounded within their error.
    """
    scale = 1.0
    while True:
        bounds = {name: scale * error for name, error in errors.items()}
        indices = kept_samples(times_s, [*columns.values()], [0.9 * bounds[name] for name in columns])
        if len(indices) <= MAX_SAMPLES or scale > MAX_SCALE:
            break
        scale *= 2
    series: dict[str, Any] = {"t": [round(times_s[i], 6) for i in indices]}
    for name, values in columns.items():
        digits = max(0, math.ceil(-math.log10(0.2 * bounds[name])))
        series[name] = [None if (value := values[i]) is None else round(value, digits) for i in indices]
    return {**series, "error": bounds}


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


def significant(value: float | None, digits: int = 6) -> float | None:
    """A number rounded to significant digits; None where there is none."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.{digits}g}")
