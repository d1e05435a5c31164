"""What is added to eadp by name: by its own rooms (`OWN`), and by other installed packages (entry points `eadp.KIND`).

| kind | name | object |
|---|---|---|
| `commands` | of `eadp NAME` | a function: typer's annotations, returns the exit code |
| `plan_sources` | any | a `PlanSource`: it recognises texts and reads them as plans |
| `plan_changes` | of an option of `eadp plan` | a function from a plan and the option's file to the plan and notes |
| `grounds` | `files` | a function from `--terrain`'s files to a `Ground`, the heights of points |
| `fields` | `files` | reads a field, its obstacles and its boundary for `eadp cover` |
| `plan_writers` | of `eadp plan --format` | the function from a plan and its name to a text |
| `log_tables` | `autopilot` | reads topics of an autopilot's log as tables, for `eadp replan` and sorties |
| `jobs` | any | a `JobKind`: folders that stand for several flights |
| `rests`, `tracks` | one each | what rooms ask of one another: see `OWN` |
| `checks` | any | what `eadp plan --check` runs: a function as `check.check.checked`, to a `CheckReport` |
| `estimators` | `power`, `log` | a `PowerEstimator`, with the settings in `estimator:`; the same over a log |
| `result_writers` | any | writes into the folder of a flight: a function of a `Flight` and its path |
| `result_figures` | of `--figure` | the same, where its name is asked for |
| `page` | `place`, `check`, `html` | where the page of a result goes, whether it may, and its text |
| `pages` | any | a `PageSource`: what `eadp report` makes pages of |
| `results` | `flight` | reads the folder of a flight again |
| `charts` | `periodogram` | what a figure of another room draws into its axes |
| `planners` | of `planner.name` and `--planner` | a `Planner` |
| `airframes` | of `airframe.model` | a dataclass that inherits from `FixedWing` or `PowerCurve` |
| `batteries` | of `battery.chemistry` | a function: open-circuit voltage of a cell [V] of the state of charge, 0 to 1 |
| `coverage_patterns` | of `--pattern` | a `survey.coverage.Pattern` |
| `log_formats`, `mission_formats` | any | a `LogFormat`, a `MissionFormat`; the first that recognises a file reads it |
| `mission_writers` | of `--to` | the function from a `PlannedPath` to a text |
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from eadp.errors import EadpError, printable

OWN: dict[str, dict[str, str]] = {
    "commands": {
        "plan": "eadp.cli.plan:command",
        "profile": "eadp.measure.profile:command",
        "fit": "eadp.measure.command:command",
        "simulate": "eadp.cli.simulate:command",
        "cover": "eadp.survey.command:command",
        "export": "eadp.exchange.command:command",
        "sweep": "eadp.sweep.command:command",
        "replan": "eadp.live.command:command",
        "init": "eadp.survey.init:command",
        "vehicle": "eadp.cli.vehicle:command",
        "report": "eadp.report.report:command",
        "schema": "eadp.cli.schema:command",
    },
    "plan_sources": {"mission": "eadp.exchange.reader:MISSION"},
    "plan_changes": {"avoid": "eadp.exchange.field_reader:avoid", "inside": "eadp.exchange.field_reader:inside"},
    "grounds": {"files": "eadp.survey.terrain:ground_of"},
    "fields": {"files": "eadp.exchange.field_reader:limited_field"},
    "plan_writers": {"sympy": "eadp.check.proof:sympy_text", "latex": "eadp.check.proof:latex_text"},
    "log_tables": {"autopilot": "eadp.measure.autopilot_logs:read_tables"},
    "rests": {"telemetry": "eadp.live.replanner:rest_after"},
    "tracks": {"recorded": "eadp.live.recorded:flown_track"},
    "jobs": {"sorties": "eadp.survey.folder:SORTIE_JOBS"},
    "checks": {"geometry": "eadp.check.check:checked"},
    "estimators": {"power": "eadp.papers.power:PowerTracker", "log": "eadp.papers.power:over_log"},
    "result_writers": {"page": "eadp.report.flight:write_page"},
    "result_figures": {"paper": "eadp.papers.figures:write_figure"},
    "page": {
        "place": "eadp.report.page:page_of",
        "check": "eadp.report.page:check_page",
        "html": "eadp.report.page:page_html",
    },
    "pages": {"flight": "eadp.report.report:FOLDER", "sweep": "eadp.sweep.page:PAGE"},
    "results": {"flight": "eadp.report.report:read_folder"},
    "charts": {"periodogram": "eadp.measure.figures:draw_periodogram"},
    "planners": {
        "static": "eadp.planning.registry:Planner",
        "paper": "eadp.papers.planner:PaperPlanner",
        "joint": "eadp.planning.joint.planner:JointPlanner",
    },
}
"""Those of eadp, imported when they are needed: module and name within it, by kind and name."""


DECIDING = ("airframes", "batteries", "estimators", "jobs", "mission_formats", "plan_sources", "planners")
"""Kinds of which a flight's result depends on what is installed."""


def plug_in(kind: str, name: str) -> Any:
    """What eadp or an installed package offers under a name; None where neither does.

    Raises
    ------
    EadpError
        If it cannot be imported.
    """
    own = OWN.get(kind, {})
    if name in own:
        return _opened(own[name])
    return next((_loaded(found) for found in _entry_points(kind) if found.name == name), None)


def plug_ins(kind: str) -> list[Any]:
    """All of a kind, eadp's own first.

    Raises
    ------
    EadpError
        If one of them cannot be imported.
    """
    return [*map(_opened, OWN.get(kind, {}).values()), *(_loaded(found) for found in _entry_points(kind))]


def added_names(kind: str) -> list[str]:
    """The names that installed packages add to a kind."""
    return [found.name for found in _entry_points(kind)]


def _opened(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def _entry_points(kind: str) -> Any:
    from importlib.metadata import entry_points  # its import and its search take up to 0.1 s

    return entry_points(group=f"eadp.{kind}")


def _loaded(found: Any) -> Any:
    try:
        return found.load()
    except Exception as error:  # of somebody else's code
        what = f"{found.value} of the entry points {found.group}: {type(error).__name__}: {printable(str(error))}"
        raise EadpError(f"{found.name} cannot be imported: {what}") from error


@cache
def code_identity() -> str:
    """Of eadp and each package that adds to `DECIDING`: name, version, and a hash as its files may be edited."""
    modules = {("eadp", str(import_module("eadp").__version__)): {"eadp"}}
    for found in (each for kind in DECIDING for each in _entry_points(kind)):
        modules.setdefault((found.dist.name, found.dist.version), set()).add(found.module.partition(".")[0])
    ours, *others = modules
    return ", ".join(
        f"{name} {version} ({sources_hash(_places(sorted(modules[name, version])))[:10]})"
        for name, version in (ours, *sorted(others))
    )


def _places(names: Iterable[str]) -> tuple[Path, ...]:
    """The folders of packages, and the files of modules without one."""
    specs = [spec for name in names if (spec := find_spec(name)) is not None]
    return tuple(Path(place) for spec in specs for place in spec.submodule_search_locations or [spec.origin or ""])


@cache
def sources_hash(places: tuple[Path, ...]) -> str:
    """A hash of Python files, and of those in folders."""
    digest = hashlib.sha256()
    for place in places:
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(path.read_bytes() if path.is_file() else b"")
    return digest.hexdigest()
