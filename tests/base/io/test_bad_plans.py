"""Plans that cannot be read, each with the exact error that it must give. tests/regenerate.py rewrites those."""

import re

import pytest
from common import ROOT

from eadp.errors import InputError
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text

BAD = ROOT / "tests" / "bad"
PLANS = sorted(path.stem for path in BAD.glob("*.plan"))
PLACE = re.compile(r"(?P<file>[^:]+):(?P<line>[1-9][0-9]*):(?P<column>[1-9][0-9]*): error: (?P<message>.+)")


def golden(name):
    return (BAD / f"{name}.expected").read_text(encoding="utf-8")


def test_there_are_plans_and_nothing_is_left_over():
    assert len(PLANS) > 60
    assert sorted(path.stem for path in BAD.glob("*.expected")) == PLANS


def test_each_error_is_the_golden_one_and_has_its_place_in_the_file(monkeypatch):
    monkeypatch.chdir(ROOT)
    for name in PLANS:
        with pytest.raises(InputError) as caught:
            read_plan(read_text(f"tests/bad/{name}.plan"))
        error = str(caught.value)
        assert f"{error}\n" == golden(name)
        lines = (BAD / f"{name}.plan").read_bytes().decode("utf-8-sig", errors="replace").split("\n")
        places = []
        for line in error.split("\n"):
            assert line.isprintable()
            if line.startswith("    "):  # the line itself, and a caret under the column
                continue
            match = PLACE.fullmatch(line)
            assert match, f"no FILE:LINE:COL: error: at the start of {line}"
            assert match["file"] == f"tests/bad/{name}.plan"
            place = int(match["line"]), int(match["column"])
            assert place[0] <= len(lines)
            assert place[1] <= len(lines[place[0] - 1]) + 1
            places.append(place)
        assert places == sorted(places), f"{name}: first by line"


@pytest.mark.parametrize("name", ["stage-of-two-parts", "constant-not-real", "not-utf-8"])
def test_the_command_says_it_on_stderr_alone(name, eadp):
    answer = eadp("plan", f"tests/bad/{name}.plan")
    assert (answer.code, answer.out, answer.err) == (2, "", golden(name))
