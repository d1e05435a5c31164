"""Altitudes of a coverage path: climbs to the first line and final approaches, and flights over terrain.

Over terrain lines keep a height above ground, turns and ways a clearance. A commanded altitude holds for a part of the
path. A model follows it at once, as fast as it can; autopilots spread the change over the part. Both keep to the floor.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.flight import ground_speeds_mps
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece, Pose, centre_m, polyline_m
from eadp.core.geometry.geodesy import compass_deg
from eadp.core.geometry.polygons import FreeSpace, holding
from eadp.core.guidance import RATE_SHARE
from eadp.errors import Infeasible, Unreachable
from eadp.models.airspace import CLEARANCE_M, CLEARANCE_SHARE, EVERYWHERE, Airspace
from eadp.survey.coverage import CoverageSolution, timed
from eadp.survey.swaths import CoverageLeg, MotionLimits
from eadp.survey.terrain import ElevationModel

# --- commanded altitudes

LEVEL_M = 0.25
"""Commanded altitudes are multiples of this [m]: errors of barometers and maps are larger."""

RECOVERY_S = 30.0
"""Time within which one command leads back below the ceiling [s]: a descent at the greatest rate gains 10 m or so."""

FOLLOWING_ROUNDING_M = 1e-6

REACHED_SHARE = 0.98
"""Share of a height at which a climb to it is over: pixels there are 2 % smaller."""


class Climbing(NamedTuple):
    """How an aircraft takes another altitude: greatest rates [m/s], and that for an error of altitude [1/s]."""

    up_mps: float
    down_mps: float
    gain_per_s: float

    def reached_s(self, height_m: float) -> float:
        """Time in which a climb by a height is over, with `RATE_SHARE` of the greatest rate [s]."""
        up_mps, left_m = RATE_SHARE * self.up_mps, (1 - REACHED_SHARE) * height_m
        # at the rate down to an error of ḣ/k, from where on the error falls as e^(−k t)
        near_m = min(max(up_mps / self.gain_per_s, left_m), height_m)
        return (height_m - near_m) / up_mps + math.log(near_m / left_m) / self.gain_per_s

    def followed_m(self, altitude_m: FloatArray, commanded_m: FloatArray, seconds: float) -> FloatArray:
        """Altitudes after a time with commanded ones [m]."""
        # ḣ = k (h_c − h) within the rates
        closed = -np.expm1(-self.gain_per_s * seconds) * (commanded_m - altitude_m)
        return np.asarray(altitude_m + np.clip(closed, -self.down_mps * seconds, self.up_mps * seconds))


class Band(NamedTuple):
    """Where a flight along samples of a path may be, shape (n,); times of the ways between them, shape (n − 1,).

    `may_end` says where another altitude may be commanded.
    """

    places_m: FloatArray
    seconds: FloatArray
    floor_m: FloatArray
    ceiling_m: FloatArray
    may_end: BoolArray


def min_profile_m(floor_m: FloatArray, up_m: FloatArray, down_m: FloatArray) -> FloatArray:
    """The lowest profile at or above a floor that climbs and descends no more than it can.

    Parameters
    ----------
    floor_m : array, shape (n,)
    up_m, down_m : array, shape (n − 1,)
        Greatest climb and descent from each sample to the next [m].

    Returns
    -------
    array, shape (n,)
        Of all such profiles the lowest at every sample.
    """
    up, down = (np.concatenate([[0.0], np.cumsum(each)]) for each in (up_m, down_m))
    # z_i = max over j ≥ i of f_j − (U_j − U_i), then over j ≤ i of z_j − (D_i − D_j)
    climbed = np.maximum.accumulate((floor_m - up)[::-1])[::-1] + up
    return np.asarray(np.maximum.accumulate(climbed + down) - down)


def banded(band: Band, climbing: Climbing, room_m: float) -> Band:
    """A band that an aircraft can stay within: floor and ceiling change no faster than it can, `room_m` apart [m]."""
    up_m, down_m = (RATE_SHARE * rate * band.seconds for rate in (climbing.up_mps, climbing.down_mps))
    floor_m = min_profile_m(band.floor_m, up_m, down_m)
    ceiling_m = np.maximum(band.ceiling_m, floor_m + room_m)
    down = np.concatenate([[0.0], np.cumsum(down_m)])
    # a descent to a lower ceiling starts in time: c_i = min over j ≥ i of c_j + (D_j − D_i)
    ceiling_m = np.minimum.accumulate((ceiling_m + down)[::-1])[::-1] - down
    return band._replace(floor_m=floor_m, ceiling_m=ceiling_m)


def commanded(
    band: Band, climbing: Climbing, hard_floor_m: FloatArray, start_m: float | None = None
) -> list[tuple[int, float]]:
    """Altitudes to command along a band, each as far as it can hold.

    Parameters
    ----------
    band : Band
        As `banded` makes it.
    climbing : Climbing
    hard_floor_m : array, shape (n,)
        What a straight climb or descent from one command's end to the next one's stays above, too [m].
    start_m : float, optional
        Altitude at the first sample [m]; by default the first one commanded.

    Returns
    -------
    list of (int, float)
        The sample at which each command ends, and the altitude [m].

    Raises
    ------
    Unreachable
        Of the sample from which on the floor rises faster than the aircraft.
    """
    last, found = len(band.places_m) - 1, list[tuple[int, float]]()
    top_m = float(np.max(band.ceiling_m, initial=float(band.floor_m.max()), where=np.isfinite(band.ceiling_m)))
    levels_m = LEVEL_M * np.arange(np.floor(band.floor_m.min() / LEVEL_M), np.ceil(top_m / LEVEL_M) + 1)
    # at its greatest rate an aircraft climbs where it is commanded so much more
    levels_m = np.concatenate(
        [levels_m, levels_m[-1] + np.arange(LEVEL_M, climbing.up_mps / climbing.gain_per_s, LEVEL_M)]
    )
    i, here_m, before_m = 0, start_m, start_m
    while i < last:
        # where it cannot stay in the band, it is above the ceiling for a while, but not below the floor
        given = band, climbing, hard_floor_m, levels_m, i, here_m, before_m
        best = _farthest(*given) or _farthest(*given, above=True)
        if best is None:
            raise Unreachable(i, f"no climb from {band.places_m[i]:.0f} m of the way on stays above the ground")
        i, before_m, here_m = best
        found.append((i, before_m))
    return found


def _farthest(
    band: Band,
    climbing: Climbing,
    hard_floor_m: FloatArray,
    levels_m: FloatArray,
    start: int,
    here_m: float | None,
    before_m: float | None,
    *,
    above: bool = False,
) -> tuple[int, float, float] | None:
    """Where the command that holds farthest from a sample ends, its altitude, and that of the aircraft there [m].

    From `above` the ceiling it is the one that is first below it, or else the shortest.
    """
    levels_m = levels_m if before_m is not None else levels_m[levels_m >= band.floor_m[start] - FOLLOWING_ROUNDING_M]
    flown_m = levels_m if here_m is None else np.full(len(levels_m), here_m)
    best, steepest = None, -np.inf
    for end in range(start + 1, len(band.places_m)):
        flown_m = climbing.followed_m(flown_m, levels_m, float(band.seconds[end - 1]))
        below = flown_m <= band.ceiling_m[end] + FOLLOWING_ROUNDING_M
        kept = (flown_m >= band.floor_m[end] - FOLLOWING_ROUNDING_M) & (below | above)
        levels_m, flown_m, below = levels_m[kept], flown_m[kept], below[kept]
        if not len(levels_m):
            break
        way_m = band.places_m[end] - band.places_m[start]
        min_m = hard_floor_m[end]
        if before_m is not None:
            steepest = max(steepest, (hard_floor_m[end] - before_m) / way_m)
            min_m = before_m + steepest * way_m
        # no command is so far from the flight that its greatest rate alone keeps it in the band
        beyond = climbing.gain_per_s * (levels_m - flown_m)
        fit = (levels_m >= min_m - FOLLOWING_ROUNDING_M) & (beyond <= climbing.up_mps) & (beyond >= -climbing.down_mps)
        if above and float(band.seconds[start:end].sum()) > RECOVERY_S and best is not None:
            break
        back = fit & below if above else fit
        if band.may_end[end] and (back.any() or (fit.any() and best is None)):
            k = int(np.argmax(back if back.any() else fit))  # the lowest
            best = end, float(levels_m[k]), float(flown_m[k])
            if above and back[k]:
                break
    return best


# --- climbs and final approaches over level ground

LARGE_M = 255.0
"""Radius from which on ArduPilot holds one in tens of metres; below it holds whole metres [m]."""

SAME_M, SAME_S = 1e-6, 1e-6


class FinalApproach(NamedTuple):
    """A straight way down to where a flight lands, the height above that place at which it begins [m], and a circle.

    On the circle, which begins and ends where the approach begins, a flight descends that is higher; None without room.
    """

    leg: CoverageLeg
    height_m: float
    circle: CoverageLeg | None = None

    def circles(self, down_m: float, climbing: Climbing, motion: MotionLimits) -> int:
        """The number of circles on which a flight descends by a height [m]."""
        if self.circle is None or down_m <= 0:
            return 0
        return math.ceil(down_m / (RATE_SHARE * climbing.down_mps * motion.time_s([self.circle.piece])))


class Lack(NamedTuple):
    """What a climb lacks: the time by which it is too late [s], and the place along the path up to which it is low [m].

    Both are 0 where it is in time.
    """

    late_s: float
    until_m: float


def held_up_m(radius_m: float) -> float:
    """The least radius that an autopilot holds, of a radius or more [m]."""
    step_m = 1.0 if radius_m < LARGE_M else 10.0
    return step_m * math.ceil(radius_m / step_m - SAME_M)


def whole_circle(pose: Pose, radius_m: float, turn: int) -> CoverageLeg:
    """A whole circle from a pose, to the left (+1) or to the right (−1)."""
    return CoverageLeg(Piece(turn, pose, pose, 2 * math.pi * radius_m, centre_m(pose, turn, radius_m)))


def free_circles(pose: Pose, radius_m: float, space: FreeSpace | None) -> Iterator[CoverageLeg]:
    """The whole circles from a pose that lie in the free space, which is None for everywhere."""
    for turn in (1, -1):
        circle = whole_circle(pose, radius_m, turn)
        if space is None or space.has_hull(polyline_m([circle.piece])):
            yield circle


def with_circles(
    solution: CoverageSolution, section: int, circle: CoverageLeg, count: int, motion: MotionLimits
) -> CoverageSolution:
    """A path with whole circles before one of its sections."""
    sections = [*solution.sections[:section], *[circle] * count, *solution.sections[section:]]
    return timed(replace(solution, sections=tuple(sections)), motion)


def climbed_first(
    solution: CoverageSolution, motion: MotionLimits, space: FreeSpace | None, lack: Callable[[CoverageSolution], Lack]
) -> CoverageSolution:
    """A path whose lines are photographed at their altitude: with circles before the first, or with the camera off.

    Parameters
    ----------
    solution : CoverageSolution
        From the ground on.
    motion : MotionLimits
    space : FreeSpace or None
        Where circles may lie.
    lack : function
        What the climb of a path lacks.

    Raises
    ------
    Infeasible
        If laps, whose lines are flown whole, have no room for a circle before them.
    """
    late_s, until_m = lack(solution)
    if late_s <= SAME_S:
        return solution
    legs = solution.path(0.0).legs
    # before the first line and what is straight before it; sections up to there are legs
    first = next(i for i, leg in enumerate(legs) if leg.sensing)
    first -= bool(motion.lead_in_m and first and not solution.blocks)
    # from the first line back to the start: low over the ground a circle has less room
    for section in range(first, -1, -1):
        pose = legs[section].start
        metre_s = motion.time_s([whole_circle(pose, 1.0, 1).piece])
        whole = max(1, math.floor(late_s / (motion.min_radius_m * metre_s)))
        # as wide as takes just the time, or else more of the smallest
        radii_m = (max(each, motion.min_radius_m) for each in (late_s / (whole * metre_s), motion.min_radius_m))
        for radius_m in dict.fromkeys(map(held_up_m, radii_m)):
            count = math.ceil(late_s / (radius_m * metre_s) - SAME_S)
            for circle in free_circles(pose, radius_m, space):
                found = with_circles(solution, section, circle, count, motion)
                if lack(found).late_s <= SAME_S:
                    return found
    if solution.blocks:
        raise Infeasible("the climb has no room for a circle before the laps", "--pattern dubins, or another --home")
    off = _unphotographed(solution, until_m, motion)
    if lack(off).late_s > SAME_S:
        raise Infeasible("the climb from home comes too near to the ground", "another --home, or --takeoff another way")
    return off


def level_lack(solution: CoverageSolution, motion: MotionLimits, climb_s: float) -> Lack:
    """What a climb over level ground that takes a time [s] lacks before the first line."""
    legs = solution.path(0.0).legs
    seconds = [motion.time_s([leg.piece]) for leg in legs]
    late_s = climb_s - sum(seconds[: next(i for i, leg in enumerate(legs) if leg.sensing)])
    if late_s <= 0:
        return Lack(0.0, 0.0)
    times_s, places_m = (np.cumsum([0.0, *each]) for each in (seconds, [leg.piece.length_m for leg in legs]))
    return Lack(late_s, float(np.interp(climb_s, times_s, places_m)))


def _unphotographed(solution: CoverageSolution, until_m: float, motion: MotionLimits) -> CoverageSolution:
    """A path without laps whose camera is off up to a place along it [m]."""
    found, end_m = list[CoverageLeg](), 0.0
    for leg in solution.path(0.0).legs:
        start_m, end_m = end_m, end_m + leg.piece.length_m
        if not leg.sensing or start_m >= until_m - SAME_M:
            found.append(leg)
            continue
        low, *rest = [leg] if end_m <= until_m + SAME_M else leg.cut(until_m - start_m)
        found += [replace(low, sensing=False), *rest]
    if not any(leg.sensing for leg in found):
        raise Infeasible("all lines lie in the climb from home", "another --home, or less altitude")
    return timed(replace(solution, sections=tuple(found)), motion)


# --- over terrain

STEP_M = 10.0
"""Distance of the samples of a path [m]; of a terrain with smaller cells half a cell, down to `ASIDE_M`."""

OFF_M = 12.5
"""How far a flight is off along its path, at most [m]: 11 m after turns in wind. A floor is that of all samples as
near, and of the neighbours."""

ASIDE_M = 2.0
"""Distance of a flight from its line [m]: 0.8 m after turns in steady wind, 1.5 m in gusts of 1.5 m/s."""

FLARE_M = 3.0
"""Height from which on an aircraft flares, by the ground as it is [m]: LAND_FLARE_ALT of ArduPilot by default."""

MAP_M = 0.1
"""Height over the ground by which no final approach is refused [m]: maps are less exact."""

CIRCLES = 50
"""Most circles that lead down to a final approach."""

ROUNDING_M = 1e-6

HOME_POINTS = 25
"""Points in a row on a way home."""

WAYS_HOME = 200
"""Ways home that are tried, at least."""


class HeightLimits(NamedTuple):
    """Heights above ground [m]: least on lines, by how much they may be higher, and least elsewhere."""

    line_m: float
    tolerance_m: float
    clearance_m: float


class Ground(NamedTuple):
    """The ground of a flight, and how high above it the flight is.

    Attributes
    ----------
    terrain : ElevationModel
    home_m : (float, float)
        Where its altitude is 0 [m].
    zero_m : float
        Height above the sea there [m].
    limits : HeightLimits
    motion : MotionLimits
    apart_m : float
        Distance of the lines [m].
    given : Airspace, optional
        Obstacles with heights above their ground.
    """

    terrain: ElevationModel
    home_m: Point
    zero_m: float
    limits: HeightLimits
    motion: MotionLimits
    apart_m: float
    given: Airspace = EVERYWHERE

    def heights_m(self, points_m: FloatArray) -> FloatArray:
        """Heights above the altitude 0 [m], shape (n,). Raises Infeasible where one is not known."""
        return self.terrain.known_m(points_m) - self.zero_m

    def samples(self, legs: Sequence[CoverageLeg]) -> Samples:
        """Samples of legs, near enough for its terrain."""
        return Samples.of(legs, min(max(self.terrain.cell_m / 2, ASIDE_M), STEP_M))

    @property
    def airspace(self) -> Airspace:
        """Obstacles whose heights are above the altitude 0: from the highest ground of their outlines."""
        tops = []
        for each in self.given.obstacles:
            if each.height_m is not None:
                known_m = self.terrain.heights_m(np.array(each.outline))
                # an obstacle beyond the terrain has no known height; one whose top is below home counts as high as home
                top_m = (
                    None if np.isnan(known_m).any() else max(float(known_m.max()) - self.zero_m + each.height_m, 0.0)
                )
                each = each._replace(height_m=top_m)
            tops.append(each)
        return self.given._replace(obstacles=tuple(tops))


class Samples(NamedTuple):
    """Samples of legs, shape (n,): places along the path, points, headings, index of the leg that each ends or is in,
    and whether it is on a line."""

    places_m: FloatArray
    points_m: FloatArray
    headings_rad: FloatArray
    legs: IntArray
    on_line: BoolArray

    @classmethod
    def of(cls, legs: Sequence[CoverageLeg], step_m: float) -> Samples:
        """Samples of legs, at most a step [m] apart, with the ends of all."""
        poses, places, owner, on_line = [legs[0].start], [0.0], [0], [legs[0].sensing]
        for k, leg in enumerate(legs):
            on_line[-1] |= leg.sensing
            steps = max(1, math.ceil(leg.piece.length_m / step_m))
            along_m = np.linspace(0, leg.piece.length_m, steps + 1)[1:].tolist()
            poses += [leg.piece.pose_at(place_m) for place_m in along_m]
            places += [places[-1] + place_m for place_m in along_m]
            owner += [k] * steps
            on_line += [leg.sensing] * steps
        x, y, headings = np.array(poses).T
        return cls(np.array(places), np.column_stack([x, y]), headings, np.array(owner), np.array(on_line))


@dataclass(frozen=True)
class HeightProfile:
    """A flight over its ground at samples, shape (n,): heights of the ground below and of the flight [m].

    `commanded_m` are the altitudes in turn, `sides_m` the mean heights of the ground half the lines' distance to either
    side.
    """

    samples: Samples
    ground: Ground
    ground_m: FloatArray
    sides_m: FloatArray
    flown_m: FloatArray
    commanded_m: tuple[float, ...]

    @property
    def above_m(self) -> FloatArray:
        """Heights above ground on lines [m]."""
        return (self.flown_m - self.ground_m)[self.samples.on_line]

    @property
    def overlapping_m(self) -> FloatArray:
        """Heights on lines above the ground where their pictures overlap [m]."""
        return (self.flown_m - self.sides_m)[self.samples.on_line]

    @property
    def home_altitude_m(self) -> int:
        """Altitude at which every straight way home is clear of ground and obstacles [m]."""
        ground, points_m, home_m = self.ground, self.samples.points_m, np.array(self.ground.home_m)
        ends_m = points_m[:: max(1, len(points_m) // WAYS_HOME)] - home_m
        ways_m = home_m + np.linspace(0, 1, HOME_POINTS)[:, None, None] * ends_m
        top_m = ground.airspace.top_on_ways_m(points_m, ground.home_m, CLEARANCE_M)
        top_m = max(float(ground.heights_m(ways_m.reshape(-1, 2)).max()), top_m)
        return math.ceil(top_m + ground.limits.clearance_m)


def over_terrain(
    solution: CoverageSolution,
    ground: Ground,
    climbing: Climbing,
    start_m: float | None = None,
    *,
    lands: FinalApproach | None = None,
) -> tuple[CoverageSolution, HeightProfile]:
    """A path without laps whose legs have the altitudes that keep it above the ground.

    Parameters
    ----------
    solution : CoverageSolution
    ground : Ground
    climbing : Climbing
    start_m : float, optional
        Altitude at the start [m], for a flight from the ground; by default that of the first leg.
    lands : FinalApproach, optional
        The last leg, of a flight that lands. Circles are flown before it where the flight is too high.

    Returns
    -------
    CoverageSolution
        Straight legs are cut where another altitude is commanded.
    HeightProfile
        A final approach is one slope, as an autopilot flies it.

    Raises
    ------
    Infeasible
        Where the height of the ground is not known, or the aircraft cannot climb over it, or descend to the approach.
    """
    legs = _legs(solution)
    samples, motion = ground.samples(legs), ground.motion
    circles = 0 if lands is None else sum(leg == lands.circle for leg in legs)
    # the last samples before the circles and before the final approach, or of all
    last = before = len(samples.legs) - 1
    if lands is not None:
        last, before = (int(np.searchsorted(samples.legs, len(legs) - 1 - n)) - 1 for n in (circles, 0))
    below_m, sides_m, hard_m, ceiling_m = _band(samples, ground)
    floor_m = _spread(hard_m, samples)  # the hard floor of all places where the flight may be by then
    seconds = _seconds(samples, motion)
    if start_m is not None:
        climbed_m = _climbed_m(start_m, samples, seconds, below_m, ground, climbing)
        hard_m, floor_m = np.minimum(hard_m, climbed_m), np.minimum(floor_m, climbed_m)
    land_m, approach_m = 0.0, math.inf  # altitudes at which a final approach ends and begins
    if lands is not None:
        land_m = round(float(ground.heights_m(samples.points_m[-1:])[0]), 2)
        approach_m = LEVEL_M * math.ceil((land_m + lands.height_m) / LEVEL_M)
        # the altitude commanded there is that of the approach; the flight may be a step lower, or as much higher as
        # circles lead down
        down_m = RATE_SHARE * climbing.down_mps * float(seconds[last:before].sum())
        floor_m[last], hard_m[last], ceiling_m[last] = approach_m - LEVEL_M, approach_m, approach_m + down_m
    # altitudes commanded, each with the number of the last sample up to which it holds
    to = last + 1
    band = Band(samples.places_m[:to], seconds[:last], floor_m[:to], ceiling_m[:to], _may_change(legs, samples)[:to])
    try:
        found = commanded(banded(band, climbing, ground.limits.tolerance_m / 2), climbing, hard_m[:to], start_m)
    except Unreachable as error:
        raise Infeasible(f"{error}, at {ground.terrain.place_text(samples.points_m[error.target])}") from None
    if circles:
        found.append((before, approach_m))
    flown_m = [np.array(found[0][1] if start_m is None else start_m)]
    for altitude_m, step_s in zip(_repeated(found), seconds.tolist(), strict=False):
        flown_m.append(climbing.followed_m(flown_m[-1], altitude_m, step_s))
    if lands is not None:
        if (above_m := float(flown_m[-1]) - approach_m) > ground.limits.tolerance_m:
            if lands.circle is None or circles >= CIRCLES:
                raise _too_high(above_m, ground.terrain.place_text(samples.points_m[before]))
            more = lands.circles(above_m, climbing, motion)
            lower = with_circles(solution, len(solution.sections) - 1, lands.circle, more, motion)
            return over_terrain(lower, ground, climbing, start_m, lands=lands)
        found.append((len(below_m) - 1, land_m))
        ways_m = samples.places_m[before + 1 :]
        flown_m += [*np.interp(ways_m, samples.places_m[[before, -1]], [float(flown_m[-1]), land_m])]
    altitudes_m, levels_m = _repeated(found), tuple(level_m for _, level_m in found)
    profile = HeightProfile(samples, ground, below_m, sides_m, np.array(flown_m), levels_m)
    return replace(solution, sections=_cut(legs, samples, altitudes_m)), profile


def _may_change(legs: Sequence[CoverageLeg], samples: Samples) -> BoolArray:
    """Where another altitude may be commanded, shape (n,): on straights, and where a leg ends."""
    on_straight = np.array([leg.piece.turn == 0 for leg in legs])[samples.legs]
    return np.asarray(on_straight | np.append(samples.legs[1:] != samples.legs[:-1], True))


def _too_high(above_m: float, place: str) -> Infeasible:
    message = f"the flight is {above_m:.0f} m too high at {place} for the final approach"
    advice = "a --landing farther away, or from another direction"
    return Infeasible(f"{message}, and no circle beside it has room", advice)


def climb_lack(solution: CoverageSolution, ground: Ground, climbing: Climbing, start_m: float) -> Lack:
    """What a climb from an altitude at the start lacks: on lines their height, on ways the clearance once it has it.

    Raises Infeasible where the height of the ground is not known.
    """
    legs = _legs(solution)
    samples = ground.samples(legs)
    _, _, hard_m, _ = _band(samples, ground)
    up_mps, seconds = RATE_SHARE * climbing.up_mps, _seconds(samples, ground.motion)
    climbed_m = start_m + up_mps * np.concatenate([[0.0], np.cumsum(seconds)])
    floor_m = np.where(samples.on_line, _spread(hard_m, samples), hard_m)
    kept = samples.on_line | np.array([leg.whole_circle for leg in legs])[samples.legs]
    kept |= np.maximum.accumulate(climbed_m >= hard_m)
    lacks_m = np.where(kept, floor_m - climbed_m, 0.0)
    low = np.flatnonzero((lacks_m > ROUNDING_M) & samples.on_line)
    until_m = float(samples.places_m[min(low[-1] + 1, len(lacks_m) - 1)]) if len(low) else 0.0
    return Lack(max(float(lacks_m.max()), 0.0) / up_mps, until_m)


def _seconds(samples: Samples, motion: MotionLimits) -> FloatArray:
    """Times from each sample to the next, shape (n − 1,) [s]."""
    courses = samples.headings_rad[1:]
    speeds_mps, _ = ground_speeds_mps(np.cos(courses), np.sin(courses), motion.airspeed_mps, motion.wind_mps)
    return np.asarray(np.diff(samples.places_m) / speeds_mps)


def _climbed_m(
    start_m: float, samples: Samples, seconds: FloatArray, below_m: FloatArray, ground: Ground, climbing: Climbing
) -> FloatArray:
    """The highest altitudes that a climb from the start reaches, shape (n,) [m]; Infeasible below the ground `below_m`.

    `seconds`, shape (n − 1,), are the times of the steps between samples.
    """
    climbed_m = start_m + RATE_SHARE * climbing.up_mps * np.concatenate([[0.0], np.cumsum(seconds)])
    k = 1 + int(np.argmax((below_m - climbed_m)[1:]))
    if climbed_m[k] < below_m[k]:
        rise = f"rises {below_m[k] - start_m:.0f} m in {samples.places_m[k]:.0f} m of the way from home"
        able = f"the aircraft climbs {climbed_m[k] - start_m:.0f} m"
        message = f"the ground at {ground.terrain.place_text(samples.points_m[k])} {rise}, and {able}"
        raise Infeasible(message, "another --home, or --takeoff another way")
    return climbed_m


def check_approach(final: FinalApproach, ground: Ground) -> None:
    """Raise Infeasible where a final approach comes too near to the ground.

    It has to stay above all that is below it, by half of its height over its end's ground, or by the clearance if that
    is less. Where this is less than `FLARE_M`, nothing is asked.
    """
    samples, limits = ground.samples([final.leg]), ground.limits
    # the highest of the ground and obstacles near each sample, above the ground of the approach's end
    tops_m = _band(samples, ground)[2] - limits.clearance_m - ground.heights_m(samples.points_m[-1:])
    heights_m = final.height_m * (1 - samples.places_m / samples.places_m[-1])
    min_m = np.minimum(limits.clearance_m, heights_m / 2)
    above_m = heights_m - tops_m
    k = int(np.argmin(np.where(min_m < FLARE_M, np.inf, above_m - min_m)))
    if above_m[k] >= min_m[k] - MAP_M:
        return
    place = ground.terrain.place_text(samples.points_m[k])
    message = f"the final approach towards {compass_deg(final.leg.start[2]) % 360:.0f}° "
    if above_m[k] > 0:
        lacks_m = min_m[k] - above_m[k]
        message += f"is {above_m[k]:.1f} m above the ground at {place}, {lacks_m:.2g} m less than it has to be"
    else:
        message += f"leads into the ground at {place}"
    raise Infeasible(message)


def clear_circle(circle: CoverageLeg, final: FinalApproach, ground: Ground) -> bool:
    """Whether a circle at the height at which a final approach begins keeps the clearance."""
    land_m = float(ground.heights_m(np.array([final.leg.end[:2]]))[0])
    return bool(_band(ground.samples([circle]), ground)[2].max() <= land_m + final.height_m)


def _repeated(found: Sequence[tuple[int, float]]) -> FloatArray:
    """The altitude commanded on each step from a sample to the next [m], from the last sample of each altitude."""
    lasts, levels_m = zip(*found, strict=True)
    return np.repeat(levels_m, np.diff([0, *lasts]))


def _legs(solution: CoverageSolution) -> list[CoverageLeg]:
    return [leg for leg in solution.path(0.0).legs if leg.piece.length_m > 0]


def _band(samples: Samples, ground: Ground) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Of each sample: height of the ground below, mean height on both sides, floor and ceiling of the flight [m].

    On lines both sides are half the lines' distance away, and a ceiling holds; elsewhere the clearance of turns is.
    """
    limits, on_line = ground.limits, samples.on_line
    aside_m = np.where(on_line, ground.apart_m / 2, CLEARANCE_SHARE * ground.motion.min_radius_m)[:, None]
    normals = np.column_stack([-np.sin(samples.headings_rad), np.cos(samples.headings_rad)])
    places_m = [samples.points_m + side * aside_m * normals for side in (0, 1, -1)]
    below_m, left_m, right_m = map(ground.heights_m, places_m)
    sides_m = (left_m + right_m) / 2
    # the ground below, and where the flight may be beside its line
    near_m = [below_m, *(ground.heights_m(samples.points_m + aside * normals) for aside in (ASIDE_M, -ASIDE_M))]
    on_lines_m = np.maximum(np.max(near_m, axis=0), sides_m) + limits.line_m
    floor_m = np.where(on_line, on_lines_m, np.max([below_m, left_m, right_m], axis=0) + limits.clearance_m)
    for each in ground.airspace.obstacles:
        if each.height_m is not None:
            over = np.any([holding([each.outline], points)[0] for points in places_m], axis=0)
            floor_m = np.where(over, np.maximum(floor_m, each.height_m + limits.clearance_m), floor_m)
    high_m = np.min(near_m, axis=0) + limits.line_m + limits.tolerance_m
    return below_m, sides_m, floor_m, np.where(on_line, -_spread(-high_m, samples), np.inf)


def _spread(values: FloatArray, samples: Samples) -> FloatArray:
    """For each sample the greatest value of all samples within `OFF_M` before and after it, its neighbours at least."""
    from scipy.ndimage import maximum_filter1d

    count = max(1, int(OFF_M / float(np.diff(samples.places_m).max())))
    return np.asarray(maximum_filter1d(values, 2 * count + 1, mode="nearest"))


def _cut(legs: Sequence[CoverageLeg], samples: Samples, altitudes_m: FloatArray) -> tuple[CoverageLeg, ...]:
    """The legs, cut where the altitude commanded changes; `altitudes_m` is that of each step between samples."""
    parts: list[CoverageLeg] = []
    for k, leg in enumerate(legs):
        own = np.flatnonzero(samples.legs[1:] == k).tolist()  # the leg's steps: step i starts at sample i
        changes = [j for i, j in itertools.pairwise(own) if altitudes_m[i] != altitudes_m[j]]
        pieces = leg.cut(*(samples.places_m[changes] - samples.places_m[own[0]]).tolist()) if changes else [leg]
        starts = [own[0], *changes]
        parts += [replace(part, altitude_m=float(altitudes_m[i])) for part, i in zip(pieces, starts, strict=True)]
    return tuple(parts)
