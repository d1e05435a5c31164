"""A Rint battery from a log of voltage and current: open-circuit voltage, linear in charge, and resistance.

The terminal voltage of the model is linear in what is sought, V = V₀ + (V₁ − V₀) b − R I, with the state of charge b
counted from the current. Capacity and k_b stand in b as one factor, and V₁ − V₀ takes up whatever they are wrong by:
they are given, or the capacity is that with which the voltage falls as a table of the cells' chemistry does.

Source: letter, Sec. III-C and Eq. 22 for the model; Huber 1964 for the weights; Newey and West 1987 for the covariance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from eadp.core.arrays import FloatArray
from eadp.core.flight.battery import interpolated
from eadp.core.signals.robust import regressed
from eadp.errors import Infeasible

MIN_SAMPLES = 20

MIN_CHARGE_USED = 0.05
"""Smallest share of the capacity that must be used for a slope of the voltage to be fitted."""

SIGNIFICANCE = 3.0
"""Distance from 0, in standard errors, at which a slope or a resistance is significant."""


@dataclass(frozen=True)
class BatteryFit:
    """Rint battery fitted to a log; standard errors hold under correlated noise.

    Attributes
    ----------
    voltage_full_v, voltage_empty_v : float, float or None
        Open-circuit voltage at full charge and without; None where it is taken as the same at any charge [V].
    resistance_ohm : float or None
        Inner resistance [Ω]; None where the current varies too little.
    voltage_full_std_v, voltage_empty_std_v, resistance_std_ohm : float
        Standard errors; 0 where there is no value.
    rms_v, constant_rms_v : float
        Error of the voltage [V], root mean square: of this fit, and of one whose voltage does not depend on charge.
    charge_from, charge_to : float
        State of charge at the start and at the end of the log.
    correlation_s : float
        Correlation time of the residuals [s]: unmodelled dynamics, mainly relaxation.
    notes : tuple of str
        What could not be estimated, and why.
    """

    voltage_full_v: float
    voltage_empty_v: float | None
    resistance_ohm: float | None
    voltage_full_std_v: float
    voltage_empty_std_v: float
    resistance_std_ohm: float
    rms_v: float
    constant_rms_v: float
    charge_from: float
    charge_to: float
    correlation_s: float
    notes: tuple[str, ...]


# fmt: off
CURVES_V = {
    "lipo": (3.27, 3.61, 3.69, 3.71, 3.73, 3.75, 3.77, 3.79, 3.80, 3.82, 3.84,
             3.85, 3.87, 3.91, 3.95, 3.98, 4.02, 4.08, 4.11, 4.15, 4.20),
    "li-ion": (2.90, 3.22, 3.37, 3.43, 3.47, 3.51, 3.54, 3.57, 3.60, 3.63, 3.67,
               3.72, 3.78, 3.83, 3.88, 3.92, 3.97, 4.01, 4.06, 4.11, 4.18),
}
# fmt: on
"""Open-circuit voltage of a cell at each twentieth of the charge [V], as tables of chargers (lipo) and data sheets of
18650 cells (li-ion) have it."""

FULL_SHARE = 0.95
"""Charge whose voltage is that of a full battery."""
MAX_GUESSED_CELLS = 8
"""Most cells in series that a voltage tells from one more."""


def is_full_at_rest(voltage_v: float, cells: int | None = None, cell_v: Sequence[float] = CURVES_V["lipo"]) -> bool:
    """Whether a voltage at rest is that of full cells: of so many, or of some number up to `MAX_GUESSED_CELLS`."""
    low, high = interpolated(FULL_SHARE, cell_v), cell_v[-1] + 0.05
    numbers = range(1, MAX_GUESSED_CELLS + 1) if cells is None else [cells]
    return any(low <= voltage_v / number <= high for number in numbers)


CURVE_STD_V = 0.01
"""Standard deviation of a cell's curve about the table [V], as far as it acts like a change of the capacity."""

MIN_DISCHARGE = 0.3
"""Smallest share of the capacity that must be used for it to be estimated."""
BOUND = 1e-4
"""Distance of a capacity's logarithm to that of the least the log allows, within which the search ended there: ten
times its tolerance."""


@dataclass(frozen=True)
class CapacityFit:
    """Capacity and its standard error, and the charge used in the log [Ah]."""

    capacity_ah: float
    std_ah: float
    used_ah: float


def _readings(*readings: ArrayLike) -> tuple[FloatArray, ...]:
    """Times [s], voltage [V], current [A] as arrays, and the charge used [A s]: the current is straight in between."""
    t, volts, amps = (np.asarray(values, dtype=float) for values in readings)
    if len(t) < MIN_SAMPLES:
        raise Infeasible(f"{len(t)} readings of voltage and current; {MIN_SAMPLES} or more are needed")
    return t, volts, amps, np.concatenate(([0.0], np.cumsum(np.diff(t) * (amps[1:] + amps[:-1]) / 2)))


def fit_capacity(
    times_s: ArrayLike,
    voltage_v: ArrayLike,
    current_a: ArrayLike,
    cells: int,
    cell_v: Sequence[float] = CURVES_V["lipo"],
    soc: float = 1.0,
) -> CapacityFit:
    """Capacity of a pack whose cells' open-circuit voltage is known, by how far the voltage falls with the charge used.

    Parameters
    ----------
    times_s, voltage_v, current_a : array, shape (n,)
        Times [s], increasing; voltage at the terminals [V]; current drawn [A].
    cells : int
        Cells in series.
    cell_v : sequence of float
        Open-circuit voltage of a cell [V] at even steps of the charge.
    soc : float
        State of charge at the start.

    Raises
    ------
    Infeasible
        If there are too few readings, or too little of the charge is used.

    Source: letter, Sec. III-C, with an open-circuit voltage V(b) of tables.
    """
    t, volts, amps, used = _readings(times_s, voltage_v, current_a)
    used_ah = used / 3600
    total = float(used_ah[-1])
    if total <= 0:
        raise Infeasible("the log uses no charge")

    def open_v(log_capacity: float) -> FloatArray:
        return cells * np.asarray(interpolated(soc - used_ah / math.exp(log_capacity), cell_v))

    def cost(log_capacity: float) -> float:
        rest = volts - open_v(log_capacity)
        # V = V(b) − R I
        left = rest + amps * max(0.0, -float(amps @ rest) / float(amps @ amps))
        return float(left @ left)

    grid = math.log(total / soc) + np.linspace(0.0, math.log(1.2 / MIN_DISCHARGE), 200)
    best = int(np.argmin([cost(float(x)) for x in grid]))
    around = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, len(grid) - 1)])
    found = float(minimize_scalar(cost, bounds=around, method="bounded").x)
    if found - grid[0] < BOUND:
        raise Infeasible(f"the voltage falls as if {total:.3g} Ah, which the log uses, were more than the cells held")
    if total / math.exp(found) < MIN_DISCHARGE:
        raise Infeasible(f"the voltage falls too little: {100 * MIN_DISCHARGE:.0f} % of the charge must be used")
    step = 1e-3
    slope = (open_v(found + step) - open_v(found - step)) / (2 * step)
    noise = regressed(np.stack([slope, -amps], axis=1), volts - open_v(found), t).std(0)
    curve = cells * CURVE_STD_V / max(float(np.sqrt(np.mean(slope**2))), 1e-9)
    capacity = math.exp(found)
    return CapacityFit(capacity, capacity * math.hypot(noise, curve), total)


def fit_battery(
    times_s: ArrayLike,
    voltage_v: ArrayLike,
    current_a: ArrayLike,
    capacity_ah: float,
    *,
    k_b_per_s: float = 1 / 3600,
    soc: float = 1.0,
) -> BatteryFit:
    """Fit a Rint battery to a log.

    Parameters
    ----------
    times_s, voltage_v, current_a : array, shape (n,)
        Times [s], increasing; voltage at the terminals [V]; current drawn [A].
    capacity_ah, k_b_per_s : float
        Capacity [Ah] and k_b [1/s], which such a log does not determine.
    soc : float
        State of charge at the start.

    Raises
    ------
    Infeasible
        If there are too few readings, or the current used is more than the charge there was.

    Source: letter, Sec. III-C.
    """
    t, volts, amps, used = _readings(times_s, voltage_v, current_a)
    # ḃ = −k_b I/Q_c
    charge = soc - k_b_per_s * used / capacity_ah
    if charge.min() < -0.02:
        drawn = float(used.max()) / 3600
        raise Infeasible(f"the log draws {drawn:.3g} Ah, more than {soc:g} of a capacity of {capacity_ah:g} Ah")
    notes = ["capacity and k_b cannot be estimated from voltage and current: they are as given"]
    vary = float(np.ptp(charge)) >= MIN_CHARGE_USED
    if not vary:
        used_share = f"only {100 * np.ptp(charge):.1f} % of the charge is used"
        notes.append(f"{used_share}: the voltage is taken as the same at any charge")
    constant = regressed(np.stack([np.ones_like(amps), -amps], axis=1), volts, t)
    linear = regressed(np.stack([np.ones_like(amps), -amps, charge], axis=1), volts, t) if vary else None
    if linear is not None and not linear.values[2] > SIGNIFICANCE * linear.std(2):
        notes.append("the voltage does not fall with the charge beyond doubt: it is taken as the same at any charge")
        linear = None
    fit = linear or constant
    ohm, ohm_std = float(fit.values[1]), fit.std(1)
    found = ohm > SIGNIFICANCE * ohm_std
    if not found:
        varies = f"the current varies by {np.std(amps):.3g} A about {np.mean(amps):.3g} A"
        notes.append(f"the resistance cannot be estimated: {varies}, which gives {ohm:.3g} ± {ohm_std:.2g} Ω")
        # without a resistance, fit the terminal voltage
        columns = [np.ones_like(amps), charge] if linear else [np.ones_like(amps)]
        fit = regressed(np.stack(columns, axis=1), volts, t)
    ends = np.zeros((2, len(fit.values)))  # without charge, and full
    ends[:, 0] = 1.0
    if linear:
        ends[1, -1] = 1.0
    empty, full = (ends @ fit.values).tolist()
    empty_std, full_std = np.sqrt(np.einsum("ij,jk,ik->i", ends, fit.covariance, ends))
    return BatteryFit(
        full,
        empty if linear else None,
        ohm if found else None,
        float(full_std),
        float(empty_std) if linear else 0.0,
        ohm_std if found else 0.0,
        fit.rms,
        constant.rms,
        float(charge[0]),
        float(charge[-1]),
        fit.correlation_s,
        tuple(notes),
    )
