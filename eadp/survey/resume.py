"""What flights have left of a field: their swath is taken out of it, as it was flown and not as it was planned."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eadp.api.flight import SUMMARY
from eadp.api.given import File, Warn, python_warnings
from eadp.api.inputs import Files
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import compass_deg
from eadp.core.geometry.polygons import covered_share, ground_m2, uncovered
from eadp.errors import Fault, InputError, PathUndefined
from eadp.io.flight import flown_lines, flown_of_plan, planned_lines
from eadp.models.airspace import Field
from eadp.models.plan.plan import Plan
from eadp.models.plan.trace import PictureTrack
from eadp.plug_ins import plug_in
from eadp.survey.cover import coverage_task, flight_keys, picture_warnings
from eadp.survey.coverage import DUBINS, ZAMBONI
from eadp.survey.options import CoverageOptions
from eadp.survey.packs import whole_lines
from eadp.survey.sorties import SortieOptions, SortiePlan, SortiePlanner

MIN_PART_SHARE = 0.01
"""Share of the field below which a part is not flown again: it needs a take-off and a landing of its own."""

SWATH_SHARE = 0.01
"""Share by which the swath may be another than that of a flight resumed: less than cameras' data are known to."""

SLIVER_SHARE = 0.3
"""Width over the swath up to which ground between flown lines is not flown again: errors of flights leave as much."""

ALONG_RAD = math.radians(20.0)
"""A log is on a line where its course differs from that of the lines by less than this."""

MAX_GAP_S = 5.0
"""Longest gap of a log within a line [s]."""

Line = tuple[Point, ...]


@dataclass(frozen=True)
class FlownSurvey:
    """A flight that was flown: its source, and its lines [m].

    `heading_rad` is that of the lines, and `laps` whether they were flown in laps; None where it is not known.
    """

    source: str
    lines: Sequence[Line]
    heading_rad: float | None = None
    laps: bool | None = None


def resumed(planner: SortiePlanner, sources: Sequence[str], warn: Warn) -> tuple[SortiePlanner, Field]:
    """A planner for the rest of a field, with the lines' heading of flights flown, and the ground that is left.

    Parameters
    ----------
    planner : SortiePlanner
    sources : sequence of str
        Result folders of flights, folders of such folders, telemetry, or logs of an autopilot or a ground station.
    warn : function

    Raises
    ------
    InputError
        If a source cannot be read, is of another field, or if nothing is left.
    """
    field, swath_m = planner.task.field, planner.task.motion.swath_m
    tracks: list[FlownSurvey] = []
    for source in sources:
        tracks += _read(source, planner, warn)
    for track in tracks:
        straights = [(line[0], line[-1]) for line in track.lines]
        if covered_share(field.parts, straights, swath_m) <= 0:
            what = "covers no ground of the field"
            raise InputError.at(track.source, 1, 1, what, "a flight over this field, with its lines")
    known = [track for track in tracks if track.heading_rad is not None]
    if known and planner.task.options.heading_deg is None:
        heading_rad, laps = known[0].heading_rad, known[0].laps
        assert heading_rad is not None
        pattern = ZAMBONI if laps and planner.task.terrain is None else DUBINS
        planner = replace(planner, lines=(compass_deg(heading_rad), pattern))
    lines = [line for track in tracks for line in track.lines]
    left = left_of(planner, lines)
    again = left and flown_again(planner, left, lines)
    if left is None or again is None:
        raise InputError.at("--resume", 1, 1, "nothing is left to cover", "flights that leave some of the field")
    if (not_again_m2 := left.area_m2 - again.area_m2) >= 1:
        message = f"{not_again_m2 / 1e4:.2g} ha are left, in parts of which lines with turns cover less than "
        message += f"{100 * MIN_PART_SHARE:g} % of the field"
        warn([Fault("--resume", 1, 1, message, severity="note")])
    return planner, again


def left_of(planner: SortiePlanner, flown: Sequence[Line]) -> Field | None:
    """The ground that flown lines have left of a field; as ground of whole lines, but for laps; None without any."""
    field, motion = planner.task.field, planner.task.motion
    parts = uncovered(field.parts, flown, motion.swath_m, SLIVER_SHARE * motion.swath_m)
    left = field.with_parts(parts) if parts else None
    if left is None or planner.laps:
        return left
    # a gap shorter than two half circles is flown over: leaving the line takes as long; a sliver may lie half on one
    # line and half on the next
    return whole_lines(left, field, planner.grid(), 2 * math.pi * motion.min_radius_m, SLIVER_SHARE / 2)


def flown_again(planner: SortiePlanner, left: Field, flown: Sequence[Line]) -> Field | None:
    """The parts left of a field in which planned lines cover `MIN_PART_SHARE` of it or more that flown ones do not.

    The planned lines are those over what is left that have room for their turns. None without such a part.
    """
    field, swath_m = planner.task.field, planner.task.motion.swath_m
    lines = planner.free_lines(left)

    def bare_m2(part: Sequence[Sequence[Point]]) -> float:
        """Ground of a part that planned lines cover and flown ones do not [m²]; lines None plan all of it."""
        bare = uncovered([part], flown, swath_m, SLIVER_SHARE * swath_m)
        share = 1.0 if lines is None or not bare else covered_share(bare, lines, swath_m)
        return share * sum(ground_m2(*each) for each in bare)

    parts = [part for part in left.parts if bare_m2(part) >= MIN_PART_SHARE * field.area_m2]
    return left.with_parts(parts) if parts else None


def _read(source: str, planner: SortiePlanner, warn: Warn) -> list[FlownSurvey]:
    """The flights of a source: a result folder, a folder of result folders, telemetry, or a log."""
    path = Path(source)
    if not path.is_dir():
        return [_of_track(source, planner, warn)]
    folders = [path] if (path / SUMMARY).exists() else sorted(each.parent for each in path.glob(f"*/{SUMMARY}"))
    if not folders:
        raise InputError.at(source, 1, 1, "has no flight", "a folder of eadp simulate -o DIR, telemetry, or a log")
    return [_of_folder(folder, planner, warn) for folder in folders]


def _of_folder(folder: Path, planner: SortiePlanner, warn: Warn) -> FlownSurvey:
    """The flight of a result folder. Raises InputError where its plan has another origin than the field."""
    flight, field = plug_in("results", "flight")(folder), planner.task.field
    plan = flight.world.mission.plan
    origin, own = plan.site.origin_deg, field.origin_deg
    if (origin is None) != (own is None) or (origin and own and math.dist(origin, own) > 1e-6):
        raise InputError.at(str(folder), 1, 1, "is of another field", f"a flight over {field.name or 'this field'}")
    before_m, now_m = plan.site.swath_m, planner.task.motion.swath_m
    if before_m is not None and abs(now_m - before_m) > SWATH_SHARE * before_m:
        message = f"lines of {before_m:.3g} m were flown, and the rest is planned with {now_m:.3g} m: is the camera, "
        warn([Fault(str(folder), 1, 1, message + "its altitude or overlap another?", severity="warning")])
    columns = flown_of_plan(flight.columns, flight.summary["turned_back_s"])
    heading_rad = _heading_of_lines_rad(plan, flight.world.mission.parameters)
    return FlownSurvey(str(folder), flown_lines(plan, columns), heading_rad, plan.path_count > 0)


def _heading_of_lines_rad(plan: Plan, parameters: Sequence[float]) -> float | None:
    """The heading of the longest line over a plan's field; ways to the field and home do not count.

    None where the plan has no field or no such line, or a path has no value.
    """
    if plan.site.field is None:
        return None
    corners = np.concatenate([outline for outline, *_ in plan.site.field.parts])
    try:
        lines = np.array([(*start, *end) for start, end in planned_lines(plan, parameters)]).reshape(-1, 2, 2)
    except PathUndefined:
        return None
    middles = lines.mean(axis=1)
    lines = lines[((corners.min(axis=0) <= middles) & (middles <= corners.max(axis=0))).all(axis=1)]
    if not len(lines):
        return None
    along = lines[:, 1] - lines[:, 0]
    east, north = along[np.argmax(np.hypot(along[:, 0], along[:, 1]))].tolist()
    return math.atan2(north, east)


def _of_track(source: str, planner: SortiePlanner, warn: Warn) -> FlownSurvey:
    """A flight of telemetry or a log: its lines are the runs of photographed steps along the plan's lines, either way.

    Photographed is what lies within half a picture's length of each; without pictures, where the camera is on.
    """
    options, swath_m = planner.task.options, planner.task.motion.swath_m
    track: PictureTrack = plug_in("tracks", "recorded")(source, planner.task.field.origin_deg, warn)
    table, photographed = np.array(track.rows), np.array(track.camera_on, dtype=bool)
    times_s, points = table[:, 0], table[:, 1:]
    steps = np.diff(points, axis=0)
    if track.pictures:
        # of each row: the way flown up to it; and the pictures before and after it
        way_m = np.cumsum([0.0, *np.linalg.norm(steps, axis=1)])
        length_m = options.picture_length_m or swath_m  # where the camera is not stated, of a square picture
        taken_m = np.unique(way_m[list(track.pictures)])
        after = np.searchsorted(taken_m, way_m)
        nearest_m = np.stack([taken_m[np.clip(after + k, 0, len(taken_m) - 1)] for k in (-1, 0)])
        photographed = np.abs(nearest_m - way_m).min(axis=0) <= length_m / 2
    courses = np.arctan2(steps[:, 1], steps[:, 0])
    # of each step: whether it goes along the lines, in either direction, with the camera on, and without a gap
    off_rad = (courses - planner.heading_rad + math.pi / 2) % math.pi - math.pi / 2  # in ±π/2: 0 in both directions
    along = np.abs(off_rad) < ALONG_RAD
    along &= photographed[1:] & photographed[:-1]
    along &= (np.diff(times_s) > 0) & (np.diff(times_s) <= MAX_GAP_S)
    # runs of such steps: the index of the first step of each, and of the first step after it
    ends = np.flatnonzero(np.diff(along, prepend=False, append=False)).reshape(-1, 2)
    lines = [tuple((x, y) for x, y in points[start : end + 1].tolist()) for start, end in ends.tolist()]
    return FlownSurvey(source, [line for line in lines if len(line) > 2])  # two steps or more


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
    scenario_path = None if scenario is None else str(scenario)
    task = coverage_task(str(field), options, profile, scenario, vehicle, warn, cruises=True)
    overrides = {"start": {"altitude_m": 0.0}} | flight_keys(task, vehicle)
    profile_path = None if profile is None else str(profile)
    division, files = sorties or SortieOptions(), Files()
    planner = SortiePlanner(task, division, files, scenario_path, profile_path, overrides, on_part=on_part)
    planner, ground = resumed(planner, division.resume, warn) if division.resume else (planner, None)
    plan = planner.plan(ground)
    warn(picture_warnings(plan.pictures))
    return plan
