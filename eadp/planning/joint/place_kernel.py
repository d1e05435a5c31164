"""A route in one compiled function: what `Forecaster.candidate` and `place_of` find step by step.

It computes the same: legs' times and powers, the terms of the knapsack, its optimum, and the final charge. Where the
battery's power limits something it says so, and the steps are taken.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.compiled import jitted
from eadp.core.flight.battery import drain_per_s
from eadp.core.geometry.tracks import Nodes
from eadp.models.plan.leg_table import LegRows, write_leg_times
from eadp.planning.joint.kernels import (
    EXPECTED,
    GAIN,
    LEFT,
    MOTION,
    REST,
    TIMES,
    USE,
    WRITES_TERMS,
    Cell,
    work_arrays,
    write_load,
    write_rates,
    write_terms,
)
from eadp.planning.joint.knapsack import FULL, ConcaveEnvelope
from eadp.planning.state.charge import Charge, after_drain

FEASIBLE, SHORT, UNFLYABLE, UNKNOWN = range(4)
"""What is found: the charge suffices, or not; the wind is too strong; or the steps have to be taken, as the battery's
power limits something, or the computations' values have other proportions."""

MIN_STD, SAME_SOC, ROUNDING = 1e-6, 1e-5, 1e-9
"""Least standard deviation of a final charge, accuracy of a quantile where there are several ends, and a charge that
counts as rounding."""

PROBABILITY, UNUSED = range(2)
"""Rows of an array of shape (2, ends): probability of each end, and energy not used then [J]."""

NO_ENDS = np.zeros((0, 4))

NOTHING = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0
"""The numbers after the kind of a route of which nothing else is found."""


class Numbers(NamedTuple):
    """What is found of a route, beside its arrays.

    Kind and number of uncertain ends; value, use of charge at minimum power, available charge, and standard deviation
    of the final one; then as of `RouteLoad` and `KnapsackTerms`: variances of time [s²] and energy [J²], ratio of use,
    variance of the charge, scale, soc_per_j, mean_w, letter_soc and delivered_soc; and number of the increments, and
    value without them.
    """

    kind: int
    ends: int
    value: float
    use: float
    available: float
    std: float
    time_variance: float
    energy_variance: float
    use_ratio: float
    charge_variance: float
    scale: float
    soc_per_j: float
    mean_w: float
    letter_soc: float
    delivered_soc: float
    increments: int
    base_value: float


class Found(NamedTuple):
    """What is found of a route: numbers, the envelope of each leg, the envelopes, and the arrays of `work_arrays`."""

    numbers: Numbers
    kind_of: IntArray
    kinds: tuple[ConcaveEnvelope, ...]
    legs: FloatArray
    flags: BoolArray
    places: IntArray
    amounts: FloatArray


class Now(NamedTuple):
    """What all places of a scan have in common.

    Airspeed and wind [m/s]; ratio of measured to forecast times, its variance, and the noise of times [s²/s]; level and
    slope of the motion's power [W], their covariance and the noise of its energy [J²/s], the ripple and the greatest
    power [W]; power of the computations as forecast last [W]; standard deviation of how far the aircraft reaches [m],
    and how far it may have passed an end [m]; state of charge, the reserve, and the voltage of now; drain per ampere
    second [1/(A s)]; standard deviation of the gauge's gain and the charge of its first reading; loss per second, its
    mean and its mean square; probability of the reserve and the normal quantile of it.
    """

    airspeed_mps: float
    wind_x_mps: float
    wind_y_mps: float
    ratio: float
    ratio_variance: float
    noise_s: float
    level_w: float
    slope_w: float
    level_variance: float
    covariance: float
    slope_variance: float
    window_noise: float
    ripple_w: float
    max_w: float
    computing_w: float
    reach_std_m: float
    passed_m: float
    soc: float
    reserve_soc: float
    volts: float
    drain_per_as: float
    gain_std: float
    first_soc: float
    losses_per_s: float
    loss: float
    loss_square: float
    probability: float
    quantile: float


class EnvelopeArrays(NamedTuple):
    """The envelopes of all configurations.

    Least and greatest power of each group [W]; where the envelope of each ends, powers [W] and relative values of all
    one after the other; and the proportions of the computations' values for which they hold.
    """

    extremes_w: FloatArray
    ends: IntArray
    powers_w: FloatArray
    values: FloatArray
    proportions: FloatArray


class Envelopes(NamedTuple):
    """Envelopes of groups of configurations, the same in arrays, and the most steps of one."""

    kinds: tuple[ConcaveEnvelope, ...]
    arrays: EnvelopeArrays
    steps: int


def find_place(
    rows: LegRows,
    order: IntArray,
    group_of: IntArray,
    envelopes: Envelopes,
    past: tuple[FloatArray, FloatArray],
    weights: FloatArray,
    path: int,
    uncertain: FloatArray,
    now: Now,
    cell: Cell,
    charge: Charge,
    left: float,
    wind_variance: float,
) -> Found:
    """What a route is.

    Parameters
    ----------
    rows : LegRows
    order, group_of : array of int, shape (legs,)
        Row of each leg, and its group of configurations.
    envelopes : Envelopes
    past : two arrays, shape (parameters,)
        As `FlownShares`.
    weights : array, shape (parameters,)
        Weights of the objective.
    path : int
        Number of path parameters.
    uncertain : array, shape (ends, 4)
        Leg, distance flown to the end, clearance, and length of the leg [m] of each uncertain end.
    now : Now
    cell : Cell
    charge : Charge
        The state of charge, its use and slope of use.
    left : float
        Remaining share of the first leg.
    wind_variance : float
        Variance of the logarithm of the time due to the wind.
    """
    compiled = jitted(_find_place, *CALLED, makes_arrays=False)
    work = work_arrays(len(order), envelopes.steps)
    known = np.empty(len(rows.stages), np.intp), np.empty(len(weights)), np.empty((2, len(uncertain) + 1))
    (nodes, first, airspeeds_mps, _, _, free, shares), arrays = rows, envelopes.arrays
    numbers = compiled(
        *(nodes, first, airspeeds_mps, free, shares, order, group_of, arrays, *past, weights, path, uncertain),
        *(now, cell, charge, left, wind_variance, *work, *known),
    )
    return Found(Numbers(*numbers), group_of, envelopes.kinds, *work)


def _find_place(
    nodes: Nodes,
    first: IntArray,
    airspeeds_mps: FloatArray,
    free: FloatArray,
    shares: FloatArray,
    order: IntArray,
    group_of: IntArray,
    envelopes: EnvelopeArrays,
    past_s: FloatArray,
    past_areas_s: FloatArray,
    weights: FloatArray,
    path: int,
    uncertain: FloatArray,
    now: Now,
    cell: Cell,
    charge: Charge,
    left: float,
    wind_variance: float,
    legs: FloatArray,
    flags: BoolArray,
    places: IntArray,
    amounts: FloatArray,
    known: IntArray,
    rates: FloatArray,
    ends: FloatArray,
) -> tuple[
    int, int, float, float, float, float, float, float, float, float, float, float, float, float, float, int, float
]:
    wind_mps, ripple_w = (now.wind_x_mps, now.wind_y_mps), now.ripple_w
    airspeed_mps, level_w, slope_w, max_w = now.airspeed_mps, now.level_w, now.slope_w, now.max_w
    total_s, bank_s, energy_j = write_load(
        *(nodes, first, airspeeds_mps, order, airspeed_mps, wind_mps, left, now.ratio, level_w, slope_w, ripple_w),
        *(max_w, known, legs),
    )
    if not total_s < math.inf:
        return UNFLYABLE, *NOTHING
    time_variance = total_s * total_s * (now.ratio_variance + wind_variance) + now.noise_s * total_s
    squares = total_s * total_s * now.level_variance + 2 * total_s * bank_s * now.covariance
    energy_variance = squares + bank_s * bank_s * now.slope_variance + now.window_noise * total_s
    drain = drain_per_s(energy_j / total_s + now.computing_w, now.volts, cell[2], now.drain_per_as) * total_s
    then = after_drain(charge, drain)
    use_ratio = (charge[0] - then[0]) / max(drain, MIN_STD)
    per_as = now.drain_per_as * use_ratio

    # uncertain ends: their probabilities, and what of the motion's energy and of each leg's time is not spent then
    times_s, motion_w, expected_s = legs[TIMES], legs[MOTION], legs[EXPECTED]
    for i in range(len(order)):
        expected_s[i] = times_s[i]
    count, before = 1, 0.0
    ends[UNUSED, 0] = 0.0
    for end in range(len(uncertain)):
        leg, length_m = int(uncertain[end, 0]), uncertain[end, 3]
        ahead_m = length_m * (left if leg == 0 else 1.0)
        unflown_m = length_m - uncertain[end, 1]
        if ahead_m - unflown_m < -now.passed_m:
            continue
        reached = 0.5 * (1.0 + math.erf(uncertain[end, 2] / (now.reach_std_m * math.sqrt(2.0))))
        ends[PROBABILITY, count], ends[UNUSED, count] = reached - before, 0.0
        for i in range(leg, len(order)):
            unflown = min(1.0, unflown_m / max(ahead_m, MIN_STD)) if i == leg else 1.0
            expected_s[i] -= (reached - before) * unflown * times_s[i]
            ends[UNUSED, count] += unflown * times_s[i] * (motion_w[i] + envelopes.extremes_w[group_of[i], 0])
        count, before = count + 1, reached
    ends[PROBABILITY, 0] = 1.0 - before

    value = write_rates(free, shares, order, expected_s, past_s, past_areas_s, weights, path, rates)
    scale = 0.0
    for k in range(path, len(rates)):
        scale = max(scale, rates[k])
    for k in range(path, len(rates)):
        proportion = rates[k] / scale if scale > 0.0 else rates[k]
        if round(proportion, 4) != envelopes.proportions[k - path]:
            return UNKNOWN, *NOTHING
    limits, (size, use, own_value), truncates, mean_w, mean_v = write_terms(
        envelopes.extremes_w,
        group_of,
        now.soc,
        min(now.reserve_soc, now.soc),
        (cell[0], cell[1], cell[2], per_as, cell[4], cell[5], cell[6]),
        envelopes.ends,
        envelopes.powers_w,
        envelopes.values,
        scale,
        legs,
        flags,
        places,
        amounts,
    )
    beyond, letter_soc, delivered_soc = limits
    limited = letter_soc > now.reserve_soc or delivered_soc > ROUNDING
    if truncates or beyond > 0.0 or (ripple_w == math.inf and limited):
        return UNKNOWN, *NOTHING
    min_v = 0.1 * mean_v
    soc_per_j = per_as / math.sqrt(max(mean_v * mean_v - 4 * cell[2] * mean_w, min_v * min_v))

    # the final state of charge
    end_soc = now.soc - now.losses_per_s * total_s * now.loss
    gain_std = now.gain_std * max(now.first_soc - end_soc, 0.0)
    variance = soc_per_j * soc_per_j * (energy_variance + mean_w * mean_w * time_variance)
    variance += then[3] + gain_std * gain_std + now.losses_per_s * total_s * now.loss_square
    std = math.sqrt(variance)
    available = level(end_soc, soc_per_j, ends[:, :count], std, now.probability, now.quantile)
    available -= max(now.reserve_soc, max(letter_soc, delivered_soc))

    base_value, spare, kind = value + own_value, available - use, SHORT
    value = base_value
    if spare >= -FULL:
        kind, value = FEASIBLE, base_value + optimal_gain(amounts, size, max(spare, 0.0))
    return (
        kind,
        count - 1,
        value,
        use,
        available,
        std,
        time_variance,
        energy_variance,
        use_ratio,
        then[3],
        scale,
        soc_per_j,
        mean_w,
        letter_soc,
        delivered_soc,
        size,
        base_value,
    )


def level(soc: float, soc_per_j: float, ends: FloatArray, std: float, probability: float, quantile: float) -> float:
    """State of charge above which the final one is with a probability, as `FinalCharge.level`."""
    low, high = math.inf, -math.inf
    for n in range(ends.shape[1]):
        mean = soc + soc_per_j * ends[UNUSED, n]
        low, high = min(low, mean), max(high, mean)
    low, high = low - quantile * std, high - quantile * std
    while high - low > SAME_SOC:
        middle = (low + high) / 2
        if probability_above(middle, soc, soc_per_j, ends, std) > probability:
            low = middle
        else:
            high = middle
    return low


def probability_above(level_soc: float, soc: float, soc_per_j: float, ends: FloatArray, std: float) -> float:
    """Probability of a final state of charge above a level, as `FinalCharge.probability_above`."""
    above, scale = 0.0, max(std, MIN_STD) * math.sqrt(2.0)
    for n in range(ends.shape[1]):
        above += ends[PROBABILITY, n] * math.erfc((level_soc - soc - soc_per_j * ends[UNUSED, n]) / scale)
    return above / 2


def optimal_gain(amounts: FloatArray, count: int, spare: float) -> float:
    """Gain of the optimal filling of the fractional knapsack, without sorting it.

    The increments are parted by the gain per charge of one of them, again and again, until the critical one is found.

    Source: Balas and Zemel 1980.
    """
    left, rest, total = amounts[LEFT], amounts[REST], 0.0
    for i in range(count):
        left[i], rest[i] = amounts[USE, i], amounts[GAIN, i]
    while count > 0:
        middle = count // 2
        pivot = rest[middle] / left[middle] if left[middle] > 0.0 else math.inf
        better_use = better_gain = alike_use = alike_gain = 0.0
        for i in range(count):
            efficiency = rest[i] / left[i] if left[i] > 0.0 else math.inf
            if efficiency > pivot:
                better_use, better_gain = better_use + left[i], better_gain + rest[i]
            elif efficiency == pivot:
                alike_use, alike_gain = alike_use + left[i], alike_gain + rest[i]
        whole = better_use <= spare + FULL
        if whole:
            total, spare = total + better_gain, spare - better_use
            if alike_use > spare + FULL:
                return total + pivot * max(spare, 0.0)
            total, spare = total + alike_gain, spare - alike_use
        # go on with those that are worse, or with those that are better
        kept = 0
        for i in range(count):
            efficiency = rest[i] / left[i] if left[i] > 0.0 else math.inf
            if (efficiency < pivot) if whole else (efficiency > pivot):
                left[kept], rest[kept] = left[i], rest[i]
                kept += 1
        count = kept
    return total


CALLED = (
    *(write_load, write_leg_times, write_rates, write_terms, *WRITES_TERMS),
    *(after_drain, optimal_gain, level, probability_above),
)
"""What `_find_place` calls, to be compiled with it."""
