"""The rest of a mission, replaced in flight: by the protocol, beside the route that is left, and where it fails."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

pytest.importorskip("pymavlink")

from mavlink_vehicle import ORIGIN, Autopilot, MissionHolder, frames, recorded

from eadp.core.geometry.geodesy import to_local_m
from eadp.errors import InputError
from eadp.io.flight.inputs import load_flight
from eadp.io.link.flight import LinkFlight
from eadp.io.link.mavlink import Codec
from eadp.io.link.messages import WANTED
from eadp.io.mission.items import read_items
from eadp.io.mission.reader import PlanReader
from eadp.io.telemetry.log import ReplanLog, hash_of
from eadp.io.text.streams import Text
from eadp.models.plan.trace import nominal_legs

SCENARIO = "scenarios/survey.yaml"


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "survey.plan"
    head, _, rest = Path("plans/survey.plan").read_text().partition("%:")
    path.write_text(f"{head}%: origin {ORIGIN[0]} {ORIGIN[1]}\n%:{rest}")
    return path


@pytest.fixture(scope="module")
def inputs(plan):
    return load_flight(str(plan), scenario_path=SCENARIO)


@pytest.fixture(scope="module")
def mission(eadp_of_module, plan, tmp_path_factory):
    """The mission of c1 = 0, and its items as an autopilot holds them."""
    path = tmp_path_factory.mktemp("mission") / "survey.waypoints"
    eadp_of_module("export", plan, "--to", "ardupilot", "--altitude", "60", "-o", path)
    rows = [line.split("\t") for line in path.read_text().splitlines()[2:]]
    return path, [(int(row[3]), int(row[2]), tuple(map(float, row[4:11]))) for row in rows]


@pytest.fixture(scope="module")
def eadp_of_module():
    from eadp.__main__ import run

    def call(*arguments):
        import sys
        from unittest import mock

        with mock.patch.object(sys, "argv", ["eadp", *map(str, arguments)]), pytest.raises(SystemExit) as ended:
            run()
        assert not ended.value.code

    return call


class Flying:
    """A recorded flight with an autopilot that holds a mission; time goes on by the messages."""

    def __init__(self, inputs, mission, log=None, **given):
        self.path, items = mission
        self.holder, self.decisions, self.faults, self.now_s = MissionHolder(list(items), **given), [], [], 0.0
        self._codec, self._queue, self.sent = Codec(frozenset()), [], []
        self.autopilot = Autopilot()
        name = f"{self.path}.items.json"
        self.flight = LinkFlight(
            inputs, "link", name, None, log, self.decisions.append, self.faults.append, self._send, upload=True
        )

    def _send(self, *message):
        self._queue.append(self._codec.encoded(*message))
        self.sent += Codec(frozenset({"STATUSTEXT"})).decoded(self._queue[-1])

    def _give(self, frame):
        for message in Codec(WANTED).decoded(frame):
            self.flight.take(message, self.now_s)
        while self._queue:
            for answer in self.holder.answer(self._queue.pop(0)):
                for message in Codec(WANTED).decoded(answer):
                    self.flight.take(message, self.now_s)

    def fly(self, lines, current=False):
        for now_s, parts in frames(lines, self.autopilot):
            self.now_s = now_s
            for frame in parts[:-1]:
                self._give(frame)
            if current:
                self._give(self.holder.autopilot.frame("mission_current", self.holder.current))
            self._give(parts[-1])
            self.flight.tick(self.now_s)
            self._give(b"")
        return self

    @property
    def said(self):
        return [fault.message for fault in self.faults]


@pytest.fixture(scope="module")
def lines():
    return recorded()[:40]


def test_the_rest_is_replaced_and_verified(inputs, mission, lines):
    flown = Flying(inputs, mission).fly(lines)
    assert any("holds the mission of --items" in text for text in flown.said)
    assert any("uploaded and verified" in text for text in flown.said)
    decided = flown.decisions[-1]["parameters"]["c1"]
    assert decided < 0
    before = read_items(f"{mission[0]}.items.json", ("c1",))
    kept = sum(each.first <= 1 for each in before)
    after = flown.holder.items[1:]
    for (command, _, now), (was_command, _, was) in zip(after[:kept], mission[1][:kept], strict=True):
        assert command == was_command
        assert now == pytest.approx(was, abs=1.1e-7)  # a step of a position that is sent
    assert after[kept:] != mission[1][kept:]
    # what the autopilot holds, flown, is the route that is left
    head = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t" + f"{ORIGIN[0]}\t{ORIGIN[1]}\t0\t1\n"
    rows = [f"{k}\t0\t{f}\t{c}\t" + "\t".join(map(repr, p)) + "\t1" for k, (c, f, p) in enumerate(after, 1)]
    held, _ = PlanReader(turn_radius_m=20.0)(Text("held", head + "\n".join(rows) + "\n"))
    flown_m = sum(leg.distance_m for leg in nominal_legs(held, ()))
    plan = inputs.mission.plan
    left_m = sum(leg.distance_m for leg in nominal_legs(plan, (decided, 2.0)))
    assert flown_m == pytest.approx(left_m, rel=0.08)  # the first stages are of c1 = 0
    assert all(item[2][6] == 60 for item in after if item[0] == 16)


def test_nothing_is_uploaded_before_the_first_plan(eadp, inputs, plan, lines, tmp_path):
    """The mission is that of the forecast, and the parameters of take-off are others."""
    path = tmp_path / "survey.waypoints"
    eadp("export", plan, "--to", "ardupilot", "--altitude", "60", "--set", "spacing=20", "-o", path)
    rows = [line.split("\t") for line in path.read_text().splitlines()[2:]]
    items = [(int(row[3]), int(row[2]), tuple(map(float, row[4:11]))) for row in rows]
    flown = Flying(inputs, (path, items)).fly(lines[:3])
    assert flown.decisions[0]["parameters"]["c1"] == 0 == flown.decisions[-1]["parameters"]["c1"]
    assert not flown.decisions[-1]["reason"].startswith("spacing")
    assert flown.holder.writes == []
    assert any("holds the mission" in text for text in flown.said)


def test_another_mission_is_left_alone(inputs, mission, lines):
    path, items = mission
    moved = [(c, f, (*p[:4], p[4] + 0.001, *p[5:])) for c, f, p in items]
    flown = Flying(inputs, (path, moved)).fly(lines)
    assert any("another mission" in text for text in flown.said)
    assert flown.holder.items[1:] == moved
    assert flown.holder.writes == []


@pytest.mark.parametrize("lost", [1, 4])
def test_messages_that_are_lost_are_sent_again(inputs, mission, lines, lost):
    flown = Flying(inputs, mission, lost=lost).fly(lines)
    assert any("uploaded and verified" in text for text in flown.said)


def test_an_autopilot_that_does_not_answer_is_said(inputs, mission):
    flown = Flying(inputs, mission, lost=1000).fly(recorded()[:40])
    assert any("cannot be read" in text for text in flown.said)
    assert flown.holder.writes == []


def test_a_refused_mission_is_said_and_the_old_one_stays(inputs, mission, lines):
    flown = Flying(inputs, mission, refuses=("MISSION_COUNT", "MISSION_WRITE_PARTIAL_LIST")).fly(lines)
    assert any("the old one is kept" in text for text in flown.said)
    assert flown.holder.items[1:] == mission[1]
    assert not any("verified" in text for text in flown.said)


def test_a_mission_that_is_stored_wrong_does_not_count(inputs, mission, lines):
    flown = Flying(inputs, mission, spoils=20).fly(lines)
    assert not any("verified" in text for text in flown.said)
    assert any("mission unknown" in text for text in flown.said)
    shown = [message.fields["text"] for message in flown.sent if message.kind == "STATUSTEXT"]
    assert "eadp: mission unknown after an upload: see to it" in [text[:48] for text in shown]  # the pilot knows, too


def test_the_item_is_the_same_after_an_upload(inputs, mission, lines):
    flown = Flying(inputs, mission, resets=True)
    flown.holder.current = 3
    flown.fly(lines, current=True)
    assert any("uploaded and verified" in text for text in flown.said)
    assert flown.holder.current == 3


def test_a_mission_that_comes_later_is_read_at_arming(inputs, mission, lines):
    flown = Flying(inputs, mission)
    there, flown.holder.items = flown.holder.items, flown.holder.items[:3]
    flown._give(flown.autopilot.heartbeat(armed=False, active=False))
    assert any("another mission" in text for text in flown.said)
    flown.holder.items = there
    flown.fly(lines)
    assert any("holds the mission of --items" in text for text in flown.said)
    assert any("uploaded and verified" in text for text in flown.said)


def test_the_mission_is_read_again_when_the_autopilot_is_back(inputs, mission):
    flown = Flying(inputs, mission)
    for start_s in (0.0, 100.0):
        flown.now_s = start_s
        flown._give(flown.autopilot.heartbeat(armed=True, active=True))
        assert flown.holder.kinds.count("MISSION_REQUEST_LIST") == 1 + (start_s > 0)
        flown.flight.tick(start_s + 20.0)
    intervals = [message for message in flown.holder.kinds if message == "COMMAND_LONG"]
    assert len(intervals) == 16


def test_after_a_kill_the_mission_that_was_uploaded_is_still_known(eadp, inputs, mission, lines, tmp_path):
    path, kept = str(tmp_path / "flight.jsonl"), hash_of(inputs.texts, {})
    log = ReplanLog(path, kept)
    first = Flying(inputs, mission, log).fly(lines)
    log.close()
    assert any("uploaded and verified" in text for text in first.said)
    log = ReplanLog(path, kept)
    again = Flying(inputs, mission, log)
    again.holder = first.holder
    again._give(again.autopilot.heartbeat(armed=True, active=True))
    log.close()
    assert any("holds the mission of --items" in text for text in again.said)
    before, now = (
        [(each.item.command, each.item.parameters[4:6], *each[1:]) for each in flown.flight._lines.items]
        for flown in (first, again)
    )
    assert now == before
    assert eadp("report", path, "-o", tmp_path / "page.html").code == 0
    # without the log it is another mission
    forgets = Flying(inputs, mission)
    forgets.holder = first.holder
    forgets._give(forgets.autopilot.heartbeat(armed=True, active=True))
    assert any("another mission" in text for text in forgets.said)


def test_it_needs_the_map(inputs):
    with pytest.raises(InputError, match="--upload"):
        LinkFlight(inputs, "link", None, None, None, print, print, lambda *_: None, upload=True)


def test_waypoints_that_are_written_lie_on_the_new_lines(inputs, mission, lines):
    flown = Flying(inputs, mission).fly(lines)
    c1 = flown.decisions[-1]["parameters"]["c1"]
    points = [leg.end_m for leg in nominal_legs(inputs.mission.plan, (c1, 2.0)) if leg.stage.kind == "line"]
    written = [to_local_m(*p[4:6], ORIGIN) for c, _, p in flown.holder.items[1:] if c == 16]
    near = [min(math.dist(point, other) for other in written) for point in points[2:]]
    # between stages that are less than 5 m apart, the waypoint lies in the middle
    assert max(near) < 2.5
    assert min(near) < 0.02
