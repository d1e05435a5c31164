"""`eadp profile` and `eadp schema` as they are called: exit codes, stdout and stderr, files written."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
from common import ROOT

Run = Callable[..., tuple[int, str, str]]
PowerMeasurement = Callable[[str], str]

PEDNET = str(ROOT / "profiles" / "pednet-jetson-nano.csv")
PEDNET_MODEL = str(ROOT / "profiles" / "pednet-jetson-nano.yaml")


@pytest.fixture
def measured(tmp_path: Path) -> PowerMeasurement:
    """Write measurements to a file and return its path."""

    def write(body: str) -> str:
        file = tmp_path / "measured.csv"
        file.write_text(body, encoding="utf-8")
        return str(file)

    return write


@pytest.mark.parametrize("file", [PEDNET, PEDNET_MODEL])
def test_power_as_json(run: Run, file: str) -> None:
    code, out, err = run("profile", file, "--at", "fps=5", "--at", "fps=2.1", "--format", "json")
    document = json.loads(out)
    assert (code, err) == (0, "")
    assert document == {
        "schema": "eadp.power/1",
        "values": [
            {"configuration": {"fps": 5}, "power_w": pytest.approx(7.811535), "extrapolated": False},
            {"configuration": {"fps": 2.1}, "power_w": pytest.approx(5.300767), "extrapolated": False},
        ],
    }


def test_outside_is_refused(run: Run, tmp_path: Path) -> None:
    model = tmp_path / "m.yaml"
    code, out, err = run("profile", PEDNET, "--at", "fps=5", "--at", "fps=12", "-o", str(model))
    assert (code, out) == (2, "")
    assert err.splitlines()[0] == (
        "--at:1:1: error: fps=12 is outside the measured 2 to 10; expected a value inside, or --clamp for the nearest"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("at", "starts"),
    [
        ("5", ["--at:1:1: error: 5 is no name=value; expected fps=VALUE"]),
        ("rate=5", ["--at:1:1: error: no parameter rate; expected fps=VALUE"]),
        ("fps=5,fps=6", ["--at:1:7: error: fps stands twice"]),
        ("fps=nan", ["--at:1:1: error: fps is nan, not a finite number"]),
        ("fps=1e999,a=1", ["--at:1:1: error: fps is 1e999"]),
    ],
)
def test_configurations_that_are_refused(run: Run, at: str, starts: list[str]) -> None:
    code, out, err = run("profile", PEDNET, "--at", at)
    assert (code, out) == (2, "")
    found = [line for line in err.splitlines() if line.startswith("--at")]
    assert len(found) == len(starts)
    assert all(line.startswith(start) for line, start in zip(found, starts, strict=True))


def test_summary_as_text(run: Run, measured: PowerMeasurement) -> None:
    file = measured("# source: the bench\nfps [1/s],power_w\n2,5\n2,5.5\n10,9\n")
    code, out, _ = run("profile", file)
    assert code == 0
    assert out.splitlines() == [
        "2 configurations of fps; linear between them",
        "source: the bench",
        "fps [1/s]  power [W]  std. dev. [W]  std. error [W]  samples",
        "        2       5.25           0.35            0.25        2",
        "       10          9                                       1",
    ]


# the page about it

PAGE = (ROOT / "docs" / "profile.md").read_text(encoding="utf-8")


def test_the_page_shows_what_comes_out(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```console\n\$ eadp ([^\n]*)\n(.*?)```", PAGE, re.DOTALL)
    assert blocks
    for command, shown in blocks:
        assert run(*shlex.split(command)) == (0, shown, "")


def test_the_page_names_every_option(run: Run) -> None:
    options = set(re.findall(r"--[a-z-]+", run("profile", "--help")[1])) - {
        "--help",
        "--output",
        "--sysfs",
        "--quiet",
        "--faults",
    }
    assert options <= set(re.findall(r"--[a-z-]+", PAGE))


# several files


def test_traces_by_option(run: Run, tmp_path: Path) -> None:
    names = ["run_0.5fps.csv", "run_10fps.csv"]
    for name, power_w in zip(names, (3, 4), strict=True):
        (tmp_path / name).write_text(f"100,101,102\n{power_w},1,0\n{power_w},1,0\n", encoding="utf-8")
    files = [str(tmp_path / name) for name in names]
    by_option = run("profile", *files, "--config", "fps=0.5", "--config", "fps=10", "--format", "json")
    assert by_option[0] == 0
    assert [point["at"] for point in json.loads(by_option[1])["points"]] == [[0.5], [10]]


@pytest.mark.parametrize("ending", ["svg", "png"])
def test_plot(run: Run, tmp_path: Path, ending: str) -> None:
    picture = tmp_path / f"model.{ending}"
    assert run("profile", PEDNET, "--plot", str(picture), "--at", "fps=5") == (0, "fps=5: 7.81153 W\n", "")
    assert picture.read_bytes()[:5] in (b"<?xml", b"\x89PNG\r")
    code, out, err = run("profile", PEDNET, "--plot", str(tmp_path / "model.txt"), "-o", str(tmp_path / "m.yaml"))
    assert (code, out, list(tmp_path.iterdir())) == (2, "", [picture])
    assert "expected a name that ends in .svg or .png" in err


def test_model_as_json_is_a_model_itself(run: Run, tmp_path: Path) -> None:
    code, out, err = run("profile", PEDNET, "--format", "json")
    document = json.loads(out)
    assert (code, err, document["schema"]) == (0, "", "eadp.profile/1")
    told = {"at": [2], "power_w": 5.21438, "std_w": 0, "samples": 1, "standard_error_w": None}
    assert document["points"][0] == told
    (tmp_path / "m.json").write_text(out, encoding="utf-8")
    assert run("profile", str(tmp_path / "m.json"), "--format", "json") == (0, out, "")


def test_model_is_written_and_read_back(run: Run, tmp_path: Path) -> None:
    model = tmp_path / "m.yaml"
    code, out, _ = run("profile", PEDNET, "--interpolation", "pchip", "--names", "rate", "-o", str(model))
    assert code == 0
    assert out.startswith("5 configurations of rate; pchip between them\n")
    again = run("profile", str(model), "-o", "-")
    assert again == (0, model.read_text(encoding="utf-8"), "")
    smooth = json.loads(run("profile", str(model), "--at", "rate=9", "--format", "json")[1])
    straight = json.loads(run("profile", PEDNET, "--at", "fps=9", "--format", "json")[1])
    assert smooth["values"][0]["power_w"] > straight["values"][0]["power_w"] + 0.01


@pytest.mark.parametrize(
    ("options", "start"),
    [
        (["-o", "-", "--at", "fps=5"], "--output:1:1: error: standard output is taken"),
        (["-o", "-", "--format", "json"], "--output:1:1: error: standard output is taken"),
        (["-o", "no/such/folder/m.yaml"], "no/such/folder/m.yaml:1:1: error: cannot be written"),
        (["--names", "a,b"], "--names:1:1: error: 2 names for the parameters fps; expected 1 of them"),
        (["--names", ","], "--names:1:1: error: an empty text is no name"),
        (["--config", "fps=2"], "--config:1:1: error: 1 configurations for 0 files without"),
        (["--config", "fps=2,4"], "--config:1:1: error: 2 values of fps; expected one"),
        (["--longest", "3"], "--longest:1:1: error: has no effect here; expected it with --measure"),
    ],
)
def test_usage_that_is_refused(run: Run, options: list[str], start: str) -> None:
    code, out, err = run("profile", PEDNET, *options)
    assert (code, out) == (2, "")
    assert err.startswith(start)


# eadp schema
