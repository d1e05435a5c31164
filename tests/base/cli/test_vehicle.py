"""`eadp vehicle`: its text, its document, its picture, and its exit codes."""

import json
import re
from pathlib import Path

import pytest

WING = "vehicles/survey-wing.yaml"


def test_a_name_does_not_command_the_terminal(eadp, tmp_path):
    file = tmp_path / "wing.yaml"
    file.write_text('{schema: eadp.vehicle/1, name: "\\e[31mred\\u202e \\u009b2J"}')
    answer = eadp("vehicle", file)
    assert answer.out.splitlines()[0] == "\\u001b[31mred\\u202e \\u009b2J"
    assert json.loads(eadp("vehicle", file, "--format", "json").out)["name"] == "\x1b[31mred\u202e \x9b2J"
    simulated = eadp(
        "simulate", "plans/survey.plan", "--profile", "profiles/pednet-letter.yaml", "--set", f"vehicle={file}",
        "--set", "time_limit_s=1",
    )  # fmt: skip
    assert not {"\x1b", "\x9b", "\u202e"} & {*simulated.out, *simulated.err}


def test_a_range_of_airspeeds_has_energies_a_kilometre(eadp, tmp_path):
    wing = tmp_path / "wing.yaml"
    text = (Path("vehicles") / "foam-wing.yaml").read_text()
    wing.write_text(text.replace("[10.5, 15]", "[11, 15]"))
    answer = eadp("vehicle", wing, "--wind", "0,4,16")
    head, calm, _, strong = answer.out.splitlines()[-4:]
    assert re.findall(r"(\d+) m/s", head) == ["15", "14", "13", "12", "11"]
    found = json.loads(eadp("vehicle", wing, "--wind", "0,4", "--format", "json").out)["winds"]
    # P/v in calm air; with the wind and against it P/2 (1/(v + w) + 1/(v − w))
    for cell, one in zip(calm.split()[-5:], found[0]["speeds"], strict=True):
        assert float(cell) == pytest.approx(one["power_w"] / one["airspeed_mps"] / 3.6, abs=0.006)
    slow = found[1]["speeds"][-1]
    expected = slow["power_w"] / 7.2 * (1 / 15 + 1 / 7)
    assert slow["power_w"] * slow["endurance_s"] / 3.6 / (2 * slow["out_and_back_m"]) == pytest.approx(expected)
    assert strong.split()[-5:] == ["-"] * 5
    wing.write_text(re.sub("  airspeed_range_mps: .*\n", "", text))
    assert "out and back" not in eadp("vehicle", wing).out


def test_a_wind_above_every_airspeed_is_said(eadp):
    said = "cannot fly against a wind of {} m/s"
    text = eadp("vehicle", WING, "--wind", "4,60").out
    assert said.format(60) in text.splitlines()
    assert said.format(4) not in text


def test_json_and_picture(eadp, tmp_path):
    picture = tmp_path / "power.png"
    answer = eadp("vehicle", WING, "--wind", "4", "--computing", "10", "--format", "json", "-o", picture)
    document = json.loads(answer.out)
    assert document["schema"] == "eadp.performance/1"
    assert document["winds"][0]["held"]["power_w"] == pytest.approx(46.03, abs=0.01)
    assert document["faults"] == []
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_impossible_values_are_a_no(eadp, tmp_path):
    path = tmp_path / "v.yaml"
    path.write_text("schema: eadp.vehicle/1\nairframe: {airspeed_mps: 6, max_power_w: 9}\n")
    answer = eadp("vehicle", path)
    assert answer.code == 1
    assert "cannot fly so: an airspeed of 6 m/s is below the stall's" in answer.out
    assert "cannot fly so: level flight takes" in answer.out


def test_all_powers_of_the_text_count_the_computations(eadp):
    """The power level and that of the table's row as it flies are one, and 10 W more than without computations."""
    watts = {}
    for computing in ("0", "10"):
        out = eadp("vehicle", WING, "--wind", "0", "--computing", computing).out
        level, bank = map(float, re.search(r"m/s: ([0-9.]+) W level, ([0-9.]+) W at its greatest bank", out).groups())
        row = float(re.search(r"as it flies +[0-9.]+ +([0-9.]+)", out)[1])
        assert row == pytest.approx(level, abs=0.06)
        assert ("count 10 W of computations" in out) == (computing == "10")
        watts[computing] = level, bank
    assert watts["10"] == pytest.approx([each + 10 for each in watts["0"]], abs=0.02)


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        (("nosuch.yaml",), "nosuch.yaml:1:1"),
        (("scenarios/survey.yaml",), "scenarios/survey.yaml:4:1"),
        ((WING, "--wind", "5,x"), "--wind:1:1"),
        ((WING, "--computing", "nan"), "--computing:1:1"),
        ((WING, "--reserve", "1.5"), "--reserve:1:1"),
    ],
)
def test_bad_input(eadp, arguments, where):
    answer = eadp("vehicle", *arguments)
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.startswith(f"{where}: error: ")
