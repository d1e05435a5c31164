"""Shares, medians and tables, beside independent countings."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from eadp.sweep.results import SweepFlight, completed_interval, distinct, wilson_interval

EXACT = 1e-9


@given(st.integers(1, 400), st.data())
def test_the_interval_is_wilsons(trials, data):
    successes = data.draw(st.integers(0, trials))
    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    assert wilson_interval(successes, trials) == pytest.approx((interval.low, interval.high), abs=EXACT)


def flight(index, values, completed=True, duration=100.0, soc=0.5, quality=0.7, error=None, seed=0):
    if error is not None:
        return SweepFlight(index=index, values=values, seed=seed, error=error)
    figures = {"completed": completed, "reason": "reason", "duration_s": duration, "soc_final": soc, "quality": quality}
    return SweepFlight(index=index, values=values, seed=seed, **figures)


FLIGHTS = [
    flight(0, {"w": 1, "p": "a"}, True, 10.0, 0.1, 0.9),
    flight(1, {"w": 2, "p": "a"}, False, 20.0, 0.2, 0.8),
    flight(2, {"w": 1, "p": "b"}, True, 40.0, 0.4, None),
    flight(3, {"w": 2, "p": "b"}, error="cannot"),
    flight(4, {"w": 1, "p": "a"}, False, 30.0, 0.0, 0.5, seed=1),
]


def test_what_could_not_be_made_is_in_no_interval():
    assert completed_interval(distinct(FLIGHTS)) == wilson_interval(2, 4)
    assert completed_interval(distinct([FLIGHTS[3]])) is None


def test_copies_of_a_flight_are_in_no_interval():
    copies = [flight(i, {"w": i % 2, "seed": i}, soc=0.5 + i % 2, seed=i) for i in range(8)]
    own = distinct([*copies, flight(8, {"w": 0, "seed": 8}, False, seed=8)])
    assert completed_interval(own) == wilson_interval(2, 3)
