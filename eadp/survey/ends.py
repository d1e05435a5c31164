"""Altitudes that an aircraft is commanded along a path, so that it stays above a floor and below a ceiling.

A commanded altitude holds for a part of the path. A model follows it at once, as fast as it can; autopilots spread the
change over the part. Both keep to the floor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray
from eadp.core.geometry.dubins import Piece, Pose, centre_m, polyline_m
from eadp.core.geometry.polygons import FreeSpace
from eadp.core.guidance import RATE_SHARE
from eadp.errors import Infeasible, Unreachable
from eadp.survey.coverage import CoverageSolution, timed
from eadp.survey.swaths import CoverageLeg, MotionLimits

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
    solution: CoverageSolution,
    motion: MotionLimits,
    space: FreeSpace | None,
    lack: Callable[[CoverageSolution], Lack],
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
    first = next(i for i, leg in enumerate(legs) if leg.sensing)
    late_s = left_s = climb_s - motion.time_s([leg.piece for leg in legs[:first]])
    until_m = sum(leg.piece.length_m for leg in legs[:first])
    for leg in legs[first:]:
        if left_s <= 0:
            break
        leg_s = motion.time_s([leg.piece])
        until_m, left_s = until_m + leg.piece.length_m * min(1.0, left_s / leg_s), left_s - leg_s
    return Lack(max(late_s, 0.0), until_m if late_s > 0 else 0.0)


def _unphotographed(solution: CoverageSolution, until_m: float, motion: MotionLimits) -> CoverageSolution:
    """A path without laps whose camera is off up to a place along it [m]."""
    found, off, end_m = list[CoverageLeg](), list[CoverageLeg](), 0.0
    for leg in solution.path(0.0).legs:
        start_m, end_m = end_m, end_m + leg.piece.length_m
        if not leg.sensing or start_m >= until_m - SAME_M:
            found.append(leg)
            continue
        low_m = until_m - start_m
        low, *rest = [leg] if end_m <= until_m + SAME_M else leg.cut(low_m)
        gaps = tuple((max(start - low_m, 0.0), end - low_m) for start, end in leg.gaps_m if end > low_m)
        off.append(replace(low, sensing=False, gaps_m=()))
        found += [off[-1], *(replace(each, gaps_m=gaps) for each in rest)]
    if not any(leg.sensing for leg in found):
        raise Infeasible("all lines lie in the climb from home", "another --home, or less altitude")
    return timed(replace(solution, sections=tuple(found), in_climb=tuple(off)), motion)
