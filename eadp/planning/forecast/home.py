"""The way home: a turn, straight lines and what ends it, with the computations of minimum power."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eadp.core.flight import drain_per_s
from eadp.core.geometry.curves import Point
from eadp.models.battery import LOSS
from eadp.models.plan.stage import leg_points
from eadp.planning.base import Ending
from eadp.planning.forecast.battery_limits import FinalCharge
from eadp.planning.forecast.clearance import Homeward, after_leg
from eadp.planning.forecast.evaluate import Evaluation
from eadp.planning.forecast.knapsack import Filling
from eadp.planning.state.charge import after_drain
from eadp.planning.state.known import Known

MIN_STEP_M, STEPS, IN_FLIGHT = 20.0, 500, 60
"""Points of a route at which the way home is forecast: their least distance [m], and about how many at most, before
take-off and in flight."""


def home_spare(evaluation: Evaluation, place: int, flown_s: float = 0.0, flown_j: float = 0.0) -> float | None:
    """Charge above the reserve after a flight home from here, with the reserve's probability; None without a home.

    Parameters
    ----------
    evaluation : Evaluation
        Of the plan from here on.
    place : int
    flown_s, flown_j : float
        Time [s] and energy [J] that are forecast to the position and charge known, for their deviations.
    """
    way = _way(evaluation, place)
    if way is None:
        return None
    return _spare(evaluation, place, way, flown_s, flown_j) if math.isfinite(way.seconds) else -math.inf


def _way(evaluation: Evaluation, place: int) -> Homeward | None:
    """The way home from where an evaluation starts; None without a home."""
    min_w = float(evaluation.load.min_w[evaluation.legs.place == place].min())
    return evaluation.evaluator.homeward(evaluation.known, min_w)


def _spare(evaluation: Evaluation, place: int, way: Homeward, flown_s: float, flown_j: float) -> float:
    """Charge above the reserve, with the reserve's probability, after a way from here.

    The standard deviation is that of the whole flight: `flown_s` and `flown_j` are time and energy up to here.
    """
    final = _final_charge(evaluation, place, way, flown_s, flown_j)
    objective = evaluation.evaluator.objective
    return float(final.level(objective.probability) - objective.reserve_soc)


def _final_charge(
    evaluation: Evaluation, place: int, way: Homeward, flown_s: float = 0.0, flown_j: float = 0.0
) -> FinalCharge:
    """State of charge after a way from here, see `_spare`."""
    evaluator, known, (seconds, power_w, _) = evaluation.evaluator, evaluation.known, way
    battery = evaluator.mission.battery
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
    return FinalCharge(float(evaluator.charge_std(known, totals, soc)), means=(soc,))


def can_fall(evaluation: Evaluation, place: int, seconds: float) -> float:
    """How far the charge to spare for the way home can fall in a time [s]: what power can draw in it.

    The greatest power here, and that of level flight on the way home, which gets longer: against the wind, where the
    wind has carried the aircraft away.
    """
    known, battery = evaluation.known, evaluation.evaluator.mission.battery
    wind_mps = math.hypot(*known.wind.mps)
    away_mps, back_mps = known.airspeed_mps + wind_mps, max(known.airspeed_mps - wind_mps, 1e-3)
    volts = battery.voltage_at(min(max(known.soc, 0.0), 1.0))
    here_w = known.motion.max_w + float(evaluation.load.max_w[evaluation.legs.place == place].max())
    drawn = sum(
        seconds * share * float(drain_per_s(power_w, volts, battery.resistance_ohm, battery.drain_per_as))
        for power_w, share in ((here_w, 1.0), (known.motion.level_w, away_mps / back_mps))
    )
    return float(drawn * known.charge.filtered.use_ratio)


def home_ending(evaluation: Evaluation, place: int) -> Ending | None:
    """Forecast of the way home from here; None without one."""
    way = _way(evaluation, place)
    if way is None or not math.isfinite(way.seconds):
        return None
    seconds, energy_j = way.seconds, way.seconds * way.power_w
    known, charge = evaluation.known, _final_charge(evaluation, place, way)
    time_var = seconds**2 * known.time.variance + known.time.noise_s * seconds
    energy_var = seconds**2 * known.motion.var_level + known.motion.noise * seconds + way.power_w**2 * time_var
    return Ending(
        remaining_s=seconds,
        remaining_std_s=math.sqrt(time_var),
        energy_wh=energy_j / 3600,
        energy_std_wh=math.sqrt(energy_var) / 3600,
        soc_end=charge.mean,
        soc_end_std=math.sqrt(charge.variance),
        completes_probability=charge.probability_above(0.0),
        reserve_probability=charge.probability_above(evaluation.evaluator.objective.reserve_soc),
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


def latest_turn_back(evaluation: Evaluation, place: int, filling: Filling, points: int = STEPS) -> Reach | None:
    """The latest turn back that keeps the reserve with its probability; None without a home, or if there is none.

    Parameters
    ----------
    evaluation : Evaluation
    place : int
    filling : Filling
        Computations planned.
    points : int
        How many points of the route to try, about.
    """
    if evaluation.evaluator.mission.way_home is None:
        return None

    def spare(there: Evaluation, *flown: float) -> float:
        return home_spare(there, place, *flown) or 0.0

    found = _last_point(evaluation, place, filling, spare, points)
    if found is None:
        return None
    at, known = found
    way = _way(replace(evaluation, known=known), place)
    return at._replace(home_s=at.time_s + (0.0 if way is None else way.seconds))


def reach(evaluation: Evaluation, place: int, filling: Filling) -> Reach | None:
    """The last place of a planned route at which the reserve is left with its probability; None if there is none.

    Parameters
    ----------
    evaluation : Evaluation
    place : int
    filling : Filling
        Computations planned.
    """
    here = Homeward(0.0, 0.0)
    found = _last_point(evaluation, place, filling, lambda there, *flown: _spare(there, place, here, *flown), STEPS)
    return None if found is None else found[0]


def _last_point(
    evaluation: Evaluation,
    place: int,
    filling: Filling,
    spare: Callable[[Evaluation, float, float], float],
    points: int,
) -> tuple[Reach, Known] | None:
    """The last point of a route at which `spare` is 0 or more, and what is known there; None if it is nowhere.

    It is none after the autopilot has turned back by itself.

    The route is flown from point to point as forecast: the charge is drained by the mean power of each leg. `spare` is
    a function of the evaluation with what is known at a point, and of the time [s] and the energy [J] flown to it.
    """
    known, battery = evaluation.known, evaluation.evaluator.mission.battery
    last = (Reach(known.time_s, known.position_m, 0.0, 0.0), known) if spare(evaluation, 0.0, 0.0) >= 0 else None
    mine, legs = evaluation.legs.place == place, evaluation.routes[place].legs
    powers_w = (evaluation.load.motion_w + evaluation.computing_w(filling.shares))[mine]
    times_s = evaluation.load.times_s[mine]
    mean_w = float(evaluation.totals.mean_w[place])
    total_m, total_j = sum(leg.distance_m for leg in legs), float(powers_w @ times_s)
    if not (total_m > 0 and total_j > 0):  # at the plan's end already
        return last
    step_m = max(MIN_STEP_M, total_m / points)
    filtered, flown_s, flown_j, flown_m = known.charge.filtered, 0.0, 0.0, 0.0
    for leg, power_w, leg_s in zip(legs, powers_w.tolist(), times_s.tolist(), strict=True):
        ahead = leg_points(leg, step_m)[1:, :2].tolist()
        step_s = leg_s / max(len(ahead), 1)
        for x, y in ahead:
            volts = battery.voltage_at(min(max(filtered.soc, 0.0), 1.0))
            drain = float(drain_per_s(power_w, volts, battery.resistance_ohm, battery.drain_per_as)) * step_s
            filtered, flown_s, flown_j = after_drain(filtered, drain), flown_s + step_s, flown_j + power_w * step_s
            flown_m += leg.distance_m / len(ahead)
            if filtered.soc <= 0:
                return last
            position = x, y
            there = after_leg(known, leg)._replace(position_m=position, charge=known.charge._replace(filtered=filtered))
            if evaluation.evaluator.gives_up(there, leg.stage, mean_w):
                return last
            if spare(replace(evaluation, known=there), flown_s, flown_j) >= 0:
                last = Reach(known.time_s + flown_s, position, flown_m / total_m, flown_j / total_j), there
    return last
