"""A flight over MAVLink: through a real socket, from a telemetry log, and with what goes wrong on a link."""

import contextlib
import itertools
import json
import random
import re
import select
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("pymavlink")

from common.answers import refused
from mavlink_vehicle import Autopilot, frames, is_near, recorded, tlog

from eadp.api.inputs import load_flight
from eadp.errors import InputError
from eadp.exchange.autopilot import AT_MOST, AutopilotParameter
from eadp.live import mavlink
from eadp.live.autopilot import INTERVALS
from eadp.live.link import LinkFlight, LinkOptions
from eadp.live.mavlink import MAX_SENDERS, READING_SHARE, Codec, Link, Message
from eadp.live.messages import STALE_S, WANTED, LineMaker, ParameterCheck, values_of
from eadp.live.telemetry import TelemetryReader

SCENARIO = "scenarios/survey.yaml"


@pytest.fixture(scope="module")
def lines():
    return recorded()[:60]


class Flown:
    """A flight over a link without a socket: its decisions, warnings, and what it sends."""

    def __init__(self, inputs, **options):
        self.decisions, self.faults, self.sent = [], [], []
        told = self.decisions.append, self.faults.append, lambda *m: self.sent.append(m)
        self.flight = LinkFlight(inputs, "link", LinkOptions(**options), None, *told)

    def take(self, data: bytes, now_s: float = 0.0) -> None:
        for message in Codec(WANTED).decoded(data):
            self.flight.take(message, now_s)

    def beat(self, autopilot, seconds) -> None:
        """Heartbeats of both, armed, for some seconds."""
        for second in seconds:
            self.take(autopilot.heartbeat(armed=True, active=True), float(second))
            self.flight.tick(float(second))

    def fly(self, steps) -> "Flown":
        for _, parts in steps:
            for frame in parts:
                self.take(frame)
        return self

    @property
    def warnings(self):
        return [fault.message for fault in self.faults if fault.severity == "warning"]


@pytest.fixture(scope="module")
def flown(inputs, lines):
    return Flown(inputs).fly(frames(lines, Autopilot()))


# --- messages to lines


def lines_of(maker, values):
    """What a log keeps of the readings that are made."""
    return [reading.line for reading in maker.update(values)]


NOT_MEASURED = {"current_battery": -100, "current_consumed": 0, "battery_remaining": 80}


def test_a_line_has_what_the_messages_say(inputs, lines):
    maker = LineMaker(TelemetryReader("link", inputs.mission), inputs.mission, None, lambda _: None)
    made = []
    for _, parts in frames(lines, Autopilot(), ground_s=0):
        for frame in parts:
            for message in Codec(WANTED).decoded(frame):
                made += lines_of(maker, values_of(message.kind, message.fields))
    assert len(made) == len(lines)
    for one, line in zip(made, lines, strict=True):
        assert is_near(one["time_s"], 100 + line["time_s"], 1e-3)
        assert is_near(one["power_w"], line["power_w"], 0.08)  # a step of 0.01 A
        assert is_near(one["soc"], line["soc"], 0.005)
        assert all(is_near(a, b, 0.005) for a, b in zip(one["velocity_mps"], line["velocity_mps"], strict=True))
    assert maker.landed


@pytest.mark.parametrize(
    ("kind", "fields", "expected"),
    [
        ("GLOBAL_POSITION_INT", {"time_boot_ms": 5, "lat": 0, "lon": 0, "vx": 1, "hdg": 65535}, {"time_s": 0.005}),
        ("WIND", {"direction": 270.0, "speed": 5.0}, {"wind_mps": [5.0, 0.0]}),
        ("WIND", {"direction": 0.0, "speed": 0.0}, {}),
        ("WIND_COV", {"wind_x": 1.0, "wind_y": 2.0}, {"wind_mps": [2.0, 1.0]}),
        ("WIND_COV", {"wind_x": float("nan"), "wind_y": 2.0}, {"wind_mps": None}),
        ("VFR_HUD", {"airspeed": float("inf")}, {"airspeed_mps": None}),
        (
            "SYS_STATUS",
            {"voltage_battery": 65535, "current_battery": -1, "battery_remaining": -1},
            {"status_voltage_v": None, "status_current_a": None, "status_remaining": None},
        ),
        ("BATTERY_STATUS", {"id": 1}, {}),
        (  # twelve cells; nothing measures the current, and none is drawn, it says
            "BATTERY_STATUS",
            {"id": 0, "voltages": [4000] * 10, "voltages_ext": [4000, 4000, 0, 0]} | NOT_MEASURED,
            {"voltage_v": 48.0, "current_a": None, "consumed_ah": None, "remaining": 0.8},
        ),
    ],
)
def test_what_is_unknown_is_none(kind, fields, expected):
    found = values_of(kind, fields)
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        assert found[key] == pytest.approx(value, abs=1e-9) if value is not None else found[key] is None


def heartbeat(autopilot, mode=0, kind=1):
    fields = {"base_mode": 128 + 8, "custom_mode": mode, "system_status": 4, "type": kind, "autopilot": autopilot}
    return values_of("HEARTBEAT", fields)


@pytest.mark.parametrize(
    ("autopilot", "kind", "mission", "other"),
    [(3, 1, 10, 5), (3, 2, 3, 5), (3, 19, 10, 3), (12, 1, 4 << 24 | 4 << 16, 3 << 16), (0, 1, None, 10)],
)
def test_whether_a_mission_is_flown_is_told_by_the_mode(autopilot, kind, mission, other):
    """GUIDED_ENABLED does not tell it: PX4 sets it in position mode, ArduCopter in loiter."""
    assert mission is None or heartbeat(autopilot, mission, kind)["automatic"]
    assert not heartbeat(autopilot, other, kind)["automatic"]


def test_the_charge_drawn_counts_before_the_share_that_remains(inputs):
    maker = LineMaker(TelemetryReader("link", inputs.mission), inputs.mission, None, lambda _: None)
    maker.update({"armed": True, "active": True})
    maker.update({"consumed_ah": 0.012, "remaining": 0.9})
    (line,) = lines_of(maker, {"time_s": 1.0, "lat_deg": 55.0, "lon_deg": 10.0})
    assert line["current_consumed_ah"] == 0.012
    assert "soc" not in line
    (later,) = lines_of(maker, {"time_s": 2.0 + STALE_S, "lat_deg": 55.0, "lon_deg": 10.0})
    assert later["current_consumed_ah"] is None  # old, and the coarser share does not take its place


# --- decisions


def test_decisions_are_sent_as_the_parameters_that_people_read(inputs, flown):
    first = flown.decisions[-1]
    sent = {fields["name"].decode(): fields["value"] for _, kind, fields in flown.sent if kind == "NAMED_VALUE_FLOAT"}
    path, computing = inputs.mission.plan.parameters
    assert sent[path.label] == pytest.approx(path.shown(first["parameters"]["c1"]))
    assert sent[computing.label] == first["parameters"]["c2"]
    assert sent["soc_end"] == first["soc_end_forecast"]
    texts = [fields["text"] for _, kind, fields in flown.sent if kind == "STATUSTEXT"]
    assert texts
    assert all(len(text) <= 50 and text.isascii() for text in texts)


def texts_of(sent):
    """The texts that a ground station puts together of its pieces."""
    found = {}
    for fields in (fields for _, kind, fields in sent if kind == "STATUSTEXT"):
        key = fields.get("id", 0) or object()
        assert found.get(key, "").count("|") == fields.get("chunk_seq", 0)
        found[key] = found.get(key, "") + fields["text"].decode() + "|"
    assert all(len(text.split("|")[-2]) < 50 or text.count("|") == 1 for text in found.values())
    return [text.replace("|", "") for text in found.values()]


@pytest.mark.parametrize("length", [20, 44, 45, 94, 95, 150])
def test_a_long_text_comes_in_pieces(inputs, flown, length):
    other = Flown(inputs)
    other.flight._decided({**flown.decisions[-1], "reason": "spacing " + "x" * (length - 8)})
    assert texts_of(other.sent) == ["eadp: spacing " + "x" * (length - 8)]


def test_another_path_is_always_told_and_first(inputs, flown):
    """The reason why a path is coarser says what is short; the mission that is flown changes all the same."""
    other, last = Flown(inputs), flown.decisions[-1]
    for k, c1 in enumerate((-300.0, -300.0, -600.0)):
        other.flight._decided({**last, "parameters": {"c1": c1, "c2": 10.0}, "reason": f"battery short: by 0.{k}"})
    other.flight._decided({**last, "parameters": {"c1": -700.0, "c2": 10.0}, "reason": "kept"})
    told = texts_of(other.sent)
    assert len(told) == 3
    assert told[0].startswith("eadp: spacing now ")
    assert told[0].endswith(" m: battery short: by 0.0")
    assert told[2].endswith(" m: kept")


def test_it_commands_nothing_but_rates_of_messages(flown):
    commands = {fields["command"] for _, kind, fields in flown.sent if kind == "COMMAND_LONG"}
    assert commands == {511}
    assert {kind for _, kind, _ in flown.sent} <= {"COMMAND_LONG", "NAMED_VALUE_FLOAT", "STATUSTEXT", "HEARTBEAT"}


def test_messages_that_do_not_come_are_asked_for_again(inputs, lines):
    """A request may be lost; a message that the autopilot does not have is asked for ten times."""
    other, autopilot = Flown(inputs), Autopilot()
    other.take(autopilot.heartbeat(armed=False, active=False))
    asked = []
    for second in range(20):
        asked.append({fields["param1"] for _, kind, fields in other.sent if kind == "COMMAND_LONG"})
        other.sent.clear()
        if second >= 3:
            other.take(autopilot.battery(14.8, 1.0, None, 0.9))
        if second >= 5:
            other.take(autopilot.position(float(second), 0.0, 0.0, [0.0, 0.0], 0.0))
        other.flight.tick(float(second))
    # WIND_COV (231) is unknown to ArduPilot, which shows an error for each request
    assert asked[0] == {number for number, _ in INTERVALS.values()} - {231}
    assert [147 in numbers for numbers in asked].index(False) == 4
    assert [33 in numbers for numbers in asked].index(False) == 6
    assert [168 in numbers for numbers in asked].index(False) == 10
    assert not any(asked[10:])
    other.take(autopilot.heartbeat(armed=True, active=True))
    assert {147, 33, 168} <= {fields["param1"] for _, kind, fields in other.sent if kind == "COMMAND_LONG"}


def test_an_autopilot_that_starts_again_is_asked_again(inputs):
    """By its time alone: its heartbeats are back before they are lost, and it is still armed."""
    other, autopilot = Flown(inputs), Autopilot()
    other.beat(autopilot, [0])
    for name in INTERVALS:
        other.flight._autopilot.missing.discard(name)
    other.take(autopilot.position(500.0, -100.0, 220.0, [0.0, 10.0], 0.0))
    other.sent.clear()
    other.take(autopilot.position(1.0, -100.0, 220.0, [0.0, 10.0], 0.0))
    assert sum(kind == "COMMAND_LONG" for _, kind, _ in other.sent) == len(INTERVALS) - 1


def test_an_autopilot_of_another_number_is_said(inputs):
    other = Flown(inputs, system=5)
    other.beat(Autopilot(), range(3))
    assert other.warnings == ["messages of system 1 are ignored"]


def test_an_antenna_tracker_is_no_aircraft(inputs):
    other, tracker = Flown(inputs), Autopilot(system=2)
    other.take(tracker.frame("heartbeat", 5, 3, 0, 0, 4, 3))
    other.beat(Autopilot(), [0])
    assert [fault.message for fault in other.faults] == ["autopilot of system 1, component 1"]


# --- the way home


def decision_home(flown, **more):
    return {**flown.decisions[-1], "returns_home": True, **more}


def commands(other):
    return [fields["command"] for _, kind, fields in other.sent if kind == "COMMAND_LONG" and fields["command"] != 511]


@pytest.mark.parametrize("may", [False, True])
def test_a_return_is_told_and_commanded_only_where_that_is_allowed(inputs, flown, may):
    other = Flown(inputs, return_home=may)
    other.take(Autopilot().heartbeat(armed=True, active=True))
    other.flight._decided(decision_home(flown))
    other.flight._decided(decision_home(flown))
    texts = [fields for _, kind, fields in other.sent if kind == "STATUSTEXT" and fields["severity"] == 2]
    assert len(texts) == 1
    assert b"home" in texts[0]["text"]
    other.beat(Autopilot(), range(20))
    assert commands(other) == [20] * (10 if may else 0)


def test_a_return_that_is_accepted_is_not_repeated(inputs, flown):
    other, autopilot = Flown(inputs, return_home=True), Autopilot()
    other.take(autopilot.heartbeat(armed=True, active=True))
    other.take(autopilot.frame("command_ack", 20, 0))  # the answer to another's command
    other.flight._decided(decision_home(flown))
    other.flight.tick(0.0)
    other.take(autopilot.frame("command_ack", 20, 4))
    other.flight.tick(1.0)
    other.take(autopilot.frame("command_ack", 20, 0))
    for second in range(2, 10):
        other.flight.tick(float(second))
    assert commands(other) == [20, 20]


def test_a_return_waits_for_a_link_that_is_lost(inputs, flown):
    other, autopilot = Flown(inputs, return_home=True), Autopilot()
    other.beat(autopilot, [0])
    other.flight._decided(decision_home(flown))
    for second in range(1, 100):
        other.flight.tick(float(second))
    before = len(commands(other))
    assert before < 10, "until the loss is noticed"
    other.beat(autopilot, range(100, 120))
    assert len(commands(other)) == before + 10
    assert "eadp: return not accepted by the autopilot, commanded 10 times" in texts_of(other.sent)  # the pilot knows


def test_a_pilot_who_flies_is_not_overruled(inputs, flown):
    other, autopilot = Flown(inputs, return_home=True), Autopilot()
    autopilot.mode = "pilot"
    other.take(autopilot.heartbeat(armed=True, active=True))
    other.flight._decided(decision_home(flown))
    other.beat(autopilot, range(20))
    assert commands(other) == []
    autopilot.mode = "mission"
    other.beat(autopilot, [20])
    assert commands(other) == [20]


# --- what goes wrong


def test_a_hostile_sender_and_messages_twice_and_late_change_nothing(inputs, lines, flown):
    rng, other, before = random.Random(1), Flown(inputs), []
    stranger, ours = Autopilot(system=7), Autopilot()
    for k, (time_s, parts) in enumerate(frames(lines, ours)):
        for frame in (*parts, parts[-1], *before):
            other.take(frame)
        before = parts[-1:]
        noise = bytes(rng.randrange(256) for _ in range(200))
        other.take(noise)
        other.take(b"\xfd\xff" + noise[:20])
        other.take(stranger.position(time_s, 0.0, 0.0, [0.0, 0.0], 0.0) if k else b"")
        other.take(parts[-1][:-3])
        broken = bytearray(parts[-1])
        broken[12] ^= 0xFF
        other.take(bytes(broken))
    assert other.decisions == flown.decisions
    assert sum("system 7" in text for text in other.warnings) == 1


@pytest.mark.slow
def test_an_autopilot_that_starts_again_in_the_air_does_not_end_the_flight(inputs, lines):
    other, autopilot = Flown(inputs), Autopilot()
    steps = list(frames(lines, autopilot))
    other.fly(steps[:30])
    other.take(autopilot.heartbeat(armed=False, active=False))
    assert not other.flight.over
    other.fly(steps[30:])
    assert other.flight.over


def test_a_flood_makes_no_more_lines(inputs):
    maker = LineMaker(TelemetryReader("link", inputs.mission), inputs.mission, None, lambda _: None)
    maker.update({"armed": True, "active": True})
    made = sum(len(maker.update({"time_s": k / 50, "lat_deg": 55.0, "lon_deg": 10.0})) for k in range(500))
    assert made == 50


def test_a_message_that_makes_no_sense_is_said_once(inputs):
    other = Flown(inputs)
    other.take(Autopilot().heartbeat(armed=True, active=True))
    for _ in range(3):
        other.flight.take(Message("BATTERY_STATUS", 1, 1, {"id": 0, "voltages": None}))
    assert other.warnings.count("BATTERY_STATUS that makes no sense; ignored") == 1


@pytest.mark.parametrize(
    "address",
    ["", "udpin:", "127.0.0.1:14550", "/etc/passwd", "udp:0.0.0.0:1", "csv:x", "run.elf", "tcp:a:b", "/dev/null,x"],
)
def test_an_address_is_refused_before_anything_is_opened(address):
    with pytest.raises(InputError, match="--mavlink"):
        Link(address, WANTED)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--mavlink", "udpin:127.0.0.1:14599"), "no place on the earth"),
        (("--mavlink", "udpin:127.0.0.1:14599", "--replay", "x"), "--replay:1:1: error: beside --mavlink"),
        (("--items", "x"), "--items:1:1: error: without a link"),
        (("--return-home", "--mavlink", "udpin:127.0.0.1:14599"), "home, which has no location"),
        (("--replay", "nosuch"), "nosuch:1:1: error: cannot be read"),
        (("--replay", "flight.tlog", "--upload"), "--upload:1:1: error: beside --replay"),
        (("--replay", "README.md"), "README.md:1:1: error: has no flight"),
        (("--publish", "a.json", "--log", "./a.json"), "--publish:1:1: error: is the file of --log"),
    ],
)
def test_options_that_do_not_go_together(eadp, plan, options, message):
    given = "plans/survey.plan" if "no place" in message else plan
    assert refused(eadp("replan", given, "--scenario", SCENARIO, *options), message)


def test_a_log_without_an_entry_is_not_left_behind(eadp, plan, tmp_path):
    arguments = "replan", plan, "--scenario", SCENARIO, "--log", tmp_path / "log.jsonl"
    assert refused(eadp(*arguments, "--replay", "README.md"), "has no flight")
    assert not (tmp_path / "log.jsonl").exists()


class Endless:
    """A port from which bytes never cease to come; each read takes 0.1 ms of the clock of `time`."""

    def __init__(self, monkeypatch):
        self.now_s = self.spent_s = 0.0
        clock = SimpleNamespace(monotonic=lambda: self.now_s, thread_time=lambda: self.spent_s, sleep=self.sleep)
        monkeypatch.setattr(mavlink, "time", SimpleNamespace(**vars(clock), time=time.time))
        self.frame = Autopilot(system=7).heartbeat(armed=True, active=True)

    def sleep(self, wait_s):
        self.now_s += wait_s

    def select(self, timeout_s):
        pass

    def recv(self, size):
        self.now_s, self.spent_s = self.now_s + 1e-4, self.spent_s + 1e-4
        return self.frame


def test_reading_takes_a_small_share_of_the_time_however_much_is_sent(monkeypatch):
    port = Endless(monkeypatch)
    link = Link.__new__(Link)
    link._port, link._codec, link._pause_to_s = port, Codec(WANTED), 0.0
    count = sum(len(link.receive(0.2)) for _ in range(100))
    assert port.spent_s / port.now_s < 1.02 * READING_SHARE
    assert count > 500


@pytest.mark.parametrize("fault", [OSError(5, "Input/output error"), None], ids=["a device that is gone", "its end"])
def test_a_port_that_fails_at_once_is_tried_in_time(monkeypatch, fault):
    """A serial device that is pulled out, or a connection that the peer has closed: nothing waits for it."""

    class Dead(Endless):
        def recv(self, size):
            self.now_s, self.spent_s = self.now_s + 1e-4, self.spent_s + 1e-4
            if fault is not None:
                raise fault
            return b""

    port = Dead(monkeypatch)
    link = Link.__new__(Link)
    link._port, link._codec, link._pause_to_s = port, Codec(WANTED), 0.0
    assert [link.receive(0.2) for _ in range(100)] == [[]] * 100
    assert port.now_s == pytest.approx(99 * 0.2, abs=0.1)
    assert port.spent_s < 0.02 * port.now_s


def test_few_addresses_are_written_to():
    """Whoever sends to a port that listens is written to; the autopilot was there before a thousand others."""
    link = Link("udpin:127.0.0.1:0", WANTED)
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(40)]
        stack.callback(link.close)
        frame = Autopilot().heartbeat(armed=False, active=False)
        for each in sockets:
            each.sendto(frame, link._port.port.getsockname())
            link.receive(0.2)
        link.send(1, "HEARTBEAT", {"type": 18, "autopilot": 8, "base_mode": 0, "custom_mode": 0, "system_status": 4,
                                   "mavlink_version": 3})  # fmt: skip
        readable, _, _ = select.select(sockets, [], [], 1.0)
    assert readable == sockets[:MAX_SENDERS]


# --- files, and a socket


def test_a_flight_elsewhere_is_refused(eadp, plan, lines, tmp_path):
    log, far = tmp_path / "flight.tlog", tmp_path / "far.plan"
    log.write_bytes(tlog(frames(lines, Autopilot())))
    text = plan.read_text()
    origin = re.search(r"^%: origin .*$", text, re.MULTILINE)[0]
    far.write_text(text.replace(origin, "%: origin -35.36, 149.17"))
    answer = eadp("replan", far, "--scenario", SCENARIO, "--replay", log)
    assert refused(answer, "flight.tlog:1:1: error: is a flight elsewhere, as at")


@pytest.mark.slow
def test_a_telemetry_log_gives_the_same_decisions(eadp, plan, lines, flown, tmp_path):
    log = tmp_path / "flight.tlog"
    log.write_bytes(b"rubbish" + tlog(frames(lines, Autopilot())) + struct.pack(">Q", 1))
    answer = eadp("replan", plan, "--scenario", SCENARIO, "--replay", log)
    assert [json.loads(line) for line in answer.out.splitlines()] == flown.decisions
    assert len(flown.decisions) >= len(lines)
    assert flown.flight.over


@pytest.mark.slow
def test_over_a_socket_and_again_from_its_log(eadp, plan, lines, flown, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    log = tmp_path / "flight.jsonl"
    command = [sys.executable, "-m", "eadp", "replan", str(plan), "--scenario", SCENARIO, "--log", str(log)]
    with (
        subprocess.Popen(
            [*command, "--mavlink", f"udpin:127.0.0.1:{port}"], stdout=-1, stderr=-1, text=True
        ) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port_out,
    ):
        port_out.bind(("127.0.0.1", 0))
        heard, codec = set(), Codec(frozenset({"STATUSTEXT", "NAMED_VALUE_FLOAT", "HEARTBEAT"}))
        # until it listens, a datagram is refused or lost
        autopilot, deadline = Autopilot(), time.monotonic() + 60
        port_out.settimeout(0.2)
        while "HEARTBEAT" not in heard and time.monotonic() < deadline:
            port_out.sendto(autopilot.heartbeat(armed=False, active=False), ("127.0.0.1", port))
            try:
                heard |= {message.kind for message in codec.decoded(port_out.recv(2048))}
            except OSError:
                time.sleep(0.05)
        for _, parts in frames(lines, autopilot):
            for frame in parts:
                port_out.sendto(frame, ("127.0.0.1", port))
            time.sleep(0.02)
        out, err = process.communicate(timeout=60)
        while True:
            try:
                heard |= {message.kind for message in codec.decoded(port_out.recv(2048))}
            except OSError:
                break
    decisions = [json.loads(line) for line in out.splitlines()]
    assert decisions == flown.decisions, err
    assert heard == {"HEARTBEAT", "STATUSTEXT", "NAMED_VALUE_FLOAT"}
    again = eadp("replan", plan, "--scenario", SCENARIO, "--replay", log)
    assert [json.loads(line) for line in again.out.splitlines()] == decisions
    assert "is of another plan" not in again.err
    other = eadp("replan", plan, "--scenario", SCENARIO, "--replay", log, "--set", "reserve_soc=0.1")
    assert f"{log}:1:1: warning: is of another plan, scenario or settings: decisions may be others" in other.err


# --- the start, and the battery


@pytest.mark.parametrize("of_first_stage", [-400.0, 0.0])
def test_a_flight_starts_with_the_parameters_of_its_items(eadp, plan, tmp_path, of_first_stage):
    """They are those that are flown, whatever is best before take-off; and a take-off is no warning.

    The first stage may be flown with others: a parameter takes effect with the next one.
    """
    mission, log = tmp_path / "m.waypoints", tmp_path / "flight.tlog"
    out = ("--to", "ardupilot", "--altitude", "25", "--set", "c1=-400", "-o", mission)
    assert eadp("export", plan, *out).code == 0
    items = Path(f"{mission}.items.json")
    rows = json.loads(items.read_text())
    rows["items"] = [[*row[:5], of_first_stage if row[4] == 1 else row[5]] for row in rows["items"]]
    items.write_text(json.dumps(rows))
    log.write_bytes(tlog(frames(recorded()[:20], Autopilot())))
    answer = eadp("replan", plan, "--scenario", SCENARIO, "--replay", log, "--items", items)
    first = json.loads(answer.out.splitlines()[0])
    assert first["reason"] == "take-off"
    assert first["parameters"]["c1"] == -400


def test_a_take_off_is_told_without_a_warning(plan):
    hopeless = load_flight(str(plan), scenario=SCENARIO, overrides={"battery.capacity_ah": 0.2})
    told = Flown(hopeless).fly(frames(recorded()[:2], Autopilot()))
    severities = {fields["text"]: fields["severity"] for _, kind, fields in told.sent if kind == "STATUSTEXT"}
    assert severities[b"eadp: take-off"] == 5


@pytest.mark.slow
def test_the_pilot_is_told_of_a_cell_that_is_lost(plan):
    """Once, within 30 s; the charge drawn does not show it."""
    overrides = {"battery.cells": 4, "battery.capacity_ah": 1.0}
    flown, autopilot = Flown(load_flight(str(plan), scenario=SCENARIO, overrides=overrides)), Autopilot()
    soc, before_s = 1.0, 0.0
    for line in recorded():
        time_s, volts = line["time_s"], 14.0 + 2.8 * soc - 0.84 * (line["time_s"] >= 150)
        amps = line["power_w"] / volts
        soc, before_s = soc - amps * (time_s - before_s) / 3600, time_s
        flown.take(autopilot.heartbeat(armed=True, active=True))
        flown.take(autopilot.battery(volts, amps, 1 - soc, None))
        state = line["x_m"], line["y_m"], line["velocity_mps"], line["heading_deg"]
        flown.take(autopilot.position(100 + time_s, *state))
    told = [fault.message for fault in flown.faults if "voltage fell" in fault.message]
    assert told == ["the voltage fell for good: a cell, or its charge, is lost"]
    first_s = next(line["time_s"] for line in flown.decisions if "cell-lost" in line["warnings"])
    assert 250 < first_s <= 280


@pytest.mark.parametrize(("as_bytes", "kind"), [(True, 6), (False, 6), (False, 9)])
def test_whole_parameters_come_as_bytes_from_px4(as_bytes, kind):
    """2 as a whole number of 32 bits is 2.8e-45 as one in single precision."""
    wanted = [AutopilotParameter("MIS_TKO_LAND_REQ", 0.0, AT_MOST)]
    for value, said in ((2, "MIS_TKO_LAND_REQ is 2, more than 0, so that the mission is not armed"), (0, "")):
        check = ParameterCheck(wanted, as_bytes=as_bytes)
        sent = struct.unpack("<f", struct.pack("<i", value))[0] if as_bytes else float(value)
        fields = {"param_id": b"MIS_TKO_LAND_REQ", "param_value": sent, "param_type": kind}
        check.take(*values_of("PARAM_VALUE", fields)["parameter"])
        assert check.result() == said


# --- the airspeed


def flown_slowly(inputs, lines, answer, airspeed_mps=lambda commanded: commanded, limits=None):
    """A flight of which the airspeed is decided; the autopilot answers each change with a result.

    Returns the flight, and the calibrated airspeeds that were commanded.
    """
    flown, autopilot, commanded = Flown(inputs, command_airspeed=True), Autopilot(), []
    for second, parts in frames(lines, autopilot):
        for frame in parts:
            flown.take(frame, second)
        held = commanded[-1] if commanded and answer == 0 else 15.0
        flown.take(autopilot.frame("vfr_hud", airspeed_mps(held), 0.0, 0, 50, 25.0, 0.0), second)
        for name, value in (limits or {}).items():
            flown.take(autopilot.frame("param_value", name.encode(), value, 9, 1, 0), second)
        flown.sent.clear()
        flown.flight.tick(second)
        for _, kind, fields in flown.sent:
            if kind == "COMMAND_LONG" and fields["command"] == 178:
                assert (fields["param1"], fields["param3"]) == (0.0, -1.0)
                commanded.append(fields["param2"])
                flown.take(autopilot.frame("command_ack", 178, answer), second)
    return flown, commanded


SHORT_S = 120
"""How much of the flight is flown until the airspeed is a lower one [s]."""


@pytest.fixture(scope="module")
def slow(plan):
    """A flight whose battery is short, of an aeroplane with a range of airspeeds."""
    wing = {"airspeed_range_mps": [10.5, 15.0], "cruise_altitude_m": 25.0}  # the altitude of the frames
    overrides = {"planner.joint.airspeed": "when-short", "battery.capacity_ah": 0.25}
    overrides |= {f"vehicle.airframe.{key}": value for key, value in wing.items()}
    return load_flight(str(plan), scenario=SCENARIO, overrides=overrides)


@pytest.fixture(scope="module")
def obeyed(slow):
    """The same, whose autopilot flies what is commanded."""
    return flown_slowly(slow, recorded()[:SHORT_S], 0)


def test_an_airspeed_is_commanded_once_it_is_decided(obeyed):
    flown, commanded = obeyed
    decided = [line["airspeed_mps"] for line in flown.decisions if line["airspeed_mps"]]
    assert min(commanded) < 14
    assert {*commanded} <= {*decided}
    assert all(a != b for a, b in itertools.pairwise(commanded))
    assert any(f"accepts an airspeed of {commanded[0]:g} m/s" in fault.message for fault in flown.faults)


@pytest.mark.slow
def test_another_airspeed_than_the_commanded_one_is_obeyed(slow):
    """A pilot's from the 40th second on, which the pitot tube shows for a minute: none is decided any more."""
    seconds = itertools.count()
    flown, commanded = flown_slowly(slow, recorded()[:200], 0, lambda held: held if next(seconds) < 40 else 17.0)
    at_s = {line["time_s"]: line["airspeed_mps"] for line in flown.decisions}
    assert commanded
    assert {airspeed for time_s, airspeed in at_s.items() if time_s < 140} > {14.0}
    assert {airspeed for time_s, airspeed in at_s.items() if time_s > 280} == {None}


def test_a_refused_airspeed_is_a_limit_and_is_told_once(slow):
    flown, commanded = flown_slowly(slow, recorded()[:120], 4, lambda _: 15.0)
    assert len([text for text in flown.warnings if "refuses an airspeed of 14 m/s: result 4" in text]) == 1
    assert commanded == [14.0, 15.0]  # the least that is left
    assert flown.decisions[-1]["airspeed_mps"] == 15.0


def test_the_autopilots_limits_narrow_the_range(slow, obeyed):
    """They are read on the ground, before any line is made."""
    _, free = obeyed
    _, limited = flown_slowly(slow, recorded()[:SHORT_S], 0, limits={"AIRSPEED_MIN": 13.0, "AIRSPEED_MAX": 22.0})
    assert min(free) < 13.0
    assert 13.0 <= min(limited) <= 14.0


def test_without_the_option_no_airspeed_is_commanded(slow):
    flown = Flown(slow).fly(frames(recorded()[:30], Autopilot()))
    assert {line["airspeed_mps"] for line in flown.decisions} == {None}


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ({"vehicle.airframe.airspeed_range_mps": [10.5, 15.0]}, "the planner decides no airspeed"),
        ({}, "the aircraft states no airspeeds"),
    ],
)
def test_an_airspeed_that_is_not_decided_is_refused(plan, keys, fault):
    flight = load_flight(str(plan), scenario=SCENARIO, overrides={**keys, "planner.joint.airspeed": "fixed"})
    with pytest.raises(InputError, match=f"--command-airspeed:1:1: error: {fault}"):
        Flown(flight, command_airspeed=True)
