"""A package that adds to eadp, the one of docs/examples: installed beside it, found by its entry points, and flown."""

import json
import math
import shutil
import tomllib

import numpy as np
import pytest
from common import ROOT

from eadp.api.flight import simulate
from eadp.cli.main import main
from eadp.core import compiled
from eadp.core.flight import level
from eadp.errors import EadpError
from eadp.models.battery import Battery
from eadp.models.vehicle import FixedWing
from eadp.plug_ins import plug_in

PACKAGE = ROOT / "docs/examples/plug_in"
SURVEY, PROFILE = str(ROOT / "plans/survey.plan"), str(ROOT / "profiles/pednet-letter.yaml")
MEADOW = str(ROOT / "plans/meadow.geojson")
CORNERS = "corners\n55.37 10.43 0\n55.372 10.43 50\n55.372 10.435 50\n55.37 10.435 50\n"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder with what pip installs of the package: its modules, and what it says of itself."""
    folder = tmp_path_factory.mktemp("site")
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]
    for module in PACKAGE.glob("*.py"):
        shutil.copy(module, folder)
    about = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    lines = []
    for kind, names in project["entry-points"].items():
        lines += [f"[{kind}]", *(f"{name} = {value}" for name, value in names.items())]
    (about / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(autouse=True)
def installed(site, monkeypatch):
    monkeypatch.syspath_prepend(str(site))
    return site


def flown(**keys):
    return simulate(SURVEY, profile=PROFILE, overrides={"planner.name": "thrift", "time_limit_s": 60, **keys})


def test_a_planner_decides_by_its_own_settings():
    for full_soc in (1.0, 1.5):
        columns = flown(**{"planner.thrift.full_soc": full_soc, "planner.every_s": 5}).columns
        # c2 is from 2 to 10, decided each 5 s at the charge that the log has then
        decided = [8 * min(1.0, soc / full_soc) + 2 for soc in columns["soc"]]
        assert columns["c2"][-1] == pytest.approx(decided[-1], abs=0.05)
        assert len(set(columns["c2"])) in (12, 13)
        assert set(columns["c1"]) == {0.0}


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("planner.thrift.full_so=1", "unknown key planner.thrift.full_so; expected one of full_soc; did you mean"),
        ("planner.thrift.full_soc=much", "planner.thrift.full_soc cannot be 'much'; expected a number"),
        ("planner.estimator=1", "unknown key planner.estimator"),
        ("vehicle.airframe.aspect_ratio=wide", "vehicle.airframe.aspect_ratio cannot be 'wide'; expected a number"),
    ],
)
def test_its_settings_are_checked_as_those_of_eadp(setting, message, capsys):
    glider = ["--set", "vehicle.airframe.model=glider"] if setting.startswith("vehicle") else []
    words = ["simulate", SURVEY, "--profile", PROFILE, "--planner", "thrift", *glider, "--set", setting]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert message in error
    assert f"--set {setting.partition('=')[0]}:1:" in error


def test_without_the_package_its_names_are_unknown(capsys, installed, monkeypatch):
    monkeypatch.undo()
    assert main(["simulate", SURVEY, "--profile", PROFILE, "--planner", "thrift"]) == 2
    assert "unknown planner thrift; expected one of static, paper, joint" in capsys.readouterr().err
    assert main(["cover", MEADOW, "--swath", "30", "--pattern", "rows"]) == 2
    assert "--pattern:1:1: error: is no pattern; expected one of zamboni, dubins, auto" in capsys.readouterr().err


def test_a_package_that_cannot_be_imported_is_named(site, capsys, monkeypatch):
    (site / "eadp_others.py").rename(site / "hidden")
    monkeypatch.delitem(__import__("sys").modules, "eadp_others", raising=False)
    try:
        assert main(["export", SURVEY, "--to", "corners", "--origin", "55,10"]) == 2
    finally:
        (site / "hidden").rename(site / "eadp_others.py")
    assert "corners cannot be imported: eadp_others:corners_text of the entry points eadp.mission_writers" in (
        capsys.readouterr().err
    )


@pytest.mark.quick(1)
@pytest.mark.parametrize("fast", [True, False])
def test_an_airframe_flies_with_its_own_keys(fast, tmp_path):
    compiled.enable(fast)
    kind = plug_in("airframes", "glider")
    assert issubclass(kind, FixedWing)
    file = tmp_path / "glider.yaml"
    file.write_text("schema: eadp.vehicle/1\nairframe: {model: glider, airspeed_mps: 14}\n")
    flight = flown(vehicle=str(file))
    expected_w = kind(airspeed_mps=14.0).cruise_power_w
    assert expected_w < 0.82 * FixedWing(airspeed_mps=14.0).cruise_power_w
    computing_w = 9.75462  # of 10 frames a second, near which the planner stays for a minute
    assert flight.summary["power_w"]["min"] == pytest.approx(expected_w + computing_w, abs=0.2)


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ({"climb_rates_mps": lambda self, airspeed_mps: (1.0, 1.0)}, "has climb_rates_mps of its own"),
        ({"drag_n": lambda self, airspeed_mps, bank_rad=0.0: 9.0}, "has drag_n of its own"),
        (None, "inherits from neither FixedWing nor PowerCurve"),
    ],
)
def test_formulas_that_no_flight_asks_are_refused(own, message, monkeypatch):
    kind = object if own is None else type("Own", (plug_in("airframes", "glider"),), own)
    monkeypatch.setattr(__import__("eadp_others"), "Glider", kind)
    with pytest.raises(EadpError, match=message):
        flown(**{"vehicle.airframe.model": "glider"})


@pytest.mark.quick(1)
@pytest.mark.parametrize("fast", [False, True])
def test_cells_are_drained_and_forecast_by_their_own_law(fast):
    compiled.enable(fast)
    law, ohm, capacity_ah = plug_in("batteries", "sodium"), 0.1, 0.55
    cells = {"battery.chemistry": "sodium", "battery.cells": 4, "battery.capacity_ah": capacity_ah}
    held = {"planner.name": "static", "parameters.c1": -600.0, "parameters.c2": 6.0}
    flight = flown(**cells, **held, **{"battery.resistance_ohm": ohm, "time_limit_s": 1e4})
    columns = flight.columns
    soc, power_w = columns["soc"], columns["power_w"]
    volts = 4 * law(soc[:-1])
    # letter, Eq. 22, with the law's voltage
    amps = (volts - np.sqrt(volts**2 - 4 * ohm * power_w[1:])) / (2 * ohm)
    drawn_ah = np.sum(amps * np.diff(columns["time_s"])) / 3600
    assert soc[0] - soc[-1] == pytest.approx(drawn_ah / capacity_ah, rel=2e-3)
    straight = Battery(voltage_v=4 * law(1.0), voltage_empty_v=4 * law(0.0))
    assert np.max(np.abs(volts - straight.voltage_at(soc[:-1]))) > 0.8
    assert flight.summary["completed"]
    # what it forecasts before take-off is what is left
    assert flight.summary["soc_final"] == pytest.approx(flight.summary["energy_forecast"]["soc_end"], abs=0.01)


def test_the_charge_of_a_voltage_is_the_inverse_of_the_law():
    battery, soc = Battery(chemistry="sodium", cells=3), np.linspace(-0.0, 1.0, 77)
    assert battery.soc_at(battery.voltage_at(soc)) == pytest.approx(soc, abs=1e-12)
    assert battery.voltage_at(soc) == pytest.approx(3 * plug_in("batteries", "sodium")(soc), abs=1e-3)
    assert [level(float(each), battery.curve) for each in soc] == pytest.approx(
        (battery.voltage_at(soc) - battery.voltage_at(0)) / (battery.voltage_v - battery.voltage_at(0))
    )


def test_a_pattern_covers_a_field(capsys, tmp_path):
    words = ["cover", MEADOW, "--min-radius", "30", "--swath", "30", "--pattern", "rows"]
    assert main([*words, "--format", "json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["pattern"] == "rows"
    assert found["coverage"] > 0.999
    assert main([*words, "--home", "55.37,10.43", "--sorties", "2", "-o", str(tmp_path / "job")]) == 2
    assert "--pattern:1:1: error: covers a field in one flight" in capsys.readouterr().err


def test_a_mission_is_read_and_written(capsys, tmp_path):
    mission = tmp_path / "m.txt"
    mission.write_text(CORNERS)
    assert main(["simulate", str(mission)]) == 0
    assert "completed" in capsys.readouterr().out
    assert main(["export", str(mission), "--to", "corners"]) == 0
    written = capsys.readouterr().out
    assert written.startswith("corners\n55.37")
    assert len(written.splitlines()) > 4
    mission.write_text(CORNERS.replace("55.372", "north", 1))
    assert main(["plan", str(mission)]) == 2
    assert "m.txt:3:1: error: is no place; expected latitude longitude altitude" in capsys.readouterr().err


def test_a_command_and_a_file_of_results(capsys, tmp_path):
    plan = tmp_path / "lines.plan"
    plan.write_text("0.1; 90; x - 100\n100, 100\n0.1; 270; -y + 100\n0, 100\n")
    flight = simulate(str(plan), warn=lambda _: None)  # its turn is tight
    flight.write(tmp_path / "flight")
    head, *rows = (tmp_path / "flight/stages.csv").read_text().splitlines()
    assert head == "stage,energy_wh"
    assert [int(row.split(",")[0]) for row in rows] == [1, 2]
    assert sum(float(row.split(",")[1]) for row in rows) == pytest.approx(flight.summary["energy_wh"], rel=0.01)
    assert "stages.csv" in (tmp_path / "flight/files.json").read_text()
    assert main(["stages", str(plan)]) == 0
    assert capsys.readouterr().out.splitlines() == [head, *rows]


def test_a_log_is_fitted(capsys, tmp_path):
    log = tmp_path / "log.bars"
    log.write_text("bars\n" + "".join(f"{i / 10}|{36 + 2 * math.cos(math.pi * i / 100)}\n" for i in range(500)))
    assert main(["fit", str(log)]) == 0
    assert "period   20.00" in capsys.readouterr().out
    log.write_text("bars\n1|2\nx|3\n")
    assert main(["fit", str(log)]) == 2
    assert "is no row of two numbers; expected seconds|watts" in capsys.readouterr().err


def test_an_error_of_a_package_is_a_bug(capsys, monkeypatch):
    words = ["simulate", SURVEY, "--profile", PROFILE, "--planner", "thrift", "--set", "time_limit_s=1"]
    planner = plug_in("planners", "thrift")
    module = __import__(planner.__module__)
    exec("def divided(self, state):\n    return 1 / 0", vars(module))
    monkeypatch.setattr(planner, "update", module.divided)
    assert main(words) == 70
    assert "this is a bug, please report it: ZeroDivisionError" in capsys.readouterr().err
    monkeypatch.setattr(planner, "update", lambda self, state: (0.0, 10.0))
    assert main(words) == 2
    assert "ThriftPlanner.update returns (0.0, 10.0), and no Decision" in capsys.readouterr().err


def test_the_promised_names_are_these():
    from eadp import extend
    from eadp.measure import formats, power_log

    assert sorted(extend.__all__) == extend.__all__
    assert {"Planner", "Decision", "FlightState", "HeldForecast", "FixedWing", "CellVoltage"} < {*extend.__all__}
    assert all(hasattr(extend, name) for name in extend.__all__)
    # of logs, those of the room that reads them
    assert all(hasattr(formats, name) for name in ("LogFormat", "LogSource"))
    assert all(hasattr(power_log, name) for name in ("PowerLog", "Columns"))
