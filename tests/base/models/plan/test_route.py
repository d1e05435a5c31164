"""What is left of a plan: against the nominal flight, against plans as they are flown, and times by integration."""

import contextlib
import io
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
from common import ROOT, few
from common.observations import Piloted
from common.plans import PARTS, ROUND_AND_ON, WAVES, plan_of, survey
from common.routes import Tracked
from scipy.integrate import quad

from eadp.cli.main import main
from eadp.core.geometry.curves import CIRCLE, LINE
from eadp.core.guidance import GRAVITY_MPS2
from eadp.errors import PathUndefined
from eadp.models.battery import Battery
from eadp.models.computing import Computing
from eadp.models.plan.cursor import LIVE, PlanCursor, PlanEnd, Rules
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import RoutePredictor, flown_to_end_m
from eadp.models.plan.stage import left_m, leg_points
from eadp.models.plan.trace import default_start, nominal_legs
from eadp.models.vehicle import FixedWing, Guidance
from eadp.models.weather import Wind
from eadp.models.world import Mission, TakeOff, Timing, World
from eadp.planning.base import PlannerSettings
from eadp.planning.registry import Planner
from eadp.simulation.loop import Outcome, fly

MICROMETRE, MILLIMETRE = 1e-6, 1e-3
STEP_M = 2.0
QUADRATURE = 2e-3
"""Relative error of times and turning on legs against fine steps."""
FLOWN_IN_WIND = 0.03
FLOWN = Rules()

A_CURVE = f"1; 270; y - 10*sin(x/60)\n150, {10 * math.sin(2.5)!r}\n0.1; 90; x - 150\n150, 400\n"
TWO_PARAMETERS = """\
init:
n = 4
a = 0, 40 + c1
b = 0, 0
path:
0.1; 90; x - a
a, 100 + c2
[4, 20]
[-30, 30]
[2, 10]
0.01; 270; (x - a - 20 - c1/4)^2 + (y - 100 - c2)^2 - (20 + c1/4)^2
a + 40 + c1/2, 100 + c2
[4, 20]
[-30, 30]
[0, 0]
0.1; 270; x - a - 40 - c1/2
a + 40 + c1/2, b
[4, 20]
[-30, 30]
[2, 10]
0.01; 90; (x - a - 40 - 3*c1/4)^2 + (y - b)^2 - (c1/4)^2
a + 40 + c1, b
[4, 20]
[-30, 30]
[2, 10]
trig:
400, 0
"""
BOXES_DIFFER = """\
init:
n = 2
a = 0, 40 + c1
path:
0.1; 90; x - a
a, 100
[5, 10]
0.1; 270; y - 100 + 0*c1
a + 40 + c1, 100
[0, 20]
trig:
900, 100
"""


@lru_cache
def covered(*more) -> Plan:
    """A plan of parts, of a real field."""
    out = io.StringIO()
    field = ["cover", str(ROOT / "plans" / "meadow.geojson"), "--pattern", "zamboni"]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        assert main([*field, "--min-radius", "30", "--swath", "30", *more]) == 0
    return plan_of(out.getvalue())


def with_computations() -> Plan:
    return covered("--profile", str(ROOT / "profiles" / "pednet-jetson-nano.yaml"))


def two_parameters() -> Plan:
    return plan_of(TWO_PARAMETERS)


def nearly_a_point(plan: Plan) -> Plan:
    """The same with triggers that fire where they are, so that flights are exact."""
    return replace(plan, trigger_radius_m=MILLIMETRE)


def begun(plan, parameters, rules=FLOWN):
    start = default_start(plan, parameters)[0]
    return Tracked(plan, parameters, start, rules), start


def of_legs(legs):
    return np.array([(leg.stage.index, leg.distance_m, *leg.start_m, *leg.end_m) for leg in legs])


def alike(found, expected, tolerance=MICROMETRE):
    assert [leg.stage.index for leg in found] == [leg.stage.index for leg in expected]
    assert of_legs(found) == pytest.approx(of_legs(expected), abs=tolerance)


# --- at take-off ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("c1", [-1000.0, -400.0, 0.0])
def test_the_survey_at_take_off_is_the_nominal_flight(c1):
    follower, start = begun(survey(), (0.0, 10.0))
    fresh, begin = begun(survey(), (c1, 10.0))
    alike(fresh.route((c1, 10.0)).legs, nominal_legs(survey(), (c1, 10.0), begin))
    assert start != begin or c1 == 0
    later = follower.route((c1, 10.0)).legs  # decided now, it waits for the first lap's end
    assert [leg.stage.index for leg in later[:4]] == [1, 2, 3, 4]


@pytest.mark.quick(2)
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("with_profile", [False, True])
def test_plans_of_parts_at_take_off(share, with_profile):
    plan = with_computations() if with_profile else covered()
    box = plan.hull(0)
    parameters = (box.lo + share * (box.hi - box.lo), 10.0)[: len(plan.parameters)]
    follower, start = begun(plan, parameters)
    alike(follower.route(parameters).legs, nominal_legs(plan, parameters, start))


@pytest.mark.parametrize("text", [WAVES, ROUND_AND_ON, "0.1; 90; x\n0, 400\n"], ids=["waves", "circle", "one stage"])
def test_curves_and_explicit_plans(text):
    plan = plan_of(text)
    follower, start = begun(plan, ())
    alike(follower.route(()).legs, nominal_legs(plan, (), start), MILLIMETRE)


def test_a_plan_whose_end_is_not_reached_is_refused():
    plan = plan_of(WAVES.replace("h = 0, 50", "h = 0, 0"))
    follower, _ = begun(plan, ())
    with pytest.raises(PathUndefined, match="does not reach"):
        follower.route(())


def test_a_plan_that_cannot_be_flown_at_some_parameters_is_refused_there_alone():
    plan = plan_of("init:\na = 0, 50\npath:\n0.01; 90; (x - a)^2 + y^2 - c1\na + sqrt(c1), 0\ntrig:\n200, 0\n")
    follower, _ = begun(plan, (400.0,))
    assert follower.route((400.0,)).legs
    with pytest.raises(PathUndefined):
        follower.route((-1.0,))
    assert follower.route((400.0,)).legs


# --- in flight --------------------------------------------------------------------------------------------------------


@dataclass
class Flown:
    """A stage as flown."""

    stage: int
    trigger_m: tuple[float, float]
    parameters: tuple[float, ...]
    flown_m: float
    whole: bool = True


def way(itinerary: PlanExecutor, begin) -> Iterator[tuple[tuple[float, float], float]]:
    """Points along a stage as it lies, from where it is joined to its trigger, and how far along it they are."""
    offset, trigger = np.array(itinerary.cursor.offset_m), itinerary.trigger_m
    track = itinerary.stage.track(itinerary.path, tuple(trigger - offset))
    local = tuple(begin - offset)
    length = float(track.ahead_m(local))
    count = max(1, math.ceil(length / STEP_M))
    points = track.points(local, length, 1.0, count)[1:-1, :2] + offset
    for k, point in enumerate(points.tolist(), 1):
        yield tuple(point), length * k / count
    yield trigger, length


def itinerary_flown(plan, parameters, start, decisions, rules=FLOWN):
    """Fly exactly along the path; `decisions` are taken half way of stages, counted from 0.

    Returns the stages flown, and the route that is left at the start of each.
    """
    itinerary, predictor = PlanExecutor(PlanCursor.start(plan, parameters, rules), start), RoutePredictor()
    decided, begin = tuple(parameters), start
    flights, forecasts = [], []
    for k in range(500):
        forecasts.append(predictor.route(itinerary.cursor.decide(decided), itinerary.joined_m))
        points = list(way(itinerary, begin))
        length, last, changed, half = 0.0, begin, False, len(points) // 2
        stage, trigger, own = itinerary.stage.index, itinerary.trigger_m, itinerary.parameters
        for i, (point, along) in enumerate(points):
            if i == half and k in decisions:
                decided = tuple(decisions[k])
                itinerary.decide(decided, last)
            length, last = along, point
            changed = itinerary.advance(*point)
            if changed or itinerary.complete:
                break
        flights.append(Flown(stage, trigger, own, length, whole=not itinerary.complete))
        if itinerary.complete:
            return flights, forecasts
        assert changed, f"stage {stage} is left at its trigger"
        assert math.dist(last, trigger) <= MILLIMETRE, "and not before"
        begin = trigger
    raise AssertionError("the flight does not end")


def told_at_every_stage(plan, flights, forecasts, decisions):
    """Every forecast is what is flown, up to the stage in which the next decision is taken."""
    for k, course in enumerate(forecasts):
        later = min((i for i in decisions if i >= k), default=len(flights) - 1)
        if later == len(flights) - 1:
            assert len(course.legs) == len(flights) - k, "to the end"
        for leg, own, flown in zip(course.legs, course.parameters, flights[k : later + 1], strict=False):
            rho = plan.path_count
            assert leg.stage.index == flown.stage
            assert own[:rho] == flown.parameters[:rho]
            assert leg.end_m == pytest.approx(flown.trigger_m, abs=MICROMETRE)
            step = 0.0 if flown.whole else STEP_M
            assert leg.distance_m == pytest.approx(flown.flown_m, abs=step + MILLIMETRE)


def random_decisions(rng, plan, stages, count):
    return {
        rng.randrange(stages): tuple(
            rng.choice([box.lo, box.hi, rng.uniform(box.lo, box.hi)])
            for box in (plan.hull(i) for i in range(len(plan.parameters)))
        )
        for _ in range(count)
    }


@pytest.mark.parametrize(
    ("make", "first", "stages", "seed"),
    [
        *((survey, lambda rng, _: (rng.uniform(-1000, 0), 10.0), 40, seed) for seed in range(3)),
        *((with_computations, lambda rng, box: (rng.uniform(box.lo, box.hi), 10.0), 60, seed) for seed in range(2)),
        *((two_parameters, lambda rng, _: (rng.uniform(4, 20), rng.uniform(-30, 30), 4.0), 24, n) for n in range(3)),
    ],
)
def test_every_stage_tells_the_rest(make, first, stages, seed):
    rng, plan = random.Random(seed), nearly_a_point(make())
    parameters = first(rng, plan.hull(0))
    decisions = random_decisions(rng, plan, stages, rng.randrange(6))
    start = default_start(plan, parameters)[0]
    told_at_every_stage(plan, *itinerary_flown(plan, parameters, start, decisions), decisions)


def test_a_decision_where_sets_differ_between_stages():
    plan = nearly_a_point(plan_of(BOXES_DIFFER))
    start = (0.0, 0.0)
    itinerary, predictor = PlanExecutor(PlanCursor.start(plan, (20.0,), FLOWN), start), RoutePredictor()
    begin, course = start, predictor.route(itinerary.cursor, start)
    for k in range(6):
        for point, _ in way(itinerary, begin):
            changed = itinerary.advance(*point)
        assert changed
        begin = point
        if k == 1:  # c1 takes effect at the start of stage 2 (stage 1's path does not depend on it before that)
            itinerary.decide((0.0,), begin)
        if k > 1:
            assert course.legs[1].end_m == pytest.approx(itinerary.trigger_m, abs=MICROMETRE), "as a stage before"
            assert course.parameters[1] == itinerary.parameters
        course = predictor.route(itinerary.cursor, itinerary.joined_m)
        assert course.legs[0].end_m == pytest.approx(itinerary.trigger_m, abs=MICROMETRE)
        assert course.parameters[0] == itinerary.parameters


def test_parameters_known_to_be_in_force_hold_until_the_next_latch():
    sets = PARTS.split("[-900, 0]\n")
    text = "[-900, 0]\n".join(sets[:4]) + "[-900, -500]\n" + "[-900, 0]\n".join(sets[4:])
    follower = Tracked(plan_of(text), (-100.0, 10.0), (10.0, 10.0))
    follower.next_stage()
    follower.next_stage()
    assert follower.stage.index == 3
    follower.decide((-800.0, 10.0))
    follower.next_stage()
    assert follower.cursor.parameters[0] == -800.0
    follower.cursor = follower.cursor.in_force((-100.0, 10.0))  # an autopilot that did not take it
    assert follower.cursor.parameters[0] == -500.0, "clipped to the set of stage 4"
    assert follower.cursor.decided == (-800.0, 10.0)
    assert [own[0] for own in follower.route((-800.0, 10.0)).parameters[:2]] == [-500.0, -100.0]


def test_live_changes_in_the_second_lap():
    plan, rules = nearly_a_point(survey()), Rules(LIVE)
    start = default_start(plan, (0.0, 10.0))[0]
    decisions = {5: (-900.0, 10.0)}
    flights, forecasts = itinerary_flown(plan, (0.0, 10.0), start, decisions, rules)
    # the stage of the decision moves under the aircraft, and the one after it is joined from there: ends alone
    for leg, own, flown in zip(forecasts[6].legs, forecasts[6].parameters, flights[6:], strict=True):
        assert leg.stage.index == flown.stage
        assert leg.end_m == pytest.approx(flown.trigger_m, abs=MICROMETRE)
        assert own[0] == flown.parameters[0] == -900
    told_at_every_stage(plan, flights[7:], forecasts[7:], {})


# --- latches ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [survey, with_computations, two_parameters])
def test_before_the_latch_means_that_the_next_leg_has_what_is_decided_now(make):
    plan = make()
    first = tuple(box.lo + 0.6 * (box.hi - box.lo) for box in map(plan.hull, range(len(plan.parameters))))
    moved = tuple(box.lo + 0.3 * (box.hi - box.lo) for box in map(plan.hull, range(len(plan.parameters))))
    rho = plan.path_count
    follower, _ = begun(plan, first)
    for _ in range(20):
        course, kept = follower.route(moved), follower.route(first)
        if len(course.legs) < 2:
            break
        taken = [a != b for a, b in zip(course.parameters[1][:rho], kept.parameters[1][:rho], strict=True)]
        assert follower.cursor.accepts_changes() == any(taken)
        follower.next_stage()


# --- times ------------------------------------------------------------------------------------------------------------


def integrated(leg, airspeed_mps, wind_mps, step_m=0.05):
    """Time and ∫ tan² φ dt over what is flown of a leg, from points along it."""
    points = leg_points(leg, step_m)
    places = points[:, :2]
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    course = np.unwrap(points[:, 2])
    w = complex(*wind_mps)
    across = (w * np.exp(-1j * course)).imag
    nose = course - np.arcsin(across / airspeed_mps)  # the crab takes out what is across
    speeds = (airspeed_mps * np.exp(1j * nose) + w).real * np.cos(course) + (
        airspeed_mps * np.exp(1j * nose) + w
    ).imag * np.sin(course)
    seconds = steps * (1 / speeds[1:] + 1 / speeds[:-1]) / 2
    rates = np.diff(nose) / seconds
    return seconds.sum(), ((airspeed_mps * rates / GRAVITY_MPS2) ** 2 * seconds).sum()


@pytest.mark.quick(4)
@pytest.mark.parametrize("wind_mps", [(0.0, 0.0), (5.0, 3.0), (-8.0, 2.0)])
@pytest.mark.parametrize("make", [survey, lambda: plan_of(A_CURVE), two_parameters])
def test_times_and_turning_against_fine_steps(make, wind_mps):
    plan = make()
    parameters = (9.0, 5.0, 4.0)[: len(plan.parameters)] if plan.path_count != 1 else (-400.0, 10.0)
    follower, _ = begun(plan, parameters)
    course = follower.route(parameters)
    some = [*range(4), len(course.legs) - 1]
    times, turning = course.times_s(15.0, wind_mps)
    for i in sorted({i for i in some if i < len(course.legs)}):
        seconds, bank = integrated(course.legs[i], 15.0, wind_mps)
        curve = course.legs[i].stage.kind not in (LINE, CIRCLE)
        assert times[i] == pytest.approx(seconds, rel=QUADRATURE, abs=1e-6)
        assert turning[i] == pytest.approx(bank, rel=0.05 if curve else 5 * QUADRATURE, abs=1e-3)


@pytest.mark.parametrize("wind_mps", [(0.0, 15.5), (20.0, 0.0), (0.0, -15.0)])
def test_a_wind_stronger_than_the_airspeed_is_never_flown_through(wind_mps):
    follower, _ = begun(survey(), (-400.0, 10.0))
    times, turning = follower.route((-400.0, 10.0)).times_s(15.0, wind_mps)
    assert not np.isfinite(times).all()
    assert (times > 0).all()
    assert np.isfinite(turning).all()
    assert not np.isnan(times).any()


def simulated(c1, wind, step_s):
    """A flight of the survey with held parameters."""
    plan, parameters = survey(), (c1, 10.0)
    start, heading = default_start(plan, parameters)
    computing, battery, plane = Computing(1, None), Battery(capacity_ah=50), FixedWing()
    begins, clock = TakeOff(start, heading, 25.0), Timing(step_s)
    altitude_m = plane.cruise_altitude_m
    mission = Mission(plan, computing, battery, plane, parameters, start, rules=FLOWN, altitude_m=altitude_m)
    world = World(mission, Guidance(), wind, (), begins, clock)
    outcome = Outcome()
    for _ in fly(world, Piloted(Planner(PlannerSettings(), mission)), outcome):
        pass
    assert outcome.completed
    return outcome


@pytest.mark.quick(1)
@pytest.mark.parametrize("wind", [Wind(), Wind(4.0, towards_deg=90.0), Wind(6.0, towards_deg=200.0)])
def test_a_simulated_flight_takes_the_times_told(wind):
    # triggers fire 20 m early at both ends of a leg, so that durations stay but for the first and the last
    outcome, parameters = simulated(-1000.0, wind, 0.02), (-1000.0, 10.0)
    course = Tracked(survey(), parameters, default_start(survey(), parameters)[0]).route(parameters)
    times, _ = course.times_s(FixedWing().airspeed_mps, wind.steady_mps)
    ends = [0.0, *outcome.stage_times_s, outcome.duration_s]
    durations = np.diff(ends)
    laps = len(times) // 4 - 1
    for stage in range(4):
        flown, told = durations[4 + stage : 4 * laps : 4].sum(), times[4 + stage : 4 * laps : 4].sum()
        assert flown == pytest.approx(told, rel=2 * FLOWN_IN_WIND)
    assert outcome.duration_s == pytest.approx(times.sum(), rel=FLOWN_IN_WIND)


# --- what is left of a leg --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [survey, with_computations, lambda: plan_of(A_CURVE)])
def test_left_along_each_leg(make):
    plan = make()
    parameters = (-150.0, 10.0)[: len(plan.parameters)]
    follower, _ = begun(plan, parameters)
    legs = follower.route(parameters).legs
    for leg in [*legs[:6], legs[-1]]:
        points = leg_points(leg, 1.0)
        for i in range(0, len(points), 7):
            flown = leg.distance_m * i / (len(points) - 1)
            rough = min(max(flown * 1.1 - 5, 0.0), leg.distance_m)
            told = flown if leg.stage.kind not in (LINE, CIRCLE) else rough
            place = tuple(points[i, :2])
            off_m = 4.0 if leg.stage.kind == LINE else 0.1  # the survey's triggers lie off its circles
            assert left_m(leg, place, told) == pytest.approx(leg.distance_m - flown, abs=off_m)


def test_left_of_a_whole_turn_is_told_apart_by_what_is_flown():
    follower = Tracked(plan_of(ROUND_AND_ON), (), (50.0, 0.0))
    leg = follower.route(()).legs[0]
    assert leg.length_m == pytest.approx(100 * math.pi)
    assert left_m(leg, (50.0, 0.0), 0.0) == pytest.approx(100 * math.pi)
    assert left_m(leg, (50.0, 0.0), 310.0) == pytest.approx(0, abs=MICROMETRE)
    assert left_m(leg, (-70.0, 0.0), 150.0) == pytest.approx(50 * math.pi)
    assert left_m(leg, (50.0, 1.0), 300.0) == pytest.approx(0, abs=1.0)


# --- where a plan is over ---------------------------------------------------------------------------------------------


def first_by_steps(leg, final, shift, radius_m, step_m=0.01):
    """The same by looking every centimetre; none where nothing is found."""
    for i, point in enumerate(points := leg_points(leg, step_m)):
        inside = []
        for value, to, d in zip(point[:2], final, shift, strict=True):
            inside.append(abs(value - to) <= radius_m if abs(d) < 1e-9 else (value - to) * d > 0)
        if all(inside):
            return leg.length_m * i / (len(points) - 1)
    return None


def a_leg(path, begin, trigger, rotation=90):
    plan = plan_of(f"0.1; {rotation}; {path}\n{trigger[0]!r}, {trigger[1]!r}\n")
    follower = Tracked(plan, (), begin)
    return follower.route(()).legs[0]


def first_beyond_m(leg, final, shift, radius):
    """How far along a leg a plan is over; None where it is not."""
    return flown_to_end_m(leg, PlanEnd(final, shift, at_trigger=False), radius, 0.0)


def test_where_a_plan_is_over_on_a_curve():
    """y = 10 sin(x/60) rises over 6 m at x = 60 asin 0.6; ds² = (1 + cos²(x/60)/36) dx²."""
    leg = a_leg("y - 10*sin(x/60)", (0.0, 0.0), (150.0, 10 * math.sin(2.5)), 270)
    to_m = 60 * math.asin(0.6)
    expected_m, _ = quad(lambda x: math.hypot(1, math.cos(x / 60) / 6), 0.0, to_m)
    assert first_beyond_m(leg, (to_m, 6.0), (0.0, 1.0), 20.0) == pytest.approx(expected_m, abs=0.02)
    # along x it is within 20 m of 100 from x = 80 on
    expected_m, _ = quad(lambda x: math.hypot(1, math.cos(x / 60) / 6), 0.0, 80.0)
    assert first_beyond_m(leg, (100.0, 6.0), (0.0, 1.0), 20.0) == pytest.approx(expected_m, abs=0.01)
    assert first_beyond_m(leg, (0.0, 11.0), (0.0, 1.0), 200.0) is None


# --- the margin at the end --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", few(range(8), 3))
def test_where_a_plan_is_over_against_looking_every_centimetre(seed):
    rng = random.Random(seed)
    if seed % 2:
        sign = rng.choice([1, -1])
        leg = a_leg("3*x - 4*y", (-sign * 72.0, -sign * 54.0), (sign * 72.0, sign * 54.0), 90 if sign > 0 else 270)
    else:
        end = rng.uniform(0.5, 6.0)
        leg = a_leg("x^2 + y^2 - 3600", (60.0, 0.0), (60 * math.cos(end), 60 * math.sin(end)))
    final = (rng.uniform(-70, 70), rng.uniform(-70, 70))
    shift = (rng.choice([0.0, 10.0, -10.0]), rng.choice([0.0, 3.0, -3.0]))
    radius = rng.uniform(2, 40)
    found, expected = first_beyond_m(leg, final, shift, radius), first_by_steps(leg, final, shift, radius)
    assert (found is None) == (expected is None)
    if expected is not None:
        assert found == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("c1", [0.0, -110.0, -335.0, -1000.0])
def test_an_end_that_is_passed_by_less_than_the_margin_is_none(c1):
    """It is passed on a later leg, by more."""
    predictor, _ = begun(survey(), (c1, 10.0))
    exact = predictor.route((c1, 10.0)).legs
    for margin_m in (1.0, 8.0):
        legs = predictor.route((c1, 10.0), margin_m).legs
        assert len(legs) >= len(exact)
        if (legs[-1].lap, legs[-1].stage) != (exact[-1].lap, exact[-1].stage):
            assert predictor.route((c1, 10.0), 0.5).legs[: len(exact) - 1] == legs[: len(exact) - 1]
