"""Speed to fly: the airspeed of each stage in the wind, by the value of a second.

    v(μ) = argmin (P(v, φ) + P_computing + μ)/g(v)

with g the ground speed on the stage and μ ≥ 0 [W]. With μ = 0 the flight takes the least energy for its ground, with a
large one the least time. All stages have one μ, so that no flight is both sooner and with less energy. It is named by
its pace: the airspeed [m/s] that it gives on a straight line in still air.

Source: MacCready 1949 (speed to fly); Lagrange multiplier of the time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.guidance import GRAVITY_MPS2
from eadp.models.plan.route import LegRows, RouteArrays, leg_times_s
from eadp.models.vehicle import Aeroplane
from eadp.planning.state.known import Known, MotionKnown, terms_of

STEP_MPS = 0.5
"""Airspeeds that are commanded differ by so much [m/s]."""

SETTLE_S = 20.0
"""A stage that takes less time has the airspeed of the stage before: the aircraft needs some of it to change its own
[s]."""

ABOVE_WIND_MPS, GUST_STDS = 2.0, 3.0
"""The least airspeed is above the wind by so much [m/s], and by so many standard deviations of its gusts."""

HURRY_W = 1e6
"""A value of a second beside which the energy of a flight is nothing [W]."""


def airspeeds_of(vehicle: Aeroplane, known: Known, rows: LegRows, calibrated: float = 1.0) -> FloatArray:
    """Airspeeds that may be commanded, the greatest first [m/s]: in the vehicle's range, safe in wind and turns.

    The autopilot's limits, which are `calibrated` times true airspeeds, narrow the range. The least is at least the
    vehicle's `slowest_mps` in the tightest turn of the rows, flown with the wind, and above wind and gusts. One above
    the vehicle's own can be flown in that turn. Where none is safe, it is the vehicle's own.
    """
    assert vehicle.airspeed_range_mps is not None
    low, high = vehicle.airspeed_range_mps
    limits_mps = known.autopilot.airspeed_limits_mps(calibrated * vehicle.airspeed_mps)
    low, high = max(low, limits_mps[0] / calibrated), min(high, limits_mps[1] / calibrated)
    wind_mps = math.hypot(*known.wind.mps)
    low = max(low, wind_mps + GUST_STDS * known.wind.gust_std_mps + ABOVE_WIND_MPS)
    bend_per_m, greatest = float(rows.bends_per_m.max(initial=0.0)), math.radians(vehicle.max_bank_deg)
    speeds = np.append(np.arange(high, low, -STEP_MPS), low) if low < high else np.zeros(0)
    # tan φ = g_ground² κ / g
    banks = np.arctan((speeds + wind_mps) ** 2 * bend_per_m / GRAVITY_MPS2)
    turns = (speeds <= vehicle.airspeed_mps) | (banks <= greatest)
    slowest = [vehicle.slowest_mps(bank) for bank in np.minimum(banks, greatest).tolist()]
    chosen: FloatArray = speeds[turns & (speeds >= slowest)]
    return chosen if len(chosen) else np.array([vehicle.airspeed_mps])


def paces_of(speeds_mps: FloatArray, motion: MotionKnown, computing_w: float) -> tuple[list[float], list[float]]:
    """The paces that differ, the fastest first [m/s], and their values of a second [W]: from `HURRY_W` down to 0."""
    paces = speeds_mps.tolist()
    values = [HURRY_W, *(max(value_w(pace, motion, computing_w), 0.0) for pace in paces[1:])]
    count = next((i + 1 for i, value in enumerate(values) if value == 0.0), len(paces))
    return paces[:count], values[:count]


def value_w(pace_mps: float, motion: MotionKnown, computing_w: float) -> float:
    """The value μ of a second with which an airspeed is the best in still air [W]: v P'(v) − P(v) − P_computing."""
    step = STEP_MPS / 10
    slope = (motion.straight_w(pace_mps + step) - motion.straight_w(pace_mps - step)) / (2 * step)
    return pace_mps * slope - motion.straight_w(pace_mps) - computing_w


class SpeedChoice(NamedTuple):
    """Times and energies of the legs of routes at the airspeeds that may be commanded, in the estimated wind.

    Attributes
    ----------
    speeds_mps : array, shape (speeds,)
        The greatest first.
    legs : RouteArrays
    stages : int
        Of the plan.
    row_of : array of int, shape (legs,)
        Which of the rows below each leg has.
    seconds, joules : array, shape (speeds, rows)
        Of each row that is flown.
    paces_mps, values_w : list of float
        The paces that there are, and the value of a second at each, see `paces_of`.
    """

    speeds_mps: FloatArray
    legs: RouteArrays
    stages: int
    row_of: IntArray
    seconds: FloatArray
    joules: FloatArray
    paces_mps: list[float]
    values_w: list[float]

    @classmethod
    def of(
        cls, known: Known, legs: RouteArrays, computing_w: FloatArray, speeds_mps: FloatArray, stages: int
    ) -> SpeedChoice:
        """The choice for the legs of routes, with the power of the computations on each [W], shape (legs,)."""
        rows, first, row_of = np.unique(legs.order, return_index=True, return_inverse=True)
        motion, wind, shape = known.motion, np.array([known.wind.mps]), (len(speeds_mps), len(rows))
        times = leg_times_s(legs.rows, np.tile(rows, shape[0]), np.repeat(speeds_mps, shape[1]), wind)
        times_s, turning_s = (each[0].reshape(shape) for each in times)
        level, flat, turn, own_w = (each[:, None] for each in terms_of(motion.airframe, speeds_mps))
        straight_w = level * motion.level_w + flat * motion.slope_w + own_w + computing_w[first]
        joules = straight_w * times_s + motion.slope_w * turn * turning_s
        fastest_s = times_s[0, row_of]
        paces_mps, values_w = paces_of(speeds_mps, motion, float(fastest_s @ computing_w / fastest_s.sum()))
        return cls(speeds_mps, legs, stages, row_of, times_s, joules, paces_mps, values_w)

    def at_pace(self, pace_mps: float) -> FloatArray:
        """The airspeed of each stage on the routes at the pace that is the nearest to one, as `airspeeds_mps`."""
        return self.airspeeds_mps(self.values_w[int(np.argmin(np.abs(np.array(self.paces_mps) - pace_mps)))])

    def airspeeds_mps(self, value_w: float) -> FloatArray:
        """The airspeed of each stage on the routes, by the value of a second [W], shape (routes, stages) [m/s]."""
        seconds, joules = self.seconds[:, self.row_of], self.joules[:, self.row_of]
        legs, stages, routes = self.legs, self.stages, len(self.legs.first)
        of_stage = legs.place * stages + legs.stages - 1
        whole = [np.bincount(of_stage, e + value_w * t, routes * stages) for e, t in zip(joules, seconds, strict=True)]
        # a short stage, or one that is not flown, has the airspeed of the stage before it, its leader
        counts = np.bincount(of_stage, minlength=routes * stages)
        whole_s = np.bincount(of_stage, seconds[0], routes * stages)
        short = (whole_s < SETTLE_S * np.maximum(counts, 1)).reshape(routes, stages)
        leaders = np.zeros((routes, stages), dtype=np.intp)
        for stage in (*range(stages), *range(stages)):  # twice, as the first stages follow the last ones of a lap
            leaders[:, stage] = np.where(short[:, stage], leaders[:, stage - 1], stage)
        leaders += np.arange(routes)[:, None] * stages
        cost = [np.bincount(leaders.ravel(), of_stages, routes * stages) for of_stages in whole]
        airspeeds: FloatArray = self.speeds_mps[np.argmin(cost, axis=0)[leaders]]
        return airspeeds
