"""The way home: a turn and a straight line, with the computations of minimum power."""

from __future__ import annotations

import math

import numpy as np

from eadp.core.flight.battery import drain_per_s
from eadp.core.flight.wind import ground_speeds_mps
from eadp.planning.base import HOME_RADII
from eadp.planning.forecast.evaluate import Evaluation
from eadp.planning.forecast.final_charge import LOSS, LOSS_SQUARE, FinalCharge
from eadp.planning.state.charge import after_drain

AT_HOME_M = 1.0
"""Distance at which the aircraft is at home [m]."""


def home_spare(evaluation: Evaluation, place: int) -> float | None:
    """Charge above the reserve after a flight home from here, with the reserve's probability; None without a home.

    The way is a whole turn and a straight line, with the least power of the motion and of the computations.

    Parameters
    ----------
    evaluation : Evaluation
        Of the plan from here on.
    place : int
    """
    evaluator, known = evaluation.evaluator, evaluation.known
    mission, objective, battery = evaluator.mission, evaluator.objective, evaluator.mission.battery
    if mission.way_home is None:
        return None
    (x, y), turn_radius_m, _ = mission.way_home
    dx, dy = x - known.position_m[0], y - known.position_m[1]
    distance, seconds, speed = math.hypot(dx, dy), 0.0, known.airspeed_mps
    if distance >= AT_HOME_M:
        course = np.array([dx / distance]), np.array([dy / distance])
        ground_mps = float(ground_speeds_mps(*course, speed, known.wind.mps)[0][0])
        if ground_mps <= 0:
            return -math.inf
        seconds = distance / ground_mps + 2 * math.pi * HOME_RADII * turn_radius_m / speed
    mine = evaluation.legs.place == place
    power_w = float(evaluation.load.motion_w[mine].min()) + float(evaluation.load.min_w[mine].min())
    volts = battery.voltage_at(min(max(known.soc, 0.0), 1.0))
    drain = float(drain_per_s(power_w, volts, battery.resistance_ohm, battery.drain_per_as)) * seconds
    then = after_drain(known.charge.filtered, drain)
    motion, losses = known.motion, float(evaluator.losses(seconds))
    energy_var = seconds**2 * motion.var_level + motion.noise * seconds
    energy_var += power_w**2 * (seconds**2 * known.time.variance + known.time.noise_s * seconds)
    soc = then[0] - losses * LOSS
    gain = known.charge.gain_std * max(known.charge.gain_from - soc, 0.0)
    per_j = float(evaluation.totals.soc_per_j[place])
    std = math.sqrt(per_j**2 * energy_var + then[3] + gain**2 + losses * LOSS_SQUARE)
    return float(FinalCharge(std, means=(soc,)).level(objective.probability) - objective.reserve_soc)
