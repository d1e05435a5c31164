"""One run of a sweep: loaded from texts that are read once, flown without a log, and summed up."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeVar

from eadp import __version__
from eadp.core.compiled import switch_on
from eadp.errors import EadpError, Fault, InputError, printable
from eadp.io.energy.model_file import parse_energy
from eadp.io.flight.folder import summarise
from eadp.io.flight.inputs import Files, FlightInputs, load_flight
from eadp.io.plan.text import read_plan
from eadp.io.profile.model_file import ends_as_model, parse_profile
from eadp.io.scenario.scenario_file import Scenario, scenario_document, scenario_of
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import Document
from eadp.models.energy import EnergyModel
from eadp.models.plan.plan import Finding, Plan
from eadp.models.profile_sum import AnyProfile
from eadp.simulation.loop import Outcome, fly
from eadp.simulation.sweep.design import Result, Run

UNLOGGED_S = 1e9
CLOCKED = ("median_ms", "max_ms")
"""Of a summary's solver, what depends on the machine and its load."""

Read = TypeVar("Read")


class KeptFiles(Files):
    """Files whose texts came with the work; each is parsed once. Pickled, it is the texts alone."""

    def __init__(self, texts: dict[str, Text]) -> None:
        self.texts = texts
        self._kept: dict[tuple[str, str], Any] = {}

    def __getstate__(self) -> tuple[str, dict[str, Text]]:
        return __version__, self.texts

    def __setstate__(self, state: tuple[str, dict[str, Text]]) -> None:
        version, self.texts = state
        self._kept = {}
        if version != __version__:  # another version's flights may be others
            raise EadpError(f"this is eadp {__version__}")

    def text(self, path: str) -> Text:
        """A file's text."""
        return self.texts[path]

    def plan(self, path: str) -> tuple[Text, Plan, Sequence[Finding]]:
        """A plan's text, the plan, and what reading it shows."""
        plan, findings = self._once("plan", path, read_plan)
        return self.text(path), plan, findings

    def scenario(self, path: str | None, overrides: Mapping[str, Any] | None) -> Scenario:
        """A scenario with some keys set anew."""
        document = self.scenario_document(path)
        return scenario_of(document, overrides, self.vehicle_text)

    def scenario_document(self, path: str | None) -> Document:
        """A scenario's document, or that of the defaults."""
        return Document("scenario", {}) if path is None else self._once("scenario", path, scenario_document)

    def vehicle_text(self, path: str) -> Text:
        """A vehicle file's text: its path shows only in a scenario, so it is read when that is first read."""
        if path not in self.texts:
            self.texts[path] = read_text(path)
        return self.texts[path]

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
    """Makes runs: a function of a run that can be sent to another process.

    `fast` is whether flights are compiled where they can be.
    """

    def __init__(self, files: KeptFiles, *, fast: bool = True) -> None:
        self._files = files
        self._fast = fast
        self._warm = False

    def __call__(self, run: Run) -> Result:
        """Fly; whatever goes wrong is the result's error."""
        if switch_on(self._fast) and not self._warm:
            self._warm = True
            self._begin(run)
        begun_s = time.perf_counter()
        try:
            return Result(self._summary(run), None, time.perf_counter() - begun_s)
        except Exception as error:
            return Result(None, _told(error), time.perf_counter() - begun_s)

    def _begin(self, run: Run) -> None:
        """Fly a step, so that machine code is loaded before a run is timed: a sweep is estimated from its runs."""
        with suppress(Exception):  # it is the run's to tell
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
        json.dumps(summary, allow_nan=False)  # a figure that cannot be kept is this run's error
        return summary


def _told(error: Exception) -> str:
    """An error in one line; a fault of a key that was set is named by the key alone."""
    if isinstance(error, InputError):
        return "; ".join(_fault(fault) for fault in error.faults)
    if isinstance(error, EadpError):
        return printable(str(error), 1000)
    return f"a bug in eadp: {type(error).__name__}: {printable(str(error), 1000)}"


def _fault(fault: Fault) -> str:
    head = str(replace(fault, source=""))
    return head.partition(": error: ")[2] if fault.file.startswith("--set") else head
