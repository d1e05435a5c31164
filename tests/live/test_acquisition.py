"""Stage and lap where telemetry begins in the middle of a nominal flight."""

from __future__ import annotations

import pytest
from common import ROOT, few
from common.observations import seen_at

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.live.locator import SETTLE_S, Acquisition
from eadp.models.plan.cursor import PlanCursor, Rules
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.route import RoutePredictor
from eadp.models.plan.stage import leg_points

PLAN, _ = read_plan(read_text(str(ROOT / "plans/survey.plan")))
START, SPEED = (-45.0, 216.0), 15.0


def track(c1):
    """Points of the nominal flight, one a second: lap, stage, position and course."""
    for leg in RoutePredictor().route(PlanCursor.start(PLAN, (c1, 10.0)), START).legs:
        for point in leg_points(leg, SPEED):
            yield (leg.lap, leg.stage.index), (point.x_m, point.y_m), point.heading_rad


def found(c1, begins, in_force, **reported):
    """Seconds until one lap is left, and the place it has then and the true one."""
    points = list(track(c1))
    at = PlanExecutor(PLAN, (0.0, 10.0), points[begins][1], Rules())
    acquisition = Acquisition(at, START)
    for k, (true, position, course) in enumerate(points[begins:]):
        acquisition.update(seen_at(float(k), position, course, **reported), in_force)
        if acquisition.settled:
            return k, acquisition.hypotheses[0].stage[1:], true
    return None


@pytest.mark.quick(2)
@pytest.mark.parametrize("c1", few([0.0, -190.0, -700.0], 2))
@pytest.mark.parametrize("begins", few([40, 95, 160], 2))
def test_the_lap_is_found(c1, begins):
    for in_force, within_s in (({0: c1}, 40), ({}, 250)):
        settled_s, place, true = found(c1, begins, in_force)
        assert SETTLE_S <= settled_s < within_s
        assert place == true


def test_a_position_on_no_leg_is_a_start():
    acquisition = Acquisition(PlanExecutor(PLAN, (0.0, 10.0), (5e3, 5e3), Rules()), START)
    acquisition.update(seen_at(0.0, (5e3, 5e3), 0.0), {})
    assert acquisition.is_start
    assert not acquisition.settled


def test_a_course_is_waited_for_unless_a_stage_is_reported():
    for stage, count in ((None, 1), (4, 2)):
        acquisition = Acquisition(PlanExecutor(PLAN, (0.0, 10.0), (95.0, 80.0), Rules()), START)
        acquisition.update(seen_at(0.0, (95.0, 80.0), None, stage), {})
        assert len(acquisition.hypotheses) >= count
        assert {one.executor.stage.index for one in acquisition.hypotheses} <= {1, stage}
        assert not acquisition.stage_found


def test_a_number_of_stages_started_leaves_one_lap():
    lap_and_stage, position, course = list(track(-190.0))[95]
    lap, stage = lap_and_stage
    acquisition = Acquisition(PlanExecutor(PLAN, (0.0, 10.0), position, Rules()), START)
    acquisition.update(seen_at(0.0, position, course, stages_started=4 * lap + stage), {})
    assert {one.stage[1:] for one in acquisition.hypotheses} == {lap_and_stage}
