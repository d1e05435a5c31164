"""The battery's constants, a replayed state of charge, and faults. Source: letter, Sec. III-C."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from eadp.core.arrays import Efficiency, Seconds, Share
from eadp.core.flight import drain_per_s, interpolated, max_power_w
from eadp.errors import EadpError, printable
from eadp.plug_ins import plug_in

LETTER, CURRENT, CUT_OFF, DELIVERABLE = "letter", "current", "cut-off voltage", "deliverable power"
LIMITS = {
    LETTER: "the letter's limit of power",
    CURRENT: "the battery's current limit",
    CUT_OFF: "the battery's cut-off voltage",
    DELIVERABLE: "the battery's deliverable power",
}
"""Limits of power, and their names in words."""

CELL_V: dict[str, tuple[float, ...]] = {
    "lipo": (3.50, 4.20),
    "lihv": (3.55, 4.35),
    "li-ion": (3.20, 4.20),
    "lifepo4": (3.15, 3.40),
}
"""Open-circuit voltage of a cell [V] of each chemistry at even steps of the charge from empty to full, straight between
them: within 0.13 V of usual curves above a tenth of the charge. An empty cell's real voltage is lower: the curve bends
down at its end. Other packages offer curves of more points."""


CELL_OHM_AH = {"lipo": 0.04, "lihv": 0.04, "li-ion": 0.12, "lifepo4": 0.04}
"""Resistance of a cell times its capacity, wires and plugs among it [Ω Ah], by chemistry; others have lipo's. Within a
factor of 1.5 each.

Source: packs of `eadp init` (35 to 45 mΩ Ah); direct-current resistances of data sheets of round cells (70 mΩ Ah of
those for power, 150 of those for energy).
"""

Voltage = Annotated[float, Gt(0), Le(1e3)]
"""Packs of cars have up to 900 V; volts in mV are above."""
Resistance = Annotated[float, Ge(0), Le(10)]
"""A single cell of 0.1 Ah has about 0.3 Ω; most packs in mΩ are above 10."""
Capacity = Annotated[float, Ge(1e-6), Le(1e3)]
"""An aircraft of 150 kg that is half battery has 300 Ah at 50 V; most capacities in mAh are above 1000."""

UNSTATED: Any = None
"""Default of what `Battery` sets when it is made."""
ENDURANCE_STEPS = 1000
STEPS = 200
"""Steps of the charge at which the voltage of another package's cells is taken: half a percent, what gauges show."""


LOSS = 0.07
"""Mean of a sudden loss of charge that is to be expected, as a share of the full charge."""

CURVE_SHARE, RESISTANCE_SHARE = 0.2, 0.5
"""By how much a voltage may differ from the battery's: a share of the rise from empty to full, by which the curves of
usual cells differ from a straight line; and a share of the drop at the inner resistance, which is known roughly."""


def misfit(off_v: float, rise_v: float, drop_v: float) -> str:
    """Whether a voltage is `above` or `below` that of its charge, beyond what curves and resistances leave; or nothing.

    Parameters
    ----------
    off_v : float
        Open-circuit voltage less that of the charge [V].
    rise_v, drop_v : float
        Voltage from empty to full, and the drop at the inner resistance [V].
    """
    if abs(off_v) <= CURVE_SHARE * rise_v + RESISTANCE_SHARE * drop_v:
        return ""
    return "above" if off_v > 0 else "below"


@dataclass(frozen=True, slots=True)
class Battery:
    """A Rint battery, drained by the power it delivers, or a replayed state of charge.

    With `cells`, the open-circuit voltages are those of so many cells of the chemistry; a resistance that is not given
    is theirs, too.
    """

    voltage_v: Voltage = 14.8
    """Open-circuit voltage at full charge; at every charge if `voltage_empty_v` is not given [V]."""

    resistance_ohm: Resistance = UNSTATED
    """Inner resistance, as it is now [Ω]; by default 0.05, and of `cells` that of their chemistry and capacity."""

    capacity_ah: Capacity = 3.2
    """Charge of the full battery [Ah]."""

    k_b_per_s: Annotated[float, Ge(1e-9), Le(1e3)] = 1 / 3600
    """The letter's battery constant: the charge falls by k_b I / Q_c in a second [1/s]. An ideal battery has 1/3600."""

    soc: Efficiency = 1.0
    """State of charge at take-off, as a share of the full charge."""

    letter_crate_per_h: Annotated[float, Gt(0), Le(1e12)] | None = None
    """Limit of the power to b Q_c V times this, at a state of charge b, for the papers' flights; none by default [1/h]:
    the letter's Def. III.3."""

    prescribed: Annotated[tuple[tuple[Seconds, Share], ...], MinLen(1)] = ()
    """A trace [[time in s, state of charge], …] that is replayed instead: linear between points, held at its ends."""

    voltage_empty_v: Voltage | None = None
    """Open-circuit voltage of the empty battery; the voltage is linear in the charge then [V]."""

    max_c_rate: Annotated[float, Ge(1e-6), Le(1e6)] | None = None
    """Largest discharge current as a multiple of the capacity, at every charge; none by default [1/h]."""

    cutoff_voltage_v: Voltage | None = None
    """Voltage under load below which the battery counts as empty; none by default [V]."""

    chemistry: str | None = None
    """Chemistry of the cells, beside `cells`: lipo, lihv, li-ion, lifepo4, or one of another package; lipo if it is not
    given."""

    cells: Annotated[int, Ge(1), Le(1000)] | None = None
    """Number of cells in series: it gives `voltage_v` and `voltage_empty_v`, instead of them."""

    def __post_init__(self) -> None:
        ohm = 0.05
        if self.cells is not None:
            volts = cell_v(self.chemistry or "lipo") or CELL_V["lipo"]  # `faults` has a chemistry that is unknown
            object.__setattr__(self, "voltage_v", self.cells * volts[-1])
            object.__setattr__(self, "voltage_empty_v", self.cells * volts[0])
            ohm = self.cells * CELL_OHM_AH.get(self.chemistry or "lipo", CELL_OHM_AH["lipo"]) / self.capacity_ah
        if self.resistance_ohm is UNSTATED:
            object.__setattr__(self, "resistance_ohm", ohm)

    def faults(self) -> list[tuple[str, str]]:
        """Settings that contradict each other: the key, and what is wrong."""
        found = []
        if self.chemistry is not None and self.cells is None:
            found.append(("chemistry", "chemistry without cells"))
        if self.chemistry is not None and cell_v(self.chemistry) is None:
            found.append(("chemistry", f"chemistry {printable(self.chemistry, 60)} is none of {', '.join(CELL_V)}"))
        if self.voltage_empty_v is not None and self.voltage_empty_v > self.voltage_v:
            found.append(("voltage_empty_v", f"voltage_empty_v: {self.voltage_empty_v:g} V is above voltage_v"))
        if self.cutoff_voltage_v is not None and self.cutoff_voltage_v >= self.voltage_v:
            message = f"cutoff_voltage_v: {self.cutoff_voltage_v:g} V is not below voltage_v"
            found.append(("cutoff_voltage_v", message))
        if any(later < earlier for (earlier, _), (later, _) in itertools.pairwise(self.prescribed)):
            found.append(("prescribed", "prescribed: times that go back"))
        return found

    @property
    def curve(self) -> tuple[float, ...]:
        """Places of the voltage between empty and full, see `core.flight.level`; empty where it is linear."""
        return () if self.chemistry is None else _curve(self.chemistry)

    def voltage_at(self, soc: Any) -> Any:
        """Open-circuit voltage [V] at states of charge, a number or an array."""
        if self.voltage_empty_v is None:
            return self.voltage_v + 0 * soc  # of its shape
        place = interpolated(soc, self.curve) if self.curve else soc
        return self.voltage_empty_v + (self.voltage_v - self.voltage_empty_v) * place

    def soc_at(self, voltage_v: Any) -> Any:
        """State of charge at open-circuit voltages [V] that are not the same at each charge, an array; straight on
        beyond them."""
        empty_v, curve = self.voltage_at(0.0), self.curve
        place = (voltage_v - empty_v) / (self.voltage_v - empty_v)
        inside = (place > 0.0) & (place < 1.0) & bool(curve)
        return np.where(inside, np.interp(place, curve or (0, 1), np.linspace(0.0, 1.0, len(curve) or 2)), place)

    def energy_wh(self, soc: float) -> float:
        """b Q_c V [Wh] at a state of charge b. Source: letter, Def. III.3."""
        return soc * self.capacity_ah * float(self.voltage_at(soc))

    def endurance_s(self, power_w: float, reserve_soc: float = 0.0) -> float:
        """Time [s] from full charge until a constant power, above 0 [W], finds the reserve or is no longer delivered.

        Source: letter, Lem. III.3, integrated over the charge.
        """
        soc = reserve_soc + (1 - reserve_soc) * (np.arange(ENDURANCE_STEPS) + 0.5) / ENDURANCE_STEPS
        voltage_v = self.voltage_at(soc)
        voltage_v = voltage_v[self.max_power_w(voltage_v) >= power_w]
        # ∫ db / −ḃ, by the midpoint rule
        return float(np.sum(1 / self.drain_per_s(power_w, voltage_v))) * (1 - reserve_soc) / ENDURANCE_STEPS

    def drain_per_s(self, power_w: Any, voltage_v: Any) -> Any:
        """How fast the charge falls [1/s] under a power [W] at an open-circuit voltage [V], numbers or arrays.

        Beyond what can be delivered it is large.

        Source: letter, Eq. 22 and Lem. III.3.
        """
        return drain_per_s(power_w, voltage_v, self.resistance_ohm, self.drain_per_as)

    def drain_at_per_s(self, power_w: Any, soc: float) -> Any:
        """As `drain_per_s`, at a state of charge, which may be beyond 0 and 1."""
        return self.drain_per_s(power_w, self.voltage_at(min(max(soc, 0.0), 1.0)))

    @property
    def drain_per_as(self) -> float:
        """State of charge that an ampere takes in a second, k_b / Q_c [1/(A s)]."""
        return self.k_b_per_s / self.capacity_ah

    @property
    def max_current_a(self) -> float:
        """Largest discharge current [A]; infinite without `max_c_rate`."""
        return math.inf if self.max_c_rate is None else self.max_c_rate * self.capacity_ah

    def max_power_w(self, voltage_v: Any) -> Any:
        """Largest power [W] that it delivers at open-circuit voltages [V], a number or an array; the letter's aside."""
        return max_power_w(voltage_v, self.resistance_ohm, self.max_current_a, self.cutoff_voltage_v or 0.0)

    def power_limit_w(self, soc: float) -> float:
        """Largest power [W] allowed at a state of charge: that it delivers, and the letter's limit; may be infinite."""
        delivered = float(self.max_power_w(self.voltage_at(soc)))
        if self.letter_crate_per_h is None:
            return delivered
        return min(delivered, self.energy_wh(soc) * self.letter_crate_per_h)

    def limit_at(self, voltage_v: float) -> str:
        """Which limit is the `max_power_w` at an open-circuit voltage [V]."""
        r, cutoff_v = self.resistance_ohm, self.cutoff_voltage_v or 0.0
        if r * self.max_current_a < min(voltage_v / 2, voltage_v - cutoff_v):
            return CURRENT
        return CUT_OFF if voltage_v - cutoff_v < voltage_v / 2 else DELIVERABLE

    def undeliverable(self, power_w: float, soc: float) -> str:
        """Message for a power [W] above what it delivers at a state of charge, the letter's limit aside."""
        volts = self.voltage_at(soc)
        max_w, limit = float(self.max_power_w(volts)), LIMITS[self.limit_at(volts)]
        return f"{power_w:.1f} W exceeds the {max_w:.1f} W that {limit} allows at {volts:.4g} V"

    @property
    def power_per_soc_w(self) -> float:
        """Q_c V crate [W]: times b, the largest power that the letter allows; infinite without its limit."""
        return self.capacity_ah * self.voltage_v * (self.letter_crate_per_h or math.inf)

    @property
    def replay(self) -> list[float]:
        """The trace as `replayed_soc` takes it: the last of two points at one time counts from there on."""
        return [float(number) for point in self.prescribed for number in point]


def cell_v(chemistry: str) -> tuple[float, ...] | None:
    """Voltage of a cell at even steps of the charge [V]: of `CELL_V`, where the law of another package comes when it is
    first asked for, at `STEPS` steps; None of an unknown chemistry.

    Raises
    ------
    EadpError
        On a law whose voltage does not rise with the charge.
    """
    if chemistry not in CELL_V and (law := plug_in("batteries", chemistry)) is not None:
        volts = tuple(float(law(i / STEPS)) for i in range(STEPS + 1))
        if not (volts[0] > 0 and all(lower < upper for lower, upper in itertools.pairwise(volts))):
            raise EadpError(f"battery.chemistry {chemistry}: its voltage does not rise from above 0 V with the charge")
        CELL_V[chemistry] = volts
    return CELL_V.get(chemistry)


@cache
def _curve(chemistry: str) -> tuple[float, ...]:
    volts = cell_v(chemistry) or ()
    return tuple((each - volts[0]) / (volts[-1] - volts[0]) for each in volts) if len(volts) > 2 else ()


@dataclass(frozen=True, slots=True)
class BatteryFault:
    """A sudden loss of charge."""

    at_s: Seconds
    """Time of the loss [s]."""

    soc_drop: Share
    """Charge lost, as a share of the full charge."""
