"""What an autopilot holds, flies and says, as ArduPlane and PX4 do: maps in force, refusals, pilots, returns."""

import json

import pytest

pytest.importorskip("pymavlink")
pytest.importorskip("pyulog")

from linked_flight import Finely, Flying, qgc_items, wpl_items
from mavlink_vehicle import ARDUPILOT, PX4, Autopilot, MissionHolder, recorded

from eadp.cli.main import main
from eadp.exchange.items import MissionItem
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.live.messages import values_of
from eadp.live.mission import RestLayout, State


@pytest.fixture(scope="module")
def missions(plan, tmp_path_factory):
    """The mission of c1 = 0 for either autopilot: it takes off up to 50 m, and flies at 60 m."""
    folder = tmp_path_factory.mktemp("mission")
    paths = {ARDUPILOT: folder / "survey.waypoints", PX4: folder / "survey.plan"}
    options = ("--altitude", "60", "--home", "55.37,10.43", "--set", "c1=0", "-o")
    for to, path in zip(("ardupilot", "px4"), paths.values(), strict=True):
        assert main(["export", str(plan), "--to", to, *options, str(path)]) == 0
    return {ARDUPILOT: (paths[ARDUPILOT], wpl_items(paths[ARDUPILOT])), PX4: (paths[PX4], qgc_items(paths[PX4]))}


@pytest.fixture(scope="module")
def lines():
    return recorded()[:24]


def flown_by(kind, inputs, missions, flight=Flying, **given):
    flown = flight(inputs, missions[kind], kind=kind, **given)
    flown.holder.parameters = {"MIS_TKO_LAND_REQ": 0.0}
    return flown


def ground(flown, seconds, *frames):
    for second in seconds:
        flown.now_s = float(second)
        flown._give(flown.autopilot.heartbeat(armed=False, active=False))
        flown._give(flown.holder.current_item)
        for frame in frames:
            flown._give(frame)
        flown.flight.tick(flown.now_s)
        flown._give(b"")


BOTH = pytest.mark.parametrize("kind", [ARDUPILOT, PX4])


# --- in force


@pytest.mark.slow
@BOTH
def test_a_plan_without_altitudes_is_replaced_above_the_take_off(inputs, missions, lines, kind):
    """The take-off climbs to 50 m, which is no altitude of the plan: new items are at that of the others."""
    flown = flown_by(kind, inputs, missions).fly(lines)
    assert any("uploaded and verified" in text for text in flown.said), flown.said
    assert {item[2][6] for item in flown.holder.items if item[0] == 16} - {0.0} == {60.0}


def test_altitudes_of_a_take_off_do_not_count(reference):
    folder = reference / "autopilot/px4/plan"
    items = [
        MissionItem(row["command"], row["frame"], tuple(value or 0.0 for value in row["params"]))
        for row in json.loads((folder / "altitude-60-takeoff-50.plan").read_text())["mission"]["items"]
    ]
    assert items[0].command == 22
    assert items[0].altitude_m == 50
    survey, _ = read_plan(read_text("plans/survey.plan"))
    assert RestLayout(survey, 15.0).altitude_fault(items) is None
    higher = items[2]._replace(parameters=(*items[2].parameters[:6], 70.0))
    assert RestLayout(survey, 15.0).altitude_fault([*items, higher]) is not None


class Slow(MissionHolder):
    """One that is read back late: its answers to a reading after an upload are lost for some seconds."""

    late_s, clock, forgets, loses_end = 4.4, staticmethod(lambda: 0.0), False, False
    sent_s = None

    def answer(self, frame):
        before = list(self.items)
        answers = super().answer(frame)
        if self.kinds[-1] == "MISSION_ITEM_INT" and not self._due and self.sent_s is None:
            self.sent_s = self.clock()
            if self.forgets:
                self.items = before
            return [] if self.loses_end else answers
        late = self.sent_s is not None and self.clock() - self.sent_s < self.late_s
        return [] if late and self.kinds[-1].startswith("MISSION") else answers


class Watched(Finely):
    """Notes which path parameter the last item of the map has, tenth of a second by tenth; says no number of items."""

    total = 0

    def _give(self, frame):
        super()._give(frame)
        state, items = self.flight._mission._state, self.flight._lines.items
        if items is not None:
            self.seen = [*getattr(self, "seen", []), (self.now_s, state, items[-1].parameters[0])]


class Counted(Watched):
    """It says it."""

    total = Flying.total


def read_back_late(inputs, missions, lines, **ways):
    flown = flown_by(PX4, inputs, missions, flight=Counted if ways.get("loses_end") else Watched)
    flown.holder = Slow(missions[PX4][1], kind=PX4)
    flown.holder.parameters = {"MIS_TKO_LAND_REQ": 0.0}
    flown.holder.clock = lambda: flown.now_s
    for name, value in ways.items():
        setattr(flown.holder, name, value)
    return flown.fly(lines)


@pytest.mark.slow
@pytest.mark.parametrize("loses_end", [False, True])
def test_the_map_of_what_was_sent_holds_from_its_acknowledgement_on(inputs, missions, lines, loses_end):
    """Not only once it is read back. Where the acknowledgement is lost, the number of items says so."""
    flown = read_back_late(inputs, missions, lines, loses_end=loses_end)
    sent_s = flown.holder.sent_s
    new = {c1 for _, _, c1 in flown.seen} - {0.0}
    late_s = 1.1 if loses_end else 0.2  # after the next MISSION_CURRENT
    while_unread = (c1 for now_s, *c1 in flown.seen if sent_s + late_s < now_s < sent_s + 4.4)
    unread = [c1 for state, c1 in while_unread if state is not State.HELD]
    assert len(unread) > 5
    assert set(unread) <= new
    assert any("uploaded and verified" in text for text in flown.said)


@pytest.mark.slow
def test_the_old_map_holds_again_where_the_old_mission_is_read_back(inputs, missions, lines):
    flown = read_back_late(inputs, missions, lines[:16], forgets=True)
    values = [c1 for _, _, c1 in flown.seen]
    assert values[0] == 0.0
    refused = flown.said.index("new mission refused; the old one is kept")
    assert refused > 0
    assert any(c1 != 0.0 for c1 in values)
    back = [c1 for _, state, c1 in flown.seen if state is State.REFUSED]
    assert back
    assert set(back) == {0.0}


@pytest.mark.quick(1)
@BOTH
def test_an_empty_autopilot_is_no_other_mission(inputs, missions, lines, kind):
    """It is before a ground station has sent it; PX4 then has 65535 items, and the item of this number."""
    flown = flown_by(kind, inputs, missions)
    there, flown.holder.items = flown.holder.items, flown.holder.items[: flown.holder.first]
    ground(flown, range(25))
    assert not any("mission" in text for text in flown.said), flown.said
    flown.holder.items = there
    flown.fly(lines[:12])
    assert any("holds the mission of --items" in text for text in flown.said)


def test_a_moment_without_an_item_changes_none():
    values = values_of("MISSION_CURRENT", {"seq": 65535, "total": 161, "mission_state": 3})
    assert values == {"item_count": 161, "valid": True}
    assert values_of("MISSION_CURRENT", {"seq": 0, "total": 65535})["item_count"] is None


# --- what it says


@pytest.mark.slow
def test_its_echo_is_no_report(inputs, missions, lines):
    """PX4 sends NAMED_VALUE_FLOAT back as its own: a detector that does not obey would look obedient."""
    flown = flown_by(PX4, inputs, missions).fly(lines)
    assert "NAMED_VALUE_FLOAT" in flown.holder.kinds
    assert flown.flight._lines.heard.value("parameter c2") is None
    detector = Autopilot(component=192)
    flown._give(detector.frame("named_value_float", 1, b"c2", 4.0))
    assert flown.flight._lines.heard.value("parameter c2", ages=False) == 4.0


def sent_later(flown, text):
    """On the ground before the mission is sent, and after it with what the autopilot says then."""
    there, flown.holder.items = flown.holder.items, flown.holder.items[: flown.holder.first]
    ground(flown, range(2))
    flown.holder.items = there
    for frame in flown.holder._text(text):
        flown._give(frame)
    ground(flown, range(2, 14))


def test_a_mission_that_px4_refuses_is_refused_for_the_pilot(inputs, missions):
    """It accepts the items, and then says that it will not fly them: the pilot reads that, and not that it is held."""
    flown = flown_by(PX4, inputs, missions)
    flown.holder.parameters = {}
    sent_later(flown, flown.holder.refusal)
    (held,) = [text for text in flown.said if "holds the mission" in text]
    assert held.endswith("and refuses it: Mission rejected: Landing waypoint/pattern required.")
    assert "eadp: the autopilot refuses: Mission rejected: Landing waypoint/pattern required." in flown.texts
    ground(flown, range(14, 16), *flown.holder.armed())  # in two pieces
    assert "eadp: the autopilot refuses: Arming denied: Resolve system health failures first" in flown.texts
    assert not any(fault.severity == "note" and "holds" in fault.message for fault in flown.faults)


def test_a_mission_that_is_not_valid_is_not_just_held(inputs, missions):
    """Newer versions of PX4 say why as an event alone; the state of the mission says that it is."""
    flown = flown_by(PX4, inputs, missions)
    flown.holder.parameters = {}
    flown._give(flown.autopilot.heartbeat(armed=False, active=False) + flown.holder.current_item)
    (held,) = [text for text in flown.said if "holds the mission" in text]
    assert "refuses it: no reason given" in held or flown.flight._autopilot.refusal


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("PreArm: DO_LAND_START set and RTL_AUTOLAND disabled", True),
        ("Arm: Missing mission item: land", True),
        ("PreArm: GPS 1: Bad fix", False),
        ("Mission: 7 SetCamTrigDst", False),
        ("Flight plan received", False),
    ],
)
def test_what_ardupilot_says_against_a_mission_is_told(inputs, missions, text, told):
    flown = flown_by(ARDUPILOT, inputs, missions)
    sent_later(flown, text)
    assert any(text in each for each in flown.texts) is told
    assert any(each.severity == "note" and "holds the mission" in each.message for each in flown.faults) is not told


@pytest.mark.slow
@pytest.mark.parametrize(("mps", "said"), [(9.0, ""), (18.0, "AIRSPEED_MIN is 18, more than 15")])
def test_a_speed_below_the_autopilots_is_not_assumed(inputs, missions, lines, mps, said):
    flown = flown_by(ARDUPILOT, inputs, missions)
    assert inputs.mission.cruise_mps == 15
    flown.holder.parameters = {"ARSPD_FBW_MIN" if mps == 18.0 else "AIRSPEED_MIN": mps, "AIRSPEED_MAX": 25.0}
    flown.fly(lines)
    told = [text for text in flown.said if "does not hold" in text]
    assert [said.replace("AIRSPEED_MIN", "ARSPD_FBW_MIN") in text for text in told] == [True] * bool(said)


# --- pilots and returns


def in_mode(flown, lines, mode):
    """Fly on, a second a line, in a mode; the mission is reported."""
    flown.autopilot.mode = mode
    for line in lines:
        flown.now_s = 100.0 + line["time_s"]
        flown._give(flown.autopilot.heartbeat(armed=True, active=True))
        flown._give(flown.autopilot.battery(14.8, line["power_w"] / 14.8, None, line["soc"]))
        flown._give(flown.holder.current_item)
        state = line["x_m"], line["y_m"], line["velocity_mps"], line["heading_deg"]
        flown._give(flown.autopilot.position(flown.now_s, *state))
        flown.flight.tick(flown.now_s)
        flown._give(b"")
    return flown


@pytest.mark.quick(1)
@BOTH
def test_nothing_is_uploaded_while_the_mission_is_not_flown(inputs, missions, kind):
    """Once it is flown again, what was decided before is."""
    flown = flown_by(kind, inputs, missions, refuses=("MISSION_COUNT",))
    in_mode(flown, recorded()[:12], "mission")
    assert flown.flight._decided_path[0] < 0
    flown.holder.refuses = ()
    in_mode(flown, recorded()[12:30], "pilot")
    assert flown.holder.writes == []
    in_mode(flown, recorded()[30:60], "mission")
    assert any("uploaded and verified" in text for text in flown.said)


@pytest.mark.slow
def test_a_mission_that_was_checked_before_a_pilot_flew_is_checked_again(inputs, missions):
    """Another one may have come meanwhile."""
    flown = flown_by(ARDUPILOT, inputs, missions, refuses=("MISSION_COUNT",))
    in_mode(flown, recorded()[:12], "mission")
    mission = flown.flight._mission
    mission._state, mission._again_s = State.CHECKED, flown.now_s + 10
    flown.holder.refuses = ()
    in_mode(flown, recorded()[12:40], "pilot")
    land = (21, 3, (0.0, 0.0, 0.0, 1.0, 55.375, 10.44, 0.0))
    flown.holder.items[-1:] = [land]
    in_mode(flown, recorded()[40:60], "mission")
    assert flown.holder.items[-1] == land


@pytest.mark.slow
@BOTH
def test_nothing_of_the_survey_is_sent_while_the_autopilot_returns(inputs, missions, kind):
    flown = in_mode(flown_by(kind, inputs, missions, return_home=False), recorded()[:20], "mission")
    flown.sent.clear()
    writes = len(flown.holder.writes)
    in_mode(flown, recorded()[20:80], "return")
    names = {message.fields["name"] for message in flown.sent if message.kind == "NAMED_VALUE_FLOAT"}
    assert names <= {"soc_end", "p_done"}
    assert len(flown.holder.writes) == writes
    assert flown.texts == []


@pytest.mark.slow
@BOTH
def test_what_is_read_of_the_autopilot_counts_and_is_in_the_log(inputs, missions, kind):
    """Its kind by the first heartbeat, then its parameters; telemetry has them when they are new."""
    flown = flown_by(kind, inputs, missions)
    name, value = ("RTL_RETURN_ALT", 75.0) if kind == PX4 else ("ALT_HOLD_RTL", 7500.0)
    flown.holder.parameters = {name: value}
    lines, replanner = [], flown.flight._replanner
    take = replanner.take
    replanner.take = lambda reading: (lines.append(reading.line), take(reading))
    in_mode(flown, recorded()[:60], "mission")
    kinds = {ARDUPILOT: "ardupilot", PX4: "px4"}
    said = {"kind": kinds[kind]}
    assert [line["autopilot"] for line in lines if "autopilot" in line] == [said, said | {name: value}]
    own = replanner._flight._flight.state.autopilot
    assert own.kind == kinds[kind]
    assert own.return_altitude_m(None) == 75


def test_who_flies_home_is_not_asked_to(inputs, missions):
    flown = in_mode(flown_by(ARDUPILOT, inputs, missions), recorded()[:20], "mission")
    in_mode(flown, recorded()[20:24], "return")
    flown.flight._decided({**flown.decisions[-1], "returns_home": True, "reason": "home: battery short since 9.0 s"})
    assert not any("fly home" in text.replace("flies home", "") for text in flown.texts)
    assert not any("battery short" in text for text in flown.texts)
    in_mode(flown, recorded()[24:26], "mission")
    flown.flight._decided({**flown.decisions[-1], "returns_home": True})
    assert "eadp: only home can be reached: fly home" in flown.texts


@pytest.mark.slow
def test_the_end_of_a_plan_is_told_though_its_mission_is_over(inputs, missions):
    flown = in_mode(flown_by(ARDUPILOT, inputs, missions), recorded()[:20], "mission")
    in_mode(flown, recorded()[20:21], "return")
    flown.flight._decided({**flown.decisions[-1], "reason": "final point reached"})
    assert flown.texts[-1] == "eadp: final point reached"
