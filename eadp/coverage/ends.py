"""The ends of a flight: the climb before its first line, and the final approach with the circle that leads down to it.

An aircraft climbs and descends on whole circles beside its path, which an autopilot flies until it has its altitude
(MAV_CMD_NAV_LOITER_TO_ALT). Ground that is flown over below the altitude of the pictures would have to be flown over
again: the same way and its turns besides. So a circle, which takes the time that the climb lacks, always costs less.
Only where no circle has room is the camera off until the altitude is reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

from eadp.core.flight.aerodynamics import RATE_SHARE
from eadp.core.flight.following import Climbing
from eadp.core.geometry.dubins import Piece, Pose, centre_m, polyline_m
from eadp.core.geometry.polygons import FreeSpace
from eadp.coverage.cover import CoverageSolution, timed
from eadp.coverage.swaths import CoverageLeg, MotionLimits
from eadp.errors import Infeasible

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
