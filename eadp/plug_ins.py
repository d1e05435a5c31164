"""What other installed packages add: entry points `eadp.KIND`, read where a name or a file is not one of eadp's own.

| kind | name | object |
|---|---|---|
| `planners` | of `planner.name` and `--planner` | a `Planner` |
| `airframes` | of `airframe.model` | a dataclass that inherits from `FixedWing` or `PowerCurve` |
| `batteries` | of `battery.chemistry` | a function: open-circuit voltage of a cell [V] of the state of charge, 0 to 1 |
| `coverage_patterns` | of `--pattern` | a `coverage.cover.Pattern` |
| `log_formats`, `mission_formats` | any | a `LogFormat`, a `MissionFormat`; the first that recognises a file reads it |
| `mission_writers` | of `--to` | the function from a `PlannedPath` to a text |
"""

from __future__ import annotations

from typing import Any

from eadp.errors import EadpError, printable


def plug_in(kind: str, name: str) -> Any:
    """What an installed package offers under a name; None where none does.

    Raises
    ------
    EadpError
        If it cannot be imported.
    """
    return next((_loaded(found) for found in _entry_points(kind) if found.name == name), None)


def plug_ins(kind: str) -> list[Any]:
    """All that installed packages offer of a kind.

    Raises
    ------
    EadpError
        If one of them cannot be imported.
    """
    return [_loaded(found) for found in _entry_points(kind)]


def _entry_points(kind: str) -> Any:
    from importlib.metadata import entry_points  # its import and its search take up to 0.1 s

    return entry_points(group=f"eadp.{kind}")


def _loaded(found: Any) -> Any:
    try:
        return found.load()
    except Exception as error:  # of somebody else's code
        what = f"{found.value} of the entry points {found.group}: {type(error).__name__}: {printable(str(error))}"
        raise EadpError(f"{found.name} cannot be imported: {what}") from error
