"""With what probability a flight enters an obstacle or leaves its boundary: its path flown in the wind, with gusts.

The aircraft is a point that follows the path by course, with the guidance's gains linearised about it, and turns no
faster than it can. It is flown many times at once, each with gusts of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight import ground_speeds_mps
from eadp.core.geometry.curves import LINE, Point
from eadp.models.airspace import BOUNDARY, HOME_RADII, WayHome
from eadp.models.plan.route import Route
from eadp.models.plan.stage import Leg, leg_points
from eadp.models.vehicle import Airframe, Guidance
from eadp.models.weather import Wind
from eadp.models.world import Mission
from eadp.planning.state.climb import ClimbFollower, climb_rates_mps
from eadp.planning.state.known import Known

FLIGHTS = 200
"""Flights with gusts of their own."""
STEP_M = 2.0
"""Greatest distance between the points of a path [m]."""
NEAR_RADII = 4.0
"""Points within so many turning radii of an obstacle count."""


class _Points(NamedTuple):
    """Points of a path: the leg of each, its place [m], the course there [rad], and the way from the one before [m]."""

    legs: list[Leg]
    at_m: FloatArray
    courses: FloatArray
    steps_m: FloatArray

    @classmethod
    def along(cls, legs: Sequence[Leg]) -> _Points:
        """Points at most `STEP_M` apart along legs."""
        of_legs = [leg_points(leg, STEP_M)[1:] for leg in legs]
        at_m, courses = np.concatenate(of_legs)[:, :2], np.unwrap(np.concatenate(of_legs)[:, 2])
        steps_m = np.linalg.norm(np.diff(at_m, axis=0, prepend=at_m[:1]), axis=1)
        return cls([leg for leg, own in zip(legs, of_legs, strict=True) for _ in own], at_m, courses, steps_m)

    def altitudes_m(self, mission: Mission, wind: Wind) -> FloatArray:
        """Altitude at each of a flight from take-off on [m]: that of cruise where none is commanded."""
        altitudes_m: FloatArray = np.full(len(self.legs), mission.vehicle.cruise_altitude_m)
        climb = ClimbFollower.of(mission)
        if climb is None:
            return altitudes_m
        cosine, sine = np.cos(self.courses), np.sin(self.courses)
        ground_mps, _ = ground_speeds_mps(cosine, sine, mission.cruise_mps, wind.steady_mps)
        for i, step_s in enumerate((self.steps_m / np.maximum(ground_mps, 1.0)).tolist()):
            stage = self.legs[i].stage
            climb.follow(stage, stage.airspeed_mps or mission.cruise_mps, step_s)
            altitudes_m[i] = climb.climb.altitude_m
        return altitudes_m


def entering(mission: Mission, legs: Sequence[Leg], guidance: Guidance, wind: Wind) -> dict[str, float]:
    """Probability of each obstacle to be entered and of the boundary to be left, by name; those of 0 are left out.

    An obstacle is entered below its top alone, by the altitude at the place.

    Parameters
    ----------
    mission : Mission
        Its plan has what is in the way.
    legs : sequence of Leg
        The route.
    guidance : Guidance
    wind : Wind
        At take-off, with gusts.
    """
    from eadp.core.geometry.polygons import holding, near_edges

    airframe, airspace = mission.vehicle, mission.plan.site.airspace
    if not any(airspace):
        return {}
    # the path's points near an obstacle or the boundary
    path = _Points.along(legs)
    altitudes_m = path.altitudes_m(mission, wind)
    airspace = airspace.in_the_way(float(altitudes_m.min()))
    edges = [*(each.outline for each in airspace.obstacles), *airspace.boundary]
    if not edges:
        return {}
    places, areas = map(np.unique, near_edges(edges, path.at_m, NEAR_RADII * airframe.turn_radius_m))
    if not len(places):
        return {}
    obstacles = [airspace.obstacles[i] for i in areas.tolist() if i < len(airspace.obstacles)]
    tops_m = np.array([np.inf if each.height_m is None else each.height_m for each in obstacles])
    off_m, courses = _beside_m(path, airframe, guidance, wind)[places], path.courses[places]
    left = np.column_stack((-np.sin(courses), np.cos(courses)))
    there_m = (path.at_m[places][:, None] + off_m[:, :, None] * left[:, None]).reshape(-1, 2)
    # which flights have entered each obstacle, and left the boundary, at which points
    below = (tops_m[:, None] > altitudes_m[places])[:, :, None]
    within = [*(holding([each.outline for each in obstacles], there_m).reshape(len(obstacles), *off_m.shape) & below)]
    if airspace.boundary:
        within.append(~holding(airspace.boundary, there_m).any(axis=0).reshape(off_m.shape))
    shares = [float(each.any(axis=0).mean()) for each in within]
    names = [*(each.name for each in obstacles), BOUNDARY]
    return {name: share for name, share in zip(names, shares, strict=False) if share}


def _beside_m(path: _Points, airframe: Airframe, guidance: Guidance, wind: Wind) -> FloatArray:
    """Fly along a path `FLIGHTS` times at once: how far each is to the left of each point, shape (n, FLIGHTS) [m]."""
    legs, at_m, courses, steps_m = path
    # ground speed, and the greatest turn rate of the course [rad/s]
    speed = airframe.airspeed_mps
    ground_mps, along_mps = ground_speeds_mps(np.cos(courses), np.sin(courses), speed, wind.steady_mps)
    ground_mps = np.maximum(ground_mps, 1.0)
    # χ̇ = θ̇ a·ṗ/‖ṗ‖², with θ̇ at most V/R
    greatest = np.full(len(legs), np.inf)
    if airframe.takes_commands:
        greatest = speed * along_mps / (airframe.turn_radius_m * ground_mps)
    rng, gust_mps, gust_s = np.random.default_rng(0), wind.gust_std_mps, wind.gust_time_s
    # of each flight: gust [m/s], and how far it is beside the path [m] and off its course [rad], left positive
    gust = rng.standard_normal((2, FLIGHTS)) * gust_mps
    off_m, off_rad = np.zeros((len(legs), FLIGHTS)), np.zeros(FLIGHTS)
    for i, (leg, course) in enumerate(zip(legs, courses.tolist(), strict=True)):
        # by how much the path has turned since the point before: in a curve along a leg, or in a corner between two
        turned = course - courses[i - 1] if i else 0.0
        # the step from the point before: the gusts, the guidance's turn rate, and where the flights are then
        step_s = steps_m[i] / ground_mps[i]
        # Ornstein-Uhlenbeck: g ← ρ g + √(1 − ρ²) σ n, with ρ = e^(−Δt/τ)
        keep = math.exp(-step_s / gust_s)
        gust = keep * gust + math.sqrt(1 - keep * keep) * gust_mps * rng.standard_normal((2, FLIGHTS))
        across_mps = gust[1] * math.cos(course) - gust[0] * math.sin(course)
        # χ̇ = χ̇_path − k_d (Δχ + v_⊥/v + arctan(k e)); e ← e + (v sin Δχ + v_⊥) Δt
        curving = turned / step_s if leg is legs[i - 1] and step_s > 0 else 0.0
        gain = _gain_per_m(leg, *at_m[i].tolist())
        beside_m = off_m[max(i - 1, 0)]
        wanted = curving - guidance.k_d * (off_rad + across_mps / ground_mps[i] + np.arctan(gain * beside_m))
        off_rad = off_rad + np.clip(wanted, -greatest[i], greatest[i]) * step_s - turned
        off_m[i] = beside_m + (ground_mps[i] * np.sin(off_rad) + across_mps) * step_s
    return off_m


def _gain_per_m(leg: Leg, x_m: float, y_m: float) -> float:
    """The gain of a leg's guidance for the distance to its path [1/m]."""
    _, gx, gy, *_ = leg.path(x_m - leg.offset_m[0], y_m - leg.offset_m[1])
    return leg.stage.gain * math.hypot(gx, gy)


MAX_SLOWED = 0.9
"""Greatest share of the ground speed that a climb takes: against a strong wind it would take all."""


def with_climbs(
    known: Known, route: Route, speeds_mps: FloatArray, whole_s: FloatArray, times_s: FloatArray, motion_w: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times [s], mean and greatest motion powers [W] of a route's legs with climbs, shape (legs,).

    Parameters
    ----------
    known : Known
        With the altitude now.
    route : Route
    speeds_mps : array, shape (legs,)
        Airspeed of each leg [m/s].
    whole_s : array, shape (legs,)
        Time of each leg from its start in level flight [s].
    times_s, motion_w : array, shape (legs,)
        Time left of each leg [s] and motion power [W] in level flight.

    Source: energy of a climb m g Δh / η; ground speed by V cos γ.
    """
    times, added_w, peak_w = times_s.tolist(), [0.0] * len(times_s), [0.0] * len(times_s)
    climb, climb_j_per_m = known.climb, known.motion.climb_j_per_m
    assert climb is not None
    here_m, j_per_m = climb.altitude_m, max(climb.take_off_j_per_m, climb_j_per_m)
    for i, (stage, airspeed_mps) in enumerate(zip(route.of_legs, speeds_mps.tolist(), strict=True)):
        altitude_m = climb.commanded_m(stage)
        up_mps, down_mps = climb_rates_mps(climb.airframe, airspeed_mps)
        rate_mps = up_mps if altitude_m > here_m else -down_mps
        if altitude_m == here_m or rate_mps == 0 or times[i] <= 0:
            continue
        # climb or descend at the greatest rate from the start of the leg; what is not reached in it is left to the next
        climb_s = (altitude_m - here_m) / rate_mps
        # the climb takes V (1 − cos γ) of the ground speed
        slower_mps = airspeed_mps - math.sqrt(max(airspeed_mps**2 - rate_mps**2, 0.0))
        slowed = min(slower_mps * float(whole_s[i]) / max(route.legs[i].distance_m, 1e-9), MAX_SLOWED)
        # t' = t + slowed · t_c, with t_c ≤ t' in this leg
        climbed_s = min(climb_s, times[i] / (1 - slowed))
        times[i] += slowed * climbed_s
        climb_m = rate_mps * climbed_s
        added_w[i] += j_per_m * climb_m / times[i]
        peak_w[i] += max(j_per_m * rate_mps, 0.0)
        here_m = altitude_m if climbed_s == climb_s else here_m + climb_m
        if here_m == altitude_m:  # the take-off is over
            j_per_m = climb_j_per_m
    return np.array(times), np.maximum(motion_w + added_w, 0.0), motion_w + peak_w


AT_HOME_M = 1.0
"""Distance at which the aircraft is at home, where it does not circle [m]."""


class Homeward(NamedTuple):
    """A way home: its time [s], its mean power with the computations [W], and the climb to its altitude [m]."""

    seconds: float
    power_w: float
    climb_m: float = 0.0


def homeward(known: Known, way_home: WayHome, cruise_altitude_m: float, computing_w: float) -> Homeward:
    """The way home from a moment of a flight.

    It is a whole turn, unless home is flown to already, straight lines in level flight, and a climb to the altitude of
    the way; then a landing, with a whole turn onto it and what the descent gives, or a circle. Its time is infinite
    against too strong a wind.

    Parameters
    ----------
    known : Known
    way_home : WayHome
    cruise_altitude_m : float
        Altitude where the plan commands none [m].
    computing_w : float
        Power of the computations [W].
    """
    climb, airspeed_mps = known.climb, known.cursor.stage.airspeed_mps or known.airspeed_mps
    level_w, per_m, landing = known.motion.straight_w(airspeed_mps), known.motion.climb_j_per_m, way_home.landing
    seconds = 0.0
    if math.dist(known.position_m, way_home.end_m) > way_home.circle_radius_m:
        corners = np.array([known.position_m, *way_home.line(known.position_m)])
        seconds = _seconds(np.diff(corners, axis=0), airspeed_mps, known.wind.mps)
    turn_s = 2 * math.pi * HOME_RADII * way_home.turn_radius_m / airspeed_mps
    seconds += turn_s if seconds > 0 and not known.returns_home else 0.0
    seconds += 2 * math.pi * way_home.circle_radius_m / airspeed_mps
    here_m = cruise_altitude_m if climb is None else climb.altitude_m
    tops_m = here_m, way_home.altitude_m, None if landing is None else landing.altitude_m
    top_m = max(each for each in tops_m if each is not None)
    energy_j = level_w * seconds + per_m * (top_m - here_m)
    if landing is not None:
        legs = landing.legs
        lines = np.array([np.subtract(leg.end_m, leg.start_m) for leg in legs if leg.stage.kind == LINE]).reshape(-1, 2)
        circles_m = sum(leg.length_m for leg in legs if leg.stage.kind != LINE)
        down_s = _seconds(lines, airspeed_mps, known.wind.mps) + circles_m / airspeed_mps
        down_s += turn_s
        energy_j += max(level_w * down_s - per_m * (top_m - landing.altitude_m + landing.descent_m), 0.0)
        seconds += down_s
    power_w = energy_j / seconds if 0 < seconds < math.inf else level_w
    return Homeward(seconds, power_w + computing_w, top_m - here_m)


def _seconds(lines_m: FloatArray, airspeed_mps: float, wind_mps: Point) -> float:
    """Time of straight lines, shape (n, 2) [m], in a wind [s]; infinite where one cannot be flown."""
    lengths_m = np.linalg.norm(lines_m, axis=1)
    lines_m, lengths_m = lines_m[lengths_m >= AT_HOME_M], lengths_m[lengths_m >= AT_HOME_M]
    course_x, course_y = (lines_m / lengths_m[:, None]).T
    ground_mps, _ = ground_speeds_mps(course_x, course_y, airspeed_mps, wind_mps)
    return math.inf if (ground_mps <= 0).any() else float((lengths_m / ground_mps).sum())


def after_leg(known: Known, leg: Leg) -> Known:
    """What is known, as at the end of a leg: its place, and the altitude that is commanded there."""
    climb = known.climb
    climb = climb and climb._replace(altitude_m=climb.commanded_m(leg.stage))
    return known._replace(position_m=leg.end_m, climb=climb)
