"""`eadp sweep` as its users meet it: answers, engines that agree, files that go on, refusals."""

import csv
import io
import itertools
import os
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
import xml.etree.ElementTree as ET
from contextlib import closing

import pytest
import yaml
from broken_osqp import BROKEN, broken_osqp
from common import ROOT
from common.answers import hear_interrupts, refused

SHIPPED = "scenarios/sweep-wind-battery.yaml"
PLAN = "0.1; 90; x - c1\n0, 400\n[-10, 10]\n"
SCENARIO = "schema: eadp.scenario/1\nstep_s: 0.05\nplanner: {name: static}\n"
SWEEP = """schema: eadp.sweep/1
plan: line.plan
scenario: calm.yaml
grid:
  wind.speed_mps: [0, 2, 4]
  wind.towards_deg: [90, 270]
zip: {c1: [0, 11], battery.soc: [1, 0.5]}
seeds: 2
"""
MADE = 12
"""Of its 24 runs: c1 = 11 is outside the plan's set."""

QUICK = """schema: eadp.sweep/1
plan: line.plan
scenario: calm.yaml
grid: {time_limit_s: [0.05, 0.1]}
seeds: 300
"""
QUICK_RUNS = 600


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "line.plan").write_text(PLAN)
    (tmp_path / "calm.yaml").write_text(SCENARIO)
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    (tmp_path / "part.yaml").write_text(SWEEP.replace("[0, 2, 4]", "[2]"))
    (tmp_path / "quick.yaml").write_text(QUICK)
    return tmp_path


def table_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def started(*arguments):
    """The command as a process of its own, with its streams piped."""
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    group = {"start_new_session": True, "preexec_fn": hear_interrupts}
    command = [sys.executable, "-m", "eadp", *map(str, arguments)]
    return subprocess.Popen(command, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"}, **streams, **group)


def stored(path):
    """How many results a file has; none where it is not there yet."""
    if not path.exists():
        return 0
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
            return connection.execute("SELECT count(*) FROM runs").fetchone()[0]
    except sqlite3.OperationalError:  # its tables are not there yet
        return 0


def until_stored(process, path, count):
    """Look at a file until it has some results, as long as the process lives and at most a minute."""
    for _ in range(6000):
        if stored(path) >= count:
            return
        try:
            process.wait(0.02)
        except subprocess.TimeoutExpired:
            continue
        break
    pytest.fail(f"ended with {stored(path)} results: {process.communicate()}")


def whole(path):
    """The file is sound; the number of its results."""
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        return connection.execute("SELECT count(*) FROM runs").fetchone()[0]


def failures(path):
    """The time that each run took that could not be made."""
    with closing(sqlite3.connect(path)) as connection:
        return [took for (took,) in connection.execute("SELECT took_s FROM runs WHERE error IS NOT NULL")]


# --- answers


def test_a_row_for_each_run(eadp, folder):
    answer = eadp("sweep", folder / "sweep.yaml", "--jobs", 1, "--format", "csv")
    assert answer.code == 1, "some runs could not be made"
    assert "sweep: warning: 12 flights are 6 distinct ones: seeds change nothing" in answer.err
    head, _, _ = answer.out.partition("\n")
    varied = "wind.speed_mps,wind.towards_deg,c1,battery.soc"
    figures = "completed,reason,duration_s,soc_final,quality,reserve_kept,energy_wh,distance_m"
    assert head == f"{varied},{figures},solver_failed,fallbacks,seed,error"
    rows = table_of(answer.out)
    expected = itertools.product("024", ("90", "270"), (("0", "1"), ("11", "0.5")), "01")
    named = (*varied.split(","), "seed")
    assert [tuple(row[name] for name in named) for row in rows] == [(w, d, *z, s) for w, d, z, s in expected]
    for row in rows:
        if row["c1"] == "11":
            assert row["error"] == "c1 = 11 is outside its set; expected a value in [-10, 10]"
            assert row["completed"] == row["reason"] == row["duration_s"] == row["quality"] == ""
        else:
            along = 1 if row["wind.towards_deg"] == "90" else -1
            # from 100 m before the trigger to 20 m before it, at 15 m/s and the wind
            assert float(row["duration_s"]) == pytest.approx(80 / (15 + along * float(row["wind.speed_mps"])), abs=0.1)
            assert (row["completed"], row["reason"], row["error"]) == ("true", "final point reached", "")
            assert 0.9 < float(row["soc_final"]) < 1


def test_the_answer_for_people(eadp, folder):
    sample = "sample: {runs: 2, keys: {reserve_soc: {uniform: [0, 0.5]}}}"
    (folder / "sweep.yaml").write_text(SWEEP.replace("seeds: 2", sample))
    out = eadp("sweep", folder / "sweep.yaml", "--jobs", 1).out
    assert "runs       24, 12 could not be made\ncompleted  12 of 12: 100.0 % (95 % interval 75.8 to 100.0 %)\n" in out
    assert "error      run 2: c1 = 11 is outside its set" in out


def test_a_pipeline_requires_what_it_needs(eadp, folder):
    (folder / "short.yaml").write_text(
        "schema: eadp.sweep/1\nplan: line.plan\nscenario: calm.yaml\ngrid:\n  battery.capacity_ah: [0.001, 3]\n"
        "  reserve_soc: [0.01, 0.9999]\nseeds: 2\n"
    )
    report, results = folder / "report.xml", folder / "results.db"
    for require, code, failures in ((None, 0, 4), ("completed", 1, 4), ("reserve", 1, 6)):
        asked = () if require is None else ("--require", require)
        answer = eadp("sweep", folder / "short.yaml", "--jobs", 1, "--junit", report, "-o", results, *asked)
        assert answer.code == code
        assert (f"eadp: {failures} of 8 runs are not what --require {require} asks for" in answer.err) == (code == 1)
        assert (f"required   {require}: NO, not in {failures} of 8 runs" in answer.out) == (require is not None)
        assert f"{report}" in answer.out.splitlines()[-1]
        suite = ET.parse(report).getroot()
        assert (suite.tag, suite.get("tests"), suite.get("errors")) == ("testsuite", "8", "0")
        assert suite.get("failures") == str(failures)
        names = [test.get("name") for test in suite]
        assert names[0] == "battery.capacity_ah=0.001, reserve_soc=0.01, seed=0"
        assert len(set(names)) == 8
        found = [test.find("failure").get("message") for test in suite if test.find("failure") is not None]
        assert len(found) == failures
        assert sum("battery empty; state of charge 0.000 at the end" in words for words in found) == 4


@pytest.mark.slow
def test_the_pipeline_of_the_page_runs_as_it_stands(eadp, tmp_path, monkeypatch):
    page = (ROOT / "docs/sweep.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```yaml\n(on:.*?)```", page, re.DOTALL)
    assert len(text.splitlines()) <= 12
    steps = yaml.safe_load(text)["jobs"]["mission"]["steps"]
    (line,) = [step["run"] for step in steps if "run" in step]
    install, command = line.split(" && ")
    assert install == "pip install ."
    monkeypatch.chdir(tmp_path)
    for name in ("plans", "scenarios", "profiles"):
        (tmp_path / name).symlink_to(ROOT / name)
    assert eadp(*shlex.split(command)[1:]).code == 0
    assert ET.parse(tmp_path / "eadp.xml").getroot().get("failures") == "0"


# --- a dry run


def test_a_dry_run_prints_runs_and_makes_none(eadp, folder):
    results = folder / "results.db"
    common = ("sweep", folder / "sweep.yaml", "--dry-run", "-o", results)
    out = eadp(*common).out
    assert out.startswith("24 runs\nrun  wind.speed_mps  wind.towards_deg  c1  battery.soc  seed\n")
    assert "… 14 more" in out
    rows = table_of(eadp(*common, "--format", "csv").out)
    assert len(rows) == 24
    assert rows[-1] == {"wind.speed_mps": "4", "wind.towards_deg": "270", "c1": "11", "battery.soc": "0.5", "seed": "1"}
    assert not results.exists()
    eadp("sweep", folder / "part.yaml", "--jobs", 1, "-o", results)
    before = results.read_bytes()
    assert eadp(*common).out.startswith("24 runs, 8 made already\n")
    assert results.read_bytes() == before


@pytest.mark.slow
def test_the_shipped_sweep(eadp):
    rows = table_of(eadp("sweep", SHIPPED, "--dry-run", "--format", "csv").out)
    assert len(rows) == 400
    assert rows[0] == {"wind.speed_mps": "0", "battery.capacity_ah": "0.36", "seed": "0"}
    short = ("--jobs", 1, "--set", "time_limit_s=0.5", "--format", "csv")
    answer = eadp("sweep", SHIPPED, *short)
    assert answer.code == 0
    assert [row["reason"] for row in table_of(answer.out)] == ["time limit"] * 400


# --- engines agree, files go on


@pytest.mark.slow
def test_engines_agree(eadp, folder):
    distributed = pytest.importorskip("distributed")
    common = ("sweep", folder / "sweep.yaml", "--set", "wind.gust_std_mps=1", "--format", "csv")
    alone = eadp(*common, "--jobs", 1).out
    assert eadp(*common, "--jobs", 2).out == alone
    workers = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "memory_limit": 0}
    local = {"host": "127.0.0.1", "scheduler_port": 0, "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(**workers, **local) as cluster:
        assert cluster.scheduler_address.startswith("tcp://127.0.0.1:")
        answer = eadp(*common, "--scheduler", cluster.scheduler_address)
    assert answer.out == alone
    assert answer.code == 1


@pytest.mark.slow
def test_an_existing_file_goes_on(eadp, folder):
    results = folder / "results.db"
    common = ("sweep", folder / "sweep.yaml", "--jobs", 1, "-o", results, "--format", "csv")
    eadp("sweep", folder / "part.yaml", "--jobs", 1, "-o", results)
    assert stored(results) == 8
    first = eadp(*common).out
    assert whole(results) == 24
    assert eadp(*common).out == first
    assert whole(results) == 24
    took = failures(results)
    assert len(took) == 24 - MADE
    assert eadp(*common).out == first
    assert whole(results) == 24
    assert not {*took} & {*failures(results)}, "those that could not be made were tried again"
    more = SWEEP.replace("[0, 2, 4]", "[0, 1, 2, 4]")
    (folder / "sweep.yaml").write_text(more)
    assert len(table_of(eadp(*common).out)) == 32
    assert whole(results) == 32, "a sweep that has grown makes what is new"


@pytest.mark.slow
def test_killed_and_started_again_it_makes_what_is_missing(folder, eadp):
    results = folder / "results.db"
    arguments = ("sweep", folder / "quick.yaml", "--jobs", 2, "-o", results, "--format", "csv")
    for count in (1, 100):
        process = started(*arguments)
        until_stored(process, results, count)
        process.kill()
        process.communicate()
        assert process.returncode == -signal.SIGKILL
    kept = stored(results)
    assert 100 <= kept < QUICK_RUNS
    answer = eadp(*arguments[:2], "--jobs", 1, *arguments[4:])
    assert answer.code == 0
    assert len(table_of(answer.out)) == QUICK_RUNS
    assert whole(results) == QUICK_RUNS
    assert sorted(item.name for item in folder.glob("results*")) == ["results.db", "results.html"]


@pytest.mark.slow
def test_an_interrupt_is_130_and_leaves_a_file_that_goes_on(folder):
    results = folder / "results.db"
    process = started("sweep", folder / "quick.yaml", "--jobs", 2, "-o", results)
    until_stored(process, results, 20)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to all processes of the command
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert "runs made; the same command makes the rest\n" in err
    assert "Traceback" not in err
    kept = stored(results)
    assert 20 <= kept < QUICK_RUNS
    assert whole(results) == kept
    assert sorted(item.name for item in folder.glob("results*")) == ["results.db"]


@pytest.mark.slow
def test_two_at_once_share_the_work(folder, eadp):
    results = folder / "results.db"
    arguments = ("sweep", folder / "quick.yaml", "--jobs", 1, "-o", results, "--format", "csv")
    both = [started(*arguments) for _ in range(2)]
    answers = [process.communicate(timeout=120) for process in both]
    assert [process.returncode for process in both] == [0, 0], answers
    assert answers[0][0] == answers[1][0]  # on stderr, a loaded machine's estimates differ
    assert whole(results) == QUICK_RUNS


def test_a_full_disk_is_an_error_and_the_file_goes_on(eadp, folder, monkeypatch):
    from eadp.sweep import results as module

    def small(*arguments):
        connection = connect(*arguments)
        connection.execute("PRAGMA max_page_count = 7")
        return connection

    connect = module._connect
    results = folder / "results.db"
    common = ("sweep", folder / "sweep.yaml", "--jobs", 1, "-o", results)
    with monkeypatch.context() as patch:
        patch.setattr(module, "_connect", small)
        assert refused(eadp(*common), f"{results}:1:1: error: the disk is full")
    kept = stored(results)
    assert 0 < kept < 24
    assert eadp(*common).code == 1
    assert whole(results) == 24


# --- what is refused


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--scheduler", "host"), "--scheduler:1:1: error: host is no address"),
        (("--scheduler", "tcp://host:1", "--jobs", "2"), "--jobs:1:1: error"),
        (("--set", "c1=3"), "--set:1:1: error: parameters.c1 is varied"),
        (("-o", "-"), "--out:1:1: error"),
    ],
)
def test_bad_options(eadp, folder, options, words):
    results = folder / "results.db"
    assert refused(eadp("sweep", folder / "sweep.yaml", "-o", results, *options), words)
    assert not results.exists()


def test_bad_files(eadp, folder):
    results = folder / "results.db"
    path = folder / "sweep.yaml"
    path.write_text(SWEEP.replace("[0, 2, 4]", "[0, -2, 4]"))
    assert refused(eadp("sweep", path, "-o", results), f"{path}:5:23: error: wind.speed_mps cannot be -2; expected")
    assert refused(eadp("sweep", folder / "none.yaml", "-o", results), "none.yaml:1:1: error: cannot be read")
    assert not results.exists()
    path.write_text(SWEEP)
    results.write_text("something else, and long enough to be looked at as a database by its first hundred bytes" * 2)
    assert refused(eadp("sweep", path, "-o", results), f"{results}:1:1: error: is not an SQLite database")


def test_the_progress(capsys, monkeypatch, folder):
    from eadp.sweep import command as module
    from eadp.sweep.engines import Result

    clock = iter(range(0, 10_000, 30))
    monkeypatch.setattr("eadp.cli.output.time.monotonic", lambda: float(next(clock)))
    progress = module._SweepProgress(300, 2)
    left = []
    for i in range(6):
        progress.add(Result(None, "cannot" if i == 4 else None, 2.0))
        left.append(progress.left_s)
    assert left == [299.0, 298.0, 297.0, 296.0, 295.0, 294.0], "whatever the clock"
    progress.close()
    lines = capsys.readouterr().err.splitlines()
    assert 0 < len(lines) < 6, "one a minute"
    assert all(line.startswith("sweep: ") and line.endswith(" left") for line in lines)
    assert "6 of 300 runs, 1 could not be made" in lines[-1]


def test_a_failed_solver_shows_in_every_output(eadp, folder):
    sweep = folder / "joint.yaml"
    sweep.write_text(
        f"schema: eadp.sweep/1\nplan: {ROOT}/plans/survey.plan\nscenario: {ROOT}/scenarios/survey.yaml\n"
        "grid: {battery.capacity_ah: [0.62, 3]}\n"
    )
    arguments = ["sweep", sweep, "--jobs", 1, "--set", "time_limit_s=40", "--junit", folder / "j.xml"]
    with broken_osqp(BROKEN["failing"]):
        text, table = eadp(*arguments, "-o", folder / "r.db", "-q"), eadp(*arguments, "--format", "csv")
        strict = eadp(*arguments, "--strict-solver", "-o", folder / "r.db")
    assert (text.code, table.code, strict.code) == (0, 0, 1)
    failed = [row for row in table_of(table.out) if int(row["solver_failed"])]
    assert failed
    assert all(int(row["fallbacks"]) for row in failed)
    words = f"in {len(failed)} of 2 flights OSQP did not solve: "
    assert f"solver     {words}" in text.out
    assert f"eadp: warning: {words}" in text.err  # though it is quiet
    assert len(ET.parse(folder / "j.xml").findall(".//system-out")) == len(failed)
    assert f"OSQP did not solve in {len(failed)} of 2 flights" in (folder / "r.html").read_text()
    assert "OSQP" not in eadp(*arguments, "--format", "csv").err
