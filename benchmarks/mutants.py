"""Mutation test: random changes of one operator or number, each against the tests of its own layer; by hand.

usage: python benchmarks/mutants.py [--count 200] [--seed 0] [--layers core models planning] [--only TEXT ...] [--slow]

The operators are mutmut's (pip install mutmut coverage), and `return x` to `return None`. The rest is our own: mutmut
leaves properties alone and runs all tests. A mutant of `eadp/core` has to fail a test of `tests/base/core`, one of a
room a test of `tests/ROOM`, of the quick tier or, with `--slow`, of both. Coverage records once which test executes
which line, and keeps it in `build/mutants` until the sources change. A mutant meets the tests that execute its
statement, the quickest first, until one fails; a hang is a failure. Processes are forked with the libraries imported.
Prints the mutants that survive or hang and the counts of each layer.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import importlib.machinery
import json
import os
import random
import resource
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")  # processes are forked
os.environ.update(NUMBA_DISABLE_JIT="1")  # machine code of a mutant would be kept as the package's own

import coverage
import hypothesis
import libcst as cst
import libcst.matchers as m
import measured
import pytest
from libcst.metadata import MetadataWrapper, PositionProvider
from mutmut.mutation import mutators

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "build" / "mutants"
TIER = ["not slow"]
"""Tests that count, as pytest's -m."""
LIBRARIES = (
    "coverage.types numpy scipy.linalg scipy.optimize scipy.signal scipy.stats shapely sympy osqp numba typer yaml"
)

# Mutants that survived, and why, so that a new run need not look into them again.
# - planning/state/charge.py: after a jump no outlier → one: no reading is an outlier until four more have come
# - models/plan/structure.py: > 1e-6 * (1 + …) → >=: differs where a rounded difference is the tolerance to the last
#   digit
# - models/plan/structure.py: samples at 1 + 0.1 i → 1 + 1.1 i: any distinct samples do
# - models/plan/executor.py: turned < -π → <=: a half turn within one step, which has no direction
# - models/plan/executor.py: abs(dy) < 1e-9 → <=: a shift of exactly 1e-9 m
# - core/geometry/dubins.py: ceil(36 / fall) → 37: one harmonic more than is needed for rounding
# - core/flight.py: a crosswind < the airspeed → <=: differs where both are the same to the last digit
# - core/expressions/derivatives.py: a zero depends on the point, False → True: the value is the same, computed later
# - core/flight.py: INITIAL_GUST_MPS**2 → **3: it is 1
# - core/expressions/algebra.py: probes at 1 + 0.07 … → 2 + …: any distinct points do
# - planning/state/motion.py: UNKNOWN_W 1000 → 1001: a prior that says nothing either way


def _returned(node: cst.Return) -> list[cst.Return]:
    """`return x` becomes `return None`."""
    return [] if node.value is None or m.matches(node.value, m.Name("None")) else [cst.Return(cst.Name("None"))]


OPERATORS: list[tuple[type, Callable[[Any], Iterable[cst.CSTNode]]]] = [
    (cst.BaseNumber, mutators.operator_number),
    (cst.Name, mutators.operator_name),
    (cst.UnaryOperation, mutators.operator_remove_unary_ops),
    (cst.CSTNode, mutators.operator_keywords),
    (cst.CSTNode, mutators.operator_swap_op),
    (cst.IfExp, mutators.operator_if_exp),
    (cst.Return, _returned),
]


class Site(NamedTuple):
    """A possible change: the statement's lines up to it, and whether it runs in a function."""

    before: cst.CSTNode
    after: cst.CSTNode
    lines: range
    in_function: bool


class Mutant(NamedTuple):
    """A changed file, the change in words, and the tests that it meets in their order with their CPU seconds."""

    file: str
    text: str
    change: str
    tests: dict[str, float]


class Changes(cst.CSTVisitor):
    """All changes of a module, but for annotations, decorators and default values of fields."""

    METADATA_DEPENDENCIES = (PositionProvider,)

    def __init__(self) -> None:
        self.sites: list[Site] = []
        self._scopes: list[cst.CSTNode] = []
        self._statements: list[cst.CSTNode] = []

    def on_visit(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.Annotation | cst.Decorator):
            return False
        if isinstance(node, cst.FunctionDef | cst.ClassDef):
            self._scopes.append(node)
        if isinstance(node, cst.BaseStatement | cst.BaseSmallStatement):
            self._statements.append(node)
        if not (self._scopes and isinstance(self._scopes[-1], cst.ClassDef)):
            for kind, operator in OPERATORS:
                if isinstance(node, kind):
                    self.sites += [self._site(node, after) for after in operator(node)]
        return True

    def on_leave(self, node: cst.CSTNode) -> None:
        for stack in (self._scopes, self._statements):
            if stack and stack[-1] is node:
                stack.pop()

    def _site(self, node: cst.CSTNode, after: cst.CSTNode) -> Site:
        start = self.get_metadata(PositionProvider, self._statements[-1]).start.line
        own = self.get_metadata(PositionProvider, node, None)
        return Site(node, after, range(start, (own.end.line if own else start) + 1), bool(self._scopes))


class Recorder:
    """Plugin: which test executes which line, and how long each takes."""

    def __init__(self) -> None:
        self.coverage = coverage.Coverage(data_file=None, source=[str(ROOT / "eadp")], config_file=False)
        self.tests: dict[str, float] = {}
        self.faults: list[str] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.coverage.switch_context(item.nodeid)
        started = time.process_time()
        result = yield
        self.tests[item.nodeid] = time.process_time() - started
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.faults.append(report.nodeid)

    def lines(self) -> dict[str, dict[int, list[str]]]:
        """Tests of each line of each file."""
        data = self.coverage.get_data()
        return {str(Path(file).relative_to(ROOT)): data.contexts_by_lineno(file) for file in data.measured_files()}


class Chosen:
    """Plugin: runs chosen tests in their order; Hypothesis does not shrink what it finds."""

    def __init__(self, tests: Iterable[str]) -> None:
        self.order = {test: place for place, test in enumerate(tests)}

    def pytest_configure(self) -> None:
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        hypothesis.settings.register_profile("mutants", hypothesis.settings.get_profile("quick"), phases=phases)
        hypothesis.settings.load_profile("mutants")

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted((i for i in items if i.nodeid in self.order), key=lambda item: self.order[item.nodeid])


def run_pytest(plugin: object, *arguments: str) -> int:
    """pytest's exit code in this process, where hypothesis is imported before it; keeps no cache."""
    options = ["-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning", "-m", TIER[0]]
    return int(pytest.main([*options, *arguments], plugins=[plugin]))


def record(test_file: str, kept: Path) -> None:
    """Record the tests of one file; a test that fails is of no use and is named."""
    recorder = Recorder()
    recorder.coverage.start()
    run_pytest(recorder, test_file)
    recorder.coverage.stop()
    tests = {test: taken_s for test, taken_s in recorder.tests.items() if test not in recorder.faults}
    kept.write_text(json.dumps({"tests": tests, "lines": recorder.lines(), "faults": recorder.faults}))


def fall(mutant: Mutant) -> None:
    """End this process: 0 where all tests pass."""
    path, original = str(ROOT / mutant.file), importlib.machinery.SourceFileLoader.get_code

    def get_code(loader: Any, name: str) -> Any:
        if loader.path == path:
            return compile(mutant.text, path, "exec", dont_inherit=True)
        return original(loader, name)

    importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign]
    limit_s = int(20 + 5 * sum(mutant.tests.values()))
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
    os._exit(run_pytest(Chosen(mutant.tests), "-x", *sorted({test.split("::")[0] for test in mutant.tests})))


def _ended(running: dict[int, Any]) -> tuple[Any, int]:
    """The next of these processes to end; others, which a library has started, may end before it."""
    while True:
        process, status = os.wait()
        if process in running:
            return running.pop(process), status


def forked(tasks: Iterable[tuple[Any, Callable[[], None]]], jobs: int) -> Iterator[tuple[Any, int]]:
    """Run each task in a process of its own, `jobs` at a time; its name and its exit status, in order of their ends."""
    running: dict[int, Any] = {}
    for name, task in tasks:
        if len(running) == jobs:
            yield _ended(running)
        process = os.fork()
        if not process:
            silent = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silent, 1)
            os.dup2(silent, 2)
            task()
            os._exit(0)
        running[process] = name
    while running:
        yield _ended(running)


def digest(paths: Iterable[Path]) -> str:
    """Hash of files."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(paths))).hexdigest()[:12]


def recorded(layer: str, jobs: int) -> tuple[dict[str, float], dict[str, dict[int, set[str]]]]:
    """CPU seconds of each test of a layer, and the tests of each line of each file."""
    KEPT.mkdir(parents=True, exist_ok=True)
    shared = digest([*(ROOT / "eadp").rglob("*.py"), *(ROOT / "tests/support").rglob("*.py")])
    own = ROOT / "tests/base" / layer
    files = sorted((own if own.is_dir() else ROOT / "tests" / layer).rglob("test_*.py"))
    tier = "quick" if TIER[0] else "slow"
    kept = {file: KEPT / f"{file.stem}-{tier}-{shared}-{digest([file])}.json" for file in files}
    missing = [
        (file, lambda file=file: record(str(file.relative_to(ROOT)), kept[file]))
        for file in files
        if not kept[file].exists()
    ]
    for file, _ in forked(missing, jobs):
        print(f"recorded {file.relative_to(ROOT)}", file=sys.stderr)
    tests: dict[str, float] = {}
    lines: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
    for path in kept.values():
        record_ = json.loads(path.read_text())
        tests |= record_["tests"]
        for test in record_["faults"]:
            print(f"fails without a mutant, left out: {test}", file=sys.stderr)
        for file, by_line in record_["lines"].items():
            for line, names in by_line.items():
                lines[file][int(line)] |= {*names}
    return tests, lines


def sites(layer: str) -> tuple[dict[str, cst.Module], list[tuple[str, Site]]]:
    """The modules of a layer, and all their possible changes."""
    modules: dict[str, cst.Module] = {}
    found: list[tuple[str, Site]] = []
    for path in sorted((ROOT / "eadp" / layer).rglob("*.py")):
        wrapper, changes = MetadataWrapper(cst.parse_module(path.read_text(encoding="utf-8"))), Changes()
        wrapper.visit(changes)
        file = str(path.relative_to(ROOT))
        modules[file] = wrapper.module
        found += [(file, site) for site in changes.sites]
    return modules, found


def mutants(layers: list[str], count: int, seed: int, only: list[str], jobs: int) -> Iterator[Mutant]:
    """Random mutants, each layer's share in proportion to its possible ones, and the tests that each meets."""
    possible = {layer: sites(layer) for layer in layers}
    total = sum(len(found) for _, found in possible.values())
    known = {layer: recorded(layer, jobs) for layer in layers}  # first: one loop at a time waits for processes
    for layer, (modules, found) in possible.items():
        share = round(min(count, total) * len(found) / total)
        print(f"{layer}: {share} of {len(found)} possible mutants", file=sys.stderr)
        tests, lines = known[layer]
        for file, site in random.Random(seed).sample(found, share):
            if not any(part.split(":")[0] in file for part in only):
                continue
            text = modules[file].deep_replace(site.before, site.after).code
            change = described(modules[file].code, text)
            if not any(part in f"{file}:{change}" for part in only):
                continue
            met = set().union(*(lines[file][line] for line in site.lines))
            if (met and met <= {""}) or not site.in_function:  # executed on import
                met = set().union(*lines[file].values())
            chosen = {test: tests[test] for test in sorted(met & tests.keys(), key=lambda test: tests[test])}
            yield Mutant(file, text, change, chosen)


def described(before: str, after: str) -> str:
    """The changed lines with the number of the first."""
    old, new = before.split("\n"), after.split("\n")
    first = next(k for k, (a, b) in enumerate(zip(old, new, strict=False)) if a != b)
    if len(old) != len(new):
        return f"{first + 1}: {old[first].strip()}  →  {new[first].strip()}"
    last = max(k for k, (a, b) in enumerate(zip(old, new, strict=True)) if a != b)
    join = lambda text: " ".join(line.strip() for line in text[first : last + 1])  # noqa: E731
    return f"{first + 1}: {join(old)}  →  {join(new)}"


def main() -> None:
    """Run the mutants, print those that survive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--layers", nargs="+", default=["core", "models", "planning"])
    parser.add_argument("--only", nargs="+", default=[""], help="of these alone: parts of FILE:LINE: CHANGE")
    parser.add_argument("--slow", action="store_true", help="with the tests of the slow tier")
    parser.add_argument("--jobs", type=int, default=2)
    _run(parser.parse_args())


def _run(options: argparse.Namespace) -> None:
    os.chdir(ROOT)
    TIER[0] = "" if options.slow else "not slow"
    for library in LIBRARIES.split():
        importlib.import_module(library)
    chosen = mutants(options.layers, options.count, options.seed, options.only, options.jobs)
    counts: Counter[tuple[str, str]] = Counter()
    untested: list[Mutant] = []

    def tasks() -> Iterator[tuple[Mutant, Callable[[], None]]]:
        for mutant in chosen:
            if mutant.tests:
                yield mutant, lambda mutant=mutant: fall(mutant)
            else:
                untested.append(mutant)

    def report(mutant: Mutant, result: str) -> None:
        counts[mutant.file.split("/")[1], result] += 1
        if result != "falls":
            print(f"{result}: {mutant.file}:{mutant.change}", flush=True)

    for mutant, status in forked(tasks(), options.jobs):
        code = os.waitstatus_to_exitcode(status)
        report(mutant, "survives" if code == 0 else "hangs" if code < 0 else "falls")
    for mutant in untested:
        report(mutant, "no test")
    print(f"{options.count} mutants, seed {options.seed}")
    of = {layer: [counts[layer, one] for one in ("falls", "hangs", "survives", "no test")] for layer in options.layers}
    measured.table(
        ("layer", "mutants", "fall", "hang", "survive", "no test"),
        ([layer, sum(each), *each] for layer, each in of.items()),
    )
    fallen = sum(n for (_, result), n in counts.items() if result in ("falls", "hangs"))
    print(f"{fallen} of {counts.total()} fall, {100 * fallen / max(1, counts.total()):.1f} %")


if __name__ == "__main__":
    main()
