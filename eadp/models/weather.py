"""Wind: a steady part, which may change over time, and coloured gusts."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass

from eadp.core.bounds import Degrees, Duration, MetresPerSecond, NotNegative
from eadp.core.geometry.bearings import blowing_to_rad


@dataclass(frozen=True, slots=True)
class Wind:
    """Steady wind from a direction, or one that changes over time, and first-order gusts on each axis."""

    speed_mps: MetresPerSecond = 0.0
    """Speed of the steady wind [m/s]."""

    from_deg: Degrees = 270.0
    """Where the wind comes from: a compass bearing, 0 north, 90 east [°]. A west wind is from 270."""

    towards_deg: Degrees | None = None
    """Where the wind blows towards, instead of `from_deg`: the papers' angle, 0 east, counter-clockwise [°]."""

    profile: tuple[tuple[NotNegative, MetresPerSecond, Degrees], ...] = ()
    """Wind over time, instead of speed and direction: rows [time s, speed m/s, bearing it comes from °], times rising.
    Between rows its components are linear; before the first and after the last they are constant. The forecast before
    take-off knows the wind at time 0 alone."""

    gust_std_mps: MetresPerSecond = 0.0
    """Standard deviation of the gusts on each axis [m/s]."""

    gust_time_s: Duration = 5.0
    """Time constant of the gusts [s]."""

    @property
    def steady_mps(self) -> tuple[float, float]:
        """The steady wind's vector (east, north) at take-off [m/s]."""
        return self.steady_at_mps(0.0)

    @property
    def steady_speed_mps(self) -> float:
        """The steady wind's speed at take-off [m/s]: as stated where it does not change."""
        return math.hypot(*self.steady_mps) if self.profile else self.speed_mps

    def steady_at_mps(self, time_s: float) -> tuple[float, float]:
        """The steady wind's vector (east, north) at a time [m/s]."""
        if not self.profile:
            angle = blowing_to_rad(self.from_deg) if self.towards_deg is None else math.radians(self.towards_deg)
            return _vector(self.speed_mps, angle)
        times_s = [row[0] for row in self.profile]
        last = len(times_s) - 1
        after = min(bisect.bisect_right(times_s, time_s), last)
        before = max(after - 1, 0) if time_s < times_s[last] else last
        rows = self.profile[before], self.profile[after]
        (xa, ya), (xb, yb) = (_vector(speed, blowing_to_rad(from_deg)) for _, speed, from_deg in rows)
        span_s = times_s[after] - times_s[before]
        share = min(max((time_s - times_s[before]) / span_s, 0.0), 1.0) if span_s > 0 else 0.0
        return xa + share * (xb - xa), ya + share * (yb - ya)

    @property
    def speeds_mps(self) -> tuple[float, float]:
        """The least and the greatest speed of the steady wind at the rows of its profile [m/s]."""
        speeds = [speed for _, speed, _ in self.profile] or [self.speed_mps]
        return min(speeds), max(speeds)


def _vector(speed_mps: float, angle_rad: float) -> tuple[float, float]:
    return speed_mps * math.cos(angle_rad), speed_mps * math.sin(angle_rad)
