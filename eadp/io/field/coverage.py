"""The use case of `eadp cover`: a field, an aircraft and computations in, a plan's text and its report out."""

from __future__ import annotations

import math

from eadp.coverage.cover import CoverageRequest, cover
from eadp.coverage.plan_builder import FieldComputations, build_plan
from eadp.coverage.report import CoverageReport, PowerDraw
from eadp.errors import EadpError, InputError, printable
from eadp.io.plan.writer import plan_text
from eadp.models.computing import Computing, join_profile
from eadp.models.plan.plan import Box, Plan
from eadp.models.profile_sum import AnyProfile


def plan_coverage(
    request: CoverageRequest,
    name: str,
    *,
    profile: AnyProfile | None = None,
    cruise_power_w: float = 0.0,
    off_on_turns: bool = False,
) -> tuple[CoverageReport, str]:
    """The quickest path found that covers a field, and the text of its plan.

    Parameters
    ----------
    request : CoverageRequest
    name : str
        The field's name, for the plan's comments.
    profile : profile, optional
        Its computations run over the field; with it the report has the energy.
    cruise_power_w : float, optional
        Power of the motion in level flight [W].
    off_on_turns : bool, optional
        Whether the computations stop on turns.

    Raises
    ------
    Infeasible
        If no path covers the field.
    InputError
        If the profile does not measure whole settings.
    """
    field, motion = request.field, request.motion
    computations = _computations(profile, off_on_turns)
    solution = cover(request)
    plan = build_plan(
        solution,
        name=name,
        computations=computations,
        min_radius_m=motion.min_radius_m,
        origin_deg=field.origin_deg,
    )
    power = None if profile is None else _power(plan, profile, cruise_power_w, computations)
    report = CoverageReport.of(field, motion, solution, power)
    comments = "".join(f"% {line}\n" for line in report.comments(printable(name, 100)))
    return report, comments + plan_text(plan)


def _computations(profile: AnyProfile | None, off_on_turns: bool) -> FieldComputations:
    """The computations of a profile, over the range that it measures, in whole numbers if it has any."""
    if profile is None:
        return FieldComputations()
    sets = []
    for name in profile.names:
        lo, hi = profile.range_of(name)
        lo = max(lo, 0.0)  # bounds of computations are 0 or more
        whole = float(math.ceil(lo)), float(math.floor(hi))
        sets.append(Box(*whole) if whole[0] <= whole[1] else Box(lo, hi))
    return FieldComputations(tuple(zip(profile.names, profile.units, strict=True)), tuple(sets), off_on_turns)


def _power(plan: Plan, profile: AnyProfile, cruise_power_w: float, computations: FieldComputations) -> PowerDraw:
    """The power drawn with every computation at its maximum."""
    try:
        computing: Computing = join_profile(plan, profile)
        maxima = [plan.hull(i).hi for i in range(len(plan.parameters))]
        path = plan.stages[0].sets[: plan.path_count]
        drawn = [computing.power_w(maxima, [*path, *computations.sets_for(sensing)]) for sensing in (True, False)]
    except EadpError as error:
        raise InputError.at("--profile", 1, 1, str(error), "a profile that measures whole settings") from None
    return PowerDraw(cruise_power_w, *drawn)
