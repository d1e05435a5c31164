"""Battery as a voltage behind a resistance (Rint): current and rate of discharge.

Source: letter, Sec. III-C, Eq. 22 and App. C.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import Infeasible


def current_a(power_w: float, voltage_v: float, resistance_ohm: float) -> float:
    """Battery current that delivers a power through its inner resistance.

    Parameters
    ----------
    power_w : float
        Power at the terminals [W].
    voltage_v, resistance_ohm : float
        Open-circuit voltage [V], above 0; inner resistance [Ω], 0 or more.

    Returns
    -------
    float
        Current [A]: the smaller root, so that no load draws no current.

    Raises
    ------
    Infeasible
        If the battery cannot deliver `power_w`: more than V²/(4R).

    Source: letter, Eq. 22.
    """
    # I = (V − √(V² − 4 R y)) / 2R, multiplied out so that R → 0 gives y/V
    discriminant = voltage_v * voltage_v - 4 * resistance_ohm * power_w
    if discriminant < 0:
        raise Infeasible(undeliverable(power_w, voltage_v, resistance_ohm))
    return 2 * power_w / (voltage_v + math.sqrt(discriminant))


def drains_per_s(power_w: Any, voltage_v: Any, resistance_ohm: float, per_as: float) -> Any:
    """Rate of discharge under powers, without an error beyond the deliverable power: for forecasts.

    Parameters
    ----------
    power_w, voltage_v : float or array
        Power at the terminals [W], open-circuit voltage [V], of shapes that go together.
    resistance_ohm : float
        Inner resistance [Ω].
    per_as : float
        State of charge that an ampere takes in a second, k_b / Q_c [1/(A s)].

    Returns
    -------
    float or array
        −ḃ [1/s]; beyond what can be delivered it is large.

    Source: letter, Eq. 22 and Lem. III.3.
    """
    # I = 2y/(V + √(V² − 4 R y)),  −ḃ = k_b I / Q_c
    root = np.sqrt(np.maximum(voltage_v**2 - 4 * resistance_ohm * power_w, 0.0))
    return per_as * 2 * power_w / (voltage_v + root)


def currents_a(power_w: FloatArray, voltage_v: float, resistance_ohm: float) -> FloatArray:
    """`current_a` of an array of powers [W], any shape; [A], the same shape.

    Source: letter, Eq. 22.
    """
    discriminant = voltage_v**2 - 4 * resistance_ohm * power_w
    if np.any(discriminant < 0):
        raise Infeasible(undeliverable(float(np.max(power_w)), voltage_v, resistance_ohm))
    return 2 * power_w / (voltage_v + np.sqrt(discriminant))


def current_slope_a_per_w(power_w: Any, voltage_v: float, resistance_ohm: float) -> Any:
    """dI/dy of `current_a` [A/W] at a power or an array of powers [W]: 1/√(V² − 4 R y).

    Raises
    ------
    Infeasible
        At the largest power that can be delivered, where the slope is infinite, and beyond it.

    Source: derivative of letter, Eq. 22.
    """
    discriminant = voltage_v**2 - 4 * resistance_ohm * power_w
    if np.any(discriminant <= 0):
        raise Infeasible(undeliverable(float(np.max(power_w)), voltage_v, resistance_ohm))
    return 1.0 / np.sqrt(discriminant)


def soc_rate_per_s(
    power_w: float, voltage_v: float, resistance_ohm: float, capacity_ah: float, k_b_per_s: float
) -> float:
    """ḃ [1/s] under a power [W]; negative while it is drained.

    Source: letter, Lem. III.3, ḃ = −k_b I(y)/Q_c; a perfect battery has k_b = 1/3600 per second.
    """
    return -k_b_per_s * current_a(power_w, voltage_v, resistance_ohm) / capacity_ah


def undeliverable(power_w: float, voltage_v: float, resistance_ohm: float) -> str:
    """Message for a power that the battery cannot deliver."""
    max_w = voltage_v**2 / (4 * resistance_ohm)
    return f"{power_w:.1f} W exceeds the {max_w:.1f} W that {voltage_v:g} V through {resistance_ohm:g} Ω can deliver"
