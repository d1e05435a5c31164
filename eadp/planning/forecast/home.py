"""The way home: a turn and a straight line, with the computations of minimum power."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eadp.core.flight.battery import drain_per_s
from eadp.core.flight.wind import ground_speeds_mps
from eadp.core.geometry.curves import Point
from eadp.models.airspace import HOME_RADII, WayHome
from eadp.models.plan.legs import leg_points
from eadp.planning.forecast.evaluate import Evaluation
from eadp.planning.forecast.final_charge import LOSS, FinalCharge
from eadp.planning.forecast.knapsack import Filling
from eadp.planning.state.charge import after_drain
from eadp.planning.state.known import Known

AT_HOME_M = 1.0
"""Distance at which the aircraft is at home [m]."""

MIN_STEP_M, STEPS = 20.0, 500
"""Points of a route at which the way home is forecast: their least distance [m], and about how many at most."""


def home_spare(evaluation: Evaluation, place: int, flown_s: float = 0.0, flown_j: float = 0.0) -> float | None:
    """Charge above the reserve after a flight home from here, with the reserve's probability; None without a home.

    The way is a whole turn and straight lines, with the least power of the motion and of the computations, and the
    energy of a climb to its altitude.

    Parameters
    ----------
    evaluation : Evaluation
        Of the plan from here on.
    place : int
    flown_s, flown_j : float
        Time [s] and energy [J] that are forecast to the position and charge known, for their deviations.
    """
    way_home = evaluation.evaluator.mission.way_home
    if way_home is None:
        return None
    seconds = _seconds_home(way_home, evaluation.known)
    if not math.isfinite(seconds):
        return -math.inf
    # energy of the climb to the altitude of the way home
    known, mission = evaluation.known, evaluation.evaluator.mission
    here_m = mission.vehicle.cruise_altitude_m if known.climb is None else known.climb.altitude_m
    to_m = here_m if way_home.altitude_m is None else way_home.altitude_m
    return _spare(evaluation, place, seconds, flown_s, flown_j, max(to_m - here_m, 0.0) * known.motion.climb_j_per_m)


def _spare(
    evaluation: Evaluation, place: int, seconds: float, flown_s: float, flown_j: float, climb_j: float = 0.0
) -> float:
    """Charge above the reserve, with the reserve's probability, after `seconds` from here at the least power.

    The standard deviation is that of the whole flight: `flown_s` and `flown_j` are time and energy up to here.
    """
    evaluator, known = evaluation.evaluator, evaluation.known
    objective, battery = evaluator.objective, evaluator.mission.battery
    # the charge after it
    mine = evaluation.legs.place == place
    power_w = float(evaluation.load.motion_w[mine].min()) + float(evaluation.load.min_w[mine].min())
    power_w += climb_j / seconds if seconds > 0 else 0.0
    volts = battery.voltage_at(min(max(known.soc, 0.0), 1.0))
    drain = float(drain_per_s(power_w, volts, battery.resistance_ohm, battery.drain_per_as)) * seconds
    then = after_drain(known.charge.filtered, drain)
    # from here on of the whole flight, the part up to here included: time, energy and their variances
    energy_j, seconds = flown_j + power_w * seconds, flown_s + seconds
    mean_w = energy_j / seconds if seconds > 0 else power_w
    motion, losses = known.motion, float(evaluator.losses(known, seconds))
    totals = evaluation.totals._replace(
        seconds=np.array(seconds),
        time_var_s2=np.array(seconds**2 * known.time.variance + known.time.noise_s * seconds),
        energy_var_j2=np.array(seconds**2 * motion.var_level + motion.noise * seconds),  # t² var a + v t
        charge_var=np.array(then.var_soc),
        mean_w=np.array(mean_w),
        soc_per_j=evaluation.totals.soc_per_j[place],
    )
    soc = then.soc - losses * LOSS
    std = float(evaluator.charge_std(known, totals, soc))
    return float(FinalCharge(std, means=(soc,)).level(objective.probability) - objective.reserve_soc)


def _seconds_home(way_home: WayHome, known: Known) -> float:
    """Time of a whole turn and the straight lines home [s]; 0 at home, infinite against too strong a wind."""
    corners = np.array([known.position_m, *way_home.line(known.position_m)])
    lines = np.diff(corners, axis=0)
    lengths_m = np.linalg.norm(lines, axis=1)
    lines, lengths_m = lines[lengths_m >= AT_HOME_M], lengths_m[lengths_m >= AT_HOME_M]
    if not len(lengths_m):
        return 0.0
    speed, (course_x, course_y) = known.airspeed_mps, (lines / lengths_m[:, None]).T
    ground_mps, _ = ground_speeds_mps(course_x, course_y, speed, known.wind.mps)
    if (ground_mps <= 0).any():
        return math.inf
    return float((lengths_m / ground_mps).sum()) + 2 * math.pi * HOME_RADII * way_home.turn_radius_m / speed


class Reach(NamedTuple):
    """A place on a planned route: time [s], position [m], and the shares of the way and of the energy up to it."""

    time_s: float
    position_m: Point
    share: float
    energy_share: float


def latest_turn_back(evaluation: Evaluation, place: int, filling: Filling) -> Reach | None:
    """The latest turn back that keeps the reserve with its probability; None without a home, or if there is none.

    Parameters
    ----------
    evaluation : Evaluation
    place : int
    filling : Filling
        Computations planned.
    """
    if evaluation.evaluator.mission.way_home is None:
        return None
    return _last_point(evaluation, place, filling, lambda there, *flown: home_spare(there, place, *flown) or 0.0)


def reach(evaluation: Evaluation, place: int, filling: Filling) -> Reach | None:
    """The last place of a planned route at which the reserve is left with its probability; None if there is none.

    Parameters
    ----------
    evaluation : Evaluation
    place : int
    filling : Filling
        Computations planned.
    """
    return _last_point(evaluation, place, filling, lambda there, *flown: _spare(there, place, 0.0, *flown))


def _last_point(
    evaluation: Evaluation, place: int, filling: Filling, spare: Callable[[Evaluation, float, float], float]
) -> Reach | None:
    """The last point of a route at which `spare` is 0 or more; None if it is nowhere.

    The route is flown from point to point as forecast: the charge is drained by the mean power of each leg. `spare` is
    a function of the evaluation with what is known at a point, and of the time [s] and the energy [J] flown to it.
    """
    known, battery = evaluation.known, evaluation.evaluator.mission.battery
    last = Reach(known.time_s, known.position_m, 0.0, 0.0) if spare(evaluation, 0.0, 0.0) >= 0 else None
    mine, legs = evaluation.legs.place == place, evaluation.routes[place].legs
    powers_w = (evaluation.load.motion_w + evaluation.computing_w(filling.shares))[mine]
    times_s = evaluation.load.times_s[mine]
    total_m, total_j = sum(leg.distance_m for leg in legs), float(powers_w @ times_s)
    if not (total_m > 0 and total_j > 0):  # at the plan's end already
        return last
    step_m = max(MIN_STEP_M, total_m / STEPS)
    filtered, flown_s, flown_j, flown_m = known.charge.filtered, 0.0, 0.0, 0.0
    for leg, power_w, leg_s in zip(legs, powers_w.tolist(), times_s.tolist(), strict=True):
        points = [*leg_points(leg, step_m)][1:]
        step_s = leg_s / max(len(points), 1)
        for point in points:
            volts = battery.voltage_at(min(max(filtered.soc, 0.0), 1.0))
            drain = float(drain_per_s(power_w, volts, battery.resistance_ohm, battery.drain_per_as)) * step_s
            filtered, flown_s, flown_j = after_drain(filtered, drain), flown_s + step_s, flown_j + power_w * step_s
            flown_m += leg.distance_m / len(points)
            if filtered.soc <= 0:
                return last
            position = point.x_m, point.y_m
            there = known._replace(position_m=position, charge=known.charge._replace(filtered=filtered))
            if spare(replace(evaluation, known=there), flown_s, flown_j) >= 0:
                last = Reach(known.time_s + flown_s, position, flown_m / total_m, flown_j / total_j)
    return last
