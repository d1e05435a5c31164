"""Missions of other software as plans: against geodesics, an interpreter of jumps, and faults at their places."""

import copy
import itertools
import json
import math

import numpy as np
import pytest
from common.answers import refused
from hypothesis import assume, given
from hypothesis import strategies as st

import eadp as library
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.core.guidance import GRAVITY_MPS2
from eadp.errors import InputError
from eadp.exchange.items import ITEMS_LIMIT, MOTIONLESS
from eadp.exchange.mission_plan import LOITER_RADIUS_M
from eadp.io.plan.reader import read_plan
from eadp.io.plan.sources import PlanReader
from eadp.io.plan.writer import plan_text
from eadp.io.text.streams import Text
from eadp.models.plan.trace import nominal_legs

HOME = (47.0, 8.0)
RADIUS_M = 20.0
READER = PlanReader(turn_radius_m=RADIUS_M, airspeed_mps=15.0, climb_rate_mps=3.0)
HEAD = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47.0\t8.0\t400.0\t1\n"
ROUNDED_M = 0.05
CENTIMETRE_M = 0.01


def at(east, north):
    return to_geodetic_deg(east, north, HOME)


def row(index, command, *parameters, east=None, north=None, altitude=50.0, frame=3):
    values = [*parameters, 0, 0, 0, 0][:4]
    lat, lon = (0.0, 0.0) if east is None else at(east, north)
    numbers = "\t".join(f"{value:.9g}" for value in values)
    return f"{index}\t0\t{frame}\t{command}\t{numbers}\t{lat:.9f}\t{lon:.9f}\t{altitude:g}\t1\n"


def wpl(*items):
    """A WPL file of (command, parameters, position or None, …)."""
    return HEAD + "".join(row(i, *item[0], **item[1]) for i, item in enumerate(items, 1))


def item(command, *parameters, **where):
    return (command, *parameters), where


def waypoint(east, north, *parameters, **where):
    return item(16, *parameters, east=east, north=north, **where)


def qgc(*items, **mission):
    """A QGroundControl plan of the same items."""
    simple = []
    for number, ((command, *parameters), where) in enumerate(items, 1):
        lat, lon = at(where["east"], where["north"]) if "east" in where else (0, 0)
        values = [*parameters, 0, 0, 0, 0][:4]
        simple.append({
            "type": "SimpleItem", "command": command, "frame": where.get("frame", 3), "autoContinue": True,
            "doJumpId": number, "params": [*values, lat, lon, where.get("altitude", 50)],
        })  # fmt: skip
    return {
        "fileType": "Plan", "version": 1, "groundStation": "QGroundControl",
        "mission": {"version": 2, "vehicleType": 1, "items": simple, "plannedHomePosition": [*HOME, 400], **mission},
    }  # fmt: skip


def read(content, reader=READER, name="m"):
    body = content if isinstance(content, str) else json.dumps(content, indent=1)
    return reader(Text(name, body))


def ends(plan):
    return [stage.trigger_at(()) for stage in plan.stages]


def length_m(plan):
    return sum(leg.length_m for leg in nominal_legs(plan, ()))


def fault_of(content, reader=READER):
    with pytest.raises(InputError) as caught:
        read(content, reader)
    return caught.value.faults[0]


# --- what is read -----------------------------------------------------------------------------------------------------


def test_one_mission_in_both_formats_is_one_plan():
    items = [
        item(22, 15, altitude=30), waypoint(300, 0), item(178, 0, 20), waypoint(300, 300, altitude=80),
        item(18, 2, 0, 70, east=0, north=500), item(206, 25), waypoint(-300, 200), item(177, 2, 2), item(20),
    ]  # fmt: skip
    first, found = read(wpl(*items))
    second, also = read(qgc(*items))
    assert [f.code for f in found] == [f.code for f in also] == []
    assert len(first.stages) == len(second.stages)
    for a, b in zip(first.stages, second.stages, strict=True):
        assert (a.kind, a.rotation_deg, a.altitude_m, a.airspeed_mps, a.commands) == (
            b.kind, b.rotation_deg, b.altitude_m, b.airspeed_mps, b.commands,
        )  # fmt: skip
        assert a.trigger_at(()) == pytest.approx(b.trigger_at(()), abs=CENTIMETRE_M)
    assert first.site.origin_deg == HOME
    assert first.site.start_m == (0, 0)
    assert first.min_radius_m == RADIUS_M


def test_legs_have_the_lengths_of_geodesics():
    pyproj = pytest.importorskip("pyproj")
    corners = [(900, 0), (900, 1400), (-700, 1400), (-700, -300)]
    plan, _ = read(wpl(*(waypoint(*corner) for corner in corners)))
    places = [HOME, *(at(*corner) for corner in corners)]
    geod = pyproj.Geod(ellps="WGS84")
    legs = [geod.inv(a[1], a[0], b[1], b[0])[2] for a, b in itertools.pairwise(places)]
    # three right angles: each fillet replaces 2 r by a quarter of a circle
    expected = sum(legs) - 3 * (2 - math.pi / 2) * RADIUS_M
    assert length_m(plan) == pytest.approx(expected, abs=ROUNDED_M)


def test_reference_missions_are_as_long_as_their_geodesics(reference):
    pyproj = pytest.importorskip("pyproj")
    geod = pyproj.Geod(ellps="WGS84")
    folder = reference / "missions"
    rows = [line.split() for line in (folder / "ap-circuit.waypoints").read_text().splitlines()[1:]]
    places = [(float(r[9]), float(r[8])) for r in rows if float(r[8])]
    legs = sum(geod.inv(*a, *b)[2] for a, b in itertools.pairwise(places))
    plan = library.read_plan(folder / "ap-circuit.waypoints")
    circling = 600 * 15  # a loiter of 600 s
    assert length_m(plan) == pytest.approx(legs + circling, rel=0.03)
    for name in ("cmac-bigloop.waypoints", "cmac-turns.waypoints", "qgroundcontrol_sample.plan"):
        assert library.read_plan(folder / name, laps=2, warn=lambda _: None).stages, name
    with pytest.raises(InputError, match=r"mission\.version: 7 is not known"):
        library.read_plan(folder / "qgroundcontrol_sample_wrong_mission_version.plan")


@pytest.mark.parametrize("version", [4, 5])
def test_a_survey_is_read_through_its_items(version):
    plan = qgc(waypoint(100, 0), waypoint(500, 0), waypoint(500, 200), waypoint(100, 200))
    flat, _ = read(plan)
    items = plan["mission"]["items"]
    survey = {
        "type": "ComplexItem", "complexItemType": "survey", "version": version,
        "TransectStyleComplexItem": {"version": 1, "Items": items[1:]},
    }  # fmt: skip
    nested, _ = read(qgc() | {"mission": plan["mission"] | {"items": [items[0], survey]}})
    assert ends(nested) == ends(flat)


def test_a_landing_pattern_ends_on_the_ground():
    pattern = {
        "type": "ComplexItem", "complexItemType": "fwLandingPattern", "version": 2, "loiterRadius": 60,
        "loiterClockwise": False, "useLoiterToAlt": True, "altitudesAreRelative": True,
        "landingApproachCoordinate": [*at(600, 300), 40], "landCoordinate": [*at(0, 300), 0],
    }  # fmt: skip
    plan = qgc(waypoint(600, 0))
    plan["mission"]["items"].append(pattern)
    read_plan, found = read(plan)
    assert ends(read_plan)[-1] == pytest.approx((0, 300), abs=CENTIMETRE_M)
    circle = next(stage for stage in read_plan.stages if stage.kind == "circle" and stage.altitude_m == 40)
    assert circle.rotation_deg == 90
    assert found == []


def test_a_loiter_of_a_time_is_flown_at_the_airspeed():
    """A commanded one is calibrated: 400 m above the sea, where home is, the true one is 1.0195 times as much."""
    for speed, expected in ((None, 15.0), (25, 25.4869)):
        change = [] if speed is None else [item(178, 0, speed)]
        plan, _ = read(wpl(*change, item(19, 300, 0, 0, east=800, north=0), waypoint(800, 900)))
        round_m = 2 * math.pi * LOITER_RADIUS_M
        circling = sum(leg.length_m for leg in nominal_legs(plan, ()) if leg.stage.kind == "circle")
        assert 300 * expected - 0.06 * round_m <= circling <= 300 * expected + round_m
        assert plan.stages[-1].airspeed_mps == (speed and pytest.approx(expected, abs=1e-4))


def test_a_loiter_to_an_altitude_lasts_as_long_as_the_climb():
    circle = item(31, 0, 60, east=900, north=0, altitude=350)
    plan, _ = read(wpl(waypoint(300, 0, altitude=50), circle, waypoint(2000, 0)))
    circling = sum(leg.length_m for leg in nominal_legs(plan, ()) if leg.stage.kind == "circle")
    climb_s = (350 - 50) / READER.climb_rate_mps
    assert circling >= 15 * climb_s - 0.06 * 2 * math.pi * 60
    assert circling <= 15 * climb_s + 2 * math.pi * 60


def test_a_far_take_off_ends_its_climb_at_its_altitude():
    plan, _ = read(
        wpl(item(22, north=3000, altitude=50), item(31, 0, 60, east=0, north=3150, altitude=50), waypoint(0, 4000))
    )
    circling = sum(leg.length_m for leg in nominal_legs(plan, ()) if leg.stage.kind == "circle")
    assert circling <= 2 * math.pi * 60


def test_altitudes_are_above_home_whatever_their_frame():
    items = [
        waypoint(300, 0, altitude=450, frame=0), waypoint(600, 0, altitude=70, frame=6),
        waypoint(900, 0, altitude=80, frame=10), item(21, east=1200, north=0, altitude=0),
    ]  # fmt: skip
    plan, found = read(wpl(*items))
    assert [stage.altitude_m for stage in plan.stages] == [50, 70, 80, 0]
    assert [f.code for f in found] == ["terrain"]


def test_commands_without_motion_are_kept_where_they_are_given():
    plan, _ = read(wpl(item(530, 0, 2), waypoint(300, 0), item(206, 25, 0, 1), waypoint(600, 300), item(530, 0, 2)))
    kept = [(stage.index, [command[:4] for command in stage.commands]) for stage in plan.stages if stage.commands]
    assert kept[0] == (1, [(530, 0, 2, 0)])
    assert (206, 25, 0, 1) in kept[1][1]
    assert sum(len(commands) for _, commands in kept) == 3


@pytest.mark.parametrize("first", [(16,), (18, 1, 0, 80)])
@pytest.mark.parametrize("then", [(31, 1, 80), (18, 2, 0, 80)])
def test_the_way_to_a_circle_is_flown_as_its_first_item_has_it(first, then):
    there = [item(*each, east=2000, north=0, altitude=up) for each, up in ((first, 150), (then, 40))]
    plan, _ = read(wpl(waypoint(0, 300), item(206, 25), there[0], item(178, 0, 14), there[1], waypoint(2000, 900)))
    legs = list(nominal_legs(plan, ()))
    k, way = next((k, leg.stage) for k, leg in enumerate(legs) if leg.stage.commands)
    assert (way.kind, way.altitude_m, way.airspeed_mps, way.commands[0][0]) == ("line", 150, None, 206)
    circle = [leg for leg in legs[k + 1 :] if leg.stage.kind == "circle"]
    level_m = sum(leg.distance_m for leg in circle if (leg.stage.altitude_m, leg.stage.airspeed_mps) == (150, None))
    assert level_m == pytest.approx(2 * math.pi * 80 * (first[0] == 18), abs=CENTIMETRE_M)
    assert (circle[-1].stage.altitude_m, circle[-1].stage.airspeed_mps is None) == (40, False)


@pytest.mark.parametrize("last", [item(21, east=600, north=300), waypoint(600, 300)])
def test_what_is_commanded_before_a_last_item_that_takes_no_way_is_kept(last):
    plan, _ = read(wpl(waypoint(300, 0), waypoint(600, 300), item(183, 5, 1500), last))
    assert 183 in [command[0] for command in plan.stages[-1].commands]


def test_what_a_fixed_wing_does_otherwise_is_a_finding():
    items = [waypoint(300, 0), item(178, 1, 20), item(82, east=600, north=300), item(20), waypoint(9, 9)]
    plan, found = read(qgc(*items, vehicleType=2))
    assert {f.code for f in found} == {"multirotor", "ground-speed", "spline", "not-flown"}
    assert ends(plan)[-1] == (0, 0)


# --- jumps ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [item(20), item(17, east=300, north=300)])
def test_what_a_jump_has_flown_before_the_end_is_not_left_out(ending):
    items = [waypoint(300, 0), item(177, 5, 1), waypoint(600, 600), ending, waypoint(0, 600), item(177, 3, 1)]
    plan, found = read(wpl(*items))
    assert "item 5" in {stage.item for stage in plan.stages}
    assert not found


def interpreted(items, laps):
    """The waypoints flown, by a program that walks over the items one at a time, as an autopilot does."""
    counts = {i: (laps - 1 if c[2] < 0 else c[2]) for i, (c, _) in enumerate(items) if c[0] == 177}
    flown, i = [], 0
    while i < len(items):
        command, _ = items[i]
        if command[0] == 177 and counts[i] > 0:
            counts[i] -= 1
            i = command[1] - 1
        else:
            if command[0] != 177:
                flown.append(i)
            i += 1
    return flown


@st.composite
def with_jumps(draw):
    count = draw(st.integers(3, 8))
    items = []
    for i in range(count):
        if i > 0 and draw(st.booleans()) and items[-1][0][0] != 177:
            items.append(item(177, draw(st.integers(1, i)), draw(st.sampled_from([-1, 0, 1, 2, 3]))))
        else:
            angle = 2.4 * i
            items.append(waypoint(400 * math.cos(angle), 400 * math.sin(angle)))
    return items


@given(items=with_jumps(), laps=st.integers(1, 4))
def test_jumps_are_taken_as_often_as_they_say(items, laps):
    reader = PlanReader(turn_radius_m=1.0, laps=laps)
    try:
        plan, _ = read(wpl(*items), reader)
    except InputError:  # a jump over jumps alone
        assume(False)
    flown = interpreted(items, laps)
    expected = [i + 1 for k, i in enumerate(flown) if k == 0 or i != flown[k - 1]]
    lines = [stage.line - 2 for stage in plan.stages]
    assert [line for k, line in enumerate(lines) if k == 0 or line != lines[k - 1]] == expected


def test_for_ever_is_so_many_laps_or_longer_than_the_battery_lasts():
    items = [waypoint(500, 0), waypoint(500, 500), waypoint(0, 500), item(177, 1, -1)]
    twice, found = read(wpl(*items), PlanReader(laps=2))
    assert found == []
    assert 3000 < length_m(twice) < 4500
    plan, (finding,) = read(wpl(*items), PlanReader(repeated_m=20_000))
    assert finding.code == "repeats"
    assert 20_000 <= length_m(plan) < 23_000


# --- what cannot be read ----------------------------------------------------------------------------------------------

GOOD = [waypoint(300, 0), waypoint(300, 300), item(20)]


def changed(line, column, text):
    """A WPL file with one field replaced; the line and the column from 1."""
    lines = wpl(*GOOD).split("\n")
    fields = lines[line - 1].split("\t")
    start = sum(len(each) + 1 for each in fields[: column - 1]) + 1
    fields[column - 1] = text
    lines[line - 1] = "\t".join(fields)
    return "\n".join(lines), (line, start)


@pytest.mark.parametrize(
    ("line", "column", "text", "words"),
    [
        (3, 9, "91", "a latitude of 91"),
        (3, 10, "-365", "a longitude of -365"),
        (4, 9, "inf", "not finite"),
        (4, 9, "nan", "no coordinates"),
        (4, 11, "1e7", "an altitude"),
        (4, 4, "92", "the command 92 (NAV_GUIDED_ENABLE) cannot be flown"),
        (4, 4, "17", "a loiter without end before other items"),
        (4, 4, "16.5", "no command"),
        (4, 3, "4", "the frame 4"),
        (4, 9, "52.0", "too far from home"),
        (2, 9, "99", "home at latitude 99"),
    ],
)
def test_a_fault_of_a_field_is_at_the_field(line, column, text, words):
    body, place = changed(line, column, text)
    fault = fault_of(body)
    assert words in fault.message
    assert fault.line == line
    if "command" not in words and "loiter" not in words:
        assert (fault.line, fault.column) == place


@pytest.mark.parametrize(
    ("items", "words"),
    [
        ([*GOOD[:2], item(177, 9, 1)], "a jump to item 9"),
        ([waypoint(300, 0), item(177, 3, -1), item(177, 2, -1)], "flies nothing"),
        ([*GOOD[:2], item(177, 1, 1e6)], f"more than {ITEMS_LIMIT} items are flown"),
        ([waypoint(300, 0), item(18, 1e9, east=0, north=900)], "turns"),
        ([waypoint(300, 0), item(178, 0, -7)], "a speed of -7"),
        ([item(18, 1, 0, 60, east=500, north=0), item(18, 1, 0, -60, east=520, north=0)], "no straight leads"),
        ([item(22)], "no item moves"),
    ],
)
def test_a_mission_that_cannot_be_flown_is_an_error(items, words):
    assert words in fault_of(wpl(*items)).message


def test_speeds_that_change_nothing_or_return_to_the_default():
    fast = [waypoint(300, 0), item(178, 0, 20), waypoint(300, 300), item(178, 0, -2), waypoint(0, 300)]
    plan, findings = read(wpl(*fast))
    speeds = {stage.item: stage.airspeed_mps for stage in plan.stages}
    assert (speeds["item 1"], speeds["item 5"]) == (None, None)
    assert speeds["item 3"] > 19
    assert findings == []
    again, _ = read_plan(Text("p", plan_text(plan)))
    assert [stage.airspeed_mps for stage in again.stages] == [stage.airspeed_mps for stage in plan.stages]
    for unchanged in ((0, 0), (1, 0), (1, -1), (1, -2)):
        plan, findings = read(wpl(waypoint(300, 0), item(178, *unchanged), waypoint(300, 300)))
        assert {stage.airspeed_mps for stage in plan.stages} == {None}
        assert findings == [], "no ground speed is taken"


def test_version_120_has_no_row_of_home():
    rows = [row(i, 16, east=x, north=y) for i, (x, y) in enumerate([(0, 0), (300, 0), (300, 300)])]
    plan, findings = read("".join(["QGC WPL 120\n", *rows]))
    assert [finding.code for finding in findings] == ["no-home"]
    assert plan.stages[-1].item == "item 2"


def test_four_parameters_and_a_coordinate():
    body = qgc(*GOOD)
    for each in body["mission"]["items"]:
        each["params"], each["coordinate"] = each["params"][:4], each["params"][4:]
    assert ends(read(body)[0]) == ends(read(qgc(*GOOD))[0])


def test_a_longitude_beyond_180_counts_on():
    home = (0.0, 179.999)
    body = HEAD.replace("47.0\t8.0", f"{home[0]}\t{home[1]}")
    place = "1\t0\t3\t16\t0\t0\t0\t0\t0.002\t{}\t50\t1\n"
    assert ends(read(body + place.format(180.004))[0]) == ends(read(body + place.format(-179.996))[0])


def test_heights_that_are_doubtful_and_a_jump_too_often():
    flat = [waypoint(300, 0, altitude=0), waypoint(300, 300, altitude=0)]
    assert [finding.code for finding in read(wpl(*flat))[1]] == ["no-altitude"]
    jump = [waypoint(300 * (i % 2), 300 * i) for i in range(20)]
    assert "as item 21 jumps back 400 times" in fault_of(wpl(*jump, item(177, 1, 400))).message
    often = fault_of(wpl(*jump, item(177, 19, 2), item(177, 1, -1)), PlanReader(laps=400))
    assert "as item 22 jumps back for ever" in often.message


NO_HOME = HEAD.replace("47.0\t8.0", "0\t0")


@pytest.mark.parametrize("format_", ["qgc", "wpl"])
def test_a_home_that_is_not_set_is_the_first_position(format_):
    items = [item(206, 20), waypoint(0, 0), waypoint(300, 0), waypoint(300, 300)]
    unset = qgc(*items, plannedHomePosition=[0, 0, 0]) if format_ == "qgc" else wpl(*items).replace(HEAD, NO_HOME)
    plan, (finding,) = read(unset)
    expected, _ = read(qgc(*items))
    assert plan.site.origin_deg == pytest.approx(expected.site.origin_deg, abs=1e-9)
    assert np.array(ends(plan)) == pytest.approx(np.array(ends(expected)), abs=1e-4)  # WPL has nine digits
    label = "mission.items[1]" if format_ == "qgc" else "item 2"
    assert (finding.severity, finding.code) == ("warning", "no-home")
    assert finding.message == f"home has no position: taken as that of {label}, its first item with one"


@pytest.mark.parametrize(("altitude_m", "low"), [(350, False), (50, True)])  # home is at 400
def test_an_altitude_above_the_sea_that_is_far_below_home(altitude_m, low):
    _, findings = read(qgc(waypoint(300, 0, frame=0, altitude=altitude_m), waypoint(300, 300, frame=0, altitude=350)))
    messages = ["mission.items[0]: 50 m above the sea, which is 350 m below home"]
    assert [finding.message for finding in findings] == (messages if low else [])


@pytest.mark.parametrize(
    ("body", "place", "words"),
    [
        (HEAD.replace("110", "130"), (1, 1), "QGC WPL 130 of this format is not known"),
        ("QGC WPL\n", (1, 1), "is not known"),
        ('<gpx version="1.1"/>', (1, 1), "is XML"),
        ("QGC WPL 110\n", (1, 1), "no home"),
        (wpl(*GOOD).replace("\t", ","), (2, 1), "1 column"),
        (HEAD + row(1, 16, east=1, north=1).replace("\t1\n", "\n"), (3, 1), "11 columns"),
        (HEAD.replace("47.0\t8.0", "0\t0"), (2, 18), "home has no position"),
    ],
)
def test_a_fault_of_the_file_is_named(body, place, words):
    fault = fault_of(body)
    assert words in fault.message
    assert (fault.line, fault.column) == place


def edited(path, value):
    """The good plan with one value of its JSON replaced, or removed by `...`."""
    plan = copy.deepcopy(qgc(*GOOD))
    node = plan
    for key in path[:-1]:
        node = node[key]
    if value is ...:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    return plan


FIRST = ("mission", "items", 0)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("fileType",), "Mission", "fileType: Mission is not known"),
        (("mission", "version"), 3, "mission.version: 3 is not known"),
        (("geoFence",), {"version": 1, "polygons": [{}]}, "geoFence.version: fences of another version"),
        (("geofence",), {"version": 2}, "geofence: is not known"),
        (("geoFence",), {"version": 2, "polygons": [], "circle": []}, "geoFence.circle: is not known"),
        (("geoFence",), {"version": 2, "circles": {}}, "geoFence.circles: another kind of value"),
        (("geoFence",), [], "geoFence: another kind of value"),
        (("geoFence",), {"version": 2, "polygons": [{"inclusion": 1, "polygon": [[47, 8], [47, 8.1], [47.1, 8]]}]},
         "geoFence.polygons[0].inclusion: another kind of value"),
        (("geoFence",), {"version": 2, "polygons": [{"inclusion": True, "polygon": [[8, 47], [8, 47.1], [8.1, 47]]}]},
         "a fence far from home"),
        (("geoFence",), {"version": 2, "polygons": [
            {"inclusion": True, "polygon": [[47, 8], [47.01, 8.01], [47, 8.01], [47.01, 8]]}]},
         "a fence that crosses itself"),
        (("mission",), ..., "mission: nothing here"),
        (("mission", "plannedHomePosition"), [1, 2], "mission.plannedHomePosition: no position"),
        ((*FIRST, "type"), "FancyItem", "mission.items[0].type: FancyItem is not known"),
        ((*FIRST, "params"), [0] * 6, "mission.items[0].params: 6 parameters"),
        ((*FIRST, "params", 4), None, "mission.items[0]: no coordinates"),
        ((*FIRST, "params", 4), "1", "mission.items[0].params[4]: another kind"),
        ((*FIRST,), {"type": "ComplexItem", "complexItemType": "survey", "version": 5}, "a survey without items"),
        ((*FIRST,), {"type": "ComplexItem", "complexItemType": "art", "version": 5}, "art is not known"),
        ((*FIRST,), {"type": "ComplexItem", "complexItemType": "survey", "version": 5, "TransectStyleComplexItem":
                     {"Items": [], "HoverAndCapture": True}}, "hovers for each picture"),
    ],
)  # fmt: skip
def test_a_fault_of_json_has_its_path(path, value, words):
    assert words in fault_of(edited(path, value)).message


# --- what other software writes ---------------------------------------------------------------------------------------


def test_commands_without_motion_are_mavlinks():
    dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
    enum = dialect.enums["MAV_CMD"]
    moving = ("NAV_", "DO_CHANGE", "DO_JUMP", "GUIDED_", "WAYPOINT_")
    kept = [enum[number].name.removeprefix("MAV_CMD_") for number in MOTIONLESS - {80}]  # 80, a region of interest
    assert not [name for name in kept if name.startswith(moving)]
    plan, found = read(wpl(item(223, 1), waypoint(300, 0), item(210, 1)))
    assert found == []
    assert [command[0] for stage in plan.stages for command in stage.commands] == [223, 210]


def test_rows_are_numbered_by_their_order_whatever_their_index():
    good = wpl(*GOOD)
    for index in ("7", "1"):
        assert ends(read(good.replace("\n2\t", f"\n{index}\t"))[0]) == ends(read(good)[0])
    assert ends(read(good.replace("\t0\t47.0", "\tNaN\t47.0"))[0]) == ends(read(good)[0])


def test_a_first_row_that_is_no_home_is_flown():
    body = "QGC WPL 110\n" + row(0, 22, east=0, north=0, altitude=30) + row(1, 16, east=400, north=0) + row(2, 20)
    plan, found = read(body)
    assert plan.site.origin_deg == pytest.approx(HOME, abs=1e-8)
    assert len(plan.stages) == len(read(wpl(waypoint(400, 0), item(20)))[0].stages)
    assert [finding.code for finding in found] == ["no-home", "no-home"]
    assert "row 0 is 22 (NAV_TAKEOFF) and no home" in found[0].message


CORNERS = [(-100, -100), (500, -100), (500, 500), (-100, 500)]
FENCE = "".join(row(i, 5001, 4, east=x, north=y) for i, (x, y) in enumerate(CORNERS))
FENCE += row(4, 5004, 20, east=450, north=450)


def test_fences_beside_a_mission_keep_it_in_and_out():
    plan, _ = read(wpl(*GOOD) + FENCE + row(9, 5100, east=0, north=0))
    inside, (outside,) = plan.site.airspace.boundary, plan.site.airspace.obstacles
    assert np.array(inside[0]) == pytest.approx(np.array(CORNERS), abs=CENTIMETRE_M)
    radii = [math.dist(corner, (450, 450)) for corner in outside.outline]
    assert radii == pytest.approx([20 / math.cos(math.pi / 32)] * 32, abs=CENTIMETRE_M)
    empty = qgc()
    empty["geoFence"] = {"version": 2, "circles": [{"inclusion": True, "circle": {"center": [47, 8], "radius": 90}}]}
    for alone in ("QGC WPL 110\n" + FENCE, "QGC WPL 110\n" + row(0, 5100, east=0, north=0), empty):
        fault = fault_of(alone)
        assert fault.message == "fences or places to rally, and no mission"
        assert "--inside" in fault.expected
    circle = {"inclusion": True, "circle": {"center": [47, 181], "radius": 0}}
    for radius_m, message in ((0, "a radius of 0 m"), (90, "47, 181")):
        circle["circle"]["radius"] = radius_m
        empty["geoFence"]["circles"] = [circle]
        rows = wpl(*GOOD) + f"9\t0\t3\t5003\t{radius_m}\t0\t0\t0\t47\t181\t0\t1\n"
        assert [message in fault_of(each).message for each in (empty, rows)] == [True, True]
    assert "without its last 1 corners" in fault_of(wpl(*GOOD) + FENCE[: FENCE.index("\n3\t") + 1]).message


def test_a_height_above_calculated_ground_is_one_above_ground():
    content = qgc(waypoint(300, 0), waypoint(300, 300, frame=0))
    content["mission"]["items"][1]["params"][6] = None
    content["mission"]["items"][1] |= {"Altitude": 80, "AltitudeMode": 3, "AMSLAltAboveTerrain": None}
    plan, (finding,) = read(content)
    assert [stage.altitude_m for stage in plan.stages][-1] == 80
    assert finding.code == "terrain"


# --- commands ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def mission(tmp_path):
    path = tmp_path / "square.waypoints"
    path.write_text(wpl(item(22, altitude=60), *(waypoint(*p) for p in ((400, 0), (400, 400), (0, 400))), item(20)))
    return path


def test_a_mission_is_simulated_with_turns_of_its_aircraft(eadp, mission):
    answer = eadp("simulate", mission, "--set", "step_s=0.05", "--format", "json")
    assert answer.code == 0
    assert "not flown" not in answer.err
    summary = json.loads(answer.out)
    radius = 15**2 / GRAVITY_MPS2  # a bank of 45°
    assert summary["distance_m"] == pytest.approx(1600 - 3 * (2 - math.pi / 2) * radius, rel=0.015)
    assert summary["reason"] == "final point reached"
    given = ("--set", "vehicle.airframe.max_bank_deg=20", "--set", "step_s=0.05", "--format", "json")
    slow = eadp("simulate", mission, *given)
    assert json.loads(slow.out)["distance_m"] < summary["distance_m"] - 20
    paper = eadp("simulate", mission, "--set", "vehicle.airframe.model=paper", "--set", "step_s=0.05")
    assert paper.code == 0
    assert "not flown: the airframe paper holds its own" in paper.err


def test_waypoints_too_close_are_a_finding_of_the_check(eadp, mission):
    assert eadp("plan", mission, "--check").code == 0
    answer = eadp("plan", mission, "--check", "--min-radius", "300")
    assert answer.code == 1
    assert "item 3 is 400.0 m from the one before, where turns of 300.0 m radius need 600.0 m" in answer.out
    findings = json.loads(eadp("plan", mission, "--check", "--min-radius", "300", "--format", "json").out)["findings"]
    assert {"too-close", "radius"} <= {finding["code"] for finding in findings}


def test_a_mission_that_is_bad_writes_nothing(eadp, tmp_path):
    bad = tmp_path / "bad.waypoints"
    bad.write_text(changed(3, 9, "91")[0])
    out = tmp_path / "out"
    assert refused(eadp("simulate", bad, "-o", out), f"{bad}:3:", "a latitude of 91")
    assert not out.exists()
