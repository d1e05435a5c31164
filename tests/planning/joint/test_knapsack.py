"""The knapsack against linear programs, the envelope against a hull by brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from eadp.planning.joint.knapsack import FULL, Increments, allocation_of, concave_envelope, fill_greedy
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

unhurried = settings(deadline=None)  # no test depends on the clock
LP = 1e-8
HULL = 1e-9


def hull_value(powers, values, power):
    """The most that mixes of two configurations give at a power on average, by looking at every pair."""
    best = -np.inf
    for (p, v), (q, w) in itertools.product(zip(powers, values, strict=True), repeat=2):
        if p == q == power:
            best = max(best, v, w)
        elif p <= power <= q and p < q:
            best = max(best, v + (w - v) * (power - p) / (q - p))
    return best


def most_at(powers, values, power):
    """The same where charge may also be left over."""
    return max(hull_value(powers, values, p) for p in [power, *(p for p in powers if p <= power)])


def numbered(n):
    return np.arange(n, dtype=float)[:, None]


coarse = st.integers(0, 6).map(float)
points = st.lists(st.tuples(coarse, st.integers(-3, 6).map(float)), min_size=1, max_size=9)
fine = st.floats(0, 30).map(lambda value: round(value, 6))
fine_points = st.lists(st.tuples(fine, fine), min_size=1, max_size=9)


@unhurried
@given(points=st.one_of(points, fine_points))
def test_the_envelope_is_the_upper_hull(points):
    powers, values = (np.array(column) for column in zip(*points, strict=True))
    envelope = concave_envelope(powers, values, numbered(len(points)))
    # among the points, the cheapest first, rising in both
    for p, v, (i,) in zip(envelope.powers_w, envelope.values, envelope.configurations, strict=True):
        assert (p, v) == points[int(i)]
    assert envelope.powers_w[0] == powers.min()
    assert envelope.values[0] == values[powers == powers.min()].max()
    assert (np.diff(envelope.powers_w) > 0).all()
    assert (np.diff(envelope.values) > 0).all()
    # what it gives at every power is the most that is possible
    for power in {*powers.tolist(), *((powers.min() + powers.max()) / 2 * np.ones(1)).tolist()}:
        at = min(power, envelope.powers_w[-1])
        assert np.interp(at, envelope.powers_w, envelope.values) == pytest.approx(
            most_at(powers, values, power), abs=HULL
        )


@unhurried
@given(points=points)
def test_no_point_of_the_envelope_is_more_than_is_needed(points):
    powers, values = (np.array(column) for column in zip(*points, strict=True))
    envelope = concave_envelope(powers, values, numbered(len(points)))
    slopes = np.diff(envelope.values) / np.diff(envelope.powers_w)
    assert (np.diff(slopes) < 0).all(), "on one line the ends are enough"


def test_collinear_duplicate_and_decreasing():
    powers, values = np.array([1.0, 2.0, 3.0, 3.0, 4.0, 2.0]), np.array([0.0, 1.0, 2.0, 2.0, 1.5, 1.0])
    envelope = concave_envelope(powers, values, numbered(6))
    assert envelope.powers_w.tolist() == [1, 3]
    assert envelope.values.tolist() == [0, 2]
    falling = concave_envelope(np.array([1.0, 2.0, 3.0]), np.array([2.0, 1.0, 0.0]), numbered(3))
    assert falling.powers_w.tolist() == [1]


# --- filling ----------------------------------------------------------------------------------------------------------


def increments_of(rng, load, deepest=4):
    """Concave menus at random: some without a choice, some of several slopes, some that take nothing."""
    segment, level, use, gain = [], [], [], []
    for s in range(load):
        count = rng.integers(0, deepest + 1)
        widths = rng.uniform(0.001, 0.05, count) * rng.choice([0.0, 1.0], count, p=[0.05, 0.95])
        slopes = np.sort(rng.choice([1.0, 2.0, rng.uniform(0.1, 3)], count))[::-1]
        for k in range(count):
            segment.append(s)
            level.append(k)
            use.append(widths[k])
            gain.append(widths[k] * slopes[k] if widths[k] else rng.uniform(0, 0.1) if k == 0 else 0.0)
    order = np.array(segment, dtype=np.intp), np.array(level, dtype=np.intp)
    return Increments(*order, np.array(use, dtype=float), np.array(gain, dtype=float), 0.1, 0.3)


def by_linear_program(increments, available):
    return linprog(
        -increments.gain, A_ub=increments.use[None, :], b_ub=[available - increments.base_use], bounds=(0, 1)
    )


@pytest.mark.parametrize("seed", range(60))
def test_filled_against_a_linear_program(seed):
    rng = np.random.default_rng(seed)
    increments = increments_of(rng, rng.integers(1, 12))
    available = 0.1 + rng.uniform(0, 1.1) * increments.use.sum()
    found = fill_greedy(increments, available)
    assert found.feasible
    assert ((found.shares >= 0) & (found.shares <= 1)).all()
    assert found.use == pytest.approx(increments.base_use + increments.use @ found.shares)
    assert found.value == pytest.approx(increments.base_value + increments.gain @ found.shares)
    assert found.use <= available + FULL
    if len(increments.use):
        assert found.value == pytest.approx(0.3 - by_linear_program(increments, available).fun, abs=LP)
    assert ((found.shares > 1e-12) & (found.shares < 1 - 1e-12)).sum() <= 1, "one step in part"


@pytest.mark.parametrize("seed", range(20))
def test_a_segments_steps_come_in_order(seed):
    rng = np.random.default_rng(seed)
    increments = increments_of(rng, 6)
    found = fill_greedy(increments, 0.1 + 0.5 * increments.use.sum())
    for s in range(6):
        own = found.shares[increments.segment == s]
        taken = increments.use[increments.segment == s] > 0
        assert (np.diff(own[taken]) <= 1e-12).all()


def test_more_charge_is_never_worth_less():
    increments = increments_of(np.random.default_rng(7), 10)
    values = [fill_greedy(increments, 0.1 + share * increments.use.sum()).value for share in np.linspace(0, 1.3, 60)]
    assert (np.diff(values) >= -LP).all()
    assert values[-1] == pytest.approx(0.3 + increments.gain.sum())


def test_too_little_charge_is_said_and_nothing_taken():
    increments = increments_of(np.random.default_rng(3), 4)
    found = fill_greedy(increments, 0.1 - 1e-6)
    assert not found.feasible
    assert not found.shares.any()
    assert (found.use, found.value) == (0.1, 0.3)
    just = fill_greedy(increments, 0.1 - FULL / 2)
    assert just.feasible
    assert just.value >= 0.3


def test_nothing_to_choose():
    none = np.zeros(0)
    increments = Increments(none.astype(np.intp), none.astype(np.intp), none, none, 0.2, 0.5)
    assert fill_greedy(increments, 0.3).value == 0.5
    assert fill_greedy(increments, 0.3).feasible
    assert not fill_greedy(increments, 0.1).feasible


def test_steps_that_take_nothing_come_first():
    points = np.arange(3, dtype=np.intp)
    increments = Increments(points, 0 * points, np.array([0.1, 0.0, 0.2]), np.array([0.1, 0.01, 0.1]), 0.0, 0.0)
    assert np.isinf(increments.efficiency[1])
    found = fill_greedy(increments, 0.0)
    assert found.shares.tolist() == [0, 1, 0]
    assert fill_greedy(increments, 0.2).shares == pytest.approx([1, 1, 0.5])


def test_what_shares_add_up_to():
    points = np.arange(2, dtype=np.intp)
    increments = Increments(points, 0 * points, np.array([0.1, 0.3]), np.array([2.0, 1.0]), 0.5, 0.25)
    found = allocation_of(increments, np.array([1.0, 0.5]))
    assert (found.use, found.value) == pytest.approx((0.75, 2.75))
    assert found.feasible
