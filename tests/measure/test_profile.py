"""`eadp profile` as it is called: exit codes, stdout and stderr, files written; and what it reads."""

import json
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from common import ROOT

from eadp.core.signals import average
from eadp.errors import InputError
from eadp.measure.measuring import Configuration
from eadp.measure.profile import read_profile
from eadp.models.profile import Profile

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
def test_power_as_json(eadp: Run, file: str) -> None:
    code, out, err = eadp("profile", file, "--at", "fps=5", "--at", "fps=2.1", "--format", "json")
    document = json.loads(out)
    assert (code, err) == (0, "")
    assert document == {
        "schema": "eadp.power/1",
        "values": [
            {"configuration": {"fps": 5}, "power_w": pytest.approx(7.811535), "extrapolated": False},
            {"configuration": {"fps": 2.1}, "power_w": pytest.approx(5.300767), "extrapolated": False},
        ],
    }


def test_outside_is_refused(eadp: Run, tmp_path: Path) -> None:
    model = tmp_path / "m.yaml"
    code, out, err = eadp("profile", PEDNET, "--at", "fps=5", "--at", "fps=12", "-o", str(model))
    assert (code, out) == (2, "")
    assert err.splitlines()[0] == (
        "--at:1:1: error: fps=12 is outside the measured 2 to 10; expected a value inside, or --clamp for the nearest"
    )
    assert list(tmp_path.iterdir()) == []


PAGE = (ROOT / "docs" / "profile.md").read_text(encoding="utf-8")


def test_the_page_shows_what_comes_out(eadp: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```console\n\$ eadp ([^\n]*)\n(.*?)```", PAGE, re.DOTALL)
    assert blocks
    for command, shown in blocks:
        assert eadp(*shlex.split(command)) == (0, shown, "")


@pytest.mark.parametrize("ending", ["svg", "png"])
def test_plot(eadp: Run, tmp_path: Path, ending: str) -> None:
    picture = tmp_path / f"model.{ending}"
    assert eadp("profile", PEDNET, "--plot", str(picture), "--at", "fps=5") == (0, "fps=5: 7.81153 W\n", "")
    assert picture.read_bytes()[:5] in (b"<?xml", b"\x89PNG\r")
    code, out, err = eadp("profile", PEDNET, "--plot", str(tmp_path / "model.txt"), "-o", str(tmp_path / "m.yaml"))
    assert (code, out, list(tmp_path.iterdir())) == (2, "", [picture])
    assert "expected a name that ends in .svg or .png" in err


def test_model_is_written_and_read_back(eadp: Run, tmp_path: Path) -> None:
    model = tmp_path / "m.yaml"
    code, out, _ = eadp("profile", PEDNET, "--interpolation", "pchip", "--names", "rate", "-o", str(model))
    assert code == 0
    assert out.startswith("5 configurations of rate; pchip between them\n")
    again = eadp("profile", str(model), "-o", "-")
    assert again == (0, model.read_text(encoding="utf-8"), "")
    smooth = json.loads(eadp("profile", str(model), "--at", "rate=9", "--format", "json")[1])
    straight = json.loads(eadp("profile", PEDNET, "--at", "fps=9", "--format", "json")[1])
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
def test_usage_that_is_refused(eadp: Run, options: list[str], start: str) -> None:
    code, out, err = eadp("profile", PEDNET, *options)
    assert (code, out) == (2, "")
    assert err.startswith(start)


# what is read: traces, several files, names


def points_of(profile: Profile) -> dict[tuple[float, ...], float]:
    return dict(zip(map(tuple, profile.configurations.tolist()), profile.power_w.tolist(), strict=True))


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., list[str]]:
    """Write files by their names and return their paths."""

    def write(**bodies: str) -> list[str]:
        paths = []
        for name, body in bodies.items():
            (tmp_path / f"{name}.csv").write_text(body, encoding="utf-8")
            paths.append(str(tmp_path / f"{name}.csv"))
        return paths

    return write


TRACE = "100,101,102\n3,1,0\n3.2,1,0\n"
STEADY = Configuration(("fps",), ("1/s",), (2.0,))
SOURCES = "slow.csv (power) + table.csv + timed.csv (power)"


def test_traces_with_what_they_were_measured_at(written: Callable[..., list[str]]) -> None:
    files = written(slow=TRACE, table="fps [1/s],power_w\n4,5\n", timed="time_s,power [mW]\n0,7000\n1,7200\n")
    fast = Configuration(("fps",), ("1/s",), (8.0,))
    profile, warnings = read_profile(files, configurations=[STEADY, fast])
    assert points_of(profile) == {(2,): pytest.approx(3.1), (4,): 5, (8,): pytest.approx(7.1)}
    assert (profile.names, profile.units, profile.source) == (("fps",), ("1/s",), SOURCES)
    assert warnings == [], "nothing about the times of a trace"


def test_two_traces_at_one_configuration_are_two_runs(written: Callable[..., list[str]]) -> None:
    files = written(a=TRACE, b="power_w\n3.4\n3.6\n", c=TRACE)
    other = Configuration(("fps",), ("1/s",), (4.0,))
    profile, _ = read_profile(files, configurations=[STEADY, STEADY, other])
    assert profile.standard_error_w[0] == average([[3, 3.2], [3.4, 3.6]]).standard_error


ASKED: dict[str, Any] = {"configurations": [STEADY]}
FPS_ROW, NO_POINTS = "fps,power_w\n2,5\n", "{schema: eadp.profile/1}"


@pytest.mark.parametrize(
    ("bodies", "options", "starts"),
    [
        ({"a": TRACE, "b": TRACE}, ASKED, "--config:1:1: error: 1 configurations for 2 files"),
        ({"a": TRACE}, ASKED, "a.csv:1:1: error: one configuration only"),
        ({"a": FPS_ROW, "b": "rate,power_w\n4,5\n"}, {}, "b.csv:1:1: error: measurements of rate; expected fps, as in"),
        ({"a": FPS_ROW, "b": NO_POINTS}, {}, "b.csv:1:1: error: a model among several files; expected measurements"),
        ({"a": NO_POINTS}, ASKED, "a.csv:1:1: error: a model needs no configuration"),
    ],
)
def test_several_files_that_are_refused(
    written: Callable[..., list[str]], bodies: dict[str, str], options: dict[str, Any], starts: str
) -> None:
    with pytest.raises(InputError) as caught:
        read_profile(written(**bodies), **options)
    (fault,) = caught.value.faults
    assert str(replace(fault, file=Path(fault.file).name)).startswith(starts)


@pytest.mark.parametrize(
    ("names", "fault"),
    [
        (["fps", "keysize"], "--names:1:1: error: 2 names for the parameters c; expected 1 of them"),
        (["a=b"], "--names:1:1: error: a=b is no name; expected a name"),
        (["fps", "fps"], "--names:1:1: error: a name stands twice in fps,fps; expected each once"),
    ],
)
def test_names_that_are_refused(written: Callable[..., list[str]], names: list[str], fault: str) -> None:
    with pytest.raises(InputError) as caught:
        read_profile(written(a="2,5\n4,7\n"), names)
    assert str(caught.value).startswith(fault)


def test_names_of_numbers_alone_and_of_flags(written: Callable[..., list[str]]) -> None:
    flags = "200,201,100\n2,32,5\n2,64,6\n4,32,7\n4,64,8"
    assert read_profile(written(a=flags), ["fps", "keysize"])[0].names == ("fps", "keysize")
    assert read_profile(written(a="2,5\n4,7\n"), ["fps"])[0].names == ("fps",)


# published data

REFERENCE = ROOT.parent / "shared" / "reference" / "profiles"


def reference(name: str) -> str:
    file = REFERENCE / name
    if not file.is_file():
        pytest.skip(f"the published data is not beside this checkout: {file}")
    return str(file)


TRACES = ("landing_trace_0.5fps.csv", "landing_trace_10fps.csv")


def test_published_traces_are_the_published_model() -> None:
    files = [reference(name) for name in TRACES]
    model, _ = read_profile([reference("landing_powprofiler_model.csv")], ["fps"])
    configurations = [Configuration(("fps",), ("",), (fps,)) for fps in (0.5, 10)]
    profile, warnings = read_profile(files, configurations=configurations)
    assert warnings == []
    for fps in (0.5, 10.0):  # printed to six digits
        assert points_of(profile)[(fps,)] == pytest.approx(points_of(model)[(fps,)], rel=5e-6)
    assert profile.samples.tolist() == [1272, 964]
    std_w = [np.genfromtxt(file, delimiter=",", skip_header=1)[:, 0].std(ddof=1) for file in files]
    assert profile.std_w == pytest.approx(std_w)
    assert np.all(profile.standard_error_w < 0.007)
