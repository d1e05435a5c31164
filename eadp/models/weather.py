"""Wind: a steady part, which may change over time, and coloured gusts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from eadp.core.arrays import Degrees, Duration, MetresPerSecond, NotNegative, Share, Watts
from eadp.core.geometry.geodesy import blowing_to_rad, velocity_mps

ProfileRow = tuple[NotNegative, MetresPerSecond, Degrees]
"""Wind at a time [s]: speed [m/s], and where it comes from [°]."""


@dataclass(frozen=True, slots=True)
class Wind:
    """Steady wind from a direction, or one that changes over time, and first-order gusts on each axis."""

    speed_mps: MetresPerSecond = 0.0
    """Speed of the steady wind [m/s]."""

    from_deg: Degrees = 270.0
    """Where the wind comes from: a compass bearing, 0 north, 90 east [°]. A west wind is from 270."""

    towards_deg: Degrees | None = None
    """Where the wind blows towards, instead of `from_deg`: the papers' angle, 0 east, counter-clockwise [°]."""

    profile: tuple[ProfileRow, ...] = ()
    """Wind over time, instead of speed and direction: rows [time s, speed m/s, bearing it comes from °], times rising.
    Between rows its components are linear, beyond them constant. The forecast before take-off knows the wind at time 0
    alone."""

    gust_std_mps: MetresPerSecond = 0.0
    """Standard deviation of the gusts on each axis [m/s]."""

    gust_time_s: Duration = 5.0
    """Time constant of the gusts [s]."""

    @property
    def steady_mps(self) -> tuple[float, float]:
        """The steady wind's vector (east, north) at take-off [m/s]."""
        return self.steady_at_mps(0.0)

    def steady_at_mps(self, time_s: float) -> tuple[float, float]:
        """The steady wind's vector (east, north) at a time [s], in m/s."""
        if not self.profile:
            angle = blowing_to_rad(self.from_deg) if self.towards_deg is None else math.radians(self.towards_deg)
            return velocity_mps(self.speed_mps, angle)
        times, speeds, bearings = zip(*self.profile, strict=True)
        vectors = map(velocity_mps, speeds, map(blowing_to_rad, bearings))
        east, north = (float(np.interp(time_s, times, part)) for part in zip(*vectors, strict=True))
        return east, north

    @property
    def speeds_mps(self) -> tuple[float, float]:
        """The least and the greatest speed of the steady wind at the rows of its profile [m/s]."""
        speeds = [row[1] for row in self.profile] or [self.speed_mps]
        return min(speeds), max(speeds)


@dataclass(frozen=True, slots=True)
class Sensors:
    """Noise, delay and drop-outs of the sensors. The noise is white; by default there is none."""

    power_noise_w: Watts = 0.0
    """Standard deviation of the power reading's noise [W]."""

    position_noise_m: Annotated[float, Ge(0), Le(1e4)] = 0.0
    """Standard deviation of the position's noise on each axis [m]."""

    soc_noise: Share = 0.0
    """Standard deviation of the noise of the state of charge, as a share of the full charge."""

    delay_s: Annotated[float, Ge(0), Le(60)] = 0.0
    """Age of every reading when the planner gets it [s]."""

    drop_out_share: Share = 0.0
    """Share of the time without a power reading."""

    drop_out_s: Duration = 2.0
    """Mean length of a drop-out of the power reading [s]."""

    @property
    def ideal(self) -> bool:
        """Whether the readings are exact: every field as by default, the length of drop-outs aside."""
        return self == Sensors(drop_out_s=self.drop_out_s)
