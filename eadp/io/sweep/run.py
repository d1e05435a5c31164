"""One run of a sweep: loaded from texts that are read once, flown without a log, and summarised."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

from eadp import __version__
from eadp.core.compiled import enable
from eadp.errors import EadpError, Fault, InputError, printable
from eadp.io.flight.folder import summarise
from eadp.io.flight.inputs import Content, Files, FlightInputs, load_flight
from eadp.io.text.streams import Text, read_text
from eadp.simulation.loop import Outcome, fly
from eadp.simulation.sweep.design import Result, Run

UNLOGGED_S = 1e9
CLOCKED = ("median_ms", "max_ms")
"""Keys of a summary's solver that depend on the machine and its load."""


class KeptFiles(Files):
    """Files whose texts are sent with the runs; each is parsed once. Only the texts are pickled."""

    def __init__(self, texts: dict[str, Text]) -> None:
        self.texts = texts
        self._kept: dict[tuple[str, Callable[[Text], Any]], Any] = {}

    def __getstate__(self) -> tuple[str, dict[str, Text]]:
        return __version__, self.texts

    def __setstate__(self, state: tuple[str, dict[str, Text]]) -> None:
        version, self.texts = state
        self._kept = {}
        if version != __version__:  # another version's flights may differ
            raise EadpError(f"this is eadp {__version__}")

    def text(self, path: str) -> Text:
        """A file's text; a vehicle file's path shows only in a scenario, so its text is added when that is read."""
        if path not in self.texts:
            self.texts[path] = read_text(path)
        return self.texts[path]

    def read(self, path: str, parse: Callable[[Text], Content]) -> tuple[Text, Content]:
        """A file's text and content."""
        if (path, parse) not in self._kept:
            self._kept[path, parse] = super().read(path, parse)
        result: tuple[Text, Content] = self._kept[path, parse]
        return result

    def load(self, run: Run) -> FlightInputs:
        """A run's flight, ready to be flown."""
        return load_flight(
            run.files["plan"],
            scenario_path=run.files.get("scenario"),
            profile_path=run.files.get("profile"),
            energy_path=run.files.get("energy"),
            overrides=run.overrides,
            files=self,
        )


class FlyRun:
    """A function that makes runs and can be sent to another process.

    `fast` is whether flights are compiled if possible.
    """

    def __init__(self, files: KeptFiles, *, fast: bool = True) -> None:
        self._files = files
        self._fast = fast
        self._warm = False

    def __call__(self, run: Run) -> Result:
        """Fly; any error is in the result."""
        if enable(self._fast) and not self._warm:
            self._warm = True
            self._warm_up(run)
        start_s = time.perf_counter()
        try:
            return Result(self._summary(run), None, time.perf_counter() - start_s)
        except Exception as error:
            return Result(None, _message(error), time.perf_counter() - start_s)

    def _warm_up(self, run: Run) -> None:
        """Fly a step, so that machine code is loaded before runs are timed for the sweep's estimate."""
        with suppress(Exception):  # the run itself reports it
            inputs = self._files.load(run)
            for _ in fly(replace(inputs.world, time_limit_s=inputs.world.step_s), inputs.planner(), Outcome()):
                pass

    def _summary(self, run: Run) -> dict[str, Any]:
        inputs = self._files.load(run)
        world, pilot, outcome = replace(inputs.world, log_every_s=UNLOGGED_S), inputs.planner(), Outcome()
        for _ in fly(world, pilot, outcome):
            pass
        summary = summarise(world, pilot, outcome, inputs.scenario.planner)
        summary["solver"] = {key: value for key, value in summary["solver"].items() if key not in CLOCKED}
        json.dumps(summary, allow_nan=False)  # a figure that cannot be stored is this run's error
        return summary


def _message(error: Exception) -> str:
    """An error in one line; a fault of an overridden key without its source."""
    if isinstance(error, InputError):
        return "; ".join(_fault(fault) for fault in error.faults)
    if isinstance(error, EadpError):
        return printable(str(error), 1000)
    return f"a bug in eadp: {type(error).__name__}: {printable(str(error), 1000)}"


def _fault(fault: Fault) -> str:
    head = str(replace(fault, source=""))
    return head.partition(": error: ")[2] if fault.file.startswith("--set") else head
