"""Battery as a voltage behind a resistance (Rint): current and rate of discharge.

Source: letter, Sec. III-C, Eq. 22 and App. C.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eadp.core.arrays import Column


def drain_per_s(power_w: Any, voltage_v: Any, resistance_ohm: float, per_as: float) -> Any:
    """Rate of discharge under powers, without an error beyond the deliverable power: for forecasts.

    It may be compiled for numbers. On numbers in plain Python numpy's functions take 0.9 µs, those of `math` 0.2.

    Parameters
    ----------
    power_w, voltage_v : float or array
        Power at the terminals [W], open-circuit voltage [V], of shapes that go together.
    resistance_ohm : float
        Inner resistance [Ω].
    per_as : float
        State of charge that an ampere takes in a second, k_b / Q_c [1/(A s)]; 1 for the current [A].

    Returns
    -------
    float or array
        −ḃ [1/s]; beyond what can be delivered it is large.

    Source: letter, Eq. 22 and Lem. III.3, ḃ = −k_b I(y)/Q_c; a perfect battery has k_b = 1/3600 per second.
    """
    # I = (V − √(V² − 4 R y)) / 2R, multiplied out so that R → 0 gives y/V;  −ḃ = k_b I / Q_c
    return per_as * 2 * power_w / (voltage_v + _root_v(power_w, voltage_v, resistance_ohm))


def current_slope_a_per_w(power_w: Any, voltage_v: Any, resistance_ohm: float) -> Any:
    """dI/dy of the current [A/W] at a power [W] and an open-circuit voltage [V], numbers or arrays: 1/√(V² − 4 R y).

    At most 10/V, for forecasts: it is infinite at the largest power that can be delivered.

    Source: derivative of letter, Eq. 22.
    """
    return 1.0 / np.maximum(_root_v(power_w, voltage_v, resistance_ohm), 0.1 * voltage_v)


def _root_v(power_w: Any, voltage_v: Any, resistance_ohm: float) -> Any:
    """√(V² − 4 R y) [V]; 0 beyond what can be delivered."""
    return np.sqrt(np.maximum(voltage_v * voltage_v - 4 * resistance_ohm * power_w, 0.0))


def interpolated(soc: Any, values: Sequence[float]) -> Any:
    """Values of states of charge, a number or an array, among those at even steps of it; held at its ends."""
    return np.interp(soc, np.linspace(0.0, 1.0, len(values)), values)


def level(soc: float, curve: Column) -> float:
    """Place of the open-circuit voltage between that of the empty battery, 0, and that of the full one, 1.

    It may be compiled.

    Parameters
    ----------
    soc : float
        State of charge, 0 to 1.
    curve : sequence of float
        Places at even steps of the charge, straight between them; empty where the voltage is linear in the charge.
    """
    if len(curve) == 0:
        return soc
    last = len(curve) - 2
    i = min(int(soc * (last + 1)), last)
    return curve[i] + (curve[i + 1] - curve[i]) * (soc * (last + 1) - i)


def max_power_w(voltage_v: Any, resistance_ohm: float, max_current_a: float, cutoff_v: float) -> Any:
    """Largest power that a battery delivers at the terminals.

    Parameters
    ----------
    voltage_v : float or array
        Open-circuit voltage [V].
    resistance_ohm : float
        Inner resistance [Ω].
    max_current_a : float
        Largest discharge current [A]; infinite for none.
    cutoff_v : float
        Least voltage at the terminals [V]; 0 for none.

    Returns
    -------
    float or array
        V I − R I² at the largest current [W]: `max_current_a`, the one of the cut-off voltage (V − V_cut)/R, or V/(2R),
        where the power is greatest.
    """
    drop_v = np.maximum(np.minimum(voltage_v / 2, voltage_v - cutoff_v), 0.0)
    if resistance_ohm == 0:
        return np.where(drop_v > 0, voltage_v * max_current_a, 0.0)
    current = np.minimum(drop_v / resistance_ohm, max_current_a)
    return current * (voltage_v - resistance_ohm * current)


def min_voltage_v(power_w: Any, resistance_ohm: float, max_current_a: float, cutoff_v: float) -> Any:
    """Open-circuit voltage below which a power above 0 [W] is not delivered [V]: the inverse of `max_power_w`."""
    # V = U + R I at I = y/U, where U is at least V_cut, y/I_max and V/2, which is √(R y)
    terminal_v = np.maximum(np.maximum(power_w / max_current_a, cutoff_v), np.sqrt(resistance_ohm * power_w))
    return terminal_v + resistance_ohm * power_w / np.maximum(terminal_v, 1e-12)


def replayed_soc(trace: Sequence[float], time_s: float) -> float:
    """State of charge of a trace at a time [s]: linear between its points, held beyond them.

    Parameters
    ----------
    trace : sequence of float
        Time [s] and charge of each point in turn, times in order; of two at one time the last counts from there on.
    """
    low, high = 0, len(trace) // 2
    while low < high:  # after the last point that is not later
        middle = (low + high) // 2
        if trace[2 * middle] <= time_s:
            low = middle + 1
        else:
            high = middle
    if low == 0:
        return trace[1]
    t0, b0 = trace[2 * low - 2], trace[2 * low - 1]
    if 2 * low == len(trace):
        return b0
    return b0 + (trace[2 * low + 1] - b0) * (time_s - t0) / (trace[2 * low] - t0)


def undeliverable(power_w: float, voltage_v: float, resistance_ohm: float) -> str:
    """Message for a power beyond V²/(4R)."""
    max_w = voltage_v**2 / (4 * resistance_ohm)
    return f"{power_w:.1f} W exceeds the {max_w:.1f} W that {voltage_v:g} V through {resistance_ohm:g} Ω can deliver"
