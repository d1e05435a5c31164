"""The lines over a field as one item of QGroundControl, which can be edited there.

Source: QGroundControl's `SurveyComplexItem.cc` (version 5), `TransectStyleComplexItem.cc` and `CameraCalc.cc` (2).
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from eadp.core.geometry.bearings import compass_deg
from eadp.core.geometry.curves import Point
from eadp.core.geometry.polygons import lengths_within_m
from eadp.errors import Infeasible
from eadp.io.mission.draft import LOITER_TURNS, TRIGGER_DISTANCE, WAYPOINT, MissionItem
from eadp.io.mission.path import PlannedPath, Section
from eadp.models.plan.plan import Plan

PARALLEL_RAD = math.radians(0.1)
"""Largest angle between the lines of a survey: they are written in millimetres."""

SWATH_M = 1000.0
"""Distance of lines where there is one alone, so that QGroundControl lays one, too [m]."""

MANUAL_CAMERA = "Manual (no camera specs)"
RELATIVE_MODE = 1
"""QGroundControl's AltitudeMode of heights above home."""


def check_survey(plan: Plan) -> None:
    """Refuse a plan that is no survey of one polygon; raises Infeasible."""
    if plan.path_count or plan.repeats or any(part.repeats for part in plan.segments):
        raise Infeasible("its laps have a spacing that is planned in flight, where a survey has one; --pattern dubins")
    if plan.site.field is None:
        raise Infeasible("it has no field: a plan of eadp cover has one")
    if plan.site.field.others:
        raise Infeasible(f"its field has {len(plan.site.field.parts)} parts, where a survey has one polygon")


def survey_lines(path: PlannedPath, outline: Sequence[Point]) -> list[Section]:
    """The lines over a field: straight, parallel to the longest and over its ground. Raises Infeasible without any."""
    straight: list[Section] = []
    for each in path.sections:
        before = straight[-1] if straight else None
        if before and before.last + 1 == each.first and _course_rad(before, each) < PARALLEL_RAD and each.arc is None:
            straight[-1] = replace(before, end_m=each.end_m, last=each.last)  # a line in several stages
        elif each.arc is None and not each.points_m:
            straight.append(each)
    over_m = [float(lengths_within_m([outline], [each.start_m, each.end_m])[2].sum()) for each in straight]
    if not any(over_m):
        raise Infeasible("it has no line over its field")
    course = straight[over_m.index(max(over_m))].courses_rad[0]
    return [
        each
        for each, length_m in zip(straight, over_m, strict=True)
        if length_m > 0 and abs(math.remainder(each.courses_rad[0] - course, math.pi)) < PARALLEL_RAD
    ]


def _course_rad(before: Section, after: Section) -> float:
    """By how much a section turns from the one before it [rad]."""
    return abs(math.remainder(after.courses_rad[0] - before.courses_rad[1], 2 * math.pi))


def survey_span(items: Sequence[MissionItem], lines: Sequence[Section]) -> tuple[int, int]:
    """The items that lead along lines, from the start of the first to the end of the last: first, and one beyond."""
    placed = [i for i, item in enumerate(items) if item.command in (WAYPOINT, LOITER_TURNS)]
    start = next(i for i in placed if items[i].legs[1] >= lines[0].first)
    before = next((i for i in range(start - 1, -1, -1) if items[i].command != TRIGGER_DISTANCE), 0)
    if items[before].command == WAYPOINT:
        start = before
    end = next(i for i in reversed(placed) if items[i].legs[0] <= lines[-1].last) + 1
    while end < len(items) and items[end].command == TRIGGER_DISTANCE:
        end += 1
    return start, end


def survey_item(
    path: PlannedPath, outline: Sequence[Point], lines: Sequence[Section], items: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """The item: what is flown are `items`, until it is edited; then lines of the same spacing and angle are laid."""
    frontal_m = max((item["params"][0] for item in items if item["command"] == TRIGGER_DISTANCE), default=0.0)
    sensed_m = sum(math.dist(line.start_m, line.end_m) for line in lines)
    course = lines[0].courses_rad[0]
    east, north, angle_deg = math.sin(course), -math.cos(course), round(compass_deg(course), 3) % 180
    places = sorted({round(line.start_m[0] * east + line.start_m[1] * north, 2) for line in lines})
    spacing_m = (
        round(statistics.median(b - a for a, b in itertools.pairwise(places)), 3) if len(places) > 1 else SWATH_M
    )
    radii = [section.arc.radius_m for section in path.sections if section.arc]
    ends = [point for line in lines for point in (line.start_m, line.end_m)]
    camera = {
        "AdjustedFootprintFrontal": frontal_m,
        "AdjustedFootprintSide": spacing_m,
        "CameraName": MANUAL_CAMERA,
        "DistanceMode": RELATIVE_MODE,
        "DistanceToSurface": path.altitude_of(lines[0]),
        "version": 2,
    }
    transects = {
        "CameraCalc": camera,
        "CameraShots": math.ceil(sensed_m / frontal_m) if frontal_m else 0,
        "CameraTriggerInTurnAround": False,
        "HoverAndCapture": False,
        "Items": list(items),
        "Refly90Degrees": False,
        # where a fixed wing turns back on to the next line
        "TurnAroundDistance": round(min(radii), 1) if radii else 0.0,
        "VisualTransectPoints": [_corner(path, point) for point in ends],
        "version": 2,
    }
    return {
        "TransectStyleComplexItem": transects,
        "angle": angle_deg,
        "complexItemType": "survey",
        "entryLocation": _entry(outline, lines[0].start_m, angle_deg, spacing_m),
        "flyAlternateTransects": False,
        "polygon": [_corner(path, point) for point in outline],
        "splitConcavePolygons": False,
        "type": "ComplexItem",
        "version": 5,
    }


def _corner(path: PlannedPath, point: Point) -> list[float]:
    return [round(value, 9) for value in path.geodetic_deg(point)]


def _entry(outline: Sequence[Point], start_m: Point, angle_deg: float, spacing_m: float) -> int:
    """Which of QGroundControl's four entries is the nearest to a place: 1 its last line, 2 the other ends, 3 both.

    It lays lines from the left of a box around the polygon, turned clockwise by the angle within ±90°. Its first line
    starts at the edge of the polygon that comes first, and the others are flown alike.
    """
    angle = math.radians(angle_deg - 180 if angle_deg > 90 else angle_deg)
    cosine, sine = math.cos(angle), math.sin(angle)
    (west, east), (south, north) = ((min(axis), max(axis)) for axis in zip(*outline, strict=True))
    left_m = -max(east - west, north - south) / 2 - 1000

    def turned(point: Point) -> Point:
        x, y = point[0] - (west + east) / 2, point[1] - (south + north) / 2
        return x * cosine - y * sine, x * sine + y * cosine

    def ends(u: float) -> list[float]:
        """Where a line enters and leaves the polygon, the edge that comes first of these first."""
        edges = [(a, b) for a, b in itertools.pairwise([*corners, corners[0]]) if (a[0] > u) != (b[0] > u)]
        found = [a[1] + (u - a[0]) / (b[0] - a[0]) * (b[1] - a[1]) for a, b in edges]
        return sorted((min(found), max(found)), key=found.index)

    corners, (x, y) = [turned(point) for point in outline], turned(start_m)
    across = [u for u, _ in corners]
    # a line through a corner alone is none
    first, last = math.floor((min(across) - left_m) / spacing_m) + 1, math.ceil((max(across) - left_m) / spacing_m) - 1
    if first >= last:  # one line, through the middle
        return 0
    places = [left_m + k * spacing_m for k in (first, last)]
    there, here = map(ends, places)
    if (there[0] < there[1]) != (here[0] < here[1]):
        here = here[::-1]
    entries = [(u, line[end]) for end in (0, 1) for u, line in zip(places, (there, here), strict=True)]
    return min(range(4), key=lambda k: math.dist(entries[k], (x, y)))
