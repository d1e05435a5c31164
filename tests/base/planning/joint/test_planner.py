"""The joint planner in simulated flights, and what it says of them."""

import itertools
import math
import re
from typing import NamedTuple

import numpy as np
import pytest
from common import ROOT, few
from common.observations import Piloted, measured, observation
from common.recorder import Recorder, watched

from eadp.api.inputs import load_flight
from eadp.errors import InputError
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text
from eadp.models.battery import Battery
from eadp.models.computing import join_profile
from eadp.models.profile import Profile
from eadp.models.vehicle import PowerCurve
from eadp.models.world import Mission
from eadp.planning.base import SHORT, PlannerSettings
from eadp.planning.joint.planner import GAUGE_DISBELIEVED, JUMPED, JointPlanner, JointSettings
from eadp.planning.joint.policy import SETTLED_S
from eadp.simulation.loop import Outcome, fly

RESERVE = 0.05
CALM = {"wind.speed_mps": 0.0, "faults": [], "planner.joint.loss_rate_per_h": 0.0}
STEP_S = 0.05
TIGHT = {"battery.capacity_ah": 0.305}


class SweepFlight(NamedTuple):
    """A flight of the survey."""

    inputs: object
    outcome: Outcome
    pilot: Recorder
    steps: list

    @property
    def records(self):
        return self.outcome.records

    def mean(self, index):
        return self.outcome.parameters.mean(index)

    def quality(self):
        return self.outcome.parameters.quality({})


def flown(plan=str(ROOT / "plans/survey.plan"), **overrides):
    keys = {"step_s": STEP_S, "log_every_s": 1.0, **overrides}
    inputs = load_flight(plan, scenario=str(ROOT / "scenarios/survey.yaml"), overrides=keys)
    flight, outcome = watched(inputs), Outcome()
    steps = list(fly(inputs.world, flight, outcome))
    return SweepFlight(inputs, outcome, flight.planner, steps)


@pytest.fixture(scope="module")
def dropped():
    """In wind, with a loss of charge at 93 s that nobody is told of."""
    return flown()


@pytest.fixture(scope="module")
def tight():
    """In calm air, with charge for half of what the computations could do."""
    return flown(**CALM, **TIGHT)


def test_flights_complete_and_keep_the_reserve(dropped, tight):
    for flight in (dropped, tight):
        assert flight.inputs.scenario.planner.name == "joint", "by default"
        assert flight.outcome.completed
        assert flight.outcome.soc_final >= RESERVE
        infeasible = [record for record in flight.records if record.status == "infeasible"]
        assert len(infeasible) <= 2, "but for a moment, where the first forecasts are wide"


def test_a_drop_of_charge_is_answered_at_once(dropped):
    i = next(i for i, record in enumerate(dropped.records) if record.cause == JUMPED)
    after = dropped.records[i]
    assert 93.0 - 1e-6 <= after.time_s <= 93.0 + 0.1 + STEP_S
    assert after.ending.reserve_probability > 0.9
    assert sum(record.cause == JUMPED for record in dropped.records) == 1


def test_path_parameters_change_where_they_are_latched_alone(dropped, tight):
    changed = 0
    for flight in (dropped, tight):
        for a, b in itertools.pairwise(flight.pilot.seen):
            if a.parameters[0] != b.parameters[0]:
                changed += 1
                assert b.stages_started > a.stages_started
                assert (b.stages_started - 1) % 4 == 3, "at the start of stage 4, the first to need it"
    assert changed > 1


def test_reports_count_what_was_solved(dropped):
    report = dropped.pilot.report
    assert len(report.solve_ms) == len(dropped.records)
    assert report.replans == sum(record.calls > 0 for record in dropped.records) > 0
    assert report.calls == report.solved + report.failed == sum(record.calls for record in dropped.records)
    assert sum(report.by_status.values()) == report.calls
    assert report.fallbacks == 0
    assert max(report.gaps) <= 1e-6


def test_a_gain_below_min_gain_changes_nothing():
    first = {"parameters.c1": -700.0, "time_limit_s": 60, **CALM, "battery.capacity_ah": 3.0}
    eager = flown(**first, **{"planner.joint.min_gain": 0.0})
    calm = flown(**first, **{"planner.joint.min_gain": 1.0})  # more than there is to gain
    assert {record.parameters[0] for record in calm.records} == {-700.0}
    assert any(record.reason.startswith("kept: no change gains enough") for record in calm.records)
    assert eager.records[-1].parameters[0] > -700.0
    assert eager.records[-1].ending.quality_forecast > calm.records[-1].ending.quality_forecast


SPEED_MPS, MOTION_W = 15.0, 36.0
VEHICLE = PowerCurve(((SPEED_MPS, MOTION_W),), airspeed_mps=SPEED_MPS, cruise_altitude_m=0.0)
PROFILE = Profile(("fps",), ("",), np.array([[2.0], [10.0]]), np.array([4.8, 9.8]))
LINE = "0.1; 90; x\n0, 4500\n[2, 10]\n"


def planner_of(text, battery, **settings):
    plan = read_plan(Text("p", text))[0]
    first = (10.0,)
    mission = Mission(plan, join_profile(plan, PROFILE), battery, VEHICLE, first, (0.0, 0.0))
    own = JointSettings(loss_rate_per_h=0.0)
    return Piloted(JointPlanner(PlannerSettings(name="joint", **settings), mission, own))


def north(pilot, battery, seconds, lost=lambda time_s: 0.0):
    """Fly north along a line second by second, the battery drained by what motion and computations take."""
    soc = 1.0
    parameters, decisions = (10.0,), []
    for k in range(1, seconds):
        own = max(parameters[0], 2.0)
        power = MOTION_W + float(np.interp(own, [2, 10], [4.8, 9.8]))
        soc -= battery.drain_per_s(power, battery.voltage_v)
        motion = {"velocity_mps": (0.0, SPEED_MPS), "heading_rad": np.pi / 2}
        plan, y, known = pilot.mission.plan, SPEED_MPS * k, soc - lost(k)
        seen = observation(plan, (own,), float(k), 0.0, y, power_w=power, soc=known, **motion)
        decisions.append(pilot.take(seen))
        parameters = decisions[-1].parameters
    return decisions, soc


@pytest.mark.quick(1)
@pytest.mark.parametrize("capacity_ah", few([0.26, 0.265, 0.27], 2))
def test_between_two_configurations_both_are_flown_and_the_charge_is_used(capacity_ah):
    battery = Battery(14.8, 0.05, capacity_ah, letter_crate_per_h=1e3)
    decisions, left = north(planner_of(LINE, battery, levels={"c1": (2.0, 10.0)}), battery, 300)
    flown_with = [decision.parameters[0] for decision in decisions]
    assert set(flown_with) == {2.0, 10.0}, "what lasts lies between"
    assert sum(a != b for a, b in itertools.pairwise(flown_with)) <= 6
    assert left >= RESERVE
    # nothing rises for less than SETTLED_S: from there on all that is left over stays so
    unused = SETTLED_S * 5.0 / (3600 * capacity_ah * 14.8)
    assert left < RESERVE + 0.01 + unused or decisions[-1].parameters == (10.0,)


def test_where_nothing_is_feasible_the_lowest_is_flown_at_once_and_it_is_said_since_when_and_by_how_much():
    battery = Battery(14.8, 0.05, 0.2, letter_crate_per_h=1e3)
    decisions, _ = north(planner_of(LINE, battery), battery, 100)
    evaluated = [(k, decision) for k, decision in enumerate(decisions, 1) if decision.record is not None]
    first_s = evaluated[0][0]
    pattern = r"battery short since (\S+) s: by (\S+) % of the charge, (\S+) Wh; computations at their lowest"
    for k, decision in evaluated:
        assert decision.parameters == (2.0,)
        since, percent, short_wh = map(float, re.fullmatch(pattern, decision.reason).groups())
        shortfall = percent / 100
        assert since == first_s
        assert short_wh == pytest.approx(shortfall * 0.2 * 14.8, abs=0.01)
        record = decision.record
        assert record.status == "infeasible"
        # the charge that lacks is that of the lowest to the end, of the reserve, and of a margin of 1.64 deviations
        assert shortfall == pytest.approx(RESERVE + 1.645 * record.ending.soc_end_std - record.ending.soc_end, abs=2e-3)
        assert k - first_s < 1 or record.ending.reserve_probability < 0.05


def test_what_is_infeasible_may_become_feasible_again():
    battery = Battery(14.8, 0.05, 0.45, letter_crate_per_h=1e3)
    decisions, _ = north(planner_of(LINE, battery), battery, 120, lost=lambda time_s: 0.6 if 40 <= time_s < 80 else 0.0)
    reasons = {k: decision.reason for k, decision in enumerate(decisions, 1)}
    assert not reasons[39].startswith(SHORT)
    assert reasons[40].startswith(f"{SHORT} since 40.0 s")
    assert reasons[79].startswith(f"{SHORT} since 40.0 s")
    assert not reasons[81].startswith(SHORT)
    assert decisions[40].parameters == (2.0,)
    assert decisions[-1].parameters == (10.0,)


@pytest.mark.quick(1)
@pytest.mark.parametrize("every_s", [0.1, 5.0])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_it_re_plans_each_second_where_it_is_asked_to_however_seldom_and_noisy_the_gauge(every_s, noise):
    own = {"estimator.every_s": every_s, "sensors.soc_noise": noise, "planner.joint.max_interval_s": 0}
    flight = flown(**own, time_limit_s=40.0, faults=[])
    times = [record.time_s for record in flight.records]
    assert [second for second in range(5, 41) if not any(abs(second - time_s) < 1e-6 for time_s in times)] == []


def test_before_it_starts_a_jump_alone_is_answered_and_looks_stay_rare():
    faults = [{"at_s": 2.0, "soc_drop": 0.06}, {"at_s": 20.0, "soc_drop": 0.06}]
    flight = flown(**{"planner.joint.start_after_s": 300.0, "time_limit_s": 60.0, "faults": faults})
    assert [record.cause for record in flight.records] == [JUMPED, JUMPED]
    assert [record.time_s for record in flight.records] == pytest.approx([5.0, 20.0], abs=1.0 + STEP_S)
    assert len(flight.pilot.seen) < 80


@pytest.mark.slow
@pytest.mark.parametrize("stuck", [True, False])
def test_a_gauge_that_is_stuck_is_warned_of(stuck):
    inputs = load_flight(
        str(ROOT / "plans/survey.plan"),
        scenario=str(ROOT / "scenarios/survey.yaml"),
        overrides={"step_s": STEP_S, "log_every_s": 1.0, **CALM, "battery.capacity_ah": 0.6, "time_limit_s": 200},
    )
    flight, outcome = inputs.flight(), Outcome()
    state, held = flight.state, 0.8
    ingest, observe = state.ingest, state.observe

    def shown(soc):
        return max(soc, held) if stuck else soc

    state.ingest = lambda r: ingest(r._replace(charges=[shown(soc) for soc in r.charges]))
    state.observe = lambda o: observe(measured(o, soc=shown(o.soc)))
    for _ in fly(inputs.world, flight, outcome):
        pass
    last = outcome.records[-1]
    assert last.reason.endswith(GAUGE_DISBELIEVED) == stuck
    assert not any(r.reason.endswith(GAUGE_DISBELIEVED) for r in outcome.records if r.time_s < 60)
    assert state.soc == pytest.approx(outcome.soc_final, abs=0.01)
    assert outcome.soc_final < held - 0.09


HOME = {**CALM, "battery.capacity_ah": 0.25, "on_infeasible": "home"}


@pytest.mark.slow
@pytest.mark.parametrize("home_m", few([[0.0, -1000.0], [900.0, 0.0]], 1))
def test_where_the_plan_is_infeasible_it_turns_back_at_the_last_moment(home_m):
    flight = flown(**HOME, **{"home.position_m": home_m})
    last, end = flight.records[-1], flight.steps[-1]
    assert (flight.outcome.completed, flight.outcome.reason) == (False, "returned home")
    assert end.x_m == pytest.approx(home_m[0], abs=25)
    assert end.y_m == pytest.approx(home_m[1], abs=25)
    assert end.parameters[1] == 2.0
    assert last.reason.startswith(f"home: {SHORT}")
    assert last.time_s < end.time_s - 20
    assert RESERVE <= flight.outcome.soc_final < RESERVE + 0.06
    assert all(record.home.home_reachable for record in flight.records[:-1])


def test_an_autopilot_returns_and_circles_at_the_end_of_the_plan():
    """Up to 100 m, home and once round, in the forecast, with a whole turn towards home, and in the flight."""
    keys = {**CALM, "battery.capacity_ah": 0.9, "home.position_m": [0.0, -600.0]}
    keys["vehicle.airframe.model"] = "fixed-wing"
    own = flown(**keys, **{"autopilot.kind": "ardupilot", "planner.name": "static"})
    plain = flown(**keys, **{"planner.name": "static"})
    assert (own.outcome.completed, own.outcome.reason) == (True, "final point reached")
    assert own.steps[-1].altitude_m == pytest.approx(100, abs=1)
    assert math.dist((own.steps[-1].x_m, own.steps[-1].y_m), (0, -600)) < 25
    forecast = own.inputs.preflight().forecast
    assert own.outcome.duration_s > plain.outcome.duration_s + 30
    assert 0 < forecast.remaining_s / own.outcome.duration_s - 1 < 0.08  # a lap more, as it misses the end by a hair
    assert 0 < forecast.energy_wh / (own.outcome.energy_j / 3600) - 1 < 0.08


@pytest.mark.parametrize(
    ("overrides", "what"),
    [({"home.position_m": None}, "home, which has no location"), ({"planner.name": "static"}, "home, with planner")],
)
def test_a_flight_home_needs_a_home_and_a_forecast(overrides, what):
    with pytest.raises(InputError, match=what):
        flown(**HOME, **{"home.position_m": [0.0, 0.0]} | overrides)
