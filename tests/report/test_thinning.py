"""Thinned series keep to their stated error, which numpy's interpolation shows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.io.page import significant
from eadp.report import flight as thinning
from eadp.report.flight import changes, evenly, kept_samples, thinned

STEPS = st.lists(st.tuples(st.floats(0.01, 5), st.floats(-100, 100), st.floats(-1, 1)), min_size=1, max_size=60)


@given(STEPS, st.floats(0.01, 50))
def test_every_sample_is_within_the_error_of_the_line_between_those_kept(steps, error):
    times = np.cumsum([step for step, *_ in steps]).tolist()
    columns = {"a": [a for _, a, _ in steps], "b": [b for *_, b in steps]}
    series = thinned(times, columns, {"a": error, "b": error / 100})
    assert series["error"] == {"a": error, "b": error / 100}
    assert series["t"][0] == pytest.approx(times[0], abs=1e-6)
    assert series["t"][-1] == pytest.approx(times[-1], abs=1e-6)
    for name, bound in series["error"].items():
        slope = 1e-6 * 200 / 0.01  # times are rounded to a microsecond
        assert np.abs(np.interp(times, series["t"], series[name]) - columns[name]).max() <= bound + slope


def test_a_straight_line_keeps_its_ends_and_a_corner_is_kept():
    times = np.arange(101.0)
    assert kept_samples(times.tolist(), [(3 * times).tolist()], [0.1]) == [0, 100]
    corner = np.minimum(times, 40.0)
    assert kept_samples(times.tolist(), [corner.tolist()], [0.1]) == pytest.approx([0, 40, 100], abs=1)


def test_more_samples_than_the_limit_have_larger_errors(monkeypatch):
    monkeypatch.setattr(thinning, "MAX_SAMPLES", 60)
    rng = np.random.default_rng(2)
    times, noise = np.arange(1000.0), rng.normal(size=(2, 1000))
    noise[0, 517] = 40.0
    columns = {"a": noise[0].tolist(), "b": noise[1].tolist()}
    series = thinned(times.tolist(), columns, {"a": 0.01, "b": 0.01})
    assert len(series["t"]) <= 61
    assert series["error"]["a"] > 1
    assert 517.0 in series["t"], "a peak stays"
    for values, name in zip(noise, columns, strict=True):
        assert np.abs(np.interp(times, series["t"], series[name]) - values).max() <= series["error"][name]


def test_a_gap_stays_a_gap():
    values = [0.0, 1.0, 2.0, None, None, None, 5.0, 5.0, 5.0]
    series = thinned([float(i) for i in range(9)], {"w": values}, {"w": 0.1})
    assert series["t"] == [0, 2, 3, 5, 6, 8]
    assert series["w"] == [0, 2, None, None, 5, 5]


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
