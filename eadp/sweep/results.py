"""Results of a sweep, in one SQLite file that processes of one machine may write to at once, and their statistics.

Guarantees: A result is in the file whole or not at all, and once: the table's primary key is the run's key, a hash of
all that it depends on, and the first result of a run stays. A process that is killed at any moment leaves a readable
file; the next process makes the runs that are not in it. A file that is damaged is refused when it is opened.
"""

from __future__ import annotations

import json
import math
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields
from typing import Any
from urllib.parse import quote

from eadp.errors import InputError, printable
from eadp.io.text.streams import output_file
from eadp.plug_ins import code_identity
from eadp.sweep.engines import Result, Run

Z_95 = 1.959963984540054
"""The normal distribution's quantile of 0.975."""


def wilson_interval(successes: int, trials: int, z: float = Z_95) -> tuple[float, float]:
    """Wilson score interval of a share that was observed as `successes` of `trials`.

    Parameters
    ----------
    successes, trials : int
        Counts; one trial or more.
    z : float
        Standard deviations to either side; 95 % by default.

    Returns
    -------
    tuple of float
        The p with |successes/trials − p| = z √(p (1 − p) / trials), in order.

    Source: E. B. Wilson, Probable inference, the law of succession, and statistical inference, 1927.
    """
    share, square = successes / trials, z * z / trials
    # p = (s + z²/2n ± z √(s(1−s)/n + z²/4n²)) / (1 + z²/n)
    middle = share + square / 2
    reach = z * math.sqrt(share * (1 - share) / trials + square / (4 * trials))
    return max(0.0, (middle - reach) / (1 + square)), min(1.0, (middle + reach) / (1 + square))


@dataclass(frozen=True, kw_only=True)
class SweepFigures:
    """The figures of a flight: columns of the results file and of tables, and keys of its summary."""

    completed: bool | None = None
    reason: str | None = None
    duration_s: float | None = None
    soc_final: float | None = None
    quality: float | None = None
    reserve_kept: bool | None = None
    energy_wh: float | None = None
    distance_m: float | None = None
    solver_failed: int | None = None
    fallbacks: int | None = None


COLUMNS = tuple(each.name for each in fields(SweepFigures))
_SUMMARY = json.JSONEncoder(ensure_ascii=False, allow_nan=False)
SORTED = json.JSONEncoder(sort_keys=True)


@dataclass(frozen=True, kw_only=True)
class SweepFlight(SweepFigures):
    """One run of a sweep: the varied keys' values and the figures of its flight; `error` if it could not be made."""

    index: int
    values: Mapping[str, Any]
    seed: int
    error: str | None = None
    took_s: float = field(default=0.0, compare=False)


def distinct(flights: Sequence[SweepFlight]) -> list[SweepFlight]:
    """The first of each flight that was made: where nothing is drawn, seeds repeat a flight to the bit."""
    first: dict[tuple[Any, ...], SweepFlight] = {}
    for flight in flights:
        if flight.error is None:
            values = json.dumps({key: value for key, value in flight.values.items() if key != "seed"})
            first.setdefault((values, *(getattr(flight, name) for name in (*COLUMNS, "error"))), flight)
    return list(first.values())


def completed_interval(flights: Sequence[SweepFlight]) -> tuple[float, float] | None:
    """The 95 % interval of the share of flights that complete; None without flights."""
    return wilson_interval(sum(bool(flight.completed) for flight in flights), len(flights)) if flights else None


def label_of(value: Any) -> str:
    """A value as text: text unchanged, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


APPLICATION_ID = 0x65616470
"""`eadp` in ASCII, as SQLite's identifier of an application's files."""

SCHEMA_VERSION = 8
BUSY_S = 60.0
"""Longest time that another process may lock the file [s]."""

PAGE_BYTES = 4096
"""Size of a file without tables."""

_TABLE = f"""
CREATE TABLE runs (
    key TEXT PRIMARY KEY, code TEXT NOT NULL, files TEXT NOT NULL, overrides TEXT NOT NULL, seed INTEGER NOT NULL,
    {", ".join(COLUMNS)}, error TEXT, summary TEXT, took_s REAL NOT NULL
)
"""
_ROW = ("key", "code", "files", "overrides", "seed", *COLUMNS, "error", "summary", "took_s")
"""Columns of a row."""


class Results:
    """An open results file; without a path a temporary one. With `read_only` nothing is written."""

    def __init__(self, path: str | None, *, read_only: bool = False) -> None:
        self._path = "the temporary results"
        if path is not None:  # whole, as SQLite has names of its own for what is no file
            path = self._path = str(output_file(path))
        new = path is not None and not os.path.exists(path)
        self._connection = _connect(path, self._path, read_only)
        try:
            with self._sqlite_errors():
                self._open(path, read_only)
        except BaseException:
            self.close()
            if new and os.path.exists(self._path) and os.path.getsize(self._path) <= PAGE_BYTES:
                for ending in ("", "-wal", "-shm"):
                    with suppress(OSError):
                        os.unlink(f"{self._path}{ending}")
            raise

    def _open(self, path: str | None, read_only: bool) -> None:
        self._connection.execute("PRAGMA temp_store = MEMORY")
        self._connection.execute("CREATE TEMP TABLE wanted (place INTEGER PRIMARY KEY, key TEXT NOT NULL)")
        if read_only:
            _check_ours(self._connection, self._path)
        else:
            self._prepare(shared=path is not None)

    # --- opening and closing

    def _prepare(self, *, shared: bool) -> None:
        """Create the tables of an empty file; refuse another application's file, and runs of other code."""
        query = self._connection.execute
        _check_ours(self._connection, self._path)
        if shared:
            query("PRAGMA journal_mode = WAL")
            query("PRAGMA synchronous = NORMAL")
        with self._transaction():
            if _check_ours(self._connection, self._path):
                other = query("SELECT code FROM runs WHERE code != ? LIMIT 1", (code_identity(),)).fetchone()
                if other is not None:
                    what = f"has runs of other code, {printable(other[0], 500)}; this is {code_identity()}"
                    raise InputError.at(self._path, 1, 1, what, "a new file")
                return
            query(_TABLE)
            query(f"PRAGMA application_id = {APPLICATION_ID}")
            query(f"PRAGMA user_version = {SCHEMA_VERSION}")

    def close(self) -> None:
        """Close the file; a transaction that is open, as Ctrl-C may have come just after its start, is rolled back."""
        with suppress(sqlite3.Error):
            self._roll_back()
            self._connection.close()

    # --- expected runs and their results

    def expect(self, keys: Iterable[str]) -> None:
        """Set the runs that the other methods are about, by their keys in order."""
        with self._sqlite_errors():
            self._connection.execute("DELETE FROM wanted")
            self._connection.executemany("INSERT INTO wanted VALUES (?, ?)", enumerate(keys))

    def missing(self) -> list[int]:
        """Positions of the expected runs that are not made, or could not be; of several with one key, the first."""
        made = "SELECT key FROM runs WHERE error IS NULL"
        query = f"SELECT min(place) FROM wanted WHERE key NOT IN ({made}) GROUP BY key ORDER BY 1"
        with self._sqlite_errors():
            return [place for (place,) in self._connection.execute(query)]

    def rows(self) -> Iterator[dict[str, Any]]:
        """Figures, error and time of each expected run, in order."""
        names = (*COLUMNS, "error", "took_s")
        with self._sqlite_errors():
            for stored in self._connection.execute("SELECT runs.* FROM wanted JOIN runs USING (key) ORDER BY place"):
                row = dict(zip(_ROW, stored, strict=True))
                if row["completed"] is not None:
                    row |= {name: bool(row[name]) for name in ("completed", "reserve_kept")}
                yield {name: row[name] for name in names}

    def counts(self, column: str) -> dict[Any, int]:
        """How many of all runs have each value of a column that they have."""
        query = f"SELECT {column}, count(*) FROM runs WHERE {column} IS NOT NULL GROUP BY 1"
        with self._sqlite_errors():
            return dict(self._connection.execute(query))

    def everything(self, most: int) -> Iterator[dict[str, Any]]:
        """All runs up to a number: key, files, overrides, seed, figures and error; in the random order of keys."""
        with self._sqlite_errors():
            for stored in self._connection.execute("SELECT * FROM runs ORDER BY key LIMIT ?", (most,)):
                row = dict(zip(_ROW, stored, strict=True))
                yield {**row, "files": json.loads(row["files"]), "overrides": json.loads(row["overrides"])}

    # --- results that come

    def unmade(self, runs: Sequence[Run]) -> list[Run]:
        """Those of some runs that are not made yet."""
        made = "SELECT 1 FROM runs WHERE error IS NULL AND key = ?"
        with self._sqlite_errors():
            return [run for run in runs if self._connection.execute(made, (run.key,)).fetchone() is None]

    def store(self, results: Sequence[tuple[Run, Result]]) -> None:
        """Store results; the first of each run stays, in place of an error."""
        with self._sqlite_errors(), self._transaction():
            rows = [self._row(run, result) for run, result in results]
            marks = ", ".join("?" * len(_ROW))
            failed = "DELETE FROM runs WHERE key = ? AND error IS NOT NULL"
            self._connection.executemany(failed, [row[:1] for row in rows])
            self._connection.executemany(f"INSERT OR IGNORE INTO runs VALUES ({marks})", rows)

    def _row(self, run: Run, result: Result) -> tuple[Any, ...]:
        summary = result.summary
        known = dict(summary or {})
        solver = known.get("solver", {})
        known |= {"solver_failed": solver.get("failed"), "fallbacks": solver.get("fallbacks")}
        figures = [known.get(name) for name in COLUMNS]
        text = None if summary is None else _SUMMARY.encode(summary)
        files, overrides = (SORTED.encode(dict(part)) for part in (run.files, run.overrides))
        seed = run.overrides["seed"]
        return (run.key, code_identity(), files, overrides, seed, *figures, result.error, text, result.took_s)

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """A transaction; the write lock is taken at its start, so that what it reads stays true."""
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            yield
            self._connection.execute("COMMIT")
        except BaseException:
            self._roll_back()
            raise

    def _roll_back(self) -> None:
        """Roll back a transaction, if one is open: a full disk has ended it already."""
        if self._connection.in_transaction:
            with suppress(sqlite3.Error):
                self._connection.execute("ROLLBACK")

    @contextmanager
    def _sqlite_errors(self) -> Iterator[None]:
        """SQLite's errors as faults of the file."""
        try:
            yield
        except (sqlite3.Error, json.JSONDecodeError) as error:  # SQLite quotes a damaged file in its own errors
            raise _fault(self._path, error) from None


def _connect(path: str | None, name: str, read_only: bool) -> sqlite3.Connection:
    try:
        if read_only:
            return sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True, timeout=BUSY_S, isolation_level=None)
        if path is not None:
            os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
        return sqlite3.connect(path or "", timeout=BUSY_S, isolation_level=None)
    except OSError as error:
        raise InputError.at(name, 1, 1, f"cannot be written: {error.strerror}", "a writable place") from None
    except sqlite3.Error as error:
        raise _fault(name, error) from None


def _check_ours(connection: sqlite3.Connection, name: str) -> bool:
    """Whether a database has our tables; that of another application or version, or a damaged one, is refused."""
    keys = ("application_id", "user_version", "integrity_check(1)")
    application, version, damage = (connection.execute(f"PRAGMA {key}").fetchone()[0] for key in keys)
    (tables,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if tables and (application, version) != (APPLICATION_ID, SCHEMA_VERSION):
        other = "version of eadp" if application == APPLICATION_ID else "application"
        raise InputError.at(name, 1, 1, f"is a database of another {other}", "results of eadp sweep, or a new file")
    if damage != "ok":
        raise InputError.at(name, 1, 1, "is damaged", "a copy of the file, or a new one")
    return bool(tables)


def _fault(path: str, error: Exception) -> InputError:
    name = getattr(error, "sqlite_errorname", "") or ""
    if name.startswith("SQLITE_FULL") or name in ("SQLITE_IOERR_WRITE", "SQLITE_IOERR_SHMSIZE"):
        expected = "space for the rest; results stored so far are kept, the sweep can be continued"
        return InputError.at(path, 1, 1, "the disk is full, or a limit reached", expected)
    if name.startswith("SQLITE_NOTADB"):
        return InputError.at(path, 1, 1, "is not an SQLite database", "results of eadp sweep, or a new file")
    if name.startswith("SQLITE_BUSY"):
        return InputError.at(path, 1, 1, f"another process has held it for {BUSY_S:g} s", "a file that is not locked")
    return InputError.at(path, 1, 1, f"cannot be used: {printable(str(error))}", "a results file in a writable place")
