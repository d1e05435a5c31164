"""Reading plans, and missions of other software as plans."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from eadp.api.given import File, Warn, python_warnings
from eadp.errors import Fault, InputError
from eadp.io.plan.sources import PlanReader, is_mission
from eadp.io.text.streams import Text, read_text
from eadp.models.plan.plan import CheckReport, Finding, Plan
from eadp.plug_ins import plug_ins
from eadp.simulation.turns import calm_findings, is_tight
from eadp.survey.fences import fenced_by


class CheckedPlan(NamedTuple):
    """A plan, its name in messages, what was found in it, by which checks, and notes on files beside it."""

    plan: Plan
    name: str
    findings: Sequence[Finding]
    reports: Sequence[CheckReport] = ()
    notes: Sequence[Fault] = ()

    @property
    def report(self) -> CheckReport | None:
        """What the check of the geometry found; None where it was not asked for."""
        return self.reports[0] if self.reports else None

    @property
    def has_errors(self) -> bool:
        """Whether a check found an error."""
        return any(report.has_errors for report in self.reports)

    @property
    def faults(self) -> list[Fault]:
        """The findings, in the file's lines, and the notes."""
        return [*(finding.fault(self.name) for finding in self.findings), *self.notes]


def check_plan(
    file: File,
    *,
    min_radius_m: float | None = None,
    laps: int | None = None,
    avoid: File | None = None,
    inside: File | None = None,
    terrain: Sequence[str] = (),
    geometry: bool = True,
) -> CheckedPlan:
    """Read a plan, or a mission, and check it over the whole range of every path parameter, by value and by proof.

    Parameters
    ----------
    file, min_radius_m, laps, terrain
        As for `read_plan`; turns that are tighter than the radius are found, too.
    avoid, inside : path, optional
        Files of polygons or fences that the path stays out of, and inside of, besides those of the plan.
    geometry : bool, optional
        Whether the geometry is checked.

    Raises
    ------
    InputError
        With every fault of the file.
    """
    text = read_text(str(file))
    plan, findings = _read(text, min_radius_m or None, laps, terrain)
    plan, notes = fenced_by(plan, avoid, inside)
    if not geometry:
        return CheckedPlan(plan, text.name, findings, notes=notes)
    # a mission's coordinates are rounded, and it has no parameters: there is nothing to prove
    reports = [check(plan, min_radius_m, proven=not is_mission(text)) for check in plug_ins("checks")]
    findings = [*findings, *(finding for report in reports for finding in report.findings)]
    return CheckedPlan(plan, text.name, findings, reports, notes)


def read_plan(
    file: File,
    *,
    min_radius_m: float | None = None,
    laps: int | None = None,
    terrain: Sequence[str] = (),
    warn: Warn = python_warnings,
) -> Plan:
    """Read a plan, or a mission of other software.

    Parameters
    ----------
    file : str or path
        The file, `-` for standard input.
    min_radius_m : float, optional
        Radius of a mission's turns [m]; by default the default aircraft's.
    laps : int, optional
        How many times a mission that repeats for ever is flown.
    terrain : sequence of str, optional
        Files of the ground, for a mission whose altitudes are above it.
    warn : function, optional

    Raises
    ------
    InputError
        With every fault of the file.
    """
    return plan_of(file, min_radius_m, laps, warn, terrain)[0]


def read_mission(
    file: File,
    *,
    min_radius_m: float | None = None,
    laps: int | None = None,
    terrain: Sequence[str] = (),
    warn: Warn = python_warnings,
) -> Plan:
    """Read a mission of other software as a plan: as `read_plan`, which also reads plans.

    Raises
    ------
    InputError
        With every fault of the file; where it is a plan of eadp, too.
    """
    text = read_text(str(file))
    if not is_mission(text):
        raise InputError.at(text.name, 1, 1, "is no mission", "a QGroundControl plan or a WPL file")
    return _of_text(text, min_radius_m, laps, warn, terrain)


def plan_of(
    given: File | Plan, min_radius_m: float | None, laps: int | None, warn: Warn, terrain: Sequence[str] = ()
) -> tuple[Plan, str]:
    """A plan that is given, and its name in messages."""
    if isinstance(given, Plan):
        return given, given.name
    text = read_text(str(given))
    return _of_text(text, min_radius_m, laps, warn, terrain), text.name


def _of_text(text: Text, min_radius_m: float | None, laps: int | None, warn: Warn, terrain: Sequence[str]) -> Plan:
    plan, findings = _read(text, min_radius_m, laps, terrain)
    warn([finding.fault(text.name) for finding in findings])
    return plan


def _read(
    text: Text, min_radius_m: float | None, laps: int | None, terrain: Sequence[str]
) -> tuple[Plan, list[Finding]]:
    """A plan or a mission, and what was found in it: of a mission, also what is flown where it turns too tightly."""
    reader = PlanReader(laps=laps, terrain=tuple(terrain)).turning(min_radius_m)
    plan, findings = reader(text)
    if is_mission(text) and is_tight(plan, reader.turn_radius_m):
        findings = [*findings, *calm_findings(plan, reader.turn_radius_m)]
    return plan, findings
