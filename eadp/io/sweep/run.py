"""One run of a sweep: loaded from texts that are read once, flown without a log, and summarised."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeVar

from eadp import __version__
from eadp.core.compiled import enable
from eadp.errors import EadpError, Fault, InputError, printable
from eadp.io.energy.model_file import parse_energy
from eadp.io.flight.folder import summarise
from eadp.io.flight.inputs import Files, FlightInputs, load_flight
from eadp.io.plan.reader import read_plan
from eadp.io.profile.model_file import ends_as_model, parse_profile
from eadp.io.scenario.scenario_file import Scenario, read_scenario, scenario_document, scenario_of
from eadp.io.text.streams import Text
from eadp.io.text.yaml import Document
from eadp.models.energy import EnergyModel
from eadp.models.plan.plan import Finding, Plan
from eadp.models.profile_sum import AnyProfile
from eadp.simulation.loop import Outcome, fly
from eadp.simulation.sweep.design import Result, Run

UNLOGGED_S = 1e9
CLOCKED = ("median_ms", "max_ms")
"""Keys of a summary's solver that depend on the machine and its load."""

Read = TypeVar("Read")


class KeptFiles(Files):
    """Files whose texts are sent with the runs; each is parsed once. Only the texts are pickled."""

    def __init__(self, texts: dict[str, Text]) -> None:
        self.texts = texts
        self._kept: dict[tuple[str, str], Any] = {}

    def __getstate__(self) -> tuple[str, dict[str, Text]]:
        return __version__, self.texts

    def __setstate__(self, state: tuple[str, dict[str, Text]]) -> None:
        version, self.texts = state
        self._kept = {}
        if version != __version__:  # another version's flights may differ
            raise EadpError(f"this is eadp {__version__}")

    def text(self, path: str) -> Text:
        """A file's text."""
        return self.texts[path]

    def plan(self, path: str) -> tuple[Text, Plan, Sequence[Finding]]:
        """A plan's text, the plan, and the findings of reading it."""
        plan, findings = self._once("plan", path, read_plan)
        return self.text(path), plan, findings

    def scenario(self, path: str | None, overrides: Mapping[str, Any] | None) -> Scenario:
        """A scenario with some keys overridden."""
        if path is None:
            return read_scenario(None, overrides)
        document: Document = self._once("scenario", path, scenario_document)
        return scenario_of(document, overrides)

    def profile(self, path: str) -> tuple[AnyProfile, list[Fault]]:
        """A profile and its warnings."""
        return self._once("profile", path, lambda text: parse_profile(text, is_model=ends_as_model(path)))

    def energy(self, path: str) -> EnergyModel:
        """An energy model."""
        return self._once("energy", path, parse_energy)

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

    def _once(self, kind: str, path: str, read: Callable[[Text], Read]) -> Read:
        if (kind, path) not in self._kept:
            self._kept[kind, path] = read(self.text(path))
        result: Read = self._kept[kind, path]
        return result


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
        settings = inputs.scenario.planner
        summary = summarise(
            world, pilot, outcome, reserve_soc=settings.reserve_soc, weights=settings.weights, name=settings.name
        )
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
