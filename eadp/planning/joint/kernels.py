"""Terms of the mission program in loops, for compiled code: those of the same names in `terms` and `forecaster`.

Plain Python needs the arrays of `terms`, which take ten times as long to compile. These functions make no arrays but
write to those that they are given: numba compiles them in half the time again. Sums differ by rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.compiled import jitted
from eadp.core.flight.battery import drain_per_s, power_at, voltage_for
from eadp.core.geometry.curves import Point
from eadp.core.geometry.tracks import Nodes
from eadp.models.plan.leg_table import write_leg_times

Cell = tuple[float, float, float, float, float, float, float]
"""Voltage when empty and its rise to full [V], resistance [Ω], k_b/Q_c [1/(A s)], Q_c V crate [W], largest current [A],
cut-off voltage [V]."""

AllIncrements = tuple[IntArray, IntArray, FloatArray, FloatArray, float, float]
Limits = tuple[FloatArray, FloatArray, BoolArray, BoolArray, float, float, float]

DELIVERABLE = 0.98
"""Maximum planned power as a share of the battery's maximum power."""

TIMES, TURNING, MOTION, PEAK, EXPECTED, VOLTS, ROOM, REQUIRED, TAKEN, CHARGE_END = range(10)
"""Rows of an array of shape (10, legs)."""

TRUNCATED, BY_LETTER = range(2)
"""Rows of an array of bool of shape (2, legs)."""

SEGMENT, LEVEL = range(2)
"""Rows of an array of int of shape (2, increments)."""

USE, GAIN, LEFT, REST = range(4)
"""Rows of an array of shape (4, increments)."""


def write_load(
    nodes: Nodes,
    first: IntArray,
    airspeeds_mps: FloatArray,
    order: IntArray,
    airspeed_mps: float,
    wind_mps: Point,
    left: float,
    ratio: float,
    level_w: float,
    slope_w: float,
    ripple_w: float,
    max_w: float,
    known: IntArray,
    legs: FloatArray,
) -> tuple[float, float, float]:
    """Write TIMES, TURNING, MOTION and PEAK; return time, ∫ tan² φ and energy, see `forecaster`."""
    times_s, turning_s, motion_w, peak_w = legs[TIMES], legs[TURNING], legs[MOTION], legs[PEAK]
    write_leg_times(nodes, first, airspeeds_mps, order, airspeed_mps, wind_mps, known, times_s, turning_s)
    total_s = bank_s = energy_j = 0.0
    for i in range(len(order)):
        share, whole_s = left if i == 0 else 1.0, times_s[i]
        times_s[i] = whole_s * ratio * share
        slope = turning_s[i] / whole_s if whole_s > 0.0 else turning_s[i]
        motion_w[i] = max(level_w + slope_w * slope, 0.0)
        peak_w[i] = max(min(motion_w[i] + ripple_w, max_w), motion_w[i])
        total_s += times_s[i]
        bank_s += turning_s[i] * ratio * share
        energy_j += motion_w[i] * times_s[i]
    return max(total_s, 1e-3), bank_s, energy_j


def write_rates(
    free: FloatArray,
    shares: FloatArray,
    order: IntArray,
    times_s: FloatArray,
    past_s: FloatArray,
    past_areas_s: FloatArray,
    weights: FloatArray,
    path: int,
    rates: FloatArray,
) -> float:
    """Write the value of each parameter's share per second, and return that of what is flown, see `terms`."""
    count = len(weights)
    value = total = 0.0
    for j in range(count):
        free_s, area_s = past_s[j], past_areas_s[j]
        for i in range(len(order)):
            free_s += free[order[i], j] * times_s[i]
            if j < path:
                area_s += shares[order[i], j] * times_s[i]
        rates[j] = 0.0
        if free_s > 0.0 and weights[j] > 0.0:
            rates[j] = weights[j] / max(free_s, 1e-9)
            total += weights[j]
        value += rates[j] * area_s
    total = max(total, 1e-12)
    for j in range(count):
        rates[j] /= total
    return value / total


def write_limits(
    group_of: IntArray,
    extremes_w: FloatArray,
    soc: float,
    floor: float,
    cell: Cell,
    legs: FloatArray,
    flags: BoolArray,
) -> tuple[float, float, float]:
    """Write VOLTS, ROOM and the flags; return the excess of power and the charges required, see `terms`."""
    empty_v, rise_v, resistance_ohm, per_as, per_soc_w, max_current_a, cutoff_v = cell
    times_s, motion_w, peak_w = legs[TIMES], legs[MOTION], legs[PEAK]
    volts, room, required, taken, charge_end = legs[VOLTS], legs[ROOM], legs[REQUIRED], legs[TAKEN], legs[CHARGE_END]
    count = len(group_of)
    for i in range(count):
        required[i] = 0.0
        if rise_v > 0.0:
            power_w = peak_w[i] + extremes_w[group_of[i], 0]
            required[i] = (voltage_for(power_w, resistance_ohm, max_current_a, cutoff_v) - empty_v) / rise_v
    if rise_v > 0.0:
        floor = max(floor, min(soc, required[count - 1]))
    for i in range(count):
        volts[i] = empty_v + rise_v * max(floor, 0.0)
    for _ in range(3 if rise_v != 0.0 else 1):
        total = left = 0.0
        for i in range(count):
            power_w = motion_w[i] + extremes_w[group_of[i], 1]
            taken[i] = times_s[i] * drain_per_s(power_w, volts[i], resistance_ohm, per_as)
            total += taken[i]
        share = min(1.0, (soc - floor) / max(total, 1e-12))
        for i in range(count):
            taken[i] *= share
            left += taken[i]
            charge_end[i] = soc - left
            volts[i] = empty_v + rise_v * max(charge_end[i] + taken[i] / 2, 0.0)
    full_w = power_at(empty_v + rise_v * soc, resistance_ohm, max_current_a, cutoff_v)
    beyond, letter_soc, delivered_soc, later = 0.0, -math.inf, -math.inf, 0.0
    for i in range(count - 1, -1, -1):
        base_w, max_w = extremes_w[group_of[i], 0], extremes_w[group_of[i], 1]
        allowed = DELIVERABLE * power_at(volts[i], resistance_ohm, max_current_a, cutoff_v)
        flags[BY_LETTER, i] = False
        if per_soc_w < math.inf:
            by_charge = max(charge_end[i], 0.0) * per_soc_w
            flags[BY_LETTER, i] = by_charge < allowed
            allowed = min(allowed, by_charge)
        room[i] = allowed - peak_w[i]
        flags[TRUNCATED, i] = max_w > room[i]
        beyond = max(beyond, peak_w[i] + base_w - full_w)
        # at the end of each segment at minimum power, as states of charge at the end of the route
        letter_soc = max(letter_soc, (peak_w[i] + base_w) / per_soc_w - later)
        delivered_soc = max(delivered_soc, required[i] - later)
        later += times_s[i] * drain_per_s(motion_w[i] + base_w, volts[i], resistance_ohm, per_as)
    return beyond, letter_soc, delivered_soc


def write_increments(
    kind_of: IntArray,
    ends: IntArray,
    powers_w: FloatArray,
    values: FloatArray,
    cell: Cell,
    scale: float,
    legs: FloatArray,
    places: IntArray,
    amounts: FloatArray,
) -> tuple[int, float, float, float]:
    """Write SEGMENT and LEVEL, USE and GAIN; return the number of increments, and use, value and mean power.

    The latter are with every segment at minimum power, and the power with computations half way [W], see `terms`.
    """
    times_s, expected_s, motion_w, volts = legs[TIMES], legs[EXPECTED], legs[MOTION], legs[VOLTS]
    base_use = base_value = energy_j = total_s = 0.0
    at = first = 0
    for kind in range(len(ends)):
        last = ends[kind] - 1
        for i in range(len(kind_of)):
            if kind_of[i] != kind:
                continue
            before = times_s[i] * drain_per_s(motion_w[i] + powers_w[first], volts[i], cell[2], cell[3])
            base_use += before
            base_value += expected_s[i] * scale * values[first]
            total_s += times_s[i]
            energy_j += times_s[i] * (motion_w[i] + (powers_w[first] + powers_w[last]) / 2)
            for n in range(first, last):
                after = times_s[i] * drain_per_s(motion_w[i] + powers_w[n + 1], volts[i], cell[2], cell[3])
                places[SEGMENT, at], places[LEVEL, at] = i, n - first
                amounts[USE, at], amounts[GAIN, at] = (
                    after - before,
                    expected_s[i] * scale * (values[n + 1] - values[n]),
                )
                before = after
                at += 1
        first = last + 1
    return at, base_use, base_value, energy_j / max(total_s, 1e-9)


def write_terms(
    extremes_w: FloatArray,
    group_of: IntArray,
    soc: float,
    floor: float,
    cell: Cell,
    ends: IntArray,
    powers_w: FloatArray,
    values: FloatArray,
    scale: float,
    legs: FloatArray,
    flags: BoolArray,
    places: IntArray,
    amounts: FloatArray,
) -> tuple[tuple[float, float, float], tuple[int, float, float], bool, float, float]:
    """`write_limits`, `write_increments`, whether limits exclude any configurations, mean power [W] and voltage [V]."""
    limits = write_limits(group_of, extremes_w, soc, floor, cell, legs, flags)
    count, base_use, base_value, mean_w = write_increments(
        group_of, ends, powers_w, values, cell, scale, legs, places, amounts
    )
    truncates, sum_v = False, 0.0
    for i in range(len(group_of)):
        truncates = truncates or flags[TRUNCATED, i]
        sum_v += legs[VOLTS, i]
    return limits, (count, base_use, base_value), truncates, mean_w, sum_v / len(group_of)


WRITES_TERMS = write_limits, write_increments, drain_per_s, power_at, voltage_for
"""What `write_terms` calls, to be compiled with it."""


# --- with arrays of their own, as the functions of the same names


def remaining_load(
    nodes: Nodes,
    first: IntArray,
    airspeeds_mps: FloatArray,
    order: IntArray,
    airspeed_mps: float,
    wind_mps: Point,
    left: float,
    ratio: float,
    level_w: float,
    slope_w: float,
    ripple_w: float,
    max_w: float,
) -> tuple[FloatArray, FloatArray, FloatArray, float, float, float]:
    """See `forecaster`."""
    legs, known = np.empty((PEAK + 1, len(order))), np.empty(len(airspeeds_mps), dtype=np.intp)
    found = jitted(write_load, write_leg_times, makes_arrays=False)(
        *(nodes, first, airspeeds_mps, order, airspeed_mps, wind_mps, left, ratio, level_w, slope_w, ripple_w, max_w),
        *(known, legs),
    )
    return legs[TIMES], legs[MOTION], legs[PEAK], *found


def quality(
    free: FloatArray,
    shares: FloatArray,
    order: IntArray,
    times_s: FloatArray,
    past_s: FloatArray,
    past_areas_s: FloatArray,
    weights: FloatArray,
    path: int,
) -> tuple[FloatArray, float]:
    """See `terms`."""
    rates = np.empty(len(weights))
    compiled = jitted(write_rates, makes_arrays=False)
    return rates, compiled(free, shares, order, times_s, past_s, past_areas_s, weights, path, rates)


def limits_and_increments(
    times_s: FloatArray,
    expected_s: FloatArray,
    motion_w: FloatArray,
    peak_w: FloatArray,
    extremes_w: FloatArray,
    group_of: IntArray,
    soc: float,
    floor: float,
    cell: Cell,
    ends: IntArray,
    powers_w: FloatArray,
    values: FloatArray,
    scale: float,
) -> tuple[Limits, AllIncrements, bool, float, float]:
    """See `terms`."""
    legs, flags, places, amounts = work_arrays(len(times_s), len(powers_w))
    legs[TIMES], legs[EXPECTED], legs[MOTION], legs[PEAK] = times_s, expected_s, motion_w, peak_w
    compiled = jitted(write_terms, *WRITES_TERMS, makes_arrays=False)
    limits, increments, truncates, mean_w, mean_v = compiled(
        *(extremes_w, group_of, soc, floor, cell, ends, powers_w, values, scale, legs, flags, places, amounts)
    )
    found = legs[VOLTS], legs[ROOM], flags[TRUNCATED], flags[BY_LETTER], *limits
    return found, _increments(increments, places, amounts), truncates, mean_w, mean_v


def all_increments(
    kind_of: IntArray,
    ends: IntArray,
    powers_w: FloatArray,
    values: FloatArray,
    times_s: FloatArray,
    expected_s: FloatArray,
    motion_w: FloatArray,
    volts: FloatArray,
    cell: Cell,
    scale: float,
) -> tuple[AllIncrements, float]:
    """See `terms`."""
    legs, _, places, amounts = work_arrays(len(times_s), len(powers_w))
    legs[TIMES], legs[EXPECTED], legs[MOTION], legs[VOLTS] = times_s, expected_s, motion_w, volts
    compiled = jitted(write_increments, drain_per_s, makes_arrays=False)
    *increments, mean_w = compiled(kind_of, ends, powers_w, values, cell, scale, legs, places, amounts)
    return _increments(increments, places, amounts), mean_w


def work_arrays(legs: int, steps: int) -> tuple[FloatArray, BoolArray, IntArray, FloatArray]:
    """Arrays for a number of legs, each of so many increments at most, to write the terms to."""
    places, amounts = np.empty((2, legs * steps), np.intp), np.empty((4, legs * steps))
    return np.empty((CHARGE_END + 1, legs)), np.empty((2, legs), np.bool_), places, amounts


def _increments(found: Sequence[float], places: IntArray, amounts: FloatArray) -> AllIncrements:
    """The increments written, their use and value, from their number and those."""
    count, base_use, base_value = found
    count = int(count)
    return (
        places[SEGMENT, :count],
        places[LEVEL, :count],
        amounts[USE, :count],
        amounts[GAIN, :count],
        base_use,
        base_value,
    )
