"""Sensors: noise as large as is said, delay, drop-outs as often and as long as is said; means, and U by hand."""

import itertools
from dataclasses import fields

import numpy as np
import pytest

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text
from eadp.models.plan.cursor import PlanCursor, Rules
from eadp.models.plan.stage import Box
from eadp.models.weather import Sensors
from eadp.simulation.metrics import ParameterLog, SensorSuite

STEP_S = 0.05


def truth(k):
    """Position, power and charge."""
    return (float(k), -float(k)), 30.0 + k, 0.5


def measured(suite, k):
    (x_m, y_m), power_w, soc = truth(k)
    return suite.measured(k, x_m, y_m, power_w, soc)


def told(sensors, count, seed=0):
    suite = SensorSuite(sensors, STEP_S, np.random.default_rng(seed))
    return [measured(suite, k) for k in range(1, count + 1)]


@pytest.mark.parametrize("key", [field.name for field in fields(Sensors)])
def test_any_fault_is_no_ideal(key):
    assert Sensors(**{key: 0.1}).ideal is (key == "drop_out_s")  # the length of drop-outs alone does nothing


def test_noise_has_the_size_that_is_said():
    n = 10_000
    seen = told(Sensors(power_noise_w=2.0, position_noise_m=0.7, soc_noise=0.01), n)
    for i, std in enumerate((0.7, 0.7, 2.0, 0.01)):
        flat = [
            ((*place, power_w, soc)[i], (*truth(k)[0], *truth(k)[1:])[i])
            for k, (place, power_w, soc) in enumerate(seen, 1)
        ]
        errors = np.array([value - true for value, true in flat])
        assert abs(errors.mean()) < 4 * std / n**0.5
        assert errors.std() == pytest.approx(std, rel=4 / (2 * n) ** 0.5)


def test_what_is_told_of_a_step_does_not_depend_on_others_asked_of():
    sensors = Sensors(power_noise_w=1.0, position_noise_m=0.5, soc_noise=0.01, drop_out_share=0.3)
    every = told(sensors, 5000)
    suite = SensorSuite(sensors, STEP_S, np.random.default_rng(0))
    for k in (1, 7, 8, 1900, 2000, 2001, 2001, 4999):
        assert measured(suite, k) == every[k - 1]


@pytest.mark.parametrize(("share", "length_s"), [(0.1, 2.0), (0.5, 1.0), (0.9, 5.0)])
def test_drop_outs_are_as_often_and_as_long_as_is_said(share, length_s):
    n = 80_000
    suite = SensorSuite(Sensors(drop_out_share=share, drop_out_s=length_s), STEP_S, np.random.default_rng(3))
    missing = np.array([measured(suite, k)[1] is None for k in range(1, n + 1)])
    runs = [sum(1 for _ in run) * STEP_S for out, run in itertools.groupby(missing.tolist()) if out]
    assert missing.mean() == pytest.approx(share, rel=0.25)
    assert np.mean(runs) == pytest.approx(length_s, rel=0.3)


def test_the_same_seed_tells_the_same():
    sensors = Sensors(power_noise_w=1.0, drop_out_share=0.3)
    assert told(sensors, 500, seed=4) == told(sensors, 500, seed=4) != told(sensors, 500, seed=5)


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
    assert log.quality({"c1": 0.0, "c2": 0.0}) is None, "nothing that is free has a weight"
    assert log.paper_metric(0.25) == pytest.approx((c1 + c2) / 2 / 0.25)
    assert log.paper_metric(0.0) is None


def test_time_without_a_choice_is_left_out():
    log = ParameterLog(PLAN, cursor_at(0.0, 10.0), START)
    log.give_up(10.0, (0.0, 0.0), (Box(-1000, 0), Box(0, 0)))
    log.close(50.0)
    assert log.mean_share(1) == 1.0
    assert log.mean(1) == pytest.approx(2.0), "the mean of the value counts all the time"


def test_ground_that_is_not_reached_counts_0():
    log = ParameterLog(PLAN, cursor_at(0.0, 10.0), START)
    log.close(16.0, ((0.0, 240.0), 15.0))
    assert log.quality({}) == pytest.approx(0.6, abs=1e-9)
    complete = ParameterLog(PLAN, cursor_at(0.0, 10.0), START)
    complete.close(26.7)
    assert complete.quality({}) == pytest.approx(1.0)
