"""Wind: a steady part and coloured gusts."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Wind:
    """Steady wind towards a direction (0° is east, 90° north) and first-order gusts on each axis."""

    speed_mps: float = 0.0
    towards_deg: float = 0.0
    gust_std_mps: float = 0.0
    gust_time_s: float = 5.0

    @property
    def steady_mps(self) -> tuple[float, float]:
        """The steady wind's vector (east, north) [m/s]."""
        angle = math.radians(self.towards_deg)
        return self.speed_mps * math.cos(angle), self.speed_mps * math.sin(angle)
