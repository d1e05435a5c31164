"""Parameters flown: their mean shares are those of the log of parameters."""

from __future__ import annotations

import numpy as np
import pytest
from common import ROOT
from eadp.planning.state.flown import ParameterAverages

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.models.plan.stage import Box
from eadp.simulation.metrics import ParameterLog

ALGEBRA = 1e-9


@pytest.mark.parametrize("seed", range(10))
def test_flown_is_what_the_log_of_parameters_says(seed):
    rng = np.random.default_rng(seed)
    plan = read_plan(read_text(str(ROOT / "plans" / "survey.plan")))[0]
    boxes = [(Box(-1000, 0), Box(2, 10)), (Box(-1000, 0), Box(0, 0)), (Box(-300, -300), Box(2, 6))]
    sets, time_s = boxes[0], 0.0
    parameters = (-200.0, 5.0)
    log, flown = ParameterLog(plan, parameters, sets), ParameterAverages(2)
    flown.hold(0.0, parameters, sets)
    for _ in range(30):
        time_s += rng.uniform(0, 20)
        sets = boxes[rng.integers(3)]
        parameters = tuple(box.clip(value) for box, value in zip(sets, rng.uniform([-1000, 2], [0, 10]), strict=True))
        log.change(time_s, parameters, sets)
        flown.hold(time_s, parameters, sets)
    log.close(time_s)
    for i in range(2):
        assert flown.areas_s[i] / flown.times_s[i] == pytest.approx(log.mean_share(i), rel=ALGEBRA)
    live = [flown.areas_s[i] / flown.times_s[i] for i in range(2)]
    assert np.mean(live) == pytest.approx(log.quality({}), rel=ALGEBRA)
    assert 0.3 * live[0] + 0.7 * live[1] == pytest.approx(log.quality({"c1": 3.0, "c2": 7.0}), rel=ALGEBRA)


def test_flown_counts_what_had_a_choice_up_to_now():
    flown = ParameterAverages(1)
    flown.hold(0.0, (4.0,), (Box(2, 10),))
    flown.hold(10.0, (0.0,), (Box(0, 0),))
    flown.hold(15.0, (10.0,), (Box(2, 10),))
    assert flown.times_s == [10.0]
    assert flown.areas_s == [pytest.approx(10 * 0.25)]
    # what is held counts to a moment, and is not counted twice
    assert flown.until(16.5) == ([11.5], [pytest.approx(10 * 0.25 + 1.5)])
    assert flown.until(17.0) == ([12.0], [pytest.approx(10 * 0.25 + 2)])
    flown.hold(17.0, (10.0,), (Box(2, 10),))
    assert (flown.times_s, flown.areas_s) == flown.until(17.0) == ([12.0], [pytest.approx(10 * 0.25 + 2)])


def test_before_anything_is_held_nothing_is_flown():
    assert ParameterAverages(2).until(30.0) == ([0.0, 0.0], [0.0, 0.0])


def test_stages_without_sets_leave_no_choice():
    flown = ParameterAverages(1)
    flown.hold(0.0, (4.0,), ())
    flown.hold(10.0, (5.0,), ())
    assert flown.times_s == [0.0]
