"""A planner on telemetry: its advice, also in a file, what is reported of stages, and fixes that make no sense."""

import itertools
import json
import math
import shutil

import pytest
from common import ROOT
from common.answers import refused
from common.recorder import Recorder, watched
from hypothesis import given
from hypothesis import strategies as st

from eadp.api.inputs import load_flight
from eadp.live.flight import EMPTY, LiveFlight, _GroundVelocity
from eadp.live.gate import APART_S, APPLY_S, AppliedParameters
from eadp.live.replanner import ValuesFile
from eadp.planning.base import Sample
from eadp.planning.forecast.held import HeldForecast
from eadp.planning.registry import make_flight
from eadp.simulation.loop import Outcome, fly

STEP_S = 0.05


def inputs_of(planner="joint", **overrides):
    keys = {"planner.name": planner, "step_s": STEP_S, "log_every_s": 1e9, **overrides}
    return load_flight(str(ROOT / "plans/survey.plan"), scenario=str(ROOT / "scenarios/survey.yaml"), overrides=keys)


@pytest.fixture(scope="module")
def recorded():
    """Four minutes of the survey with the joint planner: the inputs, and all that it saw."""
    inputs, short = inputs_of(), inputs_of(time_limit_s=255)
    watching = watched(short, every_step=True)
    for _ in fly(short.world, watching, Outcome()):
        pass
    return inputs, watching.planner


def live(inputs):
    scenario = inputs.scenario
    return LiveFlight(
        inputs.mission,
        lambda mission: (make_flight(scenario.planner, mission), HeldForecast(scenario.planner, mission)),
        scenario.planner.every_s,
    )


def samples(seen, every, keys=()):
    """Every so many observations and the last one, as telemetry with some of its optional keys."""
    for k, o in enumerate(seen, 1):
        if k % every == 0 or k == len(seen):
            sample = Sample(o.time_s, o.position_m, o.sample.power_w, o.soc)
            yield sample._replace(**{key: getattr(o.sample, key) for key in keys})


MEASURED = ("velocity_mps", "heading_rad")


def test_the_ground_velocity_is_estimated_from_positions():
    """On a circle of 60 m at 15 m/s: nothing from one position, the chord from two, the tangent from more."""
    ground, found = _GroundVelocity(15.0), []
    for k in range(6):
        angle = 15.0 * k / 60
        velocity = ground.update(Sample(float(k), (60 * math.cos(angle), 60 * math.sin(angle)), None, None))
        found.append(velocity and (math.hypot(*velocity), math.atan2(velocity[1], velocity[0]) - angle - math.pi / 2))
    assert found[0] is None
    assert found[1] == pytest.approx((15, -15 / 120), rel=0.01)
    for speed_mps, behind in found[2:]:
        assert speed_mps == pytest.approx(15, rel=0.1)
        assert abs(behind) < 0.06
    # long after the last position they begin anew
    assert ground.update(Sample(1000.0, (0.0, 0.0), None, None)) is None


def test_advice_comes_once_a_second_and_when_parameters_change(recorded):
    inputs, recorder = recorded
    flight = live(inputs)
    seen = samples(recorder.seen[:600], 4, MEASURED)
    times = [sample.time_s for sample in seen if flight.update(sample)[0] is not None]
    assert times[0] == 0.2
    gaps = [later - now for now, later in itertools.pairwise(times)]
    assert max(gaps) < 1.01
    assert len(times) < 35


@pytest.mark.slow
def test_a_planner_without_a_forecast_has_one_of_held_parameters():
    calm = {"wind.speed_mps": 0, "battery.capacity_ah": 0.7, "parameters.c1": -250.0}
    inputs = inputs_of("paper", **calm, faults=[])
    watching, outcome = watched(inputs, every_step=True), Outcome()
    for _ in fly(inputs.world, watching, outcome):
        pass
    recorder = watching.planner
    flight = live(inputs)
    advised = {}
    for sample in samples(recorder.seen, 20):
        advice, _ = flight.update(sample)
        if advice is not None:
            advised[round(sample.time_s)] = advice
    assert outcome.completed
    half = advised[round(outcome.duration_s / 2)]
    assert half.ending.completes_probability == pytest.approx(1.0, abs=0.01)
    assert half.ending.remaining_s == pytest.approx(outcome.duration_s / 2, rel=0.03)
    assert half.ending.soc_end == pytest.approx(outcome.soc_final, abs=0.02)
    assert flight._tracker.complete


def start(inputs, time_s=0.0, **changes):
    return Sample(time_s, inputs.mission.start_m, 36.0, 0.9)._replace(**changes)


def test_an_empty_battery_is_a_no_until_it_is_measured_not_to_be(recorded):
    flight = live(recorded[0])
    flight.update(start(recorded[0]))
    advice, _ = flight.update(start(recorded[0], 1.0, soc=0.0))
    assert (advice.reason, advice.ending.soc_end, advice.ending.completes_probability) == (EMPTY, 0.0, 0.0)
    assert not flight.forecast_completes
    assert flight.update(start(recorded[0], 2.0, soc=0.0)) == (None, ())
    advice, _ = flight.update(start(recorded[0], 3.0, soc=0.9))
    assert advice.reason != EMPTY


@pytest.mark.quick(2)
@pytest.mark.parametrize("place", [(0.0, 0.0), (5e3, -5e3), (-1e7, 1e7), (35.0, 146.0), (-40.0, 11.0)])
def test_the_first_fix_may_be_anywhere(recorded, place):
    inputs = recorded[0]
    flight = live(inputs)
    for k in range(30):
        sample = Sample(100.0 + k, (place[0] + 12.0 * k, place[1]), 36.0, 0.9 - 0.0002 * k)
        advice, notices = flight.update(sample)
        assert not any("failed" in notice.message for notice in notices)
        assert advice is not None
        assert 1 <= advice.stage <= 4


def reported_stages(flight, inputs, *stages):
    """The stages that are flown after each reported one, and the notices."""
    answers = []
    for k, stage in enumerate(stages):
        advice, notices = flight.update(start(inputs, float(k), stage=stage))
        answers.append((advice.stage, [notice.message for notice in notices]))
    return answers


def test_reported_stages_are_taken_and_a_jump_back_and_an_unknown_one_give_one_notice(recorded):
    inputs = recorded[0]
    back = "stage 2 is before stage 3, which is flown; ignored"
    none = "there is no stage 7; ignored"
    advised = reported_stages(live(inputs), inputs, 1, 1, 2, 4, 1, 3)
    assert advised == [(1, []), (1, []), (2, []), (4, []), (1, []), (3, [])]
    advised = reported_stages(live(inputs), inputs, 3, 2, 2, 7, 7, 3, 2)
    assert advised == [(3, []), (3, [back]), (3, []), (3, [none]), (3, []), (3, []), (3, [])]


def test_reported_parameters_are_in_force(recorded):
    inputs = recorded[0]
    flight = live(inputs)
    advice, notices = flight.update(start(inputs, parameters={"c1": -300.0, "c9": 1.0}))
    assert advice.in_force == {"c1": -300.0, "c2": 10.0}
    assert [notice.message for notice in notices] == ["the plan has no parameter c9; ignored"]
    advice, notices = flight.update(start(inputs, 1.0, parameters={"c2": 99.0, "c9": 1.0}))
    assert advice.in_force == {"c1": -300.0, "c2": 10.0}
    assert [notice.message for notice in notices] == ["c2 = 99 is outside its set; clipped"]


def test_a_parameter_is_held_until_another_value_is_reported(recorded):
    applied = AppliedParameters((0.0, 10.0), recorded[0].mission.plan)
    assert not applied.update(0.0, {0: 0.0, 1: 10.0}, (0.0, 10.0))
    applied.decide((-500.0, 10.0))
    # it waits for its stage
    assert not applied.update(50.0, {0: 0.0, 1: 10.0}, (0.0, 10.0))
    assert applied.held == {}
    # its stage starts at 51 s
    assert not applied.update(51.0, {0: 0.0, 1: 10.0}, (-500.0, 10.0))
    assert not applied.update(51.0 + APPLY_S - 1, {0: 0.0, 1: 10.0}, (0.0, 10.0))
    assert applied.update(51.0 + APPLY_S, {0: 0.0, 1: 10.0}, (0.0, 10.0))
    assert (applied.held, applied.effective, applied.asked) == ({0: 0.0}, (0.0, 10.0), (-500.0, 10.0))
    applied.decide((0.0, 2.0))
    assert (applied.effective, applied.asked) == ((0.0, 2.0), (-500.0, 2.0))
    assert applied.update(70.0, {0: -500.0, 1: 2.0}, (0.0, 2.0))
    assert (applied.held, applied.effective) == ({}, (-500.0, 2.0))


@pytest.mark.slow
def test_a_parameter_that_is_on_its_way_is_held_no_longer(recorded):
    """Until it is reported as it was for as long again: what was on its way has been refused."""
    flight, seen = live(recorded[0]), iter(recorded[1].seen[::20])

    def warnings_after(seconds, c1):
        for o in itertools.islice(seen, seconds):
            sample = Sample(o.time_s, o.position_m, o.sample.power_w, o.soc, parameters={"c1": c1})
            advice, _ = flight.update(sample)
        return advice.warnings

    assert "not-applied" in warnings_after(100, 0.0)
    assert "not-applied" not in warnings_after(1, math.nan)
    assert "not-applied" not in warnings_after(50, math.nan)
    assert "not-applied" in warnings_after(100, 0.0)


def test_parameters_of_a_stage_that_positions_do_not_show_yet_wait_for_it(recorded):
    applied = AppliedParameters((0.0, 10.0), recorded[0].mission.plan)
    applied.decide((-500.0, 10.0))
    assert applied.update_apart(50.0, {0: 0.0, 1: 10.0}, (0.0, 10.0)) == []
    # the aircraft has started the stage that takes c1
    assert applied.update_apart(60.0, {0: -500.0, 1: 10.0}, (0.0, 10.0)) == [0]
    assert applied.update_apart(61.0, {0: -500.0, 1: 10.0}, (-500.0, 10.0)) == []
    # the other way round: it has not started it yet
    applied.decide((0.0, 10.0))
    assert applied.update_apart(90.0, {0: -500.0, 1: 10.0}, (0.0, 10.0)) == [0]
    assert applied.update_apart(91.0, {0: 0.0, 1: 10.0}, (0.0, 10.0)) == []


def test_parameters_reported_for_longer_or_as_others_are_in_force(recorded):
    applied = AppliedParameters((0.0, 10.0), recorded[0].mission.plan)
    applied.decide((-500.0, 10.0))
    assert applied.update_apart(50.0, {0: -300.0}, (0.0, 10.0)) == []
    assert applied.update_apart(60.0, {0: -500.0}, (0.0, 10.0)) == [0]
    assert applied.update_apart(60.0 + APART_S, {0: -500.0}, (0.0, 10.0)) == []


@pytest.mark.slow
def test_an_aircraft_that_starts_a_stage_a_second_before_positions_show_it(recorded):
    """What it reports to be in force then takes effect with the stage, as the plan has it."""
    inputs = recorded[0]

    class Deciding(Recorder):
        """Decides once, in the first stage."""

        def update(self, state):
            decision = super().update(state)
            return decision._replace(parameters=(-500.0, 10.0)) if state.now.time_s > 5 else decision

        next_update_s = 0.0

    flown = inputs_of("static", step_s=0.01, time_limit_s=90.0)  # fine: samples lie beside the starts of stages
    watching = watched(flown, Deciding)
    for _ in fly(flown.world, watching, Outcome()):
        pass
    recorder = watching.planner
    held = HeldForecast(inputs.scenario.planner, inputs.mission)
    flight = LiveFlight(inputs.mission, lambda _: (watched(flown, Deciding), held), 1.0)
    ahead = 0
    for o, later in itertools.pairwise(recorder.seen[99::100]):
        reported = dict(zip(inputs.mission.plan.names, later.parameters, strict=True))
        advice, _ = flight.update(Sample(o.time_s, o.position_m, o.sample.power_w, o.soc, parameters=reported))
        ahead += o.parameters[0] != later.parameters[0]
        assert advice.stage == o.stage
        assert advice.in_force["c1"] == o.parameters[0]
    assert ahead > 0


def test_a_value_that_is_reported_all_the_time_is_not_one_that_is_not_applied(recorded):
    """A computation that runs at another rate than commanded follows its commands all the same."""
    applied = AppliedParameters((0.0, 10.0), recorded[0].mission.plan)
    for time_s in range(30):
        assert not applied.update(float(time_s), {1: 9.2}, (0.0, 10.0))
    applied.decide((0.0, 4.0))
    for time_s in range(30, 60):
        assert not applied.update(float(time_s), {1: 3.7}, (0.0, 4.0))


def test_a_planner_that_fails_gives_a_notice_and_does_not_end_it(recorded):
    inputs = recorded[0]

    class Failing(Recorder):
        def update(self, state):
            raise RuntimeError("out of order")

    held = HeldForecast(inputs.scenario.planner, inputs.mission)
    flight = LiveFlight(inputs.mission, lambda _: (watched(inputs, Failing), held), 1.0)
    advice, notices = flight.update(start(inputs))
    assert "the planner failed, and parameters stay: RuntimeError: out of order" in notices[0].message
    assert advice.parameters == {"c1": 0.0, "c2": 10.0}
    assert flight.update(start(inputs, 1.0))[1] == ()


FINITE = st.floats(-1e7, 1e7)
PAIR = st.none() | st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000))
ANY_FIX = st.builds(
    Sample,
    st.floats(-1e11, 1e11),
    st.tuples(FINITE, FINITE),
    st.none() | st.floats(-1e6, 1e6),
    st.floats(0, 1),
    st.none() | st.integers(1, 6),
    PAIR,
    PAIR,
    st.none() | st.floats(-7, 7),
    st.dictionaries(st.sampled_from(["c1", "c2", "c3"]), st.floats(allow_nan=False, allow_infinity=False)),
)
INPUTS = {planner: inputs_of(planner) for planner in ("static", "paper", "joint")}


@given(
    st.sampled_from(sorted(INPUTS)),
    st.lists(st.tuples(st.floats(1e-6, 50), st.floats(-30, 30), st.floats(-30, 30), ANY_FIX), max_size=25),
    st.booleans(),
)
def test_no_fixes_crash_it_and_advice_is_finite(planner, steps, near):
    flight = live(INPUTS[planner])
    x, y = INPUTS[planner].mission.start_m
    time_s = 0.0
    for step_s, dx, dy, sample in steps:
        time_s, x, y = time_s + step_s, x + dx, y + dy
        sample = sample._replace(time_s=time_s)
        advice, notices = flight.update(sample._replace(position_m=(x, y)) if near else sample)
        assert not any("failed" in notice.message for notice in notices), notices
        if advice is None:
            continue
        numbers = [*advice.parameters.values(), *advice.in_force.values(), *(advice.wind_mps or ())]
        numbers += advice.ending
        assert all(value is None or math.isfinite(value) for value in numbers)
        assert advice.reason


def test_a_mission_without_a_start_starts_at_the_first_sample(recorded):
    inputs = recorded[0]
    flight = live(inputs.with_mission(start_m=None))
    advice, notices = flight.update(Sample(3.0, (-100.0, 220.0), 36.0, 0.9))
    assert notices == ()
    assert advice.stage == 1


PLAN, SCENARIO, EXAMPLE = "plans/survey.plan", "scenarios/survey.yaml", "scenarios/example-telemetry.jsonl"
LINES = 60


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """The beginning of the example's telemetry: the rate of the computations is the same to its end."""
    path = tmp_path_factory.mktemp("begun") / "telemetry.jsonl"
    path.write_text("".join((ROOT / EXAMPLE).read_text().splitlines(keepends=True)[:LINES]))
    return path


def test_the_file_holds_the_values_last_decided(eadp, begun, tmp_path):
    file = tmp_path / "rates.json"
    answer = eadp("replan", PLAN, "--scenario", SCENARIO, "--telemetry", begun, "--publish", file)
    lines = [json.loads(line) for line in answer.out.splitlines()]
    fps = [line["parameters"]["c2"] for line in lines]
    last = max(k for k in range(len(lines)) if k == 0 or fps[k] != fps[k - 1])
    assert json.loads(file.read_text()) == {"time_s": lines[last]["time_s"], "parameters": {"fps": fps[-1]}}
    assert [each.name for each in tmp_path.iterdir()] == ["rates.json"]


def test_it_is_written_where_values_change_and_a_failure_is_said_once(tmp_path):
    plan = load_flight(PLAN, scenario=SCENARIO).mission.plan
    (tmp_path / "there").mkdir()
    said, file = [], tmp_path / "there" / "rates.json"
    door = ValuesFile(str(file), plan.parameters[plan.path_count :], said.append)
    decision = {"time_s": 1.0, "parameters": {"c1": 0.0, "c2": 7.0}}
    door.decided(decision)
    door.decided({**decision, "time_s": 2.0})
    assert json.loads(file.read_text()) == {"time_s": 1.0, "parameters": {"fps": 7.0}}
    shutil.rmtree(tmp_path / "there")
    for time_s in (3.0, 4.0):
        door.decided({"time_s": time_s, "parameters": {"c1": 0.0, "c2": 2.0}})
    assert len(said) == 1
    assert "cannot be written" in said[0].message
    (tmp_path / "there").mkdir()
    door.decided({"time_s": 5.0, "parameters": {"c1": 0.0, "c2": 2.0}})
    assert json.loads(file.read_text())["time_s"] == 5.0


@pytest.mark.parametrize("path", ["", "plans", "/dev/null"])
def test_a_path_that_is_no_file_is_refused(eadp, path):
    answer = eadp("replan", PLAN, "--scenario", SCENARIO, "--telemetry", EXAMPLE, "--publish", path)
    assert refused(answer, "cannot be written")
