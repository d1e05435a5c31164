"""With what probability a flight enters an obstacle or leaves its boundary: its path flown in the wind, with gusts.

The aircraft is a point that follows the path by course, with the guidance's gains linearised about it, and turns no
faster than it can. It is flown many times at once, each with gusts of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray
from eadp.core.flight.wind import ground_speeds_mps
from eadp.core.geometry.curves import Point
from eadp.models.airspace import BOUNDARY, Airspace
from eadp.models.plan.legs import Leg, TracePoint, leg_points
from eadp.models.vehicle import Airframe, FixedWing, Guidance
from eadp.planning.state.climb import ClimbFollower

FLIGHTS = 200
"""Flights with gusts of their own."""
STEP_M = 2.0
"""Greatest distance between the points of a path [m]."""
NEAR_RADII, LEAD_M = 4.0, 300.0
"""Points within so many turning radii of an obstacle count, and are flown to from so far before [m]."""


def entering(
    legs: Sequence[Leg],
    airspace: Airspace,
    airframe: Airframe,
    guidance: Guidance,
    wind_mps: Point,
    gusts: tuple[float, float],
    climb: ClimbFollower | None = None,
) -> dict[str, float]:
    """Probability of each obstacle to be entered and of the boundary to be left, by name; those of 0 are left out.

    An obstacle is entered below its top alone, by the altitude at the place.

    Parameters
    ----------
    legs : sequence of Leg
        The route.
    airspace : Airspace
        What is in the way.
    airframe, guidance
    wind_mps : (float, float)
        Steady wind [m/s].
    gusts : (float, float)
        Their standard deviation on each axis [m/s] and time constant [s].
    climb : ClimbFollower, optional
        At take-off; without, the flight is at the airframe's own altitude.
    """
    from eadp.core.geometry.polygons import holding, near_edges

    if not any(airspace):
        return {}
    # the path's points near an obstacle or the boundary
    points = [(leg, point) for leg in legs for point in [*leg_points(leg, STEP_M)][1:]]
    at_m = np.array([(point.x_m, point.y_m) for _, point in points])
    courses = np.unwrap([point.heading_rad for _, point in points])
    steps_m = np.linalg.norm(np.diff(at_m, axis=0, prepend=at_m[:1]), axis=1)
    altitudes_m = np.full(len(points), airframe.cruise_altitude_m)
    if climb is not None:
        ground_mps, _ = ground_speeds_mps(np.cos(courses), np.sin(courses), airframe.airspeed_mps, wind_mps)
        for i, step_s in enumerate((steps_m / np.maximum(ground_mps, 1.0)).tolist()):
            climb.follow(points[i][0].stage, step_s)
            altitudes_m[i] = climb.climb.altitude_m
    airspace = airspace.in_the_way(float(altitudes_m.min()))
    edges = [*(each.outline for each in airspace.obstacles), *airspace.boundary]
    if not edges:
        return {}
    places, areas = near_edges(edges, at_m, NEAR_RADII * airframe.turn_radius_m)
    if not len(places):
        return {}
    near = np.zeros(len(at_m), dtype=bool)
    near[places] = True
    obstacles = [airspace.obstacles[i] for i in np.unique(areas).tolist() if i < len(airspace.obstacles)]
    outlines = [each.outline for each in obstacles]
    tops_m = np.array([np.inf if each.height_m is None else each.height_m for each in obstacles])
    through = _flown_through(steps_m, near)
    # which flights have entered each obstacle, and left the boundary
    entered = np.zeros((len(outlines) + bool(airspace.boundary), FLIGHTS), dtype=bool)
    for i, off_m in _flights(points, courses, steps_m, through, airframe, guidance, wind_mps, gusts):
        if near[i]:
            there_m = at_m[i] + off_m[:, None] * (-math.sin(courses[i]), math.cos(courses[i]))
            entered[: len(outlines)] |= holding(outlines, there_m) & (tops_m > altitudes_m[i])[:, None]
            if airspace.boundary:
                entered[-1] |= ~holding(airspace.boundary, there_m).any(axis=0)
    names = [*(each.name for each in obstacles), BOUNDARY]
    return {name: share for name, share in zip(names, entered.mean(axis=1).tolist(), strict=False) if share}


def _flights(
    points: Sequence[tuple[Leg, TracePoint]],
    courses: FloatArray,
    steps_m: FloatArray,
    through: BoolArray,
    airframe: Airframe,
    guidance: Guidance,
    wind_mps: Point,
    gusts: tuple[float, float],
) -> Iterator[tuple[int, FloatArray]]:
    """Fly along a path `FLIGHTS` times at once; yield each point flown `through`, by number, and the errors.

    The errors, shape (FLIGHTS,), are how far each flight is to the left of the point [m]. `courses` are the path's
    [rad], `steps_m` the distances from the points before [m], both of shape (n,); the rest is as in `entering`.
    """
    # ground speed, and the greatest turn rate of the course [rad/s]
    speed = airframe.airspeed_mps
    ground_mps, along_mps = ground_speeds_mps(np.cos(courses), np.sin(courses), speed, wind_mps)
    ground_mps = np.maximum(ground_mps, 1.0)
    # χ̇ = θ̇ a·ṗ/‖ṗ‖², with θ̇ at most V/R
    limited = isinstance(airframe, FixedWing)
    greatest = speed * along_mps / (airframe.turn_radius_m * ground_mps) if limited else np.full(len(points), np.inf)
    rng, (gust_mps, gust_s) = np.random.default_rng(0), gusts
    # of each flight: gust [m/s], and how far it is beside the path [m] and off its course [rad], left positive
    gust = rng.standard_normal((2, FLIGHTS)) * gust_mps
    off_m, off_rad = np.zeros(FLIGHTS), np.zeros(FLIGHTS)
    before = None  # the leg of the point before
    for i in np.flatnonzero(through).tolist():
        leg, course = points[i][0], courses[i]
        # by how much the path has turned since the point before: in a curve along a leg, or in a corner between two
        turned = course - courses[i - 1] if i and before is not None else 0.0
        along_leg = leg is before
        if i == 0 or not through[i - 1]:  # a new stretch: all flights start on the path
            off_m[:], off_rad[:] = 0.0, 0.0
            turned, along_leg = 0.0, True
        before = leg
        # the step from the point before: the gusts, the guidance's turn rate, and where the flights are then
        step_s = steps_m[i] / ground_mps[i]
        # Ornstein-Uhlenbeck: g ← ρ g + √(1 − ρ²) σ n, with ρ = e^(−Δt/τ)
        keep = math.exp(-step_s / gust_s)
        gust = keep * gust + math.sqrt(1 - keep * keep) * gust_mps * rng.standard_normal((2, FLIGHTS))
        across_mps = gust[1] * math.cos(course) - gust[0] * math.sin(course)
        # χ̇ = χ̇_path − k_d (Δχ + v_⊥/v + arctan(k e)); e ← e + (v sin Δχ + v_⊥) Δt
        curving = turned / step_s if along_leg and step_s > 0 else 0.0
        gain = guidance.gain_per_m if guidance.normalised else _gain_per_m(leg, points[i][1].x_m, points[i][1].y_m)
        wanted = curving - guidance.k_d * (off_rad + across_mps / ground_mps[i] + np.arctan(gain * off_m))
        off_rad = off_rad + np.clip(wanted, -greatest[i], greatest[i]) * step_s - turned
        off_m = off_m + (ground_mps[i] * np.sin(off_rad) + across_mps) * step_s
        yield i, off_m


def _flown_through(steps_m: FloatArray, near: BoolArray) -> BoolArray:
    """Which points of a path are flown through: those with a point that is `near` at most `LEAD_M` ahead, shape (n,).

    `steps_m` are the distances from the points before [m], shape (n,).
    """
    flown_m = np.cumsum(steps_m)
    ahead_m = flown_m[np.minimum(np.searchsorted(flown_m, flown_m + LEAD_M), len(flown_m) - 1)]
    # numbers of near points before each point, and up to LEAD_M ahead of it: they differ where one lies between
    counts = np.concatenate(([0], np.cumsum(near)))
    through: BoolArray = counts[np.searchsorted(flown_m, ahead_m, side="right")] > counts[: len(near)]
    return through


def _gain_per_m(leg: Leg, x_m: float, y_m: float) -> float:
    """The gain of a leg's guidance for the distance to its path [1/m]."""
    _, gx, gy, *_ = leg.path(x_m - leg.offset_m[0], y_m - leg.offset_m[1])
    return leg.stage.gain * math.hypot(gx, gy)
