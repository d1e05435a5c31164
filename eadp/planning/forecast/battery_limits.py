"""What the battery's limits of power leave for the computations along routes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray
from eadp.core.flight import drain_per_s, max_power_w, min_voltage_v
from eadp.models.battery import Battery
from eadp.models.plan.route import RouteArrays

DELIVERABLE = 0.999
"""Share of the power that the battery can deliver at which computations are planned."""


class RouteLoad(NamedTuple):
    """Time and power on the legs of routes.

    Attributes
    ----------
    times_s : array, shape (legs,)
        Time left [s].
    motion_w, peak_w : array, shape (legs,)
        Mean and greatest power of the motion [W].
    min_w, max_w : array, shape (legs,)
        Least and greatest power of the computations [W].
    """

    times_s: FloatArray
    motion_w: FloatArray
    peak_w: FloatArray
    min_w: FloatArray
    max_w: FloatArray


class PowerLimits(NamedTuple):
    """Limits of the battery's power along routes.

    Attributes
    ----------
    volts : array, shape (legs,)
        Open-circuit voltage [V].
    room_w : array, shape (legs,)
        Greatest power of the computations that the battery allows [W].
    truncated, by_letter : array of bool, shape (legs,)
        Where the battery excludes configurations, and where b Q_c V crate is its least limit.
    beyond_w : array, shape (routes,)
        Excess of the minimum power over what the full battery can deliver [W]; 0 where there is none.
    letter_soc, delivered_soc : array, shape (routes,)
        Final states of charge below which the minimum power exceeds b Q_c V crate, or what the battery can deliver,
        somewhere on the route.
    """

    volts: FloatArray
    room_w: FloatArray
    truncated: BoolArray
    by_letter: BoolArray
    beyond_w: FloatArray
    letter_soc: FloatArray
    delivered_soc: FloatArray

    @property
    def min_soc(self) -> FloatArray:
        """Final state of charge that the limits require, shape (routes,)."""
        return np.maximum(self.letter_soc, self.delivered_soc)


def power_limits(
    legs: RouteArrays, load: RouteLoad, battery: Battery, soc: float, reserve_soc: float, use_ratio: FloatArray
) -> PowerLimits:
    """Voltage along routes, and what the battery's limits leave.

    The state of charge falls as computations of maximum power drain it, but not below the reserve, nor below what the
    minimum power requires at the end of the route.

    Parameters
    ----------
    legs : RouteArrays
    load : RouteLoad
    battery : Battery
    soc, reserve_soc : float
        State of charge now, and the one to keep at the end.
    use_ratio : array, shape (routes,)
        Ratio of charge used to charge predicted.

    Source: letter, Def. III.3; Rint battery.
    """
    b, times_s = battery, load.times_s
    voltage_varies = b.voltage_at(1.0) > b.voltage_at(0.0)
    limits = b.resistance_ohm, b.max_current_a, b.cutoff_voltage_v or 0.0
    per_as = (b.drain_per_as * use_ratio)[legs.place]
    # least power that has to be delivered at the peak; and the mean power of the highest computations
    base_w, greatest_w = load.peak_w + load.min_w, load.motion_w + load.max_w
    # the lowest charge at the end of each route; and the charge at which each leg's minimum power can be delivered
    floor: FloatArray = np.full(len(legs.first), min(reserve_soc, soc))
    required = np.zeros(len(times_s))
    if voltage_varies:
        required = b.soc_at(min_voltage_v(base_w, *limits))
        floor = np.maximum(floor, np.minimum(soc, required[legs.last]))
    volts = b.voltage_at(np.maximum(floor, 0.0)[legs.place])
    charge_end = volts
    # the drain depends on the voltage, and the voltage on the charge: in turns
    for _ in range(3 if voltage_varies else 1):
        taken = times_s * drain_per_s(greatest_w, volts, b.resistance_ohm, 1.0) * per_as
        # no more than to the floor; the voltage of a leg is that of the charge in its middle
        scale = np.minimum(1.0, (soc - floor) / np.maximum(legs.sums(taken), 1e-12))
        taken = taken * scale[legs.place]
        charge_end = soc - legs.running(taken)
        volts = b.voltage_at(np.maximum(charge_end + taken / 2, 0.0))
    deliverable_w = DELIVERABLE * max_power_w(volts, *limits)
    allowed_w = deliverable_w
    if b.power_per_soc_w < math.inf:
        allowed_w = np.minimum(deliverable_w, np.maximum(charge_end, 0.0) * b.power_per_soc_w)
    beyond_w = base_w - float(max_power_w(b.voltage_at(soc), *limits))
    # what minimum power uses after each leg: a charge required at a leg, less this, is required at the route's end
    base_use = times_s * drain_per_s(load.motion_w + load.min_w, volts, b.resistance_ohm, 1.0) * per_as
    later_use = legs.sums(base_use)[legs.place] - legs.running(base_use)
    room_w = allowed_w - load.peak_w
    greatest_of = np.maximum.reduceat  # over the legs of each route
    return PowerLimits(
        volts=volts,
        room_w=room_w,
        truncated=load.max_w > room_w,
        by_letter=allowed_w < deliverable_w,
        beyond_w=np.maximum(greatest_of(beyond_w, legs.first), 0.0),
        letter_soc=greatest_of(base_w / b.power_per_soc_w - later_use, legs.first),
        delivered_soc=greatest_of(required - later_use, legs.first),
    )


MIN_STD = 1e-6
"""Least standard deviation of a final state of charge."""

LOSS_SQUARE = (0.12**3 - 0.02**3) / 3 / 0.1
"""Mean square of a loss of charge, uniform in 2 to 12 %, with the mean `LOSS`; losses are a Poisson process."""
