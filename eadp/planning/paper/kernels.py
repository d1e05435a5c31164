"""`Horizon` in loops, for compiled code: what its methods do with arrays, for which plain Python is too slow in loops.

Arrays of shape (M, J) are those of a table: value, use of charge and limit of every choice at every step. `low`, `high`
and `step` are those of a mixture's variables, in ascending order of the step. Both forms make the same choices; sums
differ by their rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from eadp.core import compiled
from eadp.core.arrays import BoolArray, FloatArray, IntArray

FEASIBLE_W = 1e-6
"""Excess of power that counts as rounding [W]."""

FLOOR_SLACK = 1e-4
"""Tolerance, as a share of the span of power, within which a relaxed power counts as its next level above."""

MIN_REACH = 1e-5
"""Smallest scaling of a variable."""

UNDELIVERABLE = 1e6
"""Charge that a power takes which the battery cannot deliver: more than there is."""

NO_LIMIT, BATTERYS, LETTERS = 0, 1, 2
"""Limits of power that exclude a choice: none, one of the battery, the letter's."""


class Kernels(NamedTuple):
    """Those that are called."""

    stepped: Callable[..., Any]
    tabled: Callable[..., Any]
    proven: Callable[..., Any]
    scaled: Callable[..., Any]
    unscaled: Callable[..., Any]
    levels_of: Callable[..., Any]


def kernels() -> Kernels | None:
    """Them, compiled; None where compiled code is off."""
    if not compiled.enabled():
        return None
    return Kernels(
        compiled.jitted(stepped),
        compiled.jitted(tabled),
        compiled.jitted(proven, bound_of),
        compiled.jitted(scaled),
        compiled.jitted(unscaled),
        compiled.jitted(levels_of, bound_of, rounded, best_of, violated_by, raised, in_order),
    )


def stepped(rows: FloatArray, state: FloatArray, steps: int, worst: bool) -> tuple[FloatArray, FloatArray]:
    """Motion power that limits each step, its largest or that at its end, and its mean, 0 or more [W].

    `rows`, of shape (M n, m), read the power at n instants of each step off the state, of shape (m,).
    """
    limit, mean, each = np.full(steps, -math.inf), np.zeros(steps), len(rows) // steps
    for m in range(steps):
        for k in range(m * each, m * each + each):
            motion_w = 0.0
            for i in range(len(state)):
                motion_w += rows[k, i] * state[i]
            mean[m] += motion_w
            if not worst or not motion_w <= limit[m]:
                limit[m] = motion_w
        mean[m] = max(mean[m] / each, 0.0)
    return limit, mean


def tabled(
    limit_motion_w: FloatArray,
    mean_motion_w: FloatArray,
    powers_w: FloatArray,
    soc: float,
    step_s: float,
    voltage_v: float,
    resistance_ohm: float,
    per_as: float,
    delivered_w: float,
    power_per_soc_w: float,
) -> tuple[FloatArray, FloatArray, bool, FloatArray, float]:
    """Use of charge, limit, whether all powers are delivered, and the charge that the lowest leaves; its least."""
    steps, count = len(mean_motion_w), len(powers_w)
    drop, limit, spare = np.empty((steps, count)), np.empty((steps, count)), np.empty(steps)
    deliverable, total, left, least = True, soc, soc, math.inf
    for m in range(steps):
        for j in range(count):
            power_w = mean_motion_w[m] + powers_w[j]
            root = math.sqrt(max(voltage_v * voltage_v - 4 * resistance_ohm * power_w, 0.0))
            drop[m, j] = per_as * 2 * power_w / (voltage_v + root) * step_s
            if power_w > delivered_w:
                deliverable, drop[m, j] = False, UNDELIVERABLE
            limit[m, j] = (limit_motion_w[m] + (powers_w[j] - FEASIBLE_W)) / power_per_soc_w
            total += drop[m, j] + limit[m, j]
        left -= drop[m, 0]
        spare[m] = left - limit[m, 0]
        least = min(least, spare[m])
    return drop, limit, deliverable, spare, least if math.isfinite(total) else math.nan


def bound_of(multipliers: FloatArray, value: FloatArray, drop: FloatArray, limit: FloatArray, soc: float) -> float:
    """The Lagrangian bound of `horizon`."""
    best, later = np.full(len(multipliers), -math.inf), 0.0
    for m in range(len(multipliers) - 1, -1, -1):
        later += multipliers[m]
        for j in range(value.shape[1]):
            best[m] = max(best[m], value[m, j] - multipliers[m] * limit[m, j] - later * drop[m, j])
    bound = 0.0
    for m in range(len(best)):  # in the order of the objective's sum
        bound += best[m]
    return bound + later * soc


def proven(
    z: FloatArray,
    multipliers: FloatArray,
    step: IntArray,
    low: IntArray,
    high: IntArray,
    value: FloatArray,
    drop: FloatArray,
    limit: FloatArray,
    spare: FloatArray,
    soc: float,
) -> tuple[bool, float, float]:
    """Whether mixtures keep to the constraints, their value, and the bound of their multipliers."""
    taken, total, v = 0.0, 0.0, 0
    for m in range(len(spare)):
        required = 0.0
        total += value[m, 0]
        while v < len(z) and step[v] == m:
            taken += z[v] * (drop[m, high[v]] - drop[m, low[v]])
            required += z[v] * (limit[m, high[v]] - limit[m, low[v]])
            total += z[v] * (value[m, high[v]] - value[m, low[v]])
            v += 1
        if taken + required > spare[m]:
            return False, 0.0, 0.0
    return True, total, bound_of(multipliers, value, drop, limit, soc)


def scaled(
    step: IntArray,
    low: IntArray,
    high: IntArray,
    value: FloatArray,
    drop: FloatArray,
    limit: FloatArray,
    spare: FloatArray,
    matrix: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Gradient, upper bounds, reach, units of the rows and largest gain of the QP; fills the rows of its matrix."""
    steps, size = len(spare), len(step)
    gradient, reach, units = np.empty(size), np.empty(size), np.full(steps, 1e-300)
    upper, largest = np.empty(size + steps), -math.inf
    for v in range(size):
        own, least = step[v], 1.0
        drop_rise = drop[own, high[v]] - drop[own, low[v]]
        limit_rise = limit[own, high[v]] - limit[own, low[v]]
        for m in range(own, steps):
            row = drop_rise + limit_rise if m == own else drop_rise
            matrix[size + m, v] = row
            if row > 0:
                least = min(least, spare[m] / row)
        reach[v] = max(least, MIN_REACH)
        upper[v] = 1.0 / reach[v]
        for m in range(own, steps):
            matrix[size + m, v] *= reach[v]
            units[m] = max(units[m], matrix[size + m, v])
        gradient[v] = (value[own, high[v]] - value[own, low[v]]) * reach[v]
        largest = max(largest, gradient[v])
    for m in range(steps):
        upper[size + m] = spare[m] / units[m]
        for v in range(size):
            if step[v] > m:
                break
            matrix[size + m, v] /= units[m]
    return gradient / -largest, upper, reach, units, largest


def unscaled(
    x: FloatArray, y: FloatArray, reach: FloatArray, units: FloatArray, largest: float
) -> tuple[FloatArray, FloatArray]:
    """Mixtures and multipliers of a solution of the QP."""
    z, multipliers = np.empty(len(reach)), np.empty(len(units))
    for v in range(len(z)):
        z[v] = min(max(x[v] * reach[v], 0.0), 1.0)
    for m in range(len(units)):
        multipliers[m] = max(y[len(z) + m], 0.0) * (largest / units[m])
    return z, multipliers


def levels_of(
    z: FloatArray,
    multipliers: FloatArray,
    step: IntArray,
    low: IntArray,
    high: IntArray,
    powers_w: FloatArray,
    rising: bool,
    value: FloatArray,
    drop: FloatArray,
    limit: FloatArray,
    soc: float,
    limited: bool,
) -> tuple[IntArray, FloatArray, float, float, int]:
    """The choices of mixtures, the mixtures' power [W], the choices' value, its bound, and the limit above them."""
    power_w = np.full(len(value), powers_w[0])
    for v in range(len(z)):
        power_w[step[v]] += z[v] * (powers_w[high[v]] - powers_w[low[v]])
    made = rounded(power_w, powers_w, rising, value, drop, limit, soc)
    objective, taken, above = 0.0, 0.0, NO_LIMIT
    for m in range(len(made)):
        objective += value[m, made[m]]
        j = min(made[m] + 1, len(powers_w) - 1)
        if drop[m, j] >= UNDELIVERABLE:
            above = BATTERYS
        if limited and above == NO_LIMIT and limit[m, j] > soc - (taken + drop[m, j]):
            above = LETTERS
        taken += drop[m, made[m]]
    return made, power_w, objective, bound_of(multipliers, value, drop, limit, soc), above


def rounded(
    power_w: FloatArray,
    powers_w: FloatArray,
    rising: bool,
    value: FloatArray,
    drop: FloatArray,
    limit: FloatArray,
    soc: float,
) -> IntArray:
    """The best choice of each step within the QP's power, verified; see `Horizon`."""
    steps, slack = len(power_w), FLOOR_SLACK * (powers_w[-1] - powers_w[0])
    made = np.zeros(steps, dtype=np.intp)
    violated, attempt = steps - 1, 0
    while violated >= 0:  # within the tolerance, exactly, and then a step lower each time
        if attempt < 2:
            for m in range(steps):
                j = len(powers_w) - 1
                while j > 0 and powers_w[j] > power_w[m] + (1 - attempt) * slack:
                    j -= 1
                made[m] = j if rising else best_of(value, m, j + 1)
        else:
            while made[violated] == 0:  # minimum power everywhere is feasible
                violated -= 1
            made[violated] = best_of(value, violated, made[violated])
        violated, attempt = violated_by(made, drop, limit, soc), attempt + 1
    mixed = np.zeros(steps, dtype=np.bool_)
    for m in range(steps):
        mixed[m] = power_w[m] > powers_w[made[m]] + slack
    while raised(made, mixed, value, drop, limit, soc):
        pass
    return made


def best_of(value: FloatArray, step: int, count: int) -> int:
    """The first of the best of a step's lowest choices."""
    best = 0
    for j in range(1, count):
        if value[step, j] > value[step, best]:
            best = j
    return best


def violated_by(made: IntArray, drop: FloatArray, limit: FloatArray, soc: float) -> int:
    """The first step whose power requires more charge than is left; -1 for none."""
    taken = 0.0
    for m in range(len(made)):
        taken += drop[m, made[m]]
        if not limit[m, made[m]] <= soc - taken:
            return m
    return -1


def raised(
    made: IntArray, mixed: BoolArray, value: FloatArray, drop: FloatArray, limit: FloatArray, soc: float
) -> bool:
    """Raise one mixed step to its next choice, if need be with an earlier step lowered; whether that was feasible."""
    steps, count = value.shape
    losses, shorts, choices = np.full(steps, math.inf), np.zeros(steps), np.zeros(steps, dtype=np.intp)
    taken, most = 0.0, -math.inf
    for m in range(steps):
        now = drop[m, made[m]]
        taken += now
        most = max(most, now - drop[m, 0])
        if mixed[m]:
            for j in range(made[m] + 1, count):
                if value[m, j] > value[m, made[m]]:
                    shorts[m], choices[m] = limit[m, j] - (soc - taken + now - drop[m, j]), j
                    if shorts[m] <= most:
                        losses[m] = value[m, made[m]] - value[m, j]
                    break
    while True:
        m = int(np.argmin(losses))
        if losses[m] == math.inf:
            return False
        before, made[m] = made[m], choices[m]
        # what a lower choice of an earlier step loses; the last entry lowers none
        lost = np.full(m * count + 1, math.inf)
        for other in range(m):
            for j in range(count):
                loss = value[other, made[other]] - value[other, j]
                enough = drop[other, made[other]] - drop[other, j] >= max(shorts[m], 1e-15)
                if enough and loss < -losses[m]:
                    lost[other * count + j] = loss
        if shorts[m] <= 0:
            lost[-1] = -math.inf
        for place in in_order(lost):
            other = place // count
            was, made[other] = made[other], made[other] if other == m else place % count
            if violated_by(made, drop, limit, soc) < 0:
                return True
            made[other] = was
        losses[m], made[m] = math.inf, before


def in_order(losses: FloatArray) -> IntArray:
    """Places of the finite losses, the least first, equal ones in order; by insertion, which compiles fast."""
    order, count = np.zeros(len(losses), dtype=np.intp), 0
    for place in range(len(losses)):
        if losses[place] < math.inf:
            at = count
            while at > 0 and losses[order[at - 1]] > losses[place]:
                order[at] = order[at - 1]
                at -= 1
            order[at] = place
            count += 1
    return order[:count]
