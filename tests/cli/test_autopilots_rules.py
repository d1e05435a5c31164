"""What an autopilot does on its own is the same at every door: export, its parameters, forecast and sorties."""

from __future__ import annotations

import json

import pytest
from common.answers import refused

HOME = "-33.9998197,149.9993505"
CORNERS = [[150.0, -34.0], [150.0032473, -34.0], [150.0032473, -33.9981969], [150.0, -33.9981969], [150.0, -34.0]]
WIND = "wind: {speed_mps: 4, from_deg: 200}\n"


@pytest.fixture
def place(eadp, tmp_path):
    """A folder with a field, its plan from home, a tower beside it on the way home, and scenarios by kind."""
    (tmp_path / "field.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [CORNERS]}))
    tower = {"type": "Point", "coordinates": [149.99965, -33.99955]}
    feature = {"type": "Feature", "properties": {"name": "avoid tower", "height": 90}, "geometry": tower}
    (tmp_path / "tower.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    for kind in ("none", "ardupilot", "px4"):
        stated = "" if kind == "none" else f"autopilot: {{kind: {kind}}}\n"
        (tmp_path / f"{kind}.yaml").write_text(f"schema: eadp.scenario/1\n{WIND}{stated}")
    made = ("--swath", "40", "--altitude", "60", "--home", HOME, "--scenario", tmp_path / "none.yaml")
    assert eadp("cover", tmp_path / "field.geojson", *made, "-o", tmp_path / "a.plan").code == 0
    return tmp_path


@pytest.mark.parametrize(
    ("to", "ending", "name"), [("ardupilot", ".param", "RTL_ALTITUDE,"), ("px4", ".params", "RTL_RETURN_ALT\t")]
)
def test_the_way_home_is_clear_of_an_obstacle_of_a_file_beside(eadp, place, to, ending, name):
    """Its top at 90 m, and 20 m of clearance; a lower altitude that is stated is not taken, with a warning."""
    wanted, out = place / f"a{ending}", place / "a.mission"
    given = ("--scenario", place / "none.yaml", "--parameters", wanted, "-o", out)
    assert eadp("export", place / "a.plan", "--to", to, *given).code == 0
    assert f"{name}60" in wanted.read_text()
    assert eadp("export", place / "a.plan", "--to", to, "--avoid", place / "tower.geojson", *given).code == 0
    assert f"{name}110" in wanted.read_text()
    low = eadp(
        "export",
        place / "a.plan",
        "--to",
        to,
        "--avoid",
        place / "tower.geojson",
        "--set",
        "home.altitude_m=70",
        *given,
    )
    assert "70 m is not clear of all that is below ways home: 110 m is taken" in low.err
    assert f"{name}110" in wanted.read_text()


def test_a_mission_is_for_the_autopilot_of_its_scenario(eadp, place):
    refused(eadp("export", place / "a.plan", "--to", "ardupilot", "--scenario", place / "px4.yaml"), "autopilot is px4")
    refused(eadp("export", place / "a.plan", "--to", "px4", "--scenario", place / "ardupilot.yaml"), "is ardupilot")


def test_px4s_own_return_counts_in_its_missions_and_what_is_stated_of_it_is_written(eadp, place):
    wanted = place / "a.params"
    given = (
        "--to",
        "px4",
        "--scenario",
        place / "none.yaml",
        "--set",
        "battery.capacity_ah=0.5",
        "--parameters",
        wanted,
    )
    assert "the autopilot turns back by itself unless" in eadp("export", place / "a.plan", *given).err
    off = eadp("export", place / "a.plan", *given, "--set", "autopilot.parameters.COM_FLTT_LOW_ACT=0")
    assert "turns back by itself" not in off.err
    assert "COM_FLTT_LOW_ACT\t0\t6" in wanted.read_text()


def test_sorties_say_that_they_do_not_count_it(eadp, place):
    given = ("--swath", "40", "--altitude", "60", "--home", HOME, "--sorties", "auto")
    for kind, said in (("px4", True), ("none", False)):
        answer = eadp(
            "cover", place / "field.geojson", *given, "--scenario", place / f"{kind}.yaml", "-o", place / kind
        )
        assert answer.code == 0
        assert ("the autopilot's own return is not counted in sorties" in answer.err) == said
