"""What is given to the use cases: paths or objects, settings, folders of several flights, and where warnings go."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from eadp.errors import Fault
from eadp.io.text.options import Flag
from eadp.plug_ins import plug_ins

File = str | PathLike[str]
Overrides = Mapping[str, Any] | Iterable[str]
Warn = Callable[[Sequence[Fault]], None]
"""Takes warnings."""


@dataclass(frozen=True)
class FlightOptions:
    """What a flight is of, beside its plan."""

    scenario: Annotated[str | None, Flag(metavar="FILE")] = None
    """Scenario (YAML)."""

    profile: Annotated[str | None, Flag(metavar="FILE")] = None
    """Computation profile: its model, or the measurements."""

    energy: Annotated[str | None, Flag(metavar="FILE")] = None
    """Energy model made by eadp fit."""

    planner: Annotated[str | None, Flag(metavar="NAME")] = None
    """Which planner decides: joint, paper, static, or one that is installed."""

    set_: Annotated[Sequence[str], Flag(metavar="KEY=VALUE")] = ()
    """Set a scenario key, as in wind.speed_mps=8, spacing=20 or fps=5."""


def python_warnings(faults: Sequence[Fault]) -> None:
    for fault in faults:
        warnings.warn(str(fault), stacklevel=3)


class JobKind(NamedTuple):
    """A kind of job: the name of its document in its folder, and what flies all of it.

    `simulate` takes the folder, overrides, a seed, `on_flight`, called with the name of each flight, and `warn`, and
    raises InputError with the faults of the folder. What it returns has `summary`, with the keys that a flight's has,
    `text`, its lines for people, and `write` as `Flight` has.
    """

    document: str
    simulate: Callable[..., Any]


class PageSource(NamedTuple):
    """Results that `eadp report` makes a page of; the first of `eadp.plug_ins`' kind `pages` that recognises one does.

    Attributes
    ----------
    kind : str
        Of the page: flight or sweep.
    recognises : function
        Whether a path is such a result.
    data : function
        The page's data, of the path, the page's path, and where the folders of a sweep's flights are.
    """

    kind: str
    recognises: Callable[[Path], bool]
    data: Callable[[Path, Path, str | None], Mapping[str, Any]]


def job_in(path: str) -> JobKind | None:
    """The kind of a folder that stands for a job; None for a plan, and for any other folder."""
    if "\0" in path or not os.path.isdir(path):
        return None
    kinds: list[JobKind] = plug_ins("jobs")
    return next((kind for kind in kinds if os.path.isfile(os.path.join(path, kind.document))), None)
