"""Ground of a field that a path leaves uncovered: where it is, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import point_text, to_geodetic_deg
from eadp.core.geometry.polygons import Ring, apart_m, clipped, covered_shares, ground_m2, inner_point, uncovered
from eadp.coverage.swaths import MotionLimits
from eadp.models.airspace import BOUNDARY, CLEARANCE_SHARE
from eadp.models.field import Field

MIN_SHARE = 1e-4
"""A place is listed from this share of the field on."""

WIDTH_SHARE = 0.01
"""Width over the swath below which ground between strips is rounding."""

IN_CLIMB = "below the altitude of the pictures, in the climb from home, and no room for a circle"

SHOWN = 3
"""Places that are named, the largest ones."""


class LeftGround(NamedTuple):
    """A place that is not covered: its outline and its holes [m], its area [m²], a point of it [m], and why."""

    rings: Sequence[Ring]
    area_m2: float
    place_m: Point
    reason: str

    def document(self, origin_deg: Point | None) -> dict[str, Any]:
        """Its values, with latitude and longitude where the field has an origin."""
        at_deg = None if origin_deg is None else [round(each, 7) for each in to_geodetic_deg(*self.place_m, origin_deg)]
        return {"area_m2": self.area_m2, "at_m": self.place_m, "at_deg": at_deg, "reason": self.reason}


def left_ground(
    field: Field,
    lines: Sequence[Sequence[Point]],
    motion: MotionLimits,
    *,
    in_climb: Sequence[Sequence[Point]] = (),
) -> list[LeftGround]:
    """The places of a field that lines leave uncovered, the largest first.

    Parameters
    ----------
    field : Field
        With what is in the way.
    lines : sequence of sequences of (float, float)
        Points of each line [m].
    motion : MotionLimits
        For the swath and the room of a turn.
    in_climb : sequence of sequences of (float, float), optional
        Points of each part of a line that is flown in the climb, with the camera off [m].
    """
    found = []
    for rings in uncovered(field.parts, lines, motion.swath_m, WIDTH_SHARE * motion.swath_m):
        area_m2 = ground_m2(*rings)
        if area_m2 >= MIN_SHARE * field.area_m2:
            low = in_climb and covered_shares([rings], [in_climb], motion.swath_m)[-1] > 0.5
            reason = IN_CLIMB if low else _reason(rings, area_m2, field, motion)
            found.append(LeftGround(rings, area_m2, inner_point(*rings), reason))
    return sorted(found, key=lambda each: -each.area_m2)


def _reason(rings: Sequence[Ring], area_m2: float, field: Field, motion: MotionLimits) -> str:
    """Why a place is not covered."""
    obstacles, boundary = field.airspace

    def share(*areas: Sequence[Point]) -> float:
        """How much of the place lies within some areas."""
        return sum(ground_m2(*part) for part in clipped([rings], areas)) / area_m2

    if boundary and share(*boundary) < 0.5:
        return f"beyond {BOUNDARY}"
    for each in obstacles:
        if share(each.outline) > 0.5:
            return f"{each.name}, and no room for a turn beside it"
    # how far from an obstacle a line may have to end: the diameter of half a circle with clearance, what is flown
    # beyond the line, and half a swath
    reach_m = (2 + 2 * CLEARANCE_SHARE) * motion.min_radius_m + motion.beyond_m + motion.swath_m / 2
    edges = [(each.name, each.outline) for each in obstacles] + [(BOUNDARY, ring) for ring in boundary]
    near = zip(apart_m([outline for _, outline in edges], rings), (name for name, _ in edges), strict=True)
    distance_m, name = min(near, default=(reach_m + 1, ""))
    if distance_m <= reach_m:
        return f"no room for a turn {'inside' if name == BOUNDARY else 'beside'} {name}"
    return "beside or between the lines, narrower than their swath"


def left_text(left: Sequence[LeftGround], share: float, origin_deg: Point | None) -> list[str]:
    """What is left, for people, line by line: the share of the field, and the largest places."""
    if not left:
        return []
    places = f"in {len(left)} places; the largest" if len(left) > SHOWN else "at"
    total = sum(each.area_m2 for each in left)
    lines = [f"left       {100 * share:.2f} % of the field, {area_text(total)} {places}:"]
    for each in left[:SHOWN]:
        lines.append(f"           {area_text(each.area_m2)} at {point_text(each.place_m, origin_deg)}: {each.reason}")
    return lines


def area_text(area_m2: float) -> str:
    """An area, for people."""
    return f"{area_m2 / 1e4:.2f} ha" if area_m2 >= 1000 else f"{area_m2:.0f} m²"
