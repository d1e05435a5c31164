"""Fences of autopilots as zones of a field: those in a WPL file and those in a plan of QGroundControl, in degrees."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from eadp.errors import InputError
from eadp.io.field.draft import FieldDraft, Ring, Vertex, Zones
from eadp.io.mission.draft import Fence
from eadp.io.mission.qgc import qgc_fences
from eadp.io.mission.wpl import wpl_fences
from eadp.io.text.source import SourceText


def no_field(source: SourceText, metres: bool, feature: str | None) -> FieldDraft:
    """Refuse a mission in the place of a field; raises InputError."""
    expected = "a field; the fences of a mission belong to --inside FILE and --avoid FILE"
    raise source.error((1, 1), "is a mission or a fence, not a field", expected)


def _zones(read: Callable[[SourceText], list[Fence]], source: SourceText, metres: bool, inside: bool) -> Zones:
    """The fences to keep in or out of, and that they are in degrees; raises InputError."""
    if metres:
        raise InputError.at("--metres", 1, 1, "a fence is in degrees (WGS-84)", "a fence without --metres")
    fences = read(source)
    wanted = [fence for fence in fences if fence.inclusion is inside]
    if not wanted:
        other = "--avoid" if inside else "--inside"
        expected = f"a fence; those of this file belong to {other}" if fences else "a fence; places to rally are none"
        raise source.error((1, 1), f"no fence to keep {'inside' if inside else 'out of'}", expected)
    corners = [[Vertex(lon, lat, fence.location) for lat, lon in fence.corners_deg] for fence in wanted]
    return Zones([Ring(each, fence.location) for each, fence in zip(corners, wanted, strict=True)], degrees=True)


wpl_zones, qgc_zones = partial(_zones, wpl_fences), partial(_zones, qgc_fences)
