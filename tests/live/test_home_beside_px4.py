"""When to turn home, and the autopilot's own return: flights of PX4, replayed."""

import json
import re

import pytest
from common import ROOT

from eadp.api.inputs import load_flight
from eadp.live.autopilot import NOTICE, WARNING, Pilot
from eadp.live.replanner import Replanner
from eadp.models.autopilot import Autopilot

PX4 = ROOT.parent / "shared/reference/autopilot/px4"
recordings = pytest.mark.skipif(not PX4.exists(), reason="no recordings of PX4")


def replayed(folder, plan="field.plan", until_s=300.0, change=lambda line: None, **keys):
    """Decisions of the planner beside a recorded flight, and its flight."""
    inputs = load_flight(str(PX4 / "plan" / plan), scenario=str(PX4 / "plan/scenario.yaml"), overrides=keys)
    decisions = []
    flight = Replanner(inputs, folder, None, decisions.append, lambda fault: None)
    with open(PX4 / folder / "log.jsonl") as lines:
        for number, raw in enumerate(lines, 1):
            line = json.loads(raw)
            if line.pop("kind") == "telemetry" and line["time_s"] <= until_s:
                change(line)
                flight.take(flight.reader.reading(number, line))
    return decisions, flight


@pytest.mark.slow
@recordings
def test_a_loss_is_no_rate():
    """A quarter of the charge at 173 s, 150 m from home: home can wait, and the pilot reads for how long."""
    decisions, _ = replayed("loss-home-at-once-and-echo", until_s=182.0, on_infeasible="home")
    short = [line for line in decisions if "battery short" in line["reason"]]
    assert short[0]["time_s"] == pytest.approx(175, abs=2)
    assert not any(line["returns_home"] for line in decisions)
    for line in short:
        waits_s = line["point_of_no_return_s"] - line["time_s"]
        assert f"; home can wait {waits_s:.0f} s" in line["reason"]
        assert waits_s > 60
        assert line["point_of_no_return_s"] < line["home_by_s"]
        assert line["home_reachable"]


@pytest.mark.slow
@recordings
def test_the_time_left_at_which_px4_turns_back_is_known():
    """It did with 594 mAh used of 1200, by a mean of 10.2 A, at 270 s: 1.1 times the way and 100 s."""
    _, flight = replayed("px4-returns-at-50-percent", "land.plan", until_s=270.0)
    state = flight._flight._flight.state
    known = state.known(state.now.time_s, state.now.position_m)
    way_home = flight._mission.way_home.flown_by(Autopilot("px4"))
    from eadp.planning.forecast.clearance import homeward

    way, rule = homeward(known, way_home, 60.0, 0.0), Autopilot("px4").time_rule
    needed_s = rule.factor * (way.seconds + way.climb_m / rule.climb_mps) + rule.margin_s
    assert needed_s == pytest.approx((1.2 - 0.594) * 3600 / 10.2, rel=0.03)


@pytest.mark.slow
@recordings
def test_before_it_turns_back_that_is_forecast_and_after_it_the_way_home():
    """Not to complete, minutes before; then, by the mode, what is left at home: 36.5 %, of which it glided some."""

    def as_sent(line):
        if line["time_s"] < 151:
            line["autopilot"] = {"kind": "px4"}
        if line["time_s"] > 276.5:  # the mode is RTL
            line |= {"flies_mission": False, "returns_home": True}

    decisions, _ = replayed("px4-returns-at-50-percent", "land.plan", until_s=292.0, change=as_sent)
    before = [line for line in decisions if 205 < line["time_s"] < 270]
    assert all(line["completes_probability"] < 0.01 for line in before)
    said = [re.search(r"the autopilot turns back below (\S+) %;", line["reason"]) for line in before]
    assert all(30 < float(found[1]) < 45 for found in said)
    after = [line for line in decisions if line["time_s"] > 278]
    assert {line["reason"] for line in after} == {"the autopilot returns: parameters stay"}
    assert all(0 < 0.365 - line["soc_end_forecast"] < 0.08 for line in after)
    assert all(line["point_of_no_return_s"] is None for line in after)


class Read:
    """What a pilot reads of decisions that leave some minutes."""

    def __init__(self):
        plan = type("Plan", (), {"path_count": 0, "parameters": ()})()
        self.sent = []
        self.pilot = Pilot("link", plan, (), lambda fault: None, self._give, lambda: 1, lambda: 0.0)

    def _give(self, kind, fields):
        self.sent.append((kind, fields))

    def at(self, time_s, until_s, by_s=None):
        line = {"time_s": time_s, "parameters": {}, "reason": "kept", "warnings": [], "airspeed_mps": None}
        line |= {"soc_end_forecast": None, "completes_probability": None}
        line |= {"point_of_no_return_s": until_s, "home_by_s": by_s}
        self.pilot.decision(line, completes=True)

    @property
    def texts(self):
        return [(f["text"].decode().replace("eadp: ", ""), f["severity"]) for k, f in self.sent if k == "STATUSTEXT"]

    @property
    def values(self):
        return [f["value"] for k, f in self.sent if k == "NAMED_VALUE_FLOAT" and f["name"] == b"min_left"]


def test_the_pilot_reads_the_minutes_left_and_when_home_is_reached(monkeypatch):
    monkeypatch.setenv("TZ", "UTC")
    read = Read()
    read.at(0.0, 18.5 * 60, 20 * 60)
    assert read.texts == [("18 min left, home by 00:20", NOTICE)]
    assert read.values == [18.5]
    # once at each mark, though minutes waver about it
    for k, left_s in enumerate((904, 899, 902, 898, 290, 100)):
        read.at(10.0 * k, 10.0 * k + left_s, 10.0 * k + left_s + 60)
    assert [text.partition(" min")[0] for text, _ in read.texts] == ["18", "14", "4", "1"]
    assert [severity for _, severity in read.texts] == [NOTICE, NOTICE, WARNING, WARNING]
    read.at(500.0, 490.0)
    assert read.texts[-1][0] == "home is out of reach with the reserve"
    assert read.values[-1] == 0
    # a flight without a home has none
    other = Read()
    other.at(0.0, None)
    assert not other.texts
    assert not other.values
