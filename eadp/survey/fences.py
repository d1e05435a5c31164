"""Obstacles and a boundary from files beside a plan."""

from __future__ import annotations

from dataclasses import replace

from eadp.api.given import File
from eadp.errors import Fault, InputError
from eadp.io.plan.writer import parameters_of
from eadp.io.text.streams import Text
from eadp.models.airspace import Airspace
from eadp.models.plan.plan import Plan
from eadp.survey.field_reader import read_airspace, read_field_text

FENCES = ("avoid", "inside")
"""Kinds of files of fences."""


def fenced(plan: Plan, avoid: Text | None = None, inside: Text | None = None) -> tuple[Plan, list[Fault]]:
    """A plan with the obstacles and the boundary of files besides its own, and notes; both boundaries hold.

    Raises
    ------
    InputError
        As `read_airspace`; or where the boundaries have no ground in common.
    """
    if avoid is None and inside is None:
        return plan, []
    starts_m = plan.stages[0].trigger_at(parameters_of(plan, ()))
    own, (given, notes) = plan.site.airspace, read_airspace(avoid, inside, plan.site.origin_deg, starts_m)
    boundary = own.boundary or given.boundary
    if own.boundary and given.boundary:
        assert inside is not None
        from eadp.core.geometry.polygons import clipped

        # two outlines have no hole in common, as their unions may have
        pairs = ((mine, each) for mine in own.boundary for each in given.boundary)
        boundary = tuple(part[0] for mine, each in pairs for part in clipped([[mine]], [each]))
        if not boundary:
            message = "no ground in common with the plan's own boundary"
            raise InputError.at(inside.name, 1, 1, message, "a boundary round the plan")
    airspace = Airspace((*own.obstacles, *given.obstacles), boundary)
    return replace(plan, site=plan.site._replace(airspace=airspace)), notes


def fenced_by(plan: Plan, avoid: File | None, inside: File | None) -> tuple[Plan, list[Fault]]:
    """As `fenced`, of paths; raises InputError as it, and where a file cannot be read."""
    return fenced(plan, *(None if path is None else read_field_text(str(path)) for path in (avoid, inside)))
