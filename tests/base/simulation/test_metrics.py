"""Means and the quality U, by hand."""

import pytest

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text
from eadp.models.plan.cursor import PlanCursor, Rules
from eadp.models.plan.stage import Box
from eadp.simulation.metrics import ParameterLog

PLAN, _ = read_plan(Text("p", "0.1; 90; x-c1\nc1, 400\n[-1000, 0]\n[2, 10]\n"))
START, LIVE = (0.0, 0.0), Rules("live")
"""A flight of one leg, north along x = c1 to the plan's end at y = 400: its ground is its length."""


def cursor_at(*parameters, plan=PLAN):
    return PlanCursor.start(plan, parameters, LIVE)


def logged():
    log = ParameterLog(PLAN, cursor_at(0.0, 10.0), START)
    log.change(10.0, cursor_at(-500.0, 10.0))
    log.change(30.0, cursor_at(-500.0, 4.0))
    log.close(40.0)
    return log


def test_means_are_over_time():
    log = logged()
    assert log.mean(0) == pytest.approx(-500 * 30 / 40)
    assert log.mean(1) == pytest.approx((10 * 30 + 4 * 10) / 40)
    assert [len(record.history) for record in log.records] == [1, 1]
    assert log.records[0].history == [(10.0, -500.0)]


def test_quality_of_one_leg_is_the_mean_share():
    log = logged()
    c1, c2 = (10 * 1 + 30 * 0.5) / 40, (30 * 1 + 10 * 0.25) / 40
    assert log.quality({}) == pytest.approx((c1 + c2) / 2)
    assert log.quality({"c1": 3, "c2": 1}) == pytest.approx((3 * c1 + c2) / 4)
    assert log.quality({"c1": 3}) == pytest.approx((3 * c1 + c2) / 4), "a weight that is not named is 1"
    assert log.quality({"c1": 1, "c2": 0}) == pytest.approx(c1)
    assert log.paper_metric(0.25) == pytest.approx((c1 + c2) / 2 / 0.25)
    assert log.paper_metric(0.0) is None


def test_the_energy_of_computations_is_power_by_time():
    log = ParameterLog(PLAN, cursor_at(0.0, 10.0), START, computing_w=9.0)
    log.change(10.0, cursor_at(0.0, 2.0), None, 5.0)
    log.change(15.0, cursor_at(0.0, 2.0), None, 0.0)
    log.close(40.0)
    assert log.computing_j == pytest.approx(9 * 10 + 5 * 5)


def test_time_without_a_choice_is_left_out():
    log = ParameterLog(PLAN, cursor_at(0.0, 10.0), START)
    log.give_up(10.0, (0.0, 0.0), (Box(-1000, 0), Box(0, 0)), 0.0)
    log.close(50.0)
    assert log.mean_share(1) == 1.0
    assert log.mean(1) == pytest.approx(2.0), "the mean of the value counts all the time"


def test_a_weight_of_nothing_that_is_free_gives_no_quality():
    assert logged().quality({"c1": 0.0, "c2": 0.0}) is None


def test_ground_that_is_not_reached_counts_0():
    log = ParameterLog(PLAN, cursor_at(0.0, 10.0), START)
    log.close(16.0, ((0.0, 240.0), 15.0))
    assert log.quality({}) == pytest.approx(0.6, abs=1e-9)
    complete = ParameterLog(PLAN, cursor_at(0.0, 10.0), START)
    complete.close(26.7)
    assert complete.quality({}) == pytest.approx(1.0)
