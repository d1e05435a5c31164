"""The battery's constants, a replayed state of charge, and faults. Source: letter, Sec. III-C."""

from __future__ import annotations

import bisect
from dataclasses import dataclass

from eadp.core.battery import current_a, soc_rate_per_s


@dataclass(frozen=True, slots=True)
class Battery:
    """A Rint battery. `crate_per_h` bounds the power by b Q_c V crate (letter, Def. III.3, with its missing unit)."""

    voltage_v: float = 14.8
    resistance_ohm: float = 0.05
    capacity_ah: float = 3.2
    k_b_per_s: float = 1 / 3600
    soc: float = 1.0
    crate_per_h: float = 10.0
    prescribed: tuple[tuple[float, float], ...] = ()

    def current_a(self, power_w: float) -> float:
        """Current [A] that delivers a power [W]. Raises Infeasible where it cannot."""
        return current_a(power_w, self.voltage_v, self.resistance_ohm)

    def rate_per_s(self, power_w: float) -> float:
        """ḃ [1/s] under a power [W]. Raises Infeasible where it cannot be delivered."""
        return soc_rate_per_s(power_w, self.voltage_v, self.resistance_ohm, self.capacity_ah, self.k_b_per_s)

    @property
    def power_per_soc_w(self) -> float:
        """Q_c V crate [W]: times b, the largest power allowed."""
        return self.capacity_ah * self.voltage_v * self.crate_per_h

    def prescribed_soc(self, time_s: float) -> float:
        """The replayed state of charge: linear between points, the last of two at one time, held at the ends."""
        points = self.prescribed
        after = bisect.bisect_right(points, time_s, key=lambda point: point[0])
        if after == 0:
            return points[0][1]
        t0, b0 = points[after - 1]
        if after == len(points):
            return b0
        t1, b1 = points[after]
        return b0 + (b1 - b0) * (time_s - t0) / (t1 - t0)


@dataclass(frozen=True, slots=True)
class Fault:
    """A sudden loss of charge."""

    at_s: float
    soc_drop: float
