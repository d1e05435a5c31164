"""The joint planner on odd plans and in odd states, from its observations alone."""

import numpy as np
import pytest
from common.observations import Piloted, observation
from common.plans import plan_of, survey

from eadp.models.battery import Battery
from eadp.models.computing import join_profile
from eadp.models.plan.cursor import PlanCursor, Rules
from eadp.models.plan.executor import FIRED, PlanExecutor
from eadp.models.plan.route import RoutePredictor
from eadp.models.profile import Profile
from eadp.models.vehicle import PowerCurve
from eadp.models.world import Mission
from eadp.planning.base import Observation, PlannerSettings, Sample
from eadp.planning.joint.planner import JointPlanner

PROFILE = Profile(("fps",), ("",), np.array([[2.0], [10.0]]), np.array([4.8, 9.8]))
SPEED_MPS, MOTION_W = 15.0, 36.0
VEHICLE = PowerCurve(((SPEED_MPS, MOTION_W),), airspeed_mps=SPEED_MPS, cruise_altitude_m=0.0)
FULL_AH, PLENTY = Battery(14.8, 0.05, 3.2, letter_crate_per_h=10.0), 0.9
LINE = "0.1; 90; x\n0, 900\n[2, 10]\n0.1; 90; x\n0, 1800\n[2, 10]\n"


def planner_for(plan, parameters, profile=PROFILE, battery=FULL_AH, start=(0.0, 0.0), **settings):
    computing = join_profile(plan, profile)
    mission = Mission(plan, computing, battery, VEHICLE, parameters, start)
    return Piloted(JointPlanner(PlannerSettings(name="joint", **settings), mission))


def up_a_line(pilot, parameters, length_m, stage_m=900.0, soc=lambda t: PLENTY):
    """Fly north along x = 0 second by second; decisions as they come."""
    decisions = []
    for k in range(1, int(length_m / SPEED_MPS)):
        y = SPEED_MPS * k
        stage = int(y // stage_m) + 1
        own = {"power_w": MOTION_W + 9.8, "velocity_mps": (0.0, SPEED_MPS), "heading_rad": np.pi / 2}
        plan = pilot.mission.plan
        seen = observation(plan, parameters, float(k), 0.0, y, started=stage, soc=soc(k), **own)
        decisions.append(pilot.take(seen))
        parameters = decisions[-1].parameters
    return decisions


@pytest.mark.parametrize("soc", [0.04, 0.001])
def test_below_the_reserve_the_lowest_configuration_is_flown(soc):
    decisions = up_a_line(planner_for(plan_of(LINE), (10.0,)), (10.0,), 1800, soc=lambda t: soc)
    assert decisions[-1].parameters == (2.0,)
    assert "battery short since" in decisions[-1].reason
    assert decisions[-1].record.status == "infeasible"


def test_a_wind_stronger_than_the_airspeed_is_said():
    plan = plan_of(LINE)
    pilot = planner_for(plan, (10.0,))
    decision = None
    for k in range(1, 60):  # blown backwards
        own = {"velocity_mps": (0.0, -3.0), "heading_rad": np.pi / 2}
        seen = observation(plan, (10.0,), float(k), 0.0, 100.0 - 3 * k, soc=PLENTY, **own)
        decision = pilot.take(seen)
    assert "cannot be flown" in decision.reason
    assert decision.parameters == (10.0,)


@pytest.mark.parametrize(
    ("text", "parameters", "profile"),
    [
        ("0.1; 90; x\n0, 1800\n", (), None),
        ("0.1; 90; x - c1\nc1, 1800\n[-3, 3]\n", (0.0,), None),
        ("0.1; 90; x\n0, 1800\n[0, 0]\n", (0.0,), None),
    ],
    ids=["nothing to choose", "no computations", "inhibited"],
)
def test_plans_with_little_to_choose(text, parameters, profile):
    pilot = planner_for(plan_of(text), parameters, profile)
    decisions = up_a_line(pilot, parameters, 1500, stage_m=1e9)
    record = decisions[-1].record
    assert record.time_s + record.ending.remaining_s == pytest.approx(1800 / SPEED_MPS, abs=1)
    assert len(decisions[-1].parameters) == len(parameters)


@pytest.mark.slow
def test_the_quality_told_counts_what_is_flown_of_the_stage_of_the_moment():
    """Half of a single stage at the highest, half at the lowest, for the charge is lost half way."""
    battery = Battery(14.8, 0.05, 3.2, letter_crate_per_h=100.0)
    pilot = planner_for(plan_of("0.1; 90; x\n0, 9000\n[2, 10]\n"), (10.0,), battery=battery)
    decisions = up_a_line(pilot, (10.0,), 5000, stage_m=1e9, soc=lambda t: PLENTY if t < 300 else 0.01)
    assert decisions[-1].parameters == (2.0,)
    assert decisions[-1].record.ending.quality_forecast == pytest.approx(0.5, abs=0.02)


def test_power_that_the_battery_does_not_allow_is_said():
    battery = Battery(14.8, 0.05, 3.2, letter_crate_per_h=1.0)  # 24 W at half the charge; flight takes 36 W
    pilot = planner_for(plan_of("0.1; 90; x\n0, 9000\n[2, 10]\n"), (10.0,), battery=battery)
    decisions = up_a_line(pilot, (10.0,), 1000, stage_m=1e9, soc=lambda t: 0.5)
    assert decisions[-1].parameters == (2.0,)
    assert decisions[-1].record.status == "infeasible"


def test_a_decision_that_comes_too_late_for_its_stage_does_not_stay_in_the_route():
    plan = survey()
    battery = Battery(capacity_ah=0.6, letter_crate_per_h=20.0)
    pilot = planner_for(plan, (0.0, 10.0), battery=battery, start=(-45.0, 216.0))
    executor, first = PlanExecutor(PlanCursor.start(plan, (0.0, 10.0), Rules()), (-45.0, 216.0)), (0.0, 10.0)

    def seen(time_s, x_m, y_m, soc):
        joined_m, started = executor.joined_m, executor.stages_started
        return Observation(Sample(time_s, (x_m, y_m), 46.0, soc), soc, executor.cursor, joined_m, started)

    for k in range(1, 31):
        if k in (10, 20):
            executor.handle(FIRED, *executor.trigger_m)
        pilot.take(seen(float(k), -40.0, -60.0, 1.0 if k < 30 else 0.5))
        if k == 20:  # nothing but the loss of charge is to change the path
            first = pilot.take(seen(20.5, -40.0, -60.0, 1.0)).parameters
            executor.decide(first, (-40.0, -60.0))
    decided = pilot.take(seen(30.5, -40.0, -60.0, 0.5)).parameters
    assert decided[0] != first[0], "decided in the last moment of stage 3"
    executor.handle(FIRED, *executor.trigger_m)
    executor.decide(decided, executor.joined_m)  # a moment after stage 4 has started with what was in force before
    pilot.take(seen(31.0, 35.0, 0.0, 0.5))
    known = pilot.state.known(31.0, (35.0, 0.0))
    pilot._places.enter(known)
    route = pilot._places.route(known, pilot._places.shares)
    assert route.parameters[0][0] == first[0] == executor.parameters[0]
    cursor = executor.cursor.decide(pilot._decision.parameters)
    again = RoutePredictor().route(cursor, executor.joined_m, known.margin_m)
    assert [own[0] for own in route.parameters] == [own[0] for own in again.parameters]
