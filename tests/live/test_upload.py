"""The rest of a mission, replaced in flight: by the protocol, beside the route that is left, and where it fails."""

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("pymavlink")

from common.plans import ORIGIN, STADIUM
from linked_flight import Finely, Flying, wpl_items
from mavlink_vehicle import Autopilot, MissionHolder, frames, recorded

from eadp.cli.main import main
from eadp.core.geometry.geodesy import to_local_m
from eadp.errors import InputError
from eadp.exchange.autopilot import read_parameters, speed_limits, wanted_parameters
from eadp.exchange.items import ITEMS_LIMIT
from eadp.exchange.path import PlannedPath, planned_sections
from eadp.exchange.writer import mapped_items, mission_items, read_items
from eadp.io.plan.reader import read_plan
from eadp.io.plan.sources import PlanReader
from eadp.io.text.streams import Text
from eadp.live.link import LinkFlight, LinkOptions
from eadp.live.mavlink import Codec
from eadp.live.messages import ASKED, WANTED
from eadp.live.mission import RECHECK_S, MissionClient, Outgoing, Received, RestLayout
from eadp.live.replanner import ReplanLog, hash_of
from eadp.models.plan.trace import nominal_legs, nominal_route


@pytest.fixture(scope="module")
def mission(plan, tmp_path_factory):
    """The mission of c1 = 0, and its items as an autopilot holds them."""
    path = tmp_path_factory.mktemp("mission") / "survey.waypoints"
    assert main(["export", str(plan), "--to", "ardupilot", "--altitude", "60", "-o", str(path)]) == 0
    return path, wpl_items(path)


@pytest.fixture(scope="module")
def lines():
    return recorded()[:24]


@pytest.fixture(scope="module")
def replaced(inputs, mission, lines):
    """The flight in which the rest is replaced."""
    return Flying(inputs, mission).fly(lines)


@pytest.mark.slow
def test_a_mission_that_is_held_is_read_again_each_minute(inputs, mission, monkeypatch):
    """While decisions go on, too: somebody may have changed it."""
    read_s, download = [], MissionClient.download
    monkeypatch.setattr(MissionClient, "download", lambda *given: (read_s.append(given[1]), download(*given)))
    lines = recorded()[:200]
    Flying(inputs, mission).fly(lines)
    assert all(later - earlier <= RECHECK_S + 2 for earlier, later in itertools.pairwise(read_s))
    assert read_s[-1] >= 100 + lines[-1]["time_s"] - RECHECK_S - 2


def test_the_rest_is_replaced_and_verified(inputs, mission, replaced):
    flown = replaced
    assert any("holds the mission of --items" in text for text in flown.said)
    assert any("uploaded and verified" in text for text in flown.said)
    decided = flown.decisions[-1]["parameters"]["c1"]
    assert decided < 0
    before = read_items(f"{mission[0]}.items.json", ("c1",))
    kept = sum(each.first <= 1 for each in before)
    after = flown.holder.items[1:]
    for (command, _, now), (was_command, _, was) in zip(after[:kept], mission[1][:kept], strict=True):
        assert command == was_command
        assert now[:4] == pytest.approx(was[:4], rel=1e-6)  # numbers in single precision
        assert now[4:] == pytest.approx(was[4:], abs=1.1e-7)  # a step of a position that is sent
    assert after[kept:] != mission[1][kept:]
    # what the autopilot holds, flown, is the route that is left
    head = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t" + f"{ORIGIN[0]}\t{ORIGIN[1]}\t0\t1\n"
    rows = [f"{k}\t0\t{f}\t{c}\t" + "\t".join(map(repr, p)) + "\t1" for k, (c, f, p) in enumerate(after, 1)]
    held, _ = PlanReader(turn_radius_m=20.0)(Text("held", head + "\n".join(rows) + "\n"))
    legs = nominal_legs(inputs.mission.plan, (decided, 2.0))
    flown_m, left_m = (sum(leg.distance_m for leg in each) for each in (nominal_legs(held, ()), legs))
    assert flown_m == pytest.approx(left_m, rel=0.08)  # the first stages are of c1 = 0
    assert all(item[2][6] == 60 for item in after if item[0] == 16)
    # waypoints lie on the new lines; between stages that are less than 5 m apart, one lies in the middle
    written = [to_local_m(*p[4:6], ORIGIN) for c, _, p in after if c == 16]
    points = [leg.end_m for leg in legs if leg.stage.kind == "line"]
    near = [min(math.dist(point, other) for other in written) for point in points[2:]]
    assert max(near) < 2.5
    assert min(near) < 0.02


def test_nothing_is_uploaded_before_the_first_plan(eadp, inputs, plan, lines, tmp_path):
    """The mission is that of the forecast, and the flight begins with it, not with the parameters of the plan."""
    path = tmp_path / "survey.waypoints"
    eadp("export", plan, "--to", "ardupilot", "--altitude", "60", "--set", "spacing=20", "-o", path)
    items = wpl_items(path)
    flown = Flying(inputs, (path, items)).fly(lines[:3])
    exported = json.loads((tmp_path / "survey.waypoints.items.json").read_text())["items"][-1][5]
    assert flown.decisions[0]["parameters"]["c1"] == exported == flown.decisions[-1]["parameters"]["c1"] != 0
    assert not flown.decisions[-1]["reason"].startswith("spacing")
    assert flown.holder.writes == []
    assert any("holds the mission" in text for text in flown.said)


@pytest.mark.parametrize("refuses", [(), ("MISSION_COUNT",)])
def test_items_before_an_upload_are_no_refusal(inputs, mission, lines, tmp_path, refuses):
    """The items flown are of c1 = 0: in force where the new mission is refused, else those of before it."""
    path = tmp_path / "log.jsonl"
    log = ReplanLog(str(path), hash_of(inputs.sources, {}))
    flown = Flying(inputs, mission, log, refuses=refuses).fly(lines, current=True)
    log.close()
    assert flown.decisions[-1]["parameters"]["c1"] < 0
    rows = [row for row in map(json.loads, path.read_text().splitlines()) if row["kind"] == "telemetry"]
    in_force = [row.get("parameters", {}).get("c1") for row in rows]
    assert in_force[2] == 0.0, "before the first plan"
    assert in_force[-1] == (0.0 if refuses else None)
    uploads = sum("verified" in text for text in flown.said)
    assert (uploads == 0) == bool(refuses)
    if refuses:
        assert any("the old one is kept" in text for text in flown.said)
        assert flown.holder.items[1:] == mission[1]
    else:  # what it has sent itself is not read again
        assert flown.holder.kinds.count("MISSION_REQUEST_LIST") == 2 + 2 * uploads


class Lossy(MissionHolder):
    """One of which an answer is lost: the first at which `loses` holds."""

    left = 1

    def __init__(self, items, loses, **given):
        super().__init__(items, **given)
        self.loses = loses

    def answer(self, frame):
        answers = super().answer(frame)
        if self.left and self.loses(self):
            self.left = 0
            return []
        return answers


@pytest.mark.parametrize("at_end", [False, True])
def test_a_request_that_is_lost_does_not_end_an_upload(inputs, mission, lines, at_end):
    """ArduPilot answers the item that comes again with an error, and goes on.

    It goes back to its first item before the end of the upload is known.
    """

    def loses(holder):
        return holder.kinds[-1] == "MISSION_ITEM_INT" and not holder._due if at_end else holder._due[:1] == [30]

    flown = Flying(inputs, mission)
    flown.holder = Lossy(mission[1], loses, resets=at_end)
    flown.holder.current = 3
    flown.fly(lines, current=True)
    assert not flown.holder.left
    assert any("uploaded and verified" in text for text in flown.said)
    assert flown.holder.current == 3


@pytest.mark.slow
def test_a_silence_while_an_upload_is_read_back_does_not_lose_it(inputs, mission, lines):
    """An item is asked for `ITEM_TRIES` times in 4 s."""
    flown, silent_from_s = Finely(inputs, mission), []

    class Silent(MissionHolder):
        def answer(self, frame):
            answers = super().answer(frame)
            if self.writes and self.kinds[-1] == "MISSION_REQUEST_INT":
                silent_from_s.append(flown.now_s)
            return [] if silent_from_s and flown.now_s - silent_from_s[0] < 5.0 else answers

    flown.holder = Silent(mission[1])
    flown.fly(lines)
    assert silent_from_s
    assert any("read again" in text for text in flown.said)
    assert any("uploaded and verified" in text for text in flown.said)
    assert not any("unknown" in text or "another" in text for text in flown.said)


def test_a_mission_of_too_many_items_is_refused_and_not_cut():
    client = MissionClient()
    for count, ended, answer in (
        (ITEMS_LIMIT + 1, None, Outgoing("MISSION_REQUEST_INT", {"seq": 0})),  # home is one more
        (ITEMS_LIMIT + 2, Received(None), Outgoing("MISSION_ACK", {"type": 4})),  # MAV_MISSION_NO_SPACE
    ):
        client.download(0.0)
        assert client.take("MISSION_COUNT", {"count": count}, 0.1) == ended
        assert client.messages[-1] == answer
        assert client.busy is (ended is None)


@pytest.mark.parametrize("ahead", [True, False])
def test_items_ahead_with_other_parameters_are_replaced(inputs, mission, lines, replaced, tmp_path, ahead):
    """The last item has what is decided, and those before it, or only those flown past, have not."""
    decided = replaced.decisions[11]["parameters"]["c1"]
    path, items = mission
    map_of = json.loads(Path(f"{path}.items.json").read_text())
    for row in map_of["items"]:
        row[5] = decided if row[3] > (map_of["items"][-1][3] - 10 if ahead else 1) else 0.0
    other = tmp_path / "other.waypoints"
    Path(f"{other}.items.json").write_text(json.dumps(map_of))
    flown = Flying(inputs, (other, items)).fly(lines[:12], current=True)
    assert flown.decisions[-1]["parameters"]["c1"] == decided
    assert any("uploaded and verified" in text for text in flown.said) is ahead
    assert bool(flown.holder.writes) is ahead


def test_item_0_on_the_ground_is_that_of_home(inputs, mission):
    flown = Flying(inputs, mission)
    flown._give(flown.autopilot.heartbeat(armed=False, active=False))
    flown._give(flown.holder.autopilot.frame("mission_current", 0, flown.total))
    flown._give(flown.autopilot.position(1.0, -100.0, 220.0, [0.0, 0.0], 0.0))
    assert not any("no item" in text for text in flown.said)


def test_a_mission_that_the_pilot_changes_in_flight_is_left_alone(inputs, mission, lines):
    land = (21, 3, (0.0, 0.0, 0.0, 0.0, 55.375, 10.44, 0.0))

    class Changed(Flying):
        def _give(self, frame):
            if self.now_s > 102 and not self.holder.writes:
                self.holder.items[10:] = [land]
            super()._give(frame)

    flown = Changed(inputs, mission).fly(lines)
    assert any("another mission" in text for text in flown.said)
    assert flown.holder.items[10:] == [land]
    assert flown.holder.writes == []


@pytest.mark.slow
@pytest.mark.parametrize("counts", [True, False])
def test_another_number_of_items_is_read_at_once(inputs, mission, lines, counts):
    """Without an upload, too: old autopilots report 0 items, and it is noticed at the next arming."""

    class Changed(Flying):
        total = property(lambda self: counts * (len(self.holder.items) - 1))

        def _give(self, frame):
            if self.now_s > 110:
                del self.holder.items[10:]
            super()._give(frame)

    flown = Changed(inputs, mission, upload=False).fly(lines, current=True)
    assert any("another mission" in text for text in flown.said) == counts
    # at first, at arming, at the change, and each 10 s from then on
    assert flown.holder.kinds.count("MISSION_REQUEST_LIST") == 2 + counts * (1 + int(flown.now_s - 111) // 10)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda number, frame, altitude: (0, altitude + 500), "not above home"),
        (lambda number, frame, altitude: (frame, altitude + 40 * (number > 60)), "not those of the plan"),
    ],
)
def test_altitudes_that_cannot_be_kept_are_no_upload(inputs, mission, lines, change, said):
    path, items = mission
    given = []
    for number, (command, frame, (*numbers, altitude)) in enumerate(items):
        new, height = change(number, frame, altitude)
        given.append((command, new, (*numbers, height)))
    flown = Flying(inputs, (path, given)).fly(lines)
    assert any(said in text for text in flown.said)
    assert flown.holder.writes == []


@pytest.mark.slow
def test_acks_of_others_end_no_upload(inputs, mission, lines):
    """That of a fence, and that for a ground station."""

    class Between(MissionHolder):
        def answer(self, frame):
            fields = [(1, 191, 1, 1), (255, 190, 1, 0), (255, 191, 1, 0)]
            return [*(self.autopilot.frame("mission_ack", *each) for each in fields), *super().answer(frame)]

    flown = Flying(inputs, mission)
    flown.holder = Between(mission[1])
    flown.fly(lines)
    assert any("uploaded and verified" in text for text in flown.said)


@pytest.mark.slow
def test_after_a_kill_before_the_upload_it_is_made(inputs, mission, lines, tmp_path):
    path, kept = str(tmp_path / "flight.jsonl"), hash_of(inputs.sources, {})
    log = ReplanLog(path, kept)
    first = Flying(inputs, mission, log, refuses=("MISSION_COUNT",)).fly(lines[:12])
    log.close()
    assert first.decisions[-1]["parameters"]["c1"] < 0
    log = ReplanLog(path, kept)
    again = Flying(inputs, mission, log).fly(lines[12:20])
    log.close()
    assert {answer["parameters"]["c1"] for answer in again.decisions} == {first.decisions[-1]["parameters"]["c1"]}
    assert any("uploaded and verified" in text for text in again.said)


def test_an_autopilot_that_does_not_answer_is_said(inputs, mission):
    flown = Flying(inputs, mission, lost=1000).fly(recorded()[:40])
    assert any("cannot be read" in text for text in flown.said)
    assert flown.holder.writes == []


def test_a_mission_that_is_stored_wrong_does_not_count(inputs, mission, lines):
    flown = Flying(inputs, mission, spoils=20).fly(lines)
    assert not any("verified" in text for text in flown.said)
    assert any("mission unknown" in text for text in flown.said)
    shown = flown.texts
    assert "eadp: mission unknown after an upload: see to it" in [text[:48] for text in shown]  # the pilot knows, too


@pytest.mark.slow
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
        before = flown.holder.kinds.count("COMMAND_LONG")
        flown._give(flown.autopilot.heartbeat(armed=True, active=True))
        assert flown.holder.kinds.count("COMMAND_LONG") == before + 7
        assert flown.holder.kinds.count("MISSION_REQUEST_LIST") == 1 + (start_s > 0)
        flown.flight.tick(start_s + 20.0)
        flown._give(b"")


def test_after_a_kill_the_mission_that_was_uploaded_is_still_known(eadp, inputs, mission, lines, tmp_path):
    path, kept = str(tmp_path / "flight.jsonl"), hash_of(inputs.sources, {})
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
    # without the log it is another mission
    forgets = Flying(inputs, mission)
    forgets.holder = first.holder
    forgets._give(forgets.autopilot.heartbeat(armed=True, active=True))
    assert any("another mission" in text for text in forgets.said)


def test_it_needs_the_map(inputs):
    with pytest.raises(InputError, match="--upload"):
        LinkFlight(inputs, "link", LinkOptions(upload=True), None, print, print)


def test_a_log_of_a_mission_with_another_number_of_items_has_the_stage_by_position(inputs, mission, lines):
    """What was uploaded in flight is in no telemetry log of a ground station."""
    faults, autopilot = [], Autopilot()
    flight = LinkFlight(inputs, "log", LinkOptions(f"{mission[0]}.items.json"), None, lambda _: None, faults.append)
    for _, parts in frames(lines[:3], autopilot):
        for frame in (autopilot.frame("mission_current", 1, len(mission[1]) - 20), *parts):
            for message in Codec(WANTED).decoded(frame):
                flight.take(message)
    assert [fault.message for fault in faults if fault.severity == "warning"] == [
        "another mission than that of --items is flown: the stage is found by the position"
    ]


class Tears(MissionHolder):
    """A link that is down for some seconds while the rest of a mission is sent; ArduPilot keeps what has come."""

    def __init__(self, items, now_s, after, silent_s=12.0):
        super().__init__(items)
        self._now_s, self._after, self._silent_s, self._from_s = now_s, after, silent_s, None
        self.torn = None

    def answer(self, frame):
        if self._from_s is None and len(self.writes) >= self._after:
            self._from_s, self.torn = self._now_s(), list(self.items)
        if self._from_s is not None and self._now_s() - self._from_s < self._silent_s:
            return []
        if self._from_s is not None and self._due and self._now_s() - self._from_s < self._silent_s + 2:
            self._due.clear()
        return super().answer(frame)


@pytest.mark.quick(1)
@pytest.mark.parametrize("after", [30, 60])
def test_an_upload_that_is_interrupted_is_sent_again(inputs, mission, after):
    """What is held is the first items of the new mission before the rest of the old one: eadp's own."""
    flown = Finely(inputs, mission)
    flown.holder = Tears(mission[1], lambda: flown.now_s, after)
    flown.fly(recorded()[:60])
    new, old = flown.holder.items, [flown.holder.items[0], *mission[1]]
    assert flown.holder.torn[after:] == old[after : len(flown.holder.torn)] != new[after:]
    told = flown.texts
    assert any("upload interrupted" in text for text in told)
    assert flown.said.index("upload interrupted: it is sent again") < max(
        k for k, text in enumerate(flown.said) if "uploaded and verified" in text
    )
    assert not any("unknown" in text or "another mission" in text for text in flown.said)
    decided = flown.decisions[-1]["parameters"]["c1"]
    assert {each.parameters[0] for each in flown.flight._lines.items if each.first > 4} == {decided}


CAMERA = """\
%: origin 55.37 10.43
%: command 206 15 0 1 0 0 0 0
0.1; 90; x
0, 300
%: command 206 0 0 1 0 0 0 0
0.0005; 270; (x - 50)^2 + (y - 300)^2 - 2500
100, 300
%: command 206 15 0 1 0 0 0 0
0.1; 270; x - 100
100, 0
%: command 206 0 0 1 0 0 0 0
0.0005; 90; (x - 150)^2 + y^2 - 2500
200, 0
%: command 206 15 0 1 0 0 0 0
0.1; 90; x - 200
200, 300
"""


def mapped(plan, *, px4=False, **options):
    """What is planned, and its items with their stages."""
    planned = nominal_route(plan, ()).planned()
    path = PlannedPath("whole", planned_sections(planned.legs), ORIGIN, 60.0, 15.0, ORIGIN, **options)
    return planned, mapped_items(mission_items(path, px4=px4), planned, plan.path_count)


def test_the_rest_has_the_camera_of_each_line():
    plan, _ = read_plan(Text("camera", CAMERA))
    planned, whole = mapped(plan)
    kept, rest = RestLayout(plan, 15.0).after([each.item for each in whole], whole, planned, px4=False)
    assert 0 < kept < len(whole)
    assert [each.item[:3] for each in rest] == [each.item[:3] for each in whole[kept:]]  # legs count from the first
    assert [each.item.parameters[0] for each in rest if each.item.command == 206] == [0, 15, 0, 15, 0]


def test_an_airspeed_that_ends_in_the_rest_is_commanded():
    first, rest = CAMERA.split("0.1; 270; x - 100")
    text = f"%: airspeed 12\n{first}%: airspeed default\n0.1; 270; x - 100{rest}"
    plan, _ = read_plan(Text("speeds", text))
    planned, whole = mapped(plan)
    _, rest = RestLayout(plan, 15.0).after([each.item for each in whole], whole, planned, px4=False)
    assert [each.item.parameters[1] for each in rest if each.item.command == 178] == [-2]


ROUND_SHORT_LINE = """\
%: origin 55.37 10.43
0.1; 90; x
0, 300
0.0005; 270; (x - 50)^2 + (y - 300)^2 - 2500
50, 350
0.1; 0; y - 350
70, 350
0.0005; 270; (x - 70)^2 + (y - 300)^2 - 2500
120, 300
"""


@pytest.mark.parametrize("px4", [False, True])
def test_a_turn_whose_first_corner_stays_does_so_to_the_return(px4):
    """The line before it is short: it ends in that corner."""
    plan, _ = read_plan(Text("short", ROUND_SHORT_LINE))
    planned, whole = mapped(plan, px4=px4, trigger_distance_m=20.0)
    assert (3, 4) in [(each.first, each.last) for each in whole]
    kept, rest = RestLayout(plan, 15.0).after([each.item for each in whole], whole, planned.after(2), px4=px4)
    assert (kept, rest, whole[-1].item.command) == (len(whole), [], 20)


def test_new_items_begin_after_all_stages_that_items_which_stay_lead_along():
    """An item that stays leads on along a stage whose own last item leads on along another one."""
    plan, _ = read_plan(Text("short", ROUND_SHORT_LINE + "0.1; 270; x - 120\n120, 200\n0.1; 270; x - 130\n130, 100\n"))
    planned, whole = mapped(plan, px4=True)
    longer = [each._replace(last=5) if each.first == 4 else each for each in whole]
    assert {(each.first, each.last) for each in longer} >= {(3, 4), (4, 5)}
    layout = RestLayout(plan, 15.0)
    for started in (1, 2, 3, 4):
        kept, rest = layout.after([each.item for each in longer], longer, planned.after(started - 1), px4=True)
        assert rest[0].first > max([0, *(each.last for each in longer[:kept])])


@pytest.mark.parametrize("px4", [False, True])
def test_the_rest_for_px4_has_no_loiters(px4):
    plan, _ = read_plan(Text("stadium", STADIUM.format(2, 40, 8, 30)))
    plan = replace(plan, site=plan.site._replace(origin_deg=ORIGIN))
    planned, whole = mapped(plan, px4=px4)
    _, rest = RestLayout(plan, 15.0).after([each.item for each in whole], whole, planned, px4=px4)
    assert any(each.item.command == 18 for each in rest) is not px4


@pytest.mark.quick(1)
@pytest.mark.parametrize("older", [False, True])
def test_parameters_that_disagree_are_said_once(inputs, mission, lines, older):
    """And by how much; an older autopilot has them by other names, in other units."""
    flown, cruise_mps = Flying(inputs, mission), inputs.mission.cruise_mps
    speed = {"TRIM_ARSPD_CM": 1800.0} if older else {"AIRSPEED_CRUISE": 18.0}
    mah = 1000 * inputs.mission.battery.capacity_ah
    flown.holder.parameters = {**speed, "BATT_CAPACITY": mah, "ROLL_LIMIT_DEG": 45.0}
    flown.fly(lines)
    (said,) = [text for text in flown.said if "forecast does not hold" in text]
    wanted = f"TRIM_ARSPD_CM is 1800, not {100 * cruise_mps:g}", f"AIRSPEED_CRUISE is 18, not {cruise_mps:g}"
    assert said == f"the forecast does not hold: {wanted[not older]}"
    aircraft = inputs.mission.plan, inputs.mission.vehicle, inputs.mission.battery
    asked_for = [*wanted_parameters(*aircraft, ardupilot=True), *speed_limits(*aircraft[:2], ardupilot=True)]
    limit = 2 * ASKED * len(read_parameters(asked_for, ardupilot=True))
    assert flown.holder.kinds.count("PARAM_REQUEST_READ") <= limit
    assert sum("forecast does not hold" in m.fields["text"] for m in flown.sent if m.kind == "STATUSTEXT") == 1
