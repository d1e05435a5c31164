"""The position in a plan: by reports, by triggers, and after a gap by position, course and time."""

import math

import pytest
from common import ROOT
from common.observations import seen_at
from common.plans import PARTS
from hypothesis import given
from hypothesis import strategies as st

from eadp.api.inputs import Files, load_flight
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text
from eadp.live.locator import COURSE_STD_RAD, DISTANCE_STD_M, FollowedExecutor, path_mismatch
from eadp.live.tracker import Messages, PlanTracker
from eadp.models.plan.cursor import PlanCursor, Rules, shift_at
from eadp.models.plan.route import RoutePredictor
from eadp.models.plan.stage import leg_points

PLAN, _ = read_plan(read_text(str(ROOT / "plans/survey.plan")))
MISSION = load_flight(
    str(ROOT / "plans/survey.plan"), scenario=str(ROOT / "scenarios/survey.yaml"), overrides={"parameters.c1": -300.0}
).mission
START, SPEED, PARAMETERS = MISSION.start_m, MISSION.cruise_mps, MISSION.parameters
LEGS = RoutePredictor().route(PlanCursor.start(PLAN, PARAMETERS), START).legs
ENDS_S = [sum(leg.distance_m for leg in LEGS[: i + 1]) / SPEED for i in range(len(LEGS))]
CALM = (0.0, 0.0)


def begun(parameters, plan=PLAN, position=START):
    return FollowedExecutor(PlanCursor.start(plan, parameters, Rules()), position)


def nominal(time_s):
    """Number of the leg, position and course at a time on the nominal flight in no wind."""
    number = next(i for i, end_s in enumerate(ENDS_S) if time_s < end_s)
    points = leg_points(LEGS[number], 0.1)
    before_s = ENDS_S[number - 1] if number else 0.0
    x, y, course = points[round((time_s - before_s) / (ENDS_S[number] - before_s) * (len(points) - 1))].tolist()
    return number, (x, y), course


def tracker():
    """At the start of the survey."""
    return PlanTracker(MISSION, START, 0.0, Messages())


def starts_of(found, seen):
    """Take a sample; the starts of stages before it."""
    starts = []
    found.track(seen, CALM, lambda *start: starts.append(start))
    return starts


def place(found):
    return found.executor.cursor.lap, found.executor.stage.index


def place_at(time_s):
    leg = LEGS[nominal(time_s)[0]]
    return leg.lap, leg.stage.index


@given(st.floats(6.0, ENDS_S[-1] - 1.0), st.floats(0.95, 1.05))
def test_the_stage_is_found_again_after_any_gap(time_s, wrong_share):
    number, position, course = nominal(time_s)
    before_s = ENDS_S[number - 1] if number else 0.0
    found = tracker()
    starts_of(found, seen_at(time_s * wrong_share, position, course))
    if min(time_s - before_s, ENDS_S[number] - time_s) > 1.0:  # two stages meet at a trigger
        assert place(found) == place_at(time_s)
        assert found.executor.stages_started == number + 1
        assert found.stage_started_s == pytest.approx(time_s * wrong_share - (time_s - before_s), abs=1.0)
    assert found.through_gap
    assert found.stage_unknown


def test_what_is_found_is_certain_with_the_next_stage():
    found, time_s = tracker(), 100.0
    for _ in range(60):
        _, position, course = nominal(time_s)
        starts_of(found, seen_at(time_s, position, course))
        if not found.stage_unknown:
            break
        time_s += 1.0
    assert place(found) == place_at(time_s + 2.0) != place_at(100.0), "a trigger ends a stage within its radius"


def test_a_leg_that_the_time_does_not_allow_or_of_another_course_is_not_found():
    _, position, course = nominal(100.0)
    for seen in (seen_at(30.0, position, course), seen_at(100.0, position, course + math.pi)):
        found = tracker()
        starts_of(found, seen)
        assert place(found) != place_at(100.0)
        assert not found.lost


def test_without_a_position_the_flight_waits_unless_a_stage_is_reported():
    found = tracker()
    assert found.track(seen_at(4.0, None), CALM, lambda *_: None) == START
    assert not found.stage_unknown
    starts_of(found, seen_at(6.0, None))
    assert (place(found), found.stage_unknown) == ((0, 1), True)
    assert len(starts_of(found, seen_at(40.0, None, stages_started=4))) == 2
    assert place(found) == (0, 4)


@pytest.mark.parametrize("skips", [0, 1, 2, 3])
def test_stages_that_are_reported_to_be_over_are_skipped_and_spread_over_the_step(skips):
    found = tracker()
    starts = starts_of(found, seen_at(6.0, (-100.0, 240.0), stages_started=1 + skips))
    assert found.executor.stages_started == 1 + skips
    assert starts == [(6.0 * k / skips, (-100.0, 240.0), 1.0) for k in range(1, skips)]
    assert found.stage_started_s == (6.0 if skips else 0.0)


CIRCLE = "%: trigger-radius 5\n0.002; 90; x^2 + y^2 - 50^2\n47, -17.06\n0.1; 90; x - 47\n47, 300\n"


def test_turns_of_a_circle_before_a_gap_count_by_the_time_on_it():
    """The circle's start and end are near to one another: the time tells which is flown."""
    text = Text("circle.plan", CIRCLE)
    mission = load_flight(text.name, overrides={"start.position_m": [50, 0]}, files=Files({text.name: text})).mission
    for gap_s, stage in ((6.0, 1), (19.0 * 15 / mission.cruise_mps, 2)):
        found = PlanTracker(mission, (50.0, 0.0), 0.0, Messages())
        for k in range(1, 10):
            angle = 0.1 * k
            at = 50 * math.cos(angle), 50 * math.sin(angle)
            starts_of(found, seen_at(5.0 * k / mission.cruise_mps, at))
        angle += gap_s * mission.cruise_mps / 50
        at, course = ((50 * math.cos(angle), 50 * math.sin(angle)), angle + math.pi / 2)
        if stage == 2:
            at, course = (47.0, -10.0), math.pi / 2
        starts_of(found, seen_at(45.0 / mission.cruise_mps + gap_s, at, course))
        assert found.executor.stage.index == stage


@pytest.mark.parametrize("turned", [0.0, 0.4, math.pi / 2, 3.0])
def test_the_path_mismatch_is_the_distance_from_the_path_and_the_angle_to_it(turned):
    """On the path and at 7 m from a line, courses a whole turn apart alike."""
    number = next(i for i, leg in enumerate(LEGS) if leg.stage.kind == "line")
    found = tracker()
    found.begin_within(seen_at(0.0, LEGS[number].start_m, None, stages_started=number + 1))
    _, (x, y), course = nominal((ENDS_S[number - 1] + ENDS_S[number]) / 2)
    beside = (x - 7 * math.sin(course), y + 7 * math.cos(course))
    angle = (turned / COURSE_STD_RAD) ** 2
    for whole in (0, 2 * math.pi, -2 * math.pi):
        on_path = path_mismatch(found.executor, seen_at(9.0, (x, y), course + turned + whole))
        assert on_path == pytest.approx(angle, abs=1e-6)
        off_path = path_mismatch(found.executor, seen_at(9.0, beside, course + turned + whole))
        assert off_path == pytest.approx(angle + (7 / DISTANCE_STD_M) ** 2, rel=1e-6)


def test_a_placed_flight_fires_its_trigger_on_time():
    """From any share of a stage, the stage ends where a flight from its start ends it."""
    for number in range(4):
        ends = []
        for share in (0.1, 0.6):
            points = leg_points(LEGS[number], 0.5)[:, :2].tolist()
            first = round(share * (len(points) - 1))
            executor = FollowedExecutor(PlanCursor.start(PLAN, PARAMETERS, Rules()), START)
            for _ in range(number):
                executor.skip(LEGS[number].start_m)
            here = tuple(points[first])
            placed = executor.placed(executor.cursor, LEGS[number].start_m, number + 1, here, share)
            ends.append(next(i for i in range(first, len(points)) if placed.advance(*points[i])))
        assert ends[0] == ends[1]


def test_a_placed_flight_ends_a_circle_that_it_flies_past_outside():
    """Most of a turn, 8 m outside the circle and so outside the trigger's disc: the angle flown ends it."""
    plan, _ = read_plan(Text("circle.plan", CIRCLE))
    executor = FollowedExecutor(PlanCursor.start(plan, (), Rules()), (50.0, 0.0))
    sweep_deg = 360 - math.degrees(math.atan2(17.06, 47))

    def at(angle_deg):
        return 58 * math.cos(math.radians(angle_deg)), 58 * math.sin(math.radians(angle_deg))

    for first_deg in (10, 200, 300):
        placed = executor.placed(executor.cursor, (50.0, 0.0), 1, at(first_deg), first_deg / sweep_deg)
        ends_deg = next(angle for angle in range(first_deg, 720) if placed.advance(*at(angle)))
        assert ends_deg == math.ceil(sweep_deg)


# --- where others tell what is flown


def test_a_stage_may_be_left_anywhere_and_the_next_ones_lie_where_they_would():
    led, flown = (begun((0.0, 10.0)) for _ in range(2))
    here = (500.0, 500.0)
    for _ in range(5):
        assert led.skip(here)
        assert flown.skip(flown.trigger_m)
    assert (led.stage.index, led.cursor.lap, led.stages_started) == (2, 1, 6)
    assert led.trigger_m == flown.trigger_m
    assert led.cursor.offset_m == flown.cursor.offset_m == pytest.approx(shift_at(PLAN, (0.0, 10.0)))


def test_a_stage_that_is_told_to_go_on_is_not_left_but_the_plans_end_counts():
    itinerary = begun((0.0, 10.0))
    trigger = itinerary.trigger_m
    for point in ((trigger[0] + 30, trigger[1] + 60), trigger, (trigger[0], trigger[1] - 50)):
        itinerary.stay(*point)
    assert (itinerary.stages_started, itinerary.complete) == (1, False)
    assert itinerary.advance(trigger[0], trigger[1] - 50), "once nothing tells otherwise"
    line = begun((), read_plan(Text("p", "0.1; 90; x\n0, 400\n"))[0], (0.0, 0.0))
    line.stay(0.0, 100.0)
    assert not line.complete
    line.stay(0.0, 395.0)
    assert line.complete


def test_parameters_that_are_known_to_be_in_force_move_the_path_at_once():
    told, waiting = (begun((0.0, 10.0)) for _ in range(2))
    here = told.trigger_m
    waiting.decide((-500.0, 10.0), here)
    assert waiting.parameters == (0.0, 10.0)
    assert told.take_in_force((-500.0, 10.0), here)
    assert told.parameters == (-500.0, 10.0)
    assert told.path(*here)[0] == pytest.approx(begun((-500.0, 10.0)).path(*here)[0])
    assert not told.take_in_force((-500.0, 10.0), here)
    assert told.take_in_force((-500.0, 99.0), here) is False, "clipped to the stage's set"


def test_where_others_tell_what_is_flown():
    plan, _ = read_plan(Text("p", PARTS))
    itinerary = begun((0.0, 10.0), plan, (10.0, 0.0))
    stages = [itinerary.stage.index]
    ahead = {index: itinerary.stages_to(index) for index in range(len(plan.stages) + 2)}
    while itinerary.skip((0.0, 0.0)):
        stages.append(itinerary.stage.index)
    assert itinerary.complete
    first = {index: stages.index(index, 1) if index in stages[1:] else None for index in ahead}
    assert ahead == first
    assert len(stages) > len(set(stages)), "laps"
