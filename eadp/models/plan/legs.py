"""One leg: a stage as it is flown exactly along its path, from where it is joined to its trigger."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from eadp.core.expressions.derivatives import PathFunction
from eadp.core.geometry.curves import Point
from eadp.core.geometry.tracks import Track
from eadp.models.plan.stage import Stage


class Leg(NamedTuple):
    """One stage of a route: from where it is joined to its trigger.

    `track` is its path as travelled to its trigger, in the frame of lap 0. `flown_m` is less than `length_m` for the
    leg on which the plan ends.
    """

    lap: int
    stage: Stage
    track: Track
    offset_m: Point
    start_m: Point
    end_m: Point
    length_m: float
    flown_m: float = math.inf

    @property
    def path(self) -> PathFunction:
        """Its path function, in the frame of lap 0."""
        return self.track.path

    @property
    def distance_m(self) -> float:
        """The distance flown along the leg [m]."""
        return min(self.length_m, self.flown_m)


class TracePoint(NamedTuple):
    """A point of the nominal path [m] with its direction of travel [rad]."""

    stage: int
    kind: str
    x_m: float
    y_m: float
    heading_rad: float


def leg_points(leg: Leg, step_m: float) -> Iterator[TracePoint]:
    """The points of one stage, to where the plan ends on it; see `trace`."""
    stage, (ox, oy) = leg.stage, leg.offset_m
    start = (leg.start_m[0] - ox, leg.start_m[1] - oy)
    share = leg.distance_m / leg.length_m if leg.length_m else 1.0
    count = max(1, math.ceil(leg.distance_m / step_m - 1e-9))
    for (x, y), heading in leg.track.points(start, leg.distance_m, share, count):
        yield TracePoint(stage.index, stage.kind, x + ox, y + oy, heading)


def left_m(leg: Leg, position: Point, flown_m: float, early_m: float = 0.0) -> float:
    """The distance left of a leg at a position [m]; up to `early_m` more than the leg, where the last one ended early.

    Parameters
    ----------
    leg : Leg
    position : (float, float)
        Where the aircraft is [m].
    flown_m : float
        Distance flown on it so far, roughly [m]: it resolves turns round a circle, and is the measure on a curve.
    """
    local = (position[0] - leg.offset_m[0], position[1] - leg.offset_m[1])
    cut_m = leg.length_m - leg.distance_m
    left = leg.track.remaining_m(local, leg.distance_m - flown_m + cut_m) - cut_m
    return min(max(left, 0.0), leg.distance_m + early_m)


def rest_of(leg: Leg, position: Point, flown_m: float) -> Leg:
    """A leg from a position on [m], with about the distance flown on it so far [m]; see `left_m`."""
    rest_m = min(left_m(leg, position, flown_m), leg.distance_m)
    (ox, oy), (x, y) = leg.offset_m, position
    nx, ny = leg.track.nearest((x - ox, y - oy))
    cut_m = leg.length_m - leg.distance_m
    return leg._replace(start_m=(nx + ox, ny + oy), length_m=rest_m + cut_m, flown_m=rest_m)
