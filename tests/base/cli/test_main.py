"""The frame of the command line: exit codes, start-up, help whose examples work."""

import os
import re
import shlex
import subprocess
import sys

import pytest
from cli_page import page
from common.answers import refused

from eadp.cli import main as cli
from eadp.cli.main import COMMANDS


def test_help_lists_the_commands_in_groups(eadp):
    out = eadp("--help").out
    assert re.findall(r"^([A-Z][a-z ]+):$", out, re.MULTILINE)[1:] == ["Your aircraft", "A plan", "Its flight", "More"]
    assert all(len(re.findall(rf"^  {name} ", out, re.MULTILINE)) == 1 for name in COMMANDS)


def test_the_page_of_the_command_line_is_current(root, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    current = "python tests/support/cli_page.py > docs/cli.md"
    assert (root / "docs/cli.md").read_text(encoding="utf-8") == page(), current


@pytest.mark.parametrize(("words", "found"), [("eadp sim", "simulate"), ("eadp vehicle --wi", "--wind")])
def test_shells_complete_commands_and_options(words, found):
    environment = os.environ | {"_EADP_COMPLETE": "complete_bash", "COMP_WORDS": words}
    environment["COMP_CWORD"] = str(len(words.split()) - 1)
    command = [sys.executable, "-m", "eadp"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert found in done.stdout.split()
    assert done.stderr == ""


def test_version(eadp):
    assert re.fullmatch(r"eadp \d+\.\d+\.\d+\n", eadp("--version").out)


@pytest.mark.parametrize(
    "name",  # that of fit is a block of the README
    [pytest.param(name, marks=pytest.mark.slow) if name in ("fit", "replan") else name for name in COMMANDS],
)
def test_help_starts_with_an_example_that_works(eadp, tmp_path, name):
    out = eadp(name, "--help").out
    body = out.split("\n\n", 1)[1].lstrip()
    assert body.startswith("Example: eadp ")
    example = " ".join(body.split("\n\n", 1)[0].removeprefix("Example: ").split())
    example = re.sub(r"- (?=\w)", "-", example)  # a word that the help has folded at its hyphen
    words = [word.replace("runs/", f"{tmp_path}/") for word in shlex.split(example)]
    if name == "report":  # of a result that another command has made
        short = ("--set", "time_limit_s=10", "--set", "step_s=0.05")
        eadp("simulate", "plans/survey.plan", "--scenario", "scenarios/survey.yaml", "-o", words[-1], *short)
    assert eadp(*words[1:]).code == 0


@pytest.mark.parametrize("arguments", [("nosuch",), ("plan", "--bogus", "x"), ("schema", "x")])
def test_bad_usage_is_exit_2_with_empty_stdout(eadp, arguments):
    assert refused(eadp(*arguments), "error")


SHORT = "simulate plans/survey.plan --scenario scenarios/survey.yaml --set time_limit_s=5"


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("command", "unused"),
    [
        ("--version", "numpy pydantic yaml eadp.api eadp.models eadp.core"),
        (
            "profile profiles/pednet-jetson-nano.csv --at fps=5",
            "eadp.planning eadp.simulation eadp.io.scenario eadp.io.vehicle eadp.io.plan eadp.models.plan",
        ),
        ("plan plans/survey.plan", "yaml eadp.planning eadp.simulation eadp.io.scenario eadp.io.profile"),
        ("vehicle vehicles/foam-wing.yaml", "sympy scipy eadp.planning eadp.simulation eadp.io.scenario eadp.io.plan"),
        (f"{SHORT} --planner static", "sympy scipy osqp matplotlib shapely eadp.io.figures"),
        (f"{SHORT} --planner joint", "sympy scipy.special matplotlib shapely eadp.io.figures.canvas"),
    ],
)
def test_a_command_imports_what_its_answer_needs(command, unused, root):
    """None needs a room but for what it is asked: the log of a flight has the estimator of papers, and measure reads a
    table of powers, which may be a recording.

    A simple shift needs no sympy, a planner without a program no OSQP, a flight without files no figures.
    """
    code = (
        "import sys; from eadp.cli.main import main; main(sys.argv[2:]);"
        "names = {'.'.join(m.split('.')[:k]) for m in sys.modules for k in range(1, 5)};"
        "found = set(sys.argv[1].split()) & names; sys.exit(str(found) if found else 0)"
    )
    rooms = {"survey", "exchange", "live", "measure", "papers", "sweep", "report", "check"}
    rooms -= {"simulate": {"papers"}, "profile": {"measure"}}.get(command.partition(" ")[0], set())
    words = [code, f"{unused} {' '.join(f'eadp.{room}' for room in rooms)}", *command.split()]
    done = subprocess.run([sys.executable, "-c", *words], capture_output=True, text=True, check=False, cwd=root)
    assert done.returncode == 0, done.stderr


def test_linear_algebra_keeps_to_one_thread_unless_asked():
    """numpy reads the variable once, when it is first imported."""
    code = (
        "import os, sys\n"
        "class Watch:\n"
        "    def find_spec(name, *_):\n"
        "        if name == 'numpy': print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])\n"
        "sys.meta_path.insert(0, Watch); import eadp.cli.main, numpy"
    )
    plain = {key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")}
    for environment, threads in ((plain, "1 1\n"), ({**plain, "OPENBLAS_NUM_THREADS": "2"}, "2 1\n")):
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment
        )
        assert done.stdout == threads, done.stderr


def test_a_bug_is_70_and_says_so_without_a_traceback(eadp, monkeypatch):
    def broken(_path):
        raise RuntimeError("the unexpected")

    monkeypatch.setattr("eadp.api.plan.read_text", broken)
    answer = eadp("plan", "plans/survey.plan")
    assert answer.code == 70
    assert "bug" in answer.err
    assert "the unexpected" in answer.err
    assert "Traceback" not in answer.err


def test_an_interrupt_is_130(eadp, monkeypatch):
    def interrupted(_path):
        raise KeyboardInterrupt

    monkeypatch.setattr("eadp.api.plan.read_text", interrupted)
    assert eadp("plan", "plans/survey.plan").code == cli.INTERRUPTED


def test_a_closed_pipe_ends_quietly(root):
    command = f"{shlex.quote(sys.executable)} -m eadp schema scenario | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, cwd=root, check=False)
    assert done.stdout == "{\n"
    assert done.stderr == ""


def test_debug_shows_the_traceback(eadp, monkeypatch):
    monkeypatch.setenv("EADP_DEBUG", "1")
    assert "Traceback" in eadp("plan", "nosuch.plan").err


def test_schemas(eadp):
    import json

    for name in ("scenario", "vehicle", "profile", "energy", "sweep", "telemetry", "decision"):
        answer = eadp("schema", name)
        assert answer.code == 0
        schema = json.loads(answer.out)
        assert "properties" in schema
        nodes = [schema, *schema.get("$defs", {}).values()]
        for key, node in ((key, node) for each in nodes for key, node in each.get("properties", {}).items()):
            assert node.get("description"), f"{name}: {key}"
