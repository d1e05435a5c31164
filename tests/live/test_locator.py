"""The position in a plan: found again after a gap by position, course and time; one hypothesis in ordinary flight."""

from __future__ import annotations

import math

import pytest
from common import ROOT
from common.observations import seen_at
from hypothesis import given
from hypothesis import strategies as st

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text
from eadp.live.locator import COURSE_STD_RAD, DISTANCE_STD_M, Locator, allows, path_mismatch
from eadp.models.plan.cursor import PlanCursor, Rules
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.route import RoutePredictor
from eadp.models.plan.stage import leg_points

PLAN, _ = read_plan(read_text(str(ROOT / "plans/survey.plan")))
START, SPEED = (-100.0, 220.0), 15.0
PARAMETERS = (-300.0, 10.0)
LEGS = RoutePredictor().route(PlanCursor.start(PLAN, PARAMETERS), START).legs
ENDS_S = [sum(leg.distance_m for leg in LEGS[: i + 1]) / SPEED for i in range(len(LEGS))]


def locator():
    """At the start of the survey."""
    return Locator(PlanExecutor(PLAN, PARAMETERS, START, Rules()), SPEED, 0.0)


def nominal(time_s):
    """Number of the leg, position and course at a time on the nominal flight in no wind."""
    number = next(i for i, end_s in enumerate(ENDS_S) if time_s < end_s)
    points = list(leg_points(LEGS[number], 0.1))
    before_s = ENDS_S[number - 1] if number else 0.0
    point = points[round((time_s - before_s) / (ENDS_S[number] - before_s) * (len(points) - 1))]
    return number, (point.x_m, point.y_m), point.heading_rad


def sighted(time_s, elapsed_s=None, **known):
    number, position, course = nominal(time_s)
    found = locator()
    found.seek(seen_at(elapsed_s or time_s, position, course)._replace(**known), (0.0, 0.0))
    return number, found


def stages(found):
    return [(one.executor.cursor.lap, one.executor.stage.index) for one in found.hypotheses]


@given(st.floats(1.0, ENDS_S[-1] - 1.0), st.floats(0.95, 1.05))
def test_the_stage_is_found_again_after_any_gap(time_s, wrong_share):
    number, found = sighted(time_s, time_s * wrong_share)
    before_s, leg = ENDS_S[number - 1] if number else 0.0, LEGS[number]
    near_end_s = min(time_s - before_s, ENDS_S[number] - time_s)
    true = leg.lap, leg.stage.index
    assert true in stages(found)
    if near_end_s > 1.0:  # two stages meet at a trigger
        assert stages(found)[0] == true
        assert found.executor.stages_started == number + 1
        assert found.hypotheses[0].stage_started_s == pytest.approx(time_s * wrong_share - (time_s - before_s), abs=1.0)
    assert found.through_gap


def test_a_lap_that_the_time_does_not_allow_is_none():
    number, found = sighted(100.0)
    lap = LEGS[number].lap
    assert all(abs(one - lap) <= 1 for one, _ in stages(found))
    _, other = sighted(100.0, 30.0)
    assert other.uncertain, "no stage fits position and time"


def test_without_a_position_it_is_where_the_time_puts_it():
    number, found = sighted(100.0, position_m=None, velocity_mps=None)
    assert found.uncertain
    assert stages(found) == [(LEGS[number].lap, LEGS[number].stage.index)]
    _, position, _ = nominal(100.0)
    now = found.seek(seen_at(100.0, None), (0.0, 0.0))
    assert math.dist(now, position) < 3.0


def through(text, start, positions):
    """A flight that has followed these positions at cruise speed, and its time."""
    plan, _ = read_plan(Text("short.plan", text))
    found, time_s, at = Locator(PlanExecutor(plan, (), start, Rules()), SPEED, 0.0), 0.0, start
    for position in positions:
        time_s, at = time_s + math.dist(at, position) / SPEED, position
        found.follow(seen_at(time_s, position), None, lambda *_: None)
    return found, time_s


CIRCLE = "%: trigger-radius 5\n0.002; 90; x^2 + y^2 - 50^2\n47, -17.06\n0.1; 90; x - 47\n47, 300\n"


@pytest.mark.parametrize("flown_deg", [20, 90, 170, 200])
def test_without_a_position_it_goes_on_round_a_circle_from_where_it_was(flown_deg):
    def on_round(angle_deg):
        return 50 * math.cos(math.radians(angle_deg)), 50 * math.sin(math.radians(angle_deg))

    found, time_s = through(CIRCLE, (50.0, 0.0), [on_round(angle_deg) for angle_deg in range(5, flown_deg + 1, 5)])
    now = found.seek(seen_at(time_s + 5.0, None), (0.0, 0.0))
    assert math.dist(now, on_round(flown_deg + math.degrees(5.0 * SPEED / 50))) < 3.0


def test_without_a_position_it_goes_on_from_within_a_short_leg():
    text = "%: trigger-radius 1\n0.1; 90; x\n0, 12\n0.1; 90; x\n0, 900\n"
    found, time_s = through(text, (0.0, 0.0), [(0.0, 3.0), (0.0, 9.0)])
    assert found.executor.stages_started == 1
    now = found.seek(seen_at(time_s + 5.0, None), (0.0, 0.0))
    assert now == pytest.approx((0.0, 9.0 + 5.0 * SPEED), abs=3.0)


@pytest.mark.parametrize("skips", [0, 1, 2, 3])
def test_stages_that_are_reported_to_be_over_are_skipped_and_spread_over_the_step(skips):
    found, starts = locator(), []
    found.follow(seen_at(6.0, (-100.0, 240.0)), skips, lambda *start: starts.append(start))
    assert found.executor.stages_started == 1 + skips
    assert starts == [(6.0 * k / skips, (-100.0, 240.0), 1.0) for k in range(1, skips)]
    assert found.hypotheses[0].stage_started_s == (6.0 if skips else 0.0)


def test_a_sighting_allows_the_stage_that_it_reports_and_the_one_before():
    executor = locator().executor
    for _ in range(2):
        executor.skip(START)
    allowed = [count for count in range(7) if allows(seen_at(9.0, START, stages_started=count), executor)]
    assert allowed == [3, 4]
    assert [stage for stage in range(1, 5) if allows(seen_at(9.0, START, stage=stage), executor)] == [3, 4]


def test_a_course_decides_between_two_lines():
    """Two lines of opposite directions, side by side."""
    number = next(i for i, leg in enumerate(LEGS) if leg.lap == 2 and leg.stage.kind == "line")
    time_s = (ENDS_S[number - 1] + ENDS_S[number]) / 2
    _, found = sighted(time_s, position_m=None, velocity_mps=None)
    _, position, course = nominal(time_s)
    found.seek(seen_at(time_s, position, course), (0.0, 0.0))
    assert not found.lost
    assert stages(found)[0] == (2, LEGS[number].stage.index)
    back = locator()
    back.seek(seen_at(time_s, position, course + math.pi), (0.0, 0.0))
    assert (2, LEGS[number].stage.index) not in stages(back) or back.lost


@pytest.mark.parametrize("turned", [0.0, 0.4, -0.4, math.pi / 2, 3.0])
def test_thepath_mismatch_is_the_distance_from_the_path_and_the_angle_to_it(turned):
    """On the path and at 7 m from a line, courses a whole turn apart alike."""
    number = next(i for i, leg in enumerate(LEGS) if leg.stage.kind == "line")
    _, found = sighted((ENDS_S[number - 1] + ENDS_S[number]) / 2)
    executor = next(one.executor for one in found.hypotheses if one.executor.stage.index == LEGS[number].stage.index)
    _, (x, y), course = nominal((ENDS_S[number - 1] + ENDS_S[number]) / 2)
    beside = (x - 7 * math.sin(course), y + 7 * math.cos(course))
    angle = (turned / COURSE_STD_RAD) ** 2
    for whole in (0, 2 * math.pi, -2 * math.pi):
        on_path = path_mismatch(executor, seen_at(9.0, (x, y), course + turned + whole))
        assert on_path == pytest.approx(angle, abs=1e-6)
        off_path = path_mismatch(executor, seen_at(9.0, beside, course + turned + whole))
        assert off_path == pytest.approx(angle + (7 / DISTANCE_STD_M) ** 2, rel=1e-6)


def test_a_number_of_stages_started_settles_it():
    for number in (3, 12, 20):
        found = locator()
        found.seek(seen_at(1.0, None, stages_started=number + 1), (0.0, 0.0))
        assert stages(found) == [(LEGS[number].lap, LEGS[number].stage.index)]
        assert found.executor.stages_started == number + 1


def test_a_reported_stage_settles_it_at_a_position_that_fits_none():
    found = locator()
    found.seek(seen_at(60.0, (900.0, 900.0), stage=3), (0.0, 0.0))
    assert not found.uncertain
    assert stages(found)[0][1] == 3


def test_positions_decide_between_hypotheses_and_the_wrong_ones_go():
    """A lap of no time: two laps on the same line differ by the time alone, until the first turn."""
    number, time_s = 9, ENDS_S[8] + 1.0
    _, found = sighted(time_s, time_s + 7.0)
    for _ in range(20):
        time_s += 1.0
        _, position, course = nominal(time_s)
        found.follow(seen_at(time_s + 7.0, position, course), None, lambda *_: None)
    assert not found.uncertain
    true = LEGS[nominal(time_s)[0]]
    assert stages(found) == [(true.lap, true.stage.index)]
    assert number < found.executor.stages_started


def test_a_placed_flight_fires_its_trigger_on_time():
    """From any share of a stage, the stage ends where a flight from its start ends it."""
    for number in range(4):
        ends = []
        for share in (0.1, 0.6):
            points = list(leg_points(LEGS[number], 0.5))
            first = round(share * (len(points) - 1))
            executor = PlanExecutor(PLAN, PARAMETERS, START, Rules())
            for _ in range(number):
                executor.skip(LEGS[number].start_m)
            here = (points[first].x_m, points[first].y_m)
            placed = executor.placed(executor.cursor, LEGS[number].start_m, number + 1, here, share)
            ends.append(next(i for i in range(first, len(points)) if placed.advance(points[i].x_m, points[i].y_m)))
        assert ends[0] == ends[1]


def test_a_placed_flight_ends_a_circle_that_it_flies_past_outside():
    """Most of a turn, 8 m outside the circle and so outside the trigger's disc: the angle flown ends it."""
    text = "%: trigger-radius 5\n0.002; 90; x^2 + y^2 - 50^2\n47, -17.06\n0.1; 90; x - 47\n47, 300\n"
    plan, _ = read_plan(Text("circle.plan", text))
    executor = PlanExecutor(plan, (), (50.0, 0.0), Rules())
    sweep_deg = 360 - math.degrees(math.atan2(17.06, 47))

    def at(angle_deg):
        return 58 * math.cos(math.radians(angle_deg)), 58 * math.sin(math.radians(angle_deg))

    for first_deg in (10, 200, 300):
        placed = executor.placed(executor.cursor, (50.0, 0.0), 1, at(first_deg), first_deg / sweep_deg)
        ends_deg = next(angle for angle in range(first_deg, 720) if placed.advance(*at(angle)))
        assert ends_deg == math.ceil(sweep_deg)
