"""The coverage of a field in the fewest flights."""

from __future__ import annotations

from collections.abc import Callable

from eadp.api.cover import CoverageOptions, coverage_task, flight_keys, picture_warnings
from eadp.api.given import File, Warn, python_warnings
from eadp.api.inputs import Files
from eadp.api.sorties.plan import SortieOptions, SortiePlan, SortiePlanner
from eadp.api.sorties.resume import resumed
from eadp.errors import Fault


def cover_in_sorties(
    field: File,
    options: CoverageOptions,
    sorties: SortieOptions | None = None,
    profile: File | None = None,
    scenario: File | None = None,
    *,
    vehicle: File | None = None,
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
    on_part : function, optional
        Called with the progress, as text.

    Raises
    ------
    Infeasible
        If the field is out of reach of a pack, or no path of this pattern covers a part of it.
    InputError
        With the faults of the files, or of an option under its name on the command line.
    """
    task = coverage_task(str(field), options, profile, scenario, vehicle, warn, cruises=True)
    overrides = {"start": {"altitude_m": 0.0}} | flight_keys(task, vehicle)
    profile_path = None if profile is None else str(profile)
    scenario_path = None if scenario is None else str(scenario)
    division, files = sorties or SortieOptions(), Files()
    planner = SortiePlanner(task, division, files, scenario_path, profile_path, overrides, on_part=on_part)
    if task.autopilot.turns_back:
        message, expected = "the autopilot's own return is not counted in sorties", "a look at eadp simulate of each"
        warn([Fault(str(field), 1, 1, message, expected, severity="warning")])
    planner, ground = resumed(planner, division.resume, warn) if division.resume else (planner, None)
    plan = planner.plan(ground)
    warn(picture_warnings(plan.pictures))
    return plan
