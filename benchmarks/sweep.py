"""What a sweep costs: flights per core-second, workers and memory.

    python benchmarks/sweep.py [--planner static paper joint] [--flights 10 100] [--nothing 20000]
                               [--seed 0] [--write]

- flights per core-second: `survey.plan`, vehicle `fixed-wing`, wind and capacity drawn, no log; compiled (`eadp[fast]`)
  and plain, in this process; CPU time from the first run to the last stored row, and how much of it is not flying
- memory: largest resident set of a worker after many flights, beside a Python that has imported the same
- overhead: runs that fly nothing, made in this process, in a pool of one and on a Dask cluster of two workers, stored
  in a file; time per run
"""

from __future__ import annotations

import contextlib
import importlib.util
import itertools
import os
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import eadp.cli  # noqa: F401 - first: its environment is one thread for linear algebra

# isort: split
from measured import options, recorded, table

from eadp.core import compiled
from eadp.io.text.streams import read_text
from eadp.sweep.engines import DaskEngine, Engine, Make, PoolEngine, Result, Run, SerialEngine
from eadp.sweep.results import Results
from eadp.sweep.run import FlyRun, make_runs
from eadp.sweep.sweep_file import Sweep, read_sweep

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


def swept(sweep: Sweep, make: Make, engine: Callable[[Make], Engine], out: Path | None) -> list[Result]:
    """All runs of a sweep, made and stored."""
    with contextlib.closing(Results(None if out is None else str(out))) as results:
        runs = [sweep.run(index) for index in range(len(sweep.design))]
        results.expect(run.key for run in runs)
        opened = engine(make)
        try:
            return [result for _, result in make_runs(runs, opened, results)]
        finally:
            opened.close()


def measured(call: Callable[[], list[Result]]) -> tuple[float, float, list[Result]]:
    """Wall time and CPU time of a call [s], and its results."""
    wall, cpu = time.perf_counter(), cpu_s()
    results = call()
    return time.perf_counter() - wall, cpu_s() - cpu, results


# --- parts


def throughput(folder: Path, planner: str, counts: list[int], seed: int) -> Iterator[list[object]]:
    """Flights per core-second, compiled and plain; of plain ones no more than the fewest; memory of a worker."""
    wanted = [(True, count) for count in counts] if compiled.available() else []
    for fast, count in [*wanted, (False, min(counts))]:
        sweep = sampled(folder, count, seed, planner)
        fly = FlyAndTime(FlyRun(sweep.kept, fast=fast))
        fly(sweep.run(0))  # compiled, parsed
        fly.cpu_s = 0.0
        _, cpu, results = measured(partial(swept, sweep, fly, SerialEngine, folder / f"{planner}-{fast}-{count}.db"))
        assert not any(result.error for result in results)
        name = "compiled" if fast else "plain"
        rate, each, rest = count / cpu, 1e3 * cpu / count, 1e3 * (cpu - fly.cpu_s) / count
        yield [planner, count, name, f"{cpu:.2f}", f"{rate:.1f}", f"{each:.1f}", f"{rest:.2f}"]


def overhead(folder: Path, count: int) -> Iterator[list[object]]:
    """Runs that fly nothing, by each engine."""
    path = folder / "nothing.yaml"
    path.write_text(f"schema: eadp.sweep/1\nplan: {ROOT}/plans/survey.plan\nseeds: {count}\n")
    sweep = read_sweep(read_text(str(path)))
    engines: dict[str, Callable[[Make], Engine]] = {
        "in this process": SerialEngine,
        "in a pool of one": lambda make: PoolEngine(make, 1),
    }
    with contextlib.ExitStack() as opened:
        if importlib.util.find_spec("distributed"):
            from distributed import LocalCluster

            local = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50)
            address = opened.enter_context(local).scheduler_address
            engines["on a Dask cluster of two"] = lambda make: DaskEngine(make, address)
        for number, (name, engine) in enumerate(engines.items()):
            wall, cpu, results = measured(partial(swept, sweep, nothing, engine, folder / f"nothing-{number}.db"))
            assert len(results) == count
            yield [name, f"{1e6 * cpu / count:.1f}", f"{1e6 * wall / count:.1f}"]


def memory(folder: Path, planner: str, count: int, seed: int) -> list[object]:
    """Largest resident set of a worker [MB]: without a flight, after the first, after many."""

    def one(make: Make) -> Engine:
        return PoolEngine(make, 1)

    bare = swept(sampled(folder, 1, seed), resident_mb, one, None)[0].summary
    sweep = sampled(folder, count, seed, planner)
    results = swept(sweep, FlyAndWeigh(FlyRun(sweep.kept)), one, None)
    sizes = [result.summary["duration_s"] for result in results if result.summary]
    return [planner, count, *(f"{size:.0f}" for size in (bare["duration_s"] if bare else 0, sizes[0], sizes[-1]))]


def main() -> None:
    """Everything in turn."""
    parser = options(__doc__, "sweep")
    parser.add_argument("--planner", nargs="+", default=["static", "paper", "joint"])
    parser.add_argument("--flights", type=int, nargs="+", default=[10, 100], help="sizes of sweeps that fly")
    parser.add_argument("--nothing", type=int, default=20000, help="runs that fly nothing")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with recorded("sweep", write=asked.write), tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        each = [throughput(folder, planner, asked.flights, asked.seed) for planner in asked.planner]
        table(
            ("planner", "flights", "", "CPU [s]", "flights per core-second", "ms each", "of it not flying"),
            itertools.chain(*each),
        )
        count = min(300, max(asked.flights))
        table(
            ("memory of a worker [MB], planner", "flights", "without a flight", "after the first", "after all"),
            (memory(folder, planner, count, asked.seed) for planner in asked.planner),
        )
        titles = f"{asked.nothing} runs that fly nothing, stored", "CPU each [us]", "wall [us]"
        table(titles, overhead(folder, asked.nothing))


if __name__ == "__main__":
    main()
