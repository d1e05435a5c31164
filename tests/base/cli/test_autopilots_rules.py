"""What an autopilot does on its own is the same at every door: export, its parameters, forecast and sorties."""

import json
import shutil
from pathlib import Path

import pytest
from common.answers import refused

from eadp import forecast
from eadp.cli.main import main

HOME = "-33.9998197,149.9993505"
CORNERS = [[150.0, -34.0], [150.0032473, -34.0], [150.0032473, -33.9981969], [150.0, -33.9981969], [150.0, -34.0]]
WIND = "wind: {speed_mps: 4, from_deg: 200}\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a field, its plan from home, a tower beside it on the way home, and scenarios by kind."""
    tmp_path = tmp_path_factory.mktemp("made")
    (tmp_path / "field.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [CORNERS]}))
    tower = {"type": "Point", "coordinates": [149.99965, -33.99955]}
    feature = {"type": "Feature", "properties": {"name": "avoid tower", "height": 90}, "geometry": tower}
    (tmp_path / "tower.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    for kind in ("none", "ardupilot", "px4"):
        stated = "" if kind == "none" else f"autopilot: {{kind: {kind}}}\n"
        (tmp_path / f"{kind}.yaml").write_text(f"schema: eadp.scenario/1\n{WIND}{stated}")
    given = ("--swath", "40", "--altitude", "60", "--home", HOME, "--scenario", tmp_path / "none.yaml")
    assert main(["cover", str(tmp_path / "field.geojson"), *map(str, given), "-o", str(tmp_path / "a.plan")]) == 0
    return tmp_path


@pytest.fixture
def place(made, tmp_path):
    """A copy of it."""
    return Path(shutil.copytree(made, tmp_path / "place"))


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("to", "ending", "name"), [("ardupilot", ".param", "RTL_ALTITUDE,"), ("px4", ".params", "RTL_RETURN_ALT\t")]
)
def test_the_way_home_is_clear_of_an_obstacle_of_a_file_beside(eadp, place, to, ending, name):
    """Its top at 90 m, and 20 m of clearance; a lower altitude that is stated is not taken, with a warning."""
    wanted, out = place / f"a{ending}", place / "a.mission"
    given = ("--scenario", place / "none.yaml", "--parameters", wanted, "-o", out)
    assert eadp("export", place / "a.plan", "--to", to, *given).code == 0
    assert f"{name}60" in wanted.read_text()
    beside = place / "beside.plan"
    beside.write_text(eadp("plan", place / "a.plan", "--avoid", place / "tower.geojson").out)
    assert eadp("export", beside, "--to", to, *given).code == 0
    assert f"{name}110" in wanted.read_text()
    low = eadp("export", beside, "--to", to, "--set", "home.altitude_m=70", *given)
    assert "70 m is not clear of all that is below ways home: 110 m is taken" in low.err
    assert f"{name}110" in wanted.read_text()


def test_a_mission_is_for_the_autopilot_of_its_scenario(eadp, place):
    refused(eadp("export", place / "a.plan", "--to", "ardupilot", "--scenario", place / "px4.yaml"), "autopilot is px4")
    refused(eadp("export", place / "a.plan", "--to", "px4", "--scenario", place / "ardupilot.yaml"), "is ardupilot")


def test_px4s_own_return_counts_in_its_missions_and_what_is_stated_of_it_is_written(eadp, place):
    wanted = place / "a.params"
    given = (
        "--to", "px4", "--scenario", place / "none.yaml", "--set", "battery.capacity_ah=0.5", "--parameters", wanted,
    )  # fmt: skip
    assert "the autopilot turns back by itself unless" in eadp("export", place / "a.plan", *given).err
    off = eadp("export", place / "a.plan", *given, "--set", "autopilot.parameters.COM_FLTT_LOW_ACT=0")
    assert "turns back by itself" not in off.err
    assert "COM_FLTT_LOW_ACT\t0\t6" in wanted.read_text()


SORTIES = ("--swath", "40", "--altitude", "60", "--home", HOME, "--sorties", "auto")


@pytest.mark.quick(1)
@pytest.mark.parametrize("stated", ["px4", "ardupilot"])
def test_sorties_end_above_what_makes_the_autopilot_turn_back_and_count_its_return(eadp, place, stated):
    """What each states is the forecast of its own file, with the circle at home, and keeps the reserve there."""
    scenario, out = place / f"{stated}.yaml", place / "job"
    scenario.write_text(f"{scenario.read_text()}battery: {{capacity_ah: 0.28}}\n")
    assert eadp("cover", place / "field.geojson", *SORTIES, "--scenario", scenario, "-o", out).code == 0
    document = json.loads((out / "sorties.json").read_text())
    assert document["count"] == (1 if stated == "ardupilot" else 2)  # without its own return, one would do for PX4, too
    for row in document["sorties"]:
        expected = forecast(out / row["plan"], out / "scenario.yaml")
        silent = forecast(out / row["plan"], out / "scenario.yaml", overrides={"autopilot.kind": None})
        assert expected["reserve_probability"] >= 0.95
        assert row["energy_wh"] == pytest.approx(expected["energy_wh"], rel=0.01)
        assert row["energy_wh"] > 1.05 * silent["energy_wh"]
        to = "ardupilot" if stated == "ardupilot" else "px4"
        written = eadp("export", out / row["plan"], "--to", to, "--scenario", out / "scenario.yaml", "-o", out / "m")
        assert f", {expected['energy_wh']:.2f} Wh" in written.err
        assert ("turns back by itself unless" in written.err) == (to == "px4")
