"""Series of a page, at fewer times than were logged."""

import numpy as np
import pytest

from eadp.io.text.json import significant
from eadp.report.flight import MAX_SAMPLES, changes, evenly, sampled


def test_a_long_series_keeps_rows_evenly():
    times = [0.1 * i for i in range(12_001)]
    series = sampled({"t": times, "lat": times, "w": [1 / 3] * len(times)})
    assert len(series["t"]) <= MAX_SAMPLES
    assert series["t"][-1] == 1200.0
    assert series["lat"] == series["t"]
    assert set(series["w"]) == {0.3333}


def test_changes_are_kept_exactly():
    times = [float(i) for i in range(10)]
    assert changes(times, [1, 1, 2, 2, 2, 1, 1, 1, 1, 1]) == {"t": [0, 2, 5], "v": [1, 2, 1]}


@pytest.mark.parametrize(("count", "limit"), [(0, 3), (3, 3), (10, 3), (11, 3), (1000, 7)])
def test_evenly_keeps_the_last(count, limit):
    kept = evenly(count, limit)
    assert len(kept) <= limit
    assert kept[-1:] == [count - 1][: bool(count)]
    assert len({*np.diff(kept).tolist()}) <= 1


def test_significant_digits():
    assert significant(1234.5678, 3) == 1230
    assert significant(None) is significant(float("inf")) is None
