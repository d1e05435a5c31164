"""What a sweep costs: flights per core-second and where the time goes, workers, memory, and results after a kill.

usage: python benchmarks/sweep.py [--planner static paper joint] [--flights 10 100] [--workers 100] [--nothing 20000]
                                  [--kills 20] [--seconds 120] [--seed 0]

- flights per core-second: `survey.plan`, vehicle `fixed-wing`, wind and capacity drawn, no log; compiled (`eadp[fast]`)
  and plain, in this process; CPU time from the first run to the last stored row, and how much of it is not flying
- where the time goes: CPU time in the inner loop (of which the triggers: by flying without), the estimator, the planner
  and the rest
- compiling: import of numba, the first flight of a process without machine code kept, and with machine code kept
- mission length: whole flights of the survey with its final point 1, 4 and 16 times as many laps away
- at scale: the command with one worker and with two, twice each, and on a Dask cluster of one and two: flights a
  second, time of a flight, CPU of workers and of the command, all in the middle of the sweep; what of the efficiency is
  the machine's (flights that take longer together) and what the sweep's own; memory along the way; whether rows are
  stored as it goes and the progress line counts them. Rates mean something only where two cores are free
- overhead: runs that fly nothing, made in this process and in a pool of one, stored in a file; time per run
- memory: largest resident set of a worker after many flights, beside a Python that has imported the same
- kill -9 at random moments of a sweep that writes all the time, started again each time: from the start of the process,
  and every other time within a second of its first row; rows that are lost, or made twice, at the end (0 and 0 are
  expected), and the state of the file

`--flights 10 100 1000` takes some minutes more. Exit code 1 if anything is lost or made twice, or progress untrue.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import math
import os
import pty
import random
import re
import resource
import select
import signal
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import eadp.cli  # noqa: F401 - first: its environment is one thread for linear algebra

# isort: split
import numpy as np
from measured import add_option, head, line, recorded

from eadp.api.inputs import Files, FlightInputs, load_flight
from eadp.core import compiled
from eadp.io.text.streams import read_text
from eadp.models.plan.executor import ENDS, FIRES_IN, PASS_Q, RADIUS_SQUARED, PlanExecutor
from eadp.models.world import World
from eadp.papers.estimator import ExactEstimator
from eadp.planning.flight import PlannedFlight
from eadp.simulation.aircraft import constants_of, state_of
from eadp.simulation.inner_loop import InnerLoop
from eadp.simulation.loop import Outcome, fly
from eadp.sweep.engines import Make
from eadp.sweep.pool import PoolEngine
from eadp.sweep.registry import SerialEngine
from eadp.sweep.results import Results
from eadp.sweep.run import FlyRun, make_runs
from eadp.sweep.runs import Result, Run
from eadp.sweep.sweep_file import Sweep, load_run, read_sweep

ROOT = Path(__file__).resolve().parent.parent
SWEEP = """schema: eadp.sweep/1
plan: {root}/plans/survey.plan
scenario: {root}/scenarios/survey.yaml
grid: {{vehicle.airframe.model: [fixed-wing], planner: [{planner}]}}
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
    try:  # the kernel's other figure is inherited from the process that started this one
        lines = Path("/proc/self/status").read_text().splitlines()
        kilobytes = float(next(line for line in lines if line.startswith("VmHWM")).split()[1])
    except (OSError, StopIteration):
        kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Result({**NOTHING, "duration_s": kilobytes / 1024})


class FlyAndTime:
    """Flies, and adds up the CPU time of that alone [s]."""

    def __init__(self, fly: FlyRun) -> None:
        self._fly = fly
        self.cpu_s = 0.0

    def __call__(self, run: Run) -> Result:
        start_s = time.process_time()
        result = self._fly(run)
        self.cpu_s += time.process_time() - start_s
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


def sampled(folder: Path, runs: int, seed: int, planner: str = "static") -> Sweep:
    """A sweep of so many flights."""
    path = folder / f"sweep-{planner}-{runs}.yaml"
    path.write_text(SWEEP.format(root=ROOT, runs=runs, seed=seed, planner=planner))
    return read_sweep(read_text(str(path)))


def swept(sweep: Sweep, make: Make, jobs: int, out: Path | None) -> list[Result]:
    """All runs of a sweep, made and stored."""
    with contextlib.closing(Results(None if out is None else str(out))) as results:
        runs = [sweep.run(index) for index in range(len(sweep.design))]
        results.expect(run.key for run in runs)
        engine = PoolEngine(make, jobs) if jobs else SerialEngine(make)
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


def throughput(folder: Path, planner: str, counts: list[int], seed: int) -> None:
    """Flights per core-second, compiled and plain; of plain ones no more than the fewest."""
    print(head(f"planner {planner}: flights", "", "CPU [s]", "flights per core-second", "ms each", "of it not flying"))
    wanted = [(True, count) for count in counts] if compiled.available() else []
    for fast, count in [*wanted, (False, min(counts))]:
        sweep = sampled(folder, count, seed, planner)
        fly = FlyAndTime(FlyRun(sweep.kept, fast=fast))
        fly(sweep.run(0))  # compiled, parsed
        fly.cpu_s = 0.0
        _, cpu, results = measured(partial(swept, sweep, fly, 0, folder / f"{planner}-{fast}-{count}.db"))
        assert not any(result.error for result in results)
        name = "compiled" if fast else "plain"
        rate, each, rest = count / cpu, 1e3 * cpu / count, 1e3 * (cpu - fly.cpu_s) / count
        print(line(count, name, f"{cpu:.2f}", f"{rate:.1f}", f"{each:.1f}", f"{rest:.2f} ms"))


class Clocks:
    """CPU time of some methods, each without what it calls of the others [s]."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._within: list[str] = []
        self._since = time.process_time()

    def _switch(self) -> None:
        now = time.process_time()
        self.spent[self._within[-1] if self._within else "rest"] += now - self._since
        self._since = now

    @contextlib.contextmanager
    def measuring(self, methods: dict[str, list[tuple[type, str]]]) -> Iterator[None]:
        """Measure methods by name."""
        before = [(owner, method, getattr(owner, method)) for pairs in methods.values() for owner, method in pairs]
        for name, pairs in methods.items():
            for owner, method in pairs:
                setattr(owner, method, self._clocked(name, getattr(owner, method)))
        self._since = time.process_time()
        try:
            yield
        finally:
            self._switch()
            for owner, method, function in before:
                setattr(owner, method, function)

    def _clocked(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def clocked(*arguments: Any, **named: Any) -> Any:
            self._switch()
            self._within.append(name)
            try:
                return function(*arguments, **named)
            finally:
                self._switch()
                self._within.pop()

        return clocked


def breakdown(folder: Path, planner: str, count: int, seed: int) -> None:
    """Where the time of a flight goes."""
    sweep = sampled(folder, count, seed, planner)
    runs = [sweep.run(index) for index in range(count)]
    parts: dict[str, list[tuple[type, str]]] = {
        "inner loop": [(InnerLoop, "run")],
        "stages": [(PlanExecutor, "handle"), (PlanExecutor, "decide"), (InnerLoop, "start_stage")],
        "planner": [(PlannedFlight, "take")],
        "estimator": [(ExactEstimator, name) for name in ("observe", "lap", "start_lap", "forecast")],
        "inputs": [(Files, "load"), (FlightInputs, "flight")],
    }
    print("  where it goes, ms a flight:", end="")
    for fast in (True, False) if compiled.available() else (False,):
        fly, clocks = FlyRun(sweep.kept, fast=fast), Clocks()
        fly(runs[0])
        with clocks.measuring(parts):
            for run in runs:
                fly(run)
        each = {name: 1e3 * clocks.spent[name] / count for name in (*parts, "rest")}
        print(f"\n    {'compiled' if fast else 'plain':8}", *(f"{name} {ms:.1f}" for name, ms in each.items()), end="")
        share = trigger_share(load_run(sweep.kept, runs[0]).world, fast)
        print(f"; of the inner loop the triggers take {100 * share:.0f} %", end="")
    print()


def trigger_share(world: World, fast: bool) -> float:
    """Share of the inner loop's time that the triggers take."""
    compiled.enable(fast)
    steps, spent = 100_000 if fast else 10_000, {}
    for _ in range(3):
        for watching in (True, False):
            executor = PlanExecutor(world.plan, world.parameters, world.start.position_m, world.rules)
            if watching:  # of a trigger that does not fire: a circle without end, a disc of no size
                numbers = executor.watch.numbers
                numbers[PASS_Q], numbers[RADIUS_SQUARED] = math.inf, -1.0
            else:
                executor.watch.numbers[FIRES_IN] = executor.watch.numbers[ENDS] = 0.0
            start = (world.wind.steady_mps, *world.start)
            inner_loop = InnerLoop(
                state_of(world.vehicle, *start),
                constants_of(world.vehicle, world.guidance, world.wind, world.clock.step_s),
                replace(world.battery, capacity_ah=1e6),
                world.wind,
                np.random.default_rng(0),
            )
            inner_loop.set_records(1 << 40, 0, 1 << 40)
            inner_loop.start_stage(executor, 0.0)
            inner_loop.run(0, 1)
            start_s = time.process_time()
            k, _ = inner_loop.run(1, steps)
            assert k == steps
            spent[watching] = min(time.process_time() - start_s, spent.get(watching, math.inf))
    print(f" ({1e9 * spent[True] / steps:.0f} ns a step)", end="")
    return 1 - spent[False] / spent[True]


def compiling(planner: str) -> None:
    """What the first flight of a process costs, in processes of its own."""
    if not compiled.available():
        print("\ncompiling: numba is not installed (eadp[fast])")
        return
    first = (
        "import time; t = time.process_time(); import numba; n = time.process_time() - t;"
        "import math; from dataclasses import replace; from eadp.core import compiled;"
        "from eadp.api.inputs import load_flight;"
        "from eadp.simulation.loop import Outcome, fly; compiled.enable();"
        f"i = load_flight({str(ROOT / 'plans/survey.plan')!r}, scenario={str(ROOT / 'scenarios/survey.yaml')!r},"
        f"overrides={{'planner.name': {planner!r}, 'vehicle.airframe.model': 'fixed-wing', 'log_every_s': 1e9}});"
        "w = replace(i.world, clock=i.world.clock._replace(log_every_s=math.inf));"  # as in a sweep
        "f = i.flight(); t = time.process_time(); list(fly(w, f, Outcome())); a = time.process_time() - t;"
        "f = i.flight(); t = time.process_time(); list(fly(w, f, Outcome()));"
        "print(n, a, time.process_time() - t)"
    )
    print(f"\ncompiling, planner {planner}, CPU s:")
    with tempfile.TemporaryDirectory() as kept:
        for name in ("nothing kept", "kept"):
            environment = {**os.environ, "NUMBA_CACHE_DIR": kept}
            answer = subprocess.run(
                [sys.executable, "-c", first], capture_output=True, text=True, check=True, env=environment
            )
            imported, flight, second = map(float, answer.stdout.split())
            print(f"  {name:12}  import of numba {imported:.2f}, first flight {flight:.2f}, second {second:.3f}")


def growth(planner: str) -> None:
    """A flight of the survey with its final point farther and farther away."""
    print(f"\nmission length, planner {planner}:")
    far, first = 175 - 35, 0.0
    for times in (1, 4, 16):
        text = (ROOT / "plans/survey.plan").read_text()
        assert "175, 161" in text
        with tempfile.NamedTemporaryFile("w", suffix=".plan") as file:
            # laps are (10, 1) m apart
            file.write(text.replace("175, 161", f"{35 + times * far}, {147 + times * 14}"))
            file.flush()
            # a battery that lasts, and whose charge falls as far in each flight
            overrides = {
                "vehicle.airframe.model": "fixed-wing",
                "planner.name": planner,
                "battery.capacity_ah": 1.0 * times,
                "log_every_s": 1e9,
                "time_limit_s": 1e5,
                "faults": [],
            }
            inputs = load_flight(file.name, scenario=str(ROOT / "scenarios/survey.yaml"), overrides=overrides)
        compiled.enable()
        spent = []
        for _ in range(3):
            flight, outcome = inputs.flight(), Outcome()
            start_s = time.process_time()
            for _ in fly(inputs.world, flight, outcome):
                pass
            spent.append(time.process_time() - start_s)
        assert outcome.completed, outcome.reason
        each = statistics.median(spent)
        first = first or each / outcome.duration_s
        print(f"  {times:2d} times: {outcome.duration_s:7.0f} s flown in {1e3 * each:6.1f} ms: ", end="")
        second = each / outcome.duration_s
        print(f"{1e6 * second:.0f} us for each second, {second / first:.2f} of the first's")


class Sample(NamedTuple):
    """A running sweep at a time: rows stored, the progress line's count, CPU and memory of the processes."""

    time_s: float
    stored: int
    shown: int
    command_s: float
    command_mb: float
    workers_s: float
    workers_mb: float


def watched(command: list[str], out: Path, workers: Callable[[int], list[int]]) -> list[Sample]:
    """A sweep's command, run on a terminal and sampled to its end."""
    own, theirs = pty.openpty()
    seen, shown, start_s = [], 0, time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs) as process:
        os.close(theirs)
        while process.poll() is None:
            while select.select([own], [], [], 0)[0]:
                with contextlib.suppress(OSError):
                    shown = max([shown, *map(int, re.findall(rb"(\d+) of \d+ runs", os.read(own, 1 << 16)))])
                    continue
                break
            stored, now_s = rows(out), time.perf_counter() - start_s
            seen.append(Sample(now_s, stored, shown, *usage([process.pid]), *usage(workers(process.pid))))
            time.sleep(0.25)
    os.close(own)
    assert process.returncode == 0, command
    return seen


def usage(processes: list[int]) -> tuple[float, float]:
    """CPU time [s] and memory [MB] of processes."""
    cpu = resident = 0.0
    for process in processes:
        with contextlib.suppress(OSError):
            numbers = Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2].split()
            cpu += (int(numbers[11]) + int(numbers[12])) / os.sysconf("SC_CLK_TCK")
            resident += int(numbers[21]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    return cpu, resident


def children(parent: int) -> list[int]:
    """The processes of a pool."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            if path.read_text().rpartition(") ")[2].split()[1] == str(parent):
                found.append(int(path.parent.name))
    return found


def scale(folder: Path, planner: str, count: int, seed: int) -> bool:
    """The command with one worker and with two: rate, CPU, memory; whether its progress is true."""
    sampled(folder, count, seed, planner)
    command = [sys.executable, "-m", "eadp", "sweep", str(folder / f"sweep-{planner}-{count}.yaml"), "--format", "csv"]
    true, runs = True, defaultdict(list)
    for jobs, kind in ((1, "pool"), (2, "pool"), (2, "pool"), (1, "pool"), (1, "cluster"), (2, "cluster")):
        out = folder / f"scale-{planner}-{kind}-{jobs}-{len(runs[kind, jobs])}.db"
        if kind == "pool":
            seen = watched([*command, "-o", str(out), "--jobs", str(jobs)], out, children)
        elif importlib.util.find_spec("distributed"):
            from distributed import LocalCluster

            with LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster:
                pids = [nanny.pid for nanny in cluster.workers.values()]
                address = cluster.scheduler_address
                seen = watched([*command, "-o", str(out), "--scheduler", address], out, lambda _, pids=pids: pids)
        else:
            continue
        with contextlib.closing(sqlite3.connect(out)) as connection:
            warm = f"SELECT took_s FROM runs ORDER BY rowid LIMIT -1 OFFSET {count // 10}"  # nothing is compiled there
            (took_s,) = connection.execute(f"SELECT avg(took_s) FROM ({warm})").fetchone()
        runs[kind, jobs].append(Measured.of(seen, took_s, jobs))
        # what is shown is in the file, and what was in the file a second before is shown
        late = [(seen[k - 8].stored, sample) for k, sample in enumerate(seen) if k >= 8]
        true &= all(before <= sample.shown + jobs <= sample.stored + jobs for before, sample in late)
    _print_scale(planner, count, runs)
    print(f"  progress: {'rows are stored as it goes, and each count is of rows stored' if true else 'NOT TRUE'}")
    return true


class Measured(NamedTuple):
    """Of the middle of a sweep: flights a second, time and CPU of one, busy share, memory; wall time of all."""

    rate: float
    took_ms: float
    worker_ms: float
    command_ms: float
    busy: float
    wall_s: float
    memory_mb: str

    @classmethod
    def of(cls, seen: list[Sample], took_s: float, jobs: int) -> Measured:
        """From the samples, without the start and the end."""
        count = seen[-1].stored
        middle = [sample for sample in seen if 0.1 * count <= sample.stored <= 0.95 * count]
        first, last = middle[0], middle[-1]
        flights, wall_s = last.stored - first.stored, last.time_s - first.time_s
        worker_ms, command_ms = (
            1e3 * (getattr(last, name) - getattr(first, name)) / flights for name in ("workers_s", "command_s")
        )
        memory = f"{first.command_mb:.0f} to {last.command_mb:.0f}"
        if last.workers_mb:
            memory += f", {first.workers_mb:.0f} to {last.workers_mb:.0f}"
        busy = took_s * flights / wall_s / jobs
        return cls(flights / wall_s, 1e3 * took_s, worker_ms, command_ms, busy, seen[-1].time_s, memory)


def _print_scale(planner: str, count: int, runs: dict[tuple[str, int], list[Measured]]) -> None:
    """Each sweep; the efficiency of two workers, and what of it is the machine's: flights that take longer together."""
    print(f"\n{count} flights, planner {planner}:")
    titles = "flights/s", "ms a flight", "CPU of a worker", "of the command [ms]", "busy", "all [s]", "memory [MB]"
    print(head("workers", *titles))
    for (kind, jobs), each in runs.items():
        for one in each:
            figures = one.rate, one.took_ms, one.worker_ms, one.command_ms
            cells = (
                *(f"{figure:.2f}" for figure in figures),
                f"{100 * one.busy:.0f} %",
                f"{one.wall_s:.0f}",
                one.memory_mb,
            )
            print(line(f"{kind} {jobs}", *cells))
    for kind in dict.fromkeys(kind for kind, _ in runs):
        alone, both = (max(runs[kind, jobs], key=lambda one: one.rate) for jobs in (1, 2))
        efficiency, machine = both.rate / alone.rate / 2, alone.took_ms / both.took_ms
        print(f"  {kind}: efficiency {100 * efficiency:.1f} %; flights together take {machine:.3f} of ", end="")
        print(f"their speed alone, so {100 * efficiency / machine:.1f} % is the sweep's own")


def overhead(folder: Path, count: int) -> None:
    """Time per run that flies nothing."""
    path = folder / "nothing.yaml"
    path.write_text(f"schema: eadp.sweep/1\nplan: {ROOT}/plans/survey.plan\nseeds: {count}\n")
    start_s = time.process_time()
    sweep = read_sweep(read_text(str(path)))
    for index in range(count):
        sweep.run(index)
    print(f"\noverhead of a run that flies nothing, {count} of them, stored in a file:")
    print(f"  its inputs and their hash   {1e6 * (time.process_time() - start_s) / count:7.1f} us CPU")
    for name, jobs in (("in this process", 0), ("in a pool of one", 1)):
        wall, cpu, results = measured(partial(swept, sweep, nothing, jobs, folder / f"nothing-{jobs}.db"))
        assert len(results) == count
        print(f"  {name:<26} {1e6 * cpu / count:8.1f} us CPU, {1e6 * wall / count:.1f} us wall")
    start_s = time.process_time()
    with contextlib.closing(Results(str(folder / "nothing-0.db"))) as results_file:
        results_file.expect(sweep.run(index).key for index in range(count))
        assert not results_file.missing()
    print(f"  found made already          {1e6 * (time.process_time() - start_s) / count:7.1f} us CPU")


def memory(folder: Path, planner: str, count: int, seed: int) -> None:
    """Largest resident set of a worker."""
    sweep = sampled(folder, count, seed, planner)
    bare = swept(sampled(folder, 1, seed), resident_mb, 1, None)[0].summary
    results = swept(sweep, FlyAndWeigh(FlyRun(sweep.kept)), 1, None)
    sizes = [result.summary["duration_s"] for result in results if result.summary]
    first, last = sizes[0], sizes[-1]
    print(
        f"\nmemory of a worker, planner {planner}: {bare['duration_s'] if bare else 0:.0f} MB without a flight, ",
        end="",
    )
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
            if turn % 2:  # while it stores rows; else at any time from the start of the process
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
    printed, wanted = done.stdout.count("\n") - 1, 20000
    print(f"  then run to its end (exit {done.returncode}): of {wanted} runs, {wanted - there} lost and ", end="")
    print(f"{stored - there + repeated} made twice; {printed} rows printed; file: {sound}")
    return (there, stored, repeated, printed, sound, done.returncode) == (wanted, wanted, 0, wanted, "ok", 0)


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
    parser.add_argument("--planner", nargs="+", default=["static", "paper", "joint"])
    parser.add_argument("--flights", type=int, nargs="+", default=[10, 100], help="sizes of sweeps that fly")
    parser.add_argument("--workers", type=int, default=100, help="flights of a sweep at scale; 0 for none")
    parser.add_argument("--nothing", type=int, default=20000, help="runs that fly nothing")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=120.0, help="most that the sweep that was killed may take")
    parser.add_argument("--seed", type=int, default=0)
    add_option(parser, "sweep")
    asked = parser.parse_args()
    with recorded("sweep", write=asked.write):
        return _all(asked)


def _all(asked: argparse.Namespace) -> int:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory() as name:
        folder, true = Path(name), True
        for planner in asked.planner:
            throughput(folder, planner, asked.flights, asked.seed)
            breakdown(folder, planner, 10, asked.seed)
            growth(planner)
            compiling(planner)
            if asked.workers:
                true &= scale(folder, planner, asked.workers, asked.seed)
            memory(folder, planner, min(300, max(asked.flights)), asked.seed)
        overhead(folder, asked.nothing)
        sound = kills(folder, asked.kills, asked.seconds, asked.seed) if asked.kills else True
    return 0 if sound and true else 1


if __name__ == "__main__":
    sys.exit(main())
