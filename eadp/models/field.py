"""The field of a coverage problem: an outline with holes in the local frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from eadp.core.geometry.curves import Point
from eadp.models.airspace import EVERYWHERE, Airspace

if TYPE_CHECKING:
    from eadp.core.geometry.polygons import Ring


@dataclass(frozen=True)
class Field:
    """A field to cover.

    Attributes
    ----------
    outline : tuple of (float, float)
        Vertices [m], x east and y north, counter-clockwise; the first is not repeated at the end.
    holes : tuple of tuples of (float, float)
        Areas that are not covered, each as `outline` but clockwise; within the outline and disjoint except for single
        points.
    name : str
        Its name in its file, '' if none.
    origin_deg : (float, float) or None
        Latitude and longitude [°] of the local frame's origin on the WGS-84 ellipsoid; None if the file is in metres
        and has none.
    airspace : Airspace
        What lines and turns keep to.
    others : tuple of tuples of rings
        Its other parts, each an outline and its holes.
    """

    outline: Ring
    holes: tuple[Ring, ...] = ()
    name: str = ""
    origin_deg: tuple[float, float] | None = None
    airspace: Airspace = EVERYWHERE
    others: tuple[tuple[Ring, ...], ...] = ()

    @property
    def parts(self) -> tuple[tuple[Ring, ...], ...]:
        """Its parts, each an outline and its holes; the field's own first."""
        return ((self.outline, *self.holes), *self.others)

    def with_parts(self, parts: Sequence[Sequence[Ring]]) -> Field:
        """The same field with other parts, each an outline and its holes; at least one."""
        (outline, *holes), *others = parts
        return replace(self, outline=outline, holes=tuple(holes), others=tuple(map(tuple, others)))

    @property
    def middle_m(self) -> Point:
        """The middle of the box around its own outline [m]."""
        x, y = zip(*self.outline, strict=True)
        return (min(x) + max(x)) / 2, (min(y) + max(y)) / 2

    @property
    def area_m2(self) -> float:
        """Area within the outlines, less the holes [m²]."""
        from eadp.core.geometry.polygons import signed_area_m2

        areas = ([abs(signed_area_m2(ring)) for ring in part] for part in self.parts)
        return sum(outline - sum(holes) for outline, *holes in areas)

    @property
    def summary(self) -> dict[str, float | str]:
        """Its area [m²] and its name, for documents."""
        return {"area_m2": round(self.area_m2, 1), "name": self.name}
