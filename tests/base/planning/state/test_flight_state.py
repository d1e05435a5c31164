"""The state of a flight: it depends on its readings, and neither on when it is asked nor on their batches."""

import itertools
import math
from functools import lru_cache

import numpy as np
import pytest
from common.forecasts import plan_inputs, survey_inputs
from common.observations import measured

from eadp.planning.base import Mode, Observation, Readings
from eadp.planning.state.flight_state import FlightState
from eadp.planning.state.wind import MEASURED_WIND_S
from eadp.simulation.loop import Outcome, fly

BATCHES = 1e-9
GUSTS = {"wind.speed_mps": 6.0, "wind.towards_deg": 30.0, "wind.gust_std_mps": 1.2, "battery.capacity_ah": 0.6}


class Tape(FlightState):
    """A state that keeps what it takes."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.taken = []

    def ingest(self, readings):
        self.taken.append(readings)
        super().ingest(readings)

    def observe(self, observation):
        self.taken.append(observation)
        return super().observe(observation)


def recorded(inputs):
    """A flight: its inputs, what its state took, and its outcome."""
    flight, outcome = inputs.flight(), Outcome()
    flight.state = tape = Tape(inputs.mission, inputs.scenario.planner.weights)
    steps = list(fly(inputs.world, flight, outcome))
    return inputs, tape.taken, outcome, steps


@lru_cache
def survey_flight(faults=False):
    more = {"faults": [{"at_s": 93, "soc_drop": 0.06}]} if faults else {}
    return recorded(survey_inputs("joint", **GUSTS, **more))


def time_of(each):
    return each.time_s if isinstance(each, Observation) else float(each.times_s[-1])


def state_of(inputs, taken, *, every=0, every_s=0.1, weights=None):
    """A state that took all of it, asked at every so many items."""
    state = FlightState(inputs.mission, weights or {}, every_s)
    for i, each in enumerate(taken):
        state.observe(each) if isinstance(each, Observation) else state.ingest(each)
        if every and i % every == 0:
            state.known(time_of(each), (0.0, 0.0))
    return state


def numbers(known):
    """All that is known as a list of numbers."""
    if isinstance(known, bool | int | float):
        return [float(known)]
    if isinstance(known, tuple):
        return [number for each in known for number in numbers(each)]
    return []


def known_at_end(state, taken):
    last = next(each for each in reversed(taken) if isinstance(each, Observation))
    return state.known(time_of(taken[-1]), last.position_m)


@pytest.mark.slow
@pytest.mark.parametrize("faults", [False, True])
@pytest.mark.parametrize("every", [7, 1])
def test_what_it_knows_does_not_depend_on_when_it_is_asked(every, faults):
    inputs, taken, *_ = survey_flight(faults)
    assert len(taken) > 50
    once, often = (state_of(inputs, taken, every=each) for each in (0, every))
    assert known_at_end(once, taken) == known_at_end(often, taken)
    assert (once.losses, once.warnings, once.soc) == (often.losses, often.warnings, often.soc)
    assert once.losses == faults


def singles(readings):
    """Batches of one reading each."""
    columns = [np.asarray(column, dtype=float) if len(column) else column for column in readings]
    return [Readings(*(column[i : i + 1] for column in columns)) for i in range(len(readings.times_s))]


@pytest.mark.slow
@pytest.mark.parametrize("faults", [False, True])
def test_a_batch_is_its_readings_one_by_one(faults):
    inputs, taken, *_ = survey_flight(faults)
    taken = taken[: len(taken) // 4]
    split = []
    for each in taken:
        split += [each] if isinstance(each, Observation) else singles(each)
    assert len(split) > 2 * len(taken)
    whole, one_by_one = (known_at_end(state_of(inputs, each), each) for each in (taken, split))
    assert numbers(one_by_one) == pytest.approx(numbers(whole), rel=BATCHES, abs=BATCHES)
    assert len(numbers(whole)) > 40
    assert one_by_one.cursor == whole.cursor


@pytest.mark.slow
def test_it_knows_the_flight():
    inputs, taken, _, steps = survey_flight()
    known = known_at_end(state_of(inputs, taken), taken)
    true = 6 * math.cos(math.radians(30)), 6 * math.sin(math.radians(30))
    assert known.wind.mps == pytest.approx(true, abs=1.5)
    assert known.soc == pytest.approx(steps[-1].soc, abs=0.01)
    assert known.time.ratio == pytest.approx(1.0, abs=0.03)
    # the mean power of the motion over the flight, a + b tan² φ
    sets, power_w = inputs.mission.plan.stages[0].sets, inputs.mission.computing.power_w
    mean_w = np.mean([step.power_w - power_w(step.parameters, sets) for step in steps])
    assert known.motion.level_w < mean_w + 0.5
    assert known.motion.level_w == pytest.approx(mean_w, rel=0.15)
    assert known.joined.stages_started == 1 + len([1 for a, b in itertools.pairwise(steps) if a.stage != b.stage])
    assert known.charge.believed
    assert known.climb is None


def with_holes(taken, names, rng, share=0.5):
    """Some of the readings without some quantities."""
    found = []
    for each in taken:
        if isinstance(each, Observation):
            found.append(each)
            continue
        columns = {name: np.array(getattr(each, name), dtype=float) for name in names}
        for column in columns.values():
            column[rng.random(len(column)) < share] = math.nan
        found.append(each._replace(**columns))
    return found


@pytest.mark.quick(2)
@pytest.mark.parametrize("names", [["powers_w"], ["charges"], ["headings_rad"], ["vx_mps", "vy_mps"]])
def test_what_is_not_measured_is_left_out(names):
    inputs, taken, *_ = survey_flight()
    whole = known_at_end(state_of(inputs, taken), taken)
    holed = with_holes(taken, names, np.random.default_rng(0))
    known = known_at_end(state_of(inputs, holed), holed)
    assert np.isfinite(numbers(known)).all()
    assert known.soc == pytest.approx(whole.soc, abs=0.01)
    assert known.wind.mps == pytest.approx(whole.wind.mps, abs=0.5)
    assert known.motion.level_w == pytest.approx(whole.motion.level_w, rel=0.05)


def test_without_any_power_the_airframes_stays():
    inputs, taken, *_ = survey_flight()
    blind = [
        measured(each, power_w=None)
        if isinstance(each, Observation)
        else each._replace(powers_w=np.full(len(each.times_s), math.nan))
        for each in taken
    ]
    known = known_at_end(state_of(inputs, blind), blind)
    assert known.motion.level_w == pytest.approx(inputs.mission.vehicle.cruise_power_w, rel=1e-6)
    assert np.isfinite(numbers(known)).all()


def test_a_leg_through_a_gap_is_not_learned_from():
    """Times of legs are learned at the start of the next one; a gap in either tells nothing of how long they took."""
    inputs, taken, *_ = survey_flight()
    observations = [each for each in taken if isinstance(each, Observation)]
    gapped = [each._replace(through_gap=True) for each in observations]
    known = known_at_end(state_of(inputs, gapped), gapped)
    assert known.time.ratio == 1.0
    assert known_at_end(state_of(inputs, observations), observations).time.ratio != 1.0


def test_a_leg_that_an_autopilot_leaves_for_another_path_is_not_learned_from():
    inputs, taken, *_ = survey_flight()
    observations = [
        each._replace(
            sample=each.sample._replace(mode=Mode(flies_mission=True)),
            cursor=each.cursor._replace(waiting=(-float(each.stages_started), *each.cursor.waiting[1:])),
        )
        for each in taken
        if isinstance(each, Observation)
    ]
    assert known_at_end(state_of(inputs, observations), observations).time.ratio == 1.0


def test_an_observation_sooner_than_a_reading_is_due_is_none():
    inputs, taken, *_ = survey_flight()
    observations = [each for each in taken if isinstance(each, Observation)]
    one = observations[3]
    state = FlightState(inputs.mission, every_s=0.5)
    state.observe(one)
    before = state.known(one.time_s, one.position_m)
    state.observe(measured(one, time_s=one.time_s + 0.2, power_w=500.0, soc=0.2))
    after = state.known(one.time_s, one.position_m)
    assert (after.charge, after.motion, after.wind) == (before.charge, before.motion, before.wind)
    state.observe(measured(one, time_s=one.time_s + 0.5, soc=one.soc - 0.001))
    assert state.known(one.time_s, one.position_m).charge != before.charge


def test_a_measured_wind_is_used_for_a_while():
    inputs, taken, *_ = survey_flight()
    one = next(each for each in taken if isinstance(each, Observation))
    state = FlightState(inputs.mission)
    state.observe(measured(one, wind_mps=(2.0, -1.0)))
    assert state.wind_mps == (2.0, -1.0)
    known = state.known(one.time_s, (0.0, 0.0))
    assert known.wind[:2] == ((2.0, -1.0), (0.0, 0.0, 0.0))
    later = measured(one, velocity_mps=None, heading_rad=None)
    state.observe(measured(later, time_s=one.time_s + MEASURED_WIND_S - 1))
    assert state.wind_mps == (2.0, -1.0)
    state.observe(measured(later, time_s=one.time_s + MEASURED_WIND_S + 1))
    assert state.wind_mps != (2.0, -1.0)
    assert state.known(0.0, (0.0, 0.0)).wind.covariance != (0.0, 0.0, 0.0)


def test_an_assumed_wind_holds_before_take_off_with_its_gusts():
    inputs = survey_flight()[0]
    calm, gusty = FlightState(inputs.mission), FlightState(inputs.mission)
    calm.assume((3.0, 1.0), 0.0)
    gusty.assume((3.0, 1.0), 2.0)
    one, other = (state.known(0.0, (0.0, 0.0)) for state in (calm, gusty))
    assert one.wind.mps == other.wind.mps == (3.0, 1.0)
    assert other.time.noise_s > one.time.noise_s
    assert one.soc == inputs.mission.battery.soc


STAIRS = """\
%: altitude 25
0.01; 270; y
1000, 0
%: altitude 125
0.01; 270; y
1200, 0
%: altitude 100
0.01; 270; y
2500, 0
%: altitude 150
0.01; 270; y
5000, 0
"""


def test_altitudes_are_followed_and_their_power_is_not_that_of_level_flight(tmp_path):
    keys = {"start.position_m": [0, 0], "wind.speed_mps": 0.0, "planner.name": "joint", "battery.capacity_ah": 2.0}
    inputs, taken, outcome, steps = recorded(plan_inputs(tmp_path, STAIRS, **keys))
    assert outcome.completed
    state = FlightState(inputs.mission)
    altitude_at = {round(step.time_s, 2): step.altitude_m for step in steps}
    errors = []
    for each in taken:
        if isinstance(each, Observation):
            state.observe(each)
            known = state.known(each.time_s, each.position_m)
            errors.append(known.climb.altitude_m - altitude_at.get(round(each.time_s, 2), known.climb.altitude_m))
        else:
            state.ingest(each)
    assert len(errors) > 5
    assert np.abs(errors).max() < 4.0
    known = known_at_end(state, taken)
    assert known.climb.altitude_m == pytest.approx(150, abs=1)
    assert known.motion.level_w == pytest.approx(inputs.mission.vehicle.cruise_power_w, rel=0.03)
    assert known_at_end(state_of(inputs, taken, every=1), taken) == known
