"""`Horizon` in loops, for compiled code: what its methods do with arrays, for which plain Python is too slow in loops.

Both forms make the same choices; sums differ by their rounding. No function makes an array: what they fill is passed
in, as they compile in half the time then. Arrays that are passed to all of them:

- `table`, shape (3, M, J): value, use of charge and limit of every choice at every step
- `numbers`, shape (4, M), and `places`, shape (3, M): what is computed of each step
- `variables`, shape (3, V): step, lower and upper choice of a mixture's variables, in ascending order of the step
- `z`, shape (V,), and `multipliers`, shape (M,): of the last solution
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from eadp.core import compiled
from eadp.core.arrays import FloatArray, IntArray

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

VALUE, DROP, LIMIT = 0, 1, 2
"""Parts of a table."""

SPARE, MIXTURE_W, LOSS, SHORT = 0, 1, 2, 3
"""Rows of the numbers of each step: charge that the lowest power leaves, power of the mixture [W], and of the next
choice above what it loses (infinite without one) and the charge that it is short of."""

MADE, MIXED, ABOVE = 0, 1, 2
"""Rows of the places of each step: the choice made, whether the mixture's power is above it, the next choice above."""

STEP, LOWER, UPPER = 0, 1, 2
"""Rows of the variables."""

SCALE, BOUND, GRADIENT = 0, 1, 2
"""Rows of the scaled QP's vectors: reach of the variables and units of the rows, upper bounds, gradient."""


class Kernels(NamedTuple):
    """Those that are called."""

    stepped: Callable[..., Any]
    planned: Callable[..., Any]
    scaled: Callable[..., Any]
    unscaled: Callable[..., Any]


def kernels() -> Kernels | None:
    """Them, compiled; None where compiled code is off."""
    if not compiled.enabled():
        return None
    parts = tabled, bound_of, rounded, valued, best_of, violated_by, raised, lowered_for
    return Kernels(
        compiled.jitted(stepped, makes_arrays=False),
        compiled.jitted(planned, *parts, makes_arrays=False),
        compiled.jitted(scaled, makes_arrays=False),
        compiled.jitted(unscaled, makes_arrays=False),
    )


def stepped(rows: FloatArray, state: FloatArray, worst: bool, motion_w: FloatArray) -> None:
    """Motion power that limits each step, its largest or that at its end, and its mean, 0 or more [W], shape (2, M).

    `rows`, of shape (M n, m), read the power at n instants of each step off the state, of shape (m,).
    """
    steps = motion_w.shape[1]
    each = len(rows) // steps
    for m in range(steps):
        limit_w, total_w = -math.inf, 0.0
        for k in range(m * each, m * each + each):
            now_w = 0.0
            for i in range(len(state)):
                now_w += rows[k, i] * state[i]
            total_w += now_w
            if not worst or not now_w <= limit_w:
                limit_w = now_w
        motion_w[0, m], motion_w[1, m] = limit_w, max(total_w / each, 0.0)


def planned(
    tabling: bool,
    proving: bool,
    limit_motion_w: FloatArray,
    mean_motion_w: FloatArray,
    soc: float,
    step_s: float,
    powers_w: FloatArray,
    table: FloatArray,
    numbers: FloatArray,
    places: IntArray,
    variables: IntArray,
    z: FloatArray,
    multipliers: FloatArray,
    voltage_v: float,
    resistance_ohm: float,
    per_as: float,
    delivered_w: float,
    power_per_soc_w: float,
    limited: bool,
    rising: bool,
    optimal: float,
) -> tuple[bool, bool, float, float, float, int]:
    """The table if `tabling`; then, unless it is for no proof, the choices of the last solution.

    If `proving`, of that solution a step later, if it keeps to the constraints and is optimal within `optimal` of its
    bound; it is the last one then. Returns whether choices were made; whether all powers are delivered, and the least
    charge that the lowest ones leave, NaN if anything is not finite; value of the choices, its bound, and the limit
    above them.
    """
    deliverable, least, steps, size = True, 0.0, table.shape[1], len(z)
    if tabling:
        battery = voltage_v, resistance_ohm, per_as, delivered_w, power_per_soc_w
        deliverable, least = tabled(limit_motion_w, mean_motion_w, powers_w, soc, step_s, battery, table, numbers)
        if not (proving and deliverable and least >= 0):
            return False, deliverable, least, 0.0, 0.0, NO_LIMIT
    # the last step's variables and their multiplier: as before, and 0
    ahead = 1 if proving else 0
    later = ahead * (size // steps)
    bound, taken, value, v = bound_of(multipliers, ahead, table, soc), 0.0, 0.0, 0
    for m in range(steps):
        required, power_w = 0.0, powers_w[0]
        value += table[VALUE, m, 0]
        while v < size and variables[STEP, v] == m:
            low, high, share = variables[LOWER, v], variables[UPPER, v], z[v + later if v + later < size else v]
            taken += share * (table[DROP, m, high] - table[DROP, m, low])
            required += share * (table[LIMIT, m, high] - table[LIMIT, m, low])
            value += share * (table[VALUE, m, high] - table[VALUE, m, low])
            power_w += share * (powers_w[high] - powers_w[low])
            v += 1
        if proving and taken + required > numbers[SPARE, m]:
            return False, deliverable, least, 0.0, 0.0, NO_LIMIT
        numbers[MIXTURE_W, m] = power_w
    if proving:
        if not bound - value <= optimal * abs(bound):
            return False, deliverable, least, 0.0, 0.0, NO_LIMIT
        for v in range(size - later):
            z[v] = z[v + later]
        for m in range(steps):
            multipliers[m] = multipliers[m + 1] if m + 1 < steps else 0.0
    rounded(powers_w, rising, table, numbers, places, soc)
    objective, above = valued(table, places, soc, limited)
    return True, deliverable, least, objective, bound, above


def valued(table: FloatArray, places: IntArray, soc: float, limited: bool) -> tuple[float, int]:
    """Value of the choices made, and the limit that excludes the next above."""
    objective, taken, above, last = 0.0, 0.0, NO_LIMIT, table.shape[2] - 1
    for m in range(table.shape[1]):
        made = places[MADE, m]
        j = made + 1 if made < last else last
        objective += table[VALUE, m, made]
        drop, limit = table[DROP, m, j], table[LIMIT, m, j]
        if drop >= UNDELIVERABLE:
            above = BATTERYS
        if limited and above == NO_LIMIT and limit > soc - (taken + drop):
            above = LETTERS
        taken += table[DROP, m, made]
    return objective, above


def tabled(
    limit_motion_w: FloatArray,
    mean_motion_w: FloatArray,
    powers_w: FloatArray,
    soc: float,
    step_s: float,
    battery: tuple[float, float, float, float, float],
    table: FloatArray,
    numbers: FloatArray,
) -> tuple[bool, float]:
    """Use of charge and limit of choices; whether all powers are delivered; the least charge that the lowest leave."""
    voltage_v, resistance_ohm, per_as, delivered_w, power_per_soc_w = battery
    deliverable, total, left, least = True, soc, soc, math.inf
    for m in range(len(mean_motion_w)):
        for j in range(len(powers_w)):
            power_w = mean_motion_w[m] + powers_w[j]
            root = math.sqrt(max(voltage_v * voltage_v - 4 * resistance_ohm * power_w, 0.0))
            drop = per_as * 2 * power_w / (voltage_v + root) * step_s
            if power_w > delivered_w:
                deliverable, drop = False, UNDELIVERABLE
            limit = (limit_motion_w[m] + (powers_w[j] - FEASIBLE_W)) / power_per_soc_w
            table[DROP, m, j], table[LIMIT, m, j] = drop, limit
            total += drop + limit
        left -= table[DROP, m, 0]
        numbers[SPARE, m] = left - table[LIMIT, m, 0]
        least = min(least, numbers[SPARE, m])
    return deliverable, least if math.isfinite(total) else math.nan


def bound_of(multipliers: FloatArray, ahead: int, table: FloatArray, soc: float) -> float:
    """The Lagrangian bound of `horizon` for multipliers from one of them on, summed in the order of the objective."""
    steps, total = len(multipliers), 0.0
    for m in range(ahead, steps):
        total += multipliers[m]
    later, bound = total, 0.0
    for m in range(steps):
        own, best = multipliers[m + ahead] if m + ahead < steps else 0.0, -math.inf
        for j in range(table.shape[2]):
            net = table[VALUE, m, j] - own * table[LIMIT, m, j] - later * table[DROP, m, j]
            if net > best:
                best = net
        bound += best
        later -= own
    return bound + total * soc


def scaled(
    variables: IntArray, table: FloatArray, numbers: FloatArray, matrix: FloatArray, vectors: FloatArray
) -> float:
    """Fill the rows of the QP's matrix and its vectors, shape (3, V + M), and return its largest gain."""
    steps, size, largest = table.shape[1], variables.shape[1], -math.inf
    for m in range(steps):
        vectors[SCALE, size + m] = 1e-300
    for v in range(size):
        own, low, high, reach = variables[STEP, v], variables[LOWER, v], variables[UPPER, v], 1.0
        drop = table[DROP, own, high] - table[DROP, own, low]
        limit = table[LIMIT, own, high] - table[LIMIT, own, low]
        for m in range(own, steps):
            row = drop + limit if m == own else drop
            matrix[size + m, v] = row
            if row > 0:
                reach = min(reach, numbers[SPARE, m] / row)
        reach = max(reach, MIN_REACH)
        for m in range(own, steps):
            matrix[size + m, v] *= reach
            vectors[SCALE, size + m] = max(vectors[SCALE, size + m], matrix[size + m, v])
        gain = (table[VALUE, own, high] - table[VALUE, own, low]) * reach
        vectors[SCALE, v], vectors[BOUND, v], vectors[GRADIENT, v] = reach, 1.0 / reach, gain
        largest = max(largest, gain)
    for v in range(size):
        vectors[GRADIENT, v] /= -largest
        for m in range(variables[STEP, v], steps):
            matrix[size + m, v] /= vectors[SCALE, size + m]
    for m in range(steps):
        vectors[BOUND, size + m] = numbers[SPARE, m] / vectors[SCALE, size + m]
    return largest


def unscaled(
    x: FloatArray, y: FloatArray, vectors: FloatArray, largest: float, z: FloatArray, multipliers: FloatArray
) -> None:
    """Take mixtures and multipliers of a solution of the QP as the last ones."""
    size = len(z)
    for v in range(size):
        z[v] = min(max(x[v] * vectors[SCALE, v], 0.0), 1.0)
    for m in range(len(multipliers)):
        multipliers[m] = max(y[size + m], 0.0) * (largest / vectors[SCALE, size + m])


def rounded(
    powers_w: FloatArray, rising: bool, table: FloatArray, numbers: FloatArray, places: IntArray, soc: float
) -> None:
    """The best choice of each step within the mixture's power, verified; see `Horizon`."""
    steps, slack = table.shape[1], FLOOR_SLACK * (powers_w[-1] - powers_w[0])
    violated, attempt = steps - 1, 0
    while violated >= 0:  # within the tolerance, exactly, and then a step lower each time
        if attempt < 2:
            for m in range(steps):
                j = len(powers_w) - 1
                while j > 0 and powers_w[j] > numbers[MIXTURE_W, m] + (1 - attempt) * slack:
                    j -= 1
                places[MADE, m] = j if rising else best_of(table, m, j + 1)
        else:
            while places[MADE, violated] == 0:  # minimum power everywhere is feasible
                violated -= 1
            places[MADE, violated] = best_of(table, violated, places[MADE, violated])
        violated, attempt = violated_by(places, table, soc), attempt + 1
    mixed = False
    for m in range(steps):
        places[MIXED, m] = numbers[MIXTURE_W, m] > powers_w[places[MADE, m]] + slack
        mixed = mixed or places[MIXED, m] > 0
    while mixed:
        mixed = raised(table, numbers, places, soc)


def best_of(table: FloatArray, step: int, count: int) -> int:
    """The first of the best of a step's lowest choices."""
    best = 0
    for j in range(1, count):
        if table[VALUE, step, j] > table[VALUE, step, best]:
            best = j
    return best


def violated_by(places: IntArray, table: FloatArray, soc: float) -> int:
    """The first step whose power requires more charge than is left; -1 for none."""
    taken = 0.0
    for m in range(table.shape[1]):
        taken += table[DROP, m, places[MADE, m]]
        if not table[LIMIT, m, places[MADE, m]] <= soc - taken:
            return m
    return -1


def raised(table: FloatArray, numbers: FloatArray, places: IntArray, soc: float) -> bool:
    """Raise one mixed step to its next choice, if need be with an earlier step lowered; whether that was feasible."""
    steps, count = table.shape[1], table.shape[2]
    taken, most = 0.0, -math.inf
    for m in range(steps):
        numbers[LOSS, m], made = math.inf, places[MADE, m]
        now = table[DROP, m, made]
        taken += now
        most = max(most, now - table[DROP, m, 0])
        j = made + 1 if places[MIXED, m] else count
        while j < count and table[VALUE, m, j] <= table[VALUE, m, made]:
            j += 1
        if j < count:
            short = table[LIMIT, m, j] - (soc - taken + now - table[DROP, m, j])
            numbers[SHORT, m], places[ABOVE, m] = short, j
            if short <= most:
                numbers[LOSS, m] = table[VALUE, m, made] - table[VALUE, m, j]
    while True:
        least = 0
        for m in range(1, steps):
            if numbers[LOSS, m] < numbers[LOSS, least]:
                least = m
        if numbers[LOSS, least] == math.inf:
            return False
        made, places[MADE, least] = places[MADE, least], places[ABOVE, least]
        if (numbers[SHORT, least] <= 0 and violated_by(places, table, soc) < 0) or lowered_for(
            least, table, numbers, places, soc
        ):
            return True
        numbers[LOSS, least], places[MADE, least] = math.inf, made


def lowered_for(step: int, table: FloatArray, numbers: FloatArray, places: IntArray, soc: float) -> bool:
    """Lower an earlier step, by the least loss, in exchange for one that is raised; whether that was feasible."""
    count, last, at = table.shape[2], -math.inf, -1
    while True:
        # the next choice in the order of what it loses, equal ones in their own
        least, place = math.inf, -1
        for k in range(step * count):
            other, made = k // count, places[MADE, k // count]
            loss = table[VALUE, other, made] - table[VALUE, other, k % count]
            enough = table[DROP, other, made] - table[DROP, other, k % count] >= max(numbers[SHORT, step], 1e-15)
            if enough and loss < -numbers[LOSS, step] and loss < least and (loss > last or (loss == last and k > at)):
                least, place = loss, k
        if place < 0:
            return False
        made, places[MADE, place // count] = places[MADE, place // count], place % count
        if violated_by(places, table, soc) < 0:
            return True
        places[MADE, place // count] = made
        last, at = least, place
