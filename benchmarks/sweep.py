"""What a sweep costs beside its flights: throughput, two workers beside one, memory, and what survives being killed.

usage: python benchmarks/sweep.py [--flights 10 100] [--nothing 20000] [--kills 20] [--seconds 120] [--seed 0]

- flights per core-second: `survey.plan` in wind with a battery that drains, a sample of wind and capacity, in this
  process; CPU time of all that a sweep does from the first run to the last stored row, beside that of the flights alone
- two workers: wall time of the same flights with one worker and with two, turn and turn about; meaningful only where
  two cores are free (the CPU time per flight says whether they were)
- overhead: runs that fly nothing, made in this process and in a pool of one, stored in a file; time per run
- memory: largest resident set of a worker after a hundred flights, beside a Python that has imported the same
- kill -9 at random moments of a sweep that writes all the time, started again each time: from the begin of the process,
  and every other time within a second of its first row; rows that are lost, or made twice, at the end (0 and 0 are
  expected), and the state of the file

A hundred flights take about a minute of CPU; `--flights 10 100 1000` adds ten. Exit code 1 if anything is lost or made
twice.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import resource
import signal
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from eadp.io.results import Results
from eadp.io.sweep_file import Sweep, read_sweep
from eadp.io.sweep_run import FlyRun
from eadp.simulation.engines import Here, Make, Pool
from eadp.simulation.sweep import Result, Run, make_runs

ROOT = Path(__file__).resolve().parent.parent
SWEEP = """schema: eadp.sweep/1
plan: {root}/plans/survey.plan
scenario: {root}/scenarios/survey.yaml
sample:
  runs: {runs}
  seed: {seed}
  method: latin
  keys:
    wind.speed_mps: {{uniform: [0, 9]}}
    battery.capacity_ah: {{uniform: [0.36, 0.74]}}
"""
QUICK = """schema: eadp.sweep/1
plan: line.plan
scenario: calm.yaml
grid: {time_limit_s: [0.05, 0.1]}
seeds: 10000
"""
NOTHING = {"completed": True, "reason": "nothing", "duration_s": 0.0, "soc_final": 1.0, "quality": None}


def nothing(_: Run) -> Result:
    """A run that flies nothing."""
    return Result(NOTHING)


def resident_mb(_: Run) -> Result:
    """The largest resident set of the process that makes this run [MB]."""
    return Result({**NOTHING, "duration_s": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024})


class FlyAndTime:
    """Flies, and adds up the CPU time of that alone [s]."""

    def __init__(self, fly: FlyRun) -> None:
        self._fly = fly
        self.cpu_s = 0.0

    def __call__(self, run: Run) -> Result:
        begun = time.process_time()
        result = self._fly(run)
        self.cpu_s += time.process_time() - begun
        return result


class FlyAndWeigh:
    """Flies, and tells the worker's largest resident set [MB] in place of the flight's duration."""

    def __init__(self, fly: FlyRun) -> None:
        self._fly = fly

    def __call__(self, run: Run) -> Result:
        result = self._fly(run)
        return Result(result.summary and {**result.summary, **resident_mb(run).summary}, result.error, result.took_s)


def cpu_s() -> float:
    """CPU time of this process and its ended children [s]."""
    mine, theirs = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return mine.ru_utime + mine.ru_stime + theirs.ru_utime + theirs.ru_stime


def sampled(folder: Path, runs: int, seed: int) -> Sweep:
    """A sweep of so many flights."""
    path = folder / f"sweep-{runs}.yaml"
    path.write_text(SWEEP.format(root=ROOT, runs=runs, seed=seed))
    return read_sweep(str(path))


def swept(sweep: Sweep, make: Make, jobs: int, out: Path | None) -> list[Result]:
    """All runs of a sweep, made and stored."""
    with contextlib.closing(Results(None if out is None else str(out))) as results:
        runs = [sweep.run(index) for index in range(len(sweep.design))]
        results.expect(run.key for run in runs)
        engine = Pool(make, jobs) if jobs else Here(make)
        try:
            return [result for _, result in make_runs(runs, engine, results)]
        finally:
            engine.close()


def measured(call: Callable[[], list[Result]]) -> tuple[float, float, list[Result]]:
    """Wall time and CPU time of a call [s], and its results."""
    wall, cpu = time.perf_counter(), cpu_s()
    results = call()
    return time.perf_counter() - wall, cpu_s() - cpu, results


# --- parts


def throughput(folder: Path, counts: list[int], seed: int) -> None:
    """Flights per core-second."""
    print("flights  CPU [s]  flights per core-second  of it flying")
    for count in counts:
        sweep = sampled(folder, count, seed)
        fly = FlyAndTime(FlyRun(sweep.kept))
        _, cpu, results = measured(partial(swept, sweep, fly, 0, folder / f"{count}.db"))
        assert not any(result.error for result in results)
        print(f"{count:7d}  {cpu:7.1f}  {count / cpu:23.2f}  {100 * fly.cpu_s / cpu:10.2f} %")


def two_workers(folder: Path, count: int, seed: int) -> None:
    """One worker beside two, both as pools; each twice, in turn."""
    sweep = sampled(folder, count, seed)
    make = FlyRun(sweep.kept)
    walls: dict[int, list[float]] = {1: [], 2: []}
    cpus: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(2):
        for jobs in (1, 2):
            wall, cpu, _ = measured(partial(swept, sweep, make, jobs, None))
            walls[jobs].append(wall)
            cpus[jobs].append(cpu)
    one, two = min(walls[1]), min(walls[2])
    print(f"\ntwo workers: {count} flights in {two:.1f} s, one worker {one:.1f} s: ratio {one / two:.2f}, ", end="")
    print(f"efficiency {100 * one / two / 2:.0f} %; CPU {min(cpus[2]):.1f} s beside {min(cpus[1]):.1f} s")
    print(f"  (start of processes included; {os.getloadavg()[0]:.1f} processes want {os.cpu_count()} cores)")


def overhead(folder: Path, count: int) -> None:
    """Time per run that flies nothing."""
    path = folder / "nothing.yaml"
    path.write_text(f"schema: eadp.sweep/1\nplan: {ROOT}/plans/survey.plan\nseeds: {count}\n")
    begun = time.process_time()
    sweep = read_sweep(str(path))
    for index in range(count):
        sweep.run(index)
    print(f"\noverhead of a run that flies nothing, {count} of them, stored in a file:")
    print(f"  its inputs and their hash   {1e6 * (time.process_time() - begun) / count:7.1f} us CPU")
    for name, jobs in (("in this process", 0), ("in a pool of one", 1)):
        wall, cpu, results = measured(partial(swept, sweep, nothing, jobs, folder / f"nothing-{jobs}.db"))
        assert len(results) == count
        print(f"  {name:<26} {1e6 * cpu / count:8.1f} us CPU, {1e6 * wall / count:.1f} us wall")
    begun = time.process_time()
    with contextlib.closing(Results(str(folder / "nothing-0.db"))) as results_file:
        results_file.expect(sweep.run(index).key for index in range(count))
        assert not results_file.missing()
    print(f"  found made already          {1e6 * (time.process_time() - begun) / count:7.1f} us CPU")


def memory(folder: Path, count: int, seed: int) -> None:
    """Largest resident set of a worker."""
    sweep = sampled(folder, count, seed)
    bare = swept(sampled(folder, 1, seed), resident_mb, 1, None)[0].summary
    results = swept(sweep, FlyAndWeigh(FlyRun(sweep.kept)), 1, None)
    sizes = [result.summary["duration_s"] for result in results if result.summary]
    first, last = sizes[0], sizes[-1]
    print(f"\nmemory of a worker: {bare['duration_s'] if bare else 0:.0f} MB without a flight, ", end="")
    print(f"{first:.0f} MB after the first, {last:.0f} MB after {count}")


def kills(folder: Path, count: int, seconds: float, seed: int) -> bool:
    """Kill a sweep again and again; whether nothing was lost and nothing made twice."""
    (folder / "line.plan").write_text("0.1; 90; x\n0, 400\n")
    (folder / "calm.yaml").write_text("schema: eadp.scenario/1\nstep_s: 0.05\nplanner: {name: static}\n")
    path, out = folder / "quick.yaml", folder / "killed.db"
    path.write_text(QUICK)
    command = [sys.executable, "-m", "eadp", "sweep", str(path), "-o", str(out), "--format", "csv", "--jobs"]
    chance = random.Random(seed)
    kept = []
    for turn in range(count):
        before = rows(out)
        jobs = str(1 + turn // 2 % 2)
        with subprocess.Popen([*command, jobs], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            if turn % 2:  # while it stores rows; else at any time from the begin of the process
                while rows(out) == before and process.poll() is None:
                    time.sleep(0.01)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(chance.uniform(0, 1) if turn % 2 else chance.uniform(0, 3))
            process.send_signal(signal.SIGKILL)
        kept.append(rows(out) - before)
    rowed = sum(n > 0 for n in kept)
    print(f"\nkill -9, {count} times: {rowed} had stored rows, {statistics.median(kept):.0f} in the median, ", end="")
    print(f"{max(kept)} at most")
    done = subprocess.run([*command, "2"], capture_output=True, text=True, timeout=seconds, check=False)
    with contextlib.closing(sqlite3.connect(out)) as connection:
        (sound,) = connection.execute("PRAGMA integrity_check").fetchone()
        stored, repeated = connection.execute("SELECT sum(stored), sum(repeated) FROM sessions").fetchone()
        (there,) = connection.execute("SELECT count(*) FROM runs").fetchone()
    told, wanted = done.stdout.count("\n") - 1, 20000
    print(f"  then run to its end (exit {done.returncode}): of {wanted} runs, {wanted - there} lost and ", end="")
    print(f"{stored - there + repeated} made twice; {told} rows told; file: {sound}")
    return (there, stored, repeated, told, sound, done.returncode) == (wanted, wanted, 0, wanted, "ok", 0)


def rows(path: Path) -> int:
    """Results that a file has."""
    if not path.exists():
        return 0
    with contextlib.closing(sqlite3.connect(path)) as connection, contextlib.suppress(sqlite3.OperationalError):
        return int(connection.execute("SELECT count(*) FROM runs").fetchone()[0])
    return 0


def main() -> int:
    """Everything in turn."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, nargs="+", default=[10, 100], help="sizes of sweeps that fly")
    parser.add_argument("--nothing", type=int, default=20000, help="runs that fly nothing")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=120.0, help="most that the sweep that was killed may take")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        throughput(folder, asked.flights, asked.seed)
        two_workers(folder, 20, asked.seed)
        overhead(folder, asked.nothing)
        memory(folder, 20, asked.seed)
        sound = kills(folder, asked.kills, asked.seconds, asked.seed) if asked.kills else True
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
