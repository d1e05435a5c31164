"""Wind: a steady part and coloured gusts."""

from __future__ import annotations

import math
from dataclasses import dataclass

from eadp.core.bounds import Degrees, Duration, MetresPerSecond
from eadp.core.geometry.bearings import blowing_to_rad


@dataclass(frozen=True, slots=True)
class Wind:
    """Steady wind from a direction, and first-order gusts on each axis."""

    speed_mps: MetresPerSecond = 0.0
    """Speed of the steady wind [m/s]."""

    from_deg: Degrees = 270.0
    """Where the wind comes from: a compass bearing, 0 north, 90 east [°]. A west wind is from 270."""

    towards_deg: Degrees | None = None
    """Where the wind blows towards, instead of `from_deg`: the papers' angle, 0 east, counter-clockwise [°]."""

    gust_std_mps: MetresPerSecond = 0.0
    """Standard deviation of the gusts on each axis [m/s]."""

    gust_time_s: Duration = 5.0
    """Time constant of the gusts [s]."""

    @property
    def steady_mps(self) -> tuple[float, float]:
        """The steady wind's vector (east, north) [m/s]."""
        angle = blowing_to_rad(self.from_deg) if self.towards_deg is None else math.radians(self.towards_deg)
        return self.speed_mps * math.cos(angle), self.speed_mps * math.sin(angle)
