"""A flight again, of an autopilot's own log, made here byte by byte."""

import json
import math
from dataclasses import replace

import pytest

pytest.importorskip("pymavlink")
pytest.importorskip("pyulog")

from common.answers import refused
from common.autopilot_logs import dataflash, ulog
from common.plans import ORIGIN
from mavlink_vehicle import VOLTS, Autopilot, frames, is_near, recorded

from eadp.api.inputs import load_flight
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.exchange.writer import read_items
from eadp.live.mavlink import Codec
from eadp.live.messages import WANTED, LineMaker, values_of
from eadp.live.recorded import log_values
from eadp.live.telemetry import TelemetryReader

SCENARIO = "scenarios/survey.yaml"


@pytest.fixture(scope="module")
def lines():
    return recorded()[:60]


def px4(lines, items=()):
    """The flight as uORB topics, in the steps of the messages."""
    times = [round((100 + line["time_s"]) * 1e6) for line in lines]
    places = [[round(v * 1e7) / 1e7 for v in to_geodetic_deg(each["x_m"], each["y_m"], ORIGIN)] for each in lines]
    amps = [round(100 * line["power_w"] / VOLTS) / 100 for line in lines]
    charges = [round(each["soc"] * 100) / 100 for each in lines]
    battery = [(t, VOLTS, a, -1.0, soc) for t, a, soc in zip(times, amps, charges, strict=True)]
    motion = [(*each["velocity_mps"][::-1], math.radians(each["heading_deg"]), -25.0) for each in lines]
    end = times[-1] + 1_000_000
    return {
        "vehicle_status": ("QB", ("timestamp", "arming_state"), [(times[0] - 1, 2), (end, 1)]),
        "vehicle_land_detected": ("QB", ("timestamp", "landed"), [(times[0] - 1, 0), (end, 1)]),
        "mission_result": ("QH", ("timestamp", "seq_current"), list(zip(times, items, strict=False))),
        "battery_status": ("Qffff", ("timestamp", "voltage_v", "current_a", "discharged_mah", "remaining"), battery),
        "wind": ("Qff", ("timestamp", "windspeed_north", "windspeed_east"), [(times[0], 3.0, -1.0)]),
        "airspeed_validated": ("Qf", ("timestamp", "true_airspeed_m_s"), [(times[0], 12.0)]),
        "vehicle_local_position": (
            "Qffff",
            ("timestamp", "vx", "vy", "heading", "z"),
            [*((t, *each) for t, each in zip(times, motion, strict=True)), (end, 0.0, 0.0, 0.0, 0.0)],
        ),
        "vehicle_global_position": (
            "Qdd",
            ("timestamp", "lat", "lon"),
            [(t, *place) for t, place in zip([*times, end], [*places, places[-1]], strict=True)],
        ),
    }


def ardupilot(lines, items=()):
    """The same as messages of a DataFlash log."""
    found = px4(lines)
    battery = [(t, 0, v, a, c, round(100 * share)) for t, v, a, c, share in found["battery_status"][2]]
    motion = [(t, 0, n, e, math.degrees(h)) for t, n, e, h, _ in found["vehicle_local_position"][2]]
    place = [(t, round(lat * 1e7), round(lon * 1e7), 25.0) for t, lat, lon in found["vehicle_global_position"][2]]
    times = [row[0] for row in place]
    started = [row for t, item in zip(times, items, strict=False) for row in ((t, item, 16), (t, item + 50, 178))]
    return {
        "ARM": ("QB", ("TimeUS", "ArmState"), [(t, s == 2) for t, s in found["vehicle_status"][2]]),
        "MISE": ("QHH", ("TimeUS", "CNum", "CId"), started),
        "BAT": ("QBffff", ("TimeUS", "Inst", "Volt", "Curr", "CurrTot", "RemPct"), battery),
        "XKF2": ("QBff", ("TimeUS", "C", "VWN", "VWE"), [(times[0], 0, 3.0, -1.0), (times[0] + 1, 1, 9.0, 9.0)]),
        "ARSP": ("QBf", ("TimeUS", "I", "Airspeed"), [(times[0], 0, 12.0)]),
        "XKF1": ("QBfff", ("TimeUS", "C", "VN", "VE", "Yaw"), motion),
        "POS": ("QLLf", ("TimeUS", "Lat", "Lng", "RelHomeAlt"), place),
    }


FORMS = pytest.mark.parametrize(("form", "made"), [("ulog", px4), ("dataflash", ardupilot)])
WRITERS = {"ulog": ulog, "dataflash": dataflash}


def made_lines(inputs, values, items=None):
    maker = LineMaker(TelemetryReader("log", inputs.mission), inputs.mission, items, lambda _: None)
    return [reading.line for each in values for reading in maker.update(each)], maker


@pytest.mark.parametrize(("height_m", "true_mps"), [(None, 12.0), (550, 12.3239), (2000, 13.2394)])
def test_an_autopilots_airspeed_becomes_true_at_the_height_of_the_field(plan, height_m, true_mps):
    """√(ρ0/ρ) of the standard atmosphere; an airspeed that a log has as true stays."""
    inputs = load_flight(str(plan), scenario=SCENARIO)
    site = inputs.mission.plan.site._replace(ground_m=height_m)
    inputs = inputs.with_mission(plan=replace(inputs.mission.plan, site=site))
    row = {"armed": True, "active": True, "time_s": 1.0, "lat_deg": ORIGIN[0], "lon_deg": ORIGIN[1]}
    for said, expected in (({"airspeed_mps": 12.0}, true_mps), ({"true_mps": 12.0, "airspeed_mps": 9.0}, 12.0)):
        (line,), _ = made_lines(inputs, [said, row])
        assert line["airspeed_mps"] == pytest.approx(expected, abs=1e-3)


@FORMS
def test_lines_are_those_of_the_messages(plan, lines, tmp_path, form, made):
    inputs = load_flight(str(plan), scenario=SCENARIO)
    path = tmp_path / "flight.log"
    path.write_bytes(WRITERS[form](made(lines)))
    logged, maker = made_lines(inputs, log_values(str(path), form))
    said = [
        values_of(message.kind, message.fields)
        for _, parts in frames(lines, Autopilot(), ground_s=0)
        for frame in parts
        for message in Codec(WANTED).decoded(frame)
    ]
    expected, _ = made_lines(inputs, said)
    assert maker.landed
    assert len(logged) == len(expected) == len(lines)
    for one, other in zip(logged, expected, strict=True):
        # the log's clock may count from its first message
        assert is_near(one["time_s"] - logged[0]["time_s"], other["time_s"] - expected[0]["time_s"], 1e-3)
        for key in ("lat_deg", "lon_deg"):
            assert is_near(one[key], other[key], 1.5e-7)
        for key in ("power_w", "soc", "voltage_v", "altitude_m"):
            assert is_near(one[key], other[key], 1e-4)
        assert is_near((one["heading_deg"] - other["heading_deg"] + 180) % 360, 180, 0.01)
        assert all(is_near(a, b, 0.006) for a, b in zip(one["velocity_mps"], other["velocity_mps"], strict=True))
    assert logged[0]["wind_mps"] == (-1.0, 3.0)
    assert logged[0]["airspeed_mps"] == 12.0
    assert "wind_mps" not in logged[-1]  # old


@FORMS
def test_the_item_gives_the_stage(eadp, plan, lines, tmp_path, form, made):
    mission = tmp_path / "survey.waypoints"
    assert eadp("export", plan, "--to", "ardupilot", "-o", mission).code == 0
    items = read_items(f"{mission}.items.json", ("c1",))
    inputs, path = load_flight(str(plan), scenario=SCENARIO), tmp_path / "flight.log"
    path.write_bytes(WRITERS[form](made(lines, range(form == "dataflash", len(items)))))
    logged, _ = made_lines(inputs, log_values(str(path), form), items)
    for line, item in zip(logged, items, strict=False):
        assert line["stages_started"] == item.first


def test_another_number_of_items_in_a_log_is_another_mission(eadp, plan, lines, tmp_path):
    """It comes in flight: what was uploaded then is in no file of --items."""
    mission, path, log = (tmp_path / name for name in ("survey.waypoints", "flight.bin", "log.jsonl"))
    assert eadp("export", plan, "--to", "ardupilot", "-o", mission).code == 0
    items = f"{mission}.items.json"
    count, tables = len(read_items(items, ("c1",))), ardupilot(lines, [2] * len(lines))
    times = [row[0] for row in tables["POS"][2]]
    tables["CMD"] = ("QH", ("TimeUS", "CTot"), [(times[0] - 1, count + 1), (times[20] - 1, count - 3)])
    path.write_bytes(dataflash(tables))
    answer = eadp("replan", plan, "--scenario", SCENARIO, "--replay", path, "--items", items, "--log", log)
    told = [row for row in map(json.loads, log.read_text().splitlines()) if row["kind"] == "telemetry"]
    assert ["flies_mission" in row for row in told] == [k < 20 for k in range(len(told))]
    assert answer.err.count("another mission than that of --items") == 1


def test_a_log_without_a_state_is_of_a_flight(plan, lines, tmp_path):
    path = tmp_path / "flight.bin"
    path.write_bytes(dataflash({k: v for k, v in ardupilot(lines).items() if k != "ARM"}))
    inputs = load_flight(str(plan), scenario=SCENARIO)
    logged, maker = made_lines(inputs, log_values(str(path), "dataflash"))
    assert len(logged) == len(lines) + 1  # after the landing, too
    assert not maker.landed


def test_a_log_without_positions_or_that_is_damaged_is_an_error(eadp, plan, lines, tmp_path):
    tables = {key: table for key, table in ardupilot(lines).items() if key not in ("POS", "XKF1")}
    for name, body, fault in (
        ("flight.bin", dataflash(tables), "has no flight"),
        ("flight.ulg", b"ULog" + bytes(20), "cannot be read by pyulog"),
    ):
        (tmp_path / name).write_bytes(body)
        answer = eadp("replan", plan, "--scenario", SCENARIO, "--replay", tmp_path / name)
        assert refused(answer, f"{tmp_path / name}:1:1: error: {fault}")
