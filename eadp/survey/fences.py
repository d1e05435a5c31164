"""Obstacles and a boundary from files beside a plan: what `eadp plan --avoid` and `--inside` change."""

from __future__ import annotations

from dataclasses import replace

from eadp.api.given import File
from eadp.errors import Fault, InputError
from eadp.io.plan.writer import parameters_of
from eadp.io.text.streams import Text
from eadp.models.airspace import Airspace
from eadp.models.plan.plan import Plan
from eadp.survey.field_reader import read_airspace, read_field_text


def avoid(plan: Plan, file: File) -> tuple[Plan, list[Fault]]:
    """A plan with the obstacles of a file besides its own, and notes. Raises InputError as `_fenced`."""
    return _fenced(plan, read_field_text(str(file)), None)


def inside(plan: Plan, file: File) -> tuple[Plan, list[Fault]]:
    """A plan with the boundary of a file besides its own, and notes; both hold. Raises InputError as `_fenced`."""
    return _fenced(plan, None, read_field_text(str(file)))


def _fenced(plan: Plan, avoided: Text | None, boundary_file: Text | None) -> tuple[Plan, list[Fault]]:
    """A plan beside files of obstacles and of a boundary.

    Raises
    ------
    InputError
        As `read_airspace`; or where the boundaries have no ground in common.
    """
    starts_m = plan.stages[0].trigger_at(parameters_of(plan, ()))
    own, (given, notes) = plan.site.airspace, read_airspace(avoided, boundary_file, plan.site.origin_deg, starts_m)
    boundary = own.boundary or given.boundary
    if own.boundary and given.boundary:
        assert boundary_file is not None
        from eadp.core.geometry.polygons import clipped

        # two outlines have no hole in common, as their unions may have
        pairs = ((mine, each) for mine in own.boundary for each in given.boundary)
        boundary = tuple(part[0] for mine, each in pairs for part in clipped([[mine]], [each]))
        if not boundary:
            message = "no ground in common with the plan's own boundary"
            raise InputError.at(boundary_file.name, 1, 1, message, "a boundary round the plan")
    airspace = Airspace((*own.obstacles, *given.obstacles), boundary)
    return replace(plan, site=plan.site._replace(airspace=airspace)), notes
