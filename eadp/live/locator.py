"""The position in a plan by telemetry: how well positions fit its legs, and the take-off before it."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from eadp.core.geometry.curves import Point, tangent
from eadp.errors import EadpError
from eadp.models.plan.cursor import LAP_LIMIT, PlanCursor, cursors
from eadp.models.plan.executor import ENDED, FIRED, PlanExecutor
from eadp.models.plan.route import RoutePredictor
from eadp.models.plan.stage import Leg, left_m, leg_points
from eadp.planning.base import Sample

GAP_S, GAP_STEPS = 5.0, 3.0
"""A gap: minimum length [s], and in multiples of the step before."""

STEP_M, MAX_STEPS = 1.0, 5000
"""Distance of trigger checks between two samples [m], and their maximum number."""

DISTANCE_STD_M, COURSE_STD_RAD = 15.0, 0.5
"""Standard deviations of the distance from the path, and of the course from its direction, on the right stage: the
aircraft joins each stage within a trigger's radius."""

TIME_STD_S, TIME_STD_SHARE = 3.0, 0.08
"""Standard deviation of the time flown in a gap: a constant [s], and a share of the forecast."""

MAX_STDS = 5.0
"""Maximum mismatch of time, and of position and course together, in standard deviations."""

POINT_M, MAX_POINTS = 3.0, 400
"""Distance of the points of a stage at which a position is sought [m], and their maximum number."""


class FollowedExecutor(PlanExecutor):
    """A flight through a plan that others fly, and tell of: it may be elsewhere in the plan than its triggers say."""

    def take_in_force(self, parameters: Sequence[float], position: Point) -> bool:
        """Take parameters that are known to be in force, whatever was decided; return whether they are others.

        Raises
        ------
        PathUndefined
            If the path has no value at them.
        """
        values = tuple(parameters)
        if values == self.cursor.parameters:
            return False
        return self._change(self.cursor.in_force(values), position)

    def placed(
        self, cursor: PlanCursor, joined_m: Point, stages_started: int, position: Point, share: float
    ) -> FollowedExecutor:
        """A flight through the same plan that is somewhere else: a share along a stage, at a position [m].

        Raises
        ------
        PathUndefined
            As `advance`.
        """
        other = copy.copy(self)
        other.cursor, other.joined_m, other.stages_started = cursor, joined_m, stages_started
        other._lay_out(position)
        other.watch.resume(share)
        return other

    def skip(self, position: Point) -> bool:
        """Leave the stage at a position [m], wherever its trigger is; return whether another one has started.

        Raises
        ------
        PathUndefined
            As `advance`.
        """
        return self._leave(position, ended=bool(self.watch.events(*position) & ENDED))

    def stay(self, x: float, y: float) -> None:
        """Take a position [m] at which the stage is known to go on: only the plan's end counts.

        Raises
        ------
        PathUndefined
            If the next lap's loop variables have no value.
        """
        events = self.watch.events(x, y)
        self.complete = bool(events & ENDED) or (bool(events & FIRED) and self.cursor.next() is None)

    def past_end(self) -> FollowedExecutor | None:
        """The flight that goes on where this one is complete, without its end on this leg; None without a next stage.

        Raises
        ------
        PathUndefined
            If the next lap's loop variables have no value.
        """
        if self.cursor.next() is None:
            return None
        other = copy.copy(self)
        other.complete, other.watch = False, self.watch.without_end()
        return other

    def stages_to(self, index: int) -> int | None:
        """In how many stages from here the next one of an index (from 1) starts; None where none will.

        Raises
        ------
        PathUndefined
            If a lap's loop variables have no value.
        """
        if not 1 <= index <= len(self.cursor.table.plan.stages):
            return None
        ahead = itertools.islice(cursors(self.cursor), 1, LAP_LIMIT)
        return next((count for count, cursor in enumerate(ahead, 1) if cursor.stage.index == index), None)


class LegAhead(NamedTuple):
    """A leg `legs_on` legs later, from 0, with the cursor at its stage; its start after now, and duration [s]."""

    legs_on: int
    cursor: PlanCursor
    leg: Leg
    start_s: float
    duration_s: float


class Match(NamedTuple):
    """Where a sample fits a leg best: the leg, its share, and the square of the mismatch in standard deviations."""

    ahead: LegAhead
    share: float
    mismatch: float


def legs_ahead(
    executor: PlanExecutor, flown_s: float, position: Point, cruise_mps: float, wind_mps: Point
) -> Iterator[LegAhead]:
    """The legs left to fly from a position [m], `flown_s` [s] after the stage started, and when they are flown.

    Up to the first leg that cannot be flown in this wind.

    Raises
    ------
    PathUndefined
        Where the route has no path.
    """
    route = RoutePredictor().route(executor.cursor, executor.joined_m)
    times_s = route.times_s(cruise_mps, wind_mps)[0].tolist()
    # the start of the first leg: by where the position is on it, and on a circle by the time on it
    start_s = 0.0
    if route.legs and 0 < times_s[0] < math.inf and route.legs[0].distance_m > 0:
        leg = route.legs[0]
        share = min(1.0, flown_s / times_s[0])
        left = left_m(leg, position, share * leg.distance_m, executor.cursor.table.plan.max_radius_m)
        start_s = -(1 - left / leg.distance_m) * times_s[0]
    for legs_on, (leg, time_s, cursor) in enumerate(zip(route.legs, times_s, cursors(executor.cursor), strict=False)):
        if not math.isfinite(time_s):
            return
        yield LegAhead(legs_on, cursor, leg, start_s, time_s)
        start_s += time_s


def time_std_s(elapsed_s: float) -> float:
    """Standard deviation of the time flown in a gap [s]."""
    return TIME_STD_S + TIME_STD_SHARE * elapsed_s


def best_match(ahead: LegAhead, seen: Sample, elapsed_s: float | None = None) -> Match | None:
    """The point of a leg that a sample with a position fits best, by position and course; None where none fits.

    With `elapsed_s`, the time since what the legs are ahead of [s], by the time too.
    """
    assert seen.position_m is not None
    std_s = time_std_s(elapsed_s or 0.0)
    if elapsed_s is not None and ahead.start_s + ahead.duration_s < elapsed_s - MAX_STDS * std_s:
        return None
    points = leg_points(ahead.leg, max(POINT_M, ahead.leg.distance_m / MAX_POINTS))
    shares = np.linspace(0.0, 1.0, len(points))
    # squares of how far each point is from time, place and course, in standard deviations
    off_time2 = np.zeros(len(points))
    if elapsed_s is not None:
        off_time2 = ((ahead.start_s + shares * ahead.duration_s - elapsed_s) / std_s) ** 2
    offsets = points[:, :2] - seen.position_m
    off_path2 = np.sum(offsets**2, axis=1) / DISTANCE_STD_M**2
    if seen.course_rad is not None:
        turned = points[:, 2] - seen.course_rad
        off_path2 += (np.remainder(turned + math.pi, 2 * math.pi) - math.pi) ** 2 / COURSE_STD_RAD**2
    near = (off_time2 <= MAX_STDS**2) & (off_path2 <= MAX_STDS**2)
    total = np.where(near, off_time2 + off_path2, math.inf)
    best = int(np.argmin(total))
    return Match(ahead, float(shares[best]), float(total[best])) if math.isfinite(total[best]) else None


def path_mismatch(executor: PlanExecutor, to: Sample) -> float:
    """Square of the mismatch of position and course with the path of a flight's stage, in standard deviations.

    0 where the path function has no value here: that does not speak against the stage.
    """
    assert to.position_m is not None
    ox, oy = executor.cursor.offset_m
    local = (to.position_m[0] - ox, to.position_m[1] - oy)
    try:
        phi, gx, gy, *_ = executor.path(*local)
        dx, dy = tangent(executor.path, local, executor.stage.sense)
    except (EadpError, ArithmeticError, ValueError):
        return 0.0
    # (d/σ_d)² + (Δχ/σ_χ)², with d = φ/|∇φ|
    mismatch = (phi / math.hypot(gx, gy) / DISTANCE_STD_M) ** 2
    if to.course_rad is not None:
        turned = math.remainder(math.atan2(dy, dx) - to.course_rad, 2 * math.pi)
        mismatch += (turned / COURSE_STD_RAD) ** 2
    return mismatch


def line_between(start: Point, end: Point) -> list[Point]:
    """The points after `start` of the straight line to `end`, at most `STEP_M` apart [m]."""
    (x0, y0), (x1, y1) = start, end
    steps = min(max(1, math.ceil(math.dist(start, end) / STEP_M)), MAX_STEPS)
    return [(x0 + k / steps * (x1 - x0), y0 + k / steps * (y1 - y0)) for k in range(1, steps + 1)]


ON_GROUND = 0.5
"""Share of the airspeed of cruise below which no aeroplane flies."""

NEAR_M, NEAR_SHARE, STAYS_S = 10.0, 0.1, 5.0
"""How near altitude [m] and airspeed, as a share, are to the plan's once it is reached, and for how long [s]."""

SLOWEST_MPS, MAX_S = 1.0, 120.0
"""The slowest climb [m/s]: what changes its altitude by less flies level; and the longest take-off [s]: what holds
another airspeed by then goes on doing so."""


class InitialClimb:
    """Follows a take-off by the altitude and the airspeed, as far as they are measured.

    Parameters
    ----------
    first : Sample
        The first of the flight.
    cruise_mps : float
        Airspeed of cruise [m/s].
    altitude_m : float
        The plan's at its start [m].

    Attributes
    ----------
    from_ground : bool
        Whether the flight started on the ground.
    on_plan : bool
        Whether the plan is reached; it stays reached.
    """

    def __init__(self, first: Sample, cruise_mps: float, altitude_m: float) -> None:
        self._cruise_mps, self._start_s = cruise_mps, first.time_s
        airspeed_mps = cruise_mps if first.airspeed_mps is None else first.airspeed_mps
        self.from_ground = airspeed_mps < ON_GROUND * cruise_mps
        # the altitude of level flight [m], and since when it is held [s]; since when the flight is near its plan [s]
        self._level_m, self._level_s = first.altitude_m or 0.0, first.time_s
        self._near_s: float | None = None
        self.on_plan = not self.from_ground and self._update_near(first, altitude_m)

    def update(self, sample: Sample, altitude_m: float) -> None:
        """Update `on_plan` with a sample, beside the plan's altitude at it [m]."""
        if self.on_plan:
            return
        if not self._update_near(sample, altitude_m):
            self._near_s = None
        elif self._near_s is None:
            self._near_s = sample.time_s
        stays = self._near_s is not None and sample.time_s - self._near_s >= STAYS_S
        self.on_plan = stays or sample.time_s - self._start_s > MAX_S

    def _update_near(self, sample: Sample, altitude_m: float) -> bool:
        """Note the altitude of a sample; return whether the flight is near its plan, as far as this is measured.

        That is at cruise airspeed, and at the plan's altitude [m] or at another one that it holds. Where no altitude is
        measured, it is at the plan's once the slowest climb has got there.
        """
        near = sample.airspeed_mps is None or abs(sample.airspeed_mps / self._cruise_mps - 1) <= NEAR_SHARE
        if sample.altitude_m is None:
            return near and (not self.from_ground or (sample.time_s - self._start_s) * SLOWEST_MPS >= altitude_m)
        if abs(sample.altitude_m - self._level_m) > SLOWEST_MPS * STAYS_S:
            self._level_m, self._level_s = sample.altitude_m, sample.time_s
        held = sample.altitude_m > NEAR_M and sample.time_s - self._level_s >= STAYS_S
        return near and (held or abs(sample.altitude_m - altitude_m) <= NEAR_M)
