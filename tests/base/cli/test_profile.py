"""`eadp profile` and `eadp schema` as they are called: exit codes, stdout and stderr, files written."""

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


PAGE = (ROOT / "docs" / "profile.md").read_text(encoding="utf-8")


def test_the_page_shows_what_comes_out(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```console\n\$ eadp ([^\n]*)\n(.*?)```", PAGE, re.DOTALL)
    assert blocks
    for command, shown in blocks:
        assert run(*shlex.split(command)) == (0, shown, "")


@pytest.mark.parametrize("ending", ["svg", "png"])
def test_plot(run: Run, tmp_path: Path, ending: str) -> None:
    picture = tmp_path / f"model.{ending}"
    assert run("profile", PEDNET, "--plot", str(picture), "--at", "fps=5") == (0, "fps=5: 7.81153 W\n", "")
    assert picture.read_bytes()[:5] in (b"<?xml", b"\x89PNG\r")
    code, out, err = run("profile", PEDNET, "--plot", str(tmp_path / "model.txt"), "-o", str(tmp_path / "m.yaml"))
    assert (code, out, list(tmp_path.iterdir())) == (2, "", [picture])
    assert "expected a name that ends in .svg or .png" in err


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
        (["-o", "no/such/folder/m.yaml"], "no/such/folder/m.yaml:1:1: error: cannot be written"),
        (["--names", "a,b"], "--names:1:1: error: 2 names for the parameters fps; expected 1 of them"),
        (["--at", "rate=5"], "--at:1:1: error: no parameter rate; expected fps=VALUE"),
        (["--clamp"], "--clamp:1:1: error: has no effect here; expected it with --at"),
        (["--longest", "3"], "--longest:1:1: error: has no effect here; expected it with --measure"),
    ],
)
def test_usage_that_is_refused(run: Run, options: list[str], start: str) -> None:
    code, out, err = run("profile", PEDNET, *options)
    assert (code, out) == (2, "")
    assert err.startswith(start)
