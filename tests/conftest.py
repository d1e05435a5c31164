"""Settings and fixtures that tests share."""

import gc
import importlib.util
import os
import sys
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import pytest
from common import ROOT, draw_nothing, evenly
from common.browser import ABSENT, CHROMIUM, Browser
from hypothesis import HealthCheck, Phase, settings

from eadp import plug_ins
from eadp.check.proof import AlgebraProcess
from eadp.cli.main import main
from eadp.cli.output import Progress
from eadp.core import compiled
from eadp.io.plan import sources
from eadp.io.text import yaml
from eadp.papers.power import PowerTracker
from eadp.planning import registry

gc.disable()  # until all tests are collected: nothing of them is garbage

# The quick tier draws the same examples each time, so that more of them would find nothing new; the slow tier draws new
# ones. Of a test that is to fall, any failing example will do. A loaded machine makes the generation of inputs slow,
# which is no fault of a test. None depends on the clock.
settings.register_profile("base", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("quick", settings.get_profile("base"), max_examples=10, derandomize=True)
settings.register_profile("slow", settings.get_profile("base"), max_examples=50)
settings.register_profile(
    "any", settings.get_profile("quick"), max_examples=15, phases=(Phase.explicit, Phase.generate)
)
settings.load_profile("quick")
Progress.__init__.__defaults__ = (float("inf"),)  # no line of progress, which the clock of a slow machine would draw

# Machine code is compiled once for each version of the sources: by all tests, their processes and pytest's workers
# together, and kept between runs.
os.environ.setdefault("NUMBA_CACHE_DIR", os.path.join(tempfile.gettempdir(), f"eadp-tests-{os.getuid()}"))


class Solution(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


@pytest.fixture
def eadp(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    """Run a command in the repository's root."""
    monkeypatch.chdir(ROOT)

    def run(*arguments: str) -> Solution:
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Solution(code, captured.out, captured.err)

    return run


@pytest.fixture(autouse=True)
def _code_as_before():
    """What a test switches, as a sweep in this process does, is switched back for the next one."""
    before = compiled.enabled()
    yield
    compiled.enable(before)


@pytest.fixture(scope="session", autouse=True)
def _read_once():
    """Nodes of a document, plans, and what is installed, which are never changed, are those that were read before."""
    nodes, parsed = {}, yaml._Loader.get_single_node
    plan, entry_points = lru_cache(100)(sources.read_plan), plug_ins._entry_points

    def known(loader):
        body = loader._source.body
        if len(nodes) > 100:  # most come once
            nodes.clear()
        if body not in nodes:
            nodes[body] = parsed(loader)
        return nodes[body]

    @lru_cache
    def installed(kind, _path):
        return entry_points(kind)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(yaml._Loader, "get_single_node", known)
        patch.setattr(sources, "read_plan", lambda text: (plan(text)[0], [*plan(text)[1]]))
        patch.setattr(plug_ins, "_entry_points", lambda kind: installed(kind, tuple(sys.path)))
        yield


@pytest.fixture(scope="session")
def _idle():
    """Processes that have imported sympy and wait for questions."""
    processes = []
    yield processes
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module", autouse=True)
def _sympy_started_once(request: pytest.FixtureRequest, _idle):
    """A check takes the process of the one before, but where the process is the subject."""
    started, left = AlgebraProcess._started, AlgebraProcess.__exit__

    def taken(self):
        if _idle and importlib.util.find_spec("sympy") is not None:
            self._process = _idle.pop()
            return self._process
        return started(self)

    def put_back(self, kind=None, *why):
        if self._process is not None and kind is None:
            _idle.append(self._process)
            self._process = None
        left(self, kind, *why)

    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name != "check":
            patch.setattr(AlgebraProcess, "_started", taken)
            patch.setattr(AlgebraProcess, "__exit__", put_back)
        yield


COMPILED = [
    "base/api", "base/cli", "base/io/figures", "base/io/flight", "base/planning", "base/simulation/test_fixed_wing.py",
    "base/simulation/test_reproduction.py", "base/simulation/test_wind_over_time.py", "exchange", "live", "measure",
    "report", "survey", "sweep/test_sweep_command.py", "sweep/test_sweep_file.py",
]  # fmt: skip
"""Tests of whole flights whose subject is not the plain form of the code, beside those of this folder."""


@pytest.fixture(scope="module", autouse=True)
def _machine_code(request: pytest.FixtureRequest):
    """Flights of these tests are compiled, where numba is installed."""
    path = request.path.relative_to(ROOT / "tests")
    compiled.enable(path.parent.name == "" or any(path.is_relative_to(name) for name in COMPILED))
    yield
    compiled.enable(False)


DRAWN = {"base/io/figures/test_flight.py", "base/api/test_flight.py", "test_notebook.py", "test_pictures.py"}
"""Tests whose subject is a figure of a result folder, or all of it: elsewhere these are empty files."""

PAGES = {"report/test_flight.py", "test_words.py"}
"""Tests whose subject is the page of a result folder."""


@pytest.fixture(scope="module", autouse=True)
def _undrawn(request: pytest.FixtureRequest):
    """No figures and pages in result folders, where they are not the subject."""
    with pytest.MonkeyPatch.context() as patch:
        path = request.path.relative_to(ROOT / "tests").as_posix()
        if path not in DRAWN:
            draw_nothing(patch, page=path not in PAGES)
        yield patch


@pytest.fixture
def drawn(_undrawn: pytest.MonkeyPatch):
    """Figures and pages for one test of another file."""
    _undrawn.undo()
    yield
    draw_nothing(_undrawn)


class Unestimated(PowerTracker):
    """Forecasts that the power stays as it was read last: the estimate takes a fifth of a flight's time."""

    def _observe(self, time_s: float, power_w: float | None, computing_w: float) -> None:
        self._forecast_w = self._forecast_w if power_w is None else power_w


PLANNING = ["base/planning/forecast", "base/planning/joint", "base/planning/state"]
UNESTIMATED = ["base/cli", *PLANNING, "exchange", "live", "survey"]
"""Tests whose subject is not the estimate in a flight's log."""


@pytest.fixture(scope="module", autouse=True)
def _unestimated(request: pytest.FixtureRequest):
    """No estimates in the logs of these tests' flights; the planners' own are as they are."""
    path = request.path.relative_to(ROOT / "tests")
    with pytest.MonkeyPatch.context() as patch:
        if any(path.is_relative_to(name) for name in UNESTIMATED):
            patch.setattr(
                registry, "plug_in", lambda *of: Unestimated if of[0] == "estimators" else plug_ins.plug_in(*of)
            )
        yield


@pytest.hookimpl(tryfirst=True)  # before -m chooses by the marker
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files of whole flights and pages come first, so that no worker is left alone with them at the end.

    Behind the first of them are some without flights: machine code is then made by one of two workers.

    Of a test marked `quick(n)`, cases beyond n, spread evenly, are slow.

    Tests in a browser are marked, and skipped where there is none, unless `EADP_BROWSER=required`.
    """
    pages = sorted(path.name for path in (ROOT / "tests").glob("test_*.py"))
    plain = ["test_spectrum.py", "test_proof.py", "test_fit_command.py", "test_fit_pictures.py", "test_autopilot.py"]
    first = ["test_public.py", *plain, "test_sweep_command.py", *pages]
    items.sort(key=lambda item: first.index(item.path.name) if item.path.name in first else len(first))
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("quick") and not item.get_closest_marker("slow"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for each in cases.values():
        (count,) = each[0].get_closest_marker("quick").args  # type: ignore[union-attr]
        for i in {*range(len(each))} - evenly(len(each), count):
            each[i].add_marker(pytest.mark.slow)
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.browser)
            if CHROMIUM is None and os.environ.get("EADP_BROWSER") != "required":
                item.add_marker(pytest.mark.skip(reason=ABSENT))


def pytest_collection_finish() -> None:
    """Modules and tests, which live to the end, are looked through no more."""
    gc.freeze()
    gc.set_threshold(20_000, 20)
    gc.enable()


def pytest_unconfigure(config: pytest.Config) -> None:
    """Say in the last line, below the counts, that pages were not tested."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    reports = reporter.stats.get("skipped", ()) if reporter is not None else ()
    skipped = [report for report in reports if "browser" in getattr(report, "keywords", ())]
    if skipped:
        reporter.write_line(f"{len(skipped)} tests of pages were skipped: {ABSENT}", yellow=True)


@pytest.fixture(scope="session")
def browser():
    """The browser in which pages are opened, started once."""
    with Browser() as opened:
        yield opened


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository's root."""
    return ROOT


@pytest.fixture(scope="session")
def reference() -> Path:
    """Published data to compare with; tests that use it are skipped where it is absent."""
    folder = ROOT.parent / "shared" / "reference"
    if not folder.is_dir():
        pytest.skip("the published reference data are not on this machine")
    return folder
