"""The results file: each run once, whoever writes, whatever goes wrong; shares and medians beside countings."""

import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from eadp.errors import InputError
from eadp.sweep import results as results_file
from eadp.sweep.engines import Result, Run
from eadp.sweep.results import COLUMNS, Results, SweepFlight, completed_interval, distinct, wilson_interval

RUNS = [Run(f"key{i}", {"plan": "p"}, {"seed": i, "wind.speed_mps": 1}) for i in range(6)]
SUMMARY = {"completed": True, "reason": "r", "duration_s": 2.5, "soc_final": 0.25, "quality": None, "more": [1]}
SUMMARY |= {"reserve_kept": True, "energy_wh": 6.5, "distance_m": 1200.0}
SUMMARY |= {"solver": {"failed": 3, "fallbacks": 1}}
SOLVER = {"solver_failed": 3, "fallbacks": 1}


@pytest.fixture
def path(tmp_path):
    return str(tmp_path / "deep/results.db")


def expecting(results, runs=RUNS):
    results.expect(run.key for run in runs)
    return results


def test_results_are_kept_in_order_of_what_is_expected(path):
    with closing(expecting(Results(path))) as results:
        assert results.missing() == [0, 1, 2, 3, 4, 5]
        results.store([(RUNS[4], Result(SUMMARY)), (RUNS[1], Result(None, "cannot", 0.1))])
        assert results.missing() == [0, 1, 2, 3, 5], "what could not be made is made again"
    with closing(expecting(Results(path))) as results:
        first, second = results.rows()
        assert first == {**dict.fromkeys(COLUMNS), "error": "cannot", "took_s": 0.1}
        figures = {key: SUMMARY[key] for key in SUMMARY if key not in ("more", "solver")}
        assert second == figures | SOLVER | {"error": None, "took_s": 0.0}
        results.store([(RUNS[1], Result(SUMMARY)), (RUNS[4], Result(None, "cannot"))])
        assert [row["error"] for row in results.rows()] == [None, None]


def test_a_damaged_result_is_refused(path):
    with closing(expecting(Results(path))) as results:
        results.store([(RUNS[0], Result(SUMMARY))])
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("UPDATE runs SET reason = CAST(x'ff' AS TEXT)")
        connection.commit()
    with closing(expecting(Results(path))) as results, pytest.raises(InputError, match=r"damaged|cannot be used"):
        [*results.rows()]


def test_a_file_that_could_not_be_started_is_removed(path, monkeypatch):
    monkeypatch.setattr(results_file, "_TABLE", "CREATE TABLE")
    with pytest.raises(InputError, match="cannot be used"):
        Results(path)
    assert not os.listdir(os.path.dirname(path))


def test_a_damaged_index_is_refused(path):
    with closing(expecting(Results(path))) as results:
        results.store([(run, Result(SUMMARY)) for run in RUNS])
    damaged = bytearray(Path(path).read_bytes())
    at = damaged.rindex(RUNS[3].key.encode())  # the index is after the table
    damaged[at : at + 1] = b"x"
    Path(path).write_bytes(damaged)
    for read_only in (False, True):
        with pytest.raises(InputError, match=r"results\.db:1:1: error: is damaged; expected a copy of the file"):
            Results(path, read_only=read_only)


def test_what_another_process_has_stored_is_not_made_again(path):
    with closing(Results(path)) as results, closing(Results(path)) as other:
        assert results.unmade(RUNS) == RUNS
        other.store([(RUNS[2], Result(SUMMARY, None, 9.0))])
        assert results.unmade(RUNS) == [*RUNS[:2], *RUNS[3:]]
        results.store([(run, Result(SUMMARY)) for run in RUNS])
        assert [row["took_s"] for row in expecting(results).rows()] == [0, 0, 9, 0, 0, 0]
    assert os.listdir(os.path.dirname(path)) == ["results.db"]


@pytest.mark.parametrize("kind", ["text", "database", "folder"])
def test_another_file_is_refused_and_unchanged(tmp_path, kind):
    path = tmp_path / "results.db"
    if kind == "folder":
        path.mkdir()
    elif kind == "text":
        path.write_text("not a database, but some text that is longer than a header of SQLite would be " * 3)
    else:
        with closing(sqlite3.connect(path)) as connection:
            connection.execute("CREATE TABLE mine (x)")
    before = None if kind == "folder" else path.read_bytes()
    with pytest.raises(InputError, match=r"results\.db:1:1: error: "):
        Results(str(path))
    assert before is None or path.read_bytes() == before
    assert [item.name for item in tmp_path.iterdir()] == ["results.db"]


def test_what_sqlite_says_of_a_damaged_schema_is_printable(path):
    """Found by fuzzing: the message quotes the schema's bytes."""
    with closing(expecting(Results(path))):
        pass
    data = Path(path).read_bytes()
    at = data.index(b"CREATE TABLE runs")
    Path(path).write_bytes(data[: at + 13] + b"\x01\x1b" + data[at + 15 :])
    with pytest.raises(InputError) as error:
        Results(path)
    assert all(line.isprintable() for line in str(error.value).splitlines())


@pytest.mark.parametrize("name", [":memory:", "file:a?mode=memory"])
def test_names_that_mean_something_to_sqlite_are_names_of_files(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with closing(Results(name)):
        assert (tmp_path / name).is_file()


def test_a_file_with_runs_of_other_code_is_not_continued(path, monkeypatch):
    with closing(Results(path)) as results:
        results.store([(RUNS[0], Result(SUMMARY))])
    monkeypatch.setattr(results_file, "code_identity", lambda: "eadp 99")
    with pytest.raises(InputError, match=r"has runs of other code, eadp 0.*; this is eadp 99; expected a new file"):
        Results(path)
    with closing(Results(path, read_only=True)) as results:
        assert [row["key"] for row in results.everything(1000)] == ["key0"]


EXACT = 1e-9


@given(st.integers(1, 400), st.data())
def test_the_interval_is_wilsons(trials, data):
    successes = data.draw(st.integers(0, trials))
    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    assert wilson_interval(successes, trials) == pytest.approx((interval.low, interval.high), abs=EXACT)


def flight(index, values, completed=True, duration=100.0, soc=0.5, quality=0.7, error=None, seed=0):
    if error is not None:
        return SweepFlight(index=index, values=values, seed=seed, error=error)
    figures = {"completed": completed, "reason": "reason", "duration_s": duration, "soc_final": soc, "quality": quality}
    return SweepFlight(index=index, values=values, seed=seed, **figures)


FLIGHTS = [
    flight(0, {"w": 1, "p": "a"}, True, 10.0, 0.1, 0.9),
    flight(1, {"w": 2, "p": "a"}, False, 20.0, 0.2, 0.8),
    flight(2, {"w": 1, "p": "b"}, True, 40.0, 0.4, None),
    flight(3, {"w": 2, "p": "b"}, error="cannot"),
    flight(4, {"w": 1, "p": "a"}, False, 30.0, 0.0, 0.5, seed=1),
]


def test_what_could_not_be_made_is_in_no_interval():
    assert completed_interval(distinct(FLIGHTS)) == wilson_interval(2, 4)
    assert completed_interval(distinct([FLIGHTS[3]])) is None


def test_copies_of_a_flight_are_in_no_interval():
    copies = [flight(i, {"w": i % 2, "seed": i}, soc=0.5 + i % 2, seed=i) for i in range(8)]
    own = distinct([*copies, flight(8, {"w": 0, "seed": 8}, False, seed=8)])
    assert completed_interval(own) == wilson_interval(2, 3)
