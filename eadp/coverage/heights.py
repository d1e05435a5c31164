"""A coverage path over terrain: lines keep a height above ground, turns and ways a clearance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.flight.following import RATE_SHARE, Band, Climbing, banded, commanded
from eadp.core.flight.wind import ground_speeds_mps
from eadp.core.geometry.polygons import holding
from eadp.coverage.cover import CoverageSolution
from eadp.coverage.swaths import CoverageLeg, MotionLimits
from eadp.errors import Infeasible, Unreachable
from eadp.models.airspace import CLEARANCE_SHARE, EVERYWHERE, Airspace
from eadp.models.terrain import ElevationModel

STEP_M = 10.0
"""Distance of the samples of a path [m]. A floor is that of the neighbours, too: a flight is up to 9 m off along it."""

ASIDE_M = 2.0
"""Distance of a flight from its line [m]: 0.8 m after turns in steady wind, 1.5 m in gusts of 1.5 m/s."""

LAPS_TRIED = 5
"""Values of c1 at which the ground under laps is taken."""


class HeightLimits(NamedTuple):
    """Heights above ground [m]: least on lines, by how much they may be higher, and least elsewhere."""

    line_m: float
    tolerance_m: float
    clearance_m: float


class Ground(NamedTuple):
    """The ground of a flight: its heights, that of the altitude 0 above the sea [m], and what may stand on it."""

    terrain: ElevationModel
    zero_m: float
    given: Airspace = EVERYWHERE

    def heights_m(self, points_m: FloatArray) -> FloatArray:
        """Heights above the altitude 0 [m], shape (n,). Raises Infeasible where one is not known."""
        return self.terrain.known_m(points_m) - self.zero_m

    def airspace(self, airspace: Airspace) -> Airspace:
        """Obstacles whose heights are above the altitude 0: from the highest ground of their outlines."""
        tops = []
        for each in airspace.obstacles:
            if each.height_m is not None:
                known_m = self.terrain.heights_m(np.array(each.outline))
                # of one beyond the terrain the height is not known
                top_m = None if np.isnan(known_m).any() else float(known_m.max()) - self.zero_m + each.height_m
                each = each._replace(height_m=top_m)
            tops.append(each)
        return airspace._replace(obstacles=tuple(tops))


@dataclass(frozen=True)
class HeightProfile:
    """A flight over its ground, at samples, shape (n,).

    `commanded` are the altitudes of the parts of the path; `sides_m` is the mean height of the ground half a line's
    distance to either side.
    """

    places_m: FloatArray
    points_m: FloatArray
    ground_m: FloatArray
    sides_m: FloatArray
    flown_m: FloatArray
    on_line: BoolArray
    commanded: int
    limits: HeightLimits
    terrain: ElevationModel

    @property
    def above_m(self) -> FloatArray:
        """Heights above ground on lines [m]."""
        return (self.flown_m - self.ground_m)[self.on_line]

    @property
    def overlapping_m(self) -> FloatArray:
        """Heights on lines above the ground where their pictures overlap [m]."""
        return (self.flown_m - self.sides_m)[self.on_line]

    @property
    def elsewhere_m(self) -> float | None:
        """Least height above ground beside the lines [m]."""
        return (
            float((self.flown_m - self.ground_m)[~self.on_line].min(initial=math.inf))
            if not self.on_line.all()
            else None
        )

    @property
    def high_share(self) -> float:
        """Share of the lines that are higher than is allowed for."""
        return float(np.mean(self.above_m > self.limits.line_m + self.limits.tolerance_m + 1e-6))

    @property
    def highest(self) -> tuple[float, float]:
        """Latitude and longitude [°] where a line is highest above ground."""
        k = int(np.argmax(np.where(self.on_line, self.flown_m - self.ground_m, -np.inf)))
        return self.terrain.place_deg(self.points_m[k])

    @property
    def steepest(self) -> float:
        """Greatest slope of the ground under lines, along them."""
        rise = np.abs(np.diff(self.ground_m)) / np.maximum(np.diff(self.places_m), 1e-9)
        return float(rise[self.on_line[1:] & self.on_line[:-1]].max(initial=0.0))


class _Samples(NamedTuple):
    """Samples of legs: places along the path, points, headings, legs before each, and whether it is on a line."""

    places_m: FloatArray
    points_m: FloatArray
    headings_rad: FloatArray
    legs: IntArray
    on_line: BoolArray

    @classmethod
    def of(cls, legs: Sequence[CoverageLeg]) -> _Samples:
        poses, places, owner, on_line = [legs[0].start], [0.0], [0], [legs[0].sensing]
        for k, leg in enumerate(legs):
            on_line[-1] |= leg.sensing
            count = max(1, math.ceil(leg.piece.length_m / STEP_M))
            steps_m = [leg.piece.length_m * i / count for i in range(1, count + 1)]
            begin_m = places[-1]
            poses += [leg.piece.pose_at(step_m) for step_m in steps_m]
            places += [begin_m + step_m for step_m in steps_m]
            owner += [k] * count
            on_line += [leg.sensing] * count
        x, y, headings = np.array(poses).T
        return cls(np.array(places), np.column_stack([x, y]), headings, np.array(owner), np.array(on_line))

    def beside(self, distance_m: FloatArray) -> list[FloatArray]:
        """Points to the left and to the right [m]."""
        normals = np.column_stack([-np.sin(self.headings_rad), np.cos(self.headings_rad)])
        return [self.points_m + side * distance_m[:, None] * normals for side in (1, -1)]


def _over_ground(
    samples: _Samples, ground: Ground, limits: HeightLimits, motion: MotionLimits, apart_m: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Heights of the ground below samples and beside them, and floor and ceiling of the flight [m]."""
    aside_m = np.where(samples.on_line, apart_m / 2, CLEARANCE_SHARE * motion.min_radius_m)
    below_m, left_m, right_m = (ground.heights_m(points) for points in (samples.points_m, *samples.beside(aside_m)))
    sides_m = (left_m + right_m) / 2
    rises_m = np.abs(left_m - right_m) / apart_m * ASIDE_M
    high_m = below_m - rises_m + limits.line_m + limits.tolerance_m
    ceiling_m = np.where(samples.on_line, _spread(high_m, np.minimum), np.inf)
    floor_m = np.where(
        samples.on_line,
        np.maximum(below_m + rises_m, sides_m) + limits.line_m,
        np.max([below_m, left_m, right_m], axis=0) + limits.clearance_m,
    )
    for each in ground.airspace(ground.given).obstacles:
        if each.height_m is not None:
            inside = np.any(
                [holding([each.outline], points)[0] for points in (samples.points_m, *samples.beside(aside_m))], axis=0
            )
            floor_m = np.where(inside, np.maximum(floor_m, each.height_m + limits.clearance_m), floor_m)
    return below_m, sides_m, _spread(floor_m, np.maximum), ceiling_m


def _spread(values: FloatArray, function: np.ufunc) -> FloatArray:
    """The least or the greatest of each sample and its neighbours."""
    padded = np.pad(values, 1, mode="edge")
    return np.asarray(function(function(padded[:-2], padded[1:-1]), padded[2:]))


def over_terrain(
    solution: CoverageSolution,
    ground: Ground,
    limits: HeightLimits,
    motion: MotionLimits,
    climbing: Climbing,
    apart_m: float,
    start_m: float | None = None,
) -> tuple[CoverageSolution, HeightProfile]:
    """A path whose legs have the altitudes that keep it above the ground; laps have one altitude.

    Parameters
    ----------
    solution : CoverageSolution
    ground : Ground
    limits : HeightLimits
    motion : MotionLimits
        For the ground speeds.
    climbing : Climbing
    apart_m : float
        Distance of the lines [m].
    start_m : float, optional
        Altitude at the start [m], for a flight from the ground; by default that of the first leg.

    Returns
    -------
    CoverageSolution
        Straight legs are cut where another altitude is commanded.
    HeightProfile
        Of laps, at their finest spacing.

    Raises
    ------
    Infeasible
        Where the height of the ground is not known, or the aircraft cannot climb over it.
    """
    if solution.blocks:
        return _at_one_altitude(solution, ground, limits, motion, apart_m)
    legs = [leg for leg in solution.path(0.0).legs if leg.piece.length_m > 0]
    samples = _Samples.of(legs)
    below_m, sides_m, floor_m, ceiling_m = _over_ground(samples, ground, limits, motion, apart_m)
    lengths_m = np.diff(samples.places_m)
    courses = samples.headings_rad[1:]
    speeds_mps, _ = ground_speeds_mps(np.cos(courses), np.sin(courses), motion.airspeed_mps, motion.wind_mps)
    seconds = lengths_m / np.maximum(speeds_mps, 1e-3)
    if start_m is not None:
        climbed_m = start_m + RATE_SHARE * climbing.up_mps * np.concatenate([[0.0], np.cumsum(seconds)])
        _check_climb_out(samples, below_m, climbed_m, ground)
        floor_m = np.minimum(floor_m, climbed_m)
    straight = np.array([leg.piece.turn == 0 for leg in legs])
    ends = np.append(samples.legs[1:] != samples.legs[:-1], True)
    band = banded(
        Band(samples.places_m, seconds, floor_m, ceiling_m, straight[samples.legs] | ends),
        climbing,
        limits.tolerance_m / 2,
    )
    try:
        found = commanded(band, climbing, floor_m, start_m)
    except Unreachable as error:
        place = ground.terrain.place_deg(samples.points_m[error.target])
        raise Infeasible(f"{error}: {place[0]:.5f},{place[1]:.5f}") from None
    altitudes_m = np.empty(len(floor_m))
    flown_m = np.empty(len(floor_m))
    first, flown_m[0] = 0, found[0][1] if start_m is None else start_m
    for end, altitude_m in found:
        altitudes_m[first + 1 : end + 1] = altitude_m
        for i in range(first, end):
            flown_m[i + 1] = climbing.followed_m(flown_m[i], np.array(altitude_m), float(seconds[i]))
        first = end
    profile = HeightProfile(
        samples.places_m,
        samples.points_m,
        below_m,
        sides_m,
        flown_m,
        samples.on_line,
        len(found),
        limits,
        ground.terrain,
    )
    return replace(solution, sections=tuple(_cut(legs, samples, altitudes_m))), profile


def _cut(legs: Sequence[CoverageLeg], samples: _Samples, altitudes_m: FloatArray) -> list[CoverageLeg]:
    """The legs, cut where the altitude changes."""
    parts = []
    for k, leg in enumerate(legs):
        own = np.flatnonzero(samples.legs[1:] == k) + 1
        begin_m = samples.places_m[own[0] - 1]
        changes = [i for i, j in itertools.pairwise(own.tolist()) if altitudes_m[i] != altitudes_m[j]]
        values = [altitudes_m[own[0]], *(altitudes_m[i + 1] for i in changes)]
        pieces = leg.cut(*(float(samples.places_m[i] - begin_m) for i in changes)) if changes else [leg]
        parts += [replace(part, altitude_m=float(value)) for part, value in zip(pieces, values, strict=True)]
    return parts


def _check_climb_out(samples: _Samples, below_m: FloatArray, climbed_m: FloatArray, ground: Ground) -> None:
    """Refuse ground that rises faster than a climb from the start."""
    k = 1 + int(np.argmax((below_m - climbed_m)[1:]))
    if climbed_m[k] < below_m[k]:
        latitude, longitude = ground.terrain.place_deg(samples.points_m[k])
        rise, way_m = below_m[k] - climbed_m[0], samples.places_m[k]
        raise Infeasible(
            f"the ground at {latitude:.5f},{longitude:.5f} rises {rise:.0f} m in {way_m:.0f} m of the way from home, "
            f"and the aircraft climbs {climbed_m[k] - climbed_m[0]:.0f} m: another home, or a climb before the way"
        )


def _at_one_altitude(
    solution: CoverageSolution, ground: Ground, limits: HeightLimits, motion: MotionLimits, apart_m: float
) -> tuple[CoverageSolution, HeightProfile]:
    """Laps, and what is flown between them, at the least altitude at which all keep their heights."""
    taken = []
    for c1 in np.linspace(0.0, solution.min_c1, LAPS_TRIED).tolist():
        samples = _Samples.of([leg for leg in solution.path(c1).legs if leg.piece.length_m > 0])
        taken.append((samples, *_over_ground(samples, ground, limits, motion, apart_m)))
    altitude_m = math.ceil(max(float(floor_m.max()) for *_, floor_m, _ in taken))
    samples, below_m, sides_m, *_ = taken[0]
    flown_m = np.full(len(below_m), float(altitude_m))
    profile = HeightProfile(
        samples.places_m, samples.points_m, below_m, sides_m, flown_m, samples.on_line, 1, limits, ground.terrain
    )
    return solution, profile
