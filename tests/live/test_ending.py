"""The end of a plan: by how much it is passed, and what follows."""

import math

import pytest
from common import ROOT
from common.observations import seen_at

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.live.gate import Continuation, is_certain
from eadp.models.plan.cursor import PlanCursor, Rules
from eadp.models.plan.executor import PlanExecutor

PLAN, _ = read_plan(read_text(str(ROOT / "plans/survey.plan")))
NORTH = math.pi / 2


def in_lap(lap):
    """On the first stage of a lap of the survey at c1 = 0; laps from 15 on may end the plan, beyond (175, 161)."""
    executor = PlanExecutor(PlanCursor.start(PLAN, (0.0, 10.0), Rules()), (-45.0, 216.0))
    for _ in range(4 * lap):
        executor.skip((0.0, 0.0))
    return executor


@pytest.mark.parametrize(
    ("position", "course", "certain"),
    [
        ((175.2, 161.1), NORTH, False),
        ((177.0, 161.1), NORTH, True),
        ((177.0, 161.1), None, False),
        ((175.2, 170.0), 0.0, True),
        ((175.2, 170.0), math.pi, False),
    ],
)
def test_an_end_is_certain_if_it_is_passed_by_more_than_the_error_of_a_position(position, course, certain):
    executor = in_lap(15)
    executor.advance(*position)
    assert executor.complete
    assert is_certain(executor, position, course) == certain


def test_a_flight_goes_on_past_an_end_and_the_other_is_left_as_it_was():
    executor = in_lap(15)
    executor.advance(175.2, 161.1)
    following = executor.past_end()
    assert executor.complete
    assert not following.complete
    following.advance(175.3, 162.0)
    assert not following.complete
    assert following.skip((35.0, 150.0))
    assert (following.cursor.lap, following.stage.index) == (15, 2)


def test_the_next_leg_decides_that_it_goes_on_and_positions_elsewhere_that_it_does_not():
    executor = in_lap(15).past_end()
    continuation = Continuation(executor)
    (ox, oy), _ = executor.cursor.offset_m, executor.stage
    on_circle = seen_at(0.0, (-45.0 + ox, 216.0 + oy), math.pi)
    assert all(continuation.update(executor, on_circle, 1.0) is None for _ in range(60))
    executor.skip(executor.trigger_m)
    on_line = seen_at(0.0, (-115.0 + ox, 80.0 + oy), -NORTH)
    assert [continuation.update(executor, on_line, 1.0) for _ in range(5)] == [None] * 4 + [True]
    away, elsewhere = Continuation(executor), seen_at(0.0, (500.0, 500.0), 0.0)
    assert [away.update(executor, elsewhere, 2.5) for _ in range(2)] == [None, False]
