"""Terms of the mission program in loops, for compiled code: those of the same names in `terms` and `forecaster`.

They compile in a tenth of the time that the arrays of `terms` take, which plain Python needs. Sums differ by rounding.
"""

from __future__ import annotations

import math

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.flight.battery import drain_per_s, power_at, voltage_for
from eadp.core.geometry.curves import Point
from eadp.core.geometry.tracks import Nodes
from eadp.models.plan.leg_table import leg_times_s

Cell = tuple[float, float, float, float, float, float, float]
"""Voltage when empty and its rise to full [V], resistance [Ω], k_b/Q_c [1/(A s)], Q_c V crate [W], largest current [A],
cut-off voltage [V]."""

AllIncrements = tuple[IntArray, IntArray, FloatArray, FloatArray, float, float]
Limits = tuple[FloatArray, FloatArray, BoolArray, BoolArray, float, float, float]

DELIVERABLE = 0.98
"""Maximum planned power as a share of the battery's maximum power."""


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
    whole_s, turning_s = leg_times_s(nodes, first, airspeeds_mps, order, airspeed_mps, wind_mps)
    count = len(whole_s)
    times_s, motion_w, peak_w = np.zeros(count), np.zeros(count), np.zeros(count)
    total_s = bank_s = energy_j = 0.0
    for i in range(count):
        share = left if i == 0 else 1.0
        times_s[i] = whole_s[i] * ratio * share
        slope = turning_s[i] / whole_s[i] if whole_s[i] > 0.0 else turning_s[i]
        motion_w[i] = max(level_w + slope_w * slope, 0.0)
        peak_w[i] = max(min(motion_w[i] + ripple_w, max_w), motion_w[i])
        total_s += times_s[i]
        bank_s += turning_s[i] * ratio * share
        energy_j += motion_w[i] * times_s[i]
    return times_s, motion_w, peak_w, max(total_s, 1e-3), bank_s, energy_j


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
    count = len(weights)
    rates, areas_s, total = np.zeros(count), past_areas_s.copy(), 0.0
    for j in range(count):
        free_s = past_s[j]
        for i, row in enumerate(order):
            free_s += free[row, j] * times_s[i]
            if j < path:
                areas_s[j] += shares[row, j] * times_s[i]
        if free_s > 0.0 and weights[j] > 0.0:
            rates[j] = weights[j] / max(free_s, 1e-9)
            total += weights[j]
    value = 0.0
    for j in range(count):
        rates[j] /= max(total, 1e-12)
        value += rates[j] * areas_s[j]
    return rates, value


def power_limits(
    times_s: FloatArray,
    motion_w: FloatArray,
    peak_w: FloatArray,
    extremes_w: FloatArray,
    group_of: IntArray,
    soc: float,
    floor: float,
    cell: Cell,
) -> Limits:
    """See `terms`."""
    empty_v, rise_v, resistance_ohm, per_as, per_soc_w, max_current_a, cutoff_v = cell
    count = len(times_s)
    required, taken, charge_end = np.zeros(count), np.zeros(count), np.zeros(count)
    if rise_v > 0.0:
        for i in range(count):
            power_w = peak_w[i] + extremes_w[group_of[i], 0]
            required[i] = (voltage_for(power_w, resistance_ohm, max_current_a, cutoff_v) - empty_v) / rise_v
        floor = max(floor, min(soc, required[count - 1]))
    volts = np.full(count, empty_v + rise_v * max(floor, 0.0))
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
    room, truncated, by_letter = np.zeros(count), np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    full_w = power_at(empty_v + rise_v * soc, resistance_ohm, max_current_a, cutoff_v)
    beyond, letter_soc, delivered_soc, later = 0.0, -math.inf, -math.inf, 0.0
    for i in range(count - 1, -1, -1):
        base_w, max_w = extremes_w[group_of[i], 0], extremes_w[group_of[i], 1]
        allowed = DELIVERABLE * power_at(volts[i], resistance_ohm, max_current_a, cutoff_v)
        if per_soc_w < math.inf:
            by_charge = max(charge_end[i], 0.0) * per_soc_w
            by_letter[i] = by_charge < allowed
            allowed = min(allowed, by_charge)
        room[i] = allowed - peak_w[i]
        truncated[i] = max_w > room[i]
        beyond = max(beyond, peak_w[i] + base_w - full_w)
        # at the end of each segment at minimum power, as states of charge at the end of the route
        letter_soc = max(letter_soc, (peak_w[i] + base_w) / per_soc_w - later)
        delivered_soc = max(delivered_soc, required[i] - later)
        later += times_s[i] * drain_per_s(motion_w[i] + base_w, volts[i], resistance_ohm, per_as)
    return volts, room, truncated, by_letter, beyond, letter_soc, delivered_soc


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
    limits = power_limits(times_s, motion_w, peak_w, extremes_w, group_of, soc, floor, cell)
    volts, truncates, sum_v = limits[0], False, 0.0
    for i in range(len(volts)):
        truncates |= limits[2][i]
        sum_v += volts[i]
    increments, mean_w = all_increments(
        group_of, ends, powers_w, values, times_s, expected_s, motion_w, volts, cell, scale
    )
    return limits, increments, truncates, mean_w, sum_v / len(volts)


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
    size = 0
    for kind in kind_of:
        size += ends[kind] - (ends[kind - 1] if kind else 0) - 1
    segment, level = np.zeros(size, np.intp), np.zeros(size, np.intp)
    use, gain = np.zeros(size), np.zeros(size)
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
                segment[at], level[at] = i, n - first
                use[at], gain[at] = after - before, expected_s[i] * scale * (values[n + 1] - values[n])
                before = after
                at += 1
        first = last + 1
    return (segment, level, use, gain, base_use, base_value), energy_j / max(total_s, 1e-9)
