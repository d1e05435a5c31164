"""Lines of telemetry: read strictly, one warning for each invalid line, with its location."""

import io
import json
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.io.plan.sources import PlanReader
from eadp.io.text.streams import Text
from eadp.live.telemetry import LINE_LIMIT_BYTES, TelemetryLine, TelemetryReader, numbered_lines
from eadp.models.battery import Battery
from eadp.models.computing import join_profile
from eadp.models.vehicle import FixedWing
from eadp.models.world import Mission
from eadp.planning.base import Mode

OF_KEY = {"x_m": "position_m"}
GOOD = {"time_s": 1.0, "x_m": 2.0, "y_m": 3, "power_w": 36.5, "soc": 0.5}


def read(raw, number=7):
    raw = raw if isinstance(raw, bytes) else raw.encode()
    sample, _, warnings, _ = TelemetryReader("<stdin>").read(number, raw)
    return sample, [str(warning) for warning in warnings]


def test_a_line():
    sample, warnings = read(json.dumps(GOOD) + "\r\n")
    assert warnings == []
    assert sample[:4] == (1.0, (2.0, 3.0), 36.5, 0.5)
    assert sample[4:] == (None, None, None, None, {}, None, (), None, None, None, Mode())


def test_all_keys():
    more = {"stage": 2, "wind_mps": [0, 5], "velocity_mps": [1.5, -2], "heading_deg": 450, "parameters": {"c1": -5}}
    sample, warnings = read(json.dumps({**GOOD, **more, "power_w": None}))
    assert warnings == []
    assert sample.power_w is None
    assert (sample.stage, sample.wind_mps, sample.velocity_mps, sample.parameters) == (2, (0, 5), (1.5, -2), {"c1": -5})
    assert sample.heading_rad == pytest.approx(0.0)


@pytest.mark.parametrize("key", ["x_m", "power_w", "soc", "stage", "wind_mps", "stages_started"])
def test_any_value_but_the_time_may_be_null(key):
    sample, warnings = read(json.dumps({**GOOD, key: None}))
    assert warnings == []
    assert getattr(sample, OF_KEY.get(key, key)) is None
    assert (sample.position_m is None) == (key == "x_m")


@pytest.mark.parametrize("given", [{"kind": 5}, {"kind": "px4", "RTL_TYPE": "ardupilot"}, {"RTL_TYPE": None}])
def test_an_autopilot_has_a_kind_and_numbers(given):
    sample, warnings = read(json.dumps({**GOOD, "autopilot": given}))
    assert sample.mode.autopilot is None
    assert ["autopilot cannot be" in warning for warning in warnings] == [True]
    valid = read(json.dumps({**GOOD, "autopilot": {"kind": "px4", "RTL_TYPE": 1}}))[0].mode.autopilot
    assert (valid.kind, valid.parameters) == ("px4", {"RTL_TYPE": 1})


def test_missing_keys_give_one_warning_and_count_as_null():
    reader = TelemetryReader("log.jsonl")
    raw = json.dumps({"time_s": 1.0, "power_w": 36.5}).encode()
    sample, _, warnings, _ = reader.read(1, raw)
    assert sample[:4] == (1.0, None, 36.5, None)
    assert [str(warning) for warning in warnings] == [
        "log.jsonl:1:1: warning: x_m, y_m, soc are missing; expected the keys time_s, x_m, y_m, power_w, soc"
    ]
    assert reader.read(2, raw)[2] == []


def test_latitude_longitude_and_the_charge_drawn_stand_for_position_and_charge():
    origin, place = (55.37, 10.43), to_geodetic_deg(120.0, -40.0, (55.37, 10.43))
    plan = PlanReader()(Text("p", f"%: origin {origin[0]} {origin[1]}\n0.1; 90; x\n0, 300\n"))[0]
    battery = Battery(capacity_ah=4.0, soc=0.9)
    reader = TelemetryReader("log.jsonl", Mission(plan, join_profile(plan, None), battery, FixedWing(), ()))
    line = {"time_s": 1.0, "lat_deg": place[0], "lon_deg": place[1], "power_w": 36.5, "current_consumed_ah": 1.0}
    sample, _, warnings, _ = reader.read(1, json.dumps({**line, "airspeed_mps": 16}).encode())
    assert warnings == []
    assert sample.position_m == pytest.approx((120.0, -40.0), abs=1e-3)
    assert (sample.soc, sample.airspeed_mps) == (pytest.approx(0.9 - 1.0 / 4.0), 16)
    # what they stand for has precedence
    sample, _, _, _ = reader.read(2, json.dumps({**line, **GOOD}).encode())
    assert sample[:4] == (1.0, (2.0, 3.0), 36.5, 0.5)
    far, _, warnings, _ = reader.read(3, json.dumps({**line, "lat_deg": 57.5}).encode())
    assert far.position_m is None
    assert "too far from the plan's origin" in str(warnings[0])
    assert reader.read(4, json.dumps({**line, "lat_deg": 57.5}).encode())[2] == []
    wrong, _, warnings, _ = reader.read(5, json.dumps({**line, "lat_deg": 91, "current_consumed_ah": -1}).encode())
    assert (wrong.position_m, wrong.soc) == (None, None)
    assert len(warnings) == 2


@pytest.mark.parametrize(
    ("key", "value", "message"),  # as in km/h and mAh
    [
        ("velocity_mps", [54, 0], "velocity_mps is 54 m/s; expected at most 37.5 m/s: 2.5 times the airspeed"),
        ("wind_mps", [0, -38], "wind_mps is 38 m/s; expected at most 37.5 m/s: 2.5 times the airspeed"),
        ("current_consumed_ah", 340, "current_consumed_ah is 340 Ah; expected at most 8 Ah: 2 times the battery's"),
    ],
)
def test_what_the_aircraft_cannot_have_counts_as_null(key, value, message):
    plan = PlanReader()(Text("p", "0.1; 90; x\n0, 300\n"))[0]
    reader = TelemetryReader("log", Mission(plan, join_profile(plan, None), Battery(capacity_ah=4.0), FixedWing(), ()))
    line = {"time_s": 1.0, "x_m": 2.0, "y_m": 3.0, "power_w": 36.5}
    sample, _, (warning,), _ = reader.read(1, json.dumps({**line, key: value}).encode())
    assert f"warning: {message}" in str(warning)
    assert (sample.velocity_mps, sample.wind_mps, sample.soc) == (None, None, None)
    faster = replace(plan, stages=tuple(replace(stage, airspeed_mps=25.0) for stage in plan.stages))
    battery = Battery(capacity_ah=400.0)
    fast = TelemetryReader("log", Mission(faster, join_profile(plan, None), battery, FixedWing(), ()))
    assert fast.read(1, json.dumps({**line, "soc": 1, key: value}).encode())[2] == []


def test_without_an_origin_there_are_no_latitudes():
    sample, warnings = read(json.dumps({"time_s": 1.0, "lat_deg": 55.0, "lon_deg": 10.0, "power_w": 36.5, "soc": 1}))
    assert sample.position_m is None
    assert ["the plan has no origin" in warning for warning in warnings] == [True]


HEAD = "<stdin>:7:"
MISSING = "are missing; expected the keys time_s, x_m, y_m, power_w, soc"


@pytest.mark.parametrize(
    ("raw", "warning"),
    [
        ("", "1: warning: the line is blank; expected a JSON object"),
        ("[1, 2]", '1: warning: is no JSON object; expected an object such as {"time_s": 0, …}'),
        ('{"time_s": 1', "13: warning: is not JSON: expecting ',' delimiter"),
        (b'{"a\xff": 1}', "4: warning: is not UTF-8 text: byte 0xff; expected UTF-8 text"),
        ("{}", f"1: warning: time_s, x_m, y_m, power_w, soc {MISSING}"),
        ('{"time_s": 1, "time_s": 2}', "15: warning: the key time_s stands twice; expected each key once"),
        ('{"time_s": NaN}', "12: warning: time_s cannot be NaN; expected a time in seconds, of any clock that rises"),
        ('{"time_s": 3}', f"1: warning: x_m, y_m, power_w, soc {MISSING}"),
    ],
)
def test_what_is_no_line_of_telemetry(raw, warning):
    assert read(raw) == (None, [HEAD + warning])


@pytest.mark.parametrize(
    ("key", "value", "shown"),
    [
        ("soc", "1.5", "1.5; expected a state of charge, 0 to 1"),
        ("power_w", "NaN", "NaN; expected a power in watts, or null where the sensor has no reading"),
        ("time_s", "null", "null; expected a time in seconds, of any clock that rises"),
        ("x_m", '"2"', '"2"; expected a position in metres, east'),
        ("x_m", "1e300", "1e+300; expected a position in metres, east"),
        ("stage", "0", "0; expected the stage being flown, a whole number from 1"),
        ("wind_mps", "[1, 2, 3]", "[1.0, 2.0, 3.0]; expected [x, y]: the vector that the wind blows towards"),
        ("parameters", '{"c1": "a"}', '{"c1": "a"}; expected parameters in force by name'),
    ],
)
def test_an_invalid_value_costs_that_value_alone(key, value, shown):
    raw = json.dumps({name: inner for name, inner in GOOD.items() if name != key})[:-1] + f', "{key}": {value}}}'
    sample, document, warnings, _ = TelemetryReader("<stdin>").read(7, raw.encode())
    whole, _ = read(json.dumps(GOOD))
    rest = {"parameters": {}} if key == "parameters" else {OF_KEY.get(key, key): None}
    assert sample == (None if key == "time_s" else whole._replace(**rest))
    assert document[key] is None
    assert len(warnings) == 1
    assert str(warnings[0]).startswith(f"{HEAD}{raw.rindex(value) + 1}: warning: {key} cannot be {shown}")


def test_unknown_keys_give_one_warning_and_are_ignored():
    reader = TelemetryReader("log.jsonl")
    raw = json.dumps({**GOOD, "altitude_x": 30, "mode": "AUTO"}).encode()
    sample, _, warnings, _ = reader.read(1, raw)
    assert sample is not None
    assert [str(warning).partition("; expected")[0] for warning in warnings] == [
        "log.jsonl:1:82: warning: unknown key altitude_x; ignored here and from now on",
        "log.jsonl:1:94: warning: unknown key mode; ignored here and from now on",
    ]
    assert reader.read(2, raw)[2] == []


def test_a_byte_order_mark_stands_before_the_first_line_alone():
    raw = b"\xef\xbb\xbf" + json.dumps(GOOD).encode()
    assert read(raw, number=1)[0] is not None
    assert read(raw, number=2)[0] is None


def test_lines_of_a_stream_and_one_that_is_too_long():
    long = b" " * (3 * LINE_LIMIT_BYTES) + b"\n"
    lines = list(numbered_lines(io.BytesIO(b"a\n" + long + b"\nb"), "x"))
    assert [number for number, _ in lines] == [1, 2, 3, 4]
    assert [raw for _, raw in lines[::2]] == [b"a\n", b"\n"]
    assert lines[3][1] == b"b"
    assert read(lines[1][1]) == (None, [f"{HEAD}1: warning: the line is too long; expected at most 65536 bytes"])


def test_the_schema_names_what_is_required():
    schema = TelemetryLine.model_json_schema()
    assert schema["required"] == ["time_s"]
    more = "lat_deg lon_deg current_consumed_ah airspeed_mps altitude_m voltage_v stage stages_started flies_mission "
    more += "returns_home autopilot wind_mps velocity_mps heading_deg parameters"
    assert {*GOOD, *more.split()} == set(schema["properties"])


@given(st.binary(max_size=200) | st.text().map(lambda text: text.encode("utf-8", "surrogatepass")))
def test_no_bytes_crash_it(raw):
    sample, warnings = read(raw)
    assert sample is None
    assert len(warnings) >= 1
    assert all("\n" not in warning for warning in warnings)


@pytest.mark.parametrize(
    ("heading_deg", "nose"),
    [(0, (0, 1)), (90, (1, 0)), (180, (0, -1)), (270, (-1, 0)), (45, (0.5**0.5, 0.5**0.5)), (-90, (-1, 0))],
)
def test_a_heading_is_a_compass_bearing(heading_deg, nose):
    """Worked by hand: x is east and y north, so 90 points along x."""
    sample, warnings = read(json.dumps({**GOOD, "heading_deg": heading_deg}))
    assert warnings == []
    assert (math.cos(sample.heading_rad), math.sin(sample.heading_rad)) == pytest.approx(nose, abs=1e-12)
