"""The way home: a turn, straight lines and what ends it, with the computations of minimum power.

All functions are of an evaluation of one place.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.models.battery import LOSS
from eadp.models.plan.stage import leg_points
from eadp.planning.base import Ending
from eadp.planning.forecast.battery_limits import MIN_STD
from eadp.planning.forecast.clearance import Homeward, after_leg
from eadp.planning.forecast.evaluate import Evaluation
from eadp.planning.forecast.knapsack import Filling
from eadp.planning.state.charge import after_drain

STEP_M = 20.0
"""Accuracy of a place on a route [m]."""


def home_spare(evaluation: Evaluation, flown_s: float = 0.0, flown_j: float = 0.0) -> float | None:
    """Charge above the reserve after a flight home from here, with the reserve's probability; None without a home.

    Parameters
    ----------
    evaluation : Evaluation
        Of the plan from here on.
    flown_s, flown_j : float
        Time [s] and energy [J] that are forecast to the position and charge known, for their deviations.
    """
    way = _way(evaluation)
    if way is None:
        return None
    return _spare(evaluation, way, flown_s, flown_j) if math.isfinite(way.seconds) else -math.inf


def _way(evaluation: Evaluation) -> Homeward | None:
    """The way home from where an evaluation starts; None without a home."""
    return evaluation.evaluator.homeward(evaluation.known, float(evaluation.load.min_w.min()))


def _spare(evaluation: Evaluation, way: Homeward, flown_s: float, flown_j: float) -> float:
    """Charge above the reserve, with the reserve's probability, after a way from here.

    The standard deviation is that of the whole flight: `flown_s` and `flown_j` are time and energy up to here.
    """
    final, objective = _final_charge(evaluation, way, flown_s, flown_j), evaluation.evaluator.objective
    return final.mean - evaluation.evaluator.quantile * final.stdev - objective.reserve_soc


def _final_charge(evaluation: Evaluation, way: Homeward, flown_s: float = 0.0, flown_j: float = 0.0) -> NormalDist:
    """State of charge after a way from here; its deviation is that of the whole flight, see `_spare`."""
    evaluator, known = evaluation.evaluator, evaluation.known
    drain = float(evaluator.mission.battery.drain_at_per_s(way.power_w, known.soc)) * way.seconds
    then = after_drain(known.charge.filtered, drain)
    # of the whole flight, the part up to here included
    whole_j, whole_s = flown_j + way.power_w * way.seconds, flown_s + way.seconds
    totals = evaluation.totals._replace(
        seconds=np.array(whole_s),
        time_var_s2=np.array(known.time.var_s2(whole_s)),
        energy_var_j2=np.array(known.motion.energy_var_j2(whole_s, whole_s, 0.0)),
        charge_var=np.array(then.var_soc),
        mean_w=np.array(whole_j / whole_s if whole_s > 0 else way.power_w),
        soc_per_j=evaluation.totals.soc_per_j[0],
    )
    soc = then.soc - float(evaluator.losses(known, whole_s)) * LOSS
    return NormalDist(soc, max(float(evaluator.charge_std(known, totals, soc)), MIN_STD))


def can_fall(evaluation: Evaluation, seconds: float) -> float:
    """How far the charge to spare for the way home can fall in a time [s]: what power can draw in it.

    The greatest power here, and that of level flight on the way home, which gets longer: against the wind, where the
    wind has carried the aircraft away.
    """
    known, battery = evaluation.known, evaluation.evaluator.mission.battery
    wind_mps = math.hypot(*known.wind.mps)
    away_mps, back_mps = known.airspeed_mps + wind_mps, max(known.airspeed_mps - wind_mps, 1e-3)
    here_w = known.motion.max_w + float(evaluation.load.max_w.max())
    here_per_s, level_per_s = (
        float(battery.drain_at_per_s(power_w, known.soc)) for power_w in (here_w, known.motion.level_w)
    )
    return seconds * (here_per_s + level_per_s * away_mps / back_mps) * known.charge.filtered.use_ratio


def home_ending(evaluation: Evaluation) -> Ending | None:
    """Forecast of the way home from here; None without one."""
    way = _way(evaluation)
    if way is None or not math.isfinite(way.seconds):
        return None
    seconds, energy_j = way.seconds, way.seconds * way.power_w
    known, charge = evaluation.known, _final_charge(evaluation, way)
    time_var = known.time.var_s2(seconds)
    energy_var = known.motion.energy_var_j2(seconds, seconds, 0.0) + way.power_w**2 * time_var
    return Ending(
        remaining_s=seconds,
        remaining_std_s=math.sqrt(time_var),
        energy_wh=energy_j / 3600,
        energy_std_wh=math.sqrt(energy_var) / 3600,
        soc_end=charge.mean,
        soc_end_std=charge.stdev,
        completes_probability=1 - charge.cdf(0.0),
        reserve_probability=1 - charge.cdf(evaluation.evaluator.objective.reserve_soc),
    )


class Reach(NamedTuple):
    """A place on a planned route: time [s], position [m], and the shares of the way and of the energy up to it.

    `home_s` is when home is reached from there [s]; 0 where that is not asked for.
    """

    time_s: float
    position_m: Point
    share: float
    energy_share: float
    home_s: float = 0.0


def latest_turn_back(evaluation: Evaluation, filling: Filling) -> Reach | None:
    """The latest turn back that keeps the reserve with its probability; None without a home, or if there is none.

    `filling` are the computations planned.
    """
    if evaluation.evaluator.mission.way_home is None:
        return None
    found = _last_point(evaluation, filling, lambda there, *flown: home_spare(there, *flown) or 0.0)
    if found is None:
        return None
    at, there = found
    way = _way(there)
    return at._replace(home_s=at.time_s + (0.0 if way is None else way.seconds))


def reach(evaluation: Evaluation, filling: Filling) -> Reach | None:
    """The last place of a planned route at which the reserve is left with its probability; None if there is none.

    `filling` are the computations planned.
    """
    here = Homeward(0.0, 0.0)
    found = _last_point(evaluation, filling, lambda there, *flown: _spare(there, here, *flown))
    return None if found is None else found[0]


def _last_point(
    evaluation: Evaluation, filling: Filling, spare: Callable[[Evaluation, float, float], float]
) -> tuple[Reach, Evaluation] | None:
    """The last point of a route at which `spare` is 0 or more, and the evaluation there; None if it is nowhere.

    It is none after the autopilot has turned back by itself. The last leg that ends at such a point is looked for from
    the end, then the point on the leg after it by halving, as the charge to spare falls along a leg.

    The route is flown as forecast: the charge is drained by the mean power of each leg. `spare` is a function of the
    evaluation with what is known at a point, and of the time [s] and the energy [J] flown to it.
    """
    known, evaluator, legs = evaluation.known, evaluation.evaluator, evaluation.routes[0].legs
    battery, times_s, mean_w = evaluator.mission.battery, evaluation.load.times_s, float(evaluation.totals.mean_w[0])
    powers_w = evaluation.load.motion_w + evaluation.computing_w(filling.shares)
    drains = battery.drain_per_s(powers_w, evaluation.limits.volts) * times_s
    # of each leg: time [s], energy [J], charge predicted and way [m]; and up to its end
    of_legs = np.array([times_s, powers_w * times_s, drains, [leg.distance_m for leg in legs]])
    to_ends = of_legs.cumsum(axis=1)
    _, total_j, _, total_m = to_ends[:, -1].tolist()

    def at(i: int, share: float) -> tuple[Reach, Evaluation]:
        """The point at a share of a leg, and the evaluation there."""
        flown_s, flown_j, drain, flown_m = (to_ends[:, i] - (1 - share) * of_legs[:, i]).tolist()
        # of two points, the last
        x, y = leg_points(legs[i]._replace(flown_m=share * legs[i].distance_m), math.inf)[-1, :2].tolist()
        charge = known.charge._replace(filtered=after_drain(known.charge.filtered, drain))
        there = after_leg(known, legs[i])._replace(position_m=(x, y), charge=charge)
        reached = Reach(known.time_s + flown_s, there.position_m, flown_m / total_m, flown_j / total_j)
        return reached, replace(evaluation, known=there)

    def gives_up(i: int, share: float) -> bool:
        return evaluator.gives_up(at(i, share)[1].known, legs[i].stage, mean_w)

    def is_enough(i: int, share: float) -> bool:
        """Whether the charge at a share of a leg is enough."""
        reached, there = at(i, share)
        flown = reached.time_s - known.time_s, reached.energy_share * total_j
        return there.known.soc > 0 and not gives_up(i, share) and spare(there, *flown) >= 0

    starts = spare(evaluation, 0.0, 0.0) >= 0
    last = (Reach(known.time_s, known.position_m, 0.0, 0.0), evaluation) if starts else None
    if not (total_m > 0 and total_j > 0):  # at the plan's end already
        return last
    of_own = known.autopilot.kind is not None
    count = next((i for i in range(len(legs)) if of_own and gives_up(i, 1.0)), len(legs))
    whole = next((i + 1 for i in reversed(range(count)) if is_enough(i, 1.0)), 0)
    low, high = 0.0, 1.0
    while whole < len(legs) and (high - low) * legs[whole].distance_m > STEP_M:
        middle = (low + high) / 2
        low, high = (middle, high) if is_enough(whole, middle) else (low, middle)
    if low > 0:
        return at(whole, low)
    return at(whole - 1, 1.0) if whole else last
