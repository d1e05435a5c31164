"""Flights by `eadp replan` in a closed loop: disturbed telemetry, and an autopilot that does not apply parameters."""

import json

import pytest
from common import ROOT, few
from common.link import DISTURBANCES, UNDISTURBED, Disturbance, flown, through

from eadp.api.inputs import Files, load_flight
from eadp.io.text.streams import Text
from eadp.live.flight import NOT_FLOWN, RETURNS
from eadp.live.replanner import Replanner

START_S = 60.0
MAX_WRONG_S, MAX_LOSS = 20.0, 0.03
CODES = {
    "gap 30 s": {"stage-unknown"},
    "gap 120 s": {"stage-unknown"},
    "frozen position 20 s": {"stale", "stage-unknown"},
    "null charge 60 s": {"stale"},
    "clock + 7,200 s": {"clock"},
    "clock back 50 s": {"clock", "stage-unknown"},
    "gauge stuck from the start on": {"gauge-stuck"},
}
"""Warnings of each disturbance."""


def short_survey(**overrides):
    """Some laps of the survey, with a battery that does not last at the highest parameters."""
    body = (ROOT / "plans/survey.plan").read_text(encoding="utf-8").replace("175, 161", "95, 152")
    name = str(ROOT / "plans/short.plan")
    keys = {"step_s": 0.05, "faults": [], "battery.capacity_ah": 0.26, **overrides}
    scenario = str(ROOT / "scenarios/survey.yaml")
    return load_flight(name, scenario=scenario, overrides=keys, files=Files({name: Text(name, body)}))


@pytest.fixture(scope="module")
def undisturbed():
    return flown(short_survey(), UNDISTURBED)


def test_the_undisturbed_flight_has_no_warnings(undisturbed):
    assert undisturbed.outcome.completed
    assert undisturbed.wrong_s == 0
    assert undisturbed.warnings == []
    assert all(answer["warnings"] == [] for answer in undisturbed.answers)


@pytest.mark.slow
@pytest.mark.parametrize("disturbance", few(DISTURBANCES, 1), ids=lambda disturbance: disturbance.name)
def test_a_disturbance_costs_little_and_the_stage_is_found_again(undisturbed, disturbance):
    disturbed = flown(short_survey(), disturbance, START_S)
    assert disturbed.outcome.completed
    assert disturbed.wrong_s <= MAX_WRONG_S
    assert disturbed.quality >= undisturbed.quality - MAX_LOSS
    assert {code for answer in disturbed.answers for code in answer["warnings"]} == CODES.get(disturbance.name, set())


@pytest.mark.slow
def test_a_gauge_that_rises_and_a_false_power_are_warned_of():
    def rising(line):
        return line | {"soc": 0.8 + line["time_s"] / 1e4, "power_w": 1e5 if line["time_s"] == 100 else line["power_w"]}

    flight = flown(short_survey(), Disturbance("rising", 0.0, through(rising)), START_S)
    codes = {answer["time_s"]: answer["warnings"] for answer in flight.answers}
    assert codes[100.0] == ["gauge-rises", "power-outlier"]
    assert codes[101.0] == ["gauge-rises"]
    assert codes[START_S] == []


HAND_S, FLOWN_BY_HAND_S, ITS_POWER_W = 72, 60, 150.0


@pytest.fixture(scope="module")
def lines():
    """The telemetry of an undisturbed flight whose battery suffices, with airspeeds."""
    seen = []
    keeping = through(lambda line: seen.append(line) or line)
    flown(short_survey(**{"battery.capacity_ah": 0.4}), Disturbance("seen", 0.0, keeping))
    return [{key: value for key, value in line.items() if key[0] != "_"} | {"airspeed_mps": 15.0} for line in seen]


def with_pilot(lines, *, modes):
    """The flight with a pilot for a minute, who flies away and back, faster, with three times the power."""
    before = [line for line in lines if line["time_s"] <= HAND_S]
    last, by_hand = before[-1], []
    for k in range(1, FLOWN_BY_HAND_S + 1):
        away_m = 20.0 * min(k, FLOWN_BY_HAND_S - k)
        changed = {"time_s": last["time_s"] + k, "x_m": last["x_m"] + away_m, "soc": last["soc"] - 2e-3 * k}
        changed |= {"power_w": ITS_POWER_W, "airspeed_mps": 20.0, "velocity_mps": None, "heading_deg": None}
        by_hand.append(last | changed)
    after = [
        line | {"time_s": line["time_s"] + FLOWN_BY_HAND_S, "soc": line["soc"] - 2e-3 * FLOWN_BY_HAND_S}
        for line in lines[len(before) :]
    ]
    if modes:
        before, after = ([line | {"flies_mission": True} for line in some] for some in (before, after))
        by_hand = [line | {"flies_mission": False} for line in by_hand]
    return [*before, *by_hand, *after]


def answered(lines, warnings=None):
    """What is decided on lines, by time."""
    answers = []
    inputs = short_survey(**{"battery.capacity_ah": 0.4})
    flight = Replanner(inputs, "telemetry", None, answers.append, [].append if warnings is None else warnings.append)
    for number, line in enumerate(lines, 1):
        flight.take(flight.reader.reading(number, line))
    return {answer["time_s"]: answer for answer in answers}


@pytest.mark.slow
@pytest.mark.parametrize("modes", [True, False])
def test_while_a_pilot_flies_nothing_is_learned_and_nothing_decided(lines, modes):
    alone = answered([line | {"flies_mission": True} if modes else line for line in lines])
    answers = answered(with_pilot(lines, modes=modes))
    found_s = 1 if modes else 6
    by_hand = [answers[float(HAND_S + k)] for k in range(found_s, FLOWN_BY_HAND_S - 3)]
    assert {each["reason"] for each in by_hand} == {NOT_FLOWN}
    assert len({tuple(each["parameters"].items()) for each in by_hand}) == 1
    # after it: the place in the plan, and the forecasts of time and power to the end, of the flight without him
    for time_s in (HAND_S + 30.0, HAND_S + 90.0):
        here, there = answers[time_s + FLOWN_BY_HAND_S], alone[time_s]
        assert (here["stage"], here["lap"]) == (there["stage"], there["lap"])
        powers_w = [each["energy_wh"] / each["remaining_s"] * 3600 for each in (here, there)]
        assert powers_w[0] == pytest.approx(powers_w[1], rel=0.03)


@pytest.mark.slow
def test_a_mission_that_is_taken_up_again_is_forecast_from_the_start_of_the_leg_that_was_left(lines):
    """PX4 flies to the item before, whose stage is behind; ArduPilot straight on to the end of the leg."""
    alone = answered([line | {"flies_mission": True} for line in lines])
    # stages started at each second, as an autopilot's items report them
    counts, places, last = {}, 0, None
    for time_s, answer in alone.items():
        places += (answer["stage"], answer["lap"]) != last
        last = answer["stage"], answer["lap"]
        counts[time_s] = places
    back_s = HAND_S + FLOWN_BY_HAND_S + 1.0
    left_s = {}
    for behind in (0, 1):
        warnings, flown_again = [], []
        for line in with_pilot(lines, modes=True):
            at_s = line["time_s"] - FLOWN_BY_HAND_S * (line["time_s"] > HAND_S + FLOWN_BY_HAND_S)
            count = counts.get(min(at_s, HAND_S) if not line["flies_mission"] else at_s, places)
            flown_again.append(line | {"stages_started": count - behind * (back_s <= line["time_s"] < back_s + 8)})
        left_s[behind] = answered(flown_again, warnings)[back_s]["remaining_s"]
        assert not any("ignored" in warning.message for warning in warnings)
    assert left_s[1] > left_s[0] + 5


@pytest.mark.slow
def test_of_an_autopilot_that_returns_no_parameters_are_decided():
    """Nor is the pilot asked to fly home, though the charge is gone."""
    example = (ROOT / "scenarios/example-telemetry.jsonl").read_text().splitlines()[:110]
    lines = [line | {"flies_mission": line["time_s"] <= 60} for line in map(json.loads, example)]
    lines[60:] = [line | {"returns_home": True, "soc": 0.06} for line in lines[60:]]
    answers = answered(lines)
    after = [answer for time_s, answer in answers.items() if time_s > 60]
    assert {each["reason"] for each in after} == {RETURNS}
    assert not any(each["returns_home"] for each in after)
