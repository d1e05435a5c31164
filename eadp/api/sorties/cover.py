"""The coverage of a field in the fewest flights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from eadp.api.cover import CoverageOptions, coverage_task, flight_keys, picture_warnings
from eadp.api.export import ExportOptions, autopilot_of
from eadp.api.given import File, Warn, python_warnings
from eadp.api.inputs import Files
from eadp.api.sorties.plan import SortieOptions, SortiePlan, SortiePlanner
from eadp.api.sorties.resume import resumed
from eadp.errors import Infeasible
from eadp.models.autopilot import PX4


def cover_in_sorties(
    field: File,
    options: CoverageOptions,
    sorties: SortieOptions | None = None,
    profile: File | None = None,
    scenario: File | None = None,
    *,
    vehicle: File | None = None,
    exports: Sequence[str] = (),
    on_part: Callable[[str], None] = lambda _: None,
    warn: Warn = python_warnings,
) -> SortiePlan:
    """Plan the coverage of a field in the fewest flights from home and back, each with a full pack.

    Parameters
    ----------
    field, options, scenario, vehicle, warn
        As for `cover`; the options have a home.
    sorties : SortieOptions, optional
        How the field is divided, and what is flown already.
    profile : path, optional
    exports : sequence of str, optional
        Formats in which the sorties are written besides: those for PX4 end by its rules.
    on_part : function, optional
        Called with the progress, as text.

    Raises
    ------
    Infeasible
        If the field is out of reach of a pack, or no path of this pattern covers a part of it.
    InputError
        With the faults of the files, or of an option under its name on the command line.
    """
    scenario_path = None if scenario is None else str(scenario)
    task = coverage_task(str(field), options, profile, scenario, vehicle, warn, cruises=True)
    if task.circled is not None:
        task, _ = task.best()
    overrides = {"start": {"altitude_m": 0.0}} | flight_keys(task, vehicle)
    if any(autopilot_of(to, ExportOptions(scenario=scenario_path)).kind == PX4 for to in exports):
        task = replace(task, autopilot=replace(task.autopilot, kind=PX4))
        overrides["autopilot.kind"] = PX4
    profile_path = None if profile is None else str(profile)
    division, files = sorties or SortieOptions(), Files()
    planner = SortiePlanner(task, division, files, scenario_path, profile_path, overrides, on_part=on_part)
    planner, ground = resumed(planner, division.resume, warn) if division.resume else (planner, None)
    try:
        plan = planner.plan(ground)
    except Infeasible:
        if not task.circles_first:
            raise
        # the climb to the first line of some sortie has no room for a circle
        plan = replace(planner, task=replace(planner.task, circles_first=False)).plan(ground)
    warn(picture_warnings(plan.pictures))
    return plan
