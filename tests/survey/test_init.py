"""`eadp init`: every preset flies as it is, and nothing is overwritten unasked."""

import json
import re

import pytest
from common import few
from common.answers import refused

from eadp.io.scenario import read_scenario
from eadp.io.text.streams import Text, read_text
from eadp.io.vehicle import read_vehicle
from eadp.models.performance import performance
from eadp.survey.init import PRESETS


@pytest.mark.slow
@pytest.mark.parametrize("preset", few(PRESETS, 1))
def test_a_preset_flies_as_it_is(eadp, tmp_path, preset):
    assert eadp("init", tmp_path / "new", "--preset", preset).code == 0
    folder = tmp_path / "new"
    flown = eadp(
        "simulate", folder / "survey.plan", "--scenario", folder / "scenario.yaml", "--planner", "static",
        "--set", "step_s=0.05", "--format", "json",
    )  # fmt: skip
    assert flown.code == 0
    summary = json.loads(flown.out)
    assert summary["completed"]
    assert summary["reserve_kept"]
    assert eadp("plan", folder / "survey.plan", "--check").code == 0
    vehicle = read_vehicle(read_text(str(folder / f"{preset}.yaml")))
    assert performance(vehicle.airframe, vehicle.battery).faults == ()


def test_every_commented_key_of_the_scenario_may_be_used(eadp, tmp_path):
    eadp("init", tmp_path)
    text = (tmp_path / "scenario.yaml").read_text()
    commented = re.findall(r"^ *# [a-z]+: .*$", text, re.MULTILINE)
    assert len(commented) >= 6
    for line in commented:
        if "profile" not in line:
            (tmp_path / "s.yaml").write_text(text.replace(line, line.replace("# ", "", 1)))
            read_scenario(str(tmp_path / "s.yaml"))


def test_nothing_is_overwritten_unasked(eadp, tmp_path):
    (tmp_path / "scenario.yaml").write_text("mine")
    assert refused(eadp("init", tmp_path), "scenario.yaml:1:1: error: exists already; expected a new file, or --force")
    assert [path.name for path in tmp_path.iterdir()] == ["scenario.yaml"]
    assert (tmp_path / "scenario.yaml").read_text() == "mine"
    assert eadp("init", tmp_path, "--force").code == 0
    assert len(list(tmp_path.iterdir())) == 5
    (tmp_path / "camera.yaml").rename(tmp_path / "mine")
    (tmp_path / "camera.yaml").symlink_to(tmp_path / "mine")
    (tmp_path / "mine").write_text("mine")
    assert "camera.yaml:1:1: error: is a link" in eadp("init", tmp_path, "--force").err
    assert (tmp_path / "mine").read_text() == "mine"


def test_bad_input(eadp, tmp_path):
    answer = eadp("init", tmp_path / "x", "--preset", "kite")
    assert refused(answer, "--preset:1:1: error: no such aircraft; expected one of data-sheet, foam-wing, mapper")
    (tmp_path / "file").write_text("")
    assert refused(eadp("init", tmp_path / "file"), "error: cannot be written")


@pytest.mark.parametrize("preset", ["foam-wing", "mapper", "small-wing"])
def test_constants_have_sources(preset, root):
    """Every constant that is not the pilot's choice has a comment: its source, or the word assumed."""
    text = read_text(str(root / f"vehicles/{preset}.yaml")).body
    choices = {"model", "airspeed_mps", "cruise_altitude_m", "max_bank_deg", "max_climb_rate_mps", "avionics_w"}
    assert read_vehicle(Text(preset, text)).name
    for line in re.findall(r"^  ([a-z_]+): .*$", text.split("battery:")[0], re.MULTILINE):
        if line not in choices:
            assert re.search(rf"^  {line}: .*#|# .*\n  (?:[a-z_]+: [0-9.]+\n  )?{line}:", text, re.MULTILINE), line
