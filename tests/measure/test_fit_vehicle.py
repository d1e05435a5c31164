"""`eadp fit --vehicle`: logs of aeroplanes with closed forms, in three formats; what it writes flies."""

import importlib.util
import json
import math
import re
import sys

import numpy as np
import pytest
import yaml
from common import ROOT
from common.autopilot_logs import dataflash, ulog

from eadp import fit_vehicle
from eadp.io.text.streams import read_text
from eadp.io.vehicle import read_vehicle
from eadp.measure.autopilot_logs import Tables
from eadp.measure.formats import autopilot_motion
from eadp.measure.power_log import AIRSPEED, DENSITY
from eadp.models.vehicle import FixedWing, PowerCurve

WING = FixedWing(
    mass_kg=2.0, wing_area_m2=0.45, aspect_ratio=7.2, zero_lift_drag_coefficient=0.03, propulsive_efficiency=0.5,
    avionics_w=4.0, max_power_w=300.0,
)  # fmt: skip
BASE = """\
schema: eadp.vehicle/1
name: mine
airframe: {mass_kg: 2, wing_area_m2: 0.45, aspect_ratio: 7.2, avionics_w: 4, max_power_w: 300}
"""


SPEEDS = (12.0, 14.0, 16.0, 18.0)


def flight(speeds):
    """Time, power, airspeed, bank, climb of `WING`, 5 readings a second."""
    rows, t = [], 0.0
    for speed in speeds:
        for bank, climb, seconds in ((0, 0, 60), (35, 0, 60), (-35, 0, 30), (0, 2, 40)):
            for _ in range(5 * seconds):
                watts = WING.level_power_w(speed, math.radians(bank))
                rows.append((t, watts + climb * WING.weight_n / 0.5, speed, bank, climb))
                t += 0.2
    return rows


@pytest.fixture
def log(tmp_path):
    """Write a CSV of a flight at some airspeeds."""

    def write(speeds=SPEEDS, header="time_s,power_w,airspeed_mps,bank_deg,climb_mps", of=lambda row: row):
        path = tmp_path / "log.csv"
        path.write_text("\n".join([header, *(",".join(f"{v:.6g}" for v in of(row)) for row in flight(speeds))]) + "\n")
        return path

    return write


def test_the_wing_of_a_log(eadp, log, tmp_path):
    (tmp_path / "base.yaml").write_text(BASE)
    out = tmp_path / "mine.yaml"
    answer = eadp("fit", log(), "--vehicle", "--base", tmp_path / "base.yaml", "-o", out)
    assert answer.code == 0
    assert "not known" not in answer.out
    found = read_vehicle(read_text(str(out)))
    assert (found.name, found.airframe.model, found.airframe.mass_kg) == ("mine", PowerCurve.model, 2.0)
    assert found.airframe.propulsive_efficiency == pytest.approx(0.5, rel=0.01)
    for speed in (12.0, 15.0, 18.0):
        assert found.airframe.level_power_w(speed, 0.5) == pytest.approx(WING.level_power_w(speed, 0.5), rel=0.01)


def test_a_take_off_is_left_out_and_the_options_cut(eadp, log):
    plain = log((15.0,))
    steady = json.loads(eadp("fit", plain, "--vehicle", "--format", "json").out)
    rows = plain.read_text().splitlines()
    # 20 s at 300 W with a climb of 5 m/s before the flight
    start = [f"{t / 5:g},300,15,0,5" for t in range(100)]
    later = [f"{float(row.split(',')[0]) + 20:g},{row.partition(',')[2]}" for row in rows[1:]]
    plain.write_text("\n".join([rows[0], *start, *later]) + "\n")
    answer = eadp("fit", plain, "--vehicle", "--format", "json")
    assert answer.code == 0
    assert re.search(r"a take-off, to (2\d) s of the log, left out; --from 0 fits it too", answer.err)
    found = json.loads(answer.out)["power"]
    assert found["level_w"][0][1] == pytest.approx(steady["power"]["level_w"][0][1], rel=0.01)
    assert (found["polar"], len(found["level_w"])) == (False, 1)
    assert "take-off" not in eadp("fit", plain, "--vehicle", "--from", "0").err
    cut = json.loads(eadp("fit", plain, "--vehicle", "--from", "30", "--to", "130", "--format", "json").out)
    assert cut["power"]["windows"] < found["windows"] // 1.5


def test_without_a_base_it_is_a_power_curve(eadp, log, tmp_path):
    out = tmp_path / "mine.yaml"
    answer = eadp("fit", log(), "--vehicle", "-o", out, "--format", "json")
    assert fit_vehicle(log(), warn=lambda _: None).yaml == out.read_text()
    document = json.loads(answer.out)
    assert document["schema"] == "eadp.vehicle/1"
    assert document["airframe"] == yaml.safe_load(out.read_text())["airframe"]
    assert document["power"]["climb_w_per_mps"] == pytest.approx(WING.weight_n / 0.5, rel=0.01)
    curve = read_vehicle(read_text(str(out))).airframe
    assert isinstance(curve, PowerCurve)
    assert len(curve.points) == 5
    for speed, bank in ((12.0, 0.0), (15.0, 0.0), (16.0, 0.6)):
        assert curve.level_power_w(speed, bank) == pytest.approx(WING.level_power_w(speed, bank), rel=0.02)
    # its climb takes the same power
    assert curve.weight_n / curve.propulsive_efficiency == pytest.approx(WING.weight_n / 0.5, rel=0.01)
    assert any("mass and efficiency apart" in note for note in document["notes"])


@pytest.mark.parametrize(("speeds", "base"), [((15.0,), False), ((12.0, 14.0, 16.0, 18.0), False), ((15.0,), True)])
def test_a_log_without_turns_gets_the_rise_with_bank_of_physics(eadp, log, tmp_path, speeds, base):
    (tmp_path / "base.yaml").write_text(BASE)
    out, noise = tmp_path / "mine.yaml", np.random.default_rng(1)

    def of(row):
        watts = WING.level_power_w(row[2]) + row[4] * WING.weight_n / 0.5
        return row[0], watts + 15 * noise.standard_normal(), row[2], 0.0, row[4]

    given = ("--base", tmp_path / "base.yaml") if base else ()
    assert eadp("fit", log(speeds=speeds, of=of), "--vehicle", "-o", out, *given).code == 0
    curve = read_vehicle(read_text(str(out))).airframe
    assert isinstance(curve, PowerCurve)
    assert "# bank_w: assumed" in out.read_text()
    assert "±" not in re.search("bank_w: [0-9].*", out.read_text())[0]
    bank = math.radians(35)
    assert curve.level_power_w(15.0, bank) == pytest.approx(WING.level_power_w(15.0, bank), rel=0.05)


def test_what_it_writes_flies(eadp, log, tmp_path):
    vehicle, scenario = tmp_path / "mine.yaml", tmp_path / "s.yaml"
    eadp("fit", log(speeds=(15.0,)), "--vehicle", "-o", vehicle)
    assert len(read_vehicle(read_text(str(vehicle))).airframe.points) == 1
    scenario.write_text(f"schema: eadp.scenario/1\nvehicle: {vehicle}\nbattery: {{capacity_ah: 9}}\nstep_s: 0.05\n")
    given = ("--scenario", scenario, "--planner", "static", "--profile", "profiles/pednet-jetson-nano.yaml")
    flown = eadp("simulate", "plans/survey.plan", *given, "--set", "c1=-900", "--format", "json")
    assert flown.code == 0
    summary = json.loads(flown.out)
    mean_w = 3600 * summary["energy_wh"] / summary["duration_s"]
    assert WING.cruise_power_w < mean_w - 8 < WING.level_power_w(15.0, math.radians(35)) + 6


def test_altitude_stands_in_for_climb(eadp, log):
    header, height = "time_s,power_w,tas_mps,roll_rad,altitude_m", [0.0]

    def of(row):
        height[0] += 0.2 * row[4]
        return (*row[:3], math.radians(row[3]), height[0])

    document = json.loads(eadp("fit", log(header=header, of=of), "--vehicle", "--format", "json").out)
    assert document["power"]["climb_w_per_mps"] == pytest.approx(WING.weight_n / 0.5, rel=0.02)
    assert document["power"]["bank_w"] is not None


def test_what_is_missing_is_named(eadp, log):
    answer = eadp("fit", log(header="time_s,power_w,x,bank_deg,z"), "--vehicle")
    assert (answer.code, answer.out) == (2, "")
    assert "error: the log lacks airspeed (airspeed_mps; " in answer.err
    assert "climb (climb_mps" in answer.err
    assert "bank (" not in answer.err


def test_bad_bases(eadp, log, tmp_path):
    base = tmp_path / "base.yaml"
    base.write_text("schema: eadp.vehicle/1\nairframe: {model: paper}\n")
    answer = eadp("fit", log(), "--vehicle", "--base", base)
    assert answer.err.startswith("--base:1:1: error: an aircraft of model paper")
    base.write_text(BASE.replace("mass_kg: 2", "mass_kg: 5"))
    answer = eadp("fit", log(), "--vehicle", "--base", base)
    assert answer.code == 0
    assert "it would be 1.25; the mass of --base is not the log's" in answer.out


def test_a_battery_beside(eadp, tmp_path):
    path = tmp_path / "log.csv"
    rng, rows, used = np.random.default_rng(3), [], 0.0
    cells = np.interp(np.linspace(0, 1, 101), [0, 0.05, 0.2, 0.5, 0.8, 1], [3.2, 3.6, 3.73, 3.84, 4.02, 4.19])
    for t, watts, speed, bank, climb in flight((12.0, 14.0, 16.0, 18.0, 16.0, 14.0)):
        open_v = 4 * np.interp(1 - used / 2.2, np.linspace(0, 1, 101), cells)
        amps = float(np.roots([0.03, -open_v, watts]).min())
        used += amps * 0.2 / 3600
        rows.append((t, open_v - 0.03 * amps + 0.01 * rng.standard_normal(), amps, speed, bank, climb))
    lines = [",".join(f"{v:.6g}" for v in row) for row in rows]
    path.write_text("\n".join(["time_s,voltage_v,current_a,airspeed_mps,bank_deg,climb_mps", *lines]))
    assert 0.7 < used / 2.2 < 1
    out = tmp_path / "v.yaml"
    answer = eadp("fit", path, "--vehicle", "--battery", "--cells", "4", "--soc", "1", "-o", out, "--format", "json")
    assert answer.code == 0
    document = json.loads(answer.out)
    assert document["battery"]["capacity_ah"] == pytest.approx(2.2, rel=0.03)
    assert document["battery_std"]["capacity_ah"] < 0.22
    assert read_vehicle(read_text(str(out))).battery.capacity_ah == document["battery"]["capacity_ah"]


def test_bad_cells(eadp, log):
    assert eadp("fit", log(), "--battery", "--cells", "0").err.startswith("--cells:1:1: error: 0 cells")
    answer = eadp("fit", log(), "--battery", "--cells", "4", "--chemistry", "lifepo4")
    assert answer.err.startswith("--chemistry:1:1: error: no curve of its voltage is known")


@pytest.mark.parametrize("made", [ulog, dataflash])
def test_an_autopilots_log(eadp, tmp_path, made):
    pytest.importorskip("pyulog" if made is ulog else "pymavlink")
    rows = [(round(t * 1e6) + 1000, *row) for t, *row in flight((12.0, 15.0, 18.0))]
    currents = [(us, 16.0, watts / 16) for us, watts, *_ in rows]
    speeds = [(us, speed) for us, _, speed, *_ in rows]
    if made is ulog:
        halves = [(us, math.radians(bank) / 2) for us, _, _, bank, _ in rows]
        turns = [(us, math.cos(half), math.sin(half), 0, 0) for us, half in halves]
        tables = {
            "battery_status": ("Qff", ("timestamp", "voltage_v", "current_a"), currents),
            "airspeed_validated": ("Qf", ("timestamp", "true_airspeed_m_s"), speeds),
            "vehicle_attitude": ("Qffff", ("timestamp", *(f"q[{i}]" for i in range(4))), turns),
            "vehicle_local_position": ("Qff", ("timestamp", "x", "vz"), [(us, 0, -up) for us, *_, up in rows]),
        }
    else:
        climbs = [(us, k, 99 if k else -up) for us, *_, up in rows for k in (0, 1)]
        tables = {
            "BAT": ("Qff", ("TimeUS", "Volt", "Curr"), currents),
            "ARSP": ("Qf", ("TimeUS", "Airspeed"), speeds),
            "ATT": ("Qf", ("TimeUS", "Roll"), [(us, bank) for us, _, _, bank, _ in rows]),
            "XKF1": ("QBf", ("TimeUS", "C", "VD"), climbs),
        }
    path = tmp_path / "log"
    path.write_bytes(made(tables))
    power = json.loads(eadp("fit", path, "--vehicle", "--format", "json").out)["power"]
    assert power["level_w"][0][1] == pytest.approx(WING.level_power_w(12.0), rel=0.01)
    assert power["level_w"][-1][1] == pytest.approx(WING.level_power_w(18.0), rel=0.01)
    rise = WING.level_power_w(15.0, math.pi / 4) - WING.level_power_w(15.0)
    assert power["bank_w"] == pytest.approx(rise, rel=0.03)
    assert power["climb_w_per_mps"] == pytest.approx(WING.weight_n / 0.5, rel=0.02)


@pytest.mark.parametrize(
    "tables",
    [
        {"airspeed_validated": {"true_airspeed_m_s": 15.0, "calibrated_airspeed_m_s": 13.596}},
        {"airspeed_validated": {"calibrated_airspeed_m_s": 13.596}, "vehicle_global_position": {"alt": 2000.0}},
        {"airspeed_validated": {"true_airspeed_m_s": 15.0}, "vehicle_global_position": {"alt": 2000.0}},
        {"ARSP": {"Airspeed": 13.596}, "CTUN": {"E2T": 15 / 13.596}},
        {"CTUN": {"As": 13.596}, "POS": {"Alt": 2000.0}},
    ],
)
def test_airspeeds_of_logs_become_true(tables):
    times = np.arange(1e6, 5e6, 1e6)
    columns = {
        topic: {"timestamp": times} | {label: np.full(4, value) for label, value in row.items()}
        for topic, row in tables.items()
    }
    found = autopilot_motion(Tables(columns), times)
    assert found[AIRSPEED] == pytest.approx(np.full(4, 15.0), rel=1e-3)
    assert found[DENSITY] == pytest.approx(np.full(4, 1.0065), rel=1e-3)


@pytest.mark.slow
def test_the_independent_plant(eadp, tmp_path, monkeypatch):
    """Level power within 3 % between the airspeeds flown, bank within 10 %, in a light wind with gusts."""
    pytest.importorskip("jsbsim")
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    spec = importlib.util.spec_from_file_location("twin_of_fit", ROOT / "benchmarks/twin.py")
    twin = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(twin)
    twin.write_identification(tmp_path / "log.csv")
    answer = eadp(
        "fit", tmp_path / "log.csv", "--vehicle", "--base", "benchmarks/twin/owner.yaml", "-o", tmp_path / "v.yaml"
    )
    assert answer.code == 0
    wing = read_vehicle(read_text(str(tmp_path / "v.yaml"))).airframe
    # of the plant in still air: power at the battery
    for speed, watts in ((12.0, 44.849), (15.0, 69.493), (17.0, 93.875), (19.0, 125.353)):
        assert wing.level_power_w(speed) == pytest.approx(watts, rel=0.03)
    turn = wing.level_power_w(15.0, math.radians(40.41)) - wing.level_power_w(15.0)
    assert turn == pytest.approx(76.390 - 69.493, rel=0.10)
