"""What climbs, descents and airspeeds of stages add to time and motion power of the legs of a route."""

from __future__ import annotations

import math

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.models.plan.route import Route
from eadp.planning.state.climb import Climb

MAX_SLOWED = 0.9
"""Greatest share of the ground speed that a climb takes: against a strong wind it would take all."""


def with_climbs(
    climb: Climb, route: Route, whole_s: FloatArray, times_s: FloatArray, motion_w: FloatArray, climb_j_per_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times [s], mean and greatest motion powers [W] of a route's legs with climbs and airspeeds, shape (legs,).

    Parameters
    ----------
    climb : Climb
        Where the aircraft is now.
    route : Route
    whole_s : array, shape (legs,)
        Time of each leg from its start in level flight [s].
    times_s, motion_w : array, shape (legs,)
        Time left of each leg [s] and motion power [W] in level flight at the airframe's airspeed.
    climb_j_per_m : float
        Energy of a metre of climb [J/m].

    Source: energy of a climb m g Δh / η; ground speed by V cos γ.
    """
    times, added_w, peak_w = times_s.tolist(), [0.0] * len(times_s), [0.0] * len(times_s)
    # of each airspeed: its power above the airframe's own [W], and its greatest rates of climb and descent [m/s]
    rates: dict[float, tuple[float, float, float]] = {}
    here_m, j_per_m = climb.altitude_m, max(climb.take_off_j_per_m, climb_j_per_m)
    for i, stage in enumerate(route.of_legs):
        altitude_m, airspeed_mps = climb.commanded(stage)
        if airspeed_mps not in rates:
            rates[airspeed_mps] = climb.faster_w(airspeed_mps), *climb.rates_mps(airspeed_mps)
        faster_w, up_mps, down_mps = rates[airspeed_mps]
        added_w[i] = peak_w[i] = faster_w
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
