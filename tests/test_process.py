"""The process of the command: signals from its first line on, closed and full standard streams, plain terminals."""

import os
import subprocess
import sys

import pytest
from common import ROOT, few
from common.answers import hear_interrupts

INTERRUPTING = """
import os, signal, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.{signal})

sys.meta_path.insert(0, Finder())
sys.argv = ["eadp", "fit", "scenarios/example-power-log.csv", "-o", {out!r}]
from eadp.__main__ import run
run()
"""


@pytest.mark.parametrize(
    "module", few(["eadp.cli.main", "typer", "numpy", "pydantic", "scipy", "eadp.measure.power"], 1)
)
@pytest.mark.parametrize("signal", few(["SIGINT", "SIGTERM"], 1))
def test_an_interrupt_of_an_import_is_130(tmp_path, module, signal):
    code = INTERRUPTING.format(module=module, signal=signal, out=str(tmp_path / "model.yaml"))
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, check=False, preexec_fn=hear_interrupts
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"eadp: interrupted\n")
    assert os.listdir(tmp_path) == []


def shell(command, **environment):
    line = f"'{sys.executable}' -m eadp {command}"
    return subprocess.run(
        line, shell=True, cwd=ROOT, capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("schema scenario >&-", "eadp: error: standard output cannot be written: Bad file descriptor\n"),
        ("plan - <&-", "<stdin>:1:1: error: cannot be read: Bad file descriptor; expected a readable file\n"),
        ("schema scenario > /dev/full", "eadp: error: standard output cannot be written: No space left on device\n"),
        ("plan plans/survey.plan --format json > /dev/full", "No space left on device\n"),
        ("sweep scenarios/sweep-wind-battery.yaml --dry-run --format csv >&-", "Bad file descriptor\n"),
    ],
)
def test_a_stream_that_cannot_be_used_is_exit_2(command, message):
    if "/dev/full" in command and not os.path.exists("/dev/full"):
        pytest.skip("no full device")
    done = shell(command)
    assert done.returncode == 2
    assert done.stderr.endswith(message)
    assert done.stdout == ""


@pytest.mark.slow
def test_a_closed_stream_is_no_place_for_a_file(tmp_path):
    out = tmp_path / "model.yaml"
    assert shell(f"fit scenarios/example-power-log.csv --to 110 -o {out} <&- >&- 2>&-").returncode == 2
    assert out.read_text().startswith("schema: eadp.energy/1")


@pytest.mark.slow
def test_what_a_terminal_cannot_show_is_escaped(tmp_path):
    done = shell("fit scenarios/example-power-log.csv --to 110", PYTHONIOENCODING="ascii")
    assert done.returncode == 0
    assert r"R\xb2" in done.stdout
    done = shell(f"plan '{tmp_path}/nö.plan'", PYTHONIOENCODING="ascii")
    assert (done.returncode, r"n\xf6.plan" in done.stderr) == (2, True)
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text(
        f"schema: eadp.sweep/1\nplan: {ROOT}/plans/survey.plan\nscenario: {ROOT}/scenarios/survey.yaml\n"
        "grid: {vehicle.name: [ä]}\n",
        encoding="utf-8",
    )
    done = shell(
        f"sweep {sweep} --set time_limit_s=0.01 --set planner.name=static --jobs 1 --format csv",
        PYTHONIOENCODING="ascii",
    )
    assert r"\xe4" in done.stdout
