"""What is added to eadp by name: by its own rooms (`OWN`), and by other installed packages (entry points `eadp.KIND`).

| kind | name | object |
|---|---|---|
| `commands` | of `eadp NAME` | a function: typer's annotations, returns the exit code |
| `plan_sources` | any | a `PlanSource`: it recognises texts and reads them as plans |
| `plan_changes` | of an option of `eadp plan` | a function from a plan and the option's file to the plan and notes |
| `grounds` | `files` | a function from `--terrain`'s files to a `Ground`, the heights of points |
| `fences` | any | a function from a text to the fences in it as (inside, corners °, place); None where it has no such |
| `plan_writers` | of `eadp plan --format` | the function from a plan and its name to a text |
| `measurers` | `command` | what `eadp profile --measure` runs |
| `jobs` | any | a `JobKind`: folders that stand for several flights |
| `exporters`, `message_readers`, `rests`, `tracks` | one each | what rooms ask of one another: see `OWN` |
| `checks` | any | what `eadp plan --check` runs: a function as `check.check.checked`, to a `CheckReport` |
| `estimators` | `power`, `log` | a `PowerEstimator`, with the settings in `estimator:`; the same over a log |
| `result_writers` | any | writes into the folder of a flight: a function of a `Flight` and its path |
| `result_figures` | of `--figure` | the same, where its name is asked for |
| `pages` | any | a `PageSource`: what `eadp report` makes pages of |
| `results` | `flight` | reads the folder of a flight again |
| `charts` | `periodogram` | what a figure of another room draws into its axes |
| `planners` | of `planner.name` and `--planner` | a `Planner` |
| `airframes` | of `airframe.model` | a dataclass that inherits from `FixedWing` or `PowerCurve` |
| `batteries` | of `battery.chemistry` | a function: open-circuit voltage of a cell [V] of the state of charge, 0 to 1 |
| `coverage_patterns` | of `--pattern` | a `coverage.cover.Pattern` |
| `log_formats`, `mission_formats` | any | a `LogFormat`, a `MissionFormat`; the first that recognises a file reads it |
| `mission_writers` | of `--to` | the function from a `PlannedPath` to a text |
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from eadp.errors import EadpError, printable

OWN: dict[str, dict[str, str]] = {
    "commands": {
        "plan": "eadp.cli.plan:command",
        "profile": "eadp.cli.profile:command",
        "fit": "eadp.measure.command:command",
        "simulate": "eadp.cli.simulate:command",
        "cover": "eadp.survey.command:command",
        "export": "eadp.exchange.command:command",
        "sweep": "eadp.sweep.command:command",
        "replan": "eadp.live.command:command",
        "init": "eadp.survey.init:command",
        "vehicle": "eadp.cli.vehicle:command",
        "report": "eadp.report.command:command",
        "schema": "eadp.cli.schema:command",
    },
    "plan_sources": {"mission": "eadp.exchange.reader:MISSION"},
    "plan_changes": {"avoid": "eadp.survey.field_reader:avoid", "inside": "eadp.survey.field_reader:inside"},
    "grounds": {"files": "eadp.survey.terrain:ground_of"},
    "fences": {"mission": "eadp.exchange.reader:mission_fences"},
    "plan_writers": {
        "sympy": "eadp.check.proof:sympy_text",
        "latex": "eadp.check.proof:latex_text",
    },
    "measurers": {"command": "eadp.measure.measuring:measure_profile"},
    "exporters": {"mission": "eadp.exchange.export:MISSION_EXPORTER"},
    "message_readers": {"tlog": "eadp.live.mavlink:tlog_messages"},
    "rests": {"telemetry": "eadp.live.replanner:rest_after"},
    "tracks": {"recorded": "eadp.live.recorded:flown_track"},
    "jobs": {"sorties": "eadp.survey.folder:SORTIE_JOBS"},
    "checks": {"geometry": "eadp.check.check:checked"},
    "estimators": {"power": "eadp.papers.power:PowerTracker", "log": "eadp.papers.power:over_log"},
    "result_writers": {"page": "eadp.report.flight:write_page"},
    "result_figures": {"paper": "eadp.papers.figures:write_figure"},
    "pages": {
        "flight": "eadp.report.report:FOLDER",
        "sweep": "eadp.sweep.page:PAGE",
        "log": "eadp.live.log_page:PAGE",
    },
    "results": {"flight": "eadp.report.report:read_folder"},
    "charts": {"periodogram": "eadp.measure.figures:draw_periodogram"},
    "planners": {
        "static": "eadp.planning.registry:Planner",
        "paper": "eadp.papers.planner:PaperPlanner",
        "joint": "eadp.planning.joint.planner:JointPlanner",
    },
}
"""Those of eadp, imported when they are needed: module and name within it, by kind and name."""


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
