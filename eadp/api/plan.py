"""Reading plans, and missions of other software as plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eadp.api.given import File, Warn, python_warnings
from eadp.errors import Fault, InputError, PathUndefined
from eadp.io.plan.sources import Ground, PlanReader, is_mission
from eadp.io.plan.writer import parameters_of
from eadp.io.text.streams import read_text
from eadp.models.plan.plan import CheckReport, Finding, Plan
from eadp.plug_ins import plug_in, plug_ins


class CheckedPlan(NamedTuple):
    """A plan, its name in messages, what was found in it, by which checks, and notes on files beside it."""

    plan: Plan
    name: str
    findings: Sequence[Finding]
    reports: Sequence[CheckReport] = ()
    notes: Sequence[Fault] = ()

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
    file, min_radius_m, laps, avoid, inside, terrain
        As for `read_plan`; turns that are tighter than the radius are found, too.
    geometry : bool, optional
        Whether the geometry is checked.

    Raises
    ------
    InputError
        With every fault of the file.
    """
    text = read_text(str(file))
    ground: Ground | None = plug_in("grounds", "files")(terrain) if terrain else None
    reader = PlanReader(laps=laps, ground=ground)
    if min_radius_m:
        reader = replace(reader, turn_radius_m=min_radius_m)
    plan, findings = reader(text)
    notes: list[Fault] = []
    for name, zones in (("avoid", avoid), ("inside", inside)):
        if zones is not None:
            plan, more = plug_in("plan_changes", name)(plan, zones)
            notes += more
    if ground is not None:
        plan = _at_height(plan, ground)
    # a mission's coordinates are rounded, and it has no parameters: there is nothing to prove
    proven = not is_mission(text)
    reports = [check(plan, min_radius_m, proven=proven) for check in plug_ins("checks")] if geometry else []
    findings = [*findings, *_zone_findings(plan), *(found for report in reports for found in report.findings)]
    return CheckedPlan(plan, text.name, findings, reports, notes)


def read_plan(
    file: File,
    *,
    min_radius_m: float | None = None,
    laps: int | None = None,
    avoid: File | None = None,
    inside: File | None = None,
    terrain: Sequence[str] = (),
    warn: Warn = python_warnings,
) -> Plan:
    """Read a plan, or a mission of other software, with what lies around it.

    Parameters
    ----------
    file : str or path
        The file, `-` for standard input.
    min_radius_m : float, optional
        Radius of a mission's turns [m]; by default the default aircraft's.
    laps : int, optional
        How many times a mission that repeats for ever is flown.
    avoid, inside : path, optional
        Files of polygons or fences that the path stays out of, and inside of, besides those of the plan.
    terrain : sequence of str, optional
        Files of the ground: for a mission whose altitudes are above it, and for the height of a plan's home.
    warn : function, optional

    Raises
    ------
    InputError
        With every fault of the file.
    """
    read = check_plan(
        file, min_radius_m=min_radius_m, laps=laps, avoid=avoid, inside=inside, terrain=terrain, geometry=False
    )
    warn(read.faults)
    return read.plan


def _zone_findings(plan: Plan) -> list[Finding]:
    """Warnings where the path at the take-off parameters enters an obstacle, or leaves the boundary."""
    airspace = plan.site.airspace
    if not any(airspace):
        return []
    from eadp.models.plan.trace import nominal_legs, zone_findings
    from eadp.models.vehicle import FixedWing

    try:
        legs = nominal_legs(plan, parameters_of(plan, ()))
    except PathUndefined:  # a plan without its sets
        return []
    return zone_findings(legs, airspace, FixedWing().cruise_altitude_m)


def _at_height(plan: Plan, ground: Ground) -> Plan:
    """A plan whose altitude 0 has the ground's height above the sea, at home or where it starts, if it has none."""
    site = plan.site
    if site.origin_deg is None:
        raise InputError.at("--terrain", 1, 1, "the plan has no place on the earth", "a plan with %: origin")
    if site.above_sea_m is not None:
        return plan
    home_m = np.array([site.home_m or site.start_m or (0.0, 0.0)])
    return replace(plan, site=site._replace(height_m=round(float(ground(home_m, site.origin_deg)[0]), 2)))
