"""Folders that stand for several flights, as those of sorties: rooms and other packages bring them in."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from eadp.api.given import File, Overrides, Warn
from eadp.plug_ins import plug_ins


class FlownJob(Protocol):
    """All flights of a job that was flown."""

    @property
    def summary(self) -> dict[str, Any]:
        """With the keys of a flight's summary that both have: completed, reserve_kept, duration_s and others."""

    def text(self) -> list[str]:
        """A summary for people, line by line."""

    def write(self, folder: str | Path, *, force: bool = False) -> None:
        """Write a result folder; raises InputError as `Flight.write`."""


class JobKind(Protocol):
    """A kind of job: names of files in its folder (the job's document, its scenario, one plan), and how it is flown."""

    document: str
    scenario: str
    plan: str

    def simulate(
        self,
        folder: File,
        overrides: Overrides = (),
        seed: int = 0,
        *,
        on_flight: Callable[[str], None],
        warn: Warn,
    ) -> FlownJob:
        """Fly all of it; raises InputError with the faults of the folder."""


def job_in(path: str) -> JobKind | None:
    """The kind of a folder that stands for a job; None for a plan, and for any other folder."""
    if "\0" in path or not os.path.isdir(path):
        return None
    kinds: list[JobKind] = plug_ins("jobs")
    return next((kind for kind in kinds if os.path.isfile(os.path.join(path, kind.document))), None)


def job_of(path: str) -> JobKind | None:
    """The kind of job whose document a file is; None for a plan."""
    name = os.path.basename(path)
    kinds: list[JobKind] = plug_ins("jobs") if name.endswith(".json") else []
    return next((kind for kind in kinds if name == kind.document), None)
